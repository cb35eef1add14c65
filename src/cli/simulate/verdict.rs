//! What `--judge` found of the pictures: how far each is from the reference mode's, beside what it states of itself.

use crate::optics::judge::Judged;
use std::sync::{Mutex, PoisonError};

/// What was found of the pictures so far.
#[derive(Debug, Default)]
pub(super) struct Verdicts(Mutex<Vec<Verdict>>);

/// What was found of one.
#[derive(Debug, Clone, Copy, serde::Serialize)]
struct Verdict {
    capture: u32,
    /// relRMSE against the reference mode, its noise taken off, and below what that is not known.
    light_error_found: f64,
    light_error_floor: f64,
    /// What the picture states; None of one of a single sample, which states nothing.
    light_error: Option<f64>,
}

/// What was found of all.
#[derive(Debug, serde::Serialize)]
pub(super) struct Found {
    judged: usize,
    /// The one that is farthest off.
    worst: Verdict,
    /// Captures whose pictures are farther off than they state.
    beyond_stated: Vec<u32>,
}

impl Verdicts {
    pub fn add(&self, capture: u32, judged: Judged, stated: Option<f64>) {
        let Judged { error, floor } = judged;
        let verdict =
            Verdict { capture, light_error_found: error, light_error_floor: floor, light_error: stated };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(verdict);
    }

    /// All together; none if nothing was judged.
    pub fn found(self) -> Option<Found> {
        let mut all = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        all.sort_by_key(|verdict| verdict.capture);
        let worst = all.iter().copied().max_by(|a, b| a.light_error_found.total_cmp(&b.light_error_found))?;
        let is_beyond = |v: &&Verdict| v.light_error.is_some_and(|stated| !v.judged().agrees_with(stated));
        let beyond_stated = all.iter().filter(is_beyond).map(|verdict| verdict.capture).collect();
        Some(Found { judged: all.len(), worst, beyond_stated })
    }
}

impl Verdict {
    fn judged(&self) -> Judged {
        Judged { error: self.light_error_found, floor: self.light_error_floor }
    }
}

impl std::fmt::Display for Found {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { judged, worst, beyond_stated } = self;
        let percent = |part: f64| 100.0 * part;
        let (found, floor) = (percent(worst.light_error_found), percent(worst.light_error_floor));
        let number = worst.capture;
        write!(f, "{judged} judged, the worst is {number}: {found:.2} % off (floor {floor:.2} %)")?;
        if let Some(stated) = worst.light_error {
            write!(f, ", states {:.2} %", percent(stated))?;
        }
        match &beyond_stated[..] {
            [] => write!(f, "; none is farther off than it states"),
            captures => write!(f, "; farther off than they state: {captures:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_is_told_and_who_states_too_little() {
        let verdicts = Verdicts::default();
        for (capture, error, stated) in
            [(7, 0.004, Some(0.005)), (2, 0.02, Some(0.006)), (3, 0.03, Some(0.03)), (9, 0.5, None)]
        {
            verdicts.add(capture, Judged { error, floor: 0.001 }, stated);
        }
        let found = verdicts.found().unwrap();
        assert_eq!((found.judged, found.worst.capture, &found.beyond_stated[..]), (4, 9, &[2][..]));
        let told = found.to_string();
        assert!(told.contains("the worst is 9: 50.00 % off (floor 0.10 %); farther"), "{told}");
        assert!(Verdicts::default().found().is_none());
    }
}
