//! A clear lens or dome of a sensor file: a solid that is round about the camera's axis.

use super::{CameraSpec, PlateSpec};
use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A clear solid between camera and pad, round about the camera's optical axis, each of its two faces flat or spherical. A
/// plano-convex lens has one radius, a dome under a domed pad has one that follows the pad's, a shell has two.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensSpec {
    /// From the undeformed face to the lens on the axis, mm (above the deepest press).
    pub gap_mm: f64,
    /// Thickness on the axis, mm.
    pub thickness_mm: f64,
    /// Across its rim, mm.
    pub diameter_mm: f64,
    /// Radius of the face towards the pad, mm: above 0 it bulges towards the pad, below 0 it is hollow; absent: flat.
    #[serde(default)]
    pub front_radius_mm: Option<f64>,
    /// Radius of the face towards the camera, mm: above 0 it bulges towards the camera, below 0 it is hollow; absent: flat.
    #[serde(default)]
    pub back_radius_mm: Option<f64>,
    /// Index of refraction (acrylic 1.49, silicone 1.41).
    pub ior: f64,
}

/// Faces flatter than this are flat, mm.
const FLATTEST_MM: f64 = 1e4;
/// Least thickness at the rim, and least distance from a plate, mm.
const LEAST_MM: f64 = 0.01;

/// Places at which a face is held against the lens: so many distances from the axis, in so many directions.
const RADII: usize = 40;
const DIRECTIONS: usize = 24;

/// A face of a lens: its height over the undeformed pad is `vertex + c r^2 / (1 + sqrt(1 - c^2 r^2))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensFace {
    /// Height on the axis, mm.
    pub vertex_mm: f64,
    /// The curvature c, above 0 where the face turns up towards its rim, 1/mm.
    pub curvature: f64,
}

impl LensFace {
    /// Its height so far from the axis, mm.
    pub fn height_mm(&self, r_mm: f64) -> f64 {
        let (c, r2) = (self.curvature, r_mm * r_mm);
        self.vertex_mm + c * r2 / (1.0 + (1.0 - c * c * r2).max(0.0).sqrt())
    }
}

impl LensSpec {
    /// The face towards the pad.
    pub fn front(&self) -> LensFace {
        LensFace { vertex_mm: self.gap_mm, curvature: self.front_radius_mm.map_or(0.0, |r| 1.0 / r) }
    }

    /// The face towards the camera.
    pub fn back(&self) -> LensFace {
        let vertex_mm = self.gap_mm + self.thickness_mm;
        LensFace { vertex_mm, curvature: self.back_radius_mm.map_or(0.0, |r| -1.0 / r) }
    }

    /// From the axis to the rim, mm.
    pub fn half_mm(&self) -> f64 {
        self.diameter_mm / 2.0
    }

    /// Its lowest and highest points over the undeformed face, mm.
    pub fn heights_mm(&self) -> [f64; 2] {
        let of = |face: LensFace| [face.vertex_mm, face.height_mm(self.half_mm())];
        let ([a, b], [c, d]) = (of(self.front()), of(self.back()));
        [a.min(b), c.max(d)]
    }

    /// Whether it fills a point so far from the axis and so high over the undeformed face, mm.
    pub fn contains(&self, r_mm: f64, height_mm: f64) -> bool {
        r_mm < self.half_mm()
            && height_mm > self.front().height_mm(r_mm)
            && height_mm < self.back().height_mm(r_mm)
    }

    /// The least distance, mm, from a face under it. `height_mm` gives the face's height at a point of the pad frame, or None
    /// beside it.
    pub fn clearance_mm(&self, center_mm: [f64; 2], height_mm: impl Fn([f64; 2]) -> Option<f64>) -> f64 {
        let front = self.front();
        let over = |k: usize| {
            let r = self.half_mm() * (k / DIRECTIONS) as f64 / RADII as f64;
            let (sin, cos) = (TAU * (k % DIRECTIONS) as f64 / DIRECTIONS as f64).sin_cos();
            let face = height_mm([center_mm[0] + r * cos, center_mm[1] + r * sin])?;
            Some(front.height_mm(r) - face)
        };
        (0..=RADII * DIRECTIONS).filter_map(over).fold(f64::INFINITY, f64::min)
    }

    pub(super) fn check(&self, camera: &CameraSpec, plate: Option<&PlateSpec>, p: &mut Problems) {
        let before = p.len();
        p.range("gap_mm", self.gap_mm, 0.1, 100.0, "mm");
        p.range("thickness_mm", self.thickness_mm, 0.05, 100.0, "mm");
        p.range("diameter_mm", self.diameter_mm, 0.5, 400.0, "mm");
        p.range("ior", self.ior, 1.0, 4.0, "");
        let radii = [("front_radius_mm", self.front_radius_mm), ("back_radius_mm", self.back_radius_mm)];
        for (key, radius) in radii.into_iter().filter_map(|(key, radius)| Some((key, radius?))) {
            let half = self.half_mm();
            if !(half..=FLATTEST_MM).contains(&radius.abs()) {
                p.push(
                    key,
                    radius,
                    format!("{half} to {FLATTEST_MM} mm, or as much below 0 (half of diameter_mm at least)"),
                    "lower diameter_mm, or leave the key out where the face is flat",
                );
            }
        }
        // Where its parts are follows from sound numbers only.
        if p.len() > before {
            return;
        }
        let rim = self.back().height_mm(self.half_mm()) - self.front().height_mm(self.half_mm());
        if rim < LEAST_MM {
            p.push(
                "thickness_mm",
                self.thickness_mm,
                format!("{LEAST_MM} mm or more at the rim, where its faces leave {rim:.3} mm"),
                "make the lens thicker or narrower, or its faces flatter",
            );
        }
        let top = self.back().vertex_mm;
        if top >= camera.distance_mm {
            p.push(
                "thickness_mm",
                self.thickness_mm,
                format!(
                    "the lens ends {top} mm above the face on its axis, below the camera at {} mm",
                    camera.distance_mm
                ),
                "make the lens thinner or move the camera away",
            );
        }
        if let Some([begins, ends]) = plate.map(PlateSpec::heights_mm) {
            let [low, high] = self.heights_mm();
            if low < ends + LEAST_MM && high > begins - LEAST_MM {
                p.push(
                    "gap_mm",
                    self.gap_mm,
                    format!(
                        "a lens off the plate by {LEAST_MM} mm: it is {low:.3} to {high:.3} mm above the face, the plate \
                         {begins} to {ends} mm"
                    ),
                    "move the lens above or below the plate, or leave one of them out",
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_bulge_to_the_side_that_their_sign_says() {
        let lens = LensSpec {
            gap_mm: 1.0,
            thickness_mm: 3.0,
            diameter_mm: 8.0,
            front_radius_mm: Some(5.0),
            back_radius_mm: Some(-5.0),
            ior: 1.5,
        };
        // Both turn up by 5 - 3 mm at the rim: a shell.
        assert!((lens.front().height_mm(4.0) - 3.0).abs() < 1e-12);
        assert!((lens.back().height_mm(4.0) - 6.0).abs() < 1e-12);
        assert_eq!(lens.heights_mm(), [1.0, 6.0]);
        assert!(lens.contains(0.0, 2.0) && !lens.contains(0.0, 4.5) && lens.contains(3.9, 4.5));
        let bulging = LensSpec { back_radius_mm: Some(5.0), thickness_mm: 4.5, ..lens.clone() };
        assert!((bulging.back().height_mm(4.0) - 3.5).abs() < 1e-12);
        assert_eq!(LensSpec { back_radius_mm: None, ..lens.clone() }.back().height_mm(3.0), 4.0);
        // Over a flat face it is nearest on the axis, over one that rises to the side there, and beside the pad nowhere.
        assert_eq!(lens.clearance_mm([0.0, 0.0], |_| Some(0.0)), 1.0);
        let bowl = |[x, y]: [f64; 2]| Some(0.2 * (x * x + y * y));
        assert!((lens.clearance_mm([0.0, 0.0], bowl) - (3.0 - 0.2 * 16.0)).abs() < 0.02);
        let narrow = |at: [f64; 2]| bowl(at).filter(|_| at[0].abs() < 1.0);
        assert!(
            lens.clearance_mm([0.0, 0.0], narrow)
                < lens.clearance_mm([0.0, 0.0], |at| bowl(at).filter(|h| *h < 0.2))
        );
    }
}
