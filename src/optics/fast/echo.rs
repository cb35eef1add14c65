//! What the walls give back of the light that a press takes from them or sends them.
//!
//! A pressed pad is lit otherwise and faces otherwise than the untouched one: its flanks throw light at one wall, its shadows
//! keep it from another. The difference, direction by direction, is worked out in every frame ([`super::bounce`] sends it from
//! coarse cells of the picture); where it goes, how walls pass it on, and what of it returns to the pad does not depend on
//! the press and is worked out once: rays from each cell, a small radiosity solution over groups of
//! patches, and its irradiance over place and normal. What stands between a flank and a wall is known by the flank's own
//! horizons; what returns is not hidden by the pad. Only for level faces: the normals of a curved one are not known well enough
//! here to tell a press from the face itself.

use super::exchange::{Exchange, Sparse};
use super::grid::{Grid, Layout, Places};
use super::grouping::{self, Grouping};
use super::lanes::{WIDTH, Work, with_widest};
use super::pad_image::PadImage;
use super::probes::{self, NUMBERS, TERMS};
use super::source::Lamp;
use super::view::View;
use super::wall_shadow::Low;
use super::world::World;
use crate::optics::sampler::{Sampler, hash};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Directions around in which cells send.
pub const AROUND: usize = 16;
/// Ranges of elevation from the level, and the slopes between them; the last is upright.
pub const RISES: usize = 4;
pub const SLOPES: [f32; RISES] = [0.0, 0.25, 0.7, 1.6];
/// Directions of a cell.
pub const DIRECTIONS: usize = AROUND * RISES;
/// Rays of a direction.
const RAYS: usize = 4;
/// Edge of a group of patches: at least this, and at least this part of the world.
const GROUP_MM: f32 = 1.25;
const GROUP_PART: f32 = 0.05;
/// Grid on which what returns is known.
const STEP_MM: f32 = 1.75;
const LIFT_MM: [f32; 2] = [0.0, 2.0];
/// In place of a group.
const NOWHERE: u16 = u16::MAX;

/// What is worked out once.
#[derive(Debug, Clone, PartialEq)]
pub struct Echo {
    /// Cells along x and y.
    pub size: [usize; 2],
    /// By cell, direction and ray: the group that it meets.
    pub(super) ends: Vec<u16>,
    /// Where the answer is known.
    pub(super) places: Places,
    /// By node, term, colour and group.
    pub(super) response: Vec<f32>,
    pub(super) groups: usize,
    /// One where nothing has a colour, else three.
    pub(super) colours: usize,
    /// Patches on which a pressed pad may throw its shadow.
    pub(super) low: Vec<Low>,
    /// What a plate mirrors of the pad.
    pub(super) image: PadImage,
}

impl Echo {
    /// For cells of a view, and lights. `events` is how often light may be scattered before it reaches the pad.
    pub fn new(
        world: &World,
        view: &View,
        lamps: &[Lamp],
        layout: &Layout,
        events: u32,
        rest: impl Fn(Vec2) -> f32 + Sync,
        buried: impl Fn(Vec3) -> bool + Sync,
    ) -> Option<Self> {
        let (cell_px, size) = super::sending_cells(view);
        let above = 1e-3 + 2.0 * world.offset;

        // (Under a plate the layout ends below it.)
        let lift_mm = [LIFT_MM[0], LIFT_MM[1].min(layout.lift_mm[1])];
        let coarse = Layout { step_mm: STEP_MM, lift_mm, lift_step_mm: lift_mm[1], ..*layout };
        let places = Places::new(&coarse, &rest);
        if events < 2 || places.is_curved() {
            return None;
        }

        // Where cells send to.
        let met: Vec<u32> = (0..size[0] * size[1])
            .into_par_iter()
            .flat_map_iter(|cell| {
                let corner = Vec2::new((cell % size[0]) as f32, (cell / size[0]) as f32);
                let sampler = Sampler::new(0xec40, cell as u32, 0, RAYS as u32);
                let rest = &rest;
                (0..DIRECTIONS * RAYS).map(move |k| {
                    let (direction, ray) = (k / RAYS, (k % RAYS) as u32);
                    let [u, v, a, b] = sampler.group(ray, direction as u32);
                    let [start, along] = view.ray((corner + Vec2::new(u, v)) * cell_px as f32);
                    let from = on_face(start, along, rest) + Vec3::Z * above;
                    let to = towards(direction, a, b);
                    let mut dice = hash(cell as u32, k as u32);
                    world.follow(from, to, &mut dice).map_or(u32::MAX, |met| met.element as u32)
                })
            })
            .collect();

        // Where the pad looks.
        let (looks, kernel) = probes::looks(places.is_curved());
        let seen: Vec<Vec<u32>> = (0..places.count())
            .into_par_iter()
            .map(|node| {
                let origin = places.point(node) + Vec3::Z * probes::clearance(places.is_curved());
                let look = |(k, direction): (usize, &Vec3)| {
                    let mut dice = hash(node as u32, k as u32);
                    let met = world.follow(origin, *direction, &mut dice);
                    met.map_or(u32::MAX, |met| met.element as u32)
                };
                looks.iter().enumerate().map(look).collect()
            })
            .collect();

        // What they meet in turn, taken together.
        let matter = met.iter().chain(seen.iter().flatten()).copied();
        let grouping = Grouping::new(world, matter, GROUP_MM.max(GROUP_PART * world.extent()), &buried);
        let groups = grouping.members.len();
        if groups == 0 || groups >= usize::from(NOWHERE) {
            return None;
        }
        let low = grouping.patches().into_par_iter().filter_map(|(element, group)| {
            let (point, _) = world.middle(element as usize);
            let low = Low::of(world, lamps, element as usize, group, rest(point.truncate()))?;
            Some(low.uncovered(grouping.open_part(element)))
        });
        let low = low.collect();
        let group = |element: &u32| grouping.of(*element).unwrap_or(NOWHERE);

        // How groups pass light on, and what places see of them. Of so many groups a place sees few, and each sends to few.
        let present = |row: &[f32]| -> Sparse {
            let mut found = Vec::new();
            for (k, value) in row.iter().enumerate() {
                if *value != 0.0 {
                    found.push((k as u32, *value));
                }
            }
            found
        };
        let passed: Vec<(Sparse, f32)> = grouping
            .members
            .par_iter()
            .map(|members| {
                let (mut parts, mut area) = (vec![0.0f32; groups], 0.0);
                for &element in members {
                    let met = grouping.met_by(element);
                    let of_ray = world.area(element as usize) / grouping::RAYS as f32;
                    area += of_ray * met.len() as f32;
                    for to in met.iter().map(group) {
                        if to != NOWHERE {
                            parts[usize::from(to)] += of_ray;
                        }
                    }
                }
                parts.iter_mut().for_each(|part| *part /= f32::max(area, 1e-20));
                (present(&parts), area)
            })
            .collect();
        let (onward, areas) = passed.into_iter().unzip();
        let albedos = grouping.members.iter().map(|m| world.element(m[0] as usize).0).collect();
        let rows: Vec<Sparse> = seen
            .par_iter()
            .flat_map_iter(|seen| {
                let mut gathered = vec![0.0f32; TERMS * groups];
                for (element, weights) in seen.iter().zip(&kernel) {
                    let to = usize::from(group(element));
                    if to != usize::from(NOWHERE) {
                        for term in 0..TERMS {
                            gathered[term * groups + to] += weights[term];
                        }
                    }
                }
                gathered.chunks_exact(groups).map(present).collect::<Vec<_>>()
            })
            .collect();
        let exchange = Exchange { onward, albedos, areas };
        let response = exchange.seen(&rows, events - 1);
        let ends = met.iter().map(group).collect();
        let image = PadImage::new(view, &places, (cell_px, size), events, &rest);
        Some(Self { size, ends, places, response, groups, colours: exchange.colours(), low, image })
    }

    /// What reaches each group: by picture what each cell sends in each direction (power, in units of mm^2; by cell, picture and
    /// direction), less what groups lose straight from the lights. Where rays end is read once for all pictures.
    pub fn reached(&self, sent: &[Vec3], lost: &[Vec<Vec3>], films: usize) -> Vec<Vec<Vec3>> {
        let mut power = vec![Vec3::ZERO; self.groups * films];
        for (film, lost) in lost.iter().enumerate() {
            power.iter_mut().skip(film).step_by(films).zip(lost).for_each(|(power, lost)| *power = -*lost);
        }
        let cells = sent.chunks_exact(films * DIRECTIONS).zip(self.ends.chunks_exact(DIRECTIONS * RAYS));
        for (sent, ends) in cells {
            for (direction, ends) in ends.chunks_exact(RAYS).enumerate() {
                for end in ends.iter().filter(|end| **end != NOWHERE) {
                    let power = &mut power[usize::from(*end) * films..][..films];
                    for (power, sent) in power.iter_mut().zip(sent[direction..].iter().step_by(DIRECTIONS)) {
                        *power += *sent * (1.0 / RAYS as f32);
                    }
                }
            }
        }
        (0..films).map(|film| power.iter().skip(film).step_by(films).copied().collect()).collect()
    }

    /// By picture: the irradiance that comes back of what has reached each group, and of what was `sent` by way of a plate. The response
    /// is read once for all pictures.
    pub fn answers(&self, reached: &[Vec<Vec3>], sent: &[Vec3]) -> Vec<Grid<NUMBERS>> {
        let films = reached.len();
        // (Of white lights all colours get the same.)
        let grey = self.colours == 1 && reached.iter().flatten().all(|p| p.x == p.y && p.x == p.z);
        let column = |film: usize, channel: usize| Column {
            number: film * NUMBERS + channel,
            power: reached[film].iter().map(|p| p[channel]).collect(),
        };
        let of_colour = |colour: usize| -> Vec<Column> {
            let channels = if grey || self.colours == 3 { colour..colour + 1 } else { 0..3 };
            (0..films)
                .flat_map(|film| channels.clone().map(move |channel| (film, channel)))
                .map(|(film, channel)| column(film, channel))
                .collect()
        };
        let columns: Vec<Vec<Column>> = (0..self.colours).map(of_colour).collect();
        let mut values = vec![[0.0; NUMBERS]; self.places.count() * films];
        let nodes = self.response.par_chunks_exact(TERMS * self.colours * self.groups);
        nodes.zip(values.par_chunks_exact_mut(films)).for_each(|(response, out)| {
            with_widest(Returned { response, groups: self.groups, columns: &columns, grey, out });
        });
        self.image.add(sent, films, &mut values);
        let of_film = |film: usize| values.iter().skip(film).step_by(films).copied().collect();
        (0..films).map(|film| Grid::from_values(self.places.clone(), of_film(film))).collect()
    }

    /// Whether the numbers belong together: as read from a file.
    pub fn fits(&self) -> bool {
        let cells = self.size[0] * self.size[1];
        self.ends.len() == cells * DIRECTIONS * RAYS
            && (self.colours == 1 || self.colours == 3)
            && self.response.len() == self.places.count() * TERMS * self.colours * self.groups
            && self.image.fits(self.places.count(), cells)
            && self.low.iter().all(|low| usize::from(low.group) < self.groups)
            && self.ends.iter().all(|end| *end == NOWHERE || usize::from(*end) < self.groups)
    }
}

/// What has reached the groups in one colour of one picture.
struct Column {
    /// Where what comes back of it stands among the numbers of a node, picture by picture.
    number: usize,
    power: Vec<f32>,
}

/// What comes back at a node: its `response` times what has reached each group.
struct Returned<'a> {
    response: &'a [f32],
    groups: usize,
    /// By colour of the response.
    columns: &'a [Vec<Column>],
    /// Whether the first colour stands for all.
    grey: bool,
    /// By picture.
    out: &'a mut [[f32; NUMBERS]],
}

impl Work for Returned<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { response, groups, columns: of_colours, grey, out } = self;
        let numbers = out.as_flattened_mut();
        for term in 0..TERMS {
            for (colour, columns) in of_colours.iter().enumerate() {
                let row = &response[(term * of_colours.len() + colour) * groups..][..groups];
                for some in columns.chunks(ABREAST) {
                    let powers = std::array::from_fn(|k| &some[k.min(some.len() - 1)].power[..]);
                    let sums = products(row, powers);
                    some.iter().zip(sums).for_each(|(column, sum)| numbers[column.number + 3 * term] = sum);
                }
            }
        }
        if grey {
            numbers.chunks_exact_mut(3).for_each(|colours| colours.fill(colours[0]));
        }
    }
}

/// Products that are summed up side by side, so that none waits for its own last sum.
const ABREAST: usize = 4;

/// Scalar products of a row with others.
#[inline(always)]
fn products(row: &[f32], others: [&[f32]; ABREAST]) -> [f32; ABREAST] {
    let others = others.map(|other| &other[..row.len()]);
    let mut sums = [[0.0f32; WIDTH]; ABREAST];
    let whole = row.len() / WIDTH * WIDTH;
    for k in (0..whole).step_by(WIDTH) {
        let row = &row[k..k + WIDTH];
        for (sums, other) in sums.iter_mut().zip(others) {
            let other = &other[k..k + WIDTH];
            for lane in 0..WIDTH {
                sums[lane] += row[lane] * other[lane];
            }
        }
    }
    let mut out = [0.0; ABREAST];
    for (out, (sums, other)) in out.iter_mut().zip(sums.iter().zip(others)) {
        let rest: f32 = row[whole..].iter().zip(&other[whole..]).map(|(a, b)| a * b).sum();
        *out = sums.iter().sum::<f32>() + rest;
    }
    out
}

/// Where a ray from above meets the untouched face.
pub fn on_face(start: Vec3, along: Vec3, rest: &impl Fn(Vec2) -> f32) -> Vec3 {
    let mut z = 0.0;
    let mut p = start;
    for _ in 0..4 {
        p = start + along * ((z - start.z) / along.z);
        z = rest(p.truncate());
    }
    p.with_z(z)
}

/// A direction of a range, spread as an even face sends.
pub fn towards(direction: usize, a: f32, b: f32) -> Vec3 {
    let phi = ((direction / RISES) as f32 + a) * (TAU / AROUND as f32);
    let sine2 = |k: usize| match SLOPES.get(k) {
        Some(slope) => {
            let slope = slope.max(0.0);
            slope * slope / (1.0 + slope * slope)
        }
        None => 1.0,
    };
    let rise = direction % RISES;
    let (low, high) = (sine2(rise), sine2(rise + 1));
    let sine = (low + (high - low) * b).sqrt().clamp(0.02, 1.0);
    let level = (1.0 - sine * sine).max(0.0).sqrt();
    Vec3::new(level * phi.cos(), level * phi.sin(), sine)
}

/// The direction and range that a unit vector upwards is in: where [`towards`] has it.
pub fn range_of(v: Vec3) -> usize {
    let around = v.truncate().to_angle().rem_euclid(TAU) * (AROUND as f32 / TAU);
    let slope = v.z / v.truncate().length().max(1e-12);
    let rise = SLOPES.iter().rposition(|from| slope >= *from).unwrap_or(0);
    (around as usize).min(AROUND - 1) * RISES + rise
}

/// Part of what a level face sends into one range of one direction.
pub fn level_part(rise: usize) -> f32 {
    let sine2 = |k: usize| SLOPES.get(k).map_or(1.0, |s| s.max(0.0).powi(2) / (1.0 + s.max(0.0).powi(2)));
    (sine2(rise + 1) - sine2(rise)) / AROUND as f32
}

/// Power that an area of radiosity 1 sends, from the integral over elevations ([`super::bounce`]'s weight).
pub const PER_WEIGHT: f32 = TAU / AROUND as f32 / PI;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_is_in_the_range_that_it_was_drawn_from() {
        for direction in 0..DIRECTIONS {
            for (a, b) in [(0.01, 0.02), (0.5, 0.5), (0.99, 0.98), (0.3, 0.7)] {
                assert_eq!(range_of(towards(direction, a, b)), direction);
            }
        }
    }

    #[test]
    fn a_level_face_sends_all_it_has() {
        let sum: f32 = (0..RISES).map(level_part).sum::<f32>() * AROUND as f32;
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
        for direction in 0..DIRECTIONS {
            for (a, b) in [(0.1, 0.2), (0.9, 0.9)] {
                let to = towards(direction, a, b);
                assert!((to.length() - 1.0).abs() < 1e-4 && to.z > 0.0, "{to}");
            }
        }
    }

    #[test]
    fn what_comes_back_of_several_pictures_is_that_of_each() {
        let layout = Layout {
            across: [Vec2::splat(-1.0), Vec2::splat(1.0)],
            step_mm: 1.0,
            lift_mm: LIFT_MM,
            lift_step_mm: LIFT_MM[1],
        };
        let places = Places::new(&layout, |_| 0.0);
        let number = |k: usize| ((k * 37) % 101) as f32 / 50.0 - 1.0;
        // (More groups than go by eight.)
        let groups = 2 * WIDTH + 3;
        for (colours, grey, films) in
            [(1, true, 1), (1, true, 3), (1, false, 1), (1, false, 5), (3, true, 6), (3, false, 2)]
        {
            let response: Vec<f32> = (0..places.count() * TERMS * colours * groups).map(number).collect();
            let (ends, low, image, places) = (Vec::new(), Vec::new(), PadImage::default(), places.clone());
            let echo = Echo { size: [0; 2], ends, places, response, groups, colours, low, image };
            let power =
                |k: usize| Vec3::from_array([0, 1, 2].map(|c| number(k + if grey { 0 } else { 1000 * c })));
            let reached: Vec<Vec<Vec3>> =
                (0..films).map(|film| (0..groups).map(|group| power(7 * film + group)).collect()).collect();
            let answers = echo.answers(&reached, &[]);
            assert_eq!(answers.len(), films);
            for (answer, power) in answers.iter().zip(&reached) {
                for (node, numbers) in answer.parts().1.iter().enumerate() {
                    for (k, number) in numbers.iter().enumerate() {
                        let row = (node * TERMS + k / 3) * colours + if colours == 1 { 0 } else { k % 3 };
                        let row = &echo.response[row * groups..][..groups];
                        let truth: f32 = row.iter().zip(power).map(|(a, p)| a * p[k % 3]).sum();
                        assert!((number - truth).abs() < 1e-4, "{number} {truth}");
                    }
                }
            }
        }
    }
}
