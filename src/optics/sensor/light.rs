//! The lights of a sensor file.

use super::{HousingSpec, place};
use crate::problem::Problems;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// One light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightSpec {
    /// Name in reports.
    pub name: String,
    /// Luminous surface.
    pub shape: LightShapeSpec,
    /// Colour, 0 to 255 a channel, taken as linear (the paper's table).
    pub rgb: [f64; 3],
    /// Energy in the units of the paper's table; radiance = rgb/255 energy/100, whatever the light's area.
    pub energy: f64,
    /// Angular profile: radiance falls as cos^k; 0 is Lambertian.
    #[serde(default)]
    pub cosine_power: f64,
    /// Whether it shines on both sides, as a sheet that is lit from its edge does.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub two_sided: bool,
    /// Diffuse reflectance of the light's own patch.
    #[serde(default = "default_patch_albedo")]
    pub albedo: f64,
}

fn default_patch_albedo() -> f64 {
    0.5
}

/// The highest energy of a light.
pub const MOST_ENERGY: f64 = 1e6;

/// What rgb times energy is divided by: white (255) of energy 100 has radiance 1.
pub const RGB_ENERGY_OF_ONE: f64 = 25_500.0;

/// The luminous surface of a light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum LightShapeSpec {
    /// A rectangle or strip.
    Rectangle {
        /// Centre, mm.
        center_mm: [f64; 3],
        /// Direction in which it shines.
        facing: [f64; 3],
        /// Length at right angles to z, and the other edge, mm.
        size_mm: [f64; 2],
    },
    /// A disc.
    Disc {
        /// Centre, mm.
        center_mm: [f64; 3],
        /// Direction in which it shines.
        facing: [f64; 3],
        /// Radius, mm.
        radius_mm: f64,
    },
    /// A tube that shines all around.
    Tube {
        /// One end of the axis, mm.
        from_mm: [f64; 3],
        /// The other end, mm.
        to_mm: [f64; 3],
        /// Radius, mm.
        radius_mm: f64,
    },
    /// Triangles that shine where their normals point.
    Mesh {
        /// Corners, mm.
        vertices_mm: Vec<[f64; 3]>,
        /// Three corners each by number from 0, counterclockwise seen from where they shine.
        triangles: Vec<[u32; 3]>,
    },
}

/// What is checked, in messages.
const KIND: place::Kind = "light";
/// Nearer than this to a wall a light is mounted on it, mm.
const AT_WALL_MM: f64 = 0.05;
/// A light shines into a wall where the cosine between its facing and the way out is more (within 60 degrees of it): beside one
/// that it grazes there is light.
const INTO_WALL: f64 = 0.5;
/// The shortest tube, mm.
const LEAST_TUBE_MM: f64 = 1e-3;

impl LightSpec {
    /// Whether any light leaves it.
    pub fn shines(&self) -> bool {
        self.energy > 0.0 && self.rgb.iter().any(|channel| *channel > 0.0)
    }

    pub(super) fn check(&self, housing: Option<&HousingSpec>, p: &mut Problems) {
        for (channel, value) in self.rgb.iter().enumerate() {
            p.range(&format!("rgb[{channel}]"), *value, 0.0, 255.0, "");
        }
        if let Some(housing) = housing {
            place::within_walls(p, KIND, housing, &self.shape.places());
        }
        p.range("energy", self.energy, 0.0, MOST_ENERGY, "");
        p.range("cosine_power", self.cosine_power, 0.0, 200.0, "");
        p.range("albedo", self.albedo, 0.0, 0.95, "");
        for (key, at) in self.shape.places() {
            place::point(p, KIND, key, &at);
        }
        if let Some(housing) = housing {
            self.check_facing(housing, p);
        }
        match &self.shape {
            LightShapeSpec::Rectangle { facing, size_mm, .. } => {
                place::direction(p, facing);
                place::size(p, *size_mm);
            }
            LightShapeSpec::Disc { facing, radius_mm, .. } => {
                place::direction(p, facing);
                p.range("shape.radius_mm", *radius_mm, 1e-3, 100.0, "mm");
            }
            LightShapeSpec::Tube { from_mm, to_mm, radius_mm } => {
                let length = from_mm.iter().zip(to_mm).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                if length < LEAST_TUBE_MM {
                    p.push(
                        "shape.to_mm",
                        format!("{to_mm:?}"),
                        format!("{LEAST_TUBE_MM} mm or more from shape.from_mm"),
                        "give both ends of the tube's axis",
                    );
                }
                p.range("shape.radius_mm", *radius_mm, 1e-3, 100.0, "mm");
                if self.two_sided {
                    p.push(
                        "two_sided",
                        true,
                        "rectangles, discs and meshes only: of a tube only the outside is seen",
                        "leave two_sided out: a tube shines all around",
                    );
                }
            }
            LightShapeSpec::Mesh { vertices_mm, triangles } => place::triangles(p, vertices_mm, triangles),
        }
    }

    /// Refuses a light that shines into the wall at its back: the picture has none of it, and nobody sees why.
    fn check_facing(&self, housing: &HousingSpec, p: &mut Problems) {
        let (center_mm, facing) = match &self.shape {
            LightShapeSpec::Rectangle { center_mm, facing, .. }
            | LightShapeSpec::Disc { center_mm, facing, .. } => (center_mm, facing),
            LightShapeSpec::Tube { .. } | LightShapeSpec::Mesh { .. } => return,
        };
        if self.two_sided {
            return;
        }
        let normal = DVec3::from_array(*facing).normalize_or_zero();
        // Each wall by its axis, its place there, the way out and what it is called.
        let walls = [
            (0, housing.x_mm[0], -1.0, "x_mm[0]"),
            (0, housing.x_mm[1], 1.0, "x_mm[1]"),
            (1, housing.y_mm[0], -1.0, "y_mm[0]"),
            (1, housing.y_mm[1], 1.0, "y_mm[1]"),
            (2, -housing.height_mm, -1.0, "height_mm"),
        ];
        for (axis, wall, outward, key) in walls {
            let before_mm = (wall - center_mm[axis]) * outward;
            if (0.0..AT_WALL_MM).contains(&before_mm) && normal[axis] * outward > INTO_WALL {
                let mut turned = *facing;
                turned[axis] = -turned[axis];
                p.push(
                    "shape.facing",
                    format!("{facing:?}"),
                    format!(
                        "away from optics.housing.{key}, {before_mm:.3} mm in front of which light {:?} stands",
                        self.name
                    ),
                    format!("turn it: facing = {turned:?}"),
                );
            }
        }
    }
}

impl LightShapeSpec {
    /// Where its file says that it is.
    fn places(&self) -> Vec<(&'static str, [f64; 3])> {
        match self {
            LightShapeSpec::Rectangle { center_mm, .. } | LightShapeSpec::Disc { center_mm, .. } => {
                vec![("shape.center_mm", *center_mm)]
            }
            LightShapeSpec::Tube { from_mm, to_mm, .. } => {
                vec![("shape.from_mm", *from_mm), ("shape.to_mm", *to_mm)]
            }
            LightShapeSpec::Mesh { vertices_mm, .. } => {
                vertices_mm.iter().map(|v| ("shape.vertices_mm", *v)).collect()
            }
        }
    }
}
