//! Examples a protocol file carries, by which it is tested.

use crate::protocol::value::{Bytes, Fields};
use serde::Deserialize;

/// `[[vector]]`: a command and its bytes, or bytes and what they are.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vector {
    /// The command sent ...
    pub cmd: Option<String>,
    /// ... with these fields ...
    #[serde(default)]
    pub args: Fields,
    /// ... under this line number ...
    pub number: Option<i64>,
    /// ... is these bytes.
    pub tx: Option<Bytes>,
    /// These bytes (a line without its end, or a frame) ...
    pub rx: Option<Bytes>,
    /// ... are of this class ...
    pub class: Option<String>,
    /// ... carry these fields ...
    #[serde(default)]
    pub fields: Fields,
    /// ... and mean this state.
    pub state: Option<super::MotionState>,
    /// Only while this command waits for its reply.
    pub after: Option<String>,
}

/// `[[dialogue]]`: an exchange from beginning to end.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dialogue {
    /// What it shows.
    pub name: String,
    /// Its turns, in order.
    pub turns: Vec<Turn>,
}

/// One turn of a dialogue.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// The client submits this command.
    pub cmd: Option<String>,
    /// Its fields.
    #[serde(default)]
    pub args: Fields,
    /// These bytes must go out.
    pub tx: Option<Bytes>,
    /// These bytes come in.
    pub rx: Option<Bytes>,
    /// The last command ends like this: `done`, `refused`, `failed`, or `pending`.
    pub ends: Option<String>,
}
