//! From a rig file's settings to a camera that is ready.
//!
//! The virtual camera is not opened here: it belongs to a virtual bench, which makes it and passes it to
//! [`ready`].

use super::averaged::Averaged;
use super::replay::ReplayCamera;
use super::settings::{CameraSettings, CameraSource};
use super::{Camera, CameraError};
use crate::clock::Clock;
use std::time::Duration;

/// Opens the camera that the settings name, lets it warm up, and averages if asked to.
pub async fn open(settings: &CameraSettings, clock: Clock) -> Result<Box<dyn Camera>, CameraError> {
    let refused = |why: &str| CameraError::Open { camera: settings.label(), why: why.to_owned() };
    let camera: Box<dyn Camera> = match settings.source {
        #[cfg(target_os = "linux")]
        CameraSource::V4l => {
            let settings = settings.clone();
            Box::new(blocking(move || super::v4l::V4lCamera::open(&settings)).await?)
        }
        #[cfg(any(target_os = "linux", target_os = "macos", target_os = "windows"))]
        CameraSource::Nokhwa => {
            let settings = settings.clone();
            Box::new(blocking(move || super::nokhwa::NokhwaCamera::open(&settings)).await?)
        }
        CameraSource::Replay => {
            let Some(replay) = &settings.replay else { return Err(refused("[camera.replay] is missing")) };
            Box::new(ReplayCamera::open(replay, clock)?)
        }
        CameraSource::Virtual => return Err(refused("a virtual camera needs a virtual bench to look at")),
        #[allow(unreachable_patterns)]
        _ => return Err(refused("this source does not exist on this system; set source = \"replay\"")),
    };
    ready(camera, settings, clock).await
}

/// Lets a camera warm up, and averages if asked to.
pub async fn ready(
    mut camera: Box<dyn Camera>,
    settings: &CameraSettings,
    clock: Clock,
) -> Result<Box<dyn Camera>, CameraError> {
    // A recording does not settle, and its images are counted.
    if settings.source != CameraSource::Replay {
        let mut t = clock.now();
        for _ in 0..settings.warmup_frames {
            let frame = camera.frame_after(t, settings.stall()).await?;
            t = frame.stamp.exposed_at.after(Duration::from_nanos(1));
        }
    }
    if settings.mean_of > 1 {
        camera = Box::new(Averaged::new(camera, settings.mean_of));
    }
    Ok(camera)
}

#[cfg(any(target_os = "linux", target_os = "macos", target_os = "windows"))]
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => done,
        Err(panic) => std::panic::resume_unwind(panic.into_panic()),
    }
}
