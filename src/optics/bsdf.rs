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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::pearson::{UNLIKELY, chance};
    use crate::optics::{Albedo, noise::uniform, sampler::Sampler};

    fn all() -> Vec<(Material, bool)> {
        let metal = |alpha| Material::RoughConductor { f0: Vec3::new(0.9, 0.8, 0.6), alpha };
        let coat = Material::FlakeCoating {
            albedo: Albedo::grey(0.5),
            flakes: 0.3,
            f0: Vec3::splat(0.9),
            alpha: 0.2,
        };
        let frosted = |alpha| Material::RoughDielectric { ior: 1.5, alpha };
        vec![
            (Material::Lambert { albedo: Albedo::grey(0.7) }, true),
            (metal(0.1), true),
            (metal(0.6), true),
            (coat, true),
            (frosted(0.15), true),
            (frosted(0.4), true),
            (frosted(0.15), false),
            (frosted(0.4), false),
        ]
    }

    fn views() -> [Vec3; 3] {
        [Vec3::Z, Vec3::new(0.5, 0.2, 0.7).normalize(), Vec3::new(-0.8, 0.5, 0.25).normalize()]
    }

    #[test]
    fn samples_follow_their_density() {
        const ROWS: usize = 24;
        const COLUMNS: usize = 32;
        const N: u32 = 60_000;
        for (material, outside) in all() {
            let bsdf = Bsdf::new(&material, Vec2::ZERO, outside);
            for wo in views() {
                let mut seen = vec![0.0f64; ROWS * COLUMNS];
                let mut lost = 0.0;
                for i in 0..N {
                    // Independent points: a stratified set would be too even for the test's statistics.
                    let u = |d| uniform(d, i) as f32;
                    match bsdf.sample(wo, Vec2::new(u(1), u(2)), u(3)) {
                        None => lost += 1.0,
                        Some(s) => {
                            let row = (s.wi.z.acos() / (TAU / 2.0) * ROWS as f32) as usize;
                            let turn = (s.wi.y.atan2(s.wi.x) / TAU).rem_euclid(1.0);
                            let column = (turn * COLUMNS as f32) as usize;
                            seen[row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)] += 1.0;
                        }
                    }
                }
                // Expected counts by a midpoint rule within each bin.
                const SUB: usize = 24;
                let mut expected = vec![0.0f64; ROWS * COLUMNS];
                for (bin, value) in expected.iter_mut().enumerate() {
                    for k in 0..SUB * SUB {
                        let polar =
                            ((bin / COLUMNS) as f32 + ((k / SUB) as f32 + 0.5) / SUB as f32) / ROWS as f32;
                        let (r, z) = (polar * TAU / 2.0).sin_cos();
                        let turn =
                            ((bin % COLUMNS) as f32 + ((k % SUB) as f32 + 0.5) / SUB as f32) / COLUMNS as f32;
                        let (sin, cos) = (turn * TAU).sin_cos();
                        *value += f64::from(r * bsdf.pdf(wo, Vec3::new(r * cos, r * sin, z)));
                    }
                    *value *= f64::from(N) * 2.0 * std::f64::consts::PI.powi(2)
                        / (ROWS * COLUMNS * SUB * SUB) as f64;
                }
                let total: f64 = expected.iter().sum();
                assert!(
                    (total / (f64::from(N) - lost) - 1.0).abs() < 0.02,
                    "{material:?} {wo}: density sums to {total}"
                );
                // (Where hardly anything is expected the midpoint rule is coarse.)
                let told = seen.iter().zip(&expected).filter(|(_, e)| **e >= 25.0);
                let (seen, expected): (Vec<f64>, Vec<f64>) = told.unzip();
                let likely = chance(&seen, &expected);
                assert!(likely > UNLIKELY, "{material:?} {wo}: {likely}");
            }
        }
    }

    #[test]
    fn the_square_covers_the_disc_evenly() {
        const N: u32 = 100_000;
        const SIDE: usize = 12;
        let mut seen = [0.0; SIDE * SIDE];
        for i in 0..N {
            let p = concentric_disc(Vec2::new(uniform(1, i) as f32, uniform(2, i) as f32));
            let parts = [p.length_squared(), (p.y.atan2(p.x) / TAU).rem_euclid(1.0)];
            let [ring, turn] = parts.map(|part| ((part * SIDE as f32) as usize).min(SIDE - 1));
            seen[ring * SIDE + turn] += 1.0;
        }
        let even = f64::from(N) / (SIDE * SIDE) as f64;
        let likely = chance(&seen, &[even; SIDE * SIDE]);
        assert!(likely > UNLIKELY, "{likely}");
    }

    #[test]
    fn weights_are_evaluation_over_density_and_no_energy_is_made() {
        for (material, outside) in all() {
            let bsdf = Bsdf::new(&material, Vec2::ZERO, outside);
            for wo in views() {
                let sampler = Sampler::new(2, 0, 0, 4096);
                let mut energy = 0.0;
                for i in 0..4096 {
                    let [a, b, c, _] = sampler.group(i, 0);
                    let Some(s) = bsdf.sample(wo, Vec2::new(a, b), c) else { continue };
                    let truth = bsdf.eval(wo, s.wi) * s.wi.z.abs() / bsdf.pdf(wo, s.wi);
                    assert!((s.weight - truth).abs().max_element() <= 1e-4 * truth.max_element().max(1.0));
                    assert!((s.pdf / bsdf.pdf(wo, s.wi) - 1.0).abs() < 1e-4);
                    // Radiance in the denser medium counts 1/eta^2; energy does not.
                    let scale = match bsdf.lobe {
                        Lobe::RoughDielectric { eta, .. } if s.wi.z < 0.0 => eta * eta,
                        _ => 1.0,
                    };
                    energy += s.weight.x * scale / 4096.0;
                }
                assert!(energy <= 1.005, "{material:?} {wo}: {energy}");
                assert!(energy > 0.5, "{material:?} {wo}: {energy}");
            }
        }
    }

    #[test]
    fn light_may_run_either_way() {
        for (material, outside) in all() {
            let bsdf = Bsdf::new(&material, Vec2::ZERO, outside);
            let wo = Vec3::new(0.3, -0.2, 0.8).normalize();
            for wi in [Vec3::new(0.1, 0.6, 0.5), Vec3::new(-0.3, 0.2, 0.9), Vec3::new(-0.3, 0.1, -0.8)] {
                let wi = wi.normalize();
                let there = bsdf.eval(wo, wi).x;
                let back = if wi.z > 0.0 {
                    bsdf.eval(wi, wo).x
                } else {
                    // The other way round the near side is the far side, and radiance is rescaled.
                    let Lobe::RoughDielectric { eta, .. } = bsdf.lobe else { continue };
                    let flip = Vec3::new(1.0, 1.0, -1.0);
                    Bsdf::new(&material, Vec2::ZERO, !outside).eval(wi * flip, wo * flip).x / (eta * eta)
                };
                assert!((there - back).abs() <= 1e-4 * there.max(1e-4), "{material:?} {wi}: {there} {back}");
            }
        }
    }

    #[test]
    fn fresnel_and_snell_at_known_angles() {
        assert!((fresnel(1.0, 1.5) - 0.04).abs() < 1e-6);
        // Brewster's angle: tan = n; the parallel part vanishes, so the mean is half the perpendicular.
        // There cos_t = sin_i, so r = (cos_i - n sin_i)/(cos_i + n sin_i) = (1 - n^2)/(1 + n^2).
        let cos = 1.0 / (1.0f32 + 1.5 * 1.5).sqrt();
        let perpendicular = ((1.0f32 - 2.25) / (1.0 + 2.25)).powi(2);
        assert!((fresnel(cos, 1.5) - perpendicular / 2.0).abs() < 1e-6);
        assert_eq!(fresnel(0.3, 1.0 / 1.5), 1.0);
        assert!(refract(Vec3::new(0.9, 0.0, 0.43589), Vec3::Z, 1.0 / 1.5).is_none());
        let w = refract(Vec3::new(0.6, 0.0, 0.8), Vec3::Z, 1.5).unwrap();
        assert!((w - Vec3::new(-0.4, 0.0, -(1.0f32 - 0.16).sqrt())).length() < 1e-6);
    }
}
