//! One picture: nodes every few pixels, and the blocks between them.
//!
//! Each pixel's position and normal come from the points of the pad that its four corners see: the normal of their two
//! diagonals is the mean over the pixel, whatever the mesh does within. Where the corners see different things (the
//! pad's rim, a fold, a wall in front) the pixel is the mean of what its corners see.

use super::Precomputed;
use super::bounce::{self, Cell, Cells, Untouched};
use super::horizon::Heights;
use super::lanes::{Eight, Mask, Vectors, WIDTH, Work, with_widest};
use super::raster::{Sample, corners};
use super::shade::Block;
use super::slots::{POSITION, Slots};
use super::source::{COARSE, LINES, Line};
use super::vector::{irradiance, quadrilateral};
use crate::optics::{Albedo, Film, Mesh};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Pixels between nodes.
const NODE_PX: usize = WIDTH;
/// Horizons are followed this far below a light, as a slope, so that they can be interpolated.
const BELOW: f32 = 0.05;
/// A horizon that departs more from the mean of its neighbours, as a slope, is followed between them, too.
const BENT: f32 = 0.03;
/// Largest edge of a cell of the bounce, mm.
const CELL_MM: f32 = 0.26;
/// A pixel over which the ground's slope changes by more is looked at in its corners.
const CREASE: f32 = 0.2;
/// 1/sqrt(3).
const RMS: f32 = 0.577_350_3;
/// Samples along the edge of a pixel over a crease.
const GRID: usize = 4;
/// Among corners that lie alike the nearest counts: what a pixel's square of distance is worth in the cosine.
const NEARNESS: f32 = 0.01;
/// Variance of the mean of that many samples as part of their own: of an edge they err by N^(-3/4).
const SAMPLED_ERROR: f64 = 1.0 / (GRID * GRID * GRID) as f64;
/// The same for the four corners, which are shared with the neighbours.
const CORNERED_ERROR: f64 = 0.25;
/// Pixels that see parts of the pad farther apart, in quads, are the mean of their corners.
const MOST_QUADS: usize = 24;
/// Where a pixel's corners differ in height by more than this many pixels, they see different things.
const STEEPEST: f32 = 8.0;

/// How finely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Cells of the heights that hide light, in distances of the lattice's points.
    pub cell: f32,
    /// No block is larger, mm.
    pub block_mm: f32,
    /// No block with a shadow's edge is divided further, mm.
    pub shadow_mm: f32,
    /// A block is divided when the light at its middle departs by more from what its corners' horizons give there, as part
    /// of the mean irradiance of the picture.
    pub shadow: f32,
    /// A block is divided when its middle departs from its corners' mean by more, mm.
    pub curved_mm: f32,
    /// Whether bent horizons are followed finely.
    pub fine: bool,
    /// Whether flanks light their surroundings.
    pub bounce: bool,
    /// Whether nothing is skipped that a scene does not need: to measure what skipping saves.
    pub thorough: bool,
}

/// Pictures, and what tells of their error.
pub struct Pictures {
    /// One, or one a light.
    pub films: Vec<Film>,
    /// Sum over pixels and channels of the squares of what the bounce changed (of the last picture).
    pub bounced: f64,
    /// Rms over the face of |n - n0|^2, which tells how steep the press made it.
    pub steepness: f64,
    /// Sum over pixels and channels of the variances of what mixed pixels are means of (of the first picture).
    pub spread: f64,
}

/// Rms of |n - n0|^2 over cells, n0 the normal of the untouched face.
fn steepness(cells: &[Cell], rest_normal: impl Fn(Vec3) -> Vec3) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for cell in cells.iter().filter(|c| c.count > 0.0) {
        let rest = rest_normal(cell.position / cell.count);
        let departure = f64::from((cell.normal.normalize_or(rest) - rest).length_squared());
        sum += departure * departure * f64::from(cell.count);
        count += f64::from(cell.count);
    }
    (sum / f64::max(count, 1.0)).sqrt()
}

/// Rows of blocks hold one picture after the other, `block` numbers each.
fn by_film(all: Vec<Vec3>, block: usize, films: usize) -> Vec<Vec<Vec3>> {
    if films == 1 {
        return vec![all];
    }
    let mut out = vec![Vec::with_capacity(all.len() / films); films];
    for row in all.chunks(block * films) {
        for (film, part) in out.iter_mut().zip(row.chunks_exact(row.len() / films)) {
            film.extend_from_slice(part);
        }
    }
    out
}

/// A pad seen by the sensor, ready to be shaded.
pub struct Frame<'a> {
    pub once: &'a Precomputed,
    pub mesh: &'a Mesh,
    /// Points of the pad's lattice along x.
    pub nx: usize,
    pub albedo: &'a Albedo,
    pub heights: &'a Heights,
    /// What the corners of pixels see of the pad.
    pub seen: &'a [Sample],
    /// Its vertices in the raster.
    pub vertices: &'a [Vec3],
    pub effort: Effort,
    pub slots: Slots,
    /// Irradiance against which errors are held.
    pub level: f32,
}

impl Frame<'_> {
    /// The pictures, one or one a light.
    pub fn render(mut self) -> Pictures {
        let camera = &self.once.view.camera;
        let (width, height, films) = (camera.width, camera.height, self.slots.films);
        let nodes = self.nodes();
        self.level = self.mean_level(&nodes);
        let this = &self;
        let cell_px = self.cell_px();
        let size = [width.div_ceil(cell_px), height.div_ceil(NODE_PX) * (NODE_PX / cell_px)];
        let in_row = size[0] * (NODE_PX / cell_px);
        let mut cells = vec![bounce::EMPTY; size[0] * size[1]];
        let mut light = vec![Vec3::ZERO; size[0] * size[1] * films];
        let mut spreads = vec![0.0; height.div_ceil(NODE_PX)];
        let mut pixels = vec![Vec3::ZERO; width * height * films];
        pixels
            .par_chunks_mut(NODE_PX * width * films)
            .zip(cells.par_chunks_mut(in_row))
            .zip(light.par_chunks_mut(in_row * films))
            .zip(&mut spreads)
            .enumerate()
            .for_each(|(row, (((out, cells), light), spread))| {
                with_widest(Row { frame: this, nodes: &nodes, row, cell_px, out, cells, light, spread });
            });
        let films = by_film(pixels, NODE_PX * width, films);
        let lights = by_film(light, in_row, films.len());
        let mut all: Vec<Film> = films.into_iter().map(|pixels| Film { width, height, pixels }).collect();
        let mut bounced = 0.0;
        if self.effort.bounce {
            let albedo = match self.albedo {
                Albedo::Constant(albedo) => *albedo,
                Albedo::Texture(texture) => texture.mean(),
            };
            let edge_mm = cell_px as f32 * self.once.pixel_mm;
            let cells = Cells { size, edge_mm, cells: &cells, lights: &lights, albedo };
            let grids = match lights.len() {
                1 => std::slice::from_ref(&self.once.total),
                _ => &self.once.tables.probes[..],
            };
            let grounds = if lights.len() == 1 { &self.once.grounds[..1] } else { &self.once.grounds[1..] };
            let gains = cells.gains(|film, p| Untouched {
                sky: grids[film].at(p),
                // (Under the table it holds what it has at the untouched face.)
                ground: Vec3::from(grounds[film].at(p.with_z(f32::MIN))),
            });
            for (k, (film, gains)) in all.iter_mut().zip(&gains).enumerate() {
                bounced = self.apply(film, [k, lights.len()], gains, size[0], cell_px);
            }
        }
        Pictures {
            films: all,
            bounced,
            steepness: steepness(&cells, |p| self.once.total.rest_normal(p)),
            spread: spreads.iter().sum(),
        }
    }

    /// Pixels along the edge of a cell of the bounce.
    fn cell_px(&self) -> usize {
        [8, 4, 2].into_iter().find(|n| *n as f32 * self.once.pixel_mm <= CELL_MM).unwrap_or(1)
    }

    /// Multiplies a picture by its gains, bilinear between the middles of cells; the sum of squares of what changes.
    fn apply(
        &self,
        film: &mut Film,
        [k, films]: [usize; 2],
        gains: &[Vec3],
        nx: usize,
        cell_px: usize,
    ) -> f64 {
        let width = film.width;
        let ny = gains.len() / nx;
        let change = |(y, row): (usize, &mut [Vec3])| {
            let at = ((y as f32 + 0.5) / cell_px as f32 - 0.5).max(0.0);
            let j = (at as usize).min(ny - 1);
            let t = at - j as f32;
            let (above, below) = (&gains[j * nx..][..nx], &gains[(j + 1).min(ny - 1) * nx..][..nx]);
            let mut sum = 0.0;
            if above.iter().chain(below).all(|g| *g == Vec3::ONE) {
                return sum;
            }
            let column: Vec<Vec3> = above.iter().zip(below).map(|(a, b)| a.lerp(*b, t)).collect();
            for (x, pixel) in row.iter_mut().enumerate() {
                let at = ((x as f32 + 0.5) / cell_px as f32 - 0.5).max(0.0);
                let i = (at as usize).min(nx - 1);
                let gain = column[i].lerp(column[(i + 1).min(nx - 1)], at - i as f32);
                let veil = self.once.veil(k, films, x, y);
                let add = (*pixel - veil) * (gain - Vec3::ONE);
                sum += f64::from(add.length_squared());
                *pixel += add;
            }
            sum
        };
        film.pixels.par_chunks_mut(width).enumerate().map(change).sum()
    }

    /// What a light's irradiance counts for: the rms of its colours; alike for all where each has a picture of its own.
    #[inline(always)]
    fn strength(&self, l: usize) -> f32 {
        if self.slots.films > 1 { 1.0 } else { self.once.radiances[l].length() * RMS }
    }

    /// Mean irradiance at the nodes, as errors count: what a level pad gets.
    fn mean_level(&self, nodes: &[f32]) -> f32 {
        let (slots, lights) = (&self.slots, self.once.sources.len());
        let (mut sum, mut count) = (0.0, 0.0f32);
        for node in nodes.chunks_exact(slots.stride()).filter(|n| !n[POSITION].is_nan()) {
            sum += (0..lights).map(|l| node[slots.direct(l) + 2].max(0.0) * self.strength(l)).sum::<f32>();
            count += 1.0;
        }
        // Of several pictures each has its part.
        let films = slots.films as f32;
        sum / (count.max(1.0) * films)
    }

    /// Nodes along x and y.
    fn node_counts(&self) -> [usize; 2] {
        let camera = &self.once.view.camera;
        [camera.width.div_ceil(NODE_PX) + 1, camera.height.div_ceil(NODE_PX) + 1]
    }

    /// All nodes, row by row.
    fn nodes(&self) -> Vec<f32> {
        let [columns, rows] = self.node_counts();
        let stride = self.slots.stride();
        let mut nodes = vec![0.0; columns * rows * stride];
        nodes.par_chunks_mut(columns * stride).enumerate().for_each(|(row, out)| {
            with_widest(NodeRow { frame: self, row, out });
        });
        nodes
    }

    /// What a corner of a pixel sees of the pad, if nothing fixed is in front.
    #[inline(always)]
    fn corner(&self, x: usize, y: usize) -> Option<(Vec3, u32)> {
        let view = &self.once.view;
        let sample = self.seen[y * view.corners()[0] + x];
        let hidden = self.once.fixed(x, y).is_some_and(|value| value > sample.value);
        (sample.triangle != u32::MAX && !hidden)
            .then(|| (super::View::point(view.row(y)[x], sample.value), sample.triangle))
    }

    /// Normal of a triangle, towards the camera.
    #[inline(always)]
    fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = corners(triangle, self.nx).map(|k| self.mesh.positions[k]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        if n.dot(self.once.view.camera.origin - a) < 0.0 { -n } else { n }
    }

    /// Albedo at a point of a triangle.
    #[inline(always)]
    fn albedo_at(&self, triangle: u32, p: Vec3) -> Vec3 {
        match self.albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Texture(texture) => texture.sample(uv(self.mesh, self.nx, triangle, p)),
        }
    }

    /// Fills up to eight nodes at once.
    #[inline(always)]
    fn fill(&self, points: &[Vec3], out: &mut [f32]) {
        let (once, slots) = (self.once, &self.slots);
        let stride = slots.stride();
        let mut eight = Vectors::all(points[0]);
        for (i, p) in points.iter().enumerate() {
            (eight.x.0[i], eight.y.0[i], eight.z.0[i]) = (*p).into();
        }
        for (l, (source, table)) in once.sources.iter().zip(&once.tables.direct).enumerate() {
            let phi = match (table, source.corners()) {
                (None, Some(corners)) => quadrilateral(&corners, eight),
                _ => Vectors::all(Vec3::ZERO),
            };
            for (i, (p, node)) in points.iter().zip(out.chunks_exact_mut(stride)).enumerate() {
                let phi = match table {
                    Some(table) => Vec3::from(table.at(*p)),
                    None if source.faces(*p) => Vec3::new(phi.x.0[i], phi.y.0[i], phi.z.0[i]),
                    None => Vec3::ZERO,
                };
                node[slots.direct(l)..][..3].copy_from_slice(&phi.to_array());
            }
        }
        let grids =
            if slots.films == 1 { std::slice::from_ref(&once.total) } else { &once.tables.probes[..] };
        let greys = once.greys.as_deref().filter(|_| slots.grey).unwrap_or_default();
        for (p, node) in points.iter().zip(out.chunks_exact_mut(stride)) {
            node[POSITION..3].copy_from_slice(&p.to_array());
            for (film, grid) in greys.iter().enumerate() {
                let values = grid.at(*p);
                node[slots.indirect(film)..][..values.len()].copy_from_slice(&values);
            }
            for (film, grid) in grids.iter().enumerate().filter(|_| !slots.grey) {
                let values = grid.at(*p);
                node[slots.indirect(film)..][..values.len()].copy_from_slice(&values);
            }
            for (l, source) in once.sources.iter().enumerate() {
                let lines = source.seen(*p, once.view.slab.as_ref());
                self.horizons(l, *p, &lines, node);
                // Behind a light there is nothing to take off.
                node[slots.gain(l)] = f32::from(u8::from(source.faces(*p)));
                if slots.varying() {
                    let numbers = &mut node[slots.line(l, 0)..][..6 * LINES];
                    for (numbers, end) in numbers.chunks_exact_mut(3).zip(lines.iter().flatten()) {
                        numbers.copy_from_slice(&end.to_array());
                    }
                }
                if once.tables.direct[l].is_some() {
                    let phi = Vec3::from_slice(&node[slots.direct(l)..]);
                    node[slots.gain(l)] = phi.length() / outline(&lines).length().max(1e-12);
                }
            }
        }
    }

    /// Fills a node between others of which it is a mean: fields are interpolated anyway, only its place and the horizons
    /// of lights that the pad hides at one of them are its own.
    #[inline(always)]
    fn fill_between(&self, p: Vec3, parents: [&[f32]; 4], [u, v]: [f32; 2], node: &mut [f32]) {
        let slots = &self.slots;
        let [a, b, c, d] = parents.map(|parent| &parent[..node.len()]);
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        for (k, number) in node.iter_mut().enumerate() {
            *number = a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2] + d[k] * weights[3];
        }
        node[POSITION..3].copy_from_slice(&p.to_array());
        for (l, source) in self.once.sources.iter().enumerate() {
            if !self.effort.thorough && node[slots.light(l)] == 0.0 {
                continue;
            }
            let lines = match slots.varying() {
                true => {
                    let end = |k: usize, end: usize| Vec3::from_slice(&node[slots.line(l, k) + 3 * end..]);
                    std::array::from_fn(|k| [end(k, 0), end(k, 1)])
                }
                false => source.seen(p, None),
            };
            self.horizons(l, p, &lines, node);
        }
    }

    /// Fills a node's part on what the pad hides of a light, whose lines appear there.
    #[inline(always)]
    fn horizons(&self, l: usize, p: Vec3, lines: &[Line; LINES], node: &mut [f32]) {
        let slots = &self.slots;
        let (mut hides, mut rises, mut uneven) = (false, false, false);
        let slopes = slots.horizons(l);
        // A few lines first; the ones between only where the pad rises before one of these, and the finest only where
        // the horizon bends.
        let order = (0..LINES).step_by(COARSE).chain((2..LINES).step_by(COARSE)).chain((1..LINES).step_by(2));
        for (turn, k) in order.enumerate() {
            let coarse = turn < LINES.div_ceil(COARSE);
            let between = |reach: usize| 0.5 * (node[slopes + k - reach] + node[slopes + k + reach]);
            if k % 2 == 1 && rises && !uneven && !self.effort.thorough {
                node[slopes + k] = between(1);
                continue;
            }
            let sight = Toward::new(lines[k]);
            let horizon = match coarse || rises || self.effort.thorough {
                true => sight.horizon(self.heights, p, slots.bent()),
                false => sight.least(),
            };
            uneven |= !coarse && k % 2 == 0 && self.effort.fine && (horizon - between(2)).abs() > BENT;
            node[slopes + k] = horizon;
            hides |= horizon > sight.from.min(sight.to);
            rises |= horizon > sight.least();
        }
        node[slots.light(l)] =
            if hides { f32::from(1 + u8::from(uneven || self.effort.thorough)) } else { 0.0 };
    }
}

/// A line of a light as it is looked at from a point of the pad.
#[derive(Debug, Clone, Copy)]
struct Toward {
    ahead: Vec2,
    distance: f32,
    /// Slopes under which its ends appear.
    from: f32,
    to: f32,
}

impl Toward {
    #[inline(always)]
    fn new([low, high]: Line) -> Self {
        let middle = (low + high).truncate() * 0.5;
        let distance = middle.length().max(1e-6);
        let ahead = middle / distance;
        let slope = |q: Vec3| q.z / q.truncate().dot(ahead).max(1e-3 * distance);
        Self { ahead, distance, from: slope(low), to: slope(high) }
    }

    /// From here upwards horizons are followed.
    #[inline(always)]
    fn least(&self) -> f32 {
        self.from.min(self.to) - BELOW
    }

    #[inline(always)]
    fn horizon(&self, heights: &Heights, p: Vec3, bent: bool) -> f32 {
        // A light that appears through a plate has no distance: the pad's rim ends the line of sight.
        let distance = if bent { f32::INFINITY } else { self.distance };
        heights.horizon(p, self.ahead, distance, self.least(), self.from.max(self.to))
    }
}

/// Vector irradiance of a whole ribbon.
#[inline(always)]
fn outline(lines: &[Line; LINES]) -> Vec3 {
    let mut around = [Vec3::ZERO; 2 * LINES];
    for (k, [low, high]) in lines.iter().enumerate() {
        around[k] = *low;
        around[2 * LINES - 1 - k] = *high;
    }
    irradiance(&around)
}

struct NodeRow<'a> {
    frame: &'a Frame<'a>,
    row: usize,
    out: &'a mut [f32],
}

impl Work for NodeRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let camera = &self.frame.once.view.camera;
        let y = (self.row * NODE_PX).min(camera.height);
        let stride = self.frame.slots.stride();
        for (batch, nodes) in self.out.chunks_mut(WIDTH * stride).enumerate() {
            let seen = |i: usize| self.frame.corner(((batch * WIDTH + i) * NODE_PX).min(camera.width), y);
            let mut points = [Vec3::ZERO; WIDTH];
            let n = nodes.len() / stride;
            (0..n).for_each(|i| points[i] = seen(i).map_or(Vec3::ZERO, |(p, _)| p));
            self.frame.fill(&points[..n], nodes);
            for (i, node) in nodes.chunks_exact_mut(stride).enumerate() {
                if seen(i).is_none() {
                    node[POSITION] = f32::NAN;
                }
            }
        }
    }
}

/// A row of blocks.
struct Row<'a> {
    frame: &'a Frame<'a>,
    nodes: &'a [f32],
    row: usize,
    cell_px: usize,
    out: &'a mut [Vec3],
    cells: &'a mut [Cell],
    light: &'a mut [Vec3],
    spread: &'a mut f64,
}

/// A rectangle of pixels: x0, y0, x1, y1.
type Rectangle = [usize; 4];

/// Room for the work on a row.
struct Desk<'a> {
    frame: &'a Frame<'a>,
    block: Block<'a>,
    first: usize,
    width: usize,
    /// Coordinates of the corners, row by row, with one more on every side and room to read eight at the end.
    stride: usize,
    points: [Vec<f32>; 3],
    uvs: Vec<Vec2>,
    out: &'a mut [Vec3],
    sums: Vec<Vectors>,
    /// Nodes of a block that is being divided, and its parts that wait.
    arena: Vec<f32>,
    waiting: Vec<(Rectangle, [usize; 4])>,
    cell_px: usize,
    cells: &'a mut [Cell],
    light: &'a mut [Vec3],
    spread: &'a mut f64,
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

/// What a block is divided for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finer {
    /// Everything.
    Fields,
    /// The edges of shadows alone.
    Horizons,
}

/// Where nothing is seen.
const NOWHERE: f32 = 1e30;

impl Work for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { frame, nodes, row, cell_px, out, cells, light, spread } = self;
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
        let block = Block::new(&frame.slots, &frame.once.sources, frame.effort.thorough);
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
            cell_px,
            cells,
            light,
            spread,
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

impl Desk<'_> {
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

    /// A block some of whose nodes see no pad: they borrow a point of it that does.
    #[inline(never)]
    fn partial(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        let [x0, y0, x1, y1] = rectangle;
        let mut any = (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
        let Some((x, y)) = any.find(|&(x, y)| self.point(x, y).x != NOWHERE) else {
            (y0..y1).for_each(|y| (x0..x1).for_each(|x| self.mixed(x, y, rectangle)));
            return;
        };
        let mut borrowed = vec![0.0; self.frame.slots.stride()];
        self.frame.fill(&[self.point(x, y)], &mut borrowed);
        self.shade(rectangle, four.map(|n| if n[POSITION].is_nan() { &borrowed[..] } else { n }));
    }

    /// Divides a block until what it holds can be interpolated.
    #[inline(always)]
    fn divide(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        if self.finer(rectangle, four).is_none() {
            self.shade(rectangle, four);
            return;
        }
        // Parts that wait, with their nodes in the arena.
        let stride = self.frame.slots.stride();
        let mut arena = std::mem::take(&mut self.arena);
        let mut waiting = std::mem::take(&mut self.waiting);
        arena.clear();
        four.iter().for_each(|n| arena.extend_from_slice(n));
        waiting.push((rectangle, [0, 1, 2, 3]));
        while let Some((rectangle, ids)) = waiting.pop() {
            let [x0, y0, x1, y1] = rectangle;
            let parents = ids.map(|k| &arena[k * stride..][..stride]);
            let Some(finer) = self.finer(rectangle, parents) else {
                self.shade(rectangle, parents);
                continue;
            };
            let (mx, my) = ((x0 + x1) / 2, (y0 + y1) / 2);
            let next = arena.len() / stride;
            let inner = [(mx, y0), (x0, my), (mx, my), (x1, my), (mx, y1)].map(|(x, y)| self.point(x, y));
            let (old, fresh) = {
                let at = arena.len();
                arena.resize(at + inner.len() * stride, 0.0);
                arena.split_at_mut(at)
            };
            match finer {
                Finer::Fields => self.frame.fill(&inner, fresh),
                Finer::Horizons => {
                    let (u, v) = ((mx - x0) as f32 / (x1 - x0) as f32, (my - y0) as f32 / (y1 - y0) as f32);
                    let parents = ids.map(|k| &old[k * stride..][..stride]);
                    let places = [[u, 0.0], [0.0, v], [u, v], [1.0, v], [u, 1.0]];
                    for ((node, p), at) in fresh.chunks_exact_mut(stride).zip(inner).zip(places) {
                        self.frame.fill_between(p, parents, at, node);
                    }
                }
            }
            let [a, b, c, d] = ids;
            let [top, left, middle, right, bottom] = [0, 1, 2, 3, 4].map(|k| next + k);
            waiting.push(([x0, y0, mx, my], [a, top, left, middle]));
            waiting.push(([mx, y0, x1, my], [top, b, middle, right]));
            waiting.push(([x0, my, mx, y1], [left, middle, c, bottom]));
            waiting.push(([mx, my, x1, y1], [middle, right, bottom, d]));
        }
        (self.arena, self.waiting) = (arena, waiting);
    }

    /// Whether a block must be divided, and can be, and for what.
    #[inline(always)]
    fn finer(&self, rectangle: Rectangle, four: [&[f32]; 4]) -> Option<Finer> {
        let [x0, y0, x1, y1] = rectangle;
        let (effort, size) = (&self.frame.effort, (x1 - x0).max(y1 - y0) as f32 * self.frame.once.pixel_mm);
        if x1 - x0 < 2 || y1 - y0 < 2 {
            return None;
        }
        let (mx, my) = ((x0 + x1) / 2, (y0 + y1) / 2);
        let curved = || {
            let mean = 0.25 * four.iter().map(|n| n[POSITION + 2]).sum::<f32>();
            (self.point(mx, my).z - mean).abs() > effort.curved_mm
        };
        let wanted = if size > effort.block_mm || curved() {
            Finer::Fields
        } else if size > effort.shadow_mm && self.bends([mx, my], rectangle, four) {
            Finer::Horizons
        } else {
            return None;
        };
        let inner = [(mx, y0), (x0, my), (mx, my), (x1, my), (mx, y1)];
        inner.iter().all(|&(x, y)| self.point(x, y).x != NOWHERE).then_some(wanted)
    }

    /// Whether interpolated horizons would be wrong by too much light at the middle of a block.
    #[inline(always)]
    fn bends(&self, [mx, my]: [usize; 2], [x0, y0, x1, y1]: Rectangle, four: [&[f32]; 4]) -> bool {
        let frame = self.frame;
        let slots = &frame.slots;
        let flagged = |l: usize| four.iter().any(|n| n[slots.light(l)] > 0.0);
        if frame.effort.thorough || !(0..frame.once.sources.len()).any(flagged) {
            return frame.effort.thorough;
        }
        let p = self.point(mx, my);
        if p.x == NOWHERE {
            return false;
        }
        let (u, v) = ((mx - x0) as f32 / (x1 - x0) as f32, (my - y0) as f32 / (y1 - y0) as f32);
        let between = |k: usize| {
            let (top, bottom) =
                (four[0][k] * (1.0 - u) + four[1][k] * u, four[2][k] * (1.0 - u) + four[3][k] * u);
            top * (1.0 - v) + bottom * v
        };
        let vector = |k: usize| Vec3::new(between(k), between(k + 1), between(k + 2));
        let [a, b, c, d] = four.map(|n| Vec3::from_slice(&n[POSITION..]));
        let normal = (c - b).cross(d - a).normalize_or(Vec3::Z);
        let normal = if normal.z < 0.0 { -normal } else { normal };
        let mut wrong = 0.0;
        for (l, source) in frame.once.sources.iter().enumerate().filter(|(l, _)| flagged(*l)) {
            let light = vector(slots.direct(l)).dot(normal).max(0.0) * frame.strength(l);
            if light <= frame.effort.shadow * frame.level {
                continue;
            }
            let mut departs = 0.0;
            for k in (0..LINES).step_by(COARSE) {
                let line = match slots.varying() {
                    true => [0, 3].map(|end| vector(slots.line(l, k) + end)),
                    false => source.line(k, LINES - 1, p).map(|end| end - p),
                };
                let sight = Toward::new(line);
                let cut =
                    |slope: f32| ((slope - sight.from) / (sight.to - sight.from).max(1e-6)).clamp(0.0, 1.0);
                let horizon = sight.horizon(frame.heights, p, slots.bent());
                departs += (cut(horizon) - cut(between(slots.horizons(l) + k))).abs();
            }
            wrong += light * departs / 3.0;
        }
        wrong > frame.effort.shadow * frame.level
    }

    /// Shades a block, eight pixels at a time: of narrow blocks several rows at once.
    #[inline(always)]
    fn shade(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        let [x0, y0, x1, y1] = rectangle;
        self.block.prepare(four);
        let scale = [1.0 / (x1 - x0) as f32, 1.0 / (y1 - y0) as f32];
        let limit = Eight::all(STEEPEST * self.frame.once.pixel_mm);
        let crease = Eight::all(CREASE * self.frame.once.pixel_mm);
        let columns = x1 - x0;
        let at_once = (WIDTH / columns).max(1);
        for top in (y0..y1).step_by(at_once) {
            let lanes = Lanes { x0, columns, top, count: columns * at_once.min(y1 - top) };
            let u = Eight(std::array::from_fn(|i| ((i % columns) as f32 + 0.5) * scale[0]));
            let v = Eight(std::array::from_fn(|i| ((top - y0 + i / columns) as f32 + 0.5) * scale[1]));
            let first = self.at(x0, top);
            let stride = self.stride;
            let read = |c: usize, step: usize| match columns == WIDTH {
                true => Eight(std::array::from_fn(|i| self.points[c][first + step..first + step + WIDTH][i])),
                // (Beyond the last row of the block it reads that row.)
                false => Eight(std::array::from_fn(|i| {
                    let i = i.min(lanes.count - 1);
                    self.points[c][first + step + i / columns * stride + i % columns]
                })),
            };
            let vectors = |k: usize| Vectors { x: read(0, k), y: read(1, k), z: read(2, k) };
            let (a, b) = (vectors(0), vectors(1));
            let (c, d) = (vectors(stride), vectors(stride + 1));
            let low = a.z.min(b.z).min(c.z.min(d.z));
            let high = a.z.max(b.z).max(c.z.max(d.z));
            let steep = limit.below(high - low);
            let before = |k: usize| {
                let back = first - k;
                match columns == WIDTH {
                    true => Eight(std::array::from_fn(|i| self.points[2][back..back + WIDTH][i])),
                    false => Eight(std::array::from_fn(|i| {
                        let i = i.min(lanes.count - 1);
                        self.points[2][back + i / columns * stride + i % columns]
                    })),
                }
            };
            let bend = |step: usize, next: Eight| ((read(2, 2 * step) - next) - (a.z - before(step))).abs();
            let uneven = steep.or(crease.below(bend(1, b.z).max(bend(stride, c.z))));
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
            self.block.light([u, v], point, normal, &self.frame.once.radiances, &mut self.sums);
            self.put(lanes);
            self.count(lanes, point, normal, steep);
            if uneven.any() {
                for i in (0..lanes.count).filter(|&i| uneven.lane(i)) {
                    let (x, y) = lanes.pixel(i);
                    self.mixed(x, y, rectangle);
                }
            }
        }
    }

    /// Adds pixels to the cells of the bounce; of large cells some rows stand for all.
    #[inline(always)]
    fn count(&mut self, lanes: Lanes, points: Vectors, normals: Vectors, not: Mask) {
        let columns = self.width.div_ceil(self.cell_px);
        let cells = self.cells.len();
        for i in 0..lanes.count {
            let (x, y) = lanes.pixel(i);
            if not.lane(i) || (self.cell_px >= 4 && y % 4 != 1) {
                continue;
            }
            let k = (y - self.first) / self.cell_px * columns + x / self.cell_px;
            let pick = |v: &Vectors| Vec3::new(v.x.0[i], v.y.0[i], v.z.0[i]);
            let cell = &mut self.cells[k];
            cell.position += pick(&points);
            cell.normal += pick(&normals);
            cell.count += 1.0;
            for (film, sum) in self.sums.iter().enumerate() {
                self.light[film * cells + k] += pick(sum);
            }
        }
    }

    /// Writes the light on pixels.
    #[inline(always)]
    fn put(&mut self, lanes: Lanes) {
        let rows = self.out.len() / (self.width * self.sums.len());
        for i in 0..lanes.count {
            let (x, y) = lanes.pixel(i);
            let albedo = self.albedo(x, y) * (FRAC_1_PI * self.frame.once.transmitted(x, y));
            for (film, sum) in self.sums.iter().enumerate() {
                let light = Vec3::new(sum.x.0[i], sum.y.0[i], sum.z.0[i]);
                let veil = self.frame.once.veil(film, self.sums.len(), x, y);
                self.out[(film * rows + y - self.first) * self.width + x] = albedo * light + veil;
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
                let mean = |n: usize| {
                    let mut sum = Vec3::ZERO;
                    for k in 0..n * n {
                        let (s, t) = ((k % n) as f32 + 0.5, (k / n) as f32 + 0.5);
                        let (s, t) = (s / n as f32, t / n as f32);
                        sum += texture.sample(a.lerp(b, s).lerp(c.lerp(d, s), t));
                    }
                    sum / (n * n) as f32
                };
                // As many samples as the pixel covers texels, at least 2 x 2.
                let size = Vec2::new(texture.width as f32, texture.height as f32);
                let spread = ((d - a) * size).abs().max((c - b) * size).max_element();
                if spread < 2.5 { mean(2) } else { mean((spread.ceil() as usize).clamp(3, 16)) }
            }
        }
    }

    /// A pixel over a crease, or one whose corners see different things: the mean of a grid of samples, or of its corners
    /// where those do not all see the pad.
    #[inline(never)]
    fn mixed(&mut self, x: usize, y: usize, rectangle: Rectangle) {
        let corner = |dx: usize, dy: usize| self.frame.corner(x + dx, y + dy).map(|(_, triangle)| triangle);
        let triangles = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        if let [Some(a), Some(b), Some(c), Some(d)] = triangles
            && let Some(quads) = self.quads([a, b, c, d])
        {
            self.sampled(x, y, rectangle, [a, b, c, d].map(|k| self.frame.normal(k)), quads);
        } else {
            self.cornered(x, y, rectangle);
        }
    }

    /// The quads of the lattice around these triangles, from and to along x and y; None where they are many.
    fn quads(&self, triangles: [u32; 4]) -> Option<[usize; 4]> {
        let (nx, ny) = (self.frame.nx - 1, self.frame.vertices.len() / self.frame.nx - 1);
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for triangle in triangles {
            let quad = triangle as usize / 2;
            for (k, at) in [quad % nx, quad / nx].into_iter().enumerate() {
                (low[k], high[k]) = (low[k].min(at), high[k].max(at));
            }
        }
        let few = (0..2).all(|k| high[k] - low[k] < MOST_QUADS);
        few.then(|| {
            let [i, j] = low.map(|at| at.saturating_sub(1));
            [i, (high[0] + 2).min(nx), j, (high[1] + 2).min(ny)]
        })
    }

    /// The mean of a grid of samples over a pixel, each with the triangle on top there. Horizons jump at a crease: each
    /// sample takes those of the corner that lies most as it does.
    fn sampled(
        &mut self,
        x: usize,
        y: usize,
        [x0, y0, x1, y1]: Rectangle,
        corner_normals: [Vec3; 4],
        [i0, i1, j0, j1]: [usize; 4],
    ) {
        let frame = self.frame;
        let once = frame.once;
        let films = self.sums.len();
        let rows = self.out.len() / (self.width * films);
        let place = |k: usize| Vec2::new((k % GRID) as f32 + 0.5, (k / GRID) as f32 + 0.5) / GRID as f32;
        // Which triangle is on top at each sample.
        let mut found = [(f32::NEG_INFINITY, u32::MAX); GRID * GRID];
        let middle = Vec2::new(x as f32, y as f32);
        for j in j0..j1 {
            for i in i0..i1 {
                let id = 2 * (j * (frame.nx - 1) + i) as u32;
                for triangle in [id, id + 1] {
                    let [a, b, c] = corners(triangle, frame.nx).map(|k| frame.vertices[k]);
                    let [pa, pb, pc] = [a, b, c].map(|p| p.truncate() - middle);
                    let outside = pa.min(pb).min(pc).cmpgt(Vec2::ONE).any()
                        || pa.max(pb).max(pc).cmplt(Vec2::ZERO).any();
                    let area = (pb - pa).perp_dot(pc - pa);
                    if outside || area == 0.0 || !area.is_finite() {
                        continue;
                    }
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
                }
            }
        }
        // The light on each.
        let row = [once.view.row(y), once.view.row(y + 1)];
        let mut light = vec![Vec3::ZERO; films];
        let (mut squares, mut count) = (Vec3::ZERO, 0.0f32);
        for first in (0..GRID * GRID).step_by(WIDTH) {
            let (mut points, mut normals) = (Vectors::all(Vec3::ZERO), Vectors::all(Vec3::Z));
            let mut albedos = [Vec3::ZERO; WIDTH];
            let (mut seen, mut corner) = ([false; WIDTH], [0; WIDTH]);
            for lane in 0..WIDTH {
                let (value, triangle) = found[first + lane];
                if triangle == u32::MAX {
                    continue;
                }
                let at = place(first + lane);
                let ray: [Vec3; 2] = std::array::from_fn(|k| {
                    let between = |row: &[[Vec3; 2]]| row[x][k].lerp(row[x + 1][k], at.x);
                    between(row[0]).lerp(between(row[1]), at.y)
                });
                let p = super::View::point(ray, value);
                let n = frame.normal(triangle);
                (points.x.0[lane], points.y.0[lane], points.z.0[lane]) = p.into();
                (normals.x.0[lane], normals.y.0[lane], normals.z.0[lane]) = n.into();
                albedos[lane] = frame.albedo_at(triangle, p);
                seen[lane] = true;
                let like = |k: usize| {
                    let far = at.distance_squared(Vec2::new((k % 2) as f32, (k / 2) as f32));
                    n.dot(corner_normals[k]) - NEARNESS * far
                };
                corner[lane] = (1..4).fold(0, |best, k| if like(k) > like(best) { k } else { best });
            }
            let at = |k: usize, low: usize, high: usize| (k - low) as f32 / (high - low) as f32;
            let u = Eight(std::array::from_fn(|k| at(x + corner[k] % 2, x0, x1)));
            let v = Eight(std::array::from_fn(|k| at(y + corner[k] / 2, y0, y1)));
            self.sums.fill(Vectors::all(Vec3::ZERO));
            self.block.light([u, v], points, normals, &once.radiances, &mut self.sums);
            for lane in (0..WIDTH).filter(|&lane| seen[lane]) {
                for (film, (sum, light)) in self.sums.iter().zip(&mut light).enumerate() {
                    let value =
                        albedos[lane] * Vec3::new(sum.x.0[lane], sum.y.0[lane], sum.z.0[lane]) * FRAC_1_PI;
                    *light += value;
                    if film == 0 {
                        squares += value * value;
                    }
                }
                count += 1.0;
            }
        }
        if count == 0.0 {
            self.cornered(x, y, [x0, y0, x1, y1]);
            return;
        }
        let variance = squares / count - (light[0] / count) * (light[0] / count);
        *self.spread += SAMPLED_ERROR * f64::from(variance.element_sum().max(0.0));
        for (film, light) in light.iter().enumerate() {
            let veil = once.veil(film, films, x, y);
            self.out[(film * rows + y - self.first) * self.width + x] =
                *light / count * once.transmitted(x, y) + veil;
        }
    }

    /// The mean of what the corners of a pixel see.
    fn cornered(&mut self, x: usize, y: usize, [x0, y0, x1, y1]: Rectangle) {
        let once = self.frame.once;
        let films = self.sums.len();
        let rows = self.out.len() / (self.width * films);
        let (mut points, mut normals) = (Vectors::all(Vec3::ZERO), Vectors::all(Vec3::Z));
        let mut albedos = [Vec3::ZERO; 4];
        let mut fixed = vec![Vec3::ZERO; films];
        for (k, (cx, cy)) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].into_iter().enumerate() {
            match self.frame.corner(cx, cy) {
                Some((p, triangle)) => {
                    let n = self.frame.normal(triangle);
                    (points.x.0[k], points.y.0[k], points.z.0[k]) = p.into();
                    (normals.x.0[k], normals.y.0[k], normals.z.0[k]) = n.into();
                    albedos[k] = self.frame.albedo_at(triangle, p);
                }
                None => {
                    for (film, sum) in fixed.iter_mut().enumerate() {
                        *sum += 0.25 * once.fixed_light(film, films, cx, cy);
                    }
                }
            }
        }
        if albedos != [Vec3::ZERO; 4] {
            // Each corner with the light and the horizons where it stands.
            let at = |k: usize, low: usize, high: usize| ((k - low) as f32) / (high - low) as f32;
            let u = Eight(std::array::from_fn(|k| at(x + k % 2, x0, x1)));
            let v = Eight(std::array::from_fn(|k| at(y + k / 2 % 2, y0, y1)));
            self.sums.fill(Vectors::all(Vec3::ZERO));
            self.block.light([u, v], points, normals, &once.radiances, &mut self.sums);
        }
        for (film, fixed) in fixed.iter().enumerate() {
            let mut light = Vec3::ZERO;
            let mut squares = Vec3::ZERO;
            for (k, albedo) in albedos.iter().enumerate() {
                let sum = &self.sums[film];
                let value = *albedo * Vec3::new(sum.x.0[k], sum.y.0[k], sum.z.0[k]) * FRAC_1_PI;
                light += 0.25 * value;
                squares += 0.25 * value * value;
            }
            if film == 0 {
                *self.spread += CORNERED_ERROR * f64::from((squares - light * light).element_sum().max(0.0));
            }
            let veil = once.veil(film, films, x, y);
            self.out[(film * rows + y - self.first) * self.width + x] =
                light * once.transmitted(x, y) + *fixed + veil;
        }
    }
}

/// Texture coordinate at a point of a triangle's plane; 0 where the mesh carries none.
#[inline(always)]
pub fn uv(mesh: &Mesh, nx: usize, triangle: u32, point: Vec3) -> Vec2 {
    if mesh.uvs.is_empty() {
        return Vec2::ZERO;
    }
    let ids = corners(triangle, nx);
    let [a, b, c] = ids.map(|k| mesh.positions[k]);
    let [ta, tb, tc] = ids.map(|k| mesh.uvs[k]);
    let (e, f, p) = (b - a, c - a, point - a);
    let n = e.cross(f);
    let scale = 1.0 / n.length_squared().max(1e-30);
    let (wb, wc) = (p.cross(f).dot(n) * scale, e.cross(p).dot(n) * scale);
    ta + (tb - ta) * wb + (tc - ta) * wc
}
