//! The trajectory: a plan made concrete as timed poses with capture marks.
//!
//! There is exactly one of these per session. The bench follows it, the twin follows it, and its
//! hash is stored with every row of the dataset: that is what makes *the identical trajectory* a
//! fact. Heights are relative to the contact zero, which touch-off finds at run time on the bench.

use crate::pose::Pose;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// What a waypoint is part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// In the air, from the clearance height over the location down to the approach height.
    Approach,
    /// Down into the pad.
    Press,
    /// Sideways at depth.
    Slide,
    /// About z at depth.
    Rotate,
    /// Up and away, to the clearance height.
    Retract,
}

/// What kind of experiment a capture belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Primitive {
    /// Normal press at a location.
    Press,
    /// Press, then slide.
    Slip,
    /// Press, then rotate.
    Rotate,
}

/// Direction of a slide in the camera's image, as an angle from right towards down.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SlideDirection {
    /// 0 = right (+x), 90 = down (+y), 180 = left (-x), degrees.
    pub deg: f64,
}

/// One commanded pose, reached in a straight line from the one before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Waypoint {
    /// Where to go; `z_mm` relative to the contact zero.
    pub pose: Pose,
    /// Nominal start of the move, from the beginning of the trajectory.
    pub starts: Duration,
    /// Nominal arrival.
    pub arrives: Duration,
    /// Feed of the tip along the line, mm/s (0 for a pure rotation).
    pub feed_mm_s: f64,
    /// Feed of the rotation, deg/s (0 where nothing turns).
    pub feed_deg_s: f64,
    /// What the move is part of.
    pub phase: Phase,
    /// Index into [`Trajectory::episodes`].
    pub episode: u32,
    /// Index into [`Trajectory::captures`] when a capture is due after arrival and settling.
    pub capture: Option<u32>,
}

/// One approach .. retract with one indenter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Name of the indenter (its file's stem).
    pub indenter: String,
    /// What is done.
    pub primitive: Primitive,
    /// Where the press happens, pad frame, mm.
    pub location_mm: [f64; 2],
    /// Repetition number, from 0.
    pub repeat: u32,
    /// First waypoint of the episode, an index into [`Trajectory::waypoints`].
    pub first_waypoint: u32,
    /// One past the last waypoint.
    pub end_waypoint: u32,
}

/// One mark: one real frame and one simulated frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaptureMark {
    /// The waypoint after which the capture is due.
    pub waypoint: u32,
    /// Index into [`Trajectory::episodes`].
    pub episode: u32,
    /// Running number within the episode, from 0.
    pub step: u32,
    /// Commanded depth, mm.
    pub depth_mm: f64,
    /// Distance slid so far, mm.
    pub slip_mm: f64,
    /// Direction of the slide; 0 where nothing slides.
    pub slip_direction_deg: f64,
    /// Signed rotation so far, degrees.
    pub rotation_deg: f64,
}

/// The whole of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Every commanded pose, in order.
    pub waypoints: Vec<Waypoint>,
    /// The episodes, in order; they partition the waypoints.
    pub episodes: Vec<Episode>,
    /// The captures, in plan order; the index is the capture's number everywhere.
    pub captures: Vec<CaptureMark>,
}

impl Trajectory {
    /// BLAKE3 of the canonical JSON form, in hex: equal hashes mean equal trajectories.
    pub fn hash(&self) -> String {
        let json = serde_json::to_vec(self).expect("a trajectory holds only finite numbers and strings");
        blake3::hash(&json).to_hex().to_string()
    }

    /// Waypoints of one episode.
    pub fn waypoints_of(&self, episode: u32) -> &[Waypoint] {
        let e = &self.episodes[episode as usize];
        &self.waypoints[e.first_waypoint as usize..e.end_waypoint as usize]
    }

    /// Pose commanded at a capture.
    pub fn pose_of(&self, capture: u32) -> Pose {
        self.waypoints[self.captures[capture as usize].waypoint as usize].pose
    }

    /// Nominal time of motion, without settling, exposures, touch-off and indenter changes.
    pub fn duration(&self) -> Duration {
        self.waypoints.last().map_or(Duration::ZERO, |w| w.arrives)
    }
}
