//! What the pressed pad changes in the indirect light: flanks that light what is around them, and hide walls from it.
//!
//! The picture is cut into cells of about a quarter of a millimetre, smaller ones beside sharp rims, each with its mean height, normal
//! and irradiance. From each the pad's profile is followed in a few directions: where it rises above what was seen before, its
//! radiance takes the place of what the untouched sensor has there, up to the edge itself, which lies between cells. One bounce, from
//! the light that is there already, and where that changes much once or twice more; what follows is a small part of a small part.
//! (Horizon-based indirect lighting, Bavoil and Sainz 2008, on a coarse raster.)
//!
//! The same horizons tell what each cell sends towards the walls; what they give back is the [`echo`](super::echo). What the picture
//! does not show of the pad ([`Unseen`]) sends, too, and is seen by cells, but nobody asks what it gets.

mod elevation;
mod hidden;
mod row;
mod sender;
mod walk;

use super::echo::{self, Echo};
use super::grid::Grid;
use super::horizon::Heights;
use super::lanes::{Eight, Vectors, WIDTH, lanes, with_widest};
use super::packed::Packing;
use super::probes::{self, NUMBERS};
use super::skyline;
use super::tilt::Tilts;
use super::traces;
use glam::{Vec2, Vec3};
use hidden::Hidden;
use rayon::prelude::*;
use row::{Pass, Row};

/// Directions looked into.
const DIRECTIONS: usize = echo::AROUND;
/// A cell's light is changed by at most this factor, where next to none was.
const MOST: f32 = 3.0;

/// So much of the pad beside the picture is looked at, mm.
pub const BEYOND_MM: f32 = 2.0;

/// Cells of the picture along the edge of one that sends towards walls, where they are as large as they may be; as many as are
/// worked on at once.
pub const SENDING: usize = WIDTH;
/// Light that changes by more, rms, where it bounces, bounces a second time, and a third.
const STRONG: [f32; 2] = [0.01, 0.02];
/// Up a flank the light changes by at most this part of it per mm.
const STEEPEST: f32 = 1.0;
/// An echo below this part of the light is none. (Rounding and interpolation leave up to half of it where nothing is pressed.)
const SILENT: f32 = 3e-5;

/// Means over a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Position, or what adds up to it.
    pub position: Vec3,
    /// Normal, not of length 1: a sum over the area of the surface, not of the picture.
    pub normal: Vec3,
    /// Area of the surface, in pixels of a level one.
    pub area: f32,
    /// The area of the level under it, in the same: below 0 where it is seen from behind. Set by [`Cell::of`].
    pub level: f32,
    /// Pixels counted.
    pub count: f32,
}

impl Cell {
    /// Of what a cell shows on level ground and on upright flanks the larger, standing for both, and whether it is the flank.
    pub fn of(ground: &Cell, flank: &Cell) -> (Cell, bool) {
        let steep = flank.area > ground.area;
        let main = if steep { flank } else { ground };
        let (count, area) = (ground.count + flank.count, ground.area + flank.area);
        let position = main.position * (count / main.count.max(1e-6));
        let level = ground.normal.z + flank.normal.z;
        (Cell { position, normal: main.normal, area, level, count }, steep)
    }
}

/// Nothing counted.
pub const EMPTY: Cell = Cell { position: Vec3::ZERO, normal: Vec3::ZERO, area: 0.0, level: 0.0, count: 0.0 };

/// The picture's cells.
pub struct Cells<'a> {
    /// Cells along x and y.
    pub size: [usize; 2],
    /// The first of those rows, which show something.
    pub rows: usize,
    /// Edge of a cell on the pad, mm.
    pub edge_mm: f32,
    /// Cells along the edge of one that sends towards walls.
    pub sending: usize,
    /// Row by row, as sums.
    pub cells: &'a [Cell],
    /// Which of them stand for an upright flank.
    pub flanks: &'a [bool],
    /// How their light changes with height.
    pub tilts: &'a Tilts,
    /// Sums of the irradiance over the area of the surface, by picture.
    pub lights: &'a [Vec<Vec3>],
    /// Unseen parts, and the irradiance there, by picture.
    pub unseen: &'a [Unseen],
    pub unseen_lights: &'a [Vec<Vec3>],
    /// Pixels of a full cell.
    pub most_count: f32,
    /// Mean albedo of the pad.
    pub albedo: Vec3,
    /// Where the camera is.
    pub eye: Vec3,
    /// From where to where the pad goes.
    pub extent: [Vec2; 2],
    /// The pad as it is.
    pub heights: &'a Heights,
    /// What walls do, where they do anything.
    pub echo: Option<&'a Echo>,
    /// By picture: what groups of walls lose of the light, if anything.
    pub lost: &'a [Vec<Vec3>],
    /// How these pictures are those of lights.
    pub packing: Packing,
    /// What the scene has for the lights.
    pub radiances: &'a [Vec3],
    /// Whether strong light bounces again.
    pub again: bool,
    /// Whether all distances are looked at, or some.
    pub closely: bool,
}

/// The untouched sensor at a place. (Looked up behind pointers: each function that the large loops over cells were compiled for
/// would be a copy of them.)
#[derive(Clone, Copy)]
pub struct Untouched<'a> {
    /// Walls low over the face, in a picture.
    pub sky: &'a (dyn Fn(usize, Vec3) -> [f32; skyline::NUMBERS] + Sync),
    /// Irradiance of the face there, in a picture.
    pub ground: &'a (dyn Fn(usize, Vec3) -> Vec3 + Sync),
    /// The face's normal.
    pub normal: &'a (dyn Fn(Vec3) -> Vec3 + Sync),
}

/// What a press changes.
pub struct Changes {
    /// By picture: what the light of each cell is to be multiplied with.
    pub gains: Vec<Vec<Vec3>>,
    /// Mean square of what the echo alone changes, as a part of the mean light, as in [`traces`].
    pub echoed: Vec<f64>,
}

/// Means over cells, by row with room on both sides so that eight neighbours can be looked at from any column, and with the
/// pad's border beside the picture.
struct Means {
    stride: usize,
    /// Rows above the picture, and below it.
    beside: usize,
    /// Which cells beside the picture were taken from the mesh; empty where none was.
    from_mesh: Vec<bool>,
    /// Minus infinity where nothing is.
    heights: Vec<f32>,
    places: [Vec<f32>; 2],
    normals: [Vec<f32>; 3],
    /// As other cells see them: mixed with those of flanks that look away from the camera (from whichever side: of a ridge within one
    /// cell both flanks are). Empty where there are none.
    shown_normals: [Vec<f32>; 3],
    /// By picture and colour: irradiance before any bounce, and as others see it.
    own: Vec<[Vec<f32>; 3]>,
    lights: Vec<[Vec<f32>; 3]>,
    /// The same of the untouched face there.
    grounds: Vec<[Vec<f32>; 3]>,
    /// Areas of the cell and of the untouched face under it, mm^2, and the normal of that.
    areas: [Vec<f32>; 2],
    rest_normals: [Vec<f32>; 3],
    /// 1 where the cell stands for an upright flank. This and what follows is empty where there is none.
    upright: Vec<f32>,
    /// How far below its middle a flank is looked at as well, mm; 0 elsewhere.
    lower: Vec<f32>,
    /// By picture and colour: by how much its light changes with height, 1/mm, before any bounce and as others see it.
    own_tilts: Vec<[Vec<f32>; 3]>,
    tilts: Vec<[Vec<f32>; 3]>,
    highest: f32,
}

/// Cells beside the picture: as far as is looked, and what stands high there.
const MARGIN: usize = 108;

/// An unseen part of the pad: what is in a cell beside the picture, or what in one of the picture looks away from the camera.
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

/// Cells on either side of the picture that are known, of so wide ones.
pub fn beside(edge_mm: f32) -> usize {
    ((BEYOND_MM / edge_mm).ceil() as usize).min(MARGIN / 2)
}

/// The cell of a picture of some size that is nearest to one beside it.
pub fn nearest(size: [usize; 2], at: [isize; 2]) -> [usize; 2] {
    [0, 1].map(|d| at[d].clamp(0, size[d] as isize - 1) as usize)
}

impl Cells<'_> {
    /// What a cell at the border of the picture stands for, in cells: what is beyond is taken to be as it is.
    fn beyond(&self, at: [usize; 2], p: Vec3) -> f32 {
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

    fn means(&self, untouched: Untouched<'_>) -> Means {
        let Untouched { ground, normal: rest, .. } = untouched;
        let [nx, ny] = self.size;
        let stride = nx.next_multiple_of(WIDTH) + 2 * MARGIN;
        let beside = beside(self.edge_mm);
        let row = |value: f32| vec![value; stride * (ny + 2 * beside)];
        let of_flanks = || if self.tilts.lights.is_empty() { Vec::new() } else { row(0.0) };
        let mut means = Means {
            stride,
            beside,
            from_mesh: vec![false; if self.unseen.is_empty() { 0 } else { stride * (ny + 2 * beside) }],
            heights: row(f32::NEG_INFINITY),
            places: [row(0.0), row(0.0)],
            normals: [row(0.0), row(0.0), row(1.0)],
            shown_normals: [const { Vec::new() }; 3],
            own: self.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            lights: Vec::new(),
            grounds: self.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            areas: [row(0.0), row(0.0)],
            rest_normals: [row(0.0), row(0.0), row(1.0)],
            upright: of_flanks(),
            lower: of_flanks(),
            own_tilts: self.tilts.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            tilts: Vec::new(),
            highest: f32::NEG_INFINITY,
        };
        let known = self.known_beside();
        for (k, cell) in self.cells.iter().enumerate().filter(|(_, c)| c.count > 0.0) {
            let at = means.at(k % nx, k / nx);
            let (p, n) = (cell.position / cell.count, cell.normal.normalize_or(Vec3::Z));
            (means.places[0][at], means.places[1][at], means.heights[at]) = p.into();
            (means.normals[0][at], means.normals[1][at], means.normals[2][at]) = n.into();
            means.highest = means.highest.max(p.z);
            if self.flanks[k] && !self.tilts.lights.is_empty() {
                (means.upright[at], means.lower[at]) = (1.0, self.tilts.lower_mm[k]);
                for (out, tilt) in means.own_tilts.iter_mut().zip(&self.tilts.lights) {
                    (out[0][at], out[1][at], out[2][at]) = tilt[k].into();
                }
            }
            for (out, light) in means.own.iter_mut().zip(self.lights) {
                let light = light[k] / cell.area;
                (out[0][at], out[1][at], out[2][at]) = light.into();
            }
            for (film, out) in means.grounds.iter_mut().enumerate() {
                (out[0][at], out[1][at], out[2][at]) = ground(film, p).into();
            }
            if self.echo.is_none() {
                continue;
            }
            let normal = rest(p);
            let part = cell.count / (cell.count.max(self.most_count));
            let part = part * (self.beyond([k % nx, k / nx], p) - known[k]).max(1.0);
            let pixel = part * (self.edge_mm * (self.eye.z - p.z) / self.eye.z).powi(2) / cell.count;
            means.areas[0][at] = pixel * cell.area;
            means.areas[1][at] = pixel * cell.level / normal.z;
            let [x, y, z] = &mut means.rest_normals;
            (x[at], y[at], z[at]) = normal.into();
        }
        means.lights.clone_from(&means.own);
        means.tilts.clone_from(&means.own_tilts);
        if !self.unseen.is_empty() {
            means.shown_normals.clone_from(&means.normals);
        }
        for (k, cell) in self.unseen_in_picture() {
            let (at, part) = (means.at(cell.at[0] as usize, cell.at[1] as usize), self.unseen_part(cell));
            for (own, of_cell) in means.shown_normals.iter_mut().zip(cell.normal.to_array()) {
                own[at] += (of_cell - own[at]) * part;
            }
            self.show(&mut means, k);
        }
        self.put_beside(&mut means, ground);
        self.continue_beside(&mut means);
        means
    }

    fn in_picture(&self, unseen: &Unseen) -> bool {
        nearest([self.size[0], self.rows], unseen.at).map(|n| n as isize) == unseen.at
    }

    /// The unseen cells beside the picture.
    fn unseen_beside(&self) -> impl Iterator<Item = (usize, &Unseen)> {
        self.unseen.iter().enumerate().filter(|(_, unseen)| !self.in_picture(unseen))
    }

    /// The unseen parts of cells of the picture.
    fn unseen_in_picture(&self) -> impl Iterator<Item = (usize, &Unseen)> {
        self.unseen.iter().enumerate().filter(|(_, unseen)| self.in_picture(unseen))
    }

    /// By cell: how many beside the picture would go on as it is, were they not known.
    fn known_beside(&self) -> Vec<f32> {
        let mut known = vec![0.0; self.cells.len()];
        for (_, cell) in self.unseen_beside() {
            let [i, j] = nearest([self.size[0], self.rows], cell.at);
            known[j * self.size[0] + i] += 1.0;
        }
        known
    }

    /// Puts what is known of the pad beside the picture into its cells.
    fn put_beside(&self, means: &mut Means, ground: &dyn Fn(usize, Vec3) -> Vec3) {
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
    fn continue_beside(&self, means: &mut Means) {
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

    /// What others see of cells, once these see the pad as it is. Of all, or of upright flanks alone: half of what they have is
    /// from the pad at their foot, and where that is in their shadow next to nothing is left.
    fn relight(&self, means: &mut Means, gains: &[Vec3], of: impl Fn(usize) -> bool) {
        let ([nx, _], films, numbers) = (self.size, self.lights.len(), self.numbers());
        for k in (0..self.cells.len()).filter(|k| self.cells[*k].count > 0.0 && of(*k)) {
            let (i, j) = (k % nx, k / nx);
            let at = means.at(i, j);
            for (film, (own, seen)) in means.own.iter().zip(&mut means.lights).enumerate() {
                let gain = gains[(j * numbers + film) * nx + i];
                for (c, (own, seen)) in own.iter().zip(seen).enumerate() {
                    seen[at] = own[at] * gain[c];
                }
            }
            if !self.flanks[k] {
                continue;
            }
            for (film, (own, seen)) in means.own_tilts.iter().zip(&mut means.tilts).enumerate() {
                let more = gains[(j * numbers + films + film) * nx + i];
                for (c, (own, seen)) in own.iter().zip(seen).enumerate() {
                    // (By the middle of a flank nothing of its light may be gone.)
                    let most = means.lights[film][c][at] * STEEPEST;
                    seen[at] = (own[at] + more[c]).clamp(-most, most);
                }
            }
        }
        for (k, cell) in self.unseen_in_picture() {
            if of(cell.at[1] as usize * nx + cell.at[0] as usize) {
                self.show(means, k);
            }
        }
        self.continue_beside(means);
    }

    /// Part that something unseen has in the surface of its cell.
    fn unseen_part(&self, unseen: &Unseen) -> f32 {
        let cell = &self.cells[unseen.at[1] as usize * self.size[0] + unseen.at[0] as usize];
        let scale = self.edge_mm * (self.eye.z - unseen.position.z) / self.eye.z;
        let seen_mm2 = cell.area / cell.count.max(1e-6) * scale * scale;
        unseen.area_mm2 / (unseen.area_mm2 + seen_mm2)
    }

    /// Mixes the light on something unseen into what others see of its cell.
    fn show(&self, means: &mut Means, k: usize) {
        let cell = &self.unseen[k];
        let (at, part) = (means.at(cell.at[0] as usize, cell.at[1] as usize), self.unseen_part(cell));
        for (shown, light) in means.lights.iter_mut().zip(self.unseen_lights) {
            for (c, shown) in shown.iter_mut().enumerate() {
                shown[at] += (light[k][c] - shown[at]) * part;
            }
        }
    }

    /// Numbers a cell has in a pass, by picture: its gain, and where there are flanks by how much its light changes with height,
    /// 1/mm, beyond what it did before.
    fn numbers(&self) -> usize {
        self.lights.len() + self.tilts.lights.len()
    }

    /// How strong a bounce is: the rms of what it changes, as part of the mean light.
    fn strength(&self, means: &Means, gains: &[Vec3]) -> f32 {
        let ([nx, _], numbers) = (self.size, self.numbers());
        let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0f32);
        for k in (0..self.cells.len()).filter(|k| self.cells[*k].count > 0.0) {
            let (i, j) = (k % nx, k / nx);
            let at = means.at(i, j);
            for (film, own) in means.own.iter().enumerate() {
                let light = Vec3::new(own[0][at], own[1][at], own[2][at]);
                squares += (light * (gains[(j * numbers + film) * nx + i] - Vec3::ONE)).length_squared();
                sum += light.element_sum();
                count += 3.0;
            }
        }
        (squares * count).sqrt() / sum.max(1e-12)
    }

    /// What a press changes. What a cell sees is found once for all pictures.
    pub fn changes(&self, untouched: Untouched<'_>) -> Changes {
        let ([nx, _], films, numbers) = (self.size, self.lights.len(), self.numbers());
        let mut means = self.means(untouched);
        let mut gains = vec![Vec3::ONE; self.cells.len() * numbers];
        if self.flanks.contains(&true) {
            gains.par_chunks_mut(nx * numbers).enumerate().for_each(|(j, out)| {
                if self.flanks[j * nx..][..nx].contains(&true) {
                    let (cells, means, sky) = (self, &means, untouched.sky);
                    Row { cells, means, sky, j, out, pass: Pass::Flanks }.work();
                }
            });
            self.relight(&mut means, &gains, |k| self.flanks[k]);
        }
        // Rows that send together; by cell, picture and direction.
        let in_row = nx.div_ceil(self.sending) * films * echo::DIRECTIONS;
        let mut sent = vec![Vec3::ZERO; self.size[1].div_ceil(self.sending) * in_row];
        let bounce = |means: &Means, gains: &mut Vec<Vec3>, sent: &mut Vec<Vec3>| {
            gains.fill(Vec3::ONE);
            sent.fill(Vec3::ZERO);
            gains
                .par_chunks_mut(self.sending * nx * numbers)
                .zip(sent.par_chunks_mut(in_row))
                .enumerate()
                .for_each(|(k, (out, sent))| {
                    for (j, out) in out.chunks_mut(nx * numbers).enumerate() {
                        let (cells, sky, pass) = (self, untouched.sky, Pass::All { sent });
                        Row { cells, means, sky, j: self.sending * k + j, out, pass }.work();
                    }
                });
        };
        bounce(&means, &mut gains, &mut sent);
        for strong in STRONG {
            if !self.again || self.strength(&means, &gains) <= strong {
                break;
            }
            self.relight(&mut means, &gains, |_| true);
            bounce(&means, &mut gains, &mut sent);
        }
        let of_film =
            |film: usize| gains.chunks_exact(nx).skip(film).step_by(numbers).flatten().copied().collect();
        let mut gains: Vec<Vec<Vec3>> = (0..films).map(of_film).collect();
        let lights = match self.packing {
            Packing::Apart => films,
            Packing::Grey(lights) => lights,
        };
        let Some(echo) = self.echo else {
            return Changes { gains: self.packing.unpack(gains), echoed: vec![0.0; traces::count(lights)] };
        };
        self.send_unseen(untouched, &mut sent);
        let answers = echo.answers(&echo.reached(&sent, self.lost, films));
        let echoes = gains.par_iter_mut().zip(&answers).enumerate();
        let echoes = echoes.map(|(film, (gains, answer))| self.echo(&means, film, answer, gains));
        let (means, changes): (Vec<Vec3>, Vec<Vec<Vec3>>) = echoes.map(|e| (e.mean, e.changes)).unzip();
        let means = self.packing.unpack(means.into_iter().map(|mean| vec![mean]).collect());
        let echoes = means.into_iter().zip(self.packing.unpack(changes));
        let echoes: Vec<Echoed> = echoes.map(|(mean, changes)| Echoed { mean: mean[0], changes }).collect();
        let mut echoed: Vec<f64> = echoes.iter().map(Echoed::mean_square).collect();
        if lights > 1 {
            echoed.push(Echoed::sum(&echoes, self.radiances).mean_square());
        }
        Changes { gains: self.packing.unpack(gains), echoed }
    }

    /// Adds what is sent by what is not seen, as from the nearest cell of the picture.
    fn send_unseen(&self, untouched: Untouched<'_>, sent: &mut [Vec3]) {
        let films = self.lights.len();
        let of_cells = self.unseen.par_chunks(WIDTH).enumerate();
        let of_cells: Vec<hidden::Sent> = of_cells
            .map(|(chunk, unseen)| {
                with_widest(Hidden { cells: self, first: chunk * WIDTH, unseen, untouched })
            })
            .collect();
        let columns = self.size[0].div_ceil(self.sending);
        for (cell, of_films) in self.unseen.iter().zip(of_cells.iter().flat_map(|of| of.chunks_exact(films)))
        {
            let [i, j] = nearest([self.size[0], self.rows], cell.at).map(|n| n / self.sending);
            for (film, of_film) in of_films.iter().enumerate() {
                let to = &mut sent[((j * columns + i) * films + film) * echo::DIRECTIONS..];
                to.iter_mut().zip(of_film).for_each(|(to, more)| *to += *more);
            }
        }
    }

    /// Adds what walls give back to the gains of a picture.
    fn echo(&self, means: &Means, film: usize, answer: &Grid<NUMBERS>, gains: &mut [Vec3]) -> Echoed {
        let ([nx, _], [x, y, z]) = (self.size, &means.own[film]);
        let at = |k: usize| means.at(k % nx, k / nx);
        let seen = || (0..gains.len()).filter(|k| self.cells[*k].count > 0.0);
        let light = |k: usize| Vec3::new(x[at(k)], y[at(k)], z[at(k)]);
        let n = seen().count().max(1) as f32;
        let mean = (seen().map(light).sum::<Vec3>() / n).max(Vec3::splat(1e-12));
        let most = answer.parts().1.iter().flatten().fold(0.0f32, |most, v| most.max(v.abs()));
        if most < SILENT * mean.max_element() {
            return Echoed { mean, changes: Vec::new() };
        }
        let seen: Vec<usize> = seen().collect();
        let change = |k: &usize| {
            let i = at(*k);
            let p = Vec3::new(means.places[0][i], means.places[1][i], means.heights[i]);
            let normal = Vec3::new(means.normals[0][i], means.normals[1][i], means.normals[2][i]);
            probes::change(&answer.at(p), normal)
        };
        let changes: Vec<Vec3> = seen.par_iter().with_min_len(1024).map(change).collect();
        for (k, change) in seen.into_iter().zip(&changes) {
            let light = light(k);
            let bounded = change.clamp(-0.9 * light, light * (MOST - 1.0));
            gains[k] += bounded / light.max(Vec3::splat(1e-12));
        }
        Echoed { mean, changes }
    }
}

/// What walls gave back to the cells that see the pad; nothing where that is silent.
struct Echoed {
    /// Mean light before.
    mean: Vec3,
    changes: Vec<Vec3>,
}

impl Echoed {
    /// That of all lights together.
    fn sum(all: &[Self], radiances: &[Vec3]) -> Self {
        let longest = all.iter().map(|one| one.changes.len()).max().unwrap_or(0);
        let mut sum = Self { mean: Vec3::ZERO, changes: vec![Vec3::ZERO; longest] };
        for (one, radiance) in all.iter().zip(radiances) {
            sum.mean += one.mean * *radiance;
            sum.changes.iter_mut().zip(&one.changes).for_each(|(sum, change)| *sum += *change * *radiance);
        }
        sum
    }

    /// As a part of the mean light.
    fn mean_square(&self) -> f64 {
        let share = 1.0 / self.mean.max_element().max(1e-12);
        let squares: f64 = self.changes.iter().map(|c| f64::from((*c * share).length_squared())).sum();
        squares / self.changes.len().max(1) as f64
    }
}

impl Means {
    /// Where the numbers of a cell stand.
    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> usize {
        (j + self.beside) * self.stride + MARGIN + i
    }

    #[inline(always)]
    fn eight(numbers: &[f32], at: usize) -> Eight {
        let numbers = &numbers[at..at + WIDTH];
        Eight(lanes!(i => numbers[i]))
    }

    #[inline(always)]
    fn light([x, y, z]: &[Vec<f32>; 3], at: usize) -> Vectors {
        Vectors { x: Self::eight(x, at), y: Self::eight(y, at), z: Self::eight(z, at) }
    }
}

#[cfg(test)]
mod tests;
