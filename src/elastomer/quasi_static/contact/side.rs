//! Sides of the indenter: planes that stand for it near a point.

use super::Sample;
use crate::indenter::Indenter;
use glam::DVec3;

/// Penetration beyond which the nearest side of the indenter is not trusted, mm.
const DEEP_MM: f64 = 0.02;
/// Cosine of the angle between the nearest side and the one that a point came in by, below which they are two sides and
/// not parts of one rounded edge.
pub(super) const ANOTHER_SIDE: f64 = 0.3;

/// A plane that touches the indenter, in the indenter's frame.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// Where it touches.
    pub at: DVec3,
    /// Out of the indenter.
    pub normal: DVec3,
}

/// Where a point meets the indenter on its way through an increment.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Part of the way.
    pub fraction: f64,
    /// What it meets.
    pub side: Side,
}

impl Side {
    /// The nearest to a point in the indenter's frame, and the point's signed distance, mm.
    pub fn nearest(indenter: &dyn Indenter, p: DVec3) -> (f64, Side) {
        let (gap, normal) = indenter.distance_and_normal(p);
        (gap, Side { at: p - normal * gap, normal })
    }

    /// Signed distance of a point, mm.
    pub fn gap(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.at)
    }

    /// The part of a vector that lies in the plane.
    pub fn along(&self, v: DVec3) -> DVec3 {
        v - self.normal * self.normal.dot(v)
    }

    /// Whether a point that came in by this side belongs out by it, though another is nearest.
    pub fn came_by_instead(&self, gap: f64, nearest: &Side) -> bool {
        gap < -DEEP_MM && nearest.normal.dot(self.normal) < ANOTHER_SIDE
    }
}

impl Sample {
    /// What pushes this point, at `p` in the indenter's frame, out of it: nothing in particular where it is not deep,
    /// else the side that it came in by, unless the nearest is a part of that.
    pub fn side_out(&self, indenter: &dyn Indenter, p: DVec3) -> Option<Side> {
        let came_by = self.entry.map(|e| e.side).or(self.anchor.map(|a| a.side))?;
        let (gap, nearest) = Side::nearest(indenter, p);
        let side = if came_by.came_by_instead(gap, &nearest) { came_by } else { nearest };
        (gap < -DEEP_MM).then_some(side)
    }

    /// The side that it was at when it was last seen.
    pub fn touched(&self, indenter: &dyn Indenter) -> Side {
        let foot = |side: Side| Side { at: self.seen - side.normal * side.gap(self.seen), ..side };
        self.pushed_by.map_or_else(|| Side::nearest(indenter, self.seen).1, foot)
    }
}
