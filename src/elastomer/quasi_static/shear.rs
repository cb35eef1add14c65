//! How far the face of a bonded layer gives way along itself under tractions along it, wave by wave.
//!
//! A vector along the face is a complex number, x its real part, so that one transform takes both components. Of a wave the
//! component along it bends the layer, and the one across it only shears; the matrix of both is symmetric, and applied to the
//! transform F of a field it is m(k) F(k) + d(k) conj(F(-k)), m being half the sum of the two compliances, and d half of what they
//! differ by, turned twice as far as the wave.

use super::body::Body;
use super::compliance::{SHALLOW, of_layer};
use super::transforms::Transforms;
use rayon::prelude::*;
use twinrig_fourier::Complex;

/// See [`super::compliance::Compliance`]'s. Found by experiment: discs with radii of 12 to 23 points, anywhere on the lattice, twisted
/// on a half-space, take 16/3 G a^3 of torque a radian within 1.2 %, a by the points' area.
const EDGE: f64 = 0.05;

/// Tractions along a lattice to the displacements of the same points along it; nothing pulls beside it.
pub struct ShearCompliance {
    /// Points along x and y.
    size: [usize; 2],
    transforms: Transforms,
    /// m and d of each wave, mm per MPa over the number of padded points, by wave along x.
    of_wave: Vec<(f32, Complex<f32>)>,
    rows: Vec<Complex<f32>>,
    waves: Vec<Complex<f32>>,
    answers: Vec<Complex<f32>>,
}

impl ShearCompliance {
    /// That of a pad without coating, on a lattice of `size` points `spacing_mm` apart.
    pub fn new(body: &Body, size: [usize; 2], spacing_mm: [f64; 2]) -> Self {
        let transforms = Transforms::around(size);
        let padded = transforms.padded;
        let (depth_mm, material) = (body.size_mm[2], &body.material);
        let (e, nu) = (material.youngs_modulus_mpa, material.poisson_ratio);
        let along_and_across = |k: f64| {
            let (q, soft) = (k * depth_mm, 2.0 * (1.0 + nu) / e);
            let across = if q < SHALLOW { soft * depth_mm } else { soft * q.tanh() / k };
            [of_layer(k, e, nu, depth_mm, 1.0), across]
        };
        let count = (padded[0] * padded[1]) as f64;
        // Signed radians a step.
        let turn = |i: usize, axis: usize| {
            let n = padded[axis];
            let i = if 2 * i > n { i as f64 - n as f64 } else { i as f64 };
            2.0 * std::f64::consts::PI * i / n as f64
        };
        let of_wave = (0..padded[0] * padded[1])
            .into_par_iter()
            .map(|k| {
                let (i, j) = (k / padded[1], k % padded[1]);
                let turn = [turn(i, 0), turn(j, 1)];
                let wave = [turn[0] / spacing_mm[0], turn[1] / spacing_mm[1]];
                let left = (EDGE * (turn[0].cos() + turn[1].cos() - 2.0)).exp() / count;
                let [along, across] = along_and_across(wave[0].hypot(wave[1])).map(|c| c * left);
                let unit = Complex::new(wave[0], wave[1]) / wave[0].hypot(wave[1]).max(f64::MIN_POSITIVE);
                let mut twice = unit * unit;
                // (The shortest waves run both ways at once.)
                if 2 * i == padded[0] || 2 * j == padded[1] {
                    twice.im = 0.0;
                }
                let differ = twice * (0.5 * (along - across));
                (0.5 * (along + across) as f32, Complex::new(differ.re as f32, differ.im as f32))
            })
            .collect();
        Self {
            size,
            of_wave,
            transforms,
            rows: vec![Complex::default(); padded[0] * size[1]],
            waves: vec![Complex::default(); padded[0] * padded[1]],
            answers: vec![Complex::default(); padded[0] * padded[1]],
        }
    }

    /// How far a point gives way under a traction on it alone, mm per MPa.
    pub fn own(&self) -> f32 {
        self.of_wave.iter().map(|(mean, _)| mean).sum()
    }

    /// Displacements under tractions, mm and MPa, x running fastest.
    pub fn displacement(&mut self, traction: &[Complex<f32>], out: &mut [Complex<f32>]) {
        let ([nx, ny], [px, py]) = (self.size, self.transforms.padded);
        let Self { of_wave, transforms: Transforms { forward, back, .. }, rows, waves, answers, .. } = self;
        rows.par_chunks_exact_mut(px).zip(traction.par_chunks_exact(nx)).for_each(|(row, traction)| {
            row[..nx].copy_from_slice(traction);
            row[nx..].fill(Complex::default());
            forward[0].process(row);
        });
        waves.par_chunks_exact_mut(py).enumerate().for_each(|(i, column)| {
            for (to, row) in column.iter_mut().zip(rows.chunks_exact(px)) {
                *to = row[i];
            }
            column[ny..].fill(Complex::default());
            forward[1].process(column);
        });
        let columns = answers.par_chunks_exact_mut(py).zip(of_wave.par_chunks_exact(py));
        columns.enumerate().for_each(|(i, (answers, of_wave))| {
            let (here, there) = (&waves[i * py..][..py], &waves[(px - i) % px * py..][..py]);
            for (j, (answer, (mean, differ))) in answers.iter_mut().zip(of_wave).enumerate() {
                *answer = here[j] * *mean + there[(py - j) % py].conj() * *differ;
            }
            back[1].process(answers);
        });
        rows.par_chunks_exact_mut(px).zip(out.par_chunks_exact_mut(nx)).enumerate().for_each(
            |(j, (row, out))| {
                for (to, answers) in row.iter_mut().zip(answers.chunks_exact(py)) {
                    *to = answers[j];
                }
                back[0].process(row);
                out.copy_from_slice(&row[..nx]);
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{pad, settings};
    use super::*;
    use crate::elastomer::{Friction, Law};

    /// The compliance of a pad so thick that it is a half-space to what happens on such a lattice.
    fn half_space(n: usize, spacing_mm: f64) -> (ShearCompliance, f64, f64) {
        let mut pad = pad(Law::NeoHookean);
        pad.thickness_mm = 400.0;
        let body = Body::new(&pad, &settings(Friction::Infinite));
        let nu = pad.material.poisson_ratio;
        let g = pad.material.youngs_modulus_mpa / 2.0 / (1.0 + nu);
        (ShearCompliance::new(&body, [n, n], [spacing_mm; 2]), g, nu)
    }

    #[test]
    fn a_point_pulls_its_surroundings_as_cerruti_has_it() {
        let (n, spacing) = (81, 0.1);
        let (mut layer, g, nu) = half_space(n, spacing);
        let mut traction = vec![Complex::default(); n * n];
        let middle = n * (n / 2) + n / 2;
        traction[middle] = Complex::new(1.0 / (spacing * spacing) as f32, 0.0);
        let mut out = vec![Complex::default(); n * n];
        layer.displacement(&traction, &mut out);
        let theory = |x: f64, y: f64| {
            let r = x.hypot(y);
            let k = 1.0 / (2.0 * std::f64::consts::PI * g * r);
            [k * (1.0 - nu + nu * x * x / (r * r)), k * nu * x * y / (r * r)]
        };
        // (What is far away is felt from around the corner, too: alike everywhere.)
        let seen = |i: usize, j: usize| out[middle + j * n + i];
        for (i, j) in [(8, 0), (0, 8), (6, 6), (10, 4), (3, 9)] {
            let at = |i: usize, j: usize| theory(i as f64 * spacing, j as f64 * spacing);
            let ([far_x, far_y], [x, y]) = (at(20, 20), at(i, j));
            let moved = seen(i, j) - seen(20, 20);
            let off = f64::from(moved.re) - (x - far_x);
            assert!(off.abs() < 0.03 * x, "{i} {j}: {} instead of {}", moved.re, x - far_x);
            let off = f64::from(moved.im) - (y - far_y);
            assert!(off.abs() < 0.03 * x, "{i} {j}: {} instead of {}", moved.im, y - far_y);
        }
    }

    #[test]
    fn what_pulls_here_moves_there_as_what_pulls_there_moves_here() {
        let body = Body::new(&pad(Law::NeoHookean), &settings(Friction::Infinite));
        for size in [[12, 9], [5, 16]] {
            let mut layer = ShearCompliance::new(&body, size, [0.1, 0.13]);
            let n = size[0] * size[1];
            let field = |seed: usize| -> Vec<Complex<f32>> {
                let number = |k: usize| ((k * 37 + seed * 11) % 17) as f32 - 8.0;
                (0..n).map(|k| Complex::new(number(k), number(k + 5))).collect()
            };
            let (a, b) = (field(1), field(2));
            let mut moved = [vec![Complex::default(); n], vec![Complex::default(); n]];
            layer.displacement(&a, &mut moved[0]);
            layer.displacement(&b, &mut moved[1]);
            let work = |t: &[Complex<f32>], u: &[Complex<f32>]| -> f32 {
                t.iter().zip(u).map(|(t, u)| t.re * u.re + t.im * u.im).sum()
            };
            let (ab, ba) = (work(&a, &moved[1]), work(&b, &moved[0]));
            assert!((ab - ba).abs() < 1e-4 * work(&a, &moved[0]), "{size:?}: {ab} {ba}");
            assert!(work(&a, &moved[0]) > 0.0);
        }
    }
}
