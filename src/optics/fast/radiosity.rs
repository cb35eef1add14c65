//! The light that walls and pad send out, solved once for the untouched sensor.
//!
//! Elements are the sides of the world's patches. Each gathers over cosine-distributed rays, so that what stands in
//! between is accounted for; the rows of elements met are kept and the bounces are then a sparse product. Bounces are
//! counted: an event limit cuts the series here as it does in the reference.

use super::world::World;
use crate::optics::{emitter::Emitter, sampler::Sampler};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Rays of an element; their errors average out over the many elements that a probe sees.
const RAYS: u32 = 256;
/// Points at which an element's direct light is taken.
const POINTS: u32 = 16;

/// What each element sends out.
#[derive(Debug, Clone)]
pub struct Radiosity {
    /// Radiance of the diffuse reflection of each element, the light's own emission excepted.
    pub radiance: Vec<Vec3>,
    /// The part of it that came straight from the lights.
    straight: Vec<Vec3>,
}

impl Radiosity {
    /// After 1 to `events` scatterings.
    ///
    /// `buried` tells which points lie under the untouched face: patches of walls that reach below it count only
    /// their part above, which is what the camera's side sees of them.
    pub fn new(
        world: &World,
        emitters: &[Emitter],
        events: u32,
        buried: impl Fn(Vec3) -> bool + Sync,
    ) -> Self {
        let n = 2 * world.patches;
        let direct: Vec<Vec3> = (0..n).into_par_iter().map(|k| direct(world, emitters, k, &buried)).collect();
        let rows: Vec<Vec<u32>> = if events > 1 {
            (0..n).into_par_iter().map(|k| row(world, k, &buried)).collect()
        } else {
            Vec::new()
        };
        let mut radiance = vec![Vec3::ZERO; n];
        for bounce in 0..events {
            radiance = (0..n)
                .into_par_iter()
                .map(|k| {
                    let gathered = if bounce == 0 {
                        Vec3::ZERO
                    } else {
                        let met = rows[k].iter().filter(|&&e| e != NOTHING);
                        met.map(|&e| radiance[e as usize]).sum::<Vec3>() / rows[k].len().max(1) as f32
                    };
                    world.element(k).0 * (direct[k] * FRAC_1_PI + gathered)
                })
                .collect();
        }
        let straight = (0..n).map(|k| world.element(k).0 * direct[k] * FRAC_1_PI).collect();
        Self { radiance, straight }
    }

    /// Radiance of an element for light that was scattered before.
    pub fn direct_free(&self, element: usize) -> Vec3 {
        (self.radiance[element] - self.straight[element]).max(Vec3::ZERO)
    }
}

/// Irradiance of an element straight from the lights, over those of its points that nothing covers.
fn direct(world: &World, emitters: &[Emitter], element: usize, buried: &impl Fn(Vec3) -> bool) -> Vec3 {
    let sampler = Sampler::new(0x0e1e, element as u32 / 2, 0, POINTS);
    let own = world.element(element).1;
    let (mut sum, mut points) = (Vec3::ZERO, 0);
    for i in 0..POINTS {
        let [u, v, ..] = sampler.group(i, 0);
        let (point, normal) = world.point(element, [u, v]);
        if buried(point) || covered(world, point, normal) {
            continue;
        }
        sum += world.direct(point, normal, own, emitters);
        points += 1;
    }
    sum / points.max(1) as f32
}

/// Whether the patch of a light lies right on the point, as patches on walls do.
fn covered(world: &World, point: Vec3, normal: Vec3) -> bool {
    let start = point + normal * world.offset;
    world.blocked(start, start + normal * (COVER * world.offset))
}

/// How near, in offsets (an offset is 2e-6 of the scene).
const COVER: f32 = 200.0;

/// The elements met by the rays of one, [`NOTHING`] where a ray meets none.
fn row(world: &World, element: usize, buried: &impl Fn(Vec3) -> bool) -> Vec<u32> {
    let sampler = Sampler::new(0x6a74, element as u32, 0, RAYS);
    (0..RAYS)
        .filter_map(|i| {
            let [u, v, a, b] = sampler.group(i, 0);
            let (point, normal) = world.point(element, [u, v]);
            if buried(point) || covered(world, point, normal) {
                return None;
            }
            let met = world.trace(point + normal * world.offset, cosine(normal, a, b));
            Some(met.map_or(NOTHING, |met| met.element as u32))
        })
        .collect()
}

/// In place of an element.
const NOTHING: u32 = u32::MAX;

/// A direction about `normal` with density cos/pi.
fn cosine(normal: Vec3, a: f32, b: f32) -> Vec3 {
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
        let emitters: Vec<Emitter> = scene.lights.iter().map(Emitter::new).collect();
        let solved = Radiosity::new(&world, &emitters, 40, |_| false);
        // The lamp sends pi x area x L; all is absorbed in the end: (1 - 1/2) E = power, and radiance = E / 2 pi.
        let mut sent = 0.0;
        for k in (1..2 * world.patches).step_by(2) {
            let (point, normal) = world.point(k, [0.3, 0.3]);
            // Equal patches: the mean over the inside of the room.
            if point.abs().max_element() > 4.995 && normal.dot(point) < 0.0 {
                sent += solved.radiance[k].x;
            }
        }
        let patches = 12.0 * f32::powi((14.142_f32 / 1.5).ceil(), 2);
        let mean = sent / patches;
        let truth = 4.0 / 600.0;
        assert!((mean / truth - 1.0).abs() < 0.02, "{mean} {truth}");
    }
}
