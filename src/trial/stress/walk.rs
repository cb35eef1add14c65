//! A case of the quasi-static mode, followed and judged.
//!
//! At every waypoint, whatever the pad: numbers are finite; base and contact balance within 1 %; the face is not inside
//! the indenter, not below the tip, not folded; nothing pulls. On the way: the work that the indenter does is not less
//! than what the pad stores (and equal to it without friction), a slide and a turn are resisted, Coulomb's force is not
//! exceeded. At the end the released face is flat. The families add what they are about.
//!
//! Bounds grow with the *claim*: the error that the solver states, or its tolerance where that is larger.

mod cycles;
mod finer;
mod judge;
mod layer;
mod mirror;
mod path;
mod repeat;
mod slide;
mod symmetry;

use super::cases::{Case, Family};
use super::checks::Checks;
use crate::elastomer::{self, Elastomer, ElastomerCapture, Error, Friction, PadShape};
use crate::indenter::Indenter;
use crate::pose::Pose;
use cycles::cycles;
use finer::finer;
use glam::DVec3;
use layer::layer;
use mirror::mirror;
use path::path;
use repeat::repeat;
use std::sync::Arc;

/// Height above the pad's highest place at which a path begins and ends, mm.
const CLEAR_MM: f64 = 0.3;
/// Elastic force of a square millimetre at a strain of a thousandth, per MPa: forces below this are noise, N.
const LEAST_FORCE_PER_MPA: f64 = 1e-3;

/// Follows a case and judges every waypoint.
///
/// # Errors
/// What the solver answers.
pub fn follow(case: &Case, checks: &mut Checks) -> Result<(), Error> {
    follow_as(case, checks, |_| {})
}

/// As [`follow`], with every capture altered before it is judged: how the checks themselves are tested.
///
/// # Errors
/// As [`follow`].
pub fn follow_as(
    case: &Case,
    checks: &mut Checks,
    alter: impl Fn(&mut ElastomerCapture),
) -> Result<(), Error> {
    let mut walk = Walk::new(case, case.settings.tolerance, checks, &alter)?;
    match case.family {
        Family::Layer => layer(&mut walk),
        Family::Finer => finer(&mut walk, &alter),
        Family::Mirror => mirror(&mut walk),
        Family::Repeat => repeat(case, checks),
        Family::Cycles => cycles(&mut walk),
        _ => path(&mut walk),
    }
}

/// A solver on its way, with the checks that every waypoint goes through.
struct Walk<'a> {
    case: &'a Case,
    body: Arc<dyn Indenter>,
    solver: Box<dyn Elastomer>,
    pose: Pose,
    last: Option<ElastomerCapture>,
    /// Work of the indenter since the first waypoint that was counted, and the sum of its absolute values, N mm.
    work: [f64; 2],
    tolerance: f64,
    claim: f64,
    /// Way along the face that the outermost point of the body has gone in contact, mm.
    dragged_mm: f64,
    checks: &'a mut Checks,
    alter: &'a dyn Fn(&mut ElastomerCapture),
}

impl<'a> Walk<'a> {
    fn new(
        case: &'a Case,
        tolerance: f64,
        checks: &'a mut Checks,
        alter: &'a dyn Fn(&mut ElastomerCapture),
    ) -> Result<Self, Error> {
        let body = case.indenter();
        let pose = Pose::new(case.at_mm[0], case.at_mm[1], CLEAR_MM, case.askew_deg);
        let settings = elastomer::Settings { tolerance, ..case.settings.clone() };
        let solver = elastomer::solver(&case.pad, &settings, body.clone(), &pose)?;
        Ok(Self {
            case,
            body,
            solver,
            pose,
            last: None,
            work: [0.0; 2],
            tolerance,
            claim: tolerance,
            dragged_mm: 0.0,
            checks,
            alter,
        })
    }

    /// The tip this much above the face.
    fn at(&self, above_mm: f64) -> Pose {
        Pose { z_mm: self.rest_mm([self.pose.x_mm, self.pose.y_mm]) + above_mm, ..self.pose }
    }

    /// Height of the untouched face, mm.
    fn rest_mm(&self, at: [f64; 2]) -> f64 {
        let pad = &self.case.pad;
        pad.shape.face_height_mm([pad.size_x_mm, pad.size_y_mm], at)
    }

    /// How far the indenter reaches below the untouched face, mm.
    fn depth_mm(&self, now: &ElastomerCapture) -> f64 {
        if self.case.pad.shape == PadShape::Cuboid {
            return self.pose.depth_mm();
        }
        let s = &now.surface;
        let lattice = (0..s.ny).flat_map(|j| (0..s.nx).map(move |i| (i, j)));
        let inside = lattice.map(|(i, j)| {
            let [x, y] = s.rest_xy(i, j);
            let p = self.pose.to_indenter(DVec3::new(x, y, self.rest_mm([x, y])));
            self.body.lower_surface(p.x, p.y).map_or(0.0, |lower| p.z - lower)
        });
        inside.fold(0.0, f64::max)
    }

    fn frictionless(&self) -> bool {
        self.case.settings.friction == Friction::Coefficient(0.0)
    }

    /// Distance of the body's outermost points from its axis, mm.
    fn reach_mm(&self) -> f64 {
        let [hx, hy] = self.body.half_extent_mm();
        hx.max(hy)
    }

    /// Forces below this are noise, N.
    fn least_force(&self) -> f64 {
        LEAST_FORCE_PER_MPA * self.case.pad.material.youngs_modulus_mpa
    }

    fn go(&mut self, pose: Pose) -> Result<ElastomerCapture, Error> {
        self.solver.advance(&pose)?;
        let mut now = self.solver.capture(self.case.lattice, self.case.lattice)?;
        (self.alter)(&mut now);
        if let Some(before) = &self.last {
            // Forces are the pad's on the indenter, so the indenter's work has the other sign.
            let mean = |f: fn(&ElastomerCapture) -> f64| 0.5 * (f(before) + f(&now));
            let work = -mean(|c| c.forces.shear_force_n[0]) * (pose.x_mm - self.pose.x_mm)
                - mean(|c| c.forces.shear_force_n[1]) * (pose.y_mm - self.pose.y_mm)
                - mean(|c| c.forces.normal_force_n) * (pose.z_mm - self.pose.z_mm)
                - mean(|c| c.forces.torque_n_mm) * (pose.theta_deg - self.pose.theta_deg).to_radians();
            self.work = [self.work[0] + work, self.work[1] + work.abs()];
        }
        let turned = (pose.theta_deg - self.pose.theta_deg).abs().to_radians();
        self.dragged_mm += (pose.x_mm - self.pose.x_mm).hypot(pose.y_mm - self.pose.y_mm);
        self.dragged_mm += turned * self.reach_mm();
        self.pose = pose;
        self.judge(&now);
        self.last = Some(now.clone());
        Ok(now)
    }

    /// Lifts off and looks whether the face is flat again.
    fn release(&mut self) -> Result<(), Error> {
        let now = self.go(Pose { z_mm: CLEAR_MM, ..self.pose })?;
        let s = &now.surface;
        let mut off = 0.0f64;
        for j in 0..s.ny {
            for i in 0..s.nx {
                let [x, y] = s.rest_xy(i, j);
                off = off.max(
                    (s.positions[j * s.nx + i].as_dvec3() - DVec3::new(x, y, self.rest_mm([x, y]))).length(),
                );
            }
        }
        self.checks.hold("off rest when released, mm", off, 1e-3);
        self.checks.hold(
            "force when released, N",
            now.forces.normal_force_n.abs(),
            self.least_force() * 1e-3,
        );
        Ok(())
    }
}
