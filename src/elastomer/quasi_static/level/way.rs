//! Ways of the indenter from pose to pose.

use crate::pose::Pose;

/// Less than this is one minus the cosine of no corner.
const STRAIGHT: f64 = 1e-9;

/// What a degree counts as, mm.
const DEGREE_MM: f64 = 0.05;

/// The way from one pose to another as four numbers, a degree counting as 0.05 mm.
pub(super) fn way_between(a: &Pose, b: &Pose) -> [f64; 4] {
    [b.x_mm - a.x_mm, b.y_mm - a.y_mm, b.z_mm - a.z_mm, DEGREE_MM * (b.theta_deg - a.theta_deg)]
}

/// How far a way turns, radians.
pub(super) fn turn_of(way: &[f64; 4]) -> f64 {
    (way[3] / DEGREE_MM).to_radians()
}

/// How much of a way leads along the face, turns counted in.
pub(super) fn along_face(way: &[f64; 4]) -> f64 {
    way[0].hypot(way[1]).hypot(way[3])
}

/// Whether a way leads along the face, or turns on it.
pub(super) fn drags(way: &[f64; 4]) -> bool {
    along_face(way) > 0.0
}

/// How many times `last` goes into `way`, if they point the same way.
pub(super) fn along(way: &[f64; 4], last: &[f64; 4]) -> Option<f64> {
    let dot = |a: &[f64; 4], b: &[f64; 4]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
    let (ww, ll, wl) = (dot(way, way), dot(last, last), dot(way, last));
    (ll > 0.0 && wl > 0.95 * (ww * ll).sqrt()).then(|| (wl / ll).min(2.0))
}

/// The ends of the straight parts of a way.
pub fn corners<'a>(poses: impl Iterator<Item = &'a Pose>) -> Vec<Pose> {
    let mut corners: Vec<Pose> = Vec::new();
    for pose in poses {
        if let [.., before, last] = corners[..]
            && goes_on(&way_between(&before, &last), &way_between(&last, pose))
        {
            corners.pop();
        }
        corners.push(*pose);
    }
    corners
}

/// Whether two ways point the same way but for rounding.
fn goes_on(first: &[f64; 4], next: &[f64; 4]) -> bool {
    let dot = |a: &[f64; 4], b: &[f64; 4]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
    let both = (dot(first, first) * dot(next, next)).sqrt();
    dot(first, next) >= (1.0 - STRAIGHT) * both
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_has_corners_where_it_turns() {
        let at = |x_mm: f64, z_mm: f64| Pose::new(x_mm, 0.0, z_mm, 0.0);
        let way = [at(0.0, 0.3), at(0.0, -0.1), at(0.0, -0.4), at(0.1, -0.4), at(0.3, -0.4), at(0.2, -0.4)];
        let found = corners(way.iter());
        assert_eq!(found, [way[0], way[2], way[4], way[5]]);
        assert_eq!(corners(way[..1].iter()), [way[0]]);
    }
}
