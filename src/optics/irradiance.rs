//! Irradiance of a polygonal Lambertian light, in closed form.
//!
//! Lambert's formula: E = L/2 sum_i theta_i n . (v_i x v_i+1)/|v_i x v_i+1|, where v_i are the unit
//! directions to the corners and theta_i the angles between neighbours (Lambert 1760; Arvo 1995, eq. 2.1.5).
//! The polygon is first clipped at the receiver's horizon; the sum itself is the vector of
//! [`vector`](super::fast::vector), projected on the normal.

use super::fast::vector::{edge, of_point};
use glam::{Vec3, Vec4};

/// Irradiance at `point` with unit normal `normal` from a convex polygon of radiance 1 whose corners run
/// counter-clockwise as seen from its shining side. Points behind the light get 0.
pub fn polygon(point: Vec3, normal: Vec3, corners: &[Vec3; 4]) -> f32 {
    let [a, b, c, d] = *corners;
    let v = [a - point, b - point, c - point, d - point];
    // In front of the light? Its normal is u x v of the corner order.
    let shining = (v[1] - v[0]).cross(v[3] - v[0]);
    // A point in its plane must not be taken for one in front by rounding: the plane would fill its sky.
    if shining.dot(v[0]) >= -1e-6 * (shining.length() * v[0].length()) {
        return 0.0;
    }
    if let Some(phi) = of_point(v) {
        return phi.dot(normal).max(0.0);
    }
    let heights = [v[0].dot(normal), v[1].dot(normal), v[2].dot(normal), v[3].dot(normal)];
    let [lowest, highest] = [Vec4::from(heights).min_element(), Vec4::from(heights).max_element()];
    if highest <= 0.0 {
        return 0.0;
    }
    let sum = if lowest >= 0.0 {
        let unit = |k: usize| v[k].normalize_or_zero();
        let u = [unit(0), unit(1), unit(2), unit(3)];
        (edge(u[0], u[1]) + edge(u[1], u[2]) + edge(u[2], u[3]) + edge(u[3], u[0])).dot(normal)
    } else {
        clipped(&v, &heights, normal)
    };
    // Seen from the receiver the corners run clockwise, hence the sign.
    (-0.5 * sum).max(0.0)
}

/// The sum over the part above the horizon; its edge along the horizon is counted, too (the formula
/// needs a closed polygon), but the horizon's great circle has its normal along the receiver's.
fn clipped(v: &[Vec3; 4], heights: &[f32; 4], normal: Vec3) -> f32 {
    let mut kept = [Vec3::ZERO; 5];
    let mut n = 0;
    for i in 0..4 {
        let k = (i + 1) % 4;
        if heights[i] >= 0.0 {
            kept[n] = v[i].normalize_or_zero();
            n += 1;
        }
        if (heights[i] > 0.0 && heights[k] < 0.0) || (heights[i] < 0.0 && heights[k] > 0.0) {
            let s = heights[i] / (heights[i] - heights[k]);
            kept[n] = (v[i] + (v[k] - v[i]) * s).normalize_or_zero();
            n += 1;
        }
    }
    let mut sum = Vec3::ZERO;
    for i in 0..n {
        sum += edge(kept[i], kept[if i + 1 == n { 0 } else { i + 1 }]);
    }
    sum.dot(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// E by the midpoint rule over the light's area.
    fn quadrature(point: Vec3, normal: Vec3, corners: &[Vec3; 4]) -> f64 {
        let (u, v) = (corners[1] - corners[0], corners[3] - corners[0]);
        let area_normal = u.cross(v);
        let n = 400;
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let y = corners[0] + u * ((i as f32 + 0.5) / n as f32) + v * ((j as f32 + 0.5) / n as f32);
                let d = (y - point).as_dvec3();
                let r2 = d.length_squared();
                let at_light = (-d.dot(area_normal.as_dvec3())).max(0.0);
                sum += d.dot(normal.as_dvec3()).max(0.0) * at_light / (r2 * r2);
            }
        }
        sum / f64::from(n * n)
    }

    const BLUE: [Vec3; 4] = [
        Vec3::new(-10.0, -4.5, 4.0),
        Vec3::new(-10.0, 4.5, 4.0),
        Vec3::new(-10.0, 4.5, 6.0),
        Vec3::new(-10.0, -4.5, 6.0),
    ];

    #[test]
    fn the_formula_agrees_with_quadrature_above_and_across_the_horizon() {
        for (point, normal) in [
            (Vec3::new(0.0, 0.0, 0.0), Vec3::Z),
            (Vec3::new(-9.0, 3.0, 0.5), Vec3::new(0.3, -0.2, 0.9)),
            (Vec3::new(5.0, -7.0, 1.0), Vec3::new(0.5, 0.1, 0.2)),
            (Vec3::new(9.0, 0.0, 4.9), Vec3::new(-0.1, 0.0, 1.0)),
            (Vec3::new(-6.0, 0.0, 5.0), Vec3::Z),
            (Vec3::new(-6.0, 1.0, 5.0), Vec3::Y),
            (Vec3::new(-6.0, 1.0, 5.0), Vec3::X),
            (Vec3::new(-6.0, 1.0, 5.0), Vec3::NEG_X),
        ] {
            let normal = normal.normalize();
            let (value, truth) = (f64::from(polygon(point, normal, &BLUE)), quadrature(point, normal, &BLUE));
            assert!(
                (value - truth).abs() < 2e-4 * truth.max(1e-3),
                "{point} {normal}: {value} against {truth}"
            );
        }
    }

    #[test]
    fn every_angle_is_as_good_as_single_precision() {
        for k in 1..1000 {
            let angle = std::f64::consts::PI * f64::from(k) / 1000.0;
            let b = Vec3::new(angle.cos() as f32, angle.sin() as f32, 0.0);
            assert!((f64::from(edge(Vec3::X, b).z) - angle).abs() < 1e-6, "{angle}");
        }
    }

    #[test]
    fn the_walls_of_a_closed_room_fill_the_sky_of_each_even_near_its_edges() {
        let h = Vec3::new(2.0, 3.0, 4.0);
        let axes = [Vec3::X * h.x, Vec3::Y * h.y, Vec3::Z * h.z];
        let walls: Vec<[Vec3; 4]> = (0..6)
            .map(|k| {
                let sign = if k % 2 == 0 { -1.0 } else { 1.0 };
                let (c, u, v) = (axes[k / 2] * sign, axes[(k / 2 + 1) % 3] * -sign, axes[(k / 2 + 2) % 3]);
                [c - u - v, c + u - v, c + u + v, c - u + v]
            })
            .collect();
        for (k, wall) in walls.iter().enumerate() {
            let (u, v) = (wall[1] - wall[0], wall[3] - wall[0]);
            let normal = u.cross(v).normalize();
            for s in [1e-4, 3e-3, 0.1, 0.37, 0.8, 0.999, 0.99999] {
                for t in [1e-5, 2e-3, 0.2, 0.5, 0.9, 0.9999] {
                    let point = wall[0] + u * s + v * t;
                    let others = walls.iter().enumerate().filter(|(j, _)| *j != k);
                    let sum: f32 = others.map(|(_, w)| polygon(point, normal, w)).sum();
                    assert!((sum / std::f32::consts::PI - 1.0).abs() < 5e-3, "{point}: {sum}");
                }
            }
        }
    }

    #[test]
    fn behind_the_light_and_below_the_horizon_it_is_dark() {
        assert_eq!(polygon(Vec3::new(-11.0, 0.0, 5.0), Vec3::X, &BLUE), 0.0);
        assert_eq!(polygon(Vec3::new(0.0, 0.0, 7.0), Vec3::Z, &BLUE), 0.0);
        assert_eq!(polygon(Vec3::new(-10.0, 0.0, 1.0), Vec3::Z, &BLUE), 0.0);
    }

    #[test]
    fn a_light_that_fills_the_sky_gives_pi() {
        let far = 1e4;
        let sky = [[-far, -far], [-far, far], [far, far], [far, -far]].map(|[x, y]| Vec3::new(x, y, 1.0));
        let e = polygon(Vec3::ZERO, Vec3::Z, &sky);
        assert!((e - std::f32::consts::PI).abs() < 1e-3, "{e}");
    }
}
