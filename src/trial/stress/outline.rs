//! What the checks have to know of a body's shape.

use crate::indenter::Indenter;
use glam::{DVec2, DVec3};

/// Area of a body's walls up to a height above its tip, as seen by who stands in its way, mm^2; walls behind openings count, too.
pub fn frontal_mm2(body: &dyn Indenter, height_mm: f64, direction_deg: f64) -> f64 {
    const STEP_MM: f64 = 0.05;
    let along = DVec2::from_angle(direction_deg.to_radians());
    let [hx, hy] = body.half_extent_mm();
    let n = (hx.hypot(hy) / STEP_MM).ceil() as i32 + 1;
    let height = |i: i32, j: i32| {
        let p = STEP_MM * (f64::from(i) * along + f64::from(j) * along.perp());
        body.lower_surface(p.x, p.y).map_or(height_mm, |low| low.min(height_mm))
    };
    // What falls along the way rises again.
    let falls = |j: i32| (-n..n).map(|i| (height(i, j) - height(i + 1, j)).max(0.0)).sum::<f64>();
    (-n..=n).map(falls).sum::<f64>() * STEP_MM
}

/// Whether a body is its own mirror image in x and in y.
pub fn is_mirrored(body: &dyn Indenter) -> bool {
    let [hx, hy] = body.half_extent_mm();
    let at = |k: u32, half: f64, step: f64| half * ((f64::from(k) * step).fract() * 2.2 - 1.1);
    (0..200).all(|k| {
        let p = DVec3::new(at(k, hx, 0.618), at(k, hy, 0.414), 0.3 * f64::from(k % 7));
        let d = body.distance(p);
        [[-1.0, 1.0], [1.0, -1.0]]
            .iter()
            .all(|m| (body.distance(DVec3::new(m[0] * p.x, m[1] * p.y, p.z)) - d).abs() < 1e-9)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::scene;

    #[test]
    fn a_sphere_is_its_own_mirror_image_and_a_skew_body_is_not() {
        assert!(is_mirrored(scene::sphere(3.0).as_ref()));
        let plan =
            crate::indenter::spec::Plan::Polygon { corners_mm: vec![[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]] };
        let shape = crate::indenter::spec::Shape::Flat { plan };
        let skew = crate::indenter::from_spec("skew", &scene::spec(shape, 0.0), None).expect("a triangle");
        assert!(!is_mirrored(skew.as_ref()));
    }

    #[test]
    fn walls_are_as_wide_as_they_are_high_and_a_ball_as_its_cut() {
        for degrees in [0.0, 30.0, 90.0] {
            let punch = frontal_mm2(scene::punch(4.0, 0.0).as_ref(), 0.5, degrees);
            assert!((punch / 2.0 - 1.0).abs() < 0.05, "{punch} mm2");
            // A segment of a circle: R 3, 0.5 high.
            let (radius, angle) = (3.0f64, (2.5f64 / 3.0).acos());
            let segment = radius * radius * (angle - angle.sin() * angle.cos());
            let ball = frontal_mm2(scene::sphere(radius).as_ref(), 0.5, degrees);
            assert!((ball / segment - 1.0).abs() < 0.05, "{ball} mm2");
        }
    }
}
