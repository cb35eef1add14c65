//! Rays against triangles: an obvhs eight-wide tree over full-precision triangles.
//!
//! The triangle test is the Pluecker form over vertices relative to the ray's origin (the form that Embree's
//! robust mode uses): the sign at an edge is computed from the same numbers by both triangles that share it, so
//! no ray slips between them. obvhs' own packed triangle keeps edges in 16 bits, too coarse for shading by normals.

use glam::{Vec3, Vec3A};
use obvhs::{
    BvhBuildParams, aabb::Aabb, bvh2::reinsertion::ReinsertionOptimizer, cwbvh::CwBvh,
    cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh, ploc::PlocBuilder, ray::Ray, ray::RayHit,
};

/// Where a ray hit first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// Index of the triangle in the list the tree was built from.
    pub triangle: u32,
    /// The point, from the triangle's corners (so it lies in its plane to rounding).
    pub point: Vec3,
    /// Weights of the second and third corner.
    pub barycentric: [f32; 2],
    /// Geometric unit normal, (b - a) x (c - a).
    pub normal: Vec3,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corners: [Vec3A; 3],
}

/// Distance along the ray and Pluecker weights of the three corners, if the triangle is hit in [tmin, tmax).
#[inline(always)]
fn intersect(tri: &Triangle, ray: &Ray) -> Option<(f32, [f32; 3])> {
    let [a, b, c] = tri.corners;
    let (a, b, c) = (a - ray.origin, b - ray.origin, c - ray.origin);
    let (e0, e1, e2) = (c - a, a - b, b - c);
    // Each is twice the signed volume over the edge opposite to the corner it weighs.
    let on_b = e0.cross(c + a).dot(ray.direction);
    let on_c = e1.cross(a + b).dot(ray.direction);
    let on_a = e2.cross(b + c).dot(ray.direction);
    let inside = on_a.min(on_b).min(on_c) >= 0.0 || on_a.max(on_b).max(on_c) <= 0.0;
    if !inside {
        return None;
    }
    let normal = e1.cross(e0);
    let along = normal.dot(ray.direction);
    let t = normal.dot(a) / along;
    // A ray in the triangle's plane gives 0/0 or an infinity: both fail here.
    (t >= ray.tmin && t < ray.tmax).then_some((t, [on_a, on_b, on_c]))
}

/// Margin around the boxes of the tree, relative to the largest coordinate.
const MARGIN: f32 = 1e-6;

/// A tree over triangles.
#[derive(Debug, Clone)]
pub struct Accel {
    bvh: CwBvh,
    /// In the order of the tree's slots.
    triangles: Vec<Triangle>,
    /// Index in the caller's list, by slot.
    source: Vec<u32>,
}

impl Accel {
    /// Builds the tree. Triangles without area are left out: no ray can hit them.
    pub fn new(corners: &[[Vec3; 3]]) -> Self {
        let mut kept = Vec::with_capacity(corners.len());
        let mut boxes = Vec::with_capacity(corners.len());
        // obvhs' slab test is not conservative: a ray through a corner that lies on the faces of its boxes
        // can miss them all. A margin above the rounding of that test closes the gap.
        let extent = corners.iter().flatten().fold(0.0f32, |m, p| m.max(p.abs().max_element()));
        let margin = Vec3A::splat(extent * MARGIN);
        for (k, tri) in corners.iter().enumerate() {
            let [a, b, c] = tri.map(Vec3A::from);
            if (b - a).cross(c - a) != Vec3A::ZERO {
                kept.push(k as u32);
                let tight = Aabb::from_points(&[a, b, c]);
                boxes.push(Aabb::new(tight.min - margin, tight.max + margin));
            }
        }
        if kept.is_empty() {
            return Self { bvh: CwBvh::default(), triangles: Vec::new(), source: Vec::new() };
        }
        let params = BvhBuildParams::medium_build();
        let mut bvh2 = PlocBuilder::with_capacity(boxes.len()).build(
            params.ploc_search_distance,
            &boxes,
            (0..boxes.len() as u32).collect(),
            params.sort_precision,
            params.search_depth_threshold,
        );
        ReinsertionOptimizer::default().run(&mut bvh2, params.reinsertion_batch_ratio, None);
        let bvh = bvh2_to_cwbvh(&bvh2, params.max_prims_per_leaf.clamp(1, 3), true, false);
        let source: Vec<u32> = bvh.primitive_indices.iter().map(|&p| kept[p as usize]).collect();
        let triangles =
            source.iter().map(|&k| Triangle { corners: corners[k as usize].map(Vec3A::from) }).collect();
        Self { bvh, triangles, source }
    }

    /// The first triangle along the ray with 0 <= t < `t_max`.
    #[inline]
    pub fn hit(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<Hit> {
        if self.triangles.is_empty() {
            return None;
        }
        let ray = Ray::new(origin.into(), direction.into(), 0.0, t_max);
        let mut found = RayHit::none();
        let mut weights = [0.0; 3];
        let any =
            self.bvh.ray_traverse(ray, &mut found, |ray, slot| match intersect(&self.triangles[slot], ray) {
                Some((t, w)) => {
                    weights = w;
                    t
                }
                None => f32::INFINITY,
            });
        if !any {
            return None;
        }
        let slot = found.primitive_id as usize;
        let [a, b, c] = self.triangles[slot].corners;
        let scale = 1.0 / (weights[0] + weights[1] + weights[2]);
        let barycentric = [weights[1] * scale, weights[2] * scale];
        let point = a + (b - a) * barycentric[0] + (c - a) * barycentric[1];
        let normal = (b - a).cross(c - a).normalize();
        Some(Hit {
            t: found.t,
            triangle: self.source[slot],
            point: point.into(),
            barycentric,
            normal: normal.into(),
        })
    }

    /// Whether anything lies on the open segment from `from` to `to`.
    #[inline]
    pub fn blocked(&self, from: Vec3, to: Vec3) -> bool {
        if self.triangles.is_empty() {
            return false;
        }
        let ray = Ray::new(from.into(), (to - from).into(), 0.0, 1.0);
        !self.bvh.ray_traverse_miss(ray, |ray, slot| {
            intersect(&self.triangles[slot], ray).map_or(f32::INFINITY, |(t, _)| t)
        })
    }
}

/// Whether the segment may touch the box; never false when it does.
#[inline]
pub fn overlaps([lo, hi]: &[Vec3; 2], from: Vec3, to: Vec3) -> bool {
    let inverse = (to - from).recip();
    let (a, b) = ((*lo - from) * inverse, (*hi - from) * inverse);
    let enter = a.min(b).max_element().max(0.0);
    let leave = a.max(b).min_element().min(1.0);
    // What cannot be compared (0 times infinity) counts as an overlap.
    enter.partial_cmp(&leave) != Some(std::cmp::Ordering::Greater)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Mesh, sampler::Sampler};

    fn bumpy(height: f32) -> Vec<[Vec3; 3]> {
        let n = 61;
        let at = |k: usize| {
            let (x, y) = ((k % n) as f32 / 6.0 - 5.0, (k / n) as f32 / 6.0 - 5.0);
            Vec3::new(x, y, height * (x * 1.3).sin() * (y * 0.9).cos())
        };
        let mesh = Mesh::from_lattice(n, n, (0..n * n).map(at).collect(), Vec::new());
        (0..mesh.triangles.len()).map(|k| mesh.corners(k)).collect()
    }

    #[test]
    fn the_tree_finds_what_a_loop_over_all_triangles_finds() {
        let triangles = bumpy(1.0);
        let accel = Accel::new(&triangles);
        let s = Sampler::new(3, 0, 0, 512);
        for i in 0..512 {
            let p = s.group(i, 0);
            let origin = Vec3::new(p[0] * 12.0 - 6.0, p[1] * 12.0 - 6.0, 3.0);
            let q = s.group(i, 1);
            let direction = Vec3::new(q[0] - 0.5, q[1] - 0.5, -q[2] - 0.05).normalize();
            let ray = Ray::new(origin.into(), direction.into(), 0.0, f32::INFINITY);
            let truth = triangles
                .iter()
                .filter_map(|t| intersect(&Triangle { corners: t.map(Vec3A::from) }, &ray))
                .map(|(t, _)| t)
                .fold(f32::INFINITY, f32::min);
            match accel.hit(origin, direction, f32::INFINITY) {
                None => assert_eq!(truth, f32::INFINITY),
                Some(hit) => {
                    assert!((hit.t - truth).abs() < 1e-5);
                    assert!((hit.point - (origin + direction * hit.t)).length() < 1e-5);
                    assert!(accel.blocked(origin, origin + direction * (truth * 1.001)));
                    assert!(!accel.blocked(origin, origin + direction * (truth * 0.999)));
                }
            }
        }
    }

    #[test]
    fn nothing_leaks_through_shared_edges_and_corners() {
        // Low enough that the eye sees no silhouette, where a ray may rightly pass by.
        let triangles = bumpy(0.3);
        let accel = Accel::new(&triangles);
        for [a, b, _] in &triangles {
            for at in [*a, (*a + *b) / 2.0] {
                if at.abs().truncate().max_element() < 4.9 {
                    let origin = Vec3::new(0.3, -0.2, 7.0);
                    let hit = accel.hit(origin, (at - origin).normalize(), f32::INFINITY);
                    assert!(hit.is_some_and(|h| (h.point - at).length() < 1e-4), "{at}: {hit:?}");
                }
            }
        }
    }

    #[test]
    fn no_triangles_and_flat_triangles_are_never_hit() {
        assert!(Accel::new(&[]).hit(Vec3::ZERO, Vec3::Z, f32::INFINITY).is_none());
        let flat = Accel::new(&[[Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z - Vec3::X]]);
        assert!(flat.hit(Vec3::ZERO, Vec3::Z, f32::INFINITY).is_none());
        assert!(!flat.blocked(Vec3::ZERO, Vec3::Z * 2.0));
    }
}
