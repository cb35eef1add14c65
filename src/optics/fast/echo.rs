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
use super::probes::{self, NUMBERS, TERMS};
use super::radiosity;
use super::source::Lamp;
use super::view::View;
use super::wall_shadow::Low;
use super::world::World;
use crate::optics::sampler::{Sampler, hash};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
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
/// Rays of a patch, by which it is known what else it lights.
const PATCH_RAYS: u32 = 64;
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

        let coarse = Layout { step_mm: STEP_MM, lift_mm: LIFT_MM, lift_step_mm: LIFT_MM[1], ..*layout };
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
                    world.follow(from, to, &mut dice).map_or(u32::MAX, |(met, _)| met.element as u32)
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
                    met.map_or(u32::MAX, |(met, _)| met.element as u32)
                };
                looks.iter().enumerate().map(look).collect()
            })
            .collect();

        // Groups of the patches that matter: those met, by place, side and reflectance.
        let edge = GROUP_MM.max(GROUP_PART * world.extent());
        let mut group_of: HashMap<u32, u16> = HashMap::new();
        let mut known: HashMap<([i32; 3], u32, [u32; 3]), u16> = HashMap::new();
        let mut members: Vec<Vec<u32>> = Vec::new();
        for &element in met.iter().chain(seen.iter().flatten()).filter(|&&e| e != u32::MAX) {
            if group_of.contains_key(&element) {
                continue;
            }
            let (point, normal) = world.point(element as usize, [0.3, 0.3]);
            let size = normal.abs();
            let axis = if size.z >= size.max_element() { 2 } else { u32::from(size.y > size.x) };
            let side = 2 * axis + u32::from(normal[axis as usize] < 0.0);
            let albedo = world.element(element as usize).0.to_array().map(f32::to_bits);
            let at = (point / edge).floor().as_ivec3().to_array();
            let group = *known.entry((at, side, albedo)).or_insert_with(|| {
                members.push(Vec::new());
                (members.len() - 1) as u16
            });
            group_of.insert(element, group);
            members[usize::from(group)].push(element);
        }
        let groups = members.len();
        if groups == 0 || groups >= usize::from(NOWHERE) {
            return None;
        }
        let mut low: Vec<(u32, u16)> = group_of.iter().map(|(element, group)| (*element, *group)).collect();
        low.sort_unstable();
        let low = low.into_par_iter().filter_map(|(element, group)| {
            let (point, _) = world.point(element as usize, [0.3, 0.3]);
            Low::of(world, lamps, element as usize, group, rest(point.truncate()))
        });
        let low = low.collect();
        let group = |element: &u32| group_of.get(element).copied().unwrap_or(NOWHERE);

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
        let passed: Vec<(Sparse, f32)> = members
            .par_iter()
            .map(|members| {
                let (mut parts, mut rays, mut area) = (vec![0.0f32; groups], 0, 0.0);
                for &element in members {
                    let met = radiosity::met_by(world, element as usize, PATCH_RAYS, &buried);
                    area += world.area(element as usize) * met.len() as f32 / PATCH_RAYS as f32;
                    rays += met.len();
                    for to in met.iter().map(|e| group(&radiosity::element_of(*e))) {
                        if to != NOWHERE {
                            parts[usize::from(to)] += 1.0;
                        }
                    }
                }
                parts.iter_mut().for_each(|part| *part /= rays.max(1) as f32);
                (present(&parts), area)
            })
            .collect();
        let (onward, areas) = passed.into_iter().unzip();
        let albedos = members.iter().map(|m| world.element(m[0] as usize).0).collect();
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
        Some(Self { size, ends, places, response, groups, colours: exchange.colours(), low })
    }

    /// The irradiance that comes back of what each cell sends in each direction (power, in units of mm^2), less what groups lose
    /// straight from the lights.
    pub fn answer(&self, sent: &[Vec3], lost: &[Vec3]) -> Grid<NUMBERS> {
        let mut power = vec![Vec3::ZERO; self.groups];
        power.iter_mut().zip(lost).for_each(|(power, lost)| *power = -*lost);
        for (sent, ends) in sent.iter().zip(self.ends.chunks_exact(RAYS)) {
            for end in ends.iter().filter(|end| **end != NOWHERE) {
                power[usize::from(*end)] += *sent * (1.0 / RAYS as f32);
            }
        }
        let powers: [Vec<f32>; 3] = std::array::from_fn(|c| power.iter().map(|p| p[c]).collect());
        let of_node = TERMS * self.colours * self.groups;
        let node = |response: &[f32]| -> [f32; NUMBERS] {
            std::array::from_fn(|k| {
                let row = k / 3 * self.colours + if self.colours == 1 { 0 } else { k % 3 };
                let row = &response[row * self.groups..][..self.groups];
                // Eight sums side by side.
                let mut sums = [0.0f32; 8];
                let (rows, powers) = (row.chunks_exact(8), powers[k % 3].chunks_exact(8));
                let rest: f32 = rows.remainder().iter().zip(powers.remainder()).map(|(a, b)| a * b).sum();
                for (row, power) in rows.zip(powers) {
                    for lane in 0..8 {
                        sums[lane] += row[lane] * power[lane];
                    }
                }
                sums.iter().sum::<f32>() + rest
            })
        };
        let values = self.response.par_chunks_exact(of_node).map(node).collect();
        Grid::from_values(self.places.clone(), values)
    }

    /// Whether the numbers belong together: as read from a file.
    pub fn fits(&self) -> bool {
        let cells = self.size[0] * self.size[1];
        self.ends.len() == cells * DIRECTIONS * RAYS
            && (self.colours == 1 || self.colours == 3)
            && self.response.len() == self.places.count() * TERMS * self.colours * self.groups
            && self.low.iter().all(|low| usize::from(low.group) < self.groups)
            && self.ends.iter().all(|end| *end == NOWHERE || usize::from(*end) < self.groups)
    }
}

/// Where a ray from above meets the untouched face.
fn on_face(start: Vec3, along: Vec3, rest: &impl Fn(Vec2) -> f32) -> Vec3 {
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
}
