//! What is known about each side of a capture: the columns of the dataset, before they are joined.

use crate::pose::Pose;
use serde::{Deserialize, Serialize};

/// The real side of a capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RealRecord {
    /// Which run over the plan took it; see `journal/sessions.ndjson`.
    pub session: String,
    /// Whether the frame was made up by the virtual bench.
    pub is_virtual: bool,
    /// Pose asked for, relative to the contact zero.
    pub commanded: Pose,
    /// Pose reported by the devices, relative to the contact zero.
    pub measured: Pose,
    /// Height of the contact in the frame of the nominal contact, mm.
    pub contact_zero_mm: f64,
    /// `given` or `touch_off`.
    pub contact_method: String,
    /// Each axis involved.
    pub axes: Vec<AxisRecord>,
    /// Whether the measured pose departs from the commanded one by more than the tolerance.
    pub departed: bool,
    /// Instant at which the exposure can have begun, monotonic clock, ns.
    pub exposed_mono_ns: i64,
    /// Instant at which all motion had settled, monotonic clock, ns.
    pub settled_mono_ns: i64,
    /// Wall clock, ns since 1970 UTC.
    pub utc_ns: i64,
    /// From motion complete to the exposure, ms.
    pub settle_ms: f64,
    /// Difference of the last two frames, code values.
    pub still_rms: f64,
    /// The source's running number of the frame.
    pub frame_sequence: u32,
    /// The driver's flags.
    pub frame_flags: u32,
    /// Frames lost immediately before.
    pub dropped_before: u32,
    /// Exposures averaged.
    pub frames_averaged: u16,
    /// Exposure time, us, if known.
    pub exposure_us: Option<f64>,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// The source's pixel format.
    pub fourcc: String,
    /// Difference between the background in force and the first one, code values.
    pub drift_rms: f64,
}

/// One axis of one device at a capture, in mm or degrees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisRecord {
    /// Device of the rig file.
    pub device: String,
    /// Axis of the device.
    pub axis: String,
    /// Position asked for.
    pub commanded: f64,
    /// Position reported.
    pub measured: f64,
}

/// The simulated side of a capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimRecord {
    /// Hash of everything that determines the simulation.
    pub config_hash: String,
    /// Version of the program.
    pub engine_version: String,
    /// Pose that was followed.
    pub pose: Pose,
    /// `commanded` or `measured`.
    pub poses: String,
    /// Elastomer mode.
    pub elastomer_mode: String,
    /// Constitutive law.
    pub law: String,
    /// Young's modulus, MPa.
    pub youngs_modulus_mpa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Friction coefficient; absent when infinite.
    pub friction: Option<f64>,
    /// Optics mode.
    pub optics_mode: String,
    /// Samples per pixel, where that is what was chosen.
    pub spp: Option<u32>,
    /// Seed of everything random.
    pub seed: u64,
    /// Time spent on the elastomer since the capture before on the same path, ms.
    pub elastomer_ms: f64,
    /// Time spent on the picture, ms.
    pub render_ms: f64,
    /// Force that pushes the indenter away, N.
    pub normal_force_n: f64,
    /// Tangential force along x and y, N.
    pub shear_force_n: [f64; 2],
    /// Torque about the indenter's axis, N mm.
    pub torque_n_mm: f64,
    /// Area in contact as it is seen along z, mm^2.
    pub contact_area_mm2: f64,
    /// How much of its grip a contact with infinite friction is sure to have kept (1 up to a way of twice the depth, 0 once it has torn
    /// loose); absent otherwise.
    pub held: Option<f64>,
    /// Bounding box of the contact on the picture: x0, y0, x1, y1 (exclusive), pixels; absent without contact.
    pub contact_box_px: Option<[u32; 4]>,
    /// Steps or Newton iterations.
    pub iterations: u64,
    /// Mean passes per step of the relative-rest loop.
    pub passes_per_step: f64,
    /// How often that loop ran into its limit.
    pub limit_hits: u64,
    /// Particles or quadrature points.
    pub particles: u64,
    /// Residual reported by the solver.
    pub residual: f64,
    /// Error of the surface relative to depth, as the solver estimates it.
    pub estimated_error: Option<f64>,
    /// relRMSE of the picture's light, as the fast mode estimates it; in the reference mode its noise.
    pub light_error: Option<f64>,
    /// Whether that is within the tolerance asked for; absent where none was.
    pub light_meets_tolerance: Option<bool>,
}

/// What the comparison of the two sides says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PairMetrics {
    /// Whole picture, simulated against real.
    pub full: ImageScores,
    /// Contact region only; absent without contact.
    pub contact: Option<ImageScores>,
    /// Whole picture, untouched sensor against real.
    pub null_full: ImageScores,
    /// Contact region, untouched sensor against real.
    pub null_contact: Option<ImageScores>,
}

/// Scores of one picture against another, 8-bit RGB.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ImageScores {
    /// Mean squared error, code values squared.
    pub mse: f64,
    /// Peak signal to noise ratio, dB; infinite for equal pictures.
    pub psnr_db: f64,
    /// Structural similarity, 1 for equal pictures.
    pub ssim: f64,
}
