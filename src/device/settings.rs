//! What a rig file says about a mover: its port, its protocol, its axes.

use super::kinematics::Kinematics;
use crate::motion::{Arm, AxisKind, AxisLimits};
use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A serial device with axes, as the rig file describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoverSettings {
    /// Which firmware protocol it speaks: the stem of a file in `firmware_protocols/`.
    pub protocol: String,
    /// Where it is connected.
    pub port: PortSettings,
    /// Baud rate, when it differs from the protocol's.
    pub baud: Option<u32>,
    /// Pattern (regex) that the firmware's identity must match before anything moves.
    pub identity: Option<String>,
    /// What to do with DTR on opening, when it differs from the protocol's.
    pub dtr: Option<Dtr>,
    /// Time for vibrations to die after a move, ms.
    #[serde(default = "default_settle_ms")]
    pub settle_ms: u64,
    /// A move without progress for this long has stalled, ms.
    #[serde(default = "default_stall_ms")]
    pub stall_ms: u64,
    /// The axes by name.
    pub axes: BTreeMap<String, AxisSettings>,
    /// How the axes make a pose where they are the joints of an arm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kinematics: Option<Kinematics>,
}

fn default_settle_ms() -> u64 {
    150
}

fn default_stall_ms() -> u64 {
    3000
}

/// Where a mover is connected.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum PortSettings {
    /// A path such as `/dev/serial/by-id/...`, or the word `virtual`.
    Path(String),
    /// Matched by USB identity, so that two adapters can never be swapped.
    Usb(UsbPort),
}

impl PortSettings {
    /// Whether the rig file asks for the emulator of the virtual bench.
    pub fn is_virtual(&self) -> bool {
        matches!(self, PortSettings::Path(p) if p == "virtual")
    }
}

impl std::fmt::Display for PortSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            PortSettings::Path(path) => f.write_str(path),
            PortSettings::Usb(UsbPort { vid, pid, serial }) => {
                write!(f, "usb:{vid}:{pid}")?;
                serial.as_ref().map_or(Ok(()), |serial| write!(f, ":{serial}"))
            }
        }
    }
}

/// A USB serial adapter by identity.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UsbPort {
    /// Vendor id, hexadecimal, e.g. `0403`.
    pub vid: String,
    /// Product id, hexadecimal.
    pub pid: String,
    /// Serial number, when two adapters of one kind are present.
    pub serial: Option<String>,
}

/// What to do with the DTR line when the port opens; many boards reset on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dtr {
    /// As the driver does.
    Leave,
    /// Hold it on.
    High,
    /// Hold it off.
    Low,
    /// Off, then on: a deliberate reset.
    Pulse,
}

/// One axis. Positions and feeds are in its own unit: mm for linear, degrees for rotary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisSettings {
    /// Its name on the wire (an axis letter, or an address such as `1/1`).
    pub wire: String,
    /// Linear or rotary.
    pub kind: AxisKind,
    /// Lowest allowed position.
    pub min: f64,
    /// Highest allowed position.
    pub max: f64,
    /// Fastest allowed feed, per second.
    pub max_feed: f64,
    /// Acceleration, per second squared (time estimates, emulators).
    pub accel: f64,
    /// Device counts per mm or degree, where the protocol speaks in counts.
    pub counts_per_unit: Option<f64>,
    /// Largest accepted difference between target and measured position.
    pub tolerance: f64,
    /// Always arrive from this side, overshooting by `distance`, against backlash.
    pub approach: Option<Approach>,
}

/// One-sided approach against backlash.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Approach {
    /// The side to arrive from.
    pub from: Side,
    /// How far beyond the target to start, in the axis unit.
    pub distance: f64,
}

/// A side of a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// From lower positions.
    Below,
    /// From higher positions.
    Above,
}

/// No axis of a bench goes further, mm or degrees.
const FURTHEST: f64 = 1e6;

impl AxisSettings {
    /// The limits every move on this axis is checked against.
    pub fn limits(&self) -> AxisLimits {
        AxisLimits {
            kind: self.kind,
            min: self.min,
            max: self.max,
            max_feed: self.max_feed,
            accel: self.accel,
        }
    }
}

impl MoverSettings {
    /// The axes that poses are made of: those of the tool on an arm with joints, or else the device's own.
    pub fn pose_axes(&self) -> BTreeMap<String, AxisSettings> {
        self.kinematics.as_ref().map_or_else(|| self.axes.clone(), Kinematics::tool_axes)
    }

    /// The arm that the axes make, where they are joints.
    pub fn arm(&self) -> Option<Arm> {
        Some(self.kinematics.as_ref()?.arm(&self.axes))
    }

    /// Reports everything that cannot be right.
    pub fn check(&self, problems: &mut Problems) {
        if let Some(baud) = self.baud {
            problems.range("baud", f64::from(baud), 300.0, 1e7, "baud");
        }
        problems.range("settle_ms", self.settle_ms as f64, 0.0, 60_000.0, "ms");
        problems.range("stall_ms", self.stall_ms as f64, 1.0, 600_000.0, "ms");
        if self.axes.is_empty() {
            problems.push("axes", "nothing", "at least one axis", "add a table [<device>.axes.<name>]");
        }
        for (name, axis) in &self.axes {
            problems.within("axes", |p| {
                p.within(name.as_str(), |p| axis.check(p));
            });
        }
        if let Some(kinematics) = &self.kinematics {
            problems.within("kinematics", |p| kinematics.check(&self.axes, p));
        }
    }
}

impl AxisSettings {
    /// Whether nothing is wrong with the axis itself. Of what is wrong with it follows nothing about anything else.
    pub fn is_sound(&self) -> bool {
        let mut problems = Problems::new();
        self.check(&mut problems);
        problems.is_empty()
    }

    pub(super) fn check(&self, problems: &mut Problems) {
        if !(self.min.is_finite() && self.max.is_finite() && self.min < self.max) {
            let next = "set max above min";
            problems.push("max", self.max, format!("more than min = {}", self.min), next);
        } else {
            for (key, end) in [("min", self.min), ("max", self.max)] {
                problems.range(key, end, -FURTHEST, FURTHEST, self.kind.unit());
            }
        }
        problems.range("max_feed", self.max_feed, 1e-3, 1e4, "per second");
        problems.range("accel", self.accel, 1e-3, 1e6, "per second squared");
        problems.range("tolerance", self.tolerance, 1e-6, 1.0, self.kind.unit());
        if let Some(counts) = self.counts_per_unit {
            problems.range("counts_per_unit", counts, 1e-6, 1e9, "");
        }
        if let Some(approach) = &self.approach {
            problems.range("approach.distance", approach.distance, 0.0, 10.0, self.kind.unit());
        }
    }
}
