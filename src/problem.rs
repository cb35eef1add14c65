//! What is wrong with a user's file: every problem at once, each with the next move.
//!
//! A domain checks its own settings and reports a key path relative to where its table begins
//! (`pad.thickness_mm`); `config` knows the file and finds the line.

/// One thing that is wrong with one key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Dotted key path, e.g. `arm.axes.z.travel_mm`; list elements as `[2]`.
    pub key: String,
    /// The offending value as the user wrote it.
    pub value: String,
    /// What would have been accepted.
    pub allowed: String,
    /// What to do about it.
    pub next: String,
}

/// Collects problems below a key prefix.
#[derive(Debug, Default)]
pub struct Problems {
    prefix: Vec<String>,
    found: Vec<Problem>,
    doubted: Vec<String>,
}

impl Problems {
    /// An empty collection at the root of a file.
    pub fn new() -> Self {
        Self::default()
    }

    /// An empty collection, for a file at whose keys `doubted` something else was read than was written.
    pub fn doubting(doubted: Vec<String>) -> Self {
        Self { doubted, ..Self::default() }
    }

    /// Whether what a key of the file (given from its root) and all below it say is what was written. What follows
    /// from another table is judged only then.
    pub fn is_certain(&self, key: &str) -> bool {
        let below = |rest: &str| rest.is_empty() || rest.starts_with(['.', '[']);
        !self.doubted.iter().any(|doubted| doubted.strip_prefix(key).is_some_and(below))
    }

    /// Runs `check` with `key` appended to the prefix.
    pub fn within(&mut self, key: impl Into<String>, check: impl FnOnce(&mut Problems)) {
        self.prefix.push(key.into());
        check(self);
        self.prefix.pop();
    }

    /// Adds a problem with `key` (relative to the present prefix; empty for the prefix itself).
    pub fn push(
        &mut self,
        key: &str,
        value: impl std::fmt::Display,
        allowed: impl Into<String>,
        next: impl Into<String>,
    ) {
        let mut path = self.prefix.clone();
        if !key.is_empty() {
            path.push(key.to_owned());
        }
        let key = path.join(".").replace(".[", "[");
        self.found.push(Problem {
            key,
            value: value.to_string(),
            allowed: allowed.into(),
            next: next.into(),
        });
    }

    /// Requires `min <= value <= max` (and a finite value).
    pub fn range(&mut self, key: &str, value: f64, min: f64, max: f64, unit: &str) {
        if !(value.is_finite() && value >= min && value <= max) {
            let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
            self.push(
                key,
                value,
                format!("{min} to {max}{unit}"),
                format!("choose a value from {min} to {max}{unit}"),
            );
        }
    }

    /// Whether nothing was found.
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// How many were found.
    pub fn len(&self) -> usize {
        self.found.len()
    }

    /// Everything found, in order.
    pub fn into_vec(self) -> Vec<Problem> {
        self.found
    }
}

/// More digits in a row than anybody reads.
const LEGIBLE_DIGITS: usize = 24;

/// The text with its longest numbers in short: nobody counts the noughts of a number of three hundred digits.
pub fn legible(text: &str) -> String {
    let is_of_number = |c: char| c.is_ascii_digit() || c == '.';
    let mut shown = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(begin) = rest.find(|c: char| c.is_ascii_digit()) {
        let (before, from) = rest.split_at(begin);
        let number = &from[..from.find(|c| !is_of_number(c)).unwrap_or(from.len())];
        let after = &from[number.len()..];
        // Part of a name or a path is no number.
        let is_free = |c: Option<char>| c.is_none_or(|c| !(c.is_alphanumeric() || matches!(c, '_' | '/')));
        let is_alone = is_free(before.chars().next_back()) && is_free(after.chars().next());
        let short = number.trim_end_matches('.').parse::<f64>();
        shown.push_str(before);
        match short {
            Ok(value) if number.len() > LEGIBLE_DIGITS && is_alone => {
                let dot = if number.ends_with('.') { "." } else { "" };
                shown.push_str(&format!("{value:e}{dot}"));
            }
            _ => shown.push_str(number),
        }
        rest = after;
    }
    shown + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_numbers_are_told_in_short() {
        let long = format!("x {:.3} to {} mm, {}", 1e300, -1e300, f64::MIN_POSITIVE);
        assert_eq!(legible(&long), "x 1e300 to -1e300 mm, 2.2250738585072014e-308");
        for kept in ["", "0.30000000000000004 and 12.5.", "1e300", "/a/111111111111111111111111111111", "é 7"]
        {
            assert_eq!(legible(kept), kept);
        }
        assert_eq!(legible(&format!("It is {}.", 1e30)), "It is 1e30.");
    }

    #[test]
    fn prefixes_nest_and_lists_read_naturally() {
        let mut problems = Problems::new();
        problems.within("axes", |p| p.within("[2]", |p| p.range("travel_mm", -1.0, 0.0, 300.0, "mm")));
        let found = problems.into_vec();
        assert_eq!(found[0].key, "axes[2].travel_mm");
        assert_eq!(found[0].allowed, "0 to 300 mm");
    }

    #[test]
    fn what_stands_beside_a_doubt_is_certain() {
        let problems = Problems::doubting(vec!["axes.z.max".to_owned()]);
        assert!(!problems.is_certain("axes.z") && !problems.is_certain("axes.z.max"));
        assert!(problems.is_certain("axes.z.min") && problems.is_certain("axes.za"));
    }
}
