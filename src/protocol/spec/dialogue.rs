//! The middle of a protocol file: commands and classes of replies.

use super::conduct::MotionState;
use super::link::FieldSpec;
use crate::protocol::template::Template;
use crate::protocol::value::Pattern;
use serde::Deserialize;
use std::collections::BTreeMap;

/// `[cmd.<name>]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandSpec {
    /// Text of the line, for line protocols.
    pub tx: Option<Template>,
    /// Header fields, for binary protocols.
    #[serde(default)]
    pub header: BTreeMap<String, i64>,
    /// Payload fields, for binary protocols.
    #[serde(default)]
    pub payload: Vec<FieldSpec>,
    /// What one sending of it concerns.
    #[serde(default)]
    pub scope: Scope,
    /// What ends the wait for it: `ack` for any class of that role, `none`, or the name of a class.
    #[serde(default = "default_reply")]
    pub reply: String,
    /// Roles or classes whose fields are kept for the caller.
    #[serde(default)]
    pub collect: Vec<String>,
    /// Class without which an `ack` cannot be this command's: it belongs to an earlier one, or is doubled.
    pub needs: Option<String>,
    /// States it may be sent in; any when empty.
    #[serde(default)]
    pub pre: Vec<MotionState>,
    /// Time for the reply, extended by every `busy`.
    #[serde(default = "default_timeout_ms")]
    pub timeout_ms: u64,
    /// Its reply comes only when motion has ended: bounded by progress, not by `timeout_ms`.
    #[serde(default)]
    pub waits_for_motion: bool,
    /// The device answers nothing at all while it runs.
    #[serde(default)]
    pub silent: bool,
    /// What may be done when its reply is lost.
    #[serde(default)]
    pub retry: Retry,
    /// Whether it goes out numbered, where lines are numbered.
    #[serde(default = "yes")]
    pub numbered: bool,
    /// It may make the device move: losing its reply makes the position unknown.
    #[serde(default)]
    pub moves: bool,
}

fn default_reply() -> String {
    "ack".to_owned()
}

fn default_timeout_ms() -> u64 {
    2000
}

fn yes() -> bool {
    true
}

/// What one sending of a command concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// The device as a whole; sent once. A move of this scope carries all its axes as `{axes}`.
    #[default]
    Device,
    /// One axis; sent once for each.
    Axis,
}

/// What may be done when a reply is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Retry {
    /// Nothing: the outcome is unknown.
    #[default]
    Never,
    /// It may simply be sent again.
    Idempotent,
    /// It may be sent again under its old line number; the device drops what it already has.
    Resync,
}

/// `[[rx]]`: one class of replies.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RxSpec {
    /// Its name.
    pub class: String,
    /// What it means for the dialogue.
    pub role: Role,
    /// What a line must match; named groups become fields.
    #[serde(rename = "match")]
    pub pattern: Option<Pattern>,
    /// What the header of a frame must hold.
    #[serde(default)]
    pub when: BTreeMap<String, i64>,
    /// Payload fields of a frame.
    #[serde(default)]
    pub payload: Vec<FieldSpec>,
    /// Only while this command waits for its reply (where frames do not say what they answer).
    pub after: Option<String>,
    /// Takes one field apart into fields of its own.
    pub split: Option<Split>,
    /// This field, where present, is classified as a line of its own, before this one takes effect.
    pub inner: Option<String>,
    /// With role `ack`: it is a refusal when these fields have these values.
    #[serde(default)]
    pub nack_when: BTreeMap<String, String>,
    /// Field that holds the code for the table of errors or alarms.
    pub code: Option<String>,
    /// Field that holds a flag for the table of flags.
    pub flag: Option<String>,
    /// A refusal after which the device still sends an `ack` for the same line.
    #[serde(default)]
    pub ack_follows: bool,
    /// The class describes entries of a table of the device's own: fields `code`, `title`, `text`.
    pub learns: Option<FaultTable>,
    /// Command to send at once (it bypasses the queue), such as the empty line that clears a latched error.
    pub then: Option<String>,
}

/// A table of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultTable {
    /// `[errors]`.
    Errors,
    /// `[alarms]`.
    Alarms,
}

/// What a class means for the dialogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The command was accepted.
    Ack,
    /// The command was refused.
    Nack,
    /// Something stopped the device.
    Alarm,
    /// State, and perhaps position.
    Status,
    /// Position.
    Position,
    /// Still working; extends timeouts.
    Busy,
    /// The firmware introduces itself: it has just started.
    Banner,
    /// Words about the device.
    Info,
    /// Something happened that a step may wait for.
    Event,
    /// The device asks for a line again.
    Resend,
    /// A value that was asked for.
    Data,
}

/// Takes a field like `MPos:1,2,3|FS:0,0` apart.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// The field.
    pub field: String,
    /// Between the parts.
    pub on: char,
    /// Between name and value.
    pub pair: char,
    /// Between the numbers of a list.
    pub list: char,
}
