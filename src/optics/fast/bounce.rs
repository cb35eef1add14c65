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
    /// Sums of the irradiance, by picture.
    pub lights: &'a [Vec<Vec3>],
    /// Mean albedo of the pad.
    pub albedo: Vec3,
}

/// A cell's means.
#[derive(Debug, Clone, Copy)]
struct Mean {
    position: Vec3,
    normal: Vec3,
}

/// What takes the place of the untouched sensor's light in one direction: the cell that is seen, and how much of the
/// irradiance comes from where the sky and where the ground was.
#[derive(Debug, Clone, Copy)]
struct Risen {
    direction: usize,
    cell: usize,
    of_sky: f32,
    of_ground: f32,
}

impl Cells<'_> {
    fn means(&self) -> Vec<Mean> {
        let mean = |cell: &Cell| Mean {
            position: cell.position / cell.count.max(1.0),
            normal: cell.normal.normalize_or(Vec3::Z),
        };
        self.cells.iter().map(mean).collect()
    }

    /// What the irradiance of each cell is to be multiplied with, by picture. `sky` gives the indirect irradiance of the
    /// untouched sensor in a picture at a place for a normal. What a cell sees is found once for all pictures.
    pub fn gains(&self, sky: impl Fn(usize, Vec3, Vec3) -> Vec3 + Sync) -> Vec<Vec<Vec3>> {
        let ([nx, _], films) = (self.size, self.lights.len());
        let mean = self.means();
        let counted = self.cells.iter().filter(|c| c.count > 0.0).count().max(1) as f32;
        let light: Vec<Vec<Vec3>> = self
            .lights
            .iter()
            .map(|light| light.iter().zip(self.cells).map(|(l, c)| *l / c.count.max(1.0)).collect())
            .collect();
        let reflected = self.albedo * FRAC_1_PI;
        let ground: Vec<Vec3> = light.iter().map(|l| l.iter().sum::<Vec3>() / counted * reflected).collect();
        let highest = mean.iter().zip(self.cells).filter(|(_, c)| c.count > 0.0);
        let highest = highest.fold(f32::NEG_INFINITY, |h, (m, _)| h.max(m.position.z));
        let mut gains = vec![Vec3::ONE; self.cells.len() * films];
        gains.par_chunks_mut(nx * films).enumerate().for_each(|(j, row)| {
            let mut seen = Vec::new();
            for i in 0..nx {
                let Mean { position: p, normal: n } = mean[j * nx + i];
                let flat = n.z > 1.0 - 1e-5 && highest - p.z < EVEN * self.edge_mm;
                if self.cells[j * nx + i].count == 0.0 || flat {
                    continue;
                }
                self.look([i, j], &mean, &mut seen);
                for film in 0..films {
                    let (mut sum, mut last, mut environment) = (Vec3::ZERO, usize::MAX, Vec3::ZERO);
                    for risen in &seen {
                        let radiance = light[film][risen.cell] * reflected;
                        if risen.of_sky != 0.0 && risen.direction != last {
                            let tilted = (ahead(risen.direction) * SKYWARDS.sin()).extend(SKYWARDS.cos());
                            environment = sky(film, p, tilted) * FRAC_1_PI;
                            last = risen.direction;
                        }
                        sum += (radiance - environment) * risen.of_sky
                            + (radiance - ground[film]) * risen.of_ground;
                    }
                    let change = sum * (TAU / DIRECTIONS as f32);
                    let e = light[film][j * nx + i];
                    let most = e * (MOST - 1.0);
                    row[film * nx + i] = Vec3::ONE + change.clamp(-0.9 * e, most) / e.max(Vec3::splat(1e-12));
                }
            }
        });
        let of_film =
            |film: usize| gains.chunks_exact(nx).skip(film).step_by(films).flatten().copied().collect();
        (0..films).map(of_film).collect()
    }

    /// Follows the profile from a cell into all directions; what rises above what was seen before is listed.
    fn look(&self, [i, j]: [usize; 2], mean: &[Mean], seen: &mut Vec<Risen>) {
        let [nx, ny] = self.size;
        let Mean { position: p, normal: n } = mean[j * nx + i];
        seen.clear();
        for direction in 0..DIRECTIONS {
            let ahead = ahead(direction);
            // In the picture y runs downwards, on the pad upwards.
            let steps = Vec2::new(ahead.x, -ahead.y);
            let along = n.truncate().dot(ahead);
            // Elevations as slopes. Below the surface's own plane nothing arrives.
            let mut before = if n.z > 1e-3 { -along / n.z } else { f32::NEG_INFINITY };
            for distance in DISTANCES {
                let q = Vec2::new(i as f32, j as f32) + steps * distance + 0.5;
                if q.x < 0.0 || q.y < 0.0 || q.x >= nx as f32 || q.y >= ny as f32 {
                    break;
                }
                let k = q.y as usize * nx + q.x as usize;
                if self.cells[k].count == 0.0 {
                    break;
                }
                let rise = (mean[k].position.z - p.z) / (distance * self.edge_mm);
                if rise <= before + EVEN {
                    continue;
                }
                let above = before.max(0.0);
                let of_sky = match rise > above {
                    true => weight(rise, along, n.z) - weight(above, along, n.z),
                    false => 0.0,
                };
                let of_ground = match before < 0.0 {
                    true => weight(rise.min(0.0), along, n.z) - weight(before, along, n.z),
                    false => 0.0,
                };
                seen.push(Risen { direction, cell: k, of_sky, of_ground });
                before = rise;
            }
        }
    }
}

/// Tilt of the normal whose irradiance stands for the walls that the pad hides, radians (found by experiment).
const SKYWARDS: f32 = 0.9;

/// A direction looked into.
#[inline(always)]
fn ahead(direction: usize) -> Vec2 {
    Vec2::from_angle((direction as f32 + 0.5) * (TAU / DIRECTIONS as f32))
}

/// Integral of cos(tilt) cos(elevation) up to an elevation of this slope, for a normal with the part `along` ahead and
/// `up` upwards.
#[inline(always)]
fn weight(slope: f32, along: f32, up: f32) -> f32 {
    if slope == f32::NEG_INFINITY {
        return 0.5 * (up - along * FRAC_PI_2);
    }
    let cos2 = 1.0 / (1.0 + slope * slope);
    0.5 * (along * (slope.atan() + slope * cos2) + up * slope * slope * cos2)
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
        let lights = [light.clone(), light.iter().map(|l| *l * 2.0).collect()];
        let all = Cells { size: [nx, ny], edge_mm: edge, cells: &cells, lights: &lights, albedo: Vec3::ONE };
        let (mean, mut seen) = (all.means(), Vec::new());
        // An endless wall of height h at distance d fills (1 - cos(atan(h/d)))/2 of the floor's view.
        for i in [36, 38] {
            let d = -at(40 * nx + i);
            let truth: f32 = 0.5 * (1.0 - d / d.hypot(1.0));
            all.look([i, 40], &mean, &mut seen);
            let sum: f32 = seen.iter().map(|r| light[r.cell].x * (r.of_sky + r.of_ground)).sum();
            let change = sum * FRAC_1_PI * (TAU / DIRECTIONS as f32);
            assert!((change / truth - 1.0).abs() < 0.25, "{d}: {change} {truth}");
        }
        let gains = all.gains(|_, _, _| Vec3::ZERO);
        assert!(gains[0][40 * nx + 38].x > 2.9, "what was dark is bounded");
        assert_eq!(gains[0][40 * nx + 5], Vec3::ONE);
        // Twice the light is twice the change.
        for (a, b) in gains[0].iter().zip(&gains[1]) {
            assert!((*a - *b).abs().max_element() < 1e-5, "{a} {b}");
        }
    }
}
