//! Arrays of three floats per cell as npy files: linear pictures and displaced surfaces.

use glam::Vec3;

/// A float32 array of shape (rows, columns, 3), C order, little endian, npy version 1.0.
pub fn encode(rows: usize, columns: usize, values: &[Vec3]) -> Vec<u8> {
    let dict = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, {columns}, 3), }}");
    // Magic, version, header length; the header is padded so that the data starts at a multiple of 64.
    let padded = (10 + dict.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = Vec::with_capacity(10 + padded + values.len() * 12);
    bytes.extend_from_slice(b"\x93NUMPY\x01\x00");
    bytes.extend_from_slice(&(padded as u16).to_le_bytes());
    bytes.extend_from_slice(format!("{dict:<width$}\n", width = padded - 1).as_bytes());
    bytes.extend(values.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes));
    bytes
}
