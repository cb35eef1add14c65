//! Pictures times what a press changes in their indirect light: known for cells, wanted at pixels.
//!
//! Between the middles of cells it is bilinear, but for steps: there each side has its own, and upright flanks have theirs, which
//! are not those of what is level beside them. A pixel over the edge of one is taken apart.

use super::frame::NODE_PX;
use super::traces;
use crate::optics::Film;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Between cells whose heights differ by more, gains are those of cells that are as high as the pixel, within so much, mm.
const TORN_MM: f32 = 0.3;
const ALIKE_MM: f32 = 0.1;
/// What a cell of the other kind, flank or level, counts where there is one of the same.
const OTHER: f32 = 1e-4;

/// A pixel of which a part shows an upright flank.
#[derive(Debug, Clone, PartialEq)]
pub struct Split {
    /// Column and row.
    pub pixel: [usize; 2],
    /// How high the rest of it is, mm.
    pub level_mm: f32,
    /// The light of that part, by picture.
    pub flank: Vec<Vec3>,
}

/// What is known of a pixel.
#[derive(Clone, Copy)]
enum Kind {
    /// How high it is, mm.
    Level(f32),
    Flank,
}

/// A picture's gains, by cell.
pub struct Gains<'a> {
    pub gains: &'a [Vec3],
    /// Mean heights of the cells, mm.
    pub lifts: &'a [f32],
    /// Which cells stand for upright flanks.
    pub flanks: &'a [bool],
    /// Cells along x.
    pub columns: usize,
    /// Pixels along the edge of a cell.
    pub cell_px: usize,
    /// By row of nodes.
    pub splits: &'a [Vec<Split>],
    /// By pixel: whether it shows nothing of the pad, whose gains are not for it. Empty where all do.
    pub hidden: &'a [bool],
}

/// Multiplies pictures, each by its own; the sums of squares of what changes, as in [`traces`]. `radiances` are those of the
/// scene. `height_mm` tells how high a pixel is, if it sees the pad, `veil` what of a picture's light there is not the pad's.
pub fn apply(
    all: &[Gains<'_>],
    films: &mut [Film],
    radiances: &[Vec3],
    height_mm: impl Fn(usize, usize) -> Option<f32> + Sync,
    veil: impl Fn(usize, usize, usize) -> Vec3 + Sync,
) -> Vec<f64> {
    let (width, count) = (films.first().map_or(0, |film| film.width), traces::count(films.len()));
    let columns: Vec<(usize, f32)> = (0..width).map(|x| all[0].across(x)).collect();
    // Row by row, so that what the pictures gain together is added up while it is at hand.
    let mut rows: Vec<Vec<&mut [Vec3]>> = Vec::new();
    for film in films {
        rows.resize_with(film.height, Vec::new);
        rows.iter_mut().zip(film.pixels.chunks_mut(width)).for_each(|(row, pixels)| row.push(pixels));
    }
    let row = |(y, pictures): (usize, Vec<&mut [Vec3]>)| {
        let mut squares = vec![0.0; count];
        let mut together = vec![Vec3::ZERO; if count > 1 { width } else { 0 }];
        for (k, row) in pictures.into_iter().enumerate() {
            let changed = |x: usize, change: Vec3| {
                if let Some(sum) = together.get_mut(x) {
                    *sum += change * radiances[k];
                }
            };
            let veil = |x: usize, y: usize| veil(k, x, y);
            squares[k] = all[k].row(y, row, &columns, k, (&height_mm, &veil), changed);
        }
        if let [_, .., of_sum] = &mut squares[..] {
            *of_sum = together.iter().map(|change| f64::from(change.length_squared())).sum();
        }
        squares
    };
    let by_row: Vec<Vec<f64>> = rows.into_par_iter().enumerate().map(row).collect();
    (0..count).map(|k| by_row.iter().map(|squares| squares[k]).sum()).collect()
}

impl Gains<'_> {
    /// The cell before the middle of a pixel along x, and how far that is towards the next.
    fn across(&self, x: usize) -> (usize, f32) {
        let at = ((x as f32 + 0.5) / self.cell_px as f32 - 0.5).max(0.0);
        let i = (at as usize).min(self.columns - 1);
        (i, at - i as f32)
    }

    fn row(
        &self,
        y: usize,
        row: &mut [Vec3],
        columns: &[(usize, f32)],
        index: usize,
        (height_mm, veil): (&impl Fn(usize, usize) -> Option<f32>, &impl Fn(usize, usize) -> Vec3),
        mut changed: impl FnMut(usize, Vec3),
    ) -> f64 {
        let nx = self.columns;
        let last = self.gains.len() / nx - 1;
        let at = ((y as f32 + 0.5) / self.cell_px as f32 - 0.5).max(0.0);
        let j = (at as usize).min(last);
        let (t, next) = (at - j as f32, (j + 1).min(last));
        let (above, below) = (&self.gains[j * nx..][..nx], &self.gains[next * nx..][..nx]);
        if above.iter().chain(below).all(|g| *g == Vec3::ONE) {
            return 0.0;
        }
        let column: Vec<Vec3> = above.iter().zip(below).map(|(a, b)| a.lerp(*b, t)).collect();
        let around = |i: usize| {
            [j * nx + i, j * nx + (i + 1).min(nx - 1), next * nx + i, next * nx + (i + 1).min(nx - 1)]
        };
        let torn = |four: [usize; 4]| {
            let z = four.map(|k| self.lifts[k]);
            let [low, high] = z.iter().fold([z[0]; 2], |[l, h], z| [l.min(*z), h.max(*z)]);
            high - low > TORN_MM || four.iter().any(|k| self.flanks[*k])
        };
        let torn: Vec<bool> = (0..nx).map(|i| torn(around(i))).collect();
        let of_kind = |x: usize, kind: Kind| {
            let (i, s) = columns[x];
            self.of_kind(around(i), Vec2::new(s, t), kind)
        };
        // Flanks wait aside while the rest of the row is multiplied.
        let splits = self.splits[y / NODE_PX].iter().filter(|split| split.pixel[1] == y);
        let splits: Vec<&Split> = splits.filter(|split| torn[columns[split.pixel[0]].0]).collect();
        let mut levels: Vec<Option<f32>> = vec![None; if splits.is_empty() { 0 } else { row.len() }];
        for split in &splits {
            row[split.pixel[0]] -= split.flank[index];
            levels[split.pixel[0]] = Some(split.level_mm);
        }
        let mut sum = 0.0;
        let hidden = self.hidden.get(y * row.len()..).unwrap_or_default();
        for (x, pixel) in row.iter_mut().enumerate() {
            if hidden.get(x).is_some_and(|hidden| *hidden) {
                continue;
            }
            let (i, s) = columns[x];
            let mut gain = column[i].lerp(column[(i + 1).min(nx - 1)], s);
            if torn[i] {
                let beside_flank = levels.get(x).copied().flatten();
                let Some(height_mm) = beside_flank.or_else(|| height_mm(x, y)) else { continue };
                gain = of_kind(x, Kind::Level(height_mm));
            }
            let add = (*pixel - veil(x, y)) * (gain - Vec3::ONE);
            sum += f64::from(add.length_squared());
            *pixel += add;
            changed(x, add);
        }
        for split in splits {
            let (x, light) = (split.pixel[0], split.flank[index]);
            let gained = light * of_kind(x, Kind::Flank);
            sum += f64::from((gained - light).length_squared());
            changed(x, gained - light);
            row[x] += gained;
        }
        sum
    }

    /// The gain between four cells, by those of the same kind.
    fn of_kind(&self, four: [usize; 4], at: Vec2, kind: Kind) -> Vec3 {
        let (s, t) = (at.x, at.y);
        let parts = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
        let (mut sum, mut whole) = (Vec3::ZERO, 1e-12);
        for (part, k) in parts.into_iter().zip(four) {
            let Kind::Level(z) = kind else {
                let weight = part * if self.flanks[k] { 1.0 } else { OTHER };
                (sum, whole) = (sum + self.gains[k] * weight, whole + weight);
                continue;
            };
            let (gain, alike) = match self.flanks[k] {
                false => (self.gains[k], self.alike(k, z)),
                true => self.beside_flank(k, z).unwrap_or((self.gains[k], OTHER)),
            };
            let weight = part * alike;
            (sum, whole) = (sum + gain * weight, whole + weight);
        }
        sum / whole
    }

    /// How much a cell counts for what is so high, mm.
    fn alike(&self, k: usize, z: f32) -> f32 {
        1.0 / (1.0 + ((z - self.lifts[k]) / ALIKE_MM).powi(2))
    }

    /// What level ground so high would gain in a flank's cell, by those of its neighbours that are as high, and what it counts:
    /// up to the flank the level goes on as before it.
    fn beside_flank(&self, flank: usize, z: f32) -> Option<(Vec3, f32)> {
        let (i, j) = ((flank % self.columns) as isize, (flank / self.columns) as isize);
        let [nx, ny] = [self.columns as isize, (self.gains.len() / self.columns) as isize];
        let level = |i: isize, j: isize| {
            let is_inside = (0..nx).contains(&i) && (0..ny).contains(&j);
            let k = is_inside.then(|| (j * nx + i) as usize)?;
            (!self.flanks[k] && (z - self.lifts[k]).abs() < ALIKE_MM).then_some(k)
        };
        let (mut sum, mut whole) = (Vec3::ZERO, 0.0);
        for (di, dj) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
            let (Some(near), far) = (level(i + di, j + dj), level(i + 2 * di, j + 2 * dj)) else { continue };
            let (a, b) = (self.gains[near], self.gains[far.unwrap_or(near)]);
            let weight = self.alike(near, z);
            sum += (a + (a - b)).clamp(0.5 * a, 2.0 * a) * weight;
            whole += weight;
        }
        (whole > 0.0).then(|| (sum / whole, whole.min(1.0)))
    }
}
