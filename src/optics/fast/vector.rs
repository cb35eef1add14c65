//! Vector irradiance of a polygon: Lambert's formula before it is projected on a normal (which
//! [`irradiance`](crate::optics::irradiance) does, for the reference).
//!
//! Phi = 1/2 sum_i theta_i (v_i x v_i+1)/|v_i x v_i+1| (Arvo 1994, "The irradiance Jacobian for partially occluded
//! polyhedral sources", eq. 3). For a receiver above whose horizon the whole polygon lies, E = Phi . n: the normal
//! comes in at the end, and Phi is a smooth field over space that can be tabulated once.

use super::lanes::{Eight, Vectors, polynomial};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// Coefficients of Abramowitz and Stegun's 4.4.46: acos(c)/sqrt(1 - c) for c >= 0, to 2e-8.
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

/// Angle over sine of two unit vectors' angle, times their cross product.
///
/// Times sqrt(1 - c)/sin = 1/sqrt(1 + c) the polynomial is the factor angle/sin, in which nothing cancels for short
/// edges, at a fifth of the cost of atan2. Edges seen under more than a right angle use angle = pi - acos(-c), with the
/// sine from the cross product: near a wall 1 - c^2 has no digits left.
#[inline(always)]
pub fn edge(a: Vec3, b: Vec3) -> Vec3 {
    let cross = a.cross(b);
    let c = a.dot(b);
    let x = c.abs().min(1.0);
    let [a0, a1, a2, a3, a4, a5, a6, a7] = A;
    let sum = ((((((a7 * x + a6) * x + a5) * x + a4) * x + a3) * x + a2) * x + a1) * x + a0;
    let factor = sum / (1.0 + x).sqrt();
    let factor = if c >= 0.0 { factor } else { PI / cross.length().max(1e-20) - factor };
    cross * factor
}

/// The same for eight pairs at once.
#[inline(always)]
pub fn edges(a: Vectors, b: Vectors) -> Vectors {
    let cross = a.cross(b);
    let c = a.dot(b);
    let x = c.abs().min(Eight::all(1.0));
    let factor = polynomial(&A, x).over((Eight::all(1.0) + x).sqrt());
    let is_obtuse = c.below(Eight::all(0.0));
    // Few edges are seen under so wide an angle: a root and a quotient less for the others.
    if !is_obtuse.any() {
        return cross.scaled(factor);
    }
    let obtuse = Eight::all(PI).over(cross.dot(cross).sqrt().max(Eight::all(1e-20))) - factor;
    cross.scaled(is_obtuse.choose(obtuse, factor))
}

/// For radiance 1, of a quadrilateral as seen from eight points on its shining side.
#[inline(always)]
pub fn quadrilateral(corners: &[Vec3; 4], points: Vectors) -> Vectors {
    let unit = |k: usize| (Vectors::all(corners[k]) - points).unit();
    let (a, b, c, d) = (unit(0), unit(1), unit(2), unit(3));
    (edges(a, b) + edges(b, c) + edges(c, d) + edges(d, a)).scaled(Eight::all(-0.5))
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

/// What is seen under a smaller angle, radians, is taken for a point: there the sum over edges has lost its digits to what cancels
/// in it. (By then either errs by less than 5e-4.)
const POINT: f32 = 0.02;

/// Vector irradiance of a quadrilateral given relative to the receiver, for radiance 1, where it is as good as a point; None
/// where it is not.
#[inline(always)]
pub fn of_point([a, b, c, d]: [Vec3; 4]) -> Option<Vec3> {
    let middle = 0.25 * (a + b + c + d);
    let far2 = middle.length_squared();
    let across = (c - a).length_squared().max((d - b).length_squared());
    (across < POINT * POINT * far2).then(|| {
        let area = 0.5 * (c - a).cross(d - b);
        middle * ((-area.dot(middle)).max(0.0) / (far2 * far2))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_a_light_becomes_a_point_nothing_jumps_and_digits_are_kept() {
        let p = Vec3::new(3.0, -2.0, 0.2);
        let of_size = |size: f32| {
            let middle = LIGHT[0].lerp(LIGHT[2], 0.5);
            LIGHT.map(|c| (c - middle) * size + middle - p)
        };
        let exact = |size: f32| {
            let [a, b, _, d] = of_size(size).map(Vec3::as_dvec3);
            let middle = of_size(size).iter().map(|c| c.as_dvec3()).sum::<glam::DVec3>() / 4.0;
            middle * (-middle.dot((b - a).cross(d - a)) / middle.length_squared().powi(2))
        };
        for size in [1e-4, 1e-3, 0.02, 0.03] {
            let found = of_point(of_size(size)).unwrap_or(irradiance(&of_size(size))).as_dvec3();
            assert!((found - exact(size)).length() < 1e-3 * exact(size).length(), "{size}");
        }
        assert!(of_point(of_size(1e-3)).is_some() && of_point(of_size(1.0)).is_none());
    }

    const LIGHT: [Vec3; 4] = [
        Vec3::new(-10.0, -4.5, 4.0),
        Vec3::new(-10.0, 4.5, 4.0),
        Vec3::new(-10.0, 4.5, 6.0),
        Vec3::new(-10.0, -4.5, 6.0),
    ];

    #[test]
    fn above_the_horizon_its_product_with_the_normal_is_the_quadrature() {
        let (u, v) = (LIGHT[1] - LIGHT[0], LIGHT[3] - LIGHT[0]);
        let n = 200;
        for p in [Vec3::new(0.0, 0.0, 0.1), Vec3::new(-7.0, 3.0, 0.4), Vec3::new(9.0, -6.0, -0.2)] {
            let phi = irradiance(&LIGHT.map(|c| c - p)).as_dvec3();
            let mut truth = glam::DVec3::ZERO;
            for k in 0..n * n {
                let (s, t) = ((k % n) as f32 + 0.5, (k / n) as f32 + 0.5);
                let d = (LIGHT[0] + u * (s / n as f32) + v * (t / n as f32) - p).as_dvec3();
                let r2 = d.length_squared();
                truth += d * (-d.dot(u.cross(v).as_dvec3()) / (r2 * r2)) / f64::from(n * n);
            }
            assert!((phi - truth).length() < 1e-4 * truth.length(), "{p}: {phi} {truth}");
        }
    }

    #[test]
    fn eight_at_once_are_the_same_to_rounding() {
        for k in 1..100 {
            let angle = PI * k as f32 / 100.0;
            let b = Vec3::new(angle.cos(), angle.sin() * 0.6, angle.sin() * 0.8);
            let (one, eight) = (edge(Vec3::X, b), edges(Vectors::all(Vec3::X), Vectors::all(b)));
            assert!((one - Vec3::new(eight.x.0[3], eight.y.0[0], eight.z.0[7])).length() < 1e-6);
        }
    }
}
