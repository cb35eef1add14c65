//! The camera of a sensor file.

use crate::problem::Problems;
use serde::{Deserialize, Serialize};

/// A camera that looks straight at the pad, its picture upright.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Columns of the picture.
    pub width_px: usize,
    /// Rows of the picture.
    pub height_px: usize,
    /// What a pixel sees of the undeformed face, mm.
    pub mm_per_px: f64,
    /// From the optical centre to the undeformed face, mm.
    pub distance_mm: f64,
    /// Where the optical axis meets the face, mm.
    #[serde(default)]
    pub center_mm: [f64; 2],
    /// Radial distortion coefficients k1, k2 (Brown; in units of the focal length).
    #[serde(default)]
    pub distortion: Option<[f64; 2]>,
    /// Radius of the aperture for depth of field, mm (focused on the undeformed face); 0 is a pinhole.
    #[serde(default)]
    pub aperture_radius_mm: f64,
}

impl CameraSpec {
    /// What it sees of the undeformed face, mm.
    pub fn view_mm(&self) -> [f64; 2] {
        [self.width_px as f64 * self.mm_per_px, self.height_px as f64 * self.mm_per_px]
    }

    pub(super) fn check(&self, p: &mut Problems) {
        p.range("width_px", self.width_px as f64, 8.0, 8192.0, "px");
        p.range("height_px", self.height_px as f64, 8.0, 8192.0, "px");
        p.range("mm_per_px", self.mm_per_px, 1e-4, 1.0, "mm");
        p.range("distance_mm", self.distance_mm, 0.5, 500.0, "mm");
        p.range("aperture_radius_mm", self.aperture_radius_mm, 0.0, 10.0, "mm");
        for (axis, value) in self.center_mm.iter().enumerate() {
            p.range(&format!("center_mm[{axis}]"), *value, -100.0, 100.0, "mm");
        }
        for (k, value) in self.distortion.iter().flatten().enumerate() {
            p.range(&format!("distortion[{k}]"), *value, -0.5, 0.5, "");
        }
    }
}
