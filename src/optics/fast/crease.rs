//! Pixels over creases and folds: means over the [pieces](super::piece) of triangles that they show.

use super::cover::SAMPLED_ERROR;
use super::desk::{Desk, Rectangle};
use super::facet;
use super::frame::Frame;
use super::gains::Split;
use super::lanes::{Eight, Vectors, WIDTH, lanes};
use super::piece::Shown;
use super::shade::Own;
use super::traces::Pieces;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Among corners that lie alike the nearest counts: what a pixel's square of distance is worth in the cosine.
const NEARNESS: f32 = 0.01;
/// What of a steep pixel has more than this of its normal upwards is no flank.
const LEVEL: f32 = 0.5;
/// What has less is upright in any pixel: a corner of a flank may be all that shows.
const UPRIGHT: f32 = 0.125;
/// Of pixels that see parts of the pad farther apart, in quads, only the corners are looked at.
const MOST_QUADS: usize = 64;

impl<const N: usize> Frame<'_, N> {
    /// The quads of the lattice around these triangles, from and to along x and y; None where they are many, or none.
    pub fn quads(&self, triangles: &[u32]) -> Option<[usize; 4]> {
        let (nx, ny) = (self.nx - 1, self.vertices.len() / self.nx - 1);
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for &triangle in triangles {
            let quad = triangle as usize / 2;
            for (k, at) in [quad % nx, quad / nx].into_iter().enumerate() {
                (low[k], high[k]) = (low[k].min(at), high[k].max(at));
            }
        }
        let few = (0..2).all(|k| high[k] >= low[k] && high[k] - low[k] < MOST_QUADS);
        few.then(|| {
            let [i, j] = low.map(|at| at.saturating_sub(1));
            [i, (high[0] + 2).min(nx), j, (high[1] + 2).min(ny)]
        })
    }
}

impl<const N: usize> Desk<'_, N> {
    /// A pixel over a crease, or one whose corners see different things.
    #[inline(never)]
    pub fn mixed(&mut self, x: usize, y: usize, rectangle: Rectangle, steep: bool) {
        let corner = |dx: usize, dy: usize| self.frame.corner(x + dx, y + dy).map(|(_, triangle)| triangle);
        let triangles = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        if let [Some(a), Some(b), Some(c), Some(d)] = triangles
            && let Some(quads) = self.frame.quads(&[a, b, c, d])
        {
            self.pieced(x, y, rectangle, [a, b, c, d].map(|k| self.frame.normal(k)), quads, steep);
        } else {
            self.in_part(x, y, rectangle);
        }
    }

    /// The mean over the pieces of triangles that a pixel shows. Horizons jump at a crease: each piece has its own. Fields are
    /// those of the corner that lies most as it does.
    fn pieced(
        &mut self,
        x: usize,
        y: usize,
        [x0, y0, x1, y1]: Rectangle,
        corner_normals: [Vec3; 4],
        quads: [usize; 4],
        steep: bool,
    ) {
        let frame = self.frame;
        let once = frame.once;
        let films = self.sums.len();
        let pixel = Vec2::new(x as f32, y as f32);
        let mut pieces = std::mem::take(&mut self.pieces);
        let ray = frame.ray_in([x, y], Vec2::splat(0.5));
        let height_mm = |value: f32| super::View::point(ray, value).z;
        Shown { vertices: frame.vertices, nx: frame.nx, pixel, quads, height_mm }.pieces(&mut pieces);
        for piece in &mut pieces {
            piece.point = super::View::point(frame.ray_in([x, y], piece.at), piece.value);
            piece.normal = frame.normal(piece.triangle);
        }
        let stride = frame.slots.stride();
        let mut own = std::mem::take(&mut self.horizons);
        facet::horizons(frame, &pieces, &mut own);
        // The light on each.
        let mut light = vec![Vec3::ZERO; films];
        let (mut seen, mut whole) = (Pieces::new(films), 0.0f32);
        // What of it is an upright flank's, and how high the rest is.
        let (mut of_flank, mut level) = (vec![Vec3::ZERO; films], [0.0f32; 2]);
        for (number, batch) in pieces.chunks(WIDTH).enumerate() {
            let (mut points, mut normals) = (Vectors::all(Vec3::ZERO), Vectors::all(Vec3::Z));
            let mut albedos = [Vec3::ZERO; WIDTH];
            let mut corner = [0; WIDTH];
            let start = number * WIDTH * stride;
            let mut starts = [start; WIDTH];
            for (lane, piece) in batch.iter().enumerate() {
                let (p, n) = (piece.point, piece.normal);
                (points.x.0[lane], points.y.0[lane], points.z.0[lane]) = p.into();
                (normals.x.0[lane], normals.y.0[lane], normals.z.0[lane]) = n.into();
                albedos[lane] = frame.albedo_at(piece.triangle, p);
                let like = |k: usize| {
                    let far = piece.at.distance_squared(Vec2::new((k % 2) as f32, (k / 2) as f32));
                    n.dot(corner_normals[k]) - NEARNESS * far
                };
                corner[lane] = (1..4).fold(0, |best, k| if like(k) > like(best) { k } else { best });
                starts[lane] = start + lane * stride;
            }
            let at = |k: usize, low: usize, high: usize| (k - low) as f32 / (high - low) as f32;
            let u = Eight(lanes!(k => at(x + corner[k] % 2, x0, x1)));
            let v = Eight(lanes!(k => at(y + corner[k] / 2, y0, y1)));
            self.sums.fill(Vectors::all(Vec3::ZERO));
            let horizons = Own { nodes: &own, at: starts };
            self.block.light([u, v], points, normals, &once.radiances, Some(horizons), &mut self.sums);
            for (lane, piece) in batch.iter().enumerate() {
                let pick = |v: &Vectors| Vec3::new(v.x.0[lane], v.y.0[lane], v.z.0[lane]);
                let weight = piece.part * self.area(pick(&points), pick(&normals));
                let cells = self.cells.len() / 2;
                // (In the second half are flanks; what is level beside one counts as ground.)
                let flank = if normals.z.0[lane] < LEVEL { cells } else { 0 };
                let upright = flank > 0 && (steep || normals.z.0[lane] < UPRIGHT);
                if !upright {
                    level = [level[0] + points.z.0[lane] * piece.part, level[1] + piece.part];
                }
                let cell = self.cell_of(x, y).filter(|_| steep).map(|k| k + flank);
                if let Some(cell) = cell.map(|k| &mut self.cells[k]) {
                    cell.position += pick(&points) * piece.part;
                    cell.normal += pick(&normals) * weight;
                    cell.area += weight;
                    cell.count += piece.part;
                }
                let of_cell = cell.filter(|_| flank > 0).map(|k| k - flank);
                if let Some(cell) = of_cell {
                    self.flanks.add(cell, points.z.0[lane], weight);
                }
                for (film, (sum, light)) in self.sums.iter().zip(&mut light).enumerate() {
                    if let Some(k) = cell {
                        let at = if flank > 0 { films * cells } else { 0 };
                        self.light[at + film * cells + k - flank] += pick(sum) * weight;
                    }
                    if of_cell.is_some() {
                        self.flanks.light(pick(sum));
                    }
                    let value = albedos[lane] * pick(sum) * FRAC_1_PI;
                    *light += value * piece.part;
                    if upright {
                        of_flank[film] += value * piece.part;
                    }
                }
                let values = self.sums.iter().map(|sum| albedos[lane] * pick(sum) * FRAC_1_PI);
                seen.add(piece.part, values, &once.radiances);
                whole += piece.part;
            }
        }
        (self.pieces, self.horizons) = (pieces, own);
        if whole <= 0.0 {
            self.in_part(x, y, [x0, y0, x1, y1]);
            return;
        }
        if of_flank.iter().any(|light| *light != Vec3::ZERO) {
            let share = once.transmitted(x, y) / whole;
            let flank = of_flank.into_iter().map(|light| light * share).collect();
            self.splits.push(Split { pixel: [x, y], level_mm: level[0] / level[1].max(1e-12), flank });
        }
        seen.add_variances(whole, SAMPLED_ERROR, self.spread);
        for (film, light) in light.iter().enumerate() {
            let veil = once.veil(film, films, x, y);
            self.out[film][(y - self.first) * self.width + x] =
                *light / whole * once.transmitted(x, y) + veil;
        }
    }
}
