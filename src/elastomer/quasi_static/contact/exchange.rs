//! What the sample points and the indenter exchange: forces and their stiffness.

use super::place::Place;
use super::{Active, Contacts, FEW, Sample};
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

impl Contacts {
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
            stiffness: at.matrix_to_pad(&matrix).map(|v| v * s.area),
            normal: at.to_pad(normal),
        })
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

    /// What a field over the face's control points is at a sample point.
    pub(super) fn value(&self, u: &[f32], cell: [usize; 2], sub: usize) -> DVec3 {
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

    /// Adds what a sample point has to a field over the face's control points.
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
}

fn add_outer(m: &mut [f64; 6], v: DVec3, k: f64) {
    for (m, p) in m.iter_mut().zip([v.x * v.x, v.y * v.y, v.z * v.z, v.x * v.y, v.x * v.z, v.y * v.z]) {
        *m += k * p;
    }
}
