//! The relief of the gel's face under an indenter, by Gaussians on its height map.
//!
//! The relief counts towards the camera: what the indenter presses in bulges towards the lens. With
//! p(x, y) the penetration of the indenter into the undeformed face (its height map clipped at the depth)
//! and G(s) a Gaussian of standard deviation s, the relief is
//!   G(membrane) max(p, skirt * G(skirt) p)  -  rim * G(rim) p:
//! the gel is nowhere above the indenter and sinks with it around the contact; the membrane rounds
//! edges; the difference to the widest Gaussian raises a rim beyond. Widths and weights are found by
//! experiment.

use super::Drag;
use super::look::SensorLook;
use crate::indenter::Indenter;
use crate::pose::Pose;
use rayon::prelude::*;
use std::sync::Arc;

/// Standard deviations, mm.
const SKIRT_MM: f64 = 0.45;
const RIM_MM: f64 = 1.3;
/// Weights of the wider Gaussians.
const SKIRT: f32 = 1.25;
const RIM: f32 = 0.30;
/// Gel piled up ahead of a dragged contact, as a factor on the skirt's slope.
const PILE_UP: f32 = 0.35;
/// The wide Gaussians are computed on a grid so many times coarser.
const COARSE: usize = 4;
/// A lower surface this far above the tip never touches, mm.
const NEVER_MM: f32 = 6.0;

/// The lower surface of an indenter on a lattice in its own frame.
#[derive(Debug)]
pub struct IndenterMap {
    of: Arc<dyn Indenter>,
    half_mm: [f64; 2],
    step_mm: f64,
    columns: usize,
    rows: usize,
    height_mm: Vec<f32>,
}

impl IndenterMap {
    /// Samples `indenter` every `step_mm`.
    pub fn new(indenter: &Arc<dyn Indenter>, step_mm: f64) -> Self {
        // One cell beyond the body on each side, so that the body's own edge is interpolated.
        let half_mm = indenter.half_extent_mm().map(|half| half.min(40.0) + 2.0 * step_mm);
        let [columns, rows] = half_mm.map(|half| (2.0 * half / step_mm).ceil() as usize + 2);
        let height_mm = (0..rows)
            .into_par_iter()
            .flat_map_iter(|j| {
                (0..columns).map(move |i| {
                    let (x, y) = (i as f64 * step_mm - half_mm[0], j as f64 * step_mm - half_mm[1]);
                    indenter.lower_surface(x, y).map_or(NEVER_MM, |z| (z as f32).min(NEVER_MM))
                })
            })
            .collect();
        Self { of: Arc::clone(indenter), half_mm, step_mm, columns, rows, height_mm }
    }

    /// Whether this is the map of that very indenter.
    pub fn is_of(&self, indenter: &Arc<dyn Indenter>) -> bool {
        Arc::ptr_eq(&self.of, indenter)
    }

    /// Height of the lower surface at a place of the indenter's frame, mm.
    fn at(&self, x_mm: f64, y_mm: f64) -> f32 {
        let (u, v) = ((x_mm + self.half_mm[0]) / self.step_mm, (y_mm + self.half_mm[1]) / self.step_mm);
        if !(u >= 0.0 && v >= 0.0) {
            return NEVER_MM;
        }
        let (i, j) = (u as usize, v as usize);
        if i + 1 >= self.columns || j + 1 >= self.rows {
            return NEVER_MM;
        }
        let (fx, fy) = ((u - i as f64) as f32, (v - j as f64) as f32);
        let row = |j: usize| {
            let k = j * self.columns + i;
            self.height_mm[k] + (self.height_mm[k + 1] - self.height_mm[k]) * fx
        };
        let (top, bottom) = (row(j), row(j + 1));
        top + (bottom - top) * fy
    }
}

/// The deformed part of the face, on the camera's pixel grid.
#[derive(Debug)]
pub struct Relief {
    /// First column and row.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Towards the camera, px (so that slopes are differences), row by row.
    pub px: Vec<f32>,
    /// Largest relief, px.
    pub highest_px: f32,
    /// Where the indenter's axis stands, px.
    pub centre: [f32; 2],
}

impl Relief {
    /// The relief under `map` at `pose`; `None` where nothing touches inside the picture.
    pub fn of(
        look: &SensorLook,
        shift_px: [f64; 2],
        pose: &Pose,
        map: &IndenterMap,
        drag: &Drag,
    ) -> Option<Relief> {
        let (w, h) = (look.width as usize, look.height as usize);
        let per_px = look.mm_per_px;
        let origin = [0.5 * w as f64 + shift_px[0], 0.5 * h as f64 + shift_px[1]];
        let centre = [origin[0] + pose.x_mm / per_px, origin[1] + pose.y_mm / per_px];

        // 1. Where the indenter can touch: the body's turned bounding box.
        let (sin, cos) = pose.theta_deg.to_radians().sin_cos();
        let [hx, hy] = map.half_mm;
        let reach = [hx * cos.abs() + hy * sin.abs(), hx * sin.abs() + hy * cos.abs()];
        let limit = |c: f64, n: usize| (c.floor().max(0.0) as usize).min(n);
        let [x_from, x_to] = [-1.0, 1.0].map(|s| limit(centre[0] + s * reach[0] / per_px + s, w));
        let [y_from, y_to] = [-1.0, 1.0].map(|s| limit(centre[1] + s * reach[1] / per_px + s, h));
        if x_from >= x_to || y_from >= y_to {
            return None;
        }

        // 2. Penetration, and where it is.
        let depth_mm = -pose.z_mm as f32;
        let columns = x_to - x_from;
        let mut penetration = vec![0.0f32; columns * (y_to - y_from)];
        let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
        for (row, y) in penetration.chunks_exact_mut(columns).zip(y_from..) {
            let dy = (y as f64 + 0.5 - centre[1]) * per_px;
            for (p, x) in row.iter_mut().zip(x_from..) {
                let dx = (x as f64 + 0.5 - centre[0]) * per_px;
                *p = (depth_mm - map.at(cos * dx + sin * dy, cos * dy - sin * dx)).max(0.0);
                if *p > 0.0 {
                    (left, right) = (left.min(x), right.max(x));
                    (top, bottom) = (top.min(y), bottom.max(y));
                }
            }
        }
        if left > right {
            return None;
        }

        // 3. A window with room for the widest Gaussian, a whole number of coarse cells.
        let margin = (3.2 * RIM_MM / per_px) as usize + 2 * COARSE;
        let whole = |n: usize| n.div_ceil(COARSE) * COARSE;
        let (x0, y0) = (left.saturating_sub(margin), top.saturating_sub(margin));
        let (width, height) = (whole((right + margin).min(w) - x0), whole((bottom + margin).min(h) - y0));
        let mut px = vec![0.0f32; width * height];
        for y in top..=bottom {
            let from = &penetration[(y - y_from) * columns + (left - x_from)..][..right - left + 1];
            px[(y - y0) * width + (left - x0)..][..from.len()].copy_from_slice(from);
        }
        px.iter_mut().for_each(|p| *p /= per_px as f32);

        // 4. The wide Gaussians on the coarse grid, the narrow one on the pixels.
        let (cw, ch) = (width / COARSE, height / COARSE);
        let coarse = shrink(&px, width, cw, ch);
        let coarse_px = COARSE as f64 * per_px;
        let skirt = gaussian(coarse.clone(), cw, SKIRT_MM / coarse_px);
        let rim = gaussian(coarse, cw, RIM_MM / coarse_px);
        let drag_px = [drag.x_mm, drag.y_mm].map(|d| (d / per_px) as f32);
        combine_enlarged(&mut px, width, &skirt, cw, ch, |p, s| p.max(SKIRT * s));
        let mut px = gaussian(px, width, look.membrane_mm / per_px);
        let around = surroundings(&skirt, &rim, cw, ch, drag_px);
        combine_enlarged(&mut px, width, &around, cw, ch, |p, a| p + a);

        let highest_px = px.iter().copied().fold(0.0, f32::max);
        Some(Relief { x0, y0, width, height, px, highest_px, centre: centre.map(|c| c as f32) })
    }
}

/// The rim, and what a drag piles up ahead of the contact: the face rises, away from the camera, where
/// the skirt falls along the drag.
fn surroundings(skirt: &[f32], rim: &[f32], cw: usize, ch: usize, drag_px: [f32; 2]) -> Vec<f32> {
    let mut wide: Vec<f32> = rim.iter().map(|r| -RIM * r).collect();
    if drag_px != [0.0, 0.0] {
        let per_cell = 0.5 / COARSE as f32;
        for y in 1..ch - 1 {
            for x in 1..cw - 1 {
                let i = y * cw + x;
                let slope =
                    [skirt[i + 1] - skirt[i - 1], skirt[i + cw] - skirt[i - cw]].map(|d| d * per_cell);
                wide[i] += PILE_UP * (slope[0] * drag_px[0] + slope[1] * drag_px[1]);
            }
        }
    }
    wide
}

/// Means of `COARSE` x `COARSE` cells.
fn shrink(fine: &[f32], width: usize, cw: usize, ch: usize) -> Vec<f32> {
    let mut coarse = vec![0.0; cw * ch];
    for (y, row) in fine.chunks_exact(width).enumerate() {
        for (cell, four) in coarse[(y / COARSE) * cw..].iter_mut().zip(row.chunks_exact(COARSE)) {
            *cell += four.iter().sum::<f32>();
        }
    }
    let scale = 1.0 / (COARSE * COARSE) as f32;
    coarse.iter_mut().for_each(|c| *c *= scale);
    coarse
}

/// Combines a map with a coarse one, interpolated bilinearly between the centres of its cells.
fn combine_enlarged(
    fine: &mut [f32],
    width: usize,
    coarse: &[f32],
    cw: usize,
    ch: usize,
    with: impl Fn(f32, f32) -> f32,
) {
    let place = |i: usize, n: usize| {
        let u = ((i as f32 + 0.5) / COARSE as f32 - 0.5).clamp(0.0, (n - 1) as f32);
        let cell = (u as usize).min(n.saturating_sub(2));
        (cell, u - cell as f32)
    };
    let columns: Vec<(usize, f32)> = (0..width).map(|x| place(x, cw)).collect();
    let mut line = vec![0.0f32; cw];
    for (y, row) in fine.chunks_exact_mut(width).enumerate() {
        let (j, fy) = place(y, ch);
        let (upper, lower) = (&coarse[j * cw..][..cw], &coarse[(j + 1).min(ch - 1) * cw..][..cw]);
        for ((l, a), b) in line.iter_mut().zip(upper).zip(lower) {
            *l = a + (b - a) * fy;
        }
        for (p, (i, fx)) in row.iter_mut().zip(&columns) {
            *p = with(*p, line[*i] + (line[(i + 1).min(cw - 1)] - line[*i]) * fx);
        }
    }
}

/// A Gaussian of `sigma` cells as three box filters in each direction (Wells 1986; widths by Kovesi 2010).
fn gaussian(map: Vec<f32>, width: usize, sigma: f64) -> Vec<f32> {
    let height = map.len() / width;
    let radii = box_radii(sigma);
    let mut across = map;
    let mut other = vec![0.0; across.len()];
    for r in radii {
        for (from, to) in across.chunks_exact(width).zip(other.chunks_exact_mut(width)) {
            box_row(from, to, r);
        }
        std::mem::swap(&mut across, &mut other);
    }
    // Down the columns, whole rows at a time: a running sum for each column.
    let mut sums = vec![0.0f32; width];
    for r in radii {
        let scale = 1.0 / (2 * r + 1) as f32;
        sums.fill(0.0);
        for row in across.chunks_exact(width).take(r) {
            sums.iter_mut().zip(row).for_each(|(s, v)| *s += v);
        }
        for y in 0..height {
            if let Some(row) = across.chunks_exact(width).nth(y + r) {
                sums.iter_mut().zip(row).for_each(|(s, v)| *s += v);
            }
            other[y * width..][..width].iter_mut().zip(&sums).for_each(|(o, s)| *o = s * scale);
            if y >= r {
                let row = &across[(y - r) * width..][..width];
                sums.iter_mut().zip(row).for_each(|(s, v)| *s -= v);
            }
        }
        std::mem::swap(&mut across, &mut other);
    }
    across
}

/// Radii of three boxes whose variances add up to about `sigma` squared.
fn box_radii(sigma: f64) -> [usize; 3] {
    let lower = (((4.0 * sigma * sigma + 1.0).sqrt() - 1.0) / 2.0).floor();
    // n boxes of the next size up, the rest of the lower size.
    let of = |r: f64| (2.0 * r + 1.0).powi(2) - 1.0;
    let missing = 12.0 * sigma * sigma - 3.0 * of(lower);
    let larger = (missing / (of(lower + 1.0) - of(lower))).round().clamp(0.0, 3.0) as usize;
    std::array::from_fn(|i| lower as usize + usize::from(i < larger))
}

fn box_row(from: &[f32], to: &mut [f32], r: usize) {
    let scale = 1.0 / (2 * r + 1) as f32;
    let mut sum: f32 = from.iter().take(r).sum();
    for (x, out) in to.iter_mut().enumerate() {
        sum += from.get(x + r).copied().unwrap_or(0.0);
        *out = sum * scale;
        if x >= r {
            sum -= from[x - r];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_boxes_are_a_gaussian() {
        for sigma in [2.0, 4.0, 9.0] {
            let (w, c) = (121, 60);
            let mut impulse = vec![0.0; w * w];
            impulse[c * w + c] = 1.0;
            let blurred = gaussian(impulse, w, sigma);
            let total: f32 = blurred.iter().sum();
            assert!((total - 1.0).abs() < 1e-3, "light is kept: {total}");
            let variance: f32 =
                blurred.iter().enumerate().map(|(i, v)| v * ((i % w) as f32 - c as f32).powi(2)).sum();
            let error = (f64::from(variance).sqrt() / sigma - 1.0).abs();
            // Boxes have whole radii: with three of radius r the variance is r (r + 1), and the next one that can be
            // reached is 2 (r + 1) / 3 away, so the nearest misses sigma by at most (r + 1) / (6 sigma^2).
            let r = ((1.0 + 4.0 * sigma * sigma).sqrt() - 1.0) / 2.0;
            assert!(error < (r + 1.0) / (6.0 * sigma * sigma), "sigma {sigma}: {}", variance.sqrt());
            // Three boxes are flatter than the Gaussian of their own width: 0.94 of its height along each axis.
            let peak = f64::from(blurred[c * w + c]) * std::f64::consts::TAU * f64::from(variance);
            assert!((peak - 0.94 * 0.94).abs() < 0.02, "sigma {sigma}: peak {peak} of a Gaussian's");
        }
    }
}
