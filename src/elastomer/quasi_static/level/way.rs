//! Ways of the indenter from pose to pose.

use crate::pose::Pose;

/// The way from one pose to another as four numbers, a degree counting as 0.05 mm.
pub(super) fn way_between(a: &Pose, b: &Pose) -> [f64; 4] {
    [b.x_mm - a.x_mm, b.y_mm - a.y_mm, b.z_mm - a.z_mm, 0.05 * (b.theta_deg - a.theta_deg)]
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
