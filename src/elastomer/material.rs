//! Constitutive laws: two Lame parameters and how stress follows from the deformation gradient.

use serde::{Deserialize, Serialize};

/// Which stored energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// P = 2 mu (F - R) + lambda (J - 1) J F^-T.
    FixedCorotated,
    /// P = mu (F - F^-T) + lambda ln J F^-T.
    NeoHookean,
}

/// An isotropic hyperelastic material.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Stored energy.
    pub law: Law,
    /// Young's modulus E, MPa.
    pub youngs_modulus_mpa: f64,
    /// Poisson's ratio nu, 0 to 0.499.
    pub poisson_ratio: f64,
    /// Density, g/mm^3 (the predecessor's unit; only the explicit modes use it).
    pub density_g_mm3: f64,
}

impl Material {
    /// Shear modulus mu = G = E / (2 (1 + nu)), MPa.
    pub fn mu_mpa(&self) -> f64 {
        self.youngs_modulus_mpa / (2.0 * (1.0 + self.poisson_ratio))
    }

    /// First Lame parameter lambda = E nu / ((1 + nu) (1 - 2 nu)), MPa.
    pub fn lambda_mpa(&self) -> f64 {
        self.youngs_modulus_mpa * self.poisson_ratio
            / ((1.0 + self.poisson_ratio) * (1.0 - 2.0 * self.poisson_ratio))
    }
}
