//! What must hold at every waypoint, and of the work on the way there.

use super::Walk;
use crate::elastomer::ElastomerCapture;

/// Height to which a body that drags the face along lifts it, and lets it sink, over the way dragged: 0.2 and 0.27 are
/// seen with a slab 0.1 mm deep that is dragged 1 mm, with cells of 1.2 and of 0.3 mm.
const DRAG_MOVES: f64 = 0.3;

impl Walk<'_> {
    /// What must hold at any waypoint.
    pub(super) fn judge(&mut self, now: &ElastomerCapture) {
        let (f, stats) = (now.forces, &now.stats);
        let stated = stats.estimated_error.unwrap_or(0.0);
        self.checks.stated_error = Some(self.checks.stated_error.unwrap_or(0.0).max(stated));
        self.claim = self.tolerance.max(stated);
        let (depth, claim, least) = (self.depth_mm(now), self.claim, self.least_force());

        let numbers =
            [f.normal_force_n, f.shear_force_n[0], f.shear_force_n[1], f.torque_n_mm, stats.base_reaction_n];
        let finite = numbers.iter().all(|v| v.is_finite())
            && stats.elastic_energy_n_mm.is_finite()
            && claim.is_finite()
            && now.surface.positions.iter().all(|p| p.is_finite());
        self.checks.hold("finite", if finite { 0.0 } else { f64::NAN }, 1.0);
        if !finite {
            return;
        }
        let normal = f.normal_force_n.abs().max(least);
        self.checks.hold("balance", (stats.base_reaction_n - f.normal_force_n).abs() / normal, 1e-3);
        self.checks.hold("pull, N", -f.normal_force_n, least);
        self.checks.hold("negative energy, N mm", -stats.elastic_energy_n_mm, 0.01 * least);

        // Where the face is. The claim is a root mean square; a single point may be off by more.
        let (mut inside, mut lowest, mut highest) = (0.0f64, 0.0f64, 0.0f64);
        let (mut squares, mut touching) = (0.0, 0u32);
        let nx = now.surface.nx;
        for (n, (p, contact)) in now.surface.positions.iter().zip(&now.contact).enumerate() {
            let p = p.as_dvec3();
            let rest_mm = self.rest_mm(now.surface.rest_xy(n % nx, n / nx));
            let d = -self.body.distance(self.pose.to_indenter(p));
            if *contact || d > 0.0 {
                squares += d.max(0.0).powi(2);
                touching += 1;
            }
            inside = inside.max(d);
            lowest = lowest.max(rest_mm - p.z);
            highest = highest.max(p.z - rest_mm);
        }
        let (mean, most) = (1.5 * claim * depth + 1e-3, 6.0 * claim * depth + 5e-3);
        self.checks.hold("penetration RMS, mm", (squares / f64::from(touching.max(1))).sqrt(), mean);
        self.checks.hold("penetration, mm", inside, most);
        // What drags the face along lifts it in front and lets it sink behind, whatever the depth.
        let dragged = if self.frictionless() { 0.0 } else { DRAG_MOVES * self.dragged_mm };
        self.checks.hold("below the tip, mm", lowest - depth, most + dragged);
        // What is displaced rises beside the contact, within the pad's thickness: as high as the body is deep under what is wider.
        let radius = (stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
        let rise = depth * (radius / (2.0 * self.case.pad.thickness_mm)).max(1.0);
        self.checks.hold("above the pad, mm", highest, rise + most + dragged);
        self.checks.hold("folded", folded(now), 5e-3);
    }

    /// Compares the work since the reset with the energy stored since then.
    pub(super) fn judge_work(&mut self, energy_before: f64) {
        let Some(now) = &self.last else { return };
        let stored = now.stats.elastic_energy_n_mm - energy_before;
        let scale = self.work[1].max(now.stats.elastic_energy_n_mm).max(1e-3 * self.least_force());
        let bound = 0.05 + 0.5 * self.claim;
        self.checks.hold("more stored than worked", (stored - self.work[0]) / scale, bound);
        if self.frictionless() {
            self.checks.hold("dissipation without friction", (self.work[0] - stored).abs() / scale, bound);
        }
    }
}

/// Part of the face's triangles that look downwards.
fn folded(now: &ElastomerCapture) -> f64 {
    let s = &now.surface;
    let at = |i: usize, j: usize| s.positions[j * s.nx + i];
    let mut down = 0;
    for j in 1..s.ny {
        for i in 1..s.nx {
            let (a, b, c, d) = (at(i - 1, j - 1), at(i, j - 1), at(i - 1, j), at(i, j));
            down += usize::from((b - a).cross(c - a).z <= 0.0) + usize::from((c - d).cross(b - d).z <= 0.0);
        }
    }
    down as f64 / (2 * (s.nx - 1) * (s.ny - 1)) as f64
}
