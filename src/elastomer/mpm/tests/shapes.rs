//! Two plain indenters for the tests of this module.

use crate::indenter::Indenter;
use glam::{DVec2, DVec3};

/// A ball that touches the origin from above.
#[derive(Debug)]
pub struct Ball {
    pub radius_mm: f64,
}

impl Indenter for Ball {
    fn name(&self) -> &str {
        "ball"
    }

    fn distance(&self, p: DVec3) -> f64 {
        (p - DVec3::Z * self.radius_mm).length() - self.radius_mm
    }

    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let from_centre = p - DVec3::Z * self.radius_mm;
        (from_centre.length() - self.radius_mm, from_centre.normalize_or(DVec3::NEG_Z))
    }

    fn half_extent_mm(&self) -> [f64; 2] {
        [self.radius_mm; 2]
    }

    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let left = self.radius_mm.powi(2) - x_mm * x_mm - y_mm * y_mm;
        (left >= 0.0).then(|| self.radius_mm - left.sqrt())
    }
}

/// A flat round punch of some height.
#[derive(Debug)]
pub struct Punch {
    pub radius_mm: f64,
    pub height_mm: f64,
}

impl Indenter for Punch {
    fn name(&self) -> &str {
        "punch"
    }

    fn distance(&self, p: DVec3) -> f64 {
        let side = p.truncate().length() - self.radius_mm;
        let flat = (p.z - self.height_mm / 2.0).abs() - self.height_mm / 2.0;
        DVec2::new(side.max(0.0), flat.max(0.0)).length() + side.max(flat).min(0.0)
    }

    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let eps = 1e-6;
        let d = self.distance(p);
        let along = |e: DVec3| self.distance(p + e * eps) - self.distance(p - e * eps);
        (d, DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)).normalize_or(DVec3::NEG_Z))
    }

    fn half_extent_mm(&self) -> [f64; 2] {
        [self.radius_mm; 2]
    }

    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        (x_mm.hypot(y_mm) <= self.radius_mm).then_some(0.0)
    }
}
