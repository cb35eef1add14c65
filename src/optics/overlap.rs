//! Whether two meshes cut each other, or lie in the same place.

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

/// Part of the extent of two meshes by which what lies in one plane may be off it.
const FLAT: f64 = 1e-5;

/// Whether a triangle of one and a triangle of the other lie in one plane and share a part of it.
pub fn coincide(a: &Mesh, b: &Mesh) -> bool {
    let extent = |mesh: &Mesh| {
        let [low, high] = bounds(&mesh.positions);
        f64::from((high - low).max_element())
    };
    let far = a.positions.iter().chain(&b.positions).fold(0.0f32, |far, p| far.max(p.abs().max_element()));
    let off = FLAT * extent(a).max(extent(b)) + f64::from(2.0 * f32::EPSILON * far);
    let [[a_low, a_high], theirs] = [a, b].map(|mesh| bounds(&mesh.positions));
    if !meet([a_low - off as f32, a_high + off as f32], theirs) {
        return false;
    }
    let corners = |mesh: &Mesh, k: usize| mesh.corners(k).map(|p| p.as_dvec3());
    (0..a.triangles.len()).map(|k| corners(a, k)).any(|t| {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]).normalize_or_zero();
        (0..b.triangles.len()).map(|k| corners(b, k)).any(|u| {
            u.iter().all(|p| (*p - t[0]).dot(normal).abs() <= off) && share_a_part(t, u, normal, off)
        })
    })
}

/// Whether two triangles in a plane share more than an edge: no line along an edge of either parts them.
fn share_a_part(t: [DVec3; 3], u: [DVec3; 3], normal: DVec3, off: f64) -> bool {
    [t, u].iter().all(|of| {
        (0..3).all(|k| {
            let aside = (of[(k + 1) % 3] - of[k]).cross(normal).normalize_or_zero();
            let [[t_low, t_high], [u_low, u_high]] = [t, u].map(|triangle| {
                let along = triangle.map(|p| p.dot(aside));
                [
                    along.into_iter().fold(f64::INFINITY, f64::min),
                    along.into_iter().fold(-f64::INFINITY, f64::max),
                ]
            });
            t_low + off < u_high && u_low + off < t_high
        })
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

    #[test]
    fn sheets_that_share_a_part_of_a_plane_coincide() {
        let sheet = |x: f32, z: f32| Mesh::parallelogram(Vec3::new(x, -1.0, z), Vec3::X * 2.0, Vec3::Y * 2.0);
        assert!(coincide(&sheet(0.0, 0.0), &sheet(1.5, 0.0)) && coincide(&sheet(1.5, 0.0), &sheet(0.0, 0.0)));
        // Side by side, one before the other, and one through the other.
        assert!(!coincide(&sheet(0.0, 0.0), &sheet(2.0, 0.0)));
        assert!(!coincide(&sheet(0.0, 0.0), &sheet(1.5, 1e-3)));
        let upright = Mesh::parallelogram(Vec3::new(1.0, -1.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 2.0);
        assert!(!coincide(&sheet(0.0, 0.0), &upright));
        // One within the other, turned about.
        let small = Mesh::parallelogram(Vec3::new(0.5, 0.0, 0.0), Vec3::Y * 0.2, Vec3::X * 0.2);
        assert!(coincide(&sheet(0.0, 0.0), &small) && coincide(&small, &sheet(0.0, 0.0)));
    }
}
