//! Light sources: shape, colour, angular profile, and what the patch itself reflects.

use super::Mesh;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// The luminous surface.
#[derive(Debug, Clone, PartialEq)]
pub enum LightShape {
    /// A rectangle (an LED strip is a long one): centre plus half edges; it shines towards
    /// `half_u x half_v`.
    Rectangle {
        /// Centre.
        center: Vec3,
        /// Half of the first edge.
        half_u: Vec3,
        /// Half of the second edge, at right angles to the first.
        half_v: Vec3,
    },
    /// A flat disc.
    Disc {
        /// Centre.
        center: Vec3,
        /// Direction in which it shines, a unit vector.
        normal: Vec3,
        /// Radius, mm.
        radius: f32,
    },
    /// The curved face of a cylinder, shining outwards.
    Tube {
        /// One end of the axis.
        from: Vec3,
        /// The other end.
        to: Vec3,
        /// Radius, mm.
        radius: f32,
    },
    /// Any mesh, shining where its normals point.
    Mesh(Arc<Mesh>),
}

/// A light of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Name in reports and of its basis image.
    pub name: String,
    /// The luminous surface.
    pub shape: LightShape,
    /// Radiance along the normal, linear RGB.
    pub radiance: Vec3,
    /// Whether the back shines as well.
    pub two_sided: bool,
    /// Angular profile: radiance falls as cos^k of the angle to the normal; 0 is Lambertian.
    pub cosine_power: f32,
    /// Diffuse reflectance of the patch itself (both sides).
    pub albedo: Vec3,
}

/// Radiances are at most this in any channel: far beyond any light, and sums of squares of it are still numbers.
pub const MOST_RADIANCE: f32 = 1e12;
/// Lights have an extent above this, mm.
const LEAST_MM: f32 = 1e-6;
/// Directions are of length 1, and edges at right angles, to this part.
const ASKEW: f32 = 1e-3;

/// Facets around a disc or a tube. The inscribed polygon of 64 sides has 0.16 % less area than the circle;
/// `tessellate` enlarges it so that the area agrees.
const FACETS: usize = 64;

/// Whether light of that radiance can be rendered and added up.
pub fn is_radiance(radiance: Vec3) -> bool {
    radiance.is_finite() && radiance.min_element() >= 0.0 && radiance.max_element() <= MOST_RADIANCE
}

impl LightShape {
    /// What is no shape about it.
    pub fn fault(&self) -> Option<String> {
        let long = |v: Vec3| v.is_finite() && v.length() > LEAST_MM;
        let thick = |r: f32| r.is_finite() && r > LEAST_MM;
        match self {
            LightShape::Rectangle { center, half_u, half_v } => {
                let square = long(*half_u)
                    && long(*half_v)
                    && half_u.normalize().dot(half_v.normalize()).abs() < ASKEW;
                (!(center.is_finite() && square))
                    .then(|| format!("its half edges are {half_u} and {half_v} mm about {center}"))
            }
            LightShape::Disc { center, normal, radius } => {
                let unit = (normal.length() - 1.0).abs() < ASKEW;
                (!(center.is_finite() && unit && thick(*radius)))
                    .then(|| format!("its radius is {radius} mm about {center}, its direction {normal}"))
            }
            LightShape::Tube { from, to, radius } => {
                (!(long(*to - *from) && from.is_finite() && thick(*radius)))
                    .then(|| format!("its radius is {radius} mm, its axis from {from} to {to}"))
            }
            LightShape::Mesh(mesh) => {
                let area: f32 = (0..mesh.triangles.len()).map(|k| mesh.area(k)).sum();
                let shines = area.is_finite() && area > LEAST_MM * LEAST_MM;
                (!shines).then(|| format!("its {} triangles have {area} mm^2", mesh.triangles.len()))
            }
        }
    }

    /// The shape as triangles with their normals on the shining side. Exact for rectangles and meshes;
    /// discs and tubes become 64-gons of equal area.
    pub fn tessellate(&self) -> Mesh {
        match self {
            LightShape::Rectangle { center, half_u, half_v } => {
                Mesh::parallelogram(*center - *half_u - *half_v, 2.0 * *half_u, 2.0 * *half_v)
            }
            LightShape::Disc { center, normal, radius } => {
                let step = std::f32::consts::TAU / FACETS as f32;
                let radius = radius * (step / step.sin()).sqrt();
                let (s, t) = normal.any_orthonormal_pair();
                let mut mesh = Mesh { positions: vec![*center], ..Mesh::default() };
                for k in 0..FACETS {
                    let rim = Vec2::from_angle(k as f32 * step) * radius;
                    mesh.positions.push(*center + s * rim.x + t * rim.y);
                    mesh.triangles.push([0, 1 + k as u32, 1 + ((k + 1) % FACETS) as u32]);
                }
                mesh
            }
            LightShape::Tube { from, to, radius } => {
                let step = std::f32::consts::TAU / FACETS as f32;
                let radius = radius * (step / 2.0) / (step / 2.0).sin();
                let (s, t) = (*to - *from).normalize_or(Vec3::Z).any_orthonormal_pair();
                let mut mesh = Mesh::default();
                for k in 0..FACETS {
                    let rim = Vec2::from_angle(k as f32 * step) * radius;
                    let offset = s * rim.x + t * rim.y;
                    mesh.positions.extend([*from + offset, *to + offset]);
                    let (a, b) = (2 * k as u32, 2 * ((k + 1) % FACETS) as u32);
                    mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
                }
                mesh
            }
            LightShape::Mesh(mesh) => (**mesh).clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &Mesh) -> f32 {
        (0..mesh.triangles.len()).map(|k| mesh.area(k)).sum()
    }

    #[test]
    fn facets_keep_the_area_and_the_normals() {
        let disc = LightShape::Disc { center: Vec3::ONE, normal: Vec3::NEG_Y, radius: 2.0 }.tessellate();
        assert!((area(&disc) / (4.0 * std::f32::consts::PI) - 1.0).abs() < 1e-5);
        let [a, b, c] = disc.corners(7);
        assert!((b - a).cross(c - a).dot(Vec3::NEG_Y) > 0.0);

        let tube = LightShape::Tube { from: Vec3::ZERO, to: Vec3::X * 3.0, radius: 0.5 }.tessellate();
        assert!((area(&tube) / (3.0 * std::f32::consts::PI) - 1.0).abs() < 1e-5);
        let [a, b, c] = tube.corners(10);
        let outwards = Vec3::new(0.0, a.y, a.z);
        assert!((b - a).cross(c - a).dot(outwards) > 0.0);
    }
}
