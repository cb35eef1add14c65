//! How much of a lamp's radiance arrives from a direction: what its profile sends there, and what a plate before it lets through.
//!
//! Behind a plate directions are those before it, so that both are told by where the lamp appears.

use super::lanes::{Eight, Vectors, WIDTH};
use super::plate::Slab;
use super::profile::Profile;
use super::source::{Line, MOST_LINES, Source};
use super::vector::edges;
use glam::Vec3;

/// Of a lamp from whose parts not the same arrives.
#[derive(Debug, Clone, Copy)]
pub struct Arrival {
    profile: Option<Profile>,
    /// Index of refraction of the plate.
    ior: Option<f32>,
}

impl Arrival {
    /// None where from everywhere on the lamp the same arrives.
    pub fn of(source: &Source, slab: Option<&Slab>) -> Option<Self> {
        let arrival = Self {
            profile: source.angular(),
            ior: slab.filter(|slab| source.stands_beyond(slab)).map(|slab| slab.ior),
        };
        (arrival.profile.is_some() || arrival.ior.is_some()).then_some(arrival)
    }

    /// Part that arrives from each of eight directions, unit vectors towards the lamp.
    #[inline(always)]
    pub fn part(&self, towards: Vectors) -> Eight {
        let sent = self.profile.map(|profile| profile.seen(towards));
        let passed = self.ior.map(|ior| passed(towards.z, ior));
        match (sent, passed) {
            (Some(sent), Some(passed)) => sent * passed,
            (sent, passed) => sent.or(passed).unwrap_or(Eight::all(1.0)),
        }
    }

    /// Vector irradiance of a lamp that appears by these lines, eight strips of it each with what arrives from its middle.
    pub fn of_lines<const N: usize>(&self, lines: &[Line; N]) -> Vec3 {
        const { assert!((N - 1).is_multiple_of(WIDTH) && N <= MOST_LINES) };
        let end = |of: usize, end: usize| {
            let mut ends = Vectors::all(Vec3::ZERO);
            for k in 0..WIDTH {
                let [x, y, z] = lines[(k + of) * ((N - 1) / WIDTH)][end].to_array();
                (ends.x.0[k], ends.y.0[k], ends.z.0[k]) = (x, y, z);
            }
            ends.unit()
        };
        let (lows, highs) = ([end(0, 0), end(1, 0)], [end(0, 1), end(1, 1)]);
        let around = edges(lows[0], lows[1])
            + edges(lows[1], highs[1])
            + edges(highs[1], highs[0])
            + edges(highs[0], lows[0]);
        let middle = (lows[0] + lows[1] + highs[0] + highs[1]).unit();
        let strips = around.scaled(self.part(middle));
        -0.5 * Vec3::from_array([strips.x, strips.y, strips.z].map(|e| e.0.iter().sum()))
    }
}

/// What a plate lets through of light at these cosines to its faces, all inner reflections together (Fresnel).
#[inline(always)]
fn passed(cos: Eight, ior: f32) -> Eight {
    let (zero, one, n) = (Eight::all(0.0), Eight::all(1.0), Eight::all(ior));
    let cos = cos.max(zero).min(one);
    let inside = (one - (one - cos * cos) * Eight::all(1.0 / (ior * ior))).max(zero).sqrt();
    let parallel = (n * cos - inside).over(n * cos + inside);
    let across = (cos - n * inside).over(cos + n * inside);
    let face = (parallel * parallel + across * across) * Eight::all(0.5);
    (one - face).over(one + face)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Light, LightShape};

    #[test]
    fn a_plate_lets_as_much_through_as_it_does_of_a_ray() {
        let slab = Slab { low: 1.0, high: 2.0, ior: 1.49 };
        let cosines = [1.0, 0.9, 0.7, 0.5, 0.3, 0.1, 0.01, 0.0f32];
        for (cos, found) in cosines.into_iter().zip(passed(Eight(cosines), slab.ior).0) {
            let truth = slab.transmitted(Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos));
            assert!((found - truth).abs() < 1e-6, "{cos}: {found} {truth}");
        }
    }

    #[test]
    fn strips_give_what_arrives_of_the_whole_lamp() {
        let slab = Slab { low: 1.5, high: 3.5, ior: 1.49 };
        let shape = LightShape::Rectangle {
            center: Vec3::new(-9.7, 1.5, 4.7),
            half_u: Vec3::Y * 5.0,
            half_v: Vec3::Z * 0.2,
        };
        for power in [0.0, 1.0, 4.0] {
            let light = Light {
                name: "lamp".to_owned(),
                shape: shape.clone(),
                radiance: Vec3::ONE,
                two_sided: false,
                cosine_power: power,
                albedo: Vec3::ZERO,
            };
            let source = Source::new(&light).unwrap();
            for slab in [None, Some(&slab)] {
                let Some(arrival) = Arrival::of(&source, slab) else {
                    assert!(power == 0.0 && slab.is_none());
                    continue;
                };
                for p in [Vec3::new(-5.0, 0.0, 0.0), Vec3::new(0.0, -4.0, 0.3), Vec3::new(8.0, 6.0, 0.0)] {
                    let found = arrival.of_lines(&source.seen::<17>(p, slab));
                    let truth = super::super::tables::arriving(&source, slab, p);
                    // (Inner reflections arrive from elsewhere than where the lamp appears: what they add counts as if from there.)
                    let bound = if slab.is_some() { 0.05 } else { 0.01 };
                    assert!(
                        (found - truth).length() < bound * truth.length(),
                        "{power} {p}: {found} {truth}"
                    );
                }
            }
        }
    }
}
