//! Moves: limits before the first byte, proof of arrival at the end.
//!
//! Stages of a move: check (limits, feed, reference), legs (one, or two where an axis is always
//! approached from one side), and for each leg: send, wait for the end of motion, measure, settle,
//! measure again.

use super::{Measured, Mover, MoverError, Reference};
use crate::clock::{Part, Timestamp, spent};
use crate::device::settings::{Approach, AxisSettings, Side};
use crate::motion::{LimitError, Profile};
use crate::protocol::{Failure, Request, StopKind};
use std::collections::BTreeMap;
use std::time::Duration;

/// Axes by name; their order is that of indices.
type Axes = BTreeMap<String, AxisSettings>;

/// Where a move ended, with the proof.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    /// All axes, measured after settling.
    pub measured: Vec<Measured>,
    /// When the device had said that it is at rest: settling began.
    pub rested_at: Timestamp,
    /// When settling had ended. That it is still where it should be was measured after that.
    pub settled_at: Timestamp,
    /// How often something had to be recovered on the way (a lost reply).
    pub recoveries: u32,
}

impl Reached {
    /// Where nothing was to move.
    pub(super) fn nowhere(measured: Vec<Measured>, now: Timestamp) -> Reached {
        Reached { measured, rested_at: now, settled_at: now, recoveries: 0 }
    }
}

/// Readback may lag behind the report of arrival (ophyd issue 288): it is read again this often.
const READBACK_TRIES: u32 = 5;
/// Time between these readings.
const READBACK_PAUSE: Duration = Duration::from_millis(100);

/// One leg, or two where an axis must be approached from the other side. Axes are in the order of their names.
pub(super) fn legs(axes: &Axes, targets: &[(usize, f64)], here: &[f64]) -> Vec<Vec<(usize, f64)>> {
    let mut first = targets.to_vec();
    for (at, target) in &mut first {
        let Some(settings) = axes.values().nth(*at) else { continue };
        let Some(Approach { from, distance }) = settings.approach else { continue };
        let now = here[*at];
        // At the target already, the lash was taken up when it was reached.
        let there = (now - *target).abs() <= settings.tolerance;
        match from {
            Side::Above if now < *target && !there => *target = (*target + distance).min(settings.max),
            Side::Below if now > *target && !there => *target = (*target - distance).max(settings.min),
            _ => {}
        }
    }
    if first == targets { vec![first] } else { vec![first, targets.to_vec()] }
}

/// Targets by index, every one inside its limits.
pub(super) fn check_targets(axes: &Axes, targets: &[(&str, f64)]) -> Result<Vec<(usize, f64)>, MoverError> {
    let mut indexed = Vec::new();
    for (name, target) in targets {
        let Some((at, (_, settings))) = axes.iter().enumerate().find(|(_, (n, _))| n == name) else {
            let known = axes.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            return Err(MoverError::UnknownAxis { axis: (*name).to_owned(), known });
        };
        settings.limits().check_position(name, *target)?;
        indexed.push((at, *target));
    }
    Ok(indexed)
}

/// No axis may be faster than its limit: of the feed along the line each gets its share.
pub(super) fn check_feed(
    axes: &Axes,
    targets: &[(usize, f64)],
    feed: f64,
    here: &[f64],
) -> Result<(), LimitError> {
    let deltas: Vec<f64> = targets.iter().map(|(at, t)| (t - here[*at]).abs()).collect();
    let length = deltas.iter().map(|d| d * d).sum::<f64>().sqrt();
    for ((at, _), delta) in targets.iter().zip(&deltas) {
        let Some((name, settings)) = axes.iter().nth(*at) else { continue };
        let share = if length > 0.0 { delta / length } else { 1.0 };
        let limits = settings.limits();
        if targets.len() == 1 {
            limits.check_feed(name, feed)?;
        } else if share > 0.0 || feed.is_nan() || feed <= 0.0 {
            limits.check_feed(name, feed * share.max(f64::MIN_POSITIVE))?;
        }
    }
    Ok(())
}

impl Mover {
    /// Moves axes to targets in a straight line, at `feed` along it in axis units per second, and
    /// returns when the device has arrived, was measured within tolerance, and has settled.
    pub async fn move_to(&mut self, targets: &[(&str, f64)], feed: f64) -> Result<Reached, MoverError> {
        self.end_of_stop().await?;
        let axes = self.settings.pose_axes();
        let targets = check_targets(&axes, targets)?;
        self.require_reference()?;
        if self.tool.is_some() {
            return self.move_tool(&axes, &targets, feed).await;
        }
        let here = self.resting_axes().await?;
        let places: Vec<f64> = here.iter().map(|measured| measured.position).collect();
        check_feed(&axes, &targets, feed, &places)?;
        let mut reached = Reached::nowhere(here, self.clock.now());
        let legs = legs(&axes, &targets, &places);
        for (i, leg) in legs.iter().enumerate() {
            self.still_allowed()?;
            // Nothing is looked at where the way only turns back.
            let settling = if i + 1 == legs.len() { self.settling() } else { Duration::ZERO };
            let part = self.travel(leg, &reached.measured, feed, settling).await?;
            reached = Reached { recoveries: reached.recoveries + part.recoveries, ..part };
        }
        Ok(reached)
    }

    pub(super) fn require_reference(&self) -> Result<(), MoverError> {
        let loss = self.link.telemetry().last_loss;
        let reason = match self.reference() {
            Reference::Referenced => return Ok(()),
            Reference::Unknown => "not homed since connecting".to_owned(),
            Reference::Homing => "homing".to_owned(),
            Reference::Suspect => loss.unwrap_or_else(|| "the link was lost".to_owned()),
        };
        Err(MoverError::NotReferenced { reason })
    }

    /// Between two sendings: no stop was called, and the positions are still trusted.
    pub(super) fn still_allowed(&self) -> Result<(), MoverError> {
        if self.stop_handle().is_stopped() {
            return Err(Failure::Stopped.into());
        }
        self.require_reference()
    }

    /// How long vibrations take to die after a move.
    pub(super) fn settling(&self) -> Duration {
        Duration::from_millis(self.settings.settle_ms)
    }

    /// Sends one straight move of the axes on the wire and proves its end; without `settling` it is one piece of
    /// several, and what it proves is where it ended.
    pub(super) async fn travel(
        &mut self,
        targets: &[(usize, f64)],
        here: &[Measured],
        feed: f64,
        settling: Duration,
    ) -> Result<Reached, MoverError> {
        let mut recoveries = 0;
        self.resting = None;
        let begun = self.clock.now();
        let sent = self.call(Request::Move { targets: targets.to_vec(), feed, jog: false }).await;
        let confirmed = match sent {
            Ok(_) => true,
            // What became of the move is not known: it is not sent again before that is found out.
            Err(Failure::NoReply { what, .. }) => {
                tracing::warn!("no reply to {what}: waiting until the device is at rest");
                recoveries += 1;
                false
            }
            Err(failure) => return Err(self.after_failure(failure)),
        };
        let accepted = self.clock.now();
        let way = self.shortest(targets, here, feed);
        self.settle(Some(way)).await?;
        // While it said so again it was settling already.
        let told = self.clock.now();
        let ended = self.link.telemetry().rested_at.unwrap_or(told).max(accepted);
        // Where the answers that told of the rest told where, too, that need not be asked.
        let heard = self.told_positions().ok().filter(|all| all.iter().all(|axis| axis.at >= ended));
        let arrived = match heard.filter(|all| self.within_tolerance(targets, all).is_ok()) {
            Some(heard) => Ok(heard),
            None => self.measure_arrival(targets).await,
        };
        self.require_kept()?;
        let mut measured = match arrived {
            Ok(measured) => measured,
            Err(MoverError::NotReached { .. }) if !confirmed => return Err(MoverError::MoveUnconfirmed),
            Err(e) => return Err(e),
        };
        // The question has been answered while it settled.
        self.clock.sleep(settling.saturating_sub(self.clock.now().since(ended))).await;
        self.still_allowed()?;
        let settled_at = self.clock.now();
        if !settling.is_zero() {
            measured = self.measure_arrival(targets).await?;
            self.require_kept()?;
        }

        spent(Part::Command, accepted.since(begun));
        spent(Part::Motion, way);
        spent(Part::EndOfMotion, ended.since(accepted).saturating_sub(way));
        spent(Part::Settle, settling);
        spent(Part::Position, settled_at.since(ended).saturating_sub(settling));
        spent(Part::Position, self.clock.now().since(settled_at));
        self.resting = Some(measured.clone());
        Ok(Reached { measured, rested_at: ended, settled_at, recoveries })
    }

    /// How long a straight move takes that loses no time: the slowest of its axes decides.
    fn shortest(&self, targets: &[(usize, f64)], here: &[Measured], feed: f64) -> Duration {
        let ways: Vec<f64> = targets.iter().map(|(at, t)| (t - here[*at].position).abs()).collect();
        let line = ways.iter().map(|w| w * w).sum::<f64>().sqrt();
        let time = |((at, _), way): (&(usize, f64), &f64)| {
            let limits = self.settings.axes[&self.names[*at]].limits();
            let share = if line > 0.0 { way / line } else { 0.0 };
            let feed = (feed * share).min(limits.max_feed);
            if feed > 0.0 { Profile::new(0.0, *way, feed, limits.accel).duration() } else { Duration::ZERO }
        };
        targets.iter().zip(&ways).map(time).max().unwrap_or_default()
    }

    /// Waits for the end of motion, `expected` after now where that is known. A device that has stalled is stopped.
    pub(super) async fn settle(&mut self, expected: Option<Duration>) -> Result<(), MoverError> {
        let stall = Duration::from_millis(self.settings.stall_ms);
        match self.call(Request::Settle { stall, expected }).await {
            Ok(_) => Ok(()),
            Err(failure @ (Failure::Stalled { .. } | Failure::NoReply { .. })) => {
                // It may still be moving, and nobody knows where: stop it, trust nothing.
                self.homed.distrust();
                self.stop_handle().stop(StopKind::Controlled);
                if let Err(e) = self.link.finish_stop().await {
                    tracing::warn!("stopping after \"{failure}\" failed as well: {e}");
                }
                Err(self.after_failure(failure))
            }
            Err(failure) => Err(self.after_failure(failure)),
        }
    }

    /// The positions, once every target is within tolerance.
    async fn measure_arrival(&mut self, targets: &[(usize, f64)]) -> Result<Vec<Measured>, MoverError> {
        let mut tries = 0;
        loop {
            let measured = match self.read_positions().await {
                Err(MoverError::Device(failure)) => return Err(self.after_failure(failure)),
                other => other?,
            };
            let Err(missed) = self.within_tolerance(targets, &measured) else { return Ok(measured) };
            tries += 1;
            if tries >= READBACK_TRIES {
                return Err(missed);
            }
            self.clock.sleep(READBACK_PAUSE).await;
        }
    }

    fn within_tolerance(&self, targets: &[(usize, f64)], measured: &[Measured]) -> Result<(), MoverError> {
        for (at, target) in targets {
            let settings = &self.settings.axes[&self.names[*at]];
            let found = &measured[*at];
            // Rounding of the last printed digit is not a miss.
            let allowed = settings.tolerance + 1e-9;
            let counted = match (self.spec.position.counts, found.counts, settings.counts_per_unit) {
                // The motor's own count is a second witness where the position is only the target.
                (false, Some(counts), Some(scale)) => Some(counts.0 as f64 / scale),
                _ => None,
            };
            for position in [Some(found.position), counted].into_iter().flatten() {
                let missed_by = (position - target).abs();
                if missed_by.is_nan() || missed_by > allowed {
                    return Err(MoverError::NotReached {
                        axis: found.axis.clone(),
                        target: *target,
                        measured: position,
                        tolerance: settings.tolerance,
                        unit: settings.kind.unit(),
                    });
                }
            }
        }
        Ok(())
    }

    /// The error of a failed dialogue: that the position was lost, where it was.
    fn after_failure(&self, failure: Failure) -> MoverError {
        if failure == Failure::Stopped || self.reference() == Reference::Referenced {
            return failure.into();
        }
        MoverError::PositionLost { reason: failure.to_string() }
    }

    fn require_kept(&self) -> Result<(), MoverError> {
        match self.reference() {
            Reference::Referenced => Ok(()),
            _ => Err(MoverError::PositionLost {
                reason: self.link.telemetry().last_loss.unwrap_or_else(|| "the link was lost".to_owned()),
            }),
        }
    }
}
