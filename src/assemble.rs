//! The composition root: checked configuration in, devices and a twin out.
//!
//! This is the only place where a rig file's words become ports, emulators, cameras and solvers. Everything
//! below takes small parameters; everything above takes what is assembled here.

pub mod twin;

pub use twin::{TwinError, twin};
