//! The virtual bench: devices that are not there, imitated down to their bytes and delays.
//!
//! A *firmware emulator* ([`firmware`]) answers the bytes of one protocol as recorded firmware does
//! and moves axes of the shared [`world`], which the virtual camera sees. [`serve`] puts an emulator
//! behind a stream: an in-memory pipe in tests, a real pseudo-terminal for the virtual bench and for
//! other people's clients. [`faults`] stands between the two and spoils the dialogue on demand.
//! The virtual [`camera`] exposes [`picture`]s of the world, and can fail on demand, too.
//!
//! Emulators imitate input and output, not physics: steps are exact, belts do not stretch, and
//! blocks of a planner's queue are joined at rest. What the camera sees when the indenter presses is
//! the camera's affair.

pub mod camera;
pub mod faults;
pub mod firmware;
pub mod picture;
pub mod serve;
pub mod world;

pub use camera::{CameraFault, CameraFaults, VirtualCamera};
pub use faults::{Fault, FaultKind, FaultPlan, Faulty, Trigger};
pub use firmware::{Emulator, EmulatorError, EmulatorOptions};
pub use world::{World, WorldScene};
