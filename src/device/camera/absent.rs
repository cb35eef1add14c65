//! No camera: what a bench carries whose command needs none, so that jogging works with the camera unplugged.

use super::{Camera, CameraDescription, CameraError, FrameFuture};
use crate::clock::Timestamp;
use std::time::Duration;

/// A camera that has no frames.
#[derive(Debug, Default)]
pub struct AbsentCamera(CameraDescription);

impl Camera for AbsentCamera {
    fn description(&self) -> &CameraDescription {
        &self.0
    }

    fn frame_after(&mut self, _: Timestamp, _: Duration) -> FrameFuture<'_> {
        let why = "this command opened none".to_owned();
        Box::pin(std::future::ready(Err(CameraError::Open { camera: "(none)".to_owned(), why })))
    }
}
