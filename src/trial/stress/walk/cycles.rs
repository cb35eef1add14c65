//! The same strokes many times.

use super::Walk;
use crate::elastomer::Error;

/// Pressed and let go (not quite) again and again: the force at the bottom does not wander.
pub(super) fn cycles(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    let mut first = None;
    for n in 0..case.times {
        let pose = walk.at(-case.depth_mm);
        if n % 50 != 1 {
            walk.solver.advance(&pose)?;
            walk.pose = pose;
        } else {
            let force = walk.go(pose)?.forces.normal_force_n;
            let first = *first.get_or_insert(force);
            let off = (force - first).abs() / force.max(walk.least_force());
            walk.checks.hold("force wanders over cycles", off, 0.01 + 0.5 * walk.claim);
        }
        let pose = walk.at(-0.3 * case.depth_mm);
        walk.solver.advance(&pose)?;
        walk.pose = pose;
    }
    walk.release()
}
