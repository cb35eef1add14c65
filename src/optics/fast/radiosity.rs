//! The light that walls and pad send out, solved once for the untouched sensor.
//!
//! Elements are the sides of the world's patches. Each gathers over cosine-distributed rays, so that what stands in
//! between is accounted for; the rows of elements met are kept and the bounces are then a sparse product. Bounces are
//! counted: an event limit cuts the series here as it does in the reference.

use super::byway::Byways;
use super::plate::Slab;
use super::source::Lamp;
use super::world::World;
use crate::optics::sampler::{Sampler, hash};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Rays of an element without and with clear bodies, at which chance splits them; their errors average out over the many
/// elements that a probe sees (with four times the rays a picture changes by 0.02 % of its mean and 0.25 %).
const RAYS: [u32; 2] = [64, 256];
/// Points at which an element's direct light is taken.
const POINTS: u32 = 16;

/// What each element sends out, for each light of radiance 1. Lights and their colours stand side by side, four at a time.
#[derive(Debug, Clone)]
pub struct Radiosity {
    /// How many lights.
    pub lights: usize,
    /// Numbers of a light: one where nothing has a colour, else three.
    colours: usize,
    /// Vectors of an element.
    pub vectors: usize,
    /// By element: radiance of the diffuse reflection, the light's own emission excepted.
    radiance: Vec<Vec4>,
    /// What of it the camera sees is scattered once more than what lights the pad; without what came straight from the lights.
    shown: Vec<Vec4>,
}

impl Radiosity {
    /// After 1 to `events` scatterings; what the camera sees after one more.
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
        let byways = Byways::new(world, lamps, slab);
        let of_element = |k: usize| {
            let mut sums = direct(world, lamps, k, &buried);
            byways.add_to(&mut sums, k, |point, normal| buried(point) || covered(world, point, normal));
            sums
        };
        let direct: Vec<f32> = (0..n).into_par_iter().flat_map_iter(of_element).collect();
        let rows: Vec<Vec<u32>> = (0..n).into_par_iter().map(|k| row(world, k, &buried)).collect();
        let albedos: Vec<Vec3> = (0..n).map(|k| world.element(k).0).collect();
        let colours = if albedos.iter().all(|a| a.x == a.y && a.y == a.z) { 1 } else { 3 };
        let vectors = (lights * colours).div_ceil(4);
        let mut straight = vec![Vec4::ZERO; n * vectors];
        // By element, for all its numbers.
        let mut reflectances = straight.clone();
        for (k, albedo) in albedos.iter().enumerate() {
            for number in 0..lights * colours {
                let (at, lane) = (k * vectors + number / 4, number % 4);
                let (light, colour) = (number / colours, number % colours);
                reflectances[at][lane] = albedo[colour];
                straight[at][lane] = albedo[colour] * direct[k * lights + light] * FRAC_1_PI;
            }
        }
        let mut radiance = if events > 0 { straight.clone() } else { vec![Vec4::ZERO; n * vectors] };
        let scattered = |before: &[Vec4]| {
            let mut sums = vec![Vec4::ZERO; before.len()];
            sums.par_chunks_mut(vectors).zip(&rows).enumerate().for_each(|(k, (sums, row))| {
                let reflectances = &reflectances[k * vectors..][..vectors];
                let share = 1.0 / row.len().max(1) as f32;
                for (v, sum) in sums.iter_mut().enumerate() {
                    let mut arrived = Vec4::ZERO;
                    for &met in row {
                        if met != NOTHING {
                            arrived += before[met as usize * vectors + v];
                        }
                    }
                    *sum = arrived * reflectances[v] * share;
                }
            });
            sums
        };
        for _ in 1..events {
            radiance = scattered(&radiance);
            radiance.iter_mut().zip(&straight).for_each(|(sum, straight)| *sum += *straight);
        }
        let shown = scattered(&radiance);
        Self { lights, colours, vectors, radiance, shown }
    }

    /// Radiance of an element in numbers side by side.
    #[inline(always)]
    pub fn radiances(&self, element: usize) -> &[Vec4] {
        &self.radiance[element * self.vectors..][..self.vectors]
    }

    /// What numbers side by side tell of a light.
    pub fn of_light(&self, numbers: &[Vec4], light: usize) -> Vec3 {
        let number = |colour: usize| {
            let number = light * self.colours + if self.colours == 1 { 0 } else { colour };
            numbers[number / 4][number % 4]
        };
        Vec3::new(number(0), number(1), number(2))
    }

    /// Radiance of an element in a light.
    pub fn radiance(&self, element: usize, light: usize) -> Vec3 {
        self.of_light(self.radiances(element), light)
    }

    /// What the camera sees of an element, but for what came straight from the lights.
    pub fn shown(&self, element: usize, light: usize) -> Vec3 {
        self.of_light(&self.shown[element * self.vectors..][..self.vectors], light)
    }
}

/// Irradiance of an element straight from each light, over those of its points that nothing covers.
fn direct(world: &World, lamps: &[Lamp], element: usize, buried: &impl Fn(Vec3) -> bool) -> Vec<f32> {
    let sampler = Sampler::new(0x0e1e, element as u32 / 2, 0, POINTS);
    let own = world.element(element).1;
    let (mut sums, mut points) = (vec![0.0; lamps.len()], 0);
    for i in 0..POINTS {
        let [u, v, ..] = sampler.group(i, 0);
        let (point, normal) = world.point(element, [u, v]);
        if buried(point) || covered(world, point, normal) {
            continue;
        }
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += world.direct(point, normal, own, k, &lamps[k]);
        }
        points += 1;
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

fn row(world: &World, element: usize, buried: &impl Fn(Vec3) -> bool) -> Vec<u32> {
    met_by(world, element, RAYS[usize::from(world.has_clear())], buried)
}

/// The elements met by the rays of one, [`NOTHING`] where a ray meets none; rays from points that something covers are
/// left out.
pub fn met_by(world: &World, element: usize, rays: u32, buried: &impl Fn(Vec3) -> bool) -> Vec<u32> {
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
            Some(met.map_or(NOTHING, |met| met.element as u32))
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
            let (point, normal) = world.point(k, [0.3, 0.3]);
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
