//! Means over cells, as other cells see them: taken from the picture, and lit anew after a bounce.

use super::{Cells, MARGIN, Unseen, Untouched, beside};
use crate::optics::fast::lanes::{Eight, Vectors, WIDTH, lanes};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Up a flank the light changes by at most this part of it per mm.
const STEEPEST: f32 = 1.0;

/// Where an upright flank looks at what is at its foot: to these sides, and as far away over its height: a sixth each of what it gets of an
/// even face comes from between them.
const LOOKS: [f32; 4] = [-0.75, -0.25, 0.25, 0.75];
/// See [`LOOKS`].
const AWAY: [f32; 6] = [0.68, 1.22, 1.84, 2.83, 4.96, 15.2];
/// Part of its light that is left it at least.
const LEAST: f32 = 0.1;

/// Means over cells, by row with room on both sides so that eight neighbours can be looked at from any column, and with the
/// pad's border beside the picture.
pub(super) struct Means {
    pub(super) stride: usize,
    /// Rows above the picture, and below it.
    pub(super) beside: usize,
    /// Which cells beside the picture were taken from the mesh; empty where none was.
    pub(super) from_mesh: Vec<bool>,
    /// Minus infinity where nothing is.
    pub(super) heights: Vec<f32>,
    pub(super) places: [Vec<f32>; 2],
    pub(super) normals: [Vec<f32>; 3],
    /// As other cells see them: mixed with those of flanks that look away from the camera (from whichever side: of a ridge within one
    /// cell both flanks are). Empty where there are none.
    pub(super) shown_normals: [Vec<f32>; 3],
    /// By picture and colour: irradiance before any bounce, and as others see it.
    pub(super) own: Vec<[Vec<f32>; 3]>,
    pub(super) lights: Vec<[Vec<f32>; 3]>,
    /// The same of the untouched face there.
    pub(super) grounds: Vec<[Vec<f32>; 3]>,
    /// Areas of the cell and of the untouched face under it, mm^2, and the normal of that.
    pub(super) areas: [Vec<f32>; 2],
    pub(super) rest_normals: [Vec<f32>; 3],
    /// 1 where the cell stands for an upright flank. This and what follows is empty where there is none.
    pub(super) upright: Vec<f32>,
    /// How far below its middle a flank is looked at as well, mm; 0 elsewhere.
    pub(super) lower: Vec<f32>,
    /// By picture and colour: by how much its light changes with height, 1/mm, before any bounce and as others see it.
    own_tilts: Vec<[Vec<f32>; 3]>,
    pub(super) tilts: Vec<[Vec<f32>; 3]>,
    pub(super) highest: f32,
}

impl Means {
    /// Where the numbers of a cell stand.
    #[inline(always)]
    pub(super) fn at(&self, i: usize, j: usize) -> usize {
        (j + self.beside) * self.stride + MARGIN + i
    }

    #[inline(always)]
    pub(super) fn eight(numbers: &[f32], at: usize) -> Eight {
        let numbers = &numbers[at..at + WIDTH];
        Eight(lanes!(i => numbers[i]))
    }

    #[inline(always)]
    pub(super) fn light([x, y, z]: &[Vec<f32>; 3], at: usize) -> Vectors {
        Vectors { x: Self::eight(x, at), y: Self::eight(y, at), z: Self::eight(z, at) }
    }
}

impl Cells<'_> {
    pub(super) fn means(&self, untouched: Untouched<'_>) -> Means {
        let Untouched { ground, normal: rest, .. } = untouched;
        let [nx, ny] = self.size;
        let stride = nx.next_multiple_of(WIDTH) + 2 * MARGIN;
        let beside = beside(self.edge_mm);
        let row = |value: f32| vec![value; stride * (ny + 2 * beside)];
        let of_flanks = || if self.tilts.lights.is_empty() { Vec::new() } else { row(0.0) };
        let mut means = Means {
            stride,
            beside,
            from_mesh: vec![false; if self.unseen.is_empty() { 0 } else { stride * (ny + 2 * beside) }],
            heights: row(f32::NEG_INFINITY),
            places: [row(0.0), row(0.0)],
            normals: [row(0.0), row(0.0), row(1.0)],
            shown_normals: [const { Vec::new() }; 3],
            own: self.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            lights: Vec::new(),
            grounds: self.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            areas: [row(0.0), row(0.0)],
            rest_normals: [row(0.0), row(0.0), row(1.0)],
            upright: of_flanks(),
            lower: of_flanks(),
            own_tilts: self.tilts.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            tilts: Vec::new(),
            highest: f32::NEG_INFINITY,
        };
        let known = self.known_beside();
        for (k, cell) in self.cells.iter().enumerate().filter(|(_, c)| c.count > 0.0) {
            let at = means.at(k % nx, k / nx);
            let (p, n) = (cell.position / cell.count, cell.normal.normalize_or(Vec3::Z));
            (means.places[0][at], means.places[1][at], means.heights[at]) = p.into();
            (means.normals[0][at], means.normals[1][at], means.normals[2][at]) = n.into();
            means.highest = means.highest.max(p.z);
            if self.flanks[k] && !self.tilts.lights.is_empty() {
                (means.upright[at], means.lower[at]) = (1.0, self.tilts.lower_mm[k]);
                for (out, tilt) in means.own_tilts.iter_mut().zip(&self.tilts.lights) {
                    (out[0][at], out[1][at], out[2][at]) = tilt[k].into();
                }
            }
            for (out, light) in means.own.iter_mut().zip(self.lights) {
                let light = light[k] / cell.area;
                (out[0][at], out[1][at], out[2][at]) = light.into();
            }
            for (film, out) in means.grounds.iter_mut().enumerate() {
                (out[0][at], out[1][at], out[2][at]) = ground(film, p).into();
            }
            if self.echo.is_none() {
                continue;
            }
            let normal = rest(p);
            let part = cell.count / (cell.count.max(self.most_count));
            let part = part * (self.beyond([k % nx, k / nx], p) - known[k]).max(1.0);
            let pixel = part * (self.edge_mm * (self.eye.z - p.z) / self.eye.z).powi(2) / cell.count;
            means.areas[0][at] = pixel * cell.area;
            means.areas[1][at] = pixel * cell.level / normal.z;
            let [x, y, z] = &mut means.rest_normals;
            (x[at], y[at], z[at]) = normal.into();
        }
        means.lights.clone_from(&means.own);
        for k in (0..self.kept.len()).filter(|k| self.flanks[*k] && self.cells[*k].count > 0.0) {
            let at = means.at(k % nx, k / nx);
            for light in &mut means.lights {
                light.iter_mut().zip(self.kept[k].to_array()).for_each(|(light, kept)| light[at] *= kept);
            }
        }
        means.tilts.clone_from(&means.own_tilts);
        if !self.unseen.is_empty() {
            means.shown_normals.clone_from(&means.normals);
        }
        for (_, cell) in self.unseen_in_picture() {
            let (at, part) = (means.at(cell.at[0] as usize, cell.at[1] as usize), self.unseen_part(cell));
            for (own, of_cell) in means.shown_normals.iter_mut().zip(cell.normal.to_array()) {
                own[at] += (of_cell - own[at]) * part;
            }
        }
        self.show(&mut means, |_| true);
        self.put_beside(&mut means, ground);
        self.continue_beside(&mut means);
        means
    }

    /// What others see of cells, once these see the pad as it is. Of all, or of upright flanks alone: half of what they have is
    /// from the pad at their foot, and where that is in their shadow next to nothing is left.
    pub(super) fn relight(&self, means: &mut Means, gains: &[Vec3], of: impl Fn(usize) -> bool) {
        let ([nx, _], films, numbers) = (self.size, self.lights.len(), self.numbers());
        for k in (0..self.cells.len()).filter(|k| self.cells[*k].count > 0.0 && of(*k)) {
            let (i, j) = (k % nx, k / nx);
            let at = means.at(i, j);
            for (film, (own, seen)) in means.own.iter().zip(&mut means.lights).enumerate() {
                let gain = gains[(j * numbers + film) * nx + i] * self.kept(k, self.flanks[k]);
                for (c, (own, seen)) in own.iter().zip(seen).enumerate() {
                    seen[at] = own[at] * gain[c];
                }
            }
            if !self.flanks[k] {
                continue;
            }
            for (film, (own, seen)) in means.own_tilts.iter().zip(&mut means.tilts).enumerate() {
                let more = gains[(j * numbers + films + film) * nx + i];
                for (c, (own, seen)) in own.iter().zip(seen).enumerate() {
                    // (By the middle of a flank nothing of its light may be gone.)
                    let most = means.lights[film][c][at] * STEEPEST;
                    seen[at] = (own[at] + more[c]).clamp(-most, most);
                }
            }
        }
        self.show(means, of);
        self.continue_beside(means);
    }

    /// The unseen parts of cells of the picture.
    fn unseen_in_picture(&self) -> impl Iterator<Item = (usize, &Unseen)> {
        self.unseen.iter().enumerate().filter(|(_, unseen)| self.in_picture(unseen))
    }

    /// Part that something unseen has in the surface of its cell: all where it is a flank larger than what is seen there, which then stands
    /// for both ([`super::Cell::of`]). Who stands at its foot sees the flank alone.
    fn unseen_part(&self, unseen: &Unseen) -> f32 {
        let cell = &self.cells[unseen.at[1] as usize * self.size[0] + unseen.at[0] as usize];
        let scale = self.edge_mm * (self.eye.z - unseen.position.z) / self.eye.z;
        let seen_mm2 = cell.area / cell.count.max(1e-6) * scale * scale;
        let part = unseen.area_mm2 / (unseen.area_mm2 + seen_mm2);
        if unseen.is_flank && part > 0.5 { 1.0 } else { part }
    }

    /// Mixes the light on what is unseen into what others see of its cells.
    fn show(&self, means: &mut Means, of: impl Fn(usize) -> bool) {
        let index = |cell: &Unseen| cell.at[1] as usize * self.size[0] + cell.at[0] as usize;
        let shown: Vec<(usize, &Unseen)> =
            self.unseen_in_picture().filter(|(_, cell)| of(index(cell))).collect();
        let changes: Vec<Vec<Vec3>> = shown.par_iter().map(|(_, cell)| self.of_foot(means, cell)).collect();
        for ((k, cell), changes) in shown.into_iter().zip(changes) {
            let (at, part) = (means.at(cell.at[0] as usize, cell.at[1] as usize), self.unseen_part(cell));
            let kept = self.kept(index(cell), cell.is_flank);
            for ((shown, light), change) in means.lights.iter_mut().zip(self.unseen_lights).zip(changes) {
                let light = (light[k] + change).max(light[k] * LEAST) * kept;
                for (c, shown) in shown.iter_mut().enumerate() {
                    shown[at] += (light[c] - shown[at]) * part;
                }
            }
        }
    }

    /// By picture: what an unseen flank gets more or less than it would of an untouched face at its foot, which half of what it sees is.
    fn of_foot(&self, means: &Means, cell: &Unseen) -> Vec<Vec3> {
        let mut sums = vec![Vec3::ZERO; self.lights.len()];
        let (from, ahead) = (cell.position, cell.normal.truncate().normalize_or_zero());
        let height_mm = from.z - self.heights.at(from.truncate() + ahead * self.edge_mm);
        if !cell.is_flank || ahead == Vec2::ZERO || height_mm <= 0.0 || height_mm.is_nan() {
            return sums;
        }
        let eye = self.eye;
        let seen =
            |p: Vec3| (p - eye).truncate() * Vec2::new(1.0, -1.0) * (eye.z / ((eye.z - p.z) * self.edge_mm));
        for (turn, away) in LOOKS.into_iter().flat_map(|turn| AWAY.map(|away| (turn, away))) {
            let way = ahead.rotate(Vec2::new((1.0 - turn * turn).sqrt(), turn));
            let place = from.truncate() + way * (away * height_mm);
            let there = place.extend(self.heights.at(place));
            if there.z >= from.z || !there.is_finite() {
                continue;
            }
            let cell = (cell.place + seen(there) - seen(from)).floor().as_ivec2();
            let [nx, ny] = [self.size[0], self.rows].map(|n| n as i32);
            if !((0..nx).contains(&cell.x) && (0..ny).contains(&cell.y)) {
                continue;
            }
            let at = means.at(cell.x as usize, cell.y as usize);
            for (film, sum) in sums.iter_mut().enumerate() {
                let [now, before] = [&means.lights[film], &means.grounds[film]]
                    .map(|[x, y, z]| Vec3::new(x[at], y[at], z[at]));
                *sum += now - before;
            }
        }
        let part = 0.5 * self.albedo / (LOOKS.len() * AWAY.len()) as f32;
        sums.iter_mut().for_each(|sum| *sum *= part);
        sums
    }

    /// What of the light of a cell leaves it, where it stands for a flank.
    fn kept(&self, k: usize, is_flank: bool) -> Vec3 {
        self.kept.get(k).copied().filter(|_| is_flank).unwrap_or(Vec3::ONE)
    }
}
