//! The search along a step for where the directional derivative of the potential is zero.

use super::super::contact::Contacts;
use super::super::fields::dot;
use super::{Newton, Problem, State};

impl Newton {
    /// Moves `u` along the step to where the directional derivative has fallen enough.
    pub(super) fn search(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &mut Vec<f32>,
    ) -> Option<State> {
        let slope0 = dot(&self.residual, &self.step);
        let norm0 = dot(&self.residual, &self.residual);
        let (mut low, mut slope_low, mut high) = (0.0, slope0, None::<(f64, f64)>);
        let mut moved_low = false;
        let mut alpha = 1.0;
        let mut trial = std::mem::take(&mut self.trial);
        let mut trial_elastic = std::mem::take(&mut self.trial_elastic);
        let mut trial_residual = std::mem::take(&mut self.trial_residual);
        let mut found = None;
        for attempt in 0..12 {
            trial.clear();
            trial.extend(u.iter().zip(&self.step).map(|(u, s)| u + alpha as f32 * s));
            let state = self.measure(problem, contacts, &trial, &mut trial_elastic, &mut trial_residual);
            if !state.valid() {
                high = None;
                alpha = low + 0.4 * (alpha - low);
                continue;
            }
            let slope = dot(&trial_residual, &self.step);
            let norm = dot(&trial_residual, &trial_residual);
            // A full step that does not overshoot is good; a shorter one must have come near the minimum.
            let short = if attempt == 0 { 1.0 } else { 0.7 };
            let inside = slope <= 0.5 * slope0.abs() && slope >= short * slope0;
            let done = inside || (attempt == 0 && norm < 0.25 * norm0);
            if done || attempt == 11 {
                found = Some(state);
                break;
            }
            // Regula falsi in the Illinois form: an end that stays halves its weight.
            if slope < 0.0 {
                if let (Some((_, s)), true) = (&mut high, moved_low) {
                    *s *= 0.5;
                }
                (low, slope_low, moved_low) = (alpha, slope, true);
            } else {
                if high.is_some() && !moved_low {
                    slope_low *= 0.5;
                }
                high = Some((alpha, slope));
                moved_low = false;
            }
            alpha = match high {
                None => (2.0 * alpha).min(8.0),
                Some((h, s)) => low + (h - low) * (slope_low / (slope_low - s)).clamp(0.05, 0.95),
            };
        }
        if found.is_some() {
            std::mem::swap(u, &mut trial);
            std::mem::swap(&mut self.elastic, &mut trial_elastic);
            std::mem::swap(&mut self.residual, &mut trial_residual);
        }
        self.trial = trial;
        self.trial_elastic = trial_elastic;
        self.trial_residual = trial_residual;
        found
    }
}
