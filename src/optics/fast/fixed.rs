//! What of the sensor shows beside the pad, and in a plate: the same in every picture.

use super::DIRECT_LIFT_MM;
use super::byway::Byways;
use super::cover::{SAMPLES, place};
use super::plate::{MIRRORED, Slab};
use super::radiosity::{Radiosity, cosine};
use super::source::Lamp;
use super::view::View;
use super::world::{Met, World};
use crate::optics::accel::overlaps;
use crate::optics::sampler::{Sampler, hash};
use crate::optics::{Error, Role, Scene, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// What a plate mirrors into each pixel, by light of radiance 1. Where the edge of a lamp is mirrored, pixels are sampled.
///
/// Of what a ray meets after further reflections inside lamps alone are looked at, which show there even so. Walls count as if they
/// stood where the first of these shows them. What is seen through the plate counts with all of its light as if it stood where it is
/// seen without any, so that of a lamp's light the part that makes its ghost is taken off there and added here.
pub fn veils(view: &View, slab: &Slab, world: &World, lamps: &[Lamp], solved: &Radiosity) -> Vec<Vec<Vec3>> {
    let camera = &view.camera;
    let [columns, rows] = view.corners();
    let shining = |met: &Met, along: Vec3| {
        let lamp = met.light.filter(|_| met.front)?;
        Some((lamp, lamps[lamp].radiance(-along.dot(met.normal))))
    };
    // (As far as anything is.)
    let far = 2.0 * world.extent();
    let lamp_at = |from: Vec3, along: Vec3| {
        lamps.iter().find(|lamp| overlaps(&lamp.bounds, from, from + along * far))?;
        shining(&world.trace(from, along)?, along)
    };
    // By light; tells the lamp that each image shows.
    let look = |at: Vec2, sums: &mut [Vec3]| {
        let (origin, direction) = camera.ray(at.x, at.y, Vec2::ZERO);
        let up = direction.with_z(-direction.z);
        let mut add = |shown: Option<(usize, f32)>, weight: f32| {
            let (lamp, radiance) = shown?;
            sums[lamp] += Vec3::splat(weight * radiance);
            Some(lamp)
        };
        let mirrored = slab.mirrored(origin, direction);
        let (mut shown, mut walls) = ([None; MIRRORED], [None; 2]);
        let further: f32 = mirrored[2..].iter().map(|(_, weight)| weight).sum();
        for (image, (from, weight)) in mirrored.into_iter().enumerate() {
            let from = from + up * world.offset;
            shown[image] = match walls.get_mut(image) {
                Some(wall) => world.trace(from, up).and_then(|met| {
                    *wall = Some((met.element, weight + if image == 1 { further } else { 0.0 }));
                    add(shining(&met, up), weight)
                }),
                None => add(lamp_at(from, up), weight),
            };
        }
        let (ghost, weight) = slab.ghost(origin, direction);
        let [from, below] = slab.below(origin, direction);
        let below = below.normalize();
        let doubled = add(lamp_at(ghost + below * world.offset, below), weight);
        let straight = add(lamp_at(from + below * world.offset, below), -weight);
        for (light, sum) in sums.iter_mut().enumerate() {
            // (The first image comes of one face, and the second of three.)
            let [first, second] = walls;
            let of_first = |(element, weight)| solved.mirrored(element, light) * weight;
            let of_second = |(element, weight)| solved.radiance(element, light) * weight;
            *sum += first.map_or(Vec3::ZERO, of_first) + second.map_or(Vec3::ZERO, of_second);
        }
        (shown, doubled, straight)
    };
    let corner = |k: usize| {
        look(Vec2::new((k % columns) as f32, (k / columns) as f32), &mut vec![Vec3::ZERO; solved.lights])
    };
    let corners: Vec<_> = (0..columns * rows).into_par_iter().map(corner).collect();
    let seen: Vec<Vec<Vec3>> = (0..camera.width * camera.height)
        .into_par_iter()
        .map(|k| {
            let (x, y) = (k % camera.width, k / camera.width);
            let at = Vec2::new(x as f32, y as f32);
            let mut sums = vec![Vec3::ZERO; solved.lights];
            // (An edge may come and go between two corners: those around see where.)
            let mut around = (y.saturating_sub(1)..(y + 3).min(rows))
                .flat_map(|y| (x.saturating_sub(1)..(x + 3).min(columns)).map(move |x| y * columns + x));
            let here = corners[y * columns + x];
            let is_even = around.all(|k| corners[k] == here) && look(at + 0.5, &mut sums) == here;
            if !is_even {
                sums.fill(Vec3::ZERO);
                (0..SAMPLES).for_each(|s| _ = look(at + place(s), &mut sums));
                sums.iter_mut().for_each(|sum| *sum /= SAMPLES as f32);
            }
            sums
        })
        .collect();
    (0..solved.lights).map(|l| seen.iter().map(|s| s[l]).collect()).collect()
}

/// What the camera sees of the fixed parts in one direction.
#[derive(Debug, Clone, Default)]
pub struct Look {
    /// Inverse depth; minus infinity where there is nothing.
    pub value: f32,
    /// Its radiance by light; empty where there is nothing.
    pub lights: Vec<Vec3>,
    /// Whether it shows beside the untouched pad, and whether it stands high above that.
    pub shows: bool,
    /// See `shows`.
    pub high: bool,
    /// The lamp whose shining side it is.
    pub lamp: Option<usize>,
    /// Where it is, mm, its normal on the side that shows, its reflectance, and the lamp of which it is a side.
    pub point: Vec3,
    pub normal: Vec3,
    pub albedo: Vec3,
    pub part: Option<usize>,
}

/// Looks at what the camera would see without the pad.
pub struct Looks<'a> {
    view: &'a View,
    world: &'a World,
    /// The same without pad and plates: what stands above a plate is not in its way, walls are wider than the view there.
    bare: World,
    lamps: &'a [Lamp],
    byways: Byways<'a>,
    solved: &'a Radiosity,
    /// No press lifts the pad to this height.
    high: f32,
    /// Which points lie under the untouched face.
    buried: &'a (dyn Fn(Vec3) -> bool + Sync),
    /// Whether what lamps reflect is gathered where they show. (Not where light ends early: it counts one event more.)
    gathers: bool,
}

impl<'a> Looks<'a> {
    /// What stands above `high` counts as high, what is `buried` lies under the untouched face.
    ///
    /// # Errors
    /// When the scene without the pad is none.
    pub fn new(
        scene: &Scene,
        view: &'a View,
        world: &'a World,
        lamps: &'a [Lamp],
        solved: &'a Radiosity,
        high: f32,
        buried: &'a (dyn Fn(Vec3) -> bool + Sync),
    ) -> Result<Self, Error> {
        let bare = World::new(&Scene { surfaces: solid(scene), ..scene.clone() }, false)?;
        let gathers = scene.max_events >= LEAST_EVENTS && !world.has_clear();
        let byways = Byways::new(world, lamps, view.slab);
        Ok(Self { view, world, bare, lamps, byways, solved, high, buried, gathers })
    }

    /// All corners of pixels.
    pub fn corners(&self) -> Vec<Look> {
        let [columns, rows] = self.view.corners();
        let at = |k: usize| Vec2::new((k % columns) as f32, (k / columns) as f32);
        (0..columns * rows).into_par_iter().map(|k| self.at(at(k), RAYS)).collect()
    }

    /// A point of the raster, in pixels; what a lamp reflects there is gathered over so many rays.
    pub fn at(&self, at: Vec2, rays: u32) -> Look {
        let Self { view, world, bare, lamps, solved, high, buried, gathers, .. } = self;
        let [start, along] = view.ray(at);
        let direction = along.normalize();
        let Some(met) = bare.trace(start + direction * bare.offset, direction) else {
            return Look { value: f32::NEG_INFINITY, ..Look::default() };
        };
        let value = along.length() / met.hit.t;
        // Its radiance is that of the whole sensor, pad included; what the pad hides is not shown anyway.
        let free = world.trace(start + direction * bare.offset, direction);
        let Some(whole) = free.filter(|whole| whole.hit.t >= met.hit.t * 0.999) else {
            return Look { value, lights: vec![Vec3::ZERO; lamps.len()], ..Look::default() };
        };
        let lamp = met.light.filter(|_| met.front);
        let gathered = match buried(met.hit.point) {
            true => Some(GATHERED),
            false => (lamp.is_some() && *gathers).then_some(rays),
        };
        let met_there = gathered.map(|rays| self.met_from(at, met.hit.point, met.normal, rays));
        let scattered = |l: usize| match (&met_there, gathered) {
            (Some(met_there), Some(rays)) => {
                let sum: Vec3 = met_there.iter().map(|there| self.radiance(there, l)).sum();
                met.albedo * sum / rays as f32
            }
            _ => solved.shown(whole.element, l),
        };
        // (Where there is a plate, all this is seen through it.)
        let passed = view.slab.map_or(1.0, |slab| slab.transmitted(direction));
        let radiance = lamp.map_or(0.0, |lamp| lamps[lamp].radiance(-direction.dot(met.normal)));
        let seed = [at.x.to_bits(), at.y.to_bits()];
        let by_plate = self.byways.irradiances(met.hit.point, met.normal, seed, rays / RAYS_A_PLACE);
        let of_light = |l: usize| {
            let e = world.direct(met.hit.point, met.normal, met.light, l, &lamps[l]) + by_plate[l];
            let own = if lamp == Some(l) { Vec3::splat(radiance) } else { Vec3::ZERO };
            (met.albedo * (FRAC_1_PI * e) + scattered(l) + own) * passed
        };
        Look {
            value,
            lights: (0..lamps.len()).map(of_light).collect(),
            shows: true,
            high: met.hit.point.z > *high,
            lamp,
            point: met.hit.point,
            normal: met.normal,
            albedo: met.albedo,
            part: met.light,
        }
    }

    /// Irradiance of a point straight from each light of radiance 1; of which lamp it is, is told.
    pub fn direct(&self, point: Vec3, normal: Vec3, part: Option<usize>) -> Vec<f32> {
        let lamps = self.lamps.iter().enumerate();
        lamps.map(|(l, lamp)| self.world.direct(point, normal, part, l, lamp)).collect()
    }

    /// How high a point is over the untouched pad, mm.
    pub fn over_face(&self, point: Vec3) -> f32 {
        point.z - (self.high - DIRECT_LIFT_MM[1])
    }

    /// What rays from a point meet above the face. Patches of walls are known by their parts above: of what shows in the gap
    /// beside a pad they tell too much. Those of a lamp that stands on the pad are lit unevenly: the more, the nearer to its foot.
    fn met_from(&self, at: Vec2, point: Vec3, normal: Vec3, rays: u32) -> Vec<Met> {
        let sampler = Sampler::new(0x6a90, at.x.to_bits(), at.y.to_bits(), rays);
        let start = point + normal * self.world.offset;
        (0..rays)
            .filter_map(|i| {
                let [a, b, ..] = sampler.group(i, 0);
                let mut dice = hash(at.x.to_bits() ^ at.y.to_bits().rotate_left(16), i);
                let met = self.world.follow(start, cosine(normal, a, b), &mut dice)?;
                (!(self.buried)(met.hit.point)).then_some(met)
            })
            .collect()
    }

    /// What is sent by what a ray met, in a light: near by, what comes straight from the light is that of the very point.
    fn radiance(&self, met: &Met, l: usize) -> Vec3 {
        let Self { world, solved, lamps, .. } = self;
        if !self.gathers || met.hit.t > NEAR * world.patch_mm {
            return solved.of_light(solved.radiances(met.element, met.faces), l);
        }
        let direct = world.direct(met.hit.point, met.normal, met.light, l, &lamps[l]);
        met.albedo * (FRAC_1_PI * direct) + solved.shown(met.element, l)
    }
}

/// Rays from a point under the face.
const GATHERED: u32 = 16;
/// Rays from a point of a lamp at a corner of pixels, and at one of a pixel's samples.
const RAYS: u32 = 64;
pub const SAMPLE_RAYS: u32 = 8;
/// For so many of them one place of each lamp is looked at by way of a plate.
const RAYS_A_PLACE: u32 = 4;
/// What is so near, in edges of a patch, is lit more unevenly than patches tell.
const NEAR: f32 = 3.0;
/// Fewest events of a scene in which one more or less does not count.
const LEAST_EVENTS: u32 = 5;

/// Inverse depth by corner, and radiance by light and corner; empty where there is nothing.
pub fn by_light(corners: &[Look], lights: usize) -> (Vec<f32>, Vec<Vec<Vec3>>) {
    if corners.iter().all(|look| look.value == f32::NEG_INFINITY) {
        return (Vec::new(), vec![Vec::new(); lights]);
    }
    let of_light =
        |l: usize| corners.iter().map(|look| look.lights.get(l).copied().unwrap_or(Vec3::ZERO)).collect();
    (corners.iter().map(|look| look.value).collect(), (0..lights).map(of_light).collect())
}

/// All surfaces but plates.
fn solid(scene: &Scene) -> Vec<Surface> {
    scene.surfaces.iter().filter(|s| s.role != Role::Plate).cloned().collect()
}
