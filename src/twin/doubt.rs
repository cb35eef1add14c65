//! What a solver says of its own answer that whoever uses it should know. Said once: a session has thousands of captures.

use crate::elastomer::{Settings, SolverStats};
use crate::percent::reads_above;
use std::sync::atomic::{AtomicBool, Ordering};

/// An explicit run whose pad moves with more than this part of its elastic energy has not come to rest (found by experiment: presses
/// at the usual speed have a few hundredths).
const RESTLESS: f64 = 0.25;

/// Tells the first doubt and keeps still about others.
#[derive(Debug, Default)]
pub struct Doubts {
    is_told: AtomicBool,
}

impl Doubts {
    /// Warns of a capture if it is in doubt and none was before; `slid` where the indenter slid or turned on its way there.
    pub fn tell(&self, captures: &[u32], slid: bool, stats: &SolverStats, settings: &Settings) {
        let Some(doubt) = of(stats, slid, settings.tolerance) else { return };
        let first = captures.first().copied().unwrap_or_default();
        if self.is_told.swap(true, Ordering::Relaxed) {
            tracing::info!("capture {first}: {doubt}");
        } else {
            tracing::warn!("capture {first}: {doubt}. Others may be, too: what each states is kept with it");
        }
    }
}

/// What is in doubt about an answer, and the next move. Equilibria state an error, explicit runs have a kinetic energy.
fn of(stats: &SolverStats, slid: bool, tolerance: f64) -> Option<String> {
    if let Some(held) = stats.held.filter(|held| *held < 1.0) {
        return Some(format!(
            "the contact, meant to stick, is sure of {:.0} % of its grip alone: beyond a way of twice the depth what holds goes by \
             rounding; slide less far, or set elastomer.friction to a number",
            100.0 * held
        ));
    }
    match stats.estimated_error {
        Some(stated) if reads_above(stated, tolerance) => Some(format!(
            "the pad's surface is stated to be off by {:.2} % of the depth, above the {:.2} % asked for; round edges more{} or \
             lower elastomer.tolerance, which takes finer cells as far as there are any",
            100.0 * stated,
            100.0 * tolerance,
            if slid { ", slide or turn less far," } else { "" }
        )),
        None if stats.residual > RESTLESS => Some(format!(
            "the pad is not at rest: it moves with {:.0} % of its elastic energy, so its forces are not those of an \
             equilibrium; lower elastomer.speed_mm_s, or use elastomer.mode = \"quasi_static\"",
            100.0 * stats.residual
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_in_doubt_where_it_states_more_than_was_asked_or_moves() {
        let stats =
            |estimated_error, residual| SolverStats { estimated_error, residual, ..SolverStats::default() };
        let of = |stats: &SolverStats, tolerance| super::of(stats, true, tolerance);
        assert_eq!(of(&stats(Some(0.009), 0.9), 0.01), None);
        assert_eq!(of(&stats(None, 0.05), 0.01), None);
        assert_eq!(of(&stats(Some(0.010_04), 0.0), 0.01), None, "1.00 % is no more than 1.00 %");
        assert!(of(&stats(Some(0.010_06), 0.0), 0.01).is_some());
        let told = of(&stats(Some(0.023), 0.0), 0.01).unwrap();
        assert!(told.contains("2.30 %") && told.contains("1.00 %"), "{told}");
        // Of slides only where there was one.
        assert!(told.contains("round edges more, slide or turn less far, or lower"), "{told}");
        let pressed = super::of(&stats(Some(0.023), 0.0), false, 0.01).unwrap();
        assert!(pressed.contains("round edges more or lower"), "{pressed}");
        let torn = SolverStats { held: Some(0.25), ..stats(Some(0.009), 0.0) };
        assert!(of(&torn, 0.01).is_some_and(|told| told.contains("25 %")));
        assert_eq!(of(&SolverStats { held: Some(1.0), ..torn }, 0.01), None);
        let told = of(&stats(None, 0.9), 0.01).unwrap();
        assert!(told.contains("90 %") && told.contains("speed_mm_s"), "{told}");
    }
}
