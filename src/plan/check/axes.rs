//! Axis targets and feeds against the fences of the rig.

use super::{Fence, RigFences};
use crate::motion::{AxisRole, Coordinate, Phase, Trajectory, Waypoint};
use crate::plan::{Contact, Plan};
use crate::pose::Pose;
use crate::problem::Problems;
use std::collections::BTreeMap;

/// The rules about axes alone; for all of them see [`super::check`].
pub fn check(plan: &Plan, trajectory: &Trajectory, rig: &RigFences, problems: &mut Problems) {
    for coordinate in Coordinate::ALL {
        match rig.map.role(coordinate) {
            None => check_unprovided(coordinate, trajectory, problems),
            Some(role) => match rig.fence(role) {
                Some(fence) => check_provided(coordinate, role, fence, plan, trajectory, problems),
                None => problems.push(
                    plan_key(coordinate, Phase::Approach),
                    format!("needs axis {} of device {}", role.axis, role.device),
                    "an axis that the rig file describes",
                    format!("correct [motion.{}] in the rig file", coordinate.name()),
                ),
            },
        }
    }
}

/// A coordinate without an axis stays at 0; whatever else is asked of it is refused.
fn check_unprovided(coordinate: Coordinate, trajectory: &Trajectory, problems: &mut Problems) {
    let asked = trajectory.waypoints.iter().find(|w| coordinate.of(&w.pose) != 0.0);
    if let Some(waypoint) = asked {
        let name = coordinate.name();
        problems.push(
            plan_key(coordinate, waypoint.phase),
            format!("{name} = {}", coordinate.of(&waypoint.pose)),
            format!("{name} = 0, since no axis of this rig provides {name}"),
            format!("choose a rig with [motion.{name}], or a plan that does not need it"),
        );
    }
}

/// The furthest that a rule is broken, and by what.
struct Worst {
    excess: f64,
    value: String,
    allowed: String,
    count: usize,
}

fn check_provided(
    coordinate: Coordinate,
    role: &AxisRole,
    fence: &Fence,
    plan: &Plan,
    trajectory: &Trajectory,
    problems: &mut Problems,
) {
    let axis = format!("{}.{}", role.device, role.axis);
    let unit = fence.limits.kind.unit();
    let mut worst: BTreeMap<&'static str, Worst> = BTreeMap::new();
    let mut note = |key: &'static str, excess: f64, value: String, allowed: String| {
        let entry = worst.entry(key).or_insert_with(|| Worst {
            excess: f64::NEG_INFINITY,
            value: String::new(),
            allowed,
            count: 0,
        });
        entry.count += 1;
        if excess > entry.excess || excess.is_nan() {
            (entry.excess, entry.value) = (excess, value);
        }
    };

    // Positions: the target itself, and where a one-sided approach begins.
    let travel = format!("{} to {} {unit} on axis {axis}", fence.limits.min, fence.limits.max);
    let mut visit = |key: &'static str, at: f64, what: &dyn Fn() -> String| {
        let target = role.to_axis(at);
        for (position, how) in [(target, ""), (target + fence.overshoot, ", approaching one-sided")] {
            if fence.limits.check_position(&axis, position).is_err() {
                let excess = (fence.limits.min - position).max(position - fence.limits.max);
                let value = format!("{} puts axis {axis} at {position:.4} {unit}{how}", what());
                note(key, excess, value, travel.clone());
            }
        }
    };
    for waypoint in std::iter::once(None).chain(trajectory.waypoints.iter().map(Some)) {
        let start = Pose::new(0.0, 0.0, plan.clearance_mm, 0.0);
        let (pose, phase) = waypoint.map_or((&start, Phase::Approach), |w| (&w.pose, w.phase));
        let key = plan_key(coordinate, phase);
        if coordinate != Coordinate::Z {
            visit(key, coordinate.of(pose), &|| described(coordinate, pose, waypoint));
            continue;
        }
        // Heights count from a zero that touch-off finds somewhere in a range. Before that, travel
        // is at clearance over the nominal contact.
        let [low, high] = plan.contact.zero_range_mm();
        for zero in [low, high] {
            visit(key, zero + pose.z_mm, &|| {
                format!("{} with the contact zero at {zero} mm", described(coordinate, pose, waypoint))
            });
        }
        if waypoint.is_none() && matches!(plan.contact, Contact::TouchOff(_)) {
            visit(key, pose.z_mm, &|| format!("{} before touch-off", described(coordinate, pose, waypoint)));
        }
    }
    if let (Coordinate::Z, Contact::TouchOff(touch)) = (coordinate, &plan.contact) {
        visit("contact.start_mm", touch.start_mm, &|| "the touch-off's start".into());
        visit("contact.max_depth_mm", -touch.max_depth_mm, &|| "the touch-off's end".into());
    }

    // Feeds: the full feed of a line is held against every axis that moves in it, since axes on
    // different devices each get it.
    let fastest = format!("0 (exclusive) to {} {unit}/s on axis {axis}", fence.limits.max_feed);
    let mut before = Pose::new(0.0, 0.0, plan.clearance_mm, 0.0);
    for waypoint in &trajectory.waypoints {
        if coordinate.of(&waypoint.pose) != coordinate.of(&before) {
            let feed = if coordinate == Coordinate::Theta { waypoint.feed_deg_s } else { waypoint.feed_mm_s };
            if fence.limits.check_feed(&axis, feed).is_err() {
                let key = feed_key(coordinate, waypoint.phase);
                note(key, feed - fence.limits.max_feed, format!("{feed} {unit}/s"), fastest.clone());
            }
        }
        before = waypoint.pose;
    }

    for (key, worst) in worst {
        let times = if worst.count > 1 { format!(" (the worst of {})", worst.count) } else { String::new() };
        let next = if key.starts_with("feeds") {
            "choose a slower feed, or correct max_feed in the rig file"
        } else {
            "keep the plan inside the travel, or correct the axis limits or motion origin in the rig file"
        };
        problems.push(key, worst.value + &times, worst.allowed, next);
    }
}

pub(super) fn described(coordinate: Coordinate, pose: &Pose, waypoint: Option<&Waypoint>) -> String {
    let what = match waypoint {
        None => "the start".to_owned(),
        Some(Waypoint { capture: Some(capture), .. }) => format!("capture {capture}"),
        Some(w) => format!("episode {}, {}", w.episode, phase_name(w.phase)),
    };
    format!("{} = {} ({what})", coordinate.name(), coordinate.of(pose))
}

pub(super) fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::Approach => "approach",
        Phase::Press => "press",
        Phase::Slide => "slide",
        Phase::Rotate => "rotation",
        Phase::Retract => "retract",
    }
}

/// The key of the plan file that decides a coordinate in a phase.
pub(super) fn plan_key(coordinate: Coordinate, phase: Phase) -> &'static str {
    match (coordinate, phase) {
        (Coordinate::Theta, _) => "rotate.angle_deg",
        (Coordinate::Z, Phase::Approach | Phase::Retract) => "clearance_mm",
        (Coordinate::Z, _) => "depths",
        (_, Phase::Slide | Phase::Retract) => "slide.distance_mm",
        _ => "locations",
    }
}

fn feed_key(coordinate: Coordinate, phase: Phase) -> &'static str {
    match (coordinate, phase) {
        (Coordinate::Theta, _) => "feeds.rotate_deg_s",
        (_, Phase::Approach | Phase::Retract) => "feeds.travel_mm_s",
        (_, Phase::Press) => "feeds.press_mm_s",
        (_, Phase::Slide | Phase::Rotate) => "feeds.slide_mm_s",
    }
}
