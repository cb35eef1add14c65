//! The composition root: checked configuration in, devices and a twin out.
//!
//! This is the only place where a rig file's words become ports, emulators, cameras and solvers. Everything
//! below takes small parameters; everything above takes what is assembled here.

pub mod bench;
pub mod records;
pub mod twin;

pub use bench::{
    Assembled, BenchError, BenchOptions, bench, camera_alone, can_run_at, movers_alone, stop_ports,
};
pub use records::{ProvenanceError, provenance, run_notes, session_note, session_settings};
pub use twin::{TwinError, optics_store, twin};
