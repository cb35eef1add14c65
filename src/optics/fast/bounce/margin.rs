//! The margin: the pad beside the picture, as the mesh has it where that is known, else as it is at the picture's border.

use super::means::Means;
use super::{BEYOND_MM, Cells, Unseen, nearest};
use glam::{Vec2, Vec3};

impl Cells<'_> {
    /// What a cell at the border of the picture stands for, in cells: what is beyond is taken to be as it is.
    pub(super) fn beyond(&self, at: [usize; 2], p: Vec3) -> f32 {
        let [low, high] = self.extent;
        // In the picture y runs downwards.
        let sides = [[p.x - low.x, high.x - p.x], [high.y - p.y, p.y - low.y]];
        (0..2).fold(1.0, |cells, axis| {
            let beyond = |side: f32| (side / self.edge_mm - 0.5).clamp(0.0, BEYOND_MM / self.edge_mm);
            let first = if at[axis] == 0 { beyond(sides[axis][0]) } else { 0.0 };
            let last =
                if at[axis] + 1 == [self.size[0], self.rows][axis] { beyond(sides[axis][1]) } else { 0.0 };
            cells * (1.0 + first + last)
        })
    }

    pub(super) fn in_picture(&self, unseen: &Unseen) -> bool {
        nearest([self.size[0], self.rows], unseen.at).map(|n| n as isize) == unseen.at
    }

    /// The unseen cells beside the picture.
    fn unseen_beside(&self) -> impl Iterator<Item = (usize, &Unseen)> {
        self.unseen.iter().enumerate().filter(|(_, unseen)| !self.in_picture(unseen))
    }

    /// By cell: how many beside the picture would go on as it is, were they not known.
    pub(super) fn known_beside(&self) -> Vec<f32> {
        let mut known = vec![0.0; self.cells.len()];
        for (_, cell) in self.unseen_beside() {
            let [i, j] = nearest([self.size[0], self.rows], cell.at);
            known[j * self.size[0] + i] += 1.0;
        }
        known
    }

    /// Puts what is known of the pad beside the picture into its cells.
    pub(super) fn put_beside(&self, means: &mut Means, ground: &dyn Fn(usize, Vec3) -> Vec3) {
        for (k, cell) in self.unseen_beside() {
            let from = means.at(0, 0) as isize + cell.at[1] * means.stride as isize + cell.at[0];
            let at = from as usize;
            means.from_mesh[at] = true;
            (means.places[0][at], means.places[1][at], means.heights[at]) = cell.position.into();
            for (c, of_cell) in cell.normal.to_array().into_iter().enumerate() {
                (means.normals[c][at], means.shown_normals[c][at]) = (of_cell, of_cell);
            }
            means.highest = means.highest.max(cell.position.z);
            if let Some(upright) = means.upright.get_mut(at) {
                *upright = f32::from(u8::from(cell.is_flank));
            }
            for (film, (light, rest)) in means.lights.iter_mut().zip(&mut means.grounds).enumerate() {
                (light[0][at], light[1][at], light[2][at]) = self.unseen_lights[film][k].into();
                (rest[0][at], rest[1][at], rest[2][at]) = ground(film, cell.position).into();
            }
        }
    }

    /// Beside the picture the pad goes on as at its border, where nothing else is known.
    pub(super) fn continue_beside(&self, means: &mut Means) {
        let [nx, ny] = [self.size[0], self.rows].map(|n| n as isize);
        let (beside, [low, high]) = (means.beside as isize, self.extent);
        for j in -beside..ny + beside {
            for i in -beside..nx + beside {
                let (from_i, from_j) = (i.clamp(0, nx - 1), j.clamp(0, ny - 1));
                if (i, j) == (from_i, from_j) {
                    continue;
                }
                let from = means.at(from_i as usize, from_j as usize);
                let to = from.wrapping_add_signed((j - from_j) * means.stride as isize + i - from_i);
                if means.from_mesh.get(to).is_some_and(|known| *known) {
                    continue;
                }
                let z = means.heights[from];
                let edge_mm = self.edge_mm * (self.eye.z - z) / self.eye.z;
                // In the picture y runs downwards.
                let aside = Vec2::new((i - from_i) as f32, (from_j - j) as f32) * edge_mm;
                let place = Vec2::new(means.places[0][from], means.places[1][from]) + aside;
                if z == f32::NEG_INFINITY || place.cmplt(low).any() || place.cmpgt(high).any() {
                    continue;
                }
                let Means {
                    heights, places, normals, shown_normals, lights, grounds, upright, tilts, ..
                } = means;
                (places[0][to], places[1][to], heights[to]) = (place.x, place.y, z);
                let colours = lights.iter_mut().chain(grounds).chain(tilts).flatten();
                colours
                    .chain(normals.iter_mut().chain(shown_normals))
                    .chain(Some(upright))
                    .filter(|numbers| !numbers.is_empty())
                    .for_each(|numbers| numbers[to] = numbers[from]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::optics::fast::bounce::tests::{heights, white};
    use glam::{Vec2, Vec3};

    /// What the border stands for and what is in the picture make up the pad.
    #[test]
    fn the_border_stands_for_what_is_beyond_it() {
        let (size, edge) = ([20, 10], 0.25);
        let extent = [Vec2::new(-3.0, -2.0), Vec2::new(3.5, 1.5)];
        let (cells, lights) = (Vec::new(), Vec::new());
        let pad = heights(extent, |_| 0.0);
        let all = white(size, edge, &cells, &lights, &pad, extent);
        let mut sum = 0.0;
        for (i, j) in (0..size[0]).flat_map(|i| (0..size[1]).map(move |j| (i, j))) {
            let p = Vec3::new((i as f32 + 0.5) * edge - 2.5, 1.25 - (j as f32 + 0.5) * edge, 0.0);
            sum += all.beyond([i, j], p) * edge * edge;
        }
        assert!((sum - 6.5 * 3.5).abs() < 1e-3, "{sum}");
    }
}
