//! The pixels of a picture: blocks between nodes, divided where what they hold cannot be interpolated, and shaded eight
//! pixels at a time.

mod divide;
mod partial;

use super::bounce::Cell;
use super::frame::{Frame, NODE_PX, uv};
use super::gains::Split;
use super::lanes::{Eight, Mask, Vectors, WIDTH, Work, lanes};
use super::piece::Piece;
use super::shade::Block;
use super::slots::POSITION;
use super::tilt::Parts;
use crate::optics::{Albedo, Texture};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// A pixel over which the ground's slope changes by more is looked at in its corners.
const CREASE: f32 = 0.2;
/// Where a pixel's corners differ in height by more than this many pixels, they see different things.
const STEEPEST: f32 = 8.0;
/// One over a crease that rises by more has a flank in it, and counts part by part where light bounces: its mean normal is no part's.
/// (An upright step under one light was 1.6 % off where it counted as a whole, and is 0.6.)
const FLANKED: f32 = 2.0;
/// Flanks steeper than this, as the part of the normal towards the eye, count as this steep.
const LEVEL: f32 = 0.01;
/// Where nothing is seen.
const NOWHERE: f32 = 1e30;

/// A row of blocks.
pub struct Row<'a, const N: usize> {
    pub frame: &'a Frame<'a, N>,
    pub nodes: &'a [f32],
    pub row: usize,
    pub cell_px: usize,
    /// By picture.
    pub out: Vec<&'a mut [Vec3]>,
    pub cells: &'a mut [Cell],
    pub light: &'a mut [Vec3],
    /// What mixed pixels may be wrong by, as in [`traces`](super::traces).
    pub spread: &'a mut [f64],
    pub splits: &'a mut Vec<Split>,
    pub flanks: &'a mut Parts,
}

/// A rectangle of pixels: x0, y0, x1, y1.
pub type Rectangle = [usize; 4];

/// Room for the work on a row.
pub struct Desk<'a, const N: usize> {
    pub frame: &'a Frame<'a, N>,
    pub block: Block<'a, N>,
    pub first: usize,
    pub width: usize,
    /// Coordinates of the corners, row by row, with one more on every side and room to read eight at the end.
    pub stride: usize,
    pub points: [Vec<f32>; 3],
    pub uvs: Vec<Vec2>,
    /// By picture.
    pub out: Vec<&'a mut [Vec3]>,
    pub sums: Vec<Vectors>,
    /// Nodes of a block that is being divided, and its parts that wait.
    pub arena: Vec<f32>,
    pub waiting: Vec<(Rectangle, [usize; 4])>,
    /// Of the pixel over a crease at hand, and what its facets see of lights.
    pub pieces: Vec<Piece>,
    pub horizons: Vec<f32>,
    pub cell_px: usize,
    pub cells: &'a mut [Cell],
    pub light: &'a mut [Vec3],
    /// What mixed pixels may be wrong by, as in [`traces`](super::traces).
    pub spread: &'a mut [f64],
    pub splits: &'a mut Vec<Split>,
    /// What it shows of upright flanks.
    pub flanks: &'a mut Parts,
}

/// Pixels that are shaded at once: rows of a block, one after the other.
#[derive(Debug, Clone, Copy)]
struct Lanes {
    x0: usize,
    columns: usize,
    top: usize,
    count: usize,
}

impl Lanes {
    #[inline(always)]
    fn pixel(self, i: usize) -> (usize, usize) {
        (self.x0 + i % self.columns, self.top + i / self.columns)
    }
}

impl<const N: usize> Work for Row<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { frame, nodes, row, cell_px, out, cells, light, spread, splits, flanks } = self;
        let camera = &frame.once.view.camera;
        let (width, films) = (camera.width, frame.slots.films);
        let first = row * NODE_PX;
        let last = (first + NODE_PX).min(camera.height);
        let stride = width + 3 + WIDTH;
        let mut points = [(); 3].map(|()| vec![NOWHERE; (last - first + 3) * stride]);
        let textured = matches!(frame.albedo, Albedo::Texture(_));
        let mut uvs = vec![Vec2::ZERO; if textured { (last - first + 3) * stride } else { 0 }];
        for j in 0..last - first + 3 {
            // Beyond the picture its border is repeated.
            let y = (first + j).saturating_sub(1).min(camera.height);
            for i in 0..width + 3 {
                let x = i.saturating_sub(1).min(width);
                let Some((p, triangle)) = frame.corner(x, y) else { continue };
                let k = j * stride + i;
                (points[0][k], points[1][k], points[2][k]) = (p.x, p.y, p.z);
                if textured {
                    uvs[k] = uv(frame.mesh, frame.nx, triangle, p);
                }
            }
        }
        let sources = &frame.once.sources;
        let weight = |l: usize| frame.strength(l) / (frame.effort.field * frame.level).max(1e-30);
        let slab = frame.once.view.slab.as_ref();
        let closed = |l: usize| frame.once.tables.direct[l].is_none();
        let weights = (0..sources.len()).map(weight).collect();
        let block = Block::new(&frame.slots, sources, slab, closed, weights, frame.effort.thorough);
        let sums = vec![Vectors::all(Vec3::ZERO); films];
        let (arena, waiting) = (Vec::new(), Vec::new());
        let mut desk = Desk {
            frame,
            block,
            first,
            width,
            stride,
            points,
            uvs,
            out,
            sums,
            arena,
            waiting,
            pieces: Vec::new(),
            horizons: Vec::new(),
            cell_px,
            cells,
            light,
            spread,
            splits,
            flanks,
        };
        let [columns, _] = frame.node_counts();
        let size = frame.slots.stride();
        for i in 0..columns - 1 {
            let rectangle = [i * NODE_PX, first, ((i + 1) * NODE_PX).min(width), last];
            let node = |i: usize, j: usize| &nodes[((row + j) * columns + i) * size..][..size];
            let four = [node(i, 0), node(i + 1, 0), node(i, 1), node(i + 1, 1)];
            if four.iter().all(|n| !n[POSITION].is_nan()) {
                desk.divide(rectangle, four);
            } else {
                desk.partial(rectangle, four);
            }
        }
    }
}

impl<const N: usize> Desk<'_, N> {
    /// Where the numbers of a corner stand.
    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> usize {
        (y + 1 - self.first) * self.stride + x + 1
    }

    #[inline(always)]
    fn point(&self, x: usize, y: usize) -> Vec3 {
        let k = self.at(x, y);
        Vec3::new(self.points[0][k], self.points[1][k], self.points[2][k])
    }

    /// Shades a block, eight pixels at a time: of narrow blocks several rows at once.
    #[inline(always)]
    fn shade(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        let [x0, y0, x1, y1] = rectangle;
        let middle = self.point((x0 + x1) / 2, (y0 + y1) / 2).z;
        let mean = 0.25 * four.iter().map(|n| n[POSITION + 2]).sum::<f32>();
        self.block.prepare(four, if middle == NOWHERE { 0.0 } else { (middle - mean).abs() });
        let scale = [1.0 / (x1 - x0) as f32, 1.0 / (y1 - y0) as f32];
        let limit = Eight::all(STEEPEST * self.frame.once.pixel_mm);
        let [crease, flanked] = [CREASE, FLANKED].map(|pixels| Eight::all(pixels * self.frame.once.pixel_mm));
        let columns = x1 - x0;
        let at_once = (WIDTH / columns).max(1);
        for top in (y0..y1).step_by(at_once) {
            let lanes = Lanes { x0, columns, top, count: columns * at_once.min(y1 - top) };
            let u = Eight(lanes!(i => ((i % columns) as f32 + 0.5) * scale[0]));
            let v = Eight(lanes!(i => ((top - y0 + i / columns) as f32 + 0.5) * scale[1]));
            let first = self.at(x0, top);
            let stride = self.stride;
            let read = |c: usize, step: usize| match columns == WIDTH {
                true => Eight(lanes!(i => self.points[c][first + step..first + step + WIDTH][i])),
                // (Beyond the last row of the block it reads that row.)
                false => Eight(lanes!(i => {
                    let i = i.min(lanes.count - 1);
                    self.points[c][first + step + i / columns * stride + i % columns]
                })),
            };
            let vectors = |k: usize| Vectors { x: read(0, k), y: read(1, k), z: read(2, k) };
            let (a, b) = (vectors(0), vectors(1));
            let (c, d) = (vectors(stride), vectors(stride + 1));
            let low = a.z.min(b.z).min(c.z.min(d.z));
            let high = a.z.max(b.z).max(c.z.max(d.z));
            // (Where no corner sees the pad, something else is in front, and there is no height to tell it.)
            let steep = limit.below(high - low).or(Eight::all(0.5 * NOWHERE).below(low));
            let before = |k: usize| {
                let back = first - k;
                match columns == WIDTH {
                    true => Eight(lanes!(i => self.points[2][back..back + WIDTH][i])),
                    false => Eight(lanes!(i => {
                        let i = i.min(lanes.count - 1);
                        self.points[2][back + i / columns * stride + i % columns]
                    })),
                }
            };
            // (A flank within one pixel, between slopes that are alike, bends twice, there and back.)
            let bend = |step: usize, next: Eight| {
                let (rise, before, after) = (next - a.z, a.z - before(step), read(2, 2 * step) - next);
                (after - before).abs().max((rise - before + rise - after).abs())
            };
            let uneven = steep.or(crease.below(bend(1, b.z).max(bend(stride, c.z))));
            let steep = steep.or(uneven.and(flanked.below(high - low)));
            let point = (a + b + c + d).scaled(Eight::all(0.25));
            // The picture's y runs downwards: this order points to the camera.
            let normal = (c - b).cross(d - a).unit();
            let away = normal.z.below(Eight::all(0.0));
            let normal = Vectors {
                x: away.choose(-normal.x, normal.x),
                y: away.choose(-normal.y, normal.y),
                z: away.choose(-normal.z, normal.z),
            };
            self.sums.fill(Vectors::all(Vec3::ZERO));
            self.block.light([u, v], point, normal, &self.frame.once.radiances, None, &mut self.sums);
            self.put(lanes);
            self.count(lanes, point, normal, steep);
            if uneven.any() {
                for i in (0..lanes.count).filter(|&i| uneven.lane(i)) {
                    let (x, y) = lanes.pixel(i);
                    self.mixed(x, y, rectangle, steep.lane(i));
                }
            }
        }
    }

    /// Adds pixels to the cells of the bounce; of large cells some rows stand for all.
    #[inline(always)]
    fn count(&mut self, lanes: Lanes, points: Vectors, normals: Vectors, not: Mask) {
        let cells = self.cells.len() / 2;
        for i in 0..lanes.count {
            let (x, y) = lanes.pixel(i);
            let Some(k) = self.cell_of(x, y).filter(|_| !not.lane(i)) else { continue };
            let pick = |v: &Vectors| Vec3::new(v.x.0[i], v.y.0[i], v.z.0[i]);
            let weight = self.area(pick(&points), pick(&normals));
            let cell = &mut self.cells[k];
            cell.position += pick(&points);
            cell.normal += pick(&normals) * weight;
            cell.area += weight;
            cell.count += 1.0;
            for (film, sum) in self.sums.iter().enumerate() {
                self.light[film * cells + k] += pick(sum) * weight;
            }
        }
    }

    /// The cell that a pixel counts for, if it does.
    #[inline(always)]
    pub fn cell_of(&self, x: usize, y: usize) -> Option<usize> {
        let columns = self.width.div_ceil(self.cell_px);
        (self.cell_px < 4 || y % 4 == 1).then(|| (y - self.first) / self.cell_px * columns + x / self.cell_px)
    }

    /// What a cell sends goes by its area: a flank's is larger than its picture, most so where it looks away.
    #[inline(always)]
    pub fn area(&self, p: Vec3, n: Vec3) -> f32 {
        let to_eye = (self.frame.once.view.camera.origin - p).normalize_or(Vec3::Z);
        to_eye.z / n.dot(to_eye).max(LEVEL * to_eye.z)
    }

    /// Writes the light on pixels.
    #[inline(always)]
    fn put(&mut self, lanes: Lanes) {
        for i in 0..lanes.count {
            let (x, y) = lanes.pixel(i);
            let albedo = self.albedo(x, y) * (FRAC_1_PI * self.frame.once.transmitted(x, y));
            for (film, sum) in self.sums.iter().enumerate() {
                let light = Vec3::new(sum.x.0[i], sum.y.0[i], sum.z.0[i]);
                let veil = self.frame.once.veil(film, self.sums.len(), x, y);
                self.out[film][(y - self.first) * self.width + x] = albedo * light + veil;
            }
        }
    }

    /// The mean albedo of a pixel.
    #[inline(always)]
    fn albedo(&self, x: usize, y: usize) -> Vec3 {
        match self.frame.albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Texture(texture) => {
                let k = self.at(x, y);
                let (a, b) = (self.uvs[k], self.uvs[k + 1]);
                let (c, d) = (self.uvs[k + self.stride], self.uvs[k + self.stride + 1]);
                // As many samples as the pixel covers texels, at least 2 x 2.
                let size = Vec2::new(texture.width as f32, texture.height as f32);
                let spread = ((d - a) * size).abs().max((c - b) * size).max_element();
                if spread < 2.5 {
                    mean(texture, [a, b, c, d], 2)
                } else {
                    mean(texture, [a, b, c, d], (spread.ceil() as usize).clamp(3, 16))
                }
            }
        }
    }
}

/// Mean of n x n samples of a texture between the coordinates of a pixel's corners. (A function, not a closure: only that is
/// inlined into what has wide instructions switched on.)
#[inline(always)]
fn mean(texture: &Texture, [a, b, c, d]: [Vec2; 4], n: usize) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for j in 0..n {
        for i in 0..n {
            let [s, t] = [i, j].map(|k| (k as f32 + 0.5) / n as f32);
            sum += texture.sample(a.lerp(b, s).lerp(c.lerp(d, s), t));
        }
    }
    sum / (n * n) as f32
}

#[cfg(test)]
mod tests;
