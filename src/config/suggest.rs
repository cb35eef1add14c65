//! Did you mean ...?

/// The word nearest to a mistyped one, if any is near.
pub fn closest<'a>(typed: &str, words: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let allowed = 1 + typed.chars().count() / 3;
    let cut_short = |w: &str| typed.len() >= 3 && w.starts_with(typed);
    words
        .map(|w| (distance(typed, w), w))
        .filter(|(d, w)| *d <= allowed || cut_short(w))
        .min_by_key(|(d, _)| *d)
        .map(|(_, w)| w)
}

/// Letters to insert, remove, replace or swap with their neighbour (optimal string alignment).
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) =
        (a.to_lowercase().chars().collect(), b.to_lowercase().chars().collect());
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            rows[i][j] = if i == 0 || j == 0 {
                i + j
            } else {
                let replace = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
                let mut best = replace.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
                if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                    best = best.min(rows[i - 2][j - 2] + 1);
                }
                best
            };
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_of_the_finger_are_recognised_and_other_words_are_not() {
        let words = ["youngs_modulus_mpa", "mode", "friction", "tolerance"];
        let near = |typed| closest(typed, words.into_iter());
        assert_eq!(near("youngs_modulus"), Some("youngs_modulus_mpa"));
        assert_eq!(near("mdoe"), Some("mode"));
        assert_eq!(near("Friction"), Some("friction"));
        assert_eq!(near("tol"), Some("tolerance"));
        assert_eq!(near("colour"), None);
        assert_eq!(distance("kitten", "sitting"), 3);
    }
}
