//! How far the face of a bonded layer gives way under a pressure on it, wave by wave.

use super::body::Body;
use rayon::prelude::*;
use rustfft::{Fft, FftPlanner, num_complex::Complex};
use std::sync::Arc;

/// Beyond so many radians through the depth a layer is as good as a half-space, and below so many as one that is pressed
/// everywhere.
const DEEP: f64 = 20.0;
/// See [`DEEP`].
const SHALLOW: f64 = 1e-2;
/// How much stiffer than the layer the shortest waves on a lattice are: by exp(`EDGE` (2 - cos(kx s) - cos(ky s))) for points
/// s apart. Without it a punch that ends half-way between two points is too small by a quarter of s on every side, with it by
/// nothing (found by experiment: squares of 41 and 123 points).
const EDGE: f64 = 0.35;
/// How fast a coating takes over from the bulk as waves become shorter: the part of the bulk falls as
/// exp(-2 `TAKES_OVER` k t) (after King 1987, "Elastic analysis of some punch problems for a layered medium", whose weights
/// for punches of size 1/k these follow).
const TAKES_OVER: f64 = 0.65;

/// Pressures on a lattice to the displacements of the same points; nothing presses beside it.
pub struct Compliance {
    /// Points along x and y.
    size: [usize; 2],
    /// The same with as many again, so that nothing is felt around the corner.
    padded: [usize; 2],
    /// mm per MPa of each wave, over the number of padded points; rows are waves along x.
    of_wave: Vec<f32>,
    forward: [Arc<dyn Fft<f32>>; 2],
    back: [Arc<dyn Fft<f32>>; 2],
    /// Rows along y of each point along x, and its turned copy.
    field: Vec<Complex<f32>>,
    turned: Vec<Complex<f32>>,
}

/// mm per MPa of a wave of `k` radians a mm on the face of a layer bonded to a rigid base (Hayes et al. 1972, "A mathematical
/// analysis for indentation tests of articular cartilage").
fn of_layer(k: f64, youngs_modulus_mpa: f64, poisson_ratio: f64, thickness_mm: f64) -> f64 {
    let (a, q) = (3.0 - 4.0 * poisson_ratio, k * thickness_mm);
    let half_space = 2.0 * (1.0 - poisson_ratio * poisson_ratio) / youngs_modulus_mpa;
    if q < SHALLOW {
        return half_space * thickness_mm * (1.0 - 2.0 * poisson_ratio)
            / (2.0 * (1.0 - poisson_ratio).powi(2));
    }
    let bonded = if q > DEEP {
        1.0
    } else {
        (a * (2.0 * q).sinh() - 2.0 * q) / (a * (2.0 * q).cosh() + 2.0 * q * q + 0.5 * (1.0 + a * a))
    };
    half_space / k * bonded
}

/// The next number without prime factors above 5: transforms of so many points are quick.
fn quick(n: usize) -> usize {
    let rest = |n: usize| {
        [2, 3, 5].iter().fold(n, |mut n, p| {
            while n % p == 0 {
                n /= p;
            }
            n
        })
    };
    (n..).find(|n| rest(*n) == 1).unwrap_or(n)
}

impl Compliance {
    /// That of a pad, on a lattice of `size` points `spacing_mm` apart.
    pub fn new(body: &Body, size: [usize; 2], spacing_mm: [f64; 2]) -> Self {
        let padded = size.map(|n| quick(2 * n));
        let mut planner = FftPlanner::new();
        // Radians a mm, and what is left of the compliance.
        let waves = [0, 1].map(|axis| {
            let n = padded[axis];
            let wave = |i: usize| {
                let turn = 2.0 * std::f64::consts::PI * i.min(n - i) as f64 / n as f64;
                (turn / spacing_mm[axis], (EDGE * (turn.cos() - 1.0)).exp())
            };
            (0..n).map(wave).collect::<Vec<_>>()
        });
        let material = &body.material;
        let per_mpa = |k: f64| {
            let bulk = of_layer(k, material.youngs_modulus_mpa, material.poisson_ratio, body.size_mm[2]);
            body.coating.as_ref().map_or(bulk, |c| {
                let coated = of_layer(k, c.youngs_modulus_mpa, c.poisson_ratio, body.size_mm[2]);
                let part = (-2.0 * TAKES_OVER * k * c.thickness_mm).exp();
                part * bulk + (1.0 - part) * coated
            })
        };
        let count = (padded[0] * padded[1]) as f64;
        let of_wave = (0..padded[0] * padded[1])
            .map(|at| (waves[0][at / padded[1]], waves[1][at % padded[1]]))
            .map(|((kx, left_x), (ky, left_y))| (per_mpa(kx.hypot(ky)) * left_x * left_y / count) as f32)
            .collect();
        Self {
            size,
            padded,
            of_wave,
            forward: padded.map(|n| planner.plan_fft_forward(n)),
            back: padded.map(|n| planner.plan_fft_inverse(n)),
            field: vec![Complex::default(); padded[0] * size[1]],
            turned: vec![Complex::default(); padded[0] * padded[1]],
        }
    }

    /// The most that a wave gives way, mm per MPa.
    pub fn largest(&self) -> f32 {
        let count = (self.padded[0] * self.padded[1]) as f32;
        count * self.of_wave.iter().fold(0.0f32, |most, c| most.max(*c))
    }

    /// How far a point gives way under a pressure on it alone, mm per MPa.
    pub fn own(&self) -> f32 {
        self.of_wave.iter().sum()
    }

    /// Displacements under pressures, mm and MPa, x running fastest; along the pressure.
    pub fn displacement(&mut self, pressure: &[f32], out: &mut [f32]) {
        let ([nx, ny], [px, py]) = (self.size, self.padded);
        let Self { of_wave, forward, back, field, turned, .. } = self;
        field.par_chunks_exact_mut(px).zip(pressure.par_chunks_exact(nx)).for_each(|(row, given)| {
            for (to, from) in row.iter_mut().zip(given) {
                *to = Complex::new(*from, 0.0);
            }
            row[nx..].fill(Complex::default());
            forward[0].process(row);
        });
        turned.par_chunks_exact_mut(py).zip(of_wave.par_chunks_exact(py)).enumerate().for_each(
            |(i, (row, of_wave))| {
                for (j, to) in row[..ny].iter_mut().enumerate() {
                    *to = field[j * px + i];
                }
                row[ny..].fill(Complex::default());
                forward[1].process(row);
                for (value, of_wave) in row.iter_mut().zip(of_wave) {
                    *value *= *of_wave;
                }
                back[1].process(row);
            },
        );
        field.par_chunks_exact_mut(px).zip(out.par_chunks_exact_mut(nx)).enumerate().for_each(
            |(j, (row, out))| {
                for (i, to) in row.iter_mut().enumerate() {
                    *to = turned[i * py + j];
                }
                back[0].process(row);
                for (to, from) in out.iter_mut().zip(row) {
                    *to = from.re;
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_waves_press_a_layer_together_and_short_ones_a_half_space() {
        let (e, nu, h) = (0.145, 0.45, 4.0);
        let together = (1.0 + nu) * (1.0 - 2.0 * nu) / (e * (1.0 - nu)) * h;
        for k in [0.0, 1e-3, 4e-3] {
            assert!((of_layer(k, e, nu, h) / together - 1.0).abs() < 1e-3, "{k}");
        }
        // (The second is less than a hundredth of a percent from the first where one takes over from the other.)
        for k in [3.0, 6.0] {
            assert!((of_layer(k, e, nu, h) * k * e / (2.0 * (1.0 - nu * nu)) - 1.0).abs() < 1e-4, "{k}");
        }
    }

    #[test]
    fn a_thin_coating_is_felt_by_short_waves_alone() {
        let material = crate::elastomer::Material {
            law: crate::elastomer::Law::NeoHookean,
            youngs_modulus_mpa: 0.145,
            poisson_ratio: 0.45,
            density_g_mm3: 1.0,
        };
        let mut pad = crate::elastomer::Pad::slab([20.0, 20.0, 4.0], material);
        let answer = |pad: &crate::elastomer::Pad, period: usize| {
            let body = Body::new(pad, &crate::elastomer::Settings::default());
            let mut layer = Compliance::new(&body, [160, 160], [0.1, 0.1]);
            let pressure: Vec<f32> =
                (0..160 * 160).map(|k| if (k % 160) % period < period / 2 { 0.1 } else { 0.0 }).collect();
            let mut out = vec![0.0; 160 * 160];
            layer.displacement(&pressure, &mut out);
            // From crest to trough beside the middle.
            let row = &out[80 * 160..];
            (60..100).map(|i| (row[i] - row[i + period / 2]).abs()).fold(0.0, f32::max)
        };
        let plain = [answer(&pad, 4), answer(&pad, 80)];
        pad.coating = Some(crate::elastomer::Coating {
            thickness_mm: 0.3,
            youngs_modulus_mpa: 1.45,
            poisson_ratio: 0.45,
        });
        let coated = [answer(&pad, 4), answer(&pad, 80)];
        assert!(coated[0] < 0.2 * plain[0], "{coated:?} {plain:?}");
        assert!(coated[1] > 0.7 * plain[1], "{coated:?} {plain:?}");
    }
}
