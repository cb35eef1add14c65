//! The mesh that the pad's face becomes, in a sensor file.

use super::CameraSpec;
use crate::problem::Problems;
use serde::{Deserialize, Serialize};

/// The mesh of the pad's face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeshSpec {
    /// Vertices along x and y; [0, 0] takes as many as make it as fine as the pixels that see it.
    pub vertices: [usize; 2],
    /// Standard deviation of seeded noise on the heights, mm (the paper uses 1e-4, we need none).
    pub depth_noise_mm: f64,
    /// Seed of that noise.
    pub depth_noise_seed: u32,
}

impl Default for MeshSpec {
    fn default() -> Self {
        Self { vertices: [0, 0], depth_noise_mm: 0.0, depth_noise_seed: 0 }
    }
}

/// Fewest and most vertices along an edge: between too few of them a press has room to vanish.
const VERTICES: [usize; 2] = [32, 8192];
/// Most vertices in all unless more are asked for: a tree over their triangles takes about a gigabyte.
const MOST_UNASKED: f64 = 4e6;

impl MeshSpec {
    /// Vertices along x and y of a face of this extent, mm. Unless they are given, the camera's raster (the paper's choice), or
    /// more where the pad is larger than what the camera sees of it: there the raster over the whole pad is coarser than pixels.
    pub fn vertices_of(&self, size_mm: [f64; 2], camera: &CameraSpec) -> [usize; 2] {
        if self.vertices != [0, 0] {
            return self.vertices;
        }
        let raster = [camera.width_px, camera.height_px];
        let as_pixels: [f64; 2] = std::array::from_fn(|axis| {
            let quads = (size_mm[axis] / camera.mm_per_px - ROUNDING).ceil();
            (quads + 1.0).clamp(raster[axis] as f64, VERTICES[1] as f64)
        });
        let bound = (MOST_UNASKED / (as_pixels[0] * as_pixels[1])).sqrt().min(1.0);
        std::array::from_fn(|axis| ((as_pixels[axis] * bound) as usize).max(raster[axis]))
    }

    pub(super) fn check(&self, p: &mut Problems) {
        let bad = |n: usize| !(VERTICES[0]..=VERTICES[1]).contains(&n);
        if self.vertices != [0, 0] && self.vertices.into_iter().any(bad) {
            let value = format!("{:?}", self.vertices);
            p.push(
                "vertices",
                value,
                format!("{} to {} each, or [0, 0]", VERTICES[0], VERTICES[1]),
                "use [0, 0] for a mesh as fine as the pixels",
            );
        }
        p.range("depth_noise_mm", self.depth_noise_mm, 0.0, 0.1, "mm");
    }
}

/// A pad of a whole number of pixels has no quad more by the rounding of their size.
const ROUNDING: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(width_px: usize, height_px: usize, mm_per_px: f64) -> CameraSpec {
        CameraSpec {
            width_px,
            height_px,
            mm_per_px,
            distance_mm: 19.0,
            center_mm: [0.0, 0.0],
            distortion: None,
            aperture_radius_mm: 0.0,
        }
    }

    #[test]
    fn the_mesh_is_as_fine_as_the_pixels_wherever_the_camera_looks() {
        let vertices = |size: [f64; 2], camera: &CameraSpec| MeshSpec::default().vertices_of(size, camera);
        // 18 x 13.5 mm of 20 x 20 mm are seen: the raster over all of it would be coarser than pixels.
        let fine = vertices([20.0, 20.0], &camera(640, 480, 0.028125));
        assert_eq!(fine, [713, 713]);
        assert!(fine.iter().all(|n| 20.0 / (n - 1) as f64 <= 0.028125));
        // All of the pad is seen, and more: the raster.
        assert_eq!(vertices([16.0, 12.0], &camera(640, 480, 0.028125)), [640, 480]);
        // A whole number of pixels.
        assert_eq!(vertices([20.0, 20.0], &camera(100, 100, 0.1)), [201, 201]);
        // A close look at a large pad ends where no machine has the memory, but never below the raster.
        let [nx, ny] = vertices([200.0, 100.0], &camera(640, 480, 0.02));
        assert!(nx * ny <= 4_000_000 && nx * ny > 3_900_000, "{nx} {ny}");
        assert!((nx as f64 / ny as f64 - 8192.0 / 5001.0).abs() < 0.01, "{nx} {ny}");
        assert_eq!(vertices([200.0, 200.0], &camera(4000, 3000, 0.01)), [4000, 3000]);
        // What is asked for is taken.
        let asked = MeshSpec { vertices: [50, 40], ..MeshSpec::default() };
        assert_eq!(asked.vertices_of([20.0, 20.0], &camera(640, 480, 0.028125)), [50, 40]);
    }
}
