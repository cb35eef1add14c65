//! Whether a closed mesh bounds one solid: every part encloses a volume, it does not cut through itself, and no part of it lies
//! in another or is inside out. Cavities are filled: no pad reaches them, and a thin wall would let one through.

use super::Defect;
use super::mesh::Mesh;
use super::topology::Solid;
use glam::DVec3;
use rayon::prelude::*;

/// Least mean thickness of a part, over its diagonal: what is thinner is a surface that closes by folding back. Ten times what
/// welding may take off; a foil of 20 um that is 10 mm square has over a hundred times as much as this.
const THINNEST: f64 = 1e-5;
/// Triangles of each part that are asked what lies outside them.
const ASKED: usize = 64;
/// How far outside, over the mesh's diagonal.
const OUTSIDE: f64 = 1e-5;
/// Directions without meaning, so that few rays meet an edge; each is asked whether the one before may have.
const DIRECTIONS: [DVec3; 3] =
    [DVec3::new(0.537, 0.321, 0.780), DVec3::new(-0.713, 0.467, 0.523), DVec3::new(0.179, -0.851, 0.494)];

/// Proves that a mesh bounds a solid; the same without its cavities, if it has any.
///
/// # Errors
/// [`Defect::Flat`], [`Defect::Crossing`] and [`Defect::Misplaced`].
pub fn check(mesh: &Mesh, solid: &Solid) -> Result<Option<Solid>, Defect> {
    let at = |i: u32| solid.vertices[i as usize];
    let (part_of, parts) = parts(solid);
    let mut members = vec![Vec::new(); parts];
    for (k, part) in part_of.iter().enumerate() {
        members[*part].push(k);
    }
    let six_volumes = |triangles: &[usize]| -> f64 {
        triangles.iter().map(|k| solid.triangles[*k].map(at)).map(|[a, b, c]| a.dot(b.cross(c))).sum()
    };
    for triangles in &members {
        let faces = || triangles.iter().map(|k| solid.triangles[*k].map(at));
        let twice_area: f64 = faces().map(|[a, b, c]| (b - a).cross(c - a).length()).sum();
        let (low, high) = super::bounds(&faces().flatten().collect::<Vec<_>>());
        let across_mm = (high - low).length();
        // A plate's volume over half its area.
        let thickness_mm = six_volumes(triangles).abs() / 1.5 / twice_area.max(f64::MIN_POSITIVE);
        if thickness_mm < THINNEST * across_mm {
            let near = at(solid.triangles[triangles[0]][0]);
            return Err(Defect::Flat { parts, near, across_mm, thickness_mm });
        }
    }
    // Each edge is walked once from its lower to its higher index.
    let crossed = solid.triangles.par_iter().find_map_first(|t| {
        let edges = [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        edges.into_iter().filter(|[a, b]| a < b).find(|[a, b]| mesh.is_crossed(at(*a), at(*b)))
    });
    if let Some([from, to]) = crossed {
        return Err(Defect::Crossing { from: at(from), to: at(to) });
    }
    let (low, high) = super::bounds(&solid.vertices);
    let outside = (high - low).length() * OUTSIDE;
    for triangles in &members {
        for k in triangles.iter().step_by(triangles.len().div_ceil(ASKED)) {
            let [a, b, c] = solid.triangles[*k].map(at);
            let (middle, normal) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero());
            let point = middle + normal * outside;
            if normal != DVec3::ZERO && DIRECTIONS.iter().all(|d| mesh.winding(point, *d) != 0) {
                return Err(Defect::Misplaced { parts, near: middle });
            }
        }
    }
    // What is left inside out bounds a cavity.
    let cavity: Vec<bool> = members.iter().map(|triangles| six_volumes(triangles) < 0.0).collect();
    Ok(cavity.contains(&true).then(|| {
        let kept = solid.triangles.iter().zip(&part_of).filter(|(_, part)| !cavity[**part]);
        Solid { vertices: solid.vertices.clone(), triangles: kept.map(|(t, _)| *t).collect() }
    }))
}

/// The connected part that each triangle belongs to, and how many there are.
fn parts(solid: &Solid) -> (Vec<usize>, usize) {
    let mut parent: Vec<u32> = (0..solid.vertices.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for t in &solid.triangles {
        let first = root(&mut parent, t[0]);
        for k in &t[1..] {
            let other = root(&mut parent, *k);
            parent[other as usize] = first;
        }
    }
    let mut number = std::collections::HashMap::new();
    let of_triangle = solid.triangles.iter().map(|t| {
        let next = number.len();
        *number.entry(root(&mut parent, t[0])).or_insert(next)
    });
    let of_triangle: Vec<usize> = of_triangle.collect();
    (of_triangle, number.len())
}
