//! Sample points: Sobol sequences of four dimensions, Owen-scrambled by hashing, padded.
//!
//! Every group of four dimensions is an independently shuffled and scrambled copy of the first four
//! Sobol dimensions (Burley, "Practical Hash-based Owen Scrambling", JCGT 2020; the scrambling hash is
//! Laine and Karras' with Vegdahl's constants). Within a group any power of two samples is stratified in
//! each elementary interval; across groups, pixels and seeds samples are independent. A point depends on seed,
//! pixel, sample and group alone, so a picture does not depend on who renders which tile.

/// Direction numbers of Sobol dimensions 1 to 3 (Joe and Kuo's initial values), bits reversed; dimension 0
/// is the identity when reversed.
static DIRECTIONS: [[u32; 32]; 3] = [
    reversed_directions(1, 0, [1, 0, 0]),
    reversed_directions(2, 1, [1, 3, 0]),
    reversed_directions(3, 1, [1, 3, 1]),
];

/// Direction numbers from a primitive polynomial of degree `s` with inner coefficients `a`.
const fn reversed_directions(s: usize, a: u32, initial: [u32; 3]) -> [u32; 32] {
    let mut m = [0u32; 32];
    let mut k = 0;
    while k < 32 {
        if k < s {
            m[k] = initial[k];
        } else {
            let mut value = m[k - s] ^ (m[k - s] << s);
            let mut i = 1;
            while i < s {
                if (a >> (s - 1 - i)) & 1 == 1 {
                    value ^= m[k - i] << i;
                }
                i += 1;
            }
            m[k] = value;
        }
        k += 1;
    }
    let mut v = [0u32; 32];
    k = 0;
    while k < 32 {
        v[k] = (m[k] << (31 - k)).reverse_bits();
        k += 1;
    }
    v
}

/// Mixes two words into one; the finaliser is murmur3's.
#[inline]
pub fn hash(a: u32, b: u32) -> u32 {
    let mut x = a ^ b.wrapping_mul(0x9e37_79b9).wrapping_add(0x7f4a_7c15).rotate_left(13);
    x ^= x >> 16;
    x = x.wrapping_mul(0x85eb_ca6b);
    x ^= x >> 13;
    x = x.wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

/// A hash in which each bit depends on itself and lower bits only: an Owen scrambling of reversed bits.
#[inline]
fn scramble_reversed(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The sample points of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Sampler {
    seed: u32,
    mask: u32,
}

impl Sampler {
    /// For pixel (x, y) of a picture with `samples` samples a pixel.
    pub fn new(seed: u32, x: u32, y: u32, samples: u32) -> Self {
        let mask = samples.max(1).next_power_of_two().wrapping_sub(1);
        Self { seed: hash(hash(hash(seed, 0x5eed), x), y), mask }
    }

    /// The four coordinates, in [0, 1), of sample `index` in dimension group `group`.
    #[inline]
    pub fn group(&self, index: u32, group: u32) -> [f32; 4] {
        let seed = hash(self.seed, group);
        // Shuffle the order of the points, within the power of two that the picture uses.
        let mut k = scramble_reversed(index.reverse_bits(), seed).reverse_bits() & self.mask;
        let mut x = [k, 0, 0, 0];
        let mut bit = 0;
        while k != 0 {
            let skip = k.trailing_zeros();
            bit += skip as usize;
            for d in 0..3 {
                x[d + 1] ^= DIRECTIONS[d][bit];
            }
            k = (k >> skip) >> 1;
            bit += 1;
        }
        let mut out = [0.0; 4];
        for d in 0..4 {
            let bits = scramble_reversed(x[d], hash(seed, d as u32 + 1)).reverse_bits();
            out[d] = (bits >> 8) as f32 * (1.0 / 16_777_216.0);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_are_stratified_in_every_dimension_and_in_pairs() {
        for group in 0..20 {
            let s = Sampler::new(7, 3, 9, 256);
            let points: Vec<_> = (0..256).map(|i| s.group(i, group)).collect();
            for d in 0..4 {
                let mut seen = [0; 256];
                points.iter().for_each(|p| seen[(p[d] * 256.0) as usize] += 1);
                assert!(seen.iter().all(|&n| n == 1), "dimension {d} of group {group}");
            }
            // Dimensions 0 and 1 form a (0, 8, 2)-net: one point in each of 16 x 16 boxes, and 4 x 64.
            for (nx, ny) in [(16, 16), (4, 64), (64, 4)] {
                let mut seen = vec![0; 256];
                for p in &points {
                    seen[(p[0] * nx as f32) as usize * ny + (p[1] * ny as f32) as usize] += 1;
                }
                assert!(seen.iter().all(|&n| n == 1));
            }
        }
    }

    #[test]
    fn all_four_dimensions_together_integrate_better_than_random() {
        // f = product of (1 + (x - 1/2)); the mean is 1, and independent samples of N = 1024
        // have a standard error of about 0.019.
        let rms = |samples: u32| {
            let square: f64 = (0..64u32)
                .map(|pixel| {
                    let s = Sampler::new(1, pixel, 0, samples);
                    let sum: f64 = (0..samples)
                        .map(|i| s.group(i, 2).iter().map(|x| 0.5 + f64::from(*x)).product::<f64>())
                        .sum();
                    (sum / f64::from(samples) - 1.0).powi(2)
                })
                .sum();
            (square / 64.0).sqrt()
        };
        assert!(rms(1024) < 0.002, "{}", rms(1024));
        assert!(rms(1024) < rms(256) / 2.5);
    }

    #[test]
    fn pixels_and_groups_are_uncorrelated() {
        let mean = |f: &dyn Fn(u32) -> f64| (0..4096).map(f).sum::<f64>() / 4096.0;
        let a = |i: u32| Sampler::new(1, i, 5, 64);
        let pixel_mean = mean(&|i| f64::from(a(i).group(0, 0)[0]));
        assert!((pixel_mean - 0.5).abs() < 0.02);
        let across =
            mean(&|i| (f64::from(a(i).group(0, 0)[0]) - 0.5) * (f64::from(a(i).group(0, 1)[0]) - 0.5));
        assert!(across.abs() < 0.006, "{across}");
        let neighbours =
            mean(&|i| (f64::from(a(i).group(0, 0)[0]) - 0.5) * (f64::from(a(i + 1).group(0, 0)[0]) - 0.5));
        assert!(neighbours.abs() < 0.006, "{neighbours}");
    }
}
