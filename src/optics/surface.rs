//! The pad's face as the optics see it: a lattice of displaced material points, pad frame.

use super::{Error, Mesh, from_pad};
use glam::{Vec2, Vec3};

/// Displaced positions of a lattice of material points on the pad's face.
///
/// Undeformed, point (i, j) lies at x = -Lx/2 + Lx i/(nx-1), y = -Ly/2 + Ly j/(ny-1), edges included;
/// `positions[j * nx + i]` is where it is now, pad frame, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplacedSurface {
    /// Points along x.
    pub nx: usize,
    /// Points along y.
    pub ny: usize,
    /// Extent of the undeformed face in x and y, mm.
    pub size_mm: [f64; 2],
    /// Displaced positions, y outer.
    pub positions: Vec<Vec3>,
    /// Heights (z) of the undeformed points; empty for a flat face (all 0).
    pub rest_z: Vec<f32>,
}

impl DisplacedSurface {
    /// The untouched flat face.
    pub fn flat(nx: usize, ny: usize, size_mm: [f64; 2]) -> Self {
        let mut surface = Self { nx, ny, size_mm, positions: Vec::new(), rest_z: Vec::new() };
        surface.positions = surface.rest();
        surface
    }

    /// The untouched face of a pad that is not flat: `height` gives z over (x, y), mm, 0 at the apex and below it
    /// towards the camera.
    pub fn resting(nx: usize, ny: usize, size_mm: [f64; 2], height: impl Fn(f64, f64) -> f64) -> Self {
        let mut surface = Self::flat(nx, ny, size_mm);
        surface.rest_z =
            surface.positions.iter().map(|p| height(f64::from(p.x), f64::from(p.y)) as f32).collect();
        surface.at_rest()
    }

    /// The same face without any displacement.
    pub fn at_rest(&self) -> Self {
        Self { positions: self.rest(), ..self.clone() }
    }

    /// The undeformed positions.
    fn rest(&self) -> Vec<Vec3> {
        let along = |n: usize, size: f64, k: usize| -size / 2.0 + size * k as f64 / (n - 1).max(1) as f64;
        (0..self.nx * self.ny)
            .map(|k| {
                let (x, y) = (
                    along(self.nx, self.size_mm[0], k % self.nx),
                    along(self.ny, self.size_mm[1], k / self.nx),
                );
                Vec3::new(x as f32, y as f32, self.rest_z.get(k).copied().unwrap_or(0.0))
            })
            .collect()
    }

    /// The face on another lattice: displacements interpolated by Catmull-Rom splines, which keep
    /// normals continuous where a coarse simulation feeds a fine picture. Where the slope breaks they would overshoot, and a
    /// sharp rim carry a ridge that throws shadows: there they are kept monotone.
    pub fn resampled(&self, nx: usize, ny: usize) -> Self {
        if (nx, ny) == (self.nx, self.ny) {
            return self.clone();
        }
        let displacement: Vec<Vec3> = self.positions.iter().zip(self.rest()).map(|(p, r)| *p - r).collect();
        let heights: Vec<Vec3> = self.rest_z.iter().map(|z| Vec3::Z * *z).collect();
        let step = |size: f64, n: usize| (size / (n - 1).max(1) as f64) as f32;
        let step_mm = [step(self.size_mm[0], self.nx), step(self.size_mm[1], self.ny)];
        let on_it = |field: &[Vec3]| interpolate(field, [self.nx, self.ny], [nx, ny], step_mm);
        let rest_z = match heights.is_empty() {
            true => Vec::new(),
            false => on_it(&heights).iter().map(|h| h.z).collect(),
        };
        let mut out = Self { nx, ny, size_mm: self.size_mm, positions: Vec::new(), rest_z };
        out.positions = out.rest();
        for (p, d) in out.positions.iter_mut().zip(on_it(&displacement)) {
            *p += d;
        }
        out
    }

    /// The face with seeded normal noise of standard deviation `sigma_mm` on its heights (the paper's remedy
    /// against flipping normals; ours do not flip, so 0 is the default elsewhere).
    pub fn with_depth_noise(mut self, sigma_mm: f64, seed: u32) -> Self {
        if sigma_mm > 0.0 {
            for (k, p) in self.positions.iter_mut().enumerate() {
                p.z += (sigma_mm * super::noise::normal(seed, k as u32)) as f32;
            }
        }
        self
    }

    /// The face as a mesh of the scene frame, its normals towards the camera. `uv_of` maps the undeformed
    /// point, mm, to texture coordinates: what is printed on the face rides on it.
    ///
    /// # Errors
    /// When there are fewer than 2 x 2 points, or not as many positions as points, or one is not finite.
    pub fn mesh(&self, uv_of: impl Fn(Vec3) -> Vec2) -> Result<Mesh, Error> {
        let n = self.nx * self.ny;
        if self.nx < 2 || self.ny < 2 || self.positions.len() != n {
            return Err(Error::Scene {
                part: "the pad".to_owned(),
                what: format!("its {} x {} lattice has {} positions", self.nx, self.ny, self.positions.len()),
                next: "give at least 2 x 2 points and one position each".to_owned(),
            });
        }
        let rest = self.rest();
        // The scene's y runs the other way: rows are turned over, so that the mesh's own order stays
        // counter-clockwise as seen by the camera.
        let flipped = (0..n).map(|k| (self.ny - 1 - k / self.nx) * self.nx + k % self.nx);
        let positions = flipped.clone().map(|k| from_pad(self.positions[k])).collect();
        let uvs = flipped.map(|k| uv_of(rest[k])).collect();
        let mesh = Mesh::from_lattice(self.nx, self.ny, positions, uvs);
        mesh.check("the pad")?;
        Ok(mesh)
    }
}

/// Displacements on a lattice, interpolated onto another one over the same rectangle. `step_mm` is how far the points of the
/// first stand apart.
fn interpolate(field: &[Vec3], [mx, my]: [usize; 2], [nx, ny]: [usize; 2], step_mm: [f32; 2]) -> Vec<Vec3> {
    let columns: Vec<_> = (0..nx).map(|i| Knots::new(i, nx, mx)).collect();
    let mut narrow = Vec::with_capacity(nx * my);
    for row in field.chunks_exact(mx) {
        let bends: Vec<Vec3> = (0..mx)
            .map(|i| bend([row[i.saturating_sub(1)], row[i], row[(i + 1).min(mx - 1)]], step_mm[0]))
            .collect();
        narrow.extend(columns.iter().map(|knots| knots.between(|i| row[i], |i| bends[i])));
    }
    let at = |i: usize, j: usize| narrow[j * nx + i];
    let bends: Vec<Vec3> = (0..nx * my)
        .map(|k| {
            let (i, j) = (k % nx, k / nx);
            bend([at(i, j.saturating_sub(1)), at(i, j), at(i, (j + 1).min(my - 1))], step_mm[1])
        })
        .collect();
    let mut out = Vec::with_capacity(nx * ny);
    for j in 0..ny {
        let knots = Knots::new(j, ny, my);
        out.extend((0..nx).map(|i| knots.between(|j| at(i, j), |j| bends[j * nx + i])));
    }
    out
}

/// Slopes that break by less at a point are smooth, by more than the second there is a crease.
const BREAK: [f32; 2] = [0.3, 0.6];
/// A cubic between two points is monotone where its slope at either is at most so many times the chord's (Fritsch and Carlson
/// 1980, "Monotone piecewise cubic interpolation").
const MONOTONE: f32 = 3.0;

/// What is to be added to the spline's slope at the middle one of three points, a step.
fn bend([before, here, after]: [Vec3; 3], step_mm: f32) -> Vec3 {
    let (left, right) = (here - before, after - here);
    let breaks = (right - left).abs() / step_mm;
    if breaks.max_element() <= BREAK[0] {
        return Vec3::ZERO;
    }
    let slope = 0.5 * (left + right);
    let turns = (left * right).cmple(Vec3::ZERO);
    let most = Vec3::select(turns, Vec3::ZERO, MONOTONE * left.abs().min(right.abs()));
    let crease = ((breaks - BREAK[0]) / (BREAK[1] - BREAK[0])).clamp(Vec3::ZERO, Vec3::ONE);
    (slope.clamp(-most, most) - slope) * crease
}

/// How a point between others follows from them.
struct Knots {
    /// The four points around it, clamped at the ends, and their Catmull-Rom weights.
    at: [usize; 4],
    weights: [f32; 4],
    /// Weights of what is added to the slopes at the middle two.
    slopes: [f32; 2],
}

impl Knots {
    /// Point `i` of `n` on a lattice of `m` points.
    fn new(i: usize, n: usize, m: usize) -> Self {
        let at = i as f64 * (m - 1) as f64 / (n - 1).max(1) as f64;
        let k = (at as usize).min(m.saturating_sub(2));
        let t = at - k as f64;
        let (t2, t3) = (t * t, t * t * t);
        let weights = [
            -0.5 * t3 + t2 - 0.5 * t,
            1.5 * t3 - 2.5 * t2 + 1.0,
            -1.5 * t3 + 2.0 * t2 + 0.5 * t,
            0.5 * t3 - 0.5 * t2,
        ];
        Self {
            at: [k.saturating_sub(1), k, (k + 1).min(m - 1), (k + 2).min(m - 1)],
            weights: weights.map(|w| w as f32),
            slopes: [t3 - 2.0 * t2 + t, t3 - t2].map(|w| w as f32),
        }
    }

    fn between(&self, value: impl Fn(usize) -> Vec3, bend: impl Fn(usize) -> Vec3) -> Vec3 {
        let spline: Vec3 = (0..4).map(|k| value(self.at[k]) * self.weights[k]).sum();
        spline + bend(self.at[1]) * self.slopes[0] + bend(self.at[2]) * self.slopes[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_keeps_linear_displacements_and_lattice_points() {
        let mut s = DisplacedSurface::flat(21, 11, [20.0, 10.0]);
        for p in &mut s.positions {
            *p += Vec3::new(0.01 * p.y, 0.0, -0.02 * p.x);
        }
        let fine = s.resampled(81, 41);
        // Away from the edge, where clamping bends the spline, a linear field stays linear.
        for j in 4..37 {
            for i in 4..77 {
                let (x, y) = (-10.0 + 0.25 * i as f32, -5.0 + 0.25 * j as f32);
                let truth = Vec3::new(x + 0.01 * y, y, -0.02 * x);
                assert!((fine.positions[j * 81 + i] - truth).length() < 1e-5);
            }
        }
        for j in 0..11 {
            for i in 0..21 {
                assert!((fine.positions[j * 4 * 81 + i * 4] - s.positions[j * 21 + i]).length() < 1e-5);
            }
        }
    }

    /// A rim, a spike and a cone keep to the heights that they have; a smooth hill is where the spline has it.
    #[test]
    fn resampling_overshoots_no_crease() {
        let n = 41;
        let resampled = |height: fn(f32) -> f32| {
            let mut s = DisplacedSurface::flat(n, n, [4.0, 4.0]);
            for p in &mut s.positions {
                p.z = height(p.x + 0.2 * p.y);
            }
            let lattice = s.positions.iter().fold([f32::MAX, f32::MIN], |[l, h], p| [l.min(p.z), h.max(p.z)]);
            (s.resampled(157, 203), lattice)
        };
        fn rim(x: f32) -> f32 {
            if x < 0.03 { -0.8 } else { 0.0 }
        }
        fn spike(x: f32) -> f32 {
            if (x - 0.31).abs() < 0.06 { -0.5 } else { 0.0 }
        }
        for height in [rim as fn(f32) -> f32, spike, |x| -(0.8 - 2.0 * x.abs()).max(0.0)] {
            let (fine, [low, high]) = resampled(height);
            for p in &fine.positions {
                assert!(p.z >= low - 5e-3 && p.z <= high + 5e-3, "{p}");
            }
        }
        fn hill(x: f32) -> f32 {
            0.5 * (-x * x).exp()
        }
        for p in resampled(hill).0.positions {
            assert!((p.z - hill(p.x + 0.2 * p.y)).abs() < 2e-3 || p.x.abs().max(p.y.abs()) > 1.8);
        }
    }

    #[test]
    fn the_mesh_faces_the_camera_and_carries_its_texture() {
        let mut s = DisplacedSurface::flat(5, 4, [8.0, 6.0]);
        s.positions[0] += Vec3::new(0.1, 0.2, -0.3);
        let mesh = s.mesh(|p| Vec2::new(p.x / 8.0 + 0.5, p.y / 6.0 + 0.5)).unwrap();
        for k in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(k);
            assert!((b - a).cross(c - a).z > 0.0);
        }
        // Lattice point (0, 0) is the upper left one: last row of the mesh, texture coordinate (0, 0).
        assert!((mesh.positions[15] - Vec3::new(-3.9, 2.8, 0.3)).length() < 1e-6);
        assert_eq!(mesh.uvs[15], Vec2::ZERO);
    }
}
