//! Linear pictures: float RGB, row 0 on top, and how they are written.

use super::Error;
use crate::image::npy;
use glam::Vec3;
use std::path::Path;

/// A picture in linear RGB.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` values, row 0 on top.
    pub pixels: Vec<Vec3>,
}

impl Film {
    /// A black picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![Vec3::ZERO; width * height] }
    }

    /// The pixel in column `x` of row `y`.
    pub fn at(&self, x: usize, y: usize) -> Vec3 {
        self.pixels[y * self.width + x]
    }

    /// Means over squares of `grain` pixels.
    pub fn shrunk(&self, grain: usize) -> Film {
        let mut out = Film::new(self.width / grain, self.height / grain);
        for (k, p) in self.pixels.iter().enumerate() {
            out.pixels[k / self.width / grain * out.width + k % self.width / grain] += *p;
        }
        let share = 1.0 / (grain * grain) as f32;
        out.pixels.iter_mut().for_each(|p| *p *= share);
        out
    }

    /// The mean over all pixels.
    pub fn mean(&self) -> Vec3 {
        let sum = self.pixels.iter().fold(glam::DVec3::ZERO, |s, p| s + p.as_dvec3());
        (sum / self.pixels.len().max(1) as f64).as_vec3()
    }

    /// relRMSE against a converged picture: sqrt(mean((I - ref)^2)) / mean(ref), over pixels and channels.
    pub fn relative_rmse(&self, truth: &Film) -> f64 {
        let n = (self.pixels.len() * 3) as f64;
        let square: f64 =
            self.pixels.iter().zip(&truth.pixels).map(|(a, b)| (*a - *b).as_dvec3().length_squared()).sum();
        let mean: f64 = truth.pixels.iter().map(|p| p.as_dvec3().element_sum()).sum::<f64>() / n;
        // Black against black is no difference.
        if square == 0.0 { 0.0 } else { (square / n).sqrt() / mean }
    }

    /// 8-bit code values: round(255 oetf(clip(value * exposure, 0, 1))) with the sRGB transfer function.
    pub fn to_srgb8(&self, exposure: f32) -> Vec<u8> {
        let code = |v: f32| (255.0 * linear_to_srgb((v * exposure).clamp(0.0, 1.0))).round() as u8;
        self.pixels.iter().flat_map(|p| p.to_array().map(code)).collect()
    }

    /// The picture as an npy file: float32, shape (height, width, 3), C order, little endian.
    pub fn to_npy(&self) -> Vec<u8> {
        npy::encode(self.height, self.width, &self.pixels)
    }

    /// Reads what [`Film::to_npy`] writes (and NumPy's own float32 (h, w, 3) arrays).
    ///
    /// # Errors
    /// When the bytes are no little-endian float32 C-order array of shape (h, w, 3); `path` is named.
    pub fn from_npy(bytes: &[u8], path: &str) -> Result<Self, Error> {
        let fault = |reason: &str| Error::Content {
            path: path.to_owned(),
            reason: format!("{reason} (expected npy 1.0, float32, shape (h, w, 3))"),
            next: "write it anew, e.g. with numpy.save(path, picture.astype(numpy.float32))",
        };
        if bytes.len() < 10 || &bytes[..8] != b"\x93NUMPY\x01\x00" {
            return Err(fault("no npy header"));
        }
        let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = bytes.get(10..start).and_then(|h| std::str::from_utf8(h).ok());
        let header = header.ok_or_else(|| fault("header cut short"))?;
        if !header.contains("'<f4'") || !header.contains("'fortran_order': False") {
            return Err(fault("wrong type or order"));
        }
        let shape = header.split_once('(').and_then(|(_, rest)| rest.split_once(')')).map(|(s, _)| s);
        let shape: Vec<usize> =
            shape.unwrap_or("").split(',').filter_map(|n| n.trim().parse().ok()).collect();
        let [height, width, 3] = shape[..] else { return Err(fault("wrong shape")) };
        let data = &bytes[start..];
        if data.len() != height * width * 12 {
            return Err(fault("data cut short"));
        }
        let value = |c: &[u8]| f32::from_le_bytes([c[0], c[1], c[2], c[3]]);
        let pixels = data
            .chunks_exact(12)
            .map(|p| Vec3::new(value(&p[..4]), value(&p[4..8]), value(&p[8..])))
            .collect();
        Ok(Self { width, height, pixels })
    }

    /// Writes the picture as npy.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_npy(&self, path: &Path) -> Result<(), Error> {
        std::fs::write(path, self.to_npy()).map_err(|e| Error::File {
            action: "write",
            path: path.display().to_string(),
            reason: e.to_string(),
        })
    }
}

/// The sRGB transfer function (IEC 61966-2-1), 0 to 1.
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Linear value of an sRGB code value.
pub fn srgb_to_linear(code: u8) -> f32 {
    let v = f32::from(code) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn npy_makes_the_round_trip_and_starts_its_data_aligned() {
        let mut film = Film::new(3, 2);
        film.pixels[4] = Vec3::new(1.5, -2.0, 1e-9);
        let bytes = film.to_npy();
        assert_eq!((bytes.len() - 3 * 2 * 12) % 64, 0);
        assert_eq!(Film::from_npy(&bytes, "x").unwrap(), film);
        assert!(
            Film::from_npy(&bytes[..bytes.len() - 1], "x").unwrap_err().to_string().contains("cut short")
        );
    }

    #[test]
    fn codes_survive_decoding_and_encoding() {
        for code in 0..=255u8 {
            let film = Film { width: 1, height: 1, pixels: vec![Vec3::splat(srgb_to_linear(code))] };
            assert_eq!(film.to_srgb8(1.0), [code; 3]);
        }
    }
}
