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

mod friction;
mod grip;
mod patch;
mod reach;
mod side;

use self::friction::{Anchor, FrictionLaw, SLIP_SOFTNESS, STICK_SOFTNESS};
pub use self::grip::Grip;
pub use self::patch::Loads;
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

/// An indenter where it is.
struct Place<'a> {
    indenter: &'a dyn Indenter,
    half_extent_mm: [f64; 2],
    pose: &'a Pose,
    sin: f64,
    cos: f64,
}

impl<'a> Place<'a> {
    fn of(indenter: &'a dyn Indenter, pose: &'a Pose) -> Self {
        let (sin, cos) = pose.theta_deg.to_radians().sin_cos();
        Self { indenter, half_extent_mm: indenter.half_extent_mm(), pose, sin, cos }
    }

    /// A point of the pad in the indenter's frame.
    fn in_indenter(&self, p: DVec3) -> DVec3 {
        let (x, y) = (p.x - self.pose.x_mm, p.y - self.pose.y_mm);
        DVec3::new(self.cos * x + self.sin * y, -self.sin * x + self.cos * y, p.z - self.pose.z_mm)
    }

    /// A direction of the indenter's in the pad's frame.
    fn to_pad(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y, v.z)
    }
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

    fn value(&self, u: &[f32], cell: [usize; 2], sub: usize) -> DVec3 {
        let per_axis = self.lattice.per_axis;
        let (wx, wy) = (&self.weights[sub % per_axis], &self.weights[sub / per_axis]);
        let mut out = [0.0; 3];
        for (c, o) in out.iter_mut().enumerate() {
            let plane = &u[self.face[c]..self.face[c] + self.plane];
            for (b, wy) in wy.iter().enumerate() {
                let row = &plane[(cell[1] + b) * self.cx + cell[0]..][..3];
                *o +=
                    wy * (wx[0] * f64::from(row[0]) + wx[1] * f64::from(row[1]) + wx[2] * f64::from(row[2]));
            }
        }
        DVec3::from_array(out)
    }

    fn spread(&self, out: &mut [f32], cell: [usize; 2], sub: usize, v: DVec3) {
        let per_axis = self.lattice.per_axis;
        let (wx, wy) = (&self.weights[sub % per_axis], &self.weights[sub / per_axis]);
        for (c, v) in v.to_array().iter().enumerate() {
            let plane = &mut out[self.face[c]..self.face[c] + self.plane];
            for (b, wy) in wy.iter().enumerate() {
                let row = &mut plane[(cell[1] + b) * self.cx + cell[0]..][..3];
                for (o, wx) in row.iter_mut().zip(wx) {
                    *o += (v * wx * wy) as f32;
                }
            }
        }
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

    /// Evaluates forces and stiffness of every point at displacement `u`.
    pub fn linearise(&mut self, indenter: &dyn Indenter, pose: &Pose, u: &[f32]) {
        self.reach(indenter, pose, u);
        let mut active = std::mem::take(&mut self.active);
        active.clear();
        let mut samples = std::mem::take(&mut self.samples);
        let at = Place::of(indenter, pose);
        let points = samples.par_iter_mut().with_min_len(FEW);
        active.par_extend(points.filter_map(|s| self.linearised(s, &at, u)));
        self.samples = samples;
        self.active = active;
    }

    /// Looks at a point at displacement `u`, and tells what it exchanges, if anything.
    fn linearised(&self, s: &mut Sample, at: &Place<'_>, u: &[f32]) -> Option<Active> {
        let (k, kt) = (self.stiffness, self.tangential);
        let moved = self.value(u, s.cell, s.sub);
        let p = at.in_indenter(s.rest + moved);
        s.seen = p;
        s.pressure = 0.0;
        s.gap = f64::INFINITY;
        // A multiplier acts across a small gap.
        let reach = s.multiplier / k;
        let [hx, hy] = at.half_extent_mm;
        let near = p.z >= -reach && p.x.abs() <= hx + reach && p.y.abs() <= hy + reach;
        let held = s.loaded;
        let known = held || s.anchor.is_some() || s.pushed_by.is_some();
        if (self.bilateral || !near) && !known {
            return None;
        }
        let (gap, normal) = match s.pushed_by {
            Some(side) => (side.gap(p), side.normal),
            None => at.indenter.distance_and_normal(p),
        };
        s.gap = gap;
        s.pressure = s.multiplier - k * gap;
        let pulls = self.bilateral && held;
        if !pulls && (s.pressure <= 0.0 || self.bilateral) {
            s.pressure = 0.0;
        }
        if s.pressure == 0.0 && s.anchor.is_none_or(|a| a.bound == 0.0) {
            return None;
        }
        // Normal part: p n, with stiffness k n n^T.
        let mut force = normal * s.pressure;
        let mut matrix = [0.0; 6];
        if s.pressure != 0.0 {
            add_outer(&mut matrix, normal, k);
        }
        if let Some(anchor) = &s.anchor {
            // Tangential traction, capped: stiffness kt (I - n n^T) while it sticks, else the cap's own.
            let trial = anchor.trial(p, kt);
            let length = trial.length();
            let part = if length >= anchor.bound { anchor.bound / length.max(1e-12) } else { 1.0 };
            force += trial * part;
            for v in [DVec3::X, DVec3::Y, DVec3::Z] {
                add_outer(&mut matrix, anchor.side.along(v), part * kt);
            }
            if part < 1.0 {
                add_outer(&mut matrix, trial / length, -part * kt);
            }
        }
        Some(Active {
            cell: s.cell,
            sub: s.sub,
            force: at.to_pad(force) * s.area,
            position: s.rest + moved,
            stiffness: rotate(&matrix, at.sin, at.cos).map(|v| v * s.area),
            normal: at.to_pad(normal),
        })
    }

    /// Whether points that carried pressure pull as well as push, and no others act.
    pub fn set_bilateral(&mut self, bilateral: bool) {
        self.bilateral = bilateral;
    }

    /// Subtracts the contact forces from a residual.
    pub fn subtract_forces(&self, r: &mut [f32]) {
        for a in &self.active {
            self.spread(r, a.cell, a.sub, -a.force);
        }
    }

    /// Adds the contact stiffness times `d`.
    pub fn apply(&self, d: &[f32], out: &mut [f32]) {
        for a in &self.active {
            let v = self.value(d, a.cell, a.sub);
            let k = &a.stiffness;
            let f = DVec3::new(
                k[0] * v.x + k[3] * v.y + k[4] * v.z,
                k[3] * v.x + k[1] * v.y + k[5] * v.z,
                k[4] * v.x + k[5] * v.y + k[2] * v.z,
            );
            self.spread(out, a.cell, a.sub, f);
        }
    }

    /// Chooses anew by what side each deep point is pushed out. During a solve that stays: where the force of a point
    /// jumps from one side to another, no step finds its zero.
    pub fn choose_sides(&mut self, indenter: &dyn Indenter, pose: &Pose, u: &[f32]) {
        let mut samples = std::mem::take(&mut self.samples);
        let at = Place::of(indenter, pose);
        samples.par_iter_mut().with_min_len(FEW).for_each(|s| {
            if s.entry.is_some() || s.anchor.is_some() {
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
        let mut samples = std::mem::take(&mut self.samples);
        for s in &mut samples {
            s.old_u = self.value(u, s.cell, s.sub);
            s.entry = None;
            s.let_go = false;
            s.pushed_by = None;
            let p = s.rest + s.old_u;
            let end = to.to_indenter(p);
            if s.anchor.is_some() || end.z < 0.0 || end.x.abs() > hx || end.y.abs() > hy {
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

    /// Sum of contact forces on the pad, N, and their torque about z through the pose, N mm.
    pub fn resultant(&self, pose: &Pose) -> (DVec3, f64) {
        let mut force = DVec3::ZERO;
        let mut torque = 0.0;
        for a in &self.active {
            force += a.force;
            torque += (a.position.x - pose.x_mm) * a.force.y - (a.position.y - pose.y_mm) * a.force.x;
        }
        (force, torque)
    }

    /// Distance of what is pressed from the indenter's axis, weighed by the pressure, mm.
    pub fn arm_mm(&self, pose: &Pose) -> f64 {
        let (mut sum, mut force) = (0.0, 0.0);
        for a in &self.active {
            sum += a.force.z.abs() * (a.position.x - pose.x_mm).hypot(a.position.y - pose.y_mm);
            force += a.force.z.abs();
        }
        if force > 0.0 { sum / force } else { 0.0 }
    }

    /// Root mean square of the penetration at the corners of loaded cells, between the sample points, mm.
    pub fn penetration_between(&self, indenter: &dyn Indenter, pose: &Pose, u: &[f32]) -> f64 {
        let (mut sum, mut n) = (0.0, 0);
        let corners = [[1.0, 0.0], [0.0, 1.0]].map(|[a, b]: [f64; 2]| [0.5 * a, 0.5, 0.5 * b]);
        let half = self.lattice.area_mm2.sqrt() * self.lattice.per_axis as f64 / 2.0;
        let count = self.lattice.per_cell();
        for cell in self.samples.chunks(count).filter(|cell| cell.iter().any(|s| s.pressure > 0.0)) {
            let s = &cell[0];
            let middle = cell.iter().map(|s| s.rest).sum::<DVec3>() / count as f64;
            for (x, wx) in corners.iter().enumerate() {
                for (y, wy) in corners.iter().enumerate() {
                    let side = |k: usize| if k == 0 { -half } else { half };
                    let mut p = middle + DVec3::new(side(x), side(y), 0.0);
                    if let Some(chart) = &self.lattice.chart {
                        p.z = chart.height_mm(p.x, p.y);
                    }
                    let mut moved = [0.0; 3];
                    for (c, o) in moved.iter_mut().enumerate() {
                        for b in 0..3 {
                            for a in 0..3 {
                                let at = self.face[c] + (s.cell[1] + b) * self.cx + s.cell[0] + a;
                                *o += wx[a] * wy[b] * f64::from(u[at]);
                            }
                        }
                    }
                    p += DVec3::from_array(moved);
                    sum += indenter.distance(pose.to_indenter(p)).min(0.0).powi(2);
                    n += 1;
                }
            }
        }
        if n == 0 { 0.0 } else { (sum / f64::from(n)).sqrt() }
    }

    /// Part of the loaded cells that lie at the rim of the contact: 1 where it is nowhere wider than two cells.
    pub fn rim_part(&self) -> f64 {
        let cells = self.samples.chunks(self.lattice.per_cell());
        let loaded: Vec<bool> = cells.map(|cell| cell.iter().any(|s| s.pressure > 0.0)).collect();
        let nx = self.window.width();
        let (mut rim, mut all) = (0, 0);
        for n in (0..loaded.len()).filter(|n| loaded[*n]) {
            let within = (1..nx - 1).contains(&(n % nx)) && (nx..loaded.len() - nx).contains(&n);
            let inside = within && [n - 1, n + 1, n - nx, n + nx].iter().all(|n| loaded[*n]);
            rim += usize::from(!inside);
            all += 1;
        }
        if all == 0 { 0.0 } else { rim as f64 / all as f64 }
    }

    /// How far the indenter reaches below the face at rest, mm: on a flat one, the depth of its pose.
    pub fn depth_mm(&self, indenter: &dyn Indenter, pose: &Pose) -> f64 {
        if self.lattice.chart.is_none() {
            return pose.depth_mm();
        }
        let below = |rest: DVec3| {
            let p = pose.to_indenter(rest);
            indenter.lower_surface(p.x, p.y).map_or(0.0, |lower| p.z - lower)
        };
        self.lattice.under(indenter, pose).map(below).fold(0.0, f64::max)
    }

    /// Rest positions of the points that carry pressure.
    pub fn touching_points(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.samples.iter().filter(|s| s.pressure > 0.0).map(|s| s.rest)
    }
}

fn add_outer(m: &mut [f64; 6], v: DVec3, k: f64) {
    for (m, p) in m.iter_mut().zip([v.x * v.x, v.y * v.y, v.z * v.z, v.x * v.y, v.x * v.z, v.y * v.z]) {
        *m += k * p;
    }
}

/// Turns a symmetric matrix about z.
fn rotate(m: &[f64; 6], s: f64, c: f64) -> [f64; 6] {
    let [xx, yy, zz, xy, xz, yz] = *m;
    [
        c * c * xx - 2.0 * c * s * xy + s * s * yy,
        s * s * xx + 2.0 * c * s * xy + c * c * yy,
        zz,
        c * s * (xx - yy) + (c * c - s * s) * xy,
        c * xz - s * yz,
        s * xz + c * yz,
    ]
}
