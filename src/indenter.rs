//! Indenters: rigid bodies known by their signed distance.
//!
//! The frame of an indenter has its lowest point (the tip) at the origin's height and its body
//! towards +z; x and y are those of the pad at zero rotation. Points are `DVec3` in mm.
//!
//! [`spec`] is the file format, [`build`](mod@self) makes a [`solid`] of plane [`outline`]s from it,
//! [`stl`] loads a mesh instead. Whoever needs an indenter calls [`from_spec`].

mod build;
pub mod outline;
pub mod solid;
pub mod spec;
pub mod stl;
pub mod thin;

pub use spec::IndenterSpec;

use crate::cache::Store;
use crate::problem::{Problem, Problems};
use glam::{DVec2, DVec3};
use solid::Solid;
use spec::Shape;
use std::sync::{Arc, OnceLock};

/// A rigid indenter.
pub trait Indenter: Send + Sync + std::fmt::Debug {
    /// Name, the stem of its file.
    fn name(&self) -> &str;

    /// Signed distance from `p` to the surface, mm, negative inside. Exact near the surface;
    /// far away it may be a lower bound of the true distance.
    fn distance(&self, p: DVec3) -> f64;

    /// Signed distance and its unit gradient (outward normal) at `p`.
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3);

    /// Half extents of the body in x and y, mm: it lies within |x| <= hx, |y| <= hy.
    fn half_extent_mm(&self) -> [f64; 2];

    /// Height of the body, mm: pressed deeper, a face would close above it.
    fn height_mm(&self) -> f64 {
        f64::INFINITY
    }

    /// Height of the body's lower surface above the tip plane at (x, y), mm; `None` beside the body.
    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64>;

    /// Points of the undersides of parts that are narrower than [`thin::WIDE_MM`], in the indenter's frame. They are looked for once.
    fn thin_parts(&self) -> &[DVec3] {
        &[]
    }
}

/// Why an indenter could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Numbers in the file make no sense.
    Spec {
        /// Which.
        name: String,
        /// Everything that is wrong.
        problems: Vec<Problem>,
    },
    /// The round is wider than the narrowest body it has to fit into.
    RoundTooLarge {
        /// Which.
        name: String,
        /// The round asked for.
        edge_round_mm: f64,
        /// The largest that fits.
        largest_mm: f64,
    },
    /// The mesh is defective.
    Stl {
        /// Which.
        name: String,
        /// File and defect.
        source: stl::Error,
    },
    /// Rounding is a property of parametric solids.
    RoundOnMesh {
        /// Which.
        name: String,
        /// The round asked for.
        edge_round_mm: f64,
    },
}

impl Error {
    /// The same as a problem of the file that names the indenter by `key`.
    pub fn problem(&self, key: &str) -> Problem {
        let (name, fault, allowed, next) = match self {
            Self::Spec { name, problems } => {
                let list =
                    |of: &dyn Fn(&Problem) -> String| problems.iter().map(of).collect::<Vec<_>>().join("; ");
                let fault = list(&|p| format!("{} = {}", p.key, p.value));
                (name, fault, list(&|p| p.allowed.clone()), list(&|p| p.next.clone()))
            }
            Self::RoundTooLarge { name, edge_round_mm, largest_mm } => (
                name,
                format!("its edges cannot be rounded by {edge_round_mm} mm, the body is too narrow"),
                format!("less than {largest_mm:.3} mm"),
                format!("choose edge_round_mm below {largest_mm:.3} or a wider body"),
            ),
            Self::Stl { name, source: stl::Error { path, defect } } => {
                (name, format!("{} {defect}", path.display()), defect.allowed(), defect.advice().to_owned())
            }
            Self::RoundOnMesh { name, edge_round_mm } => (
                name,
                format!("the edges of a mesh cannot be rounded (edge_round_mm = {edge_round_mm})"),
                "0 mm for a mesh".to_owned(),
                "round them in the STL file and set edge_round_mm = 0 for this indenter".to_owned(),
            ),
        };
        Problem { key: key.to_owned(), value: format!("{name}: {fault}"), allowed, next }
    }
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Problem { value, allowed, next, .. } = self.problem("");
        write!(f, "indenter {value}; allowed: {allowed}; {next}")
    }
}

/// Makes an indenter from its file; `edge_round_mm` replaces the file's own where it is given.
///
/// # Errors
/// When the spec does not pass its check, the round does not fit, or the mesh is no closed solid.
pub fn from_spec(
    name: &str,
    spec: &IndenterSpec,
    edge_round_mm: Option<f64>,
) -> Result<Arc<dyn Indenter>, Error> {
    from_spec_or_store(name, spec, edge_round_mm, None)
}

/// As [`from_spec`], with a folder ([`stl::kept::KIND`]) that remembers large meshes between runs.
///
/// # Errors
/// As [`from_spec`].
pub fn from_spec_or_store(
    name: &str,
    spec: &IndenterSpec,
    edge_round_mm: Option<f64>,
    store: Option<&Store>,
) -> Result<Arc<dyn Indenter>, Error> {
    let mut spec = spec.clone();
    spec.edge_round_mm = edge_round_mm.unwrap_or(spec.edge_round_mm);
    let mut problems = Problems::new();
    spec.check(&mut problems);
    if !problems.is_empty() {
        return Err(Error::Spec { name: name.to_owned(), problems: problems.into_vec() });
    }
    if let Shape::Stl { path, unit, tip, centre } = &spec.shape {
        if spec.edge_round_mm > 0.0 {
            return Err(Error::RoundOnMesh { name: name.to_owned(), edge_round_mm: spec.edge_round_mm });
        }
        let mesh = stl::load(name, path, *unit, *tip, *centre, store);
        return Ok(Arc::new(mesh.map_err(|source| Error::Stl { name: name.to_owned(), source })?));
    }
    let solid = build::solid(&spec, spec.edge_round_mm).map_err(|e| Error::RoundTooLarge {
        name: name.to_owned(),
        edge_round_mm: spec.edge_round_mm,
        largest_mm: e.largest_mm,
    })?;
    let (half_extent, height_mm) = (solid.half_extent(), spec.height_mm);
    let name = name.to_owned();
    Ok(Arc::new(Parametric { name, half_extent, height_mm, solid, thin_parts: OnceLock::new() }))
}

/// An indenter made of swept outlines.
#[derive(Debug)]
struct Parametric {
    name: String,
    solid: Solid,
    half_extent: DVec2,
    height_mm: f64,
    thin_parts: OnceLock<Vec<DVec3>>,
}

impl Indenter for Parametric {
    fn name(&self) -> &str {
        &self.name
    }

    fn distance(&self, p: DVec3) -> f64 {
        self.solid.distance_and_normal(p).0
    }

    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        self.solid.distance_and_normal(p)
    }

    fn half_extent_mm(&self) -> [f64; 2] {
        self.half_extent.into()
    }

    fn height_mm(&self) -> f64 {
        self.height_mm
    }

    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        self.solid.lower_surface(DVec2::new(x_mm, y_mm))
    }

    fn thin_parts(&self) -> &[DVec3] {
        self.thin_parts.get_or_init(|| thin::parts(self))
    }
}

#[cfg(test)]
mod tests;
