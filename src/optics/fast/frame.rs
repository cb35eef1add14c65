//! One picture: nodes every few pixels, and the blocks between them.
//!
//! Each pixel's position and normal come from the points of the pad that its four corners see: the normal of their two
//! diagonals is the mean over the pixel, whatever the mesh does within. Where the corners see different things (the
//! pad's rim, a fold, a wall in front) the pixel is the mean of what its corners see.

use super::Precomputed;
use super::bounce::{self, Cell, Cells, Untouched};
use super::cover::Laid;
use super::desk::Row;
use super::gains::{self, Gains};
use super::glow::Pressed;
use super::horizon::{Heights, Stand, slope_of, squeezed};
use super::lanes::{Vectors, WIDTH, with_widest};
use super::packed::{CHANNELS, Packing};
use super::raster::{Sample, corners};
use super::skyline;
use super::slots::{POSITION, Slots};
use super::source::{COARSE, KEPT, LINES, Line, with_means};
use super::tilt::{Parts, Tilts};
use super::toward::Toward;
use super::traces;
use super::unseen::{AllUnseen, Border};
use super::vector::{irradiance, of_point, quadrilateral};
use super::wall_shadow;
use crate::optics::{Albedo, Film, Mesh};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Pixels between nodes.
pub const NODE_PX: usize = WIDTH;
/// A horizon that departs more from the mean of its neighbours, as a slope, is followed between them, too.
const BENT: f32 = 0.03;
/// Largest edge of a cell of the bounce, mm.
const CELL_MM: f32 = 0.26;
/// They are not quartered to less than this, mm: smaller ones take three times as long, and are hardly better.
const GROOVE_CELL_MM: f32 = 0.05;
/// 1/sqrt(3).
const RMS: f32 = 0.577_350_3;

/// How finely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Cells of the heights that hide light, in distances of the lattice's points: as a rule, and of pads with sharp rims.
    pub cells: [f32; 2],
    /// No block is larger, mm.
    pub block_mm: f32,
    /// No block with a shadow's edge is divided further, mm.
    pub shadow_mm: f32,
    /// A block is divided when the light at its middle departs by more from what its corners' horizons give there, as part
    /// of the mean irradiance of the picture.
    pub shadow: f32,
    /// The field of a light is worked out at each pixel of a block where else it would be wrong by more, as part of the same.
    pub field: f32,
    /// A block is divided when its middle departs from its corners' mean by more, mm.
    pub curved_mm: f32,
    /// Whether bent horizons are followed finely, and strong light bounces again.
    pub fine: bool,
    /// Whether nodes follow from those around them where they may, and the bounce looks at half as many distances: of pads without
    /// sharp rims.
    pub sparse: bool,
    /// Whether flanks light their surroundings.
    pub bounce: bool,
    /// Whether nothing is skipped that a scene does not need: to measure what skipping saves.
    pub thorough: bool,
}

/// Pictures, and what tells of their error.
pub struct Pictures {
    /// One, or one a light.
    pub films: Vec<Film>,
    /// Their means over all pixels.
    pub means: Vec<Vec3>,
    /// Sum over pixels and channels of the squares of what the bounce changed; this and what follows as in [`traces`].
    pub bounced: Vec<f64>,
    /// Mean square of what walls gave back of the press, as a part of the mean light.
    pub echoed: Vec<f64>,
    /// Sum over pixels and channels of the squares of what the press changed in the light on fixed parts.
    pub glowed: Vec<f64>,
    /// The same of what is wrong at the feet of lamps.
    pub feet: Vec<f64>,
    /// Sum over pixels and channels of the variances of what mixed pixels are means of.
    pub spread: Vec<f64>,
    /// Rms over the face of |n - n0|^2, which tells how steep the press made it.
    pub steepness: f64,
    /// How differently the pad has moved beyond the picture's border, in the mean, mm.
    pub border_mm: f64,
    /// Lights beyond whose plane some of the pad is, and the part that is before it.
    pub sided: Vec<(usize, f64)>,
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
    /// Lights beyond whose plane some of the pad is: there their light ends.
    pub sided: Vec<usize>,
}

impl Frame<'_> {
    /// The pictures, one or one a light.
    pub fn render(mut self) -> Pictures {
        let camera = &self.once.view.camera;
        let (width, height, films) = (camera.width, camera.height, self.slots.films);
        let nodes = self.nodes();
        self.level = self.mean_level(&nodes);
        self.sided = self.sided(&nodes);
        let this = &self;
        let (cell_px, finer) = self.cell_px();
        let size = [width.div_ceil(cell_px), height.div_ceil(NODE_PX) * (NODE_PX / cell_px)];
        let in_row = size[0] * (NODE_PX / cell_px);
        // (Twice each: what is level enough to have normals of its own, and flanks that are narrower than a pixel.)
        let mut cells = vec![bounce::EMPTY; 2 * size[0] * size[1]];
        let mut light = dark(size[0] * size[1] * 2 * films);
        let traces = traces::count(films);
        let mut spreads = vec![0.0; traces * height.div_ceil(NODE_PX)];
        let mut splits = vec![Vec::new(); height.div_ceil(NODE_PX)];
        let mut parts_of_flanks = vec![Parts::default(); height.div_ceil(NODE_PX)];
        let mut all: Vec<Film> =
            (0..films).map(|_| Film { width, height, pixels: dark(width * height) }).collect();
        let mut rows: Vec<Vec<&mut [Vec3]>> = Vec::new();
        rows.resize_with(splits.len(), Vec::new);
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
                with_widest(Row {
                    frame: this,
                    nodes: &nodes,
                    row,
                    cell_px,
                    out,
                    cells,
                    light,
                    spread,
                    splits,
                    flanks,
                });
            });
        let mut lights = by_film(&light, in_row, 2 * films);
        let flanks = lights.split_off(films);
        let mut whole = Vec::with_capacity(size[0] * size[1]);
        let mut is_flank = Vec::with_capacity(size[0] * size[1]);
        for (row, both) in cells.chunks(2 * in_row).enumerate() {
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
        let cells = whole;
        let edge_mm = cell_px as f32 * self.once.pixel_mm;
        // (Rows beyond the picture's last are empty.)
        let shown = cells.iter().rposition(|cell| cell.count > 0.0).map_or(1, |k| k / size[0] + 1);
        let border = Border { size: [size[0], shown], cell_px, edge_mm, cells: &cells };
        let border_mm = border.uneven_mm(self.heights, |p| self.once.total.lift(p));
        let (mut bounced, mut echoed) = (vec![0.0; traces], vec![0.0; traces]);
        let mut glows: Vec<Vec<Vec3>> = Vec::new();
        if self.effort.bounce {
            let albedo = match self.albedo {
                Albedo::Constant(albedo) => *albedo,
                Albedo::Texture(texture) => texture.mean(),
            };
            // (Of large cells a part of the rows counts.)
            let most_count = (cell_px * cell_px) as f32 * if cell_px >= 4 { 0.25 } else { 1.0 };
            let (eye, echo) = (camera.origin, self.once.tables.echo.as_ref());
            let extent = self.heights.extent();
            let packing = self.packing(albedo, films);
            let tilts = Tilts::of(&parts_of_flanks, in_row, lights.len()).packed(packing);
            let packed_lights = packing.pack(&lights);
            let AllUnseen { cells: unseen, lights: unseen_lights } = self.unseen(&border, border_mm);
            let unseen_lights = packing.pack(&unseen_lights);
            let cells = Cells {
                size,
                rows: shown,
                edge_mm,
                sending: finer * bounce::SENDING,
                cells: &cells,
                flanks: &is_flank,
                tilts: &tilts,
                lights: &packed_lights,
                unseen: &unseen,
                unseen_lights: &unseen_lights,
                most_count,
                albedo,
                eye,
                extent,
                heights: self.heights,
                echo,
                lost: &packing.pack(&self.lost(lights.len())),
                packing,
                radiances: &self.once.radiances,
                again: self.effort.fine,
                closely: !self.effort.sparse,
            };
            let skylines = match lights.len() {
                1 => std::slice::from_ref(&self.once.skyline),
                _ => &self.once.tables.skylines[..],
            };
            let grounds = if lights.len() == 1 { &self.once.grounds[..1] } else { &self.once.grounds[1..] };
            let untouched = Untouched {
                sky: &|film: usize, p: Vec3| match packing {
                    Packing::Apart => skylines[film].at(p),
                    Packing::Grey(lamps) => {
                        let mut numbers = [0.0; skyline::NUMBERS];
                        for (c, of_lamp) in
                            skylines[..lamps].iter().skip(film * CHANNELS).take(CHANNELS).enumerate()
                        {
                            let of_lamp = of_lamp.at(p);
                            numbers[c..].iter_mut().zip(&of_lamp).step_by(3).for_each(|(n, of)| *n = *of);
                        }
                        numbers
                    }
                },
                // (Under the table it holds what it has at the untouched face.)
                ground: &|film: usize, p: Vec3| {
                    let of = |lamp: usize| Vec3::from(grounds[lamp].at(p.with_z(f32::MIN)));
                    match packing {
                        Packing::Apart => of(film),
                        Packing::Grey(_) => {
                            Vec3::from_array([0, 1, 2].map(|c| packing.number(film, c, |lamp| of(lamp).x)))
                        }
                    }
                },
                normal: &|p| self.once.total.rest_normal(p),
            };
            let changes = cells.changes(untouched);
            let pressed = Pressed {
                view: &self.once.view,
                heights: self.heights,
                level: self.once.level(),
                albedo,
                columns: size[0],
                cell_px,
                edge_mm,
                cells: cells.cells,
                lights: &lights,
                gains: &changes.gains,
                grounds,
                skylines,
                sources: &self.once.sources,
                radiances: &self.once.radiances,
            };
            glows = pressed.changes(&self.once.tables.glow);
            let lifts: Vec<f32> = cells.cells.iter().map(|c| c.position.z / c.count.max(1e-6)).collect();
            echoed = changes.echoed;
            let hidden = self.hidden();
            let (lifts, flanks, columns) = (&lifts[..], &is_flank[..], size[0]);
            let (splits, hidden) = (&splits[..], &hidden[..]);
            let of = |gains| Gains { gains, lifts, flanks, columns, cell_px, splits, hidden };
            let all_gains: Vec<Gains<'_>> = changes.gains.iter().map(|gains| of(&gains[..])).collect();
            let veil = |k: usize, x: usize, y: usize| self.once.veil(k, lights.len(), x, y);
            let height_mm = |x: usize, y: usize| self.height_mm(x, y);
            bounced = gains::apply(&all_gains, &mut all, &self.once.radiances, height_mm, veil);
        }
        let (once, count) = (self.once, all.len());
        let mut spread: Vec<f64> =
            (0..traces).map(|k| spreads.iter().skip(k).step_by(traces).sum()).collect();
        let covers = &once.tables.covers;
        let parts = covers.parts(|pixel| self.values(pixel % width, pixel / width));
        let lights = if count == 1 { std::slice::from_ref(&once.cover_total) } else { &covers.lights[..] };
        let veil = |k: usize, pixel: usize| once.veil(k, count, pixel % width, pixel / width);
        let laid = Laid { lights, parts: &parts, radiances: &once.radiances };
        covers.lay(&mut all, &laid, veil, &mut spread);
        let [glowed, feet] = self.add_glow(&mut all, &glows, &parts);
        Pictures {
            means: all.iter().map(Film::mean).collect(),
            films: all,
            bounced,
            echoed,
            steepness: steepness(&cells, |p| once.total.rest_normal(p)),
            border_mm,
            sided: self.sided.iter().map(|l| (*l, self.faced(&nodes, *l))).collect(),
            glowed,
            feet,
            spread,
        }
    }

    /// Adds what the press changes in the light on fixed parts, by picture and spot, to the pixels that show them. The sums over
    /// pixels and channels of the squares of what that is, and of what is wrong at the feet of lamps. `parts` are those of the
    /// covers.
    fn add_glow(&self, films: &mut [Film], glows: &[Vec<Vec3>], parts: &[[f32; 2]]) -> [Vec<f64>; 2] {
        let tables = &self.once.tables;
        let (columns, level) = (self.once.view.corners()[0], self.once.level());
        let radiances = &self.once.radiances;
        let [mut squares, mut feet] = [(); 2].map(|()| vec![0.0; traces::count(films.len())]);
        // Both are in the order of pixels.
        let mut covered = tables.covers.pixels.iter().zip(parts).peekable();
        for &[pixel, spot] in &tables.glow.pixels {
            while covered.next_if(|(k, _)| **k < pixel).is_some() {}
            let (at, spot) = (pixel as usize, spot as usize);
            let part = match covered.peek() {
                Some((k, [_, fixed])) if **k == pixel => *fixed,
                _ => {
                    let (x, y) = (at % (columns - 1), at / (columns - 1));
                    let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
                    0.25 * four.iter().filter(|(x, y)| self.corner(*x, *y).is_none()).count() as f32
                }
            };
            let foot = tables.glow.spots[spot].foot_error(level);
            traces::add_squares(&mut feet, films.iter().map(|film| film.pixels[at] * foot), radiances);
            let added = films.iter_mut().zip(glows).map(|(film, glow)| {
                let add = (glow[spot] * part).max(-film.pixels[at]);
                film.pixels[at] += add;
                add
            });
            traces::add_squares(&mut squares, added, radiances);
        }
        [squares, feet]
    }

    /// By picture: what groups of walls lose of the lights to the pad.
    fn lost(&self, films: usize) -> Vec<Vec<Vec3>> {
        let Some(echo) = &self.once.tables.echo else { return Vec::new() };
        let losses = wall_shadow::losses(echo, &self.once.sources, self.heights);
        if losses.is_empty() {
            return Vec::new();
        }
        if films > 1 {
            return losses
                .iter()
                .map(|of_light| of_light.iter().map(|loss| Vec3::splat(*loss)).collect())
                .collect();
        }
        let mut sum = vec![Vec3::ZERO; echo.groups];
        for (of_light, radiance) in losses.iter().zip(&self.once.radiances) {
            sum.iter_mut().zip(of_light).for_each(|(sum, loss)| *sum += *radiance * *loss);
        }
        vec![sum]
    }

    /// Which pictures the bounce takes together.
    fn packing(&self, albedo: Vec3, films: usize) -> Packing {
        let is_grey = self.slots.grey && self.once.is_skyline_grey && albedo == Vec3::splat(albedo.x);
        if films > 1 && is_grey { Packing::Grey(films) } else { Packing::Apart }
    }

    /// Pixels along the edge of a cell of the bounce, and by how many times that is finer than usual: between a sharp rim and
    /// the foot of its flank light goes to and fro within a few tenths of a millimetre, in a groove within less.
    fn cell_px(&self) -> (usize, usize) {
        let usual = cell_px(self.once.pixel_mm);
        let finer = match self.effort.fine && self.heights.has_sharp_rims() {
            true if self.heights.has_grooves()
                && usual as f32 * self.once.pixel_mm >= 4.0 * GROOVE_CELL_MM =>
            {
                4
            }
            true => 2,
            false => 1,
        };
        let finer = finer.min(usual);
        (usual / finer, finer)
    }

    /// By pixel: whether something fixed is before the pad at all its corners; empty where nothing fixed shows. (Of one that
    /// it covers in part the picture has at first what is the pad's.)
    fn hidden(&self) -> Vec<bool> {
        if self.once.tables.fixed.is_empty() {
            return Vec::new();
        }
        let [width, height] = self.once.view.corners().map(|n| n - 1);
        let hidden = |k: usize| {
            let (x, y) = (k % width, k / width);
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            four.iter().all(|(x, y)| self.corner(*x, *y).is_none()) && self.once.tables.covers.at(k).is_none()
        };
        (0..width * height).into_par_iter().with_min_len(4096).map(hidden).collect()
    }

    /// How high what the corners of a pixel see of the pad is in the mean, mm, over the level of the view.
    fn height_mm(&self, x: usize, y: usize) -> Option<f32> {
        let view = &self.once.view;
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        let heights = corners.iter().filter_map(|&(x, y)| {
            let value = self.seen[y * view.corners()[0] + x].value;
            (value > 1e-6).then(|| super::View::point(view.row(y)[x], value).z)
        });
        let (sum, n) = heights.fold((0.0, 0.0f32), |(s, n), z| (s + z, n + 1.0));
        (n > 0.0).then(|| sum / n)
    }

    /// What a light's irradiance counts for: the rms of its colours; alike for all where each has a picture of its own.
    #[inline(always)]
    pub fn strength(&self, l: usize) -> f32 {
        if self.slots.films > 1 { 1.0 } else { self.once.radiances[l].length() * RMS }
    }

    /// Mean irradiance at the nodes, as errors count: what a level pad gets.
    pub(super) fn mean_level(&self, nodes: &[f32]) -> f32 {
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

    /// The part of the nodes that are before a light.
    fn faced(&self, nodes: &[f32], l: usize) -> f64 {
        let seen = || nodes.chunks_exact(self.slots.stride()).filter(|n| !n[POSITION].is_nan());
        seen().filter(|n| n[self.slots.gain(l)] > 0.0).count() as f64 / seen().count().max(1) as f64
    }

    /// Lights that some nodes face and others do not.
    fn sided(&self, nodes: &[f32]) -> Vec<usize> {
        let seen = || nodes.chunks_exact(self.slots.stride()).filter(|n| !n[POSITION].is_nan());
        let faced = |l: usize| move |n: &[f32]| n[self.slots.gain(l)] > 0.0;
        (0..self.once.sources.len()).filter(|l| seen().any(faced(*l)) && !seen().all(faced(*l))).collect()
    }

    /// What a corner of a pixel sees of the pad, if nothing fixed is in front.
    #[inline(always)]
    pub fn corner(&self, x: usize, y: usize) -> Option<(Vec3, u32)> {
        let view = &self.once.view;
        let sample = self.seen[y * view.corners()[0] + x];
        let hidden = self.once.fixed(x, y).is_some_and(|value| value > sample.value);
        (sample.triangle != u32::MAX && !hidden)
            .then(|| (super::View::point(view.row(y)[x], sample.value), sample.triangle))
    }

    /// Normal of a triangle, towards the camera.
    #[inline(always)]
    pub fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = corners(triangle, self.nx).map(|k| self.mesh.positions[k]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        if n.dot(self.once.view.camera.origin - a) < 0.0 { -n } else { n }
    }

    /// Albedo at a point of a triangle.
    #[inline(always)]
    pub fn albedo_at(&self, triangle: u32, p: Vec3) -> Vec3 {
        match self.albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Texture(texture) => texture.sample(uv(self.mesh, self.nx, triangle, p)),
        }
    }

    /// Fills up to eight nodes at once.
    #[inline(always)]
    pub fn fill(&self, points: &[Vec3], out: &mut [f32]) {
        self.fill_on(points, |k| points[k].into(), out);
    }

    /// The same, where the pad hides lights as from the `stands` of these points.
    #[inline(always)]
    pub fn fill_on(&self, points: &[Vec3], stands: impl Fn(usize) -> Stand, out: &mut [f32]) {
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
                    None if source.faces(*p) => {
                        let corners = source.corners().map(|corners| corners.map(|c| c - *p));
                        let of_edges = Vec3::new(phi.x.0[i], phi.y.0[i], phi.z.0[i]);
                        corners.and_then(of_point).unwrap_or(of_edges)
                    }
                    None => Vec3::ZERO,
                };
                node[slots.direct(l)..][..3].copy_from_slice(&phi.to_array());
            }
        }
        let grids =
            if slots.films == 1 { std::slice::from_ref(&once.total) } else { &once.tables.probes[..] };
        let greys = once.greys.as_deref().filter(|_| slots.grey).unwrap_or_default();
        for (k, (p, node)) in points.iter().zip(out.chunks_exact_mut(stride)).enumerate() {
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
                self.horizons(l, stands(k), &lines, node);
                // Behind a light there is nothing to take off.
                node[slots.gain(l)] = f32::from(u8::from(source.faces(*p)));
                if slots.varying() {
                    let numbers = &mut node[slots.line(l, 0)..][..6 * LINES.div_ceil(KEPT)];
                    let kept = lines.iter().step_by(KEPT).flatten();
                    for (numbers, end) in numbers.chunks_exact_mut(3).zip(kept) {
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
    pub fn fill_between(&self, p: Vec3, parents: [&[f32]; 4], [u, v]: [f32; 2], node: &mut [f32]) {
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
                    with_means(|k| [end(k, 0), end(k, 1)])
                }
                false => source.seen(p, None),
            };
            self.horizons(l, p.into(), &lines, node);
        }
    }

    /// Fills a node with what the pad hides of lights at a point, and nothing else.
    pub fn fill_horizons(&self, from: Stand, node: &mut [f32]) {
        for (l, source) in self.once.sources.iter().enumerate() {
            self.horizons(l, from, &source.seen(from.point, self.once.view.slab.as_ref()), node);
        }
    }

    /// Fills a node's part on what the pad hides of a light, whose lines appear there.
    #[inline(always)]
    fn horizons(&self, l: usize, from: Stand, lines: &[Line; LINES], node: &mut [f32]) {
        let slots = &self.slots;
        let (mut hides, mut rises) = (false, false);
        let slopes = slots.horizons(l);
        let follow = |k: usize, hides: &mut bool, rises: &mut bool| {
            let sight = Toward::new(lines[k]);
            let horizon = sight.horizon(self.heights, from, slots.bent());
            *hides |= horizon > sight.from.min(sight.to);
            *rises |= horizon > sight.least();
            horizon
        };
        // A few lines first, the ones between where the pad is higher anywhere...
        for k in (0..LINES).step_by(COARSE) {
            node[slopes + k] = squeezed(follow(k, &mut hides, &mut rises));
        }
        let mut reach = COARSE / 2;
        let mut bends =
            rises || self.effort.thorough || (self.effort.fine && self.heights.rises_above(from.point.z));
        let mut flag = 0;
        while reach > 0 {
            let mut bent = false;
            for k in (reach..LINES).step_by(2 * reach) {
                let between = 0.5 * (node[slopes + k - reach] + node[slopes + k + reach]);
                node[slopes + k] = between;
                if bends {
                    let slope = follow(k, &mut hides, &mut rises);
                    node[slopes + k] = squeezed(slope);
                    bent |= (slope - slope_of(between)).abs() > BENT;
                }
            }
            flag += u8::from(bends);
            // ...or rises before one of these, and the finest only where the horizon bends.
            let wanted = bent || (reach == COARSE / 2 && rises);
            bends = wanted && self.effort.fine || self.effort.thorough;
            reach /= 2;
        }
        node[slots.light(l)] = if hides { f32::from(flag.max(1)) } else { 0.0 };
    }
}

/// Pixels along the edge of a cell of the bounce.
pub fn cell_px(pixel_mm: f32) -> usize {
    [8, 4, 2].into_iter().find(|n| *n as f32 * pixel_mm <= CELL_MM).unwrap_or(1)
}

/// Vector irradiance of a whole ribbon.
#[inline(always)]
fn outline(lines: &[Line; LINES]) -> Vec3 {
    const CORNERS: usize = 2 * LINES.div_ceil(KEPT);
    let mut around = [Vec3::ZERO; CORNERS];
    for (k, [low, high]) in lines.iter().step_by(KEPT).enumerate() {
        around[k] = *low;
        around[CORNERS - 1 - k] = *high;
    }
    irradiance(&around)
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
