//! The `[emulator]` table of a protocol file: how the emulated firmware behaves.
//!
//! The client never reads it. The table holds what differs between machines of one family (texts,
//! settings, sizes of buffers, axes); what a family of firmwares has in common, such as how a reset
//! is swallowed or a line is counted, is the *dialect*, one of a closed set that the emulator knows.

use super::value::Pattern;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The table as checked.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmulatorSpec {
    /// Time from a command to the first byte of its reply, microseconds.
    #[serde(default = "default_latency_us")]
    pub latency_us: u64,
    /// `[[emulator.axis]]`: the axes the firmware has, in its own order. A rig that wires an axis
    /// replaces travel, feed, acceleration and counts by its own.
    pub axis: Vec<EmulatedAxis>,
    /// `[emulator.dialect.<name>]`: the family, and what this member of it says.
    pub dialect: Dialect,
}

fn default_latency_us() -> u64 {
    1500
}

/// An axis as the firmware has it when no rig says otherwise.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmulatedAxis {
    /// Its name on the wire.
    pub wire: String,
    /// Lowest position, mm or degrees.
    pub min: f64,
    /// Highest position.
    pub max: f64,
    /// Fastest feed, per second.
    pub max_feed: f64,
    /// Acceleration, per second squared.
    pub accel: f64,
    /// Counts (steps, ticks) for each mm or degree.
    pub counts_per_unit: f64,
    /// The end of travel where its home switch is.
    pub home: HomeEnd,
}

/// An end of travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HomeEnd {
    /// At the lowest position.
    Min,
    /// At the highest position.
    Max,
}

/// The family of firmwares, with what this member says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dialect {
    /// GRBL 1.1 and grblHAL.
    Grbl(GrblEmulation),
    /// Marlin and its vendors' trees.
    Marlin(MarlinEmulation),
    /// Zaber ASCII.
    ZaberAscii(ZaberEmulation),
    /// Thorlabs APT.
    ThorlabsApt(AptEmulation),
    /// Dobot Magician.
    Dobot(DobotEmulation),
    /// Dynamixel 2.0 and Feetech STS.
    ServoBus(ServoEmulation),
    /// Any line protocol that rules can describe.
    Rules(RulesEmulation),
}

/// A member of the GRBL family.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrblEmulation {
    /// What a reset prints, after an empty line.
    pub banner: String,
    /// Answer to `$I`.
    pub identify: Vec<String>,
    /// Answer to `$G`, with `{feed}`, `{motion}`, `{wcs}`, `{units}`, `{distance}`, `{feed_mode}`.
    pub parser_state: String,
    /// Names in `$#` before `G28`.
    pub coordinate_systems: Vec<String>,
    /// Settings in the order of `$$`, each `number=value`; the decimals of a value are kept.
    pub settings: Vec<String>,
    /// Settings that a controller has once it is set up for a rig.
    #[serde(default)]
    pub set_up: Vec<String>,
    /// Blocks the planner holds.
    pub planner_blocks: usize,
    /// Bytes the receive buffer holds.
    pub rx_bytes: usize,
    /// Characters a line may have.
    pub line_chars: usize,
    /// Sleep after an alarm is printed, ms.
    #[serde(default = "default_alarm_delay_ms")]
    pub alarm_delay_ms: u64,
    /// States in which nothing is answered: `homing`, `critical_alarm`.
    #[serde(default)]
    pub silent_in: Vec<SilentState>,
    /// What grblHAL does otherwise.
    #[serde(default)]
    pub hal: bool,
    /// grblHAL's answer to `$EA`, each `number=text`.
    #[serde(default)]
    pub alarm_texts: Vec<String>,
    /// grblHAL's answer to `$EE`.
    #[serde(default)]
    pub error_texts: Vec<String>,
}

fn default_alarm_delay_ms() -> u64 {
    500
}

/// A state in which a GRBL answers nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SilentState {
    /// While `$H` runs, even to `?`.
    Homing,
    /// After ALARM:1 and ALARM:2, until a reset.
    CriticalAlarm,
}

/// A member of the Marlin family.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarlinEmulation {
    /// What a reset prints.
    pub boot: Vec<String>,
    /// Answer to `M115`.
    pub identify: Vec<String>,
    /// Answer to `M503`, with `{steps}` for the steps per mm of all axes.
    pub settings: Vec<String>,
    /// Answer to `M105`, after `ok `.
    pub temperatures: String,
    /// Blocks the planner holds.
    pub planner_blocks: usize,
    /// Lines the command queue holds.
    pub queue_lines: usize,
    /// Bytes the receive buffer holds.
    pub rx_bytes: usize,
    /// Time between two busy lines, ms.
    pub busy_ms: u64,
    /// Whether M112, M410 and M108 act as soon as they are received.
    pub emergency_parser: bool,
    /// Whether codes it does not know are reported; some vendors' trees only say `ok`.
    pub reports_unknown_codes: bool,
    /// What `M112` prints before the silence; recorded boards print nothing.
    #[serde(default)]
    pub kill_text: String,
    /// Whether M114 waits for motion to end (true for a while in 1.1).
    #[serde(default)]
    pub position_waits: bool,
    /// Feed of homing by axis letter, mm/s.
    pub homing_feed: BTreeMap<String, f64>,
}

/// A chain of Zaber devices.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZaberEmulation {
    /// Settings of a device: what `get` answers.
    pub settings: BTreeMap<String, String>,
    /// Settings of an axis, besides `pos`, `maxspeed`, `accel` and the limits.
    pub axis_settings: BTreeMap<String, String>,
}

/// A Thorlabs controller with one channel.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AptEmulation {
    /// Its address on the bus.
    pub address: u8,
    /// Model, at most eight characters.
    pub model: String,
    /// Serial number.
    pub serial: i32,
    /// Firmware version: interim, minor, major, unused.
    pub firmware: [u8; 4],
    /// Notes of the hardware information.
    pub notes: String,
    /// Whether it sends stepper status (with an encoder count) instead of DC status (with velocity).
    pub stepper: bool,
    /// Velocity parameter for one unit per second.
    pub velocity_per_unit: f64,
    /// Acceleration parameter for one unit per second squared.
    pub accel_per_unit: f64,
}

/// A Dobot Magician arm.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DobotEmulation {
    /// Serial number.
    pub serial: String,
    /// Device name.
    pub name: String,
    /// Version: major, minor, revision.
    pub version: [u8; 3],
    /// Where homing ends: x, y, z (mm), r (degrees).
    pub home_pose: [f64; 4],
    /// Least and greatest distance of the tool from the base axis, mm.
    pub reach_mm: [f64; 2],
}

/// Servos on one bus.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoEmulation {
    /// Which frames they speak.
    pub framing: ServoFraming,
    /// Model number.
    pub model: u16,
    /// Firmware version, as a ping answers it.
    pub firmware: u8,
    /// Registers by name; `model`, `id`, `torque`, `goal`, `speed`, `position` and
    /// `moving` mean something.
    pub registers: BTreeMap<String, Register>,
    /// What registers hold at power-up, where that is not 0.
    #[serde(default)]
    pub initial: BTreeMap<String, i64>,
    /// Units per second of one count of the speed register.
    pub speed_unit: f64,
    /// Whether switching the torque on makes the present position the goal.
    #[serde(default)]
    pub holds_on_torque: bool,
}

/// Frames of servo buses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServoFraming {
    /// Dynamixel protocol 2.0.
    Dynamixel2,
    /// Feetech STS, the frames of Dynamixel protocol 1.0.
    Feetech,
}

/// A register: little-endian bytes at an address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Register {
    /// Address of the first byte.
    pub address: usize,
    /// Number of bytes.
    pub bytes: usize,
}

/// A device described by rules.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RulesEmulation {
    /// What ends a reply.
    pub eol: String,
    /// What `{identity}` stands for in a reply.
    pub identity: String,
    /// Decimals of positions and feeds.
    pub decimals: usize,
    /// The fastest feed that can be set, per second.
    pub max_feed: f64,
    /// What `{state}` stands for in each state.
    pub states: BTreeMap<RuleState, String>,
    /// What `{error}` stands for when there is none.
    pub no_error: String,
    /// The error that an unknown line leaves.
    pub unknown: String,
    /// The error that a number out of range leaves.
    pub out_of_range: String,
    /// `[[emulator.dialect.rules.rule]]`, tried in this order.
    pub rule: Vec<Rule>,
}

/// One rule.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Pattern of the line, without its end.
    #[serde(rename = "match")]
    pub matches: Pattern,
    /// What is done, in order.
    #[serde(rename = "do", default)]
    pub does: Vec<RuleVerb>,
    /// States in which it is refused, and the error that leaves.
    #[serde(default)]
    pub refuse: BTreeMap<RuleState, String>,
    /// What is answered; nothing if absent.
    pub reply: Option<String>,
}

/// States of an axis of a device made of rules.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RuleState {
    /// Not homed.
    Unreferenced,
    /// Homing.
    Homing,
    /// Moving.
    Moving,
    /// At rest and homed.
    Idle,
}

impl RuleState {
    /// All of them, with the words that files use.
    pub const ALL: [(RuleState, &str); 4] = [
        (RuleState::Unreferenced, "unreferenced"),
        (RuleState::Homing, "homing"),
        (RuleState::Moving, "moving"),
        (RuleState::Idle, "idle"),
    ];

    /// The word for it in protocol files.
    pub fn word(self) -> &'static str {
        Self::ALL.into_iter().find(|(state, _)| *state == self).map_or("", |(_, word)| word)
    }
}

/// What a rule may do; a text names a group of its pattern.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RuleVerb {
    /// Moves to the position in that group.
    MoveTo(String),
    /// Moves by the distance in that group.
    MoveBy(String),
    /// Homes.
    Home,
    /// Decelerates to rest.
    Stop,
    /// Forgets the reference.
    Reset,
    /// Sets the feed of moves.
    SetFeed(String),
}
