//! Direct light tabulated: the vector irradiance of every light over the space of the pad.

use super::grid::{Grid, Layout};
use super::horizon::Panel;
use super::vector::irradiance;
use glam::Vec2;

/// Lights that share a table.
pub const LIGHTS_A_TABLE: usize = 4;
/// Three components of each of them.
pub const NUMBERS: usize = 3 * LIGHTS_A_TABLE;

/// Tables of all lights, nothing hidden.
pub fn direct(
    panels: &[Panel],
    layout: &Layout,
    rest: impl Fn(Vec2) -> f32 + Sync + Copy,
) -> Vec<Grid<NUMBERS>> {
    panels
        .chunks(LIGHTS_A_TABLE)
        .map(|group| {
            Grid::new(layout, rest, |point| {
                let mut values = [0.0; NUMBERS];
                for (k, panel) in group.iter().enumerate() {
                    if panel.faces(point) {
                        let phi = irradiance(&panel.corners.map(|c| c - point));
                        values[3 * k..3 * k + 3].copy_from_slice(&phi.to_array());
                    }
                }
                values
            })
        })
        .collect()
}
