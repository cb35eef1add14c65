//! A sweep over hard cases: every one must end in a correct answer or in a typed error.
//!
//! A case is judged by what must hold whatever the pad: all numbers finite, the base carries the contact
//! force, nothing penetrates the indenter, and the pad returns to rest when it is let go. Materials range
//! over decades of stiffness and up to nu = 0.499, presses up to 60 % of the thickness, slides and turns
//! with stick, Coulomb friction and none. What a case costs is reported beside its outcome.

use super::{QuasiStaticSolver, Resolution};
use crate::elastomer::{
    Elastomer, ElastomerCapture, Error, Friction, Law, Material, Mode, Pad, PadShape, Settings,
};
use crate::indenter::Indenter;
use crate::pose::Pose;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// One case of the sweep.
#[derive(Debug, Clone)]
pub struct Case {
    /// What is pressed into the pad.
    pub indenter: Arc<dyn Indenter>,
    /// Pad and material.
    pub pad: Pad,
    /// Friction.
    pub friction: Friction,
    /// Cell size, mm.
    pub cell_mm: f64,
    /// Poses in turn; the last is above the pad.
    pub path: Vec<Pose>,
}

/// How a case ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// Everything that must hold, held; the worst of the relative imbalances.
    Correct {
        /// |base reaction - normal force| over the normal force, at worst.
        imbalance: f64,
    },
    /// Refused with advice.
    Refused(Error),
    /// Something that must hold did not.
    Wrong(String),
}

/// The sweep for a set of indenters on a pad of 20 x 20 x 4 mm.
pub fn cases(indenters: &[Arc<dyn Indenter>]) -> Vec<Case> {
    let mut cases = Vec::new();
    let mut add = |indenter: &Arc<dyn Indenter>, law, e: f64, nu: f64, friction, depth: f64, cell_mm| {
        let material = Material { law, youngs_modulus_mpa: e, poisson_ratio: nu, density_g_mm3: 1e-3 };
        let pad =
            Pad { shape: PadShape::Cuboid, size_x_mm: 20.0, size_y_mm: 20.0, thickness_mm: 4.0, material };
        let path = vec![
            Pose::new(0.0, 0.0, -depth, 0.0),
            Pose::new(1.0, 0.0, -depth, 0.0),
            Pose::new(1.0, 0.0, -depth, 15.0),
            Pose::new(1.0, 0.0, 0.5, 15.0),
        ];
        cases.push(Case { indenter: Arc::clone(indenter), pad, friction, cell_mm, path });
    };
    let frictions = [Friction::Coefficient(0.0), Friction::Coefficient(0.5), Friction::Infinite];
    for indenter in indenters {
        for law in [Law::FixedCorotated, Law::NeoHookean] {
            for friction in frictions {
                add(indenter, law, 0.145, 0.45, friction, 0.5, 0.625);
            }
            for (e, nu) in [(0.001, 0.45), (10.0, 0.45), (0.145, 0.0), (0.145, 0.49), (0.145, 0.499)] {
                add(indenter, law, e, nu, Friction::Infinite, 0.5, 0.625);
            }
            for depth in [0.01, 1.0, 1.6, 2.4] {
                add(indenter, law, 0.145, 0.45, Friction::Coefficient(0.5), depth, 0.625);
            }
            add(indenter, law, 0.145, 0.45, Friction::Infinite, 0.5, 1.25);
        }
    }
    cases
}

/// Runs a case and judges it; also says how long it took.
pub fn run(case: &Case) -> (Outcome, Duration) {
    let begun = Instant::now();
    let outcome = judge(case).unwrap_or_else(Outcome::Refused);
    (outcome, begun.elapsed())
}

fn judge(case: &Case) -> Result<Outcome, Error> {
    let settings = Settings { mode: Mode::QuasiStatic, friction: case.friction, ..Settings::default() };
    let resolution = Resolution { cell_mm: case.cell_mm, ..Resolution::for_tolerance(settings.tolerance) };
    let start = Pose::new(0.0, 0.0, 0.5, 0.0);
    let indenter = Arc::clone(&case.indenter);
    let mut solver = QuasiStaticSolver::with_resolution(&case.pad, &settings, resolution, indenter, &start)?;
    let mut imbalance = 0.0f64;
    for (n, pose) in case.path.iter().enumerate() {
        solver.advance(pose)?;
        let capture = solver.capture(41, 41)?;
        if let Some(what) = fault(&capture, n + 1 == case.path.len()) {
            return Ok(Outcome::Wrong(format!("at pose ({pose}): {what}")));
        }
        let normal = capture.forces.normal_force_n.abs();
        if normal > 0.0 {
            imbalance = imbalance.max((capture.stats.base_reaction_n - normal).abs() / normal);
        }
    }
    Ok(Outcome::Correct { imbalance })
}

/// What is wrong with a capture, if anything.
fn fault(capture: &ElastomerCapture, released: bool) -> Option<String> {
    let f = &capture.forces;
    let finite = [f.normal_force_n, f.shear_force_n[0], f.shear_force_n[1], f.torque_n_mm];
    if !finite.iter().all(|v| v.is_finite()) || !capture.surface.positions.iter().all(|p| p.is_finite()) {
        return Some("a number is not finite".to_owned());
    }
    let normal = f.normal_force_n.abs();
    let imbalance = (capture.stats.base_reaction_n - normal).abs();
    if imbalance > 0.01 * normal.max(1e-9) {
        return Some(format!("base reaction and normal force differ by {imbalance:.3e} N of {normal:.3e} N"));
    }
    if released {
        let rest = capture.surface.positions.iter().map(|p| p.z.abs()).fold(0.0, f32::max);
        if rest > 1e-3 {
            return Some(format!("the released face stands {rest:.4} mm from rest"));
        }
    }
    None
}
