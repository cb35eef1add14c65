//! What `twinrig check` shows: the expansion, the limits, time and disk.

use super::load::Setup;
use super::rig::Mounted;
use crate::device::settings::MoverSettings;
use crate::motion::{Coordinate, Phase};
use crate::plan::estimate::moves;
use crate::plan::file::primitive_name;
use crate::plan::{Contact, Estimate};
use serde::Serialize;
use std::fmt;
use std::time::Duration;

/// A configuration that passed, for people ([`fmt::Display`]) and scripts ([`Serialize`]).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckReport {
    /// Name of the rig.
    pub rig: String,
    /// Whether nothing on it is real.
    pub is_virtual: bool,
    /// The sensor; absent on a virtual bench without a plan.
    pub sensor: Option<String>,
    /// Every axis.
    pub axes: Vec<AxisReport>,
    /// The plan, if one was given.
    pub plan: Option<PlanReport>,
    /// The files that were read, with their hashes.
    pub files: Vec<FileReport>,
    /// The overrides.
    pub sets: Vec<String>,
    /// What passes, and yet promises more than there is.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// One axis: what it may do and what the plan asks of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisReport {
    /// Device and axis.
    pub axis: String,
    /// Coordinate of the pad frame that it provides, if any.
    pub coordinate: Option<&'static str>,
    /// `mm` or `deg`.
    pub unit: &'static str,
    /// Allowed positions.
    pub limits: [f64; 2],
    /// Fastest allowed feed, per second.
    pub max_feed: f64,
    /// Positions that the plan can command, whatever contact zero results.
    pub planned: Option<[f64; 2]>,
}

/// What a plan expands to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanReport {
    /// Its name.
    pub name: String,
    /// `press`, `slip` or `rotate`.
    pub primitive: &'static str,
    /// Captures: pairs of a real and a simulated picture.
    pub captures: usize,
    /// Approach .. retract, so many times.
    pub episodes: usize,
    /// Indenters, in order of use.
    pub indenters: Vec<String>,
    /// Number of locations.
    pub locations: usize,
    /// Depths, mm.
    pub depths_mm: Vec<f64>,
    /// Moves of each phase.
    pub moves: Vec<(Phase, usize)>,
    /// Indenters that somebody must mount; none on a virtual bench.
    pub by_hand: usize,
    /// How the contact zero is known.
    pub contact: Contact,
    /// Hash of the trajectory, as every row of the dataset will carry it.
    pub trajectory_blake3: String,
    /// Time and disk.
    pub estimate: Estimate,
    /// Expected duration without changing indenters, s.
    pub seconds: f64,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FileReport {
    /// Where it was found.
    pub path: String,
    /// BLAKE3 of its text.
    pub blake3: String,
}

impl CheckReport {
    /// Reports on a setup; it has passed all checks, or there would be none.
    pub fn new(setup: &Setup) -> Self {
        let rig = &setup.rig;
        let mut axes = Vec::new();
        for (device, mover) in &rig.devices {
            let joints = mover.axes.iter().filter(|_| mover.kinematics.is_some());
            let of_poses = mover.pose_axes();
            for (name, axis, is_joint) in
                of_poses.iter().map(|(n, a)| (n, a, false)).chain(joints.map(|(n, a)| (n, a, true)))
            {
                let provides = Coordinate::ALL
                    .into_iter()
                    .find(|c| rig.motion.role(*c).is_some_and(|r| r.device == *device && r.axis == *name));
                axes.push(AxisReport {
                    axis: format!("{device}.{name}"),
                    coordinate: if is_joint { Some("the tool") } else { provides.map(Coordinate::name) },
                    unit: axis.kind.unit(),
                    limits: [axis.min, axis.max],
                    max_feed: axis.max_feed,
                    planned: provides.and_then(|c| planned_range(setup, c)),
                });
            }
        }
        let sensor = match (&setup.sensor, &rig.sensor) {
            (Some(sensor), _) => Some(sensor.name.clone()),
            (None, Mounted::One(name)) => Some(name.clone()),
            (None, Mounted::Any) => None,
        };
        let plan = setup.plan.as_ref().map(|p| PlanReport {
            name: p.plan.name.clone(),
            primitive: primitive_name(p.plan.primitive),
            captures: p.trajectory.captures.len(),
            episodes: p.trajectory.episodes.len(),
            indenters: p.plan.indenters.iter().map(|i| i.name.clone()).collect(),
            locations: p.plan.locations_mm.len(),
            depths_mm: p.plan.depths_mm.clone(),
            moves: moves(&p.trajectory),
            by_hand: if rig.is_virtual() { 0 } else { p.estimate.indenter_changes as usize },
            contact: p.plan.contact,
            trajectory_blake3: p.trajectory.hash(),
            estimate: p.estimate,
            seconds: p.estimate.total().as_secs_f64(),
        });
        Self {
            rig: rig.name.clone(),
            is_virtual: rig.is_virtual(),
            sensor,
            axes,
            plan,
            files: (setup.sources.iter())
                .map(|s| FileReport { path: s.path.clone(), blake3: s.blake3.clone() })
                .collect(),
            sets: setup.sets.clone(),
            warnings: (rig.devices.iter().filter_map(|(name, device)| beyond_reach(name, device)))
                .chain(setup.warnings.iter().cloned())
                .collect(),
        }
    }
}

/// Words for a box of a tool that the joints cannot fill.
fn beyond_reach(name: &str, device: &MoverSettings) -> Option<String> {
    let (count, all, worst) = device.kinematics.as_ref()?.corners_out_of_reach(&device.axes)?;
    let said = worst.to_string();
    let (said, _) = said.rsplit_once("; ").unwrap_or((&said, ""));
    Some(format!(
        "[devices.{name}.kinematics.tool] allows more than the joints can do: {count} of the {all} corners of its box are out of reach, the worst: {said}. A pose there is refused before anything moves; for limits that can be relied on make the box smaller"
    ))
}

/// Lowest and highest axis position that the plan can command.
fn planned_range(setup: &Setup, coordinate: Coordinate) -> Option<[f64; 2]> {
    let plan = setup.plan.as_ref()?;
    let role = setup.rig.motion.role(coordinate)?;
    let [low, high] =
        if coordinate == Coordinate::Z { plan.plan.contact.zero_range_mm() } else { [0.0, 0.0] };
    let overshoot = setup.rig.fences().fence(role)?.overshoot;
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for waypoint in &plan.trajectory.waypoints {
        for zero in [low, high] {
            let target = role.to_axis(zero + coordinate.of(&waypoint.pose));
            for position in [target, target + overshoot] {
                range = [range[0].min(position), range[1].max(position)];
            }
        }
    }
    Some(range)
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.is_virtual { " (virtual)" } else { "" };
        writeln!(f, "rig: {}{kind}", self.rig)?;
        writeln!(f, "sensor: {}", self.sensor.as_deref().unwrap_or("any"))?;
        for axis in &self.axes {
            let unit = axis.unit;
            let role = axis.coordinate.map_or_else(|| "unused".to_owned(), |c| format!("moves {c}"));
            let [min, max] = axis.limits;
            write!(f, "axis {}: {role}, {min} to {max} {unit}, up to {} {unit}/s", axis.axis, axis.max_feed)?;
            if let Some([low, high]) = axis.planned {
                write!(f, "; the plan stays within {low:.3} to {high:.3} {unit}")?;
            }
            writeln!(f)?;
        }
        if let Some(plan) = &self.plan {
            write!(f, "{plan}")?;
        }
        for set in &self.sets {
            writeln!(f, "set: {set}")?;
        }
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        write!(f, "everything is in order; nothing was moved")
    }
}

impl fmt::Display for PlanReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "plan: {} ({})", self.name, self.primitive)?;
        let depths = match self.depths_mm.as_slice() {
            [one] => format!("depth {one} mm"),
            [first, .., last] => format!("{} depths from {first} to {last} mm", self.depths_mm.len()),
            [] => String::new(),
        };
        let (indenters, locations) =
            (counted(self.indenters.len(), "indenter"), counted(self.locations, "location"));
        writeln!(f, "expansion: {indenters}, {locations}, {depths}")?;
        writeln!(f, "indenters: {}", self.indenters.join(", "))?;
        writeln!(f, "episodes: {}", self.episodes)?;
        writeln!(f, "captures: {}", self.captures)?;
        match &self.contact {
            Contact::Given { zero_mm } => writeln!(f, "contact: given, {zero_mm} mm above nominal")?,
            Contact::TouchOff(t) => writeln!(
                f,
                "contact: touch-off for each indenter, from {} mm above nominal to {} mm below",
                t.start_mm, t.max_depth_mm
            )?,
        }
        let e = &self.estimate;
        writeln!(
            f,
            "bench time: about {} (moving {}, settling {}, pictures {}, touch-off {}){}",
            span(e.total()),
            span(e.motion),
            span(e.settling),
            span(e.exposures),
            span(e.touch_off),
            if self.by_hand > 0 {
                format!(", and {} mounted by hand", counted(self.by_hand, "indenter"))
            } else {
                String::new()
            },
        )?;
        writeln!(f, "disk: about {}", bytes(e.disk_bytes))?;
        writeln!(f, "trajectory: {}", self.trajectory_blake3)
    }
}

fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

fn span(time: Duration) -> String {
    let s = time.as_secs_f64().round() as u64;
    match s {
        0..=119 => format!("{s} s"),
        120..=7199 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s / 60 % 60),
    }
}

fn bytes(n: u64) -> String {
    let mb = n as f64 / 1e6;
    if mb < 1000.0 { format!("{mb:.0} MB") } else { format!("{:.1} GB", mb / 1000.0) }
}
