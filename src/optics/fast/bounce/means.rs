//! Means over cells, as other cells see them: taken from the picture, and lit anew after a bounce.

use super::{Cells, MARGIN, Unseen, Untouched, beside};
use crate::optics::fast::lanes::{Eight, Vectors, WIDTH, lanes};
use glam::Vec3;

/// Up a flank the light changes by at most this part of it per mm.
const STEEPEST: f32 = 1.0;

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
        means.tilts.clone_from(&means.own_tilts);
        if !self.unseen.is_empty() {
            means.shown_normals.clone_from(&means.normals);
        }
        for (k, cell) in self.unseen_in_picture() {
            let (at, part) = (means.at(cell.at[0] as usize, cell.at[1] as usize), self.unseen_part(cell));
            for (own, of_cell) in means.shown_normals.iter_mut().zip(cell.normal.to_array()) {
                own[at] += (of_cell - own[at]) * part;
            }
            self.show(&mut means, k);
        }
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
                let gain = gains[(j * numbers + film) * nx + i];
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
        for (k, cell) in self.unseen_in_picture() {
            if of(cell.at[1] as usize * nx + cell.at[0] as usize) {
                self.show(means, k);
            }
        }
        self.continue_beside(means);
    }

    /// The unseen parts of cells of the picture.
    fn unseen_in_picture(&self) -> impl Iterator<Item = (usize, &Unseen)> {
        self.unseen.iter().enumerate().filter(|(_, unseen)| self.in_picture(unseen))
    }

    /// Part that something unseen has in the surface of its cell.
    fn unseen_part(&self, unseen: &Unseen) -> f32 {
        let cell = &self.cells[unseen.at[1] as usize * self.size[0] + unseen.at[0] as usize];
        let scale = self.edge_mm * (self.eye.z - unseen.position.z) / self.eye.z;
        let seen_mm2 = cell.area / cell.count.max(1e-6) * scale * scale;
        unseen.area_mm2 / (unseen.area_mm2 + seen_mm2)
    }

    /// Mixes the light on something unseen into what others see of its cell.
    fn show(&self, means: &mut Means, k: usize) {
        let cell = &self.unseen[k];
        let (at, part) = (means.at(cell.at[0] as usize, cell.at[1] as usize), self.unseen_part(cell));
        for (shown, light) in means.lights.iter_mut().zip(self.unseen_lights) {
            for (c, shown) in shown.iter_mut().enumerate() {
                shown[at] += (light[k][c] - shown[at]) * part;
            }
        }
    }
}
