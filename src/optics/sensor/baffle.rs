//! Baffles of a sensor file: opaque sheets and blocks between lights, pad and camera.
//!
//! What a baffle is by itself is checked here; whether it stands in the pad, in the lens or before the camera shows only
//! when the sensor is put together ([`clearance`](crate::optics::clearance)).

use super::{HousingSpec, PlateSpec, place};
use crate::optics::{Mesh, from_pad, shape, to_pad};
use crate::problem::Problems;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// An opaque diffuse part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaffleSpec {
    /// Name in reports.
    pub name: String,
    /// Its surface.
    pub shape: BaffleShapeSpec,
    /// Diffuse reflectance, on both sides of a sheet.
    #[serde(default = "default_albedo")]
    pub albedo: f64,
}

/// Matt black paint.
fn default_albedo() -> f64 {
    0.05
}

/// The surface of a baffle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum BaffleShapeSpec {
    /// A thin sheet.
    Rectangle {
        /// Centre, mm.
        center_mm: [f64; 3],
        /// Direction at right angles to it, either way.
        facing: [f64; 3],
        /// Length at right angles to z, and the other edge, mm.
        size_mm: [f64; 2],
    },
    /// A block along the axes.
    Box {
        /// One corner, mm.
        from_mm: [f64; 3],
        /// The opposite corner, mm.
        to_mm: [f64; 3],
    },
    /// Triangles, each a thin sheet.
    Mesh {
        /// Corners, mm.
        vertices_mm: Vec<[f64; 3]>,
        /// Three corners each by number from 0.
        triangles: Vec<[u32; 3]>,
    },
}

/// What is checked, in messages.
const KIND: place::Kind = "baffle";
/// The least edge of a block, and the least distance from a wall or a plate along which a sheet lies, mm: of two surfaces in
/// one place chance would decide which is seen.
const LEAST_MM: f64 = 1e-3;

impl BaffleSpec {
    /// Its surface in the scene frame.
    pub fn mesh(&self) -> Mesh {
        match &self.shape {
            BaffleShapeSpec::Rectangle { center_mm, facing, size_mm } => {
                let [center, half_u, half_v] = shape::rectangle(center_mm, facing, *size_mm);
                Mesh::parallelogram(center - half_u - half_v, 2.0 * half_u, 2.0 * half_v)
            }
            BaffleShapeSpec::Box { from_mm, to_mm } => {
                let [a, b] = [from_mm, to_mm].map(|corner| from_pad(shape::vector(corner)));
                Mesh::cuboid(a.min(b), a.max(b))
            }
            BaffleShapeSpec::Mesh { vertices_mm, triangles } => shape::mesh(vertices_mm, triangles),
        }
    }

    pub(super) fn check(&self, housing: Option<&HousingSpec>, plate: Option<&PlateSpec>, p: &mut Problems) {
        let before = p.len();
        p.range("albedo", self.albedo, 0.0, 0.95, "");
        let places = self.places();
        for (key, at) in &places {
            place::point(p, KIND, key, at);
        }
        match &self.shape {
            BaffleShapeSpec::Rectangle { facing, size_mm, .. } => {
                place::direction(p, facing);
                place::size(p, *size_mm);
            }
            BaffleShapeSpec::Box { from_mm, to_mm } => {
                if from_mm.iter().zip(to_mm).any(|(a, b)| (a - b).abs() < LEAST_MM) {
                    p.push(
                        "shape.to_mm",
                        format!("{to_mm:?}"),
                        format!("{LEAST_MM} mm or more from shape.from_mm along each axis"),
                        "give two opposite corners; a sheet is a rectangle",
                    );
                }
            }
            BaffleShapeSpec::Mesh { vertices_mm, triangles } => place::triangles(p, vertices_mm, triangles),
        }
        // Where it reaches is known only of a sound shape.
        if p.len() > before {
            return;
        }
        let reach = self.reach();
        if let Some(housing) = housing {
            place::within_walls(p, KIND, housing, &reach.map(|corner| ("shape", corner)));
            check_off_walls(reach, housing, p);
        }
        if let Some(plate) = plate {
            check_off_plate(reach, plate, p);
        }
    }

    /// Where its file says that it is.
    fn places(&self) -> Vec<(&'static str, [f64; 3])> {
        match &self.shape {
            BaffleShapeSpec::Rectangle { center_mm, .. } => vec![("shape.center_mm", *center_mm)],
            BaffleShapeSpec::Box { from_mm, to_mm } => {
                vec![("shape.from_mm", *from_mm), ("shape.to_mm", *to_mm)]
            }
            BaffleShapeSpec::Mesh { vertices_mm, .. } => {
                vertices_mm.iter().map(|v| ("shape.vertices_mm", *v)).collect()
            }
        }
    }

    /// The lowest and highest coordinates of its surface, pad frame, mm, without what single precision adds to them.
    fn reach(&self) -> [[f64; 3]; 2] {
        let inf = Vec3::splat(f32::INFINITY);
        let positions = self.mesh().positions;
        let [low, high] = positions
            .iter()
            .map(|p| to_pad(*p))
            .fold([inf, -inf], |[low, high], p| [low.min(p), high.max(p)]);
        [low, high].map(|p| p.to_array().map(|v| (f64::from(v) * 1e4).round() / 1e4))
    }
}

/// Refuses a sheet right on a wall.
fn check_off_walls([low, high]: [[f64; 3]; 2], housing: &HousingSpec, p: &mut Problems) {
    let walls = [housing.x_mm, housing.y_mm, [-housing.height_mm, f64::INFINITY]];
    for (axis, wall) in walls.iter().enumerate() {
        let is_on = |at: &&f64| (low[axis] - **at).abs() < LEAST_MM && (high[axis] - **at).abs() < LEAST_MM;
        if let Some(at) = wall.iter().find(is_on) {
            p.push(
                "shape",
                format!("a sheet in the wall at {} = {at} mm", ["x", "y", "z"][axis]),
                format!("{LEAST_MM} mm or more off it"),
                "move it off the wall, so that it is seen",
            );
        }
    }
}

/// Refuses what reaches into the plate or lies on it.
fn check_off_plate([low, high]: [[f64; 3]; 2], plate: &PlateSpec, p: &mut Problems) {
    let [begins, ends] = plate.heights_mm();
    // Heights over the face are -z of the pad frame.
    let (bottom, top) = (-high[2], -low[2]);
    if bottom < ends + LEAST_MM && top > begins - LEAST_MM {
        p.push(
            "shape",
            format!("{bottom} to {top} mm above the face"),
            format!("off the plate, which is {begins} to {ends} mm above it, by {LEAST_MM} mm or more"),
            "move the baffle below or above the plate, or correct optics.plate",
        );
    }
}
