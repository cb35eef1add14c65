//! What is wrong with a mesh, where, and what to do about it.

use super::PLAUSIBLE_MM;
use glam::DVec3;

/// What is wrong with a mesh, said of its file ("is cut short: ..."). Places are rounded as they are told.
#[derive(Debug, thiserror::Error)]
pub enum Defect {
    /// The file cannot be read.
    #[error("cannot be read ({0})")]
    Unreadable(#[from] std::io::Error),
    /// Neither form of STL.
    #[error("is not an STL file ({0})")]
    NotStl(String),
    /// A binary file with fewer bytes than its triangle count needs.
    #[error("is cut short: {triangles} triangles need {expected} bytes, there are {found}")]
    Truncated {
        /// Count in the header.
        triangles: u32,
        /// Bytes needed.
        expected: u64,
        /// Bytes there.
        found: u64,
    },
    /// No triangle.
    #[error("holds no triangle (of {given} given, all are degenerate)")]
    Empty {
        /// Triangles in the file.
        given: usize,
    },
    /// A coordinate that is no number.
    #[error("has a coordinate that is not a finite number, in triangle {triangle}")]
    NotFinite {
        /// Which, from 0.
        triangle: usize,
    },
    /// A hole.
    #[error(
        "is not watertight: {count} open edge{}, the first from {} to {} (file units)",
        plural(*.count), in_file(*.from), in_file(*.to)
    )]
    OpenEdges {
        /// How many.
        count: usize,
        /// One end of the first.
        from: DVec3,
        /// Its other end.
        to: DVec3,
    },
    /// More than two triangles at an edge.
    #[error(
        "is not manifold: more than two triangles at {count} edge{}, the first from {} to {} (file units)",
        plural(*.count), in_file(*.from), in_file(*.to)
    )]
    NonManifold {
        /// How many.
        count: usize,
        /// One end of the first.
        from: DVec3,
        /// Its other end.
        to: DVec3,
    },
    /// Neighbouring triangles disagree about the outside.
    #[error(
        "has {count} edge{} whose two triangles face opposite ways, the first from {} to {} (file units)",
        plural(*.count), in_file(*.from), in_file(*.to)
    )]
    Orientation {
        /// How many.
        count: usize,
        /// One end of the first.
        from: DVec3,
        /// Its other end.
        to: DVec3,
    },
    /// A part is a surface, not a body.
    #[error(
        "has a part (of {parts}) that encloses no volume, near {} (mm, the tip at height 0): it is {across_mm:.3} mm across and on average {thickness_mm:.6} mm thick",
        placed(*.near)
    )]
    Flat {
        /// How many parts there are.
        parts: usize,
        /// A corner of this one.
        near: DVec3,
        /// Diagonal of its bounding box, mm.
        across_mm: f64,
        /// Its mean thickness, mm.
        thickness_mm: f64,
    },
    /// It goes through itself.
    #[error(
        "cuts through itself: the edge from {} to {} (mm, the tip at height 0) goes through another face",
        placed(*.from), placed(*.to)
    )]
    Crossing {
        /// One end of the first such edge.
        from: DVec3,
        /// Its other end.
        to: DVec3,
    },
    /// A part lies in another, or is inside out.
    #[error(
        "has a part (of {parts}) that lies in another or is inside out, near {} (mm, the tip at height 0)",
        placed(*.near)
    )]
    Misplaced {
        /// How many parts there are.
        parts: usize,
        /// Where that was seen.
        near: DVec3,
    },
    /// The size is implausible for an indenter.
    #[error("is {extent_mm:.4} mm across when read in {unit}")]
    Size {
        /// Largest extent, mm.
        extent_mm: f64,
        /// Unit it was read in.
        unit: &'static str,
        /// What to try.
        advice: String,
    },
}

impl Defect {
    /// What would have been accepted.
    pub fn allowed(&self) -> String {
        match self {
            Self::Unreadable(_) | Self::NotStl(_) | Self::Truncated { .. } => "a whole STL file".to_owned(),
            Self::Size { .. } => {
                format!("an indenter of {} to {} mm across", PLAUSIBLE_MM.0, PLAUSIBLE_MM.1)
            }
            _ => "a closed mesh that bounds a solid".to_owned(),
        }
    }

    /// The next move.
    pub fn advice(&self) -> &str {
        match self {
            Self::Unreadable(_) => "check the path, which is relative to the indenter file",
            Self::NotStl(_) => "export the mesh as binary or ASCII STL",
            Self::Truncated { .. } => "copy or export it again",
            Self::Empty { .. } => "export the solid again",
            Self::NotFinite { .. } => "repair the mesh",
            Self::OpenEdges { .. } => "close the holes (e.g. \"make manifold\" in a mesh editor)",
            Self::NonManifold { .. } => "remove inner faces or separate the touching solids",
            Self::Orientation { .. } => "recalculate the normals",
            Self::Flat { .. } => "give that part a thickness, or remove it",
            Self::Crossing { .. } => {
                "unite the overlapping solids or untangle the mesh (\"boolean union\" or \"make manifold\" in a mesh editor)"
            }
            Self::Misplaced { .. } => "remove or unite that part, or recalculate its normals",
            Self::Size { advice, .. } => advice,
        }
    }
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

/// A place in mm, to the micrometre.
fn placed(at: DVec3) -> DVec3 {
    rounded(at, 1e3)
}

/// A place in file units, to the millionth: they may be metres.
fn in_file(at: DVec3) -> DVec3 {
    rounded(at, 1e6)
}

fn rounded(at: DVec3, parts: f64) -> DVec3 {
    // Adding 0 takes the sign from -0.
    (at * parts).round() / parts + 0.0
}
