//! Bodies that are narrower than what lies between the sample points.

use super::*;
use crate::indenter::spec::{Plan, Shape};
use crate::indenter::{Indenter, IndenterSpec, from_spec};

/// The cone of the press set: 1 mm across at its tip.
pub(super) fn small_cone(edge_round_mm: f64) -> Arc<dyn Indenter> {
    let shape = Shape::Cone { tip_diameter_mm: 1.0, half_angle_deg: 19.29 };
    let spec = IndenterSpec { description: String::new(), edge_round_mm, height_mm: 8.0, shape };
    from_spec("cone", &spec, None).expect("a body")
}

#[test]
fn a_small_cone_touches_as_widely_and_presses_as_hard_as_over_the_finest_cells() {
    let cone = small_cone(0.3);
    let seen = |tolerance: f64| {
        let settings = Settings { tolerance, friction: Friction::Coefficient(0.5), ..Settings::default() };
        let start = Pose::new(0.0, 0.0, 0.2, 0.0);
        let mut s =
            QuasiStaticSolver::new(&pad(Law::FixedCorotated), &settings, cone.clone(), &start).unwrap();
        [0.25, 0.5, 1.0].map(|depth_mm| {
            s.advance(&Pose { z_mm: -depth_mm, ..start }).expect("an easy press");
            let seen = s.capture(201, 201).expect("a lattice");
            let radius_mm = (seen.stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
            (radius_mm, seen.forces.normal_force_n)
        })
    };
    for ((radius_mm, force_n), (fine_radius_mm, fine_force_n)) in seen(0.01).into_iter().zip(seen(0.003)) {
        assert!((radius_mm / fine_radius_mm - 1.0).abs() < 0.02, "{radius_mm} mm, {fine_radius_mm} mm");
        assert!((force_n / fine_force_n - 1.0).abs() < 0.015, "{force_n} N, {fine_force_n} N");
    }
}

#[test]
fn a_cone_without_friction_does_not_pierce_the_face_however_long_the_way() {
    let start = Pose::new(0.0, 0.0, 0.1, 0.0);
    let pressed = |ways_mm: &[f64]| {
        let settings = Settings { friction: Friction::Coefficient(0.0), ..Settings::default() };
        let mut s =
            QuasiStaticSolver::new(&pad(Law::FixedCorotated), &settings, small_cone(0.3), &start).unwrap();
        for depth_mm in ways_mm {
            s.advance(&Pose { z_mm: -depth_mm, ..start }).expect("a press");
        }
        let seen = s.capture(201, 201).expect("a lattice");
        [seen.forces.normal_force_n, seen.stats.elastic_energy_n_mm]
    };
    let bit_by_bit = pressed(&[0.2, 0.4, 0.6, 0.8, 0.92]);
    let at_once = pressed(&[0.92]);
    for (one, other) in at_once.iter().zip(bit_by_bit) {
        assert!((one / other - 1.0).abs() < 0.01, "{at_once:?} instead of {bit_by_bit:?}");
    }
}

/// A flat body with upright walls pressed 0.3 mm.
fn pressed(plan: Plan, theta_deg: f64, tolerance: f64) -> Result<ElastomerCapture, Error> {
    let shape = Shape::Flat { plan };
    let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
    let body = from_spec("body", &spec, None).expect("a body");
    let settings = Settings { tolerance, friction: Friction::Coefficient(0.5), ..Settings::default() };
    let start = Pose::new(0.03, 0.01, 0.2, theta_deg);
    let mut solver = QuasiStaticSolver::new(&pad(Law::NeoHookean), &settings, body, &start)?;
    solver.advance(&Pose { z_mm: -0.3, ..start })?;
    solver.capture(101, 101)
}

#[test]
fn a_thin_wall_that_passes_between_sample_points_is_no_answer() {
    let blade = |x_mm: f64| Plan::Rectangle { x_mm, y_mm: 8.0 };
    let ring = |inner_diameter_mm: f64| Plan::Ring { outer_diameter_mm: 7.0, inner_diameter_mm };
    let ridges = |width_mm: f64| Plan::Stripes { count: 4, width_mm, length_mm: 6.0, pitch_mm: 1.7 };
    let narrow = [
        (blade(0.01), 45.0, 0.02),
        (blade(0.03), 45.0, 0.05),
        (blade(0.02), 20.0, 0.02),
        (ring(6.98), 0.0, 0.01),
        (ring(6.9), 0.0, 0.02),
        // Along the grid none or all of the points see one.
        (ridges(0.03), 0.0, 0.05),
        (ridges(0.03), 0.0, 0.02),
    ];
    for (plan, theta_deg, tolerance) in narrow {
        let name = format!("{plan:?} at {theta_deg} degrees");
        match pressed(plan, theta_deg, tolerance) {
            // The least of them takes 0.12 N over cells that see it.
            Ok(seen) => assert!(seen.forces.normal_force_n > 0.06, "{name}: {:?}", seen.forces),
            Err(Error::Unresolved { .. } | Error::NotConverged { .. }) => (),
            Err(other) => panic!("{name}: {other}"),
        }
    }
}
