//! Transforms in the plane: sines, the cosines that are their partners, and the dense products that apply them.
//!
//! At the sizes of a pad (tens to a hundred wave numbers) a dense matrix is the fastest transform.

use super::lanes::{Isa, Kernel, Lanes, WIDTH, best_isa, dispatch_on};
use std::f64::consts::PI;

/// Orthonormal sines on n points, half a step from the ends of the period, and the cosines that are their partners, with
/// padded rows.
#[derive(Debug)]
pub struct Waves {
    /// Points, and wave numbers.
    pub n: usize,
    /// Length of a padded row.
    pub stride: usize,
    /// `forward[partner]`: mode rows over point columns.
    pub forward: [Vec<f32>; 2],
    /// `back[partner]`: point rows over mode columns.
    pub back: [Vec<f32>; 2],
}

impl Waves {
    /// The tables for `n` points.
    pub fn new(n: usize) -> Self {
        let stride = n.div_ceil(WIDTH) * WIDTH;
        let wave = |m: usize, i: usize, odd: bool| {
            let angle = PI * (m + 1) as f64 * (i as f64 + 0.5) / n as f64;
            let norm = (2.0 / n as f64).sqrt();
            match (m + 1 == n, odd) {
                (false, false) => norm * angle.sin(),
                (false, true) => -norm * angle.cos(),
                (true, false) => angle.sin() / (n as f64).sqrt(),
                // Its partner would be zero everywhere: the constant takes its place.
                (true, true) => -1.0 / (n as f64).sqrt(),
            }
        };
        let table = |odd: bool, transposed: bool| {
            let mut t = vec![0.0; n * stride];
            for m in 0..n {
                for i in 0..n {
                    let at = if transposed { i * stride + m } else { m * stride + i };
                    t[at] = wave(m, i, odd) as f32;
                }
            }
            t
        };
        Self {
            n,
            stride,
            forward: [table(false, false), table(true, false)],
            back: [table(false, true), table(true, true)],
        }
    }
}

/// A dense product: `rows` rows of `a`, `inner` long, times `inner` rows of `b`, `columns` long.
pub struct Product<'a> {
    /// Left factor, and from row to row of it.
    pub a: (&'a [f32], usize),
    /// Right factor, and from row to row of it.
    pub b: (&'a [f32], usize),
    /// Rows of the result.
    pub rows: usize,
    /// Terms of a sum.
    pub inner: usize,
    /// Columns of the result.
    pub columns: usize,
}

impl Product<'_> {
    /// Writes the result to rows that are `stride` apart, which is at least a row's columns. Up to fifteen numbers after the
    /// columns of a row may be overwritten.
    pub fn to(self, out: &mut [f32], stride: usize) {
        self.multiply_on(best_isa(), out, stride);
    }

    fn multiply_on(self, isa: Isa, out: &mut [f32], stride: usize) {
        dispatch_on(isa, Multiply { of: self, out, stride });
    }
}

struct Multiply<'a> {
    of: Product<'a>,
    out: &'a mut [f32],
    stride: usize,
}

impl Multiply<'_> {
    /// A tile of R rows and C registers.
    #[inline(always)]
    fn tile<L: Lanes, const R: usize, const C: usize>(&mut self, row: usize, column: usize) {
        let Product { a: (a, a_stride), b: (b, b_stride), inner, columns, .. } = self.of;
        let mut sums = [[L::splat(0.0); C]; R];
        let mut rows = [&a[..0]; R];
        for r in 0..R {
            rows[r] = &a[(row + r) * a_stride..][..inner];
        }
        // What is read beyond the columns is not written; the last rows may have nothing there.
        let whole = inner.min((b.len() + b_stride).saturating_sub(column + C * L::COUNT) / b_stride);
        for i in 0..whole {
            add_products(&mut sums, &rows, i, &b[i * b_stride + column..][..C * L::COUNT]);
        }
        for i in whole..inner {
            let mut padded = [[0.0; WIDTH]; C];
            for (to, from) in padded.as_flattened_mut().iter_mut().zip(&b[i * b_stride + column..]) {
                *to = *from;
            }
            add_products(&mut sums, &rows, i, padded.as_flattened());
        }
        for (r, sum) in sums.iter().enumerate() {
            let to = &mut self.out[(row + r) * self.stride + column..];
            if to.len() >= C * L::COUNT {
                for c in 0..C {
                    sum[c].store(&mut to[c * L::COUNT..]);
                }
            } else {
                let mut whole = [[0.0; WIDTH]; C];
                for c in 0..C {
                    sum[c].store(&mut whole.as_flattened_mut()[c * L::COUNT..]);
                }
                let n = to.len().min(columns - column);
                to[..n].copy_from_slice(&whole.as_flattened()[..n]);
            }
        }
    }

    /// R rows, from the last columns to the first: what is written beyond a row is so before the next row's own.
    #[inline(always)]
    fn columns<L: Lanes, const R: usize>(&mut self, row: usize) {
        let mut left = self.of.columns.div_ceil(L::COUNT);
        while left > 0 {
            let tile = if left >= L::ABREAST { L::ABREAST } else { left.min(2) };
            left -= tile;
            match tile {
                1 => self.tile::<L, R, 1>(row, left * L::COUNT),
                2 => self.tile::<L, R, 2>(row, left * L::COUNT),
                _ => self.tile::<L, R, 4>(row, left * L::COUNT),
            }
        }
    }
}

/// Adds number `i` of each row of a times row `i` of b.
#[inline(always)]
fn add_products<L: Lanes, const R: usize, const C: usize>(
    sums: &mut [[L; C]; R],
    rows: &[&[f32]; R],
    i: usize,
    of_b: &[f32],
) {
    let mut b = [L::splat(0.0); C];
    for c in 0..C {
        b[c] = L::load(&of_b[c * L::COUNT..]);
    }
    for r in 0..R {
        let a = L::splat(rows[r][i]);
        for c in 0..C {
            sums[r][c] = a.fma(b[c], sums[r][c]);
        }
    }
}

impl Kernel for Multiply<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let mut row = 0;
        while row + TILE_ROWS <= self.of.rows {
            self.columns::<L, TILE_ROWS>(row);
            row += TILE_ROWS;
        }
        while row < self.of.rows {
            self.columns::<L, 1>(row);
            row += 1;
        }
    }
}

/// Rows of a result that are summed at once: with the columns that stand [abreast](Lanes::ABREAST), what the vector registers hold.
pub const TILE_ROWS: usize = 5;

#[cfg(test)]
mod tests {
    use super::super::lanes::of_this_machine;
    use super::*;

    #[test]
    fn a_product_is_the_sum_of_products_whatever_its_sides() {
        for (rows, inner, columns) in [(1, 1, 1), (7, 3, 18), (5, 34, 34), (11, 50, 50), (6, 8, 100)] {
            let number = |n: usize, of: usize| ((n * 37 + of) % 11) as f32 - 5.0;
            let (a_stride, b_stride, stride) = (inner + 3, columns, columns + 1);
            let a: Vec<f32> = (0..rows * a_stride).map(|n| number(n, 1)).collect();
            let b: Vec<f32> = (0..inner * b_stride).map(|n| number(n, 4)).collect();
            for isa in of_this_machine() {
                let mut out = vec![f32::NAN; rows * stride];
                let product = Product { a: (&a, a_stride), b: (&b, b_stride), rows, inner, columns };
                product.multiply_on(isa, &mut out, stride);
                for r in 0..rows {
                    for c in 0..columns {
                        let sum: f32 = (0..inner).map(|i| a[r * a_stride + i] * b[i * b_stride + c]).sum();
                        assert_eq!(out[r * stride + c], sum, "{isa:?}, {rows} {inner} {columns}: {r} {c}");
                    }
                }
            }
        }
    }

    #[test]
    fn going_to_waves_and_back_changes_nothing() {
        for n in [18, 34, 51] {
            let waves = Waves::new(n);
            for partner in 0..2 {
                let x: Vec<f32> = (0..n).map(|i| ((i * 7) % 5) as f32 - 2.0).collect();
                let (mut there, mut back) = (vec![0.0; n], vec![0.0; n]);
                let column = |x| Product { a: x, b: (&[], 0), rows: n, inner: n, columns: 1 };
                Product { b: (&x, 1), ..column((&waves.forward[partner], waves.stride)) }.to(&mut there, 1);
                Product { b: (&there, 1), ..column((&waves.back[partner], waves.stride)) }.to(&mut back, 1);
                let off = x.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off < 1e-5, "{n} {partner}: {off}");
            }
        }
    }
}
