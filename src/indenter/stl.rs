//! Indenters from watertight meshes in STL files.
//!
//! Four stages: [`read`] turns the file into triangles, [`topology`] welds their corners and proves
//! that they close up, [`mesh`] answers closest-point queries on a hierarchy of boxes, [`solidity`] proves that they bound a
//! solid. The sign comes from angle-weighted pseudonormals (Baerentzen and Aanaes 2005), which is exact for closed meshes, so
//! sharp features are kept: nothing is resampled. Edges of a mesh cannot be rounded. What the first two and the last stage made
//! of a large file is [`kept`] for later runs.

pub mod defect;
pub mod kept;
pub mod mesh;
pub mod read;
pub mod solidity;
pub mod topology;

pub use defect::Defect;

use super::spec::{Centre, LengthUnit, TipEnd};
use crate::cache::Store;
use glam::DVec3;
use mesh::Mesh;
use std::path::{Path, PathBuf};
use topology::Solid;

/// Smallest and largest plausible extent of an indenter, mm; outside, the unit is doubted.
const PLAUSIBLE_MM: (f64, f64) = (0.5, 200.0);

/// Why a file did not become an indenter.
#[derive(Debug, thiserror::Error)]
#[error("{path} {defect}; {}", .defect.advice())]
pub struct Error {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub defect: Defect,
}

/// Loads a mesh, checks that it is a closed solid, and puts its tip at z = 0 with the body towards +z. What the checks of a
/// large file made of it is kept in `store`, and taken from there when the same file is loaded again.
///
/// # Errors
/// Names the file and the defect.
pub fn load(
    name: &str,
    path: &Path,
    unit: LengthUnit,
    tip: TipEnd,
    centre: Centre,
    store: Option<&Store>,
) -> Result<Mesh, Error> {
    let load = || -> Result<Mesh, Defect> {
        let file = std::fs::read(path)?;
        let Some(store) = store.filter(|_| file.len() >= kept::WORTH_KEEPING) else {
            return checked(name, &file, unit, tip, centre).map(|(mesh, _)| mesh);
        };
        let key = kept::key(&file, unit, tip, centre);
        if let Some(solid) = store.take(&key, kept::decode) {
            return Ok(Mesh::new(name, &solid));
        }
        let (mesh, solid) = checked(name, &file, unit, tip, centre)?;
        store.keep(&key, &kept::encode(&solid));
        Ok(mesh)
    };
    load().map_err(|defect| Error { path: path.to_owned(), defect })
}

/// The solid of a file's bytes in its place, and its mesh.
fn checked(
    name: &str,
    file: &[u8],
    unit: LengthUnit,
    tip: TipEnd,
    centre: Centre,
) -> Result<(Mesh, Solid), Defect> {
    let mut solid = topology::close(&read::triangles(file)?)?;
    let (low, high) = bounds(&solid.vertices);
    check_size(high - low, unit)?;

    // Into millimetres, tip down, tip at height 0.
    let scale = unit.in_mm();
    let axis = match centre {
        Centre::Bounds => (low + high) / 2.0,
        Centre::Origin => DVec3::ZERO,
    };
    for v in &mut solid.vertices {
        *v = match tip {
            TipEnd::MinusZ => DVec3::new(v.x - axis.x, v.y - axis.y, v.z - low.z),
            // Half a turn about x: a proper rotation, which keeps the mesh from being mirrored.
            TipEnd::PlusZ => DVec3::new(v.x - axis.x, axis.y - v.y, high.z - v.z),
        } * scale;
    }
    let mesh = Mesh::new(name, &solid);
    Ok(match solidity::check(&mesh, &solid)? {
        Some(filled) => (Mesh::new(name, &filled), filled),
        None => (mesh, solid),
    })
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)))
}

fn check_size(extent: DVec3, unit: LengthUnit) -> Result<(), Defect> {
    let plausible = |u: LengthUnit| {
        let mm = extent.max_element() * u.in_mm();
        (PLAUSIBLE_MM.0..=PLAUSIBLE_MM.1).contains(&mm)
    };
    if plausible(unit) {
        return Ok(());
    }
    let all = [LengthUnit::Millimetre, LengthUnit::Metre, LengthUnit::Inch];
    let advice = match all.into_iter().find(|&u| plausible(u)) {
        Some(u) => format!("the file is probably in {}: set unit = \"{}\"", u.name(), u.name()),
        None => "scale the mesh to the indenter's true size".to_owned(),
    };
    Err(Defect::Size { extent_mm: extent.max_element() * unit.in_mm(), unit: unit.name(), advice })
}

#[cfg(test)]
mod tests;
