//! Sample points: Sobol sequences of four dimensions, Owen-scrambled by hashing, padded.
//!
//! Every group of four dimensions is an independently shuffled and scrambled copy of the first four
//! Sobol dimensions (Burley, "Practical Hash-based Owen Scrambling", JCGT 2020; the scrambling hash is
//! Laine and Karras' with Vegdahl's constants). Within a group any power of two samples has one point in each of as many
//! elementary intervals of dimensions 0 and 1, and of any one alone; of other pairs, and of all four, its share in intervals at most
//! eight times as large. Across groups, pixels and seeds samples are independent, but in
//! pixels of four samples or fewer: there dimensions 0 and 2, and 1 and 3, of a point have something in common. A point depends on seed, pixel, sample and
//! group alone, so a picture does not depend on who renders which tile.

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
mod tests;
