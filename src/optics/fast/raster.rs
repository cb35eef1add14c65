//! Which triangle of a lattice is on top at each sample of a raster.
//!
//! The vertices come projected: raster coordinates and a value that is linear over a triangle in the raster, of which
//! the largest wins: the inverse depth for a camera, the height for a look from above. Bands of rows are
//! independent, so that the result does not depend on threads.

use super::lanes::{Work, with_widest};
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
    /// Where samples stand within their cell: 0 at its corner, 0.5 at its middle.
    pub offset: f32,
}

impl Projected<'_> {
    /// Draws everything, row by row.
    pub fn draw(&self, width: usize, height: usize) -> Vec<Sample> {
        let [nx, _] = self.lattice;
        // Lowest and highest y of each row of vertices.
        let reach: Vec<[f32; 2]> = self
            .vertices
            .par_chunks_exact(nx)
            .with_min_len(64)
            .map(|row| {
                row.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], v| [l.min(v.y), h.max(v.y)])
            })
            .collect();
        let mut samples = vec![EMPTY; width * height];
        samples.par_chunks_mut(BAND * width).enumerate().for_each(|(band, samples)| {
            let target = Target { samples, width, first: band * BAND, offset: self.offset };
            with_widest(Band { drawn: self, reach: &reach, target });
        });
        samples
    }
}

struct Band<'a> {
    drawn: &'a Projected<'a>,
    reach: &'a [[f32; 2]],
    target: Target<'a>,
}

impl Work for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Band { drawn, reach, mut target } = self;
        let [nx, ny] = drawn.lattice;
        let (first, last) =
            (target.first as f32, (target.first + target.samples.len() / target.width) as f32);
        for j in 0..ny - 1 {
            let low = reach[j][0].min(reach[j + 1][0]);
            let high = reach[j][1].max(reach[j + 1][1]);
            // Not so for what is not a number: such rows are drawn and their triangles dropped.
            if high < first - 1.0 || low > last + 1.0 {
                continue;
            }
            let below = &drawn.vertices[j * nx..(j + 1) * nx];
            let above = &drawn.vertices[(j + 1) * nx..(j + 2) * nx];
            let (mut va, mut vd) = (below[0], above[0]);
            let mut id = 2 * (j * (nx - 1)) as u32;
            for (&vb, &vc) in below[1..].iter().zip(&above[1..]) {
                target.quad([va, vb, vc, vd], id);
                id += 2;
                (va, vd) = (vb, vc);
            }
        }
    }
}

struct Target<'a> {
    samples: &'a mut [Sample],
    width: usize,
    first: usize,
    offset: f32,
}

impl Target<'_> {
    /// The two triangles of a quad, (a, b, c) and (a, c, d).
    #[inline(always)]
    fn quad(&mut self, [a, b, c, d]: [Vec3; 4], id: u32) {
        let low_y = a.y.min(b.y).min(c.y.min(d.y)) - self.offset - SLACK;
        let high_y = a.y.max(b.y).max(c.y.max(d.y)) - self.offset + SLACK;
        let rows = self.samples.len() / self.width;
        let y0 = first_at(low_y - self.first as f32);
        let y1 = past(high_y - self.first as f32, rows);
        if y0 >= y1 {
            return;
        }
        let low_x = a.x.min(b.x).min(c.x.min(d.x)) - self.offset - SLACK;
        let high_x = a.x.max(b.x).max(c.x.max(d.x)) - self.offset + SLACK;
        let (x0, x1) = (first_at(low_x), past(high_x, self.width));
        if x0 >= x1 {
            return;
        }
        self.triangle([a, b, c], id, [x0, x1, y0, y1]);
        self.triangle([a, c, d], id + 1, [x0, x1, y0, y1]);
    }

    #[inline(always)]
    fn triangle(&mut self, [a, b, c]: [Vec3; 3], id: u32, [x0, x1, y0, y1]: [usize; 4]) {
        let (pa, pb, pc): (Vec2, Vec2, Vec2) = (a.truncate(), b.truncate(), c.truncate());
        let area = (pb - pa).perp_dot(pc - pa);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let inverse = 1.0 / area;
        let (eb, ec) = ((pa - pc) * inverse, (pb - pa) * inverse);
        let slack = SLACK * (eb.abs().max_element() + ec.abs().max_element());
        for y in y0..y1 {
            for x in x0..x1 {
                let p = Vec2::new(x as f32 + self.offset, (self.first + y) as f32 + self.offset);
                let wb = eb.perp_dot(p - pc);
                let wc = ec.perp_dot(p - pa);
                let wa = 1.0 - wb - wc;
                if wa.min(wb).min(wc) >= -slack {
                    let value = a.z * wa + b.z * wb + c.z * wc;
                    let sample = &mut self.samples[y * self.width + x];
                    if value > sample.value {
                        *sample = Sample { value, triangle: id };
                    }
                }
            }
        }
    }
}

/// The first sample at or after `x`. (A camera sees points beside itself as far away as numbers go.)
#[inline(always)]
fn first_at(x: f32) -> usize {
    let whole = x.max(0.0) as usize;
    whole.saturating_add(usize::from((whole as f32) < x))
}

/// The sample after the last one at or before `x`, of `n`.
#[inline(always)]
fn past(x: f32, n: usize) -> usize {
    if x < 0.0 { 0 } else { (x as usize).saturating_add(1).min(n) }
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
        let samples = Projected { lattice: [nx, ny], vertices: &vertices, offset: 0.5 }.draw(80, 37);
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
    fn what_reaches_beyond_all_numbers_is_left_out() {
        for far in [1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            let beside = |x: f32| [0.0, 9.0].map(|y| Vec3::new(x, y, 1.0));
            let vertices = [beside(0.0), beside(4.0), beside(far), [Vec3::splat(far); 2]].concat();
            let samples = Projected { lattice: [2, 4], vertices: &vertices, offset: 0.5 }.draw(8, 8);
            let near = samples.iter().enumerate().filter(|(k, _)| k % 8 < 4);
            near.for_each(|(k, s)| assert!((s.value - 1.0).abs() < 1e-3, "{far} {k} {s:?}"));
        }
    }

    #[test]
    fn the_largest_value_wins() {
        let near = |z: f32| [(0.0, 0.0), (9.0, 0.0), (0.0, 9.0), (9.0, 9.0)].map(|(x, y)| Vec3::new(x, y, z));
        let mut folded = near(1.0).to_vec();
        folded.extend(near(2.0));
        let samples = Projected { lattice: [2, 4], vertices: &folded, offset: 0.5 }.draw(8, 8);
        assert!(samples.iter().all(|s| s.value > 1.9));
    }
}
