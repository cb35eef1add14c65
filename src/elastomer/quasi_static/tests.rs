//! Physics of the quasi-static solver against other people's numbers.

mod friction;
mod narrow;
mod pads;

use super::grid::Grid;
use super::layer::{Passage, RestLayer};
use super::operator::Operator;
use super::stack::Stack;
use super::*;
use crate::elastomer::{ContactForces, Friction, Law, Material, PadShape};
use glam::DVec3;

/// A sphere whose lowest point is the tip.
#[derive(Debug)]
pub(super) struct Sphere(pub f64);

impl Indenter for Sphere {
    fn name(&self) -> &str {
        "sphere"
    }
    fn distance(&self, p: DVec3) -> f64 {
        (p - DVec3::new(0.0, 0.0, self.0)).length() - self.0
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let d = p - DVec3::new(0.0, 0.0, self.0);
        (d.length() - self.0, d.normalize_or(DVec3::NEG_Z))
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [self.0, self.0]
    }
    fn lower_surface(&self, x: f64, y: f64) -> Option<f64> {
        let s = self.0 * self.0 - x * x - y * y;
        (s >= 0.0).then(|| self.0 - s.sqrt())
    }
}

pub(super) fn pad(law: Law) -> Pad {
    let material = Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 };
    Pad::slab([20.0, 20.0, 4.0], material)
}

pub(super) fn settings(friction: Friction) -> Settings {
    Settings { mode: crate::elastomer::Mode::QuasiStatic, friction, ..Settings::default() }
}

/// A cylinder of radius a with its lower edge rounded by r.
#[derive(Debug)]
pub(super) struct Punch(pub f64, pub f64);

impl Punch {
    fn eval(&self, p: DVec3) -> (f64, DVec3) {
        // 2D: q = (rho, z); rounded box |rho| <= a, 0 <= z <= 20.
        let rho = p.x.hypot(p.y);
        let dir = if rho > 0.0 { DVec3::new(p.x / rho, p.y / rho, 0.0) } else { DVec3::X };
        let (a, r) = (self.0 - self.1, self.1);
        let (zc, hz) = (10.0, 10.0 - self.1);
        let (dx, dz) = (rho - a, (p.z - zc).abs() - hz);
        let sz = if p.z >= zc { 1.0 } else { -1.0 };
        if dx > 0.0 && dz > 0.0 {
            let l = dx.hypot(dz);
            (l - r, dir * (dx / l) + DVec3::Z * (sz * dz / l))
        } else if dx > dz {
            (dx - r, dir)
        } else {
            (dz - r, DVec3::Z * sz)
        }
    }
}

impl Indenter for Punch {
    fn name(&self) -> &str {
        "punch"
    }
    fn distance(&self, p: DVec3) -> f64 {
        self.eval(p).0
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        self.eval(p)
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [self.0, self.0]
    }
    fn lower_surface(&self, _: f64, _: f64) -> Option<f64> {
        None
    }
}

/// Converged finite elements: frictionless sphere R 4, d 0.25 mm, fixed-corotated, E 0.145, nu 0.45.
/// Columns: r, height, rest radius, u_r, u_theta, u_z (mm, um).
const SPHERE_BY_FINITE_ELEMENTS: &str = include_str!("sphere_by_finite_elements.csv");

fn solver(friction: Friction, indenter: Arc<dyn Indenter>, law: Law) -> QuasiStaticSolver {
    QuasiStaticSolver::new(&pad(law), &settings(friction), indenter, &Pose::new(0.0, 0.0, 1.0, 0.0))
        .expect("settings are in range")
}

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
fn against_finite_elements(s: &QuasiStaticSolver) -> (f64, f64) {
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
fn the_base_carries_what_the_indenter_presses_and_unloading_returns_to_rest() {
    let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::NeoHookean);
    s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("an easy press");
    let c = s.capture(21, 21).expect("a lattice");
    let balance = (c.stats.base_reaction_n - c.forces.normal_force_n).abs() / c.forces.normal_force_n;
    assert!(balance < 1e-3, "{balance}");
    assert!(c.contact[10 * 21 + 10] && !c.contact[0]);
    s.advance(&Pose::new(0.0, 0.0, 0.1, 0.0)).expect("lifting off");
    let c = s.capture(21, 21).expect("a lattice");
    assert!(c.surface.positions.iter().all(|p| p.z.abs() < 1e-3));
}

/// Control values of the displacement u_z = stretch (z + t), u_x = shear (z + t).
fn homogeneous(grid: &Grid, stretch: f64, shear: f64) -> Vec<f32> {
    let mut knots = vec![0.0; 3];
    for h in &grid.hz {
        knots.push(knots[knots.len() - 1] + h);
    }
    let end = knots[knots.len() - 1];
    knots.extend([end, end]);
    let mut u = vec![0.0; grid.field_len()];
    for k in 0..grid.layers() {
        let z = 0.5 * (knots[k + 1] + knots[k + 2]);
        u[grid.at(2, k)..][..grid.plane()].fill((stretch * z) as f32);
        u[grid.at(0, k)..][..grid.plane()].fill((shear * z) as f32);
    }
    u
}

/// Force of the pad on its base, per area, for a homogeneous deformation.
fn base_traction(law: Law, stretch: f64, shear: f64) -> [f64; 2] {
    let material = pad(law).material;
    let grid = Grid::new([8.0, 8.0, 4.0], 0.5, 0.8, 1.25);
    let u = homogeneous(&grid, stretch, shear);
    let operator = Operator::new(grid.clone(), law, &Stack::coated(&grid, &material, None), None);
    let mut force = vec![0.0; grid.field_len()];
    operator.evaluate(&u, &mut force, &mut operator::Tangent::default());
    let sum = |c: usize| -> f64 {
        force[grid.at(c, 0)..][..grid.plane()].iter().map(|v| f64::from(*v)).sum::<f64>() / -64.0
    };
    [sum(0), sum(2)]
}

#[test]
fn patch_tests_are_exact_for_both_laws() {
    let m = pad(Law::NeoHookean).material;
    let (mu, lambda) = (m.mu_mpa(), m.lambda_mpa());
    for l in [0.7f64, 0.95, 1.3] {
        let [_, corotated] = base_traction(Law::FixedCorotated, l - 1.0, 0.0);
        assert!((corotated - (2.0 * mu + lambda) * (l - 1.0)).abs() < 1e-5, "l {l}: {corotated}");
        let [_, neo] = base_traction(Law::NeoHookean, l - 1.0, 0.0);
        assert!((neo - (mu * (l - 1.0 / l) + lambda * l.ln() / l)).abs() < 1e-5, "l {l}: {neo}");
    }
    let [neo, _] = base_traction(Law::NeoHookean, 0.0, 0.25);
    assert!((neo - mu * 0.25).abs() < 1e-5, "{neo}");
    // Simple shear of 0.25 under the fixed-corotated law: 0.0125965 MPa (analytic tables).
    let [corotated, _] = base_traction(Law::FixedCorotated, 0.0, 0.25);
    assert!((corotated - 0.012_596_5).abs() < 1e-5, "{corotated}");
}

/// A smooth field with no symmetry, zero at the base and within `margin` control points of the sides.
fn wavy(grid: &Grid, size: f32, margin: usize) -> Vec<f32> {
    let mut u = vec![0.0; grid.field_len()];
    for c in 0..3 {
        for k in 1..grid.layers() {
            for j in margin..grid.cy() - margin {
                for i in margin..grid.cx() - margin {
                    let phase = 0.7 * i as f32 + 1.1 * j as f32 * (1.0 + c as f32) + 0.4 * k as f32;
                    u[grid.at(c, k) + j * grid.cx() + i] = size * phase.sin();
                }
            }
        }
    }
    u
}

/// Squares of what a tangent is off the central difference of forces `eps` to both sides, over its own; the bonded
/// layer does not count.
fn off_difference(grid: &Grid, forces: &[Vec<f32>; 2], eps: f32, along: &[f32]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for i in (0..grid.field_len()).filter(|i| !(i / grid.plane()).is_multiple_of(grid.layers())) {
        let difference = (forces[1][i] - forces[0][i]) / (2.0 * eps);
        error += f64::from(difference - along[i]).powi(2);
        norm += f64::from(along[i]).powi(2);
    }
    error / norm
}

#[test]
fn the_tangent_is_the_derivative_of_the_forces_and_symmetric() {
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        let grid = Grid::new([8.0, 8.0, 4.0], 0.5, 0.8, 1.25);
        let operator = Operator::new(grid.clone(), law, &Stack::uniform(&grid, 0.05, 0.45), None);
        let n = grid.field_len();
        let (u, d) = (wavy(&grid, 0.1, 0), wavy(&grid, 1.0, 3));
        let mut tangent = operator::Tangent::default();
        let mut forces = [vec![0.0; n], vec![0.0; n]];
        let eps = 1e-3;
        for (f, sign) in forces.iter_mut().zip([-eps, eps]) {
            let moved: Vec<f32> = u.iter().zip(&d).map(|(u, d)| u + sign * d).collect();
            operator.evaluate(&moved, f, &mut tangent);
        }
        let mut here = vec![0.0; n];
        operator.evaluate(&u, &mut here, &mut tangent);
        let mut along = vec![0.0; n];
        operator.apply(&tangent, &d, &mut along);
        let off = off_difference(&grid, &forces, eps, &along);
        assert!(off < 1e-5, "{law:?}: {}", off.sqrt());
        let e: Vec<f32> = wavy(&grid, 1.0, 1).iter().rev().copied().collect();
        let mut back = vec![0.0; n];
        operator.apply(&tangent, &e, &mut back);
        let mut masked = e.clone();
        for c in 0..3 {
            masked[grid.at(c, 0)..][..grid.plane()].fill(0.0);
        }
        operator.apply(&tangent, &masked, &mut back);
        let (a, b) = (newton::dot(&masked, &along), newton::dot(&d, &back));
        assert!((a - b).abs() < 1e-4 * newton::dot(&along, &along).sqrt() * newton::dot(&e, &e).sqrt());
    }
}

#[test]
fn the_rest_layer_inverts_the_operator_away_from_the_sides() {
    let grid = Grid::new([8.0, 8.0, 4.0], 0.5, 0.8, 1.25);
    let stack = Stack::uniform(&grid, 0.05, 0.45);
    let operator = Operator::new(grid.clone(), Law::FixedCorotated, &stack, None);
    let layer = RestLayer::new(&grid, &stack);
    let n = grid.field_len();
    let x = wavy(&grid, 1.0, 5);
    let (mut force, mut back) = (vec![0.0; n], vec![0.0; n]);
    let mut tangent = operator::Tangent::default();
    operator.evaluate(&vec![0.0; n], &mut force, &mut tangent);
    operator.apply(&tangent, &x, &mut force);
    let mut passage = Passage::default();
    layer.enter(&force, &mut passage);
    let mut face = vec![0.0; 3 * grid.plane()];
    layer.face(&passage, &mut face);
    layer.leave(&mut passage, None, &mut back);
    for (c, face) in face.chunks(grid.plane()).enumerate() {
        let known = &back[grid.at(c, grid.layers() - 1)..];
        assert!(
            face.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-4),
            "the face is known before the rest"
        );
    }
    let error = x.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(error < 1e-3, "{error}");
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

#[test]
fn a_long_slide_ends_in_full_sliding_at_coulombs_force() {
    let mut s = solver(Friction::Coefficient(0.2), Arc::new(Sphere(4.0)), Law::NeoHookean);
    s.advance(&Pose::new(-0.5, 0.0, -0.3, 0.0)).expect("an easy press");
    for i in 1..=4 {
        s.advance(&Pose::new(-0.5 + 0.25 * f64::from(i), 0.0, -0.3, 0.0)).expect("a slide");
    }
    let f = s.capture(2, 2).expect("a lattice").forces;
    let ratio = -f.shear_force_n[0] / f.normal_force_n;
    // The face slips along a slope and over stretched material, so the force is a little above mu N.
    assert!((0.2..0.2 * 1.06).contains(&ratio), "{f:?}");
    assert!(f.shear_force_n[1].abs() < 1e-3 * f.normal_force_n);
}

#[test]
fn slides_of_five_millimetres_go_through_and_leave_the_face_whole() {
    // Coarse, to be quick.
    let resolution = Resolution { cell_mm: 1.25, ..Resolution::for_tolerance(0.01) };
    for friction in [Friction::Coefficient(0.8), Friction::Infinite] {
        let start = Pose::new(0.0, 0.0, 0.2, 0.0);
        let indenter = Arc::new(Sphere(3.0));
        let settings = settings(friction);
        let pad = pad(Law::NeoHookean);
        let mut s = QuasiStaticSolver::with_resolution(&pad, &settings, resolution, indenter, &start)
            .expect("settings are in range");
        for x in 0..=5 {
            s.advance(&Pose::new(f64::from(x), 0.0, -0.5, 0.0)).expect("a slide");
            let c = s.capture(81, 81).expect("a lattice");
            let n = c.forces.normal_force_n;
            assert!((c.stats.base_reaction_n - n).abs() < 0.01 * n, "{friction:?} at {x}: {c:?}");
            // Nothing folds under the tip, nothing stands up in front of it.
            let deepest = c.surface.positions.iter().map(|p| p.z).fold(0.0, f32::min);
            let highest = c.surface.positions.iter().map(|p| p.z).fold(0.0, f32::max);
            assert!(deepest > -0.6 && highest < 0.1, "{friction:?} at {x}: {deepest} {highest}");
            assert!(x == 0 || c.forces.shear_force_n[0] < -0.3 * n, "{friction:?} at {x}: {:?}", c.forces);
        }
        s.advance(&Pose::new(5.0, 0.0, 0.2, 0.0)).expect("lifting off");
        let c = s.capture(21, 21).expect("a lattice");
        assert!(c.surface.positions.iter().all(|p| p.z.abs() < 1e-3));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::FixedCorotated);
            s.advance(&Pose::new(0.1, 0.0, -0.3, 0.0)).expect("an easy press");
            // The first by the splines alone, the second in relief.
            [31, 101].map(|n| s.capture(n, n).expect("a lattice"))
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn a_pose_that_no_indenter_can_have_is_refused() {
    for pose in [
        Pose::new(f64::NAN, 0.0, -0.4, 0.0),
        Pose::new(0.0, 0.0, f64::NEG_INFINITY, 0.0),
        Pose::new(0.0, 0.0, -4.0, 0.0),
        Pose::new(0.0, 1e6, 1.0, 0.0),
    ] {
        let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::NeoHookean);
        assert!(matches!(s.advance(&pose), Err(Error::Pose { .. })), "{pose}");
    }
}

/// A blade along y, thinner than the way from one sample point to the next.
#[derive(Debug)]
struct Blade;

impl Indenter for Blade {
    fn name(&self) -> &str {
        "blade"
    }
    fn distance(&self, p: DVec3) -> f64 {
        let q = DVec3::new(p.x.abs() - 0.1, p.y.abs() - 5.0, (p.z - 5.0).abs() - 5.0);
        q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let step = |axis: DVec3| self.distance(p + axis * 1e-6) - self.distance(p - axis * 1e-6);
        let normal = DVec3::new(step(DVec3::X), step(DVec3::Y), step(DVec3::Z));
        (self.distance(p), normal.normalize_or(DVec3::NEG_Z))
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [0.1, 5.0]
    }
    fn lower_surface(&self, x: f64, y: f64) -> Option<f64> {
        (x.abs() <= 0.1 && y.abs() <= 5.0).then_some(0.0)
    }
}

#[test]
fn a_blade_that_the_sample_points_miss_is_told_as_an_error() {
    let settings = Settings { tolerance: 0.05, ..settings(Friction::Coefficient(0.0)) };
    let mut s = QuasiStaticSolver::new(
        &pad(Law::NeoHookean),
        &settings,
        Arc::new(Blade),
        &Pose::new(0.0, 0.0, 1.0, 0.0),
    )
    .unwrap();
    s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).unwrap();
    let capture = s.capture(41, 41).unwrap();
    let stated = capture.stats.estimated_error.expect("a press");
    let deepest = capture.surface.positions.iter().fold(0.0, |d: f32, p| d.min(p.z));
    // Either the blade dents the face as deep as it stands, or the capture says how far that is from true.
    let missing = f64::from(0.5 + deepest) / 0.5;
    assert!(stated > 0.5 * missing, "stated {stated}, the dent lacks {missing} of the depth");
}

#[test]
fn a_waypoint_that_is_asked_for_again_is_as_it_was_and_takes_nothing() {
    let mut s = solver(Friction::Coefficient(0.5), Arc::new(Punch(2.7, 0.3)), Law::FixedCorotated);
    let pose = Pose::new(0.0, 0.0, -0.5, 0.0);
    s.advance(&pose).expect("an easy press");
    let first = s.capture(51, 51).expect("a lattice");
    s.advance(&pose).expect("where it is");
    let again = s.capture(51, 51).expect("a lattice");
    assert_eq!((again.stats.iterations, again.stats.passes), (0, 0));
    assert_eq!(first.surface.positions, again.surface.positions);
    assert_eq!(first.forces, again.forces);
}

#[test]
fn contact_at_the_edge_is_refused_and_before_touch_nothing_is_computed() {
    let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::FixedCorotated);
    s.advance(&Pose::new(5.0, 5.0, 0.2, 30.0)).expect("the air is free");
    let c = s.capture(5, 5).expect("a lattice");
    assert_eq!((c.stats.iterations, c.forces), (0, ContactForces { normal_force_n: -0.0, ..c.forces }));
    let refused = s.advance(&Pose::new(9.5, 0.0, -0.2, 0.0));
    assert!(matches!(refused, Err(Error::OffPad { .. })), "{refused:?}");
}

#[test]
fn what_states_too_much_is_solved_with_finer_cells_until_it_is_let_go() {
    let settings = Settings { tolerance: 0.02, ..settings(Friction::Infinite) };
    let start = Pose::new(0.0, 0.0, 0.2, 0.0);
    let punch = Arc::new(Punch(1.75, 0.02));
    let solver = |resolution: Option<Resolution>| {
        // Small, to be quick.
        let pad = Pad { size_x_mm: 10.0, size_y_mm: 10.0, ..pad(Law::NeoHookean) };
        match resolution {
            None => QuasiStaticSolver::new(&pad, &settings, punch.clone(), &start),
            Some(r) => QuasiStaticSolver::with_resolution(&pad, &settings, r, punch.clone(), &start),
        }
        .expect("settings are in range")
    };
    let coarse = Resolution::for_tolerance(settings.tolerance).for_body(punch.as_ref(), [10.0, 10.0, 4.0]);
    let press = Pose::new(0.0, 0.0, -0.3, 0.0);
    let drag = Pose::new(0.1, 0.0, -0.3, 0.0);
    let run = |s: &mut QuasiStaticSolver, pose: &Pose| {
        s.advance(pose).expect("an easy way");
        (s.finest().grid().nx, s.capture(41, 41).expect("a lattice"))
    };
    let (mut given, mut s) = (solver(Some(coarse)), solver(None));
    let (cells, before) = run(&mut given, &press);
    let stated = |c: &ElastomerCapture| c.stats.estimated_error.expect("a press");
    assert!(stated(&before) > 2.0 * settings.tolerance, "{}", stated(&before));
    let (finer, pressed) = run(&mut s, &press);
    assert!(finer > cells && stated(&pressed) <= 2.0 * settings.tolerance, "{finer} {}", stated(&pressed));
    assert!(pressed.stats.iterations > before.stats.iterations, "work on levels that are left counts");
    // A copy goes the same way.
    let mut copy = s.fork();
    // It is dragged with them, and as well.
    let (again, dragged) = run(&mut s, &drag);
    let (_, plain) = run(&mut given, &drag);
    assert!(stated(&plain) > 2.25 * settings.tolerance, "{}", stated(&plain));
    assert!(again >= finer && stated(&dragged) <= 2.25 * settings.tolerance, "{again} {}", stated(&dragged));
    copy.advance(&drag).expect("an easy way");
    assert_eq!(copy.capture(41, 41).expect("a lattice").surface, dragged.surface);
    assert_eq!(run(&mut s, &start).0, cells);
    assert_eq!(run(&mut s, &press).1.surface, pressed.surface);
}

#[test]
fn a_fork_goes_on_as_the_original_does_to_the_bit() {
    let mut s = solver(Friction::Coefficient(0.5), Arc::new(Sphere(4.0)), Law::NeoHookean);
    s.advance(&Pose::new(0.0, 0.0, -0.2, 0.0)).expect("an easy press");
    let mut fork = s.fork();
    let slide = [0.1, 0.2].map(|x_mm| Pose::new(x_mm, 0.0, -0.2, 0.0));
    let [original, forked] = [&mut s as &mut dyn Elastomer, fork.as_mut()].map(|s| {
        slide.iter().for_each(|pose| s.advance(pose).expect("an easy slide"));
        s.capture(41, 41).expect("a lattice").surface
    });
    assert_eq!(original, forked);
}

#[test]
fn a_nearly_incompressible_pad_that_is_let_go_comes_back_and_at_once() {
    let mut pad = Pad { size_x_mm: 8.0, size_y_mm: 8.0, thickness_mm: 2.0, ..pad(Law::NeoHookean) };
    pad.material.poisson_ratio = 0.499;
    let settings = Settings { tolerance: 0.1, ..settings(Friction::Coefficient(0.0)) };
    let start = Pose::new(0.0, 0.0, 0.3, 0.0);
    let mut s = QuasiStaticSolver::new(&pad, &settings, Arc::new(Sphere(1.0)), &start).expect("in range");
    let [shallow, deep, lifted] = [-0.06, -0.2, -0.06].map(|z_mm| {
        s.advance(&Pose::new(0.0, 0.0, z_mm, 0.0)).expect("an easy way");
        let c = s.capture(2, 2).expect("a lattice");
        (c.forces.normal_force_n, c.stats.iterations)
    });
    assert!(deep.0 > 5.0 * shallow.0, "{deep:?}");
    assert!((lifted.0 / shallow.0 - 1.0).abs() < 2e-3, "{lifted:?} after {shallow:?}");
    // Halved for every direction without stiffness that is met on the way, it takes 52.
    assert!(lifted.1 < 35, "{lifted:?}");
}

#[test]
fn a_first_tenth_of_a_millimetre_to_a_coarse_tolerance_takes_no_finer_cells_than_to_the_usual_one() {
    let first = |tolerance: f64| {
        let settings = Settings { tolerance, ..settings(Friction::Infinite) };
        let start = Pose::new(0.0, 0.0, 0.2, 0.0);
        let mut s = QuasiStaticSolver::new(&pad(Law::NeoHookean), &settings, Arc::new(Sphere(4.0)), &start)
            .expect("in range");
        s.advance(&Pose::new(0.0, 0.0, -0.1, 0.0)).expect("an easy press");
        let stated = s.capture(101, 101).expect("a lattice").stats.estimated_error.expect("a press");
        assert!(stated < refinement::wanted(tolerance), "{tolerance}: {stated}");
        s.finest().grid().nx
    };
    let usual = first(0.01);
    assert!(first(0.02) <= usual, "{usual}");
}

#[test]
fn a_drag_states_no_more_than_was_asked_for() {
    let settings = Settings { tolerance: 0.1, ..settings(Friction::Infinite) };
    let start = Pose::new(0.0, 0.0, 0.5, 0.0);
    let sphere = Arc::new(Sphere(4.0));
    let mut s = QuasiStaticSolver::new(&pad(Law::NeoHookean), &settings, sphere, &start).expect("in range");
    // A contact of the size of a cell.
    for n in 0..3 {
        s.advance(&Pose::new(0.1 * f64::from(n), 0.0, -0.06, 0.0)).expect("an easy way");
        let stated = s.capture(2, 2).expect("a lattice").stats.estimated_error.expect("a press");
        assert!(stated < settings.tolerance, "{n}: {stated}");
    }
}

#[test]
fn a_flat_punch_presses_as_hard_over_the_usual_cells_as_over_fine_ones() {
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};
    let shape = Shape::Flat { plan: Plan::Disc { diameter_mm: 5.4 } };
    let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.3, height_mm: 8.0, shape };
    let punch = from_spec("punch", &spec, None).expect("a disc");
    let force_n = |tolerance: f64, cell_mm: Option<f64>| {
        let settings = Settings { tolerance, ..settings(Friction::Coefficient(0.0)) };
        let (pad, start) = (pad(Law::NeoHookean), Pose::new(0.0, 0.0, 0.2, 0.0));
        let usual = Resolution::for_tolerance(tolerance);
        let resolution = Resolution { cell_mm: cell_mm.unwrap_or(usual.cell_mm), ..usual };
        let mut s = QuasiStaticSolver::with_resolution(&pad, &settings, resolution, punch.clone(), &start)
            .expect("in range");
        s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("an easy press");
        s.capture(2, 2).expect("a lattice").forces.normal_force_n
    };
    let (usual, fine) = (force_n(0.01, None), force_n(0.01, Some(0.25)));
    assert!((usual / fine - 1.0).abs() < 0.01, "{usual} instead of {fine}");
}
