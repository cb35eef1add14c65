//! The pad's face in a sensor file: coating, printed dots, the picture it wears.

use crate::problem::Problems;
use serde::{Deserialize, Serialize};

/// The coating of the pad's face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CoatingSpec {
    /// Diffuse reflectance where no texture says otherwise.
    pub albedo: f64,
    /// 1 is fully diffuse (the paper's choice); below, metal flakes show: their GGX alpha is the
    /// roughness squared.
    pub roughness: f64,
    /// Part of the area that metal flakes cover; left out, `1 - roughness`. With 1 the coat is a metal film.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flakes: Option<f64>,
}

impl Default for CoatingSpec {
    fn default() -> Self {
        Self { albedo: 0.5, roughness: 1.0, flakes: None }
    }
}

impl CoatingSpec {
    /// Part of the area that metal flakes cover.
    pub fn cover(&self) -> f64 {
        self.flakes.unwrap_or(1.0 - self.roughness)
    }

    pub(super) fn check(&self, p: &mut Problems) {
        p.range("albedo", self.albedo, 0.0, 0.99, "");
        p.range("roughness", self.roughness, 0.05, 1.0, "");
        if let Some(flakes) = self.flakes {
            p.range("flakes", flakes, 0.0, 1.0, "of the area");
        }
    }
}

/// Dots in rows and columns on the pad's face, printed on its coating.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerSpec {
    /// From dot to dot, mm (on the plane through the apex of a curved face, as the camera sees it).
    pub pitch_mm: f64,
    /// Of a dot, mm.
    pub diameter_mm: f64,
    /// Diffuse reflectance of the ink.
    #[serde(default = "default_ink")]
    pub albedo: f64,
    /// Where one of the dots is, pad frame, mm.
    #[serde(default)]
    pub offset_mm: [f64; 2],
    /// Root mean square by which a dot is off its place along x and y, part of the pitch.
    #[serde(default = "default_place_rms")]
    pub place_rms: f64,
    /// Root mean square by which a dot is larger or smaller than the others, and is longer than wide, part of the diameter.
    #[serde(default = "default_size_rms")]
    pub size_rms: f64,
    /// Root mean square of what a dot lets through of the coat under it.
    #[serde(default = "default_faint_rms")]
    pub faint_rms: f64,
    /// Which print of this kind: another number is another sensor's.
    #[serde(default)]
    pub seed: u32,
}

fn default_ink() -> f64 {
    0.05
}

// (What a careful print by hand or stencil has.)
fn default_place_rms() -> f64 {
    0.02
}

fn default_size_rms() -> f64 {
    0.03
}

fn default_faint_rms() -> f64 {
    0.04
}

impl MarkerSpec {
    pub(super) fn check(&self, p: &mut Problems) {
        p.range("pitch_mm", self.pitch_mm, 0.1, 50.0, "mm");
        // (A pitch that is none is told of above, and bounds nothing.)
        let widest = if (0.1..=50.0).contains(&self.pitch_mm) { self.pitch_mm } else { 50.0 };
        p.range("diameter_mm", self.diameter_mm, 0.02, widest, "mm, up to the pitch");
        p.range("albedo", self.albedo, 0.0, 0.99, "");
        for (axis, value) in self.offset_mm.iter().enumerate() {
            p.range(&format!("offset_mm[{axis}]"), *value, -100.0, 100.0, "mm");
        }
        p.range("place_rms", self.place_rms, 0.0, 0.05, "of the pitch");
        p.range("size_rms", self.size_rms, 0.0, 0.1, "of the diameter");
        p.range("faint_rms", self.faint_rms, 0.0, 0.3, "");
    }
}

/// Grain and specks of the coating, which a real one has and which ride on the face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GrainSpec {
    /// Root mean square by which the reflectance differs from its mean, relative, specks apart; 0 is none.
    pub rms: f64,
    /// How far apart two points are that have half of it in common, mm (on the plane through the apex of a curved face, as
    /// the camera sees it).
    pub size_mm: f64,
    /// Dark specks, in each mm^2.
    pub specks_per_mm2: f64,
    /// Width of a speck where it is half as dark as in its middle, mm; they are from half to twice as wide, and up to three
    /// times as long as wide.
    pub speck_mm: f64,
    /// How much darker the middle of a speck is, relative, on average; many are fainter, a few several times as dark
    /// (exponential).
    pub speck_depth: f64,
    /// Which coat of this kind: another number is another sensor's.
    pub seed: u32,
}

impl Default for GrainSpec {
    fn default() -> Self {
        Self { rms: 0.0, size_mm: 0.05, specks_per_mm2: 0.0, speck_mm: 0.3, speck_depth: 0.01, seed: 0 }
    }
}

impl GrainSpec {
    pub(super) fn check(&self, p: &mut Problems) {
        p.range("rms", self.rms, 0.0, 0.2, "");
        p.range("size_mm", self.size_mm, 0.01, 1.0, "mm");
        p.range("specks_per_mm2", self.specks_per_mm2, 0.0, 5.0, "in each mm^2");
        p.range("speck_mm", self.speck_mm, 0.02, 1.0, "mm");
        p.range("speck_depth", self.speck_depth, 0.0, 0.3, "");
    }

    /// Whether any of it shows.
    pub fn shows(&self) -> bool {
        self.rms > 0.0 || (self.specks_per_mm2 > 0.0 && self.speck_depth > 0.0)
    }
}

/// How the image of the untouched sensor becomes part of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TextureMode {
    /// The coating alone.
    None,
    /// The paper's way: the image is the albedo, and is lit again.
    Lit,
    /// The image times the ratio of deformed to untouched light: the untouched simulation is the untouched image.
    #[default]
    Ratio,
}
