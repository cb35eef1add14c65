//! One resolution of the pad: its equilibrium, the way from one to the next, and what error it states (`estimate`).

mod estimate;

use super::super::{ContactForces, ElastomerCapture, Error, SolverStats, Surface};
use super::body::Body;
use super::chart::Chart;
use super::contact::{Contacts, Grip, Loads};
use super::frames::Frames;
use super::grid::Grid;
use super::layer::RestLayer;
use super::newton::{Machine, Newton, Outcome, Problem, State, Strain};
use super::operator::Operator;
use super::resolution::{GUESS_RESIDUAL, LONGEST_INCREMENT_MM, Resolution};
use super::slip::{Account, Ledger};
use super::springs::FaceGreen;
use super::stack::Stack;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::Vec3;
use rayon::prelude::*;
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
const SHARP_RESIDUAL: f64 = 1e-3;
/// Stiffness of the contact springs, MPa/mm, times the width of a cell over Young's modulus: two and a half times the
/// pad's own at that scale; the multipliers do the rest. Found by experiment: with springs four times as stiff a face that
/// meets an edge between its control points is held by too many samples, and flat bodies press 1 % harder; with two
/// thirds of it the contact of a sphere is 2 % too wide.
const SPRING_STIFFNESS: f64 = 12.0;
/// A press counts as at least this deep where errors are relative to depth, mm.
const LEAST_DEPTH_MM: f64 = 0.02;
/// Difference between the base's reaction and the contact force, over that force, with which an increment may end.
const LARGEST_IMBALANCE: f64 = 1e-3;
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
/// Least volume ratio of a guess.
const GUESS_VOLUME: f32 = 0.1;
/// A step further down, over the depth reached, up to which the solution linearised there is a better guess than a coarser
/// grid's. Found by experiment, a sphere and a punch at 0.25 to 1.2 mm: steps of a tenth of the depth take two thirds of the
/// time, those of a third of it half as much again.
const PRESSES_ON: f64 = 0.15;
/// Part of the last way from which on one that goes on is as well guessed by that alone: the linear solve then costs more than it
/// saves. Found by experiment: slides of a sphere and a punch take a tenth less without it, steps of a tenth of a press a twentieth.
const AS_LONG: f64 = 0.9;
/// Longest way along the face in one increment with friction, mm.
const LONGEST_SLIDE_MM: f64 = 0.25;
/// The same with infinite friction over the width of a cell. Found by experiment: in increments of 0.25 mm over cells of 0.31 mm a
/// sphere of radius 4, pressed 0.5 mm and slid 1 mm, drags 5 % less than in shorter ones; in those it drags as hard as over cells
/// of 0.42 and 0.21 mm within 1 %.
const SLIDE_OVER_CELL: f64 = 0.625;
/// Part of what is pressed that may be let go and come back within an increment: what it held falls to its neighbours, which may
/// let go in turn. Found by experiment: a sphere of radius 4, infinite friction, 0.25 mm deep and slid 1 mm over cells of 0.31 mm,
/// loses half of its points and a third of its drag in an increment of 0.125 mm; in shorter ones it drags as over other cells.
const MOST_IDLE: f64 = 0.05;
/// So far along the face, over the depth, and at least so far, mm, what sticks holds, to and fro counted; over as much again it tears
/// loose. Found by experiment: up to three depths finer cells and shorter increments drag the same within 6 %; beyond, what holds
/// goes by how they fall. (The least is for presses so shallow that a usual waypoint would lie beyond.)
const HELD_OVER_DEPTH: f64 = 2.0;
/// See [`HELD_OVER_DEPTH`].
const HELD_MM: f64 = 1.0;
/// Wear with which what sticks begins to tear, and with which it is loose.
const TEARS: [f64; 2] = [1.0, 2.0];
/// Wear that is added where no equilibrium is found for what holds.
const TORN_AT_ONCE: f64 = 0.5;
/// Length of increments over the usual while it tears. Found by experiment: what springs back in one of 0.25 mm lets the tips of the
/// moon dig into the face; in those of 0.03 to 0.125 mm it does not, and the drags agree within 2 %.
const TEARING_INCREMENT: f64 = 0.5;
/// Less than what rounding makes of a wear.
const WEAR_ROUNDING: f64 = 1e-9;
/// Largest turn in one increment, degrees.
const LARGEST_TURN_DEG: f64 = 5.0;
/// Smallest distance of the contact from the pad's edge, mm.
const EDGE_MARGIN_MM: f64 = 1.0;

/// The pad at one resolution.
#[derive(Debug)]
pub struct Level {
    machine: Arc<Machine>,
    /// The map of a pad that is not flat.
    chart: Option<Chart>,
    /// Residual to reach, relative to the contact forces.
    residual: f64,
    /// Penetration that may remain, relative to depth.
    penetration: f64,
    /// Forces below this count as this, N.
    least_force: f64,
    /// Longest way into the pad in one increment with friction, mm.
    increment_mm: f64,
    /// Whether a finer level makes its answers good.
    guesses: bool,
    /// The equilibrium reached.
    at: Equilibrium,
    /// The iteration and its counters.
    pub newton: Newton,
}

/// What an increment may do.
#[derive(Debug, Clone, Copy)]
pub struct Leave {
    /// Whether it has to end where the pad is unstable on the way.
    pub cautious: bool,
    /// Tangent applications after which no further round is begun.
    pub passes: u64,
}

/// What a way leaves behind.
#[derive(Debug, Clone)]
pub struct Equilibrium {
    pose: Pose,
    contacts: Contacts,
    u: Vec<f32>,
    /// Displacement one increment ago, and the way of the indenter since then, for extrapolation.
    last: Option<(Vec<f32>, [f64; 4])>,
    at_rest: bool,
    /// How far the indenter has gone along the face since the pad was at rest, mm; nothing where it came straight down.
    dragged_mm: f64,
    /// The same over how far what sticks holds, at the depths at which it went.
    worn: f64,
    /// Work of slides and turns without friction, and what became of it.
    ledger: Ledger,
    outcome: Option<Outcome>,
    /// Largest penetration at a sample point after the last solve, mm.
    penetration_mm: f64,
    /// Part of the friction that was still changing after the last solve.
    unsettled: f64,
    /// The error it states, once it was asked for.
    stated: OnceLock<Option<f64>>,
}

impl Level {
    /// A pad at rest, the indenter at `pose`; whether it only `guesses` for a finer one.
    pub fn new(body: &Body, resolution: &Resolution, pose: Pose, guesses: bool) -> Self {
        let Body { size_mm, material, friction, .. } = body;
        let coating = body.coating.as_ref();
        let grid = Grid::below_coating(
            *size_mm,
            resolution.cell_mm,
            resolution.first_height,
            resolution.growth,
            coating.map_or(0.0, |c| c.thickness_mm),
        );
        let chart = Chart::new(body.shape, *size_mm);
        let stack = Stack::coated(&grid, material, coating);
        let layer = RestLayer::new(&grid, &stack);
        let green = FaceGreen::new(&grid, &layer);
        let stiffness = SPRING_STIFFNESS * material.youngs_modulus_mpa / grid.hx;
        let contacts = Contacts::new(&grid, chart, resolution.samples, stiffness, *friction, stack.face_mu());
        let u = vec![0.0; grid.field_len()];
        let least_force = 1e-5 * material.youngs_modulus_mpa * grid.hx * grid.hy;
        let frames = chart.map(|chart| Frames::new(&grid, &chart));
        let operator = Operator::new(grid, material.law, &stack, chart.as_ref());
        Self {
            chart,
            machine: Arc::new(Machine { operator, layer, green, frames }),
            residual: resolution.residual,
            penetration: resolution.penetration,
            least_force,
            increment_mm: resolution.increment_mm,
            guesses,
            at: Equilibrium {
                pose,
                contacts,
                u,
                last: None,
                at_rest: true,
                dragged_mm: 0.0,
                worn: 0.0,
                ledger: Ledger::default(),
                outcome: None,
                penetration_mm: 0.0,
                unsettled: 0.0,
                stated: OnceLock::new(),
            },
            newton: Newton::default(),
        }
    }

    /// The same pad in the same state, with counters of its own.
    pub fn fork(&self) -> Self {
        Self {
            machine: Arc::clone(&self.machine),
            chart: self.chart,
            residual: self.residual,
            penetration: self.penetration,
            least_force: self.least_force,
            increment_mm: self.increment_mm,
            guesses: self.guesses,
            at: self.at.clone(),
            newton: self.newton.fork(),
        }
    }

    /// From now on a finer level makes its answers good.
    pub fn only_guess(&mut self) {
        self.guesses = true;
        self.residual = self.residual.max(GUESS_RESIDUAL);
        self.penetration = self.penetration.max(GUESS_RESIDUAL);
    }

    /// Whether nothing touches.
    pub fn at_rest(&self) -> bool {
        self.at.at_rest
    }

    /// Whether friction is infinite.
    pub fn sticks(&self) -> bool {
        self.at.contacts.sticks()
    }

    /// How the last increment ended, unless nothing touches.
    pub fn outcome(&self) -> Option<Outcome> {
        self.at.outcome
    }

    /// Its grid.
    pub fn grid(&self) -> &Grid {
        self.machine.operator.grid()
    }

    /// Where the indenter is.
    pub fn pose(&self) -> &Pose {
        &self.at.pose
    }

    /// Force of the indenter into the pad, N.
    pub fn normal_force_n(&self) -> f64 {
        -self.at.contacts.resultant(&self.at.pose).0.z
    }

    /// Displacement of the control points, mm.
    pub fn displacement(&self) -> &[f32] {
        &self.at.u
    }

    /// The equilibrium, to come back to.
    pub fn equilibrium(&self) -> Equilibrium {
        self.at.clone()
    }

    /// Change of the displacement since an equilibrium of before, mm.
    pub fn change_since(&self, before: &Equilibrium) -> Vec<f32> {
        self.at.u.iter().zip(&before.u).map(|(now, then)| now - then).collect()
    }

    /// Back to an equilibrium of before.
    pub fn return_to(&mut self, at: Equilibrium) {
        self.at = at;
    }

    /// Moves the indenter where nothing touches.
    pub fn rest_at(&mut self, pose: &Pose) {
        let at = &mut self.at;
        at.contacts.clear();
        at.u.fill(0.0);
        (at.at_rest, at.last, at.outcome, at.pose) = (true, None, None, *pose);
        (at.dragged_mm, at.worn, at.ledger) = (0.0, 0.0, Ledger::default());
        at.stated = OnceLock::new();
    }

    /// Whether the indenter at `pose` would be clear of the face at rest.
    pub fn is_clear(&self, indenter: &dyn Indenter, pose: &Pose) -> bool {
        self.at.contacts.least_gap(indenter, pose) >= 0.0
    }

    /// Where a way straight down from rest first touches, as a part of it; 0 for any other way.
    pub fn idle_part(&self, indenter: &dyn Indenter, pose: &Pose) -> f64 {
        let straight_down = Pose { z_mm: self.at.pose.z_mm, ..*pose } == self.at.pose;
        if self.at.at_rest && straight_down {
            self.at.contacts.first_touch(indenter, &self.at.pose, pose)
        } else {
            0.0
        }
    }

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
        self.at.stated = OnceLock::new();
        self.at.contacts.begin_increment(indenter, &saved.pose, pose, &saved.u);
        let machine = Arc::clone(&self.machine);
        let problem = Problem { machine: &machine, indenter, pose, least_force: self.least_force };
        let way = way_between(&saved.pose, pose);
        let drags = drags(&way);
        let worn = self.worn_after(indenter, pose, &way);
        self.at.contacts.set_torn((worn - TEARS[0]) / (TEARS[1] - TEARS[0]));
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
                self.at.dragged_mm += along_face(&way);
                self.at.worn = worn;
                self.at.outcome = Some(outcome);
                self.at.pose = *pose;
                Ok(())
            }
            Err(outcome) => {
                self.at = saved;
                Err(outcome)
            }
        }
    }

    /// How worn the contact is after a way to `pose`.
    fn worn_after(&self, indenter: &dyn Indenter, pose: &Pose, way: &[f64; 4]) -> f64 {
        let held_mm = HELD_MM.max(HELD_OVER_DEPTH * self.at.contacts.depth_mm(indenter, pose));
        self.at.worn + along_face(way) / held_mm
    }

    /// Tears loose some of what sticks and finds no equilibrium; whether there was any.
    pub fn tear(&mut self) -> bool {
        let holds = self.at.contacts.sticks() && !self.at.at_rest && self.at.worn < TEARS[1] - WEAR_ROUNDING;
        if holds {
            self.at.worn = self.at.worn.max(TEARS[0]) + TORN_AT_ONCE;
        }
        holds
    }

    /// Whether so much was let go and came back that what holds has come apart for the increment's length alone.
    fn unzips(&self, worn: f64) -> bool {
        let contacts = &self.at.contacts;
        let holds = contacts.sticks() && worn <= TEARS[0] + WEAR_ROUNDING;
        !self.guesses && holds && contacts.idle_part() > MOST_IDLE
    }

    /// How many increments a way takes: a press may be long; what moves along the face with friction goes
    /// part of a cell at a time, so that points come and go a few at once, and half of that while it tears loose.
    pub fn increments(&self, indenter: &dyn Indenter, to: &Pose) -> f64 {
        let from = &self.at.pose;
        let along = (to.x_mm - from.x_mm).hypot(to.y_mm - from.y_mm);
        let down = (to.z_mm - from.z_mm).abs();
        let turn = (to.theta_deg - from.theta_deg).abs();
        let longest = [LONGEST_INCREMENT_MM, LONGEST_INCREMENT_MM];
        let sticks = self.at.contacts.sticks();
        let worn = self.worn_after(indenter, to, &way_between(from, to));
        let tears = worn > TEARS[0] + WEAR_ROUNDING && self.at.worn < TEARS[1] - WEAR_ROUNDING;
        let part = if sticks && tears { TEARING_INCREMENT } else { 1.0 };
        let slide = if sticks { SLIDE_OVER_CELL * self.grid().hx } else { LONGEST_SLIDE_MM };
        let friction = [self.increment_mm, part * slide.min(LONGEST_SLIDE_MM)];
        let [deep, far] = if self.at.contacts.has_friction() { friction } else { longest };
        (down / deep).max(along / far).max(turn / (part * LARGEST_TURN_DEG)).ceil().max(1.0)
    }

    /// Guesses the displacement at the next pose: as a coarser level says, else extrapolated where the way
    /// goes on as before, and, unless it goes on as far, one linear solve in which what touches keeps touching. A guess that
    /// folds the pad is dropped. Answers the strain there.
    fn guess(&mut self, problem: &Problem<'_>, way: &[f64; 4], hint: Option<&[f32]>) -> Strain {
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
                if self.guesses || residual < LEAST_RESIDUAL || self.is_balanced(problem, &state) {
                    return Ok(outcome);
                }
                // What is left is small at each point and all of one sign.
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
                return if near { Ok(outcome) } else { Err(outcome) };
            }
        }
    }

    /// Whether the base bears what presses on the face.
    fn is_balanced(&self, problem: &Problem<'_>, state: &State) -> bool {
        let (force, _) = self.at.contacts.resultant(problem.pose);
        (force.z.abs() - state.strain.base_force.abs()).abs()
            <= LARGEST_IMBALANCE * force.z.abs().max(self.least_force)
    }

    /// Whether the indenter has come straight down since the pad was at rest.
    pub fn straight_down(&self) -> bool {
        self.at.dragged_mm == 0.0
    }

    /// What presses the face.
    pub fn loads(&self) -> Loads {
        self.at.contacts.loads()
    }

    /// What holds the face along itself, where the indenter has gone along it and what sticks is whole, in part at least.
    pub fn grip(&self) -> Option<Grip> {
        let holds = self.trust_in_grip() > 0.0 && !self.straight_down() && self.chart.is_none();
        holds.then(|| self.at.contacts.grip(&self.at.pose))
    }

    /// Refuses contact beside the pad or too close to its edge.
    pub fn check_margin(&self, indenter: &dyn Indenter) -> Result<(), Error> {
        let size = self.machine.operator.grid().size;
        let [hx, hy] = indenter.half_extent_mm();
        // A body that covers the pad has no contact edge on it.
        let covers = |at: f64, half: f64, size: f64| at.abs() + size / 2.0 <= half;
        let distance = |p: f64, at: f64, half: f64, size: f64| {
            if covers(at, half, size) { f64::INFINITY } else { size / 2.0 - p.abs() }
        };
        let mut least = f64::INFINITY;
        for p in self.at.contacts.touching_points() {
            least = least.min(distance(p.x, self.at.pose.x_mm, hx, size[0])).min(distance(
                p.y,
                self.at.pose.y_mm,
                hy,
                size[1],
            ));
        }
        if least < EDGE_MARGIN_MM {
            return Err(Error::OffPad { pose: self.at.pose, distance_mm: least, allowed_mm: EDGE_MARGIN_MM });
        }
        Ok(())
    }

    /// The face, sampled, and what acts on it.
    ///
    /// # Errors
    /// [`Error::Setting`] for a lattice with fewer than two points along a side.
    pub fn capture(&self, indenter: &dyn Indenter, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        if nx < 2 || ny < 2 {
            return Err(Error::Setting {
                key: "elastomer.surface",
                value: format!("[{nx}, {ny}]"),
                allowed: "at least 2 points along each direction".to_owned(),
                next: "ask for more".to_owned(),
            });
        }
        let grid = self.machine.operator.grid();
        let (cx, top) = (grid.cx(), grid.layers() - 1);
        let tables = |n: usize, size: f64, cells: usize| -> Vec<(f64, usize, [f64; 3])> {
            (0..n)
                .map(|i| {
                    let x = -size / 2.0 + size * i as f64 / (n - 1) as f64;
                    let (cell, w) = Grid::trace(x, size, cells);
                    (x, cell, w)
                })
                .collect()
        };
        let (xs, ys) = (tables(nx, grid.size[0], grid.nx), tables(ny, grid.size[1], grid.ny));
        let patch = self.at.contacts.patch();
        let (mut positions, mut contact) = (vec![Vec3::ZERO; nx * ny], vec![false; nx * ny]);
        positions.par_chunks_exact_mut(nx).zip(contact.par_chunks_exact_mut(nx)).zip(&ys).for_each(
            |((positions, contact), (y, j, wy))| {
                for ((position, contact), (x, i, wx)) in positions.iter_mut().zip(contact).zip(&xs) {
                    let mut p = [*x, *y, self.chart.map_or(0.0, |chart| chart.height_mm(*x, *y))];
                    for (c, p) in p.iter_mut().enumerate() {
                        let plane = &self.at.u[grid.at(c, top)..][..grid.plane()];
                        for (b, wy) in wy.iter().enumerate() {
                            for (a, wx) in wx.iter().enumerate() {
                                *p += wy * wx * f64::from(plane[(j + b) * cx + i + a]);
                            }
                        }
                    }
                    *position = Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32);
                    *contact = patch.contains(x / grid.size[0] + 0.5, y / grid.size[1] + 0.5);
                }
            },
        );
        let (force, torque) = self.at.contacts.resultant(&self.at.pose);
        let stats = SolverStats {
            iterations: self.newton.iterations,
            passes: self.newton.passes,
            passes_per_step: self.newton.passes as f64 / (self.newton.iterations as f64).max(1.0),
            limit_hits: 0,
            particles: grid.points() as u64,
            residual: self.at.outcome.map_or(0.0, |o| o.residual),
            estimated_error: self.estimated_error(indenter),
            elastic_energy_n_mm: self.at.outcome.map_or(0.0, |o| o.evaluation.energy),
            base_reaction_n: self.at.outcome.map_or(0.0, |o| o.base_force),
            contact_area_mm2: patch.area_mm2(),
            held: self.at.contacts.sticks().then(|| self.held(indenter)),
        };
        Ok(ElastomerCapture {
            surface: Surface { nx, ny, size_x_mm: grid.size[0], size_y_mm: grid.size[1], positions },
            contact,
            forces: ContactForces {
                normal_force_n: -force.z,
                shear_force_n: [-force.x, -force.y],
                torque_n_mm: -torque,
            },
            stats,
        })
    }
}

/// The way from one pose to another as four numbers, a degree counting as 0.05 mm.
fn way_between(a: &Pose, b: &Pose) -> [f64; 4] {
    [b.x_mm - a.x_mm, b.y_mm - a.y_mm, b.z_mm - a.z_mm, 0.05 * (b.theta_deg - a.theta_deg)]
}

/// How much of a way leads along the face, turns counted in.
fn along_face(way: &[f64; 4]) -> f64 {
    way[0].hypot(way[1]).hypot(way[3])
}

/// Whether a way leads along the face, or turns on it.
fn drags(way: &[f64; 4]) -> bool {
    along_face(way) > 0.0
}

/// How many times `last` goes into `way`, if they point the same way.
fn along(way: &[f64; 4], last: &[f64; 4]) -> Option<f64> {
    let dot = |a: &[f64; 4], b: &[f64; 4]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
    let (ww, ll, wl) = (dot(way, way), dot(last, last), dot(way, last));
    (ll > 0.0 && wl > 0.95 * (ww * ll).sqrt()).then(|| (wl / ll).min(2.0))
}
