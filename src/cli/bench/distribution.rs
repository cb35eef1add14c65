//! How a measured time is distributed.

use serde::Serialize;

/// Some percentiles and the ends of a sample, ms.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(super) struct Distribution {
    /// How many were measured.
    pub n: usize,
    pub min_ms: f64,
    pub p50_ms: f64,
    pub p90_ms: f64,
    pub p99_ms: f64,
    pub max_ms: f64,
}

impl Distribution {
    /// Of times in ms. A percentile is the smallest value that so many of the sample do not exceed.
    pub(super) fn of(mut sample: Vec<f64>) -> Distribution {
        sample.sort_by(f64::total_cmp);
        let n = sample.len();
        let at = |part: f64| match n {
            0 => f64::NAN,
            _ => sample[((part * n as f64).ceil() as usize).clamp(1, n) - 1],
        };
        Distribution {
            n,
            min_ms: at(0.0),
            p50_ms: at(0.5),
            p90_ms: at(0.9),
            p99_ms: at(0.99),
            max_ms: at(1.0),
        }
    }
}

impl std::fmt::Display for Distribution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Distribution { n, min_ms, p50_ms, p90_ms, p99_ms, max_ms } = self;
        write!(
            f,
            "min {min_ms:6.2}  p50 {p50_ms:6.2}  p90 {p90_ms:6.2}  p99 {p99_ms:6.2}  max {max_ms:6.2} ms  (n = {n})"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_members_of_the_sample() {
        let d = Distribution::of((1..=200).rev().map(f64::from).collect());
        assert_eq!((d.min_ms, d.p50_ms, d.p90_ms, d.p99_ms, d.max_ms), (1.0, 100.0, 180.0, 198.0, 200.0));
        assert_eq!(Distribution::of(vec![7.0]).p99_ms, 7.0);
        assert!(Distribution::of(Vec::new()).max_ms.is_nan());
    }
}
