//! What the pressed pad changes in the indirect light: flanks that light what is around them, and hide walls from it.
//!
//! The picture is cut into cells of about a quarter of a millimetre, each with its mean height, normal and irradiance. From
//! each the pad's profile is followed in a few directions: where it rises above what was seen before, its radiance takes
//! the place of what the untouched sensor has there, up to the edge itself, which lies between cells. One bounce, from the
//! light that is there already; what follows is a small part of a small part. (Horizon-based indirect lighting, Bavoil and
//! Sainz 2008, on a coarse raster.)
//!
//! The same horizons tell what each cell sends towards the walls; what they give back is the [`echo`](super::echo).

use super::echo::{self, Echo, PER_WEIGHT, RISES, SLOPES};
use super::grid::Grid;
use super::horizon::Heights;
use super::lanes::{Eight, Mask, Vectors, WIDTH, Work, lanes, with_widest};
use super::lookout::Lookout;
use super::probes::{self, NUMBERS};
use super::skyline;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Directions looked into.
const DIRECTIONS: usize = echo::AROUND;
/// Distances looked at, in cells.
const DISTANCES: [f32; 25] = [
    1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.5, 16.0, 17.5, 19.0, 21.0, 23.0,
    25.0, 28.0, 31.0, 35.0, 39.0, 44.0,
];
/// Ground this even, up to the farthest distance, needs no look: a slope.
const EVEN: f32 = 4e-3;
/// Cells that see nothing of the pad are taken to be this high, mm.
const NOWHERE: f32 = -1e4;
/// Cells are no nearer to each other than this, in their edges.
const NEAREST: f32 = 0.3;
/// What rises on by this slope above the line of sight has an edge, which is looked for.
const EDGED: f32 = 0.3;
/// A cell's light is changed by at most this factor, where next to none was.
const MOST: f32 = 3.0;

/// So much of the pad beside the picture is taken to be as its border, mm.
const BEYOND_MM: f32 = 2.0;

/// Cells of the picture along the edge of one that sends towards walls; as many as are worked on at once.
pub const SENDING: usize = WIDTH;
/// An echo below this part of the light is none.
const SILENT: f32 = 1e-5;

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
    /// Edge of a cell on the pad, mm.
    pub edge_mm: f32,
    /// Row by row, as sums.
    pub cells: &'a [Cell],
    /// Sums of the irradiance over the area of the surface, by picture.
    pub lights: &'a [Vec<Vec3>],
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
}

/// The untouched sensor's light, in a picture at a place.
pub struct Untouched {
    /// Walls low over the face.
    pub sky: [f32; skyline::NUMBERS],
    /// Irradiance of the face there.
    pub ground: Vec3,
}

/// What a press changes.
pub struct Changes {
    /// By picture: what the light of each cell is to be multiplied with.
    pub gains: Vec<Vec<Vec3>>,
    /// Sum over cells, pictures and colours of the squares of what the echo alone changes, as parts of the mean light.
    pub echoed: f64,
}

/// Means over cells, by row with room on both sides so that eight neighbours can be looked at from any column.
struct Means {
    stride: usize,
    /// Minus infinity where nothing is.
    heights: Vec<f32>,
    places: [Vec<f32>; 2],
    normals: [Vec<f32>; 3],
    /// By picture and colour: irradiance.
    lights: Vec<[Vec<f32>; 3]>,
    /// The same of the untouched face there.
    grounds: Vec<[Vec<f32>; 3]>,
    /// Areas of the cell and of the untouched face under it, mm^2, and the normal of that.
    areas: [Vec<f32>; 2],
    rest_normals: [Vec<f32>; 3],
    highest: f32,
}

/// Cells beside the picture: as far as is looked, and what stands high there.
const MARGIN: usize = 56;

impl Cells<'_> {
    /// What a cell at the border of the picture stands for, in cells: what is beyond is taken to be as it is.
    fn beyond(&self, at: [usize; 2], p: Vec3) -> f32 {
        let [low, high] = self.extent;
        // In the picture y runs downwards.
        let sides = [[p.x - low.x, high.x - p.x], [high.y - p.y, p.y - low.y]];
        (0..2).fold(1.0, |cells, axis| {
            let beyond = |side: f32| (side / self.edge_mm - 0.5).clamp(0.0, BEYOND_MM / self.edge_mm);
            let first = if at[axis] == 0 { beyond(sides[axis][0]) } else { 0.0 };
            let last = if at[axis] + 1 == self.size[axis] { beyond(sides[axis][1]) } else { 0.0 };
            cells * (1.0 + first + last)
        })
    }

    fn means(&self, untouched: &impl Fn(usize, Vec3) -> Untouched, rest: &impl Fn(Vec3) -> Vec3) -> Means {
        let [nx, ny] = self.size;
        let stride = nx.next_multiple_of(WIDTH) + 2 * MARGIN;
        let row = |value: f32| vec![value; stride * ny];
        let mut means = Means {
            stride,
            heights: row(f32::NEG_INFINITY),
            places: [row(0.0), row(0.0)],
            normals: [row(0.0), row(0.0), row(1.0)],
            lights: self.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            grounds: self.lights.iter().map(|_| [row(0.0), row(0.0), row(0.0)]).collect(),
            areas: [row(0.0), row(0.0)],
            rest_normals: [row(0.0), row(0.0), row(1.0)],
            highest: f32::NEG_INFINITY,
        };
        for (k, cell) in self.cells.iter().enumerate().filter(|(_, c)| c.count > 0.0) {
            let at = k / nx * stride + MARGIN + k % nx;
            let (p, n) = (cell.position / cell.count, cell.normal.normalize_or(Vec3::Z));
            (means.places[0][at], means.places[1][at], means.heights[at]) = p.into();
            (means.normals[0][at], means.normals[1][at], means.normals[2][at]) = n.into();
            means.highest = means.highest.max(p.z);
            for (out, light) in means.lights.iter_mut().zip(self.lights) {
                let light = light[k] / cell.area;
                (out[0][at], out[1][at], out[2][at]) = light.into();
            }
            for (film, out) in means.grounds.iter_mut().enumerate() {
                (out[0][at], out[1][at], out[2][at]) = untouched(film, p).ground.into();
            }
            if self.echo.is_none() {
                continue;
            }
            let normal = rest(p);
            let part = cell.count / (cell.count.max(self.most_count));
            let part = part * self.beyond([k % nx, k / nx], p);
            let pixel = part * (self.edge_mm * (self.eye.z - p.z) / self.eye.z).powi(2) / cell.count;
            means.areas[0][at] = pixel * cell.area;
            means.areas[1][at] = pixel * cell.level / normal.z;
            let [x, y, z] = &mut means.rest_normals;
            (x[at], y[at], z[at]) = normal.into();
        }
        means
    }

    /// What a press changes. `untouched` gives the light of the untouched sensor in a picture at a place, `rest` the normal of its face.
    /// What a cell sees is found once for all pictures.
    pub fn changes(
        &self,
        untouched: impl Fn(usize, Vec3) -> Untouched + Sync,
        rest: impl Fn(Vec3) -> Vec3 + Sync,
    ) -> Changes {
        let ([nx, _], films) = (self.size, self.lights.len());
        let means = self.means(&untouched, &rest);
        let mut gains = vec![Vec3::ONE; self.cells.len() * films];
        // Rows that send together; by cell, picture and direction.
        let in_row = nx.div_ceil(SENDING) * films * echo::DIRECTIONS;
        let mut sent = vec![Vec3::ZERO; self.size[1].div_ceil(SENDING) * in_row];
        gains.par_chunks_mut(SENDING * nx * films).zip(sent.par_chunks_mut(in_row)).enumerate().for_each(
            |(k, (out, sent))| {
                for (j, out) in out.chunks_mut(nx * films).enumerate() {
                    let (cells, means, untouched) = (self, &means, &untouched);
                    with_widest(Row { cells, means, untouched, j: SENDING * k + j, out, sent });
                }
            },
        );
        let of_film =
            |film: usize| gains.chunks_exact(nx).skip(film).step_by(films).flatten().copied().collect();
        let mut gains: Vec<Vec<Vec3>> = (0..films).map(of_film).collect();
        let mut echoed = 0.0;
        if let Some(echo) = self.echo {
            for (film, gains) in gains.iter_mut().enumerate() {
                let of_film = |of: &[Vec3]| of[film * echo::DIRECTIONS..][..echo::DIRECTIONS].to_vec();
                let sent: Vec<Vec3> = sent.chunks_exact(films * echo::DIRECTIONS).flat_map(of_film).collect();
                echoed += self.echo(&means, film, &echo.answer(&sent), gains);
            }
        }
        Changes { gains, echoed }
    }

    /// Adds what walls give back to the gains of a picture; the mean square of what it is.
    fn echo(&self, means: &Means, film: usize, answer: &Grid<NUMBERS>, gains: &mut [Vec3]) -> f64 {
        let ([nx, _], [x, y, z]) = (self.size, &means.lights[film]);
        let at = |k: usize| k / nx * means.stride + MARGIN + k % nx;
        let seen = || (0..gains.len()).filter(|k| self.cells[*k].count > 0.0);
        let light = |k: usize| Vec3::new(x[at(k)], y[at(k)], z[at(k)]);
        let n = seen().count().max(1) as f32;
        let mean = (seen().map(light).sum::<Vec3>() / n).max(Vec3::splat(1e-12));
        let most = answer.parts().1.iter().flatten().fold(0.0f32, |most, v| most.max(v.abs()));
        if most < SILENT * mean.max_element() {
            return 0.0;
        }
        let mut squares = 0.0;
        let seen: Vec<usize> = seen().collect();
        for k in seen {
            let i = at(k);
            let p = Vec3::new(means.places[0][i], means.places[1][i], means.heights[i]);
            let normal = Vec3::new(means.normals[0][i], means.normals[1][i], means.normals[2][i]);
            let (change, light) = (probes::change(&answer.at(p), normal), light(k));
            squares += f64::from((change / mean.max_element()).length_squared());
            let bounded = change.clamp(-0.9 * light, light * (MOST - 1.0));
            gains[k] += bounded / light.max(Vec3::splat(1e-12));
        }
        squares / f64::from(n)
    }
}

impl Means {
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

/// A row of cells.
struct Row<'a, S> {
    cells: &'a Cells<'a>,
    means: &'a Means,
    untouched: &'a S,
    j: usize,
    out: &'a mut [Vec3],
    sent: &'a mut [Vec3],
}

impl<S: Fn(usize, Vec3) -> Untouched> Work for Row<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let nx = self.cells.size[0];
        let films = self.means.lights.len();
        let mut sums = vec![Vectors::all(Vec3::ZERO); films];
        let mut skies: Vec<[Eight; skyline::NUMBERS]> = Vec::new();
        for i in (0..nx).step_by(WIDTH) {
            let lanes = WIDTH.min(nx - i);
            let at = self.j * self.means.stride + MARGIN + i;
            let even = EVEN * self.cells.edge_mm;
            let level = |k: usize| {
                let z = self.means.heights[k];
                z == f32::NEG_INFINITY
                    || (self.means.normals[2][k] > 1.0 - 1e-5 && self.means.highest - z < even)
            };
            if (at..at + lanes).all(level) {
                self.send_level(at, i);
                continue;
            }
            sums.fill(Vectors::all(Vec3::ZERO));
            skies.clear();
            let horizons = self.look(at, lanes, &mut sums, &mut skies);
            for (film, sum) in sums.iter().enumerate() {
                for k in 0..lanes {
                    if level(at + k) {
                        continue;
                    }
                    let change = Vec3::new(sum.x.0[k], sum.y.0[k], sum.z.0[k]) * (TAU / DIRECTIONS as f32);
                    let [x, y, z] = &self.means.lights[film];
                    let e = Vec3::new(x[at + k], y[at + k], z[at + k]);
                    let most = e * (MOST - 1.0);
                    self.out[film * nx + i + k] =
                        Vec3::ONE + change.clamp(-0.9 * e, most) / e.max(Vec3::splat(1e-12));
                }
            }
            self.send(at, i, lanes, &horizons);
        }
    }
}

/// By direction: the slope below which the pad is seen, and the weight of what is.
type Horizons = [[Eight; 2]; DIRECTIONS];

impl<S: Fn(usize, Vec3) -> Untouched> Row<'_, S> {
    /// Follows the profile from eight cells into all directions; what rises above what was seen before takes the place of
    /// sky or ground.
    #[inline(always)]
    fn look(
        &mut self,
        at: usize,
        lanes: usize,
        sums: &mut [Vectors],
        skies: &mut Vec<[Eight; skyline::NUMBERS]>,
    ) -> Horizons {
        let mut horizons = [[Eight::all(0.0); 2]; DIRECTIONS];
        let means = self.means;
        let (zero, even, least) = (Eight::all(0.0), Eight::all(EVEN), Eight::all(1e-3));
        let z = Means::eight(&means.heights, at);
        let [x, y] = [0, 1].map(|c| Means::eight(&means.places[c], at));
        let nearest = Eight::all(NEAREST * self.cells.edge_mm);
        let [nx, ny, nz] = [0, 1, 2].map(|c| Means::eight(&means.normals[c], at));
        // Slopes of the cell's own plane along x and y.
        let flat = Eight::all(1e-3).below(nz);
        let [plane_x, plane_y] = [nx, ny].map(|n| flat.choose((-n).over(nz), zero));
        let reflected = self.cells.albedo * FRAC_1_PI;
        let farthest = DISTANCES[DISTANCES.len() - 1] * self.cells.edge_mm;
        // By picture: what was seen last, and the untouched ground there.
        let mut tops = vec![[Vectors::all(Vec3::ZERO); 2]; sums.len()];
        let middle = (0..lanes).min_by_key(|k| (!z.0[*k].is_finite(), k.abs_diff(lanes / 2))).unwrap_or(0);
        let stands = Vec3::new(x.0[middle], y.0[middle], z.0[middle].max(NOWHERE));
        let lookout = Lookout::new(stands, self.cells.eye.z, self.cells.edge_mm);
        for (direction, horizon) in horizons.iter_mut().enumerate() {
            let ahead = ahead(direction);
            let along = nx * Eight::all(ahead.x) + ny * Eight::all(ahead.y);
            // Elevations as slopes. Below the surface's own plane nothing arrives.
            let upright = Eight::all(1e-3).below(nz);
            let mut before = upright.choose((-along).over(nz), Eight::all(f32::NEG_INFINITY));
            let mut below = upright
                .choose(weight(before, along, nz), (nz - along * Eight::all(FRAC_PI_2)) * Eight::all(0.5));
            // Where the step before showed something, what shows next lies between the two; first of all the cell itself.
            let mut shown: Option<(usize, Mask)> = Some((at, zero.below(Eight::all(1.0))));
            let mut turned = zero;
            let mut steep = zero;
            let back = self.neighbour(lookout.cells_to(ahead * self.cells.edge_mm, stands.z)).unwrap_or(0);
            let mut height = stands.z;
            for distance in DISTANCES {
                let ahead_mm = ahead * (distance * self.cells.edge_mm);
                // How high it is there is known when it is found: the second look is at the right place.
                let Some(first) = self.neighbour(lookout.cells_to(ahead_mm, height)) else { break };
                let there = means.heights[(at + middle).wrapping_add_signed(first)];
                let second = lookout.tells((there - height).abs()).then(|| {
                    height = there;
                    self.neighbour(lookout.cells_to(ahead_mm, there))
                });
                let k = at.wrapping_add_signed(second.flatten().unwrap_or(first));
                // (The picture moves what is high: places tell how far away it is.)
                let (dx, dy) = (Means::eight(&means.places[0], k) - x, Means::eight(&means.places[1], k) - y);
                let away = (dx * dx + dy * dy).sqrt().max(nearest);
                // What is looked at lies a little aside of the direction: there the cell's own plane has another slope.
                let plane =
                    plane_x * (Eight::all(ahead.x) * away - dx) + plane_y * (Eight::all(ahead.y) * away - dy);
                let dz = (Means::eight(&means.heights, k) - z).max(Eight::all(NOWHERE));
                let rise = (dz + plane).over(away);
                let risen = (before + even).below(rise);
                if !risen.any() {
                    shown = None;
                    continue;
                }
                let now = weight(rise, along, nz);
                let [of_sky, of_ground] = shares([before, below], [rise, now], risen);
                if skies.is_empty() {
                    self.gather(at, lanes, skies);
                }
                let middle = (before.max(zero) + rise) * Eight::all(0.5);
                // How much is seen of a step on what is there, and on what was there before: by how much its slope is above
                // the line of sight.
                let normal = |c: usize| Means::eight(&means.normals[c], k);
                let toward =
                    -(normal(0) * dx + normal(1) * dy + normal(2) * dz).over(away * normal(2).max(least));
                let hides = toward.below(least);
                if shown.is_some_and(|(nearer, _)| nearer == at) {
                    // Of the cell itself half is in that where both planes meet halfway, and nothing where they meet at an end.
                    let own = (nx * dx + ny * dy + nz * dz).over(away * nz.max(least)).max(least);
                    let halfway = (toward * own * Eight::all(2.0)).over((toward + own) * (toward + own));
                    let beside = toward * halfway.over(Eight::all(1.0) - halfway);
                    turned = hides.choose(Eight::all(1.0), beside.max(least));
                }
                let step =
                    k.checked_add_signed(-back).filter(|s| s + WIDTH <= means.heights.len()).unwrap_or(k);
                let toward = toward.max(least);
                for (film, sum) in sums.iter_mut().enumerate() {
                    let environment = skyline::radiance(&skies[film], direction, middle);
                    let scaled = |light: Vectors| Vectors {
                        x: light.x * Eight::all(reflected.x),
                        y: light.y * Eight::all(reflected.y),
                        z: light.z * Eight::all(reflected.z),
                    };
                    let mut light = Means::light(&means.lights[film], k);
                    if hides.any() {
                        // The top of a step is not seen, but what rises to it.
                        light = hides.pick(Means::light(&means.lights[film], step), light);
                    }
                    if let Some((nearer, of)) = shown {
                        let (near, far) = (&means.lights[film], Means::light(&means.lights[film], k));
                        let sum = Means::light(near, nearer).scaled(turned) + far.scaled(toward);
                        light = of.pick(sum.scaled(Eight::all(1.0).over(turned + toward)), light);
                    }
                    let radiance = scaled(light);
                    let ground = scaled(Means::light(&means.grounds[film], k));
                    *sum = *sum
                        + (radiance - environment).scaled(of_sky)
                        + (radiance - ground).scaled(of_ground);
                    tops[film] = [risen.pick(radiance, tops[film][0]), risen.pick(ground, tops[film][1])];
                }
                (shown, turned) = (Some((k, risen)), toward);
                steep = risen.choose(hides.choose(steep, toward), steep);
                before = risen.choose(rise, before);
                below = risen.choose(now, below);
            }
            let rose = Eight::all(EDGED).below(steep);
            if rose.any() {
                // What was seen last goes on to its edge, which lies between the middles of cells.
                let mut top = before;
                for lane in (0..lanes).filter(|lane| rose.lane(*lane)) {
                    let p = Vec3::new(x.0[lane], y.0[lane], z.0[lane]);
                    top.0[lane] =
                        self.cells.heights.horizon(p, ahead, farthest, before.0[lane], f32::INFINITY);
                }
                let now = weight(top, along, nz);
                let [of_sky, of_ground] = shares([before, below], [top, now], rose);
                let middle = (before.max(zero) + top) * Eight::all(0.5);
                for (film, sum) in sums.iter_mut().enumerate() {
                    let environment = skyline::radiance(&skies[film], direction, middle);
                    let [radiance, ground] = tops[film];
                    *sum = *sum
                        + (radiance - environment).scaled(of_sky)
                        + (radiance - ground).scaled(of_ground);
                }
                (before, below) = (top, now);
            }
            *horizon = [before, below];
        }
        horizons
    }

    /// By how much the index of a cell of this row differs from that of another, unless that is beyond the picture.
    #[inline(always)]
    fn neighbour(&self, (aside, down): (isize, isize)) -> Option<isize> {
        let row = self.j.checked_add_signed(down).filter(|row| *row < self.cells.size[1]);
        row.map(|_| aside.clamp(-(MARGIN as isize), MARGIN as isize) + down * self.means.stride as isize)
    }

    /// Eight level cells in the open: more or less light than before goes everywhere as from an even face.
    #[inline(always)]
    fn send_level(&mut self, at: usize, i: usize) {
        let (means, films) = (self.means, self.means.lights.len());
        if self.cells.echo.is_none() {
            return;
        }
        let [area, rest_area] = [0, 1].map(|k| Means::eight(&means.areas[k], at));
        for film in 0..films {
            let (now, before) =
                (Means::light(&means.lights[film], at), Means::light(&means.grounds[film], at));
            let more = (now.scaled(area) - before.scaled(rest_area)).sums() * self.cells.albedo;
            let to = &mut self.sent[(i / SENDING * films + film) * echo::DIRECTIONS..][..echo::DIRECTIONS];
            for (k, to) in to.iter_mut().enumerate() {
                *to += more * echo::level_part(k % RISES);
            }
        }
    }

    /// What eight cells send into each direction above their horizons, less what the untouched face sent.
    #[inline(always)]
    fn send(&mut self, at: usize, i: usize, lanes: usize, horizons: &Horizons) {
        let (means, films, nx) = (self.means, self.means.lights.len(), self.cells.size[0]);
        if self.cells.echo.is_none() {
            return;
        }
        let (zero, steepest) = (Eight::all(0.0), Eight::all(1e4));
        let [area, rest_area] = [0, 1].map(|k| Means::eight(&means.areas[k], at) * Eight::all(PER_WEIGHT));
        let [nx_, ny_, nz_] = [0, 1, 2].map(|c| Means::eight(&means.normals[c], at));
        let [rx, ry, rz] = [0, 1, 2].map(|c| Means::eight(&means.rest_normals[c], at));
        // Parts of what is sent, by direction: now and before.
        let mut parts = [[zero; 2]; echo::DIRECTIONS];
        for (direction, [slope, below]) in horizons.iter().enumerate() {
            let ahead = ahead(direction);
            let along = nx_ * Eight::all(ahead.x) + ny_ * Eight::all(ahead.y);
            let rest_along = rx * Eight::all(ahead.x) + ry * Eight::all(ahead.y);
            let plane = (-rest_along).over(rz);
            let rest_below = weight(plane, rest_along, rz);
            // What leaves from high up meets a wall where steeper light from the level would; what meets none is the pad's.
            let lift = self.lift(at, ahead);
            let from = |k: usize, lift: Eight, along: Eight, up: Eight, horizon: Eight, below: Eight| {
                let edge = SLOPES.get(k).map_or(steepest, |s| Eight::all(*s)) - lift;
                horizon.below(edge).choose(weight(edge, along, up), below)
            };
            let of_both = |k: usize| {
                [from(k, lift, along, nz_, *slope, *below), from(k, zero, rest_along, rz, plane, rest_below)]
            };
            let mut low = of_both(0);
            for rise in 0..RISES {
                let high = of_both(rise + 1);
                parts[direction * RISES + rise] = [(high[0] - low[0]) * area, (high[1] - low[1]) * rest_area];
                low = high;
            }
        }
        for film in 0..films {
            let mut now = Means::light(&means.lights[film], at);
            for k in 0..lanes {
                let gain = self.out[film * nx + i + k];
                (now.x.0[k], now.y.0[k], now.z.0[k]) =
                    (now.x.0[k] * gain.x, now.y.0[k] * gain.y, now.z.0[k] * gain.z);
            }
            let before = Means::light(&means.grounds[film], at);
            let to = &mut self.sent[(i / SENDING * films + film) * echo::DIRECTIONS..][..echo::DIRECTIONS];
            for (to, [part, rest]) in to.iter_mut().zip(&parts) {
                *to += (now.scaled(*part) - before.scaled(*rest)).sums() * self.cells.albedo;
            }
        }
    }

    /// By how much the slope from the level to where a wall stands differs from that from each of eight cells, if it stands
    /// at the rim of the pad.
    #[inline(always)]
    fn lift(&self, at: usize, ahead: Vec2) -> Eight {
        let [low, high] = self.cells.extent;
        let away = |c: usize| {
            let place = Means::eight(&self.means.places[c], at);
            let wall = Eight::all(if ahead[c] > 0.0 { high[c] } else { low[c] });
            (wall - place) * Eight::all(1.0 / ahead[c])
        };
        let far = away(0).min(away(1)).max(Eight::all(self.cells.edge_mm));
        Means::eight(&self.means.heights, at).max(Eight::all(0.0)).over(far)
    }

    /// The untouched sensor's walls at eight cells, by picture.
    #[inline(never)]
    fn gather(&self, at: usize, lanes: usize, skies: &mut Vec<[Eight; skyline::NUMBERS]>) {
        for film in 0..self.means.lights.len() {
            let mut numbers = [Eight::all(0.0); skyline::NUMBERS];
            for lane in 0..lanes {
                let k = at + lane;
                if self.means.heights[k] == f32::NEG_INFINITY {
                    continue;
                }
                let p = Vec3::new(self.means.places[0][k], self.means.places[1][k], self.means.heights[k]);
                for (out, number) in numbers.iter_mut().zip((self.untouched)(film, p).sky) {
                    out.0[lane] = number;
                }
            }
            skies.push(numbers);
        }
    }
}

/// A direction looked into.
#[inline(always)]
fn ahead(direction: usize) -> Vec2 {
    Vec2::from_angle((direction as f32 + 0.5) * (TAU / DIRECTIONS as f32))
}

/// What rises from one slope and its weight to another hides of what is above the level, and of what is below.
#[inline(always)]
fn shares([before, below]: [Eight; 2], [rise, now]: [Eight; 2], risen: Mask) -> [Eight; 2] {
    let zero = Eight::all(0.0);
    let positive = zero.below(rise);
    let of_sky = positive.choose(now - zero.below(before).choose(below, zero), zero);
    let of_ground = before.below(zero).choose(positive.choose(zero, now) - below, zero);
    [risen.choose(of_sky, zero), risen.choose(of_ground, zero)]
}

/// Integral of cos(tilt) cos(elevation) up to elevations of these slopes, for normals with the part `along` ahead and
/// `up` upwards; 0 at slope 0.
#[inline(always)]
fn weight(slope: Eight, along: Eight, up: Eight) -> Eight {
    let cos2 = Eight::all(1.0).over(Eight::all(1.0) + slope * slope);
    (along * (slope.atan() + slope * cos2) + up * slope * slope * cos2) * Eight::all(0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White cells seen from high above.
    fn white<'a>(
        size: [usize; 2],
        edge_mm: f32,
        cells: &'a [Cell],
        lights: &'a [Vec<Vec3>],
        heights: &'a Heights,
        extent: [Vec2; 2],
    ) -> Cells<'a> {
        let (eye, albedo) = (Vec3::new(0.0, 0.0, 20.0), Vec3::ONE);
        Cells { size, edge_mm, cells, lights, most_count: 1.0, albedo, eye, extent, heights, echo: None }
    }

    /// A pad of these heights.
    fn heights(extent: [Vec2; 2], z: impl Fn(Vec2) -> f32) -> Heights {
        let n = 401;
        let share = |k: usize| Vec2::new((k % n) as f32, (k / n) as f32) / (n - 1) as f32;
        let at = |k: usize| extent[0] + (extent[1] - extent[0]) * share(k);
        let positions: Vec<Vec3> = (0..n * n).map(|k| at(k).extend(z(at(k)))).collect();
        Heights::new(&positions, [n, n], 0.05)
    }

    #[test]
    fn a_narrow_flank_stands_for_a_cell_of_which_it_is_the_larger_part() {
        let flat = Cell {
            position: Vec3::new(3.0, 0.0, 0.0),
            normal: Vec3::Z * 3.0,
            area: 3.0,
            level: 3.0,
            count: 3.0,
        };
        let flank = Cell {
            position: Vec3::new(1.0, 0.0, 0.5),
            normal: Vec3::X * 18.0,
            area: 18.0,
            level: 0.0,
            count: 1.0,
        };
        let (cell, steep) = Cell::of(&flat, &flank);
        assert!(steep && cell.area == 21.0 && cell.level == 3.0 && cell.normal.normalize() == Vec3::X);
        // Four pixels are counted, and lie where the flank does.
        assert_eq!(cell.position / cell.count, Vec3::new(1.0, 0.0, 0.5));
        let (cell, steep) = Cell::of(&flat, &EMPTY);
        assert!(!steep && cell == flat);
    }

    /// A wall of height 1 along x = `edge_x`, up to which the eye sees a floor and beyond which a plateau.
    fn step(edge_x: f32) -> ([usize; 2], f32, Vec<Cell>) {
        let (nx, ny, edge) = (81, 81, 0.25);
        let at = |k: usize| (Vec2::new((k % nx) as f32, (ny - 1 - k / nx) as f32) - 40.0) * edge;
        // What is seen at a place of the level is nearer to the middle where it is high.
        let cell = |k: usize| {
            let (floor, plateau) = (at(k), at(k) * (1.0 - 1.0 / 20.0));
            let flat = |p: Vec3| Cell { position: p, normal: Vec3::Z, area: 1.0, level: 1.0, count: 1.0 };
            if (floor.x - 0.5 * edge..floor.x + 0.5 * edge).contains(&edge_x) {
                let position = Vec3::new(edge_x, floor.y, 0.5);
                return Cell { position, normal: -Vec3::X, area: 1.0 / edge, level: 1.0, count: 1.0 };
            }
            if floor.x < edge_x { flat(floor.extend(0.0)) } else { flat(plateau.extend(1.0)) }
        };
        ([nx, ny], edge, (0..nx * ny).map(cell).collect())
    }

    /// The floor sees the wall under a known form factor, in the middle of the picture and towards its border, where what
    /// is high is seen elsewhere than it stands.
    #[test]
    fn a_step_lights_its_foot_by_its_form_factor() {
        for edge_x in [0.06, 5.06] {
            let ([nx, ny], edge, cells) = step(edge_x);
            let extent = [Vec2::splat(-10.125), Vec2::splat(10.125)];
            let pad = heights(extent, |p| f32::from(u8::from(p.x > edge_x)));
            let foot = cells.iter().position(|c| c.position.z > 0.0).unwrap();
            // The wall shines as does what is behind it; the sky is dark, as is the ground in the eyes of the wall.
            let light: Vec<Vec3> =
                cells.iter().map(|c| Vec3::splat(if c.position.z > 0.0 { c.area } else { 1e-3 })).collect();
            let lights = [light.clone(), light.iter().map(|l| *l * 2.0).collect()];
            let all = white([nx, ny], edge, &cells, &lights, &pad, extent);
            let dark = |_, _| Untouched { sky: [0.0; skyline::NUMBERS], ground: Vec3::ZERO };
            let rest = |_| Vec3::Z;
            let gains = all.changes(dark, rest).gains;
            // (The change is told as part of the light that is there, which is bounded: brighter ground is changed less.)
            let bright = [cells.iter().map(|c| Vec3::splat(c.area)).collect()];
            let of_bright = Cells { lights: &bright, ..all }.changes(dark, rest).gains;
            // An endless wall of height h at distance d fills (1 - cos(atan(h/d)))/2 of the floor's view.
            for i in [foot - 20, foot - 12, foot - 5, foot - 3, foot - 2, foot - 1] {
                let k = 40 * nx + i;
                let d = edge_x - cells[k].position.x;
                let truth: f32 = 0.5 * (1.0 - d / d.hypot(1.0));
                let gain = of_bright[0][k].x;
                assert!(((gain - 1.0) / truth - 1.0).abs() < 0.1, "{edge_x} {d}: {gain} {truth}");
            }
            let k = 40 * nx + foot;
            assert!(gains[0][k - 1].x > 2.9, "what was dark is bounded");
            assert_eq!(gains[0][k + 15], Vec3::ONE, "from the plateau nothing higher is seen");
            // Twice the light is twice the change.
            for (a, b) in gains[0].iter().zip(&gains[1]) {
                assert!((*a - *b).abs().max_element() < 1e-5, "{a} {b}");
            }
        }
    }

    /// A face that is even, however it leans, sees nothing of itself.
    #[test]
    fn a_leaning_plane_sees_nothing_of_itself() {
        let (nx, ny, edge) = (41, 33, 0.25);
        let up = Vec3::new(-0.9, 0.4, 1.0);
        let cells: Vec<Cell> = (0..nx * ny)
            .map(|k| {
                let (x, y) = ((k % nx) as f32 * edge, (k / nx) as f32 * -edge);
                let position = Vec3::new(x, y, 0.9 * x - 0.4 * y);
                Cell { position, normal: up, area: up.length(), level: 1.0, count: 1.0 }
            })
            .collect();
        let lights = [vec![Vec3::ONE; nx * ny]];
        let extent = [Vec2::new(0.0, -8.0), Vec2::new(10.0, 0.0)];
        let pad = heights(extent, |p| 0.9 * p.x - 0.4 * p.y);
        let all = white([nx, ny], edge, &cells, &lights, &pad, extent);
        let dark = |_, _| Untouched { sky: [0.0; skyline::NUMBERS], ground: Vec3::ZERO };
        for gain in &all.changes(dark, |_| Vec3::Z).gains[0] {
            assert!((*gain - Vec3::ONE).abs().max_element() < 1e-3, "{gain}");
        }
    }

    /// What the border stands for and what is in the picture make up the pad.
    #[test]
    fn the_border_stands_for_what_is_beyond_it() {
        let (size, edge) = ([20, 10], 0.25);
        let extent = [Vec2::new(-3.0, -2.0), Vec2::new(3.5, 1.5)];
        let (cells, lights) = (Vec::new(), Vec::new());
        let pad = heights(extent, |_| 0.0);
        let all = white(size, edge, &cells, &lights, &pad, extent);
        let mut sum = 0.0;
        for (i, j) in (0..size[0]).flat_map(|i| (0..size[1]).map(move |j| (i, j))) {
            let p = Vec3::new((i as f32 + 0.5) * edge - 2.5, 1.25 - (j as f32 + 0.5) * edge, 0.0);
            sum += all.beyond([i, j], p) * edge * edge;
        }
        assert!((sum - 6.5 * 3.5).abs() < 1e-3, "{sum}");
    }
}
