//! Serial protocols as data: what a device says and understands is a TOML file, not code.
//!
//! A *protocol file* (`firmware_protocols/*.toml`) describes one firmware in both directions. Its
//! typed form is [`Spec`]; [`encode`] turns commands into bytes, [`deframe`] and [`classify`] bytes into
//! replies;
//! [`engine`] is the client's state machine, which knows what is in flight, what counts as done and
//! what an alarm does to the trust in positions. Nothing here opens a port or reads a clock: bytes
//! and instants go in, bytes and events come out, so every dialogue can be replayed.
//!
//! Terms: a *command* is what we send, a *reply* any unit the device sends (a line or a frame), its
//! *class* the entry of the file that recognised it, its *role* what that means for the dialogue.
//!
//! Sources: recorded dialogues of GRBL 1.1h, grblHAL, Marlin 1.1.6 and of vendors' clients; the
//! firmwares' and vendors' documents named in each file.

pub mod checksum;
pub mod classify;
pub mod conformance;
pub mod deframe;
pub mod emulation;
pub mod encode;
pub mod engine;
pub mod spec;
pub mod template;
pub mod value;

pub use checksum::ChecksumKind;
pub use classify::{Reply, classify, state_of};
pub use deframe::{Deframer, Unit};
pub use emulation::EmulatorSpec;
pub use encode::{EncodeError, encode};
pub use engine::{
    AxisWire, Engine, Event, Failure, Outcome, Output, Reading, Request, StopKind, Ticket, Which,
};
pub use spec::{Spec, SpecError};
pub use template::Template;
pub use value::{Bytes, Fields, Pattern, Value};
