//! Indirect irradiance above the untouched face, as a function of place and normal.
//!
//! At each node of a grid the radiance that arrives from everywhere is gathered once; the irradiance of a surface of any
//! normal is then fitted by a quadratic polynomial in the normal (the span of spherical harmonics up to order 2, which
//! hold all but 1 % of any irradiance: Ramamoorthi and Hanrahan 2001), best for the normals that pads have.

use super::grid::{Grid, Layout, Places};
use super::lanes::{Eight, Vectors};
use super::mirrored::Mirrored;
use super::radiosity::Radiosity;
use super::world::World;
use crate::optics::sampler::hash;
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Terms of the polynomial.
pub const TERMS: usize = 9;
/// Numbers a node holds: terms of three colours.
pub const NUMBERS: usize = 3 * TERMS;
/// Rays gathered at a node.
const RAYS: usize = 2048;
/// Steepest normals of the fit, and at which tilt their weight has fallen to a half for an even and a curved face, radians.
const STEEPEST: f64 = 1.25;
const HALF_WEIGHT: [f64; 2] = [0.35, 1.0];
/// How far above an even and a curved untouched face the lowest nodes are, mm: heights of a curved one are known by cells.
const CLEARANCE_MM: [f32; 2] = [2e-3, 0.06];

/// The polynomial's terms.
#[inline(always)]
fn terms(n: Vec3) -> [f32; TERMS] {
    [1.0, n.x, n.y, n.z, n.x * n.y, n.y * n.z, n.z * n.x, n.x * n.x - n.y * n.y, 3.0 * n.z * n.z - 1.0]
}

/// All terms but the first, which is 1, of eight normals.
#[inline(always)]
pub fn terms_of(n: Vectors) -> [Eight; TERMS - 1] {
    let three = Eight::all(3.0);
    [
        n.x,
        n.y,
        n.z,
        n.x * n.y,
        n.y * n.z,
        n.z * n.x,
        n.x * n.x - n.y * n.y,
        three * n.z * n.z - Eight::all(1.0),
    ]
}

/// The irradiance of a normal from a node's numbers.
pub fn irradiance(numbers: &[f32; NUMBERS], n: Vec3) -> Vec3 {
    let e = irradiance_of(&numbers.map(Eight::all), n);
    Vec3::new(e.x.0[0], e.y.0[0], e.z.0[0])
}

/// The irradiance of one normal at eight places, from their numbers.
#[inline(always)]
pub fn irradiance_of(numbers: &[Eight; NUMBERS], n: Vec3) -> Vectors {
    let zero = Eight::all(0.0);
    let e = change_of(numbers, n);
    Vectors { x: e.x.max(zero), y: e.y.max(zero), z: e.z.max(zero) }
}

/// What a node's numbers tell for a normal, where they are a change and may be below 0.
pub fn change(numbers: &[f32; NUMBERS], n: Vec3) -> Vec3 {
    let t = terms(n);
    let sum = |c: usize| (0..TERMS).map(|k| numbers[3 * k + c] * t[k]).sum::<f32>();
    Vec3::new(sum(0), sum(1), sum(2))
}

#[inline(always)]
fn change_of(numbers: &[Eight; NUMBERS], n: Vec3) -> Vectors {
    let t = terms(n);
    let mut e = [Eight::all(0.0); 3];
    for k in 0..NUMBERS {
        e[k % 3] = e[k % 3] + numbers[k] * Eight::all(t[k / 3]);
    }
    let [x, y, z] = e;
    Vectors { x, y, z }
}

/// Gathers the field over a rectangle, for each light of radiance 1.
pub fn gather(
    world: &World,
    mirrored: &Mirrored<'_>,
    solved: &Radiosity,
    layout: &Layout,
    rest: impl Fn(Vec2) -> f32 + Sync,
) -> Vec<Grid<NUMBERS>> {
    let places = Places::new(layout, rest);
    let fit = Fit::new(places.is_curved());
    let (directions, kernel) = fit.looks();
    let nodes: Vec<Vec<[f32; NUMBERS]>> = (0..places.count())
        .into_par_iter()
        .map(|node| {
            let origin = places.point(node) + Vec3::Z * clearance(places.is_curved());
            let mut numbers = vec![[0.0; NUMBERS]; solved.lights];
            // By term.
            let mut sums = vec![Vec4::ZERO; TERMS * solved.vectors];
            for (k, (direction, weights)) in directions.iter().zip(&kernel).enumerate() {
                let mut dice = hash(node as u32, k as u32);
                // (A light itself is direct light, and mirrored it is looked at below.)
                let Some(met) = world.follow(origin, *direction, &mut dice) else { continue };
                let radiances = solved.radiances(met.element, met.faces);
                for (sums, weight) in sums.chunks_exact_mut(radiances.len()).zip(weights) {
                    for (sum, radiance) in sums.iter_mut().zip(radiances) {
                        *sum += *radiance * *weight;
                    }
                }
            }
            mirrored.seen(origin, |light, direction, weight| {
                let weights = fit.weights(direction);
                for (k, number) in numbers[light].iter_mut().enumerate() {
                    *number += weights[k / 3] * weight;
                }
            });
            for (light, numbers) in numbers.iter_mut().enumerate() {
                for term in 0..TERMS {
                    let sum = solved.of_light(&sums[term * solved.vectors..], light);
                    for colour in 0..3 {
                        numbers[3 * term + colour] += sum[colour];
                    }
                }
            }
            numbers
        })
        .collect();
    let of_light = |l: usize| nodes.iter().map(|n| n[l]).collect();
    (0..solved.lights).map(|l| Grid::from_values(places.clone(), of_light(l))).collect()
}

/// The field of all lights together; colours come in turns.
pub fn total<const N: usize>(grids: &[Grid<N>], radiances: &[Vec3]) -> Grid<N> {
    let (places, values) = grids[0].parts();
    let mut sum = vec![[0.0; N]; values.len()];
    for (grid, radiance) in grids.iter().zip(radiances) {
        for (sum, numbers) in sum.iter_mut().zip(grid.parts().1) {
            for (k, (sum, number)) in sum.iter_mut().zip(numbers).enumerate() {
                *sum += number * radiance[k % 3];
            }
        }
    }
    Grid::from_values(places.clone(), sum)
}

/// One number for three colours; None where they differ.
pub fn grey(grid: &Grid<NUMBERS>) -> Option<Grid<TERMS>> {
    let (places, values) = grid.parts();
    let same = |n: &[f32; NUMBERS]| n.chunks_exact(3).all(|c| c[0] == c[1] && c[1] == c[2]);
    let one = |n: &[f32; NUMBERS]| std::array::from_fn(|k| n[3 * k]);
    values.iter().all(same).then(|| Grid::from_values(places.clone(), values.iter().map(one).collect()))
}

/// Directions to look into, and what radiance 1 from each adds to each term.
pub fn looks(curved: bool) -> (Vec<Vec3>, Vec<[f32; TERMS]>) {
    Fit::new(curved).looks()
}

/// What radiance over solid angle from a direction adds to each term.
pub fn by_direction(curved: bool) -> impl Fn(Vec3) -> [f32; TERMS] + Sync {
    let fit = Fit::new(curved);
    move |direction| fit.weights(direction)
}

/// How far above the untouched face the lowest nodes are, mm.
pub fn clearance(curved: bool) -> f32 {
    CLEARANCE_MM[usize::from(curved)]
}

/// Evenly spread directions (the Fibonacci lattice).
fn sphere(n: usize) -> Vec<Vec3> {
    let golden = std::f64::consts::TAU * 0.618_033_988_749_894_9;
    (0..n)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let (r, phi) = ((1.0 - z * z).sqrt(), golden * i as f64);
            DVec3::new(r * phi.cos(), r * phi.sin(), z).as_vec3()
        })
        .collect()
}

/// The least-squares fit, worked out once: what a normal's irradiance adds to each term.
struct Fit {
    by_normal: Vec<(Vec3, [f64; TERMS])>,
}

impl Fit {
    /// Of the normals that even or curved pads have.
    fn new(curved: bool) -> Self {
        let half_weight = HALF_WEIGHT[usize::from(curved)];
        let mut normals = vec![(Vec3::Z, 1.0)];
        for ring in 1..=8 {
            let tilt = STEEPEST * f64::from(ring) / 8.0;
            let weight = 1.0 / (1.0 + (tilt / half_weight).powi(2));
            for k in 0..12 {
                let phi = std::f64::consts::TAU * (f64::from(k) + 0.5 * f64::from(ring % 2)) / 12.0;
                let n = DVec3::new(tilt.sin() * phi.cos(), tilt.sin() * phi.sin(), tilt.cos());
                normals.push((n.as_vec3(), weight));
            }
        }
        // (sum w t t^T) c = sum w t E(n): the matrix is inverted, the right side is linear in the radiances.
        let mut matrix = [[0.0f64; TERMS]; TERMS];
        for (n, w) in &normals {
            let t = terms(*n);
            for a in 0..TERMS {
                for b in 0..TERMS {
                    matrix[a][b] += w * f64::from(t[a]) * f64::from(t[b]);
                }
            }
        }
        let inverse = invert(matrix);
        let row = |n: Vec3, w: f64| {
            let t = terms(n);
            std::array::from_fn(|a| w * (0..TERMS).map(|b| inverse[a][b] * f64::from(t[b])).sum::<f64>())
        };
        Self { by_normal: normals.into_iter().map(|(n, w)| (n, row(n, w))).collect() }
    }

    /// Evenly spread directions, and what radiance 1 from each adds to each term.
    fn looks(&self) -> (Vec<Vec3>, Vec<[f32; TERMS]>) {
        let directions = sphere(RAYS);
        let solid_angle = (4.0 * std::f64::consts::PI / directions.len() as f64) as f32;
        let kernel = directions.iter().map(|d| self.weights(*d).map(|w| w * solid_angle)).collect();
        (directions, kernel)
    }

    /// What radiance over solid angle from a direction adds to each term.
    fn weights(&self, d: Vec3) -> [f32; TERMS] {
        let mut out = [0.0; TERMS];
        for (n, row) in &self.by_normal {
            let cos = f64::from(n.dot(d).max(0.0));
            for a in 0..TERMS {
                out[a] += row[a] * cos;
            }
        }
        // Exact for the untouched face, which most of a picture shows.
        let upright = terms(Vec3::Z);
        let fitted: f64 = (0..TERMS).map(|a| out[a] * f64::from(upright[a])).sum();
        out[0] += f64::from(d.z.max(0.0)) - fitted;
        out.map(|v| v as f32)
    }
}

/// Gauss and Jordan with pivots; the matrix of the fit is positive definite.
fn invert(mut m: [[f64; TERMS]; TERMS]) -> [[f64; TERMS]; TERMS] {
    let mut inverse: [[f64; TERMS]; TERMS] =
        std::array::from_fn(|a| std::array::from_fn(|b| if a == b { 1.0 } else { 0.0 }));
    for k in 0..TERMS {
        let pivot = (k..TERMS).max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs())).unwrap_or(k);
        m.swap(k, pivot);
        inverse.swap(k, pivot);
        let scale = 1.0 / m[k][k];
        for b in 0..TERMS {
            m[k][b] *= scale;
            inverse[k][b] *= scale;
        }
        for a in (0..TERMS).filter(|&a| a != k) {
            let factor = m[a][k];
            for b in 0..TERMS {
                m[a][b] -= factor * m[k][b];
                inverse[a][b] -= factor * inverse[k][b];
            }
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_sky_is_fitted_to_a_hundredth() {
        // L = 1 + d.y + d.z/2 over the whole sphere: E = pi + (2 pi/3) (n.y + n.z/2).
        let (directions, kernel) = looks(false);
        let mut numbers = [0.0; NUMBERS];
        for (d, w) in directions.iter().zip(&kernel) {
            for k in 0..TERMS {
                for c in 0..3 {
                    numbers[3 * k + c] += w[k] * (1.0 + d.y + 0.5 * d.z);
                }
            }
        }
        for n in [Vec3::Z, Vec3::new(0.3, 0.4, 0.8), Vec3::new(-0.5, -0.1, 0.6)] {
            let n = n.normalize();
            let truth = std::f32::consts::PI * (1.0 + 2.0 / 3.0 * (n.y + 0.5 * n.z));
            let e = irradiance(&numbers, n);
            assert!((e.x / truth - 1.0).abs() < 0.002 && e.x == e.y, "{n} {e} {truth}");
        }
    }
}
