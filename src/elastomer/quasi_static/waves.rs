//! Transforms in the plane: sines, the cosines that are their partners, and the dense products that apply them.
//!
//! At the sizes of a pad (tens to a hundred wave numbers) a dense matrix is the fastest transform.

use super::lanes::{Isa, Kernel, Lanes, WIDTH, best_isa, dispatch_on};
use std::f64::consts::PI;
use std::ops::Range;

/// Orthonormal sines on n points, half a step from the ends of the period, and the cosines that are their partners.
///
/// Every wave is the same on both sides of the middle, but for its sign perhaps. So points are [folded](super::mirror): sums of two that
/// mirror each other, then differences, and a wave needs those of its kind alone, half of them.
#[derive(Debug)]
pub struct Waves {
    /// Points, and waves.
    pub n: usize,
    /// Length of a padded row of waves, or of folded points.
    pub stride: usize,
    /// Half waves along the axis, place by place: even numbers first, then odd ones.
    pub numbers: Vec<usize>,
    /// From row to row of the tables.
    pub table_stride: usize,
    /// `forward[partner]`: rows of waves over the folded points of their kind.
    pub forward: [Vec<f32>; 2],
    /// `back[partner]`: rows of folded points over the waves of their kind.
    pub back: [Vec<f32>; 2],
}

/// The waves of one kind, alike or opposite on both sides of the middle, and the folded points that they live on.
#[derive(Debug)]
pub struct Kind {
    /// Their places.
    pub waves: Range<usize>,
    /// Sums of points, or differences.
    pub points: Range<usize>,
}

impl Waves {
    /// The tables for `n` points.
    pub fn new(n: usize) -> Self {
        let mut waves = Self {
            n,
            stride: n.next_multiple_of(WIDTH),
            numbers: numbers(n),
            table_stride: n.div_ceil(2).next_multiple_of(WIDTH),
            forward: [Vec::new(), Vec::new()],
            back: [Vec::new(), Vec::new()],
        };
        for partner in 0..2 {
            let mut forward = vec![0.0; n * waves.table_stride];
            let mut back = forward.clone();
            for kind in waves.kinds(partner) {
                for (m, place) in kind.waves.clone().enumerate() {
                    for (i, point) in kind.points.clone().enumerate() {
                        let value = waves.wave(waves.numbers[place], i, partner == 1) as f32;
                        forward[place * waves.table_stride + i] = value;
                        back[point * waves.table_stride + m] = value;
                    }
                }
            }
            (waves.forward[partner], waves.back[partner]) = (forward, back);
        }
        waves
    }

    /// The wave of `number` half waves, or its partner, at point i.
    fn wave(&self, number: usize, i: usize, partner: bool) -> f64 {
        let n = self.n as f64;
        let angle = PI * number as f64 * (i as f64 + 0.5) / n;
        let norm = (2.0 / n).sqrt();
        match (number == self.n, partner) {
            (false, false) => norm * angle.sin(),
            (false, true) => -norm * angle.cos(),
            (true, false) => angle.sin() / n.sqrt(),
            // Its partner would be zero everywhere: the constant takes its place.
            (true, true) => -1.0 / n.sqrt(),
        }
    }

    /// Sines of an even number are opposite on both sides of the middle, their partners alike. The constant is alike and belongs to the
    /// last of the even numbers, or stands between both.
    pub fn kinds(&self, partner: usize) -> [Kind; 2] {
        let (n, sums) = (self.n, self.n.div_ceil(2));
        match partner {
            0 => [Kind { waves: 0..n / 2, points: sums..n }, Kind { waves: n / 2..n, points: 0..sums }],
            _ => [Kind { waves: 0..sums, points: 0..sums }, Kind { waves: sums..n, points: sums..n }],
        }
    }
}

/// Of n points: even numbers of half waves, then odd ones, of which n is the first.
fn numbers(n: usize) -> Vec<usize> {
    let even = (2..=n).step_by(2);
    let odd = (1..n).step_by(2);
    even.chain((n % 2 == 1).then_some(n)).chain(odd).collect()
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
    /// Writes the result to rows that are `stride` apart.
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
            if column + C * L::COUNT <= columns {
                for c in 0..C {
                    sum[c].store(&mut to[c * L::COUNT..]);
                }
            } else {
                to[..columns - column].copy_from_slice(&sum[0].to_array()[..columns - column]);
            }
        }
    }

    /// R rows. The last registers reach back over columns that are there already, rather than beyond the row; one is
    /// stored in part where a row has no room for it.
    #[inline(always)]
    fn columns<L: Lanes, const R: usize>(&mut self, row: usize) {
        let columns = self.of.columns;
        let mut column = 0;
        while column < columns {
            let most = (columns - column).div_ceil(L::COUNT).min((columns / L::COUNT).max(1));
            let tile = if most >= L::ABREAST { L::ABREAST } else { most.min(2) };
            let from = column.min(columns.saturating_sub(tile * L::COUNT));
            match tile {
                1 => self.tile::<L, R, 1>(row, from),
                2 => self.tile::<L, R, 2>(row, from),
                _ => self.tile::<L, R, 4>(row, from),
            }
            column += tile * L::COUNT;
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
        match self.of.rows - row {
            0 => {}
            1 => self.columns::<L, 1>(row),
            2 => self.columns::<L, 2>(row),
            3 => self.columns::<L, 3>(row),
            4 => self.columns::<L, 4>(row),
            more => unreachable!("{more} rows are left beside tiles of {TILE_ROWS}"),
        }
    }
}

/// Rows of a result that are summed at once: with the columns that stand [abreast](Lanes::ABREAST), what the vector registers hold.
pub const TILE_ROWS: usize = 5;

#[cfg(test)]
mod tests {
    use super::super::lanes::of_this_machine;
    use super::super::mirror::Plane;
    use super::*;

    #[test]
    fn a_product_is_the_sum_of_products_whatever_its_sides() {
        for (rows, inner, columns) in
            [(1, 1, 1), (7, 3, 18), (8, 2, 13), (9, 5, 5), (5, 34, 34), (11, 50, 50), (6, 8, 100)]
        {
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
                    assert!(out[r * stride + columns].is_nan(), "{isa:?}, {rows} {inner} {columns}: {r}");
                }
            }
        }
    }

    #[test]
    fn waves_are_orthonormal_and_each_lives_on_half_of_the_folded_points() {
        for n in [18, 34, 51] {
            let waves = Waves::new(n);
            let mut numbers = waves.numbers.clone();
            numbers.sort_unstable();
            assert!(numbers.into_iter().eq(1..=n));
            for partner in 0..2 {
                let x: Vec<f32> = (0..n).map(|i| ((i * 7) % 5) as f32 - 2.0).collect();
                let (mut folded, mut there) = (vec![0.0; n], vec![0.0; n]);
                let (mut folded_back, mut back) = (vec![0.0; n], vec![0.0; n]);
                Plane([n, 1]).fold(&x, &mut folded);
                for Kind { waves: of, points } in waves.kinds(partner) {
                    let s = waves.table_stride;
                    let column = |x, rows, inner| Product { a: (x, s), b: (&[], 0), rows, inner, columns: 1 };
                    let forward = column(&waves.forward[partner][of.start * s..], of.len(), points.len());
                    Product { b: (&folded[points.clone()], 1), ..forward }.to(&mut there[of.clone()], 1);
                    let product = column(&waves.back[partner][points.start * s..], points.len(), of.len());
                    Product { b: (&there[of], 1), ..product }.to(&mut folded_back[points], 1);
                }
                for (place, got) in there.iter().enumerate() {
                    let truth: f64 = (0..n)
                        .map(|i| f64::from(x[i]) * waves.wave(waves.numbers[place], i, partner == 1))
                        .sum();
                    assert!(
                        (f64::from(*got) - truth).abs() < 1e-5,
                        "{n} {partner} {place}: {got} of {truth}"
                    );
                }
                Plane([n, 1]).unfold(&folded_back, &mut back);
                let off = x.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off < 1e-5, "{n} {partner}: {off}");
            }
        }
    }
}
