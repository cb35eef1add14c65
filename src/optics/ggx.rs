//! GGX facets: distribution, masking, sampling of visible normals.
//!
//! Walter et al. 2007 for the distribution and for refraction, Heitz 2014 for the height-correlated masking
//! (eq. 99), Dupuy and Benyoub 2023 for sampling visible normals by spherical caps. Single scattering:
//! energy that bounces between facets is lost, up to a few per cent at alpha 0.3 and more above.

use super::bsdf::fresnel;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Density of facet normals, per solid angle and projected area.
fn distribution(alpha: f32, m: Vec3) -> f32 {
    if m.z <= 0.0 {
        return 0.0;
    }
    let a2 = alpha * alpha;
    // (x^2 + y^2)/a^2 + z^2, without the cancellation of cos^2 (a^2 - 1) + 1.
    let s = (m.x * m.x + m.y * m.y) / a2 + m.z * m.z;
    1.0 / (PI * a2 * s * s)
}

/// Smith's Lambda.
fn lambda(alpha: f32, w: Vec3) -> f32 {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z).max(1e-20);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Density of normals visible from `wo`, per solid angle.
fn visible(alpha: f32, wo: Vec3, m: Vec3) -> f32 {
    distribution(alpha, m) * wo.dot(m).max(0.0) / (wo.z.max(1e-10) * (1.0 + lambda(alpha, wo)))
}

/// Samples a normal visible from `wo`.
pub fn sample_normal(alpha: f32, wo: Vec3, u: Vec2) -> Vec3 {
    let w = Vec3::new(alpha * wo.x, alpha * wo.y, wo.z).normalize();
    let z = (1.0 - u.y) * (1.0 + w.z) - w.z;
    let sin = (1.0 - z * z).max(0.0).sqrt();
    let (s, c) = (TAU * u.x).sin_cos();
    let h = Vec3::new(sin * c, sin * s, z) + w;
    Vec3::new(alpha * h.x, alpha * h.y, h.z.max(1e-7)).normalize()
}

/// The reflecting lobe with Fresnel term `f` of the facet's cosine, without the cosine of `wi`.
pub fn eval_reflection(alpha: f32, wo: Vec3, wi: Vec3, f: impl Fn(f32) -> Vec3) -> Vec3 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return Vec3::ZERO;
    }
    let m = (wo + wi).normalize_or_zero();
    let g = 1.0 / (1.0 + lambda(alpha, wo) + lambda(alpha, wi));
    f(wo.dot(m)) * (distribution(alpha, m) * g / (4.0 * wo.z * wi.z))
}

/// Density of reflected directions when a visible normal is sampled.
pub fn pdf_reflection(alpha: f32, wo: Vec3, wi: Vec3) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let m = (wo + wi).normalize_or_zero();
    visible(alpha, wo, m) / (4.0 * wo.dot(m)).max(1e-10)
}

/// The facet normal that refracts `wo` into `wi`, towards +z (Walter et al. 2007, eq. 16); None when there is none.
fn refracting_normal(eta: f32, wo: Vec3, wi: Vec3) -> Option<Vec3> {
    let m = (wi * eta + wo).normalize_or_zero();
    let m = if m.z < 0.0 { -m } else { m };
    (wo.dot(m) > 0.0 && wi.dot(m) < 0.0).then_some(m)
}

/// A frosted boundary: reflection and refraction, without the cosine of `wi`.
pub fn eval_dielectric(alpha: f32, eta: f32, wo: Vec3, wi: Vec3) -> f32 {
    if wi.z > 0.0 {
        return eval_reflection(alpha, wo, wi, |c| Vec3::splat(fresnel(c, eta))).x;
    }
    let Some(m) = refracting_normal(eta, wo, wi) else { return 0.0 };
    let (o, i) = (wo.dot(m), wi.dot(m));
    let g = 1.0 / (1.0 + lambda(alpha, wo) + lambda(alpha, wi));
    let denominator = (i + o / eta).powi(2) * wo.z * wi.z.abs();
    let value = (1.0 - fresnel(o, eta)) * distribution(alpha, m) * g * o * i.abs() / denominator.max(1e-20);
    value / (eta * eta)
}

/// Density of directions when a visible normal is sampled and then Fresnel's reflectance decides.
pub fn pdf_dielectric(alpha: f32, eta: f32, wo: Vec3, wi: Vec3) -> f32 {
    if wi.z > 0.0 {
        let m = (wo + wi).normalize_or_zero();
        return fresnel(wo.dot(m), eta) * pdf_reflection(alpha, wo, wi);
    }
    let Some(m) = refracting_normal(eta, wo, wi) else { return 0.0 };
    let (o, i) = (wo.dot(m), wi.dot(m));
    let jacobian = i.abs() / (i + o / eta).powi(2).max(1e-20);
    (1.0 - fresnel(o, eta)) * visible(alpha, wo, m) * jacobian
}
