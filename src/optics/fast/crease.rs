//! Pixels over creases and folds: means over the parts of the triangles that they show; where those overlap, of a grid
//! of samples, each with the triangle on top there.

use super::desk::{Desk, Rectangle};
use super::facet;
use super::frame::Frame;
use super::gains::Split;
use super::lanes::{Eight, Vectors, WIDTH, lanes};
use super::raster::corners;
use super::shade::Own;
use super::traces::Pieces;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Samples along the edge of a pixel over a fold.
const GRID: usize = 8;
/// Among corners that lie alike the nearest counts: what a pixel's square of distance is worth in the cosine.
const NEARNESS: f32 = 0.01;
/// Variance of the mean of that many samples as part of their own: of an edge they err by N^(-3/4).
const SAMPLED_ERROR: f64 = 1.0 / (GRID * GRID * GRID) as f64;
/// What of a steep pixel has more than this of its normal upwards is no flank.
const LEVEL: f32 = 0.5;
/// What has less is upright in any pixel: a corner of a flank may be all that shows.
const UPRIGHT: f32 = 0.125;
/// Of pixels that see parts of the pad farther apart, in quads, only the corners are looked at.
const MOST_QUADS: usize = 64;

/// A part of a pixel that shows one triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Where its light is taken, in the pixel.
    at: Vec2,
    /// The view's value there.
    value: f32,
    triangle: u32,
    /// Its part of the pixel.
    pub part: f32,
    /// The same place on the pad, and its normal.
    pub point: Vec3,
    pub normal: Vec3,
}

impl Piece {
    fn new(at: Vec2, value: f32, triangle: u32, part: f32) -> Self {
        Self { at, value, triangle, part, point: Vec3::ZERO, normal: Vec3::Z }
    }
}

/// Cuts the triangles of some quads at the edges of a pixel. False where they do not cover it once: where it shows a fold
/// or a rim.
fn cut(vertices: &[Vec3], nx: usize, pixel: Vec2, quads: [usize; 4], pieces: &mut Vec<Piece>) -> bool {
    pieces.clear();
    let mut whole = 0.0;
    for_triangles(vertices, nx, pixel, quads, |triangle, points| {
        let mut polygon = [Vec2::ZERO; 8];
        let mut count = 3;
        polygon[..3].copy_from_slice(&points.map(Vec3::truncate));
        for (axis, side) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            // Inside is x >= 0 for side 1, x <= 1 for side -1.
            let inside = |p: Vec2| if side > 0.0 { p[axis] } else { 1.0 - p[axis] };
            let (before, n) = (polygon, count);
            count = 0;
            for k in 0..n {
                let (p, q) = (before[k], before[(k + 1) % n]);
                let (a, b) = (inside(p), inside(q));
                if a >= 0.0 {
                    polygon[count] = p;
                    count += 1;
                }
                if (a < 0.0) != (b < 0.0) && count < polygon.len() {
                    polygon[count] = p + (q - p) * (a / (a - b));
                    count += 1;
                }
            }
        }
        let (mut area, mut middle) = (0.0, Vec2::ZERO);
        for k in 2..count {
            let [a, b, c] = [polygon[0], polygon[k - 1], polygon[k]];
            let part = 0.5 * (b - a).perp_dot(c - a);
            area += part;
            middle += (a + b + c) * (part / 3.0);
        }
        if area.abs() > 1e-5 {
            let at = middle / area;
            pieces.push(Piece::new(at, value_at(points, at), triangle, area.abs()));
            whole += area.abs();
        }
    });
    (whole - 1.0).abs() < COVERED
}

/// Pieces of a pixel cover it to this part.
const COVERED: f32 = 2e-3;

/// The triangles on top at a grid of samples, and how much of it each is.
fn sample(vertices: &[Vec3], nx: usize, pixel: Vec2, quads: [usize; 4], pieces: &mut Vec<Piece>) {
    let place = |k: usize| Vec2::new((k % GRID) as f32 + 0.5, (k / GRID) as f32 + 0.5) / GRID as f32;
    let mut found = [(f32::NEG_INFINITY, u32::MAX); GRID * GRID];
    for_triangles(vertices, nx, pixel, quads, |triangle, [a, b, c]| {
        let [pa, pb, pc] = [a, b, c].map(Vec3::truncate);
        let area = (pb - pa).perp_dot(pc - pa);
        for (k, found) in found.iter_mut().enumerate() {
            let p = place(k);
            let wb = (p - pc).perp_dot(pa - pc) / -area;
            let wc = (pb - pa).perp_dot(p - pa) / area;
            let wa = 1.0 - wb - wc;
            let value = a.z * wa + b.z * wb + c.z * wc;
            if wa.min(wb).min(wc) >= -1e-4 && value > found.0 {
                *found = (value, triangle);
            }
        }
    });
    // All samples of a triangle are one piece, in their middle.
    pieces.clear();
    for (k, &(value, triangle)) in found.iter().enumerate() {
        if triangle == u32::MAX {
            continue;
        }
        match pieces.iter_mut().find(|piece| piece.triangle == triangle) {
            Some(piece) => {
                (piece.at, piece.value) = (piece.at + place(k), piece.value + value);
                piece.part += 1.0;
            }
            None => pieces.push(Piece::new(place(k), value, triangle, 1.0)),
        }
    }
    for piece in pieces {
        let share = 1.0 / piece.part;
        (piece.at, piece.value) = (piece.at * share, piece.value * share);
        piece.part *= 1.0 / (GRID * GRID) as f32;
    }
}

/// Each triangle of some quads that may show in a pixel, relative to its corner.
pub fn for_triangles(
    vertices: &[Vec3],
    nx: usize,
    pixel: Vec2,
    [i0, i1, j0, j1]: [usize; 4],
    mut each: impl FnMut(u32, [Vec3; 3]),
) {
    for j in j0..j1 {
        for i in i0..i1 {
            let id = 2 * (j * (nx - 1) + i) as u32;
            for triangle in [id, id + 1] {
                let points = corners(triangle, nx).map(|k| vertices[k] - pixel.extend(0.0));
                let [a, b, c] = points.map(Vec3::truncate);
                let outside =
                    a.min(b).min(c).cmpgt(Vec2::ONE).any() || a.max(b).max(c).cmplt(Vec2::ZERO).any();
                let area = (b - a).perp_dot(c - a);
                if !outside && area != 0.0 && area.is_finite() {
                    each(triangle, points);
                }
            }
        }
    }
}

/// The value of a triangle at a point of the raster.
pub fn value_at([a, b, c]: [Vec3; 3], p: Vec2) -> f32 {
    let [pa, pb, pc] = [a, b, c].map(Vec3::truncate);
    let area = (pb - pa).perp_dot(pc - pa);
    let wb = (p - pc).perp_dot(pa - pc) / -area;
    let wc = (pb - pa).perp_dot(p - pa) / area;
    a.z * (1.0 - wb - wc) + b.z * wb + c.z * wc
}

impl Frame<'_> {
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

impl Desk<'_> {
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
        [i0, i1, j0, j1]: [usize; 4],
        steep: bool,
    ) {
        let frame = self.frame;
        let once = frame.once;
        let films = self.sums.len();
        let middle = Vec2::new(x as f32, y as f32);
        let mut pieces = std::mem::take(&mut self.pieces);
        if !cut(frame.vertices, frame.nx, middle, [i0, i1, j0, j1], &mut pieces) {
            sample(frame.vertices, frame.nx, middle, [i0, i1, j0, j1], &mut pieces);
        }
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
