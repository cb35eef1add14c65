//! The numbers of a run: pad and settings turned into grid, step and material in the solver's units.
//!
//! **Units.** Lengths in mm, times in s, masses in g, so stress is in g/(mm s^2) = Pa and force in
//! g mm/s^2 = 1e-6 N. The predecessor's E = 1.45e5 with density 1 is therefore 0.145 MPa and 1 g/mm^3: a
//! thousand times the density of silicone, which slows every wave by sqrt(1000). The compression wave runs
//! at c_p = 742 mm/s and the shear wave at 224 mm/s (`analytic/ANALYTIC.md` section 5); at an indenter
//! speed of 200 mm/s the press is a transient. Static answers do not depend on the density.
//!
//! Inside the kernels lengths are in cells, times in steps and masses in particle masses; the Lame
//! parameters then appear only as 4 dt^2 / (rho dx^2) times themselves.

use super::stress::Moduli;
use crate::elastomer::{Error, Friction, Law, Mode, Pad, PadShape, Settings};

/// Grid spacing and time step of the predecessor at a lattice spacing of 0.1 mm.
const REFERENCE_DX_MM: f64 = 33.0 / 256.0;
const REFERENCE_DT_S: f64 = 1e-4;
const REFERENCE_SPACING_MM: f64 = 0.1;
/// Largest part of the stability limit that the default step may use: the predecessor's own.
const DEFAULT_PART_OF_LIMIT: f64 = 0.935;
/// Largest way of the indenter in one step, cells (ANALYTIC.md section 6).
const MOST_CELLS_PER_STEP: f64 = 0.3;

/// Everything that stays the same during a run.
#[derive(Debug, Clone)]
pub struct Scheme {
    /// Constitutive law.
    pub law: Law,
    /// Lame parameters, Pa.
    pub moduli_pa: Moduli<f64>,
    /// Density, g/mm^3.
    pub density: f64,
    /// Particles along x, y, z.
    pub particles: [usize; 3],
    /// Extent of the pad, mm.
    pub size_mm: [f64; 3],
    /// Spacing of the particle lattice, mm.
    pub spacing_mm: [f64; 3],
    /// Cell width, mm.
    pub dx_mm: f64,
    /// Time step, s.
    pub dt_s: f64,
}

fn refused(
    key: &'static str,
    value: impl std::fmt::Display,
    allowed: impl Into<String>,
    next: impl Into<String>,
) -> Error {
    Error::Setting { key, value: value.to_string(), allowed: allowed.into(), next: next.into() }
}

impl Scheme {
    /// Resolves the settings, or says which one cannot work.
    pub fn new(pad: &Pad, settings: &Settings) -> Result<Self, Error> {
        const STATIC: &str = "set elastomer.mode = \"quasi_static\"";
        if settings.mode == Mode::QuasiStatic {
            return Err(refused(
                "elastomer.mode",
                "quasi_static",
                "mpm or impm",
                "choose one of them: this solver is explicit",
            ));
        }
        if pad.shape != PadShape::Cuboid {
            return Err(refused(
                "pad.shape",
                pad.shape.name(),
                "cuboid in the explicit modes",
                format!("{STATIC}, or choose a sensor with a flat pad"),
            ));
        }
        if let Some(coating) = &pad.coating {
            return Err(refused(
                "pad.coating",
                format!("{} mm of {} MPa", coating.thickness_mm, coating.youngs_modulus_mpa),
                "no coating in the explicit modes, which know one material",
                format!("{STATIC}, or leave [pad.coating] out"),
            ));
        }
        if let Friction::Coefficient(mu) = settings.friction {
            return Err(refused(
                "elastomer.friction",
                mu,
                "infinite in the explicit modes, on whose shared grid the pad always sticks",
                format!("{STATIC} for a coefficient, or set elastomer.friction = \"infinite\""),
            ));
        }
        let law = settings.law.unwrap_or(pad.material.law);
        let (youngs_key, youngs) = settings.youngs_modulus_of(pad);
        let (poisson_key, poisson) = settings.poisson_ratio_of(pad);
        let density = pad.material.density_g_mm3;
        let positive = |key, value: f64, unit: &str, next: &str| {
            if value.is_finite() && value > 0.0 {
                Ok(value)
            } else {
                Err(refused(key, value, format!("above 0{unit}"), next))
            }
        };
        positive(youngs_key, youngs, " MPa", "correct it")?;
        positive("pad.material.density_g_mm3", density, " g/mm^3", "choose e.g. the predecessor's 1")?;
        positive("elastomer.speed_mm_s", settings.speed_mm_s, " mm/s", "choose e.g. the predecessor's 200")?;
        if !(0.0..=0.499).contains(&poisson) {
            return Err(refused(poisson_key, poisson, "0 to 0.499", "choose a value in that range"));
        }
        let size_mm = [
            positive("pad.size_x_mm", pad.size_x_mm, " mm", "correct it")?,
            positive("pad.size_y_mm", pad.size_y_mm, " mm", "correct it")?,
            positive("pad.thickness_mm", pad.thickness_mm, " mm", "correct it")?,
        ];
        let n = settings.particles;
        let lattice =
            |allowed: &str, next: String| refused("elastomer.particles", format!("{n:?}"), allowed, next);
        if n.iter().any(|&n| n < 5) {
            let allowed = "at least 5 along each direction";
            return Err(lattice(allowed, "ask for more: the base alone holds three layers".into()));
        }
        if n.iter().product::<usize>() > 100_000_000 {
            return Err(lattice(
                "at most 1e8 in all",
                "choose a coarser lattice: these need over 16 GB".into(),
            ));
        }
        let spacing_mm = std::array::from_fn(|d| size_mm[d] / (n[d] - 1) as f64);
        let widest = spacing_mm.iter().copied().fold(0.0, f64::max);
        let narrowest = spacing_mm.iter().copied().fold(f64::INFINITY, f64::min);
        if widest > 2.0 * narrowest {
            return Err(lattice(
                "spacings within a factor of 2",
                format!(
                    "this lattice is {narrowest:.3} mm wide one way and {widest:.3} mm another; ask for as many as the pad's sides are long"
                ),
            ));
        }
        let usual_dx_mm = REFERENCE_DX_MM * widest / REFERENCE_SPACING_MM;
        let dx_mm = settings.dx_mm.unwrap_or(usual_dx_mm);
        // A wider lattice than the grid leaves nodes without mass inside the pad: it would fall apart.
        if !(dx_mm >= widest * 0.999 && dx_mm <= 4.0 * widest) {
            return Err(refused(
                "elastomer.dx_mm",
                dx_mm,
                format!("{widest:.4} mm (the particles' spacing) to {:.4} mm", 4.0 * widest),
                format!("leave it out for {usual_dx_mm:.4} mm"),
            ));
        }
        let mu = youngs * 1e6 / (2.0 * (1.0 + poisson));
        let lambda = youngs * 1e6 * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
        let limit = dx_mm / ((3.0 * lambda + 2.0 * mu) / density).sqrt();
        let dt_s = match settings.dt_s {
            Some(dt) if !(dt > 0.0 && dt <= limit) => {
                return Err(refused(
                    "elastomer.dt_s",
                    dt,
                    format!("above 0, at most {limit:.4e} s, with this grid and material"),
                    format!("leave it out, or choose {:.4e} s for large strains", 0.5 * limit),
                ));
            }
            Some(dt) => dt,
            None => (REFERENCE_DT_S * dx_mm / REFERENCE_DX_MM).min(DEFAULT_PART_OF_LIMIT * limit),
        };
        let most = MOST_CELLS_PER_STEP * dx_mm / dt_s;
        if settings.speed_mm_s > most {
            return Err(refused(
                "elastomer.speed_mm_s",
                settings.speed_mm_s,
                format!("at most {most:.1} mm/s: {MOST_CELLS_PER_STEP} cells in a step"),
                "lower it, or choose a shorter elastomer.dt_s",
            ));
        }
        if settings.mode == Mode::Impm {
            positive("elastomer.rest_threshold", settings.rest_threshold, "", "choose e.g. the paper's 0.5")?;
            positive("elastomer.rest_floor_mm_s", settings.rest_floor_mm_s, " mm/s", "leave it out for 1")?;
            if settings.rest_limit == 0 {
                return Err(refused(
                    "elastomer.rest_limit",
                    0,
                    "at least 1",
                    "choose 1 or more: a step takes a pass",
                ));
            }
        }
        let moduli_pa = Moduli { mu, lambda };
        Ok(Self { law, moduli_pa, density, particles: n, size_mm, spacing_mm, dx_mm, dt_s })
    }

    /// The longest stable step, s: dx / sqrt((3 lambda + 2 mu) / rho), sufficient for any layout of
    /// particles and sharp for a lone one (ANALYTIC.md section 6).
    pub fn stability_limit_s(&self) -> f64 {
        let m = self.moduli_pa;
        self.dx_mm / ((3.0 * m.lambda + 2.0 * m.mu) / self.density).sqrt()
    }

    /// Lame parameters in the kernels' units.
    pub fn scaled_moduli(&self) -> Moduli<f32> {
        let scale = 4.0 * self.dt_s * self.dt_s / (self.density * self.dx_mm * self.dx_mm);
        Moduli { mu: (self.moduli_pa.mu * scale) as f32, lambda: (self.moduli_pa.lambda * scale) as f32 }
    }

    /// Mass of a particle, g: density times the volume of a lattice cell.
    pub fn particle_mass_g(&self) -> f64 {
        self.density * self.spacing_mm.iter().product::<f64>()
    }

    /// Speed that corresponds to one cell per step, mm/s.
    pub fn unit_speed_mm_s(&self) -> f64 {
        self.dx_mm / self.dt_s
    }

    /// Force that gives a particle one cell per step in one step, N.
    pub fn unit_force_n(&self) -> f64 {
        self.particle_mass_g() * self.dx_mm / (self.dt_s * self.dt_s) * 1e-6
    }

    /// Undeformed position of a lattice point, pad frame, mm.
    pub fn rest_position_mm(&self, i: usize, j: usize, k: usize) -> [f64; 3] {
        let s = self.spacing_mm;
        [
            i as f64 * s[0] - self.size_mm[0] / 2.0,
            j as f64 * s[1] - self.size_mm[1] / 2.0,
            k as f64 * s[2] - self.size_mm[2],
        ]
    }
}
