//! How long a plan takes on a rig, and how much it writes.
//!
//! Motion uses the rig's own accelerations, so it is an estimate of the bench, not the nominal
//! duration of the trajectory. Changing indenters by hand is counted, not timed. Simulating is not
//! included: it runs beside the bench.

use super::check::RigFences;
use super::{Contact, Plan};
use crate::motion::{Coordinate, Phase, Profile, Trajectory};
use crate::pose::Pose;
use serde::Serialize;
use std::time::Duration;

/// What the rig adds to every move and every picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Until vibrations have died after a move that a capture follows.
    pub settle: Duration,
    /// From the end of settling to a finished picture.
    pub exposure: Duration,
    /// Command and confirmation of one move.
    pub command: Duration,
    /// Pixels of a picture.
    pub pixels: u64,
}

/// Time and disk.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// Moving.
    pub motion: Duration,
    /// Waiting for vibrations to die.
    pub settling: Duration,
    /// Taking pictures.
    pub exposures: Duration,
    /// Finding the contact zeros, if they lie at the nominal height.
    pub touch_off: Duration,
    /// Indenters to put in, the first included.
    pub indenter_changes: u32,
    /// Bytes of the dataset, generously.
    pub disk_bytes: u64,
}

impl Estimate {
    /// Everything together, without changing indenters.
    pub fn total(&self) -> Duration {
        self.motion + self.settling + self.exposures + self.touch_off
    }
}

/// Bytes a pixel of one capture: a noisy PNG, a smooth PNG, and a float TIFF, taken from what sessions on the
/// virtual bench wrote and rounded up.
const BYTES_PER_PIXEL: u64 = 2 + 2 + 3;

/// Journals, Parquet and thumbnails of the report, a capture.
const BYTES_PER_CAPTURE: u64 = 40_000;

/// Time and disk for a trajectory that has been checked against `rig`.
pub fn estimate(plan: &Plan, trajectory: &Trajectory, rig: &RigFences, pace: &Pace) -> Estimate {
    let mut before = Pose::new(0.0, 0.0, plan.clearance_mm, 0.0);
    let mut motion = Duration::ZERO;
    for waypoint in &trajectory.waypoints {
        motion += move_time(rig, &before, &waypoint.pose, waypoint.feed_mm_s, waypoint.feed_deg_s);
        motion += pace.command;
        before = waypoint.pose;
    }
    let captures = trajectory.captures.len() as u32;
    let changes = trajectory.episodes.chunk_by(|a, b| a.indenter == b.indenter).count() as u32;
    let touch_off = match &plan.contact {
        Contact::Given { .. } => Duration::ZERO,
        Contact::TouchOff(touch) => {
            let up = Pose::new(0.0, 0.0, plan.clearance_mm, 0.0);
            let at = |z: f64| Pose::new(0.0, 0.0, z, 0.0);
            let down = move_time(rig, &up, &at(touch.start_mm), plan.feeds.travel_mm_s, 0.0);
            let step = move_time(rig, &at(0.0), &at(touch.step_mm), plan.feeds.press_mm_s, 0.0);
            // Coarse steps down to the contact, and on average fifteen fine ones from a step above.
            let steps = (touch.start_mm / touch.step_mm).ceil() as u32 + 15;
            2 * down + steps * (step + pace.command + pace.settle + pace.exposure)
        }
    };
    Estimate {
        motion,
        settling: captures * pace.settle,
        exposures: captures * pace.exposure,
        touch_off: changes * touch_off,
        indenter_changes: changes,
        disk_bytes: u64::from(captures) * (pace.pixels * BYTES_PER_PIXEL + BYTES_PER_CAPTURE),
    }
}

/// The slowest axis decides; a one-sided approach goes beyond the target and back.
fn move_time(rig: &RigFences, from: &Pose, to: &Pose, feed_mm_s: f64, feed_deg_s: f64) -> Duration {
    let mut slowest = Duration::ZERO;
    for coordinate in Coordinate::ALL {
        let (a, b) = (coordinate.of(from), coordinate.of(to));
        let fence = rig.map.role(coordinate).and_then(|role| rig.fence(role));
        if let (Some(fence), true) = (fence, a != b) {
            let line = if coordinate == Coordinate::Theta {
                feed_deg_s
            } else {
                feed_mm_s * (b - a).abs() / from.distance_mm(to)
            };
            let feed = line.min(fence.limits.max_feed);
            let time = |way: f64| Profile::new(0.0, way, feed, fence.limits.accel).duration();
            let mut duration = time((b - a).abs());
            if fence.overshoot != 0.0 {
                duration += 2 * time(fence.overshoot.abs());
            }
            slowest = slowest.max(duration);
        }
    }
    slowest
}

/// How many moves each phase has.
pub fn moves(trajectory: &Trajectory) -> Vec<(Phase, usize)> {
    let order = [Phase::Approach, Phase::Press, Phase::Slide, Phase::Rotate, Phase::Retract];
    order
        .into_iter()
        .map(|phase| (phase, trajectory.waypoints.iter().filter(|w| w.phase == phase).count()))
        .filter(|(_, count)| *count > 0)
        .collect()
}
