//! The sweep that looks for wrong answers: several hundred cases, each of which must end in a correct answer or in a
//! typed error that says what to change.
//!
//! A case is a pad, settings, an indenter and a path ([`cases`]; some are hostile on purpose, [`hostile`]). It is
//! followed ([`walk`] for the quasi-static mode, [`explicit`] for the others), and everything that must hold whatever
//! the pad is compared with a stated bound ([`checks`]): finite numbers, balance of base and contact, no penetration,
//! no fold, work and energy, resistance, symmetry, return to rest, agreement with the exact bonded layer, with a finer
//! solution, with itself. A bound grows with the error that the solver itself states, because what is told is not
//! silent.
//!
//! **Verdicts** ([`Verdict`]). Correct and refused are right; wrong, not finite, panicked, hung and accepted (a
//! setting that makes no sense was taken) are failures. This module sees panics; that a case hangs or takes the process
//! with it is seen by whoever runs it in a process of its own.
//!
//! The cases are numbered; number and seed give the same case for ever.

pub mod cases;
pub mod checks;
pub mod explicit;
pub mod hostile;
pub mod thin;
pub mod walk;

pub use cases::{Body, Case, Family, case};
pub use checks::{Check, Checks};

use crate::elastomer::{Error, Mode};
use serde::{Deserialize, Serialize};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// How a case ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every check held.
    Correct,
    /// A typed error that says what to change.
    Refused,
    /// A check did not hold, and the solver did not say so.
    Wrong,
    /// Something was not a number.
    NotFinite,
    /// A setting or a pose that makes no sense was taken.
    Accepted,
    /// An error without advice.
    Adviceless,
    /// A panic, or the process died.
    Panicked,
    /// Not done within the time allowed.
    Hung,
}

impl Verdict {
    /// All, the good ones first.
    pub const ALL: [Verdict; 8] = [
        Verdict::Correct,
        Verdict::Refused,
        Verdict::Wrong,
        Verdict::NotFinite,
        Verdict::Accepted,
        Verdict::Adviceless,
        Verdict::Panicked,
        Verdict::Hung,
    ];

    /// Whether a case may not end so.
    pub fn is_failure(self) -> bool {
        !matches!(self, Verdict::Correct | Verdict::Refused)
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Correct => "correct",
            Verdict::Refused => "refused",
            Verdict::Wrong => "silently wrong",
            Verdict::NotFinite => "not finite",
            Verdict::Accepted => "nonsense accepted",
            Verdict::Adviceless => "no advice",
            Verdict::Panicked => "panic",
            Verdict::Hung => "hang",
        }
    }
}

/// What became of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Number of the case.
    pub number: u32,
    /// Its family.
    pub family: Family,
    /// The case in a line.
    pub title: String,
    /// How it ended.
    pub verdict: Verdict,
    /// The error, or the check that failed.
    pub what: String,
    /// Kind of the error: `setting`, `not_converged`, `unresolved`, `off_pad`, `diverged`, `drifted`,
    /// `passed_through`; empty without one.
    pub error: String,
    /// Every check at its worst.
    pub checks: Vec<Check>,
    /// Largest error that the solver stated.
    pub stated_error: Option<f64>,
    /// Processor time it took, s.
    pub cpu_s: f64,
}

impl Judgement {
    /// The check that came nearest to its bound, or went furthest beyond it.
    pub fn worst(&self) -> Option<&Check> {
        self.checks.iter().max_by(|a, b| a.part().total_cmp(&b.part()))
    }

    /// A case about which only its end is known.
    pub fn ended(case: &Case, verdict: Verdict, what: String, cpu_s: f64) -> Judgement {
        Judgement {
            number: case.number,
            family: case.family,
            title: case.title(),
            verdict,
            what,
            error: String::new(),
            checks: Vec::new(),
            stated_error: None,
            cpu_s,
        }
    }
}

/// Runs a case in this thread and judges it.
pub fn run(case: &Case) -> Judgement {
    let begun = cpu_seconds();
    let mut checks = Checks::default();
    let mut follow = || match case.settings.mode {
        Mode::QuasiStatic => walk::follow(case, &mut checks),
        Mode::Mpm | Mode::Impm => explicit::follow(case, &mut checks),
    };
    // On a thread of the pool: from outside, every parallel loop would wait to be woken twice.
    let ended = catch_unwind(AssertUnwindSafe(|| rayon::scope(|_| follow())));
    let cpu_s = cpu_seconds() - begun;
    let mut judgement = Judgement::ended(case, Verdict::Correct, String::new(), cpu_s);
    match ended {
        Err(panic) => {
            judgement.verdict = Verdict::Panicked;
            let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
            judgement.what =
                text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic".into());
        }
        Ok(Err(error)) => {
            judgement.what = error.to_string();
            judgement.error = kind(&error).to_owned();
            judgement.verdict = if advises(&judgement.what) { Verdict::Refused } else { Verdict::Adviceless };
        }
        Ok(Ok(())) => {
            if case.hostile.is_some() {
                judgement.verdict = Verdict::Accepted;
                judgement.what = "this should have been refused".into();
            }
        }
    }
    // What was wrong before an error came is wrong all the same.
    if let Some(check) = checks.broken() {
        judgement.verdict = if check.value.is_finite() { Verdict::Wrong } else { Verdict::NotFinite };
        judgement.what = check.to_string();
    }
    judgement.stated_error = checks.stated_error;
    judgement.checks = checks.into_worst();
    judgement
}

/// Seconds of processor time that this process has used, on all cores together.
pub fn cpu_seconds() -> f64 {
    let ts = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    ts.tv_sec as f64 + ts.tv_nsec as f64 * 1e-9
}

fn kind(error: &Error) -> &'static str {
    match error {
        Error::Diverged { .. } => "diverged",
        Error::Drifted { .. } => "drifted",
        Error::PassedThrough { .. } => "passed_through",
        Error::NotConverged { .. } => "not_converged",
        Error::Unresolved { .. } => "unresolved",
        Error::OffPad { .. } => "off_pad",
        Error::Setting { .. } => "setting",
        Error::Interrupted => "interrupted",
        Error::Pose { .. } => "pose",
        Error::Low { .. } => "low",
    }
}

/// Whether a message says what to do: a range, or a verb.
fn advises(message: &str) -> bool {
    const VERBS: [&str; 14] = [
        "choose", "correct", "set ", "lower", "raise", "use ", "keep", "leave", "must", "at least",
        "at most", "place", "ask", "from 0",
    ];
    VERBS.iter().any(|verb| message.contains(verb))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::spec::{Plan, Shape};
    use crate::trial::scene;

    fn bodies() -> Vec<Body> {
        let shape = Shape::Dome { radius_mm: 3.0, diameter_mm: 6.0 };
        vec![Body { name: "sphere".into(), spec: scene::spec(shape, 0.0) }]
    }

    #[test]
    fn the_same_number_is_the_same_case_and_every_family_comes() {
        let bodies = bodies();
        let families: std::collections::BTreeSet<Family> =
            (0..360).map(|n| case(n, 1, &bodies).family).collect();
        assert_eq!(families.len(), Family::ALL.len());
        for n in 0..60 {
            // As text, because hostile settings hold what is not equal to itself.
            let (a, b) = (case(n, 1, &bodies), case(n, 1, &bodies));
            assert_eq!(format!("{a:?}"), format!("{b:?}"));
        }
    }

    #[test]
    fn a_broken_check_is_told_whatever_the_end() {
        let mut checks = Checks::default();
        checks.hold("balance", 0.5, 1.0);
        assert!(checks.broken().is_none());
        checks.hold("balance", 1.5, 1.0);
        checks.hold("balance", 0.2, 1.0);
        assert_eq!(checks.broken().map(|c| c.value), Some(1.5));
        checks.hold("finite", f64::NAN, 1.0);
        assert!(checks.broken().is_some_and(|c| c.value.is_nan()));
    }

    #[test]
    fn settings_and_pads_that_make_no_sense_are_refused_with_advice() {
        let bodies = bodies();
        let mut seen = std::collections::BTreeSet::new();
        for n in 0..260 {
            let case = case(n, 1, &bodies);
            let Some(name) = case.hostile else { continue };
            seen.insert(name);
            // Poses are met on the way, so they are left to the sweep, which can end what does not end.
            if !name.starts_with("po") && !name.starts_with("depth") {
                let judgement = run(&case);
                assert_eq!(judgement.verdict, Verdict::Refused, "{judgement:?}");
            }
        }
        assert_eq!(seen.len(), hostile::NAMES.len(), "every hostile thing comes by");
    }

    #[test]
    fn a_solver_that_lies_is_caught() {
        // A sound solver's captures, falsified before they are judged.
        let bodies = bodies();
        let mut sound = (0..400)
            .map(|n| case(n, 1, &bodies))
            .find(|c| c.family == Family::Layer)
            .expect("a case of the exact layer");
        // Coarse, to be quick.
        sound.settings.tolerance = 0.03;
        let judgement = run(&sound);
        assert_eq!(judgement.verdict, Verdict::Correct, "{judgement:?}");
        let mut checks = Checks::default();
        let result = walk::follow_as(&sound, &mut checks, |c| {
            c.forces.normal_force_n *= 1.5;
            c.stats.base_reaction_n *= 1.5;
        });
        assert!(result.is_ok() && checks.broken().is_some());
        let mut checks = Checks::default();
        let result = walk::follow_as(&sound, &mut checks, |c| c.stats.base_reaction_n *= 1.05);
        assert!(result.is_ok() && checks.broken().is_some_and(|c| c.what == "balance"));
        let mut checks = Checks::default();
        let result = walk::follow_as(&sound, &mut checks, |c| {
            c.surface.positions[7].x = f32::NAN;
        });
        assert!(result.is_ok() && checks.broken().is_some_and(|c| !c.value.is_finite()));
    }

    #[test]
    fn a_thin_body_that_is_missed_is_caught() {
        let bodies = bodies();
        let mut blade = (330..360)
            .map(|n| case(n, 1, &bodies))
            .find(|c| c.family == Family::Thin)
            .expect("a case of a thin body");
        let plan = Plan::Rectangle { x_mm: 0.2, y_mm: 8.0 };
        blade.body.spec = scene::spec(Shape::Flat { plan }, 0.0);
        (blade.settings.tolerance, blade.depth_mm, blade.slide_mm) = (0.05, 0.1, 0.0);
        let judged = |part: f64| {
            let mut checks = Checks::default();
            let result = walk::follow_as(&blade, &mut checks, |c| {
                c.forces.normal_force_n *= part;
                c.stats.base_reaction_n *= part;
                c.stats.elastic_energy_n_mm *= part;
            });
            assert!(result.is_ok(), "{result:?}");
            checks.broken().cloned()
        };
        assert_eq!(judged(1.0), None);
        assert!(judged(0.05).is_some_and(|broken| broken.what.contains("thin body")));
    }
}
