//! Bodies that are narrower than what lies between the sample points.

use super::*;
use crate::indenter::spec::{Plan, Shape};
use crate::indenter::{IndenterSpec, from_spec};

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
