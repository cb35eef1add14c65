//! How far the face of a bonded layer gives way under a pressure on it, wave by wave.

use super::body::Body;
use super::coated::{Layer, of_coated};
use super::transforms::Transforms;
use rayon::prelude::*;
use twinrig_fourier::Complex;

/// Beyond so many radians through the depth a layer is as good as a half-space, and below so many as one that is pressed
/// everywhere.
pub(super) const DEEP: f64 = 20.0;
/// See [`DEEP`].
pub(super) const SHALLOW: f64 = 1e-2;
/// How much stiffer than the layer the shortest waves on a lattice are: by exp(`EDGE` (2 - cos(kx s) - cos(ky s))) for points
/// s apart. Without it a punch that ends half-way between two points is too small by a quarter of s on every side, with it by
/// nothing (found by experiment: squares of 41 and 123 points).
const EDGE: f64 = 0.35;

/// Pressures on a lattice to the displacements of the same points; nothing presses beside it.
pub struct Compliance {
    /// Points along x and y.
    size: [usize; 2],
    transforms: Transforms,
    /// mm per MPa of each wave, over the number of padded points; rows are waves along x, of which the first half tells the rest.
    of_wave: Vec<f32>,
    /// Pairs of rows along x, the second of each as the imaginary part; and, by wave along x, columns along y.
    pairs: Vec<Complex<f32>>,
    waves: Vec<Complex<f32>>,
}

/// mm per MPa of a wave of `k` radians a mm on the face of a layer bonded to a rigid base, `sign` being -1 for pressure (Hayes et al.
/// 1972, "A mathematical analysis for indentation tests of articular cartilage") and 1 for traction along the way it runs, by which
/// the same equations differ.
pub(super) fn of_layer(
    k: f64,
    youngs_modulus_mpa: f64,
    poisson_ratio: f64,
    thickness_mm: f64,
    sign: f64,
) -> f64 {
    let (a, q) = (3.0 - 4.0 * poisson_ratio, k * thickness_mm);
    let half_space = 2.0 * (1.0 - poisson_ratio * poisson_ratio) / youngs_modulus_mpa;
    if q < SHALLOW {
        let squeezed = (1.0 - 2.0 * poisson_ratio) / (2.0 * (1.0 - poisson_ratio).powi(2));
        let sheared = 1.0 / (1.0 - poisson_ratio);
        return half_space * thickness_mm * if sign < 0.0 { squeezed } else { sheared };
    }
    let bonded = if q > DEEP {
        1.0
    } else {
        let (up, down) = ((2.0 * q).exp(), (-2.0 * q).exp());
        let (sinh, cosh) = (0.5 * (up - down), 0.5 * (up + down));
        (a * sinh + sign * 2.0 * q) / (a * cosh + 2.0 * q * q + 0.5 * (1.0 + a * a))
    };
    half_space / k * bonded
}

impl Compliance {
    /// That of a pad, on a lattice of `size` points `spacing_mm` apart.
    pub fn new(body: &Body, size: [usize; 2], spacing_mm: [f64; 2]) -> Self {
        let transforms = Transforms::around(size);
        let padded = transforms.padded;
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
        let per_mpa = |k: f64| match &body.coating {
            None => of_layer(k, material.youngs_modulus_mpa, material.poisson_ratio, body.size_mm[2], -1.0),
            Some(c) => {
                let coating = Layer {
                    youngs_modulus_mpa: c.youngs_modulus_mpa,
                    poisson_ratio: c.poisson_ratio,
                    thickness_mm: c.thickness_mm,
                };
                let bulk = Layer {
                    youngs_modulus_mpa: material.youngs_modulus_mpa,
                    poisson_ratio: material.poisson_ratio,
                    thickness_mm: body.size_mm[2] - c.thickness_mm,
                };
                of_coated(k, &coating, &bulk)
            }
        };
        let count = (padded[0] * padded[1]) as f64;
        let half = padded.map(|n| n / 2 + 1);
        let mut of_wave = vec![0.0; half[0] * padded[1]];
        of_wave.par_chunks_exact_mut(padded[1]).zip(&waves[0]).for_each(|(row, (kx, left_x))| {
            for (j, (ky, left_y)) in waves[1].iter().enumerate().take(half[1]) {
                let value = (per_mpa(kx.hypot(*ky)) * left_x * left_y / count) as f32;
                row[j] = value;
                row[(padded[1] - j) % padded[1]] = value;
            }
        });
        Self {
            size,
            of_wave,
            transforms,
            pairs: vec![Complex::default(); padded[0] * size[1].div_ceil(2)],
            waves: vec![Complex::default(); half[0] * padded[1]],
        }
    }

    /// The most that a wave gives way, mm per MPa.
    pub fn largest(&self) -> f32 {
        let count = self.transforms.padded.iter().product::<usize>() as f32;
        count * self.of_wave.iter().fold(0.0f32, |most, c| most.max(*c))
    }

    /// How far a point gives way under a pressure on it alone, mm per MPa.
    pub fn own(&self) -> f32 {
        let [px, py] = self.transforms.padded;
        let twice = |i: usize| if i == 0 || 2 * i == px { 1.0 } else { 2.0 };
        self.of_wave.chunks_exact(py).enumerate().map(|(i, row)| twice(i) * row.iter().sum::<f32>()).sum()
    }

    /// Displacements under pressures, mm and MPa, x running fastest; along the pressure.
    pub fn displacement(&mut self, pressure: &[f32], out: &mut [f32]) {
        let ([nx, ny], [px, py]) = (self.size, self.transforms.padded);
        let Self { of_wave, transforms: Transforms { forward, back, .. }, pairs, waves, .. } = self;
        // Along x, two rows at once.
        pairs.par_chunks_exact_mut(px).zip(pressure.par_chunks(2 * nx)).for_each(|(pair, rows)| {
            let (re, im) = rows.split_at(nx);
            for (i, (to, re)) in pair.iter_mut().zip(re).enumerate() {
                *to = Complex::new(*re, im.get(i).copied().unwrap_or(0.0));
            }
            pair[nx..].fill(Complex::default());
            forward[0].process(pair);
        });
        // Along y and back, wave by wave along x: what is real has them in conjugate pairs.
        waves.par_chunks_exact_mut(py).zip(of_wave.par_chunks_exact(py)).enumerate().for_each(
            |(i, (column, of_wave))| {
                for (pair, to) in pairs.chunks_exact(px).zip(column[..ny].chunks_mut(2)) {
                    let (here, there) = (pair[i], pair[(px - i) % px].conj());
                    to[0] = (here + there) * 0.5;
                    if let Some(to) = to.get_mut(1) {
                        let twice = here - there;
                        *to = Complex::new(twice.im, -twice.re) * 0.5;
                    }
                }
                column[ny..].fill(Complex::default());
                forward[1].process(column);
                for (value, of_wave) in column.iter_mut().zip(of_wave) {
                    *value *= *of_wave;
                }
                back[1].process(column);
            },
        );
        // Back along x.
        pairs.par_chunks_exact_mut(px).zip(out.par_chunks_mut(2 * nx)).enumerate().for_each(
            |(m, (pair, rows))| {
                for i in 0..=px / 2 {
                    let re = waves[i * py + 2 * m];
                    let im = if 2 * m + 1 < ny { waves[i * py + 2 * m + 1] } else { Complex::default() };
                    // (Of the wave that is its own partner both are the same.)
                    pair[(px - i) % px] = Complex::new(re.re + im.im, im.re - re.im);
                    pair[i] = Complex::new(re.re - im.im, re.im + im.re);
                }
                back[0].process(pair);
                let (first, second) = rows.split_at_mut(nx);
                first.iter_mut().zip(&*pair).for_each(|(to, from)| *to = from.re);
                second.iter_mut().zip(&*pair).for_each(|(to, from)| *to = from.im);
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
            assert!((of_layer(k, e, nu, h, -1.0) / together - 1.0).abs() < 1e-3, "{k}");
        }
        // (The second is less than a hundredth of a percent from the first where one takes over from the other.)
        for k in [3.0, 6.0] {
            assert!(
                (of_layer(k, e, nu, h, -1.0) * k * e / (2.0 * (1.0 - nu * nu)) - 1.0).abs() < 1e-4,
                "{k}"
            );
        }
    }

    #[test]
    fn waves_of_traction_shear_a_layer_as_its_equations_have_it() {
        // Integrated through the depth, E 0.145, nu 0.45, 4 mm (f64, 4000 Runge-Kutta steps).
        for (k, along, across) in [
            (0.05, 75.632_237, 7.869_217),
            (0.2, 43.767_093, 12.298_947),
            (0.5, 19.253_540, 15.062_054),
            (1.0, 10.847_719, 10.751_111),
        ] {
            let of = |sign: f64| of_layer(k, 0.145, 0.45, 4.0, sign);
            assert!((of(1.0) / along - 1.0).abs() < 1e-6, "{k}: {}", of(1.0));
            assert!((of(-1.0) / across - 1.0).abs() < 1e-6, "{k}: {}", of(-1.0));
        }
        let shear = 2.0 * 1.45 / 0.145;
        assert!((of_layer(1e-4, 0.145, 0.45, 4.0, 1.0) / (4.0 * shear) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_thin_coating_is_felt_by_short_waves_most() {
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

    #[test]
    fn lattices_of_any_size_answer_as_the_sum_over_their_waves_does() {
        let (e, nu, h) = (0.145, 0.45, 4.0);
        let material = crate::elastomer::Material {
            law: crate::elastomer::Law::NeoHookean,
            youngs_modulus_mpa: e,
            poisson_ratio: nu,
            density_g_mm3: 1.0,
        };
        let pad = crate::elastomer::Pad::slab([20.0, 20.0, h], material);
        let body = Body::new(&pad, &crate::elastomer::Settings::default());
        // (Padded to odd and to even numbers, to more than twice as many, and to the least.)
        for (size, padded) in
            [([13, 9], [27, 18]), ([7, 13], [15, 27]), ([1, 5], [2, 10]), ([11, 16], [24, 32])]
        {
            let spacing = [0.12, 0.15];
            let mut layer = Compliance::new(&body, size, spacing);
            assert_eq!(layer.transforms.padded, padded);
            // What a point gives way that lies so far from the one that is pressed.
            let answer = |away: [usize; 2]| {
                let turn = |n: usize, k: usize| 2.0 * std::f64::consts::PI * n as f64 / k as f64;
                let mut sum = 0.0;
                for (i, j) in (0..padded[0]).flat_map(|i| (0..padded[1]).map(move |j| (i, j))) {
                    let k =
                        |n: usize, axis: usize| turn(n.min(padded[axis] - n), padded[axis]) / spacing[axis];
                    let stiffer = EDGE * (turn(i, padded[0]).cos() + turn(j, padded[1]).cos() - 2.0);
                    sum += of_layer(k(i, 0).hypot(k(j, 1)), e, nu, h, -1.0)
                        * stiffer.exp()
                        * (turn(i * away[0], padded[0]) + turn(j * away[1], padded[1])).cos();
                }
                sum / (padded[0] * padded[1]) as f64
            };
            let own = answer([0, 0]);
            assert!((f64::from(layer.own()) / own - 1.0).abs() < 1e-5, "{size:?}: {} {own}", layer.own());
            for pressed in [0, size[0] * size[1] / 2, size[0] * size[1] - 1] {
                let mut pressure = vec![0.0; size[0] * size[1]];
                pressure[pressed] = 1.0;
                let mut given = vec![f32::NAN; pressure.len()];
                layer.displacement(&pressure, &mut given);
                for (k, given) in given.iter().enumerate() {
                    let away = [
                        (k % size[0]).abs_diff(pressed % size[0]),
                        (k / size[0]).abs_diff(pressed / size[0]),
                    ];
                    let wanted = answer(away);
                    assert!(
                        (f64::from(*given) - wanted).abs() < 1e-5 * own,
                        "{size:?} {away:?}: {given} {wanted}"
                    );
                }
            }
        }
    }
}
