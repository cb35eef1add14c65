//! The upper half of a protocol file: states, positions, motion, completion, steps, fault tables.

use serde::Deserialize;
use std::collections::BTreeMap;

/// What the device is doing, in our words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionState {
    /// At rest, ready for a move.
    Idle,
    /// Moving.
    Moving,
    /// Searching its reference.
    Homing,
    /// Stopped by a hold, the rest of the move pending.
    Hold,
    /// Locked by an alarm.
    Alarm,
    /// Motors off or device disabled.
    Off,
}

impl MotionState {
    /// The word for it in protocol files.
    pub fn word(self) -> &'static str {
        match self {
            MotionState::Idle => "idle",
            MotionState::Moving => "moving",
            MotionState::Homing => "homing",
            MotionState::Hold => "hold",
            MotionState::Alarm => "alarm",
            MotionState::Off => "off",
        }
    }
}

/// `[state]`: from the device's words to ours.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateSpec {
    /// Field that carries the state, in any class.
    pub field: String,
    /// Field with a sub-state; `Hold:0` in the lists below means state `Hold`, sub-state `0`.
    pub sub_field: Option<String>,
    /// Words for each state. A number's bits are tested with `&0x30` (any of them set) or
    /// `!0x30` (none set), states being tried in the order alarm, homing, hold, moving, off, idle.
    #[serde(default)]
    pub idle: Vec<String>,
    /// Words for moving.
    #[serde(default)]
    pub moving: Vec<String>,
    /// Words for homing.
    #[serde(default)]
    pub homing: Vec<String>,
    /// Words for hold.
    #[serde(default)]
    pub hold: Vec<String>,
    /// Words for alarm.
    #[serde(default)]
    pub alarm: Vec<String>,
    /// Words for off.
    #[serde(default)]
    pub off: Vec<String>,
    /// Words that say, beside the state, that positions are not valid. A device that begins to say so has lost
    /// them; and a search for references that ends with it has found none.
    #[serde(default)]
    pub unreferenced: Vec<String>,
}

/// `[position]`: where positions are reported.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionSpec {
    /// Class that carries positions.
    pub class: String,
    /// Command that asks for it; absent when a status carries it.
    pub command: Option<String>,
    /// Real-time bytes that ask for it.
    pub realtime: Option<String>,
    /// What the number means.
    pub meaning: Meaning,
    /// How values are found in the fields.
    pub from: PositionFrom,
    /// Whether values are device counts instead of mm and degrees.
    #[serde(default)]
    pub counts: bool,
}

/// What a reported position is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meaning {
    /// The end of the queued motion, true only after a barrier.
    Target,
    /// Where the motors are commanded to be now.
    Steps,
    /// Measured by an encoder.
    Actual,
}

/// How positions are found in the fields of a reply.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PositionFrom {
    /// Lists in the order of `axis.order`; work = machine - offset, the last offset is kept.
    Lists {
        /// Field with machine positions.
        machine: String,
        /// Field with work positions.
        work: Option<String>,
        /// Field with the offset between them.
        offset: Option<String>,
    },
    /// A field for each axis, named by a template from the groups of `axis.wire`.
    Named {
        /// Name of the field with the position, e.g. `{letter}`.
        value: String,
        /// Name of the field with the motor's counts, a second witness.
        counts: Option<String>,
    },
    /// One axis per reply; this field.
    Single(String),
}

/// `[motion]`: which commands make a move.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSpec {
    /// Commands sent for a move, in order.
    #[serde(rename = "move")]
    pub go: Vec<String>,
    /// Commands sent for a move that will be cancelled; absent when there is none.
    #[serde(default)]
    pub jog: Vec<String>,
    /// Steps that cancel it.
    pub jog_cancel: Option<Procedure>,
    /// A move must name every axis: those not asked for keep their present position.
    #[serde(default)]
    pub whole_pose: bool,
}

/// `[done]`: how the end of a move is known.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoneSpec {
    /// The main witness.
    pub method: DoneMethod,
    /// Command that asks (poll_state, queue_index) or blocks (barrier).
    pub command: Option<String>,
    /// Real-time bytes that ask.
    pub realtime: Option<String>,
    /// Class that tells the end, for `event`.
    pub event: Option<String>,
    /// Field to compare with the index of the last command, for `queue_index`.
    pub field: Option<String>,
    /// Time between questions.
    #[serde(default = "default_period_ms")]
    pub period_ms: u64,
    /// Answers "idle" needed in a row.
    #[serde(default = "default_confirm_n")]
    pub confirm_n: u32,
}

fn default_period_ms() -> u64 {
    100
}

fn default_confirm_n() -> u32 {
    1
}

/// How the end of a move is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DoneMethod {
    /// Ask until the state is idle.
    PollState,
    /// A command whose reply comes after motion.
    Barrier,
    /// The device says so; asking is the fallback.
    Event,
    /// Ask until the device's queue has passed the move.
    QueueIndex,
}

/// The field of a step's command for one axis that is filled with the counts at which that axis was last reported: so a
/// servo is told to stay where it is.
pub const HERE_COUNTS: &str = "here_counts";

/// A list of steps from the closed set of verbs.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Procedure {
    /// The steps.
    #[serde(default)]
    pub steps: Vec<Step>,
    /// What it does to the trust in positions.
    #[serde(default)]
    pub trust: Trust,
    /// What state a stop leaves the device in, and what a person must do before it answers again; absent where the
    /// next session finds it as any other.
    pub afterwards: Option<String>,
}

/// One step: an optional sending, then an optional wait. A table with no sending only waits.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Send this command; its reply is part of the step unless `expect` says otherwise.
    pub send: Option<String>,
    /// Send this command when the device refuses the first one.
    pub or_send: Option<String>,
    /// Send these real-time bytes.
    pub realtime: Option<String>,
    /// Wait for a reply of this class.
    pub expect: Option<String>,
    /// Ask for the state until it is one of these.
    #[serde(default)]
    pub until_state: Vec<String>,
    /// Wait this long.
    pub sleep_ms: Option<u64>,
    /// Time for the wait.
    pub timeout_ms: Option<u64>,
    /// How often the step is begun again when its time is up.
    #[serde(default)]
    pub retry: u32,
    /// Going on when the time is up, or when the device refuses, is right, too.
    #[serde(default)]
    pub optional: bool,
    /// The device answers nothing while this runs: do not ask it anything.
    #[serde(default)]
    pub silent: bool,
}

/// What something does to the trust in positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trust {
    /// Positions stay valid.
    #[default]
    Keep,
    /// Positions must be found anew by homing.
    Lost,
}

/// `[keepalive]`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Keepalive {
    /// What to send.
    pub command: String,
    /// How often.
    pub every_ms: u64,
}

/// An entry of `[errors]` or `[alarms]`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// What it means.
    pub text: String,
    /// What kind of thing it is.
    #[serde(default)]
    pub class: FaultClass,
    /// What it does to the trust in positions.
    #[serde(default)]
    pub trust: Trust,
    /// The device answers nothing until it is reset.
    #[serde(default)]
    pub mutes: bool,
    /// Steps of `[recover]` that make the device usable again.
    pub recover: Option<String>,
    /// What a person should do about it, where that is more than its class tells.
    pub next: Option<String>,
}

impl Fault {
    /// What a person should do about it.
    pub fn next_move(&self) -> String {
        self.next.clone().unwrap_or_else(|| self.class.advice().to_owned())
    }
}

/// What kind of thing an error is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultClass {
    /// We sent something wrong.
    #[default]
    Usage,
    /// Right, but not now.
    State,
    /// Beyond a limit.
    Limit,
    /// The position was lost.
    Lost,
    /// Something is broken.
    Hardware,
}

impl FaultClass {
    /// What a person should do about it.
    pub fn advice(self) -> &'static str {
        match self {
            FaultClass::Usage => "check `protocol` and the wires of the axes in the rig file",
            FaultClass::State => "set the device to allow it, or wait until it is ready, then try again",
            FaultClass::Limit => "compare the limits in the rig file with those set on the device",
            FaultClass::Lost => "home before moving",
            FaultClass::Hardware => "look at the machine, then home",
        }
    }
}

/// An entry of `[flags]`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlagSpec {
    /// What it means.
    pub text: String,
    /// What to do.
    pub action: FlagAction,
    /// What it does to the trust in positions.
    #[serde(default)]
    pub trust: Trust,
    /// Command that clears it.
    pub clear: Option<String>,
}

/// What a flag in a reply does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlagAction {
    /// Nothing.
    Ignore,
    /// A line in the log.
    Warn,
    /// The move has failed.
    FailMove,
}

/// Procedures by name, as `[stop]` and `[recover]` hold them.
pub type Procedures = BTreeMap<String, Procedure>;
