//! What a session tells the rest of the program.

use crate::clock::Timestamp;
use crate::frame::Frame;
use crate::pose::Pose;
use std::time::Duration;

/// One thing that happened, in order.
#[derive(Debug, Clone)]
pub enum Event {
    /// A device said who it is.
    Identified {
        /// Device of the rig file.
        device: String,
        /// The firmware's own words.
        identity: String,
    },
    /// All axes are referenced.
    Homed,
    /// This indenter is now mounted.
    Mounted {
        /// Its name.
        indenter: String,
    },
    /// The untouched sensor was photographed.
    Background {
        /// The indenter mounted at the time.
        indenter: String,
        /// Running number, from 0.
        number: u32,
        /// The picture.
        frame: Frame,
        /// Root mean square difference from the first background of this run, code values.
        drift_rms: f64,
    },
    /// The contact was found.
    Touched {
        /// The indenter that touched.
        indenter: String,
        /// Height of the tip at contact in the frame of the nominal contact, mm.
        contact_zero_mm: f64,
        /// The first frame that showed it.
        frame: Frame,
    },
    /// An episode begins.
    Episode {
        /// Index in the trajectory.
        episode: u32,
    },
    /// A mark was captured.
    Captured(Box<RealCapture>),
    /// The arm is up again and nothing moves.
    Retracted,
}

/// The real side of one mark.
#[derive(Debug, Clone)]
pub struct RealCapture {
    /// Index in the trajectory.
    pub capture: u32,
    /// The pose that was asked for, relative to the contact zero.
    pub commanded: Pose,
    /// The pose that the devices report, relative to the contact zero.
    pub measured: Pose,
    /// Contact zero in effect, mm.
    pub contact_zero_mm: f64,
    /// Every axis involved.
    pub axes: Vec<AxisReading>,
    /// When motion was complete and settled.
    pub settled_at: Timestamp,
    /// From motion complete to a still picture.
    pub settle: Duration,
    /// Root mean square difference of the last two frames, code values.
    pub still_rms: f64,
    /// The frame, exposed after `settled_at`.
    pub frame: Frame,
    /// Wall clock at the capture, ns since 1970 UTC.
    pub utc_ns: i64,
    /// Whether the measured pose departs from the commanded one by more than the tolerance.
    pub departed: bool,
    /// Root mean square difference between the last background and the first one.
    pub drift_rms: f64,
}

/// One axis at a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisReading {
    /// Device of the rig file.
    pub device: String,
    /// Axis of the device.
    pub axis: String,
    /// Position asked for, mm or degrees.
    pub commanded: f64,
    /// Position reported, mm or degrees.
    pub measured: f64,
}
