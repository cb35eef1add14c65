//! The `[emulator]` table of a protocol file: how the emulated firmware behaves.
//!
//! The client never reads it. It is kept as the TOML table that the emulator interprets.

use serde::Deserialize;

/// The table as written; the emulator gives it meaning.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(transparent)]
pub struct EmulatorSpec(pub toml::Table);
