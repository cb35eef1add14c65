//! Walls, parted at the level of a pad's face: above it they are lit, in the gap beside the pad hardly; and at the faces of a plate. A
//! patch that reached from one into the other would be neither.

use super::plate::Slab;
use crate::optics::{Mesh, Role, Scene};
use glam::Vec3;

/// A face counts as level whose points differ by less in height, mm.
const LEVEL_MM: f32 = 0.02;

/// Height of the pad's face; None where it is curved.
pub fn level_of(scene: &Scene) -> Option<f32> {
    let pad = scene.surface(Role::Pad)?;
    let heights = pad.mesh.positions.iter().map(|p| p.z);
    let [low, high] = heights.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], z| [l.min(z), h.max(z)]);
    (high - low < LEVEL_MM).then_some(0.5 * (low + high))
}

/// Levels at which walls are cut: that of the pad's face, and those of a plate's faces. (In the plate there is less light, as radiance is
/// counted there.)
pub fn levels(scene: &Scene, slab: Option<Slab>) -> Vec<f32> {
    level_of(scene).into_iter().chain(slab.into_iter().flat_map(|slab| [slab.low, slab.high])).collect()
}

/// A mesh cut at all these levels.
pub fn cut_at(mesh: &Mesh, levels: &[f32]) -> Vec<Mesh> {
    levels.iter().fold(vec![mesh.clone()], |parts, level| {
        let halves = parts.iter().flat_map(|part| parted(part, *level));
        halves.filter(|part| !part.triangles.is_empty()).collect()
    })
}

/// What of a mesh is above a level, and what below it.
fn parted(mesh: &Mesh, level: f32) -> [Mesh; 2] {
    [1.0, -1.0].map(|side| {
        let mut part = Mesh::default();
        for k in 0..mesh.triangles.len() {
            let corners = mesh.corners(k);
            let above = |p: Vec3| side * (p.z - level);
            let mut polygon = Vec::with_capacity(4);
            for (p, q) in [(0, 1), (1, 2), (2, 0)].map(|(p, q)| (corners[p], corners[q])) {
                let (a, b) = (above(p), above(q));
                if a >= 0.0 {
                    polygon.push(p);
                }
                if a * b < 0.0 {
                    polygon.push(p + (q - p) * (a / (a - b)));
                }
            }
            // (What touches the level with an edge or a corner alone has no area there.)
            if polygon.len() < 3 || polygon.iter().all(|p| above(*p) <= 0.0) {
                continue;
            }
            let first = part.positions.len() as u32;
            part.positions.extend_from_slice(&polygon);
            part.triangles.extend((2..polygon.len() as u32).map(|k| [first, first + k - 1, first + k]));
        }
        part
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_between_levels_are_the_whole() {
        let walls = Mesh::open_box(Vec3::new(-3.0, -2.0, -0.5), Vec3::new(3.0, 2.0, 7.0));
        let area = |mesh: &Mesh| (0..mesh.triangles.len()).map(|k| mesh.area(k)).sum::<f32>();
        let strips = cut_at(&walls, &[0.0, 1.5, 3.5]);
        let mut found: Vec<f32> = strips.iter().map(area).collect();
        found.sort_by(f32::total_cmp);
        let top = found.pop().unwrap();
        assert!(found.iter().zip([10.0, 30.0, 40.0]).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}");
        assert!(found.len() == 3 && (top + 80.0 - area(&walls)).abs() < 1e-3);
        assert!(area(&cut_at(&walls, &[])[0]) == area(&walls));
    }

    #[test]
    fn parts_are_the_whole_and_lie_on_their_sides() {
        let walls = Mesh::open_box(Vec3::new(-3.0, -2.0, -0.5), Vec3::new(3.0, 2.0, 7.0));
        let area = |mesh: &Mesh| (0..mesh.triangles.len()).map(|k| mesh.area(k)).sum::<f32>();
        let [above, below] = parted(&walls, 0.0);
        assert!((area(&below) - 0.5 * 20.0).abs() < 1e-4, "{}", area(&below));
        assert!((area(&above) + area(&below) - area(&walls)).abs() < 1e-3);
        assert!(above.positions.iter().all(|p| p.z > -1e-6) && below.positions.iter().all(|p| p.z < 1e-6));
        // Normals stay inwards.
        let middle = Vec3::Z * 3.0;
        for mesh in [above, below] {
            for [a, b, c] in (0..mesh.triangles.len()).map(|k| mesh.corners(k)) {
                assert!((b - a).cross(c - a).dot(middle - a) > 0.0);
            }
        }
        // What a level runs along stays whole.
        let [whole, none] = parted(&walls, -0.5);
        assert!((area(&whole) - area(&walls)).abs() < 1e-3 && none.triangles.is_empty());
    }
}
