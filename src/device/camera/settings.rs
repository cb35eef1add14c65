//! What a rig file says about its camera: where frames come from, in which mode, locked how.
//!
//! One table serves all sources; keys that a source cannot honour are refused by [`CameraSettings::check`],
//! so that nobody believes an exposure is locked which never was. The geometry (lens, distance, scale)
//! belongs to the sensor's file.

use crate::device::camera::controls::{self, ControlId};
use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

/// The `[camera]` table of a rig file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSettings {
    /// Where frames come from.
    pub source: CameraSource,
    /// Which device: a path (`/dev/v4l/by-id/...`, `/dev/video0`), an index, or the card's name.
    pub device: Option<String>,
    /// Width of the frames, px.
    #[serde(default = "default_width")]
    pub width: u32,
    /// Height of the frames, px.
    #[serde(default = "default_height")]
    pub height: u32,
    /// Pixel format as a fourcc; without it the least compressed one that the camera offers.
    pub fourcc: Option<String>,
    /// Frames per second; without it whatever the camera does by itself.
    pub fps: Option<f64>,
    /// Controls to set and read back, by name (`exposure_absolute`) or id (`0x009a0902`).
    #[serde(default)]
    pub controls: BTreeMap<String, i64>,
    /// How long before its stamp the exposure of a frame can have begun, ms; without it the source's own rule.
    pub lead_ms: Option<f64>,
    /// Frames to throw away after opening, while the camera settles.
    #[serde(default = "default_warmup_frames")]
    pub warmup_frames: u32,
    /// How many exposures make one frame of the dataset.
    #[serde(default = "default_mean_of")]
    pub mean_of: u16,
    /// A camera that is silent for this long has stalled, ms.
    #[serde(default = "default_stall_ms")]
    pub stall_ms: u64,
    /// For `replay`: which images.
    pub replay: Option<ReplaySettings>,
    /// For `virtual`: how far the made-up camera departs from a perfect one.
    #[serde(rename = "virtual")]
    pub made_up: Option<VirtualSettings>,
}

fn default_width() -> u32 {
    640
}

fn default_height() -> u32 {
    480
}

fn default_warmup_frames() -> u32 {
    5
}

fn default_mean_of() -> u16 {
    1
}

fn default_stall_ms() -> u64 {
    3000
}

/// Where frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraSource {
    /// Linux: kernel timestamps, sequence numbers, controls.
    V4l,
    /// Any desktop system, with less proof of when a frame was exposed.
    Nokhwa,
    /// The virtual bench: sees the virtual world.
    Virtual,
    /// A folder of recorded images.
    Replay,
}

/// A folder of recorded images.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplaySettings {
    /// The folder; its PNG and JPEG files are served in the order of their names.
    pub path: PathBuf,
    /// Whether to begin anew after the last image instead of failing.
    #[serde(default)]
    pub repeat: bool,
}

/// How far the virtual camera departs from a perfect one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VirtualSettings {
    /// Exposure time, ms.
    pub exposure_ms: f64,
    /// Standard deviation of the read noise, code values.
    pub read_noise: f64,
    /// Code values at which the shot noise equals the read noise; 0 for none.
    pub shot_noise: f64,
    /// Factor on all code values.
    pub gain: f64,
    /// Added to all code values.
    pub offset: f64,
    /// The picture is shifted by this much to the right and down, px, as a camera mounted askew would.
    pub shift_px: [f64; 2],
    /// Seed of noise, dirt and texture.
    pub seed: u64,
}

impl Default for VirtualSettings {
    fn default() -> Self {
        Self {
            exposure_ms: 15.0,
            read_noise: 1.0,
            shot_noise: 0.012,
            gain: 1.02,
            offset: 1.5,
            shift_px: [0.8, -0.6],
            seed: 1,
        }
    }
}

impl CameraSettings {
    /// The stall limit as a span of time.
    pub fn stall(&self) -> Duration {
        Duration::from_millis(self.stall_ms)
    }

    /// The lead as a span of time, where one is given.
    pub fn lead(&self) -> Option<Duration> {
        self.lead_ms.map(|ms| Duration::from_secs_f64(ms.max(0.0) * 1e-3))
    }

    /// How the camera is named in messages before it has told its own name.
    pub fn label(&self) -> String {
        match (&self.device, &self.replay, self.source) {
            (Some(device), ..) => device.clone(),
            (None, Some(replay), CameraSource::Replay) => replay.path.display().to_string(),
            (None, _, source) => format!("{source:?}").to_lowercase(),
        }
    }

    /// Reports everything that cannot be right.
    pub fn check(&self, problems: &mut Problems) {
        problems.range("width", f64::from(self.width), 16.0, 8192.0, "px");
        problems.range("height", f64::from(self.height), 16.0, 8192.0, "px");
        problems.range("mean_of", f64::from(self.mean_of), 1.0, 256.0, "frames");
        problems.range("warmup_frames", f64::from(self.warmup_frames), 0.0, 1000.0, "frames");
        problems.range("stall_ms", self.stall_ms as f64, 100.0, 60_000.0, "ms");
        if let Some(fps) = self.fps {
            problems.range("fps", fps, 0.1, 1000.0, "1/s");
        }
        if let Some(lead_ms) = self.lead_ms {
            problems.range("lead_ms", lead_ms, 0.0, 10_000.0, "ms");
        }
        self.check_source(problems);
        problems.within("controls", |p| self.check_controls(p));
        if let Some(made_up) = &self.made_up {
            problems.within("virtual", |p| made_up.check(p));
        }
    }

    /// A key that the source cannot honour is a mistake, not a wish.
    fn check_source(&self, problems: &mut Problems) {
        use CameraSource::{Nokhwa, Replay, V4l, Virtual};
        let real = matches!(self.source, V4l | Nokhwa);
        let name = format!("{:?}", self.source).to_lowercase();
        if self.source == V4l && !cfg!(target_os = "linux") {
            problems.push(
                "source",
                "v4l",
                "nokhwa, virtual, replay",
                "V4L2 is Linux's; set source = \"nokhwa\"",
            );
        }
        if real && self.device.is_none() {
            let allowed = "a path, an index or a card name";
            problems.push("device", "nothing", allowed, "name one that `twinrig devices` lists");
        }
        if !real && self.device.is_some() {
            problems.push("device", &name, "no device for this source", "remove device");
        }
        if let Some(fourcc) = &self.fourcc {
            if !real {
                problems.push("fourcc", fourcc, "no format for this source", "remove fourcc");
            } else if super::formats::PixelFormat::from_fourcc(fourcc).is_none() {
                let allowed = super::formats::PixelFormat::names().join(", ");
                problems.push("fourcc", fourcc, allowed, "choose a format that can be decoded");
            }
        }
        if self.source != V4l && !self.controls.is_empty() {
            let next = "remove them, or set source = \"v4l\"";
            problems.push("controls", &name, "controls only with source = \"v4l\"", next);
        }
        match (&self.replay, self.source) {
            (None, Replay) => {
                let next = "add [camera.replay] with path = \"FOLDER\"";
                problems.push("replay.path", "nothing", "a folder of images", next);
            }
            (Some(_), V4l | Nokhwa | Virtual) => {
                let next = "remove the table, or set source = \"replay\"";
                problems.push("replay", &name, "only with source = \"replay\"", next);
            }
            _ => {}
        }
        if self.made_up.is_some() && self.source != Virtual {
            let next = "remove the table, or set source = \"virtual\"";
            problems.push("virtual", &name, "only with source = \"virtual\"", next);
        }
    }

    fn check_controls(&self, problems: &mut Problems) {
        let mut seen: BTreeMap<u32, &str> = BTreeMap::new();
        for key in self.controls.keys() {
            // A name that no standard knows may be the driver's own: only the camera can tell.
            let ControlId::Number(id) = controls::parse(key) else { continue };
            if let Some(other) = seen.insert(id, key) {
                let next = format!("remove either {other} or {key}");
                problems.push(key, key, format!("each control once ({other} is the same)"), next);
            }
        }
    }
}

impl VirtualSettings {
    fn check(&self, problems: &mut Problems) {
        problems.range("exposure_ms", self.exposure_ms, 0.01, 1000.0, "ms");
        problems.range("read_noise", self.read_noise, 0.0, 50.0, "code values");
        problems.range("shot_noise", self.shot_noise, 0.0, 10.0, "");
        problems.range("gain", self.gain, 0.1, 10.0, "");
        problems.range("offset", self.offset, -128.0, 128.0, "code values");
        for shift in self.shift_px {
            problems.range("shift_px", shift, -50.0, 50.0, "px");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems_of(text: &str) -> Vec<String> {
        let settings: CameraSettings = toml::from_str(text).expect("the text is well formed");
        let mut problems = Problems::new();
        settings.check(&mut problems);
        problems.into_vec().into_iter().map(|p| p.key).collect()
    }

    #[test]
    fn a_short_table_is_enough() {
        assert!(problems_of("source = \"virtual\"").is_empty());
        assert!(problems_of("source = \"replay\"\nreplay = { path = \"frames\" }").is_empty());
        let v4l = "source = \"v4l\"\ndevice = \"/dev/video0\"\nfourcc = \"YUYV\"\n\
                   controls = { exposure_auto = 1, exposure_absolute = 100, 0x00f0f000 = 2 }";
        let found = problems_of(v4l);
        assert_eq!(found.is_empty(), cfg!(target_os = "linux"), "{found:?}");
    }

    #[test]
    fn keys_that_a_source_cannot_honour_are_refused_all_at_once() {
        let text = "source = \"virtual\"\ndevice = \"/dev/video0\"\nwidth = 0\nlead_ms = -1\n\
                    controls = { gain = 3 }\nreplay = { path = \"x\" }\nvirtual = { gain = 0 }";
        assert_eq!(
            problems_of(text),
            ["width", "lead_ms", "device", "controls", "replay", "virtual.gain"].map(String::from)
        );
        assert_eq!(problems_of("source = \"replay\""), ["replay.path"]);
        assert!(
            problems_of("source = \"nokhwa\"\ndevice = \"0\"\nfourcc = \"H264\"").contains(&"fourcc".into())
        );
    }

    #[test]
    fn one_control_under_two_names_is_found() {
        let text = "source = \"v4l\"\ndevice = \"0\"\ncontrols = { gain = 3, 0x00980913 = 4 }";
        assert!(problems_of(text).contains(&"controls.gain".into()));
    }

    #[test]
    fn unknown_keys_are_refused() {
        let text = "source = \"virtual\"\nheigth = 480";
        assert!(toml::from_str::<CameraSettings>(text).unwrap_err().to_string().contains("heigth"));
    }
}
