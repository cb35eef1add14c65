//! The response of the electronics: linear light to 8-bit code values and back.
//!
//! A picture has a million values and only 256 codes: the lights at which the code goes up are worked out once a picture and
//! looked up, which gives the codes of the formula at a tenth of the time of its powers.

use super::{Film, film, sensor::ImageSpec};
use rayon::prelude::*;

/// Buckets of the look-up: the curve's steepest common piece (sRGB near black) has less than one step in each.
const BUCKETS: usize = 4096;
/// Pixels that are worth a thread's while.
const PIXELS: usize = 16_384;

/// Response and rounding: the inverse of [`decode`].
pub fn encode(light: &Film, spec: &ImageSpec) -> Vec<u8> {
    let steps = Steps::new(spec);
    let mut codes = vec![0; 3 * light.pixels.len()];
    codes.par_chunks_mut(3 * PIXELS).zip(light.pixels.par_chunks(PIXELS)).for_each(|(codes, pixels)| {
        for (code, p) in codes.chunks_exact_mut(3).zip(pixels) {
            code.copy_from_slice(&p.to_array().map(|value| steps.code(value)));
        }
    });
    codes
}

/// Light of a code value: the inverse of the response curve.
pub fn decode(code: u8, spec: &ImageSpec) -> f32 {
    match spec.gamma {
        None => film::srgb_to_linear(code),
        Some(gamma) => (f32::from(code) / 255.0).powf(gamma as f32),
    }
}

/// The code value of light by the formula.
fn respond(value: f32, spec: &ImageSpec) -> u8 {
    let response = match spec.gamma {
        None => film::linear_to_srgb(value),
        Some(gamma) => value.powf(1.0 / gamma as f32),
    };
    (255.0 * response).round() as u8
}

/// The response curve as a stair.
struct Steps {
    /// The least light of each code.
    from: [f32; 256],
    /// The code at which each bucket begins.
    start: [u8; BUCKETS + 1],
}

impl Steps {
    fn new(spec: &ImageSpec) -> Self {
        let mut from = [0.0; 256];
        for code in 1..=255u8 {
            // Floats from 0 to 1 are ordered like their bits.
            let (mut below, mut above) = (0, 1.0f32.to_bits());
            while above - below > 1 {
                let middle = below + (above - below) / 2;
                if respond(f32::from_bits(middle), spec) < code { below = middle } else { above = middle }
            }
            from[usize::from(code)] = f32::from_bits(above);
        }
        let mut start = [0; BUCKETS + 1];
        for (k, code) in start.iter_mut().enumerate() {
            *code = respond(k as f32 / BUCKETS as f32, spec);
        }
        Self { from, start }
    }

    fn code(&self, value: f32) -> u8 {
        let value = value.clamp(0.0, 1.0);
        let mut code = self.start[(value * BUCKETS as f32) as usize];
        while code < 255 && value >= self.from[usize::from(code) + 1] {
            code += 1;
        }
        code
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn film(values: impl Iterator<Item = f32>) -> Film {
        let pixels: Vec<Vec3> = values.map(Vec3::splat).collect();
        Film { width: pixels.len(), height: 1, pixels }
    }

    #[test]
    fn the_stair_is_the_formula_and_decoding_inverts_it() {
        for gamma in [None, Some(0.2), Some(1.0), Some(2.2), Some(5.0)] {
            let spec = ImageSpec { gamma, ..ImageSpec::default() };
            let values = || (-1000..40_000).map(|i| i as f32 / 37_003.7);
            let truth: Vec<u8> = values().flat_map(|v| [respond(v.clamp(0.0, 1.0), &spec); 3]).collect();
            assert_eq!(encode(&film(values()), &spec), truth, "{gamma:?}");
            let codes = encode(&film((0..=255).map(|code| decode(code, &spec))), &spec);
            assert!(codes.chunks_exact(3).zip(0..=255).all(|(c, code)| c == [code; 3]), "{gamma:?}");
        }
    }
}
