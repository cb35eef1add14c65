//! When a pad is solved again with finer cells, and when it is not.
//!
//! A tolerance picks cells that meet it for smooth bodies ([`Resolution::for_tolerance`]). Flat bodies with edges have
//! twice the error or more, and narrow ones fall between the cells. Every answer states its error, so a way that
//! states too much is gone again. Where a drag that slips has a poor answer, or none, and the next finer cells have no better one, those
//! after them are tried, as long as none were in vain before (a crescent that turns with friction 0.5 at tolerance 0.05 is drawn through
//! the face over those of 0.63 and 0.42 mm, and states 2 % over those of 0.31 mm; what sticks tears over all).
//! Cells that find no equilibrium, and finer ones, are not tried again before rest; where those of a
//! press find none for a drag, it is dragged with the cells that it began with, and where these are of no use, with the next finer, if
//! they are wider than those that failed. What a press is not resolved at is no bar to going deeper: finer cells are tried there
//! as if nobody had asked before.

use super::cascade::{FINEST, REFINED, Step, rest_at};
use super::resolution::Resolution;
use super::{QuasiStaticSolver, relief, take_counters};
use crate::elastomer::{Approach, Error, Friction};
use crate::pose::Pose;

/// Stated error over the one asked for that finer cells aim at: what is stated counts the edge of the contact in, where
/// the face is furthest off. Outside a band of 0.2 mm there it is about half as far off, a slab all of it (found by
/// experiment against cells of 0.2 mm).
const GOOD_ENOUGH: f64 = 1.5;
/// Stated error over the one aimed at that is worth pressing again with finer cells, which take three to ten times as
/// long.
const WORTHWHILE: f64 = 1.15;
/// The same for whoever has gone on from the first press: the way is longer.
const WORTHWHILE_LATER: f64 = 8.0 / 3.0;
/// The same for a drag with friction, whose force is off by one to one and a half times what is stated. Found by experiment: with
/// edges rounded by 0.3 mm, 0.5 mm deep and slid by 0.25 and 0.5 mm with friction 0.5, shell, dots, cone and crossed lines drag 3.5 to
/// 8 % too little over cells that state 2.6 to 7.5 %.
const WORTHWHILE_IN_A_DRAG: f64 = 1.5;
/// The same where the face folds in a slip, so that no more than the tolerance is stated: that may be a third of what it is off by there,
/// and finer cells carry it.
const WORTHWHILE_WHERE_IT_FOLDS: f64 = 2.0 / 3.0;
/// Cells over finer ones that are worth a guess of their own.
const WORTH_A_GUESS: f64 = 1.6;
/// Cells whose widths differ by less are as fine, mm.
const ROUNDING_MM: f64 = 1e-9;
/// A stated error with which an answer is none.
const UNRESOLVED: f64 = 0.2;
/// A stated error with which the splines are a ground for the relief to stand on, and a slip is good enough to be left where the next
/// finer cells are no better.
pub const OF_USE: f64 = UNRESOLVED / 2.0;

/// Stated error that finer cells aim at.
pub fn wanted(tolerance: f64) -> f64 {
    GOOD_ENOUGH * tolerance
}

impl QuasiStaticSolver {
    /// Follows the way again while an answer states too much or there is none, and finer cells may help.
    ///
    /// # Errors
    /// [`Error::Interrupted`]; that finer cells failed is not one, for how it `ended` without them stands.
    pub(super) fn refine(&mut self, ended: &mut Result<(), Error>, pose: &Pose) -> Result<(), Error> {
        let (Some(wanted), Some(mut acceptable)) = (self.wanted, self.acceptable()) else { return Ok(()) };
        let mut stated = match ended {
            _ if self.vain_mm.is_some() => return Ok(()),
            Ok(()) => self.stated_error(acceptable),
            Err(Error::NotConverged { .. }) => f64::INFINITY,
            Err(_) => return Ok(()),
        };
        while stated > acceptable
            && let Some(mut finer) = self.resolution.refined(self.pad.size_mm, stated, wanted.min(acceptable))
        {
            let widest_mm = finer.cell_mm;
            let poor = stated > OF_USE || self.finest().folded_in_a_slip() > 0.0;
            let found = loop {
                match self.again_finer(finer, pose, [acceptable, stated]) {
                    // What is drawn through the face over these, or is no better, may not be over the next.
                    Err(Error::Unresolved { .. }) if self.finest().slips() && poor => {
                        match finer.next_finer(self.pad.size_mm) {
                            Some(next) => finer = next,
                            None => break None,
                        }
                    }
                    Err(stopped @ Error::Interrupted) => return Err(stopped),
                    found => break found.ok(),
                }
            };
            // The coarser answer, if there is one, states its error.
            let Some(now) = found else {
                self.vain_mm = Some(widest_mm);
                break;
            };
            (*ended, stated) = (Ok(()), now);
            acceptable = self.acceptable().unwrap_or(acceptable);
        }
        Ok(())
    }

    /// Error that the present answer states, relative to depth. That of a face in relief is looked for where the splines' is
    /// more than `enough`, unless the splines, on which it stands, are of no use.
    pub(super) fn stated_error(&self, enough: f64) -> f64 {
        let level = self.finest();
        let splined = level.estimated_error(self.indenter.as_ref()).unwrap_or(0.0);
        let told = level.straight_down() && self.trust_in_relief() > 0.0;
        if splined <= enough || splined > OF_USE || !told {
            return splined;
        }
        let [nx, ny] = relief::lattice(self.pad.size_mm, [level.grid().hx, level.grid().hy]);
        let in_relief = self.face(nx, ny).ok().and_then(|face| face.stats.estimated_error);
        in_relief.map_or(splined, |stated| stated.min(splined))
    }

    /// Whether what is at `pose` is an answer.
    ///
    /// # Errors
    /// [`Error::Unresolved`] where cells that were picked for a tolerance state more than any use allows.
    pub(super) fn resolved(&self, pose: &Pose) -> Result<(), Error> {
        let stated = self.stated_error(UNRESOLVED);
        if self.wanted.is_some() && stated > UNRESOLVED {
            return Err(self.unresolved(pose, [stated, UNRESOLVED]));
        }
        Ok(())
    }

    fn unresolved(&self, pose: &Pose, [stated, allowed]: [f64; 2]) -> Error {
        let cell_mm = self.finest().grid().hx;
        let approach = match self.pad.friction {
            _ if self.finest().straight_down() => Approach::StraightDown,
            Friction::Coefficient(0.0) => Approach::AlongWithoutFriction,
            _ => Approach::AlongWithFriction,
        };
        Error::Unresolved { pose: *pose, stated, allowed, cell_mm, approach }
    }

    /// Whether the indenter has gone along the face since the pad was at rest, and rubs.
    fn is_dragged(&self) -> bool {
        !self.finest().straight_down() && self.pad.friction != Friction::Coefficient(0.0)
    }

    /// Stated error beyond which finer cells are tried.
    fn acceptable(&self) -> Option<f64> {
        let worthwhile = if self.finest().folded_in_a_slip() > 0.0 {
            WORTHWHILE_WHERE_IT_FOLDS
        } else if self.is_dragged() {
            WORTHWHILE_IN_A_DRAG
        } else if self.path.len() > 1 {
            WORTHWHILE_LATER
        } else {
            WORTHWHILE
        };
        Some((worthwhile * self.wanted?).min(UNRESOLVED))
    }

    /// Follows the way since rest with the levels that it was begun with, where finer ones have `ended` without an equilibrium on the
    /// way to `pose`, and tells whether these have found one. When they find none either, or come through an answer that is none, all
    /// is as it was.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub(super) fn fall_back(&mut self, ended: &mut Result<(), Error>, pose: &Pose) -> Result<bool, Error> {
        if !matches!(ended, Err(Error::NotConverged { .. })) || self.unrefined.is_none() {
            return Ok(false);
        }
        let finer: Vec<Step> = self.levels.iter().map(Step::fork).collect();
        let resolution = self.resolution;
        self.leave_refined();
        let path = self.path.clone();
        let again = path[1..].iter().try_for_each(|p| {
            self.go(p, &FINEST)?;
            self.resolved(p)
        });
        let mut found = again.and_then(|()| self.go(pose, &FINEST));
        if matches!(found, Err(Error::NotConverged { .. }))
            && self.finest().straight_down()
            && let Some(between) = self.between(resolution.cell_mm)
        {
            found = self.again_finer(between, pose, [UNRESOLVED, f64::INFINITY]).map(|_| ());
        }
        match found {
            Err(stopped @ Error::Interrupted) => return Err(stopped),
            // (Wider than what was in vain before: that was finer than these.)
            Ok(()) => (*ended, self.vain_mm) = (Ok(()), Some(resolution.cell_mm)),
            Err(_) => {
                self.unrefined = Some(std::mem::replace(&mut self.levels, finer));
                self.resolution = resolution;
            }
        }
        Ok(ended.is_ok())
    }

    /// Follows the way since rest with the next finer cells, where finer ones than these were in vain, and a drag with friction has ended
    /// in an answer that is none, or in a poor one with folds, or a press that has just `fallen_back` states too much. When they find no
    /// equilibrium either, all is as it was. (A crescent that turns with friction 0.5: cells of 0.25 mm find no equilibrium at
    /// 15 degrees, over those of 0.42 mm it is drawn through the face at 30, with those of 0.31 it turns on. Parallel lines that cells of
    /// 0.25 mm were taken for 0.5 mm deep find an equilibrium 1 mm deep over those of 0.42 and 0.31 mm.)
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub(super) fn try_between(
        &mut self,
        ended: &Result<(), Error>,
        pose: &Pose,
        fallen_back: bool,
    ) -> Result<(), Error> {
        let (true, Some(vain_mm)) = (ended.is_ok(), self.vain_mm) else { return Ok(()) };
        let enough = match self.finest().straight_down() {
            true if fallen_back && self.unrefined.is_none() => self.acceptable(),
            false if self.finest().folded_in_a_slip() > 0.0 => Some(OF_USE),
            false if self.is_dragged() => Some(UNRESOLVED),
            _ => None,
        };
        let (Some(enough), Some(next)) = (enough, self.between(vain_mm)) else { return Ok(()) };
        let stated = self.stated_error(enough);
        if stated <= enough {
            return Ok(());
        }
        match self.again_finer(next, pose, [enough, stated]) {
            Err(stopped @ Error::Interrupted) => return Err(stopped),
            // The coarser answer states its error.
            Err(_) => self.vain_mm = Some(next.cell_mm),
            Ok(_) => (),
        }
        Ok(())
    }

    /// The next finer cells, if they are wider than those that were in vain.
    fn between(&self, vain_mm: f64) -> Option<Resolution> {
        self.resolution.next_finer(self.pad.size_mm).filter(|next| next.cell_mm > vain_mm + ROUNDING_MM)
    }

    /// Back to the levels of the beginning, at rest.
    fn leave_refined(&mut self) {
        if let Some(mut levels) = self.unrefined.take() {
            rest_at(&mut levels, &self.path[0]);
            let refined = std::mem::replace(&mut self.levels, levels);
            self.count(refined);
            self.resolution = Resolution { cell_mm: self.finest().grid().hx, ..self.resolution };
        }
    }

    /// Follows the way since rest and on to `pose` with a finer level, and tells what error its answer states, which needs to be
    /// known where it is more than `enough`. When it finds none, or one of no use that states no less than `before`, all is as it
    /// was. (Crossed lines with sharp edges 1 mm deep: cells of 0.42 mm state 2 %; over those of 0.25 mm what bulges between the
    /// lines gives way to one side, and they state 26 %.)
    fn again_finer(
        &mut self,
        finer: Resolution,
        pose: &Pose,
        [enough, before]: [f64; 2],
    ) -> Result<f64, Error> {
        let rest = self.path[0];
        let mut levels: Vec<Step> = self.levels.iter().map(Step::fork).collect();
        rest_at(&mut levels, &rest);
        let unrefined = levels.iter().map(Step::fork).collect();
        let nearly_as_fine = |step: &Step| step.level.grid().hx < WORTH_A_GUESS * finer.cell_mm;
        if levels.len() > 1 && levels.last().is_some_and(nearly_as_fine) {
            levels.pop();
        }
        if let Some(last) = levels.last_mut() {
            last.level.only_guess();
        }
        let mut level = self.pad.level(&finer, rest, false);
        level.newton.interrupt = self.interrupt.clone();
        levels.push(Step::after(&levels, level));
        let coarser = std::mem::replace(&mut self.levels, levels);
        let path = self.path.clone();
        let replayed = path[1..].iter().chain([pose]).try_for_each(|p| self.go(p, &REFINED));
        let found = replayed.and_then(|()| match self.stated_error(enough) {
            stated if stated <= OF_USE || stated < before => Ok(stated),
            stated => Err(self.unresolved(pose, [stated, before])),
        });
        if found.is_err() {
            let lost = std::mem::replace(&mut self.levels, coarser);
            self.count(lost);
            return found;
        }
        self.count(coarser);
        self.unrefined.get_or_insert(unrefined);
        self.resolution = finer;
        found
    }

    /// Keeps the counters of levels that are left.
    fn count(&mut self, mut levels: Vec<Step>) {
        for (sum, n) in self.spent.iter_mut().zip(take_counters(&mut levels)) {
            *sum += n;
        }
    }

    /// Remembers a waypoint for those that may have to go the way again.
    pub(super) fn arrive(&mut self, pose: &Pose) {
        if !self.finest().at_rest() {
            self.path.push(*pose);
            return;
        }
        self.path = vec![*pose];
        self.vain_mm = None;
        self.leave_refined();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastomer::{Elastomer, Law, Material, Mode, Pad, Settings};
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};

    #[test]
    fn an_answer_of_no_use_replaces_none_that_states_less() {
        let (x_mm, y_mm) = (2.0, 12.0);
        let shape = Shape::Flat { plan: Plan::Rectangle { x_mm, y_mm } };
        let bar = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
        let bar = from_spec("bar", &bar, None).expect("a body");
        let settings = Settings { mode: Mode::QuasiStatic, ..Settings::default() };
        let at = |z_mm: f64| Pose { x_mm: 0.0, y_mm: 0.0, z_mm, theta_deg: 0.0 };
        let law = Law::FixedCorotated;
        let material = Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 };
        let pad = Pad::slab([20.0, 20.0, 4.0], material);
        let mut solver = QuasiStaticSolver::new(&pad, &settings, bar, &at(0.1)).expect("a solver");
        solver.advance(&at(-0.3)).expect("an equilibrium");
        let before = (solver.resolution, solver.finest().displacement().to_vec());
        let stated = solver.stated_error(0.0);
        let coarse = Resolution { cell_mm: 1.25, ..solver.resolution };
        let found = solver.again_finer(coarse, &at(-0.3), [0.0, stated]);
        assert!(
            matches!(found, Err(Error::Unresolved { stated: now, .. }) if now > OF_USE && now > stated),
            "{found:?}, before {stated}"
        );
        assert_eq!(before, (solver.resolution, solver.finest().displacement().to_vec()));
        // What is better than nothing stands for it, and what states as much for nothing.
        let found = solver.again_finer(coarse, &at(-0.3), [0.0, f64::INFINITY]).expect("an answer");
        assert!(found > OF_USE && solver.resolution == coarse);
        let again = solver.again_finer(coarse, &at(-0.3), [0.0, found]);
        assert!(matches!(again, Err(Error::Unresolved { .. })), "{again:?}");
    }
}
