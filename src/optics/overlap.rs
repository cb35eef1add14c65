//! Whether two meshes cut each other.

use super::Mesh;
use glam::{DVec3, Vec3};

/// Whether a triangle of one crosses a triangle of the other.
pub fn cut(a: &Mesh, b: &Mesh) -> bool {
    let all = bounds(&b.positions);
    let mut near = (0..a.triangles.len()).map(|k| a.corners(k)).filter(|t| meet(bounds(t), all));
    near.any(|t| {
        let its = bounds(&t);
        (0..b.triangles.len())
            .map(|k| b.corners(k))
            .any(|u| meet(its, bounds(&u)) && (edges_cross(t, u) || edges_cross(u, t)))
    })
}

fn bounds(points: &[Vec3]) -> [Vec3; 2] {
    let inf = Vec3::splat(f32::INFINITY);
    points.iter().fold([inf, -inf], |[low, high], p| [low.min(*p), high.max(*p)])
}

fn meet([a_low, a_high]: [Vec3; 2], [b_low, b_high]: [Vec3; 2]) -> bool {
    a_low.cmple(b_high).all() && b_low.cmple(a_high).all()
}

/// Whether an edge of one triangle passes through another (Moeller and Trumbore 1997).
fn edges_cross(of: [Vec3; 3], through: [Vec3; 3]) -> bool {
    let (of, [a, b, c]) = (of.map(|p| p.as_dvec3()), through.map(|p| p.as_dvec3()));
    let (u, v) = (b - a, c - a);
    let crosses = |from: DVec3, to: DVec3| {
        let along = to - from;
        let across = along.cross(v);
        let volume = u.dot(across);
        if volume == 0.0 {
            return false;
        }
        let off = from - a;
        let (s, q) = (off.dot(across) / volume, off.cross(u));
        let (r, t) = (along.dot(q) / volume, v.dot(q) / volume);
        s >= 0.0 && r >= 0.0 && s + r <= 1.0 && (0.0..=1.0).contains(&t)
    };
    (0..3).any(|k| crosses(of[k], of[(k + 1) % 3]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_that_cross_are_told_from_those_that_do_not() {
        let floor = |z: f32| Mesh::parallelogram(Vec3::new(-5.0, -5.0, z), Vec3::X * 10.0, Vec3::Y * 10.0);
        let block = Mesh::cuboid(Vec3::new(-1.0, -1.0, 1.0), Vec3::new(1.0, 1.0, 2.0));
        assert!(!cut(&floor(0.9), &block) && !cut(&block, &floor(2.1)));
        assert!(cut(&floor(1.5), &block) && cut(&block, &floor(1.5)));
        // A sheet that dips through: no corner of the floor is near it.
        let sheet = Mesh::parallelogram(Vec3::new(-1.0, 0.2, -0.1), Vec3::X * 2.0, Vec3::Z);
        assert!(cut(&floor(0.0), &sheet) && !cut(&floor(-0.2), &sheet));
        // Within the box of another, but beside it.
        let slope = Mesh::parallelogram(Vec3::new(-2.0, -2.0, -2.0), Vec3::new(4.0, 0.0, 4.0), Vec3::Y * 4.0);
        let speck = Mesh::cuboid(Vec3::new(-1.5, 0.0, 1.0), Vec3::new(-1.0, 0.5, 1.5));
        assert!(!cut(&slope, &speck));
    }
}
