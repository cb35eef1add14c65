//! Direct light without a closed form, tabulated: its vector irradiance over the space of the pad.
//!
//! A rectangle without profile that nothing bends has it in closed form. Anything else is cut into patches, each of
//! which is a polygon of its own with one profile and one transmittance, for every order of reflection in a plate.
//! Near a lamp that changes too much from node to node of a table; but less and less of it is missing from what a few patches give,
//! which are quickly looked at from any place: the tables hold what is missing.

use super::grid::{Grid, Layout};
use super::plate::{ORDERS, Slab};
use super::shade::distance_squared;
use super::source::{Line, Source};
use super::vector::irradiance;
use glam::{Vec2, Vec3};

/// Patches along and up a light that is cut, at least and at most.
const ALONG: [usize; 2] = [12, 24];
const UP: [usize; 2] = [2, 12];
/// Patches that are looked at from every place: of a disc, and of anything else one for so many millimetres along it, at most so many;
/// and so many beyond a plate, where longer lamps have none. Found by experiment: lamps of the size of an LED, 1 to 3 mm away, are 2 to
/// 8 % off in tables of all their light, with profiles 3 to 28 %.
const OF_DISC: usize = 4;
const PATCH_MM: f32 = 2.5;
const MOST_PATCHES: usize = 5;
const MOST_BEYOND: usize = 2;
/// Nearer to a lamp nothing is looked up.
const NEAR_MM: f32 = 1.5;
/// Finest steps of a table over the usual ones.
const FINEST: f32 = 0.4;
/// By how much the logarithm of a profile may change across a patch. Found by experiment: with 0.6 an LED with profile 1 gives 1.9 %
/// too little light a millimetre away, where what arrives of a patch changes across it, too.
const CHANGE: f32 = 0.25;

/// Tables of what is [missing](few) of those lights that need one, of radiance 1, the pad hiding nothing.
pub fn direct(
    sources: &[Source],
    slab: Option<&Slab>,
    layout: &Layout,
    rest: impl Fn(Vec2) -> f32 + Sync + Copy,
) -> Vec<Option<Grid<3>>> {
    let table = |source: &Source| {
        (slab.is_some() || source.corners().is_none()).then(|| {
            let table = Grid::new(&fine(source, layout), rest, |point| {
                (arriving(source, slab, point) - few(source, slab, point)).to_array()
            });
            let is_beyond = slab.is_some_and(|slab| source.stands_beyond(slab));
            if patches(source, is_beyond).is_some() { table } else { table.halved(rest) }
        })
    };
    sources.iter().map(table).collect()
}

/// A layout fine enough for a light's profile: steps go by its width, which is about 1 / sqrt(exponent).
fn fine(source: &Source, layout: &Layout) -> Layout {
    let exponent = source.angular().map_or(0.0, |profile| profile.power());
    let part = (1.0 + 0.5 * exponent).sqrt().recip().max(FINEST);
    Layout { step_mm: part * layout.step_mm, lift_step_mm: part * layout.lift_step_mm, ..*layout }
}

/// The vector irradiance at a point, of a light of radiance 1 with this table.
pub fn looked_up(table: &Grid<3>, source: &Source, slab: Option<&Slab>, point: Vec3) -> Vec3 {
    if slab.is_none() && distance_squared(&source.around(), point) < NEAR_MM * NEAR_MM {
        return arriving(source, None, point);
    }
    Vec3::from(table.at(point)) + few(source, slab, point)
}

/// What a few patches give.
fn few(source: &Source, slab: Option<&Slab>, point: Vec3) -> Vec3 {
    if !source.faces(point) {
        return Vec3::ZERO;
    }
    let slab = beyond(slab, source, point);
    patches(source, slab.is_some()).map_or(Vec3::ZERO, |cuts| of_patches(source, slab, point, cuts, 1))
}

/// How many these are, along and up; none of a long lamp beyond a plate, where each costs more, and what arrives changes less.
fn patches(source: &Source, is_beyond: bool) -> Option<[usize; 2]> {
    let along = match source.length_mm() {
        Some(length_mm) => ((length_mm / PATCH_MM).ceil() as usize).clamp(1, MOST_PATCHES),
        None => OF_DISC,
    };
    let up = if source.angular().is_some() { 2 } else { 1 };
    let is_long = source.length_mm().is_some() && along > MOST_BEYOND;
    (!(is_beyond && is_long)).then_some([along, up])
}

/// The plate that a light is seen through.
fn beyond<'a>(slab: Option<&'a Slab>, source: &Source, point: Vec3) -> Option<&'a Slab> {
    slab.filter(|slab| slab.covers(point) && source.stands_beyond(slab))
}

/// The vector irradiance at a point, of a light of radiance 1.
pub fn arriving(source: &Source, slab: Option<&Slab>, point: Vec3) -> Vec3 {
    if !source.faces(point) {
        return Vec3::ZERO;
    }
    if let (None, Some(corners)) = (slab, source.corners()) {
        return irradiance(&corners.map(|c| c - point));
    }
    let slab = beyond(slab, source, point);
    of_patches(source, slab, point, cuts(source, slab, point), ORDERS)
}

/// That of so many patches along and up the light, by so many orders of reflection in a plate.
fn of_patches(
    source: &Source,
    slab: Option<&Slab>,
    point: Vec3,
    [along, up]: [usize; 2],
    orders: usize,
) -> Vec3 {
    let mut sum = Vec3::ZERO;
    let line = |k: usize| match slab {
        Some(slab) => source.line_beyond(slab, k, along, point),
        None => source.line(k, along, point),
    };
    let points = |k: usize| Points::new(line(k), up, point, slab, orders);
    let mut before = points(0);
    for k in 1..=along {
        let now = points(k);
        for j in 0..up {
            let corners = [before.at[j], now.at[j], now.at[j + 1], before.at[j + 1]];
            let middle = 0.25 * corners.iter().sum::<Vec3>();
            let Some(slab) = slab else {
                sum += irradiance(&corners.map(|c| c - point)) * source.radiance(point - middle);
                continue;
            };
            for (order, (before, now)) in before.seen.iter().zip(&now.seen).take(orders).enumerate() {
                // (Light leaves the lamp along the way by which it arrives, beyond the plate.)
                let sighted = slab.sighted(point, middle, order);
                let arrives = source.radiance(-sighted.offset) * sighted.transmitted;
                sum += irradiance(&[before[j], now[j], now[j + 1], before[j + 1]]) * arrives;
            }
        }
        before = now;
    }
    sum
}

/// How many patches along and up a light has, as seen from a point: the steeper the profile there, the more.
fn cuts(source: &Source, slab: Option<&Slab>, point: Vec3) -> [usize; 2] {
    let Some(profile) = source.angular() else { return [ALONG[0], UP[0]] };
    let [first, middle, last] = [0, 1, 2].map(|k| source.line(k, 2, point));
    let center = 0.5 * (middle[0] + middle[1]);
    // (Through a plate, the part of the way in air: there directions change no less.)
    let away = slab.map_or(center - point, |slab| slab.in_air(point, center));
    let cosine = (profile.along(-away) / away.length().max(1e-12)).clamp(1e-3, 1.0);
    let steepness =
        profile.power() * (1.0 / (cosine * cosine) - 1.0).sqrt() / (CHANGE * away.length().max(1e-12));
    let cut = |extent: Vec3, [least, most]: [usize; 2]| {
        ((steepness * extent.length()).ceil() as usize).clamp(least, most)
    };
    [cut(last[0] - first[0], ALONG), cut(middle[1] - middle[0], UP)]
}

/// Points of a line of a light.
struct Points {
    at: [Vec3; UP[1] + 1],
    /// Where they are seen through a plate, by order.
    seen: [[Vec3; UP[1] + 1]; ORDERS],
}

impl Points {
    /// `up + 1` evenly spread ones; the rest is not used.
    fn new([low, high]: Line, up: usize, from: Vec3, slab: Option<&Slab>, orders: usize) -> Self {
        let mut points = Self { at: [low; UP[1] + 1], seen: [[Vec3::ZERO; UP[1] + 1]; ORDERS] };
        for (j, at) in points.at[..=up].iter_mut().enumerate() {
            *at = low.lerp(high, j as f32 / up as f32);
        }
        if let Some(slab) = slab {
            for (order, seen) in points.seen.iter_mut().take(orders).enumerate() {
                for (seen, at) in seen.iter_mut().zip(&points.at[..=up]) {
                    *seen = slab.sighted(from, *at, order).offset;
                }
            }
        }
        points
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::Lamp;
    use super::*;
    use crate::optics::irradiance::polygon;
    use crate::optics::sampler::Sampler;
    use crate::optics::{Light, LightShape};

    fn white(shape: LightShape, cosine_power: f32) -> Light {
        let (name, radiance, albedo) = ("lamp".to_owned(), Vec3::ONE, Vec3::ZERO);
        Light { name, shape, radiance, two_sided: false, cosine_power, albedo }
    }

    #[test]
    fn a_thick_tube_gives_as_much_light_as_its_facets() {
        let shape =
            LightShape::Tube { from: Vec3::new(-9.0, -8.0, 5.0), to: Vec3::new(-9.0, 8.0, 5.0), radius: 0.8 };
        let facets = shape.tessellate();
        let light = white(shape, 0.0);
        let source = Source::new(&light).unwrap();
        for p in [Vec3::ZERO, Vec3::new(-3.0, 6.0, 0.4), Vec3::new(7.0, -5.0, 0.0), Vec3::new(2.0, 9.5, 0.0)]
        {
            let facet = |k: usize| {
                let [a, b, c] = facets.corners(2 * k);
                polygon(p, Vec3::Z, &[a, b, c, a + c - b])
            };
            let truth: f32 = (0..facets.triangles.len() / 2).map(facet).sum();
            let found = arriving(&source, None, p).z;
            assert!((found / truth - 1.0).abs() < 6e-3, "{p}: {found} {truth}");
        }
    }

    #[test]
    fn a_tube_with_a_profile_gives_as_much_light_as_places_all_over_it() {
        let from = Vec3::new(-9.0, -4.0, 5.0);
        // (The last is as short as it is thick, so that most of it is its ends. It is looked at from 1 mm off its axis, too.)
        let far = [Vec3::ZERO, Vec3::new(-6.0, 6.0, 0.4), Vec3::new(7.0, -5.0, 0.0)];
        let near = [far[0], far[1], far[2], Vec3::new(-8.2, -3.8, 4.4), Vec3::new(-8.4, -3.2, 4.2)];
        for (to, radius, from_where) in [
            (Vec3::new(-9.0, 6.0, 5.0), 0.2, &far[..]),
            (Vec3::new(-9.0, -3.0, 9.0), 0.5, &far[..]),
            (from + Vec3::Y * 0.4, 0.2, &near[..]),
        ] {
            for power in [0.0, 0.5, 1.0, 4.0] {
                let light = white(LightShape::Tube { from, to, radius }, power);
                let lamp = Lamp::new(&light).unwrap();
                let places = 1 << 14;
                let sampler = Sampler::new(1, 2, 3, places);
                for p in from_where {
                    let of_place = |i| {
                        let [a, b, ..] = sampler.group(i, 0);
                        let (place, normal, area) = lamp.place([a, b]);
                        let to = place - *p;
                        let cos = -to.dot(normal) / to.length();
                        lamp.radiance(cos) * cos.max(0.0) * to.z / to.length().powi(3) * area
                    };
                    let truth = (0..places).map(of_place).sum::<f32>() / places as f32;
                    let found = arriving(&lamp.source, None, *p).z;
                    assert!((found / truth - 1.0).abs() < 0.015, "{power} {radius} {p}: {found} {truth}");
                }
            }
        }
    }

    #[test]
    fn a_lamp_with_a_profile_beyond_a_plate_gives_as_much_light_as_places_all_over_it() {
        // A thick plate, just below the lamps: light leaves them far from where they are.
        let slab = Slab { low: 0.5, high: 3.5, ior: 1.49 };
        let (center, half_u) = (Vec3::new(-9.0, 1.0, 5.0), Vec3::Y * 4.0);
        let shapes = [
            LightShape::Rectangle { center, half_u, half_v: Vec3::Z },
            LightShape::Tube { from: center - half_u, to: center + half_u, radius: 0.2 },
        ];
        for (shape, power) in shapes.into_iter().flat_map(|shape| [(shape.clone(), 1.0), (shape, 4.0)]) {
            let light = white(shape, power);
            let lamp = Lamp::new(&light).unwrap();
            let places = 1 << 14;
            let sampler = Sampler::new(1, 2, 3, places);
            for p in [Vec3::ZERO, Vec3::new(-6.0, 6.0, 0.4), Vec3::new(7.0, -5.0, 0.0)] {
                let of_place = |i| {
                    let [a, b, ..] = sampler.group(i, 0);
                    let (place, normal, area) = lamp.place([a, b]);
                    let by_order = (0..ORDERS).map(|order| {
                        let way = slab.way(p, place, order);
                        let cos = way.leaves.dot(normal).max(0.0);
                        way.part * lamp.radiance(cos) * cos * way.angle_per_mm2 * way.appears.z
                    });
                    by_order.sum::<f32>() * area
                };
                let truth = (0..places).map(of_place).sum::<f32>() / places as f32;
                let found = arriving(&lamp.source, Some(&slab), p).z;
                assert!((found / truth - 1.0).abs() < 0.015, "{power} {p}: {found} {truth}");
            }
        }
    }

    #[test]
    fn what_is_looked_up_near_a_lamp_is_what_arrives() {
        let layout = Layout {
            across: [Vec2::new(-9.95, -3.0), Vec2::new(0.0, 3.0)],
            step_mm: 0.5,
            lift_mm: [-0.5, 1.0],
            lift_step_mm: 0.5,
        };
        let plate = Slab { low: 1.5, high: 3.5, ior: 1.49 };
        for slab in [None, Some(&plate)] {
            let z = if slab.is_some() { 4.4 } else { 1.4 };
            let center = Vec3::new(-10.0, 0.2, z);
            let disc = LightShape::Disc { center, normal: Vec3::X, radius: 0.5 };
            let led = LightShape::Rectangle { center, half_u: Vec3::Y * 0.7, half_v: Vec3::Z * 0.5 };
            let axis = Vec3::new(0.5, 0.2, 0.0);
            let tube = LightShape::Tube { from: center + axis, to: center + axis.with_y(-0.2), radius: 0.2 };
            for (shape, power) in [(disc, 0.0), (led, 1.0), (tube, 4.0)] {
                let name = format!("{shape:?}");
                let light = white(shape, power);
                let source = Source::new(&light).unwrap();
                let table = &direct(std::slice::from_ref(&source), slab, &layout, |_| 0.0)[0];
                let table = table.as_ref().expect("no closed form");
                let (mut wrong, mut all) = (0.0, 0.0);
                for k in 0..400 {
                    let part = |axis| f64::from(crate::optics::sampler::hash(axis, k)) / f64::from(u32::MAX);
                    let [a, b, c] = [1, 2, 3].map(part).map(|part| part as f32);
                    let p = Vec3::new(-9.2 + 4.0 * a, 5.0 * b - 2.5, 0.6 * c);
                    let truth = arriving(&source, slab, p);
                    wrong += (looked_up(table, &source, slab, p) - truth).length_squared();
                    all += truth.length_squared();
                }
                let off = (wrong / all).sqrt();
                assert!(off < 0.004, "{name}, plate {}: {off}", slab.is_some());
            }
        }
    }
}
