//! Vector irradiance of a polygon: Lambert's formula before it is projected on a normal.
//!
//! Phi = 1/2 sum_i theta_i (v_i x v_i+1)/|v_i x v_i+1| (Arvo 1994, "The irradiance Jacobian for partially occluded
//! polyhedral sources", eq. 3). For a receiver above whose horizon the whole polygon lies, E = Phi . n: the normal
//! comes in at the end, and Phi is a smooth field over space that can be tabulated once.

use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// Angle over sine of two unit vectors' angle, times their cross product. The polynomial is Abramowitz and
/// Stegun's 4.4.46 (see [`crate::optics::irradiance`]).
#[inline(always)]
fn edge(a: Vec3, b: Vec3) -> Vec3 {
    const A: [f32; 8] = [
        FRAC_PI_2,
        -0.214_598_8,
        0.088_978_99,
        -0.050_174_305,
        0.030_891_88,
        -0.017_088_126,
        0.006_670_09,
        -0.001_262_491_1,
    ];
    let cross = a.cross(b);
    let c = a.dot(b);
    let x = c.abs().min(1.0);
    let factor = A.iter().rev().fold(0.0, |sum, a| sum * x + a) / (1.0 + x).sqrt();
    let factor = if c >= 0.0 { factor } else { PI / cross.length().max(1e-20) - factor };
    cross * factor
}

/// For radiance 1, of a polygon given relative to the receiver, its corners counter-clockwise as seen from its
/// shining side. Corners may coincide.
pub fn irradiance(corners: &[Vec3]) -> Vec3 {
    let Some(last) = corners.last() else { return Vec3::ZERO };
    let mut before = last.normalize_or_zero();
    let mut sum = Vec3::ZERO;
    for corner in corners {
        let unit = corner.normalize_or_zero();
        sum += edge(before, unit);
        before = unit;
    }
    -0.5 * sum
}

/// A convex polygon of a few corners.
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    corners: [Vec3; 8],
    len: usize,
}

impl Polygon {
    /// A quadrilateral.
    pub fn quad(corners: [Vec3; 4]) -> Self {
        let mut all = [Vec3::ZERO; 8];
        all[..4].copy_from_slice(&corners);
        Self { corners: all, len: 4 }
    }

    /// Its corners.
    pub fn corners(&self) -> &[Vec3] {
        &self.corners[..self.len]
    }

    /// The part on the positive side of the plane through the origin.
    pub fn clip(&self, normal: Vec3) -> Self {
        let mut out = Self { corners: [Vec3::ZERO; 8], len: 0 };
        for i in 0..self.len {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % self.len]);
            let (ha, hb) = (a.dot(normal), b.dot(normal));
            if ha >= 0.0 && out.len < 8 {
                out.corners[out.len] = a;
                out.len += 1;
            }
            if (ha >= 0.0) != (hb >= 0.0) && out.len < 8 {
                out.corners[out.len] = a + (b - a) * (ha / (ha - hb));
                out.len += 1;
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::irradiance::polygon;

    const LIGHT: [Vec3; 4] = [
        Vec3::new(-10.0, -4.5, 4.0),
        Vec3::new(-10.0, 4.5, 4.0),
        Vec3::new(-10.0, 4.5, 6.0),
        Vec3::new(-10.0, -4.5, 6.0),
    ];

    #[test]
    fn projected_and_clipped_it_is_the_irradiance() {
        for p in [Vec3::new(0.0, 0.0, 0.1), Vec3::new(-7.0, 3.0, 0.4), Vec3::new(9.0, -6.0, -0.2)] {
            for n in [Vec3::Z, Vec3::new(0.5, 0.2, 0.8), Vec3::new(0.45, -0.1, 0.7), Vec3::NEG_X] {
                let n = n.normalize();
                let quad = Polygon::quad(LIGHT.map(|c| c - p));
                let e = irradiance(quad.clip(n).corners()).dot(n);
                let truth = polygon(p, n, &LIGHT);
                assert!((e - truth).abs() < 2e-6 + 1e-4 * truth, "{p} {n}: {e} {truth}");
            }
        }
    }

    #[test]
    fn parts_add_up() {
        let quad = Polygon::quad(LIGHT.map(|c| c - Vec3::new(1.0, 2.0, 0.3)));
        let cut = Vec3::new(0.3, 0.7, 0.5);
        let sum = irradiance(quad.clip(cut).corners()) + irradiance(quad.clip(-cut).corners());
        assert!((sum - irradiance(quad.corners())).length() < 1e-6);
    }
}
