//! Newton's method on the pad's potential, with preconditioned conjugate gradients inside.
//!
//! For fixed multipliers, anchors and bounds the equilibrium minimises a potential that is once
//! differentiable, so each Newton direction is one of descent and a search along it for a zero of the
//! directional derivative makes the iteration safe (Nocedal and Wright, chapters 3 and 7). Directions of
//! negative curvature end the inner iteration.

use super::super::interrupt::Interrupt;
use super::contact::Contacts;
use super::layer::RestLayer;
use super::operator::{Evaluation, LEAST_VOLUME, Operator, Tangent};
use super::springs::{FaceGreen, Springs};
use crate::indenter::Indenter;
use crate::pose::Pose;
use rayon::prelude::*;

/// Newton iterations before a solve is given up.
const MOST_ITERATIONS: u32 = 40;
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
}

/// Buffers and counters of the iteration.
#[derive(Debug, Default)]
pub struct Newton {
    tangent: Tangent,
    springs: Springs,
    residual: Vec<f32>,
    trial: Vec<f32>,
    trial_residual: Vec<f32>,
    step: Vec<f32>,
    r: Vec<f32>,
    z: Vec<f32>,
    p: Vec<f32>,
    ap: Vec<f32>,
    /// Ends every solution early.
    pub(in crate::elastomer) interrupt: Interrupt,
    /// Newton iterations since the counters were cleared.
    pub iterations: u64,
    /// Tangent applications since the counters were cleared.
    pub passes: u64,
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
    /// Residual to reach, relative to the contact forces.
    pub tolerance: f64,
    /// Forces below this count as this, N.
    pub least_force: f64,
}

impl Newton {
    /// A solver without memory that this ends early.
    pub(in crate::elastomer) fn ended_by(interrupt: Interrupt) -> Self {
        Self { interrupt, ..Self::default() }
    }

    /// Predicts the displacement at a new pose: one linear solve in which what touches keeps touching.
    pub fn predict(&mut self, problem: &Problem<'_>, contacts: &mut Contacts, u: &mut Vec<f32>) {
        let grid = problem.machine.operator.grid();
        for v in [&mut self.residual, &mut self.trial_residual, &mut self.step] {
            v.resize(grid.field_len(), 0.0);
        }
        let mut residual = std::mem::take(&mut self.residual);
        contacts.set_bilateral(true);
        let state = self.measure(problem, contacts, u, &mut residual);
        if state.valid() {
            self.iterations += 1;
            self.springs.update(grid, &problem.machine.green, contacts);
            self.direction(problem, contacts, &residual, 0.1);
            let mut trial = std::mem::take(&mut self.trial);
            let mut part = 1.0;
            for _ in 0..4 {
                trial.clear();
                trial.extend(u.iter().zip(&self.step).map(|(u, s)| u + part * s));
                let state = problem.machine.operator.evaluate(&trial, &mut residual, &mut self.tangent);
                if state.least_volume > 0.1 {
                    std::mem::swap(u, &mut trial);
                    break;
                }
                part *= 0.5;
            }
            self.trial = trial;
        }
        contacts.set_bilateral(false);
        self.residual = residual;
    }

    /// Least volume ratio at displacement `u`.
    pub fn least_volume(&mut self, operator: &Operator, u: &[f32]) -> f32 {
        self.trial_residual.resize(operator.grid().field_len(), 0.0);
        operator.evaluate(u, &mut self.trial_residual, &mut self.tangent).least_volume
    }

    /// Solves for the displacement, beginning at `u`.
    pub fn solve(&mut self, problem: &Problem<'_>, contacts: &mut Contacts, u: &mut Vec<f32>) -> Outcome {
        let grid = problem.machine.operator.grid();
        let n = grid.field_len();
        for v in [&mut self.residual, &mut self.trial_residual, &mut self.step] {
            v.resize(n, 0.0);
        }
        let mut residual = std::mem::take(&mut self.residual);
        let mut state = self.measure(problem, contacts, u, &mut residual);
        let mut outcome = Outcome {
            converged: false,
            residual: state.relative,
            iterations: 0,
            evaluation: state.evaluation,
            base_force: state.base_force,
        };
        let mut forcing = 0.2;
        while outcome.iterations < MOST_ITERATIONS {
            outcome.residual = state.relative;
            outcome.evaluation = state.evaluation;
            outcome.base_force = state.base_force;
            if state.relative <= problem.tolerance {
                outcome.converged = true;
                break;
            }
            if !state.valid() {
                break;
            }
            outcome.iterations += 1;
            self.iterations += 1;
            self.springs.update(grid, &problem.machine.green, contacts);
            let goal = f64::max(forcing, 0.3 * problem.tolerance / state.relative);
            self.direction(problem, contacts, &residual, goal);
            let before = state.relative;
            let Some(next) = self.search(problem, contacts, u, &mut residual) else { break };
            state = next;
            // Eisenstat and Walker's second choice keeps the inner effort in step with progress.
            forcing = (0.9 * (state.relative / before).powi(2)).clamp(0.02, 0.2);
        }
        self.residual = residual;
        outcome
    }

    /// Residual (internal minus contact forces) at `u`.
    fn measure(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &[f32],
        residual: &mut [f32],
    ) -> State {
        let op = &problem.machine.operator;
        let grid = op.grid();
        let evaluation = op.evaluate(u, residual, &mut self.tangent);
        contacts.linearise(problem.indenter, problem.pose, u);
        let plane = grid.plane();
        let base = grid.at(2, 0);
        let base_force: f64 = residual[base..base + plane].iter().map(|v| f64::from(*v)).sum();
        for c in 0..3 {
            let at = grid.at(c, 0);
            residual[at..at + plane].fill(0.0);
        }
        // The scale of the problem is the contact force as it sits on the control points of the face.
        let top = grid.layers() - 1;
        let mut scale = 0.0;
        let before: Vec<f32> = (0..3).flat_map(|c| residual[grid.at(c, top)..][..plane].to_vec()).collect();
        contacts.subtract_forces(residual);
        for c in 0..3 {
            for (a, b) in residual[grid.at(c, top)..][..plane].iter().zip(&before[c * plane..]) {
                scale += f64::from(a - b).powi(2);
            }
        }
        let norm = dot(residual, residual).sqrt();
        let relative = norm / scale.sqrt().max(problem.least_force);
        State { evaluation, relative, base_force }
    }

    /// Conjugate gradients for `step` = -K^-1 residual, to a relative reduction `goal`.
    fn direction(&mut self, problem: &Problem<'_>, contacts: &Contacts, residual: &[f32], goal: f64) {
        let (op, layer) = (&problem.machine.operator, &problem.machine.layer);
        let grid = op.grid();
        let n = grid.field_len();
        for v in [&mut self.r, &mut self.z, &mut self.p, &mut self.ap] {
            v.resize(n, 0.0);
        }
        self.step.fill(0.0);
        for (r, v) in self.r.iter_mut().zip(residual) {
            *r = -v;
        }
        self.springs.apply(grid, layer, &self.r, &mut self.z);
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
                if pass == 0 {
                    self.step.copy_from_slice(&self.p);
                }
                break;
            }
            let alpha = (rz / curvature) as f32;
            add_scaled(&mut self.step, &self.p, alpha);
            add_scaled(&mut self.r, &self.ap, -alpha);
            self.springs.apply(grid, layer, &self.r, &mut self.z);
            let next = dot(&self.r, &self.z);
            if next <= stop {
                break;
            }
            let beta = (next / rz) as f32;
            rz = next;
            self.p.par_iter_mut().zip(&self.z).with_min_len(8192).for_each(|(p, z)| *p = z + beta * *p);
        }
    }

    /// Moves `u` along the step to where the directional derivative has fallen enough.
    fn search(
        &mut self,
        problem: &Problem<'_>,
        contacts: &mut Contacts,
        u: &mut Vec<f32>,
        residual: &mut Vec<f32>,
    ) -> Option<State> {
        let slope0 = dot(residual, &self.step);
        let norm0 = dot(residual, residual);
        let (mut low, mut slope_low, mut high) = (0.0, slope0, None::<(f64, f64)>);
        let mut moved_low = false;
        let mut alpha = 1.0;
        let mut trial = std::mem::take(&mut self.trial);
        let mut trial_residual = std::mem::take(&mut self.trial_residual);
        let mut found = None;
        for attempt in 0..12 {
            trial.clear();
            trial.extend(u.iter().zip(&self.step).map(|(u, s)| u + alpha as f32 * s));
            let state = self.measure(problem, contacts, &trial, &mut trial_residual);
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
            std::mem::swap(residual, &mut trial_residual);
        }
        self.trial = trial;
        self.trial_residual = trial_residual;
        found
    }
}

#[derive(Clone, Copy)]
struct State {
    evaluation: Evaluation,
    relative: f64,
    base_force: f64,
}

impl State {
    fn valid(&self) -> bool {
        self.evaluation.least_volume > LEAST_VOLUME && self.relative.is_finite()
    }
}

/// Dot product: single precision in runs of 256, double beyond; the order is fixed.
pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    let chunk = |(a, b): (&[f32], &[f32])| -> f64 {
        a.chunks(256)
            .zip(b.chunks(256))
            .map(|(a, b)| {
                let mut lanes = [0.0f32; 16];
                let (ha, hb) = (a.chunks_exact(16), b.chunks_exact(16));
                let rest: f32 = ha.remainder().iter().zip(hb.remainder()).map(|(x, y)| x * y).sum();
                for (x, y) in ha.zip(hb) {
                    for l in 0..16 {
                        lanes[l] += x[l] * y[l];
                    }
                }
                lanes.iter().map(|v| f64::from(*v)).sum::<f64>() + f64::from(rest)
            })
            .sum()
    };
    let parts: Vec<f64> = a.par_chunks(16384).zip(b.par_chunks(16384)).map(chunk).collect();
    parts.iter().sum()
}

fn add_scaled(y: &mut [f32], x: &[f32], a: f32) {
    y.par_iter_mut().zip(x).with_min_len(8192).for_each(|(y, x)| *y += a * x);
}
