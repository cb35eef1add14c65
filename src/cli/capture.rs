//! `twinrig capture RIG --out FILE.png`: one picture from the rig's camera.
//!
//! Takes a frame exposed after now, with the controls of the rig file locked. Nothing moves.

use super::exit::Exit;
use super::options::RigOptions;
use super::screen;
use crate::clock::Clock;
use std::path::PathBuf;

/// Take one picture
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  twinrig capture rig_configs/virtual.toml --out /tmp/now.png")]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// Where to write the picture
    #[arg(long, value_name = "PNG")]
    pub out: PathBuf,
    /// Print what is known about the frame as one JSON document
    #[arg(long)]
    pub json: bool,
}

/// How long a frame may take.
const WITHIN: std::time::Duration = std::time::Duration::from_secs(5);

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let setup = match crate::config::load(&self.rig.rig, None, &self.rig.overrides.set) {
            Ok(setup) => setup,
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        };
        match self.capture(&setup).await {
            Ok(stamp) => {
                if self.json {
                    screen::json(&stamp);
                } else {
                    screen::result(self.out.display());
                }
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Failed
            }
        }
    }

    async fn capture(&self, setup: &crate::config::Setup) -> Result<crate::frame::FrameStamp, CaptureError> {
        let clock = Clock::real_time();
        let mut camera = crate::assemble::camera_alone(setup, clock).await?;
        let frame = camera.frame_after(clock.now(), WITHIN).await?;
        let bytes = crate::image::png::encode(&frame)?;
        std::fs::write(&self.out, bytes)
            .map_err(|e| CaptureError::Write { path: self.out.clone(), why: e.to_string() })?;
        Ok(frame.stamp)
    }
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
enum CaptureError {
    #[error(transparent)]
    Camera(#[from] crate::device::camera::CameraError),
    #[error(transparent)]
    Image(#[from] crate::image::Error),
    #[error("cannot write {}: {why}; check --out", path.display())]
    Write { path: PathBuf, why: String },
}
