//! Parts of the pad that are not in the picture, or look away from the camera, and have their part in the light all the same.
//!
//! Light bounces between [cells](super::bounce) of the picture. Beside it the pad is taken to go on as at its border: a body that
//! ends just beyond has flanks there, which are not in the picture. And steep flanks that look away from the camera light the walls
//! and what is before them. Such cells are summed up from the mesh, and lit. (What looks at the camera and is behind something
//! else is left out: it is level, and dark.)

use super::bounce::{self, BEYOND_MM, Cell, Unseen};
use super::frame::Frame;
use super::horizon::{Heights, Stand};
use super::lanes::{Eight, Vectors, WIDTH, Work, with_widest};
use super::shade::Block;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// How far beyond the border is looked to tell whether the pad goes on as it is, mm.
const PROBES_MM: [f32; 3] = [0.5, 1.0, BEYOND_MM];
/// A pad that moved this evenly across the border, mm, goes on as it is.
const EVEN_MM: f64 = 0.01;
/// A cell this much higher or lower than that at the border, mm, is one of its own...
const OTHER_MM: f32 = 0.02;
/// ...and so is one whose normal differs by more.
const OTHER_TURN: f32 = 0.1;
/// Part of the normal upwards below which something is a flank.
const LEVEL: f32 = 0.5;
/// Of so many quads along a row one tells which way round the mesh is in the picture.
const EVERY: usize = 16;

/// All unseen cells that differ from the border.
#[derive(Debug)]
pub struct AllUnseen {
    pub cells: Vec<Unseen>,
    /// Irradiance, picture by picture.
    pub lights: Vec<Vec<Vec3>>,
}

/// The picture's cells, from which the pad beside them is told.
pub struct Border<'a> {
    /// Cells along x, and rows that show something.
    pub size: [usize; 2],
    pub cell_px: usize,
    /// Edge of a cell on the pad, mm.
    pub edge_mm: f32,
    pub cells: &'a [Cell],
}

impl Border<'_> {
    /// Mean over the cells at the border of how much farther or less far than there the pad has moved beyond it, mm: at the distance
    /// where that is most.
    pub fn uneven_mm(&self, heights: &Heights, lift: impl Fn(Vec3) -> f32) -> f64 {
        let [nx, ny] = self.size;
        let outwards = |k: usize| match (k % nx, k / nx) {
            (0, _) => Some(-Vec2::X),
            (i, _) if i + 1 == nx => Some(Vec2::X),
            // In the picture y runs downwards.
            (_, 0) => Some(Vec2::Y),
            (_, j) if j + 1 == ny => Some(-Vec2::Y),
            _ => None,
        };
        let (mut sums, mut count) = ([0.0; PROBES_MM.len()], 0.0f32);
        for (k, cell) in self.cells.iter().enumerate().filter(|(_, cell)| cell.count > 0.0) {
            let Some(outwards) = outwards(k) else { continue };
            let here = cell.position / cell.count;
            for (sum, away_mm) in sums.iter_mut().zip(PROBES_MM) {
                let beyond = here.truncate() + outwards * away_mm;
                let height = heights.at(beyond);
                if height.is_finite() {
                    *sum += (lift(beyond.extend(height)) - lift(here)).abs();
                }
            }
            count += 1.0;
        }
        f64::from(sums.into_iter().fold(0.0, f32::max) / count.max(1.0))
    }

    /// The cell of the border from which the pad would go on to one beside the picture.
    fn nearest(&self, at: [isize; 2]) -> Option<&Cell> {
        let [i, j] = bounce::nearest(self.size, at);
        Some(&self.cells[j * self.size[0] + i]).filter(|cell| cell.count > 0.0)
    }
}

/// Which cells are summed up: those of the picture and some on either side.
struct Frames {
    beside: usize,
    size: [usize; 2],
}

impl Frames {
    fn count(&self) -> usize {
        self.size.iter().map(|n| n + 2 * self.beside).product()
    }

    /// Where a place stands, in cells of the picture, and whether it is in that.
    fn index(&self, place: Vec2) -> Option<(usize, bool)> {
        let q = place.floor().as_ivec2();
        let [nx, ny] = self.size.map(|n| n as i32);
        let beside = self.beside as i32;
        let inside = |by: i32| (-by..nx + by).contains(&q.x) && (-by..ny + by).contains(&q.y);
        inside(beside).then(|| (((q.y + beside) * (nx + 2 * beside) + q.x + beside) as usize, inside(0)))
    }

    fn at(&self, k: usize) -> [isize; 2] {
        let columns = self.size[0] + 2 * self.beside;
        [k % columns, k / columns].map(|q| q as isize - self.beside as isize)
    }
}

/// A piece of the mesh in a cell, as a part of its sums, and whether it is a flank.
type Piece = (usize, bool, Cell);

impl<const N: usize> Frame<'_, N> {
    /// What is unseen; `uneven_mm` is how uneven the pad is across the picture's border.
    pub(super) fn unseen(&self, border: &Border<'_>, uneven_mm: f64) -> AllUnseen {
        let uneven = uneven_mm > EVEN_MM;
        let beside = if uneven { bounce::beside(border.edge_mm) } else { 0 };
        let frames = Frames { beside, size: border.size };
        let mut cells = Vec::new();
        if uneven || self.effort.fine || self.heights.has_sharp_rims() {
            let pieces = self.unseen_pieces(border, &frames);
            let mut sums = vec![[bounce::EMPTY; 2]; if pieces.is_empty() { 0 } else { frames.count() }];
            for (k, is_flank, piece) in pieces {
                let sum = &mut sums[k][usize::from(is_flank)];
                sum.position += piece.position;
                sum.normal += piece.normal;
                sum.area += piece.area;
                sum.count += piece.count;
            }
            let sums =
                sums.iter().enumerate().filter(|(_, [ground, flank])| ground.count + flank.count > 0.0);
            cells.extend(sums.filter_map(|(k, [ground, flank])| {
                let at = frames.at(k);
                let (cell, is_flank) = Cell::of(ground, flank);
                let (position, normal) = (cell.position / cell.count, cell.normal.normalize_or(Vec3::Z));
                let from = border.nearest(at)?;
                let higher = position.z - from.position.z / from.count;
                let turned = normal - from.normal.normalize_or(Vec3::Z);
                let other = higher.abs() > OTHER_MM || turned.length_squared() > OTHER_TURN * OTHER_TURN;
                let (area_mm2, level_mm2) = (cell.area, cell.level);
                let place = self.once.view.project(position).truncate() / border.cell_px as f32;
                other.then_some(Unseen { at, place, position, normal, is_flank, area_mm2, level_mm2 })
            }));
        }
        let mut lights = vec![vec![Vec3::ZERO; cells.len()]; self.slots.films];
        let of_cells: Vec<Vec<Vec3>> =
            cells.par_chunks(64).map(|cells| with_widest(Lit { frame: self, cells })).collect();
        let mut first = 0;
        for chunk in of_cells {
            let count = chunk.len() / self.slots.films;
            for (light, of_film) in lights.iter_mut().zip(chunk.chunks_exact(count)) {
                light[first..first + count].copy_from_slice(of_film);
            }
            first += count;
        }
        AllUnseen { cells, lights }
    }

    /// Which way round the lattice goes, as its sides tell: 1 where areas of its quads look upwards, else -1.
    pub(super) fn forth(&self) -> f32 {
        let (nx, positions) = (self.nx, &self.mesh.positions);
        let last_row = positions.len() - nx;
        let [side, up] = [nx - 1, last_row].map(|k| positions[k] - positions[0]);
        side.cross(up).z.signum()
    }

    /// The mesh beside the picture, and in it what looks away from the camera: quad by quad, those larger than half a cell in
    /// parts.
    fn unseen_pieces(&self, border: &Border<'_>, frames: &Frames) -> Vec<Piece> {
        let (nx, positions) = (self.nx, &self.mesh.positions);
        let rows = positions.len() / nx - 1;
        let per_px = 1.0 / border.cell_px as f32;
        let size = Vec2::new(border.size[0] as f32, border.size[1] as f32);
        let (least, most) = (Vec2::splat(-(frames.beside as f32)), size + frames.beside as f32);
        let quad = |i: usize, j: usize| [j * nx + i, j * nx + i + 1, (j + 1) * nx + i, (j + 1) * nx + i + 1];
        let place = |k: usize| self.vertices[k].truncate() * per_px;
        let drawn = |[a, b, c, d]: [Vec2; 4]| (b - c).perp_dot(d - a);
        // Which way round that is in the picture, most of what is there tells.
        let forth = self.forth();
        let shows = |p: Vec2| p.cmpge(Vec2::ZERO).all() && p.cmple(size).all();
        let around: f32 = (0..rows)
            .step_by(EVERY)
            .flat_map(|j| (0..nx - 1).step_by(EVERY).map(move |i| quad(i, j).map(place)))
            .filter(|four| four.iter().all(|p| shows(*p)))
            .map(drawn)
            .sum();
        let of_row = |j: usize| {
            let mut pieces: Vec<Piece> = Vec::new();
            for four in (0..nx - 1).map(|i| quad(i, j)) {
                let [a, b, c, d] = four.map(place);
                let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
                // (Behind the camera a vertex has no depth.)
                let is_drawn = four.iter().all(|k| self.vertices[*k].is_finite());
                if !is_drawn || high.cmplt(least).any() || low.cmpgt(most).any() {
                    continue;
                }
                let is_away = drawn([a, b, c, d]) * around < 0.0;
                if !is_away && shows(low) && shows(high) {
                    continue;
                }
                let [p, q, r, s] = four.map(|k| positions[k]);
                let area = (q - r).cross(s - p) * (0.5 * forth);
                let parts = (2.0 * (high - low).max_element()).ceil().clamp(1.0, 64.0) as usize;
                let weight = 1.0 / (parts * parts) as f32;
                let is_flank = area.z < LEVEL * area.length();
                // What rises to a rim is found there by who stands before it: what looks away goes with its highest place.
                let top = [(p, a), (q, b), (r, c), (s, d)].into_iter().max_by(|a, b| a.0.z.total_cmp(&b.0.z));
                let rim = top.filter(|_| is_away && is_flank).map(|(_, place)| place);
                for (v, u) in (0..parts).flat_map(|v| (0..parts).map(move |u| (v, u))) {
                    let [u, v] = [u, v].map(|k| (k as f32 + 0.5) / parts as f32);
                    let index = frames.index(rim.unwrap_or_else(|| a.lerp(b, u).lerp(c.lerp(d, u), v)));
                    let Some((k, _)) = index.filter(|(_, inside)| is_away || !inside) else { continue };
                    let position = p.lerp(q, u).lerp(r.lerp(s, u), v) * weight;
                    let (normal, area) = (area * weight, area.length() * weight);
                    pieces.push((k, is_flank, Cell { position, normal, area, level: 0.0, count: weight }));
                }
            }
            pieces
        };
        let of_rows: Vec<Vec<Piece>> = (0..rows).into_par_iter().with_min_len(16).map(of_row).collect();
        of_rows.into_iter().flatten().collect()
    }
}

/// The light on unseen cells, picture by picture.
struct Lit<'a, const N: usize> {
    frame: &'a Frame<'a, N>,
    cells: &'a [Unseen],
}

impl<const N: usize> Work for Lit<'_, N> {
    type Output = Vec<Vec3>;

    #[inline(always)]
    fn run(self) -> Vec<Vec3> {
        let Self { frame, cells } = self;
        let (slots, sources) = (&frame.slots, &frame.once.sources);
        let slab = frame.once.view.slab.as_ref();
        let closed = |l: usize| frame.once.tables.direct[l].is_none();
        let mut block =
            Block::new(slots, sources, slab, closed, vec![0.0; sources.len()], frame.effort.thorough);
        let mut out = vec![Vec3::ZERO; cells.len() * slots.films];
        let mut nodes = vec![0.0; slots.stride() * WIDTH];
        let mut sums = vec![Vectors::all(Vec3::ZERO); slots.films];
        for (first, eight) in cells.chunks(WIDTH).enumerate() {
            let mut points = [Vec3::ZERO; WIDTH];
            points.iter_mut().zip(eight).for_each(|(point, cell)| *point = cell.position);
            let stands = |k: usize| Stand::on(eight[k].position, eight[k].normal);
            frame.fill_on(&points[..eight.len()], stands, &mut nodes);
            for (k, (cell, node)) in eight.iter().zip(nodes.chunks_exact(slots.stride())).enumerate() {
                block.prepare([node; 4], 0.0);
                sums.fill(Vectors::all(Vec3::ZERO));
                let (zero, point, normal) =
                    (Eight::all(0.0), Vectors::all(cell.position), Vectors::all(upwards(cell.normal)));
                block.light([zero, zero], point, normal, &frame.once.radiances, None, &mut sums);
                for (film, sum) in sums.iter().enumerate() {
                    let light = Vec3::new(sum.x.0[0], sum.y.0[0], sum.z.0[0]);
                    out[film * cells.len() + first * WIDTH + k] = light;
                }
            }
        }
        out
    }
}

/// What stands over its foot is lit as if it were upright: light from below is not known.
fn upwards(normal: Vec3) -> Vec3 {
    normal.with_z(normal.z.max(0.0)).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Scene;
    use crate::optics::bench_scene::Variant;
    use crate::optics::fast::tests::{against_reference, scene};
    use crate::optics::fast::{Precomputed, Renderer};

    /// The middle of the benchmark scene's pad, 10.8 x 8.1 mm of 20 x 15.
    fn middle(height: impl Fn(f32, f32) -> f32) -> Scene {
        let mut scene = scene(Variant::Ac, height);
        scene.camera.tan_half_x *= 0.6;
        scene.camera = scene.camera.with_raster(64, 48);
        scene
    }

    /// A table 1 mm high with edges at 5.7 and 4.4 mm, beyond the picture's at 5.4 and 4.05 mm.
    fn table(x: f32, y: f32) -> f32 {
        ((0.2 + (5.7 - x.abs()).min(4.4 - y.abs())) / 0.2).clamp(0.0, 1.0)
    }

    #[test]
    fn a_body_that_ends_beyond_the_picture_lights_it_as_in_the_reference() {
        // (Of 44 rows the last cells are empty.)
        for height in [48, 44] {
            let raster = |mut scene: Scene| {
                scene.camera = scene.camera.with_raster(64, height);
                scene
            };
            let once = Precomputed::new(&raster(middle(|_, _| 0.0))).unwrap();
            let scene = raster(middle(table));
            let renderer = Renderer::new(&once, &scene, 0.005).unwrap();
            let (film, stated) = renderer.render_with_error();
            let (error, means) = against_reference(&scene, &film);
            assert!((means - Vec3::ONE).abs().max_element() < 0.002, "{height}: {means}");
            assert!(error < stated && error < 0.003, "{height}: {error} {stated}");
            // Light by light it is the same.
            let apart = film.relative_rmse(&renderer.basis().combine(&once.radiances));
            assert!(apart < 0.002, "{height}: {apart}");
        }
    }
}
