//! Seeded random numbers by hashing: the same for a seed and an index on every machine and thread.

use super::sampler::hash;
use std::sync::LazyLock;

/// A uniform number in (0, 1).
pub fn uniform(seed: u32, index: u32) -> f64 {
    (f64::from(hash(hash(seed, 0x0a01_5e00), index)) + 0.5) / 4_294_967_296.0
}

/// A standard normal number (Box and Muller).
pub fn normal(seed: u32, index: u32) -> f64 {
    let (u, v) = (uniform(seed, index), uniform(hash(seed, 0x0b0b), index));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Bits of an index into the table of normals; two of them fit into a hash.
const TABLE_BITS: u32 = 12;

/// Normals to add up in pairs, each with its opposite, their variance a half.
static TABLE: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let half: Vec<f64> = (0..1 << (TABLE_BITS - 1)).map(|i| normal(0x7ab1e, i)).collect();
    let variance = half.iter().map(|x| x * x).sum::<f64>() / half.len() as f64;
    let scale = (0.5 / variance).sqrt();
    half.iter().flat_map(|x| [(x * scale) as f32, (-x * scale) as f32]).collect()
});

/// Standard normal numbers for pictures: sums of two out of a table, twenty times faster than [`normal`].
#[derive(Debug, Clone, Copy)]
pub struct Normals {
    seed: u32,
    table: &'static [f32],
}

impl Normals {
    /// The numbers of a seed.
    pub fn new(seed: u32) -> Self {
        Self { seed: hash(seed, 0x0a01_5e00), table: &TABLE }
    }

    /// One of them.
    #[inline]
    pub fn at(&self, index: u32) -> f32 {
        let bits = hash(self.seed, index);
        let of = |bits: u32| self.table[(bits & ((1 << TABLE_BITS) - 1)) as usize];
        of(bits) + of(bits >> (32 - TABLE_BITS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_mean_zero_variance_one_and_no_memory() {
        let n = 40_000;
        let quick = Normals::new(3);
        for x in [
            (0..n).map(|i| normal(3, i)).collect::<Vec<f64>>(),
            (0..n).map(|i| f64::from(quick.at(i))).collect(),
        ] {
            let mean = |f: &dyn Fn(usize) -> f64| (0..x.len() - 1).map(f).sum::<f64>() / f64::from(n);
            assert!(mean(&|i| x[i]).abs() < 0.02);
            assert!((mean(&|i| x[i] * x[i]) - 1.0).abs() < 0.03);
            assert!((mean(&|i| x[i].powi(4)) - 3.0).abs() < 0.2);
            assert!(mean(&|i| x[i] * x[i + 1]).abs() < 0.02);
            assert!((mean(&|i| f64::from(u8::from(x[i].abs() > 3.0))) - 0.0027).abs() < 0.001);
        }
    }

    /// Frames of a camera are seeded by their number: neighbours must not share their noise.
    #[test]
    fn seeds_side_by_side_have_nothing_in_common() {
        let (a, b) = (Normals::new(hash(0, 4)), Normals::new(hash(0, 5)));
        let product: f64 = (0..40_000).map(|i| f64::from(a.at(i) * b.at(i))).sum();
        assert!((product / 40_000.0).abs() < 0.02);
    }
}
