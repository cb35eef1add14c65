//! An image frame: pixels, and the proof of when they were exposed.

use crate::clock::Timestamp;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// One 8-bit RGB picture, row 0 on top, upright, as every later stage expects it.
/// Sources decode their own pixel formats before they hand a frame on.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `height * width * 3` code values.
    pub rgb: Vec<u8>,
    /// How and when it was taken.
    pub stamp: FrameStamp,
}

/// What is known about the exposure of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameStamp {
    /// Earliest instant at which the exposure can have begun (monotonic clock).
    pub exposed_at: Timestamp,
    /// Exposure time in effect, if the source knows it.
    pub exposure: Option<Duration>,
    /// The source's own running number.
    pub sequence: u32,
    /// Frames lost immediately before this one.
    pub dropped_before: u32,
    /// The driver's flags, 0 where there is no driver.
    pub flags: u32,
    /// The source's pixel format as a fourcc (`YUYV`, `MJPG`, `RGB3`).
    pub fourcc: String,
    /// How many exposures were averaged (1 = a single one).
    pub averaged: u16,
}

impl Frame {
    /// The code values of the pixel in column `x` of row `y`.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let i = (y as usize * self.width as usize + x as usize) * 3;
        [self.rgb[i], self.rgb[i + 1], self.rgb[i + 2]]
    }
}
