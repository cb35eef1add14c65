//! Plan to trajectory: the single place where a plan becomes poses and capture marks.

use super::depth_ladder::rounded;
use super::direction::unit_vector;
use super::{Feeds, Plan};
use crate::motion::{CaptureMark, Episode, Phase, Primitive, Profile, Trajectory, Waypoint};
use crate::pose::Pose;
use std::time::Duration;

/// Makes a plan concrete.
///
/// The trajectory begins over the pad's centre at clearance height, where the session puts the
/// indenter before anything else (height first). Every episode is: sideways to the location at
/// clearance, down to the approach height, down into the pad, the experiment, straight up.
/// Frame 0 of a slip or rotate episode is the press itself.
pub fn expand(plan: &Plan) -> Trajectory {
    let mut path = Path::new(plan);
    for indenter in &plan.indenters {
        for repeat in 0..plan.repeats {
            for location in &plan.locations_mm {
                let start = |path: &mut Path| path.begin(&indenter.name, *location, repeat);
                match (&plan.slide, &plan.rotate) {
                    (Some(slide), _) => {
                        for depth in &plan.depths_mm {
                            for direction in &slide.directions {
                                start(&mut path);
                                path.press(*depth);
                                let [ux, uy] = unit_vector(*direction);
                                path.mark.slip_direction_deg = direction.deg;
                                path.capture();
                                for distance in &slide.distances_mm {
                                    let [x, y] = [location[0] + distance * ux, location[1] + distance * uy];
                                    path.slide(*distance, [rounded(x), rounded(y)]);
                                    path.capture();
                                }
                                path.end();
                            }
                        }
                    }
                    (None, Some(rotate)) => {
                        for depth in &plan.depths_mm {
                            for direction in &rotate.directions {
                                start(&mut path);
                                path.press(*depth);
                                path.capture();
                                for angle in &rotate.angles_deg {
                                    path.rotate(direction.signed_deg(*angle));
                                    path.capture();
                                }
                                path.end();
                            }
                        }
                    }
                    (None, None) => {
                        start(&mut path);
                        for depth in &plan.depths_mm {
                            path.press(*depth);
                            path.capture();
                        }
                        path.end();
                    }
                }
            }
        }
    }
    path.trajectory
}

/// A trajectory under construction: where the tip is, when, and in which episode.
struct Path {
    trajectory: Trajectory,
    primitive: Primitive,
    feeds: Feeds,
    clearance_mm: f64,
    approach_mm: f64,
    at: Pose,
    now: Duration,
    mark: CaptureMark,
}

impl Path {
    fn new(plan: &Plan) -> Self {
        Self {
            trajectory: Trajectory { waypoints: vec![], episodes: vec![], captures: vec![] },
            primitive: plan.primitive,
            feeds: plan.feeds,
            clearance_mm: plan.clearance_mm,
            approach_mm: plan.approach_mm,
            at: Pose::new(0.0, 0.0, plan.clearance_mm, 0.0),
            now: Duration::ZERO,
            mark: fresh_mark(0),
        }
    }

    /// Opens an episode: over its location, and down to the approach height.
    fn begin(&mut self, indenter: &str, location_mm: [f64; 2], repeat: u32) {
        let first_waypoint = self.trajectory.waypoints.len() as u32;
        self.mark = fresh_mark(self.trajectory.episodes.len() as u32);
        self.trajectory.episodes.push(Episode {
            indenter: indenter.to_owned(),
            primitive: self.primitive,
            location_mm,
            repeat,
            first_waypoint,
            end_waypoint: first_waypoint,
        });
        let [x, y] = location_mm;
        let travel = self.feeds.travel_mm_s;
        self.go(Pose::new(x, y, self.clearance_mm, 0.0), travel, Phase::Approach);
        self.go(Pose::new(x, y, self.approach_mm, 0.0), travel, Phase::Approach);
    }

    fn press(&mut self, depth_mm: f64) {
        self.mark.depth_mm = depth_mm;
        self.go(Pose { z_mm: 0.0 - depth_mm, ..self.at }, self.feeds.press_mm_s, Phase::Press);
    }

    fn slide(&mut self, distance_mm: f64, [x_mm, y_mm]: [f64; 2]) {
        self.mark.slip_mm = distance_mm;
        self.go(Pose { x_mm, y_mm, ..self.at }, self.feeds.slide_mm_s, Phase::Slide);
    }

    fn rotate(&mut self, theta_deg: f64) {
        self.mark.rotation_deg = theta_deg;
        self.go(Pose { theta_deg, ..self.at }, 0.0, Phase::Rotate);
    }

    /// Closes the episode: straight up.
    fn end(&mut self) {
        self.go(Pose { z_mm: self.clearance_mm, ..self.at }, self.feeds.travel_mm_s, Phase::Retract);
        let episode = self.trajectory.episodes.last_mut().expect("begin comes before end");
        episode.end_waypoint = self.trajectory.waypoints.len() as u32;
    }

    /// Marks a capture at the pose reached last.
    fn capture(&mut self) {
        let number = self.trajectory.captures.len() as u32;
        let waypoint = self.trajectory.waypoints.len() as u32 - 1;
        self.trajectory.captures.push(CaptureMark { waypoint, ..self.mark.clone() });
        self.trajectory.waypoints[waypoint as usize].capture = Some(number);
        self.mark.step += 1;
    }

    fn go(&mut self, pose: Pose, feed_mm_s: f64, phase: Phase) {
        let turn_deg = (pose.theta_deg - self.at.theta_deg).abs();
        let way_mm = self.at.distance_mm(&pose);
        let feed_mm_s = if way_mm > 0.0 { feed_mm_s } else { 0.0 };
        let feed_deg_s = if turn_deg > 0.0 { self.feeds.rotate_deg_s } else { 0.0 };
        let time = |way: f64, feed: f64, accel: f64| {
            if way > 0.0 { Profile::new(0.0, way, feed, accel).duration() } else { Duration::ZERO }
        };
        let duration = time(way_mm, feed_mm_s, self.feeds.accel_mm_s2).max(time(
            turn_deg,
            feed_deg_s,
            self.feeds.accel_deg_s2,
        ));
        let starts = self.now;
        self.now += duration;
        self.at = pose;
        self.trajectory.waypoints.push(Waypoint {
            pose,
            starts,
            arrives: self.now,
            feed_mm_s,
            feed_deg_s,
            phase,
            episode: self.mark.episode,
            capture: None,
        });
    }
}

fn fresh_mark(episode: u32) -> CaptureMark {
    CaptureMark {
        waypoint: 0,
        episode,
        step: 0,
        depth_mm: 0.0,
        slip_mm: 0.0,
        slip_direction_deg: 0.0,
        rotation_deg: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::PlanFile;
    use crate::problem::Problems;

    fn shipped(text: &str) -> Plan {
        let file: PlanFile = toml::from_str(text).unwrap();
        let mut problems = Problems::new();
        let plan = file.check(&mut problems);
        assert_eq!(problems.into_vec(), []);
        plan.unwrap()
    }

    const PRESS: &str = include_str!("../../rig_configs/plans/press.toml");
    const SLIP: &str = include_str!("../../rig_configs/plans/slip.toml");
    const ROTATE: &str = include_str!("../../rig_configs/plans/rotate.toml");
    const SMALL: &str = include_str!("../../rig_configs/plans/small.toml");

    #[test]
    fn the_papers_plans_have_the_papers_counts() {
        for (text, captures, episodes) in [(PRESS, 2079, 189), (SLIP, 48, 8), (ROTATE, 60, 6), (SMALL, 4, 1)]
        {
            let plan = shipped(text);
            let trajectory = expand(&plan);
            assert_eq!(trajectory.captures.len(), captures, "{}", plan.name);
            assert_eq!(trajectory.episodes.len(), episodes, "{}", plan.name);
            assert_eq!(plan.captures(), captures as f64, "{}", plan.name);
        }
    }

    #[test]
    fn episodes_partition_the_waypoints_and_time_runs_forward() {
        for text in [PRESS, SLIP, ROTATE, SMALL] {
            let trajectory = expand(&shipped(text));
            let mut next = 0;
            for (i, episode) in trajectory.episodes.iter().enumerate() {
                assert_eq!(episode.first_waypoint, next);
                next = episode.end_waypoint;
                let waypoints = trajectory.waypoints_of(i as u32);
                assert!(waypoints.iter().all(|w| w.episode == i as u32));
                assert_eq!(waypoints[0].phase, Phase::Approach);
                assert_eq!(waypoints.last().unwrap().phase, Phase::Retract);
            }
            assert_eq!(next as usize, trajectory.waypoints.len());
            assert!(trajectory.waypoints.windows(2).all(|w| w[0].arrives == w[1].starts));
            for (i, capture) in trajectory.captures.iter().enumerate() {
                assert_eq!(trajectory.waypoints[capture.waypoint as usize].capture, Some(i as u32));
            }
        }
    }

    #[test]
    fn frame_0_of_a_slide_is_the_press_and_left_is_minus_x() {
        let trajectory = expand(&shipped(SLIP));
        let poses: Vec<Pose> = (0..6).map(|c| trajectory.pose_of(c)).collect();
        let expected: Vec<Pose> = (0..6).map(|i| Pose::new(-f64::from(i), 0.0, -0.5, 0.0)).collect();
        assert_eq!(poses, expected);
        assert_eq!(trajectory.pose_of(11), Pose::new(5.0, 0.0, -0.5, 0.0));
        let mark = &trajectory.captures[11];
        assert_eq!((mark.episode, mark.step, mark.slip_mm, mark.depth_mm), (1, 5, 5.0, 0.5));
        assert_eq!(trajectory.captures[0].slip_direction_deg, 180.0);
    }

    #[test]
    fn clockwise_is_positive_and_every_episode_starts_unturned() {
        let trajectory = expand(&shipped(ROTATE));
        assert_eq!(trajectory.pose_of(9), Pose::new(0.0, 0.0, -0.5, 45.0));
        assert_eq!(trajectory.pose_of(10).theta_deg, 0.0);
        assert_eq!(trajectory.pose_of(19).theta_deg, -45.0);
        assert_eq!(trajectory.captures[19].rotation_deg, -45.0);
    }

    #[test]
    fn a_press_descends_the_ladder_at_each_place_of_the_grid() {
        let trajectory = expand(&shipped(PRESS));
        let depths: Vec<f64> = trajectory.captures[..11].iter().map(|c| c.depth_mm).collect();
        assert_eq!(depths, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]);
        let places: Vec<[f64; 2]> = trajectory.episodes[..4].iter().map(|e| e.location_mm).collect();
        assert_eq!(places, [[-1.0, -1.0], [0.0, -1.0], [1.0, -1.0], [-1.0, 0.0]]);
        assert_eq!(trajectory.episodes[9].indenter, "sphere2");
    }

    #[test]
    fn the_same_plan_has_the_same_hash_and_another_depth_another() {
        let plan = shipped(SLIP);
        let deeper = Plan { depths_mm: vec![0.6], ..plan.clone() };
        assert_eq!(expand(&plan).hash(), expand(&plan).hash());
        assert_ne!(expand(&plan).hash(), expand(&deeper).hash());
    }

    #[test]
    fn moves_last_as_long_as_their_feeds_say() {
        let trajectory = expand(&shipped(SLIP));
        // A slide of 1 mm at 1 mm/s with 50 mm/s^2: 1 s and one ramp of 0.02 s.
        let slide = trajectory.waypoints.iter().find(|w| w.phase == Phase::Slide).unwrap();
        assert!(((slide.arrives - slide.starts).as_secs_f64() - 1.02).abs() < 1e-9);
    }
}
