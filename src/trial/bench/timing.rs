//! How long something takes, repeated.

use crate::trial::stress::cpu_seconds;
use serde::Serialize;
use std::time::Instant;

/// Times of the repeats of one piece of work.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Timing {
    /// How often it was done.
    pub repeats: usize,
    /// Least time, s.
    pub min_s: f64,
    /// Median time, s.
    pub median_s: f64,
    /// Least processor time on all threads together, s; those that wait for an equilibrium stay awake and count.
    pub cpu_s: f64,
}

impl Timing {
    /// Of pairs of time and processor time; `None` of none.
    pub fn of(mut samples: Vec<[f64; 2]>) -> Option<Timing> {
        samples.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let n = samples.len();
        let cpu_s = samples.iter().map(|s| s[1]).fold(f64::INFINITY, f64::min);
        (n > 0).then(|| Timing { repeats: n, min_s: samples[0][0], median_s: samples[n / 2][0], cpu_s })
    }
}

/// Does it once and says how long it took: time and processor time.
pub fn once<T>(work: impl FnOnce() -> T) -> (T, [f64; 2]) {
    let (begun, cpu) = (Instant::now(), cpu_seconds());
    let result = work();
    (result, [begun.elapsed().as_secs_f64(), cpu_seconds() - cpu])
}

/// Does it several times; an error ends the repeats.
///
/// # Errors
/// That of the work.
pub fn repeat<T, E>(repeats: usize, mut work: impl FnMut() -> Result<T, E>) -> Result<(T, Timing), E> {
    let (first, sample) = once(&mut work);
    let (mut result, mut samples) = (first?, vec![sample]);
    for _ in 1..repeats {
        let (next, sample) = once(&mut work);
        result = next?;
        samples.push(sample);
    }
    Ok((result, Timing::of(samples).expect("at least one sample was taken")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_and_median_are_members_of_the_sample() {
        let t = Timing::of(vec![[3.0, 1.5], [1.0, 2.0], [2.0, 1.0]]).expect("three samples");
        assert_eq!((t.repeats, t.min_s, t.median_s, t.cpu_s), (3, 1.0, 2.0, 1.0));
        assert_eq!(Timing::of(Vec::new()), None);
        assert_eq!(repeat(3, || Err::<(), _>("no")), Err("no"));
    }
}
