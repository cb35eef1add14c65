//! What the pad hides of a light: horizons over its height field.
//!
//! Along a level direction the pad hides everything below the steepest line of sight over it. A light is cut into a few
//! upright strips; each is clipped at the horizon of its middle and at the receiver's own plane, and what is left has its
//! irradiance in closed form: penumbras without noise. A coarse map of largest heights tells beforehand where
//! nothing can be hidden.

use super::raster::Projected;
use super::vector::{Polygon, irradiance};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Strips of a light (found by experiment: 4 instead cost half as much again and gain 0.002 % on the benchmark scene).
const STRIPS: usize = 2;
/// Fine cells in a coarse one, each way.
const COARSE: usize = 4;
/// Lines of sight this close to the pad (as a slope) are looked at more closely.
const DOUBT: f32 = 0.02;

/// The pad seen from above.
pub struct Heights {
    low: Vec2,
    cell: f32,
    size: [usize; 2],
    /// Heights at the cells' middles; minus infinity where there is no pad.
    z: Vec<f32>,
    coarse: [usize; 2],
    /// Largest and mean height of each coarse cell.
    pools: Vec<[f32; 2]>,
    highest: f32,
}

/// A rectangular light as the horizons see it.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Corners, counter-clockwise as seen from the shining side.
    pub corners: [Vec3; 4],
    /// Unit normal.
    pub normal: Vec3,
}

impl Panel {
    /// From a rectangle's corners; the strips will run across its more level edge.
    pub fn new(corners: [Vec3; 4]) -> Self {
        let (u, v) = (corners[1] - corners[0], corners[3] - corners[0]);
        let level = |e: Vec3| e.z.abs() / e.length().max(1e-20);
        let [a, b, c, d] = corners;
        let normal = u.cross(v).normalize_or_zero();
        let corners = if level(u) <= level(v) { corners } else { [b, c, d, a] };
        Self { corners, normal }
    }

    /// Whether a point is on the shining side.
    #[inline]
    pub fn faces(&self, point: Vec3) -> bool {
        let to = point - self.corners[0];
        to.dot(self.normal) > 1e-6 * to.length()
    }
}

impl Heights {
    /// Looks at a lattice from above, with cells of about `cell` mm.
    pub fn new(positions: &[Vec3], lattice: [usize; 2], cell: f32) -> Self {
        let inf = Vec3::splat(f32::INFINITY);
        let [low, high] = positions.iter().fold([inf, -inf], |[l, h], p| [l.min(*p), h.max(*p)]);
        let extent = (high - low).truncate();
        let cell = cell.max(extent.max_element() / 2048.0).max(1e-6);
        let size = [(extent.x / cell) as usize + 1, (extent.y / cell) as usize + 1];
        let vertices: Vec<Vec3> =
            positions.par_iter().map(|p| ((p.truncate() - low.truncate()) / cell).extend(p.z)).collect();
        let drawn = Projected { lattice, vertices: &vertices };
        let z: Vec<f32> = drawn
            .bands(size[0], size[1], 0, |_, band| band.iter().map(|s| s.value).collect::<Vec<_>>())
            .concat();
        let coarse = [size[0].div_ceil(COARSE), size[1].div_ceil(COARSE)];
        let pools = (0..coarse[0] * coarse[1])
            .map(|k| {
                let (i0, j0) = (k % coarse[0] * COARSE, k / coarse[0] * COARSE);
                let (mut top, mut sum, mut n) = (f32::NEG_INFINITY, 0.0, 0);
                for j in j0..(j0 + COARSE).min(size[1]) {
                    for z in &z[j * size[0] + i0..j * size[0] + (i0 + COARSE).min(size[0])] {
                        if z.is_finite() {
                            (top, sum, n) = (top.max(*z), sum + z, n + 1);
                        }
                    }
                }
                [top, if n > 0 { sum / n as f32 } else { f32::NEG_INFINITY }]
            })
            .collect();
        Self { low: low.truncate(), cell, size, z, coarse, pools, highest: high.z }
    }

    /// Height of the pad at a place, or of the nearest part of it.
    pub fn at(&self, p: Vec2) -> f32 {
        let q = (p - self.low) / self.cell;
        let most = Vec2::new(self.size[0] as f32, self.size[1] as f32) - 1.51;
        let z = self.height(q.min(most).max(Vec2::splat(0.5)));
        if z.is_finite() { z } else { self.highest }
    }

    /// By coarse cell and panel: whether some of the pad may hide some of the panel from there.
    pub fn doubts(&self, panels: &[Panel]) -> Vec<bool> {
        let n = self.coarse[0] * self.coarse[1];
        (0..n * panels.len())
            .into_par_iter()
            .map(|k| self.doubtful(k / panels.len(), &panels[k % panels.len()]))
            .collect()
    }

    /// The coarse cell of a point.
    #[inline]
    pub fn coarse_cell(&self, p: Vec2) -> usize {
        let q = (p - self.low) / (self.cell * COARSE as f32);
        let i = (q.x.max(0.0) as usize).min(self.coarse[0] - 1);
        let j = (q.y.max(0.0) as usize).min(self.coarse[1] - 1);
        j * self.coarse[0] + i
    }

    fn doubtful(&self, cell: usize, panel: &Panel) -> bool {
        let step = self.cell * COARSE as f32;
        let centre = Vec2::new((cell % self.coarse[0]) as f32 + 0.5, (cell / self.coarse[0]) as f32 + 0.5);
        let [_, z] = self.pools[cell];
        if !z.is_finite() {
            return true;
        }
        let at = self.low + centre * step;
        let lowest = panel.corners.iter().fold(f32::INFINITY, |m, c| m.min(c.z));
        // Panels that reach down to the pad are always looked at.
        if lowest <= self.highest {
            return true;
        }
        const LINES: usize = 9;
        for line in 0..LINES {
            let s = line as f32 / (LINES - 1) as f32;
            let [a, b, c, d] = panel.corners;
            let end = [a.lerp(b, s), d.lerp(c, s)];
            let target = if end[0].z < end[1].z { end[0] } else { end[1] };
            let flat = target.truncate() - at;
            let distance = flat.length();
            if distance < 2.0 * step {
                return true;
            }
            let ahead = flat / distance;
            let slope = (target.z - z) / distance - DOUBT;
            let mut t = step;
            while t < distance && z + slope * t < self.highest {
                let q = (at + ahead * t - self.low) / step;
                if q.cmplt(Vec2::ZERO).any() {
                    break;
                }
                let (i, j) = (q.x as usize, q.y as usize);
                if i >= self.coarse[0] || j >= self.coarse[1] {
                    break;
                }
                if self.pools[j * self.coarse[0] + i][0] > z + slope * t {
                    return true;
                }
                t += 0.75 * step;
            }
        }
        false
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

    /// Irradiance from a panel of radiance 1 at a point of the pad with unit normal, what the pad hides left out.
    pub fn irradiance(&self, point: Vec3, normal: Vec3, panel: &Panel) -> f32 {
        if !panel.faces(point) {
            return 0.0;
        }
        let mut sum = 0.0;
        for strip in 0..STRIPS {
            let (s, t) = (strip as f32 / STRIPS as f32, (strip + 1) as f32 / STRIPS as f32);
            let [a, b, c, d] = panel.corners.map(|c| c - point);
            let corners = [a.lerp(b, s), a.lerp(b, t), d.lerp(c, t), d.lerp(c, s)];
            let quad = Polygon::quad(corners).clip(normal);
            if quad.corners().len() < 3 {
                continue;
            }
            let middle = 0.25 * corners.iter().sum::<Vec3>().truncate();
            let distance = middle.length();
            let visible = if distance > 0.0 {
                let ahead = middle / distance;
                // What is left, as slopes of the line of sight in the strip's direction.
                let slopes = quad.corners().iter().map(|c| c.z / c.truncate().dot(ahead).max(1e-6));
                let (low, high) =
                    slopes.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), s| (l.min(s), h.max(s)));
                let horizon = self.horizon(point, ahead, distance, low, high);
                if horizon >= high {
                    continue;
                }
                if horizon > low { quad.clip((-horizon * ahead).extend(1.0)) } else { quad }
            } else {
                quad
            };
            sum += irradiance(visible.corners()).dot(normal);
        }
        sum.max(0.0)
    }

    /// The steepest line of sight over the pad, at least `low`; some value of at least `high` when it is that high.
    fn horizon(&self, point: Vec3, ahead: Vec2, distance: f32, low: f32, high: f32) -> f32 {
        let mut slope = low;
        // The receiver's own cells say nothing beyond its normal.
        let mut t = 1.5 * self.cell;
        let start = (point.truncate() - self.low) / self.cell;
        let along = ahead / self.cell;
        let bias = 1e-3 * self.cell;
        let size = COARSE as f32;
        while t < distance && point.z + slope * t < self.highest && slope < high {
            let q = start + along * t;
            let block = (q / size).floor();
            let (i, j) = (block.x as usize, block.y as usize);
            if block.cmplt(Vec2::ZERO).any() || i >= self.coarse[0] || j >= self.coarse[1] {
                break;
            }
            let least = point.z + slope * t + slope.min(0.0) * 2.0 * size * self.cell;
            if self.pools[j * self.coarse[0] + i][0] <= least {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall across a flat pad: the light behind it is visible from the height at which the line of sight clears it.
    #[test]
    fn a_ridge_hides_what_is_below_its_line_of_sight() {
        let n = 201;
        let at = |k: usize| {
            let (x, y) = ((k % n) as f32 * 0.1 - 10.0, (k / n) as f32 * 0.1 - 10.0);
            Vec3::new(x, y, if (x - 2.0).abs() < 0.25 { 1.0 } else { 0.0 })
        };
        let positions: Vec<Vec3> = (0..n * n).map(at).collect();
        let heights = Heights::new(&positions, [n, n], 0.05);
        let light = |low: f32| {
            [
                Vec3::new(9.0, 2.0, low),
                Vec3::new(9.0, -2.0, low),
                Vec3::new(9.0, -2.0, 6.0),
                Vec3::new(9.0, 2.0, 6.0),
            ]
        };
        let panel = Panel::new(light(2.0));
        assert!(panel.normal.x < 0.0);
        // From x = 0 the ridge of height 1, whose near edge is at 1.8, hides the light up to 5; a cell further, to 4.8.
        let e = heights.irradiance(Vec3::ZERO, Vec3::Z, &panel);
        let truth = |low| crate::optics::irradiance::polygon(Vec3::ZERO, Vec3::Z, &light(low));
        assert!(e > 0.95 * truth(5.0) && e < truth(4.8), "{e} {} {}", truth(5.0), truth(4.8));
        let doubts = heights.doubts(std::slice::from_ref(&panel));
        assert!(doubts[heights.coarse_cell(Vec2::ZERO)]);
        assert!(!doubts[heights.coarse_cell(Vec2::new(5.0, 0.0))]);
    }
}
