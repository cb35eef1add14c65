//! The replay source: a folder of recorded images, served in the order of their names.
//!
//! Each call takes the next image, so images answer calls one to one, whatever the calls are for
//! (background, touch-off, captures). Stamps say now: what was recorded has no instant on this clock.

use super::settings::ReplaySettings;
use super::{Camera, CameraDescription, CameraError, FrameFuture};
use crate::clock::{Clock, Timestamp};
use crate::frame::{Frame, FrameStamp};
use std::path::PathBuf;
use std::time::Duration;

/// A camera that serves recorded images.
pub struct ReplayCamera {
    description: CameraDescription,
    clock: Clock,
    images: Vec<PathBuf>,
    served: usize,
    repeat: bool,
}

impl ReplayCamera {
    /// Opens the folder and reads its first image for the size.
    pub fn open(settings: &ReplaySettings, clock: Clock) -> Result<Self, CameraError> {
        let name = settings.path.display().to_string();
        let refused = |why: String| CameraError::Open { camera: name.clone(), why };
        let mut images = Vec::new();
        for entry in std::fs::read_dir(&settings.path).map_err(|e| refused(e.to_string()))? {
            let path = entry.map_err(|e| refused(e.to_string()))?.path();
            let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
            if matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg")) {
                images.push(path);
            }
        }
        images.sort();
        let Some(first) = images.first() else {
            return Err(refused("no .png, .jpg or .jpeg file in this folder".into()));
        };
        let (width, height) =
            image::image_dimensions(first).map_err(|e| refused(format!("{}: {e}", first.display())))?;
        let description = CameraDescription {
            source: "replay".into(),
            name,
            width,
            height,
            fourcc: "RGB3".into(),
            frames_per_second: 0.0,
            controls: Vec::new(),
            is_virtual: false,
        };
        Ok(Self { description, clock, images, served: 0, repeat: settings.repeat })
    }

    fn next(&mut self, t: Timestamp) -> Result<Frame, CameraError> {
        let CameraDescription { width, height, name, .. } = &self.description;
        let (index, frames) = (self.served, self.images.len());
        if index >= frames && !self.repeat {
            return Err(CameraError::Ended { camera: name.clone(), frames });
        }
        let sequence = index as u32;
        let path = &self.images[index % frames];
        let fourcc =
            if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) { "PNG" } else { "JPEG" };
        let picture = image::open(path)
            .map_err(|e| CameraError::Decode {
                camera: name.clone(),
                sequence,
                fourcc: fourcc.into(),
                why: format!("{}: {e}", path.display()),
            })?
            .into_rgb8();
        if picture.dimensions() != (*width, *height) {
            return Err(CameraError::Format {
                camera: path.display().to_string(),
                asked: format!("{width} x {height} as the first image"),
                given: format!("{} x {}", picture.width(), picture.height()),
            });
        }
        self.served += 1;
        let stamp = FrameStamp {
            exposed_at: self.clock.now().max(t),
            exposure: None,
            sequence,
            dropped_before: 0,
            flags: 0,
            fourcc: fourcc.into(),
            averaged: 1,
        };
        Ok(Frame { width: *width, height: *height, rgb: picture.into_raw(), stamp })
    }
}

impl Camera for ReplayCamera {
    fn description(&self) -> &CameraDescription {
        &self.description
    }

    fn frame_after(&mut self, t: Timestamp, within: Duration) -> FrameFuture<'_> {
        Box::pin(async move {
            // An instant to come is waited for, as a camera would.
            let wait = t.since(self.clock.now()).min(within);
            self.clock.sleep(wait).await;
            self.next(t)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WITHIN: Duration = Duration::from_secs(1);

    fn folder(sizes: &[(&str, u32, u32)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (i, (name, width, height)) in sizes.iter().enumerate() {
            let value = 10 * (i as u8 + 1);
            image::RgbImage::from_pixel(*width, *height, image::Rgb([value; 3]))
                .save(folder.path().join(name))
                .unwrap();
        }
        std::fs::write(folder.path().join("notes.txt"), "not an image").unwrap();
        folder
    }

    fn open(folder: &tempfile::TempDir, repeat: bool) -> ReplayCamera {
        let settings = ReplaySettings { path: folder.path().into(), repeat };
        ReplayCamera::open(&settings, Clock::real_time()).unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn images_come_in_order_and_end_with_a_typed_error() {
        let folder = folder(&[("b.png", 4, 2), ("a.png", 4, 2)]);
        let mut camera = open(&folder, false);
        let t = camera.clock.now().after(Duration::from_millis(500));
        let first = camera.frame_after(t, WITHIN).await.unwrap();
        assert_eq!(first.pixel(3, 1), [20; 3], "a.png comes before b.png");
        assert!(first.stamp.exposed_at >= t);
        assert_eq!(camera.frame_after(t, WITHIN).await.unwrap().pixel(0, 0), [10; 3]);
        let ended = camera.frame_after(t, WITHIN).await;
        assert!(matches!(ended, Err(CameraError::Ended { frames: 2, .. })), "{ended:?}");

        let mut endless = open(&folder, true);
        for expected in [20, 10, 20] {
            assert_eq!(endless.frame_after(t, WITHIN).await.unwrap().pixel(0, 0), [expected; 3]);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn another_size_a_torn_file_and_an_empty_folder_are_errors() {
        let mixed = folder(&[("a.png", 4, 2), ("b.png", 2, 4)]);
        let mut camera = open(&mixed, false);
        assert!(camera.frame_after(Timestamp(0), WITHIN).await.is_ok());
        assert!(matches!(camera.frame_after(Timestamp(0), WITHIN).await, Err(CameraError::Format { .. })));

        let torn = folder(&[("a.png", 4, 2), ("b.png", 4, 2)]);
        let bytes = std::fs::read(torn.path().join("b.png")).unwrap();
        std::fs::write(torn.path().join("b.png"), &bytes[..bytes.len() / 2]).unwrap();
        let mut camera = open(&torn, false);
        assert!(camera.frame_after(Timestamp(0), WITHIN).await.is_ok());
        assert!(matches!(camera.frame_after(Timestamp(0), WITHIN).await, Err(CameraError::Decode { .. })));

        let empty = ReplaySettings { path: folder(&[]).path().into(), repeat: false };
        assert!(matches!(ReplayCamera::open(&empty, Clock::real_time()), Err(CameraError::Open { .. })));
    }
}
