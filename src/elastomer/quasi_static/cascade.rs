//! A way followed on a cascade of grids.
//!
//! Every increment, unless a slide or a press just goes on, is solved on the coarsest grid first; what its solution changed is the
//! guess of the next finer one, which so begins within a few hundredths of its answer. Each grid keeps its own anchors and slips. The finest
//! alone gives the answer: a coarser one that finds no equilibrium is left behind until the pad is at rest again. Where what sticks finds
//! none however short the increments, it tears loose, and the way is gone on with.

use super::super::Error;
use super::bridge::Bridge;
use super::level::{Equilibrium, Leave, Level};
use super::newton::Outcome;
use crate::indenter::Indenter;
use crate::pose::Pose;
use std::sync::Arc;

/// One grid of the cascade.
#[derive(Debug)]
pub struct Step {
    /// The pad on this grid.
    pub level: Level,
    /// From the next coarser grid to this one.
    bridge: Option<Arc<Bridge>>,
    /// Whether it lost the way.
    lost: bool,
}

impl Step {
    /// The next grid after the `coarser` ones.
    pub fn after(coarser: &[Step], level: Level) -> Self {
        let bridge = coarser.last().map(|s| Arc::new(Bridge::new(s.level.grid(), level.grid())));
        Self { level, bridge, lost: false }
    }

    /// The same grid in the same state.
    pub fn fork(&self) -> Self {
        Self { level: self.level.fork(), bridge: self.bridge.clone(), lost: self.lost }
    }
}

/// What a way may cost before it is given up; as much again each time that what sticks tears for it, which is twice at most.
pub struct Patience {
    /// How often an increment may be halved.
    halvings: i32,
    /// Tangent applications for each increment that the way was to take.
    passes: f64,
    /// The same in tangents at quadrature points; so much may be spent on increments that find no equilibrium, besides.
    work: f64,
    /// Part of an increment that is gone even where the pad is unstable, unless it is a press.
    bold: f64,
}

/// Patience with the answer.
pub const FINEST: Patience = Patience { halvings: 6, passes: 4000.0, work: f64::INFINITY, bold: 0.25 };
/// Patience with an answer on finer cells than were thought necessary: about twenty seconds of processor time an increment.
pub const REFINED: Patience = Patience { halvings: 3, passes: 1000.0, work: 2.5e8, bold: 0.25 };
/// Patience with a guess.
const COARSER: Patience = Patience { halvings: 2, passes: 600.0, work: f64::INFINITY, bold: f64::INFINITY };

/// Longer parts of an increment than this that leave a press askew are gone again by halves. What is so still is told in its error.
const UNEVEN: f64 = 0.6;

/// Follows a straight way with the last of `levels`, the others going ahead.
///
/// # Errors
/// [`Error::NotConverged`] when patience is used up, [`Error::OffPad`], [`Error::Interrupted`].
pub fn follow(
    levels: &mut [Step],
    indenter: &dyn Indenter,
    pose: &Pose,
    patience: &Patience,
) -> Result<(), Error> {
    let finest = levels.len() - 1;
    let start = *levels[finest].level.pose();
    let parts = levels[finest].level.increments(indenter, pose);
    // A press over an unstable pad ends on one side or the other as rounding decides; a drag sticks and slips.
    let presses = Pose { z_mm: start.z_mm, ..*pose } == start && patience.bold.is_finite();
    // One that is let go comes to where it is stable.
    let lifts = presses && pose.z_mm > start.z_mm;
    let (mut done, mut longest, mut restarts, mut wasted) = (0.0, 1.0 / parts, 0, 0);
    let mut stride = longest;
    let mut begun = levels[finest].level.newton.passes;
    let within_work = parts * patience.work / levels[finest].level.grid().points() as f64;
    let most_passes = f64::min(parts * patience.passes, within_work);
    let mut last;
    while done < 1.0 {
        levels[finest].level.newton.interrupt.check()?;
        let next = f64::min(1.0, done + stride);
        let next = if next > 1.0 - 1e-9 { 1.0 } else { next };
        let mut hopeless = false;
        let cautious = !lifts && (presses || next - done > patience.bold * longest);
        let spent = levels[finest].level.newton.passes - begun;
        let even = presses && next - done > UNEVEN * longest;
        let leave = Leave { cautious, even, passes: (within_work as u64).saturating_sub(spent) };
        match increment(levels, indenter, &start.lerp(pose, next), leave)? {
            Ok(()) => {
                levels[finest].level.check_margin(indenter)?;
                last = levels[finest].level.outcome();
                done = next;
                stride = f64::min(stride * 1.5, longest);
            }
            Err(outcome) => {
                last = Some(outcome);
                restarts += 1;
                stride *= 0.5;
                wasted += levels[finest].level.newton.passes - begun - spent;
                let wasted_work = wasted as f64 * levels[finest].level.grid().points() as f64;
                hopeless = stride < longest * 0.5f64.powi(patience.halvings) || wasted_work > patience.work;
            }
        }
        let passes = (levels[finest].level.newton.passes - begun) as f64;
        if done < 1.0 && (hopeless || passes > most_passes) {
            // What sticks too hard to be followed tears, where it is dragged; a guess is left behind instead.
            let drags = !presses && patience.bold.is_finite();
            if drags && levels[finest].level.tear() {
                levels[..finest].iter_mut().for_each(|step| _ = step.level.tear());
                longest = (1.0 - done) / levels[finest].level.increments(indenter, pose);
                stride = longest;
                begun = levels[finest].level.newton.passes;
                continue;
            }
            return Err(Error::NotConverged {
                pose: start.lerp(pose, next),
                residual: last.map_or(0.0, |o| o.residual),
                iterations: last.map_or(0, |o| o.iterations),
                restarts,
                advice: format!(
                    "{} were done; lower the depth{}, round the indenter's edges, {}or choose another elastomer.tolerance \
                     (another grid)",
                    part_of_way(done, &start, pose),
                    match presses {
                        true => "",
                        false if start.distance_mm(pose) > 0.0 => " or the slide",
                        false => " or the turn",
                    },
                    if levels[finest].level.sticks() {
                        "set elastomer.friction to a number below 1, "
                    } else {
                        ""
                    },
                ),
            });
        }
    }
    Ok(())
}

/// How much of a way was done, in words.
fn part_of_way(done: f64, start: &Pose, end: &Pose) -> String {
    let (way_mm, turn_deg) = (start.distance_mm(end), (end.theta_deg - start.theta_deg).abs());
    match way_mm > 0.0 {
        true => format!("{:.3} of {way_mm:.3} mm of this way", done * way_mm),
        false => format!("{:.2} of {turn_deg:.2} degrees of this turn", done * turn_deg),
    }
}

/// One increment of the last of `levels`, with what the coarser ones say of it. When it fails, all are where they
/// were.
fn increment(
    levels: &mut [Step],
    indenter: &dyn Indenter,
    pose: &Pose,
    leave: Leave,
) -> Result<Result<(), Outcome>, Error> {
    let Some((fine, coarser)) = levels.split_last_mut() else { return Ok(Ok(())) };
    if fine.level.is_clear(indenter, pose) {
        levels.iter_mut().for_each(|step| step.level.look(indenter, pose));
        rest_at(levels, pose);
        return Ok(Ok(()));
    }
    // Where a slide or a press goes on, what came last says more than a coarser grid, which stays behind.
    let goes_on = fine.level.slides_on_to(pose) || fine.level.presses_on_to(indenter, pose);
    if goes_on && fine.level.increment(indenter, pose, None, leave).is_ok() {
        return Ok(Ok(()));
    }
    let before: Vec<(Equilibrium, bool)> = coarser.iter().map(|s| (s.level.equilibrium(), s.lost)).collect();
    let hint = match &fine.bridge {
        Some(bridge) if before.last().is_some_and(|(_, lost)| !lost) => {
            match change(coarser, indenter, fine.level.pose(), pose) {
                Ok(change) => Some(bridge.carry(&change)),
                Err(stopped @ Error::Interrupted) => return Err(stopped),
                Err(_) => None,
            }
        }
        _ => None,
    };
    let lost = hint.is_none();
    let result = fine.level.increment(indenter, pose, hint.as_deref(), leave);
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

/// What a way changes on the last of `levels`, which may have to come to its beginning first.
fn change(levels: &mut [Step], indenter: &dyn Indenter, from: &Pose, to: &Pose) -> Result<Vec<f32>, Error> {
    let last = levels.len() - 1;
    if levels[last].level.pose() != from {
        follow(levels, indenter, from, &COARSER)?;
    }
    let old = levels[last].level.equilibrium();
    follow(levels, indenter, to, &COARSER)?;
    Ok(levels[last].level.change_since(&old))
}

/// Moves the indenter where nothing touches.
pub fn rest_at(levels: &mut [Step], pose: &Pose) {
    for step in levels {
        step.level.rest_at(pose);
        step.lost = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_of_a_way_is_told_in_millimetres_and_that_of_a_turn_in_degrees() {
        let (start, deep) = (Pose::new(0.0, 0.0, -0.5, 0.0), Pose::new(0.0, 0.0, -1.0, 0.0));
        assert_eq!(part_of_way(0.25, &start, &deep), "0.125 of 0.500 mm of this way");
        let turned = Pose { theta_deg: -5.0, ..start };
        assert_eq!(part_of_way(0.25, &start, &turned), "1.25 of 5.00 degrees of this turn");
    }
}
