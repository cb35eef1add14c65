//! Presses and small drags against finite elements and closed forms.

use super::*;
use crate::indenter::spec::Shape;
use crate::indenter::{IndenterSpec, from_spec};

/// Converged finite elements: frictionless sphere R 4, d 0.25 mm, fixed-corotated, E 0.145, nu 0.45.
/// Columns: r, height, rest radius, u_r, u_theta, u_z (mm, um).
const SPHERE_BY_FINITE_ELEMENTS: &str = include_str!("../sphere_by_finite_elements.csv");

/// Displacement of the face at rest position (x, y), mm.
fn displacement(s: &QuasiStaticSolver, x: f64, y: f64) -> DVec3 {
    let grid = s.finest().grid();
    let (i, wx) = Grid::trace(x, grid.size[0], grid.nx);
    let (j, wy) = Grid::trace(y, grid.size[1], grid.ny);
    let mut out = [0.0; 3];
    for (c, o) in out.iter_mut().enumerate() {
        let plane = &s.finest().displacement()[grid.at(c, grid.layers() - 1)..];
        for b in 0..3 {
            for a in 0..3 {
                *o += wx[a] * wy[b] * f64::from(plane[(j + b) * grid.cx() + i + a]);
            }
        }
    }
    DVec3::from_array(out)
}

/// Root mean square difference from the finite elements within twice the contact radius, and the bulge, um.
pub(super) fn against_finite_elements(s: &QuasiStaticSolver) -> (f64, f64) {
    let (mut sum, mut n, mut bulge_um) = (0.0, 0, 0.0f64);
    for line in SPHERE_BY_FINITE_ELEMENTS.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|v| v.parse().expect("a number")).collect();
        for direction in 0..8 {
            let (sin, cos) = (0.1 + 0.785 * f64::from(direction)).sin_cos();
            let u_z = 1e3 * displacement(s, row[2] * cos, row[2] * sin).z;
            bulge_um = bulge_um.max(u_z);
            // Twice the contact radius of 1.094 mm.
            if row[2] < 2.19 {
                sum += (u_z - row[5]).powi(2);
                n += 1;
            }
        }
    }
    ((sum / f64::from(n)).sqrt(), bulge_um)
}

#[test]
fn a_frictionless_sphere_agrees_with_finite_elements() {
    let mut s = solver(Friction::Coefficient(0.0), Arc::new(Sphere(4.0)), Law::FixedCorotated);
    s.advance(&Pose::new(0.0, 0.0, -0.25, 0.0)).expect("an easy press");
    let capture = s.capture(201, 201).expect("a lattice");
    let forces = capture.forces;
    // Counted in relief, and where the lattice is too coarse for that.
    let coarse = s.capture(31, 31).expect("a lattice");
    for area_mm2 in [capture.stats.contact_area_mm2, coarse.stats.contact_area_mm2] {
        let radius = (area_mm2 / std::f64::consts::PI).sqrt();
        assert!((radius - 1.094).abs() < 0.02 * 1.094, "{radius}");
    }
    let marked = capture.contact.iter().filter(|c| **c).count() as f64 * 0.01;
    assert!((marked - capture.stats.contact_area_mm2).abs() < 0.05 * marked, "{marked} mm2");
    assert!((forces.normal_force_n - 0.0794).abs() < 0.01 * 0.0794, "{forces:?}");
    let (rmse_um, bulge_um) = against_finite_elements(&s);
    assert!(rmse_um < 2.5, "1 % of the depth is 2.5 um: {rmse_um}");
    assert!((bulge_um - 2.41).abs() < 0.24, "{bulge_um}");
}

#[test]
fn the_error_asked_for_is_met_against_finite_elements_and_the_one_stated_is_honest() {
    for tolerance in [0.1, 0.05, 0.02, 0.01, 0.005] {
        let settings = Settings { tolerance, ..settings(Friction::Coefficient(0.0)) };
        let start = Pose::new(0.0, 0.0, 0.5, 0.0);
        let pad = pad(Law::FixedCorotated);
        let mut s = QuasiStaticSolver::new(&pad, &settings, Arc::new(Sphere(4.0)), &start).expect("in range");
        s.advance(&Pose::new(0.0, 0.0, -0.25, 0.0)).expect("an easy press");
        let stated = s.capture(2, 2).expect("a lattice").stats.estimated_error.expect("a press");
        let found = against_finite_elements(&s).0 / 250.0;
        assert!(found < tolerance, "asked for {tolerance}: {found}, stated {stated}");
        assert!(stated > 0.6 * found, "found {found}, stated {stated}");
    }
}

#[test]
fn a_small_press_agrees_with_the_exact_bonded_layer() {
    // R 4, h 4, E 0.145, nu 0.45, d 0.1: F = 0.0183889 N at small strain, infinite width.
    let resolution = Resolution { cell_mm: 0.25, ..Resolution::for_tolerance(0.01) };
    let pad = Pad { size_x_mm: 16.0, size_y_mm: 16.0, ..pad(Law::NeoHookean) };
    let start = Pose::new(0.0, 0.0, 0.5, 0.0);
    let frictionless = settings(Friction::Coefficient(0.0));
    let mut s =
        QuasiStaticSolver::with_resolution(&pad, &frictionless, resolution, Arc::new(Sphere(4.0)), &start)
            .expect("settings are in range");
    s.advance(&Pose::new(0.0, 0.0, -0.1, 0.0)).expect("an easy press");
    let force = s.capture(2, 2).expect("a lattice").forces.normal_force_n;
    assert!((force - 0.018_388_9).abs() < 0.03 * 0.018_388_9, "{force}");
}

#[test]
fn tangential_and_torsional_stiffness_follow_the_half_space_and_the_layer_is_stiffer() {
    let (a, g, nu) = (2.7, 0.05, 0.45);
    let start = Pose::new(0.0, 0.0, -0.1, 0.0);
    let pressed = solver(Friction::Infinite, Arc::new(Punch(a, 0.3)), Law::NeoHookean);
    let shear = |pose: &Pose| {
        let mut s = pressed.fork();
        s.advance(&start).expect("an easy press");
        s.advance(pose).expect("a small move");
        s.capture(2, 2).expect("a lattice").forces
    };
    // Mindlin: Q = 8 G a s / (2 - nu); Reissner and Sagoci: T = 16/3 G a^3 beta. The flat part has the
    // radius a - 0.3 .. a; the layer of 4 mm is 10 to 40 % stiffer.
    let q = -shear(&Pose::new(0.05, 0.0, -0.1, 0.0)).shear_force_n[0];
    let half_space = 8.0 * g * a * 0.05 / (2.0 - nu);
    assert!(q > half_space && q < 1.45 * half_space, "{q} against {half_space}");
    let t = -shear(&Pose::new(0.0, 0.0, -0.1, 2.0)).torque_n_mm;
    let half_space = 16.0 / 3.0 * g * a.powi(3) * 2f64.to_radians();
    assert!(t > 0.75 * half_space && t < 1.25 * half_space, "{t} against {half_space}");
}

/// Normal force, N, of a body pressed so deep into the usual pad, as captured on 201 x 201 points.
fn force_n(body: &Arc<dyn Indenter>, law: Law, friction: Friction, depth_mm: f64) -> f64 {
    force_of_pad_n(&pad(law), body, friction, depth_mm)
}

/// The same of a pad.
fn force_of_pad_n(pad: &Pad, body: &Arc<dyn Indenter>, friction: Friction, depth_mm: f64) -> f64 {
    let start = Pose::new(0.0, 0.0, 0.3, 0.0);
    let mut s = QuasiStaticSolver::new(pad, &settings(friction), body.clone(), &start).unwrap();
    s.advance(&Pose { z_mm: -depth_mm, ..start }).expect("an easy press");
    s.capture(201, 201).expect("a lattice").forces.normal_force_n
}

#[test]
fn presses_are_as_hard_as_by_axisymmetric_finite_elements() {
    // On a disc as large as the pad, biquadratic elements of 0.025 to 0.05 mm at the contact's edge: known to 0.1 %.
    let (free, stuck) = (Friction::Coefficient(0.0), Friction::Infinite);
    let sphere: Arc<dyn Indenter> = Arc::new(Sphere(4.0));
    let small: Arc<dyn Indenter> = Arc::new(Sphere(2.0));
    let punch: Arc<dyn Indenter> = Arc::new(Punch(3.0, 0.3));
    let cone = narrow::small_cone(0.3);
    let (fc, nh) = (Law::FixedCorotated, Law::NeoHookean);
    for (name, body, law, friction, depth_mm, truth_n) in [
        ("sphere", &sphere, fc, free, 0.5, 0.25429),
        ("sphere", &sphere, fc, free, 1.0, 0.84993),
        ("sphere", &sphere, nh, free, 0.5, 0.26199),
        ("sphere", &sphere, nh, free, 1.0, 0.89741),
        ("sphere", &sphere, fc, stuck, 0.5, 0.25599),
        ("sphere", &sphere, fc, stuck, 1.0, 0.88336),
        ("sphere", &sphere, nh, stuck, 0.5, 0.26381),
        ("sphere", &sphere, nh, stuck, 1.0, 0.93434),
        ("small sphere", &small, fc, free, 0.5, 0.15024),
        ("small sphere", &small, fc, free, 1.0, 0.45138),
        ("small sphere", &small, fc, stuck, 0.5, 0.15144),
        ("small sphere", &small, fc, stuck, 1.0, 0.47054),
        ("punch", &punch, fc, free, 0.5, 1.1549),
        ("punch", &punch, fc, free, 1.0, 2.2436),
        ("punch", &punch, fc, stuck, 0.5, 1.2202),
        ("punch", &punch, fc, stuck, 1.0, 2.6213),
        ("cone", &cone, fc, free, 0.5, 0.08876),
        ("cone", &cone, fc, stuck, 0.5, 0.09346),
        ("cone", &cone, fc, stuck, 1.0, 0.21666),
    ] {
        let found_n = force_n(body, law, friction, depth_mm);
        assert!(
            (found_n / truth_n - 1.0).abs() < 0.01,
            "{name}, {law:?}, {friction:?}, {depth_mm} mm: {found_n} N instead of {truth_n}"
        );
    }
    for (poisson_ratio, friction, truth_n) in
        [(0.40, free, 0.23512), (0.49, free, 0.27480), (0.40, stuck, 0.23545), (0.49, stuck, 0.27898)]
    {
        let mut pad = pad(fc);
        pad.material.poisson_ratio = poisson_ratio;
        let found_n = force_of_pad_n(&pad, &sphere, friction, 0.5);
        assert!(
            (found_n / truth_n - 1.0).abs() < 0.01,
            "nu {poisson_ratio}, {friction:?}: {found_n} N instead of {truth_n}"
        );
    }
    // A cap of radius 20 mm, 16 mm across.
    let shape = Shape::Dome { radius_mm: 20.0, diameter_mm: 16.0 };
    let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.3, height_mm: 8.0, shape };
    let cap = from_spec("cap", &spec, None).expect("a body");
    for (friction, truth_n) in [(free, 1.1135), (stuck, 1.1540)] {
        let found_n = force_n(&cap, fc, friction, 0.5);
        assert!(
            (found_n / truth_n - 1.0).abs() < 0.01,
            "cap, {friction:?}: {found_n} N instead of {truth_n}"
        );
    }
}
