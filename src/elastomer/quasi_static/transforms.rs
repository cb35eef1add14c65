//! Fourier transforms of a lattice that nothing surrounds.

use std::sync::Arc;
use twinrig_fourier::{Direction, Fft, single};

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
            forward: padded.map(|n| single(n, Direction::Forward)),
            back: padded.map(|n| single(n, Direction::Inverse)),
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
