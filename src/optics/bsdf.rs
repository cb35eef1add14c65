//! Scattering at a point: evaluation, density and sampling of every material.
//!
//! Directions are in a local frame whose z is the geometric normal on the viewer's side, so `wo.z > 0`;
//! both point away from the surface. A material is a diffuse part, which the integrator lights in closed
//! form where it can, plus at most one other lobe. Radiance is scaled by 1/eta^2 when it is followed into a denser
//! medium (Veach 1997, section 5.2).

use super::{Material, ggx};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};

/// A material at one point, seen from one side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bsdf {
    /// Albedo of the diffuse part.
    pub diffuse: Vec3,
    /// The other part.
    pub lobe: Lobe,
}

/// What a material has beside its diffuse part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lobe {
    /// Nothing.
    None,
    /// GGX facets of a metal, over the part `cover` of the area.
    Conductor {
        /// Reflectance at normal incidence.
        f0: Vec3,
        /// GGX alpha.
        alpha: f32,
        /// Part of the area.
        cover: f32,
    },
    /// A smooth boundary; `eta` is the far side's index over the near side's.
    Dielectric {
        /// Relative index.
        eta: f32,
    },
    /// A frosted boundary.
    RoughDielectric {
        /// Relative index.
        eta: f32,
        /// GGX alpha.
        alpha: f32,
    },
}

/// A sampled direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scattered {
    /// Where to go on, a unit vector.
    pub wi: Vec3,
    /// BSDF times cosine over density, of the whole material.
    pub weight: Vec3,
    /// The share of the weight that is not diffuse.
    pub lobe_weight: Vec3,
    /// Density per solid angle; 0 for a mirror direction.
    pub pdf: f32,
}

impl Bsdf {
    /// The material at texture coordinate `uv`, seen from outside (where the normal points) or inside.
    #[inline]
    pub fn new(material: &Material, uv: Vec2, outside: bool) -> Self {
        let relative = |ior: f32| if outside { ior } else { 1.0 / ior };
        match material {
            Material::Lambert { albedo } => Self { diffuse: albedo.at(uv), lobe: Lobe::None },
            Material::Dielectric { ior } => {
                Self { diffuse: Vec3::ZERO, lobe: Lobe::Dielectric { eta: relative(*ior) } }
            }
            Material::RoughDielectric { ior, alpha } => Self {
                diffuse: Vec3::ZERO,
                lobe: Lobe::RoughDielectric { eta: relative(*ior), alpha: *alpha },
            },
            Material::RoughConductor { f0, alpha } => {
                Self { diffuse: Vec3::ZERO, lobe: Lobe::Conductor { f0: *f0, alpha: *alpha, cover: 1.0 } }
            }
            Material::FlakeCoating { albedo, flakes, f0, alpha } => Self {
                diffuse: albedo.at(uv) * (1.0 - flakes),
                lobe: Lobe::Conductor { f0: *f0, alpha: *alpha, cover: *flakes },
            },
        }
    }

    /// Whether all directions but the mirror ones are dark.
    pub fn is_specular(&self) -> bool {
        matches!(self.lobe, Lobe::Dielectric { .. })
    }

    /// The part that is neither diffuse nor a mirror, without the cosine.
    #[inline]
    pub fn eval_lobe(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        match self.lobe {
            Lobe::None | Lobe::Dielectric { .. } => Vec3::ZERO,
            Lobe::Conductor { f0, alpha, cover } => {
                cover * ggx::eval_reflection(alpha, wo, wi, |c| schlick(f0, c))
            }
            Lobe::RoughDielectric { eta, alpha } => Vec3::splat(ggx::eval_dielectric(alpha, eta, wo, wi)),
        }
    }

    /// The whole material without its mirror directions, without the cosine.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        let diffuse = if wi.z > 0.0 { self.diffuse * FRAC_1_PI } else { Vec3::ZERO };
        diffuse + self.eval_lobe(wo, wi)
    }

    /// Probability with which [`Bsdf::sample`] samples the diffuse part.
    #[inline]
    fn diffuse_share(&self) -> f32 {
        match self.lobe {
            Lobe::None => 1.0,
            Lobe::Dielectric { .. } | Lobe::RoughDielectric { .. } => 0.0,
            Lobe::Conductor { f0, cover, .. } => {
                let (d, s) = (self.diffuse.element_sum(), cover * f0.element_sum());
                if d + s > 0.0 { d / (d + s) } else { 0.5 }
            }
        }
    }

    /// Density of `wi` under [`Bsdf::sample`], per solid angle.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let share = self.diffuse_share();
        let diffuse = share * wi.z.max(0.0) * FRAC_1_PI;
        match self.lobe {
            Lobe::None | Lobe::Dielectric { .. } => diffuse,
            Lobe::Conductor { alpha, .. } => diffuse + (1.0 - share) * ggx::pdf_reflection(alpha, wo, wi),
            Lobe::RoughDielectric { eta, alpha } => ggx::pdf_dielectric(alpha, eta, wo, wi),
        }
    }

    /// Samples a direction: `u` a point of the unit square, `choice` in [0, 1) picks the lobe.
    /// None where the light is absorbed.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2, choice: f32) -> Option<Scattered> {
        match self.lobe {
            Lobe::None => {
                let wi = cosine_hemisphere(u);
                let pdf = wi.z * FRAC_1_PI;
                (pdf > 0.0).then_some(Scattered { wi, weight: self.diffuse, lobe_weight: Vec3::ZERO, pdf })
            }
            Lobe::Dielectric { eta } => {
                let reflected = fresnel(wo.z, eta);
                let (wi, scale) = if choice < reflected {
                    (Vec3::new(-wo.x, -wo.y, wo.z), 1.0)
                } else {
                    (refract(wo, Vec3::Z, eta)?, 1.0 / (eta * eta))
                };
                let weight = Vec3::splat(scale);
                Some(Scattered { wi, weight, lobe_weight: weight, pdf: 0.0 })
            }
            Lobe::Conductor { alpha, .. } => {
                let wi = if choice < self.diffuse_share() {
                    cosine_hemisphere(u)
                } else {
                    let m = ggx::sample_normal(alpha, wo, u);
                    2.0 * wo.dot(m) * m - wo
                };
                self.weigh(wo, wi)
            }
            Lobe::RoughDielectric { eta, alpha } => {
                let m = ggx::sample_normal(alpha, wo, u);
                let wi = if choice < fresnel(wo.dot(m), eta) {
                    Some(2.0 * wo.dot(m) * m - wo).filter(|w| w.z > 0.0)
                } else {
                    refract(wo, m, eta).filter(|w| w.z < 0.0)
                };
                self.weigh(wo, wi?)
            }
        }
    }

    fn weigh(&self, wo: Vec3, wi: Vec3) -> Option<Scattered> {
        let pdf = self.pdf(wo, wi);
        if pdf <= 0.0 || !pdf.is_finite() {
            return None;
        }
        let lobe_weight = self.eval_lobe(wo, wi) * (wi.z.abs() / pdf);
        let diffuse = self.diffuse * (FRAC_1_PI * wi.z.max(0.0) / pdf);
        Some(Scattered { wi, weight: diffuse + lobe_weight, lobe_weight, pdf })
    }
}

/// Cosine-weighted direction about z, by the concentric map (Shirley and Chiu 1997).
#[inline]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = concentric_disc(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Maps the unit square to the unit disc, keeping neighbours together.
#[inline]
pub fn concentric_disc(u: Vec2) -> Vec2 {
    let p = 2.0 * u - Vec2::ONE;
    if p == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (r, angle) = if p.x.abs() > p.y.abs() {
        (p.x, TAU / 8.0 * (p.y / p.x))
    } else {
        (p.y, TAU / 4.0 - TAU / 8.0 * (p.x / p.y))
    };
    let (sin, cos) = angle.sin_cos();
    Vec2::new(r * cos, r * sin)
}

/// Unpolarised reflectance of a boundary with relative index `eta` at the cosine of incidence.
#[inline]
pub fn fresnel(cos_i: f32, eta: f32) -> f32 {
    let cos_i = cos_i.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// The direction behind a boundary with normal `m` (on `wo`'s side), by Snell's law; None at total reflection.
#[inline]
pub fn refract(wo: Vec3, m: Vec3, eta: f32) -> Option<Vec3> {
    let cos_i = wo.dot(m);
    let sin2_t = (1.0 - cos_i * cos_i).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 || cos_i <= 0.0 {
        return None;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    Some((m * (cos_i / eta - cos_t) - wo / eta).normalize())
}

/// Schlick's approximation of a metal's reflectance.
#[inline]
fn schlick(f0: Vec3, cos: f32) -> Vec3 {
    f0 + (Vec3::ONE - f0) * (1.0 - cos.clamp(0.0, 1.0)).powi(5)
}
