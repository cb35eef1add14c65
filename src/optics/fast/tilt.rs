//! How the light on upright flanks changes with height.
//!
//! A flank is as narrow as a pixel in the picture, and one cell of the bounce stands for all of it. But what lies at its foot
//! sees its lowest part alone: within a tenth of its height from it, half of what it sees is the lowest fifth. Lights stand
//! high or low, and between foot and rim a flank's light changes by up to a half. So a straight line is laid through the
//! light of its parts.

use super::packed::Packing;
use glam::Vec3;

/// Parts of flanks that span less than about this height tell of no line, mm.
const LEAST_MM: f32 = 0.1;
/// A flank is looked at from so many standard deviations of its parts' heights below their mean: there stands a tenth of an even
/// flank's height below the middle of its lower half.
const LOWER: f32 = 1.2;

/// Parts of flanks, of a row of blocks.
#[derive(Debug, Clone, Default)]
pub struct Parts {
    /// Cell of the bounce, height in mm, and area in pixels of a level one.
    parts: Vec<(usize, f32, f32)>,
    /// Their irradiance, picture by picture.
    lights: Vec<Vec3>,
}

impl Parts {
    /// Adds a part of a flank. Then comes [`Parts::light`], once a picture.
    #[inline(always)]
    pub fn add(&mut self, cell: usize, height_mm: f32, area: f32) {
        self.parts.push((cell, height_mm, area));
    }

    /// Its irradiance.
    #[inline(always)]
    pub fn light(&mut self, light: Vec3) {
        self.lights.push(light);
    }
}

/// How the light of cells that stand for flanks changes with height.
#[derive(Debug, Clone, PartialEq)]
pub struct Tilts {
    /// By picture and cell: by how much, 1/mm. Empty where there are no flanks.
    pub lights: Vec<Vec<Vec3>>,
    /// By cell: how far below the middle what is low on it stands, mm.
    pub lower_mm: Vec<f32>,
}

/// What is summed up of a cell's parts: area, times height, times its square, mm^2.
type Moments = [f32; 3];

impl Tilts {
    /// The same of pictures that are [taken together](Packing).
    pub fn packed(&self, packing: Packing) -> Self {
        Self { lights: packing.pack(&self.lights), lower_mm: self.lower_mm.clone() }
    }

    /// Of a picture without flanks.
    pub const NONE: Self = Self { lights: Vec::new(), lower_mm: Vec::new() };

    /// From what rows of blocks show, each of so many cells.
    pub fn of(rows: &[Parts], in_row: usize, films: usize) -> Self {
        if rows.iter().all(|row| row.parts.is_empty()) {
            return Self::NONE;
        }
        let cells = rows.len() * in_row;
        let mut out = Self { lights: vec![vec![Vec3::ZERO; cells]; films], lower_mm: vec![0.0; cells] };
        let mut moments: Vec<Moments> = vec![[0.0; 3]; in_row];
        let mut lights = vec![[Vec3::ZERO; 2]; in_row * films];
        for (row, of_row) in rows.iter().enumerate().filter(|(_, row)| !row.parts.is_empty()) {
            moments.fill([0.0; 3]);
            lights.fill([Vec3::ZERO; 2]);
            for (&(cell, z, area), of_part) in of_row.parts.iter().zip(of_row.lights.chunks_exact(films)) {
                let weights = [area, area * z, area * z * z];
                moments[cell].iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
                for (sum, light) in lights[cell * films..][..films].iter_mut().zip(of_part) {
                    sum[0] += *light * area;
                    sum[1] += *light * (area * z);
                }
            }
            for (cell, [area, first, second]) in moments.iter().enumerate().filter(|(_, m)| m[0] > 0.0) {
                let (at, middle) = (row * in_row + cell, first / area);
                let spread = (second / area - middle * middle).max(0.0);
                if spread > LEAST_MM * LEAST_MM / 12.0 {
                    out.lower_mm[at] = LOWER * spread.sqrt();
                }
                let spread = spread + LEAST_MM * LEAST_MM / 12.0;
                for (film, [light, raised]) in lights[cell * films..][..films].iter().enumerate() {
                    out.lights[film][at] = (*raised - *light * middle) / (area * spread);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_parts_of_any_size_is_found_and_none_through_one() {
        let mut rows = vec![Parts::default(); 2];
        let light = |film: f32, z: f32| Vec3::new(1.0, 2.0 + 0.5 * z, 4.0 - z) * film;
        for (z, area) in [(0.1, 3.0), (0.5, 1.0), (0.9, 7.0)] {
            rows[1].add(2, z, area);
            (0..2).for_each(|film| rows[1].light(light(film as f32 + 1.0, z)));
        }
        rows[1].add(0, 0.4, 5.0);
        (0..2).for_each(|_| rows[1].light(Vec3::ONE));
        let Tilts { lights, lower_mm } = Tilts::of(&rows, 3, 2);
        for (film, tilts) in lights.iter().enumerate() {
            let truth = Vec3::new(0.0, 0.5, -1.0) * (film as f32 + 1.0);
            assert!(
                (tilts[5] / truth.y - truth / truth.y).abs().max_element() < 0.03,
                "{} {truth}",
                tilts[5]
            );
            assert!(tilts[..5].iter().all(|tilt| tilt.abs().max_element() < 1e-6));
        }
        assert!(
            (lower_mm[5] - 1.2 * 0.35).abs() < 0.03 && lower_mm[..5].iter().all(|l| *l == 0.0),
            "{lower_mm:?}"
        );
        assert_eq!(Tilts::of(&[Parts::default()], 3, 1), Tilts::NONE);
    }
}
