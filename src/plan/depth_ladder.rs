//! Ladders: the depths, distances or angles at which captures are taken.

use crate::problem::Problems;
use serde::Deserialize;

/// Rungs are rounded to a billionth of the unit, so that 3 x 0.1 is 0.3.
const PER_UNIT: f64 = 1e9;

/// Most rungs of one ladder: more is a mistyped step.
const MOST_RUNGS: f64 = 10_000.0;

/// The `[depths]` table: start, stop and step, or a list.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthsTable {
    /// First depth, mm.
    pub start_mm: Option<f64>,
    /// Last depth, mm, included.
    pub stop_mm: Option<f64>,
    /// Distance between two depths, mm.
    pub step_mm: Option<f64>,
    /// The depths one by one, mm.
    pub list_mm: Option<Vec<f64>>,
}

impl DepthsTable {
    /// The depths, increasing; `None` after reporting why there are none.
    pub fn check(&self, problems: &mut Problems) -> Option<Vec<f64>> {
        match (&self.list_mm, self.start_mm, self.stop_mm, self.step_mm) {
            (Some(list), None, None, None) => check_list(list, problems),
            (None, Some(start), Some(stop), Some(step)) => {
                problems.range("start_mm", start, 0.0, 20.0, "mm");
                problems.range("stop_mm", stop, 0.0, 20.0, "mm");
                rungs("step_mm", start, stop, step, "mm", problems)
            }
            _ => {
                problems.push(
                    "",
                    "an incomplete or doubled ladder",
                    "start_mm, stop_mm and step_mm, or list_mm alone",
                    "write `start_mm = 0.0`, `stop_mm = 1.0`, `step_mm = 0.1`, or `list_mm = [0.5]`",
                );
                None
            }
        }
    }
}

fn check_list(list: &[f64], problems: &mut Problems) -> Option<Vec<f64>> {
    if list.is_empty() {
        problems.push("list_mm", "[]", "at least one depth", "write e.g. `list_mm = [0.5]`");
        return None;
    }
    let mut sound = true;
    for (i, depth) in list.iter().enumerate() {
        let key = format!("list_mm.[{i}]");
        if !(0.0..=20.0).contains(depth) {
            problems.range(&key, *depth, 0.0, 20.0, "mm");
            sound = false;
        } else if i > 0 && *depth <= list[i - 1] {
            let allowed = format!("more than {} mm, the depth before it", list[i - 1]);
            problems.push(&key, depth, allowed, "list the depths from shallow to deep, each once");
            sound = false;
        }
    }
    sound.then(|| list.to_vec())
}

/// From `start` to `stop` in equal steps, both ends included. Reports a step that does not divide
/// the way, since the last capture would then not be where the plan says.
pub(super) fn rungs(
    step_key: &str,
    start: f64,
    stop: f64,
    step: f64,
    unit: &str,
    problems: &mut Problems,
) -> Option<Vec<f64>> {
    let way = stop - start;
    let count = way / step;
    if !(step.is_finite() && step > 0.0 && way.is_finite() && way >= 0.0 && count <= MOST_RUNGS) {
        let allowed =
            format!("a positive step from {start} up to {stop} {unit}, at most {MOST_RUNGS} of them");
        problems.push(step_key, step, allowed, "correct the ends or the step");
        return None;
    }
    let whole = count.round();
    if (count - whole).abs() > 1e-6 {
        let fitting = way / count.ceil();
        problems.push(
            step_key,
            step,
            format!("a step that divides {way} {unit} into whole parts"),
            format!("use a step of {fitting:.6} {unit}, or move the end"),
        );
        return None;
    }
    Some((0..=whole as u32).map(|i| rounded(start + f64::from(i) * step)).collect())
}

/// To the nearest billionth, without a negative zero.
pub(super) fn rounded(value: f64) -> f64 {
    (value * PER_UNIT).round() / PER_UNIT + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ladder(start: f64, stop: f64, step: f64) -> (Option<Vec<f64>>, usize) {
        let mut problems = Problems::new();
        let rungs = rungs("step_mm", start, stop, step, "mm", &mut problems);
        (rungs, problems.into_vec().len())
    }

    #[test]
    fn tenths_are_what_a_person_would_write() {
        let (rungs, _) = ladder(0.0, 1.0, 0.1);
        assert_eq!(rungs.unwrap(), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]);
    }

    #[test]
    fn a_step_that_misses_the_end_or_never_arrives_is_refused() {
        for (start, stop, step) in [
            (0.0, 1.0, 0.3),
            (0.0, 1.0, 0.0),
            (0.0, 1.0, -0.1),
            (1.0, 0.0, 0.1),
            (0.0, 1.0, f64::NAN),
            (0.0, 1.0, 1e-7),
        ] {
            assert_eq!(ladder(start, stop, step), (None, 1), "{start} {stop} {step}");
        }
    }

    #[test]
    fn a_list_must_increase() {
        let mut problems = Problems::new();
        assert!(check_list(&[0.5, 0.5, -1.0], &mut problems).is_none());
        let found = problems.into_vec();
        assert_eq!(found[0].key, "list_mm[1]");
        assert_eq!(found[1].allowed, "0 to 20 mm");
    }
}
