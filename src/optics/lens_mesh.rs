//! The closed mesh of a lens, normals outwards.
//!
//! Facets alone would bend light like so many prisms; the mesh carries the true normals at its vertices, and between those of
//! a sphere the interpolated ones are true again.

use super::sensor::{LensFace, LensSpec};
use super::{Mesh, from_pad};
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;

/// Rings of a spherical face, and vertices around: facets of a face of 20 mm stand off a sphere of 12 mm by a micrometre.
const RINGS: usize = 48;
const AROUND: usize = 256;

/// The lens over the point (x, y) of the pad frame, mm, in the scene frame.
pub fn of_lens(lens: &LensSpec, center_mm: [f64; 2]) -> Mesh {
    let axis = from_pad(Vec3::new(center_mm[0] as f32, center_mm[1] as f32, 0.0)).as_dvec3();
    let mut mesh = Mesh::default();
    let front = cap(&mut mesh, axis, lens.front(), lens.half_mm(), false);
    let back = cap(&mut mesh, axis, lens.back(), lens.half_mm(), true);
    // The rim has the faces' last points, with normals of its own.
    let first = mesh.positions.len() as u32;
    for k in 0..AROUND {
        let out = around(k).as_vec3();
        for ring in [front, back] {
            mesh.positions.push(mesh.positions[ring + k]);
            mesh.normals.push(out);
        }
    }
    for k in 0..AROUND as u32 {
        let at = |k: u32| first + 2 * (k % AROUND as u32);
        let (low, next) = (at(k), at(k + 1));
        mesh.triangles.extend([[low, next, next + 1], [low, next + 1, low + 1]]);
    }
    mesh
}

/// The direction from the axis to vertex `k` of a ring.
fn around(k: usize) -> DVec3 {
    let (sin, cos) = (TAU * k as f64 / AROUND as f64).sin_cos();
    DVec3::new(cos, sin, 0.0)
}

/// Adds a face whose outside is up or down; the first vertex of its rim.
fn cap(mesh: &mut Mesh, axis: DVec3, face: LensFace, half_mm: f64, is_up: bool) -> usize {
    let c = face.curvature;
    let rings = if c == 0.0 { 1 } else { RINGS };
    // Even steps of angle: near the rim of a half sphere radii alone would be too coarse.
    let radius = |ring: usize| {
        let share = ring as f64 / rings as f64;
        match ring == rings || c == 0.0 {
            true => half_mm * share,
            false => (share * (half_mm * c.abs()).min(1.0).asin()).sin() / c.abs(),
        }
    };
    let sign = if is_up { 1.0 } else { -1.0 };
    let first = mesh.positions.len();
    let mut add = |r: f64, out: DVec3| {
        let height = face.height_mm(r);
        let normal = DVec3::Z * (1.0 - c * (height - face.vertex_mm)) - out * (c * r);
        mesh.positions.push((axis + out * r + DVec3::Z * height).as_vec3());
        mesh.normals.push((normal * sign).normalize().as_vec3());
    };
    add(0.0, DVec3::X);
    for ring in 1..=rings {
        (0..AROUND).for_each(|k| add(radius(ring), around(k)));
    }
    let at = |ring: usize, k: usize| match ring {
        0 => first as u32,
        _ => (first + 1 + (ring - 1) * AROUND + k % AROUND) as u32,
    };
    let mut add = |[a, b, c]: [u32; 3]| mesh.triangles.push(if is_up { [a, b, c] } else { [a, c, b] });
    for ring in 1..=rings {
        for k in 0..AROUND {
            add([at(ring - 1, k), at(ring, k), at(ring, k + 1)]);
            if ring > 1 {
                add([at(ring - 1, k), at(ring, k + 1), at(ring - 1, k + 1)]);
            }
        }
    }
    first + 1 + (rings - 1) * AROUND
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;
    use std::f64::consts::PI;

    fn lens(front_radius_mm: Option<f64>, back_radius_mm: Option<f64>) -> LensSpec {
        LensSpec {
            gap_mm: 1.0,
            thickness_mm: 4.0,
            diameter_mm: 8.0,
            front_radius_mm,
            back_radius_mm,
            ior: 1.5,
        }
    }

    #[test]
    fn it_is_closed_its_normals_point_outwards_and_it_has_its_volume() {
        let ball_cap = |r: f64, a: f64| {
            let h = r - (r * r - a * a).sqrt();
            PI * h * h * (3.0 * r - h) / 3.0
        };
        let slab = |thick: f64| PI * 16.0 * thick;
        let sag = |r: f64| r - (r * r - 16.0).sqrt();
        for (lens, volume) in [
            (lens(None, None), slab(4.0)),
            (lens(Some(5.0), None), slab(4.0 - sag(5.0)) + ball_cap(5.0, 4.0)),
            // A half ball on a short stem.
            (LensSpec { thickness_mm: 4.5, ..lens(Some(4.0), None) }, slab(0.5) + ball_cap(4.0, 4.0)),
            (
                lens(Some(6.0), Some(-7.0)),
                slab(4.0 - sag(6.0) + sag(7.0)) + ball_cap(6.0, 4.0) - ball_cap(7.0, 4.0),
            ),
        ] {
            let mesh = of_lens(&lens, [0.5, -1.0]);
            mesh.check("lens").unwrap();
            // Each edge of places is walked once in each direction.
            let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
            let mut six_volumes = 0.0;
            for (k, triangle) in mesh.triangles.iter().enumerate() {
                let corners = mesh.corners(k);
                let [a, b, c] = corners.map(|p| p.as_dvec3());
                six_volumes += a.dot(b.cross(c));
                let normal = (b - a).cross(c - a).normalize();
                assert!(triangle.iter().all(|i| mesh.normals[*i as usize].as_dvec3().dot(normal) > 0.99));
                for e in 0..3 {
                    let ends = [corners[e], corners[(e + 1) % 3]].map(|p| p.to_array().map(f32::to_bits));
                    *edges.entry(ends).or_default() += 1;
                }
            }
            assert!(edges.iter().all(|([a, b], n)| *n == 1 && edges.get(&[*b, *a]) == Some(&1)));
            let of_mesh = six_volumes / 6.0;
            assert!((of_mesh / volume - 1.0).abs() < 1e-3, "{of_mesh} {volume} {lens:?}");
            let center = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f32;
            assert!((center.truncate() - glam::Vec2::new(0.5, 1.0)).length() < 1e-3, "{center}");
        }
    }
}
