//! What can go wrong with a mover, each with the next move.

use crate::motion::{LimitError, ReachError};
use crate::protocol::{EncodeError, Failure};

/// Why a mover did not do what it was asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MoverError {
    /// Beyond a limit. Nothing was sent.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The arm cannot take a pose. Nothing was sent.
    #[error(transparent)]
    Reach(#[from] ReachError),
    /// There is no such axis.
    #[error(
        "there is no axis {axis}; this device has {known}: correct the name, or add the axis to the rig file"
    )]
    UnknownAxis {
        /// The name asked for.
        axis: String,
        /// The names there are.
        known: String,
    },
    /// The rig file and the protocol file do not agree.
    #[error("rig file: {0}")]
    Settings(#[from] EncodeError),
    /// The pattern of the rig file's `identity` cannot be read.
    #[error("identity \"{pattern}\": {reason}; correct it in the rig file")]
    IdentityPattern {
        /// The pattern.
        pattern: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Another device answers.
    #[error(
        "another device is on this port: it says \"{says}\", expected {expected}; check the port in the rig file. Nothing was moved"
    )]
    WrongIdentity {
        /// What it said.
        says: String,
        /// The pattern it had to match.
        expected: String,
    },
    /// Positions are not known.
    #[error("the position is not known ({reason}); home first")]
    NotReferenced {
        /// Why.
        reason: String,
    },
    /// Positions were lost while something was going on.
    #[error("the position was lost: {reason}{}", unless_said(reason))]
    PositionLost {
        /// What happened.
        reason: String,
    },
    /// The device ended elsewhere than it was sent.
    #[error(
        "axis {axis}: sent to {target} {unit}, arrived at {measured} {unit} (tolerance {tolerance}); look for a limit inside the firmware, lost steps, or a tolerance below its resolution"
    )]
    NotReached {
        /// The axis.
        axis: String,
        /// Where it was sent.
        target: f64,
        /// Where it is.
        measured: f64,
        /// What was allowed.
        tolerance: f64,
        /// `mm` or `deg`.
        unit: &'static str,
    },
    /// The device does not tell where an axis is.
    #[error("the device reports no position for axis {axis}; check `wire` in the rig file")]
    NoPosition {
        /// The axis.
        axis: String,
    },
    /// The protocol cannot do that.
    #[error("{protocol} has no {what}")]
    NotSupported {
        /// The protocol.
        protocol: String,
        /// What is missing in its file.
        what: &'static str,
    },
    /// The device speaks, but something else.
    #[error(
        "the device answers, but not as {protocol} does: it said \"{said}\"; check that this is the right port (`twinrig devices` lists them), the baud rate, and `protocol` in the rig file"
    )]
    SpeaksOtherwise {
        /// What was expected.
        protocol: String,
        /// What it said last, shortened.
        said: String,
    },
    /// Silence from a device that a hard stop silences.
    #[error(
        "{silence}. If it was stopped at once before (`twinrig stop --now`, a second Ctrl-C): {afterwards}"
    )]
    Halted {
        /// What was waited for, and what else silence may mean.
        silence: Box<Failure>,
        /// What the stop has left behind, and what to do about it.
        afterwards: String,
    },
    /// The reply to a move was lost, and the device is not where the move leads.
    #[error(
        "the reply to a move was lost, and the device came to rest elsewhere; its position is known again, nothing was sent twice. Repeat the move, or check the cable"
    )]
    MoveUnconfirmed,
    /// The dialogue with the device failed.
    #[error(transparent)]
    Device(#[from] Failure),
}

/// Where the reason does not end with it already: what to do.
fn unless_said(reason: &str) -> &'static str {
    let last = reason.rsplit([';', ':', ',']).next().unwrap_or_default();
    if last.contains("home") { "" } else { "; home before the next move" }
}

impl MoverError {
    /// Whether a stop was the cause.
    pub fn is_stop(&self) -> bool {
        matches!(self, MoverError::Device(Failure::Stopped))
    }
}
