//! What the sample points of the contact do not see.
//!
//! Contact is enforced at a few points of each cell. A knife, a pin or the crest of a wave may pass between them: the
//! face is then found at rest under a body that stands in it. So the face is looked at again, on a lattice fine enough
//! for the narrowest of the shipped bodies, and under all that is narrower ([`thin`]); what is found counts as error.

use super::chart::Chart;
use super::grid::Grid;
use crate::indenter::{Indenter, thin};
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// Largest spacing of the lattice, mm: two points across the narrowest edge of the press set (0.2 mm).
const SPACING_MM: f64 = thin::WIDE_MM;

/// What is less far inside is so by rounding alone, mm: a body that just touches a dome stands in it by that.
const ROUNDING_MM: f64 = 1e-6;
/// A face this near the body touches it, mm.
const TOUCHES_MM: f64 = 0.02;
/// Part of the way to the body's underside by which a point of the face has to have been pushed, or else it was missed.
const PUSHED: f64 = 0.5;
/// Tries to find the point of the face that is at a place, and how near to it is near enough, mm.
const MOVES: usize = 20;
/// See [`MOVES`].
const NEAR_ENOUGH_MM: f64 = 1e-3;

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
    /// Counts a point under the body, whose height at rest, height now and the body's own above it are given, mm, from any level.
    fn count(&mut self, rest_mm: f64, now_mm: f64, underside_mm: f64) {
        let way_mm = rest_mm - underside_mm;
        let stands_in_it = way_mm > ROUNDING_MM;
        self.under += u64::from(stands_in_it);
        self.missed += u64::from(stands_in_it && rest_mm - now_mm < PUSHED * way_mm);
    }

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

/// The pad's face.
struct Face<'a> {
    grid: &'a Grid,
    chart: Option<&'a Chart>,
    u: &'a [f32],
}

impl Face<'_> {
    /// Height of the untouched face, mm.
    fn rest_mm(&self, x_mm: f64, y_mm: f64) -> f64 {
        self.chart.map_or(0.0, |chart| chart.height_mm(x_mm, y_mm))
    }

    /// Where a point of it is now; cells and weights are those of its place.
    fn at(&self, [x, y]: [f64; 2], traces: [(usize, [f64; 3]); 2]) -> DVec3 {
        self.grid.moved(self.u, [x, y, self.rest_mm(x, y)], traces).into()
    }

    /// The point of it that is at a place now, or nearly there where it is folded; nothing beside the pad.
    fn found_at(&self, place: [f64; 2]) -> Option<DVec3> {
        let (size, mut from, mut found) = (self.grid.size, place, None);
        for _ in 0..MOVES {
            let cells = [(from[0], size[0], self.grid.nx), (from[1], size[1], self.grid.ny)];
            if cells.iter().any(|(x, size, _)| x.abs() > 0.5 * size) {
                break;
            }
            let p = self.at(from, cells.map(|(x, size, n)| Grid::trace(x, size, n)));
            found = Some(p);
            let off = [p.x - place[0], p.y - place[1]];
            if off[0].hypot(off[1]) < NEAR_ENOUGH_MM {
                break;
            }
            from = [from[0] - off[0], from[1] - off[1]];
        }
        found
    }
}

/// How far the face lies in the indenter.
pub fn inside(grid: &Grid, chart: Option<&Chart>, u: &[f32], indenter: &dyn Indenter, pose: &Pose) -> Inside {
    let face = Face { grid, chart, u };
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
    let of_row = |y: &f64| {
        let row = Grid::trace(*y, grid.size[1], grid.ny);
        let mut sums = Sums::default();
        for (x, i, wx) in &columns {
            let p = face.at([*x, *y], [(*i, *wx), row]);
            let at_body = pose.to_indenter(p);
            let gap = indenter.distance(at_body);
            if gap < -ROUNDING_MM {
                sums.squares += gap * gap;
                sums.inside += 1;
                sums.deepest_mm = sums.deepest_mm.max(-gap);
            }
            if gap < TOUCHES_MM
                && let Some(underside) = indenter.lower_surface(at_body.x, at_body.y)
            {
                sums.count(face.rest_mm(p.x, p.y) - pose.z_mm, at_body.z, underside);
            }
        }
        sums
    };
    // Rows are summed in their order, whatever the number of threads.
    let of_rows: Vec<Sums> = rows.par_iter().map(of_row).collect();
    let mut sums = of_rows.iter().fold(Sums::default(), Sums::and);
    for part in indenter.thin_parts() {
        let under = pose.to_pad(*part);
        if let Some(p) = face.found_at([under.x, under.y]) {
            sums.count(face.rest_mm(p.x, p.y) - pose.z_mm, p.z - pose.z_mm, part.z);
        }
    }
    let mean = |sum: f64, n: u64| if n == 0 { 0.0 } else { sum / n as f64 };
    Inside {
        rms_mm: mean(sums.squares, sums.inside).sqrt(),
        deepest_mm: sums.deepest_mm,
        missed: mean(sums.missed as f64, sums.under),
    }
}
