//! Which triangle of a lattice is on top at each sample of a raster.
//!
//! The vertices come projected: raster coordinates and a value that is linear over a triangle in the raster, of which
//! the largest wins: the inverse depth for a camera, the height for a look from above. Bands of rows are
//! independent, so that the result does not depend on threads.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Rows of a band.
const BAND: usize = 16;
/// Samples this far outside an edge still belong to it, so that rounding opens no cracks, in samples.
const SLACK: f32 = 1e-4;

/// What a sample shows. No triangle: `value` is minus infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The interpolated value.
    pub value: f32,
    /// Triangle, in the order of [`crate::optics::Mesh::from_lattice`].
    pub triangle: u32,
}

/// Nothing there.
pub const EMPTY: Sample = Sample { value: f32::NEG_INFINITY, triangle: u32::MAX };

/// A lattice ready to be drawn.
pub struct Projected<'a> {
    /// Points along x and y.
    pub lattice: [usize; 2],
    /// By vertex: x, y in samples, and the value.
    pub vertices: &'a [Vec3],
}

impl Projected<'_> {
    /// Draws bands of rows and hands each to `use_band` with its first row; returns the results in order.
    pub fn bands<T: Send>(
        &self,
        width: usize,
        height: usize,
        band_rows: usize,
        use_band: impl Fn(usize, &[Sample]) -> T + Sync,
    ) -> Vec<T> {
        let [nx, ny] = self.lattice;
        // Lowest and highest sample row of each row of quads.
        let reach: Vec<[f32; 2]> = self
            .vertices
            .par_chunks_exact(nx)
            .map(|row| {
                row.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], v| [l.min(v.y), h.max(v.y)])
            })
            .collect();
        let rows = if band_rows == 0 { BAND } else { band_rows };
        (0..height.div_ceil(rows))
            .into_par_iter()
            .map(|band| {
                let first = band * rows;
                let last = (first + rows).min(height);
                let mut samples = vec![EMPTY; (last - first) * width];
                for j in 0..ny - 1 {
                    let low = reach[j][0].min(reach[j + 1][0]);
                    let high = reach[j][1].max(reach[j + 1][1]);
                    // Not so for what is not a number: such rows are drawn and their triangles dropped.
                    if high < first as f32 - 1.0 || low > last as f32 + 1.0 {
                        continue;
                    }
                    let mut target = Target { samples: &mut samples, width, first, last };
                    for i in 0..nx - 1 {
                        let a = j * nx + i;
                        let [va, vb, vc, vd] = [a, a + 1, a + nx + 1, a + nx].map(|k| self.vertices[k]);
                        let id = 2 * (j * (nx - 1) + i) as u32;
                        target.triangle([va, vb, vc], id);
                        target.triangle([va, vc, vd], id + 1);
                    }
                }
                use_band(first, &samples)
            })
            .collect()
    }
}

struct Target<'a> {
    samples: &'a mut [Sample],
    width: usize,
    first: usize,
    last: usize,
}

impl Target<'_> {
    #[inline(always)]
    fn triangle(&mut self, [a, b, c]: [Vec3; 3], id: u32) {
        // Samples stand at half-integers.
        let low = a.min(b).min(c);
        let high = a.max(b).max(c);
        let y0 = ((low.y - 0.5 - SLACK).ceil() as i32).max(self.first as i32);
        let y1 = ((high.y - 0.5 + SLACK).floor() as i32).min(self.last as i32 - 1);
        let x0 = ((low.x - 0.5 - SLACK).ceil() as i32).max(0);
        let x1 = ((high.x - 0.5 + SLACK).floor() as i32).min(self.width as i32 - 1);
        if x0 > x1 || y0 > y1 {
            return;
        }
        let (pa, pb, pc): (Vec2, Vec2, Vec2) = (a.truncate(), b.truncate(), c.truncate());
        let area = (pb - pa).perp_dot(pc - pa);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let inverse = 1.0 / area;
        let (eb, ec) = ((pa - pc) * inverse, (pb - pa) * inverse);
        let slack = SLACK * (eb.abs().max_element() + ec.abs().max_element());
        for y in y0..=y1 {
            for x in x0..=x1 {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let wb = eb.perp_dot(p - pc);
                let wc = ec.perp_dot(p - pa);
                let wa = 1.0 - wb - wc;
                if wa.min(wb).min(wc) >= -slack {
                    let value = a.z * wa + b.z * wb + c.z * wc;
                    let sample = &mut self.samples[(y as usize - self.first) * self.width + x as usize];
                    if value > sample.value {
                        *sample = Sample { value, triangle: id };
                    }
                }
            }
        }
    }
}

/// The corners of a lattice's triangle.
#[inline(always)]
pub fn corners(triangle: u32, nx: usize) -> [usize; 3] {
    let quad = triangle as usize / 2;
    let a = quad / (nx - 1) * nx + quad % (nx - 1);
    if triangle.is_multiple_of(2) { [a, a + 1, a + nx + 1] } else { [a, a + nx + 1, a + nx] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_inside_is_drawn_once_with_its_value() {
        let (nx, ny) = (13, 9);
        let at = |k: usize| {
            let (x, y) = ((k % nx) as f32 * 7.3 - 2.0, (k / nx) as f32 * 5.1 - 1.0);
            Vec3::new(x + 0.1 * y, y, 0.5 * x - 0.25 * y)
        };
        let vertices: Vec<Vec3> = (0..nx * ny).map(at).collect();
        let drawn = Projected { lattice: [nx, ny], vertices: &vertices };
        let samples: Vec<Sample> = drawn.bands(80, 37, 0, |_, band| band.to_vec()).concat();
        for (k, s) in samples.iter().enumerate() {
            let (px, py) = ((k % 80) as f32 + 0.5, (k / 80) as f32 + 0.5);
            let (x, y) = (px - 0.1 * py, py);
            let inside = x > -1.9 && x < 85.5;
            if inside {
                assert!((s.value - (0.5 * x - 0.25 * y)).abs() < 1e-3, "{px} {py} {s:?}");
                let [a, ..] = corners(s.triangle, nx);
                assert!((vertices[a].truncate() - Vec2::new(px, py)).length() < 10.0);
            }
        }
    }

    #[test]
    fn the_largest_value_wins() {
        let near = |z: f32| [(0.0, 0.0), (9.0, 0.0), (0.0, 9.0), (9.0, 9.0)].map(|(x, y)| Vec3::new(x, y, z));
        let mut folded = near(1.0).to_vec();
        folded.extend(near(2.0));
        let drawn = Projected { lattice: [2, 4], vertices: &folded };
        for band in drawn.bands(8, 8, 3, |_, band| band.to_vec()) {
            assert!(band.iter().all(|s| s.value > 1.9));
        }
    }
}
