//! What the indenter does to the pad: depth, footprint, and sideways motion.

use super::Bench;
use crate::motion::{Phase, Trajectory, Waypoint};
use crate::plan::Plan;
use crate::plan::footprint::Footprint;
use crate::pose::Pose;
use crate::problem::Problems;

/// Deepest press as a share of the pad's thickness. Beyond it the material is far outside the
/// range of the models, and a real pad tears from its backing.
pub const DEEPEST_SHARE: f64 = 0.6;

/// How far inside the pad's edge every contact stays, mm: nearer, the bonded-layer models stop
/// being right and a real pad peels.
pub const EDGE_MARGIN_MM: f64 = 1.0;

/// Rounding that is forgiven, mm.
const SLACK_MM: f64 = 1e-6;

pub(super) fn check(plan: &Plan, trajectory: &Trajectory, bench: &Bench<'_>, problems: &mut Problems) {
    check_depth(plan, trajectory, bench, problems);
    check_heights(plan, trajectory, bench, problems);
    check_footprints(plan, trajectory, bench, problems);
    check_sideways(plan, trajectory, bench, problems);
}

/// Where an indenter touches, over all its episodes.
fn contact_waypoints<'t>(
    trajectory: &'t Trajectory,
    indenter: &'t str,
) -> impl Iterator<Item = &'t Waypoint> + Clone {
    (trajectory.episodes.iter().enumerate())
        .filter(move |(_, e)| e.indenter == indenter)
        .flat_map(|(e, _)| trajectory.waypoints_of(e as u32))
        .filter(|w| is_in_contact(w))
}

fn is_in_contact(waypoint: &Waypoint) -> bool {
    matches!(waypoint.phase, Phase::Press | Phase::Slide | Phase::Rotate)
}

fn check_depth(plan: &Plan, trajectory: &Trajectory, bench: &Bench<'_>, problems: &mut Problems) {
    // A one-sided approach of the press axis from inside the pad goes deeper than it is told.
    let role = &bench.rig.map.z;
    let overshoot = bench.rig.fence(role).map_or(0.0, |f| f.overshoot * role.sign);
    let extra = (-overshoot).max(0.0);
    let deepest = trajectory.waypoints.iter().map(|w| -w.pose.z_mm).fold(0.0, f64::max);
    let allowed = DEEPEST_SHARE * bench.pad.thickness_mm;
    if deepest + extra > allowed + SLACK_MM {
        let approach =
            if extra > 0.0 { format!(" and {extra} mm of one-sided approach") } else { String::new() };
        let thickness = bench.pad.thickness_mm;
        let share = DEEPEST_SHARE * 100.0;
        problems.push(
            "depths",
            format!("{deepest} mm deep{approach}"),
            format!("0 to {allowed:.3} mm ({share:.0} % of the {thickness} mm thick pad of {})", plan.sensor),
            "press less deep, or choose a sensor with a thicker pad",
        );
    }
}

/// The twin refuses a press that takes the whole indenter into the pad ([`Error::Low`](crate::elastomer::Error::Low)): a bench
/// would perform it first, and the pair would lack its other half.
fn check_heights(plan: &Plan, trajectory: &Trajectory, bench: &Bench<'_>, problems: &mut Problems) {
    let size = [bench.pad.size_x_mm, bench.pad.size_y_mm];
    let depth =
        |w: &Waypoint| w.pose.depth_mm() + bench.pad.shape.face_height_mm(size, [w.pose.x_mm, w.pose.y_mm]);
    for (i, planned) in plan.indenters.iter().enumerate() {
        let Some(indenter) = bench.indenters.get(&planned.name) else { continue };
        let depths = contact_waypoints(trajectory, &planned.name).map(depth);
        let (deepest, height) = (depths.fold(0.0, f64::max), indenter.height_mm());
        if deepest >= height {
            problems.push(
                &format!("indenters.[{i}]"),
                format!(
                    "indenter {} is {height:.3} mm high and would be pressed {deepest:.3} mm deep, so that the face would close \
                     above it",
                    planned.name
                ),
                format!("0 to less than {height:.3} mm deep"),
                "press less deep than it is high, or make it higher (height_mm in its file, or the mesh)",
            );
        }
    }
}

fn check_footprints(plan: &Plan, trajectory: &Trajectory, bench: &Bench<'_>, problems: &mut Problems) {
    let half = [bench.pad.size_x_mm / 2.0, bench.pad.size_y_mm / 2.0];
    for (i, planned) in plan.indenters.iter().enumerate() {
        let Some(indenter) = bench.indenters.get(&planned.name) else {
            continue; // Whoever assembled the bench has reported that it is not there.
        };
        let contact_poses = contact_waypoints(trajectory, &planned.name);
        let deepest = contact_poses.clone().map(|w| -w.pose.z_mm).fold(0.0, f64::max);
        let key = format!("indenters.[{i}]");
        let Some(footprint) = Footprint::at_depth(indenter.as_ref(), deepest) else {
            problems.push(
                &key,
                format!("{} touches nothing {deepest} mm deep", planned.name),
                "an indenter whose tip is at height 0",
                format!("correct the shape in the file of {}", planned.name),
            );
            continue;
        };

        // The pose that comes nearest to the edge, or leaves it furthest.
        let reach = |w: &Waypoint| {
            let [x0, x1, y0, y1] = footprint.bounds_mm(&w.pose);
            (x1.max(-x0) - half[0]).max(y1.max(-y0) - half[1])
        };
        let Some(worst) = contact_poses.max_by(|a, b| reach(a).total_cmp(&reach(b))) else { continue };
        let [x0, x1, y0, y1] = footprint.bounds_mm(&worst.pose);
        let misses = x0 > half[0] || x1 < -half[0] || y0 > half[1] || y1 < -half[1];
        if reach(worst) > -EDGE_MARGIN_MM + SLACK_MM {
            let what =
                if misses { "misses the pad" } else { "comes too near to the pad's edge, or leaves it" };
            problems.push(
                &key,
                format!(
                    "{} {what}: it touches x {x0:.2} to {x1:.2} mm, y {y0:.2} to {y1:.2} mm at {}",
                    planned.name, worst.pose
                ),
                format!(
                    "|x| up to {} mm, |y| up to {} mm: {EDGE_MARGIN_MM} mm inside the pad of {}",
                    half[0] - EDGE_MARGIN_MM,
                    half[1] - EDGE_MARGIN_MM,
                    plan.sensor
                ),
                "move the locations inward, slide less far, or choose a smaller indenter",
            );
        }
    }
}

/// Sideways motion is allowed at clearance, and in contact as the experiment itself. Anything in
/// between drags the indenter over the pad or hits it from the side.
fn check_sideways(plan: &Plan, trajectory: &Trajectory, bench: &Bench<'_>, problems: &mut Problems) {
    let moved = |a: f64, b: f64| (a - b).abs() > 1e-12;
    let mut before = Pose::new(0.0, 0.0, plan.clearance_mm, 0.0);
    let (mut dragged, mut bent) = (None, None);
    for waypoint in &trajectory.waypoints {
        let pose = waypoint.pose;
        let [dx, dy] = [moved(before.x_mm, pose.x_mm), moved(before.y_mm, pose.y_mm)];
        let sideways = dx || dy || moved(before.theta_deg, pose.theta_deg);
        let at_clearance = before.z_mm.min(pose.z_mm) >= plan.clearance_mm - SLACK_MM;
        let experiment = matches!(waypoint.phase, Phase::Slide | Phase::Rotate);
        let in_contact = experiment && pose.z_mm < 0.0 && pose.z_mm == before.z_mm;
        if sideways && !at_clearance && !in_contact {
            dragged.get_or_insert(waypoint);
        }
        if dx && dy && !at_clearance {
            bent.get_or_insert(waypoint);
        }
        before = pose;
    }
    if let Some(waypoint) = dragged {
        problems.push(
            "depths",
            format!("sideways motion at height {} mm", waypoint.pose.z_mm),
            format!("in contact (deeper than 0 mm) or at clearance_mm = {} mm", plan.clearance_mm),
            "press deeper than 0 mm before sliding or turning",
        );
    }
    let device = |role: Option<&crate::motion::AxisRole>| role.map(|r| r.device.clone());
    let [x, y] = [device(bench.rig.map.x.as_ref()), device(bench.rig.map.y.as_ref())];
    if let (Some(waypoint), Some(x), Some(y)) = (bent, x, y)
        && x != y
    {
        problems.push(
            "slide.directions",
            format!("an oblique slide to x {} y {} mm", waypoint.pose.x_mm, waypoint.pose.y_mm),
            format!("left, right, up or down, since x is on device {x} and y on {y}"),
            "two devices cannot follow one straight line: choose a direction along one axis",
        );
    }
}
