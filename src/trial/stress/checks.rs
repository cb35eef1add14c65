//! What must hold: a value and the bound that it must not exceed.

use serde::{Deserialize, Serialize};

/// One thing that was compared with its bound.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// What.
    pub what: String,
    /// The value seen.
    #[serde(with = "number")]
    pub value: f64,
    /// What it must not exceed.
    #[serde(with = "number")]
    pub bound: f64,
}

impl Check {
    /// The value as a part of its bound; infinite for what is no number.
    pub fn part(&self) -> f64 {
        if self.value.is_finite() { self.value / self.bound } else { f64::INFINITY }
    }
}

impl std::fmt::Display for Check {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:.4e} exceeds its bound {:.4e}", self.what, self.value, self.bound)
    }
}

/// The checks of a case.
#[derive(Debug, Clone, Default)]
pub struct Checks {
    worst: Vec<Check>,
    /// Largest error that the solver stated about itself.
    pub stated_error: Option<f64>,
}

impl Checks {
    /// Compares a value with its bound and remembers the worst of each kind.
    pub fn hold(&mut self, what: &str, value: f64, bound: f64) {
        let check = Check { what: what.to_owned(), value, bound };
        match self.worst.iter_mut().find(|c| c.what == what) {
            Some(known) if known.part() >= check.part() => {}
            Some(known) => *known = check,
            None => self.worst.push(check),
        }
    }

    /// The first that does not hold; what is no number before all others.
    pub fn broken(&self) -> Option<&Check> {
        let broken = || self.worst.iter().filter(|c| c.part() > 1.0 || c.part().is_nan());
        broken().find(|c| !c.value.is_finite()).or_else(|| broken().next())
    }

    /// The worst of every kind.
    pub fn into_worst(self) -> Vec<Check> {
        self.worst
    }
}

/// JSON has no word for what is not a number; null stands for it.
mod number {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(value: &f64, s: S) -> Result<S::Ok, S::Error> {
        if value.is_finite() { s.serialize_some(value) } else { s.serialize_none() }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(d)?.unwrap_or(f64::NAN))
    }
}
