//! The elastomer: how the pad deforms under the indenter.
//!
//! A pad is bonded to a rigid backing, an indenter is a rigid body given by its signed distance,
//! and a simulation follows a path of indenter poses. What comes out at a capture is the displaced
//! surface, the force on the indenter, and what the solver can say about its own error.
//!
//! Two solvers stand behind one contract ([`Elastomer`]): the paper's explicit material point
//! method with or without its relative-rest loop ([`Mode::Mpm`], [`Mode::Impm`]), and a quasi-static
//! solver whose waypoints are equilibria ([`Mode::QuasiStatic`]). What neither does where a scene does not need it is named in
//! [`skips`]. Lengths are mm, forces N, stress MPa; the frame is the pad frame of [`crate::pose`]. This module never knows
//! optics, files or the rig.

pub mod capture;
mod interrupt;
pub mod material;
pub mod mpm;
pub mod pad;
pub mod quasi_static;
pub mod settings;
pub mod skips;

pub use capture::{ContactForces, ElastomerCapture, RimPoint, SolverStats, Surface};
pub use material::{Law, Material};
pub use mpm::ExplicitSolver;
pub use pad::{Coating, Pad, PadShape};
pub use quasi_static::QuasiStaticSolver;
pub use settings::{Friction, Mode, Settings};
pub use skips::Skip;

use crate::indenter::Indenter;
use crate::pose::Pose;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A pad at rest with the indenter at `start`, solved as the settings say.
///
/// # Errors
/// When a setting makes no sense together with the pad.
pub fn solver(
    pad: &Pad,
    settings: &Settings,
    indenter: Arc<dyn Indenter>,
    start: &Pose,
) -> Result<Box<dyn Elastomer>, Error> {
    match settings.mode {
        Mode::QuasiStatic => Ok(Box::new(QuasiStaticSolver::new(pad, settings, indenter, start)?)),
        Mode::Mpm | Mode::Impm => Ok(Box::new(ExplicitSolver::new(pad, settings, indenter, start)?)),
    }
}

/// Whether a pad can be solved as the settings say, without solving anything.
///
/// # Errors
/// What [`solver`] would say about the settings.
pub fn check(pad: &Pad, settings: &Settings) -> Result<(), Error> {
    match settings.mode {
        Mode::QuasiStatic => quasi_static::check(pad, settings),
        Mode::Mpm | Mode::Impm => mpm::scheme::Scheme::new(pad, settings).map(drop),
    }
}

/// Farthest that an indenter may be from the pad's middle, mm, and degrees that it may be turned.
const FARTHEST: f64 = 1000.0;

/// Refuses a pose that no indenter, or not this one, can be brought to over a face `face_mm` above the pad's middle.
fn pose_can_be_reached(
    indenter: &dyn Indenter,
    pose: &Pose,
    face_mm: f64,
    thickness_mm: f64,
) -> Result<(), Error> {
    let at = [pose.x_mm, pose.y_mm, pose.z_mm, pose.theta_deg];
    // NaN is in no range.
    let is_near = at.iter().all(|c| c.abs() <= FARTHEST);
    // The backing has the face's shape.
    let thickness_mm = thickness_mm - face_mm;
    if is_near && pose.depth_mm() < thickness_mm {
        let (depth_mm, height_mm) = (pose.depth_mm() + face_mm, indenter.height_mm());
        return match depth_mm < height_mm {
            true => Ok(()),
            false => Err(Error::Low { indenter: indenter.name().to_owned(), height_mm, depth_mm }),
        };
    }
    Err(Error::Pose { pose: *pose, farthest: FARTHEST, thickness_mm })
}

/// A deforming pad that follows one indenter.
pub trait Elastomer: Send {
    /// Moves the indenter in a straight line (and a linear turn) to `pose` and lets the pad follow.
    ///
    /// # Errors
    /// A typed error when the step cannot be solved; the state is then unusable, unless the error tells that the way
    /// [`goes_on`](Error::goes_on).
    fn advance(&mut self, pose: &Pose) -> Result<(), Error>;

    /// The state at the present pose: surface sampled on an `nx` by `ny` lattice, forces, statistics.
    fn capture(&mut self, nx: usize, ny: usize) -> Result<ElastomerCapture, Error>;

    /// A copy of the present state, so that paths with a common beginning share it.
    fn fork(&self) -> Box<dyn Elastomer>;

    /// From now on [`advance`](Self::advance) ends with [`Error::Interrupted`] soon after the flag is set.
    /// Copies inherit it.
    fn interrupt_by(&mut self, flag: Arc<AtomicBool>);
}

/// Why a pad could not be simulated. Every message says what to change.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Somebody asked for the end.
    #[error("interrupted on the way to a waypoint")]
    Interrupted,
    /// The relative-rest loop or the explicit step blew up.
    #[error(
        "the {mode} step diverged at step {step} (t = {time_s:.6} s, particle {particle}): {what}; lower elastomer.dt_s, raise elastomer.rest_threshold, or use elastomer.mode = \"quasi_static\""
    )]
    Diverged {
        /// `mpm` or `impm`.
        mode: &'static str,
        /// Step number, from 0.
        step: u64,
        /// Simulated time, s.
        time_s: f64,
        /// Index of the first offending particle.
        particle: usize,
        /// What was seen.
        what: String,
    },
    /// The strain that an explicit mode's particles carry is no longer that of their positions.
    #[error(
        "at step {step} (t = {time_s:.6} s) of {mode} the strain that the particles carry leaves {:.0} % of the pad's deformation unexplained, at most {:.0} % can be used: it drifts a little in every step; take fewer steps (raise elastomer.speed_mm_s or elastomer.dt_s, or choose a shorter path), raise elastomer.particles, or use elastomer.mode = \"quasi_static\"", 100.0 * unexplained, 100.0 * allowed
    )]
    Drifted {
        /// `mpm` or `impm`.
        mode: &'static str,
        /// Step number, from 0.
        step: u64,
        /// Simulated time, s.
        time_s: f64,
        /// Part of the deformation's sum of squares that the strain does not explain.
        unexplained: f64,
        /// Largest that is accepted.
        allowed: f64,
    },
    /// The indenter of an explicit mode has gone through the pad's face.
    #[error(
        "at pose ({pose}) the face of the pad lies {inside_mm:.3} mm inside the indenter; {mode} tells bodies apart by one grid cell, {cell_mm:.3} mm; raise elastomer.particles for a finer grid, lower elastomer.speed_mm_s or elastomer.dt_s, round the indenter's edges, press less deep, or use elastomer.mode = \"quasi_static\""
    )]
    PassedThrough {
        /// `mpm` or `impm`.
        mode: &'static str,
        /// Where the indenter was.
        pose: Pose,
        /// How deep the face lies in it, mm.
        inside_mm: f64,
        /// Grid cell, the largest that is accepted, mm.
        cell_mm: f64,
    },
    /// A waypoint has no equilibrium that the solver could find.
    #[error(
        "no equilibrium found at pose ({pose}): residual {residual:.3e} after {iterations} iterations and {restarts} restarts; {advice}"
    )]
    NotConverged {
        /// Where the indenter was.
        pose: Pose,
        /// Relative residual reached.
        residual: f64,
        /// Newton iterations spent.
        iterations: u32,
        /// How often the waypoint was refined and tried again.
        restarts: u32,
        /// What to change.
        advice: String,
    },
    /// An equilibrium that says nothing: too much of the body falls between the cells.
    #[error(
        "cells of {cell_mm:.3} mm do not resolve the contact at pose ({pose}), and finer ones found no equilibrium or were too many: stated error {:.0} % of the depth, at most {:.0} % can be used; lower elastomer.tolerance, round the indenter's edges, or choose another depth{}", 100.0 * stated, 100.0 * allowed, approach.advice()
    )]
    Unresolved {
        /// Where the indenter was.
        pose: Pose,
        /// Stated error, relative to depth.
        stated: f64,
        /// Largest that is accepted.
        allowed: f64,
        /// Cell size, mm.
        cell_mm: f64,
        /// How it came there.
        approach: Approach,
    },
    /// The contact leaves the region in which the pad is simulated.
    #[error(
        "the contact comes within {distance_mm:.3} mm of the pad's edge at pose ({pose}); keep it at least {allowed_mm} mm inside, or choose a smaller indenter or a larger pad"
    )]
    OffPad {
        /// Where the indenter was.
        pose: Pose,
        /// Distance of the contact from the edge, mm.
        distance_mm: f64,
        /// Smallest allowed distance, mm.
        allowed_mm: f64,
    },
    /// An indenter cannot be there.
    #[error(
        "no indenter can be at ({pose}): each coordinate lies within {farthest} mm or degrees, and the depth of a press below the pad's thickness of {thickness_mm} mm; correct the plan"
    )]
    Pose {
        /// The pose.
        pose: Pose,
        /// Bound of each coordinate.
        farthest: f64,
        /// Bound of the depth.
        thickness_mm: f64,
    },
    /// The whole indenter would be in the pad.
    #[error(
        "indenter {indenter} is {height_mm:.3} mm high and would be pressed {depth_mm:.3} mm deep, so that the face would close above it; press less deep than it is high, or make it higher (height_mm in its file, or the mesh)"
    )]
    Low {
        /// Its name.
        indenter: String,
        /// Its height, mm.
        height_mm: f64,
        /// Depth below the face, mm.
        depth_mm: f64,
    },
    /// A setting makes no sense together with the others.
    #[error("{key} = {value}; allowed: {allowed}; {next}")]
    Setting {
        /// Dotted key: of a rig file below `elastomer`, of a sensor file below `pad`.
        key: &'static str,
        /// The offending value.
        value: String,
        /// What would be accepted.
        allowed: String,
        /// What to do about it.
        next: String,
    },
}

impl Error {
    /// Whether it concerns one waypoint alone: a press that cells do not resolve yet may be resolved deeper, and is there what it
    /// would be had nobody asked before.
    pub fn goes_on(&self) -> bool {
        matches!(self, Error::Unresolved { approach: Approach::StraightDown, .. })
    }
}

/// How an indenter came to where its contact is not resolved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Approach {
    /// Straight down since the pad was at rest.
    StraightDown,
    /// Along the face, and with friction.
    AlongWithFriction,
    /// Along the face, and without.
    AlongWithoutFriction,
}

impl Approach {
    fn advice(self) -> &'static str {
        match self {
            Approach::StraightDown => "; deeper captures of this press are tried nevertheless",
            Approach::AlongWithFriction => {
                "; what ends on a drag goes further with a lower elastomer.friction, or over the wider cells of a larger elastomer.tolerance"
            }
            Approach::AlongWithoutFriction => {
                "; where a slide without friction catches on edges, set elastomer.friction above 0"
            }
        }
    }
}
