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

/// A bonded elastic pad. The contact face is z = 0 at its centre, the backing lies below.
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
}
