//! Fourier transforms, compiled once (`fourier/Cargo.toml` says why).

use rustfft::FftPlanner;
pub use rustfft::num_complex::Complex;
pub use rustfft::{Fft, FftDirection as Direction};
use std::sync::Arc;

/// A transform of `points` numbers of single precision; back and forth together multiply by `points`.
pub fn plan(points: usize, direction: Direction) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft(points, direction)
}
