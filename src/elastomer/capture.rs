//! What a simulation hands over at a capture.

use super::Error;
use glam::Vec3;
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
    /// Area in contact, mm^2.
    pub contact_area_mm2: f64,
    /// With infinite friction in the quasi-static mode, how much of its grip the contact is sure to have kept: 1 up to a way along the
    /// face of twice the depth; further on that over the way, since points peel off and take hold again as rounding decides; 0 once it
    /// has torn loose.
    pub held: Option<f64>,
}

/// Everything at one capture.
#[derive(Debug, Clone, PartialEq)]
pub struct ElastomerCapture {
    /// Displaced surface.
    pub surface: Surface,
    /// Contact mask on the same lattice.
    pub contact: Vec<bool>,
    /// Forces on the indenter.
    pub forces: ContactForces,
    /// The solver's account.
    pub stats: SolverStats,
}
