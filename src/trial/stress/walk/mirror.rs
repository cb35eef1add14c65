//! Mirror images: a slide to the left and one to the right.

use super::Walk;
use super::slide::slide;
use crate::elastomer::{ElastomerCapture, Error};
use glam::Vec3;

/// A slide to the left mirrors one to the right, at every waypoint.
///
/// An error that is stated is a root mean square over what is scored ([`scored_mm`]); single points may be off by more, as of what
/// touches they may. What sticks and tears on one side otherwise than on the other is told by the part of its grip that it is
/// sure to have kept: with the rest points may have come along or not, and drag as much more or less.
pub(super) fn mirror(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    walk.go(walk.at(-case.depth_mm))?;
    let forked = walk.solver.fork();
    let (start, pressed) = (walk.pose, walk.last.clone());
    let right = slide(walk, case.slide_mm, 0.0)?;
    (walk.solver, walk.pose, walk.last) = (forked, start, pressed);
    let left = slide(walk, case.slide_mm, 180.0)?;
    let stride_mm = case.slide_mm / right.len() as f64;
    for (n, (right, left)) in right.iter().zip(&left).enumerate() {
        let stated = |c: &ElastomerCapture| c.stats.estimated_error.unwrap_or(0.0);
        let claim = stated(left).max(stated(right)).max(walk.tolerance);
        // While one of them tears; once both are loose they are alike again.
        let held = [left, right].map(|c| c.stats.held.unwrap_or(1.0));
        let unsure = if held == [0.0; 2] { 0.0 } else { 1.0 - held[0].min(held[1]) };
        let way_mm = stride_mm * (n + 1) as f64;
        let [rms, most] = apart_mm(right, left, way_mm);
        walk.checks.hold("left against right, mm rms", rms, claim * case.depth_mm + 1e-3);
        let most_allowed = 6.0 * claim * case.depth_mm + 5e-3 + unsure * way_mm;
        walk.checks.hold("left against right, mm", most, most_allowed);
        let normal = right.forces.normal_force_n.max(walk.least_force());
        let off = (right.forces.normal_force_n - left.forces.normal_force_n).abs() / normal;
        walk.checks.hold("left force against right", off, 0.01 + 0.5 * claim);
        let drags = [right, left].map(|c| c.forces.shear_force_n[0]);
        let unsure_n = unsure * drags[0].abs().max(drags[1].abs());
        walk.checks.hold(
            "left drag against right",
            (drags[0] + drags[1]).abs() / normal,
            0.02 + claim + unsure_n / normal,
        );
    }
    walk.release()
}

/// How far the faces of a slide of `way_mm` to the right and of the mirror image of one to the left are apart: the root mean square where they
/// are scored, and the most anywhere.
fn apart_mm(right: &ElastomerCapture, left: &ElastomerCapture, way_mm: f64) -> [f64; 2] {
    let s = &right.surface;
    let scored = scored_mm(right);
    let (mut squares, mut points, mut most) = (0.0, 0u32, 0.0f64);
    for (i, j) in (0..s.ny).flat_map(|j| (0..s.nx).map(move |i| (i, j))) {
        let (a, b) = (s.positions[j * s.nx + i], left.surface.positions[j * s.nx + s.nx - 1 - i]);
        let apart = Vec3::new(a.x + b.x, a.y - b.y, a.z - b.z).abs().max_element();
        let [x, y] = s.rest_xy(i, j);
        if (x - way_mm).hypot(y) < scored {
            squares += f64::from(apart).powi(2);
            points += 1;
        }
        most = most.max(f64::from(apart));
    }
    [(squares / f64::from(points.max(1))).sqrt(), most]
}

/// Distance from the body's axis up to which a face is scored: twice the radius of the contact, at least 3 mm.
fn scored_mm(now: &ElastomerCapture) -> f64 {
    (2.0 * (now.stats.contact_area_mm2 / std::f64::consts::PI).sqrt()).max(3.0)
}
