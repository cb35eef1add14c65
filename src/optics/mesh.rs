//! Triangle meshes: positions, texture coordinates, and the lattice they came from.

use super::Error;
use glam::{Vec2, Vec3};

/// A triangle mesh in the scene frame, mm. Normals are geometric: (b - a) x (c - a).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Texture coordinate of each vertex; empty when the mesh carries no texture.
    pub uvs: Vec<Vec2>,
    /// Unit normal of each vertex, of a curved surface that the triangles stand for; empty where they are what is meant. Clear
    /// surfaces refract by it.
    pub normals: Vec<Vec3>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// `[nx, ny]` when vertex (i, j) of a regular lattice stands at `j * nx + i` and the triangles are
    /// those of [`Mesh::lattice`]: quads in the same order, two triangles each.
    pub lattice: Option<[usize; 2]>,
}

impl Mesh {
    /// The mesh of an `nx` by `ny` lattice of points (at least 2 x 2), x inner. Each quad
    /// a = (i, j), b = (i+1, j), c = (i+1, j+1), d = (i, j+1) becomes the triangles (a, b, c) and (a, c, d).
    pub fn from_lattice(nx: usize, ny: usize, positions: Vec<Vec3>, uvs: Vec<Vec2>) -> Self {
        let mut triangles = Vec::with_capacity(2 * (nx.max(1) - 1) * (ny.max(1) - 1));
        for j in 0..ny.saturating_sub(1) {
            for i in 0..nx.saturating_sub(1) {
                let a = (j * nx + i) as u32;
                let (b, d) = (a + 1, a + nx as u32);
                let c = d + 1;
                triangles.push([a, b, c]);
                triangles.push([a, c, d]);
            }
        }
        Self { positions, uvs, normals: Vec::new(), triangles, lattice: Some([nx, ny]) }
    }

    /// The parallelogram with corner `a` and edges `u`, `v`; its normal is u x v.
    pub fn parallelogram(a: Vec3, u: Vec3, v: Vec3) -> Self {
        Self {
            positions: vec![a, a + u, a + u + v, a + v],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Self::default()
        }
    }

    /// Appends the triangles of another mesh. The result is no lattice and carries neither texture nor normals.
    pub fn append(&mut self, other: &Mesh) {
        let base = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
        self.uvs.clear();
        self.normals.clear();
        self.lattice = None;
    }

    /// The six faces of the axis-aligned box, normals outwards.
    pub fn cuboid(min: Vec3, max: Vec3) -> Self {
        let s = max - min;
        let (x, y, z) = (Vec3::X * s.x, Vec3::Y * s.y, Vec3::Z * s.z);
        let mut mesh = Mesh::default();
        for face in [
            Mesh::parallelogram(min, y, x),
            Mesh::parallelogram(min + z, x, y),
            Mesh::parallelogram(min, x, z),
            Mesh::parallelogram(min + y, z, x),
            Mesh::parallelogram(min, z, y),
            Mesh::parallelogram(min + x, y, z),
        ] {
            mesh.append(&face);
        }
        mesh
    }

    /// Four walls and the face at the largest z of an axis-aligned box, normals inwards; no face at the
    /// smallest z.
    pub fn open_box(min: Vec3, max: Vec3) -> Self {
        let s = max - min;
        let (x, y, z) = (Vec3::X * s.x, Vec3::Y * s.y, Vec3::Z * s.z);
        let mut mesh = Mesh::default();
        for face in [
            Mesh::parallelogram(min, y, z),
            Mesh::parallelogram(min + x, z, y),
            Mesh::parallelogram(min, z, x),
            Mesh::parallelogram(min + y, x, z),
            Mesh::parallelogram(min + z, y, x),
        ] {
            mesh.append(&face);
        }
        mesh
    }

    /// The corners of triangle `k`.
    pub fn corners(&self, k: usize) -> [Vec3; 3] {
        self.triangles[k].map(|i| self.positions[i as usize])
    }

    /// The area of triangle `k`, mm^2.
    pub fn area(&self, k: usize) -> f32 {
        let [a, b, c] = self.corners(k);
        (b - a).cross(c - a).length() / 2.0
    }

    /// The point that is nearest to `p`, of one triangle or more.
    pub fn nearest(&self, p: Vec3) -> Option<Vec3> {
        let points = (0..self.triangles.len()).map(|k| nearest_on(&self.corners(k), p));
        points.min_by(|q, r| q.distance_squared(p).total_cmp(&r.distance_squared(p)))
    }

    /// Indices inside the vertex list, coordinates finite, one texture coordinate and normal a vertex or none.
    pub fn check(&self, part: &str) -> Result<(), Error> {
        let fault = |what: String| {
            let next = "repair the mesh before it is rendered".to_owned();
            Err(Error::Scene { part: part.to_owned(), what, next })
        };
        if let Some(i) = self.positions.iter().position(|p| !p.is_finite()) {
            return fault(format!("vertex {i} is {} (coordinates must be finite)", self.positions[i]));
        }
        if let Some(t) = self.triangles.iter().flatten().find(|&&i| i as usize >= self.positions.len()) {
            return fault(format!("a triangle names vertex {t} of {}", self.positions.len()));
        }
        if !self.uvs.is_empty() && self.uvs.len() != self.positions.len() {
            return fault(format!(
                "{} texture coordinates for {} vertices",
                self.uvs.len(),
                self.positions.len()
            ));
        }
        if !self.normals.is_empty() && self.normals.len() != self.positions.len() {
            return fault(format!("{} normals for {} vertices", self.normals.len(), self.positions.len()));
        }
        if let Some(i) = self.normals.iter().position(|n| !n.is_normalized()) {
            return fault(format!("normal {i} is {} (normals are unit vectors)", self.normals[i]));
        }
        Ok(())
    }
}

/// The point of a triangle that is nearest to `p`.
pub fn nearest_on(corners: &[Vec3; 3], p: Vec3) -> Vec3 {
    let [a, b, c] = *corners;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let foot = p - normal * (p - a).dot(normal);
    let edges = [(a, b), (b, c), (c, a)];
    if normal != Vec3::ZERO && edges.iter().all(|(q, r)| (r - q).cross(foot - q).dot(normal) >= 0.0) {
        return foot;
    }
    let [first, second, third] = edges.map(|(q, r)| {
        let along = r - q;
        q + along * ((p - q).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    });
    let nearer = |q: Vec3, r: Vec3| if r.distance_squared(p) < q.distance_squared(p) { r } else { q };
    nearer(nearer(first, second), third)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cuboid_has_its_normals_outwards_and_its_area() {
        let mesh = Mesh::cuboid(Vec3::new(-1.0, -2.0, 0.0), Vec3::new(1.0, 2.0, 5.0));
        let centre = Vec3::new(0.0, 0.0, 2.5);
        let mut area = 0.0;
        for k in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(k);
            let n = (b - a).cross(c - a);
            area += n.length() / 2.0;
            assert!(n.dot((a + b + c) / 3.0 - centre) > 0.0);
        }
        assert!((area - 2.0 * (2.0 * 4.0 + 2.0 * 5.0 + 4.0 * 5.0)).abs() < 1e-4);
    }

    #[test]
    fn a_broken_mesh_is_named() {
        let mut mesh = Mesh::parallelogram(Vec3::ZERO, Vec3::X, Vec3::Y);
        mesh.triangles[1][2] = 9;
        assert!(mesh.check("pad").unwrap_err().to_string().contains("vertex 9 of 4"));
        mesh.triangles[1][2] = 3;
        mesh.normals = vec![Vec3::Z; 3];
        assert!(mesh.check("lens").unwrap_err().to_string().contains("3 normals for 4 vertices"));
        mesh.normals = vec![Vec3::Z; 4];
        assert!(mesh.check("lens").is_ok());
        mesh.normals[2] *= 2.0;
        assert!(mesh.check("lens").unwrap_err().to_string().contains("normal 2"));
    }

    #[test]
    fn the_nearest_point_of_a_triangle_is_over_its_face_its_edge_or_its_corner() {
        let triangle = [Vec3::ZERO, 4.0 * Vec3::X, 3.0 * Vec3::Y];
        for (p, near) in [
            (Vec3::new(1.0, 1.0, 2.0), Vec3::new(1.0, 1.0, 0.0)),
            (Vec3::new(2.0, -1.0, 1.0), Vec3::new(2.0, 0.0, 0.0)),
            (Vec3::new(2.0 + 3.0, 1.5 + 4.0, 0.0), Vec3::new(2.0, 1.5, 0.0)),
            (Vec3::new(-1.0, -2.0, 1.0), Vec3::ZERO),
        ] {
            assert!(nearest_on(&triangle, p).distance(near) < 1e-5, "{p}: {}", nearest_on(&triangle, p));
        }
    }
}
