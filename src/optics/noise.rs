//! Seeded random numbers by hashing: the same for a seed and an index on every machine and thread.

use super::sampler::hash;

/// A uniform number in (0, 1).
pub fn uniform(seed: u32, index: u32) -> f64 {
    (f64::from(hash(hash(seed, 0x0a01_5e00), index)) + 0.5) / 4_294_967_296.0
}

/// A standard normal number (Box and Muller).
pub fn normal(seed: u32, index: u32) -> f64 {
    let (u, v) = (uniform(seed, index), uniform(hash(seed, 0x0b0b), index));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_mean_zero_variance_one_and_no_memory() {
        let n = 40_000;
        let x: Vec<f64> = (0..n).map(|i| normal(3, i)).collect();
        let mean = |f: &dyn Fn(usize) -> f64| (0..x.len() - 1).map(f).sum::<f64>() / f64::from(n);
        assert!(mean(&|i| x[i]).abs() < 0.02);
        assert!((mean(&|i| x[i] * x[i]) - 1.0).abs() < 0.03);
        assert!((mean(&|i| x[i].powi(4)) - 3.0).abs() < 0.2);
        assert!(mean(&|i| x[i] * x[i + 1]).abs() < 0.02);
    }
}
