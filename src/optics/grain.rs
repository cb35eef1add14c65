//! What the coating of a real gel has beside its colour: a fine grain, and here and there a dark speck of dust or pigment.
//!
//! Both are made of a seed and are the face's own, so they ride on it as it is pressed and dragged. They are worked out on the
//! texels of the coating's picture as means over those, so that a finer camera sees the same coat and not a stronger one.

use super::noise::{Normals, uniform};
use super::sampler::hash;
use super::sensor::GrainSpec;
use rayon::prelude::*;

/// Full width at half maximum of a Gaussian, over its standard deviation.
const WIDTH_OF_SIGMA: f64 = 2.354_820_045;
/// Of white noise under a Gaussian of standard deviation 1, two points this far apart have half of their variance in common:
/// its correlation is exp(-d^2 / 4).
const HALF_OF_SIGMA: f64 = 1.665_109_222;
/// Standard deviations after which a Gaussian is cut off.
const REACH: f64 = 4.0;

/// By how much each texel's reflectance is that of the coating, u inner: 1 on average but for the specks.
/// `texel_mm` is a texel's edge. The outermost texels are clean: whatever comes into the view from beyond has their colour.
pub fn factors(grain: &GrainSpec, [width, height]: [usize; 2], texel_mm: f64) -> Vec<f32> {
    let mut field = match grain.rms > 0.0 {
        true => fine([width, height], grain, texel_mm),
        false => vec![0.0; width * height],
    };
    specks(&mut field, [width, height], grain, texel_mm);
    for (k, value) in field.iter_mut().enumerate() {
        let (i, j) = (k % width, k / width);
        let is_rim = i == 0 || j == 0 || i + 1 == width || j + 1 == height;
        *value = if is_rim { 1.0 } else { (1.0 + *value).max(0.0) };
    }
    field
}

/// A texel's mean of a Gaussian of this width is one of this width, and lower in the given ratio.
fn over_texel(sigma_mm: f64, texel_mm: f64) -> (f64, f64) {
    let mean_mm = (sigma_mm * sigma_mm + texel_mm * texel_mm / 12.0).sqrt();
    (mean_mm, sigma_mm / mean_mm)
}

/// White noise under a Gaussian whose squares add up to 1, of the rms asked for.
fn fine([width, height]: [usize; 2], grain: &GrainSpec, texel_mm: f64) -> Vec<f32> {
    let (sigma_mm, share) = over_texel(grain.size_mm / HALF_OF_SIGMA, texel_mm);
    let sigma = sigma_mm / texel_mm;
    let reach = (REACH * sigma).ceil() as usize;
    let weight = |k: usize| (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp();
    let kernel: Vec<f64> = (0..=2 * reach).map(weight).collect();
    let energy = kernel.iter().map(|w| w * w).sum::<f64>().sqrt();
    let kernel: Vec<f32> = kernel.iter().map(|w| (w / energy) as f32).collect();
    let normals = Normals::new(hash(grain.seed, 0x6_1a1));
    let columns = width + 2 * reach;
    let rows: Vec<Vec<f32>> = (0..height + 2 * reach)
        .into_par_iter()
        .map(|j| {
            let noise: Vec<f32> = (0..columns).map(|i| normals.at((j * columns + i) as u32)).collect();
            noise.windows(kernel.len()).map(|n| n.iter().zip(&kernel).map(|(n, w)| n * w).sum()).collect()
        })
        .collect();
    let rms = (grain.rms * share) as f32;
    (0..height)
        .into_par_iter()
        .flat_map_iter(|j| {
            let mut row = vec![0.0; width];
            for (above, w) in rows[j..].iter().zip(&kernel) {
                row.iter_mut().zip(above).for_each(|(sum, n)| *sum += n * w * rms);
            }
            row
        })
        .collect()
}

/// Specks are from this part of the usual width to its inverse, evenly on a logarithmic scale.
const NARROWEST: f64 = 0.5;
/// Longest of them, over its width.
const LONGEST: f64 = 3.0;

/// Dark Gaussian spots anywhere, of several shapes. How dark is chance: most of them are faint, as the exponential distribution
/// has it.
fn specks(field: &mut [f32], [width, height]: [usize; 2], grain: &GrainSpec, texel_mm: f64) {
    let extent = [width as f64, height as f64];
    let count = (grain.specks_per_mm2 * extent[0] * extent[1] * texel_mm * texel_mm).round() as u32;
    let chance = |k: u32, what: u32| uniform(hash(grain.seed, 0x5_bec0 + what), k);
    for k in 0..count {
        let [x, y] = [0, 1].map(|axis| chance(k, axis as u32) * extent[axis] - 0.5);
        let usual_mm = grain.speck_mm / WIDTH_OF_SIGMA * NARROWEST.powf(1.0 - 2.0 * chance(k, 3));
        let stretch = LONGEST.powf(0.5 * chance(k, 4));
        let [(along_mm, share_along), (across_mm, share_across)] =
            [usual_mm * stretch, usual_mm / stretch].map(|sigma_mm| over_texel(sigma_mm, texel_mm));
        let (along, across) = (along_mm / texel_mm, across_mm / texel_mm);
        let (sin, cos) = (std::f64::consts::PI * chance(k, 5)).sin_cos();
        let depth = grain.speck_depth * -chance(k, 2).ln() * share_along * share_across;
        let span = |at: f64, n: usize| {
            let [low, high] = [-1.0, 1.0].map(|side| (at + side * REACH * along).max(0.0) as usize);
            low..(high + 1).min(n)
        };
        for j in span(y, height) {
            for i in span(x, width) {
                let (dx, dy) = (i as f64 - x, j as f64 - y);
                let [s, t] = [(dx * cos + dy * sin) / along, (dy * cos - dx * sin) / across];
                field[j * width + i] -= (depth * (-0.5 * (s * s + t * t)).exp()) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [600, 500];

    fn clean() -> GrainSpec {
        GrainSpec::default()
    }

    /// Mean, and central moments of second and third order, of what is not at the rim.
    fn moments(field: &[f32]) -> [f64; 3] {
        let inner = || {
            field.iter().enumerate().filter(|(k, _)| {
                let (i, j) = (k % SIZE[0], k / SIZE[0]);
                (1..SIZE[0] - 1).contains(&i) && (1..SIZE[1] - 1).contains(&j)
            })
        };
        let n = inner().count() as f64;
        let mean = inner().map(|(_, v)| f64::from(*v)).sum::<f64>() / n;
        let moment = |p: i32| inner().map(|(_, v)| (f64::from(*v) - mean).powi(p)).sum::<f64>() / n;
        [mean, moment(2), moment(3)]
    }

    #[test]
    fn the_grain_has_the_rms_and_the_size_asked_for() {
        let grain = GrainSpec { rms: 0.02, size_mm: 0.1, ..clean() };
        let texel_mm = 0.01;
        let field = factors(&grain, SIZE, texel_mm);
        let [mean, variance, _] = moments(&field);
        assert!((mean - 1.0).abs() < 1e-3, "{mean}");
        assert!((variance.sqrt() / 0.02 - 1.0).abs() < 0.05, "{variance}");
        for [di, dj] in [[10, 0], [0, 10], [30, 0]] {
            let pairs = (1..SIZE[1] - 1 - dj).flat_map(|j| (1..SIZE[0] - 1 - di).map(move |i| (i, j)));
            let products = pairs.map(|(i, j)| {
                let at = |i: usize, j: usize| f64::from(field[j * SIZE[0] + i]) - mean;
                at(i, j) * at(i + di, j + dj)
            });
            let all: Vec<f64> = products.collect();
            let common = all.iter().sum::<f64>() / all.len() as f64 / variance;
            let due = if di + dj == 10 { 0.5 } else { 0.5f64.powi(9) };
            assert!((common - due).abs() < 0.06, "{di} {dj}: {common}");
        }
        // Of small ones there are enough to tell that two coats have nothing in common.
        let small = |seed: u32| factors(&GrainSpec { size_mm: 0.02, seed, ..grain.clone() }, SIZE, texel_mm);
        let products = small(0).into_iter().zip(small(1)).map(|(a, b)| f64::from((a - 1.0) * (b - 1.0)));
        assert!((products.sum::<f64>() / field.len() as f64 / variance).abs() < 0.03);
        assert_eq!(field, factors(&grain, SIZE, texel_mm));
    }

    /// Grain finer than texels is told by their means: seen through texels twice as large it is half as strong.
    #[test]
    fn texels_see_the_mean_of_what_is_finer_than_they() {
        let rms = |texel_mm: f64| {
            let grain = GrainSpec { rms: 0.02, size_mm: 0.01, ..clean() };
            moments(&factors(&grain, SIZE, texel_mm))[1].sqrt()
        };
        assert!((rms(0.1) / rms(0.2) - 2.0).abs() < 0.1, "{} {}", rms(0.1), rms(0.2));
        assert!((rms(0.002) / 0.02 - 1.0).abs() < 0.1, "{}", rms(0.002));
    }

    #[test]
    fn specks_are_dark_and_as_many_and_as_wide_as_asked_for() {
        let grain = GrainSpec { specks_per_mm2: 5.0, speck_mm: 0.2, speck_depth: 0.01, ..clean() };
        let field = factors(&grain, SIZE, 0.03);
        let [mean, variance, third] = moments(&field);
        let sigma: f64 = 0.2 / WIDTH_OF_SIGMA;
        // The mean of squares that are even on a logarithmic scale from 1/4 to 4.
        let area = std::f64::consts::PI * sigma * sigma * (4.0 - 0.25) / 16.0f64.ln();
        // The cumulants of spots by chance (Campbell's theorem), their depth exponential.
        for (found, due) in [
            (1.0 - mean, 5.0 * 0.01 * 2.0 * area),
            (variance, 5.0 * 2.0 * 1e-4 * area),
            (-third, 5.0 * 6.0 * 1e-6 * area * 2.0 / 3.0),
        ] {
            assert!((found / due - 1.0).abs() < 0.3, "{found} {due}");
        }
        assert!(field.iter().all(|v| *v <= 1.0));
        let deep = GrainSpec { speck_depth: 0.3, ..grain };
        assert!(factors(&deep, SIZE, 0.03).iter().all(|v| *v >= 0.0));
    }
}
