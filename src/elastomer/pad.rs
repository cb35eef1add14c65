//! The pad: its shape, its size, what it is made of.

use super::Material;
use serde::{Deserialize, Serialize};

/// Outline of the undeformed pad on its rigid backing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum PadShape {
    /// A flat slab with sharp edges.
    Cuboid,
    /// A slab whose upper edges are rounded.
    Rounded {
        /// Radius of the rounding, mm.
        radius_mm: f64,
    },
    /// A spherical cap: the outer face has this radius, its apex at the origin.
    Dome {
        /// Radius of the outer face, mm.
        radius_mm: f64,
    },
    /// A cylinder lying along y, its apex line through the origin.
    Cylinder {
        /// Radius of the outer face, mm.
        radius_mm: f64,
    },
}

impl PadShape {
    /// Its `kind`, as sensor files write it.
    pub fn name(self) -> &'static str {
        match self {
            PadShape::Cuboid => "cuboid",
            PadShape::Rounded { .. } => "rounded",
            PadShape::Dome { .. } => "dome",
            PadShape::Cylinder { .. } => "cylinder",
        }
    }

    /// Height of the untouched face of a pad of this extent, mm: 0 at its apex, below it towards the backing.
    pub fn face_height_mm(self, size_mm: [f64; 2], [x, y]: [f64; 2]) -> f64 {
        let cap = |radius: f64, r2: f64| (radius * radius - r2).max(0.0).sqrt() - radius;
        match self {
            PadShape::Cuboid => 0.0,
            PadShape::Rounded { radius_mm } => {
                let over = |at: f64, size: f64| (at.abs() - (size / 2.0 - radius_mm)).max(0.0);
                cap(radius_mm, over(x, size_mm[0]).powi(2) + over(y, size_mm[1]).powi(2))
            }
            PadShape::Dome { radius_mm } => cap(radius_mm, x * x + y * y),
            PadShape::Cylinder { radius_mm } => cap(radius_mm, x * x),
        }
    }
}

/// A skin of another stiffness on the face, bonded to the bulk: a reflective paint, a wear layer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coating {
    /// Thickness, mm; part of the pad's.
    pub thickness_mm: f64,
    /// Young's modulus, MPa.
    pub youngs_modulus_mpa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
}

/// A bonded elastic pad. The contact face is z = 0 at its centre, the backing lies below, everywhere as far from the
/// face of a dome or a cylinder as the pad is thick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pad {
    /// Outline.
    pub shape: PadShape,
    /// Extent in x, mm.
    pub size_x_mm: f64,
    /// Extent in y, mm.
    pub size_y_mm: f64,
    /// Thickness, mm.
    pub thickness_mm: f64,
    /// Bulk material.
    pub material: Material,
    /// Skin of another stiffness, of the bulk's law.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coating: Option<Coating>,
}

impl Pad {
    /// A slab of one material.
    pub fn slab([size_x_mm, size_y_mm, thickness_mm]: [f64; 3], material: Material) -> Self {
        Self { shape: PadShape::Cuboid, size_x_mm, size_y_mm, thickness_mm, material, coating: None }
    }
}
