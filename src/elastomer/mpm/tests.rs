//! Physics of the explicit modes against analytic truth.

mod shapes;

use self::shapes::Ball;
use super::*;
use crate::elastomer::{Law, Material, PadShape};

/// A pad of the predecessor's material.
fn pad(size: [f64; 3]) -> Pad {
    Pad {
        shape: PadShape::Cuboid,
        size_x_mm: size[0],
        size_y_mm: size[1],
        thickness_mm: size[2],
        material: Material {
            law: Law::FixedCorotated,
            youngs_modulus_mpa: 0.145,
            poisson_ratio: 0.45,
            density_g_mm3: 1.0,
        },
    }
}

#[test]
fn a_press_pushes_back() {
    let settings = Settings { mode: Mode::Impm, particles: [51, 51, 11], ..Settings::default() };
    let ball = Arc::new(Ball { radius_mm: 4.0 });
    let mut solver =
        ExplicitSolver::new(&pad([20.0, 20.0, 4.0]), &settings, ball, &Pose::new(0.0, 0.0, 2.0, 0.0))
            .expect("the default settings are sound");
    solver.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("a gentle press");
    let c = solver.capture(201, 201).expect("a state");
    println!(
        "{:?} {:?} min z {}",
        c.forces,
        c.stats,
        c.surface.positions.iter().map(|p| p.z).fold(0.0, f32::min)
    );
    assert!(c.forces.normal_force_n > 0.05);
}
