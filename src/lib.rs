//! twinrig drives a tactile-sensor bench, runs the identical trajectory in a simulator, and stores
//! paired real and simulated datasets.
//!
//! # The theory of the bench
//!
//! A *rig* is a bench with its devices: movers (anything serial with axes) and the camera inside the
//! sensor. A *plan* says what to do, as data. Expanded, it is one *trajectory*: timed poses of the
//! indenter relative to the sensor, with capture marks. Both sides follow that one value: the *session*
//! performs it on devices, the *twin* (our physical model of the rig) follows it in an elastomer
//! simulation and a renderer. Real and simulated frame of one mark are a *pair*; pairs are joined by mark,
//! never by nearest time, and stored in a *dataset* whose truth is two append-only journals.
//!
//! ```text
//! rig file --config--> devices (serial | pty emulator, V4L2 | nokhwa | virtual | replay)
//! plan file --plan--> Plan --check--> Trajectory --+--> session --> real captures --+
//!                                                  +--> twin ----> sim captures ---+--> pairing --> dataset --> report
//! ```
//!
//! A *virtual* device imitates bytes and delays; the *twin* imitates physics. They are kept apart: one must
//! be fast and nasty, the other true, and the virtual camera's picture is another model than the twin's.
//!
//! # Layers
//!
//! Imports go downward only, and modules of one rung do not know each other (`tests/layers.rs`). Rungs 0 and 1a, the elastomer
//! and the optics are the package `twinrig-physics`, under which Fourier transforms are one of their own: so they are compiled
//! once, and optimised, for all that is tested.
//!
//! | rung | modules | is |
//! |---|---|---|
//! | 0 | [`units`] [`clock`] [`pose`] [`frame`] [`problem`] [`percent`] [`cache`] [`draw`], `wakeful` of the physics | vocabulary; what is kept between runs; draws that are the same for ever; threads that stay awake for short pieces of work |
//! | 1a | [`indenter`] [`image`] | shapes and pictures |
//! | 1b | [`motion`] [`protocol`] [`elastomer`] [`optics`] | pure domains: no I/O, no waiting |
//! | 2 | [`plan`] [`device`] [`dataset`] | uses of the domains |
//! | 3a | [`session`] [`twin`] [`pairing`] [`trial`] | activities |
//! | 3b | [`collection`] | session and twin at once, into a dataset |
//! | 4a | [`config`] | files to checked values |
//! | 4b | [`assemble`] | checked values to devices and a twin |
//! | 5a | [`report`] [`control`] | what a dataset looks like; what a running session answers |
//! | 5b | [`cli`] | a file for each subcommand |
//!
//! # What each part never does
//!
//! - `plan` never sees a device: a plan can be checked in an office.
//! - `protocol` never does I/O nor waits: every dialogue is testable without a clock or a port.
//! - `elastomer` and `optics` know neither each other nor the rig.
//! - `session` names no firmware and opens no file: captures go to a channel.
//! - `pairing` never runs anything, so it may be repeated years later.
//! - Only `assemble` and `cli` see the whole configuration; only `cli` prints.
//!
//! # Conventions
//!
//! One frame everywhere, the pad frame of [`pose`]. Lengths are mm, forces N, stresses MPa, angles degrees, and
//! the unit is in the name. Time is `Duration` or [`clock::Timestamp`]. Errors name the thing, the value, what is
//! allowed, and the next move; every layer has its own `thiserror` enum.

// Layers 0 and 1a, and of 1b what is physics, are a package of their own.
pub use twinrig_physics::{
    cache, clock, draw, elastomer, frame, image, indenter, optics, percent, pose, problem, units,
};
// Layer 1b: pure domains.
pub mod motion;
pub mod protocol;
// Layer 2: uses of the domains.
pub mod dataset;
pub mod device;
pub mod plan;
// Layer 3a: activities.
pub mod pairing;
pub mod session;
pub mod trial;
pub mod twin;
// Layer 3b: whole collections.
pub mod collection;
// Layer 4a: files to checked values.
pub mod config;
// Layer 4b: checked values to devices and a twin.
pub mod assemble;
// Layer 5a: what a dataset looks like; what a running session answers.
pub mod control;
pub mod report;
// Layer 5b: command line.
pub mod cli;
