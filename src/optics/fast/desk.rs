//! The pixels of a picture: blocks between nodes, divided where what they hold cannot be interpolated, and shaded eight
//! pixels at a time.

use super::bounce::Cell;
use super::frame::{Frame, NODE_PX, uv};
use super::gains::Split;
use super::horizon::slope_of;
use super::lanes::{Eight, Mask, Vectors, WIDTH, Work, lanes};
use super::piece::Piece;
use super::shade::{Block, falls_off};
use super::slots::POSITION;
use super::source::coarse;
use super::tilt::Parts;
use super::toward::Toward;
use crate::optics::{Albedo, Texture};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// A pixel over which the ground's slope changes by more is looked at in its corners.
const CREASE: f32 = 0.2;
/// Where a pixel's corners differ in height by more than this many pixels, they see different things.
const STEEPEST: f32 = 8.0;
/// Flanks steeper than this, as the part of the normal towards the eye, count as this steep.
const LEVEL: f32 = 0.01;
/// A block within which so much of the light comes and goes is divided, whatever its middle says.
const JUMP: f32 = 0.5;
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

/// What a block is divided for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finer {
    /// Everything.
    Fields,
    /// The edges of shadows alone.
    Horizons,
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

    /// A block some of whose nodes see no pad is halved until all of a part's do, or it is a single pixel. What is
    /// interpolated must not come from elsewhere: beside a lamp the light changes several times over within a block.
    #[inline(never)]
    fn partial(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        let [x0, y0, x1, y1] = rectangle;
        let mut corners = (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
        if corners.all(|(x, y)| self.point(x, y).x == NOWHERE) {
            (y0..y1).for_each(|y| (x0..x1).for_each(|x| self.mixed(x, y, rectangle, false)));
            return;
        }
        let is_seen = |n: &&[f32]| !n[POSITION].is_nan();
        let (wide, high) = (x1 - x0, y1 - y0);
        let supposed;
        let whole = match four.into_iter().find(is_seen) {
            _ if four.iter().all(is_seen) => Some(four),
            Some(seen) if (wide, high) == (1, 1) => {
                // The others are where they would see the pad if it went on as high.
                let z = seen[POSITION + 2];
                supposed = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| {
                    let [start, along] = self.frame.once.view.row(y)[x];
                    let mut node = vec![0.0; self.frame.slots.stride()];
                    self.frame.fill(&[start + along * ((z - start.z) / along.z)], &mut node);
                    node
                });
                Some([0, 1, 2, 3].map(|k| if is_seen(&four[k]) { four[k] } else { &supposed[k][..] }))
            }
            _ => None,
        };
        if let Some(four) = whole {
            self.divide(rectangle, four);
            return;
        }
        let [a, b, c, d] = four;
        if wide >= high {
            let x = (x0 + x1) / 2;
            let [top, bottom] = [y0, y1].map(|y| self.node(x, y));
            self.partial([x0, y0, x, y1], [a, &top, c, &bottom]);
            self.partial([x, y0, x1, y1], [&top, b, &bottom, d]);
        } else {
            let y = (y0 + y1) / 2;
            let [left, right] = [x0, x1].map(|x| self.node(x, y));
            self.partial([x0, y0, x1, y], [a, b, &left, &right]);
            self.partial([x0, y, x1, y1], [&left, &right, c, d]);
        }
    }

    /// The node at a corner of pixels; its position is no number where the pad is not seen.
    fn node(&self, x: usize, y: usize) -> Vec<f32> {
        let mut node = vec![0.0; self.frame.slots.stride()];
        match self.point(x, y) {
            p if p.x == NOWHERE => node[POSITION] = f32::NAN,
            p => self.frame.fill(&[p], &mut node),
        }
        node
    }

    /// Divides a block until what it holds can be interpolated, and shades its parts. (One place calls for shading, all of
    /// which is inlined and takes seconds to compile.)
    #[inline(always)]
    fn divide(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        // Parts that wait, with their nodes in the arena; the whole keeps its own.
        let stride = self.frame.slots.stride();
        let mut arena = std::mem::take(&mut self.arena);
        let mut waiting = std::mem::take(&mut self.waiting);
        arena.clear();
        let mut at_hand = Some((rectangle, None::<[usize; 4]>));
        while let Some((rectangle, ids)) = at_hand {
            let parents = match ids {
                None => four,
                Some(ids) => ids.map(|k| &arena[k * stride..][..stride]),
            };
            let Some(finer) = self.finer(rectangle, parents) else {
                self.shade(rectangle, parents);
                at_hand = waiting.pop().map(|(part, ids)| (part, Some(ids)));
                continue;
            };
            let ids = ids.unwrap_or_else(|| {
                four.iter().for_each(|n| arena.extend_from_slice(n));
                [0, 1, 2, 3]
            });
            let [x0, y0, x1, y1] = rectangle;
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
            at_hand = Some(([mx, my, x1, y1], Some([middle, right, bottom, d])));
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
            let [a, b, c, d] = four.map(|n| n[POSITION + 2]);
            let mean = 0.25 * (a + b + c + d);
            // (The second tells a crease that cuts off a corner.)
            (self.point(mx, my).z - mean).abs() > effort.curved_mm || (a + d - b - c).abs() > effort.curved_mm
        };
        // Where the plane of a light runs through it.
        let ends = || {
            let faced = |l: usize| four.iter().filter(|n| n[self.frame.slots.gain(l)] > 0.0).count();
            self.frame.sided.iter().any(|l| ![0, 4].contains(&faced(*l)))
        };
        // Where light without a closed form falls off.
        let falls = || {
            let [p, q, r] = [four[0], four[3], four[1]].map(|n| Vec3::from_slice(&n[POSITION..]));
            let size2 = (q - p).length_squared().max((r - p).length_squared());
            let tabulated = |l: &usize| self.frame.once.tables.direct[*l].is_some();
            (0..self.frame.once.sources.len()).filter(tabulated).any(|l| {
                let phi = Vec3::from_slice(&four[0][self.frame.slots.direct(l)..]);
                let field = phi.abs().max_element() * self.block.weights[l];
                falls_off(&self.frame.once.sources[l].around(), 0.5 * (p + q), field, size2, 0.0)
            })
        };
        let wanted = if size > effort.block_mm || curved() || ends() || falls() {
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
        let (mut wrong, mut jumped) = (0.0, 0.0);
        for (l, source) in frame.once.sources.iter().enumerate().filter(|(l, _)| flagged(*l)) {
            let light = vector(slots.direct(l)).dot(normal).max(0.0) * frame.strength(l);
            if light <= frame.effort.shadow * frame.level {
                continue;
            }
            let (mut departs, mut jumps) = (0.0, 0.0f32);
            for k in (0..N).step_by(coarse(N)) {
                let line = match slots.varying() {
                    true => [0, 3].map(|end| vector(slots.line(l, k) + end)),
                    false => source.line(k, N - 1, p).map(|end| end - p),
                };
                let sight = Toward::new(line);
                let cut =
                    |slope: f32| ((slope - sight.from) / (sight.to - sight.from).max(1e-6)).clamp(0.0, 1.0);
                let horizon = sight.horizon(frame.heights, p, slots.bent());
                departs += (cut(horizon) - cut(slope_of(between(slots.horizons(l) + k)))).abs();
                let cuts = four.map(|n| cut(slope_of(n[slots.horizons(l) + k])));
                let most = cuts.iter().fold(0.0f32, |most, c| most.max(*c));
                jumps += most - cuts.iter().fold(1.0f32, |least, c| least.min(*c));
            }
            wrong += light * departs / 3.0;
            jumped += light * jumps / 3.0;
        }
        jumped > JUMP * frame.level || wrong > frame.effort.shadow * frame.level
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
        let crease = Eight::all(CREASE * self.frame.once.pixel_mm);
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
mod tests {
    use crate::optics::fast::tests::{punch, scene};
    use crate::optics::fast::{Precomputed, Renderer};
    use crate::optics::{LightShape, bench_scene::Variant, reference};
    use glam::Vec3;

    #[test]
    fn a_light_narrower_than_a_block_shines_at_the_camera() {
        // It covers pixel (32, 24) and one half to one pixel around, less than the distance of nodes.
        let turned = |height: fn(f32, f32) -> f32| {
            let mut scene = scene(Variant::Ac, height);
            scene.lights[0].shape = LightShape::Rectangle {
                center: Vec3::new(0.0814, -0.0814, 8.0),
                half_u: Vec3::X * 0.2,
                half_v: Vec3::Y * 0.2,
            };
            scene
        };
        let once = Precomputed::new(&turned(|_, _| 0.0)).unwrap();
        for height in [|_, _| 0.0, punch] {
            let scene = turned(height);
            let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
            // What it reflects of the others is below 1, that of the face around as well.
            let more = film.pixels[24 * 64 + 32] - scene.lights[0].radiance;
            assert!(more.min_element() > -1e-3 && more.max_element() < 1.0, "{more}");
            assert!(film.pixels[24 * 64 + 36].max_element() < 2.0);
        }
    }

    #[test]
    fn a_flank_within_one_pixel_between_slopes_that_are_alike_is_taken_apart() {
        // Both feet lie in column 32. (As level as its corners, it is 0.3 and 0.8 % off.)
        for (slope, [from_mm, rise_mm], within) in [(0.0, [0.24, 0.05], 0.0015), (0.1, [0.16, 0.1], 0.005)] {
            let mut scene = scene(Variant::Ac, |x, _| slope * x + if x < from_mm { 0.0 } else { rise_mm });
            scene.max_events = 1;
            let mut rest = scene.clone();
            let mesh = std::sync::Arc::make_mut(&mut rest.surfaces[0].mesh);
            mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
            let once = Precomputed::new(&rest).unwrap();
            let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
            let settings = reference::Settings { samples: 64, seed: 1 };
            let truth = reference::Renderer::new(&scene).unwrap().render(&settings);
            let [found, truth] = [film, truth].map(|film| (4..44).map(|y| film.at(32, y)).sum::<Vec3>());
            assert!((found / truth - Vec3::ONE).abs().max_element() < within, "{found} {truth}");
        }
    }

    #[test]
    fn beside_a_lamp_that_stands_in_the_view_both_sides_are_alike() {
        // One upright lamp alone, left or right of the middle: its blocks see the pad in part.
        let standing = |side: f32| {
            let mut scene = scene(Variant::Ac, |_, _| 0.0);
            scene.lights.truncate(1);
            scene.lights[0].shape = LightShape::Rectangle {
                center: Vec3::new(6.03 * side, 0.0, 1.3),
                half_u: Vec3::Y * -4.5 * side,
                half_v: Vec3::Z,
            };
            let once = Precomputed::new(&scene).unwrap();
            let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
            // (Samples of a pixel are not mirror images of each other: of its own edges the lamp is many times as bright.)
            let whole: Vec<bool> =
                (0..film.pixels.len()).map(|k| once.tables.covers.at(k).is_none()).collect();
            (film, whole)
        };
        let ((left, whole_left), (right, whole_right)) = (standing(-1.0), standing(1.0));
        let mirrored = |k: usize| k / left.width * left.width + left.width - 1 - k % left.width;
        let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
        for k in (0..right.pixels.len()).filter(|k| whole_right[*k] && whole_left[mirrored(*k)]) {
            squares += (left.pixels[mirrored(k)] - right.pixels[k]).length_squared();
            sum += right.pixels[k].element_sum();
            count += 3.0;
        }
        let departs = (squares * count).sqrt() / sum;
        assert!(departs < 0.01 && count > 8000.0, "{departs} of {count}");
    }
}
