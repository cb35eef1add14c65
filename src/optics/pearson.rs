//! Pearson's test: whether counts are such as a density makes them.
//!
//! Every sampler claims a density, and everything that divides by it believes the claim. A test bins what was drawn,
//! expects of each bin what the density gives, and asks how likely counts as far off as these would be by chance.

/// Bins that expect fewer are thrown together: of few counts the statistic is not distributed as the test takes it to be.
const LEAST_EXPECTED: f64 = 10.0;

/// The part of chances below which counts are called others than the density's. Seeds are fixed, so a test that passes does so
/// always.
pub const UNLIKELY: f64 = 1e-4;

/// The part of chances that would leave counts at least as far from what is expected.
pub fn chance(seen: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(seen.len(), expected.len());
    let (mut statistic, mut bins, mut rest) = (0.0, 0.0, [0.0; 2]);
    let mut count = |seen: f64, expected: f64| {
        statistic += (seen - expected).powi(2) / expected;
        bins += 1.0;
    };
    for (seen, expected) in seen.iter().zip(expected) {
        if *expected >= LEAST_EXPECTED {
            count(*seen, *expected);
        } else {
            rest = [rest[0] + seen, rest[1] + expected];
        }
    }
    if rest[1] > 0.0 || rest[0] > 0.0 {
        // (What none is expected of, and is there even so, counts in full.)
        count(rest[0], rest[1].max(1e-3));
    }
    above(statistic, bins - 1.0)
}

/// As likely is a larger value of the chi-squared distribution of so many degrees of freedom (its cube root is nearly normal: Wilson
/// and Hilferty 1931).
fn above(statistic: f64, freedom: f64) -> f64 {
    assert!(freedom >= 1.0, "one bin tells nothing");
    let variance = 2.0 / (9.0 * freedom);
    let sigmas = ((statistic / freedom).cbrt() - (1.0 - variance)) / variance.sqrt();
    // The normal distribution beyond that, by Abramowitz and Stegun 26.2.17.
    let t = 1.0 / (1.0 + 0.231_641_9 * sigmas.abs());
    let series = t
        * (0.319_381_530
            + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = series * (-0.5 * sigmas * sigmas).exp() / std::f64::consts::TAU.sqrt();
    if sigmas >= 0.0 { tail } else { 1.0 - tail }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::noise::uniform;

    #[test]
    fn chances_are_those_of_the_tables() {
        for (statistic, freedom, chance) in [
            (18.307, 10.0, 0.05),
            (29.588, 10.0, 0.001),
            (149.449, 100.0, 0.001),
            (77.929, 100.0, 0.95),
            (161.319, 100.0, 1e-4),
        ] {
            let found = above(statistic, freedom);
            assert!(
                (found / chance - 1.0).abs() < 0.1,
                "{statistic} of {freedom}: {found} instead of {chance}"
            );
        }
    }

    /// What every test by [`chance`] rests on: that it tells a density that is a little off from the one that is drawn.
    #[test]
    fn a_density_off_by_a_twentieth_is_told_and_the_right_one_passes() {
        const BINS: usize = 144;
        const N: u32 = 100_000;
        let mut seen = [0.0; BINS];
        (0..N).for_each(|i| seen[(uniform(1, i) * BINS as f64) as usize] += 1.0);
        let even = f64::from(N) / BINS as f64;
        let expected =
            |off: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..BINS).map(|k| even * off(k)).collect() };
        assert!(chance(&seen, &expected(&|_| 1.0)) > 0.01);
        // Too large throughout; too large in one half and too small in the other; a bin of no density that is hit.
        let wrong: [&dyn Fn(usize) -> f64; 3] =
            [&|_| 1.05, &|k| if k < BINS / 2 { 1.05 } else { 0.95 }, &|k| {
                if k == 7 { 0.0 } else { BINS as f64 / (BINS as f64 - 1.0) }
            }];
        for (number, off) in wrong.into_iter().enumerate() {
            let found = chance(&seen, &expected(off));
            assert!(found < UNLIKELY, "{number}: {found}");
        }
    }
}
