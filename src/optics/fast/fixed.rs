//! What of the sensor shows beside the pad, and in a plate: the same in every picture.

use super::plate::Slab;
use super::radiosity::Radiosity;
use super::source::Lamp;
use super::view::View;
use super::world::World;
use crate::optics::{Error, Role, Scene, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// What a plate mirrors into each pixel, by light of radiance 1.
pub fn veils(view: &View, slab: &Slab, world: &World, solved: &Radiosity) -> Vec<Vec<Vec3>> {
    let camera = &view.camera;
    let seen: Vec<Vec<Vec3>> = (0..camera.width * camera.height)
        .into_par_iter()
        .map(|k| {
            let at = Vec2::new((k % camera.width) as f32 + 0.5, (k / camera.width) as f32 + 0.5);
            let (origin, direction) = camera.ray(at.x, at.y, Vec2::ZERO);
            let up = direction.with_z(-direction.z);
            let mut sums = vec![Vec3::ZERO; solved.lights];
            for (from, weight) in slab.mirrored(origin, direction) {
                let Some(met) = world.trace(from + up * world.offset, up) else { continue };
                for (light, sum) in sums.iter_mut().enumerate() {
                    *sum += solved.radiance(met.element, light) * weight;
                }
                if let Some(light) = met.light.filter(|_| met.front) {
                    sums[light] += Vec3::splat(weight);
                }
            }
            sums
        })
        .collect();
    (0..solved.lights).map(|l| seen.iter().map(|s| s[l]).collect()).collect()
}

/// Inverse depth by corner, and radiance by light and corner.
pub type Fixed = (Vec<f32>, Vec<Vec<Vec3>>);

/// Traces what the camera would see without the pad.
pub fn corners(
    scene: &Scene,
    view: &View,
    world: &World,
    lamps: &[Lamp],
    solved: &Radiosity,
) -> Result<Fixed, Error> {
    // What stands above a plate is not in its way: walls are wider than the view there.
    let bare = World::new(&Scene { surfaces: solid(scene), ..scene.clone() }, false)?;
    let [columns, rows] = view.corners();
    let lights = lamps.len();
    let samples: Vec<(f32, Vec<Vec3>)> = (0..columns * rows)
        .into_par_iter()
        .map(|k| {
            let at = Vec2::new((k % columns) as f32, (k / columns) as f32);
            let [start, along] = view.ray(at);
            let direction = along.normalize();
            let Some(met) = bare.trace(start + direction * bare.offset, direction) else {
                return (f32::NEG_INFINITY, Vec::new());
            };
            let value = along.length() / met.hit.t;
            // Its radiance is that of the whole sensor, pad included; what the pad hides is not shown anyway.
            let free = world.trace(start + direction * bare.offset, direction);
            let Some(whole) = free.filter(|whole| whole.hit.t >= met.hit.t * 0.999) else {
                return (value, vec![Vec3::ZERO; lights]);
            };
            let of_light = |l: usize| {
                let e = world.direct(met.hit.point, met.normal, met.light, l, &lamps[l]);
                let own = if met.front && met.light == Some(l) { Vec3::ONE } else { Vec3::ZERO };
                met.albedo * (FRAC_1_PI * e) + solved.direct_free(whole.element, l) + own
            };
            (value, (0..lights).map(of_light).collect())
        })
        .collect();
    if samples.iter().all(|s| s.0 == f32::NEG_INFINITY) {
        return Ok((Vec::new(), vec![Vec::new(); lights]));
    }
    let of_light = |l: usize| samples.iter().map(|s| s.1.get(l).copied().unwrap_or(Vec3::ZERO)).collect();
    Ok((samples.iter().map(|s| s.0).collect(), (0..lights).map(of_light).collect()))
}

/// All surfaces but plates.
fn solid(scene: &Scene) -> Vec<Surface> {
    scene.surfaces.iter().filter(|s| s.role != Role::Plate).cloned().collect()
}
