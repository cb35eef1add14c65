//! Smoothing of a field over a lattice.

use rayon::prelude::*;

/// Lines of a lattice that one thread smooths at once.
const LINES_AT_ONCE: usize = 16;

/// Smooths a field by a Gaussian whose standard deviations along x and y are given in points; at its ends it is continued as
/// its mirror image.
pub fn smooth(field: &mut [f32], [nx, ny]: [usize; 2], deviation: [f64; 2]) {
    let weights = deviation.map(|s| {
        let reach = (4.0 * s).ceil() as i64;
        let all: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / s).powi(2)).exp()).collect();
        let sum: f64 = all.iter().sum();
        all.iter().map(|w| (w / sum) as f32).collect::<Vec<_>>()
    });
    let mirrored = |at: i64, n: usize| {
        let period = 2 * (n as i64 - 1).max(1);
        let at = at.rem_euclid(period);
        at.min(period - at) as usize
    };
    let before = field.to_vec();
    let lines = LINES_AT_ONCE * nx;
    field.par_chunks_mut(lines).zip(before.par_chunks(lines)).for_each(|(field, before)| {
        let reach = (weights[0].len() / 2) as i64;
        let mut line = Vec::new();
        for (field, before) in field.chunks_mut(nx).zip(before.chunks(nx)) {
            line.clear();
            line.extend((-reach..nx as i64 + reach).map(|at| before[mirrored(at, nx)]));
            for (k, to) in field.iter_mut().enumerate() {
                *to = weights[0].iter().zip(&line[k..]).map(|(w, v)| w * v).sum();
            }
        }
    });
    let before = field.to_vec();
    field.par_chunks_mut(lines).enumerate().for_each(|(m, field)| {
        let reach = (weights[1].len() / 2) as i64;
        for (j, field) in field.chunks_mut(nx).enumerate() {
            field.fill(0.0);
            for (k, weight) in weights[1].iter().enumerate() {
                let from = mirrored((m * LINES_AT_ONCE + j) as i64 + k as i64 - reach, ny);
                field.iter_mut().zip(&before[from * nx..]).for_each(|(to, v)| *to += weight * v);
            }
        }
    });
}
