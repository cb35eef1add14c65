//! What the pad is guessed to look like at the next pose, before anything is solved.

use super::super::newton::{Problem, Strain};
use super::Level;
use super::way::{along, along_face, drags, way_between};
use crate::indenter::Indenter;
use crate::pose::Pose;

/// Least volume ratio of a guess.
const GUESS_VOLUME: f32 = 0.1;
/// A step further down, over the depth reached, up to which the solution linearised there is a better guess than a coarser
/// grid's. Found by experiment, a sphere and a punch at 0.25 to 1.2 mm: steps of a tenth of the depth take two thirds of the
/// time, those of a third of it half as much again.
const PRESSES_ON: f64 = 0.15;
/// Part of the last way from which on one that goes on is as well guessed by that alone: the linear solve then costs more than it
/// saves. Found by experiment: slides of a sphere and a punch take a tenth less without it, steps of a tenth of a press a twentieth.
const AS_LONG: f64 = 0.9;

impl Level {
    /// Whether the way to `pose` goes on along the face as the last one did: much of what touched goes on touching.
    pub fn slides_on_to(&self, pose: &Pose) -> bool {
        let way = way_between(&self.at.pose, pose);
        let level = way[2].abs() <= 0.1 * along_face(&way);
        level && self.at.last.as_ref().is_some_and(|(_, last)| along(&way, last).is_some())
    }

    /// Whether the way to `pose` goes on straight down as the last one did, and not far, or straight up: of a face that is let go
    /// coarser grids know nothing better, and nearly incompressible ones do not get there.
    pub fn presses_on_to(&self, indenter: &dyn Indenter, pose: &Pose) -> bool {
        let way = way_between(&self.at.pose, pose);
        let depth_mm = self.at.contacts.depth_mm(indenter, &self.at.pose);
        let straight = !drags(&way) && -way[2] <= PRESSES_ON * depth_mm;
        straight && self.at.last.as_ref().is_some_and(|(_, last)| along(&way, last).is_some())
    }

    /// Guesses the displacement at the next pose: as a coarser level says, else extrapolated where the way
    /// goes on as before, and, unless it goes on as far, one linear solve in which what touches keeps touching. A guess that
    /// folds the pad is dropped. Answers the strain there.
    pub(super) fn guess(&mut self, problem: &Problem<'_>, way: &[f64; 4], hint: Option<&[f32]>) -> Strain {
        let operator = &problem.machine.operator;
        let before = self.at.u.clone();
        if let Some(hint) = hint {
            for (u, h) in self.at.u.iter_mut().zip(hint) {
                *u += h;
            }
            let strain = self.newton.strain(operator, &self.at.u);
            if strain.evaluation.least_volume > GUESS_VOLUME {
                return strain;
            }
            self.at.u.copy_from_slice(&before);
        }
        if self.at.at_rest {
            return self.newton.strain(operator, &self.at.u);
        }
        let presses_on = self.presses_on_to(problem.indenter, problem.pose);
        let mut extrapolated = None;
        if let Some((older, last_way)) = &self.at.last
            && let Some(s) = along(way, last_way)
        {
            for (u, b) in self.at.u.iter_mut().zip(older) {
                *u += s as f32 * (*u - b);
            }
            let strain = self.newton.strain(operator, &self.at.u);
            if strain.evaluation.least_volume > GUESS_VOLUME {
                if s >= AS_LONG && (self.slides_on_to(problem.pose) || presses_on) {
                    return strain;
                }
                extrapolated = Some(strain);
            } else {
                self.at.u.copy_from_slice(&before);
            }
        }
        let strain = extrapolated.unwrap_or_else(|| self.newton.strain(operator, &self.at.u));
        self.newton.predict(problem, &mut self.at.contacts, &mut self.at.u, strain)
    }
}
