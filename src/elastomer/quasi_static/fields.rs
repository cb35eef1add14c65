//! Sums and products of fields, each in a fixed order whatever the number of threads.

use rayon::prelude::*;

/// Numbers of a field that one thread goes over at a time.
const RUN: usize = 4096;
/// Numbers that are gone over before another thread that is awake has begun.
const SHORT: usize = 4 * RUN;

/// Dot product: single precision in runs of 256, double beyond; the order is fixed.
pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    let chunk = |(a, b): (&[f32], &[f32])| -> f64 {
        a.chunks(256)
            .zip(b.chunks(256))
            .map(|(a, b)| {
                let mut lanes = [0.0f32; 16];
                let (ha, hb) = (a.chunks_exact(16), b.chunks_exact(16));
                let rest: f32 = ha.remainder().iter().zip(hb.remainder()).map(|(x, y)| x * y).sum();
                for (x, y) in ha.zip(hb) {
                    for l in 0..16 {
                        lanes[l] += x[l] * y[l];
                    }
                }
                lanes.iter().map(|v| f64::from(*v)).sum::<f64>() + f64::from(rest)
            })
            .sum()
    };
    if a.len() <= SHORT {
        return a.chunks(RUN).zip(b.chunks(RUN)).map(chunk).sum();
    }
    let parts: Vec<f64> = a.par_chunks(RUN).zip(b.par_chunks(RUN)).map(chunk).collect();
    parts.iter().sum()
}

/// Adds `a` times `x` to `y`.
pub fn add_scaled(y: &mut [f32], x: &[f32], a: f32) {
    in_runs(y, x, |y, x| *y += a * x);
}

/// Does something to every number of a field, with that of another.
pub fn in_runs(y: &mut [f32], x: &[f32], change: impl Fn(&mut f32, &f32) + Sync) {
    let run = |(y, x): (&mut [f32], &[f32])| y.iter_mut().zip(x).for_each(|(y, x)| change(y, x));
    if y.len() <= SHORT {
        run((y, x));
    } else {
        y.par_chunks_mut(RUN).zip(x.par_chunks(RUN)).for_each(run);
    }
}
