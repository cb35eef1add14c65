//! An indenter where it is.

use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;

/// An indenter where it is.
pub struct Place<'a> {
    pub indenter: &'a dyn Indenter,
    pub half_extent_mm: [f64; 2],
    pose: &'a Pose,
    sin: f64,
    cos: f64,
}

impl<'a> Place<'a> {
    /// At this pose.
    pub fn of(indenter: &'a dyn Indenter, pose: &'a Pose) -> Self {
        let (sin, cos) = pose.theta_deg.to_radians().sin_cos();
        Self { indenter, half_extent_mm: indenter.half_extent_mm(), pose, sin, cos }
    }

    /// A point of the pad in the indenter's frame.
    #[inline]
    pub fn in_indenter(&self, p: DVec3) -> DVec3 {
        let (x, y) = (p.x - self.pose.x_mm, p.y - self.pose.y_mm);
        DVec3::new(self.cos * x + self.sin * y, -self.sin * x + self.cos * y, p.z - self.pose.z_mm)
    }

    /// A direction of the indenter's in the pad's frame.
    #[inline]
    pub fn to_pad(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y, v.z)
    }

    /// A symmetric matrix of the indenter's (xx, yy, zz, xy, xz, yz) in the pad's frame.
    pub fn matrix_to_pad(&self, m: &[f64; 6]) -> [f64; 6] {
        let (s, c) = (self.sin, self.cos);
        let [xx, yy, zz, xy, xz, yz] = *m;
        [
            c * c * xx - 2.0 * c * s * xy + s * s * yy,
            s * s * xx + 2.0 * c * s * xy + c * c * yy,
            zz,
            c * s * (xx - yy) + (c * c - s * s) * xy,
            c * xz - s * yz,
            s * xz + c * yz,
        ]
    }
}
