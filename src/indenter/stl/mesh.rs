//! Signed distance to a closed triangle mesh.
//!
//! A binary hierarchy of boxes (median split along the longest side, built in parallel) finds the
//! nearest triangle; whether its nearest point is in the face, on an edge or at a corner decides which
//! pseudonormal tells inside from outside.

use super::topology::{self, Solid};
use crate::indenter::{Indenter, thin};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Triangles in a leaf.
const LEAF: usize = 4;

/// Triangles that are not worth another thread.
const ALONE: usize = 4096;

/// What goes less far through a face only touches it, over the mesh's diagonal.
const TOUCHING: f64 = 1e-6;

/// A mesh that answers distance queries.
#[derive(Debug)]
pub struct Mesh {
    name: String,
    triangles: Vec<Triangle>,
    root: Node,
    half_extent: DVec2,
    height_mm: f64,
    thin_parts: OnceLock<Vec<DVec3>>,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corners: [DVec3; 3],
    /// Pseudonormals (any length): face, edges (0 to 1, 1 to 2, 2 to 0), corners.
    face: DVec3,
    edges: [DVec3; 3],
    vertices: [DVec3; 3],
}

#[derive(Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// Range of triangles below this node.
    range: std::ops::Range<usize>,
    children: Option<Box<[Node; 2]>>,
}

impl Mesh {
    /// Builds the hierarchy and the pseudonormals.
    pub fn new(name: &str, solid: &Solid) -> Mesh {
        let at = |i: u32| solid.vertices[i as usize];
        let face_normals: Vec<DVec3> = solid
            .triangles
            .par_iter()
            .map(|t| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).normalize_or_zero())
            .collect();

        // Angle-weighted at corners, plain sums at edges.
        let mut at_vertex = vec![DVec3::ZERO; solid.vertices.len()];
        for (t, &n) in solid.triangles.iter().zip(&face_normals) {
            for k in 0..3 {
                let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                at_vertex[a as usize] += n * (at(b) - at(a)).angle_between(at(c) - at(a));
            }
        }
        let mut at_side = vec![[DVec3::ZERO; 3]; face_normals.len()];
        for edge in topology::sides(&solid.triangles).chunk_by(|a, b| a.0 == b.0) {
            let sum: DVec3 = edge.iter().map(|(_, side)| face_normals[*side as usize / 3]).sum();
            edge.iter().for_each(|(_, side)| at_side[*side as usize / 3][*side as usize % 3] = sum);
        }

        // The hierarchy is built over something smaller than triangles, which then follow its order.
        let placed =
            |(k, t): (usize, &[u32; 3])| Placed { middle: t.map(at).iter().sum(), triangle: k as u32 };
        let mut order: Vec<Placed> = solid.triangles.par_iter().enumerate().map(placed).collect();
        split(&mut order);
        let triangle = |placed: &Placed| {
            let k = placed.triangle as usize;
            let t = solid.triangles[k];
            Triangle {
                corners: t.map(at),
                face: face_normals[k],
                edges: at_side[k],
                vertices: t.map(|i| at_vertex[i as usize]),
            }
        };
        let triangles: Vec<Triangle> = order.par_iter().map(triangle).collect();
        let root = Node::over(&triangles, 0);

        let (low, high) = super::bounds(&solid.vertices);
        let reach = low.abs().max(high.abs());
        let half_extent = DVec2::new(reach.x, reach.y);
        let (name, thin_parts) = (name.to_owned(), OnceLock::new());
        Mesh { name, triangles, root, half_extent, height_mm: high.z, thin_parts }
    }

    /// Whether an edge from `a` to `b` goes through a triangle that does not end in it.
    pub fn is_crossed(&self, a: DVec3, b: DVec3) -> bool {
        let slack = (self.root.high - self.root.low).length() * TOUCHING;
        let (low, high) = (a.min(b), a.max(b));
        let mut stack = vec![&self.root];
        while let Some(node) = stack.pop() {
            if node.low.cmpgt(high).any() || node.high.cmplt(low).any() {
                continue;
            }
            if let Some(children) = &node.children {
                stack.extend(children.iter());
                continue;
            }
            let triangles = &self.triangles[node.range.clone()];
            if triangles
                .iter()
                .any(|t| !t.corners.contains(&a) && !t.corners.contains(&b) && t.is_cut(a, b, slack))
            {
                return true;
            }
        }
        false
    }

    /// How often the mesh goes around a point, counted along a direction: 1 inside a solid, 0 outside.
    pub fn winding(&self, point: DVec3, direction: DVec3) -> i32 {
        let (mut count, mut stack) = (0, vec![&self.root]);
        while let Some(node) = stack.pop() {
            let (s, t) = ((node.low - point) / direction, (node.high - point) / direction);
            let (enter, leave) = (s.min(t).max_element(), s.max(t).min_element());
            if leave < enter.max(0.0) {
                continue;
            }
            match &node.children {
                Some(children) => stack.extend(children.iter()),
                None => {
                    let met = |t: &Triangle| t.met_along(point, direction);
                    count += self.triangles[node.range.clone()].iter().map(met).sum::<i32>();
                }
            }
        }
        count
    }

    /// The nearest surface point and the pseudonormal there.
    fn nearest(&self, p: DVec3) -> (DVec3, DVec3) {
        let mut best = (f64::INFINITY, DVec3::ZERO, DVec3::Z);
        let mut stack = vec![&self.root];
        while let Some(node) = stack.pop() {
            if node.gap_squared(p) >= best.0 {
                continue;
            }
            if let Some(children) = &node.children {
                let [near, far] = &**children;
                let swap = near.gap_squared(p) > far.gap_squared(p);
                stack.extend(if swap { [near, far] } else { [far, near] });
                continue;
            }
            for triangle in &self.triangles[node.range.clone()] {
                let (q, n) = triangle.nearest(p);
                let d2 = p.distance_squared(q);
                if d2 < best.0 {
                    best = (d2, q, n);
                }
            }
        }
        (best.1, best.2)
    }
}

impl Indenter for Mesh {
    fn name(&self) -> &str {
        &self.name
    }

    fn distance(&self, p: DVec3) -> f64 {
        self.distance_and_normal(p).0
    }

    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let (q, pseudonormal) = self.nearest(p);
        let away = p - q;
        let d = away.length();
        if d < 1e-9 {
            return (0.0, pseudonormal.normalize_or(DVec3::NEG_Z));
        }
        let sign = if away.dot(pseudonormal) < 0.0 { -1.0 } else { 1.0 };
        (sign * d, away * (sign / d))
    }

    fn half_extent_mm(&self) -> [f64; 2] {
        self.half_extent.into()
    }

    fn height_mm(&self) -> f64 {
        self.height_mm
    }

    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let at = DVec2::new(x_mm, y_mm);
        let mut lowest: Option<f64> = None;
        let mut stack = vec![&self.root];
        while let Some(node) = stack.pop() {
            let beside = at.cmplt(node.low.truncate()).any() || at.cmpgt(node.high.truncate()).any();
            if beside || lowest.is_some_and(|z| z <= node.low.z) {
                continue;
            }
            if let Some(children) = &node.children {
                stack.extend(children.iter());
                continue;
            }
            for triangle in &self.triangles[node.range.clone()] {
                if let Some(z) = triangle.height_at(at) {
                    lowest = Some(lowest.map_or(z, |l| l.min(z)));
                }
            }
        }
        lowest
    }

    fn thin_parts(&self) -> &[DVec3] {
        self.thin_parts.get_or_init(|| thin::parts(self))
    }
}

/// A triangle on its way to its place in the hierarchy.
#[derive(Clone, Copy)]
struct Placed {
    /// Three times its middle.
    middle: DVec3,
    triangle: u32,
}

/// Sorts triangles so that each half, each half of a half, and so on down to a leaf has them close together.
fn split(placed: &mut [Placed]) {
    if placed.len() <= LEAF {
        return;
    }
    let far = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = placed.iter().fold(far, |(l, h), p| (l.min(p.middle), h.max(p.middle)));
    let axis = (high - low).max_position();
    let middle = placed.len() / 2;
    placed.select_nth_unstable_by(middle, |a, b| a.middle[axis].total_cmp(&b.middle[axis]));
    let (left, right) = placed.split_at_mut(middle);
    in_two(left.len(), || split(left), || split(right));
}

/// Two halves of so much work, on two threads where that pays.
fn in_two<T: Send>(size: usize, a: impl FnOnce() -> T + Send, b: impl FnOnce() -> T + Send) -> (T, T) {
    if size > ALONE { rayon::join(a, b) } else { (a(), b()) }
}

impl Node {
    /// The boxes over triangles that [`split`] has sorted.
    fn over(triangles: &[Triangle], start: usize) -> Node {
        let range = start..start + triangles.len();
        if triangles.len() <= LEAF {
            let corners = triangles.iter().flat_map(|t| t.corners);
            let far = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let (low, high) = corners.fold(far, |(l, h), p| (l.min(p), h.max(p)));
            return Node { low, high, range, children: None };
        }
        let middle = triangles.len() / 2;
        let (left, right) = triangles.split_at(middle);
        let (a, b) = in_two(middle, || Self::over(left, start), || Self::over(right, start + middle));
        Node { low: a.low.min(b.low), high: a.high.max(b.high), range, children: Some(Box::new([a, b])) }
    }

    fn gap_squared(&self, p: DVec3) -> f64 {
        (self.low - p).max(p - self.high).max(DVec3::ZERO).length_squared()
    }
}

impl Triangle {
    /// Nearest point by Voronoi regions (Ericson, Real-Time Collision Detection, 5.1.5), and the
    /// pseudonormal of the feature it lies on.
    fn nearest(&self, p: DVec3) -> (DVec3, DVec3) {
        let [a, b, c] = self.corners;
        let (ab, ac, ap) = (b - a, c - a, p - a);
        let (d1, d2) = (ab.dot(ap), ac.dot(ap));
        if d1 <= 0.0 && d2 <= 0.0 {
            return (a, self.vertices[0]);
        }
        let bp = p - b;
        let (d3, d4) = (ab.dot(bp), ac.dot(bp));
        if d3 >= 0.0 && d4 <= d3 {
            return (b, self.vertices[1]);
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return (a + ab * (d1 / (d1 - d3)), self.edges[0]);
        }
        let cp = p - c;
        let (d5, d6) = (ab.dot(cp), ac.dot(cp));
        if d6 >= 0.0 && d5 <= d6 {
            return (c, self.vertices[2]);
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return (a + ac * (d2 / (d2 - d6)), self.edges[2]);
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), self.edges[1]);
        }
        let sum = va + vb + vc;
        (a + ab * (vb / sum) + ac * (vc / sum), self.face)
    }

    /// Whether a line from `a` to `b` goes through its inside, by more than `slack` on both sides.
    fn is_cut(&self, a: DVec3, b: DVec3, slack: f64) -> bool {
        let (from, to) = ((a - self.corners[0]).dot(self.face), (b - self.corners[0]).dot(self.face));
        if from * to >= 0.0 || from.abs().min(to.abs()) <= slack {
            return false;
        }
        let at = a + (b - a) * (from / (from - to));
        self.weights(at).is_some_and(|w| w.min_element() > 1e-6)
    }

    /// 1 where a ray leaves a solid through it, -1 where it enters, 0 where it passes by.
    fn met_along(&self, point: DVec3, direction: DVec3) -> i32 {
        let facing = self.face.dot(direction);
        let ahead = (self.corners[0] - point).dot(self.face) / facing;
        let hits = |at: DVec3| self.weights(at).is_some_and(|w| w.min_element() >= 0.0);
        if ahead > 0.0 && ahead.is_finite() && hits(point + direction * ahead) {
            facing.signum() as i32
        } else {
            0
        }
    }

    /// Barycentric coordinates of a point of its plane.
    fn weights(&self, at: DVec3) -> Option<DVec3> {
        let [a, b, c] = self.corners;
        let area = (b - a).cross(c - a).dot(self.face);
        let weight = |p: DVec3, q: DVec3| (q - p).cross(at - p).dot(self.face) / area;
        (area > 0.0).then(|| DVec3::new(weight(b, c), weight(c, a), weight(a, b)))
    }

    /// Height of the triangle above (x, y), edges included.
    fn height_at(&self, at: DVec2) -> Option<f64> {
        let [a, b, c] = self.corners.map(|v| v.truncate());
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 {
            return None;
        }
        let weight = |p: DVec2, q: DVec2| (q - p).perp_dot(at - p) / area;
        let (wa, wb, wc) = (weight(b, c), weight(c, a), weight(a, b));
        let within = wa.min(wb).min(wc) >= -1e-9;
        within.then(|| wa * self.corners[0].z + wb * self.corners[1].z + wc * self.corners[2].z)
    }
}
