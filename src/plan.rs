//! Plans: what to do with which indenters, as data.
//!
//! Three steps, each a pure function:
//! - [`PlanFile`] is the file as a user writes it; [`PlanFile::check`] turns it into a [`Plan`];
//! - [`expand`] makes the plan concrete as the one [`Trajectory`] that bench and twin both follow;
//! - [`check`](check::check) walks that trajectory against the fences of a rig and finds everything
//!   that would be unsafe or impossible, and [`estimate`] says how long it takes and how much it writes.
//!
//! Terms: a *primitive* is the kind of experiment (press, slip, rotate). A *ladder* is the list of
//! depths, distances or angles at which captures are taken. The *contact zero* is the height at
//! which the tip touches; depths count from it. *Clearance* is the height of sideways travel.
//!
//! The order of episodes is part of the contract, because the capture's number is its place in it:
//! indenter, repeat, location, depth (slip and rotate), direction.
//!
//! What this module never does: see a device, open a file, or wait.

pub mod check;
pub mod depth_ladder;
pub mod direction;
pub mod estimate;
pub mod expand;
pub mod file;
pub mod footprint;

pub use check::{Fence, RigFences, check, check_axes};
pub use direction::SpinDirection;
pub use estimate::Estimate;
pub use expand::expand;
pub use file::{PlanFile, SplitBy};

use crate::motion::{Primitive, SlideDirection, Trajectory};
use serde::Serialize;

/// A checked plan. Lengths are mm, angles degrees, heights relative to the contact zero.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// What it is called.
    pub name: String,
    /// The kind of experiment.
    pub primitive: Primitive,
    /// Name of the sensor it is meant for (the stem of its file).
    pub sensor: String,
    /// The indenters, in order of use.
    pub indenters: Vec<PlannedIndenter>,
    /// Where to press, pad frame, mm.
    pub locations_mm: Vec<[f64; 2]>,
    /// How deep to press, mm, increasing.
    pub depths_mm: Vec<f64>,
    /// The slide (slip plans).
    pub slide: Option<Slide>,
    /// The rotation (rotate plans).
    pub rotate: Option<Rotate>,
    /// How fast.
    pub feeds: Feeds,
    /// Height of sideways travel above the contact zero, mm.
    pub clearance_mm: f64,
    /// Height above the contact zero at which the press begins, mm.
    pub approach_mm: f64,
    /// How the contact zero is known.
    pub contact: Contact,
    /// How often everything is done.
    pub repeats: u32,
    /// How captures are divided into training and test data.
    pub split: Split,
}

/// An indenter of a plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedIndenter {
    /// The stem of its file.
    pub name: String,
    /// Radius with which its edges are rounded, mm; absent: as its file says.
    pub edge_round_mm: Option<f64>,
}

/// Slides from the location of the press, one episode a direction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Slide {
    /// Where to.
    pub directions: Vec<SlideDirection>,
    /// Distances at which a capture is taken, mm, increasing, without the 0 of the press itself.
    pub distances_mm: Vec<f64>,
}

/// Rotations about the press axis, one episode a direction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rotate {
    /// Which way.
    pub directions: Vec<SpinDirection>,
    /// Angles at which a capture is taken, degrees, increasing, without the 0 of the press itself.
    pub angles_deg: Vec<f64>,
}

/// Speeds of the tip, and the nominal accelerations that date the trajectory. A rig's own
/// accelerations give the estimate of [`estimate`]; these only stamp the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Feeds {
    /// At clearance, and down to the approach height, mm/s.
    pub travel_mm_s: f64,
    /// Into the pad, mm/s.
    pub press_mm_s: f64,
    /// Sideways at depth, mm/s.
    pub slide_mm_s: f64,
    /// Turning, deg/s.
    pub rotate_deg_s: f64,
    /// Nominal acceleration along a line, mm/s^2.
    pub accel_mm_s2: f64,
    /// Nominal acceleration of a turn, deg/s^2.
    pub accel_deg_s2: f64,
}

impl Default for Feeds {
    fn default() -> Self {
        Self {
            travel_mm_s: 5.0,
            press_mm_s: 0.5,
            slide_mm_s: 1.0,
            rotate_deg_s: 10.0,
            accel_mm_s2: 50.0,
            accel_deg_s2: 100.0,
        }
    }
}

/// How the contact zero is known. Both are heights in the rig's nominal frame, whose 0 is where the
/// rig file's `motion.z.origin` says that contact is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Contact {
    /// Known beforehand: its height above the nominal contact, mm.
    Given {
        /// Height of the contact zero above the nominal contact, mm.
        zero_mm: f64,
    },
    /// Found by descending until the image changes, once for each indenter.
    TouchOff(TouchOff),
}

impl Contact {
    /// The lowest and highest contact zero this can result in, mm above the nominal contact.
    pub fn zero_range_mm(&self) -> [f64; 2] {
        match self {
            Contact::Given { zero_mm } => [*zero_mm, *zero_mm],
            Contact::TouchOff(t) => [-t.max_depth_mm, t.start_mm],
        }
    }
}

/// A descent in steps until the picture differs from the untouched one, heights relative to the
/// rig's nominal contact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TouchOff {
    /// Where the descent begins, above the nominal contact, mm.
    pub start_mm: f64,
    /// Size of a coarse step, mm; the fine one is a tenth of it.
    pub step_mm: f64,
    /// Where it gives up, below the nominal contact, mm.
    pub max_depth_mm: f64,
    /// Change of the picture that counts as contact, code values; absent: the rig's
    /// `session.touch_threshold`.
    pub threshold: Option<f64>,
}

impl Default for TouchOff {
    fn default() -> Self {
        Self { start_mm: 0.5, step_mm: 0.1, max_depth_mm: 0.5, threshold: None }
    }
}

/// How captures are divided into training and test data: by whole groups, never by frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Split {
    /// What stays together.
    pub by: SplitBy,
    /// Share of the groups that become test data.
    pub test_fraction: f64,
    /// Seed of the division.
    pub seed: u64,
}

impl Split {
    /// `train` or `test` for every episode of a trajectory.
    ///
    /// Groups are ranked by a hash of the seed and their name, and the first `test_fraction` of
    /// them (rounded; at least one when the fraction is positive and there are two groups or more)
    /// are test data.
    pub fn of_episodes(&self, trajectory: &Trajectory) -> Vec<&'static str> {
        let names: Vec<String> = (trajectory.episodes.iter().enumerate())
            .map(|(i, e)| match self.by {
                SplitBy::Episode => i.to_string(),
                SplitBy::Indenter => e.indenter.clone(),
                SplitBy::Location => format!("{:?}", e.location_mm),
            })
            .collect();
        let mut ranked: Vec<(String, &str)> = names
            .iter()
            .map(String::as_str)
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .map(|n| (blake3::hash(format!("{} {n}", self.seed).as_bytes()).to_hex().to_string(), n))
            .collect();
        ranked.sort();
        let mut tests = (self.test_fraction * ranked.len() as f64).round() as usize;
        if self.test_fraction > 0.0 && ranked.len() >= 2 {
            tests = tests.clamp(1, ranked.len() - 1);
        }
        let test: std::collections::HashSet<&str> = ranked[..tests].iter().map(|(_, n)| *n).collect();
        names.iter().map(|n| if test.contains(n.as_str()) { "test" } else { "train" }).collect()
    }
}
