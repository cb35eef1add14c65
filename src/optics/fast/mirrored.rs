//! Lamps between pad and plate, as the pad sees them mirrored in the plate.
//!
//! Such an image is as small and as bright as a lamp, and the few rays of a probe that meet it would be told from those that do not by
//! the chance with which a face reflects. So it is looked at by itself: places all over each lamp, and to each of them one path by
//! the lower face and some by the upper one, in closed form (see [`Slab`]).

use super::plate::{ORDERS, Slab};
use super::source::Lamp;
use super::world::World;
use crate::optics::sampler::Sampler;
use glam::Vec3;

/// Places at which a patch of a lamp is looked at.
const PLACES: u32 = 4;
/// How far before a face or a lamp a path ends, where it is asked what stands in its way, mm.
const BEFORE_MM: f32 = 1e-3;

/// All lamps below a plate.
pub struct Mirrored<'a> {
    world: &'a World,
    lamps: &'a [Lamp],
    slab: Option<Slab>,
    places: Vec<Place>,
}

/// A part of a lamp.
struct Place {
    light: usize,
    point: Vec3,
    normal: Vec3,
    area_mm2: f32,
}

impl<'a> Mirrored<'a> {
    /// Those of a world; none without a plate.
    pub fn new(world: &'a World, lamps: &'a [Lamp], slab: Option<Slab>) -> Self {
        // (Patches shine on the side that comes first.)
        let patches = (0..world.patches as u32).filter_map(|patch| {
            let element = 2 * patch as usize;
            Some((patch, element, world.element(element).1?))
        });
        let places = patches.filter(|_| slab.is_some()).flat_map(|(patch, element, light)| {
            let sampler = Sampler::new(0x3141, patch, 0, PLACES);
            let area_mm2 = world.area(element) / PLACES as f32;
            (0..PLACES).map(move |k| {
                let [u, v, ..] = sampler.group(k, 0);
                let (point, normal) = world.point(element, [u, v]);
                Place { light, point, normal, area_mm2 }
            })
        });
        let below = |place: &Place| slab.is_some_and(|slab| slab.covers(place.point));
        Self { world, lamps, slab, places: places.filter(below).collect() }
    }

    /// Tells of every path to an image that is seen from a point: whose it is, in which direction, and its radiance, of a lamp of
    /// radiance 1, times the solid angle that it fills.
    pub fn seen(&self, from: Vec3, mut tell: impl FnMut(usize, Vec3, f32)) {
        let Some(slab) = self.slab.filter(|slab| slab.covers(from)) else { return };
        for place in &self.places {
            for order in 0..ORDERS {
                let image = slab.image(from, place.point, order);
                let arrives = Vec3::new(image.direction.x, image.direction.y, -image.direction.z);
                let cos = -arrives.dot(place.normal);
                if cos <= 0.0 || self.is_hidden(&slab, from, place, image.direction) {
                    continue;
                }
                let radiance = self.lamps[place.light].radiance(cos);
                let weight = image.reflected * radiance * image.angle_per_mm2 * cos * place.area_mm2;
                tell(place.light, image.direction, weight);
            }
        }
    }

    /// Whether something stands on the way up to the plate, or on the way down from it.
    fn is_hidden(&self, slab: &Slab, from: Vec3, place: &Place, direction: Vec3) -> bool {
        let rise = |p: Vec3| (slab.low - p.z - BEFORE_MM).max(0.0) / direction.z;
        let up = from + direction * rise(from);
        let start = place.point + place.normal * BEFORE_MM;
        let back = Vec3::new(-direction.x, -direction.y, direction.z);
        self.world.blocked(from, up) || self.world.blocked(start, start + back * rise(start))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::scene;
    use super::*;
    use crate::optics::bench_scene::Variant;
    use crate::optics::bsdf::fresnel;

    #[test]
    fn an_image_in_the_lower_face_lights_as_a_lamp_there_would() {
        let mut scene = scene(Variant::Ac, |_, _| 0.0);
        scene.surfaces.clear();
        let low = 12.0;
        let lamps: Vec<Lamp> = scene.lights.iter().filter_map(Lamp::new).collect();
        let world = World::new(&scene, false).unwrap();
        // So thin that what its upper face reflects appears where the image in the lower one does.
        let slab = Slab { low, high: low + 1e-3, ior: 1.5 };
        let mirrored = Mirrored::new(&world, &lamps, Some(slab));
        for from in [Vec3::new(0.0, 0.0, 0.1), Vec3::new(4.0, -3.0, 0.5)] {
            let mut found = vec![0.0; lamps.len()];
            mirrored.seen(from, |light, direction, weight| found[light] += weight * direction.z);
            // By a plate without thickness: mirror images, of which each point has its own reflectance.
            let mut images = scene.clone();
            for light in &mut images.lights {
                let crate::optics::LightShape::Rectangle { center, half_u, half_v } = &mut light.shape else {
                    continue;
                };
                let flip = |v: Vec3| Vec3::new(v.x, v.y, -v.z);
                *center = flip(*center) + Vec3::Z * (2.0 * low);
                // (A mirror image turns the other way.)
                (*half_u, *half_v) = (flip(*half_v), flip(*half_u));
            }
            for (light, found) in images.lights.iter().zip(found) {
                let lamp = Lamp::new(light).unwrap();
                let face = fresnel((lamp.center - from).normalize().z, 1.5);
                let theory = lamp.irradiance(from, Vec3::Z) * 2.0 * face / (1.0 + face);
                assert!(
                    theory > 0.0 && (found / theory - 1.0).abs() < 0.03,
                    "{:?} {from}: {found} {theory}",
                    light.name
                );
            }
        }
    }
}
