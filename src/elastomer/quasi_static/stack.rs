//! What the pad is made of, layer of cells by layer of cells: bulk, and a coating where there is one.

use super::grid::Grid;
use crate::elastomer::{Coating, Material};

/// Lame parameters of every layer of cells, from the base up, MPa.
#[derive(Debug, Clone)]
pub struct Stack {
    /// Shear moduli.
    pub mu: Vec<f64>,
    /// First parameters.
    pub lambda: Vec<f64>,
}

impl Stack {
    /// The same everywhere.
    pub fn uniform(grid: &Grid, mu: f64, lambda: f64) -> Self {
        let n = grid.hz.len();
        Self { mu: vec![mu; n], lambda: vec![lambda; n] }
    }

    /// Bulk under a coating; the grid has cells that end where it begins.
    pub fn coated(grid: &Grid, bulk: &Material, coating: Option<&Coating>) -> Self {
        let mut stack = Self::uniform(grid, bulk.mu_mpa(), bulk.lambda_mpa());
        let Some(coating) = coating else { return stack };
        let skin = Material {
            youngs_modulus_mpa: coating.youngs_modulus_mpa,
            poisson_ratio: coating.poisson_ratio,
            ..*bulk
        };
        let mut depth_mm = 0.0;
        for k in (0..grid.hz.len()).rev() {
            if depth_mm + grid.hz[k] / 2.0 > coating.thickness_mm + 1e-9 {
                break;
            }
            depth_mm += grid.hz[k];
            (stack.mu[k], stack.lambda[k]) = (skin.mu_mpa(), skin.lambda_mpa());
        }
        stack
    }

    /// Shear modulus at the face.
    pub fn face_mu(&self) -> f64 {
        self.mu[self.mu.len() - 1]
    }
}
