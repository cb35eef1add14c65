//! From linear light to code values: exposure, vignetting, blur, noise, response, 8 bit.
//!
//! The order is that of a camera: the lens darkens the corners and blurs, the sensor counts electrons
//! (shot noise, taken as normal) and adds read noise, the electronics bend the curve and round. All up to the noise is
//! linear in the light: [`arriving`].

use super::{Film, film, noise, sampler::hash, sensor::ImageSpec};
use glam::Vec3;

/// Mean of the untouched picture, linear, where no image of the untouched sensor gives it (found by
/// experiment: a mid grey after the sRGB curve, with headroom for the bright flanks).
const MIDDLE: f32 = 0.35;

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
    for (k, p) in light.pixels.iter_mut().enumerate() {
        let (dx, dy) = ((k % film.width) as f32 + 0.5 - cx, (k / film.width) as f32 + 0.5 - cy);
        *p *= exposure * (1.0 - loss * (dx * dx + dy * dy));
    }
    if spec.blur_px > 0.0 {
        blur(&mut light, spec.blur_px as f32);
    }
    light
}

/// The light with the camera's noise on it.
fn noisy(mut light: Film, spec: &ImageSpec, picture: u32) -> Film {
    let seed = hash(spec.noise_seed, picture);
    let read = (spec.read_noise / 255.0) as f32;
    let shot = spec.full_well_electrons.map_or(0.0, |electrons| 1.0 / electrons as f32);
    if read == 0.0 && shot == 0.0 {
        return light;
    }
    for (k, p) in light.pixels.iter_mut().enumerate() {
        for c in 0..3 {
            let value = p[c].clamp(0.0, 1.0);
            let sigma = (shot * value + read * read).sqrt();
            p[c] = value + sigma * noise::normal(seed, (k * 3 + c) as u32) as f32;
        }
    }
    light
}

/// Response and rounding alone: the inverse of [`decode`], for light that has been through the rest of the camera.
pub fn encode(light: &Film, spec: &ImageSpec) -> Vec<u8> {
    let code = |value: f32| (255.0 * respond(value.clamp(0.0, 1.0), spec)).round() as u8;
    light.pixels.iter().flat_map(|p| p.to_array().map(code)).collect()
}

/// The response curve, 0..1 to 0..1.
fn respond(value: f32, spec: &ImageSpec) -> f32 {
    match spec.gamma {
        None => film::linear_to_srgb(value),
        Some(gamma) => value.powf(1.0 / gamma as f32),
    }
}

/// Light of a code value: the inverse of the response curve.
pub fn decode(code: u8, spec: &ImageSpec) -> f32 {
    match spec.gamma {
        None => film::srgb_to_linear(code),
        Some(gamma) => (f32::from(code) / 255.0).powf(gamma as f32),
    }
}

/// Separable Gaussian blur; the picture is continued by its border.
fn blur(film: &mut Film, sigma: f32) {
    let radius = (3.0 * sigma).ceil() as isize;
    let mut kernel: Vec<f32> =
        (-radius..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    kernel.iter_mut().for_each(|w| *w /= sum);
    let (width, height) = (film.width as isize, film.height as isize);
    for (dx, dy) in [(1, 0), (0, 1)] {
        let source = film.pixels.clone();
        for (k, p) in film.pixels.iter_mut().enumerate() {
            let (x, y) = (k as isize % width, k as isize / width);
            *p = kernel
                .iter()
                .zip(-radius..)
                .map(|(w, i)| {
                    let (sx, sy) = ((x + dx * i).clamp(0, width - 1), (y + dy * i).clamp(0, height - 1));
                    source[(sy * width + sx) as usize] * *w
                })
                .sum::<Vec3>();
        }
    }
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
            for code in 0..=255 {
                assert_eq!(
                    encode(
                        &Film { width: 1, height: 1, pixels: vec![Vec3::splat(decode(code, &spec))] },
                        &spec
                    ),
                    [code; 3]
                );
            }
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

    /// An edge under a Gaussian of width s is the normal distribution's integral: 0.1587 at a width before it.
    #[test]
    fn a_blurred_edge_is_the_integral_of_the_gaussian() {
        let mut edge = grey(0.0);
        edge.pixels
            .iter_mut()
            .enumerate()
            .for_each(|(k, p)| *p = Vec3::splat(f32::from(u8::from(k % 64 >= 32))));
        blur(&mut edge, 4.0);
        // Pixel 32 begins at the edge: middles are half a pixel off.
        for (x, truth) in [(31, 0.450_26), (29, 0.266_0), (27, 0.130_3), (36, 0.869_7)] {
            assert!((edge.at(x, 20).x - truth).abs() < 3e-3, "{x} {}", edge.at(x, 20).x);
        }
    }

    #[test]
    fn blur_keeps_light_and_vignetting_darkens_the_corners() {
        let mut point = grey(0.0);
        point.pixels[24 * 64 + 32] = Vec3::ONE;
        blur(&mut point, 2.0);
        let sum: f32 = point.pixels.iter().map(|p| p.x).sum();
        let peak = point.at(32, 24).x;
        assert!((sum - 1.0).abs() < 1e-4 && (peak - 1.0 / (std::f32::consts::TAU * 4.0)).abs() < 2e-3);

        let spec = ImageSpec { gamma: Some(1.0), vignetting: 0.5, ..ImageSpec::default() };
        let codes = expose(&grey(0.8), &spec, 1.0, 0);
        assert!(codes[0] < 107 && codes[(24 * 64 + 32) * 3] == 204);
    }
}
