//! Noise of the virtual camera's sensor, and the random numbers behind everything seeded here.
//!
//! A code value v becomes v * gain + offset + n, n normal with variance read^2 + shot * v (shot noise grows
//! with the light). The same seed and frame number give the same noise.

use crate::device::camera::settings::VirtualSettings;

/// A small seeded generator (SplitMix64; Steele, Lea, Flood 2014).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// A stream of numbers of its own for each seed and purpose.
    pub fn new(seed: u64, purpose: u64) -> Self {
        let mut random = Self(seed ^ purpose.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        random.next();
        random
    }

    /// 64 random bits.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Standard normal (Box and Muller).
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f32::consts::TAU * self.uniform()).cos()
    }
}

/// Bits of an index into the table of normals.
const TABLE_BITS: u32 = 12;

/// Turns code values into what the sensor delivers.
#[derive(Debug, Clone)]
pub struct SensorNoise {
    seed: u64,
    gain: f32,
    offset: f32,
    /// Standard normals to draw from: drawing from a table is ten times faster than making them.
    normals: Vec<f32>,
    /// Standard deviation by code value.
    sigma: [f32; 256],
}

impl SensorNoise {
    /// The noise that the rig file asks for.
    pub fn new(settings: &VirtualSettings) -> Self {
        let mut random = Random::new(settings.seed, 0x401);
        let mut normals: Vec<f32> = (0..1 << TABLE_BITS).map(|_| random.normal()).collect();
        // The table's own mean and spread are corrected, so that noise has exactly the asked strength.
        let n = normals.len() as f32;
        let mean = normals.iter().sum::<f32>() / n;
        let spread = (normals.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / n).sqrt();
        normals.iter_mut().for_each(|x| *x = (*x - mean) / spread);
        let (read, shot) = (settings.read_noise, settings.shot_noise);
        let sigma = std::array::from_fn(|v| (read * read + shot * v as f64).sqrt() as f32);
        Self {
            seed: settings.seed,
            gain: settings.gain as f32,
            offset: settings.offset as f32,
            normals,
            sigma,
        }
    }

    /// The frame of that number, from ideal code values.
    pub fn expose(&self, ideal: &[f32], sequence: u32) -> Vec<u8> {
        let mut random = Random::new(self.seed, 0x5e9_0000_0000 | u64::from(sequence));
        let mask = (1u64 << TABLE_BITS) - 1;
        let mut out = vec![0; ideal.len()];
        for (bytes, values) in out.chunks_mut(5).zip(ideal.chunks(5)) {
            let mut bits = random.next();
            for (byte, value) in bytes.iter_mut().zip(values) {
                let v = value * self.gain + self.offset;
                let sigma = self.sigma[v.clamp(0.0, 255.0) as usize];
                let noisy = v + sigma * self.normals[(bits & mask) as usize];
                bits >>= TABLE_BITS;
                *byte = (noisy + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_asked_mean_and_spread_and_is_repeatable() {
        let settings = VirtualSettings {
            read_noise: 2.0,
            shot_noise: 0.05,
            gain: 1.1,
            offset: 3.0,
            ..Default::default()
        };
        let noise = SensorNoise::new(&settings);
        let frame = noise.expose(&vec![100.0; 60_000], 7);
        let n = frame.len() as f64;
        let mean = frame.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
        let variance = frame.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
        // 113 after gain and offset; variance 4 + 0.05 * 113, and 1/12 of rounding.
        assert!((mean - 113.0).abs() < 0.06, "mean {mean}");
        assert!((variance - (4.0 + 5.65 + 1.0 / 12.0)).abs() < 0.35, "variance {variance}");
        assert_eq!(frame, noise.expose(&vec![100.0; 60_000], 7));
        assert_ne!(frame, noise.expose(&vec![100.0; 60_000], 8));
    }
}
