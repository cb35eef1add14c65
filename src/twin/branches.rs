//! Episodes as a tree: paths with a common beginning are walked once.
//!
//! The left and the right slide of one indenter share their press, so the twin presses once and
//! forks the state. A node is a commanded pose; its captures are all those that any episode wants
//! there. Branches in which nothing is wanted are never walked, and neither is what follows the last
//! wanted capture of a branch (the retract, usually). Both can be had otherwise ([`Skip::SharedPaths`],
//! [`Skip::NeededWaypoints`]): the captures are the same.

use crate::elastomer::{Settings, Skip};
use crate::motion::Trajectory;
use crate::pose::Pose;
use std::collections::BTreeSet;

/// A pose reached from its parent's pose, with the captures due there.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    /// Where to go.
    pub pose: Pose,
    /// Captures taken there, in plan order; the first is simulated, the others share its result.
    pub captures: Vec<u32>,
    /// What happens next, in plan order.
    pub next: Vec<Branch>,
}

/// Everything one mounted indenter does from one starting pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Root {
    /// Name of the indenter.
    pub indenter: String,
    /// Where the first episode starts, in the air.
    pub start: Pose,
    /// What happens from there.
    pub next: Vec<Branch>,
}

/// The tree of the wanted captures of a trajectory, with the skips of `settings`. `pose_of` gives the pose that the twin follows
/// at a waypoint: the commanded one, or the one measured on the bench.
pub fn grow(
    trajectory: &Trajectory,
    wanted: &BTreeSet<u32>,
    settings: &Settings,
    mut pose_of: impl FnMut(usize) -> Pose,
) -> Vec<Root> {
    let shares = settings.skips(Skip::SharedPaths);
    let mut roots: Vec<Root> = Vec::new();
    for episode in &trajectory.episodes {
        let range = episode.first_waypoint as usize..episode.end_waypoint as usize;
        let is_wanted = |i: usize| trajectory.waypoints[i].capture.is_some_and(|c| wanted.contains(&c));
        let Some(last_wanted) = range.clone().rev().find(|i| is_wanted(*i)) else { continue };
        let last = if settings.skips(Skip::NeededWaypoints) { last_wanted } else { range.end - 1 };

        let start = pose_of(range.start);
        let known = roots.iter().position(|r| r.indenter == episode.indenter && r.start == start);
        let root = known.filter(|_| shares).unwrap_or_else(|| {
            roots.push(Root { indenter: episode.indenter.clone(), start, next: Vec::new() });
            roots.len() - 1
        });

        let mut siblings = &mut roots[root].next;
        for i in range.start..=last {
            let pose = pose_of(i);
            let known = siblings.iter().position(|b| b.pose == pose);
            let at = known.unwrap_or_else(|| {
                siblings.push(Branch { pose, captures: Vec::new(), next: Vec::new() });
                siblings.len() - 1
            });
            if let Some(capture) = trajectory.waypoints[i].capture.filter(|c| wanted.contains(c)) {
                siblings[at].captures.push(capture);
            }
            siblings = &mut siblings[at].next;
        }
    }
    roots
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{CaptureMark, Episode, Phase, Primitive, Waypoint};
    use std::time::Duration;

    /// Two slides from one press: left to -2, right to +2, with captures at 0, 1 and 2 mm.
    fn slip() -> Trajectory {
        let mut t = Trajectory { waypoints: Vec::new(), episodes: Vec::new(), captures: Vec::new() };
        for (e, sign) in [-1.0_f64, 1.0].into_iter().enumerate() {
            let first = t.waypoints.len() as u32;
            let path = [
                (0.0, 5.0, false),
                (0.0, -0.5, true),
                (sign, -0.5, true),
                (2.0 * sign, -0.5, true),
                (2.0 * sign, 5.0, false),
            ];
            for (x, z, capture) in path {
                let mark = capture.then(|| {
                    t.captures.push(CaptureMark {
                        waypoint: t.waypoints.len() as u32,
                        episode: e as u32,
                        step: 0,
                        depth_mm: 0.5,
                        slip_mm: x.abs(),
                        slip_direction_deg: 0.0,
                        rotation_deg: 0.0,
                    });
                    t.captures.len() as u32 - 1
                });
                t.waypoints.push(Waypoint {
                    pose: Pose::new(x, 0.0, z, 0.0),
                    starts: Duration::ZERO,
                    arrives: Duration::ZERO,
                    feed_mm_s: 1.0,
                    feed_deg_s: 0.0,
                    phase: Phase::Slide,
                    episode: e as u32,
                    capture: mark,
                });
            }
            t.episodes.push(Episode {
                indenter: "moon".into(),
                primitive: Primitive::Slip,
                location_mm: [0.0, 0.0],
                repeat: 0,
                first_waypoint: first,
                end_waypoint: t.waypoints.len() as u32,
            });
        }
        t
    }

    #[test]
    fn what_is_not_skipped_is_pressed_for_each_slide_and_followed_to_the_end() {
        let t = slip();
        let grown = |without| {
            let settings = Settings { without, ..Settings::default() };
            grow(&t, &(0..6).collect(), &settings, |i| t.waypoints[i].pose)
        };
        let roots = grown(vec![Skip::SharedPaths]);
        let captures = |root: &Root| root.next[0].next[0].captures.clone();
        assert_eq!(roots.iter().map(captures).collect::<Vec<_>>(), [[0], [3]]);
        let slid = |root: &Root| root.next[0].next[0].next[0].next[0].clone();
        assert!(roots.iter().all(|root| root.next.len() == 1 && slid(root).next.is_empty()));

        let roots = grown(vec![Skip::SharedPaths, Skip::NeededWaypoints]);
        let ends = |root: &Root| slid(root).next.iter().map(|b| (b.pose.z_mm, b.captures.len())).collect();
        assert_eq!(roots.iter().map(ends).collect::<Vec<Vec<_>>>(), [[(5.0, 0)], [(5.0, 0)]]);
        assert_eq!(grown(vec![Skip::NeededWaypoints]).len(), 1);
    }

    #[test]
    fn left_and_right_share_their_press_and_nobody_retracts() {
        let t = slip();
        let roots = grow(&t, &(0..6).collect(), &Settings::default(), |i| t.waypoints[i].pose);
        assert_eq!(roots.len(), 1);
        let press = &roots[0].next[0].next[0];
        assert_eq!(press.captures, [0, 3]);
        assert_eq!(press.next.len(), 2);
        assert!(press.next.iter().all(|slide| slide.next[0].next.is_empty()));
    }

    #[test]
    fn what_is_not_wanted_is_not_walked() {
        let t = slip();
        let roots = grow(&t, &BTreeSet::from([4]), &Settings::default(), |i| t.waypoints[i].pose);
        let press = &roots[0].next[0].next[0];
        assert_eq!(press.next.len(), 1);
        assert_eq!(press.next[0].captures, [4]);
        assert!(press.next[0].next.is_empty());
        assert!(grow(&t, &BTreeSet::new(), &Settings::default(), |i| t.waypoints[i].pose).is_empty());
    }
}
