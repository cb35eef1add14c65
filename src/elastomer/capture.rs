//! What a simulation hands over at a capture.

use super::Error;
use glam::{DVec2, Vec3};
use serde::{Deserialize, Serialize};

/// Displaced positions of a lattice of material points on the contact face.
///
/// Undeformed, point (i, j) lies at x = -Lx/2 + Lx i/(nx-1), y = -Ly/2 + Ly j/(ny-1) on the face,
/// edges included; `positions[j * nx + i]` is where it is now, pad frame, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Points along x.
    pub nx: usize,
    /// Points along y.
    pub ny: usize,
    /// Extent of the pad in x, mm.
    pub size_x_mm: f64,
    /// Extent of the pad in y, mm.
    pub size_y_mm: f64,
    /// Displaced positions, y outer, mm.
    pub positions: Vec<Vec3>,
}

impl Surface {
    /// Refuses a lattice that spans no face.
    ///
    /// # Errors
    /// [`Error::Setting`] with fewer than two points along a side.
    pub fn can_have(nx: usize, ny: usize) -> Result<(), Error> {
        if nx >= 2 && ny >= 2 {
            return Ok(());
        }
        Err(Error::Setting {
            key: "elastomer.surface",
            value: format!("[{nx}, {ny}]"),
            allowed: "at least 2 points along each direction".to_owned(),
            next: "ask for more".to_owned(),
        })
    }

    /// The undeformed x and y of a lattice point, mm.
    pub fn rest_xy(&self, i: usize, j: usize) -> [f64; 2] {
        let along = |n: usize, size: f64, k: usize| -size / 2.0 + size * k as f64 / (n - 1) as f64;
        [along(self.nx, self.size_x_mm, i), along(self.ny, self.size_y_mm, j)]
    }

    /// What part of the face the marked points stand for, as it is seen along z, mm^2.
    pub fn seen_mm2(&self, marked: &[bool]) -> f64 {
        self.parts_seen_mm2(|k| f64::from(u8::from(marked[k])))
    }

    /// The same where only a part, 0 to 1, of what a point stands for counts.
    pub fn parts_seen_mm2(&self, part: impl Fn(usize) -> f64) -> f64 {
        self.sum_mm2(part, |i, j| self.positions[j * self.nx + i].truncate().as_dvec2())
    }

    /// What part of the undeformed face the marked points stand for, mm^2.
    pub fn seen_at_rest_mm2(&self, marked: &[bool]) -> f64 {
        self.sum_mm2(|k| f64::from(u8::from(marked[k])), |i, j| self.rest_xy(i, j).into())
    }

    /// Every corner of a quadrilateral stands for a quarter of it.
    fn sum_mm2(&self, part: impl Fn(usize) -> f64, at: impl Fn(usize, usize) -> DVec2) -> f64 {
        let part = |i: usize, j: usize| part(j * self.nx + i);
        let mut sum = 0.0;
        for j in 1..self.ny {
            for i in 1..self.nx {
                let corners = part(i - 1, j - 1) + part(i, j - 1) + part(i - 1, j) + part(i, j);
                if corners > 0.0 {
                    let diagonals = [at(i, j) - at(i - 1, j - 1), at(i - 1, j) - at(i, j - 1)];
                    // What faces backwards is left out.
                    sum += 0.25 * corners * (0.5 * diagonals[0].perp_dot(diagonals[1])).max(0.0);
                }
            }
        }
        sum
    }
}

/// The pad's action on the indenter, pad frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ContactForces {
    /// Pushes the indenter away when positive, N.
    pub normal_force_n: f64,
    /// Tangential force along x and y, N.
    pub shear_force_n: [f64; 2],
    /// Torque about the indenter's axis, right-handed about z, N mm.
    pub torque_n_mm: f64,
}

impl ContactForces {
    /// All of it, so many times as large.
    pub fn times(self, factor: f64) -> Self {
        Self {
            normal_force_n: factor * self.normal_force_n,
            shear_force_n: self.shear_force_n.map(|f| factor * f),
            torque_n_mm: factor * self.torque_n_mm,
        }
    }
}

/// What the solver says about its own work since the last capture.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SolverStats {
    /// Steps (explicit) or Newton iterations (quasi-static).
    pub iterations: u64,
    /// Passes through P2G + grid + G2P, or tangent applications.
    pub passes: u64,
    /// Mean passes per step of the relative-rest loop.
    pub passes_per_step: f64,
    /// How often the relative-rest loop ran into its limit.
    pub limit_hits: u64,
    /// Particles or quadrature points.
    pub particles: u64,
    /// Relative residual of the equilibrium (quasi-static), or kinetic over elastic energy.
    pub residual: f64,
    /// Estimated error of the surface relative to depth; absent where the mode cannot say.
    pub estimated_error: Option<f64>,
    /// Elastic energy, N mm.
    pub elastic_energy_n_mm: f64,
    /// Force of the base on the pad along z, N.
    pub base_reaction_n: f64,
    /// Area in contact as it is seen along z, mm^2.
    pub contact_area_mm2: f64,
    /// With infinite friction in the quasi-static mode, how much of its grip the contact is sure to have kept: 1 up to a way along the
    /// face of twice the depth; further on that over the way, since points peel off and take hold again as rounding decides; 0 once it
    /// has torn loose.
    pub held: Option<f64>,
}

/// A point beside a sharp edge that presses the face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RimPoint {
    /// Which of the lattice's.
    pub point: usize,
    /// The place of the face at the edge that is nearest to it, mm.
    pub at: Vec3,
}

/// Everything at one capture.
#[derive(Debug, Clone, PartialEq)]
pub struct ElastomerCapture {
    /// Displaced surface.
    pub surface: Surface,
    /// Contact mask on the same lattice.
    pub contact: Vec<bool>,
    /// What is to be drawn at a sharp edge instead of beside it (quasi-static mode, pads with a level face),
    /// by rising index.
    pub rim: Vec<RimPoint>,
    /// Forces on the indenter.
    pub forces: ContactForces,
    /// The solver's account.
    pub stats: SolverStats,
}

impl ElastomerCapture {
    /// Where the points of the face are drawn: those of its rim at the edge.
    pub fn drawn(&self) -> Vec<Vec3> {
        let mut positions = self.surface.positions.clone();
        self.rim.iter().for_each(|rim| positions[rim.point] = rim.at);
        positions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_seen_follows_the_face_and_leaves_out_what_faces_backwards() {
        let face = |x: fn(f64) -> f64| {
            let mut face =
                Surface { nx: 21, ny: 11, size_x_mm: 20.0, size_y_mm: 10.0, positions: Vec::new() };
            face.positions = (0..21 * 11)
                .map(|k| {
                    let [at_x, at_y] = face.rest_xy(k % 21, k / 21);
                    Vec3::new(x(at_x) as f32, at_y as f32, 3.0)
                })
                .collect();
            face
        };
        let (all, middle): (Vec<bool>, Vec<bool>) = (0..21 * 11).map(|k| (true, k % 21 == 10)).unzip();
        let near = |got: f64, truth: f64| assert!((got - truth).abs() < 1e-4, "{got}, {truth}");
        let stretched = face(|x| 1.5 * x);
        near(stretched.seen_mm2(&all), 300.0);
        near(stretched.seen_at_rest_mm2(&all), 200.0);
        near(stretched.seen_mm2(&middle), 15.0);
        near(stretched.seen_at_rest_mm2(&middle), 10.0);
        // From 5 mm on it goes back.
        near(face(|x| x - 2.0 * (x - 5.0).max(0.0)).seen_mm2(&all), 150.0);
    }
}
