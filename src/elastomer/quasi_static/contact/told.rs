//! What a contact tells of itself.

use super::Contacts;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;

impl Contacts {
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

    /// How many points have anchors.
    #[cfg(test)]
    pub fn anchors(&self) -> usize {
        self.samples.iter().filter(|s| s.anchor.is_some()).count()
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

    /// How far from the indenter's axis the furthest point that touches is, mm; 0 where none does.
    pub fn furthest_from_axis_mm(&self) -> f64 {
        let touching = self.samples.iter().filter(|s| s.pressure > 0.0);
        touching.map(|s| s.seen.truncate().length()).fold(0.0, f64::max)
    }
}
