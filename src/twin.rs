//! The twin: our physical model of the rig, following the same trajectory.

pub mod branches;
