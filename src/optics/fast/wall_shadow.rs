//! Shadows that a pressed pad throws on the walls: the light that these lose is lost to the pad at their foot.
//!
//! What each patch low on a wall gets straight from each light is worked out once; in every frame the pad's horizons tell how
//! much of the light it hides, as they do for the pad itself. The [`echo`](super::echo) then carries the loss.

use super::echo::Echo;
use super::horizon::Heights;
use super::source::{LINES, Lamp, Source, coarse};
use super::toward::Toward;
use super::world::World;
use glam::Vec3;
use rayon::prelude::*;

/// Patches higher over the face see lights over any press, mm.
const LOW_MM: f32 = 2.0;
/// What is no higher is the face itself, mm.
const OVER_MM: f32 = 0.02;
/// Presses lower than this throw no shadow worth a look, mm.
const LEAST_MM: f32 = 0.3;

/// A patch low on a wall.
#[derive(Debug, Clone, PartialEq)]
pub struct Low {
    /// Of which group of the echo it is.
    pub group: u16,
    pub point: Vec3,
    /// Straight from each light of radiance 1: irradiance times area, mm^2.
    pub power: Vec<f32>,
}

impl Low {
    /// An element of the world, if it is low and a light shines on it.
    pub fn of(world: &World, lamps: &[Lamp], element: usize, group: u16, face_mm: f32) -> Option<Self> {
        let (point, normal) = world.middle(element);
        if !(face_mm + OVER_MM..face_mm + LOW_MM).contains(&point.z) {
            return None;
        }
        let (own, area) = (world.element(element).1, world.area(element));
        let power = |(k, lamp)| area * world.direct(point, normal, own, k, lamp);
        let power: Vec<f32> = lamps.iter().enumerate().map(power).collect();
        power.iter().any(|p| *p > 0.0).then_some(Self { group, point, power })
    }

    /// With this part of it open.
    pub fn uncovered(mut self, part: f32) -> Self {
        self.power.iter_mut().for_each(|power| *power *= part);
        self
    }
}

/// What each group of the echo loses, by light of radiance 1; empty where nothing is hidden.
pub fn losses(echo: &Echo, sources: &[Source], heights: &Heights) -> Vec<Vec<f32>> {
    if echo.low.is_empty() || !heights.rises_above(LEAST_MM) {
        return Vec::new();
    }
    let hidden = |low: &Low| -> Vec<f32> {
        // Behind the pad itself nothing is seen that could be missed.
        if heights.at(low.point.truncate()) > low.point.z {
            return vec![0.0; sources.len()];
        }
        let of = |(source, power): (&Source, &f32)| match *power > 0.0 {
            true => power * hidden(source, low.point, heights),
            false => 0.0,
        };
        sources.iter().zip(&low.power).map(of).collect()
    };
    let parts: Vec<Vec<f32>> = echo.low.par_iter().with_min_len(32).map(hidden).collect();
    let mut losses = vec![vec![0.0; echo.groups]; sources.len()];
    for (low, parts) in echo.low.iter().zip(parts) {
        for (losses, part) in losses.iter_mut().zip(parts) {
            losses[usize::from(low.group)] += part;
        }
    }
    losses
}

/// Whether a press may throw its shadow on a point over the untouched face, mm.
pub fn may_hide(point: Vec3, face_mm: f32, heights: &Heights) -> bool {
    // Behind the pad itself nothing is seen that could be missed.
    (face_mm + OVER_MM..face_mm + LOW_MM).contains(&point.z)
        && heights.rises_above(face_mm + LEAST_MM)
        && heights.at(point.truncate()) <= point.z
}

/// The part of a light that the pad hides from a point.
pub fn hidden(source: &Source, point: Vec3, heights: &Heights) -> f32 {
    let lines = source.seen::<LINES>(point, None);
    let (mut sum, mut count) = (0.0, 0.0);
    for line in lines.iter().step_by(coarse(LINES)) {
        let sight = Toward::new(*line);
        let horizon = sight.horizon(heights, point, false);
        sum += ((horizon - sight.from) / (sight.to - sight.from).max(1e-6)).clamp(0.0, 1.0);
        count += 1.0;
    }
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Light, LightShape};
    use glam::Vec2;

    #[test]
    fn a_ridge_hides_from_a_wall_what_lies_under_its_line_of_sight() {
        // A ridge of 1 mm in the middle of a pad of 20 mm, a light on the one wall from 1 to 3 mm, a point on the other at z: the
        // line over the ridge meets the light's wall at 2 - z.
        let n = 401;
        let at = |k: usize| Vec2::new((k % n) as f32, (k / n) as f32) / (n - 1) as f32 * 20.0 - 10.0;
        let ridge = |p: Vec2| if p.x.abs() < 0.1 { 1.0 } else { 0.0 };
        let positions: Vec<Vec3> = (0..n * n).map(|k| at(k).extend(ridge(at(k)))).collect();
        let heights = Heights::new(&positions, [n, n], 0.05);
        let light = Light {
            name: "left".to_owned(),
            shape: LightShape::Rectangle {
                center: Vec3::new(-9.99, 0.0, 2.0),
                half_u: Vec3::Y * 0.5,
                half_v: Vec3::Z,
            },
            radiance: Vec3::ONE,
            two_sided: false,
            cosine_power: 0.0,
            albedo: Vec3::ZERO,
        };
        let source = Source::new(&light).unwrap();
        for (z, truth) in [(1.5, 0.0), (0.9, 0.05), (0.5, 0.25), (0.2, 0.4)] {
            let seen = hidden(&source, Vec3::new(9.9, 0.0, z), &heights);
            assert!((seen - truth).abs() < 0.03, "{z}: {seen}, {truth}");
        }
    }
}
