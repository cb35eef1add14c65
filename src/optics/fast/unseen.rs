//! What the camera does not see of the pad, and what has its part in the light all the same.
//!
//! Light bounces between [cells](super::bounce) of the picture. Beside it the pad is taken to go on as at its border: a body that
//! ends just beyond has flanks there, which are not in the picture. And steep flanks look away from the camera: they light the
//! walls. Such cells are summed up from the mesh, and lit.

use super::bounce::{self, BEYOND_MM, Cell, MARGIN};
use super::frame::Frame;
use super::horizon::{Heights, Stand};
use super::lanes::{Eight, Vectors, WIDTH, Work, with_widest};
use super::shade::Block;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// How far beyond the border is looked to tell whether the pad goes on as it is, mm.
const PROBE_MM: f32 = 1.0;
/// A pad that moved this evenly across the border, mm, goes on as it is.
const EVEN_MM: f64 = 0.01;
/// A cell this much higher or lower than that at the border, mm, or turned by as much, is one of its own.
const OTHER_MM: f32 = 0.02;
const OTHER_TURN: f32 = 0.1;
/// Part of the normal upwards below which something is a flank.
const LEVEL: f32 = 0.5;

/// What is not seen in a cell of the picture or beside it.
#[derive(Debug, Clone, Copy)]
pub struct Unseen {
    /// Which cell that is, counted from the picture's first.
    pub at: [isize; 2],
    pub position: Vec3,
    /// Of length 1.
    pub normal: Vec3,
    pub is_flank: bool,
    /// Of its surface, and of the level under it.
    pub area_mm2: f32,
    pub level_mm2: f32,
}

/// Everything that is not seen and not as the border.
#[derive(Debug, Clone)]
pub struct AllUnseen {
    pub cells: Vec<Unseen>,
    /// Irradiance, picture by picture.
    pub lights: Vec<Vec<Vec3>>,
}

/// The picture's cells, as the pad beside them is told from.
pub struct Border<'a> {
    pub size: [usize; 2],
    pub cell_px: usize,
    /// Edge of a cell on the pad, mm.
    pub edge_mm: f32,
    pub cells: &'a [Cell],
}

impl Border<'_> {
    /// The last row that shows something. (Rows beyond the picture's last are empty.)
    fn last_row(&self) -> usize {
        self.cells.iter().rposition(|cell| cell.count > 0.0).map_or(0, |k| k / self.size[0])
    }

    /// Mean over the cells at the border of how much farther or less far than there the pad has moved beyond it, mm.
    pub fn uneven_mm(&self, heights: &Heights, lift: impl Fn(Vec3) -> f32) -> f64 {
        let (nx, last) = (self.size[0], self.last_row());
        let outwards = |k: usize| match (k % nx, k / nx) {
            (0, _) => Some(-Vec2::X),
            (i, _) if i + 1 == nx => Some(Vec2::X),
            // In the picture y runs downwards.
            (_, 0) => Some(Vec2::Y),
            (_, j) if j == last => Some(-Vec2::Y),
            _ => None,
        };
        let (mut sum, mut count) = (0.0, 0.0f32);
        for (k, cell) in self.cells.iter().enumerate().filter(|(_, cell)| cell.count > 0.0) {
            let Some(outwards) = outwards(k) else { continue };
            let here = cell.position / cell.count;
            let beyond = here.truncate() + outwards * PROBE_MM;
            sum += (lift(beyond.extend(heights.at(beyond))) - lift(here)).abs();
            count += 1.0;
        }
        f64::from(sum / count.max(1.0))
    }

    /// The cell of the border from which the pad would go on to one beside the picture.
    fn nearest(&self, at: [isize; 2]) -> Option<&Cell> {
        let [i, j] = [0, 1].map(|d| at[d].clamp(0, self.size[d] as isize - 1) as usize);
        Some(&self.cells[j * self.size[0] + i]).filter(|cell| cell.count > 0.0)
    }
}

/// Sums over cells, of level ground and of flanks: beside the picture of all there is, in it of what looks away from the camera.
struct Sums {
    /// Cells on either side of the picture.
    beside: usize,
    size: [usize; 2],
    sums: Vec<[Cell; 2]>,
}

impl Sums {
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

impl Frame<'_> {
    /// What is not seen; `uneven_mm` is how uneven the pad is across the picture's border.
    pub(super) fn unseen(&self, border: &Border<'_>, uneven_mm: f64) -> AllUnseen {
        let (mut cells, uneven) = (Vec::new(), uneven_mm > EVEN_MM);
        if uneven || self.heights.has_sharp_rims() {
            let sums = self.unseen_sums(border, if uneven { BEYOND_MM } else { 0.0 });
            let filled =
                sums.sums.iter().enumerate().filter(|(_, [ground, flank])| ground.count + flank.count > 0.0);
            cells.extend(filled.filter_map(|(k, [ground, flank])| {
                let at = sums.at(k);
                let (cell, is_flank) = Cell::of(ground, flank);
                let (position, normal) = (cell.position / cell.count, cell.normal.normalize_or(Vec3::Z));
                let from = border.nearest(at)?;
                let higher = position.z - from.position.z / from.count;
                let turned = normal - from.normal.normalize_or(Vec3::Z);
                let other = higher.abs() > OTHER_MM || turned.length_squared() > OTHER_TURN * OTHER_TURN;
                let (area_mm2, level_mm2) = (cell.area, cell.level);
                other.then_some(Unseen { at, position, normal, is_flank, area_mm2, level_mm2 })
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

    /// Sums the mesh up over cells of the picture and up to `beyond_mm` beside it, quad by quad; those larger than half a cell in
    /// parts.
    fn unseen_sums(&self, border: &Border<'_>, beyond_mm: f32) -> Sums {
        let beside = ((beyond_mm / border.edge_mm).ceil() as usize).min(MARGIN);
        let columns = border.size.map(|n| n + 2 * beside);
        let sums = vec![[bounce::EMPTY; 2]; columns[0] * columns[1]];
        let mut out = Sums { beside, size: border.size, sums };
        let size = Vec2::new(border.size[0] as f32, border.size[1] as f32);
        let (far, per_px) = (beside as f32, 1.0 / border.cell_px as f32);
        let (nx, positions, eye) = (self.nx, &self.mesh.positions, self.once.view.camera.origin);
        let quad = |i: usize, j: usize| [j * nx + i, j * nx + i + 1, (j + 1) * nx + i, (j + 1) * nx + i + 1];
        let area_of = |[p, q, r, s]: [Vec3; 4]| (q - r).cross(s - p) * 0.5;
        // Which way round the lattice goes, a corner of the pad tells.
        let forth = area_of(quad(0, 0).map(|k| positions[k])).z.signum();
        for j in 0..positions.len() / nx - 1 {
            for i in 0..nx - 1 {
                let four = quad(i, j);
                let [a, b, c, d] = four.map(|k| self.vertices[k].truncate() * per_px);
                let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
                let outside = high.cmplt(Vec2::splat(-far)).any() || low.cmpgt(size + far).any();
                if outside || !(low + high).is_finite() {
                    continue;
                }
                let [p, q, r, s] = four.map(|k| positions[k]);
                let area = area_of([p, q, r, s]) * forth;
                let is_away = area.dot(eye - p) < 0.0;
                if !is_away && low.cmpge(Vec2::ZERO).all() && high.cmple(size).all() {
                    continue;
                }
                let parts = (2.0 * (high - low).max_element()).ceil().clamp(1.0, 64.0) as usize;
                let weight = 1.0 / (parts * parts) as f32;
                let flank = usize::from(area.z < LEVEL * area.length());
                for (v, u) in (0..parts).flat_map(|v| (0..parts).map(move |u| (v, u))) {
                    let [u, v] = [u, v].map(|k| (k as f32 + 0.5) / parts as f32);
                    let index = out.index(a.lerp(b, u).lerp(c.lerp(d, u), v));
                    let Some((k, _)) = index.filter(|(_, inside)| is_away || !inside) else { continue };
                    let cell = &mut out.sums[k][flank];
                    cell.position += p.lerp(q, u).lerp(r.lerp(s, u), v) * weight;
                    cell.normal += area * weight;
                    cell.area += area.length() * weight;
                    cell.count += weight;
                }
            }
        }
        out
    }
}

/// The light on what is not seen, picture by picture.
struct Lit<'a> {
    frame: &'a Frame<'a>,
    cells: &'a [Unseen],
}

impl Work for Lit<'_> {
    type Output = Vec<Vec3>;

    #[inline(always)]
    fn run(self) -> Vec<Vec3> {
        let Self { frame, cells } = self;
        let (slots, sources) = (&frame.slots, &frame.once.sources);
        let closed = |l: usize| frame.once.tables.direct[l].is_none();
        let mut block = Block::new(slots, sources, closed, vec![0.0; sources.len()], frame.effort.thorough);
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
                    (Eight::all(0.0), Vectors::all(cell.position), Vectors::all(cell.normal));
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
        let once = Precomputed::new(&middle(|_, _| 0.0)).unwrap();
        let scene = middle(table);
        let (film, stated) = Renderer::new(&once, &scene, 0.005).unwrap().render_with_error();
        let (error, means) = against_reference(&scene, &film);
        println!("{error} {stated} {means}");
        assert!((means - Vec3::ONE).abs().max_element() < 0.002, "{means}");
        assert!(error < stated, "{error} {stated}");
    }
}
