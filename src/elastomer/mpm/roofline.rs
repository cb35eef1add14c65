//! The roofline: what the machine itself can do at best, measured with the same instruction set as the kernels, which is the
//! peak of fused products and the stream from and to memory. A rate says little without its bound.
//!
//! The peak is that of independent chains of fused multiply-add in registers, two flops each: three, six or twelve of
//! them, since lanes of four registers leave room for three and those of one need eight to hide the latency. The stream
//! reads an array larger than the caches of a core and writes it back changed. Every thread does the same, and the best of
//! several rounds counts: a bound must not be too low because something else ran.

use super::lanes::{Isa, Kernel, Lanes, Row, WIDTH};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Links of all chains together in one round, about a millisecond.
const LINKS: usize = 3_000_000;
/// Rounds.
const ROUNDS: usize = 15;
/// Rows of each thread's part of the stream, 64 MB: beyond the caches' share of a thread.
const ROWS: usize = 1 << 20;
/// Passes over it.
const STREAMS: usize = 4;

/// What the machine can do on some threads.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Roofline {
    /// Threads of the measurement.
    pub threads: usize,
    /// Single-precision flops a second, a fused multiply-add as two.
    pub flops_per_s: f64,
    /// Bytes a second, read and written together.
    pub bytes_per_s: f64,
}

/// `N` chains of fused products.
struct Chains<const N: usize> {
    factor: f32,
}

impl<const N: usize> Kernel for Chains<N> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f32 {
        // Towards 1 from both sides, so that nothing is subnormal or infinite.
        let (factor, rest) = (L::fill(self.factor), L::fill(1.0 - self.factor));
        let mut x = [factor; N];
        for k in 0..N {
            x[k] = L::fill(0.5 + k as f32 * 0.1);
        }
        for _ in 0..LINKS / N {
            for k in 0..N {
                x[k] = x[k].mul_add(factor, rest);
            }
        }
        let mut sum = x[0];
        for k in 1..N {
            sum = sum + x[k];
        }
        let mut row = Row::ZERO;
        sum.store(&mut row);
        row.0.iter().sum()
    }
}

/// Reads rows and writes them back.
struct Stream<'a> {
    rows: &'a mut [Row],
}

impl Kernel for Stream<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let one = L::fill(1.0);
        for row in self.rows {
            (L::load(row) + one).store(row);
        }
    }
}

impl Roofline {
    /// Measures on the threads of the present pool.
    pub fn measure(isa: Isa) -> Roofline {
        let threads = rayon::current_num_threads();
        let round = |chains: &(dyn Fn() -> f32 + Sync)| {
            let begun = Instant::now();
            rayon::broadcast(|_| black_box(chains()));
            begun.elapsed().as_secs_f64()
        };
        let factor = black_box(0.999);
        let mut least = f64::INFINITY;
        for _ in 0..ROUNDS {
            least = least.min(round(&|| isa.run(Chains::<3> { factor })));
            least = least.min(round(&|| isa.run(Chains::<6> { factor })));
            least = least.min(round(&|| isa.run(Chains::<12> { factor })));
        }
        // Each thread makes and touches its own rows.
        let streams = rayon::broadcast(|_| {
            let mut rows = vec![Row([1.0; WIDTH]); ROWS];
            let times = (0..STREAMS).map(|_| {
                let begun = Instant::now();
                isa.run(Stream { rows: &mut rows });
                black_box(&rows);
                begun.elapsed().as_secs_f64()
            });
            times.fold(f64::INFINITY, f64::min)
        });
        let slowest = streams.into_iter().fold(0.0, f64::max);
        let flops = (threads * LINKS * WIDTH * 2) as f64;
        let bytes = (threads * ROWS * size_of::<Row>() * 2) as f64;
        Roofline { threads, flops_per_s: flops / least, bytes_per_s: bytes / slowest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chains_are_not_shortened_and_the_stream_is_written() {
        // x -> factor x + 1 - factor tends to 1 from wherever it begins, in every lane of every chain.
        for isa in Isa::available() {
            assert!((isa.run(Chains::<6> { factor: 0.999 }) - (6 * WIDTH) as f32).abs() < 0.1);
            let mut rows = vec![Row([2.0; WIDTH]); 3];
            isa.run(Stream { rows: &mut rows });
            assert_eq!(rows, vec![Row([3.0; WIDTH]); 3]);
        }
        let roofline = Roofline::measure(Isa::best());
        // No machine of this century is slower, none faster per thread.
        let per_thread = roofline.flops_per_s / roofline.threads as f64;
        assert!(per_thread > 1e7 && per_thread < 1e12, "{roofline:?}");
        assert!(roofline.bytes_per_s > 1e7 && roofline.bytes_per_s < 1e13, "{roofline:?}");
    }
}
