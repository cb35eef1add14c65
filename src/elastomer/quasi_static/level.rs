//! One resolution of the pad and the equilibrium it is in. An `increment` leads to the next, from a `guess` on; how long it may be, and
//! what sticks bears of it, is `wear`; a `capture` reads it, with the error it states (`estimate`).

mod capture;
mod estimate;
mod guess;
mod increment;
mod way;
mod wear;

pub use increment::Leave;
use increment::SHARP_RESIDUAL;
pub use way::corners;

use super::body::Body;
use super::chart::Chart;
use super::contact::{Contacts, Grip, Loads};
use super::frames::Frames;
use super::grid::Grid;
use super::layer::RestLayer;
use super::newton::{Machine, Newton, Outcome};
use super::operator::Operator;
use super::resolution::{GUESS_RESIDUAL, Resolution};
use super::slip::Ledger;
use super::springs::FaceGreen;
use super::stack::Stack;
use super::symmetry;
use crate::elastomer::Friction;
use crate::indenter::Indenter;
use crate::pose::Pose;
use std::sync::{Arc, OnceLock};

/// Stiffness of the contact springs, MPa/mm, times the width of a cell over Young's modulus: two and a half times the
/// pad's own at that scale; the multipliers do the rest. Found by experiment: with springs four times as stiff a face that
/// meets an edge between its control points is held by too many samples, and flat bodies press 1 % harder; with two
/// thirds of it the contact of a sphere is 2 % too wide.
const SPRING_STIFFNESS: f64 = 12.0;
/// Longest increment of a press that sticks, over the pad's thickness, where less residual is to be reached than [`SHARP_RESIDUAL`]. Found
/// by experiment, against axisymmetric finite elements: a sphere of radius 4 pressed 0.5 and 1 mm in increments of 0.5 mm and turned by 5
/// to 15 degrees (neo-Hookean, cells of 0.31 mm) takes 2.9 to 6.1 % less torque than it should, in those of 0.125 mm 1.3 to 2.6 %.
const STICKING: f64 = 0.031_25;
/// A press counts as at least this deep where errors are relative to depth, mm.
const LEAST_DEPTH_MM: f64 = 0.02;

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
    /// The same without friction, mm.
    free_increment_mm: f64,
    /// Whether a finer level makes its answers good.
    guesses: bool,
    /// Whether it is looked at where the indenter is clear of it.
    looked_at: bool,
    /// The equilibrium reached.
    at: Equilibrium,
    /// The iteration and its counters.
    pub newton: Newton,
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
    /// The mirrors of the pad in which the indenter has been since the pad was at rest, across x and across y.
    mirrors: [bool; 2],
    /// Work of slides and turns without friction, and what became of it.
    ledger: Ledger,
    outcome: Option<Outcome>,
    /// Largest penetration at a sample point after the last solve, mm.
    penetration_mm: f64,
    /// Part of the friction that was still changing after the last solve.
    unsettled: f64,
    /// The error it states, once it was asked for.
    stated: OnceLock<Option<f64>>,
    /// Part of the face that lies over itself, once it was asked for.
    folded: OnceLock<f64>,
}

impl Equilibrium {
    /// Forgets the mirrors that the indenter has left.
    fn keep_mirrors(&mut self) {
        let here = symmetry::mirrors_of(&self.pose);
        self.mirrors = [0, 1].map(|across| self.mirrors[across] && here[across]);
    }
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
        let mut contacts =
            Contacts::new(&grid, chart, resolution.samples, stiffness, *friction, stack.face_mu());
        contacts.set_anchored(body.anchored);
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
            increment_mm: if *friction == Friction::Infinite && resolution.residual < SHARP_RESIDUAL {
                resolution.increment_mm.min(STICKING * size_mm[2])
            } else {
                resolution.increment_mm
            },
            free_increment_mm: resolution.free_increment_mm,
            guesses,
            looked_at: body.looked_at,
            at: Equilibrium {
                pose,
                contacts,
                u,
                last: None,
                at_rest: true,
                dragged_mm: 0.0,
                mirrors: symmetry::mirrors_of(&pose),
                worn: 0.0,
                ledger: Ledger::default(),
                outcome: None,
                penetration_mm: 0.0,
                unsettled: 0.0,
                stated: OnceLock::new(),
                folded: OnceLock::new(),
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
            free_increment_mm: self.free_increment_mm,
            guesses: self.guesses,
            looked_at: self.looked_at,
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

    /// How far the indenter reaches below the face at rest, mm.
    pub fn depth_mm(&self, indenter: &dyn Indenter) -> f64 {
        self.at.contacts.depth_mm(indenter, &self.at.pose)
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
        at.mirrors = symmetry::mirrors_of(pose);
        (at.stated, at.folded) = (OnceLock::new(), OnceLock::new());
    }

    /// How many points have anchors.
    #[cfg(test)]
    pub fn anchors(&self) -> usize {
        self.at.contacts.anchors()
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
}
