//! From loose triangles to a closed, consistently oriented solid, or to the name of the defect.
//!
//! STL repeats every corner in every triangle. Corners within a millionth of the mesh's size are one
//! corner. Then each directed edge must occur once and so must its reverse: that is what closed,
//! manifold and consistently oriented mean for a mesh. A mesh that is wholly inside out is turned.

use super::Defect;
use glam::{DVec3, I64Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

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

/// Cells are so many tolerances wide: most corners are looked for in one.
const CELL: f64 = 16.0;

/// Positions of the corners that are further apart than the tolerance, and which of them each corner is.
fn weld(corners: &[DVec3], tolerance: f64) -> (Vec<DVec3>, Vec<u32>) {
    let cell = |p: DVec3| (p / (CELL * tolerance)).floor().as_i64vec3();
    // The latest vertex of each cell, and the one before it in the same cell.
    let mut latest: HashMap<I64Vec3, u32, BuildHasherDefault<Places>> = HashMap::default();
    let (mut vertices, mut before): (Vec<DVec3>, Vec<Option<u32>>) = (Vec::new(), Vec::new());
    let mut indices = Vec::with_capacity(corners.len());
    for &p in corners {
        let (low, high) = (cell(p - tolerance), cell(p + tolerance));
        let (xs, ys) = (low.x..=high.x, low.y..=high.y);
        let around = (low.z..=high.z).flat_map(|z| ys.clone().map(move |y| (y, z)));
        let mut around = around.flat_map(|(y, z)| xs.clone().map(move |x| I64Vec3::new(x, y, z)));
        let known = around.find_map(|c| {
            let near = std::iter::successors(latest.get(&c).copied(), |i| before[*i as usize]);
            near.into_iter().find(|i| vertices[*i as usize].distance(p) <= tolerance)
        });
        indices.push(known.unwrap_or_else(|| {
            let index = vertices.len() as u32;
            vertices.push(p);
            before.push(latest.insert(cell(p), index));
            index
        }));
    }
    (vertices, indices)
}

/// Hashes places of a grid: who writes a mesh gains nothing by making them collide, so quick is enough.
#[derive(Default)]
struct Places(u64);

impl Hasher for Places {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|b| self.write_u64(u64::from(*b)));
    }

    fn write_u64(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn write_i64(&mut self, word: i64) {
        self.write_u64(word.cast_unsigned());
    }
}

/// The sides of all triangles, those of one edge beside each other: the edge's corners, the lower index first, and three times
/// the triangle plus the side (0 from its first corner to its second).
pub fn sides(faces: &[[u32; 3]]) -> Vec<([u32; 2], u32)> {
    let side = |(k, f): (usize, &[u32; 3])| {
        let f = *f;
        [0, 1, 2].map(|s| {
            let (a, b) = (f[s], f[(s + 1) % 3]);
            ([a.min(b), a.max(b)], (3 * k + s) as u32)
        })
    };
    let mut all: Vec<_> = faces.par_iter().enumerate().flat_map_iter(side).collect();
    all.par_sort_unstable();
    all
}

fn check_edges(vertices: &[DVec3], faces: &[[u32; 3]]) -> Result<(), Defect> {
    let sides = sides(faces);
    let edges = || sides.chunk_by(|a, b| a.0 == b.0);
    // How often an edge is walked forwards (from the lower index) and in all.
    let walked = |edge: &[([u32; 2], u32)]| {
        let forwards = |side: u32| faces[side as usize / 3][side as usize % 3] == edge[0].0[0];
        (edge.iter().filter(|(_, side)| forwards(*side)).count(), edge.len())
    };
    let find = |wrong: &dyn Fn(usize, usize) -> bool| {
        let mut bad = edges().filter(|edge| {
            let (forwards, all) = walked(edge);
            wrong(forwards, all)
        });
        let [from, to] = bad.next()?[0].0.map(|i| vertices[i as usize]);
        Some((1 + bad.count(), from, to))
    };
    if let Some((count, from, to)) = find(&|_, all| all > 2) {
        return Err(Defect::NonManifold { count, from, to });
    }
    if let Some((count, from, to)) = find(&|_, all| all == 1) {
        return Err(Defect::OpenEdges { count, from, to });
    }
    if let Some((count, from, to)) = find(&|forwards, all| 2 * forwards != all) {
        return Err(Defect::Orientation { count, from, to });
    }
    Ok(())
}
