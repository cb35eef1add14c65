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
    /// roughness squared and they cover `1 - roughness` of the area.
    pub roughness: f64,
}

impl Default for CoatingSpec {
    fn default() -> Self {
        Self { albedo: 0.5, roughness: 1.0 }
    }
}

impl CoatingSpec {
    pub(super) fn check(&self, p: &mut Problems) {
        p.range("albedo", self.albedo, 0.0, 0.99, "");
        p.range("roughness", self.roughness, 0.05, 1.0, "");
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
}

fn default_ink() -> f64 {
    0.05
}

impl MarkerSpec {
    pub(super) fn check(&self, p: &mut Problems) {
        p.range("pitch_mm", self.pitch_mm, 0.1, 50.0, "mm");
        p.range("diameter_mm", self.diameter_mm, 0.02, self.pitch_mm.max(0.02), "mm, up to the pitch");
        p.range("albedo", self.albedo, 0.0, 0.99, "");
        for (axis, value) in self.offset_mm.iter().enumerate() {
            p.range(&format!("offset_mm[{axis}]"), *value, -100.0, 100.0, "mm");
        }
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
