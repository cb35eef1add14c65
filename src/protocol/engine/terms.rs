//! What goes in and out of the engine: requests, outcomes, events.

use crate::clock::Timestamp;
use crate::protocol::classify::Reply;
use crate::protocol::encode::EncodeError;
use crate::protocol::spec::{MotionState, Trust};
use crate::protocol::value::Fields;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// One axis of a device, as the rig file names it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisWire {
    /// Name in the rig file.
    pub name: String,
    /// Name on the wire.
    pub wire: String,
    /// Device counts per mm or degree, where the protocol speaks in counts.
    pub counts_per_unit: Option<f64>,
    /// Acceleration, per second squared, where the protocol sends it.
    #[serde(default)]
    pub accel: Option<f64>,
}

/// Handle of a request; its end is reported by [`Event::Finished`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub u64);

/// What can be asked of a device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// One command of the protocol file. A command of scope `axis` goes to every axis, unless
    /// `axis` (an index) names one.
    Command {
        /// Its name.
        name: String,
        /// Its fields.
        fields: Fields,
        /// The axis it concerns.
        axis: Option<usize>,
    },
    /// Sends `[link] wake` and waits for the banner; done at once where there is no `wake`.
    Wake,
    /// Synchronises line numbers, asks for the identity.
    Identify,
    /// Sends a move: targets by axis index, feed in units per second. Ends when it is *accepted*.
    Move {
        /// Targets; with `[motion] whole_pose` all axes.
        targets: Vec<(usize, f64)>,
        /// Along the line, in axis units per second.
        feed: f64,
        /// Use the commands of `[motion] jog`.
        jog: bool,
    },
    /// Waits until motion has ended, as `[done]` says. A device that makes no progress for `stall`
    /// has stalled.
    Settle {
        /// Longest time without progress.
        stall: Duration,
        /// How long the motion should take from now on, where it is known: questions are asked more often about then.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        expected: Option<Duration>,
    },
    /// Asks for the positions of all axes and the state.
    Position,
    /// Runs the steps of a procedure.
    Run(Which),
}

/// A procedure of the protocol file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Which {
    /// `[init]`.
    Init,
    /// `[home]`.
    Home,
    /// `[motion] jog_cancel`.
    JogCancel,
    /// `[recover.<name>]`.
    Recover(String),
}

/// How to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum StopKind {
    /// Decelerate; positions stay trusted where the firmware allows it.
    Controlled,
    /// End a search for references: some firmwares do not listen to a controlled stop then.
    Homing,
    /// At once, whatever it costs.
    Emergency,
}

/// How a request ended: what was collected, or why not.
pub type Outcome = Result<Vec<Reply>, Failure>;

/// Why a request did not end well.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Failure {
    /// The device refused.
    #[error("it refused {command}: {code} ({text}); {next}")]
    Refused {
        /// The command.
        command: String,
        /// The device's code.
        code: String,
        /// What the code means.
        text: String,
        /// What to do about it.
        next: String,
    },
    /// No reply came. What became of the command is unknown.
    #[error(
        "no reply to {what} within {waited:?}; check the cable, the baud rate, that the device is powered and that it speaks the protocol that the rig file names"
    )]
    NoReply {
        /// What was waited for.
        what: String,
        /// How long.
        waited: Duration,
    },
    /// The device restarted by itself.
    #[error("the device restarted by itself; its position is lost: home before moving")]
    Restarted,
    /// An alarm.
    #[error("alarm {code}: {text}; {next}")]
    Alarm {
        /// The device's code.
        code: String,
        /// What it means.
        text: String,
        /// What it does to the trust in positions.
        trust: Trust,
        /// Procedure that makes the device usable again.
        recover: Option<String>,
        /// What a person should do about it.
        next: String,
    },
    /// A flag in a reply says that the move failed.
    #[error("the device reports {code}: {text}")]
    Flag {
        /// The flag.
        code: String,
        /// What it means.
        text: String,
    },
    /// Motion makes no progress.
    #[error("no progress for {stall:?}; look for an obstacle or a disabled motor, then home")]
    Stalled {
        /// The time that passed without progress.
        stall: Duration,
    },
    /// The port is gone.
    #[error("the link is lost ({0}); check the cable, then connect and home again")]
    LinkLost(String),
    /// A stop ended it.
    #[error("stopped")]
    Stopped,
    /// The device asks for lines again and again, or for one that is no longer known.
    #[error("the device keeps asking for line {line} again; lower the baud rate or shorten the cable")]
    ResendLoop {
        /// The line it asks for.
        line: i64,
    },
    /// The command is not for the present state.
    #[error("{command} is not possible while the device is {state:?}")]
    WrongState {
        /// The command.
        command: String,
        /// The state.
        state: MotionState,
    },
    /// The command could not be written. Nothing was sent.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

/// What happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A request ended.
    Finished(Ticket, Outcome),
    /// The device introduced itself; `expected` is false when it restarted by itself.
    Banner {
        /// Its words.
        text: String,
        /// Whether we caused it.
        expected: bool,
    },
    /// Positions are no longer valid.
    TrustLost(String),
    /// An alarm.
    Alarm {
        /// The device's code.
        code: String,
        /// What it means.
        text: String,
    },
    /// A flag appeared in the replies.
    Flag {
        /// The flag.
        code: String,
        /// What it means.
        text: String,
    },
    /// Something to know that needs no action: a line sent again, a stray reply, unknown bytes.
    Note(String),
}

/// What [`Engine::poll`] hands out.
#[derive(Debug, Default, PartialEq)]
pub struct Output {
    /// Bytes to send before anything else.
    pub urgent: Vec<u8>,
    /// Bytes to send.
    pub bytes: Vec<u8>,
    /// What happened, in order.
    pub events: Vec<Event>,
    /// When to call again, unless something arrives before.
    pub wake: Option<Timestamp>,
}
