//! The quasi-static elastomer: every waypoint is an equilibrium of the bonded pad.
//!
//! Total-Lagrangian, on quadratic B-splines over a grid that fits the pad ([`grid`]), laid over domes, cylinders and
//! rounded edges by a map ([`chart`]); what it is made of ([`body`], [`stack`]); stresses and tangents from the stored
//! energy ([`law`], [`operator`]); unilateral contact with Coulomb or infinite friction against the indenter's signed
//! distance ([`contact`]); Newton's method with conjugate gradients ([`newton`]), preconditioned by the inverse of the
//! undeformed layer ([`layer`]) with the contact springs added by the Woodbury formula ([`springs`], [`cholesky`]),
//! along a bent face ([`frames`]). Relative rest, which the explicit modes reach by looping, is here the friction law
//! itself.
//!
//! A path is followed in increments ([`level`]), first on coarse grids, whose answers are the guesses of finer ones
//! ([`cascade`], [`bridge`]); what an increment leaves behind is the displacement and, with friction, the anchors of
//! the points that touch; a capture shows the face finer than its splines (`relief`). Nothing is computed before the
//! first touch, and threads stay awake while something is (`wakeful`). An increment that does not converge is halved, and given up with a typed error in the end. What an
//! answer lacks it states ([`level`], [`probe`], [`symmetry`], `fold`, `slip`), and where that is too much, finer cells are tried
//! (`refinement`).

#![allow(
    clippy::needless_range_loop,
    clippy::neg_cmp_op_on_partial_ord,
    reason = "tensor code reads best with indices; a negated comparison is how a NaN is caught"
)]

pub mod body;
pub mod bridge;
pub mod cascade;
pub mod chart;
pub mod cholesky;
mod coated;
mod compliance;
pub mod contact;
mod fields;
mod fold;
pub mod frames;
pub mod grid;
mod increments;
mod judged;
pub mod lanes;
pub mod law;
pub mod layer;
pub mod level;
pub mod mirror;
pub mod modes;
pub mod newton;
pub mod operator;
pub mod probe;
mod refinement;
mod relief;
pub mod resolution;
mod shear;
mod slip;
pub mod springs;
pub mod stack;
pub mod symmetry;
mod transforms;
mod underside;
pub mod waves;

use super::interrupt::Interrupt;
use super::{Elastomer, ElastomerCapture, Error, Pad, PadShape, Settings, Skip};
use crate::indenter::Indenter;
use crate::pose::Pose;
use crate::wakeful::wakeful;
use body::Body;
pub(super) use body::check;
use cascade::{FINEST, Patience, REFINED, Step, follow, rest_at};
use level::{Level, corners};
use refinement::OF_USE;
use relief::Splined;
pub use resolution::Resolution;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use underside::Underside;

/// Likeness of coating and bulk ([`Body::evenness`], squared) below which the relief has nothing to say of forces.
const LEAST_ALIKE: f64 = 0.1;

/// A pad that follows an indenter through equilibria.
///
/// What the tolerance asks for in general ([`Resolution::for_tolerance`]) is tried first. Where an answer states a
/// much larger error than was asked for, or none is found, the way since the pad was last at rest is followed again with
/// finer cells, as often as that promises to help. Once at rest, the pad is as coarse as it began.
/// The answer of a waypoint depends on the way to it alone.
#[derive(Debug)]
pub struct QuasiStaticSolver {
    /// Coarsest first.
    levels: Vec<Step>,
    /// The levels without those that were added since the pad was last at rest, if any were.
    unrefined: Option<Vec<Step>>,
    /// That of the finest level.
    resolution: Resolution,
    /// Stated error that needs no finer cells, relative to depth; absent where the resolution was given.
    wanted: Option<f64>,
    /// The widest of finer cells that have failed since the pad was last at rest, mm, if any have: another try with cells as fine
    /// would begin with the same way.
    vain_mm: Option<f64>,
    /// Where the pad was last at rest, and the waypoints since then.
    path: Vec<Pose>,
    pad: Body,
    indenter: Arc<dyn Indenter>,
    /// From which depth to which its force in relief comes to say nothing, mm.
    force_fades_mm: [f64; 2],
    interrupt: Interrupt,
    /// What is not skipped.
    without: Vec<Skip>,
    /// Newton iterations and tangent applications of levels that are no more.
    spent: [u64; 2],
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
        let size = [pad.size_x_mm, pad.size_y_mm, pad.thickness_mm];
        let underside = Underside::of(indenter.as_ref(), size);
        let resolution = Resolution::for_tolerance(settings.tolerance);
        let resolution =
            resolution.for_underside(&underside, indenter.as_ref(), size).with_skips_of(settings, size);
        let wanted = refinement::wanted(settings.tolerance);
        wakeful(|| Self::build(pad, settings, (resolution, Some(wanted)), indenter, &underside, start))
    }

    /// As [`Self::new`], with the resolution given instead of derived from the tolerance, and kept whatever comes: cells are as given where the
    /// settings have relief or growing cells left out, too.
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
        let underside = Underside::of(indenter.as_ref(), [pad.size_x_mm, pad.size_y_mm, pad.thickness_mm]);
        wakeful(|| Self::build(pad, settings, (resolution, None), indenter, &underside, start))
    }

    fn build(
        pad: &Pad,
        settings: &Settings,
        (resolution, wanted): (Resolution, Option<f64>),
        indenter: Arc<dyn Indenter>,
        underside: &Underside,
        start: &Pose,
    ) -> Result<Self, Error> {
        let pad = Body::new(pad, settings);
        pad.reaches(indenter.as_ref(), start)?;
        let mut levels: Vec<Step> = Vec::new();
        let cascade = resolution.cascade(pad.size_mm);
        for (n, resolution) in cascade.iter().enumerate() {
            let level = pad.level(resolution, *start, n + 1 < cascade.len());
            levels.push(Step::after(&levels, level));
        }
        let mut solver = Self {
            force_fades_mm: relief::force_fades_mm(underside, pad.size_mm[2]),
            levels,
            unrefined: None,
            vain_mm: None,
            resolution,
            wanted,
            path: vec![*start],
            pad,
            indenter,
            interrupt: Interrupt::default(),
            without: settings.without.clone(),
            spent: [0; 2],
        };
        if !solver.finest().is_clear(solver.indenter.as_ref(), start) {
            // Begin above the pad and come down, as an indenter would.
            let above = Pose { z_mm: start.z_mm.max(0.0) + 1e-3, ..*start };
            solver.path = vec![above];
            rest_at(&mut solver.levels, &above);
            solver.go_to(start)?;
        }
        Ok(solver)
    }

    /// The grid that gives the answer.
    fn finest(&self) -> &Level {
        &self.levels[self.levels.len() - 1].level
    }

    /// Follows a straight way with the levels there are.
    fn go(&mut self, pose: &Pose, patience: &Patience) -> Result<(), Error> {
        let indenter = Arc::clone(&self.indenter);
        // Nothing happens before the first touch, so nothing is computed.
        let part = self.finest().idle_part(indenter.as_ref(), pose);
        if part > 0.0 {
            let touch = self.finest().pose().lerp(pose, part);
            if !self.skips(Skip::FirstTouch) {
                follow(&mut self.levels, indenter.as_ref(), &touch, patience)?;
            }
            rest_at(&mut self.levels, &touch);
        }
        follow(&mut self.levels, indenter.as_ref(), pose, patience)
    }

    /// Follows a straight way to `pose`, unless the indenter is there.
    fn go_to(&mut self, pose: &Pose) -> Result<(), Error> {
        match &self.path[..] {
            [.., last] if last == pose && self.finest().pose() == pose => Ok(()),
            [_, _, ..] if !self.skips(Skip::WarmStart) => self.go_from_rest(pose),
            _ => self.go_on(pose),
        }
    }

    /// Follows a straight way on to `pose`, again with finer cells where that is worth while.
    fn go_on(&mut self, pose: &Pose) -> Result<(), Error> {
        self.pad.reaches(self.indenter.as_ref(), pose)?;
        let usual = if self.unrefined.is_some() { &REFINED } else { &FINEST };
        let vain_before_mm = self.vain_mm;
        let mut ended = self.go(pose, usual);
        self.refine(&mut ended, pose)?;
        let fallen_back = self.fall_back(&mut ended, pose)?;
        self.try_between(&ended, pose, fallen_back)?;
        if let (Err(Error::NotConverged { advice, .. }), Some(doubt)) = (&mut ended, self.pad.doubt()) {
            *advice = format!("{doubt}; or, {advice}");
        }
        ended?;
        let resolved = self.resolved(pose);
        match &resolved {
            Ok(()) => self.arrive(pose),
            Err(error) if error.goes_on() => {
                self.arrive(pose);
                self.vain_mm = vain_before_mm;
            }
            Err(_) => (),
        }
        resolved
    }

    /// Goes the whole way since the pad was at rest again, and on to `pose`. Waypoints on straight parts of it are passed by.
    fn go_from_rest(&mut self, pose: &Pose) -> Result<(), Error> {
        self.pad.reaches(self.indenter.as_ref(), pose)?;
        let way = corners(self.path.iter().chain([pose]));
        rest_at(&mut self.levels, &way[0]);
        self.arrive(&way[0]);
        for corner in &way[1..way.len() - 1] {
            match self.go_on(corner) {
                Err(error) if !error.goes_on() => return Err(error),
                _ => (),
            }
        }
        self.go_on(pose)
    }

    fn skips(&self, skip: Skip) -> bool {
        !self.without.contains(&skip)
    }

    /// How much the pressure of a face in relief tells that the splines' does not, from 0 to 1: the less, the less coating and bulk
    /// are alike. Under skins of 0.1 to 0.5 mm, five times as stiff and as soft as the pad, sphere, cylinder, dots and cone 0.3 and
    /// 0.8 mm deep have forces in relief that are 2.4 % too small to 0.4 % too large (stiff; the cone 3.3 % too small), and up to 9 %
    /// too small (soft), for the layers of the relief are linear ones; the splines' mostly are within 1.3 %.
    fn trust_in_relief(&self) -> f64 {
        if !self.skips(Skip::Relief) {
            return 0.0;
        }
        let alike = self.pad.evenness().powi(2);
        if alike < LEAST_ALIKE { 0.0 } else { alike * self.finest().trust_in_relief(self.indenter.as_ref()) }
    }

    /// What the finest level has to tell, the face in finer relief than its splines have.
    fn face(&self, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        let (level, indenter) = (self.finest(), self.indenter.as_ref());
        let (grid, size) = (level.grid(), self.pad.size_mm);
        let cell_mm = [grid.hx, grid.hy];
        let spacing = [size[0] / nx.saturating_sub(1) as f64, size[1] / ny.saturating_sub(1) as f64];
        let Some(times) = relief::finer(spacing, cell_mm).filter(|_| self.skips(Skip::Relief)) else {
            return level.capture(indenter, nx, ny);
        };
        let trust = self.trust_in_relief();
        let grip = level.grip().filter(|_| trust > 0.0);
        let [mx, my] = grip.as_ref().map_or(times, |grip| relief::finer_to_hold(grip, [nx, ny], times));
        let mut capture = level.capture(indenter, mx * (nx - 1) + 1, my * (ny - 1) + 1)?;
        let loads = level.loads();
        let splined = Splined {
            body: &self.pad,
            indenter,
            pose: level.pose(),
            cell_mm,
            pressure: &|x, y| loads.at(x / size[0] + 0.5, y / size[1] + 0.5),
            force_n: capture.forces.normal_force_n,
            grip: grip.as_ref(),
        };
        let shape = self.pad.shape;
        let relief = splined.relieve(&mut capture.surface, &mut capture.contact, |x, y| {
            shape.face_height_mm([size[0], size[1]], [x, y])
        });
        if let Some(relief) = &relief {
            // Counted where it is seen: the splines' patch is 3 % too wide or too narrow where it is four cells across.
            capture.stats.contact_area_mm2 = relief.seen_mm2;
        }
        let in_relief = relief.is_some();
        if let Some(relief) = relief.filter(|_| trust > 0.0) {
            let of_force = trust * relief::left_at(level.depth_mm(indenter), self.force_fades_mm);
            let part = 1.0 + of_force * (relief.force_n / splined.force_n - 1.0);
            let more = trust * level.trust_in_grip();
            capture.forces = capture.forces.times(part);
            for (force_n, borne) in capture.forces.shear_force_n.iter_mut().zip(relief.borne.force_n) {
                *force_n -= more * borne;
            }
            capture.forces.torque_n_mm -= more * relief.borne.torque_n_mm;
            capture.stats.base_reaction_n *= part;
            capture.stats.elastic_energy_n_mm *= part;
            let in_relief = level.error_in_relief(indenter, relief.misfit_mm);
            let stated = capture.stats.estimated_error.filter(|stated| *stated <= OF_USE);
            if let (Some(stated), Some(in_relief)) = (stated, in_relief) {
                let in_relief = in_relief.max(relief::LEAST_TO_SPLINES * stated);
                capture.stats.estimated_error = Some(stated - trust * (stated - in_relief).max(0.0));
            }
        }
        let picked = |k: usize| my * (k / nx) * (mx * (nx - 1) + 1) + mx * (k % nx);
        capture.surface.positions = (0..nx * ny).map(|k| capture.surface.positions[picked(k)]).collect();
        capture.contact = (0..nx * ny).map(|k| capture.contact[picked(k)]).collect();
        (capture.surface.nx, capture.surface.ny) = (nx, ny);
        // (On a dome edges that run aslant come out with spots.)
        if in_relief && shape == PadShape::Cuboid {
            capture.rim = relief::rim(&capture.surface, &capture.contact, |p| splined.gap(p));
        }
        Ok(capture)
    }
}

impl Elastomer for QuasiStaticSolver {
    fn advance(&mut self, pose: &Pose) -> Result<(), Error> {
        wakeful(|| self.go_to(pose))
    }

    fn capture(&mut self, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        let mut capture = wakeful(|| self.face(nx, ny))?;
        // The coarser grids have worked for this answer, too.
        let mut sums = std::mem::take(&mut self.spent);
        for (sum, n) in sums.iter_mut().zip(take_counters(&mut self.levels)) {
            *sum += n;
        }
        let [iterations, passes] = sums;
        capture.stats.passes_per_step = passes as f64 / (iterations as f64).max(1.0);
        (capture.stats.iterations, capture.stats.passes) = (iterations, passes);
        Ok(capture)
    }

    fn interrupt_by(&mut self, flag: Arc<AtomicBool>) {
        self.interrupt = Interrupt::by(flag);
        for step in self.levels.iter_mut().chain(self.unrefined.iter_mut().flatten()) {
            step.level.newton.interrupt = self.interrupt.clone();
        }
    }

    fn fork(&self) -> Box<dyn Elastomer> {
        Box::new(Self {
            levels: self.levels.iter().map(Step::fork).collect(),
            unrefined: self.unrefined.as_ref().map(|levels| levels.iter().map(Step::fork).collect()),
            vain_mm: self.vain_mm,
            resolution: self.resolution,
            wanted: self.wanted,
            path: self.path.clone(),
            pad: self.pad.clone(),
            indenter: Arc::clone(&self.indenter),
            force_fades_mm: self.force_fades_mm,
            interrupt: self.interrupt.clone(),
            without: self.without.clone(),
            spent: [0; 2],
        })
    }
}

/// Newton iterations and tangent applications since the last call.
fn take_counters(levels: &mut [Step]) -> [u64; 2] {
    let mut sums = [0; 2];
    for Step { level, .. } in levels {
        sums[0] += std::mem::take(&mut level.newton.iterations);
        sums[1] += std::mem::take(&mut level.newton.passes);
    }
    sums
}

#[cfg(test)]
mod tests;
