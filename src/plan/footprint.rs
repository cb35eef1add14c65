//! The footprint: which part of an indenter can touch the pad at a given depth.
//!
//! Indenters stand on a base that is wider than their features; only what lies lower than the
//! press is deep can touch. The footprint is the convex hull of those points on a lattice, which
//! underestimates by at most one lattice spacing.

use crate::indenter::Indenter;
use crate::pose::Pose;

/// Lattice points along each side.
const SAMPLES: usize = 97;

/// Convex outline of what touches, in the indenter's own frame, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Footprint {
    hull: Vec<[f64; 2]>,
}

impl Footprint {
    /// What touches when the tip is `depth_mm` deep; `None` when nothing does.
    pub fn at_depth(indenter: &dyn Indenter, depth_mm: f64) -> Option<Self> {
        let [hx, hy] = indenter.half_extent_mm();
        let along = |h: f64, i: usize| {
            // Just inside the body at both ends, where its surface is still defined.
            (h - 1e-6) * (2.0 * i as f64 / (SAMPLES - 1) as f64 - 1.0)
        };
        let mut touching = Vec::new();
        for i in 0..SAMPLES {
            for j in 0..SAMPLES {
                let (x, y) = (along(hx, i), along(hy, j));
                if indenter.lower_surface(x, y).is_some_and(|height| height <= depth_mm + 1e-9) {
                    touching.push([x, y]);
                }
            }
        }
        (!touching.is_empty()).then(|| Self { hull: hull(touching) })
    }

    /// Lowest x, highest x, lowest y, highest y at a pose, pad frame, mm.
    pub fn bounds_mm(&self, pose: &Pose) -> [f64; 4] {
        let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for [x, y] in &self.hull {
            let p = pose.to_pad(glam::DVec3::new(*x, *y, 0.0));
            bounds = [bounds[0].min(p.x), bounds[1].max(p.x), bounds[2].min(p.y), bounds[3].max(p.y)];
        }
        bounds
    }
}

/// Convex hull by Andrew's monotone chain.
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let turns_left = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| {
        (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]) > 0.0
    };
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut side: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while side.len() >= 2 && !turns_left(side[side.len() - 2], side[side.len() - 1], p) {
                side.pop();
            }
            side.push(p);
        }
        side.pop();
        side
    };
    let mut lower = chain(&mut points.iter().copied());
    lower.extend(chain(&mut points.iter().rev().copied()));
    lower
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::check::stand_ins::Punch;

    #[test]
    fn a_square_on_a_wider_base_touches_with_the_square_alone() {
        let punch = Punch { half_mm: 4.0, base_half_mm: 8.0, tall_mm: 2.0 };
        let shallow = Footprint::at_depth(&punch, 0.5).unwrap();
        let [x0, x1, y0, y1] = shallow.bounds_mm(&Pose::new(5.0, 0.0, -0.5, 0.0));
        assert!((x1 - 9.0).abs() < 0.2 && (x0 - 1.0).abs() < 0.2 && (y1 - y0 - 8.0).abs() < 0.4);
        let turned = shallow.bounds_mm(&Pose::new(0.0, 0.0, -0.5, 45.0));
        assert!((turned[1] - 32f64.sqrt()).abs() < 0.25, "{turned:?}");
        let deep = Footprint::at_depth(&punch, 2.5).unwrap();
        assert!(deep.bounds_mm(&Pose::default())[1] > 7.99);
    }

    #[test]
    fn nothing_touches_above_the_face() {
        let punch = Punch { half_mm: 4.0, base_half_mm: 8.0, tall_mm: 2.0 };
        assert_eq!(Footprint::at_depth(&punch, -0.5), None);
    }
}
