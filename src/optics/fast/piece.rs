//! What a pixel over a crease or a fold shows: parts of triangles, cut at the pixel's edges; where those overlap, samples of it,
//! each with the triangle on top there. Tall ones are taken apart by height: up a flank shadows end, and what light the whole of
//! it has is not that of its middle.

use super::cover::{SAMPLES, place};
use super::raster::{EMPTY, Sample, corners};
use glam::{Vec2, Vec3};

/// A piece is hardly taller than this, mm, unless a pixel would have more than so many of a triangle.
const SLICE_MM: f32 = 0.04;
const MOST_SLICES: f32 = 64.0;
/// Pieces of a pixel cover it to this part.
const COVERED: f32 = 2e-3;
/// Parts of a pixel that are smaller are none.
const LEAST: f32 = 1e-5;

/// A part of a pixel that shows one triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Where its light is taken, in the pixel.
    pub at: Vec2,
    /// The view's value there.
    pub value: f32,
    pub triangle: u32,
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

/// The quads of a lattice that a pixel may show, and how high a value of the view is there.
pub struct Shown<'a, H> {
    /// The lattice's points in the raster.
    pub vertices: &'a [Vec3],
    /// Points along x.
    pub nx: usize,
    pub pixel: Vec2,
    /// From and to along x and y.
    pub quads: [usize; 4],
    /// Height of a value, mm.
    pub height_mm: H,
}

impl<H: Fn(f32) -> f32> Shown<'_, H> {
    /// Takes the pixel apart.
    pub fn pieces(&self, pieces: &mut Vec<Piece>) {
        if !self.cut(pieces) {
            self.sample(pieces);
        }
    }

    fn for_triangles(&self, each: impl FnMut(u32, [Vec3; 3])) {
        for_triangles(self.vertices, self.nx, self.pixel, self.quads, each);
    }

    /// Cuts triangles at the pixel's edges. False where they do not cover it once: where it shows a fold or a rim.
    fn cut(&self, pieces: &mut Vec<Piece>) -> bool {
        pieces.clear();
        let mut whole = 0.0;
        self.for_triangles(|triangle, points| {
            let mut polygon = Polygon::new(points.map(Vec3::truncate));
            polygon.clip(|p| p.x);
            polygon.clip(|p| 1.0 - p.x);
            polygon.clip(|p| p.y);
            polygon.clip(|p| 1.0 - p.y);
            let (area, _) = polygon.area_and_middle();
            if area <= LEAST {
                return;
            }
            whole += area;
            let value = |p: Vec2| value_at(points, p);
            let values = polygon.points().iter().map(|p| value(*p));
            let (low, high) =
                values.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            let tall = ((self.height_mm)(high) - (self.height_mm)(low)).abs();
            let slices = (tall / SLICE_MM).ceil().clamp(1.0, MOST_SLICES);
            for k in 0..slices as usize {
                let mut slice = polygon;
                if slices > 1.0 {
                    let [from, to] = [k, k + 1].map(|k| low + (high - low) * (k as f32 / slices));
                    slice.clip(|p| value(p) - from);
                    slice.clip(|p| to - value(p));
                }
                let (area, middle) = slice.area_and_middle();
                if area > LEAST / slices {
                    pieces.push(Piece::new(middle, value(middle), triangle, area));
                }
            }
        });
        (whole - 1.0).abs() < COVERED
    }

    /// The triangles on top at samples, and how much of the pixel each is.
    fn sample(&self, pieces: &mut Vec<Piece>) {
        let found = on_top(self.vertices, self.nx, self.pixel, self.quads);
        // Samples of a triangle that are as high are one piece, in their middle.
        pieces.clear();
        let mut slices: Vec<(u32, i32)> = Vec::new();
        for (k, &Sample { value, triangle }) in
            found.iter().enumerate().filter(|(_, s)| s.triangle != u32::MAX)
        {
            let slice = (triangle, ((self.height_mm)(value) / SLICE_MM).round() as i32);
            match slices.iter().position(|s| *s == slice) {
                Some(at) => {
                    let piece = &mut pieces[at];
                    (piece.at, piece.value) = (piece.at + place(k), piece.value + value);
                    piece.part += 1.0;
                }
                None => {
                    slices.push(slice);
                    pieces.push(Piece::new(place(k), value, triangle, 1.0));
                }
            }
        }
        for piece in pieces {
            let share = 1.0 / piece.part;
            (piece.at, piece.value) = (piece.at * share, piece.value * share);
            piece.part *= 1.0 / SAMPLES as f32;
        }
    }
}

/// Convex, of at most so many corners: a triangle that six lines cut.
#[derive(Debug, Clone, Copy)]
struct Polygon {
    corners: [Vec2; 9],
    count: usize,
}

impl Polygon {
    fn new([a, b, c]: [Vec2; 3]) -> Self {
        let mut corners = [a; 9];
        [corners[1], corners[2]] = [b, c];
        Self { corners, count: 3 }
    }

    fn points(&self) -> &[Vec2] {
        &self.corners[..self.count]
    }

    /// Keeps what of it is inside: where a linear function is not below 0.
    fn clip(&mut self, inside: impl Fn(Vec2) -> f32) {
        let before = *self;
        self.count = 0;
        let mut put = |p: Vec2| {
            // (Rounding may cut a corner twice.)
            if self.count < self.corners.len() {
                self.corners[self.count] = p;
                self.count += 1;
            }
        };
        for (k, p) in before.points().iter().enumerate() {
            let q = before.points()[(k + 1) % before.count];
            let (a, b) = (inside(*p), inside(q));
            if a >= 0.0 {
                put(*p);
            }
            if (a < 0.0) != (b < 0.0) {
                put(*p + (q - *p) * (a / (a - b)));
            }
        }
    }

    /// Its middle means nothing where it has no area.
    fn area_and_middle(&self) -> (f32, Vec2) {
        let (mut area, mut middle) = (0.0, Vec2::ZERO);
        for k in 2..self.count {
            let [a, b, c] = [0, k - 1, k].map(|k| self.corners[k]);
            let part = 0.5 * (b - a).perp_dot(c - a);
            area += part;
            middle += (a + b + c) * (part / 3.0);
        }
        (area.abs(), middle / area)
    }
}

/// What the samples of a pixel see of some quads.
pub fn on_top(vertices: &[Vec3], nx: usize, pixel: Vec2, quads: [usize; 4]) -> [Sample; SAMPLES] {
    let mut found = [EMPTY; SAMPLES];
    for_triangles(vertices, nx, pixel, quads, |triangle, [a, b, c]| {
        let [pa, pb, pc] = [a, b, c].map(Vec3::truncate);
        let inverse = (pb - pa).perp_dot(pc - pa).recip();
        for (k, found) in found.iter_mut().enumerate() {
            let p = place(k);
            let wb = (pa - pc).perp_dot(p - pc) * inverse;
            let wc = (pb - pa).perp_dot(p - pa) * inverse;
            if wb.min(wc).min(1.0 - wb - wc) >= -1e-4 {
                let value = value_at([a, b, c], p);
                if value > found.value {
                    *found = Sample { value, triangle };
                }
            }
        }
    });
    found
}

/// Each triangle of some quads that may show in a pixel, relative to its corner.
fn for_triangles(
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
fn value_at([a, b, c]: [Vec3; 3], p: Vec2) -> f32 {
    let [pa, pb, pc] = [a, b, c].map(Vec3::truncate);
    let area = (pb - pa).perp_dot(pc - pa);
    let wb = (p - pc).perp_dot(pa - pc) / -area;
    let wc = (pb - pa).perp_dot(p - pa) / area;
    a.z * (1.0 - wb - wc) + b.z * wb + c.z * wc
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pieces of the pixel at the origin of a lattice over the raster, whose values are heights.
    fn pieces(vertices: &[Vec3], nx: usize) -> Vec<Piece> {
        let quads = [0, nx - 1, 0, vertices.len() / nx - 1];
        let mut pieces = Vec::new();
        Shown { vertices, nx, pixel: Vec2::ZERO, quads, height_mm: |value| value }.pieces(&mut pieces);
        pieces
    }

    #[test]
    fn a_flank_is_taken_apart_by_height() {
        // Level up to 0.3, then it rises by 0.35 to 0.7, and goes on level.
        let row =
            |y: f32| [(-1.0, 0.0), (0.3, 0.0), (0.7, 0.35), (2.0, 0.35)].map(|(x, z)| Vec3::new(x, y, z));
        let pieces = pieces(&[row(-1.0), row(2.0)].concat(), 4);
        let sum = |of: fn(&Piece) -> bool| pieces.iter().filter(|p| of(p)).map(|p| p.part).sum::<f32>();
        assert!((sum(|_| true) - 1.0).abs() < 1e-4 && (sum(|p| p.value == 0.0) - 0.3).abs() < 1e-4);
        let flank: Vec<&Piece> = pieces.iter().filter(|p| p.value > 1e-3 && p.value < 0.349).collect();
        assert!(flank.len() >= 9, "{}", flank.len());
        for piece in flank {
            assert!(
                (piece.value - (piece.at.x - 0.3) * 0.35 / 0.4).abs() < 1e-4 && piece.part < 0.06,
                "{piece:?}"
            );
        }
    }

    /// The edges of folds often run along those of pixels, for many pixels.
    #[test]
    fn an_edge_that_runs_along_the_pixel_s_is_where_it_is() {
        for edge in [0.03, 0.2, 0.31, 0.5, 0.77, 0.94] {
            // What is high ends there, over what goes on below it.
            let row =
                |y: f32| [(-1.0, 0.5), (edge, 0.5), (-0.9, 0.1), (2.0, 0.1)].map(|(x, z)| Vec3::new(x, y, z));
            let turned = |y: f32| row(y).map(|p| Vec3::new(p.y, p.x, p.z));
            for vertices in [[row(-1.0), row(2.0)].concat(), [turned(-1.0), turned(2.0)].concat()] {
                let pieces = pieces(&vertices, 4);
                let high: f32 = pieces.iter().filter(|p| p.value > 0.45).map(|p| p.part).sum();
                assert!((high - edge).abs() < 0.012, "{edge}: {high}");
            }
        }
    }
}
