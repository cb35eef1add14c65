//! Direct light without a closed form, tabulated: its vector irradiance over the space of the pad.
//!
//! A rectangle without profile that nothing bends has it in closed form. Anything else is cut into patches, each of
//! which is a polygon of its own with one profile and one transmittance, for every order of reflection in a plate.

use super::grid::{Grid, Layout};
use super::plate::{ORDERS, Slab};
use super::source::{Line, Source};
use super::vector::irradiance;
use glam::{Vec2, Vec3};

/// Patches along and up a light that is cut.
const ALONG: usize = 12;
const UP: usize = 2;

/// Tables of those lights that need one, of radiance 1, the pad hiding nothing.
pub fn direct(
    sources: &[Source],
    slab: Option<&Slab>,
    layout: &Layout,
    rest: impl Fn(Vec2) -> f32 + Sync + Copy,
) -> Vec<Option<Grid<3>>> {
    let table = |source: &Source| {
        (slab.is_some() || source.corners().is_none())
            .then(|| Grid::new(layout, rest, |point| arriving(source, slab, point).to_array()))
    };
    sources.iter().map(table).collect()
}

/// The vector irradiance at a point, of a light of radiance 1.
pub fn arriving(source: &Source, slab: Option<&Slab>, point: Vec3) -> Vec3 {
    if !source.faces(point) {
        return Vec3::ZERO;
    }
    if let (None, Some(corners)) = (slab, source.corners()) {
        return irradiance(&corners.map(|c| c - point));
    }
    let slab = slab.filter(|slab| slab.covers(point) && source.line(0, ALONG, point)[0].z > slab.high);
    let mut sum = Vec3::ZERO;
    let mut before = Points::new(source.line(0, ALONG, point), point, slab);
    for k in 1..=ALONG {
        let now = Points::new(source.line(k, ALONG, point), point, slab);
        for j in 0..UP {
            let corners = [before.at[j], now.at[j], now.at[j + 1], before.at[j + 1]];
            let middle = 0.25 * corners.iter().sum::<Vec3>();
            let profile = source.profile(middle, point);
            let Some(slab) = slab else {
                sum += irradiance(&corners.map(|c| c - point)) * profile;
                continue;
            };
            for (order, (before, now)) in before.seen.iter().zip(&now.seen).enumerate() {
                let transmitted = slab.sighted(point, middle, order).transmitted;
                sum += irradiance(&[before[j], now[j], now[j + 1], before[j + 1]]) * (profile * transmitted);
            }
        }
        before = now;
    }
    sum
}

/// Points of a line of a light.
struct Points {
    at: [Vec3; UP + 1],
    /// Where they are seen through a plate, by order.
    seen: [[Vec3; UP + 1]; ORDERS],
}

impl Points {
    fn new([low, high]: Line, from: Vec3, slab: Option<&Slab>) -> Self {
        let mut points = Self { at: [low; UP + 1], seen: [[Vec3::ZERO; UP + 1]; ORDERS] };
        for (j, at) in points.at.iter_mut().enumerate() {
            *at = low.lerp(high, j as f32 / UP as f32);
        }
        if let Some(slab) = slab {
            for (order, seen) in points.seen.iter_mut().enumerate() {
                for (seen, at) in seen.iter_mut().zip(&points.at) {
                    *seen = slab.sighted(from, *at, order).offset;
                }
            }
        }
        points
    }
}
