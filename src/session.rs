//! A session: performing a trajectory on the devices of a bench.
//!
//! The session homes, mounts one indenter after another (by asking whoever is at the bench), finds
//! the contact, visits every waypoint and takes a frame at every mark. What it finds it hands on
//! as [`Event`]s; it names no firmware, opens no file and knows no simulator.
//!
//! *Order of a move.* A bench never drags: a move that goes down or stays travels sideways first,
//! above the pad, and then down; a move that goes up lifts first. Sideways motion at depth is a slide
//! of the plan, and of nothing else ([`bench`]).
//!
//! *Order of a capture.* Motion complete (the mover's affair: barrier or idle, tolerance, settle), then
//! a frame exposed after that, then another: when the two agree the picture is still, and the second
//! is the capture ([`perform`]).
//!
//! *By hand* ([`jog`]): steps, and motion that lasts only while somebody holds a key.
//!
//! *Endings.* Whatever happens, all movers are stopped first; then the arm is retracted if its position
//! can be trusted; then the error is returned ([`perform`]). Stopping bypasses every queue ([`stop`]).

pub mod bench;
pub mod event;
pub mod jog;
pub mod perform;
pub mod stop;
pub mod touch_off;

pub use bench::{Bench, BenchError};
pub use event::{AxisReading, Event, RealCapture};
pub use perform::{Session, SessionError, SessionSettings};
pub use stop::{StopLevel, StopSwitch};
pub use touch_off::{Contact, TouchOffSettings};
