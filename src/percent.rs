//! Parts as people read them: in hundredths of a percent.

/// Whether a part reads as more than another. What differs by less than is shown is no news.
pub fn reads_above(part: f64, limit: f64) -> bool {
    let shown = |part: f64| (1e4 * part).round();
    shown(part) > shown(limit)
}

#[cfg(test)]
mod tests {
    use super::reads_above;

    #[test]
    fn what_reads_the_same_is_not_above() {
        assert!(!reads_above(0.010_04, 0.01) && !reads_above(0.01, 0.010_04) && !reads_above(f64::NAN, 0.01));
        assert!(reads_above(0.010_06, 0.01));
    }
}
