//! Means over pixels that are alike: of what noise is left in is smoothed along rims and levels, and not across them.
//!
//! Windows of 5 x 5 pixels, twice as far apart each time, so that a few of them reach over the picture (Dammertz et al.,
//! "Edge-Avoiding A-Trous Wavelet Transform for fast Global Illumination Filtering", HPG 2010). What a neighbour counts follows
//! from guides without noise alone: so sums may be smoothed apart, and a picture of sums depends on nothing but them.

use glam::Vec3;
use rayon::prelude::*;

/// Numbers that tell pixels apart, each in the unit in which it tells.
pub type Guide = [f32; 8];

/// Sums that are smoothed together.
pub type Sums<const N: usize> = Vec<[Vec3; N]>;

/// What the neighbours in a row or column of a window count (a cubic B-spline).
const SPLINE: [f32; 3] = [0.375, 0.25, 0.0625];
/// Pixels this far apart in their guides have nothing to do with each other.
const APART: f32 = 2.0;

/// Pixels of a picture, and what tells which of them are alike.
pub struct Alike {
    pub width: usize,
    /// By pixel, row by row; None where it is not to be mixed with others.
    pub guides: Vec<Option<Guide>>,
}

impl Alike {
    /// Smooths sums by windows whose steps are these powers of two, one after the other.
    pub fn smoothed<const N: usize>(&self, sums: &Sums<N>, levels: std::ops::Range<u32>) -> Sums<N> {
        let mut smoothed = sums.clone();
        for level in levels {
            smoothed = self.by_windows(&smoothed, 1 << level);
        }
        smoothed
    }

    /// One window around each pixel, whose rows and columns are `step` pixels apart.
    fn by_windows<const N: usize>(&self, sums: &Sums<N>, step: usize) -> Sums<N> {
        let height = self.guides.len() / self.width;
        let near = |at: usize, size: usize| {
            let places = (0..5).map(move |k| ((at + k * step).checked_sub(2 * step), SPLINE[k.abs_diff(2)]));
            places.filter_map(move |(place, weight)| Some((place.filter(|p| *p < size)?, weight)))
        };
        let pixel = |k: usize| {
            let Some(guide) = &self.guides[k] else { return sums[k] };
            let mut sum = [Vec3::ZERO; N];
            for (y, of_row) in near(k / self.width, height) {
                for (x, of_column) in near(k % self.width, self.width) {
                    let other = y * self.width + x;
                    let Some(neighbour) = &self.guides[other] else { continue };
                    let weight = of_row * of_column * likeness(guide, neighbour);
                    sum.iter_mut().zip(&sums[other]).for_each(|(sum, of_other)| *sum += *of_other * weight);
                }
            }
            sum
        };
        (0..sums.len()).into_par_iter().with_min_len(4096).map(pixel).collect()
    }
}

/// 1 of pixels with the same guide, 0 of those that are too far apart.
#[inline(always)]
fn likeness(a: &Guide, b: &Guide) -> f32 {
    let distance2: f32 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    let near = (1.0 - distance2 / (APART * APART)).max(0.0);
    near * near
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two levels side by side, and a column that is none of the picture's.
    fn halves() -> Alike {
        let guide = |k: usize| match k % 64 {
            0..32 => Some([0.0; 8]),
            63 => None,
            _ => Some([APART; 8]),
        };
        Alike { width: 64, guides: (0..64 * 48).map(guide).collect() }
    }

    #[test]
    fn noise_is_smoothed_on_each_level_and_a_step_stays() {
        let alike = halves();
        let noise = |k: usize| crate::optics::noise::normal(7, k as u32) as f32;
        let truth = |k: usize| if k % 64 < 32 { 1.0 } else { 3.0 };
        let sums: Sums<2> =
            (0..64 * 48).map(|k| [Vec3::splat(truth(k) + 0.3 * noise(k)), Vec3::ONE]).collect();
        let smoothed = alike.smoothed(&sums, 0..5);
        let off = |k: usize| (smoothed[k][0] / smoothed[k][1]).x - truth(k);
        let pixels = || (0..64 * 48).filter(|k| k % 64 != 63);
        let rms = (pixels().map(|k| off(k).powi(2)).sum::<f32>() / pixels().count() as f32).sqrt();
        assert!(rms < 0.04, "{rms}");
        assert!(pixels().all(|k| off(k).abs() < 0.2));
        assert!((0..48).all(|y| smoothed[y * 64 + 63] == sums[y * 64 + 63]));
    }
}
