//! What the pad hides of a light: horizons over its height field.
//!
//! Along a level direction the pad hides everything below the steepest line of sight over it. Maps of the largest height
//! around each place, within twice the reach each, let a line of sight leap over what it cannot touch.

use super::raster::Projected;
use crate::optics::Mesh;
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Fine cells in a coarse one, each way.
const COARSE: usize = 2;
/// Reaches around a coarse cell, in coarse cells: 1, 2, 4 and so on.
const REACHES: usize = 8;
/// Parts of the lattice that are binned side by side; fixed, so that sums do not depend on threads.
const PARTS: usize = 4;

/// The pad seen from above.
pub struct Heights {
    low: Vec2,
    /// The other corner: cells may end short of it.
    high: Vec2,
    cell: f32,
    per_mm: f32,
    size: [usize; 2],
    /// Heights at the cells' middles; minus infinity where there is no pad.
    z: Vec<f32>,
    coarse: [usize; 2],
    /// By coarse cell: the largest height within each reach of it.
    around: Vec<[f32; REACHES]>,
    highest: f32,
    /// Points on sharp rims.
    sharp: usize,
    /// About how long these are together, mm on a square millimetre.
    rims_per_mm: f32,
}

/// From where light is looked for: a place, and the slopes of the flank that it lies on, or 0.
#[derive(Debug, Clone, Copy)]
pub struct Stand {
    pub point: Vec3,
    /// Along x and y.
    slopes: Vec2,
}

impl Stand {
    /// A place on a face with this normal.
    pub fn on(point: Vec3, normal: Vec3) -> Self {
        Self { point, slopes: normal.truncate() / -normal.z.max(STEEPEST) }
    }
}

impl From<Vec3> for Stand {
    fn from(point: Vec3) -> Self {
        Self { point, slopes: Vec2::ZERO }
    }
}

impl Heights {
    /// Looks at a pad from above, with cells of so many distances of its lattice's points, and of as many where it has sharp rims.
    pub fn of(mesh: &Mesh, lattice: [usize; 2], [cell, at_rims]: [f32; 2]) -> Self {
        let p = &mesh.positions;
        let spacing = spacing_of(p, lattice);
        let crests = Crests::of(p, lattice);
        let cell = if crests.sharp >= RIM { at_rims } else { cell };
        Self::with_crests(p, lattice, (cell * spacing).clamp(0.03, 0.2), crests)
    }

    /// Looks at a lattice from above, with cells of about `cell` mm.
    pub fn new(positions: &[Vec3], lattice: [usize; 2], cell: f32) -> Self {
        Self::with_crests(positions, lattice, cell, Crests::of(positions, lattice))
    }

    fn with_crests(positions: &[Vec3], lattice: [usize; 2], cell: f32, crests: Crests) -> Self {
        let inf = Vec3::splat(f32::INFINITY);
        let wider = |[l, h]: [Vec3; 2], [m, i]: [Vec3; 2]| [l.min(m), h.max(i)];
        let of_some = |some: &[Vec3]| some.iter().fold([inf, -inf], |all, p| wider(all, [*p; 2]));
        let [low, high] = positions.par_chunks(16_384).map(of_some).reduce(|| [inf, -inf], wider);
        let extent = (high - low).truncate();
        let cell = cell.max(extent.max_element() / 2048.0).max(1e-6);
        let size = [(extent.x / cell) as usize, (extent.y / cell) as usize].map(|n| n.max(2));
        let mut z = binned(positions, low.truncate(), cell, size)
            .unwrap_or_else(|| drawn(positions, lattice, low.truncate(), cell, size));
        let rims_mm = crests.sharp as f32 * spacing_of(positions, lattice);
        let rims_per_mm = rims_mm / (extent.x * extent.y).max(1e-6);
        for p in crests.points {
            let q = (p.truncate() - low.truncate()) / cell;
            let z = &mut z[(q.y as usize).min(size[1] - 1) * size[0] + (q.x as usize).min(size[0] - 1)];
            *z = z.max(p.z);
        }
        let coarse = [size[0].div_ceil(COARSE), size[1].div_ceil(COARSE)];
        let around = around(&z, size, coarse);
        Self {
            low: low.truncate(),
            high: high.truncate(),
            cell,
            per_mm: 1.0 / cell,
            size,
            z,
            coarse,
            around,
            highest: high.z,
            sharp: crests.sharp,
            rims_per_mm,
        }
    }

    /// From where to where it goes.
    pub fn extent(&self) -> [Vec2; 2] {
        [self.low, self.high]
    }

    /// Height of the pad at a place, or of the nearest part of it.
    pub fn at(&self, p: Vec2) -> f32 {
        let q = (p - self.low) / self.cell;
        let most = Vec2::new(self.size[0] as f32, self.size[1] as f32) - 1.51;
        let q = q.min(most).max(Vec2::splat(0.5));
        let z = self.height(q);
        if z.is_finite() { z } else { self.nearest([q.x as usize, q.y as usize]) }
    }

    /// Height of the pad in the cells nearest to one without any of it, as where its edge has drawn in.
    fn nearest(&self, [i, j]: [usize; 2]) -> f32 {
        let within = |at: usize, reach: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
        let highest = |reach: usize| {
            let rows = within(j, reach, self.size[1]).map(|row| &self.z[row * self.size[0]..]);
            rows.flat_map(|row| &row[within(i, reach, self.size[0])])
                .copied()
                .fold(f32::NEG_INFINITY, f32::max)
        };
        (1..self.size[0].max(self.size[1])).map(highest).find(|z| z.is_finite()).unwrap_or(self.highest)
    }

    /// Whether more than a corner of the pad stands on a sharp rim.
    pub fn has_sharp_rims(&self) -> bool {
        self.sharp >= RIM
    }

    /// Length of sharp rims on a square millimetre, mm.
    pub fn rims_per_mm(&self) -> f32 {
        self.rims_per_mm
    }

    /// Whether they stand so close that flanks face each other.
    pub fn has_grooves(&self) -> bool {
        self.rims_per_mm > GROOVED
    }

    /// Whether some of the pad is higher, by more than shadows need.
    #[inline(always)]
    pub fn rises_above(&self, z: f32) -> bool {
        self.highest > z + self.cell
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
    pub fn horizon(&self, from: impl Into<Stand>, ahead: Vec2, distance: f32, low: f32, high: f32) -> f32 {
        let Stand { point, slopes } = from.into();
        let near = if slopes == Vec2::ZERO { 0.0 } else { NEAR * self.cell };
        let (by_own, doubt) = (slopes.dot(ahead), DOUBT * self.cell * slopes.length());
        let mut slope = low;
        // The receiver's own cells say nothing beyond its normal.
        let mut t = 1.5 * self.cell;
        let start = (point.truncate() - self.low) * self.per_mm;
        let along = ahead * self.per_mm;
        let bias = 1e-3 * self.cell;
        let mut top = None;
        while t < distance && slope < high {
            let line = point.z + slope * t;
            if line >= self.highest {
                break;
            }
            let q = start + along * t;
            let (i, j) = (q.x as usize / COARSE, q.y as usize / COARSE);
            if !(q.x >= 0.0 && q.y >= 0.0) || i >= self.coarse[0] || j >= self.coarse[1] {
                break;
            }
            // Within how many of the reaches nothing touches the line, which may fall.
            let fall = slope.min(0.0) * self.cell;
            let around = &self.around[j * self.coarse[0] + i];
            let mut free = 0;
            for k in 0..REACHES {
                free += usize::from(around[k] <= line + fall * LEAP[k]);
            }
            if free > 0 {
                t += LEAP[free - 1] * self.cell;
            } else {
                let z = self.height(q) - bias;
                if z > line && (t > near || z > point.z + by_own * t + doubt) {
                    slope = (z - point.z) / t;
                    top = Some(t);
                }
                t += self.cell;
            }
        }
        // Between two looks at it the pad may be higher: an edge would seem farther away than it is.
        if let Some(mut t) = top.filter(|t| *t > OWN * self.cell) {
            for step in [0.5, 0.25] {
                let by = step * self.cell;
                let slope_at = |t: f32| (self.height(start + along * t) - bias - point.z) / t;
                let (nearer, farther) = (slope_at(t - by), slope_at(t + by));
                if nearer.max(farther) > slope {
                    (slope, t) = if nearer > farther { (nearer, t - by) } else { (farther, t + by) };
                }
            }
        }
        slope
    }
}

/// The larger of the distances between a lattice's points along x and y, mm.
fn spacing_of(p: &[Vec3], [nx, _]: [usize; 2]) -> f32 {
    (p[1] - p[0]).length().max((p[nx] - p[0]).length())
}

/// A slope as it is interpolated, between -1 and 1: below an upright edge 1/slope changes evenly, far from it the slope.
#[inline(always)]
pub fn squeezed(slope: f32) -> f32 {
    slope / (1.0 + slope.abs())
}

/// The slope that was squeezed to this.
#[inline(always)]
pub fn slope_of(squeezed: f32) -> f32 {
    squeezed / (1.0 - squeezed.abs()).max(1e-6)
}

/// So near, in cells, what rises is the receiver's own flank unless it stands clear of that: one that hid light from itself would be
/// too dark.
const NEAR: f32 = 2.0;
/// By so much of what the flank's plane rises over a cell: cells know its height no better.
const DOUBT: f32 = 1.0;
/// Flanks are no steeper than this, as the part of the normal upwards.
const STEEPEST: f32 = 0.1;

/// So near, in cells, the pad is part of the face that the receiver lies on.
const OWN: f32 = 12.0;

/// How far a line of sight may go within a reach, in fine cells: from the edge of its own cell, and not so far that heights
/// beyond are interpolated.
const LEAP: [f32; REACHES] = {
    let mut leap = [0.0; REACHES];
    let mut k = 0;
    while k < REACHES {
        leap[k] = ((COARSE << k) - 1) as f32;
        k += 1;
    }
    leap
};

/// Where the slope falls by more from one side of a point to the other, it is on a crest.
const CREST: f32 = 0.3;
/// By more than this, it is on a sharp rim, of at least so many points.
const SHARP: f32 = 1.0;
const RIM: usize = 16;
/// So much of them makes grooves. (Of the bodies of the press set, 1 mm deep, parallel and crossed lines have 0.7, all others at most
/// 0.22; lines 0.5 mm deep have 0.34.)
const GROOVED: f32 = 0.3;

/// What of a lattice is on a crest. A cell there is as high as its points: the mean of a rim with what lies before and behind it is
/// lower and farther back, and shadows would be too short by half a cell.
struct Crests {
    points: Vec<Vec3>,
    /// How many of them are on a sharp rim.
    sharp: usize,
}

impl Crests {
    fn of(positions: &[Vec3], lattice: [usize; 2]) -> Self {
        let found = crests(positions, lattice);
        let sharp = found.iter().filter(|(_, breaks)| *breaks > SHARP).count();
        Self { points: found.into_iter().map(|(p, _)| p).collect(), sharp }
    }
}

/// The points of a lattice that are on a crest, and by how much the slope breaks.
fn crests(positions: &[Vec3], [nx, ny]: [usize; 2]) -> Vec<(Vec3, f32)> {
    // By how much the slope falls at a point, from those before and after it.
    let breaks = |before: Vec3, p: Vec3, after: Vec3| {
        let fall = 2.0 * p.z - before.z - after.z;
        let length2 = (after - before).truncate().length_squared().max(1e-12);
        // (Most points lie so level that neither the root nor the division is needed.)
        if fall > 0.0 && 4.0 * fall * fall > CREST * CREST * length2 {
            2.0 * fall / length2.sqrt()
        } else {
            0.0
        }
    };
    let in_row = |j: usize| {
        let row = &positions[j * nx..][..nx];
        let beside =
            [j.wrapping_sub(1), j + 1].map(|j| positions.get(j.wrapping_mul(nx)..).and_then(|p| p.get(..nx)));
        let mut found = Vec::new();
        for (i, p) in row.iter().enumerate() {
            let mut most = if i > 0 && i + 1 < nx { breaks(row[i - 1], *p, row[i + 1]) } else { 0.0 };
            if let [Some(above), Some(below)] = beside {
                most = most.max(breaks(above[i], *p, below[i]));
            }
            if most > 0.0 {
                found.push((*p, most));
            }
        }
        found
    };
    (0..ny).into_par_iter().with_min_len(16).flat_map_iter(in_row).collect()
}

/// The largest height within each reach of each coarse cell.
fn around(z: &[f32], size: [usize; 2], coarse: [usize; 2]) -> Vec<[f32; REACHES]> {
    let [nx, ny] = coarse;
    let mut largest = vec![f32::NEG_INFINITY; nx * ny];
    for (j, row) in z.chunks_exact(size[0]).enumerate() {
        let out = &mut largest[j / COARSE * nx..][..nx];
        for (out, cells) in out.iter_mut().zip(row.chunks(COARSE)) {
            *out = cells.iter().fold(*out, |most, z| if *z > most { *z } else { most });
        }
    }
    let mut around = vec![[0.0; REACHES]; nx * ny];
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    for k in 0..REACHES {
        // A square of twice the reach is the union of four about its quarters' middles (at the rim: of more than that). The
        // first step goes from a cell alone to its neighbours.
        let by = (1 << k) >> 1;
        let shift = |n: usize, i: usize| match by {
            0 => [i.saturating_sub(1), i, (i + 1).min(n - 1)],
            _ => [i.saturating_sub(by), (i + by).min(n - 1), (i + by).min(n - 1)],
        };
        let mut wide = vec![0.0; nx * ny];
        for (wide, row) in wide.chunks_exact_mut(nx).zip(largest.chunks_exact(nx)) {
            for (i, wide) in wide.iter_mut().enumerate() {
                let [a, b, c] = shift(nx, i);
                *wide = larger(row[a], larger(row[b], row[c]));
            }
        }
        for j in 0..ny {
            let [a, b, c] = shift(ny, j).map(|j| &wide[j * nx..][..nx]);
            let out = &mut largest[j * nx..][..nx];
            for (i, (out, around)) in out.iter_mut().zip(&mut around[j * nx..][..nx]).enumerate() {
                *out = larger(a[i], larger(b[i], c[i]));
                around[k] = *out;
            }
        }
    }
    around
}

/// Height at the middle of each cell, from the mean of the lattice's points in it and the slope to those of its neighbours; None
/// when a cell has none. (Cells hold one or two points each way, in turns: their mean lies beside the middle, on a slope too
/// high or too low.)
fn binned(positions: &[Vec3], low: Vec2, cell: f32, size: [usize; 2]) -> Option<Vec<f32>> {
    let per_mm = 1.0 / cell;
    let [nx, ny] = size;
    // Offsets from the cell's middle, height and number.
    let part = |positions: &[Vec3]| {
        let mut sums = vec![Vec4::ZERO; nx * ny];
        for p in positions {
            let q = (p.truncate() - low) * per_mm;
            let (i, j) = ((q.x as usize).min(nx - 1), (q.y as usize).min(ny - 1));
            sums[j * nx + i] += Vec4::new(q.x - i as f32 - 0.5, q.y - j as f32 - 0.5, p.z, 1.0);
        }
        sums
    };
    let parts: Vec<_> = positions.par_chunks(positions.len().div_ceil(PARTS)).map(part).collect();
    let mean = |k: usize| {
        let mut sum = Vec4::ZERO;
        for part in &parts {
            sum += part[k];
        }
        sum / sum.w
    };
    let means: Vec<Vec4> = (0..nx * ny).into_par_iter().with_min_len(8192).map(mean).collect();
    let middle = |k: usize| {
        let mean = means[k];
        let mut z = mean.z;
        for (axis, step, at, n) in [(0, 1, k % nx, nx), (1, nx, k / nx, ny)] {
            if at == 0 || at + 1 == n {
                continue;
            }
            // The lesser of the slopes to both sides, so that what lies beyond an edge does not count.
            let (before, after) = (means[k - step], means[k + step]);
            let rise = |a: Vec4, b: Vec4| (b.z - a.z) / (b[axis] + 1.0 - a[axis]).max(0.5);
            let (left, right) = (rise(before, mean), rise(mean, after));
            if left * right > 0.0 {
                z -= mean[axis] * if left.abs() < right.abs() { left } else { right };
            }
        }
        z
    };
    let z: Vec<f32> = (0..nx * ny).into_par_iter().with_min_len(8192).map(middle).collect();
    // Nothing over nothing where a cell has no point.
    z.iter().all(|z| !z.is_nan()).then_some(z)
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

    #[test]
    fn beside_an_edge_that_has_drawn_in_the_pad_is_as_high_as_its_edge() {
        // Corners reach further than sides, and the middle is pressed.
        let n = 101;
        let at = |k: usize| {
            let (x, y) = ((k % n) as f32 * 0.2 - 10.0, (k / n) as f32 * 0.2 - 10.0);
            let drawn_in = 1.0 - 0.1 * (1.0 - (y / 10.0).powi(2));
            Vec3::new(x * drawn_in, y, if x.hypot(y) < 3.0 { 1.0 } else { 0.1 })
        };
        let positions: Vec<Vec3> = (0..n * n).map(at).collect();
        let heights = Heights::new(&positions, [n, n], 0.2);
        for place in [Vec2::new(9.9, 0.0), Vec2::new(-9.9, 0.5), Vec2::new(12.0, 0.0)] {
            assert!(!heights.height((place - heights.low) / heights.cell).is_finite(), "{place}");
            assert!((heights.at(place) - 0.1).abs() < 1e-6, "{place}: {}", heights.at(place));
        }
    }

    /// However cells lie on the lattice, whose points are nearly as far apart as they are, a sharp rim is seen as high and as far
    /// as it is: a ridge of one point's width as well.
    #[test]
    fn a_rim_between_cells_is_where_it_is() {
        let n = 201;
        for ridge in [0.0, 0.04] {
            let at = |k: usize| {
                let (i, j) = (k % n, k / n);
                let z = if i < 100 { 0.8 } else { (0.5 - 0.1 * (i - 100) as f32).max(0.0) };
                let z = if i == 99 { z + ridge } else { z };
                Vec3::new(i as f32 * 0.067, j as f32 * 0.067, z)
            };
            let positions: Vec<Vec3> = (0..n * n).map(at).collect();
            let rim = at(99);
            let (mut sum, mut count) = (0.0, 0.0);
            for cell in [0.072, 0.0737, 0.075] {
                let heights = Heights::new(&positions, [n, n], cell);
                for k in 0..200 {
                    let p = Vec3::new(rim.x + 2.0 + 0.007 * k as f32, 5.0 + 0.011 * k as f32, 0.0);
                    let ahead = Vec2::from_angle(std::f32::consts::PI + 0.4);
                    let found = heights.horizon(p, ahead, 9.0, 0.01, 2.0);
                    let farther = rim.z / found - (p.x - rim.x) / ahead.x.abs();
                    (sum, count) = (sum + farther, count + 1.0);
                }
            }
            assert!((sum / count).abs() < 0.02, "{ridge}: {}", sum / count);
        }
    }

    /// However looks at it fall, the rim of a plateau is seen from afar where it is.
    #[test]
    fn a_rim_is_where_it_is() {
        let n = 301;
        let at = |k: usize| {
            let (x, y) = ((k % n) as f32 * 0.05 - 7.5, (k / n) as f32 * 0.05 - 7.5);
            Vec3::new(x, y, 1.0 - 5.0 * (x.abs() - 2.0).clamp(0.0, 0.2))
        };
        let positions: Vec<Vec3> = (0..n * n).map(at).collect();
        // (Cells lie otherwise on the points each time.)
        let mut sum = 0.0;
        for cell in [0.052, 0.053, 0.054, 0.055, 0.056, 0.057, 0.058, 0.059] {
            let heights = Heights::new(&positions, [n, n], cell);
            for k in 0..50 {
                let x = -6.0 + 0.013 * k as f32;
                let found = heights.horizon(Vec3::new(x, 0.1, 0.0), Vec2::X, 12.0, 0.01, 2.0);
                let farther = 1.0 / found - (-2.0 - x);
                assert!(farther.abs() < 0.06, "{x}: {farther}");
                sum += farther / 400.0;
            }
        }
        assert!(sum.abs() < 0.015, "{sum}");
    }

    /// Cells that are a little higher than a place on a flank are that flank; a wall as near is not.
    #[test]
    fn what_is_near_a_place_on_a_flank_must_stand_clear_of_it() {
        let (n, cell) = (301, 0.04);
        let at = |k: usize| {
            let (x, y) = ((k % n) as f32 * 0.03 - 4.5, (k / n) as f32 * 0.03 - 4.5);
            Vec3::new(x, y, if x > 0.1 { 1.0 } else { 0.0 })
        };
        let positions: Vec<Vec3> = (0..n * n).map(at).collect();
        let heights = Heights::new(&positions, [n, n], cell);
        let below = Vec3::new(0.04, 0.1, -0.03);
        let on = Stand::on(below, Vec3::new(0.0, -4.0, 1.0).normalize());
        let horizon = |from: Stand, ahead: Vec2| heights.horizon(from, ahead, 4.0, 0.01, 20.0);
        for along in [Vec2::from_angle(2.8), Vec2::from_angle(3.4)] {
            let (of_point, of_flank) = (horizon(below.into(), along), horizon(on, along));
            assert!(of_point > 0.4 && of_flank < 0.03 / (NEAR * cell), "{of_point} {of_flank}");
        }
        assert!(horizon(on, Vec2::X) > 5.0 && horizon(below.into(), Vec2::X) > 5.0);
    }
}
