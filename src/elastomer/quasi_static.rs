//! The quasi-static elastomer: every waypoint is an equilibrium of the bonded pad.
//!
//! Total-Lagrangian, on quadratic B-splines over a grid that fits the pad ([`grid`]); stresses and
//! tangents from the stored energy ([`law`], [`operator`]); unilateral contact with Coulomb or infinite
//! friction against the indenter's signed distance ([`contact`]); Newton's method with conjugate gradients
//! ([`newton`]), preconditioned by the exact inverse of the undeformed layer ([`layer`]) with the contact
//! springs added by the Woodbury formula ([`springs`]). Relative rest, which the explicit modes reach by
//! looping, is here the friction law itself.
//!
//! A path is followed in increments; what an increment leaves behind is the displacement and, with
//! friction, the anchors of the points that touch. Nothing is computed before the first touch. An
//! increment that does not converge is halved, and given up with a typed error in the end.

#![allow(
    clippy::needless_range_loop,
    clippy::neg_cmp_op_on_partial_ord,
    reason = "tensor code reads best with indices; a negated comparison is how a NaN is caught"
)]

pub mod contact;
pub mod grid;
pub mod lanes;
pub mod law;
pub mod layer;
pub mod newton;
pub mod operator;
pub mod probe;
pub mod springs;
pub mod stress;

use super::interrupt::Interrupt;
use super::{
    ContactForces, Elastomer, ElastomerCapture, Error, Friction, Pad, PadShape, Settings, SolverStats,
    Surface, pose_can_be_reached,
};
use crate::indenter::Indenter;
use crate::pose::Pose;
use contact::{Contacts, STICK_STRENGTH};
use glam::Vec3;
use grid::Grid;
use layer::RestLayer;
use newton::{Machine, Newton, Outcome, Problem};
use operator::Operator;
use springs::FaceGreen;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Smallest distance of the contact from the pad's edge, mm.
const EDGE_MARGIN_MM: f64 = 1.0;
/// Solves per increment between which multipliers, anchors and bounds are brought up to date.
const MOST_ROUNDS: u32 = 40;
/// Rounds that end at a part of the residual they began with, and that part.
const QUICK_ROUNDS: u32 = 30;
/// See [`QUICK_ROUNDS`].
const QUICK_REDUCTION: f64 = 0.3;
/// Error of the surface per penetration at the corners of loaded cells: against cells of half the size, a sphere
/// and a flat moon pressed 0.5 mm are 1.6 and 8.6 um off, 0.3 and 1.7 %.
const MISFIT_TO_ERROR: f64 = 2.0;
/// Error of the surface per friction that was still changing (found by experiment).
const FRICTION_TO_ERROR: f64 = 0.1;
/// Newton iterations in an increment before it is halved.
const MOST_NEWTON: u32 = 100;
/// A residual (relative to the contact forces) with which an increment may end when its rounds are used up.
const ROUGH_RESIDUAL: f64 = 0.05;
/// A residual with which another round is worth its while.
const HOPELESS_RESIDUAL: f64 = 0.3;
/// Least volume ratio of a guess.
const GUESS_VOLUME: f32 = 0.1;
/// Longest way of the indenter in one increment, mm: a stick press in one stride of 1 mm loses 1 to 8 % of
/// the force, because the anchors follow the path; half of that converges.
const LONGEST_INCREMENT_MM: f64 = 0.5;
/// Longest way along the face in one increment with friction, mm.
const LONGEST_SLIDE_MM: f64 = 0.25;
/// Largest turn in one increment, degrees.
const LARGEST_TURN_DEG: f64 = 5.0;
/// How often an increment may be halved.
const MOST_HALVINGS: i32 = 6;
/// Tangent applications for each increment of a way before it is given up.
const MOST_PASSES: f64 = 4000.0;

/// A pad that follows an indenter through equilibria.
#[derive(Debug)]
pub struct QuasiStaticSolver {
    machine: Arc<Machine>,
    indenter: Arc<dyn Indenter>,
    pose: Pose,
    tolerance: f64,
    violation_mm: f64,
    contacts: Contacts,
    u: Vec<f32>,
    /// Displacement one increment ago, and the way of the indenter since then, for extrapolation.
    last: Option<(Vec<f32>, [f64; 4])>,
    at_rest: bool,
    outcome: Option<Outcome>,
    /// Largest penetration at a sample point after the last solve, mm.
    penetration_mm: f64,
    /// Part of the friction that was still changing after the last solve.
    unsettled: f64,
    newton: Newton,
    least_force: f64,
}

/// Resolution and stopping that meet an error relative to depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolution {
    /// Cell size in the plane, mm.
    pub cell_mm: f64,
    /// Height of the uppermost cells relative to their width.
    pub first_height: f64,
    /// Growth of cell heights away from the face.
    pub growth: f64,
    /// Contact samples along one edge of a cell.
    pub samples: usize,
    /// Residual relative to the contact force.
    pub residual: f64,
    /// Penetration that may remain, mm.
    pub violation_mm: f64,
}

impl Resolution {
    /// What a tolerance needs (found by experiment against converged solutions).
    pub fn for_tolerance(tolerance: f64) -> Self {
        let cell_mm = (0.417 * (tolerance / 0.01).powf(0.456)).clamp(0.1, 0.834);
        Self {
            cell_mm,
            first_height: 0.8,
            growth: 1.25,
            samples: 2,
            residual: (0.1 * tolerance).clamp(1e-4, 1e-3),
            violation_mm: (0.1 * tolerance).clamp(2e-4, 1e-3),
        }
    }
}

impl QuasiStaticSolver {
    /// A solver for `pad` as overridden by `settings`, with the indenter at `start`.
    ///
    /// # Errors
    /// [`Error::Setting`] when the pad or a setting is out of range; whatever the first contact brings
    /// when `start` already touches.
    pub fn new(
        pad: &Pad,
        settings: &Settings,
        indenter: Arc<dyn Indenter>,
        start: &Pose,
    ) -> Result<Self, Error> {
        check(pad, settings)?;
        let resolution = Resolution::for_tolerance(settings.tolerance);
        Self::with_resolution(pad, settings, resolution, indenter, start)
    }

    /// As [`Self::new`], with the resolution given instead of derived from the tolerance.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_resolution(
        pad: &Pad,
        settings: &Settings,
        resolution: Resolution,
        indenter: Arc<dyn Indenter>,
        start: &Pose,
    ) -> Result<Self, Error> {
        pose_can_be_reached(start, pad.thickness_mm)?;
        let mut material = pad.material;
        material.law = settings.law.unwrap_or(material.law);
        material.youngs_modulus_mpa = settings.youngs_modulus_mpa.unwrap_or(material.youngs_modulus_mpa);
        material.poisson_ratio = settings.poisson_ratio.unwrap_or(material.poisson_ratio);
        let size = [pad.size_x_mm, pad.size_y_mm, pad.thickness_mm];
        let grid = Grid::new(size, resolution.cell_mm, resolution.first_height, resolution.growth);
        let (mu, lambda) = (material.mu_mpa(), material.lambda_mpa());
        let layer = RestLayer::new(&grid, mu, lambda);
        let green = FaceGreen::new(&grid, &layer);
        // 17 MPa/mm at E = 0.145 MPa and cells of 0.4 mm: ten times the pad's own stiffness at that scale;
        // the multipliers do the rest.
        let stiffness = 50.0 * material.youngs_modulus_mpa / grid.hx;
        let contacts =
            Contacts::new(&grid, resolution.samples, stiffness, settings.friction, STICK_STRENGTH * mu);
        let u = vec![0.0; grid.field_len()];
        let least_force = 1e-5 * material.youngs_modulus_mpa * grid.hx * grid.hy;
        let operator = Operator::new(grid, material.law, mu, lambda);
        let mut solver = Self {
            machine: Arc::new(Machine { operator, layer, green }),
            indenter,
            pose: *start,
            tolerance: resolution.residual,
            violation_mm: resolution.violation_mm,
            contacts,
            u,
            last: None,
            at_rest: true,
            outcome: None,
            penetration_mm: 0.0,
            unsettled: 0.0,
            newton: Newton::default(),
            least_force,
        };
        if solver.contacts.least_gap(solver.indenter.as_ref(), start, None) < 0.0 {
            // Begin above the pad and come down, as an indenter would.
            solver.pose.z_mm = start.z_mm.max(0.0) + 1e-3;
            solver.advance(start)?;
        }
        Ok(solver)
    }

    /// One increment to `pose`; the state is unchanged when it fails.
    fn increment(&mut self, pose: &Pose) -> Result<(), Outcome> {
        let indenter = Arc::clone(&self.indenter);
        let indenter = indenter.as_ref();
        // The face at rest is an equilibrium wherever the indenter does not touch it.
        if self.contacts.least_gap(indenter, pose, None) >= 0.0 {
            self.contacts.clear();
            self.u.fill(0.0);
            self.at_rest = true;
            self.last = None;
            self.outcome = None;
            self.pose = *pose;
            return Ok(());
        }
        let saved = (self.contacts.clone(), self.u.clone());
        self.contacts.begin_increment(indenter, &self.pose, pose, &self.u);
        let machine = Arc::clone(&self.machine);
        let problem = Problem { machine: &machine, indenter, pose, least_force: self.least_force };
        let way = way_between(&self.pose, pose);
        self.guess(&problem, &way);
        let outcome = match self.settle(&problem) {
            Ok(outcome) => outcome,
            Err(outcome) => {
                (self.contacts, self.u) = saved;
                return Err(outcome);
            }
        };
        self.contacts.end_increment(indenter);
        self.last = (!self.at_rest).then_some((saved.1, way));
        self.at_rest = false;
        self.outcome = Some(outcome);
        self.pose = *pose;
        Ok(())
    }

    /// How many increments a way takes: a press may be long; what moves along the face with friction goes
    /// part of a cell at a time, so that points come and go a few at once.
    fn increments(&self, from: &Pose, to: &Pose) -> f64 {
        let along = (to.x_mm - from.x_mm).hypot(to.y_mm - from.y_mm);
        let down = (to.z_mm - from.z_mm).abs();
        let turn = (to.theta_deg - from.theta_deg).abs();
        let short = if self.contacts.has_friction() { LONGEST_SLIDE_MM } else { LONGEST_INCREMENT_MM };
        (down / LONGEST_INCREMENT_MM).max(along / short).max(turn / LARGEST_TURN_DEG).ceil().max(1.0)
    }

    /// Guesses the displacement at the next pose: extrapolated where the way goes on as before, then one
    /// linear solve in which what touches keeps touching. A guess that folds the pad is dropped.
    fn guess(&mut self, problem: &Problem<'_>, way: &[f64; 4]) {
        if self.at_rest {
            return;
        }
        let before = self.u.clone();
        if let Some((older, last_way)) = &self.last
            && let Some(s) = along(way, last_way)
        {
            for (u, b) in self.u.iter_mut().zip(older) {
                *u += s as f32 * (*u - b);
            }
            if !(self.newton.least_volume(&problem.machine.operator, &self.u) > GUESS_VOLUME) {
                self.u.copy_from_slice(&before);
            }
        }
        self.newton.predict(problem, &mut self.contacts, &mut self.u);
    }

    /// Solves in rounds until multipliers, anchors and bounds agree with the displacement, or as nearly as
    /// the rounds allow: what then disagrees is booked as an error. Multipliers are brought up to date long
    /// before the displacement has settled, so that both arrive together; a round that was to be sharp comes
    /// only when this does not converge.
    fn settle(&mut self, problem: &Problem<'_>) -> Result<Outcome, Outcome> {
        let mut state = self.newton.begin(problem, &mut self.contacts, &self.u);
        let mut spent = 0;
        let mut rounds = 0;
        loop {
            let goal = if rounds < QUICK_ROUNDS { QUICK_REDUCTION * state.relative.min(1.0) } else { 0.0 };
            let goal = goal.max(self.tolerance);
            let mut outcome = self.newton.solve(problem, &mut self.contacts, &mut self.u, &mut state, goal);
            rounds += 1;
            spent += outcome.iterations;
            outcome.iterations = spent;
            if !(outcome.residual <= HOPELESS_RESIDUAL.max(goal)) || !state.valid() {
                return Err(outcome);
            }
            let updated = self.contacts.update(problem.indenter, [&self.pose, problem.pose], &self.u, rounds);
            self.newton.rebalance(problem, &mut self.contacts, &self.u, &mut state);
            outcome.residual = state.relative;
            self.penetration_mm = updated.violation_mm;
            self.unsettled = updated.bound_change;
            let settled = updated.events == 0
                && updated.violation_mm < self.violation_mm
                && state.relative <= self.tolerance;
            if settled {
                return Ok(outcome);
            }
            if rounds == MOST_ROUNDS || spent > MOST_NEWTON {
                let near =
                    updated.violation_mm < 10.0 * self.violation_mm && outcome.residual <= ROUGH_RESIDUAL;
                return if near { Ok(outcome) } else { Err(outcome) };
            }
        }
    }

    /// Error of the surface relative to depth, estimated from what the splines leave between the sample
    /// points: the penetration found there, and the residual. Calibrated against finite elements. A body that the
    /// sample points have missed altogether is seen by [`probe`].
    fn estimated_error(&self) -> Option<f64> {
        let depth = self.pose.depth_mm();
        if depth <= 0.0 {
            return None;
        }
        let grid = self.machine.operator.grid();
        let unseen = probe::unseen_penetration_mm(grid, &self.u, self.indenter.as_ref(), &self.pose);
        let Some(outcome) = self.outcome else { return (unseen > 0.0).then_some(unseen / depth) };
        let between = self.contacts.penetration_between(self.indenter.as_ref(), &self.pose, &self.u);
        let misfit = (MISFIT_TO_ERROR * between + self.penetration_mm).max(unseen);
        Some(misfit / depth + outcome.residual + FRICTION_TO_ERROR * self.unsettled)
    }

    /// Refuses contact beside the pad or too close to its edge.
    fn check_margin(&self) -> Result<(), Error> {
        let size = self.machine.operator.grid().size;
        let [hx, hy] = self.indenter.half_extent_mm();
        // A body that covers the pad has no contact edge on it.
        let covers = |at: f64, half: f64, size: f64| at.abs() + size / 2.0 <= half;
        let distance = |p: f64, at: f64, half: f64, size: f64| {
            if covers(at, half, size) { f64::INFINITY } else { size / 2.0 - p.abs() }
        };
        let mut least = f64::INFINITY;
        for p in self.contacts.touching_points() {
            least = least.min(distance(p.x, self.pose.x_mm, hx, size[0])).min(distance(
                p.y,
                self.pose.y_mm,
                hy,
                size[1],
            ));
        }
        if least < EDGE_MARGIN_MM {
            return Err(Error::OffPad { pose: self.pose, distance_mm: least, allowed_mm: EDGE_MARGIN_MM });
        }
        Ok(())
    }
}

impl Elastomer for QuasiStaticSolver {
    fn advance(&mut self, pose: &Pose) -> Result<(), Error> {
        pose_can_be_reached(pose, self.machine.operator.grid().size[2])?;
        let straight_down = Pose { z_mm: self.pose.z_mm, ..*pose } == self.pose;
        if self.at_rest && straight_down {
            // Nothing happens before the first touch, so nothing is computed.
            let part = self.contacts.first_touch(self.indenter.as_ref(), &self.pose, pose);
            self.pose = self.pose.lerp(pose, part);
        }
        let start = self.pose;
        let parts = self.increments(&start, pose);
        let (mut done, mut stride, mut restarts) = (0.0, 1.0 / parts, 0);
        let begun = self.newton.passes;
        while done < 1.0 {
            self.newton.interrupt.check()?;
            let next = f64::min(1.0, done + stride);
            let next = if next > 1.0 - 1e-9 { 1.0 } else { next };
            match self.increment(&start.lerp(pose, next)) {
                Ok(()) => {
                    self.check_margin()?;
                    done = next;
                    stride = f64::min(stride * 1.5, 1.0 / parts);
                }
                Err(outcome) => {
                    restarts += 1;
                    self.last = None;
                    stride *= 0.5;
                    let passes = (self.newton.passes - begun) as f64;
                    if stride * parts < 0.5f64.powi(MOST_HALVINGS) || passes > MOST_PASSES * parts {
                        return Err(Error::NotConverged {
                            pose: start.lerp(pose, next),
                            residual: outcome.residual,
                            iterations: outcome.iterations,
                            restarts,
                            advice: format!(
                                "{:.3} of {:.3} mm of this way were done; lower the depth or the slide, round the \
                                 indenter's edges, set elastomer.friction to a number below 1, or choose another \
                                 elastomer.tolerance (another grid)",
                                done * start.distance_mm(pose),
                                start.distance_mm(pose)
                            ),
                        });
                    }
                }
            }
        }
        Ok(())
    }

    fn capture(&mut self, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        if nx < 2 || ny < 2 {
            return Err(Error::Setting {
                key: "surface",
                value: format!("[{nx}, {ny}]"),
                why: "a surface lattice has at least 2 points along each side".to_owned(),
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
        let mut positions = Vec::with_capacity(nx * ny);
        let mut contact = Vec::with_capacity(nx * ny);
        let patch = self.contacts.patch();
        for (y, j, wy) in &ys {
            for (x, i, wx) in &xs {
                let mut p = [*x, *y, 0.0];
                for (c, p) in p.iter_mut().enumerate() {
                    let plane = &self.u[grid.at(c, top)..][..grid.plane()];
                    for (b, wy) in wy.iter().enumerate() {
                        for (a, wx) in wx.iter().enumerate() {
                            *p += wy * wx * f64::from(plane[(j + b) * cx + i + a]);
                        }
                    }
                }
                positions.push(Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32));
                contact.push(patch.contains(x / grid.size[0] + 0.5, y / grid.size[1] + 0.5));
            }
        }
        let (force, torque) = self.contacts.resultant(&self.pose);
        let stats = SolverStats {
            iterations: self.newton.iterations,
            passes: self.newton.passes,
            passes_per_step: self.newton.passes as f64 / (self.newton.iterations as f64).max(1.0),
            limit_hits: 0,
            particles: grid.points() as u64,
            residual: self.outcome.map_or(0.0, |o| o.residual),
            estimated_error: self.estimated_error(),
            elastic_energy_n_mm: self.outcome.map_or(0.0, |o| o.evaluation.energy),
            base_reaction_n: self.outcome.map_or(0.0, |o| o.base_force),
            contact_area_mm2: patch.area_mm2(),
        };
        self.newton.iterations = 0;
        self.newton.passes = 0;
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

    fn interrupt_by(&mut self, flag: Arc<AtomicBool>) {
        self.newton.interrupt = Interrupt::by(flag);
    }

    fn fork(&self) -> Box<dyn Elastomer> {
        Box::new(Self {
            machine: Arc::clone(&self.machine),
            indenter: Arc::clone(&self.indenter),
            pose: self.pose,
            tolerance: self.tolerance,
            violation_mm: self.violation_mm,
            contacts: self.contacts.clone(),
            u: self.u.clone(),
            last: self.last.clone(),
            at_rest: self.at_rest,
            outcome: self.outcome,
            penetration_mm: self.penetration_mm,
            unsettled: self.unsettled,
            newton: Newton::ended_by(self.newton.interrupt.clone()),
            least_force: self.least_force,
        })
    }
}

/// The way from one pose to another as four numbers, a degree counting as 0.05 mm.
fn way_between(a: &Pose, b: &Pose) -> [f64; 4] {
    [b.x_mm - a.x_mm, b.y_mm - a.y_mm, b.z_mm - a.z_mm, 0.05 * (b.theta_deg - a.theta_deg)]
}

/// How many times `last` goes into `way`, if they point the same way.
fn along(way: &[f64; 4], last: &[f64; 4]) -> Option<f64> {
    let dot = |a: &[f64; 4], b: &[f64; 4]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
    let (ww, ll, wl) = (dot(way, way), dot(last, last), dot(way, last));
    (ll > 0.0 && wl > 0.95 * (ww * ll).sqrt()).then(|| (wl / ll).min(2.0))
}

pub(super) fn check(pad: &Pad, settings: &Settings) -> Result<(), Error> {
    let range = |key, value: f64, min: f64, max: f64, unit: &str| {
        if value.is_finite() && value >= min && value <= max {
            Ok(())
        } else {
            Err(Error::Setting {
                key,
                value: value.to_string(),
                why: format!("choose a value from {min} to {max}{unit}"),
            })
        }
    };
    let m = &pad.material;
    range(
        "youngs_modulus_mpa",
        settings.youngs_modulus_mpa.unwrap_or(m.youngs_modulus_mpa),
        1e-4,
        1e4,
        " MPa",
    )?;
    range("poisson_ratio", settings.poisson_ratio.unwrap_or(m.poisson_ratio), 0.0, 0.499, "")?;
    range("tolerance", settings.tolerance, 5e-4, 0.1, "")?;
    range("size_x_mm", pad.size_x_mm, 1.0, 200.0, " mm")?;
    range("size_y_mm", pad.size_y_mm, 1.0, 200.0, " mm")?;
    range("thickness_mm", pad.thickness_mm, 0.1, 50.0, " mm")?;
    if let Friction::Coefficient(mu) = settings.friction {
        range("friction", mu, 0.0, 10.0, "")?;
    }
    if pad.shape != PadShape::Cuboid {
        return Err(Error::Setting {
            key: "shape",
            value: format!("{:?}", pad.shape),
            why: "flat pads, shape = { kind = \"cuboid\" }: no solver knows others".to_owned(),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
