//! One increment of a way: solved in rounds, and taken back where it ends in no equilibrium.

use super::super::newton::{Outcome, Problem, State, Strain};
use super::super::slip::Account;
use super::super::symmetry;
use super::way::{drags, way_between};
use super::wear::torn;
use super::{LEAST_DEPTH_MM, Level};
use crate::indenter::Indenter;
use crate::pose::Pose;
use std::sync::{Arc, OnceLock};

/// Solves per increment between which multipliers, anchors and bounds are brought up to date.
const MOST_ROUNDS: u32 = 40;
/// Rounds that end at a part of the residual they began with, and that part.
const QUICK_ROUNDS: u32 = 30;
/// See [`QUICK_ROUNDS`].
const QUICK_REDUCTION: f64 = 0.5;
/// With less residual to be reached than this every round of a press is solved to its end. Found by experiment: what multipliers and
/// anchors are told half way decides where points stick, by which the force of a sphere pressed 1 mm scatters by 0.5 % and its face
/// by 2 um, whatever the cells; with such rounds both come nearer with every refinement, for half as much time again. Drags are no
/// nearer for twice the time.
pub(super) const SHARP_RESIDUAL: f64 = 1e-3;
/// Difference between the base's reaction and the contact force, over that force, with which an increment may end.
const LARGEST_IMBALANCE: f64 = 1e-3;
/// Part of the depth by which the sides of a press that are each other's image may differ before it is solved to less residual, and
/// in shorter increments: where the pad is nearly unstable what the stopping leaves grows to one side, and what is then no equilibrium
/// is none. Found by experiment: under a sharp square with a cavity, 2.4 mm deep in a pad of 4 mm, sides differed by 0.03 to 0.08 mm
/// beside the contact's edge, as rounding went; with a hundredth of the residual by 0.01 mm, or no equilibrium is found.
const MOST_ASKEW: f64 = 0.02;
/// Part of the depth by which they may not differ in the end: half of it is stated as an error.
const LOPSIDED: f64 = 0.05;
/// A residual below which single precision says no more.
const LEAST_RESIDUAL: f64 = 1e-5;
/// Newton iterations in an increment before it is halved.
const MOST_NEWTON: u32 = 100;
/// The same in a cautious increment: a pad that is about to give way to one side is found by many.
const MOST_CAUTIOUS: u32 = 40;
/// A residual (relative to the contact forces) with which an increment may end when its rounds are used up.
const ROUGH_RESIDUAL: f64 = 0.005;
/// A residual with which another round is worth its while.
const HOPELESS_RESIDUAL: f64 = 0.3;
/// Rounds and Newton iterations after which a level that only guesses lets well enough alone.
const GUESS_ROUNDS: u32 = 5;
/// See [`GUESS_ROUNDS`].
const GUESS_NEWTON: u32 = 10;

/// What an increment may do.
#[derive(Debug, Clone, Copy)]
pub struct Leave {
    /// Whether it has to end where the pad is unstable on the way.
    pub cautious: bool,
    /// Whether it has to end where a press has become lopsided.
    pub even: bool,
    /// Tangent applications after which no further round is begun.
    pub passes: u64,
}

impl Level {
    /// One increment to `pose`; the state is unchanged when it fails. `hint` is the change of displacement
    /// that a coarser level found for it. One that would do more than it has `leave` to fails.
    ///
    /// # Errors
    /// How the solution ended, when it was none.
    pub fn increment(
        &mut self,
        indenter: &dyn Indenter,
        pose: &Pose,
        hint: Option<&[f32]>,
        leave: Leave,
    ) -> Result<(), Outcome> {
        // The face at rest is an equilibrium wherever the indenter does not touch it.
        if self.is_clear(indenter, pose) {
            self.rest_at(pose);
            return Ok(());
        }
        let saved = self.at.clone();
        (self.at.stated, self.at.folded) = (OnceLock::new(), OnceLock::new());
        self.at.contacts.begin_increment(indenter, &saved.pose, pose, &saved.u);
        let machine = Arc::clone(&self.machine);
        let problem = Problem { machine: &machine, indenter, pose, least_force: self.least_force };
        let way = way_between(&saved.pose, pose);
        let drags = drags(&way);
        let worn = self.worn_after(indenter, pose, &way);
        self.at.contacts.set_torn(torn(worn));
        let strain = self.guess(&problem, &way, hint);
        match self.settle(&problem, strain, leave) {
            Ok(outcome) if leave.cautious && drags && self.unzips(worn) => {
                self.at = saved;
                Err(outcome)
            }
            Ok(outcome) => {
                self.at.contacts.end_increment(indenter);
                if let Some(before) = saved.outcome.filter(|_| drags && !self.at.contacts.has_friction()) {
                    let before = Account::new(saved.contacts.resultant(&saved.pose), before);
                    let after = Account::new(self.at.contacts.resultant(pose), outcome);
                    self.at.ledger.book([&saved.pose, pose], [before, after]);
                }
                self.at.last = (!saved.at_rest).then_some((saved.u, way));
                self.at.at_rest = false;
                self.at.dragged_mm += self.dragged_by(&way);
                self.at.worn = worn;
                self.at.outcome = Some(outcome);
                self.at.pose = *pose;
                self.at.keep_mirrors();
                Ok(())
            }
            Err(outcome) => {
                self.at = saved;
                Err(outcome)
            }
        }
    }

    /// Looks, where that is not skipped, at a pad at rest whose face an indenter on its way to `pose` stays clear of: as an increment
    /// would be solved. What comes of it is known, so that it then rests there.
    pub fn look(&mut self, indenter: &dyn Indenter, pose: &Pose) {
        if !self.looked_at || !self.at.at_rest {
            return;
        }
        let from = self.at.pose;
        self.at.contacts.begin_increment(indenter, &from, pose, &self.at.u);
        let machine = Arc::clone(&self.machine);
        let problem = Problem { machine: &machine, indenter, pose, least_force: self.least_force };
        let strain = self.guess(&problem, &way_between(&from, pose), None);
        let leave = Leave { cautious: false, even: false, passes: u64::MAX };
        _ = self.settle(&problem, strain, leave);
    }

    /// Solves in rounds until multipliers, anchors and bounds agree with the displacement, or as nearly as
    /// the rounds allow: what then disagrees is booked as an error. Multipliers are brought up to date long
    /// before the displacement has settled, so that both arrive together; a round that was to be sharp comes
    /// only when this does not converge.
    ///
    /// Where the pad is unstable (negative curvature), it matters how it was come by: rounding decides which way it
    /// gives. Shorter increments mostly keep clear of such places, so cautious ones end there, and where they take long.
    fn settle(&mut self, problem: &Problem<'_>, strain: Strain, leave: Leave) -> Result<Outcome, Outcome> {
        let begun = self.newton.passes;
        self.newton.indefinite = false;
        self.at.contacts.choose_sides(problem.indenter, problem.pose, &self.at.u);
        let mut state = self.newton.begin(problem, &mut self.at.contacts, &self.at.u, strain);
        let depth_mm = self.at.contacts.depth_mm(problem.indenter, problem.pose);
        let allowed_mm = self.penetration * depth_mm.max(LEAST_DEPTH_MM);
        let mut spent = 0;
        let mut rounds = 0;
        let mut residual = self.residual;
        let quick =
            self.guesses || residual >= SHARP_RESIDUAL || drags(&way_between(&self.at.pose, problem.pose));
        // One that is let go comes to where it is even.
        let presses = problem.pose.z_mm <= self.at.pose.z_mm;
        let quick_rounds = if quick { QUICK_ROUNDS } else { 0 };
        loop {
            let goal = if rounds < quick_rounds { QUICK_REDUCTION * state.relative.min(1.0) } else { 0.0 };
            let goal = goal.max(residual);
            let mut outcome =
                self.newton.solve(problem, &mut self.at.contacts, &mut self.at.u, &mut state, goal);
            rounds += 1;
            spent += outcome.iterations;
            outcome.iterations = spent;
            if leave.cautious && (self.newton.indefinite || spent > MOST_CAUTIOUS) {
                return Err(outcome);
            }
            if self.newton.passes - begun > leave.passes {
                return Err(outcome);
            }
            if !(outcome.residual <= HOPELESS_RESIDUAL.max(goal)) || !state.valid() {
                return Err(outcome);
            }
            let updated =
                self.at.contacts.update(problem.indenter, [&self.at.pose, problem.pose], &self.at.u, rounds);
            self.newton.rebalance(problem, &mut self.at.contacts, &self.at.u, &mut state);
            outcome.residual = state.relative;
            self.at.penetration_mm = updated.violation_mm;
            self.at.unsettled = updated.bound_change;
            let settled =
                updated.events == 0 && updated.violation_mm < allowed_mm && state.relative <= residual;
            if settled {
                if self.guesses {
                    return Ok(outcome);
                }
                let to_the_end = residual < LEAST_RESIDUAL;
                if to_the_end || self.is_balanced(problem, &state) {
                    let askew = self.askew(problem, depth_mm);
                    if askew <= MOST_ASKEW {
                        return Ok(outcome);
                    }
                    if to_the_end {
                        let uneven = presses && (leave.even || askew > LOPSIDED);
                        return if uneven { Err(outcome) } else { Ok(outcome) };
                    }
                }
                // What is left is small at each point and all of one sign, or to one side.
                residual *= 0.3;
            }
            if self.guesses
                && (rounds >= GUESS_ROUNDS || spent >= GUESS_NEWTON)
                && outcome.residual <= HOPELESS_RESIDUAL
            {
                return Ok(outcome);
            }
            if rounds == MOST_ROUNDS || spent > MOST_NEWTON {
                // What is still at odds stays as it is, and is told; the forces are brought into balance.
                let mut outcome = self.newton.solve(
                    problem,
                    &mut self.at.contacts,
                    &mut self.at.u,
                    &mut state,
                    self.residual,
                );
                outcome.iterations += spent;
                let near = updated.violation_mm < 10.0 * allowed_mm && outcome.residual <= ROUGH_RESIDUAL;
                let lopsided = presses && !self.guesses && self.askew(problem, depth_mm) > LOPSIDED;
                return if near && !lopsided { Ok(outcome) } else { Err(outcome) };
            }
        }
    }

    /// How much of its symmetry a straight press has lost, relative to depth.
    fn askew(&self, problem: &Problem<'_>, depth_mm: f64) -> f64 {
        if !self.straight_down() || drags(&way_between(&self.at.pose, problem.pose)) {
            return 0.0;
        }
        let lost = symmetry::lost(self.grid(), &self.at.u, problem.indenter, self.at.mirrors);
        lost.most_mm / depth_mm.max(LEAST_DEPTH_MM)
    }

    /// Whether the base bears what presses on the face.
    fn is_balanced(&self, problem: &Problem<'_>, state: &State) -> bool {
        let (force, _) = self.at.contacts.resultant(problem.pose);
        (force.z.abs() - state.strain.base_force.abs()).abs()
            <= LARGEST_IMBALANCE * force.z.abs().max(self.least_force)
    }
}
