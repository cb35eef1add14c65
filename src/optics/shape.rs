//! From the shapes that sensor files write, in the pad frame, to those of scenes.

use super::sensor::LightShapeSpec;
use super::{LightShape, Mesh, from_pad};
use glam::Vec3;
use std::sync::Arc;

/// The luminous surface of a light.
pub fn of_light(spec: &LightShapeSpec) -> LightShape {
    match spec {
        LightShapeSpec::Rectangle { center_mm, facing, size_mm } => {
            let [center, half_u, half_v] = rectangle(center_mm, facing, *size_mm);
            LightShape::Rectangle { center, half_u, half_v }
        }
        LightShapeSpec::Disc { center_mm, facing, radius_mm } => LightShape::Disc {
            center: from_pad(vector(center_mm)),
            normal: from_pad(vector(facing)).normalize(),
            radius: *radius_mm as f32,
        },
        LightShapeSpec::Tube { from_mm, to_mm, radius_mm } => LightShape::Tube {
            from: from_pad(vector(from_mm)),
            to: from_pad(vector(to_mm)),
            radius: *radius_mm as f32,
        },
        LightShapeSpec::Mesh { vertices_mm, triangles } => {
            LightShape::Mesh(Arc::new(mesh(vertices_mm, triangles)))
        }
    }
}

/// The middle of a rectangle and halves of its edges. The first edge is level; for one that faces along z it runs along x.
pub fn rectangle(center_mm: &[f64; 3], facing: &[f64; 3], size_mm: [f64; 2]) -> [Vec3; 3] {
    let normal = from_pad(vector(facing)).normalize();
    let level = Vec3::Z.cross(normal);
    let u = if level.length() > 1e-4 { level.normalize() } else { Vec3::X };
    [from_pad(vector(center_mm)), u * (size_mm[0] / 2.0) as f32, normal.cross(u) * (size_mm[1] / 2.0) as f32]
}

/// Triangles of numbered corners.
pub fn mesh(vertices_mm: &[[f64; 3]], triangles: &[[u32; 3]]) -> Mesh {
    Mesh {
        positions: vertices_mm.iter().map(|v| from_pad(vector(v))).collect(),
        triangles: triangles.to_vec(),
        ..Mesh::default()
    }
}

/// A vector of a file in single precision.
pub fn vector(v: &[f64; 3]) -> Vec3 {
    Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32)
}
