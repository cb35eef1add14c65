//! Fourier transforms of a lattice that nothing surrounds.

use std::sync::Arc;
use twinrig_fourier::{Direction, Fft, plan};

/// Those along x and y of a lattice with as many points again, so that nothing is felt around the corner.
pub struct Transforms {
    /// Points along x and y.
    pub padded: [usize; 2],
    /// From points to waves.
    pub forward: [Arc<dyn Fft<f32>>; 2],
    /// From waves to points, times the number of them.
    pub back: [Arc<dyn Fft<f32>>; 2],
}

impl Transforms {
    /// Of a lattice of `size` points.
    pub fn around(size: [usize; 2]) -> Self {
        let padded = size.map(|n| quick(2 * n));
        Self {
            padded,
            forward: padded.map(|n| plan(n, Direction::Forward)),
            back: padded.map(|n| plan(n, Direction::Inverse)),
        }
    }
}

/// The next number without prime factors above 5: transforms of so many points are quick.
fn quick(n: usize) -> usize {
    let rest = |n: usize| {
        [2, 3, 5].iter().fold(n, |mut n, p| {
            while n % p == 0 {
                n /= p;
            }
            n
        })
    };
    (n..).find(|n| rest(*n) == 1).unwrap_or(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinrig_fourier::Complex;

    #[test]
    fn forward_and_back_multiply_by_the_points_and_one_wave_is_one_line() {
        let of = Transforms::around([15, 16]);
        assert_eq!(of.padded, [30, 32]);
        for axis in 0..2 {
            let points = of.padded[axis];
            let given: Vec<_> = (0..points).map(|i| Complex::new(i as f32, 1.0)).collect();
            let mut data = given.clone();
            of.forward[axis].process(&mut data);
            of.back[axis].process(&mut data);
            for (got, given) in data.iter().zip(&given) {
                assert!((got / points as f32 - given).norm() < 1e-4, "{points} points: {got} of {given}");
            }
            let turn = |i| std::f64::consts::TAU * i as f64 / points as f64;
            let wave =
                (0..points).map(|i| turn(i).sin_cos()).map(|(sin, cos)| Complex::new(cos as f32, sin as f32));
            let mut wave: Vec<_> = wave.collect();
            of.forward[axis].process(&mut wave);
            for (line, got) in wave.iter().enumerate() {
                let truth = if line == 1 { points as f32 } else { 0.0 };
                assert!((got - truth).norm() < 1e-5, "{points} points, line {line}: {got}");
            }
        }
    }
}
