//! Contact of the face with the indenter: unilateral in the normal, sticking or Coulomb in the tangent.
//!
//! The face carries sample points, `per_axis` squared to a cell. At a point with gap g (the indenter's
//! signed distance) and its cell's multiplier l the pressure is p = max(0, l - k g): an augmented Lagrangian
//! (Simo and Laursen 1992), whose multipliers are brought up to date between solves until each is the mean
//! pressure of its cell. One multiplier to a cell is as many as the face has control points: with one to a
//! sample they fight one another (half of the points under a flat punch carry everything), and with one sample
//! to a cell the face bulges through between the samples of a punch (17 % of a frictionless moon's force).
//!
//! A point that touches gets an anchor on the indenter; the tangential traction is a multiplier and a spring
//! to the anchor, capped at the friction bound, which is held fixed during a solve and brought up to date
//! between solves, so that every solve minimises a potential. Anchors are dropped on separation, after a
//! solve and never inside it; and a point that is deep in the indenter is pushed out by one plane for a whole
//! solve ([`side`]), because the nearest side of a body changes from place to place by a jump.
//!
//! What sticks holds for a while ([`Contacts::set_torn`]). A neo-Hookean face that is sheared ever further folds ahead of the contact
//! (Biot's surface instability), finer than any grid can follow, and where it holds goes by rounding. So a contact that has been
//! dragged far tears loose, and then slides as rubber does.

mod exchange;
mod friction;
mod grip;
mod patch;
mod place;
mod reach;
mod side;
mod told;

use self::friction::{Anchor, FrictionLaw, SLIP_SOFTNESS, STICK_SOFTNESS};
pub use self::grip::Grip;
pub use self::patch::Loads;
use self::place::Place;
use self::reach::{Lattice, Window};
use self::side::{Entry, Side};
use super::chart::Chart;
use super::grid::{Grid, uniform_values};
use crate::elastomer::Friction;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// A sample point of the face.
#[derive(Debug, Clone)]
struct Sample {
    cell: [usize; 2],
    sub: usize,
    /// Rest position.
    rest: DVec3,
    /// Area, mm^2.
    area: f64,
    /// Normal multiplier of its cell, MPa.
    multiplier: f64,
    /// Whether it carried pressure at the last update.
    loaded: bool,
    anchor: Option<Anchor>,
    /// Let go in this increment: the point stays without anchor until the increment ends, or it could
    /// hold and slip in turn for ever.
    let_go: bool,
    /// Gap and position in the indenter's frame at the last evaluation, and the pressure there.
    gap: f64,
    seen: DVec3,
    pressure: f64,
    /// Displacement at the end of the last increment.
    old_u: DVec3,
    /// What pushes it out instead of what is nearest at the time.
    pushed_by: Option<Side>,
    /// Where the present increment takes the point into the indenter, were the pad to stand still.
    entry: Option<Entry>,
}

/// A sample that exchanges force, linearised.
#[derive(Debug, Clone)]
pub struct Active {
    /// Index of its cell.
    pub cell: [usize; 2],
    sub: usize,
    /// Force on the pad, N.
    force: DVec3,
    /// Where it acts.
    position: DVec3,
    /// Minus the derivative of the force, N/mm: xx, yy, zz, xy, xz, yz.
    pub stiffness: [f64; 6],
    /// Outward normal of the indenter.
    pub normal: DVec3,
}

/// Points that are not worth another thread.
const FEW: usize = 128;

/// The sample points that the indenter can reach, and their present state.
#[derive(Debug, Clone)]
pub struct Contacts {
    lattice: Lattice,
    /// The cells whose points are kept, and those, cell by cell.
    window: Window,
    samples: Vec<Sample>,
    active: Vec<Active>,
    /// Trace weights of the sub-samples along one axis.
    weights: Vec<[f64; 3]>,
    /// Penalty, MPa/mm.
    stiffness: f64,
    /// Tangential penalty, MPa/mm.
    tangential: f64,
    law: FrictionLaw,
    /// Whether what touches without friction has anchors, too.
    anchored: bool,
    /// Points that carried pressure pull as well as push, and no others act: for predictions.
    bilateral: bool,
    /// When the last point that touched in this press would have met the indenter, had the pad stood still, as a
    /// part of the way; 1 on a slide.
    latest: f64,
    plane: usize,
    cx: usize,
    face: [usize; 3],
}

impl Contacts {
    /// A face that nothing touches, which `chart` bends, if anything does.
    pub fn new(
        grid: &Grid,
        chart: Option<Chart>,
        per_axis: usize,
        stiffness: f64,
        friction: Friction,
        shear_modulus_mpa: f64,
    ) -> Self {
        let lattice = Lattice::new(grid, chart, per_axis);
        let top = grid.layers() - 1;
        Self {
            window: Window::default(),
            samples: Vec::new(),
            active: Vec::new(),
            weights: (0..per_axis).map(|s| uniform_values(lattice.offset(s))).collect(),
            lattice,
            stiffness,
            tangential: stiffness
                * if friction == Friction::Infinite { STICK_SOFTNESS } else { SLIP_SOFTNESS },
            law: FrictionLaw::new(friction, shear_modulus_mpa),
            anchored: false,
            bilateral: false,
            latest: 0.0,
            plane: grid.plane(),
            cx: grid.cx(),
            face: [grid.at(0, top), grid.at(1, top), grid.at(2, top)],
        }
    }

    /// Where on its way from one pose to another the indenter first meets the face at rest, as a part of the
    /// way; 1 when it does not.
    pub fn first_touch(&self, indenter: &dyn Indenter, from: &Pose, to: &Pose) -> f64 {
        let way = from.distance_mm(to);
        let mut fraction = 0.0;
        // Sphere tracing, as far as a turn leaves the distance valid.
        for _ in 0..64 {
            let gap = self.least_gap(indenter, &from.lerp(to, fraction));
            if gap < 1e-3 || way == 0.0 || fraction >= 1.0 {
                break;
            }
            fraction = (fraction + gap / way).min(1.0);
        }
        fraction
    }

    /// Points that exchange force.
    pub fn active(&self) -> &[Active] {
        &self.active
    }

    /// Whether there is friction.
    pub fn has_friction(&self) -> bool {
        self.law.friction != Friction::Coefficient(0.0)
    }

    /// Whether friction is infinite: what touches holds until it tears loose.
    pub fn sticks(&self) -> bool {
        self.law.friction == Friction::Infinite
    }

    /// Least gap of the face at rest, mm; infinite when the indenter is far away.
    pub fn least_gap(&self, indenter: &dyn Indenter, pose: &Pose) -> f64 {
        let [hx, hy] = indenter.half_extent_mm();
        let mut least = f64::INFINITY;
        for rest in self.lattice.under(indenter, pose) {
            let p = pose.to_indenter(rest);
            if p.x.abs() <= hx && p.y.abs() <= hy && p.z >= -least.min(1e9) {
                least = least.min(indenter.distance(p));
            }
        }
        least
    }

    /// Whether what touches without friction has anchors all the same, which bear nothing.
    pub fn set_anchored(&mut self, anchored: bool) {
        self.anchored = anchored;
    }

    /// Whether points that carried pressure pull as well as push, and no others act.
    pub fn set_bilateral(&mut self, bilateral: bool) {
        self.bilateral = bilateral;
    }

    /// Chooses anew by what side each deep point is pushed out. During a solve that stays: where the force of a point
    /// jumps from one side to another, no step finds its zero.
    pub fn choose_sides(&mut self, indenter: &dyn Indenter, pose: &Pose, u: &[f32]) {
        let mut samples = std::mem::take(&mut self.samples);
        let at = Place::of(indenter, pose);
        // (An anchor that bears nothing remembers no side, either.)
        let rubs = self.has_friction();
        samples.par_iter_mut().with_min_len(FEW).for_each(|s| {
            if s.entry.is_some() || (rubs && s.anchor.is_some()) {
                let p = at.in_indenter(s.rest + self.value(u, s.cell, s.sub));
                s.pushed_by = s.side_out(indenter, p);
            }
        });
        self.samples = samples;
    }

    /// Begins an increment from one pose to another: finds where free points would meet the indenter.
    pub fn begin_increment(&mut self, indenter: &dyn Indenter, from: &Pose, to: &Pose, u: &[f32]) {
        let [hx, hy] = indenter.half_extent_mm();
        let along = (to.x_mm - from.x_mm).hypot(to.y_mm - from.y_mm);
        self.latest = if from.z_mm - to.z_mm > along { 0.0 } else { 1.0 };
        self.keep_within_reach(indenter, [from, to], u);
        let rubs = self.has_friction();
        let mut samples = std::mem::take(&mut self.samples);
        for s in &mut samples {
            s.old_u = self.value(u, s.cell, s.sub);
            s.entry = None;
            s.let_go = false;
            s.pushed_by = None;
            let p = s.rest + s.old_u;
            let end = to.to_indenter(p);
            if (rubs && s.anchor.is_some()) || end.z < 0.0 || end.x.abs() > hx || end.y.abs() > hy {
                continue;
            }
            if indenter.distance(end) >= 0.0 {
                continue;
            }
            // Sphere tracing: no point moves further than the way plus its arc.
            let turn = (to.theta_deg - from.theta_deg).abs().to_radians();
            let arm = (p.x - from.x_mm).hypot(p.y - from.y_mm) + from.distance_mm(to);
            let way = from.distance_mm(to) + turn * arm;
            let mut fraction = 0.0;
            for _ in 0..64 {
                let q = from.lerp(to, fraction).to_indenter(p);
                let (gap, side) = Side::nearest(indenter, q);
                if gap < 1e-3 || fraction >= 1.0 {
                    s.entry = Some(Entry { fraction, side });
                    break;
                }
                fraction = (fraction + gap / way).min(1.0);
            }
        }
        self.samples = samples;
    }

    /// Forgets all contact.
    pub fn clear(&mut self) {
        self.active.clear();
        self.samples.clear();
        self.window = Window::default();
    }
}
