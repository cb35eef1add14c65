//! The rig file: a bench and its devices, and what makes it sound.

use super::document::near_or;
use crate::device::camera::settings::{CameraSettings, CameraSource};
use crate::device::settings::{AxisSettings, MoverSettings, PortSettings, Side};
use crate::elastomer;
use crate::motion::{Arm, AxisKind, AxisRole, Coordinate, PoseMap};
use crate::optics::fast::TOLERANCES;
use crate::plan::{Fence, RigFences};
use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The newest rig format.
pub const SCHEMA: u32 = 1;

/// The word that a virtual bench writes for its sensor.
pub const ANY_SENSOR: &str = "any";

/// A rig file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// Format version, 1.
    pub schema: u32,
    /// What the bench is called.
    pub name: String,
    /// The sensor it carries (the stem of a file in `sensors/`), or `any` on a virtual bench.
    pub sensor: String,
    /// Its serial devices by name (`arm`, `stage`).
    pub devices: BTreeMap<String, MoverSettings>,
    /// Which axis moves the indenter along which coordinate of the pad frame.
    pub motion: PoseMap,
    /// Its camera.
    pub camera: CameraSettings,
    /// How the twin solves the pad.
    #[serde(default)]
    pub elastomer: elastomer::Settings,
    /// How the twin renders.
    #[serde(default)]
    pub optics: OpticsTable,
    /// What the twin follows.
    #[serde(default)]
    pub twin: TwinTable,
    /// How a session is run.
    #[serde(default)]
    pub session: SessionTable,
    /// The world of a virtual bench.
    #[serde(rename = "virtual", default)]
    pub world: Option<VirtualTable>,
}

/// How the twin renders: the `[optics]` table of a rig file. (What is rendered is the sensor file's.)
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OpticsTable {
    /// Path tracing, or its fast approximation.
    pub mode: OpticsMode,
    /// Samples a pixel (reference mode; where the fast mode falls back to it, 64 or more).
    pub samples: u32,
    /// Relative error asked for (fast mode); from 0.002 to 0.01 it picks the work.
    pub tolerance: f64,
    /// Seed of the random numbers.
    pub seed: u32,
}

impl Default for OpticsTable {
    fn default() -> Self {
        Self { mode: OpticsMode::Fast, samples: 16, tolerance: 0.005, seed: 0 }
    }
}

/// The renderers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OpticsMode {
    /// Unbiased path tracing.
    Reference,
    /// Within a tolerance, at camera speed.
    Fast,
}

impl OpticsMode {
    /// The word that a rig file has for it.
    pub fn name(self) -> &'static str {
        match self {
            OpticsMode::Reference => "reference",
            OpticsMode::Fast => "fast",
        }
    }
}

/// What the twin follows, and on how many cores.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TwinTable {
    /// The poses it follows.
    pub poses: TwinPoses,
    /// Threads; absent: all cores.
    pub threads: Option<u32>,
}

/// The poses that the twin follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TwinPoses {
    /// As the plan commands: the twin runs beside the bench.
    #[default]
    Commanded,
    /// As the bench measured: the twin waits for each capture.
    Measured,
}

/// How a session is run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SessionTable {
    /// Largest root mean square difference of two frames of a still picture, code values.
    pub still_rms: f64,
    /// How long a fresh frame or a still picture may take, ms.
    pub frame_within_ms: u64,
    /// Frames thrown away before the first background, for exposure and lamps to settle.
    pub warmup_frames: u32,
    /// A new background every so many episodes, besides at every change of indenter; 0: never.
    pub background_every: u32,
    /// Change of a block of pixels that counts as contact, code values.
    pub touch_threshold: f64,
    /// Feed of the touch-off, mm/s.
    pub touch_feed_mm_s: f64,
    /// Largest accepted departure of the measured pose from the commanded one before a capture is
    /// flagged: mm along, degrees about.
    pub departure: f64,
}

impl Default for SessionTable {
    fn default() -> Self {
        Self {
            still_rms: 3.0,
            frame_within_ms: 5000,
            warmup_frames: 5,
            background_every: 0,
            touch_threshold: 1.5,
            touch_feed_mm_s: 1.0,
            departure: 0.05,
        }
    }
}

/// The world of a virtual bench.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VirtualTable {
    /// Height of the pad's true face above the nominal contact, mm: what touch-off should find.
    pub contact_offset_mm: f64,
    /// Seed of everything random on the bench.
    pub seed: u64,
}

impl Default for VirtualTable {
    fn default() -> Self {
        Self { contact_offset_mm: 0.0, seed: 1 }
    }
}

/// Which sensor a bench carries.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mounted {
    /// A virtual bench offers all.
    Any,
    /// This one.
    One(String),
}

/// A checked rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigConfig {
    /// What the bench is called.
    pub name: String,
    /// The sensor it carries.
    pub sensor: Mounted,
    /// Its serial devices by name.
    pub devices: BTreeMap<String, MoverSettings>,
    /// Which axis does what; every role names an axis that exists.
    pub motion: PoseMap,
    /// Its camera.
    pub camera: CameraSettings,
    /// How the twin solves the pad.
    pub elastomer: elastomer::Settings,
    /// How the twin renders.
    pub optics: OpticsTable,
    /// What the twin follows.
    pub twin: TwinTable,
    /// How a session is run.
    pub session: SessionTable,
    /// The world of a virtual bench; `None` on a real one.
    pub world: Option<VirtualTable>,
}

impl RigConfig {
    /// Whether nothing here is real: no confirmation needed, `--speed` allowed.
    pub fn is_virtual(&self) -> bool {
        self.world.is_some()
    }

    /// Devices whose axes are the joints of an arm.
    pub fn arms(&self) -> BTreeMap<String, Arm> {
        self.devices.iter().filter_map(|(name, mover)| Some((name.clone(), mover.arm()?))).collect()
    }

    /// The fences that plans are checked against.
    pub fn fences(&self) -> RigFences {
        let mut axes = BTreeMap::new();
        for (device, mover) in &self.devices {
            for (name, axis) in mover.pose_axes() {
                let overshoot = axis.approach.map_or(0.0, |a| match a.from {
                    Side::Below => -a.distance,
                    Side::Above => a.distance,
                });
                axes.insert((device.clone(), name), Fence { limits: axis.limits(), overshoot });
            }
        }
        RigFences { map: self.motion.clone(), axes, arms: self.arms() }
    }
}

impl RigFile {
    /// The checked rig; meaningless when problems were reported.
    pub fn check(&self, problems: &mut Problems) -> RigConfig {
        if self.schema != SCHEMA {
            let next =
                format!("this program reads schema {SCHEMA}; rewrite the file or use a matching release");
            problems.push("schema", self.schema, SCHEMA.to_string(), next);
        }
        for (key, text, example) in [("name", &self.name, "bench 2"), ("sensor", &self.sensor, "gelsight")] {
            if text.trim().is_empty() {
                problems.push(key, "\"\"", "a name", format!("write e.g. `{key} = \"{example}\"`"));
            }
        }
        if self.devices.is_empty() {
            let next = "add a table [devices.arm]";
            problems.push("devices", "nothing", "at least one device", next);
        }
        for (name, device) in &self.devices {
            problems.within("devices", |p| p.within(name.as_str(), |p| device.check(p)));
        }
        self.check_wiring(problems);
        self.check_motion(problems);
        problems.within("camera", |p| self.camera.check(p));
        problems.within("elastomer", |p| check_elastomer(&self.elastomer, p));
        problems.within("optics", |p| self.optics.check(p));
        problems.within("session", |p| self.session.check(p));
        if let Some(threads) = self.twin.threads {
            problems.range("twin.threads", f64::from(threads), 1.0, 1024.0, "threads");
        }
        let is_virtual = self.check_reality(problems);
        RigConfig {
            name: self.name.clone(),
            sensor: match self.sensor.as_str() {
                ANY_SENSOR => Mounted::Any,
                name => Mounted::One(name.to_owned()),
            },
            devices: self.devices.clone(),
            motion: self.motion.clone(),
            camera: self.camera.clone(),
            elastomer: self.elastomer.clone(),
            optics: self.optics,
            twin: self.twin,
            session: self.session,
            world: is_virtual.then(|| self.world.unwrap_or_default()),
        }
    }

    /// One port, one device; one wire, one axis.
    fn check_wiring(&self, problems: &mut Problems) {
        let mut ports: Vec<(&PortSettings, &str)> = Vec::new();
        for (name, device) in &self.devices {
            if !device.port.is_virtual() {
                if let Some((_, other)) = ports.iter().find(|(port, _)| **port == device.port) {
                    problems.push(
                        &format!("devices.{name}.port"),
                        "the port of another device",
                        format!("a port of its own ({other} has this one)"),
                        "`twinrig devices` lists ports; use /dev/serial/by-id or a USB serial number",
                    );
                }
                ports.push((&device.port, name));
            }
            let mut wires: Vec<(&str, &str)> = Vec::new();
            for (axis, settings) in &device.axes {
                if let Some((_, other)) = wires.iter().find(|(wire, _)| *wire == settings.wire) {
                    problems.push(
                        &format!("devices.{name}.axes.{axis}.wire"),
                        format!("{:?}", settings.wire),
                        format!("a wire of its own (axis {other} has this one)"),
                        "give each axis the letter or address it has on the controller",
                    );
                }
                wires.push((&settings.wire, axis));
            }
        }
    }

    fn check_motion(&self, problems: &mut Problems) {
        // An axis that could not be read as it was written says nothing about those who rely on it.
        let is_certain = |role: &AxisRole, problems: &Problems| {
            let device = format!("devices.{}", role.device);
            ["kinematics".to_owned(), format!("axes.{}", role.axis)]
                .iter()
                .all(|part| problems.is_certain(&format!("{device}.{part}")))
        };
        let press = &self.motion.z;
        let pressing = self.devices.get(&press.device).and_then(|d| d.pose_axes().remove(&press.axis));
        let pressing = pressing.filter(|axis| axis.is_sound() && is_certain(press, problems));
        if let Some(axis) = pressing.filter(|a| self.session.touch_feed_mm_s > a.max_feed) {
            problems.push(
                "session.touch_feed_mm_s",
                self.session.touch_feed_mm_s,
                format!("0.001 to {} mm/s, the fastest of {}", axis.max_feed, self.motion.z.axis),
                "touch off slower, or correct max_feed of the press axis",
            );
        }
        let mut taken: Vec<(&str, &str, &str)> = Vec::new();
        for coordinate in Coordinate::ALL {
            let Some(role) = self.motion.role(coordinate) else { continue };
            let name = coordinate.name();
            let certain = is_certain(role, problems);
            problems.within("motion", |p| {
                p.within(name, |p| {
                    if let Some(axis) = self.axis_of(role, p).filter(|axis| certain && axis.is_sound()) {
                        check_role(coordinate, role, &axis, p);
                    }
                    if let Some((_, _, other)) =
                        taken.iter().find(|(d, a, _)| *d == role.device && *a == role.axis)
                    {
                        p.push(
                            "axis",
                            format!("{}.{}", role.device, role.axis),
                            format!("an axis of its own (motion.{other} has this one)"),
                            "name another axis",
                        );
                    }
                });
            });
            taken.push((&role.device, &role.axis, name));
        }
    }

    /// The axis in a role, or why there is none.
    fn axis_of(&self, role: &AxisRole, problems: &mut Problems) -> Option<AxisSettings> {
        let devices: Vec<&str> = self.devices.keys().map(String::as_str).collect();
        let Some(device) = self.devices.get(&role.device) else {
            let next = near_or(&role.device, &devices, "name a device of this file");
            problems.push("device", format!("{:?}", role.device), devices.join(", "), next);
            return None;
        };
        let axis = device.pose_axes().remove(&role.axis);
        let names: Vec<String> = device.pose_axes().into_keys().collect();
        let axes: Vec<&str> = names.iter().map(String::as_str).collect();
        if axis.is_none() {
            let next = near_or(&role.axis, &axes, "name an axis of this device");
            problems.push("axis", format!("{:?}", role.axis), axes.join(", "), next);
        }
        axis
    }

    /// Either everything is virtual or nothing is: an indenter that a real axis moves is not seen by
    /// a virtual camera, nor the other way round. Answers whether everything is.
    fn check_reality(&self, problems: &mut Problems) -> bool {
        let is_empty = |d: &MoverSettings| matches!(&d.port, PortSettings::Path(p) if p.trim().is_empty());
        if let Some((name, _)) = self.devices.iter().find(|(_, d)| is_empty(d)) {
            let allowed = "\"virtual\", a path, or { vid = ..., pid = ... }";
            problems.push(&format!("devices.{name}.port"), "\"\"", allowed, "`twinrig devices` lists ports");
            return false; // What is real cannot be told.
        }
        let movers = self.devices.values().filter(|d| d.port.is_virtual()).count();
        let is_virtual = movers > 0 && movers == self.devices.len();
        if movers > 0 && !is_virtual {
            for (name, _) in self.devices.iter().filter(|(_, d)| d.port.is_virtual()) {
                problems.push(
                    &format!("devices.{name}.port"),
                    "\"virtual\"",
                    "a real port, since another device of this rig has one",
                    "make all devices virtual, or none",
                );
            }
        }
        match self.camera.source {
            CameraSource::Virtual if movers < self.devices.len() => problems.push(
                "camera.source",
                "\"virtual\"",
                "v4l, nokhwa or replay on a rig with real devices",
                "a virtual camera sees only what virtual devices move",
            ),
            CameraSource::V4l | CameraSource::Nokhwa if movers > 0 => problems.push(
                "camera.source",
                "a real camera",
                "virtual or replay on a rig with virtual devices",
                "a real camera does not see what virtual devices move",
            ),
            _ => {}
        }
        if self.sensor == ANY_SENSOR && !is_virtual {
            problems.push(
                "sensor",
                "\"any\"",
                "the one sensor that this bench carries",
                "name it: only a virtual bench offers all",
            );
        }
        match &self.world {
            Some(world) if is_virtual => {
                let offset = world.contact_offset_mm;
                problems.range("virtual.contact_offset_mm", offset, -5.0, 5.0, "mm");
            }
            Some(_) => {
                let next = "remove [virtual], or make every port \"virtual\"";
                problems.push("virtual", "a table", "no [virtual] table on a rig with real devices", next);
            }
            None => {}
        }
        is_virtual
    }
}

fn check_role(coordinate: Coordinate, role: &AxisRole, axis: &AxisSettings, problems: &mut Problems) {
    let wanted = if coordinate == Coordinate::Theta { AxisKind::Rotary } else { AxisKind::Linear };
    if axis.kind != wanted {
        let word = |kind| if kind == AxisKind::Rotary { "rotary" } else { "linear" };
        problems.push(
            "axis",
            format!("{:?}, a {} axis", role.axis, word(axis.kind)),
            format!("a {} axis", word(wanted)),
            "name another axis, or correct its kind",
        );
    }
    if role.sign.abs() != 1.0 {
        let next = "write 1 where the axis counts as the coordinate does, -1 where it runs the other way";
        problems.push("sign", role.sign, "1 or -1", next);
    }
    if !(axis.min..=axis.max).contains(&role.origin) {
        problems.push(
            "origin",
            role.origin,
            format!("{} to {} {}, the travel of {}", axis.min, axis.max, axis.kind.unit(), role.axis),
            "give the axis position at which the coordinate is 0",
        );
    }
    // Arriving from inside the pad would press deeper than the plan says, before every capture.
    if let (Coordinate::Z, Some(approach)) = (coordinate, axis.approach) {
        let outside = if role.sign > 0.0 { Side::Above } else { Side::Below };
        if approach.distance > 0.0 && approach.from != outside {
            let word = if outside == Side::Above { "above" } else { "below" };
            problems.push(
                "axis",
                format!("{:?}, which approaches from inside the pad", role.axis),
                format!("approach.from = \"{word}\", the side away from the pad"),
                format!("correct approach.from of devices.{}.axes.{}", role.device, role.axis),
            );
        }
    }
}

/// Ranges that hold for every solver; what a mode cannot do is said by the solver itself.
fn check_elastomer(settings: &elastomer::Settings, problems: &mut Problems) {
    let mut optional = |key: &str, value: Option<f64>, min: f64, max: f64, unit: &str| {
        if let Some(value) = value {
            problems.range(key, value, min, max, unit);
        }
    };
    optional("youngs_modulus_mpa", settings.youngs_modulus_mpa, 1e-4, 1e4, "MPa");
    optional("poisson_ratio", settings.poisson_ratio, 0.0, 0.499, "");
    optional("dx_mm", settings.dx_mm, 1e-3, 5.0, "mm");
    optional("dt_s", settings.dt_s, 1e-9, 1e-2, "s");
    problems.range("tolerance", settings.tolerance, 5e-4, 0.1, "of the depth");
    problems.range("speed_mm_s", settings.speed_mm_s, 1e-3, 1e4, "mm/s");
    problems.range("rest_threshold", settings.rest_threshold, 1e-6, 10.0, "");
    problems.range("rest_limit", f64::from(settings.rest_limit), 1.0, 10_000.0, "passes");
    problems.range("rest_floor_mm_s", settings.rest_floor_mm_s, 1e-6, 1e4, "mm/s");
    for (i, count) in settings.particles.iter().enumerate() {
        problems.range(&format!("particles.[{i}]"), *count as f64, 3.0, 4001.0, "particles");
    }
    for (i, count) in settings.surface.iter().enumerate() {
        problems.range(&format!("surface.[{i}]"), *count as f64, 2.0, 4001.0, "points");
    }
    check_skips(settings, problems);
}

/// What is left out must be there to be left out, once.
fn check_skips(settings: &elastomer::Settings, problems: &mut Problems) {
    for (i, skip) in settings.without.iter().enumerate() {
        let (key, word, mode) = (format!("without.[{i}]"), skip.name(), settings.mode);
        if settings.without[..i].contains(skip) {
            problems.push(&key, format!("\"{word}\" (named twice)"), "each skip once", "remove it");
        } else if !skip.modes().contains(&mode) {
            let users: Vec<String> = skip.modes().iter().map(|m| format!("\"{}\"", m.name())).collect();
            problems.push(
                &key,
                format!("\"{word}\" (no skip of elastomer.mode = \"{}\")", mode.name()),
                format!("with elastomer.mode = {}", users.join(" or ")),
                format!("leave it out, or choose elastomer.mode = {}", users[0]),
            );
        }
    }
}

impl OpticsTable {
    fn check(&self, problems: &mut Problems) {
        problems.range("samples", f64::from(self.samples), 1.0, 65_536.0, "samples a pixel");
        problems.range("tolerance", self.tolerance, TOLERANCES[0], TOLERANCES[1], "");
    }
}

impl SessionTable {
    fn check(&self, problems: &mut Problems) {
        problems.range("still_rms", self.still_rms, 0.1, 100.0, "code values");
        problems.range("frame_within_ms", self.frame_within_ms as f64, 100.0, 600_000.0, "ms");
        problems.range("warmup_frames", f64::from(self.warmup_frames), 0.0, 10_000.0, "frames");
        problems.range("touch_threshold", self.touch_threshold, 0.1, 255.0, "code values");
        problems.range("touch_feed_mm_s", self.touch_feed_mm_s, 1e-3, 10.0, "mm/s");
        problems.range("departure", self.departure, 1e-4, 10.0, "mm or degrees");
    }
}
