//! What error an equilibrium states, and how much of it its face in relief and its grip are trusted to tell better.

use super::super::judged::judged_mm2;
use super::super::newton::Outcome;
use super::super::slip::Account;
use super::super::{fold, probe, symmetry};
use super::wear::HELD_OVER_DEPTH;
use super::{LEAST_DEPTH_MM, Level};
use crate::indenter::Indenter;

/// Error of the surface per penetration at the corners of loaded cells. Found by experiment: pressed 0.5 mm, a sphere, a
/// cylinder, a pacman, a hexagon and a moon are 0.35, 1.2, 1.6, 1.4 and 1.8 % off cells of 0.14 mm, the edge of the
/// contact counted in, where this states 0.46, 1.6, 1.9, 2.1 and 2.2 %.
const MISFIT_TO_ERROR: f64 = 1.0;
/// By how much that is more where a contact is all rim, the edge of a knife or the tip of a pin: what happens within a
/// cell is not seen at its corners. Found by experiment: a sharp knife pressed 1 mm over cells of 0.83 mm is far from
/// true (its energy and its force differ by a fifth) where the corners tell of 4 % of the depth.
const NARROW: f64 = 2.0;
/// Part of the depth by which no point of the face may stand inside the body after a drag. A fold of the face may be drawn through a
/// narrow body between the sample points: as a root mean square that is little, and yet the face is none. Found by experiment: of 330
/// cases the face of one that was an answer before stands further inside, a cone 1.6 mm deep, by 0.27 to 0.6 of it.
const PIERCED: f64 = 0.25;
/// Part of what is under the body that it may have passed by. Sharp edges have a rim of it, as wide as a part of a cell.
const MOST_MISSED: f64 = 0.5;
/// What stands less far inside, cells, is brought out by the relief in any case.
const MENDED: f64 = 0.3;
/// Part of the face that may be turned over after a drag or a press too deep for relief: more is no face that heights tell. Found by
/// experiment: of 680 cases that of two is, a socket 1.6 mm deep that is dragged 2 mm, by a hundredth, and a prism that sticks, pressed
/// through three fifths of the pad; sharp walls that plough have a thousandth.
const MOST_FOLDED: f64 = 5e-3;
/// How far what a slip has folded is off, cells. Found by experiment: crescents that slide and turn with friction 0.5 and 0.8 over cells
/// of 0.63 and 0.42 mm have points that are as far off those over cells of 0.31 mm as they state, 1.7 times at most (fixed-corotated),
/// while nothing folds. Where a fold holds a tip these are 11 to 20 % of the depth, heights 2.6 to 4.8, and with this 6 to 16 are stated,
/// without it 4 to 16; dots that slide with friction 1 are 7 to 15 % off and state 10 to 17, without it 10 to 12.
const FOLDED_CELLS: f64 = 1.0;
/// Part of its energy that a face may have lost without friction, and of its normal force with which it may resist a slide. Found by
/// experiment: sharp ridges that turn catch on what bulges between them, resist with a quarter and lose thirteen times what is
/// stored; a cylinder with edges rounded by 0.1 mm that slides 1 mm drags the face along with up to an eighth.
const MOST_CAUGHT: f64 = 0.1;
/// What a face in relief may be off by besides, relative to depth: its lattice ends a contact where its points are, and the layer
/// below it is a linear one. Found by experiment: dots with edges rounded by 0.3 mm stay 0.3 % off over whatever cells.
const RELIEF_ERROR: f64 = 0.0035;
/// Parts of the pad's thickness down to which it answers as an undeformed layer does, and from which on it does not, and part of a
/// contact that may be rim. Found by experiment: a sharp cylinder pressed through more than half of a pad, and needles and knives
/// over cells wider than they are, take forces from their relief that disagree with the stored energy by 8 to 20 %. Between the two
/// the relief has less and less to say: at once, the force of a bar would fall by 3 %.
const TRUSTED_DOWN_TO: [f64; 2] = [0.25, 0.35];
/// See [`TRUSTED_DOWN_TO`].
const MOST_RIM: f64 = 0.9;
/// Error of the surface per friction that was still changing (found by experiment).
const FRICTION_TO_ERROR: f64 = 0.1;
/// Parts of a contact's cells that are not rim with which what the grip bears is not known on the lattice of the relief, and with which
/// it is.
const WITHIN: [f64; 2] = [0.25, 0.5];

impl Level {
    /// Error of the surface relative to depth, estimated from what the splines leave between the sample
    /// points: the penetration found there, the residual, the symmetry that was lost, what has caught on an edge, and what has folded.
    /// Calibrated against finite elements. A body that the sample points have missed altogether is seen by [`probe`].
    pub fn estimated_error(&self, indenter: &dyn Indenter) -> Option<f64> {
        *self.at.stated.get_or_init(|| self.find_error(indenter))
    }

    fn find_error(&self, indenter: &dyn Indenter) -> Option<f64> {
        let depth = self.at.contacts.depth_mm(indenter, &self.at.pose);
        if depth <= 0.0 && self.chart.is_none() {
            return None;
        }
        let grid = self.machine.operator.grid();
        let inside = probe::inside(grid, self.chart.as_ref(), &self.at.u, indenter, &self.at.pose);
        let depth = depth.max(LEAST_DEPTH_MM);
        // A face at rest under a body that stands in it is wrong altogether: how far points are inside of a thin one, its sides being
        // near, does not tell.
        let Some(outcome) = self.at.outcome else {
            return (inside.deepest_mm > 0.0 || inside.missed > 0.0).then_some(1.0);
        };
        // A blade or a pin that grazes a sample point passes by all others.
        if inside.missed > MOST_MISSED || (inside.missed > 0.0 && self.normal_force_n() <= 0.0) {
            return Some(1.0);
        }
        // (What is pressed straight down is brought into shape by its relief, and so is what stands less far inside.)
        let mendable_mm = MENDED * grid.hx.max(grid.hy);
        if !self.straight_down() && inside.deepest_mm > (PIERCED * depth).max(mendable_mm) {
            return Some(1.0);
        }
        let by_splines = !self.straight_down() || depth > TRUSTED_DOWN_TO[1] * grid.size[2];
        if by_splines && self.folded() > MOST_FOLDED {
            return Some(1.0);
        }
        let caught = self.caught();
        if caught > MOST_CAUGHT {
            return Some(1.0);
        }
        let between = self.at.contacts.penetration_between(indenter, &self.at.pose, &self.at.u);
        let misfit = self.narrow() * (MISFIT_TO_ERROR * between + self.at.penetration_mm).max(inside.rms_mm);
        // What the body has passed by is off by half of its way at least, which its distance from the sides of a thin body does not
        // tell. Of what cells resolve there is a hundredth at most.
        let unfolded = misfit / depth + inside.missed + self.unsettled_error(indenter, depth, outcome);
        Some(unfolded.hypot(self.folded_error(depth)).max(caught))
    }

    /// Whether the indenter has gone along the face since rest, and friction lets go where it is overcome. (What sticks does not count,
    /// torn loose or not.)
    pub(in super::super) fn slips(&self) -> bool {
        let contacts = &self.at.contacts;
        !self.straight_down() && contacts.has_friction() && !contacts.sticks()
    }

    /// Which part of a face that slips lies over itself. That may be so over these cells alone.
    pub(in super::super) fn folded_in_a_slip(&self) -> f64 {
        if self.slips() { self.folded() } else { 0.0 }
    }

    fn folded(&self) -> f64 {
        *self.at.folded.get_or_init(|| fold::part(self.grid(), &self.at.u))
    }

    /// What a face that slips is off by where it folds, relative to depth, as a mean. A fold holds a tip that slips by over finer cells:
    /// no further back than it was dragged.
    fn folded_error(&self, depth: f64) -> f64 {
        let grid = self.grid();
        let held_mm = (FOLDED_CELLS * grid.hx.max(grid.hy)).min(self.at.dragged_mm);
        let folded_mm2 = self.folded_in_a_slip() * grid.size[0] * grid.size[1];
        let judged_mm2 = judged_mm2(self.at.contacts.patch().area_mm2());
        held_mm / depth * (folded_mm2 / judged_mm2).sqrt()
    }

    /// How much a face that nothing rubs has caught on what slides or turns over it: the part of its energy that it has lost, or its
    /// resistance over the normal force.
    pub fn caught(&self) -> f64 {
        let glides = !self.straight_down() && !self.at.contacts.has_friction();
        let Some(outcome) = self.at.outcome.filter(|_| glides) else { return 0.0 };
        let lost = self.at.ledger.missing();
        if self.chart.is_some() {
            return lost;
        }
        let now = Account::new(self.at.contacts.resultant(&self.at.pose), outcome);
        lost.max(now.resistance(self.at.contacts.arm_mm(&self.at.pose)))
    }

    /// The same of a face in relief that may be off by `misfit_mm`; nothing where what that is found from does not tell:
    /// after a slide, when friction decides where the face is, on a pad that is not flat, and where nothing touches.
    pub fn error_in_relief(&self, indenter: &dyn Indenter, misfit_mm: f64) -> Option<f64> {
        let outcome = self.at.outcome.filter(|_| self.straight_down() && self.chart.is_none())?;
        let depth = self.at.contacts.depth_mm(indenter, &self.at.pose).max(LEAST_DEPTH_MM);
        let misfit = self.narrow() * misfit_mm / depth;
        Some(RELIEF_ERROR + misfit + self.unsettled_error(indenter, depth, outcome))
    }

    /// How much the pressure of a face in relief tells that the splines' does not, from 0 to 1: all of it of a press so shallow that
    /// the pad still answers as an undeformed layer, and that is not all rim.
    pub fn trust_in_relief(&self, indenter: &dyn Indenter) -> f64 {
        if self.at.contacts.rim_part() > MOST_RIM {
            return 0.0;
        }
        let part = self.at.contacts.depth_mm(indenter, &self.at.pose) / self.grid().size[2];
        ((TRUSTED_DOWN_TO[1] - part) / (TRUSTED_DOWN_TO[1] - TRUSTED_DOWN_TO[0])).clamp(0.0, 1.0)
    }

    /// How much the lattice of the relief has to say about what the grip bears, from 0 to 1: all, unless most of a contact is rim, where
    /// the face without traction is not known. Found by experiment, against cells over which every point holds: with it spheres
    /// (contacts of 1 to 2.3 mm in radius), cylinder, torus, moon, socket and triangle take torques within 3 % that are up to
    /// 7.8 % off by the splines, and a cone, 2.4 cells across, drags 8 % too little if it has all to say.
    pub fn trust_in_grip(&self) -> f64 {
        let within = 1.0 - self.at.contacts.rim_part();
        self.at.contacts.holding() * ((within - WITHIN[0]) / (WITHIN[1] - WITHIN[0])).clamp(0.0, 1.0)
    }

    /// By how much more than elsewhere the face is off where the contact is all rim.
    fn narrow(&self) -> f64 {
        1.0 + NARROW * self.at.contacts.rim_part().powi(4)
    }

    /// What the stopping leaves, relative to depth.
    ///
    /// Sides of a press, and of a slide that nothing rubs, differ where the pad is about to give way, those of what sticks where it tears:
    /// how far that goes is told by the furthest point. In a drag with friction points slip on one side sooner than on the other, far
    /// beyond what that changes of the face: there a mean tells, as of all errors. Found by experiment: crescents whose tips go ahead by
    /// 2 to 5 mm (friction 0.8, cells of 0.63 to 0.31 mm) have points of which one is up to 0.56 mm further along than its image, 0.06 to
    /// 0.1 mm as a mean, and over other cells faces within 3.2 % of the depth in height, 7 to 18 % as points that move along, and normal
    /// forces within 1 %.
    fn unsettled_error(&self, indenter: &dyn Indenter, depth: f64, outcome: Outcome) -> f64 {
        let lost = symmetry::lost(self.grid(), &self.at.u, indenter, self.at.mirrors);
        let askew_mm = if lost.most_mm > 0.0 && self.slips() {
            lost.rms_mm(judged_mm2(self.at.contacts.patch().area_mm2()))
        } else {
            lost.most_mm
        };
        // Each side is wrong by half of what differs between them.
        0.5 * askew_mm / depth + outcome.residual + FRICTION_TO_ERROR * self.at.unsettled
    }

    /// How much of its grip what sticks is sure to have kept.
    pub(super) fn held(&self, indenter: &dyn Indenter) -> f64 {
        let sure_mm = HELD_OVER_DEPTH * self.at.contacts.depth_mm(indenter, &self.at.pose);
        let sure = if self.at.dragged_mm > sure_mm { sure_mm / self.at.dragged_mm } else { 1.0 };
        sure * self.at.contacts.holding()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::{Sphere, pad, settings};
    use super::super::super::{QuasiStaticSolver, Resolution};
    use super::*;
    use crate::elastomer::{Elastomer, Friction, Law};
    use crate::pose::Pose;
    use std::sync::{Arc, OnceLock};

    #[test]
    fn what_folds_in_a_slip_is_stated_and_in_what_sticks_it_is_not() {
        let sphere = Arc::new(Sphere(4.0));
        for friction in [Friction::Coefficient(0.5), Friction::Infinite] {
            let (pad, settings) = (pad(Law::FixedCorotated), settings(friction));
            let start = Pose::new(0.0, 0.0, -0.5, 0.0);
            let resolution = Resolution::for_tolerance(0.05);
            let mut s =
                QuasiStaticSolver::with_resolution(&pad, &settings, resolution, sphere.clone(), &start)
                    .expect("settings are in range");
            s.advance(&Pose { x_mm: 0.5, ..start }).expect("an easy slide");
            let level = &mut s.levels.last_mut().expect("a level").level;
            let smooth = level.estimated_error(sphere.as_ref()).expect("a contact");
            assert_eq!(level.folded(), 0.0);
            // Far from the contact, and alike on both sides of the way, a piece of the face is drawn over its neighbour.
            let grid = level.grid();
            let (at, cx, plane, h) = (grid.at(0, grid.layers() - 1), grid.cx(), grid.plane(), grid.hx);
            for row in [2, plane / cx - 3] {
                level.at.u[at + row * cx + 2] += 2.5 * h as f32;
            }
            (level.at.stated, level.at.folded) = (OnceLock::new(), OnceLock::new());
            let now = level.estimated_error(sphere.as_ref()).expect("a contact");
            let folded = level.folded();
            assert!(folded > 1e-4 && folded < MOST_FOLDED, "{folded}");
            // A cell is more than the way was, which was as far as the sphere is deep.
            let judged_mm2 = judged_mm2(level.at.contacts.patch().area_mm2());
            let moved = (folded * pad.size_x_mm * pad.size_y_mm / judged_mm2).sqrt();
            let expected = if friction == Friction::Infinite { smooth } else { smooth.hypot(moved) };
            assert!((now - expected).abs() < 1e-6, "{friction:?}: {now}, {smooth} without, {moved} moved");
        }
    }
}
