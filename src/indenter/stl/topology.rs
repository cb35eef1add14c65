//! From loose triangles to a closed, consistently oriented solid, or to the name of the defect.
//!
//! STL repeats every corner in every triangle. Corners within a millionth of the mesh's size are one
//! corner. Then each directed edge must occur once and so must its reverse: that is what closed,
//! manifold and consistently oriented mean for a mesh. A mesh that is wholly inside out is turned.

use super::Defect;
use glam::DVec3;
use std::collections::HashMap;

/// A closed mesh, counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Corner positions.
    pub vertices: Vec<DVec3>,
    /// Corner indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Corners nearer than this fraction of the mesh's diagonal are one corner.
const WELD_FRACTION: f64 = 1e-6;

/// Welds corners and proves that the triangles close up.
///
/// # Errors
/// The first kind of defect found, with its number and a place.
pub fn close(triangles: &[[DVec3; 3]]) -> Result<Solid, Defect> {
    let corners: Vec<DVec3> = triangles.iter().flatten().copied().collect();
    let (low, high) = super::bounds(&corners);
    // Single precision resolves coordinates far from the origin no better than this.
    let resolution = low.abs().max(high.abs()).max_element() * 1e-7;
    let tolerance = ((high - low).length() * WELD_FRACTION).max(resolution).max(f64::MIN_POSITIVE);
    let (vertices, indices) = weld(&corners, tolerance);
    let mut faces: Vec<[u32; 3]> = indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    faces.retain(|f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0]);
    if faces.is_empty() {
        return Err(Defect::Empty { given: triangles.len() });
    }
    check_edges(&vertices, &faces)?;

    let v = |i: u32| vertices[i as usize];
    let six_volumes: f64 = faces.iter().map(|f| v(f[0]).dot(v(f[1]).cross(v(f[2])))).sum();
    if six_volumes < 0.0 {
        faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    Ok(Solid { vertices, triangles: faces })
}

fn weld(corners: &[DVec3], tolerance: f64) -> (Vec<DVec3>, Vec<u32>) {
    let cell = |p: DVec3| (p / tolerance).floor().as_i64vec3();
    let mut cells: HashMap<glam::I64Vec3, Vec<u32>> = HashMap::new();
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut indices = Vec::with_capacity(corners.len());
    for &p in corners {
        let c = cell(p);
        let around = (-1..=1).flat_map(|z| (-1..=1).flat_map(move |y| (-1..=1).map(move |x| (x, y, z))));
        let known = std::iter::once((0, 0, 0)).chain(around).find_map(|(x, y, z)| {
            let near = cells.get(&(c + glam::I64Vec3::new(x, y, z)))?;
            near.iter().copied().find(|&i| vertices[i as usize].distance(p) <= tolerance)
        });
        indices.push(known.unwrap_or_else(|| {
            let index = vertices.len() as u32;
            vertices.push(p);
            cells.entry(c).or_default().push(index);
            index
        }));
    }
    (vertices, indices)
}

fn check_edges(vertices: &[DVec3], faces: &[[u32; 3]]) -> Result<(), Defect> {
    // How often each edge is walked forwards (from the lower index) and backwards.
    let mut walked: HashMap<(u32, u32), (u32, u32)> = HashMap::new();
    for f in faces {
        for k in 0..3 {
            let (a, b) = (f[k], f[(k + 1) % 3]);
            let count = walked.entry((a.min(b), a.max(b))).or_default();
            if a < b { count.0 += 1 } else { count.1 += 1 }
        }
    }
    let mut edges: Vec<_> = walked.into_iter().collect();
    edges.sort_unstable();
    let find = |wrong: &dyn Fn(u32, u32) -> bool| {
        let bad: Vec<_> = edges.iter().filter(|(_, (f, b))| wrong(*f, *b)).collect();
        bad.first().map(|((a, b), _)| (bad.len(), vertices[*a as usize], vertices[*b as usize]))
    };
    if let Some((count, from, to)) = find(&|f, b| f + b > 2) {
        return Err(Defect::NonManifold { count, from, to });
    }
    if let Some((count, from, to)) = find(&|f, b| f + b == 1) {
        return Err(Defect::OpenEdges { count, from, to });
    }
    if let Some((count, from, to)) = find(&|f, b| f != b) {
        return Err(Defect::Orientation { count, from, to });
    }
    Ok(())
}
