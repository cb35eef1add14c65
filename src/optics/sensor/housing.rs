//! The box and the clear plate of a sensor file.

use super::CameraSpec;
use crate::problem::Problems;
use serde::{Deserialize, Serialize};

/// A box around the pad's face, open towards the pad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HousingSpec {
    /// Inner extent in x, mm, the smaller end first.
    pub x_mm: [f64; 2],
    /// Inner extent in y, mm, the smaller end first.
    pub y_mm: [f64; 2],
    /// From the undeformed face to the ceiling, mm.
    pub height_mm: f64,
    /// How far the walls reach past the undeformed face, mm (a pressed pad bulges).
    #[serde(default = "default_skirt")]
    pub skirt_mm: f64,
    /// Diffuse reflectance of walls and ceiling.
    pub albedo: f64,
}

fn default_skirt() -> f64 {
    0.5
}

/// The least and the greatest height of a ceiling, mm.
const HEIGHTS_MM: [f64; 2] = [0.5, 500.0];

impl HousingSpec {
    /// Whether there is anything between its walls and under its ceiling.
    pub(super) fn has_inside(&self) -> bool {
        let [low, high] = HEIGHTS_MM;
        [self.x_mm, self.y_mm].iter().all(|ends| ends[0] < ends[1]) && (low..=high).contains(&self.height_mm)
    }

    pub(super) fn check(&self, camera: &CameraSpec, p: &mut Problems) {
        p.range("albedo", self.albedo, 0.0, 0.95, "");
        let before = p.len();
        p.range("height_mm", self.height_mm, HEIGHTS_MM[0], HEIGHTS_MM[1], "mm");
        let is_ceiling = p.len() == before;
        p.range("skirt_mm", self.skirt_mm, 0.0, 10.0, "mm");
        for (axis, (key, extent)) in [("x_mm", self.x_mm), ("y_mm", self.y_mm)].into_iter().enumerate() {
            if extent[0] >= extent[1] {
                let [a, b] = extent;
                let next = match a > b {
                    true => format!("swap them: {key} = [{b:?}, {a:?}]"),
                    false => "give two walls that are apart".to_owned(),
                };
                p.push(key, format!("{extent:?}"), "two ends, the smaller one first", next);
                continue;
            }
            let half = camera.view_mm()[axis] / 2.0;
            let (low, high) = (camera.center_mm[axis] - half, camera.center_mm[axis] + half);
            if !(extent[0] <= low && extent[1] >= high) {
                p.push(
                    key,
                    format!("{extent:?}"),
                    format!("walls outside the view, which is {low} to {high} mm"),
                    "move the walls out, or lower camera.mm_per_px",
                );
            }
        }
        if is_ceiling && camera.distance_mm >= self.height_mm {
            p.push(
                "height_mm",
                self.height_mm,
                format!("above the camera, which is {} mm from the face", camera.distance_mm),
                "raise the ceiling: the camera stands inside the box",
            );
        }
    }
}

/// A clear plate with flat faces, parallel to the undeformed face; it fills the housing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlateSpec {
    /// From the undeformed face to the nearer side of the plate, mm (above the deepest press).
    pub gap_mm: f64,
    /// Thickness, mm.
    pub thickness_mm: f64,
    /// Index of refraction (acrylic 1.49).
    pub ior: f64,
    /// Of its faces: 0 is polished; a frosted plate's GGX alpha is the roughness squared.
    #[serde(default, skip_serializing_if = "is_polished")]
    pub roughness: f64,
}

fn is_polished(roughness: &f64) -> bool {
    *roughness == 0.0
}

impl PlateSpec {
    /// Whether anything of it shows: a polished one of air's index bends no light.
    pub fn shows(&self) -> bool {
        self.ior != 1.0 || self.roughness > 0.0
    }

    /// Its sides' heights over the undeformed face, mm.
    pub fn heights_mm(&self) -> [f64; 2] {
        [self.gap_mm, self.gap_mm + self.thickness_mm]
    }

    pub(super) fn check(&self, camera: &CameraSpec, p: &mut Problems) {
        p.range("gap_mm", self.gap_mm, 0.1, 100.0, "mm");
        p.range("thickness_mm", self.thickness_mm, 0.05, 100.0, "mm");
        p.range("ior", self.ior, 1.0, 4.0, "");
        p.range("roughness", self.roughness, 0.0, 1.0, "");
        let [_, top] = self.heights_mm();
        if top >= camera.distance_mm {
            p.push(
                "thickness_mm",
                self.thickness_mm,
                format!(
                    "the plate ends {top} mm above the face, below the camera at {} mm",
                    camera.distance_mm
                ),
                "make the plate thinner or move the camera away",
            );
        }
    }
}
