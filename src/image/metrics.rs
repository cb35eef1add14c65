//! MSE, PSNR and SSIM of 8-bit RGB pictures.
//!
//! SSIM is that of Wang, Bovik, Sheikh and Simoncelli 2004: an 11 x 11 Gaussian window of sigma 1.5, K1
//! 0.01, K2 0.03, weighted (population) covariances, only windows that lie wholly in the picture; the
//! channels are averaged. A region restricts MSE to its pixels and SSIM to the windows centred on them.
//!
//! Full-frame numbers hardly discriminate for tactile images, because most of the picture never
//! changes. So [`compare_with_null`] gives every number beside that of the null predictor, the
//! untouched image.

use super::{Error, Mask, View, same_size};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Taps of the window.
const WINDOW: usize = 11;
/// Standard deviation of the window, pixels.
const SIGMA: f64 = 1.5;
/// Stabilisers (K1 L)^2 and (K2 L)^2 with L = 255.
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);

/// How alike two pictures are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Mean squared error of code values.
    pub mse: f64,
    /// Peak signal-to-noise ratio, dB; infinite for equal pictures.
    pub psnr_db: f64,
    /// Structural similarity, 1 for equal pictures.
    pub ssim: f64,
}

/// A prediction and the null predictor, both against the same truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WithNull {
    /// The simulated picture against the real one.
    pub predicted: Metrics,
    /// The untouched picture against the real one.
    pub null: Metrics,
}

/// PSNR of 8-bit code values with the given mean squared error, dB.
pub fn psnr_db(mse: f64) -> f64 {
    10.0 * (255.0 * 255.0 / mse).log10()
}

/// Compares whole pictures.
///
/// # Errors
/// When they differ in size or are smaller than the SSIM window.
pub fn compare<'a>(a: impl Into<View<'a>>, b: impl Into<View<'a>>) -> Result<Metrics, Error> {
    over(a.into(), b.into(), None)
}

/// Compares pictures within a region.
///
/// # Errors
/// Also when the region has another size or is empty.
pub fn compare_within<'a>(
    a: impl Into<View<'a>>,
    b: impl Into<View<'a>>,
    region: &Mask,
) -> Result<Metrics, Error> {
    over(a.into(), b.into(), Some(region))
}

/// Compares a prediction with the truth, and the untouched picture with the same truth.
///
/// # Errors
/// As [`compare_within`].
pub fn compare_with_null<'a>(
    truth: impl Into<View<'a>>,
    predicted: impl Into<View<'a>>,
    untouched: impl Into<View<'a>>,
    region: Option<&Mask>,
) -> Result<WithNull, Error> {
    let truth = truth.into();
    Ok(WithNull {
        predicted: over(truth, predicted.into(), region)?,
        null: over(truth, untouched.into(), region)?,
    })
}

/// Compares whole pictures and the same pictures within a region, at the price of one comparison. The
/// second answer is `None` when the region is empty or touches only the border.
///
/// # Errors
/// As [`compare_within`].
pub fn compare_whole_and_within<'a>(
    a: impl Into<View<'a>>,
    b: impl Into<View<'a>>,
    region: Option<&Mask>,
) -> Result<(Metrics, Option<Metrics>), Error> {
    let maps = Maps::of(a.into(), b.into())?;
    let part = match region {
        None => None,
        Some(region) => match maps.over(Some(region)) {
            Err(Error::EmptyRegion) => None,
            scored => Some(scored?),
        },
    };
    Ok((maps.over(None)?, part))
}

fn over(a: View<'_>, b: View<'_>, region: Option<&Mask>) -> Result<Metrics, Error> {
    Maps::of(a, b)?.over(region)
}

/// Squared error of each pixel and SSIM of each window, from which any region can be scored.
struct Maps {
    width: usize,
    height: usize,
    /// Sum over the channels, by pixel.
    squared: Vec<u32>,
    /// Sum over the channels, by window that lies wholly inside.
    ssim: Vec<f64>,
}

impl Maps {
    fn of(a: View<'_>, b: View<'_>) -> Result<Maps, Error> {
        same_size("the second picture", (a.width, a.height), (b.width, b.height))?;
        let least = WINDOW as u32;
        if a.width < least || a.height < least {
            return Err(Error::TooSmall { width: a.width, height: a.height, least });
        }
        let (width, height) = (a.width as usize, a.height as usize);
        let square = |(p, q): (&[u8], &[u8])| -> u32 {
            p.iter().zip(q).map(|(&x, &y)| u32::from(x.abs_diff(y)).pow(2)).sum()
        };
        let squared = a.rgb.chunks_exact(3).zip(b.rgb.chunks_exact(3)).map(square).collect();
        let channels: Vec<Vec<f64>> = (0..3usize)
            .into_par_iter()
            .map(|c| ssim_map(&channel(a, c), &channel(b, c), width, height))
            .collect();
        let ssim = (0..channels[0].len()).map(|i| channels.iter().map(|c| c[i]).sum()).collect();
        Ok(Maps { width, height, squared, ssim })
    }

    fn over(&self, region: Option<&Mask>) -> Result<Metrics, Error> {
        if let Some(m) = region {
            same_size("the region", (self.width as u32, self.height as u32), (m.width, m.height))?;
        }
        let chosen = |i: usize| region.is_none_or(|m| m.inside[i]);
        let (mut errors, mut pixels) = (0u64, 0u64);
        for (_, &e) in self.squared.iter().enumerate().filter(|(i, _)| chosen(*i)) {
            errors += u64::from(e);
            pixels += 1;
        }
        let (inner, half) = (self.width - WINDOW + 1, WINDOW / 2);
        let centre = |i: usize| (i / inner + half) * self.width + i % inner + half;
        let (mut likeness, mut windows) = (0.0, 0u64);
        for (_, s) in self.ssim.iter().enumerate().filter(|(i, _)| chosen(centre(*i))) {
            likeness += s;
            windows += 1;
        }
        if windows == 0 {
            return Err(Error::EmptyRegion);
        }
        let mse = errors as f64 / (3 * pixels) as f64;
        Ok(Metrics { mse, psnr_db: psnr_db(mse), ssim: likeness / (3 * windows) as f64 })
    }
}

fn channel(view: View<'_>, c: usize) -> Vec<f64> {
    view.rgb.iter().skip(c).step_by(3).map(|&v| f64::from(v)).collect()
}

/// SSIM of every window that lies wholly inside.
fn ssim_map(a: &[f64], b: &[f64], width: usize, height: usize) -> Vec<f64> {
    let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(x, y)| x * y).collect::<Vec<f64>>();
    let mean = |p: &[f64]| smoothed(p, width, height);
    let (ma, mb) = (mean(a), mean(b));
    let (aa, bb, ab) = (mean(&product(a, a)), mean(&product(b, b)), mean(&product(a, b)));
    (0..ma.len())
        .map(|i| {
            let (x, y) = (ma[i], mb[i]);
            let (vx, vy, cov) = (aa[i] - x * x, bb[i] - y * y, ab[i] - x * y);
            ((2.0 * x * y + C1) * (2.0 * cov + C2)) / ((x * x + y * y + C1) * (vx + vy + C2))
        })
        .collect()
}

/// Gaussian-weighted mean of every window that lies wholly inside.
fn smoothed(p: &[f64], width: usize, height: usize) -> Vec<f64> {
    let taps: [f64; WINDOW] = {
        let raw: [f64; WINDOW] = std::array::from_fn(|i| {
            let x = i as f64 - (WINDOW / 2) as f64;
            (-x * x / (2.0 * SIGMA * SIGMA)).exp()
        });
        let total: f64 = raw.iter().sum();
        raw.map(|t| t / total)
    };
    let inner = width - WINDOW + 1;
    let mut rows = vec![0.0; inner * height];
    for (row, out) in p.chunks_exact(width).zip(rows.chunks_exact_mut(inner)) {
        for (k, &tap) in taps.iter().enumerate() {
            out.iter_mut().zip(&row[k..]).for_each(|(o, v)| *o += tap * v);
        }
    }
    let mut all = vec![0.0; inner * (height - WINDOW + 1)];
    for (j, out) in all.chunks_exact_mut(inner).enumerate() {
        for (k, &tap) in taps.iter().enumerate() {
            let row = &rows[(j + k) * inner..(j + k + 1) * inner];
            out.iter_mut().zip(row).for_each(|(o, v)| *o += tap * v);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Picture;

    /// Two scenes given by integer formulas, so that another program can make the very same ones.
    fn scenes() -> (Picture, Picture) {
        let (width, height) = (48i64, 40i64);
        let first = |x: i64, y: i64, c: i64| (x * x + 3 * y * y + 17 * c * x) % 256 / 2 + 60;
        let second = |x: i64, y: i64, c: i64| {
            let disc = if (x - 24).pow(2) + (y - 20).pow(2) < 64 { 30 } else { 0 };
            (first(x, y, c) + (x * 7 + y * 13 + c * 5) % 23 - 11 + disc).clamp(0, 255)
        };
        let make = |f: &dyn Fn(i64, i64, i64) -> i64| Picture {
            width: width as u32,
            height: height as u32,
            rgb: (0..width * height * 3).map(|k| f(k / 3 % width, k / 3 / width, k % 3) as u8).collect(),
        };
        (make(&first), make(&second))
    }

    #[test]
    fn numbers_agree_with_scikit_image() {
        // structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        // data_range=255, channel_axis=2) of scikit-image, and numpy for the rest.
        let (a, b) = scenes();
        assert_eq!(b.rgb[(20 * 48 + 24) * 3..][..3], [213, 166, 96]);
        let m = compare(&a, &b).unwrap();
        assert!((m.mse - 134.793_402_777_777_77).abs() < 1e-10);
        assert!((m.psnr_db - 26.834_117_239_157_93).abs() < 1e-10);
        assert!((m.ssim - 0.970_170_508_072_461_9).abs() < 1e-10, "{}", m.ssim);

        let disc =
            Mask::from_fn(48, 40, |x, y| (i64::from(x) - 24).pow(2) + (i64::from(y) - 20).pow(2) < 100);
        let m = compare_within(&a, &b, &disc).unwrap();
        assert!((m.mse - 615.724_590_163_934_4).abs() < 1e-10);
        assert!((m.ssim - 0.935_183_316_698_564_8).abs() < 1e-10, "{}", m.ssim);
    }

    #[test]
    fn equal_pictures_are_perfect_and_order_does_not_matter() {
        let (a, b) = scenes();
        let same = compare(&a, &a).unwrap();
        assert_eq!((same.mse, same.psnr_db, same.ssim), (0.0, f64::INFINITY, 1.0));
        assert_eq!(compare(&a, &b).unwrap(), compare(&b, &a).unwrap());
    }

    #[test]
    fn the_null_predictor_is_judged_by_the_same_truth() {
        let (a, b) = scenes();
        let both = compare_with_null(&b, &b, &a, None).unwrap();
        assert_eq!(both.predicted.mse, 0.0);
        assert_eq!(both.null, compare(&a, &b).unwrap());
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let (a, b) = scenes();
        let small = Picture { width: 8, height: 8, rgb: vec![0; 192] };
        assert!(matches!(compare(&a, &small), Err(Error::Size { .. })));
        assert!(matches!(compare(&small, &small), Err(Error::TooSmall { .. })));
        let nothing = Mask::from_fn(48, 40, |_, _| false);
        assert!(matches!(compare_within(&a, &b, &nothing), Err(Error::EmptyRegion)));
        let corner = Mask::from_fn(48, 40, |x, y| x < 3 && y < 3);
        assert!(matches!(compare_within(&a, &b, &corner), Err(Error::EmptyRegion)));
    }
}
