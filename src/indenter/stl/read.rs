//! STL bytes to triangles: the binary form (80-byte header, count, 50 bytes each, little endian) and
//! the ASCII form (`facet`, `vertex x y z`). Stored normals are ignored: corners in order say it all.

use super::Defect;
use glam::DVec3;

/// Corners of every triangle, in file units.
///
/// # Errors
/// When the bytes are no STL, are cut short, or hold something that is no number.
pub fn triangles(bytes: &[u8]) -> Result<Vec<[DVec3; 3]>, Defect> {
    // Many binary files begin with "solid" too, so the length decides first.
    let announced = bytes.get(80..84).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]));
    let expected = announced.map(|n| 84 + 50 * u64::from(n));
    let found = if expected == Some(bytes.len() as u64) {
        binary(&bytes[84..])
    } else if bytes.trim_ascii_start().starts_with(b"solid") && bytes.is_ascii() {
        ascii(std::str::from_utf8(bytes).expect("ASCII is UTF-8"))?
    } else {
        return Err(match (announced, expected) {
            (Some(triangles), Some(expected)) if expected > bytes.len() as u64 && expected < 1 << 34 => {
                Defect::Truncated { triangles, expected, found: bytes.len() as u64 }
            }
            (Some(n), _) => Defect::NotStl(format!(
                "it does not begin with \"solid\", and {} bytes do not fit {n} binary triangles",
                bytes.len()
            )),
            _ => {
                Defect::NotStl(format!("it has only {} bytes and does not begin with \"solid\"", bytes.len()))
            }
        });
    };
    match found.iter().position(|t| t.iter().any(|v| !v.is_finite())) {
        Some(triangle) => Err(Defect::NotFinite { triangle }),
        None => Ok(found),
    }
}

fn binary(bytes: &[u8]) -> Vec<[DVec3; 3]> {
    let number = |b: &[u8], i: usize| f64::from(f32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]));
    let corner = |b: &[u8], k: usize| {
        let i = 12 + 12 * k;
        DVec3::new(number(b, i), number(b, i + 4), number(b, i + 8))
    };
    bytes.chunks_exact(50).map(|b| [corner(b, 0), corner(b, 1), corner(b, 2)]).collect()
}

fn ascii(text: &str) -> Result<Vec<[DVec3; 3]>, Defect> {
    let mut corners = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        if words.next() != Some("vertex") {
            continue;
        }
        let numbers: Vec<f64> = words.map_while(|w| w.parse().ok()).collect();
        let [x, y, z] = numbers[..] else {
            return Err(Defect::NotStl(format!("line {}: \"{}\" is no vertex", i + 1, line.trim())));
        };
        corners.push(DVec3::new(x, y, z));
    }
    if corners.len() % 3 != 0 {
        return Err(Defect::NotStl(format!("{} vertices do not make whole triangles", corners.len())));
    }
    Ok(corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect())
}
