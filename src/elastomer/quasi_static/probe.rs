//! What the sample points of the contact do not see.
//!
//! Contact is enforced at a few points of each cell. A knife, a pin or the crest of a wave may pass between them: the
//! face is then found at rest under a body that stands in it. So the face is looked at again, on a lattice fine enough
//! for the narrowest of the shipped bodies, and what is found counts as error.

use super::chart::Chart;
use super::grid::Grid;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// Largest spacing of the lattice, mm: two points across the narrowest edge of the press set (0.2 mm).
const SPACING_MM: f64 = 0.1;

/// A face this near the body touches it, mm.
const TOUCHES_MM: f64 = 0.02;
/// Part of the way to the body's underside by which a point of the face has to have been pushed, or else it was missed.
const PUSHED: f64 = 0.5;

/// How far points of the face lie in the indenter, mm; 0 where none does.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inside {
    /// Root mean square over those that do.
    pub rms_mm: f64,
    /// The deepest.
    pub deepest_mm: f64,
    /// Part of the points under the body, where they touch it, that it has passed by. In a thin body distances say little: half its
    /// width at most.
    pub missed: f64,
}

/// The sums over some points that make [`Inside`].
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    squares: f64,
    inside: u64,
    deepest_mm: f64,
    under: u64,
    missed: u64,
}

impl Sums {
    fn and(self, more: &Self) -> Self {
        Self {
            squares: self.squares + more.squares,
            inside: self.inside + more.inside,
            deepest_mm: self.deepest_mm.max(more.deepest_mm),
            under: self.under + more.under,
            missed: self.missed + more.missed,
        }
    }
}

/// How far the face lies in the indenter.
pub fn inside(grid: &Grid, chart: Option<&Chart>, u: &[f32], indenter: &dyn Indenter, pose: &Pose) -> Inside {
    let [hx, hy] = indenter.half_extent_mm();
    let reach = hx.hypot(hy) + SPACING_MM;
    let lattice = |at: f64, size: f64| {
        let half = size / 2.0;
        let (low, high) = ((at - reach).max(-half), (at + reach).min(half));
        // As far from either end, so that what is seen of a mirrored face is the same, and one in the middle, where a needle is.
        let n = if high > low { ((high - low) / SPACING_MM).ceil() as usize | 1 } else { 0 };
        (0..n).map(move |i| low + (i as f64 + 0.5) * (high - low) / n as f64)
    };
    let columns: Vec<(f64, usize, [f64; 3])> = lattice(pose.x_mm, grid.size[0])
        .map(|x| {
            let (cell, weights) = Grid::trace(x, grid.size[0], grid.nx);
            (x, cell, weights)
        })
        .collect();
    let rows: Vec<f64> = lattice(pose.y_mm, grid.size[1]).collect();
    let (cx, top) = (grid.cx(), grid.layers() - 1);
    let of_row = |y: &f64| {
        let (j, wy) = Grid::trace(*y, grid.size[1], grid.ny);
        let mut sums = Sums::default();
        for (x, i, wx) in &columns {
            let mut p = [*x, *y, chart.map_or(0.0, |chart| chart.height_mm(*x, *y))];
            for (c, p) in p.iter_mut().enumerate() {
                let plane = &u[grid.at(c, top)..][..grid.plane()];
                for (b, wy) in wy.iter().enumerate() {
                    for (a, wx) in wx.iter().enumerate() {
                        *p += wy * wx * f64::from(plane[(j + b) * cx + i + a]);
                    }
                }
            }
            let at_body = pose.to_indenter(DVec3::from_array(p));
            let gap = indenter.distance(at_body);
            if gap < 0.0 {
                sums.squares += gap * gap;
                sums.inside += 1;
                sums.deepest_mm = sums.deepest_mm.max(-gap);
            }
            if gap < TOUCHES_MM
                && let Some(underside) = indenter.lower_surface(at_body.x, at_body.y)
            {
                let rest_mm = chart.map_or(0.0, |chart| chart.height_mm(p[0], p[1])) - pose.z_mm;
                let way_mm = rest_mm - underside;
                sums.under += u64::from(way_mm > 0.0);
                sums.missed += u64::from(way_mm > 0.0 && rest_mm - at_body.z < PUSHED * way_mm);
            }
        }
        sums
    };
    // Rows are summed in their order, whatever the number of threads.
    let of_rows: Vec<Sums> = rows.par_iter().map(of_row).collect();
    let sums = of_rows.iter().fold(Sums::default(), Sums::and);
    let mean = |sum: f64, n: u64| if n == 0 { 0.0 } else { sum / n as f64 };
    Inside {
        rms_mm: mean(sums.squares, sums.inside).sqrt(),
        deepest_mm: sums.deepest_mm,
        missed: mean(sums.missed as f64, sums.under),
    }
}
