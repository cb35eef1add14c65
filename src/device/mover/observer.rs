//! Watching a mover from elsewhere: what is known of it, without asking it anything.
//!
//! Whoever moves a device owns its [`Mover`](super::Mover); a status line, a control socket or a jog display look
//! through an [`Observer`], from any thread and while a move is under way.

use super::Reference;
use super::tool::Tool;
use crate::device::link::Telemetry;
use crate::motion::AxisKind;
use crate::protocol::spec::MotionState;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::watch;

/// When the axes were last homed, shared between a mover and those who watch it.
#[derive(Debug, Clone, Default)]
pub(super) struct Homed(Arc<Mutex<State>>);

#[derive(Debug, Clone, Copy, Default)]
struct State {
    /// Count of lost trusts when the axes were last homed.
    at_loss: Option<u64>,
    homing: bool,
}

impl Homed {
    /// The search for the switches begins: nothing is known until it ends.
    pub(super) fn begin(&self) {
        self.set(State { at_loss: None, homing: true });
    }

    /// The search has ended: well, at this count of lost trusts, or not.
    pub(super) fn end(&self, at_loss: Option<u64>) {
        self.set(State { at_loss, homing: false });
    }

    /// Positions that were valid are so no more.
    pub(super) fn distrust(&self) {
        let now = self.get();
        self.set(State { at_loss: now.at_loss.map(|_| u64::MAX), ..now });
    }

    /// What is known of the positions.
    pub(super) fn reference(&self, telemetry: &Telemetry) -> Reference {
        let State { at_loss, homing } = self.get();
        match at_loss {
            _ if homing => Reference::Homing,
            None => Reference::Unknown,
            Some(count) if count == telemetry.trust_losses && telemetry.ended.is_none() => {
                Reference::Referenced
            }
            Some(_) => Reference::Suspect,
        }
    }

    fn get(&self) -> State {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, state: State) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }
}

/// Looks at a mover that somebody else owns. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Observer {
    pub(super) telemetry: watch::Receiver<Telemetry>,
    pub(super) homed: Homed,
    pub(super) port: String,
    pub(super) protocol: String,
    pub(super) identity: Option<String>,
    /// Name, kind, lowest and highest position of each axis, in the order of the telemetry.
    pub(super) axes: Vec<(String, AxisKind, [f64; 2])>,
    /// The tool in front of them, where they are joints.
    pub(super) tool: Option<Tool>,
}

/// A mover as it was last heard of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// Port of the rig file.
    pub port: String,
    /// Protocol of the rig file.
    pub protocol: String,
    /// What the firmware said when it was asked.
    pub identity: Option<String>,
    /// What is known of the positions.
    pub reference: Reference,
    /// What the device is doing, once it has said so.
    pub state: Option<MotionState>,
    /// The axes.
    pub axes: Vec<SeenAxis>,
    /// Why trust in the positions was lost last.
    pub last_loss: Option<String>,
    /// Why the link ended, once it has.
    pub link_lost: Option<String>,
}

/// An axis as it was last heard of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeenAxis {
    /// Name in the rig file.
    pub axis: String,
    /// Linear or rotary.
    pub kind: AxisKind,
    /// Last reported position.
    pub position: Option<f64>,
    /// Lowest allowed position.
    pub min: f64,
    /// Highest allowed position.
    pub max: f64,
}

impl Observer {
    /// Waits until the positions are no longer trusted, or the device is gone; tells why.
    pub async fn lost(&mut self) -> String {
        loop {
            let telemetry = self.telemetry.borrow_and_update().clone();
            if self.homed.reference(&telemetry) != Reference::Referenced {
                let gone = telemetry.ended.map(|why| format!("the link was lost: {why}"));
                return gone.or(telemetry.last_loss).unwrap_or_else(|| "it was homed anew".to_owned());
            }
            if self.telemetry.changed().await.is_err() {
                return "the link was lost".to_owned();
            }
        }
    }

    /// What is known now.
    pub fn look(&self) -> Seen {
        let telemetry = self.telemetry.borrow().clone();
        let reference = self.homed.reference(&telemetry);
        let known = telemetry.positions.iter().map(|reading| reading.map(|r| r.value));
        let joints: Option<Vec<f64>> = known.collect::<Option<_>>().filter(|all: &Vec<_>| !all.is_empty());
        let of_the_tool = self.tool.iter().flat_map(|tool| tool.seen(joints.as_deref()));
        let readings = telemetry.positions.iter().copied().chain(std::iter::repeat(None));
        let axes = self.axes.iter().zip(readings).map(|((axis, kind, [min, max]), reading)| SeenAxis {
            axis: axis.clone(),
            kind: *kind,
            position: reading.map(|r| r.value),
            min: *min,
            max: *max,
        });
        Seen {
            port: self.port.clone(),
            protocol: self.protocol.clone(),
            identity: self.identity.clone(),
            reference,
            state: telemetry.state,
            axes: of_the_tool.chain(axes).collect(),
            last_loss: telemetry.last_loss,
            link_lost: telemetry.ended,
        }
    }
}
