//! The explicit modes: the paper's material point method, with its relative-rest loop (`impm`) or without (`mpm`).
//!
//! This is the paper's Algorithm 1 (section III-A), with quadratic B-splines on a shared grid: pad and indenter
//! are particles, and what shares nodes moves together, so the contact sticks. The stages of a
//! step, each a file:
//!
//! 1. [`cloud`]: the indenter's points put their mass and prescribed momentum on the grid;
//! 2. [`update`]: momentum to velocity, with what the pad's particles put there;
//! 3. here: the relative-rest test; on acceptance (or at the limit) x and F advance once, otherwise the
//!    pass is repeated with x and F held;
//! 4. [`transfer`] with [`spline`] and [`stress`]: grid to particles, and the same particles back to the grid;
//! 5. [`body`] over [`grid`] and [`particles`]: particles find their new blocks.
//!
//! **Corrections to the printed method** (all needed for it to work at all): C is the moment of the grid's
//! velocities, not of the particle's own; the affine momentum carries the particle's mass; the
//! particles move once a step, not twice; the rest test |v_e - v_o| <= threshold max(|v_o|, floor) has no division
//! by a speed that may be zero, and waits for contact. Units and the predecessor's density: [`scheme`].
//!
//! **Terms.** x_o is the lowest point of the indenter and v_o its prescribed velocity; x_e is the pad
//! particle nearest to it and v_e the velocity it has after the pass. Travel is the displacement of x_o.
//! A *particle-step* is one particle through one pass.
//!
//! **What it does not do.** No Coulomb friction (the grid sticks), no pad shapes but the cuboid, no
//! equilibrium: at 200 mm/s against a shear wave of 224 mm/s a press is a transient, and the pad begins to move
//! when the indenter is still about a cell away. For answers use the quasi-static mode; these modes
//! are for reproducing the paper.

// Small matrices and stencils are indexed by several things at once; iterators would hide the formula.
#![allow(clippy::needless_range_loop)]

pub mod bench;
pub mod body;
pub mod cloud;
pub mod grid;
pub mod lanes;
pub mod particles;
pub mod roofline;
pub mod scheme;
pub mod shape;
pub mod spline;
pub mod stress;
pub mod surface;
pub mod transfer;
pub mod update;

use self::body::{Body, Fault};
use self::cloud::Cloud;
use self::lanes::Isa;
use self::scheme::Scheme;
use self::stress::Stored;
use super::interrupt::Interrupt;
use super::{
    ContactForces, Elastomer, ElastomerCapture, Error, Mode, Pad, Settings, Skip, SolverStats, Surface,
    pose_can_be_reached,
};
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Forces at a capture are means over this many steps: single steps carry the grid's noise.
const FORCE_WINDOW_STEPS: usize = 10;
/// Two particles further apart than this, in cells along any axis, share no node.
const REACH_CELLS: f64 = 3.0;

/// Largest part of the deformation that the strain carried may leave unexplained: beyond it, no strain at all would be
/// nearer to the shape ([`shape`]). The paper's own slides of 5 mm on its lattice end at 0.6 to 0.7.
const MOST_UNEXPLAINED: f64 = 1.0;
/// How deep a point of the face may lie inside the indenter, cells. The shared grid keeps the face about half a cell
/// outside; a cell inside, the nodes of a kernel of radius 1.5 belong to the indenter's points alone and none is left
/// that could push the face back.
const DEEPEST_CELLS: f64 = 1.0;
/// How much wider than where it is narrowest the gap over a contact may be, cells.
const SPREAD_OF_GAP: f64 = 0.3;
/// Further than this from the indenter, in cells, nothing is touched.
const MOST_REACH: f64 = 2.0;

/// Momentum exchanged in one step, solver's units.
#[derive(Debug, Clone, Copy, Default)]
struct StepForces {
    on_pad: [f64; 3],
    torque: f64,
    base: [f64; 3],
}

/// Work done since the last capture.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    steps: u64,
    passes: u64,
    limit_hits: u64,
    /// Particle-steps in blocks that were not at rest.
    computed: u64,
}

/// What a pass has come to.
#[derive(Debug, Clone, Copy)]
enum Rest {
    /// x_e moves with the indenter.
    Reached,
    /// No particle is near enough to x_o to be moved by it; the nearest, if there is one.
    Away { particle: Option<usize> },
    /// x_e moves against it, so many times as fast as it goes.
    Moving { particle: usize, departure: f64 },
}

impl Rest {
    /// What the loop has done where it ends further from rest than with what came of its `first` pass. (At a threshold of 0.001 the
    /// face is thrown off the indenter by one loop of 20 passes, and all numbers stay finite.)
    fn worse_than(self, first: Self) -> Option<Fault> {
        match (self, first) {
            (Self::Away { particle }, Self::Moving { particle: before, .. }) => {
                Some(Fault { particle: particle.unwrap_or(before), what: THROWN_OFF })
            }
            (Self::Moving { particle, departure }, Self::Moving { departure: before, .. })
                if departure > before || departure.is_nan() =>
            {
                Some(Fault { particle, what: FASTER })
            }
            _ => None,
        }
    }
}

const THROWN_OFF: &str = "the relative-rest loop threw the pad off the indenter";
const FASTER: &str =
    "at the limit of the relative-rest loop the pad moves faster against the indenter than at its first pass";

/// A pad followed step by step.
#[derive(Debug, Clone)]
pub struct ExplicitSolver {
    interrupt: Interrupt,
    settings: Settings,
    indenter: Arc<dyn Indenter>,
    cloud: Arc<Cloud>,
    body: Body,
    pose: Pose,
    /// Whether the indenter has ever come near the pad (before that nothing is computed), or that is not asked.
    touched: bool,
    step: u64,
    forces: VecDeque<StepForces>,
    tally: Tally,
    /// Largest deformation at a capture so far, as a sum of squares ([`shape`]).
    most_deformed: f64,
}

impl ExplicitSolver {
    /// A pad at rest with the indenter at `start`. A start inside the pad is reached by a straight press from above.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that cannot work; [`Error::Diverged`] if the press to `start` blows up.
    pub fn new(
        pad: &Pad,
        settings: &Settings,
        indenter: Arc<dyn Indenter>,
        start: &Pose,
    ) -> Result<Self, Error> {
        Self::with_isa(pad, settings, indenter, start, Isa::best())
    }

    /// As [`ExplicitSolver::new`], with a given instruction set.
    ///
    /// # Errors
    /// As [`ExplicitSolver::new`].
    pub fn with_isa(
        pad: &Pad,
        settings: &Settings,
        indenter: Arc<dyn Indenter>,
        start: &Pose,
        isa: Isa,
    ) -> Result<Self, Error> {
        let scheme = Scheme::new(pad, settings)?;
        let spacing = scheme.spacing_mm.iter().copied().fold(f64::INFINITY, f64::min) / 2.0;
        let cloud = Cloud::sample(&*indenter, spacing, scheme.dx_mm, scheme.size_mm[2]).ok_or_else(|| {
            Error::Setting {
                key: "indenter",
                value: indenter.name().to_owned(),
                allowed: format!("a surface within {} mm above the tip", scheme.size_mm[2]),
                next: "place the tip at the origin of the indenter's frame".to_owned(),
            }
        })?;
        let clear = REACH_CELLS * scheme.dx_mm;
        let mut pose = *start;
        if start.z_mm < 0.0 {
            pose.z_mm = clear;
        }
        let mut body = Body::new(scheme, settings.base, isa);
        body.rest_is_computed = !settings.skips(Skip::Rest);
        let mut solver = Self {
            interrupt: Interrupt::default(),
            settings: settings.clone(),
            indenter,
            cloud: Arc::new(cloud),
            body,
            pose,
            touched: !settings.skips(Skip::FirstTouch),
            step: 0,
            forces: VecDeque::new(),
            tally: Tally::default(),
            most_deformed: 0.0,
        };
        solver.advance(start)?;
        Ok(solver)
    }

    /// The pad, for measurements.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// Where the indenter is.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// One step with the indenter moving from its pose to `to`.
    fn step_to(&mut self, to: &Pose) -> Result<(), Error> {
        let clear = REACH_CELLS * self.body.scheme.dx_mm;
        if !self.touched && to.z_mm.min(self.pose.z_mm) > clear {
            self.pose = *to;
            return Ok(());
        }
        self.touched = true;
        let from = self.pose;
        self.body.scatter_cloud(&self.cloud, &from, to);
        let x_o = from.to_pad(self.cloud.lowest);
        let v_o = (to.to_pad(self.cloud.lowest) - x_o) / self.body.scheme.dx_mm;
        let mut sum = StepForces::default();
        let mut passes = 0;
        let mut first = None;
        loop {
            let exchange = self.body.update_grid();
            passes += 1;
            let rest = match self.settings.mode {
                Mode::Mpm => Rest::Reached,
                _ => self.relative_rest(x_o, v_o),
            };
            let moves = matches!(rest, Rest::Moving { .. });
            let last = !moves || passes >= self.settings.rest_limit;
            self.body.pass(last).map_err(|f| self.diverged(f))?;
            self.tally.computed += self.body.computed as u64;
            for d in 0..3 {
                sum.on_pad[d] += exchange.impulse[d];
                sum.base[d] += self.body.base_impulse[d];
            }
            sum.torque += self.torque_about_axis(&exchange, &from);
            if last {
                self.tally.limit_hits += u64::from(moves);
                if let Some(fault) = first.and_then(|first| rest.worse_than(first)) {
                    return Err(self.diverged(fault));
                }
                break;
            }
            first.get_or_insert(rest);
        }
        self.tally.steps += 1;
        self.tally.passes += u64::from(passes);
        self.step += 1;
        self.pose = *to;
        if self.forces.len() == FORCE_WINDOW_STEPS {
            self.forces.pop_front();
        }
        self.forces.push_back(sum);
        Ok(())
    }

    fn torque_about_axis(&self, exchange: &update::Exchange, pose: &Pose) -> f64 {
        let dx = self.body.scheme.dx_mm;
        exchange.torque - (pose.x_mm * exchange.impulse[1] - pose.y_mm * exchange.impulse[0]) / dx
    }

    /// The rest test of Algorithm 1, on the velocity that x_e is about to get.
    fn relative_rest(&self, x_o: DVec3, v_o: DVec3) -> Rest {
        let Some(e) = self.body.nearest(x_o.to_array()) else { return Rest::Away { particle: None } };
        let particle = e.id as usize;
        let x_e = DVec3::from_array(self.body.grid.position_mm(e.cell, e.offset));
        let scheme = &self.body.scheme;
        if (x_e - x_o).abs().max_element() > scheme.dx_mm {
            return Rest::Away { particle: Some(particle) };
        }
        let v_e = DVec3::from_array(self.body.grid_velocity(e.cell, e.offset));
        let floor = self.settings.rest_floor_mm_s / scheme.unit_speed_mm_s();
        let departure = (v_e - v_o).length() / v_o.length().max(floor);
        if departure <= self.settings.rest_threshold {
            return Rest::Reached;
        }
        Rest::Moving { particle, departure }
    }

    fn mode_name(&self) -> &'static str {
        if self.settings.mode == Mode::Mpm { "mpm" } else { "impm" }
    }

    /// Whether the state can be shown: finite numbers alone do not make it right.
    fn check_state(&mut self, nearest_mm: f64) -> Result<(), Error> {
        let cell_mm = self.body.scheme.dx_mm;
        if -nearest_mm > DEEPEST_CELLS * cell_mm {
            let (mode, pose) = (self.mode_name(), self.pose);
            return Err(Error::PassedThrough { mode, pose, inside_mm: -nearest_mm, cell_mm });
        }
        let drift = shape::drift(&self.body);
        // A released pad is compared with the press that it comes from: what is left of it is mostly noise.
        self.most_deformed = self.most_deformed.max(drift.shape).max(shape::least(&self.body));
        let unexplained = drift.unexplained(self.most_deformed);
        if unexplained > MOST_UNEXPLAINED || unexplained.is_nan() {
            return Err(Error::Drifted {
                mode: self.mode_name(),
                step: self.step,
                time_s: self.step as f64 * self.body.scheme.dt_s,
                unexplained,
                allowed: MOST_UNEXPLAINED,
            });
        }
        Ok(())
    }

    fn diverged(&self, fault: Fault) -> Error {
        Error::Diverged {
            mode: self.mode_name(),
            step: self.step,
            time_s: self.step as f64 * self.body.scheme.dt_s,
            particle: fault.particle,
            what: fault.what.to_owned(),
        }
    }

    /// Kinetic and elastic energy, N mm.
    pub fn energies_n_mm(&self) -> (f64, f64) {
        let scheme = &self.body.scheme;
        let parts: Vec<f64> = self
            .body
            .blocks()
            .map(|(bin, _)| self.body.isa.run(Stored { bin, law: scheme.law, moduli: scheme.moduli_pa }))
            .collect();
        let (kinetic, elastic) = (0.5 * self.body.speed_squared, parts.iter().sum::<f64>());
        let volume: f64 = scheme.spacing_mm.iter().product();
        // g (mm/s)^2 and Pa mm^3 are both 1e-6 N mm.
        (
            kinetic * scheme.particle_mass_g() * scheme.unit_speed_mm_s().powi(2) * 1e-6,
            elastic * volume * 1e-6,
        )
    }

    /// Mean over the last steps of a part of the momentum exchange, N (or N cells).
    fn mean_force(&self, part: impl Fn(&StepForces) -> f64) -> f64 {
        if self.forces.is_empty() {
            return 0.0;
        }
        let sum: f64 = self.forces.iter().map(part).sum();
        sum / self.forces.len() as f64 * self.body.scheme.unit_force_n()
    }
}

impl Elastomer for ExplicitSolver {
    fn advance(&mut self, pose: &Pose) -> Result<(), Error> {
        pose_can_be_reached(self.indenter.as_ref(), pose, 0.0, self.body.scheme.size_mm[2])?;
        // A turn counts by the way of the outermost sampled point, so that no point is faster than the speed set.
        let from = self.pose;
        let turn = (pose.theta_deg - from.theta_deg).to_radians().abs() * self.cloud.radius_mm;
        let way = from.distance_mm(pose).hypot(turn);
        let steps = (way / (self.settings.speed_mm_s * self.body.scheme.dt_s)).ceil();
        if !steps.is_finite() || steps > 1e9 {
            return Err(Error::Setting {
                key: "elastomer.speed_mm_s",
                value: self.settings.speed_mm_s.to_string(),
                allowed: format!("at most 1e9 steps for a way of {way} mm"),
                next: "choose a higher speed".to_owned(),
            });
        }
        let steps = steps as u64;
        // On a thread of the pool: from any other, every parallel loop would wait for one to wake.
        rayon::scope(|_| {
            (1..=steps).try_for_each(|n| {
                self.interrupt.check()?;
                self.step_to(&from.lerp(pose, n as f64 / steps as f64))
            })
        })?;
        self.pose = *pose;
        Ok(())
    }

    fn capture(&mut self, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        Surface::can_have(nx, ny)?;
        let surface = surface::sample(&self.body, nx, ny);
        let distance_mm: Vec<f64> = surface
            .positions
            .par_iter()
            .map(|p| self.indenter.distance(self.pose.to_indenter(p.as_dvec3())))
            .collect();
        let nearest_mm = distance_mm.iter().copied().fold(f64::INFINITY, f64::min);
        self.check_state(nearest_mm)?;
        let scheme = &self.body.scheme;
        let presses = self.mean_force(|f| f.on_pad[2]) != 0.0;
        let reach_mm = if presses { reach_mm(nearest_mm, scheme.dx_mm) } else { scheme.dx_mm };
        let contact: Vec<bool> = distance_mm.iter().map(|d| *d <= reach_mm).collect();
        let contact_area_mm2 = surface.seen_mm2(&contact);
        let (kinetic, elastic) = self.energies_n_mm();
        let forces = ContactForces {
            normal_force_n: -self.mean_force(|f| f.on_pad[2]),
            shear_force_n: [-self.mean_force(|f| f.on_pad[0]), -self.mean_force(|f| f.on_pad[1])],
            torque_n_mm: -self.mean_force(|f| f.torque) * scheme.dx_mm,
        };
        let tally = std::mem::take(&mut self.tally);
        let stats = SolverStats {
            iterations: tally.steps,
            passes: tally.passes,
            passes_per_step: tally.passes as f64 / tally.steps.max(1) as f64,
            limit_hits: tally.limit_hits,
            particles: self.body.len() as u64,
            residual: if elastic > 0.0 { kinetic / elastic } else { 0.0 },
            estimated_error: None,
            elastic_energy_n_mm: elastic,
            base_reaction_n: self.mean_force(|f| f.base[2]),
            contact_area_mm2,
            held: None,
        };
        Ok(ElastomerCapture { surface, contact, rim: Vec::new(), forces, stats })
    }

    fn interrupt_by(&mut self, flag: Arc<AtomicBool>) {
        self.interrupt = Interrupt::by(flag);
    }

    fn fork(&self) -> Box<dyn Elastomer> {
        Box::new(self.clone())
    }
}

/// How far from an indenter that presses the face is still touched, mm: grids carry pressure across a gap, mostly of 0.6 to 0.7 cells, and of more than
/// one where the pad is nearly incompressible.
fn reach_mm(nearest_mm: f64, dx_mm: f64) -> f64 {
    (nearest_mm + SPREAD_OF_GAP * dx_mm).clamp(dx_mm, MOST_REACH * dx_mm)
}

#[cfg(test)]
mod tests;
