//! Direct light without a closed form, tabulated: its vector irradiance over the space of the pad.
//!
//! A rectangle without profile that nothing bends has it in closed form. Anything else is cut into patches, each of
//! which is a polygon of its own with one profile and one transmittance, for every order of reflection in a plate.

use super::grid::{Grid, Layout};
use super::plate::Slab;
use super::source::Source;
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
    let mut sum = Vec3::ZERO;
    let mut before = source.line(0, ALONG, point);
    for k in 1..=ALONG {
        let line = source.line(k, ALONG, point);
        for j in 0..UP {
            let up = |[low, high]: [Vec3; 2], j: usize| low.lerp(high, j as f32 / UP as f32);
            let corners = [up(before, j), up(line, j), up(line, j + 1), up(before, j + 1)];
            let middle = 0.25 * corners.iter().sum::<Vec3>();
            let profile = source.profile(middle, point);
            match slab.filter(|slab| slab.covers(point) && middle.z > slab.high) {
                Some(slab) => {
                    for order in Slab::orders() {
                        let transmitted = slab.sighted(point, middle, order).transmitted;
                        let seen = corners.map(|c| slab.sighted(point, c, order).offset);
                        sum += irradiance(&seen) * (profile * transmitted);
                    }
                }
                None => sum += irradiance(&corners.map(|c| c - point)) * profile,
            }
        }
        before = line;
    }
    sum
}
