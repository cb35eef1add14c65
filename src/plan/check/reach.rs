//! Poses against the reach of an arm with joints.
//!
//! Its tool's axes have a box of limits like any others ([`super::axes`]), but not every pose in the box can be taken
//! with the tool upright, nor every line be drawn without folding over. So every pose of the trajectory is asked of
//! the arm itself, at the lowest and at the highest contact zero, with the corners that the session goes around
//! (sideways only in the air, straight up and down); and at the lowest, every line between them.

use super::RigFences;
use super::axes::{phase_name, plan_key};
use crate::motion::{Arm, Coordinate, Phase, ReachError, Trajectory, Waypoint};
use crate::plan::{Contact, Plan};
use crate::pose::Pose;
use crate::problem::Problems;
use std::collections::BTreeMap;

pub(super) fn check(plan: &Plan, trajectory: &Trajectory, rig: &RigFences, problems: &mut Problems) {
    for (device, arm) in &rig.arms {
        // An arm that makes nothing of the pose cannot be asked too much.
        if Coordinate::ALL.into_iter().any(|c| rig.map.role(c).is_some_and(|role| role.device == *device)) {
            check_arm(plan, trajectory, rig, (device, arm), problems);
        }
    }
}

/// A pose of the plan, and what it belongs to.
struct Stop {
    pose: Pose,
    phase: Phase,
    what: String,
}

/// The poses that cannot be taken: how many, and the worst of them.
struct Missed {
    count: usize,
    excess: f64,
    what: String,
    error: ReachError,
}

fn check_arm(
    plan: &Plan,
    trajectory: &Trajectory,
    rig: &RigFences,
    (device, arm): (&String, &Arm),
    problems: &mut Problems,
) {
    let mut missed: BTreeMap<&'static str, Missed> = BTreeMap::new();
    let mut asked: BTreeMap<[i64; 4], Option<Vec<f64>>> = BTreeMap::new();
    let zeros = plan.contact.zero_range_mm();
    for (which, zero) in zeros.into_iter().enumerate() {
        let mut before: Option<(Pose, Vec<f64>)> = None;
        for stop in stops(plan, trajectory, zero, which == 0) {
            let pose = tool_pose(rig, device, &stop.pose);
            let mut note = |excess: f64, error: ReachError| {
                let key = key_of(arm, rig, device, &stop);
                let entry = missed.entry(key).or_insert_with(|| Missed {
                    count: 0,
                    excess: f64::NEG_INFINITY,
                    what: String::new(),
                    error: error.clone(),
                });
                entry.count += 1;
                if excess > entry.excess {
                    (entry.excess, entry.what, entry.error) = (excess, stop.what.clone(), error);
                }
            };
            let guess = before.as_ref().map_or_else(|| arm.chain.middle_deg(), |(_, joints)| joints.clone());
            let known =
                asked.entry(rounded(&pose)).or_insert_with(|| match arm.chain.joints(&pose, &guess) {
                    Ok(joints) => Some(joints),
                    Err(error) => {
                        note(error.excess(), error);
                        None
                    }
                });
            let joints = known.clone();
            // A line that was drawn before is no news, and one from or to nowhere is none.
            if let (Some((from, here)), Some(_), 0) = (&before, &joints, which)
                && rounded(from) != rounded(&pose)
                && let Err(error) = arm.line(here, &pose)
            {
                note(error.excess(), error);
            }
            before = joints.map(|joints| (pose, joints)).or(before);
        }
    }
    for (key, Missed { count, what, error, .. }) in missed {
        let times = if count > 1 { format!(" (the worst of {count})") } else { String::new() };
        let said = error.to_string();
        let (said, next) = said.rsplit_once("; ").unwrap_or((&said, "choose another pose"));
        problems.push(
            key,
            format!("{what}: {said}{times}"),
            format!("poses that the joints of {device} can take, tool upright"),
            format!("{next} ([devices.{device}.kinematics])"),
        );
    }
}

/// Every pose of the session in order, with the corners of its moves.
fn stops(plan: &Plan, trajectory: &Trajectory, zero: f64, is_lowest: bool) -> Vec<Stop> {
    let start = Pose::new(0.0, 0.0, plan.clearance_mm, 0.0);
    let stop = |pose: Pose, phase, what: &str| Stop { pose, phase, what: what.to_owned() };
    let mut stops = vec![stop(start, Phase::Approach, "the start")];
    let mut from = Pose { z_mm: zero + plan.clearance_mm, ..start };
    for waypoint in &trajectory.waypoints {
        let to = Pose { z_mm: zero + waypoint.pose.z_mm, ..waypoint.pose };
        let what = match waypoint {
            Waypoint { capture: Some(capture), .. } => format!("capture {capture}"),
            w => format!("episode {}, {}", w.episode, phase_name(w.phase)),
        };
        // Sideways before down, and after up.
        let corner = if to.z_mm <= from.z_mm {
            Pose { z_mm: from.z_mm, ..to }
        } else {
            Pose { z_mm: to.z_mm, ..from }
        };
        for pose in [corner, to] {
            stops.push(Stop { pose, phase: waypoint.phase, what: what.clone() });
        }
        from = to;
    }
    if let (Contact::TouchOff(touch), true) = (&plan.contact, is_lowest) {
        for episode in &trajectory.episodes {
            let [x, y] = episode.location_mm;
            stops.push(stop(Pose::new(x, y, touch.start_mm, 0.0), Phase::Press, "the touch-off's start"));
            stops.push(stop(Pose::new(x, y, -touch.max_depth_mm, 0.0), Phase::Press, "the touch-off's end"));
        }
    }
    stops
}

/// What a pose asks of the tool: only the coordinates that this device makes; the others it leaves at 0.
fn tool_pose(rig: &RigFences, device: &str, pose: &Pose) -> Pose {
    let mut tool = Pose::default();
    for coordinate in Coordinate::ALL {
        let role = rig.map.role(coordinate).filter(|role| role.device == device);
        if let Some((role, of)) = role.and_then(|role| Some((role, Arm::coordinate(&role.axis)?))) {
            *of.of_mut(&mut tool) = role.to_axis(coordinate.of(pose));
        }
    }
    tool
}

/// The key of the plan that decides: the place, where even touching it is too far; or else the height.
fn key_of(arm: &Arm, rig: &RigFences, device: &str, stop: &Stop) -> &'static str {
    let touching = tool_pose(rig, device, &Pose { z_mm: 0.0, ..stop.pose });
    let can_touch = arm.chain.joints(&touching, &arm.chain.middle_deg()).is_ok();
    plan_key(if can_touch { Coordinate::Z } else { Coordinate::X }, stop.phase)
}

/// A pose as a key: micrometres and thousandths of a degree.
fn rounded(pose: &Pose) -> [i64; 4] {
    Coordinate::ALL.map(|c| (c.of(pose) * 1e3).round() as i64)
}
