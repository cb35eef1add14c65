//! The virtual bench: devices that are not there.

pub mod picture;
