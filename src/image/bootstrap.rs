//! How sure a mean of paired differences is: the percentile bootstrap (Efron 1979).
//!
//! Captures are resampled with replacement; where captures come in groups that are not independent
//! (the captures of one episode), whole groups are resampled, which keeps the interval honest.

use serde::{Deserialize, Serialize};

/// A mean and its confidence interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Mean of the sample.
    pub mean: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Number of values.
    pub count: usize,
}

/// Mean of `values` with a `confidence` (such as 0.95) interval from `resamples` draws; `None` for no
/// values. Values that are not finite (an infinite PSNR) are left out. Seeded: equal input, equal answer.
pub fn mean_interval(values: &[f64], confidence: f64, resamples: usize, seed: u64) -> Option<Interval> {
    let groups: Vec<usize> = (0..values.len()).collect();
    grouped_mean_interval(values, &groups, confidence, resamples, seed)
}

/// As [`mean_interval`], resampling whole groups; `groups[i]` is the group of `values[i]`.
pub fn grouped_mean_interval(
    values: &[f64],
    groups: &[usize],
    confidence: f64,
    resamples: usize,
    seed: u64,
) -> Option<Interval> {
    // Sum and count of each group.
    let mut sums: std::collections::BTreeMap<usize, (f64, usize)> = std::collections::BTreeMap::new();
    for (&value, &group) in values.iter().zip(groups).filter(|(v, _)| v.is_finite()) {
        let entry = sums.entry(group).or_default();
        *entry = (entry.0 + value, entry.1 + 1);
    }
    let groups: Vec<(f64, usize)> = sums.into_values().collect();
    let mean = |chosen: &mut dyn Iterator<Item = (f64, usize)>| {
        let (sum, count) = chosen.fold((0.0, 0), |(s, c), (gs, gc)| (s + gs, c + gc));
        (sum / count as f64, count)
    };
    let (centre, count) = mean(&mut groups.iter().copied());
    if count == 0 {
        return None;
    }

    let mut state = seed ^ 0x9e37_79b9_7f4a_7c15;
    let mut draw = || {
        // SplitMix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        groups[((u128::from(z) * groups.len() as u128) >> 64) as usize]
    };
    let mut means: Vec<f64> =
        (0..resamples.max(1)).map(|_| mean(&mut (0..groups.len()).map(|_| draw())).0).collect();
    means.sort_by(f64::total_cmp);
    let at = |q: f64| means[((q * (means.len() - 1) as f64).round() as usize).min(means.len() - 1)];
    let tail = (1.0 - confidence) / 2.0;
    Some(Interval { mean: centre, low: at(tail), high: at(1.0 - tail), count })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equally spaced quantiles of a distribution with mean 3 and standard deviation 2 (uniform).
    fn sample(n: usize) -> Vec<f64> {
        (0..n).map(|i| 3.0 + 2.0 * 12f64.sqrt() * ((i as f64 + 0.5) / n as f64 - 0.5)).collect()
    }

    #[test]
    fn the_interval_is_that_of_the_normal_approximation() {
        let n = 400;
        let interval = mean_interval(&sample(n), 0.95, 4000, 1).unwrap();
        let half = 1.96 * 2.0 / (n as f64).sqrt();
        assert!((interval.mean - 3.0).abs() < 1e-9);
        assert!((interval.high - 3.0 - half).abs() < 0.12 * half, "{interval:?}");
        assert!((3.0 - interval.low - half).abs() < 0.12 * half, "{interval:?}");
    }

    #[test]
    fn dependent_captures_widen_it() {
        // Ten copies of each value are no more evidence than one.
        let one = sample(40);
        let ten: Vec<f64> = one.iter().flat_map(|&v| [v; 10]).collect();
        let groups: Vec<usize> = (0..400).map(|i| i / 10).collect();
        let width = |i: Interval| i.high - i.low;
        let honest = width(grouped_mean_interval(&ten, &groups, 0.95, 4000, 1).unwrap());
        let naive = width(mean_interval(&ten, 0.95, 4000, 1).unwrap());
        assert!((honest / naive - 10f64.sqrt()).abs() < 0.3, "{honest} {naive}");
    }

    #[test]
    fn infinite_values_are_left_out_and_nothing_gives_nothing() {
        assert_eq!(mean_interval(&[1.0, f64::INFINITY, 3.0], 0.9, 10, 1).unwrap().mean, 2.0);
        assert_eq!(mean_interval(&[f64::NAN], 0.9, 10, 1), None);
    }
}
