//! Fourier transforms, compiled once (`fourier/Cargo.toml` says why).

use rustfft::FftPlanner;
pub use rustfft::num_complex::Complex;
pub use rustfft::{Fft, FftDirection as Direction};
use std::sync::Arc;

/// A transform of `points` numbers of single precision; back and forth together multiply by `points`.
pub fn single(points: usize, direction: Direction) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft(points, direction)
}

/// A transform of `points` numbers of double precision; back and forth together multiply by `points`.
pub fn double(points: usize, direction: Direction) -> Arc<dyn Fft<f64>> {
    FftPlanner::new().plan_fft(points, direction)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_and_forth_multiplies_by_the_points() {
        for points in [1, 30, 31, 128] {
            let given: Vec<_> = (0..points).map(|i| Complex::new(i as f32, 1.0)).collect();
            let mut data = given.clone();
            single(points, Direction::Forward).process(&mut data);
            single(points, Direction::Inverse).process(&mut data);
            for (got, given) in data.iter().zip(&given) {
                assert!((got / points as f32 - given).norm() < 1e-4, "{points} points: {got} of {given}");
            }
            let mut wave: Vec<_> = (0..points)
                .map(|i| Complex::from_polar(1.0, std::f64::consts::TAU * i as f64 / points as f64))
                .collect();
            double(points, Direction::Forward).process(&mut wave);
            assert!((wave[1 % points].re - points as f64).abs() < 1e-9, "one wave is one line");
        }
    }
}
