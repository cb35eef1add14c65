//! Pads that are not flat, and pads with a skin.

use super::super::chart::Chart;
use super::elastic::{off_difference, wavy};
use super::*;
use crate::elastomer::Coating;
use glam::DVec2;

const RADIUS_MM: f64 = 13.5;

fn bent(shape: PadShape) -> Pad {
    Pad { shape, size_x_mm: 18.0, size_y_mm: 18.0, thickness_mm: 3.0, ..pad(Law::NeoHookean) }
}

/// Where the tip of a sphere of radius `sphere` is that stands `depth` below a face of radius [`RADIUS_MM`], towards its
/// centre, `angle` beside the apex.
fn towards_the_centre(sphere: f64, angle_deg: f64, along: DVec2, depth: f64) -> Pose {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let reach = RADIUS_MM + sphere - depth;
    let centre = DVec3::new(along.x * sin * reach, along.y * sin * reach, cos * reach - RADIUS_MM);
    Pose { x_mm: centre.x, y_mm: centre.y, z_mm: centre.z - sphere, theta_deg: 0.0 }
}

/// Force on a sphere pressed towards the centre of the face: what points outward, and the rest.
fn pressed(shape: PadShape, friction: Friction, angle_deg: f64, along: DVec2, depth: f64) -> [f64; 2] {
    let sphere = 3.0;
    let settings = Settings { tolerance: 0.02, ..settings(friction) };
    let start = towards_the_centre(sphere, angle_deg, along, -0.05);
    let body: Arc<dyn Indenter> = Arc::new(Sphere(sphere));
    let mut solver = QuasiStaticSolver::new(&bent(shape), &settings, body, &start).unwrap();
    solver.advance(&towards_the_centre(sphere, angle_deg, along, depth)).unwrap();
    let capture = solver.capture(41, 41).unwrap();
    let forces = capture.forces;
    let balance = capture.stats.base_reaction_n;
    assert!(
        (balance - forces.normal_force_n).abs() < 1e-3 * forces.normal_force_n.abs(),
        "{balance} {forces:?}"
    );
    let force = DVec3::new(forces.shear_force_n[0], forces.shear_force_n[1], forces.normal_force_n);
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let outward = DVec3::new(sin * along.x, sin * along.y, cos);
    [force.dot(outward), (force - outward * force.dot(outward)).length()]
}

#[test]
fn a_body_that_just_touches_a_dome_leaves_it_at_rest() {
    let body: Arc<dyn Indenter> = Arc::new(Sphere(4.0));
    let start = Pose::new(0.0, 0.0, 0.3, 0.0);
    let dome = bent(PadShape::Dome { radius_mm: RADIUS_MM });
    let mut solver = QuasiStaticSolver::new(&dome, &settings(Friction::Infinite), body, &start).unwrap();
    solver.advance(&Pose { z_mm: 0.0, ..start }).expect("nothing to do");
    let touched = solver.capture(41, 41).unwrap();
    assert_eq!(touched.forces.normal_force_n, 0.0);
    assert!(touched.stats.estimated_error.unwrap_or(0.0) < 0.01, "{:?}", touched.stats);
    solver.advance(&Pose { z_mm: -0.1, ..start }).expect("an easy press");
    assert!(solver.capture(41, 41).unwrap().forces.normal_force_n > 0.0);
}

#[test]
fn a_dome_answers_alike_all_around_its_apex() {
    let dome = PadShape::Dome { radius_mm: RADIUS_MM };
    for friction in [Friction::Coefficient(0.0), Friction::Infinite] {
        let [apex, _] = pressed(dome, friction, 0.0, DVec2::X, 0.4);
        for (angle, along) in [(12.0, DVec2::Y), (22.0, DVec2::new(-0.6, 0.8))] {
            let [outward, aside] = pressed(dome, friction, angle, along, 0.4);
            assert!((outward / apex - 1.0).abs() < 0.015, "{friction:?} {angle}: {outward} {apex}");
            assert!(aside < 0.015 * apex, "{friction:?} {angle}: {aside} {apex}");
        }
    }
}

#[test]
fn a_cylinder_answers_alike_around_its_axis_and_between_flat_and_domed_on_it() {
    let cylinder = PadShape::Cylinder { radius_mm: RADIUS_MM };
    let frictionless = Friction::Coefficient(0.0);
    let [crest, _] = pressed(cylinder, frictionless, 0.0, DVec2::X, 0.4);
    let [beside, aside] = pressed(cylinder, frictionless, 20.0, DVec2::X, 0.4);
    assert!((beside / crest - 1.0).abs() < 0.015 && aside < 0.015 * crest, "{beside} {aside} {crest}");
    let [dome, _] = pressed(PadShape::Dome { radius_mm: RADIUS_MM }, frictionless, 0.0, DVec2::X, 0.4);
    let [flat, _] = pressed(PadShape::Cuboid, frictionless, 0.0, DVec2::X, 0.4);
    assert!(dome < crest && crest < flat, "{dome} {crest} {flat}");
}

#[test]
fn a_dome_under_a_plate_is_a_sphere_on_a_flat_pad() {
    // Hertz knows the sum of curvatures alone; what a layer bends adds is of the order of thickness over radius.
    let radius = 60.0;
    let deep = |shape, indenter: Arc<dyn Indenter>| {
        let pose = |z_mm| Pose { x_mm: 0.0, y_mm: 0.0, z_mm, theta_deg: 0.0 };
        let settings = Settings { tolerance: 0.02, ..settings(Friction::Coefficient(0.0)) };
        let mut solver = QuasiStaticSolver::new(&bent(shape), &settings, indenter, &pose(0.02)).unwrap();
        solver.advance(&pose(-0.15)).unwrap();
        solver.capture(41, 41).unwrap().forces.normal_force_n
    };
    let flat = deep(PadShape::Cuboid, Arc::new(Sphere(radius)));
    let dome = deep(PadShape::Dome { radius_mm: radius }, Arc::new(Plate));
    let cylinder = deep(PadShape::Cylinder { radius_mm: radius }, Arc::new(Plate));
    assert!((dome / flat - 1.0).abs() < 0.03, "{dome} {flat}");
    assert!(cylinder > 1.5 * flat, "{cylinder} {flat}");
}

/// A plate as large as the pad and larger.
#[derive(Debug)]
struct Plate;

impl Indenter for Plate {
    fn name(&self) -> &str {
        "plate"
    }
    fn distance(&self, p: DVec3) -> f64 {
        -p.z
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        (-p.z, DVec3::NEG_Z)
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [50.0; 2]
    }
    fn lower_surface(&self, _: f64, _: f64) -> Option<f64> {
        Some(0.0)
    }
}

#[test]
fn forces_over_bent_and_coated_grids_are_the_derivative_of_their_energy_and_the_tangent_of_the_forces() {
    let size = [8.0, 8.0, 3.0];
    let coating = Coating { thickness_mm: 0.3, youngs_modulus_mpa: 0.6, poisson_ratio: 0.4 };
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        for shape in [PadShape::Dome { radius_mm: 7.0 }, PadShape::Rounded { radius_mm: 1.5 }] {
            let grid = Grid::below_coating(size, 0.5, 0.8, 1.25, coating.thickness_mm);
            let stack = Stack::coated(&grid, &pad(law).material, Some(&coating));
            let chart = Chart::new(shape, size);
            let operator = Operator::new(grid.clone(), law, &stack, chart.as_ref());
            let n = grid.field_len();
            let (u, d) = (wavy(&grid, 0.05, 0), wavy(&grid, 1.0, 3));
            let mut tangent = operator::Tangent::default();
            let mut forces = [vec![0.0; n], vec![0.0; n]];
            let eps = 1e-3f32;
            let energies = [-eps, eps].map(|sign| {
                let moved: Vec<f32> = u.iter().zip(&d).map(|(u, d)| u + sign * d).collect();
                let into = &mut forces[usize::from(sign > 0.0)];
                operator.evaluate(&moved, into, &mut tangent).energy
            });
            let mut here = vec![0.0; n];
            operator.evaluate(&u, &mut here, &mut tangent);
            let work = fields::dot(&here, &d);
            let found = (energies[1] - energies[0]) / (2.0 * f64::from(eps));
            assert!((found - work).abs() < 2e-3 * work.abs(), "{law:?} {shape:?}: {found} {work}");
            let mut along = vec![0.0; n];
            operator.apply(&tangent, &d, &mut along);
            let off = off_difference(&grid, &forces, eps, &along);
            assert!(off < 1e-5, "{law:?} {shape:?}: {}", off.sqrt());
        }
    }
}

#[test]
fn a_rounding_changes_nothing_in_the_middle_of_the_pad() {
    let [flat, rounded] = [PadShape::Cuboid, PadShape::Rounded { radius_mm: 1.5 }]
        .map(|shape| pressed(shape, Friction::Coefficient(0.0), 0.0, DVec2::X, 0.4)[0]);
    assert!((rounded / flat - 1.0).abs() < 0.01, "{rounded} {flat}");
}

/// Force along x of 16 mm from the middle of a long pad that a plate holds all over and shifts: what the ends lose is in
/// both of two lengths.
fn sheared(coating: Option<Coating>) -> f64 {
    let force = |length_mm| {
        let body = Pad { coating, size_x_mm: length_mm, size_y_mm: 8.0, ..bent(PadShape::Cuboid) };
        sheared_whole(&body)
    };
    force(32.0) - force(16.0)
}

fn sheared_whole(body: &Pad) -> f64 {
    let pose = |x_mm, z_mm| Pose { x_mm, y_mm: 0.0, z_mm, theta_deg: 0.0 };
    let settings = Settings { tolerance: 0.1, ..settings(Friction::Infinite) };
    let mut solver = QuasiStaticSolver::new(body, &settings, Arc::new(Plate), &pose(0.0, 0.01)).unwrap();
    solver.advance(&pose(0.0, -0.06)).unwrap();
    solver.advance(&pose(0.1, -0.06)).unwrap();
    solver.capture(41, 41).unwrap().forces.shear_force_n[0].abs()
}

#[test]
fn layers_of_a_coated_pad_yield_one_after_the_other() {
    let bulk = pad(Law::NeoHookean).material;
    let coating = |youngs_modulus_mpa| {
        Some(Coating { thickness_mm: 1.0, youngs_modulus_mpa, poisson_ratio: bulk.poisson_ratio })
    };
    let plain = sheared(None);
    // A skin of the same stuff is none.
    let same = sheared(coating(bulk.youngs_modulus_mpa));
    assert!((same / plain - 1.0).abs() < 5e-3, "{same} {plain}");
    // Simple shear in series: 2 mm of bulk, 1 mm of a skin that is four times as stiff or as soft.
    for times in [4.0, 0.25] {
        let found = sheared(coating(times * bulk.youngs_modulus_mpa)) / plain;
        let expected = 3.0 / (2.0 + 1.0 / times);
        assert!((found / expected - 1.0).abs() < 0.02, "{times}: {found} {expected}");
    }
}
