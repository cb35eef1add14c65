//! From linear light to code values: exposure, vignetting, blur, noise, response, 8 bit.
//!
//! The order is that of a camera: the lens darkens the corners and blurs, the sensor counts electrons
//! (shot noise, taken as normal) and adds read noise, the electronics bend the curve and round. All up to the noise is
//! linear in the light: [`arriving`].

use super::noise::Normals;
use super::response::{decode, encode};
use super::{Film, blur, sampler::hash, sensor::ImageSpec};
use glam::Vec3;
use rayon::prelude::*;
use std::borrow::Cow;

/// Mean of the untouched picture, linear, where no image of the untouched sensor gives it (found by
/// experiment: a mid grey after the sRGB curve, with headroom for the bright flanks).
const MIDDLE: f32 = 0.35;
/// Rows that are worth a thread's while.
const ROWS: usize = 8;

/// Mean light of code values.
pub fn mean_light(rgb: &[u8], spec: &ImageSpec) -> f32 {
    let sum: f64 = rgb.iter().map(|code| f64::from(decode(*code, spec))).sum();
    (sum / rgb.len().max(1) as f64) as f32
}

/// The factor on radiance: the file's, or else the one that gives the untouched picture the mean of the untouched image.
pub fn exposure(spec: &ImageSpec, untouched: &Film, image_mean: Option<f32>) -> f32 {
    let mean = untouched.mean().element_sum() / 3.0;
    match spec.exposure {
        Some(exposure) => exposure as f32,
        None if mean > 0.0 => image_mean.unwrap_or(MIDDLE) / mean,
        None => 1.0,
    }
}

/// The picture as code values, row 0 on top. `exposure` multiplies the radiance; `picture` numbers the frame, so
/// that each has its own noise.
pub fn expose(film: &Film, spec: &ImageSpec, exposure: f32, picture: u32) -> Vec<u8> {
    encode(&noisy(arriving(film, spec, exposure), spec, picture), spec)
}

/// The light that the sensor's chip counts, full scale at 1: exposed, darkened towards the corners and blurred.
pub fn arriving(film: &Film, spec: &ImageSpec, exposure: f32) -> Film {
    let mut light = film.clone();
    let (cx, cy) = (film.width as f32 / 2.0, film.height as f32 / 2.0);
    let loss = spec.vignetting as f32 / (cx * cx + cy * cy);
    light.pixels.par_chunks_mut(film.width.max(1)).with_min_len(ROWS).enumerate().for_each(|(y, row)| {
        let dy = y as f32 + 0.5 - cy;
        for (x, p) in row.iter_mut().enumerate() {
            let dx = x as f32 + 0.5 - cx;
            *p *= exposure * (1.0 - loss * (dx * dx + dy * dy));
        }
    });
    if spec.blur_px > 0.0 {
        blur::blur(&mut light, spec.blur_px as f32);
    }
    light
}

/// Light as the lens blurs it, before anything else.
pub fn blurred<'a>(light: &'a Film, spec: &ImageSpec) -> Cow<'a, Film> {
    if spec.blur_px <= 0.0 {
        return Cow::Borrowed(light);
    }
    let mut light = light.clone();
    blur::blur(&mut light, spec.blur_px as f32);
    Cow::Owned(light)
}

/// The light with the camera's noise on it.
fn noisy(mut light: Film, spec: &ImageSpec, picture: u32) -> Film {
    let read = (spec.read_noise / 255.0) as f32;
    let shot = spec.full_well_electrons.map_or(0.0, |electrons| 1.0 / electrons as f32);
    if read == 0.0 && shot == 0.0 {
        return light;
    }
    let normals = Normals::new(hash(spec.noise_seed, picture));
    let width = light.width.max(1);
    light.pixels.par_chunks_mut(width).with_min_len(ROWS).enumerate().for_each(|(y, row)| {
        for (k, p) in (y * width..).zip(row) {
            let value = p.clamp(Vec3::ZERO, Vec3::ONE);
            let n = Vec3::from_array([0, 1, 2].map(|c| normals.at((3 * k + c) as u32)));
            *p = value + (value * shot + read * read).map(f32::sqrt) * n;
        }
    });
    light
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: f32) -> Film {
        Film { width: 64, height: 48, pixels: vec![Vec3::splat(value); 64 * 48] }
    }

    #[test]
    fn without_effects_decoding_inverts_the_response() {
        for gamma in [None, Some(0.2), Some(1.0), Some(2.2), Some(5.0)] {
            let spec = ImageSpec { gamma, ..ImageSpec::default() };
            for code in [0, 1, 17, 128, 254, 255] {
                assert!(expose(&grey(decode(code, &spec)), &spec, 1.0, 0).iter().all(|&c| c == code));
            }
        }
    }

    #[test]
    fn noise_has_the_variance_of_its_electrons_and_its_seed() {
        let spec = ImageSpec {
            gamma: Some(1.0),
            full_well_electrons: Some(1000.0),
            read_noise: 2.0,
            ..ImageSpec::default()
        };
        let codes = expose(&grey(0.5), &spec, 1.0, 4);
        assert_eq!(codes, expose(&grey(0.5), &spec, 1.0, 4));
        assert_ne!(codes, expose(&grey(0.5), &spec, 1.0, 5));
        let n = codes.len() as f64;
        let mean = codes.iter().map(|&c| f64::from(c)).sum::<f64>() / n;
        let variance = codes.iter().map(|&c| (f64::from(c) - mean).powi(2)).sum::<f64>() / n;
        // 0.5/1000 of full scale squared, 2 codes squared, 1/12 from rounding.
        let truth = 0.5 / 1000.0 * 255.0 * 255.0 + 4.0 + 1.0 / 12.0;
        assert!((mean - 127.5).abs() < 0.3 && (variance / truth - 1.0).abs() < 0.05, "{mean} {variance}");
    }

    /// E = exposure L (1 - v r^2/r_corner^2), rounded; r from the middle of the picture.
    #[test]
    fn exposure_and_vignetting_follow_their_formula() {
        let spec = ImageSpec { gamma: Some(1.0), vignetting: 0.3, ..ImageSpec::default() };
        let codes = expose(&grey(0.4), &spec, 1.5, 0);
        for (x, y) in [(0, 0), (63, 0), (10, 40), (31, 23), (32, 0)] {
            let (dx, dy) = (x as f64 + 0.5 - 32.0, y as f64 + 0.5 - 24.0);
            let truth = 255.0 * 1.5 * 0.4 * (1.0 - 0.3 * (dx * dx + dy * dy) / 1600.0);
            assert!((f64::from(codes[(y * 64 + x) * 3]) - truth).abs() <= 0.51, "{x} {y} {truth}");
        }
    }

    #[test]
    fn vignetting_darkens_the_corners() {
        let spec = ImageSpec { gamma: Some(1.0), vignetting: 0.5, ..ImageSpec::default() };
        let codes = expose(&grey(0.8), &spec, 1.0, 0);
        assert!(codes[0] < 107 && codes[(24 * 64 + 32) * 3] == 204);
    }
}
