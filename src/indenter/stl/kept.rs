//! What proving a large mesh sound takes seconds for, kept between runs: the welded, checked and placed solid.
//!
//! The hierarchy of boxes is built anew each time: reading it would take as long, and ten times the space.

use super::topology::Solid;
use crate::cache::Kind;
use crate::indenter::spec::{Centre, LengthUnit, TipEnd};
use glam::DVec3;

/// Folders of checked solids: about ten of a million triangles. The number changes whenever a mesh is welded, checked or placed in
/// another way: what was accepted before must not stand for what is now.
pub const KIND: Kind = Kind { magic: *b"twinrig solids 2", what: "mesh", most_bytes: 1 << 28 };

/// Smaller files are checked in less time than anybody notices, bytes.
pub const WORTH_KEEPING: usize = 1 << 20;

/// The hash of everything that a solid follows from.
pub fn key(file: &[u8], unit: LengthUnit, tip: TipEnd, centre: Centre) -> [u8; 32] {
    let mut hash = blake3::Hasher::new();
    let tip = match tip {
        TipEnd::PlusZ => 0,
        TipEnd::MinusZ => 1,
    };
    let centre = match centre {
        Centre::Bounds => 0,
        Centre::Origin => 1,
    };
    hash.update(&unit.in_mm().to_le_bytes()).update(&[tip, centre]).update(file);
    *hash.finalize().as_bytes()
}

/// A solid as bytes: how many vertices, the vertices, the triangles; little endian.
pub fn encode(solid: &Solid) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(8 + 24 * solid.vertices.len() + 12 * solid.triangles.len());
    bytes.extend((solid.vertices.len() as u64).to_le_bytes());
    bytes.extend(solid.vertices.iter().flat_map(|v| v.to_array()).flat_map(f64::to_le_bytes));
    bytes.extend(solid.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()));
    bytes
}

/// The solid from its bytes; None when they are none.
pub fn decode(bytes: &[u8]) -> Option<Solid> {
    let (count, rest) = bytes.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*count)).ok()?.checked_mul(24)?;
    let (vertices, triangles) = rest.split_at_checked(length)?;
    let (coordinates, _) = vertices.as_chunks::<8>();
    let coordinates: Vec<f64> = coordinates.iter().map(|b| f64::from_le_bytes(*b)).collect();
    let vertices: Vec<DVec3> = coordinates.chunks_exact(3).map(DVec3::from_slice).collect();
    let (indices, left) = triangles.as_chunks::<4>();
    let indices: Vec<u32> = indices.iter().map(|b| u32::from_le_bytes(*b)).collect();
    let (triangles, odd) = indices.as_chunks::<3>();
    let fits = indices.iter().all(|i| (*i as usize) < vertices.len());
    let is_solid = fits && left.is_empty() && odd.is_empty() && !triangles.is_empty();
    is_solid.then(|| Solid { triangles: triangles.to_vec(), vertices })
}
