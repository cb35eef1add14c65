//! The light that walls and pad send out, solved once for the untouched sensor.
//!
//! Elements are the sides of the world's patches. Each gathers over cosine-distributed rays, so that what stands in
//! between is accounted for; the rows of elements met are kept and the bounces are then a sparse product. Events are
//! counted: a limit cuts the series here as it does in the reference, where every face of a plate is an event, too.

use super::byway::Byways;
use super::plate::Slab;
use super::source::Lamp;
use super::world::World;
use crate::optics::sampler::{Sampler, hash};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Rays of an element without and with clear bodies, at which chance splits them; their errors average out over the many
/// elements that a probe sees (with four times the rays a picture changes by 0.02 % of its mean and 0.25 %).
const RAYS: [u32; 2] = [64, 256];
/// Points at which an element's direct light is taken.
const POINTS: u32 = 16;
/// So many of them that nothing covers are enough (of a patch of a wall a strip may be left beside a lamp); else up to so many rounds of
/// them are tried.
const LEAST_POINTS: u32 = 8;
const MOST_ROUNDS: u32 = 8;
/// Faces of a plate on a way between two elements that are counted; more are met by one ray in a hundred, but by a fifth of those from a
/// wall in the plate, to and fro in the glass.
const MOST_FACES: usize = 4;

/// What each element sends out, for each light of radiance 1. Lights and their colours stand side by side, four at a time.
#[derive(Debug, Clone)]
pub struct Radiosity {
    /// How many lights.
    pub lights: usize,
    /// Numbers of a light: one where nothing has a colour, else three.
    colours: usize,
    /// Vectors of an element.
    pub vectors: usize,
    /// By faces on the way to the pad and element: radiance of the diffuse reflection, the light's own emission excepted.
    radiance: Vec<Vec<Vec4>>,
    /// By element: what a plate mirrors to the camera, as a second event; empty without one.
    mirrored: Vec<Vec4>,
    /// What of it the camera sees is scattered once more than what lights the pad; without what came straight from the lights.
    shown: Vec<Vec4>,
}

impl Radiosity {
    /// For paths of at most so many `events`, counted from the camera.
    ///
    /// `buried` tells which points lie under the untouched face: patches of walls that reach below a curved one count
    /// only their part above, which is what the camera's side sees of them. What a plate, if there is one, mirrors of lamps and
    /// lets through is direct light, too.
    pub fn new(
        world: &World,
        lamps: &[Lamp],
        slab: Option<Slab>,
        events: u32,
        buried: impl Fn(Vec3) -> bool + Sync,
    ) -> Self {
        let (n, lights) = (2 * world.patches, lamps.len());
        let albedos: Vec<Vec3> = (0..n).map(|k| world.element(k).0).collect();
        let colours = if albedos.iter().all(|a| a.x == a.y && a.y == a.z) { 1 } else { 3 };
        let vectors = (lights * colours).div_ceil(4);
        let straight = Straight::new(world, lamps, slab, &buried);
        let rows: Vec<[Vec<u32>; MOST_FACES + 1]> =
            (0..n).into_par_iter().map(|k| row(world, k, &buried)).collect();
        // By element, for all its numbers.
        let mut reflectances = vec![Vec4::ZERO; n * vectors];
        for (k, albedo) in albedos.iter().enumerate() {
            for number in 0..lights * colours {
                reflectances[k * vectors + number / 4][number % 4] = albedo[number % colours];
            }
        }
        // What comes straight from the lights, where so many faces of the plate may still be met.
        let most_faces = |faces: usize| if slab.is_some() { faces } else { 0 };
        let by_faces: Vec<Vec<Vec4>> = (0..=most_faces(STRAIGHT_FACES))
            .map(|faces| {
                let mut sent = reflectances.clone();
                for (k, sent) in sent.chunks_exact_mut(vectors).enumerate() {
                    for number in 0..lights * colours {
                        let irradiance = straight.within(k, number / colours, faces);
                        sent[number / 4][number % 4] *= irradiance * FRAC_1_PI;
                    }
                }
                sent
            })
            .collect();
        let nothing = vec![Vec4::ZERO; n * vectors];
        // What elements send on of what others send that are the next event, or later by the faces in between.
        let scattered = |later: &VecDeque<Vec<Vec4>>| {
            let mut sums = nothing.clone();
            sums.par_chunks_mut(vectors).zip(&rows).enumerate().for_each(|(k, (sums, row))| {
                let reflectances = &reflectances[k * vectors..][..vectors];
                let rays: usize = row.iter().map(Vec::len).sum();
                let share = 1.0 / rays.max(1) as f32;
                for (v, sum) in sums.iter_mut().enumerate() {
                    let mut arrived = Vec4::ZERO;
                    for (met, before) in row.iter().zip(later) {
                        for &met in met {
                            if met != NOTHING {
                                arrived += before[met as usize * vectors + v];
                            }
                        }
                    }
                    *sum = arrived * reflectances[v] * share;
                }
            });
            sums
        };
        // From the last event back to that which follows the pad's. (Through a plate the pad is the third.)
        let of_pad = if slab.is_some() { 3 } else { 1 };
        let mut sent: VecDeque<Vec<Vec4>> = vec![nothing.clone(); most_faces(MOST_FACES) + 1].into();
        let step_back = |sent: &mut VecDeque<Vec<Vec4>>, event: u32| {
            let mut radiance = scattered(sent);
            let left = (events.saturating_sub(event) as usize).min(by_faces.len() - 1);
            radiance.iter_mut().zip(&by_faces[left]).for_each(|(sum, straight)| *sum += *straight);
            sent.pop_back();
            sent.push_front(radiance);
        };
        (of_pad + 1..=events).rev().for_each(|event| step_back(&mut sent, event));
        let radiance = sent.iter().cloned().collect();
        // (What the camera sees lies under the plate, as the pad does.)
        let shown = scattered(&sent);
        (2..=of_pad).rev().for_each(|event| step_back(&mut sent, event));
        let mirrored = slab.and_then(|_| sent.pop_front()).unwrap_or_default();
        Self { lights, colours, vectors, radiance, mirrored, shown }
    }

    /// Radiance that an element sends the pad past so many faces of a plate, in numbers side by side.
    #[inline(always)]
    pub fn radiances(&self, element: usize, faces: u32) -> &[Vec4] {
        let level = (faces as usize).min(self.radiance.len() - 1);
        &self.radiance[level][element * self.vectors..][..self.vectors]
    }

    /// What numbers side by side tell of a light.
    pub fn of_light(&self, numbers: &[Vec4], light: usize) -> Vec3 {
        let number = |colour: usize| {
            let number = light * self.colours + if self.colours == 1 { 0 } else { colour };
            numbers[number / 4][number % 4]
        };
        Vec3::new(number(0), number(1), number(2))
    }

    /// Radiance of an element in a light, with no plate on the way.
    pub fn radiance(&self, element: usize, light: usize) -> Vec3 {
        self.of_light(self.radiances(element, 0), light)
    }

    /// What the camera sees of an element that the upper face of a plate mirrors.
    pub fn mirrored(&self, element: usize, light: usize) -> Vec3 {
        self.of_light(&self.mirrored[element * self.vectors..][..self.vectors], light)
    }

    /// What the camera sees of an element, but for what came straight from the lights.
    pub fn shown(&self, element: usize, light: usize) -> Vec3 {
        self.of_light(&self.shown[element * self.vectors..][..self.vectors], light)
    }
}

/// Faces of a plate by way of which a light is straight light, at most; what comes by more is counted as if by these.
const STRAIGHT_FACES: usize = 4;

/// Irradiance of elements straight from each light, with no plate on the way and by way of one.
struct Straight {
    lights: usize,
    /// By element and light: with no plate on the way.
    free: Vec<f32>,
    /// The same by way of one: by as few faces as can be, and by more.
    by_plate: Vec<[f32; 2]>,
    /// How many these are.
    faces: Vec<[u8; 2]>,
}

impl Straight {
    fn new(
        world: &World,
        lamps: &[Lamp],
        slab: Option<Slab>,
        buried: &(impl Fn(Vec3) -> bool + Sync),
    ) -> Self {
        let n = 2 * world.patches;
        let byways = Byways::new(world, lamps, slab);
        let by_way =
            |k: usize| byways.of_element(k, |point, normal| buried(point) || covered(world, point, normal));
        let faces_to = |k: usize| {
            let place = world.middle(k).0;
            lamps
                .iter()
                .map(move |lamp| slab.map_or([0; 2], |slab| slab.faces_between(place, lamp.bounds[0])))
        };
        Self {
            lights: lamps.len(),
            free: (0..n).into_par_iter().flat_map_iter(|k| direct(world, lamps, k, buried)).collect(),
            by_plate: (0..n).into_par_iter().flat_map_iter(by_way).collect(),
            faces: (0..n).flat_map(faces_to).collect(),
        }
    }

    /// Of an element and a light, by way of at most so many faces.
    fn within(&self, element: usize, light: usize, most: usize) -> f32 {
        let at = element * self.lights + light;
        let ways = self.by_plate[at].iter().zip(self.faces[at]);
        self.free[at]
            + ways.filter(|(_, faces)| usize::from(*faces) <= most).map(|(by_plate, _)| by_plate).sum::<f32>()
    }
}

/// How many times fewer points and rays do for an element.
fn fewer(world: &World, element: usize) -> u32 {
    if world.is_small(element) { 4 } else { 1 }
}

/// Irradiance of an element straight from each light, over those of its points that nothing covers.
fn direct(world: &World, lamps: &[Lamp], element: usize, buried: &impl Fn(Vec3) -> bool) -> Vec<f32> {
    let sampler = Sampler::new(0x0e1e, element as u32 / 2, 0, POINTS);
    let own = world.element(element).1;
    let (mut sums, mut points) = (vec![0.0; lamps.len()], 0);
    let fewer = fewer(world, element);
    for round in 0..MOST_ROUNDS {
        for i in 0..POINTS / fewer {
            let [u, v, ..] = sampler.group(i, round);
            let (point, normal) = world.point(element, [u, v]);
            if buried(point) || covered(world, point, normal) {
                continue;
            }
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum += world.direct(point, normal, own, k, &lamps[k]);
            }
            points += 1;
        }
        if points >= LEAST_POINTS / fewer {
            break;
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= points.max(1) as f32);
    sums
}

/// Whether the patch of a light lies right on the point, as patches on walls do.
fn covered(world: &World, point: Vec3, normal: Vec3) -> bool {
    let start = point + normal * world.offset;
    world.blocked(start, start + normal * (COVER * world.patch_mm))
}

/// How near, in edges of a patch: into so narrow a gap next to no light falls, and next to none of it shows.
const COVER: f32 = 0.1;

/// What the rays of an element meet, by faces of a plate on the way.
fn row(world: &World, element: usize, buried: &impl Fn(Vec3) -> bool) -> [Vec<u32>; MOST_FACES + 1] {
    let mut row = [const { Vec::new() }; MOST_FACES + 1];
    let rays = RAYS[usize::from(world.has_clear())] / fewer(world, element);
    for (met, faces) in met_by(world, element, rays, buried) {
        row[(faces as usize).min(MOST_FACES)].push(met);
    }
    row
}

/// The elements met by the rays of one, [`NOTHING`] where a ray meets none, and past how many faces of a plate; rays from points
/// that something covers are left out.
pub fn met_by(world: &World, element: usize, rays: u32, buried: &impl Fn(Vec3) -> bool) -> Vec<(u32, u32)> {
    let sampler = Sampler::new(0x6a74, element as u32, 0, rays);
    (0..rays)
        .filter_map(|i| {
            let [u, v, a, b] = sampler.group(i, 0);
            let (point, normal) = world.point(element, [u, v]);
            if buried(point) || covered(world, point, normal) {
                return None;
            }
            let mut dice = hash(element as u32, i);
            let met = world.follow(point + normal * world.offset, cosine(normal, a, b), &mut dice);
            Some(met.map_or((NOTHING, 0), |met| (met.element as u32, met.faces)))
        })
        .collect()
}

/// In place of an element.
const NOTHING: u32 = u32::MAX;

/// A direction about `normal` with density cos/pi.
pub fn cosine(normal: Vec3, a: f32, b: f32) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let (r, phi) = (a.sqrt(), TAU * b);
    x * (r * phi.cos()) + y * (r * phi.sin()) + normal * (1.0 - a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Albedo, Camera, Light, LightShape, Material, Mesh, Role, Scene, Surface};
    use std::sync::Arc;

    /// A closed box of albedo 1/2 with one light: power in balance gives the mean of what is sent out.
    #[test]
    fn a_closed_room_keeps_the_books() {
        let room = Mesh::cuboid(Vec3::splat(-5.0), Vec3::splat(5.0));
        let light = Light {
            name: "lamp".to_owned(),
            shape: LightShape::Rectangle {
                center: Vec3::new(0.0, 0.0, 4.99),
                half_u: Vec3::Y,
                half_v: Vec3::X,
            },
            radiance: Vec3::ONE,
            two_sided: false,
            cosine_power: 0.0,
            albedo: Vec3::splat(0.5),
        };
        let material = Material::Lambert { albedo: Albedo::grey(0.5) };
        let scene = Scene {
            surfaces: vec![Surface {
                name: "room".to_owned(),
                role: Role::Housing,
                mesh: Arc::new(room),
                material,
            }],
            lights: vec![light],
            camera: Camera::above(Vec3::ZERO, 1.0, 1, 1),
            max_events: 40,
        };
        let world = World::new(&scene, true).unwrap();
        let lamps: Vec<Lamp> = scene.lights.iter().filter_map(Lamp::new).collect();
        let solved = Radiosity::new(&world, &lamps, None, 40, |_| false);
        // The lamp sends pi x area x L; all is absorbed in the end: (1 - 1/2) E = power, and radiance = E / 2 pi.
        let mut sent = 0.0;
        for k in (1..2 * world.patches).step_by(2) {
            let (point, normal) = world.middle(k);
            // Equal patches: the mean over the inside of the room.
            if point.abs().max_element() > 4.995 && normal.dot(point) < 0.0 {
                sent += solved.radiance(k, 0).x;
            }
        }
        let patches = 12.0 * f32::powi((10.0_f32 / 1.1).ceil(), 2);
        let mean = sent / patches;
        let truth = 4.0 / 600.0;
        assert!((mean / truth - 1.0).abs() < 0.02, "{mean} {truth}");
    }
}
