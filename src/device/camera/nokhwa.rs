//! The portable source, for systems without V4L2.
//!
//! `nokhwa` gives neither sequence numbers nor flags, and its stamps, where there are any, are of the wall
//! clock. So a frame's exposure is bounded by what is certain: its buffer was empty when it was handed to the
//! driver, which was no later than the arrival of the frame [`BUFFERS`] before. A frame therefore
//! counts as exposed that early, and *the first frame after t* waits a few frames longer than with V4L2.
//! That there are no more than [`BUFFERS`] is known for Linux and assumed elsewhere.
//!
//! The crate's camera cannot leave its thread and cannot be interrupted while it waits for a frame: a stalled
//! camera leaves its thread behind until it sends again. Controls are V4L2's business ([`super::v4l`]).
//! Pictures are decoded by [`super::formats`].

use super::formats::PixelFormat;
use super::list::CameraListing;
use super::queue::{FrameQueue, RawFrame};
use super::settings::CameraSettings;
use super::{Camera, CameraDescription, CameraError, FrameFuture};
use crate::clock::{Clock, Timestamp};
use crate::frame::FrameStamp;
use ::nokhwa::utils::{
    ApiBackend, CameraFormat, CameraIndex, CameraInfo, FrameFormat, RequestedFormat, RequestedFormatType,
    Resolution,
};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Buffers that can hold frames from before.
const BUFFERS: usize = 4;
/// The rate asked for where the rig file asks for none, 1/s.
const USUAL_RATE: u32 = 30;
/// How long a closed camera is given to finish its frame.
const PATIENCE: Duration = Duration::from_millis(500);
/// Formats in order of preference, as nokhwa and as V4L2 name them.
const FORMATS: [(FrameFormat, &str); 5] = [
    (FrameFormat::RAWRGB, "RGB3"),
    (FrameFormat::RAWBGR, "BGR3"),
    (FrameFormat::YUYV, "YUYV"),
    (FrameFormat::NV12, "NV12"),
    (FrameFormat::MJPEG, "MJPG"),
];

/// A camera through nokhwa.
pub struct NokhwaCamera {
    description: CameraDescription,
    queue: FrameQueue,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl NokhwaCamera {
    /// Opens the camera in its thread and starts streaming. Blocks for as long as the driver takes.
    pub fn open(settings: &CameraSettings) -> Result<Self, CameraError> {
        let (queue, stop) = (FrameQueue::default(), Arc::new(AtomicBool::new(false)));
        let (tell, told) = mpsc::channel();
        let (its_queue, its_stop, its_settings) = (queue.clone(), Arc::clone(&stop), settings.clone());
        let camera = settings.label();
        let refused = |why: String| CameraError::Open { camera: camera.clone(), why };
        let thread = std::thread::Builder::new()
            .name("camera".into())
            .spawn(move || match start(&its_settings) {
                Ok((device, description)) => {
                    if tell.send(Ok(description)).is_ok() {
                        pump(device, &its_queue, &its_stop);
                    }
                }
                Err(error) => {
                    // Nobody listens only when the opener has given up already.
                    let _ = tell.send(Err(error));
                }
            })
            .map_err(|e| refused(e.to_string()))?;
        match told.recv_timeout(settings.stall() + Duration::from_secs(5)) {
            Ok(opened) => Ok(Self { description: opened?, queue, stop, thread }),
            Err(_) => Err(refused("it does not answer".into())),
        }
    }
}

impl Drop for NokhwaCamera {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // The thread looks up after each frame; one that waits for a frame in vain is left behind.
        let patience = Instant::now();
        while !self.thread.is_finished() && patience.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Camera for NokhwaCamera {
    fn description(&self) -> &CameraDescription {
        &self.description
    }

    fn frame_after(&mut self, t: Timestamp, within: Duration) -> FrameFuture<'_> {
        Box::pin(async move { self.queue.first_after(&self.description.name, t, within).await })
    }
}

/// Opens and verifies, in the camera's thread.
fn start(settings: &CameraSettings) -> Result<(::nokhwa::Camera, CameraDescription), CameraError> {
    let camera = settings.label();
    let refused = |why: String| CameraError::Open { camera: camera.clone(), why };
    let (index, name) = find(&camera)?;
    let rate = settings.fps.unwrap_or(f64::from(USUAL_RATE));
    if rate.fract() != 0.0 {
        let (asked, given) = (format!("{rate}/s"), "whole numbers only (a limit of nokhwa)".to_owned());
        return Err(CameraError::Format { camera, asked, given });
    }
    let size = Resolution::new(settings.width, settings.height);

    let mut last = "no format that can be decoded".to_owned();
    for (format, fourcc) in FORMATS {
        if settings.fourcc.as_deref().is_some_and(|asked| asked != fourcc) {
            continue;
        }
        let wanted = CameraFormat::new(size, format, rate as u32);
        let formats = [format];
        let request = RequestedFormat::with_formats(RequestedFormatType::Closest(wanted), &formats);
        let mut device = match ::nokhwa::Camera::new(index.clone(), request) {
            Ok(device) => device,
            Err(e) => {
                last = e.to_string();
                continue;
            }
        };
        let given = device.camera_format();
        let same_rate = settings.fps.is_none() || given.frame_rate() == wanted.frame_rate();
        if given.resolution() != size || given.format() != format || !same_rate {
            last = given.to_string();
            continue;
        }
        device.open_stream().map_err(|e| refused(e.to_string()))?;
        let description = CameraDescription {
            source: "nokhwa".into(),
            name,
            width: settings.width,
            height: settings.height,
            fourcc: fourcc.into(),
            frames_per_second: f64::from(given.frame_rate()),
            controls: Vec::new(),
            is_virtual: false,
        };
        return Ok((device, description));
    }
    let asked = format!(
        "{} x {} {} at {rate}/s",
        settings.width,
        settings.height,
        settings.fourcc.as_deref().unwrap_or("in any format")
    );
    Err(CameraError::Format { camera, asked, given: last })
}

/// Passes frames on until told to stop.
fn pump(mut device: ::nokhwa::Camera, queue: &FrameQueue, stop: &AtomicBool) {
    let clock = Clock::real_time();
    // When the buffers now filling were, at the latest, handed to the driver.
    let mut queued: VecDeque<Timestamp> = std::iter::repeat_n(clock.now(), BUFFERS).collect();
    let period = Duration::from_secs(1) / device.camera_format().frame_rate().max(1);
    let mut sequence = 0;
    while !stop.load(Ordering::Relaxed) {
        let buffer = match device.frame() {
            Ok(buffer) => buffer,
            Err(e) => return queue.lose(e.to_string()),
        };
        queued.push_back(clock.now());
        let handed_over = queued.pop_front().expect("as many are pushed as popped");
        let Some((_, fourcc)) = FORMATS.iter().find(|(f, _)| *f == buffer.source_frame_format()) else {
            return queue.lose(format!("it now sends {}", buffer.source_frame_format()));
        };
        queue.push(RawFrame {
            format: PixelFormat::from_fourcc(fourcc).expect("every format listed can be decoded"),
            width: buffer.resolution().width(),
            height: buffer.resolution().height(),
            stride: 0,
            bytes: buffer.buffer().to_vec(),
            stamp: FrameStamp {
                exposed_at: handed_over.before(period),
                exposure: None,
                sequence,
                dropped_before: 0,
                flags: 0,
                fourcc: (*fourcc).into(),
                averaged: 1,
            },
        });
        sequence += 1;
    }
    if let Err(e) = device.stop_stream() {
        tracing::debug!(error = %e, "stopping the camera");
    }
}

/// The camera that a setting names: a number, a node's number, or a name.
fn find(device: &str) -> Result<(CameraIndex, String), CameraError> {
    let refused = |why: String| CameraError::Open { camera: device.to_owned(), why };
    let all = ::nokhwa::query(ApiBackend::Auto).map_err(|e| refused(e.to_string()))?;
    let node = std::fs::canonicalize(device).ok().and_then(|p| Some(p.file_name()?.to_str()?.to_owned()));
    let number = node.as_deref().and_then(|n| n.strip_prefix("video")).unwrap_or(device).parse::<u32>().ok();
    let matches = |info: &&CameraInfo| match number {
        Some(number) => info.index().as_index().is_ok_and(|i| i == number),
        None => info.human_name() == device,
    };
    match all.iter().find(matches) {
        Some(info) => Ok((info.index().clone(), info.human_name())),
        None => {
            let names: Vec<String> = all.iter().map(CameraInfo::human_name).collect();
            Err(refused(format!("no such camera among [{}]", names.join(", "))))
        }
    }
}

/// All cameras of this machine; their modes are known only after opening.
pub fn list() -> Vec<CameraListing> {
    let all = ::nokhwa::query(ApiBackend::Auto).unwrap_or_default();
    all.iter()
        .map(|info| CameraListing {
            source: "nokhwa".into(),
            device: info.index().to_string(),
            node: info.index().to_string(),
            name: info.human_name(),
            driver: info.description().to_owned(),
            modes: Vec::new(),
            controls: Vec::new(),
            problem: None,
        })
        .collect()
}
