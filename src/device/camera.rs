//! Cameras: the one call that matters is *the next frame exposed after instant t*.
//!
//! A buffered frame from before the press is the classic silent fault of such benches, so a source
//! never counts frames: it compares exposure stamps. What a frame is: [`crate::frame::Frame`].
//!
//! Sources: [`v4l`] (Linux, all proof there is), [`nokhwa`] (portable, less proof), [`replay`] (a folder of
//! images) and, beside the virtual world it sees, [`crate::device::virtual_bench::camera`].
//! [`open`] makes one ready from a rig file's [`settings`]; [`list`] says what is connected.

pub mod absent;
pub mod averaged;
pub mod controls;
pub mod formats;
pub mod freeze;
pub mod list;
#[cfg(any(target_os = "linux", target_os = "macos", target_os = "windows"))]
pub mod nokhwa;
pub mod open;
mod queue;
pub mod replay;
pub mod settings;
#[cfg(target_os = "linux")]
pub mod v4l;

use crate::clock::Timestamp;
use crate::frame::Frame;
use serde::{Deserialize, Serialize};
use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

/// The future a camera answers with.
pub type FrameFuture<'a> = Pin<Box<dyn Future<Output = Result<Frame, CameraError>> + Send + 'a>>;

/// A source of frames.
pub trait Camera: Send {
    /// What was opened and locked, for the record.
    fn description(&self) -> &CameraDescription;

    /// The first frame whose exposure began at or after `t`; fails when none came `within` that time.
    fn frame_after(&mut self, t: Timestamp, within: Duration) -> FrameFuture<'_>;
}

/// What is recorded about a camera.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraDescription {
    /// `v4l`, `nokhwa`, `virtual` or `replay`.
    pub source: String,
    /// The device's own name (card, bus, serial where known).
    pub name: String,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Negotiated pixel format.
    pub fourcc: String,
    /// Negotiated frame rate, 1/s; 0 where there is none.
    pub frames_per_second: f64,
    /// Controls as read back after setting, by name.
    pub controls: Vec<(String, i64)>,
    /// Whether frames are made up by the virtual bench.
    pub is_virtual: bool,
}

/// Why a frame could not be had.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The device is not there or cannot be opened.
    #[error("camera {camera}: cannot open: {why}; `twinrig devices` lists what is connected")]
    Open {
        /// What was asked for.
        camera: String,
        /// The system's reason.
        why: String,
    },
    /// The driver gave something else than asked for.
    #[error(
        "camera {camera}: asked for {asked}, the driver gives {given}; set [camera] to a mode that `twinrig devices` lists"
    )]
    Format {
        /// Which camera.
        camera: String,
        /// What was asked.
        asked: String,
        /// What came back.
        given: String,
    },
    /// A control could not be locked.
    #[error(
        "camera {camera}: control {control} = {asked} reads back as {given}; remove it from [camera.controls] or choose a value the camera accepts"
    )]
    Control {
        /// Which camera.
        camera: String,
        /// Which control.
        control: String,
        /// What was asked.
        asked: i64,
        /// What came back.
        given: String,
    },
    /// No fresh frame in time.
    #[error(
        "camera {camera}: no frame exposed after the motion ended came within {waited:?}; check its cable and lighting, then resume"
    )]
    Stalled {
        /// Which camera.
        camera: String,
        /// How long was waited.
        waited: Duration,
    },
    /// The camera is gone.
    #[error("camera {camera}: lost: {why}; reconnect it, then resume")]
    Lost {
        /// Which camera.
        camera: String,
        /// The system's reason.
        why: String,
    },
    /// The recording has no more frames.
    #[error(
        "camera {camera}: all {frames} recorded frames have been served; record more, or set [camera.replay] repeat = true"
    )]
    Ended {
        /// Which recording.
        camera: String,
        /// How many it holds.
        frames: usize,
    },
    /// A frame could not be decoded.
    #[error("camera {camera}: frame {sequence} in format {fourcc} cannot be decoded: {why}")]
    Decode {
        /// Which camera.
        camera: String,
        /// The frame's number.
        sequence: u32,
        /// Its pixel format.
        fourcc: String,
        /// What is wrong.
        why: String,
    },
}
