//! The V4L2 source: all the proof that Linux has of when a frame was exposed.
//!
//! Stages of opening: find the device; negotiate size, format and rate, and refuse what the driver silently
//! changed ([`mode`]); lock the controls in order and read them back ([`lock`]); stream in a thread of its own
//! ([`pump`]), which stamps each buffer with the earliest instant its exposure can have begun ([`stamp`]).
//! Facts about the `v4l` crate and the drivers were found by trying, against the kernel's test camera.
//!
//! A camera that was lost is opened anew, with the same settings, by the next call after the one that
//! reported it: whoever resumes a session need not know.

mod ioctl;
mod lock;
mod mode;
mod pump;
mod stamp;

use super::controls::EXPOSURE_ABSOLUTE;
use super::list::{CameraListing, CameraMode, ControlListing};
use super::queue::FrameQueue;
use super::settings::CameraSettings;
use super::{Camera, CameraDescription, CameraError, FrameFuture, controls};
use crate::clock::Timestamp;
use crate::frame::Frame;
use crate::units::ExposureTicks;
use ::v4l::buffer::Type;
use ::v4l::capability::Flags;
use ::v4l::prelude::MmapStream;
use ::v4l::{Device, capability::Capabilities};
use pump::{BUFFERS, Mode, Pump};
use stamp::StampRule;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A camera through V4L2.
pub struct V4lCamera {
    settings: CameraSettings,
    description: CameraDescription,
    queue: FrameQueue,
    /// Keeps the thread; `None` while a lost camera waits to be opened anew.
    pump: Option<Pump>,
}

impl V4lCamera {
    /// Opens, negotiates, locks and starts streaming. Blocks for as long as the driver takes.
    pub fn open(settings: &CameraSettings) -> Result<Self, CameraError> {
        let camera = settings.label();
        let failed = |what: &str, e: std::io::Error| CameraError::Open {
            camera: camera.clone(),
            why: match e.kind() {
                std::io::ErrorKind::ResourceBusy => format!("{what}: another program uses it"),
                _ => format!("{what}: {e}"),
            },
        };

        // 1. The device.
        let path = find(&camera)?;
        let device = Device::with_path(&path).map_err(|e| failed(&path.display().to_string(), e))?;
        let card = device.query_caps().map_err(|e| failed("not a V4L2 device", e))?;
        if !is_camera(&card) {
            let why = format!("{} does not capture pictures by streaming", card.card);
            return Err(CameraError::Open { camera, why });
        }

        // 2. The mode, then the controls: changing the mode may reset them.
        let agreed = mode::negotiate(&device, settings, &camera)?;
        let locked = lock::lock(&device, settings, &camera)?;
        let exposure = locked.iter().find(|c| c.id == EXPOSURE_ABSOLUTE);
        let exposure =
            exposure.and_then(|c| u32::try_from(c.value).ok()).map(|v| ExposureTicks(v).duration());

        // 3. The stream.
        let period = Duration::from_secs_f64(1.0 / agreed.frames_per_second);
        let compressed = agreed.format == super::formats::PixelFormat::Mjpg;
        let lead =
            settings.lead().unwrap_or_else(|| StampRule::lead_of(&card.driver, exposure, period, compressed));
        let stream = MmapStream::with_buffers(&device, Type::VideoCapture, BUFFERS)
            .map_err(|e| failed("buffers", e))?;
        let queue = FrameQueue::default();
        let mode = Mode {
            format: agreed.format,
            fourcc: agreed.fourcc.clone(),
            width: agreed.width,
            height: agreed.height,
            stride: agreed.stride,
            rule: StampRule { period, lead },
            exposure,
            stall: settings.stall(),
        };
        let pump = Pump::start(stream, mode, queue.clone()).map_err(|e| failed("thread", e))?;

        let description = CameraDescription {
            source: "v4l".into(),
            name: format!("{} ({}, {})", card.card, card.driver, card.bus),
            width: agreed.width,
            height: agreed.height,
            fourcc: agreed.fourcc,
            frames_per_second: agreed.frames_per_second,
            controls: locked.into_iter().map(|c| (c.name, c.value)).collect(),
            is_virtual: false,
        };
        Ok(Self { settings: settings.clone(), description, queue, pump: Some(pump) })
    }

    async fn reopen(&mut self) -> Result<(), CameraError> {
        // The old stream must be gone first: the device has one owner.
        let (old, settings) = (self.pump.take(), self.settings.clone());
        let opening = tokio::task::spawn_blocking(move || {
            drop(old);
            V4lCamera::open(&settings)
        });
        match opening.await {
            Ok(Ok(camera)) => {
                *self = camera;
                tracing::info!(camera = self.description.name, "camera is back");
                Ok(())
            }
            Ok(Err(why)) => {
                let camera = self.description.name.clone();
                Err(CameraError::Lost { camera, why: why.to_string() })
            }
            Err(panic) => std::panic::resume_unwind(panic.into_panic()),
        }
    }

    async fn next_after(&mut self, t: Timestamp, within: Duration) -> Result<Frame, CameraError> {
        if self.pump.is_none() {
            self.reopen().await?;
        }
        let frame = self.queue.first_after(&self.description.name, t, within).await;
        if matches!(frame, Err(CameraError::Lost { .. })) {
            self.pump = None;
        }
        frame
    }
}

impl Camera for V4lCamera {
    fn description(&self) -> &CameraDescription {
        &self.description
    }

    fn frame_after(&mut self, t: Timestamp, within: Duration) -> FrameFuture<'_> {
        Box::pin(self.next_after(t, within))
    }
}

fn is_camera(card: &Capabilities) -> bool {
    card.capabilities.contains(Flags::VIDEO_CAPTURE | Flags::STREAMING)
}

/// The device node that a setting names: a path, a number, or a card's name.
fn find(device: &str) -> Result<PathBuf, CameraError> {
    if device.starts_with('/') {
        return Ok(PathBuf::from(device));
    }
    if let Ok(index) = device.parse::<u32>() {
        return Ok(PathBuf::from(format!("/dev/video{index}")));
    }
    let cards: Vec<(PathBuf, String)> = nodes()
        .into_iter()
        .filter_map(|path| {
            let card = Device::with_path(&path).and_then(|d| d.query_caps()).ok()?;
            is_camera(&card).then_some((path, card.card))
        })
        .collect();
    let mut named = cards.iter().filter(|(_, card)| card == device);
    let why = match (named.next(), named.next()) {
        (Some((path, _)), None) => return Ok(path.clone()),
        (Some(_), Some(_)) => "several cards have this name: give the path under /dev/v4l/by-id".to_owned(),
        (None, _) => {
            let names: Vec<&str> = cards.iter().map(|(_, card)| card.as_str()).collect();
            format!("no card of this name among [{}]", names.join(", "))
        }
    };
    Err(CameraError::Open { camera: device.to_owned(), why })
}

/// All video nodes, in order of their numbers.
fn nodes() -> Vec<PathBuf> {
    let number = |path: &Path| path.file_name()?.to_str()?.strip_prefix("video")?.parse::<u32>().ok();
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let mut found: Vec<(u32, PathBuf)> =
        entries.filter_map(|entry| Some((number(&entry.path())?, entry.path()))).collect();
    found.sort();
    found.into_iter().map(|(_, path)| path).collect()
}

/// The path by identity of a node, which survives replugging.
fn by_id(node: &Path) -> Option<PathBuf> {
    let links = std::fs::read_dir("/dev/v4l/by-id").ok()?;
    let mut found: Vec<PathBuf> = links
        .flatten()
        .map(|link| link.path())
        .filter(|link| std::fs::canonicalize(link).is_ok_and(|target| target == node))
        .collect();
    found.sort();
    found.into_iter().next()
}

/// All cameras of this machine with their modes and controls.
pub fn list() -> Vec<CameraListing> {
    nodes().into_iter().filter_map(|node| listing(&node)).collect()
}

/// What is known about one node; `None` for nodes that are no camera (metadata, radio).
fn listing(node: &Path) -> Option<CameraListing> {
    let mut listing = CameraListing {
        source: "v4l".into(),
        device: by_id(node).unwrap_or_else(|| node.to_owned()).display().to_string(),
        node: node.display().to_string(),
        name: String::new(),
        driver: String::new(),
        modes: Vec::new(),
        controls: Vec::new(),
        problem: None,
    };
    match Device::with_path(node).and_then(|device| Ok((device.query_caps()?, device))) {
        Ok((card, device)) => {
            if !is_camera(&card) {
                return None;
            }
            listing.driver = format!("{} ({})", card.driver, card.bus);
            listing.name = card.card;
            match mode::modes(&device) {
                Ok(modes) => listing.modes = modes,
                Err(e) => listing.problem = Some(format!("modes: {e}")),
            }
            listing.controls = lock::listing(&device);
        }
        Err(e) => listing.problem = Some(e.to_string()),
    }
    Some(listing)
}
