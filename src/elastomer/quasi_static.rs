//! The quasi-static elastomer: every waypoint is an equilibrium of the bonded pad.
//!
//! Total-Lagrangian, on quadratic B-splines over a grid that fits the pad ([`grid`]); stresses and
//! tangents from the stored energy ([`law`], [`operator`]); unilateral contact with Coulomb or infinite
//! friction against the indenter's signed distance ([`contact`]); Newton's method with conjugate gradients
//! ([`newton`]), preconditioned by the inverse of the undeformed layer ([`layer`]) with the contact
//! springs added by the Woodbury formula ([`springs`], [`cholesky`]). Relative rest, which the explicit modes reach by
//! looping, is here the friction law itself.
//!
//! A path is followed in increments ([`level`]), first on coarse grids, whose answers are the guesses of finer ones
//! ([`bridge`]); what an increment leaves behind is the displacement and, with friction, the anchors of the points that
//! touch. Nothing is computed before the first touch. An increment that does not converge is halved, and given up with
//! a typed error in the end.

#![allow(
    clippy::needless_range_loop,
    clippy::neg_cmp_op_on_partial_ord,
    reason = "tensor code reads best with indices; a negated comparison is how a NaN is caught"
)]

pub mod bridge;
pub mod cholesky;
pub mod contact;
pub mod grid;
pub mod lanes;
pub mod law;
pub mod layer;
pub mod level;
pub mod newton;
pub mod operator;
pub mod probe;
pub mod resolution;
pub mod springs;
pub mod stress;

use super::interrupt::Interrupt;
use super::{Elastomer, ElastomerCapture, Error, Friction, Pad, PadShape, Settings, pose_can_be_reached};
use crate::indenter::Indenter;
use crate::pose::Pose;
use bridge::Bridge;
use level::{Equilibrium, Level};
use newton::Outcome;
pub use resolution::Resolution;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A pad that follows an indenter through equilibria, on a cascade of grids.
///
/// Every increment is solved on the coarsest grid first; what its solution changed is the guess of the next finer
/// one, which so begins within a few hundredths of its answer. Each grid keeps its own anchors and slips. The finest
/// alone gives the answer: a coarser one that finds no equilibrium is left behind until the pad is at rest again.
#[derive(Debug)]
pub struct QuasiStaticSolver {
    /// Coarsest first.
    levels: Vec<Step>,
    indenter: Arc<dyn Indenter>,
}

/// One grid of the cascade.
#[derive(Debug)]
struct Step {
    level: Level,
    /// From the next coarser grid to this one.
    bridge: Option<Arc<Bridge>>,
    /// Whether it lost the way.
    lost: bool,
}

impl QuasiStaticSolver {
    /// A solver for `pad` as overridden by `settings`, with the indenter at `start`.
    ///
    /// # Errors
    /// [`Error::Setting`] when the pad or a setting is out of range; whatever the first contact brings
    /// when `start` already touches.
    pub fn new(
        pad: &Pad,
        settings: &Settings,
        indenter: Arc<dyn Indenter>,
        start: &Pose,
    ) -> Result<Self, Error> {
        check(pad, settings)?;
        let resolution = Resolution::for_tolerance(settings.tolerance);
        Self::with_resolution(pad, settings, resolution, indenter, start)
    }

    /// As [`Self::new`], with the resolution given instead of derived from the tolerance.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_resolution(
        pad: &Pad,
        settings: &Settings,
        resolution: Resolution,
        indenter: Arc<dyn Indenter>,
        start: &Pose,
    ) -> Result<Self, Error> {
        pose_can_be_reached(start, pad.thickness_mm)?;
        let mut material = pad.material;
        material.law = settings.law.unwrap_or(material.law);
        material.youngs_modulus_mpa = settings.youngs_modulus_mpa.unwrap_or(material.youngs_modulus_mpa);
        material.poisson_ratio = settings.poisson_ratio.unwrap_or(material.poisson_ratio);
        let size = [pad.size_x_mm, pad.size_y_mm, pad.thickness_mm];
        let mut levels: Vec<Step> = Vec::new();
        let cascade = resolution.cascade(size);
        for (n, resolution) in cascade.iter().enumerate() {
            let guesses = n + 1 < cascade.len();
            let level = Level::new(size, &material, settings.friction, resolution, *start, guesses);
            let bridge = levels.last().map(|s| Arc::new(Bridge::new(s.level.grid(), level.grid())));
            levels.push(Step { level, bridge, lost: false });
        }
        let mut solver = Self { levels, indenter };
        if !solver.finest().is_clear(solver.indenter.as_ref(), start) {
            // Begin above the pad and come down, as an indenter would.
            let above = Pose { z_mm: start.z_mm.max(0.0) + 1e-3, ..*start };
            rest_at(&mut solver.levels, &above);
            solver.advance(start)?;
        }
        Ok(solver)
    }

    /// The grid that gives the answer.
    fn finest(&self) -> &Level {
        &self.levels[self.levels.len() - 1].level
    }
}

impl Elastomer for QuasiStaticSolver {
    fn advance(&mut self, pose: &Pose) -> Result<(), Error> {
        pose_can_be_reached(pose, self.finest().grid().size[2])?;
        let indenter = Arc::clone(&self.indenter);
        // Nothing happens before the first touch, so nothing is computed.
        let part = self.finest().idle_part(indenter.as_ref(), pose);
        if part > 0.0 {
            let touch = self.finest().pose().lerp(pose, part);
            rest_at(&mut self.levels, &touch);
        }
        follow(&mut self.levels, indenter.as_ref(), pose, &FINEST)
    }

    fn capture(&mut self, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        let indenter = Arc::clone(&self.indenter);
        let mut capture = self.finest().capture(indenter.as_ref(), nx, ny)?;
        // The coarser grids have worked for this answer, too.
        let (mut iterations, mut passes) = (0, 0);
        for step in &mut self.levels {
            iterations += std::mem::take(&mut step.level.newton.iterations);
            passes += std::mem::take(&mut step.level.newton.passes);
        }
        capture.stats.passes_per_step = passes as f64 / (iterations as f64).max(1.0);
        (capture.stats.iterations, capture.stats.passes) = (iterations, passes);
        Ok(capture)
    }

    fn interrupt_by(&mut self, flag: Arc<AtomicBool>) {
        for step in &mut self.levels {
            step.level.newton.interrupt = Interrupt::by(Arc::clone(&flag));
        }
    }

    fn fork(&self) -> Box<dyn Elastomer> {
        let fork = |s: &Step| Step { level: s.level.fork(), bridge: s.bridge.clone(), lost: s.lost };
        Box::new(Self {
            levels: self.levels.iter().map(fork).collect(),
            indenter: Arc::clone(&self.indenter),
        })
    }
}

/// What a way may cost before it is given up.
struct Patience {
    /// How often an increment may be halved.
    halvings: i32,
    /// Tangent applications for each increment of the way.
    passes: f64,
}

/// Patience with the answer.
const FINEST: Patience = Patience { halvings: 6, passes: 4000.0 };
/// Patience with a guess.
const COARSER: Patience = Patience { halvings: 2, passes: 600.0 };

/// Follows a straight way with the last of `levels`, the others going ahead.
fn follow(
    levels: &mut [Step],
    indenter: &dyn Indenter,
    pose: &Pose,
    patience: &Patience,
) -> Result<(), Error> {
    let finest = levels.len() - 1;
    let start = *levels[finest].level.pose();
    let parts = levels[finest].level.increments(&start, pose);
    let (mut done, mut stride, mut restarts) = (0.0, 1.0 / parts, 0);
    let begun = levels[finest].level.newton.passes;
    while done < 1.0 {
        levels[finest].level.newton.interrupt.check()?;
        let next = f64::min(1.0, done + stride);
        let next = if next > 1.0 - 1e-9 { 1.0 } else { next };
        match increment(levels, indenter, &start.lerp(pose, next))? {
            Ok(()) => {
                levels[finest].level.check_margin(indenter)?;
                done = next;
                stride = f64::min(stride * 1.5, 1.0 / parts);
            }
            Err(outcome) => {
                restarts += 1;
                stride *= 0.5;
                let passes = (levels[finest].level.newton.passes - begun) as f64;
                if stride * parts < 0.5f64.powi(patience.halvings) || passes > patience.passes * parts {
                    return Err(Error::NotConverged {
                        pose: start.lerp(pose, next),
                        residual: outcome.residual,
                        iterations: outcome.iterations,
                        restarts,
                        advice: format!(
                            "{:.3} of {:.3} mm of this way were done; lower the depth or the slide, round the \
                             indenter's edges, set elastomer.friction to a number below 1, or choose another \
                             elastomer.tolerance (another grid)",
                            done * start.distance_mm(pose),
                            start.distance_mm(pose)
                        ),
                    });
                }
            }
        }
    }
    Ok(())
}

/// One increment of the last of `levels`, with what the coarser ones say of it. When it fails, all are where they
/// were.
fn increment(
    levels: &mut [Step],
    indenter: &dyn Indenter,
    pose: &Pose,
) -> Result<Result<(), Outcome>, Error> {
    let Some((fine, coarser)) = levels.split_last_mut() else { return Ok(Ok(())) };
    if fine.level.is_clear(indenter, pose) {
        fine.level.rest_at(pose);
        rest_at(coarser, pose);
        return Ok(Ok(()));
    }
    let before: Vec<(Equilibrium, bool)> = coarser.iter().map(|s| (s.level.equilibrium(), s.lost)).collect();
    let hint = match (&fine.bridge, before.last()) {
        (Some(bridge), Some((old, false))) => match follow(coarser, indenter, pose, &COARSER) {
            Ok(()) => {
                let change = coarser[coarser.len() - 1].level.change_since(old);
                Some(bridge.carry(&change))
            }
            Err(stopped @ Error::Interrupted) => return Err(stopped),
            Err(_) => None,
        },
        _ => None,
    };
    let lost = hint.is_none();
    let result = fine.level.increment(indenter, pose, hint.as_deref());
    if result.is_err() {
        for (step, (at, lost)) in coarser.iter_mut().zip(before) {
            step.level.return_to(at);
            step.lost = lost;
        }
    } else if let Some(coarse) = coarser.last_mut() {
        coarse.lost = lost;
    }
    Ok(result)
}

/// Moves the indenter where nothing touches.
fn rest_at(levels: &mut [Step], pose: &Pose) {
    for step in levels {
        step.level.rest_at(pose);
        step.lost = false;
    }
}

pub(super) fn check(pad: &Pad, settings: &Settings) -> Result<(), Error> {
    let range = |key, value: f64, min: f64, max: f64, unit: &str| {
        if value.is_finite() && value >= min && value <= max {
            Ok(())
        } else {
            Err(Error::Setting {
                key,
                value: value.to_string(),
                why: format!("choose a value from {min} to {max}{unit}"),
            })
        }
    };
    let m = &pad.material;
    range(
        "youngs_modulus_mpa",
        settings.youngs_modulus_mpa.unwrap_or(m.youngs_modulus_mpa),
        1e-4,
        1e4,
        " MPa",
    )?;
    range("poisson_ratio", settings.poisson_ratio.unwrap_or(m.poisson_ratio), 0.0, 0.499, "")?;
    range("tolerance", settings.tolerance, 5e-4, 0.1, "")?;
    range("size_x_mm", pad.size_x_mm, 1.0, 200.0, " mm")?;
    range("size_y_mm", pad.size_y_mm, 1.0, 200.0, " mm")?;
    range("thickness_mm", pad.thickness_mm, 0.1, 50.0, " mm")?;
    if let Friction::Coefficient(mu) = settings.friction {
        range("friction", mu, 0.0, 10.0, "")?;
    }
    if pad.shape != PadShape::Cuboid {
        return Err(Error::Setting {
            key: "shape",
            value: format!("{:?}", pad.shape),
            why: "flat pads, shape = { kind = \"cuboid\" }: no solver knows others".to_owned(),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
