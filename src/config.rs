//! Configuration: files to checked values, with everything that is wrong reported at once.
//!
//! Every file goes the same way. Its text becomes a [`tree`] whose values know their lines; each
//! `--set KEY=VALUE` is put into that tree; [`gather`] reads it as the domain's own serde type and
//! reports unknown keys, missing keys and wrong types together; the domain's `check` judges what is
//! inside; and [`document`] maps key paths back to lines. Only checked types leave this module.
//!
//! Files name each other: a plan names its sensor and indenters, a rig its protocols. [`lookup`]
//! says where they are found. When all of them are sound, the plan is expanded and checked against
//! the rig; so whoever holds a [`Setup`] with a plan holds one that may be performed.
//!
//! Keys of `--set`: those of the rig file; `plan.KEY` for the plan's, and `sensor.pad.KEY` or
//! `sensor.optics.KEY` for the sensor's. A typo is refused with a suggestion.
//!
//! Rig files are written by [`edit`] alone, which changes keys and keeps comments.
//!
//! What this module never does: open a device, or print.

mod agree;
mod builtin;
mod check_report;
pub mod document;
pub mod edit;
mod gather;
mod indenter_file;
mod load;
pub mod lookup;
mod protocol_file;
mod reader;
pub mod report;
pub mod rig;
pub mod sensor;
mod sensor_file;
mod suggest;
pub mod tree;
mod unused;

pub use check_report::CheckReport;
pub use indenter_file::shipped_indenters;
pub use load::{IndenterConfig, PlanSetup, Setup, check, load};
pub use lookup::{Kind, SourceFile};
pub use protocol_file::{ProtocolFile, protocol, protocol_file, shipped_protocols};
pub use report::{ConfigError, Finding};
pub use rig::{
    Mounted, OpticsMode, OpticsTable, RigConfig, SessionTable, TwinPoses, TwinTable, VirtualTable,
};
pub use sensor::SensorConfig;
pub use sensor_file::sensor_file;
