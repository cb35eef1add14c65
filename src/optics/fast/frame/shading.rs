//! The pad shaded row of blocks by row of blocks, and what each row tells of its cells.

use super::{Frame, NODE_PX};
use crate::optics::Film;
use crate::optics::fast::bounce::{self, Cell};
use crate::optics::fast::desk::Row;
use crate::optics::fast::gains::Split;
use crate::optics::fast::lanes::with_widest;
use crate::optics::fast::tilt::Parts;
use crate::optics::fast::traces;
use crate::optics::fast::unseen::Border;
use glam::Vec3;
use rayon::prelude::*;

/// What is known of a pad that is shaded and from which nothing has bounced yet.
pub(super) struct Shaded {
    /// Cells of the bounce along x and y.
    pub size: [usize; 2],
    /// Pixels along the edge of one, and by how many times that is finer than usual.
    pub cell_px: usize,
    /// See [`Self::cell_px`].
    pub finer: usize,
    /// The cells, row by row.
    pub cells: Vec<Cell>,
    /// Which of them stand for upright flanks.
    pub is_flank: Vec<bool>,
    /// The light on them, by picture.
    pub lights: Vec<Vec<Vec3>>,
    /// Sums over pixels and channels of the variances of what mixed pixels are means of, as in [`traces`].
    pub spread: Vec<f64>,
    /// Pixels of which a part shows an upright flank, by row of nodes.
    pub splits: Vec<Vec<Split>>,
    /// What flanks are made of, by row of nodes.
    pub parts_of_flanks: Vec<Parts>,
}

impl Shaded {
    /// Cells in a row of nodes.
    pub fn in_row(&self) -> usize {
        self.size[0] * (NODE_PX / self.cell_px)
    }

    /// The cells at the border of a picture whose pixels are so wide.
    pub fn border(&self, pixel_mm: f32) -> Border<'_> {
        // (Rows beyond the picture's last are empty.)
        let shown = self.cells.iter().rposition(|cell| cell.count > 0.0).map_or(1, |k| k / self.size[0] + 1);
        let edge_mm = self.cell_px as f32 * pixel_mm;
        Border { size: [self.size[0], shown], cell_px: self.cell_px, edge_mm, cells: &self.cells }
    }

    /// Rms of |n - n0|^2 over the cells, n0 the normal of the untouched face.
    pub fn steepness(&self, rest_normal: impl Fn(Vec3) -> Vec3) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for cell in self.cells.iter().filter(|c| c.count > 0.0) {
            let rest = rest_normal(cell.position / cell.count);
            let departure = f64::from((cell.normal.normalize_or(rest) - rest).length_squared());
            sum += departure * departure * f64::from(cell.count);
            count += f64::from(cell.count);
        }
        (sum / f64::max(count, 1.0)).sqrt()
    }
}

impl<const N: usize> Frame<'_, N> {
    /// Shades the pad.
    pub(super) fn shade(&self, nodes: &[f32]) -> (Vec<Film>, Shaded) {
        let camera = &self.once.view.camera;
        let (width, height, films) = (camera.width, camera.height, self.slots.films);
        let (cell_px, finer) = self.cell_px();
        let rows_of_nodes = height.div_ceil(NODE_PX);
        let size = [width.div_ceil(cell_px), rows_of_nodes * (NODE_PX / cell_px)];
        let in_row = size[0] * (NODE_PX / cell_px);
        // (Twice each: what is level enough to have normals of its own, and flanks that are narrower than a pixel.)
        let mut cells = vec![bounce::EMPTY; 2 * size[0] * size[1]];
        let mut light = dark(size[0] * size[1] * 2 * films);
        let traces = traces::count(films);
        let mut spreads = vec![0.0; traces * rows_of_nodes];
        let mut splits = vec![Vec::new(); rows_of_nodes];
        let mut parts_of_flanks = vec![Parts::default(); rows_of_nodes];
        let mut all: Vec<Film> =
            (0..films).map(|_| Film { width, height, pixels: dark(width * height) }).collect();
        let mut rows: Vec<Vec<&mut [Vec3]>> = Vec::new();
        rows.resize_with(rows_of_nodes, Vec::new);
        for film in &mut all {
            let chunks = film.pixels.chunks_mut(NODE_PX * width);
            rows.iter_mut().zip(chunks).for_each(|(row, chunk)| row.push(chunk));
        }
        rows.into_par_iter()
            .zip(cells.par_chunks_mut(2 * in_row))
            .zip(light.par_chunks_mut(in_row * 2 * films))
            .zip(spreads.par_chunks_mut(traces).zip(&mut splits).zip(&mut parts_of_flanks))
            .enumerate()
            .for_each(|(row, (((out, cells), light), ((spread, splits), flanks)))| {
                let frame = self;
                with_widest(Row { frame, nodes, row, cell_px, out, cells, light, spread, splits, flanks });
            });
        let mut lights = by_film(&light, in_row, 2 * films);
        let (cells, is_flank) = whole_cells(&cells, in_row, &mut lights);
        let spread = (0..traces).map(|k| spreads.iter().skip(k).step_by(traces).sum()).collect();
        (all, Shaded { size, cell_px, finer, cells, is_flank, lights, spread, splits, parts_of_flanks })
    }
}

/// Makes one cell of each pair, and tells which are flanks. Of `lights`, those of the level cells by picture and then those of the
/// flanks, those of the cells are left. Rows of nodes have `in_row` cells.
fn whole_cells(pairs: &[Cell], in_row: usize, lights: &mut Vec<Vec<Vec3>>) -> (Vec<Cell>, Vec<bool>) {
    let flanks = lights.split_off(lights.len() / 2);
    let mut whole = Vec::with_capacity(pairs.len() / 2);
    let mut is_flank = Vec::with_capacity(pairs.len() / 2);
    for (row, both) in pairs.chunks(2 * in_row).enumerate() {
        let (ground, flank) = both.split_at(both.len() / 2);
        for (k, (ground, flank)) in ground.iter().zip(flank).enumerate() {
            let (cell, steep) = Cell::of(ground, flank);
            whole.push(cell);
            is_flank.push(steep);
            if flank.area > 0.0 {
                let k = row * in_row + k;
                for (light, of_flank) in lights.iter_mut().zip(&flanks) {
                    let main = if steep { of_flank[k] / flank.area } else { light[k] / ground.area };
                    light[k] = main * cell.area;
                }
            }
        }
    }
    (whole, is_flank)
}

/// So many pixels without light. (Memory that is new to the process is slow to be written to: on all threads.)
fn dark(n: usize) -> Vec<Vec3> {
    rayon::iter::repeat_n(Vec3::ZERO, n).with_min_len(16_384).collect()
}

/// Rows of blocks hold one picture after the other, `block` numbers each.
fn by_film(all: &[Vec3], block: usize, films: usize) -> Vec<Vec<Vec3>> {
    let mut out = vec![Vec::with_capacity(all.len() / films); films];
    for row in all.chunks(block * films) {
        for (film, part) in out.iter_mut().zip(row.chunks_exact(row.len() / films)) {
            film.extend_from_slice(part);
        }
    }
    out
}
