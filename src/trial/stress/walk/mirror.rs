//! Mirror images: a slide to the left and one to the right.

use super::Walk;
use super::slide::slide;
use crate::elastomer::Error;

/// A slide to the left mirrors one to the right, at every waypoint.
pub(super) fn mirror(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    walk.go(walk.at(-case.depth_mm))?;
    let forked = walk.solver.fork();
    let (start, pressed) = (walk.pose, walk.last.clone());
    let right = slide(walk, case.slide_mm, 0.0)?;
    (walk.solver, walk.pose, walk.last) = (forked, start, pressed);
    let left = slide(walk, case.slide_mm, 180.0)?;
    for (right, left) in right.iter().zip(&left) {
        let s = &right.surface;
        let mut most = 0.0f32;
        for j in 0..s.ny {
            for i in 0..s.nx {
                let (a, b) = (s.positions[j * s.nx + i], left.surface.positions[j * s.nx + s.nx - 1 - i]);
                most = most.max((a.z - b.z).abs()).max((a.x + b.x).abs()).max((a.y - b.y).abs());
            }
        }
        let claim = left.stats.estimated_error.unwrap_or(0.0).max(walk.tolerance);
        walk.checks.hold("left against right, mm", f64::from(most), claim * case.depth_mm + 1e-3);
        let normal = right.forces.normal_force_n.max(walk.least_force());
        let off = (right.forces.normal_force_n - left.forces.normal_force_n).abs() / normal;
        walk.checks.hold("left force against right", off, 0.01 + 0.5 * claim);
        let drag = right.forces.shear_force_n[0] + left.forces.shear_force_n[0];
        walk.checks.hold("left drag against right", drag.abs() / normal, 0.02 + claim);
    }
    walk.release()
}
