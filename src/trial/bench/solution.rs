//! Time to solution of the quasi-static mode, by tolerance: from rest to a surface of 201 x 201 points.
//!
//! The scenes are those that targets are stated for: a sphere (R 4 mm) and a flat round punch (5.4 mm, edge rounded by
//! 0.3) pressed 1 mm, both from nothing; after the sphere's press a slide of 1 mm with a capture every 0.25 mm and a turn
//! of 15 degrees; and the last 0.1 mm of a press that comes to 1 mm in such steps, read after each. What touches sticks.

use super::timing::once;
use super::{Effort, Stage, Timing};
use crate::elastomer::{self, Elastomer, Error, Friction, Law};
use crate::indenter::Indenter;
use crate::pose::Pose;
use crate::trial::scene;
use serde::Serialize;
use std::sync::Arc;

/// Points of the surface along each side.
const LATTICE: usize = 201;

/// One scene at one tolerance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Solution {
    /// What was done.
    pub scene: &'static str,
    /// Tolerance.
    pub tolerance: f64,
    /// How long it took; absent when it failed.
    pub time: Option<Timing>,
    /// Why it failed.
    pub error: Option<String>,
    /// Error that the solver states, of the depth.
    pub stated_error: Option<f64>,
    /// Newton iterations.
    pub iterations: u64,
    /// Tangent applications.
    pub passes: u64,
    /// Force on the indenter, N.
    pub normal_force_n: Option<f64>,
}

/// Adds the measurements.
pub(super) fn plan(effort: Effort, stages: &mut Vec<Stage>) {
    let (tolerances, repeats): (&[f64], usize) = match effort {
        Effort::Smoke => (&[0.05], 1),
        Effort::Quick => (&[0.05, 0.02], 2),
        Effort::Full => (&[0.05, 0.02, 0.01, 0.005, 0.0035], 3),
    };
    for &tolerance in tolerances {
        let name = format!("time to solution, tolerance {tolerance}");
        let stage = move |report: &mut super::Report| {
            measure(tolerance, repeats, &mut report.solutions);
            Ok(())
        };
        stages.push((name, Box::new(stage)));
    }
}

/// The state at the end of a scene.
type Ended = Result<Box<dyn Elastomer>, Error>;

fn measure(tolerance: f64, repeats: usize, rows: &mut Vec<Solution>) {
    let sphere = scene::sphere(4.0);
    let above = |body: Arc<dyn Indenter>| -> Ended {
        let settings = scene::quasi_static(Friction::Infinite, tolerance);
        elastomer::solver(&scene::pad(Law::NeoHookean), &settings, body, &Pose::new(0.0, 0.0, 0.1, 0.0))
    };
    let press = |body: Arc<dyn Indenter>| -> Ended {
        let mut solver = above(body)?;
        solver.advance(&Pose::new(0.0, 0.0, -1.0, 0.0))?;
        Ok(solver)
    };
    let nothing = || Ok(());
    let pressed = row(rows, "press sphere 1 mm", tolerance, repeats, nothing, |()| press(sphere.clone()));
    row(rows, "press punch 1 mm", tolerance, repeats, nothing, |()| press(scene::punch(5.4, 0.3)));
    let Some(pressed) = pressed else { return };
    let go_on = |mut solver: Box<dyn Elastomer>, poses: &[Pose]| -> Ended {
        for (n, pose) in poses.iter().enumerate() {
            solver.advance(pose)?;
            if n + 1 < poses.len() {
                solver.capture(LATTICE, LATTICE)?;
            }
        }
        Ok(solver)
    };
    let slide: Vec<Pose> = (1..=4).map(|n| Pose::new(0.25 * f64::from(n), 0.0, -1.0, 0.0)).collect();
    row(rows, "slide 1 mm", tolerance, repeats, nothing, |()| go_on(pressed.fork(), &slide));
    let turned = [Pose::new(0.0, 0.0, -1.0, 15.0)];
    row(rows, "turn 15 deg", tolerance, repeats, nothing, |()| go_on(pressed.fork(), &turned));
    // A solver that jogs has done so before: what it needs for it is there.
    let jog: Vec<Pose> = (1..=10).map(|n| Pose::new(0.0, 0.0, -0.1 * f64::from(n), 0.0)).collect();
    let (last, before) = jog.split_last().expect("ten steps");
    let jogged = || {
        let mut solver = above(sphere.clone())?;
        for pose in before {
            solver.advance(pose)?;
            solver.capture(LATTICE, LATTICE)?;
        }
        Ok(solver)
    };
    row(rows, "0.1 mm further", tolerance, repeats, jogged, |solver| go_on(solver, &[*last]));
}

/// Times a scene with its last capture, but not what leads to it, and adds its row; answers the state at its end.
fn row<T>(
    rows: &mut Vec<Solution>,
    scene: &'static str,
    tolerance: f64,
    repeats: usize,
    prepare: impl Fn() -> Result<T, Error>,
    run: impl Fn(T) -> Ended,
) -> Option<Box<dyn Elastomer>> {
    let (time, error, stated_error, normal_force_n) = (None, None, None, None);
    let mut row =
        Solution { scene, tolerance, time, error, stated_error, iterations: 0, passes: 0, normal_force_n };
    let (mut samples, mut state) = (Vec::new(), None);
    for _ in 0..repeats {
        let prepared = prepare();
        let (ended, sample) = once(|| {
            let mut solver = run(prepared?)?;
            solver.capture(LATTICE, LATTICE).map(|capture| (solver, capture))
        });
        match ended {
            Ok((solver, capture)) => {
                samples.push(sample);
                row.stated_error = capture.stats.estimated_error;
                row.iterations = capture.stats.iterations;
                row.passes = capture.stats.passes;
                row.normal_force_n = Some(capture.forces.normal_force_n);
                state = Some(solver);
            }
            Err(error) => row.error = Some(error.to_string()),
        }
    }
    row.time = Timing::of(samples);
    rows.push(row);
    state
}
