//! What surfaces are made of.

use super::Texture;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// Diffuse reflectance, linear, 0 to 1.
#[derive(Debug, Clone)]
pub enum Albedo {
    /// The same everywhere.
    Constant(Vec3),
    /// From a picture, through the mesh's texture coordinates.
    Texture(Arc<Texture>),
}

impl PartialEq for Albedo {
    /// The same texture is not compared texel by texel: frames of one sensor share it.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Albedo::Constant(a), Albedo::Constant(b)) => a == b,
            (Albedo::Texture(a), Albedo::Texture(b)) => Arc::ptr_eq(a, b) || a == b,
            _ => false,
        }
    }
}

impl Albedo {
    /// A grey of the given reflectance.
    pub fn grey(value: f32) -> Self {
        Albedo::Constant(Vec3::splat(value))
    }

    /// The reflectance at texture coordinate `uv`.
    #[inline]
    pub fn at(&self, uv: Vec2) -> Vec3 {
        match self {
            Albedo::Constant(c) => *c,
            Albedo::Texture(t) => t.sample(uv),
        }
    }
}

/// How a surface scatters. All but the dielectrics reflect on both sides and transmit nothing.
#[derive(Debug, Clone, PartialEq)]
pub enum Material {
    /// Ideal diffuse reflection.
    Lambert {
        /// Reflectance.
        albedo: Albedo,
    },
    /// A smooth boundary between air (outside, where the normal points) and a clear medium.
    Dielectric {
        /// Index of refraction of the medium.
        ior: f32,
    },
    /// The same boundary, frosted: GGX facets.
    RoughDielectric {
        /// Index of refraction of the medium.
        ior: f32,
        /// GGX alpha, 0.001 to 1.
        alpha: f32,
    },
    /// A metal surface of GGX facets with Schlick's Fresnel term.
    RoughConductor {
        /// Reflectance at normal incidence.
        f0: Vec3,
        /// GGX alpha, 0.001 to 1.
        alpha: f32,
    },
    /// A diffuse binder with metal flakes: the GGX lobe of the flakes over the part `flakes` of
    /// the area, the diffuse albedo over the rest.
    FlakeCoating {
        /// Reflectance of the binder.
        albedo: Albedo,
        /// Part of the area covered by flakes, 0 to 1.
        flakes: f32,
        /// Reflectance of a flake at normal incidence.
        f0: Vec3,
        /// GGX alpha of the flakes' tilt, 0.001 to 1.
        alpha: f32,
    },
}

impl Material {
    /// What it is, in messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Material::Lambert { .. } => "a diffuse surface",
            Material::Dielectric { .. } => "clear glass",
            Material::RoughDielectric { .. } => "frosted glass",
            Material::RoughConductor { .. } => "metal",
            Material::FlakeCoating { .. } => "metal flakes",
        }
    }
}
