//! Encoded quantities: numbers that mean nothing without a calibration or a datasheet.
//!
//! Physical quantities are plain `f64` with the unit in the name (`depth_mm`, `feed_mm_s`).
//! What a device counts in its own ticks is a newtype here, so that a count can never be
//! added to a length. Conversion belongs to whoever knows the scale: the axis or the driver.

use serde::{Deserialize, Serialize};

/// Motor steps or encoder counts of one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct Steps(pub i64);

/// Absolute exposure as V4L2 counts it: units of 100 microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct ExposureTicks(pub u32);

impl ExposureTicks {
    /// The exposure time these ticks stand for.
    pub fn duration(self) -> std::time::Duration {
        std::time::Duration::from_micros(u64::from(self.0) * 100)
    }
}
