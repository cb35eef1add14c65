//! Newton's method on the pad's potential, with preconditioned conjugate gradients inside.
//!
//! For fixed multipliers, anchors and bounds the equilibrium minimises a potential that is once
//! differentiable, so each Newton direction is one of descent and a search along it for a zero of the
//! directional derivative makes the iteration safe (Nocedal and Wright, chapters 3 and 7). Directions of
//! negative curvature end the inner iteration.

mod search;

use super::super::interrupt::Interrupt;
use super::contact::Contacts;
use super::fields::{add_scaled, dot, in_runs};
use super::frames::Frames;
use super::layer::RestLayer;
use super::operator::{Evaluation, LEAST_VOLUME, Operator, Tangent};
use super::springs::{FaceGreen, Springs};
use crate::indenter::Indenter;
use crate::pose::Pose;

/// Newton iterations before a solve is given up.
const MOST_ITERATIONS: u32 = 40;
/// Reduction of the residual with which an inner iteration may end.
const LOOSEST: f64 = 0.1;
/// Part of the goal of a solve that its inner iteration aims at: the multipliers that follow shift the forces by more than is left.
/// Found by experiment: with 0.3 steps of a tenth of the depth take a quarter (sphere) to two thirds (punch) more applications.
const PART_OF_GOAL: f64 = 0.5;
/// Reduction of the residual with which a prediction ends.
const PREDICTED: f64 = 0.2;
/// Tangent applications in one Newton iteration.
const MOST_PASSES: u32 = 150;

/// The parts of a solver that do not change.
#[derive(Debug)]
pub struct Machine {
    /// Elastic operator.
    pub operator: Operator,
    /// Rest-state inverse.
    pub layer: RestLayer,
    /// Its surface response.
    pub green: FaceGreen,
    /// How both are laid along a face that is not flat.
    pub frames: Option<Frames>,
}

/// Buffers and counters of the iteration.
#[derive(Debug, Default)]
pub struct Newton {
    tangent: Tangent,
    springs: Springs,
    /// Internal forces, and what the contact forces leave of them.
    elastic: Vec<f32>,
    residual: Vec<f32>,
    trial: Vec<f32>,
    trial_elastic: Vec<f32>,
    trial_residual: Vec<f32>,
    step: Vec<f32>,
    r: Vec<f32>,
    z: Vec<f32>,
    p: Vec<f32>,
    ap: Vec<f32>,
    /// Ends every solution early.
    pub(in crate::elastomer) interrupt: Interrupt,
    /// Whether a direction of negative curvature was met since this was cleared.
    pub indefinite: bool,
    /// Newton iterations since the counters were cleared.
    pub iterations: u64,
    /// Tangent applications since the counters were cleared.
    pub passes: u64,
    /// How often the strain was found: what tells that a pad was looked at.
    pub strains: u64,
}

/// How a solve ended.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// Whether the tolerance was met.
    pub converged: bool,
    /// Residual relative to the contact forces.
    pub residual: f64,
    /// Newton iterations spent.
    pub iterations: u32,
    /// Energy and least volume.
    pub evaluation: Evaluation,
    /// Force of the pad on the base along z, N.
    pub base_force: f64,
}

/// A posed contact problem.
pub struct Problem<'a> {
    /// Fixed parts.
    pub machine: &'a Machine,
    /// Indenter.
    pub indenter: &'a dyn Indenter,
    /// Its pose.
    pub pose: &'a Pose,
    /// Forces below this count as this, N.
    pub least_force: f64,
}

impl Newton {
    /// One that goes on as this would: the springs that it has factored do for some while, so that what follows is the same to the
    /// bit. Its counters are its own.
    pub(in crate::elastomer) fn fork(&self) -> Self {
        Self { springs: self.springs.fork(), interrupt: self.interrupt.clone(), ..Self::default() }
    }

    /// The pad at displacement `u`, from which [`Self::begin`] goes on.
    pub fn strain(&mut self, operator: &Operator, u: &[f32]) -> Strain {
        self.elastic.resize(operator.grid().field_len(), 0.0);
        self.strains += 1;
        strain(operator, u, &mut self.elastic, &mut self.tangent)
    }

    /// Predicts the displacement at a new pose from `u`, whose strain was the last that was found: one linear solve in which what
    /// touches keeps touching. Answers the strain it ends with.
    pub fn predict(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &mut Vec<f32>,
        strain: Strain,
    ) -> Strain {
        let operator = &problem.machine.operator;
        contacts.set_bilateral(true);
        let state = self.begin(problem, contacts, u, strain);
        let mut found = strain;
        if state.valid() {
            self.iterations += 1;
            self.springs.update(
                operator.grid(),
                &problem.machine.green,
                problem.machine.frames.as_ref(),
                contacts,
            );
            self.direction(problem, contacts, PREDICTED);
            let mut trial = std::mem::take(&mut self.trial);
            let mut went = false;
            for part in [1.0, 0.5, 0.25, 0.125] {
                trial.clear();
                trial.extend(u.iter().zip(&self.step).map(|(u, s)| u + part * s));
                found = self.strain(operator, &trial);
                went = found.evaluation.least_volume > 0.1;
                if went {
                    std::mem::swap(u, &mut trial);
                    break;
                }
            }
            if !went {
                found = self.strain(operator, u);
            }
            self.trial = trial;
        }
        contacts.set_bilateral(false);
        found
    }

    /// Forces at `u`, whose strain was the last that was found; [`Self::solve`] goes on from them.
    pub fn begin(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &[f32],
        strain: Strain,
    ) -> State {
        let n = problem.machine.operator.grid().field_len();
        for v in [&mut self.residual, &mut self.step, &mut self.trial_elastic, &mut self.trial_residual] {
            v.resize(n, 0.0);
        }
        contacts.linearise(problem.indenter, problem.pose, u);
        State { strain, relative: balance(problem, contacts, &self.elastic, &mut self.residual) }
    }

    /// Forces at the same `u` after the contacts' multipliers, anchors or bounds have changed.
    pub fn rebalance(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &[f32],
        state: &mut State,
    ) {
        contacts.linearise(problem.indenter, problem.pose, u);
        state.relative = balance(problem, contacts, &self.elastic, &mut self.residual);
    }

    /// Takes Newton steps from `u`, whose forces are `state`, until the residual is below `goal`.
    pub fn solve(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &mut Vec<f32>,
        state: &mut State,
        goal: f64,
    ) -> Outcome {
        let grid = problem.machine.operator.grid();
        let mut iterations = 0;
        let mut forcing = LOOSEST;
        while state.relative > goal && iterations < MOST_ITERATIONS && state.valid() {
            iterations += 1;
            self.iterations += 1;
            self.springs.update(grid, &problem.machine.green, problem.machine.frames.as_ref(), contacts);
            self.direction(problem, contacts, f64::max(forcing, PART_OF_GOAL * goal / state.relative));
            let before = state.relative;
            let Some(next) = self.search(problem, contacts, u) else { break };
            *state = next;
            // Eisenstat and Walker's second choice keeps the inner effort in step with progress.
            forcing = (0.9 * (state.relative / before).powi(2)).clamp(0.02, LOOSEST);
        }
        Outcome {
            converged: state.relative <= goal,
            residual: state.relative,
            iterations,
            evaluation: state.strain.evaluation,
            base_force: state.strain.base_force,
        }
    }

    /// Forces at `u`: internal ones in `elastic`, and in `residual` what the contact leaves of them.
    fn measure(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &[f32],
        elastic: &mut [f32],
        residual: &mut [f32],
    ) -> State {
        self.strains += 1;
        let strain = strain(&problem.machine.operator, u, elastic, &mut self.tangent);
        contacts.linearise(problem.indenter, problem.pose, u);
        State { strain, relative: balance(problem, contacts, elastic, residual) }
    }

    /// Conjugate gradients for `step` = -K^-1 residual, to a relative reduction `goal`.
    fn direction(&mut self, problem: &Problem<'_>, contacts: &Contacts, goal: f64) {
        let Machine { operator: op, layer, frames, .. } = problem.machine;
        let frames = frames.as_ref();
        let grid = op.grid();
        let n = grid.field_len();
        for v in [&mut self.r, &mut self.z, &mut self.p, &mut self.ap] {
            v.resize(n, 0.0);
        }
        self.step.fill(0.0);
        for (r, v) in self.r.iter_mut().zip(&self.residual) {
            *r = -v;
        }
        self.springs.apply(grid, layer, frames, &self.r, &mut self.z);
        self.p.copy_from_slice(&self.z);
        let mut rz = dot(&self.r, &self.z);
        // In the preconditioner's norm: the stiff contact springs do not hide the soft pad.
        let stop = goal * goal * rz;
        for pass in 0..MOST_PASSES {
            // What is found now is of no use any more; whoever asked for it ends.
            if self.interrupt.check().is_err() {
                break;
            }
            op.apply(&self.tangent, &self.p, &mut self.ap);
            contacts.apply(&self.p, &mut self.ap);
            self.passes += 1;
            let curvature = dot(&self.p, &self.ap);
            if !(curvature > 0.0) {
                self.indefinite = true;
                if pass == 0 {
                    self.step.copy_from_slice(&self.p);
                }
                break;
            }
            let alpha = (rz / curvature) as f32;
            add_scaled(&mut self.step, &self.p, alpha);
            add_scaled(&mut self.r, &self.ap, -alpha);
            self.springs.apply(grid, layer, frames, &self.r, &mut self.z);
            let next = dot(&self.r, &self.z);
            if next <= stop {
                break;
            }
            let beta = (next / rz) as f32;
            rz = next;
            in_runs(&mut self.p, &self.z, |p, z| *p = z + beta * *p);
        }
    }
}

/// Internal forces at `u` in `elastic`, without those that the base bears.
fn strain(operator: &Operator, u: &[f32], elastic: &mut [f32], tangent: &mut Tangent) -> Strain {
    let evaluation = operator.evaluate(u, elastic, tangent);
    let grid = operator.grid();
    let plane = grid.plane();
    let base = grid.at(2, 0);
    let base_force: f64 = elastic[base..base + plane].iter().map(|v| f64::from(*v)).sum();
    for c in 0..3 {
        let at = grid.at(c, 0);
        elastic[at..at + plane].fill(0.0);
    }
    Strain { evaluation, base_force }
}

/// Residual of the contact forces against `elastic`, relative to the contact forces as they sit on the
/// control points of the face.
fn balance(problem: &Problem<'_>, contacts: &Contacts, elastic: &[f32], residual: &mut [f32]) -> f64 {
    let grid = problem.machine.operator.grid();
    residual.copy_from_slice(elastic);
    contacts.subtract_forces(residual);
    let (top, plane) = (grid.layers() - 1, grid.plane());
    let mut scale = 0.0;
    for c in 0..3 {
        let at = grid.at(c, top);
        for (a, b) in residual[at..at + plane].iter().zip(&elastic[at..at + plane]) {
            scale += f64::from(a - b).powi(2);
        }
    }
    dot(residual, residual).sqrt() / scale.sqrt().max(problem.least_force)
}

/// What a displacement makes of the pad.
#[derive(Debug, Clone, Copy)]
pub struct Strain {
    /// Energy and least volume.
    pub evaluation: Evaluation,
    /// Force of the pad on the base along z, N.
    pub base_force: f64,
}

/// Where the iteration stands.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Of the pad.
    pub strain: Strain,
    /// Residual relative to the contact forces.
    pub relative: f64,
}

impl State {
    /// Whether all points have volume and all forces are numbers.
    pub fn valid(&self) -> bool {
        self.strain.evaluation.least_volume > LEAST_VOLUME && self.relative.is_finite()
    }
}
