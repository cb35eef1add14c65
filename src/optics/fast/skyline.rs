//! What of the walls a rising pad hides, and of lamps that a plate mirrors: the radiance of the untouched sensor, by direction, low
//! over its face.
//!
//! Walls are lit unevenly, most so by one light alone: what the pad hides is the part of one of them, not their mean. Radiance is
//! kept for the directions in which the bounce looks, as means over ranges of elevation, on a coarse grid.

use super::echo::{self, DIRECTIONS, RISES, towards};
use super::grid::{Grid, Layout, Places};
use super::lanes::{Eight, Vectors};
use super::mirrored::Mirrored;
use super::probes;
use super::radiosity::Radiosity;
use super::world::World;
use crate::optics::sampler::{Sampler, hash};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Numbers of a node: three colours of each direction.
pub const NUMBERS: usize = 3 * DIRECTIONS;
/// Rays of a direction.
const RAYS: u32 = 16;
/// Grid of the nodes, mm.
const STEP_MM: f32 = 2.5;
const LIFT_MM: [f32; 2] = [0.0, 1.5];

/// The radiance for each light of radiance 1.
pub fn gather(
    world: &World,
    solved: &Radiosity,
    mirrored: &Mirrored<'_>,
    layout: &Layout,
    rest: impl Fn(Vec2) -> f32 + Sync,
) -> Vec<Grid<NUMBERS>> {
    let layout = Layout { step_mm: STEP_MM, lift_mm: LIFT_MM, lift_step_mm: LIFT_MM[1], ..*layout };
    let places = Places::new(&layout, rest);
    let nodes: Vec<Vec<[f32; NUMBERS]>> = (0..places.count())
        .into_par_iter()
        .map(|node| {
            let origin = places.point(node) + Vec3::Z * probes::clearance(places.is_curved());
            let sampler = Sampler::new(0x5c1e, node as u32, 0, RAYS);
            let mut numbers = vec![[0.0; NUMBERS]; solved.lights];
            let mut sums = vec![Vec4::ZERO; solved.vectors];
            for direction in 0..DIRECTIONS {
                sums.fill(Vec4::ZERO);
                for ray in 0..RAYS {
                    let [a, b, ..] = sampler.group(ray, direction as u32);
                    let mut dice = hash(node as u32, direction as u32 * RAYS + ray);
                    let Some(met) = world.follow(origin, towards(direction, a, b), &mut dice) else {
                        continue;
                    };
                    for (sum, radiance) in sums.iter_mut().zip(solved.radiances(met.element, met.faces)) {
                        *sum += *radiance;
                    }
                }
                for (light, numbers) in numbers.iter_mut().enumerate() {
                    let mean = solved.of_light(&sums, light) / RAYS as f32;
                    numbers[3 * direction..][..3].copy_from_slice(&mean.to_array());
                }
            }
            // (Rays do not count lamps that they meet by way of a plate.)
            mirrored.seen(origin, |light, direction, weight| {
                let of = echo::range_of(direction);
                let mean = weight * direction.z / (PI * echo::level_part(of % RISES));
                numbers[light][3 * of..][..3].iter_mut().for_each(|number| *number += mean);
            });
            numbers
        })
        .collect();
    let of_light = |l: usize| nodes.iter().map(|n| n[l]).collect();
    (0..solved.lights).map(|l| Grid::from_values(places.clone(), of_light(l))).collect()
}

/// Whether all colours are alike.
pub fn is_grey(grid: &Grid<NUMBERS>) -> bool {
    let alike = |numbers: &[f32; NUMBERS]| numbers.chunks_exact(3).all(|c| c[0] == c[1] && c[1] == c[2]);
    grid.parts().1.iter().all(alike)
}

/// What of the walls hides behind what rises, at eight places in one direction around: radiance times weight, where weights grow
/// with elevation from 0 on the level to `borders` between the ranges. `from` and `to` are weights.
#[inline(always)]
pub fn hidden(
    numbers: &[Eight; NUMBERS],
    around: usize,
    borders: &[Eight; RISES - 1],
    [from, to]: [Eight; 2],
) -> Vectors {
    let mut sum = Vectors::all(Vec3::ZERO);
    for rise in 0..RISES {
        // Weights of normals that lean away may be below 0 on the level.
        let within = |weight: Eight| {
            let low = if rise > 0 { weight.max(borders[rise - 1]) } else { weight };
            if rise + 1 < RISES { low.min(borders[rise]) } else { low }
        };
        let k = 3 * (around * RISES + rise);
        let radiance = Vectors { x: numbers[k], y: numbers[k + 1], z: numbers[k + 2] };
        sum = sum + radiance.scaled(within(to) - within(from));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hides_is_the_radiance_of_its_direction_and_ranges() {
        let numbers: [Eight; NUMBERS] = std::array::from_fn(|k| Eight::all((k / 3) as f32));
        let borders = [0.1, 0.3, 0.6].map(Eight::all);
        for (around, from, to, truth) in [
            (0, 0.0, 0.05, 0.0),
            (3, 0.1, 0.3, 13.0 * 0.2),
            (3, 0.2, 0.4, 13.0 * 0.1 + 14.0 * 0.1),
            (15, 0.7, 0.8, 63.0 * 0.1),
            (1, -0.1, 0.9, 4.0 * 0.2 + 5.0 * 0.2 + 6.0 * 0.3 + 7.0 * 0.3),
        ] {
            let found = hidden(&numbers, around, &borders, [from, to].map(Eight::all));
            assert!(
                (found.x.0[0] - truth).abs() < 1e-4 && found.x == found.z,
                "{around} {from} {to} {found:?}"
            );
        }
    }
}
