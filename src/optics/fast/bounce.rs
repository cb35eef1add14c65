//! What the pressed pad changes in the indirect light: flanks that light what is around them, and hide walls from it.
//!
//! The picture is cut into cells of about a quarter of a millimetre, each with its mean height, normal and irradiance. From
//! each the pad's profile is followed in a few directions: where it rises above what was seen before, its radiance takes
//! the place of what the untouched sensor has there. One bounce, from the light that is there already; what
//! follows is a small part of a small part. (Horizon-based indirect lighting, Bavoil and Sainz 2008, on a coarse raster.)

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Directions looked into.
const DIRECTIONS: usize = 16;
/// Distances looked at, in cells.
const DISTANCES: [f32; 10] = [1.0, 2.0, 3.0, 4.0, 5.5, 7.5, 10.0, 13.0, 17.0, 22.0];
/// Ground this even, up to the farthest distance, needs no look: a slope.
const EVEN: f32 = 4e-3;
/// A cell's light is changed by at most this factor, where next to none was.
const MOST: f32 = 3.0;

/// Means over a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Position, or what adds up to it.
    pub position: Vec3,
    /// Normal, not of length 1.
    pub normal: Vec3,
    /// Pixels counted.
    pub count: f32,
}

/// Nothing counted.
pub const EMPTY: Cell = Cell { position: Vec3::ZERO, normal: Vec3::ZERO, count: 0.0 };

/// The picture's cells.
pub struct Cells<'a> {
    /// Cells along x and y.
    pub size: [usize; 2],
    /// Edge of a cell on the pad, mm.
    pub edge_mm: f32,
    /// Row by row, as sums.
    pub cells: &'a [Cell],
    /// Sums of the irradiance.
    pub light: &'a [Vec3],
    /// Mean albedo of the pad.
    pub albedo: Vec3,
}

/// A cell's means.
#[derive(Debug, Clone, Copy)]
struct Mean {
    position: Vec3,
    normal: Vec3,
    light: Vec3,
}

impl Cells<'_> {
    fn means(&self) -> Vec<Mean> {
        let mean = |(cell, light): (&Cell, &Vec3)| {
            let per = 1.0 / cell.count.max(1.0);
            let normal = cell.normal.normalize_or(Vec3::Z);
            Mean { position: cell.position * per, normal, light: *light * per }
        };
        self.cells.iter().zip(self.light).map(mean).collect()
    }

    /// What the irradiance of each cell is to be multiplied with. `sky` gives the indirect irradiance of the untouched
    /// sensor at a place for a normal.
    pub fn gains(&self, sky: impl Fn(Vec3, Vec3) -> Vec3 + Sync) -> Vec<Vec3> {
        let [nx, _] = self.size;
        let mean = self.means();
        let counted = self.cells.iter().filter(|c| c.count > 0.0).count().max(1) as f32;
        let ground = mean.iter().map(|m| m.light).sum::<Vec3>() / counted * self.albedo * FRAC_1_PI;
        let highest = mean.iter().zip(self.cells).filter(|(_, c)| c.count > 0.0);
        let highest = highest.fold(f32::NEG_INFINITY, |h, (m, _)| h.max(m.position.z));
        let mut gains = vec![Vec3::ONE; self.cells.len()];
        gains.par_chunks_mut(nx).enumerate().for_each(|(j, row)| {
            for (i, gain) in row.iter_mut().enumerate() {
                let Mean { position: p, normal: n, light: e } = mean[j * nx + i];
                let flat = n.z > 1.0 - 1e-5 && highest - p.z < EVEN * self.edge_mm;
                if self.cells[j * nx + i].count == 0.0 || flat {
                    continue;
                }
                let change = self.change([i, j], &mean, ground, &sky);
                let most = e * (MOST - 1.0);
                *gain = Vec3::ONE + change.clamp(-0.9 * e, most) / e.max(Vec3::splat(1e-12));
            }
        });
        gains
    }

    /// The change of a cell's irradiance.
    fn change(
        &self,
        [i, j]: [usize; 2],
        mean: &[Mean],
        ground: Vec3,
        sky: &impl Fn(Vec3, Vec3) -> Vec3,
    ) -> Vec3 {
        let [nx, ny] = self.size;
        let Mean { position: p, normal: n, .. } = mean[j * nx + i];
        let mut sum = Vec3::ZERO;
        for d in 0..DIRECTIONS {
            let phi = (d as f32 + 0.5) * (TAU / DIRECTIONS as f32);
            let ahead = Vec2::from_angle(phi);
            // In the picture y runs downwards, on the pad upwards.
            let steps = Vec2::new(ahead.x, -ahead.y);
            let along = n.truncate().dot(ahead);
            // Below the surface's own plane nothing arrives.
            let mut before = if n.z > 1e-3 { (-along / n.z).atan() } else { -FRAC_PI_2 };
            let mut environment = None;
            for distance in DISTANCES {
                let q = Vec2::new(i as f32, j as f32) + steps * distance;
                let (x, y) = (q.x.round(), q.y.round());
                if x < 0.0 || y < 0.0 || x >= nx as f32 || y >= ny as f32 {
                    break;
                }
                let k = y as usize * nx + x as usize;
                if self.cells[k].count == 0.0 {
                    break;
                }
                let Mean { position: at, light, .. } = mean[k];
                let rise = (at.z - p.z) / (distance * self.edge_mm);
                if rise <= before.tan() + EVEN {
                    continue;
                }
                let elevation = rise.atan();
                let radiance = light * self.albedo * FRAC_1_PI;
                let above = before.max(0.0);
                if elevation > above {
                    let environment = *environment.get_or_insert_with(|| {
                        let tilted = (ahead * SKYWARDS.sin()).extend(SKYWARDS.cos());
                        sky(p, tilted) * FRAC_1_PI
                    });
                    sum += (radiance - environment)
                        * (weight(elevation, along, n.z) - weight(above, along, n.z));
                }
                if before < 0.0 {
                    let top = elevation.min(0.0);
                    sum += (radiance - ground) * (weight(top, along, n.z) - weight(before, along, n.z));
                }
                before = elevation;
            }
        }
        sum * (TAU / DIRECTIONS as f32)
    }
}

/// Tilt of the normal whose irradiance stands for the walls that the pad hides, radians (found by experiment).
const SKYWARDS: f32 = 0.9;

/// Integral of cos(tilt) cos(elevation) up to an elevation, for a normal with the part `along` ahead and `up` upwards.
fn weight(elevation: f32, along: f32, up: f32) -> f32 {
    let (sin, cos) = elevation.sin_cos();
    0.5 * (along * (elevation + sin * cos) + up * sin * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of height 1 along x = 0 before a floor: the floor sees it under a known form factor.
    #[test]
    fn a_step_lights_its_foot_by_its_form_factor() {
        let (nx, ny, edge) = (81, 81, 0.25);
        let at = |k: usize| ((k % nx) as f32 - 40.5) * edge;
        let cells: Vec<Cell> = (0..nx * ny)
            .map(|k| Cell {
                position: Vec3::new(at(k), 0.0, if at(k) > 0.0 { 1.0 } else { 0.0 }),
                normal: Vec3::Z,
                count: 1.0,
            })
            .collect();
        // The plateau shines, the floor is dark, so is the sky.
        let light: Vec<Vec3> =
            (0..nx * ny).map(|k| if at(k) > 0.0 { Vec3::ONE } else { Vec3::splat(1e-3) }).collect();
        let all = Cells { size: [nx, ny], edge_mm: edge, cells: &cells, light: &light, albedo: Vec3::ONE };
        let mean = all.means();
        // An endless wall of height h at distance d fills (1 - cos(atan(h/d)))/2 of the floor's view.
        for i in [36, 38] {
            let d = -at(40 * nx + i);
            let truth: f32 = 0.5 * (1.0 - d / d.hypot(1.0));
            let change = all.change([i, 40], &mean, Vec3::ZERO, &|_, _| Vec3::ZERO).x;
            assert!((change / truth - 1.0).abs() < 0.25, "{d}: {change} {truth}");
        }
        let gains = all.gains(|_, _| Vec3::ZERO);
        assert!(gains[40 * nx + 38].x > 2.9, "what was dark is bounded");
        assert_eq!(gains[40 * nx + 5], Vec3::ONE);
    }
}
