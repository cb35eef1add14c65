//! Light of lamps that comes by way of a plate: mirrored in it to what is on the lamp's side, through it to what is beyond.
//!
//! A small lamp is met by few rays of a patch, and one ray too many would make the patch several times as bright as it is. So
//! places on each lamp are picked, and the paths to them are known in closed form (see [`Slab::way`]).

use super::plate::{ORDERS, Slab};
use super::source::Lamp;
use super::world::World;
use crate::optics::sampler::Sampler;
use glam::Vec3;

/// Pairs of places of an element and of a lamp, from afar.
const PAIRS: u32 = 64;
/// Most times as many of a lamp that is near.
const MOST_TIMES: f32 = 8.0;
/// Paths on which less arrives are left out, and all of a higher order.
const LEAST_PART: f32 = 1e-4;
/// How far before a face or a lamp a path ends, where it is asked what stands in its way, mm.
const BEFORE_MM: f32 = 1e-3;

/// All lamps of a world, by way of its plate.
pub struct Byways<'a> {
    world: &'a World,
    lamps: &'a [Lamp],
    slab: Option<Slab>,
}

impl<'a> Byways<'a> {
    /// No light comes this way where there is no plate.
    pub fn new(world: &'a World, lamps: &'a [Lamp], slab: Option<Slab>) -> Self {
        Self { world, lamps, slab }
    }

    /// Irradiance of an element of each light of radiance 1, over those of its points that nothing covers: by way of as few faces as can
    /// be, and of more.
    pub fn of_element(&self, element: usize, covered: impl Fn(Vec3, Vec3) -> bool) -> Vec<[f32; 2]> {
        let mut found = vec![[0.0; 2]; self.lamps.len()];
        let Some(slab) = self.slab.filter(|_| self.world.element(element).0 != Vec3::ZERO) else {
            return found;
        };
        let (middle, _) = self.world.middle(element);
        let usual = if self.world.is_small(element) { PAIRS / 4 } else { PAIRS };
        let pairs_of = |lamp: &Lamp| usual << nearness(&slab, lamp, middle).log2() as u32;
        let pairs: Vec<u32> = self.lamps.iter().map(pairs_of).collect();
        let most = pairs.iter().copied().fold(usual, u32::max);
        let sampler = Sampler::new(0xb1a7, element as u32, 0, most);
        let mut points = vec![0; found.len()];
        for i in 0..most {
            let [u, v, a, b] = sampler.group(i, 0);
            let (point, normal) = self.world.point(element, [u, v]);
            if covered(point, normal) {
                continue;
            }
            // (The first of them are as evenly spread as all.)
            for (l, lamp) in self.lamps.iter().enumerate().filter(|(l, _)| i < pairs[*l]) {
                points[l] += 1;
                let arriving = self.arriving(&slab, lamp, point, normal, [a, b]);
                found[l].iter_mut().zip(arriving).for_each(|(sum, arriving)| *sum += arriving);
            }
        }
        for (found, points) in found.iter_mut().zip(points) {
            found.iter_mut().for_each(|sum| *sum /= points.max(1) as f32);
        }
        found
    }

    /// Irradiance of a point of each light of radiance 1, from so many places of each or more; two numbers pick them.
    pub fn irradiances(&self, point: Vec3, normal: Vec3, [x, y]: [u32; 2], places: u32) -> Vec<f32> {
        let Some(slab) = self.slab else { return vec![0.0; self.lamps.len()] };
        let of_lamp = |lamp: &Lamp| {
            let places = (places as f32 * nearness(&slab, lamp, point)) as u32;
            let sampler = Sampler::new(0xb1a8, x, y, places);
            let of_place = |i| {
                let [a, b, ..] = sampler.group(i, 0);
                self.arriving(&slab, lamp, point, normal, [a, b]).iter().sum::<f32>()
            };
            (0..places).map(of_place).sum::<f32>() / places.max(1) as f32
        };
        self.lamps.iter().map(of_lamp).collect()
    }

    /// The irradiance of a point that a lamp of radiance 1 would give it, were all of it as the place that two numbers pick: by way of as few
    /// faces as can be, and of more.
    fn arriving(&self, slab: &Slab, lamp: &Lamp, point: Vec3, normal: Vec3, u: [f32; 2]) -> [f32; 2] {
        let (place, shines, area_mm2) = lamp.place(u);
        let mut sums = [0.0; 2];
        for order in 0..2 * ORDERS {
            let way = slab.way(point, place, order);
            if way.part < LEAST_PART {
                break;
            }
            let (cos, leaving) = (way.appears.dot(normal), way.leaves.dot(shines));
            if cos <= 0.0 || leaving <= 0.0 {
                continue;
            }
            let from = point + normal * self.world.offset;
            if self.is_hidden(slab, from, way.appears)
                || self.is_hidden(slab, place + shines * BEFORE_MM, way.leaves)
            {
                continue;
            }
            sums[order.min(1)] +=
                way.part * lamp.radiance(leaving) * way.angle_per_mm2 * leaving * cos * area_mm2;
        }
        sums
    }

    /// Whether something stands between a point outside of the plate and the plate, in this direction.
    fn is_hidden(&self, slab: &Slab, from: Vec3, direction: Vec3) -> bool {
        let gap = (slab.low - from.z).max(from.z - slab.high) - BEFORE_MM;
        gap > 0.0 && self.world.blocked(from, from + direction * (gap / direction.z.abs()))
    }
}

/// By how much nearer a lamp is, by way of the plate, than it is long.
fn nearness(slab: &Slab, lamp: &Lamp, point: Vec3) -> f32 {
    let [low, high] = lamp.bounds;
    // (Mirrored, if it is on the same side.)
    let face = if slab.covers(low) { slab.low } else { slab.high };
    let is_beside = slab.covers(low) == slab.covers(point);
    let seen_from = if is_beside { point.with_z(2.0 * face - point.z) } else { point };
    let away = (seen_from.clamp(low, high) - seen_from).length();
    ((high - low).length() / away.max(1e-6)).clamp(1.0, MOST_TIMES)
}

#[cfg(test)]
mod tests {
    use super::super::radiosity::cosine;
    use super::super::tests::scene;
    use super::*;
    use crate::optics::bench_scene::Variant;
    use crate::optics::sampler::hash;
    use crate::optics::{LightShape, Scene};
    use std::sync::Arc;

    /// The scene under a plate whose one lamp is this.
    fn lit(shape: LightShape) -> Scene {
        let mut scene = scene(Variant::B, |_, _| 0.0);
        for surface in scene.surfaces.iter_mut().filter(|s| s.role == crate::optics::Role::Plate) {
            let positions = &mut Arc::make_mut(&mut surface.mesh).positions;
            let low = positions.iter().fold(f32::INFINITY, |low, p| low.min(p.z));
            positions.iter_mut().for_each(|p| p.z = if p.z > low { 7.5 } else { 6.0 });
        }
        scene.lights.truncate(1);
        scene.lights[0].shape = shape;
        scene
    }

    #[test]
    fn as_much_comes_by_way_of_a_plate_as_rays_find() {
        let upright = |z: f32| LightShape::Rectangle {
            center: Vec3::new(-8.0, 1.0, z),
            half_u: Vec3::Y * 1.5,
            half_v: Vec3::Z,
        };
        let (from, to) = (Vec3::new(-8.0, -1.0, 3.0), Vec3::new(-8.0, 2.0, 4.0));
        let tube = LightShape::Tube { from, to, radius: 0.8 };
        for shape in [upright(3.0), upright(10.0), tube] {
            let scene = lit(shape.clone());
            let world = World::new(&scene, true).unwrap();
            let lamps: Vec<Lamp> = scene.lights.iter().filter_map(Lamp::new).collect();
            let slab = Slab::of(&scene).unwrap();
            let byways = Byways::new(&world, &lamps, slab);
            // Below, within and above the plate, facing aside, and up or down.
            for (point, normal) in [
                (Vec3::new(4.0, 2.0, 0.1), Vec3::Z),
                (Vec3::new(5.0, 0.0, 2.0), Vec3::new(-0.8, 0.0, 0.6)),
                (Vec3::new(-5.0, 0.0, 6.7), Vec3::new(-0.6, 0.0, -0.8)),
                (Vec3::new(-5.0, 1.0, 6.7), Vec3::new(-0.6, 0.0, 0.8)),
                (Vec3::new(0.0, -2.0, 10.0), Vec3::new(-0.6, 0.0, -0.8)),
            ] {
                let found = byways.irradiances(point, normal, [7, 8], 4096)[0];
                let (mut hits, rays) = (0, 1 << 17);
                let sampler = Sampler::new(3, 1, 4, rays);
                for i in 0..rays {
                    let [a, b, ..] = sampler.group(i, 0);
                    let (mut dice, direction) = (hash(9, i), cosine(normal, a, b));
                    let straight = world.trace(point, direction);
                    let Some(met) = world.follow(point, direction, &mut dice) else { continue };
                    // (What is met straight is no light by way of the plate.)
                    if straight.is_some_and(|straight| {
                        straight.element == met.element && straight.hit.t == met.hit.t
                    }) {
                        continue;
                    }
                    hits += u32::from(met.light.is_some() && met.front);
                }
                let per_ray = std::f32::consts::PI / rays as f32;
                let (truth, noise) = (hits as f32 * per_ray, (hits as f32).sqrt() * per_ray);
                let off = found - truth;
                assert!(
                    truth > 0.0 && off.abs() < 4.0 * noise + 0.01 * truth,
                    "{shape:?} {point} {normal}: {found} {truth} +- {noise}"
                );
            }
        }
    }
}
