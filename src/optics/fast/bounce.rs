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

mod echoed;
mod elevation;
mod hidden;
mod margin;
mod means;
mod row;
mod sender;
mod walk;

use super::echo::{self, Echo};
use super::horizon::Heights;
use super::lanes::WIDTH;
use super::packed::Packing;
use super::skyline;
use super::tilt::Tilts;
use super::traces;
use echoed::Echoed;
use glam::{Vec2, Vec3};
use means::Means;
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
    /// What of their light leaves them, as a part of what would if they were even; empty where all of it does.
    pub kept: &'a [Vec3],
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

/// Cells beside the picture: as far as is looked, and what stands high there.
const MARGIN: usize = 108;

/// An unseen part of the pad: what is in a cell beside the picture, or what in one of the picture looks away from the camera.
#[derive(Debug, Clone, Copy)]
pub struct Unseen {
    /// Which cell that is, counted from the picture's first.
    pub at: [isize; 2],
    /// Where its middle would be seen, in cells.
    pub place: Vec2,
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
        let answers = echo.answers(&echo.reached(&sent, self.lost, films), &sent);
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
}

#[cfg(test)]
mod tests;
