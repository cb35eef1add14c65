//! What the pad hides of a light: horizons over its height field.
//!
//! Along a level direction the pad hides everything below the steepest line of sight over it. A coarse map of largest
//! heights lets a line of sight leap over what it cannot touch.

use super::raster::Projected;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Fine cells in a coarse one, each way.
const COARSE: usize = 4;
/// Coarse cells in a wide one, each way.
const WIDE: usize = 4;

/// The pad seen from above.
pub struct Heights {
    low: Vec2,
    cell: f32,
    size: [usize; 2],
    /// Heights at the cells' middles; minus infinity where there is no pad.
    z: Vec<f32>,
    coarse: [usize; 2],
    /// Largest height of each coarse cell.
    pools: Vec<f32>,
    wide: [usize; 2],
    /// Largest height of each wide cell and its eight neighbours.
    summits: Vec<f32>,
    highest: f32,
}

impl Heights {
    /// Looks at a lattice from above, with cells of about `cell` mm.
    pub fn new(positions: &[Vec3], lattice: [usize; 2], cell: f32) -> Self {
        let inf = Vec3::splat(f32::INFINITY);
        let [low, high] = positions.iter().fold([inf, -inf], |[l, h], p| [l.min(*p), h.max(*p)]);
        let extent = (high - low).truncate();
        let cell = cell.max(extent.max_element() / 2048.0).max(1e-6);
        let size = [(extent.x / cell) as usize, (extent.y / cell) as usize].map(|n| n.max(2));
        let z = binned(positions, low.truncate(), cell, size)
            .unwrap_or_else(|| drawn(positions, lattice, low.truncate(), cell, size));
        let coarse = [size[0].div_ceil(COARSE), size[1].div_ceil(COARSE)];
        let mut pools = vec![f32::NEG_INFINITY; coarse[0] * coarse[1]];
        for (k, z) in z.iter().enumerate() {
            let pool = &mut pools[k / size[0] / COARSE * coarse[0] + k % size[0] / COARSE];
            *pool = pool.max(*z);
        }
        let (wide, summits) = summits(&pools, coarse);
        Self { low: low.truncate(), cell, size, z, coarse, pools, wide, summits, highest: high.z }
    }

    /// Height of the pad at a place, or of the nearest part of it.
    pub fn at(&self, p: Vec2) -> f32 {
        let q = (p - self.low) / self.cell;
        let most = Vec2::new(self.size[0] as f32, self.size[1] as f32) - 1.51;
        let z = self.height(q.min(most).max(Vec2::splat(0.5)));
        if z.is_finite() { z } else { self.highest }
    }

    /// Height between cell middles, bilinear; minus infinity off the pad.
    #[inline(always)]
    fn height(&self, q: Vec2) -> f32 {
        let (x, y) = (q.x - 0.5, q.y - 0.5);
        if !(x >= 0.0 && y >= 0.0) {
            return f32::NEG_INFINITY;
        }
        let (i, j) = (x as usize, y as usize);
        if i + 1 >= self.size[0] || j + 1 >= self.size[1] {
            return f32::NEG_INFINITY;
        }
        let (fx, fy) = (x - i as f32, y - j as f32);
        let k = j * self.size[0] + i;
        let (z00, z10) = (self.z[k], self.z[k + 1]);
        let (z01, z11) = (self.z[k + self.size[0]], self.z[k + self.size[0] + 1]);
        let (low, high) = (z00 + (z10 - z00) * fx, z01 + (z11 - z01) * fx);
        low + (high - low) * fy
    }

    /// The steepest line of sight over the pad, at least `low`; some value of at least `high` when it is that high.
    #[inline(always)]
    pub fn horizon(&self, point: Vec3, ahead: Vec2, distance: f32, low: f32, high: f32) -> f32 {
        let mut slope = low;
        // In strides of a wide cell up to the first that may reach the line of sight.
        let stride = (WIDE * COARSE) as f32 * self.cell;
        let mut reached = 0.0;
        loop {
            let least = point.z + low * reached + low.min(0.0) * stride;
            if reached > distance || point.z + low * reached > self.highest {
                return slope;
            }
            let q = (point.truncate() + ahead * reached - self.low) / stride;
            let inside = q.cmpge(Vec2::ZERO).all();
            let (i, j) = (q.x as usize, q.y as usize);
            if !inside || i >= self.wide[0] || j >= self.wide[1] {
                if reached > 0.0 {
                    return slope;
                }
                break;
            }
            if self.summits[j * self.wide[0] + i] > least {
                break;
            }
            reached += stride;
        }
        // The receiver's own cells say nothing beyond its normal.
        let mut t = reached.max(1.5 * self.cell);
        let start = (point.truncate() - self.low) / self.cell;
        let along = ahead / self.cell;
        let bias = 1e-3 * self.cell;
        let size = COARSE as f32;
        while t < distance && point.z + slope * t < self.highest && slope < high {
            let q = start + along * t;
            if !q.cmpge(Vec2::ZERO).all() {
                break;
            }
            let (i, j) = ((q.x / size) as usize, (q.y / size) as usize);
            if i >= self.coarse[0] || j >= self.coarse[1] {
                break;
            }
            let block = Vec2::new(i as f32, j as f32);
            let least = point.z + slope * t + slope.min(0.0) * 2.0 * size * self.cell;
            if self.pools[j * self.coarse[0] + i] <= least {
                // The line rises (or the step is short): nothing in this block reaches it, go on to the next.
                let edge = (block + Vec2::select(along.cmpgt(Vec2::ZERO), Vec2::ONE, Vec2::ZERO)) * size;
                let leave = (edge - q) / along;
                let leave =
                    if leave.is_nan() { 0.0 } else { leave.min_element().clamp(0.0, 4.0 * size * self.cell) };
                t += leave + 0.05 * self.cell;
            } else {
                let z = self.height(q) - bias;
                if z > point.z + slope * t {
                    slope = (z - point.z) / t;
                }
                t += self.cell;
            }
        }
        slope
    }
}

/// Wide cells along x and y, and the largest height around each.
fn summits(pools: &[f32], coarse: [usize; 2]) -> ([usize; 2], Vec<f32>) {
    let wide = coarse.map(|n| n.div_ceil(WIDE));
    let mut own = vec![f32::NEG_INFINITY; wide[0] * wide[1]];
    for (k, z) in pools.iter().enumerate() {
        let cell = &mut own[k / coarse[0] / WIDE * wide[0] + k % coarse[0] / WIDE];
        *cell = cell.max(*z);
    }
    let around = |k: usize| {
        let (i, j) = (k % wide[0], k / wide[0]);
        let columns = i.saturating_sub(1)..(i + 2).min(wide[0]);
        let rows = j.saturating_sub(1)..(j + 2).min(wide[1]);
        rows.flat_map(|j| columns.clone().map(move |i| (i, j)))
            .fold(f32::NEG_INFINITY, |most, (i, j)| most.max(own[j * wide[0] + i]))
    };
    (wide, (0..own.len()).map(around).collect())
}

/// Mean height of the lattice's points by cell; None when a cell has none.
fn binned(positions: &[Vec3], low: Vec2, cell: f32, size: [usize; 2]) -> Option<Vec<f32>> {
    let mut sums = vec![[0.0f32; 2]; size[0] * size[1]];
    let per_mm = 1.0 / cell;
    for p in positions {
        let q = (p.truncate() - low) * per_mm;
        let (i, j) = ((q.x as usize).min(size[0] - 1), (q.y as usize).min(size[1] - 1));
        let sum = &mut sums[j * size[0] + i];
        *sum = [sum[0] + p.z, sum[1] + 1.0];
    }
    sums.iter().all(|s| s[1] > 0.0).then(|| sums.iter().map(|s| s[0] / s[1]).collect())
}

/// Height at the middle of each cell; minus infinity where there is no pad.
fn drawn(positions: &[Vec3], lattice: [usize; 2], low: Vec2, cell: f32, size: [usize; 2]) -> Vec<f32> {
    let vertices: Vec<Vec3> =
        positions.par_iter().map(|p| ((p.truncate() - low) / cell).extend(p.z)).collect();
    let samples = Projected { lattice, vertices: &vertices, offset: 0.5 }.draw(size[0], size[1]);
    samples.iter().map(|s| s.value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall across a flat pad is seen under the slope of its near edge.
    #[test]
    fn a_ridge_is_the_horizon_before_it_and_not_behind_it() {
        let n = 201;
        let at = |k: usize| {
            let (x, y) = ((k % n) as f32 * 0.1 - 10.0, (k / n) as f32 * 0.1 - 10.0);
            Vec3::new(x, y, if (x - 2.0).abs() < 0.25 { 1.0 } else { 0.0 })
        };
        let positions: Vec<Vec3> = (0..n * n).map(at).collect();
        for cell in [0.05, 0.2] {
            let heights = Heights::new(&positions, [n, n], cell);
            let horizon = |x: f32, ahead: f32| {
                heights.horizon(Vec3::new(x, 0.0, 0.0), Vec2::X * ahead, 9.0 - x * ahead, 0.01, 2.0)
            };
            // The points at 1.8 are on the ridge.
            assert!((horizon(0.0, 1.0) - 1.0 / 1.8).abs() < 0.08, "{cell} {}", horizon(0.0, 1.0));
            assert_eq!(horizon(5.0, 1.0), 0.01);
            assert!((horizon(5.0, -1.0) - 1.0 / 2.8).abs() < 0.04, "{cell} {}", horizon(5.0, -1.0));
            assert_eq!(heights.at(Vec2::new(5.0, 3.0)), 0.0);
        }
    }
}
