//! Dense Cholesky factors in single precision, blocked for the vector registers.
//!
//! A = L L^T, right-looking (Golub and Van Loan, *Matrix Computations*, section 4.2.6): a block of columns is factored,
//! the rows below it are multiplied with the inverse of its triangle, and what remains of the matrix loses their
//! products. Rows are stored one after the other, padded to whole blocks.

use super::lanes::{Isa, Kernel, Lanes, WIDTH, best_isa, dispatch_on};

/// Columns that are factored together.
const BLOCK: usize = 2 * WIDTH;
/// Least pivot over the diagonal it came from: the matrix is positive definite, but where two unknowns nearly repeat
/// each other rounding may say otherwise.
const LEAST_PIVOT: f32 = 1e-6;

/// A lower triangular factor.
#[derive(Debug, Clone, Default)]
pub struct Cholesky {
    n: usize,
    stride: usize,
    a: Vec<f32>,
    panel: Vec<f32>,
}

impl Cholesky {
    /// Room for a matrix of `n` rows: the rows, `stride` apart, of which the lower triangle is to be filled.
    pub fn prepare(&mut self, n: usize) -> (&mut [f32], usize) {
        self.n = n;
        self.stride = n.div_ceil(BLOCK) * BLOCK;
        self.a.clear();
        self.a.resize(n * self.stride, 0.0);
        (&mut self.a, self.stride)
    }

    /// Factors what was filled in after [`Self::prepare`].
    pub fn factor(&mut self) {
        self.factor_on(best_isa());
    }

    fn factor_on(&mut self, isa: Isa) {
        self.panel.resize(BLOCK * self.stride, 0.0);
        dispatch_on(isa, Factor { a: &mut self.a, panel: &mut self.panel, n: self.n, stride: self.stride });
    }

    /// Solves in place; `y` grows to the stride.
    pub fn solve(&self, y: &mut Vec<f32>) {
        self.solve_on(best_isa(), y);
    }

    fn solve_on(&self, isa: Isa, y: &mut Vec<f32>) {
        y.resize(self.stride, 0.0);
        dispatch_on(isa, Solve { l: &self.a, stride: self.stride, y, n: self.n });
    }
}

/// Less so many times the other.
#[inline(always)]
fn take_from<L: Lanes>(from: &mut [f32; BLOCK], times: f32, other: &[f32; BLOCK]) {
    let times = L::splat(times);
    for i in (0..BLOCK).step_by(L::COUNT) {
        times.fnma(L::load(&other[i..]), L::load(&from[i..])).store(&mut from[i..]);
    }
}

struct Factor<'a> {
    a: &'a mut [f32],
    /// The block's rows below its triangle, transposed: `[column][row]`.
    panel: &'a mut [f32],
    n: usize,
    stride: usize,
}

impl Factor<'_> {
    /// Factors the triangle of a block and gives its inverse, transposed: `[column][row]`.
    #[inline(always)]
    fn triangle<L: Lanes>(&mut self, from: usize, to: usize) -> [[f32; BLOCK]; BLOCK] {
        let (s, n) = (self.stride, to - from);
        // Column by column, whole ones: what stands above the diagonal is not looked at.
        let mut columns = [[0.0; BLOCK]; BLOCK];
        for i in 0..n {
            for (j, column) in columns.iter_mut().enumerate().take(i + 1) {
                column[i] = self.a[(from + i) * s + from + j];
            }
        }
        for j in 0..n {
            let (done, rest) = columns.split_at_mut(j + 1);
            let column = &mut done[j];
            let value = self.a[(from + j) * s + from + j];
            let pivot = column[j].max(LEAST_PIVOT * value.abs()).sqrt();
            let over = L::splat(1.0 / pivot);
            for i in (0..BLOCK).step_by(L::COUNT) {
                over.mul(L::load(&column[i..])).store(&mut column[i..]);
            }
            column[j] = pivot;
            for (other, value) in rest.iter_mut().zip(&column[j + 1..]) {
                take_from::<L>(other, *value, column);
            }
        }
        for i in 0..n {
            for (j, column) in columns.iter().enumerate().take(i + 1) {
                self.a[(from + i) * s + from + j] = column[i];
            }
        }
        // Row by row of the inverse: what the rows above have left of the unit matrix, over the diagonal.
        let mut inverse = [[0.0; BLOCK]; BLOCK];
        for r in 0..n {
            inverse[r][r] = 1.0;
        }
        for r in 0..n {
            let (done, rest) = inverse.split_at_mut(r + 1);
            let row = &mut done[r];
            let over = L::splat(1.0 / columns[r][r]);
            for i in (0..BLOCK).step_by(L::COUNT) {
                over.mul(L::load(&row[i..])).store(&mut row[i..]);
            }
            for (other, value) in rest.iter_mut().zip(&columns[r][r + 1..]) {
                take_from::<L>(other, *value, row);
            }
        }
        let mut transposed = [[0.0; BLOCK]; BLOCK];
        for (r, row) in inverse.iter().enumerate() {
            for (c, value) in row.iter().enumerate() {
                transposed[c][r] = *value;
            }
        }
        transposed
    }

    /// Rows from `row` on, R of them, of what remains: less the products of the panel, from column `to` up to and
    /// beyond the diagonal.
    #[inline(always)]
    fn rows<L: Lanes, const R: usize>(&mut self, row: usize, from: usize, to: usize) {
        let s = self.stride;
        let mut column = to;
        while column < row + R {
            let mut sums = [[L::splat(0.0); 2]; R];
            for (r, sum) in sums.iter_mut().enumerate() {
                let at = (row + r) * s + column;
                *sum = [L::load(&self.a[at..]), L::load(&self.a[at + L::COUNT..])];
            }
            for k in 0..BLOCK {
                let p = &self.panel[k * s + column..][..2 * L::COUNT];
                let p = [L::load(p), L::load(&p[L::COUNT..])];
                for (r, sum) in sums.iter_mut().enumerate() {
                    let l = L::splat(self.a[(row + r) * s + from + k]);
                    *sum = [l.fnma(p[0], sum[0]), l.fnma(p[1], sum[1])];
                }
            }
            for (r, sum) in sums.iter().enumerate() {
                let at = (row + r) * s + column;
                sum[0].store(&mut self.a[at..]);
                sum[1].store(&mut self.a[at + L::COUNT..]);
            }
            column += 2 * L::COUNT;
        }
    }
}

impl Kernel for Factor<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let (n, s) = (self.n, self.stride);
        for from in (0..n).step_by(BLOCK) {
            let to = (from + BLOCK).min(n);
            let inverse = self.triangle::<L>(from, to);
            if to < from + BLOCK {
                break;
            }
            // The rows below become rows of the factor.
            for i in to..n {
                let row: &mut [f32; BLOCK] =
                    self.a[i * s + from..].first_chunk_mut().expect("rows are whole blocks");
                let of = *row;
                for j in (0..BLOCK).step_by(2 * L::COUNT) {
                    let mut sums = [L::splat(0.0); 2];
                    for (value, column) in of.iter().zip(&inverse) {
                        let value = L::splat(*value);
                        sums[0] = value.fma(L::load(&column[j..]), sums[0]);
                        sums[1] = value.fma(L::load(&column[j + L::COUNT..]), sums[1]);
                    }
                    sums[0].store(&mut row[j..]);
                    sums[1].store(&mut row[j + L::COUNT..]);
                }
                for k in 0..BLOCK {
                    self.panel[k * s + i] = self.a[i * s + from + k];
                }
            }
            // What remains of the matrix.
            let mut row = to;
            while row + 4 <= n {
                self.rows::<L, 4>(row, from, to);
                row += 4;
            }
            while row < n {
                self.rows::<L, 1>(row, from, to);
                row += 1;
            }
        }
        for i in 0..n {
            self.a[i * s + i + 1..(i + 1) * s].fill(0.0);
        }
    }
}

struct Solve<'a> {
    l: &'a [f32],
    stride: usize,
    /// As long as the stride; zero beyond the unknowns.
    y: &'a mut [f32],
    n: usize,
}

impl Kernel for Solve<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let row = |i: usize| &self.l[i * self.stride..(i + 1) * self.stride];
        for i in 0..self.n {
            let row = row(i);
            let mut sum = L::splat(0.0);
            // What is not known yet counts as zero: the lower triangle ends before it.
            let mut k = 0;
            while k < i {
                sum = L::load(&row[k..]).fma(L::load(&self.y[k..]), sum);
                k += L::COUNT;
            }
            // The last block reaches past the diagonal.
            let beyond: f32 = (i..k).map(|k| row[k] * self.y[k]).sum();
            let dot = sum.to_array().iter().sum::<f32>() - beyond;
            self.y[i] = (self.y[i] - dot) / row[i];
        }
        for i in (0..self.n).rev() {
            let row = row(i);
            let value = self.y[i] / row[i];
            let v = L::splat(value);
            let mut k = 0;
            while k + L::COUNT <= i {
                let to = &mut self.y[k..k + L::COUNT];
                v.fnma(L::load(&row[k..]), L::load(to)).store(to);
                k += L::COUNT;
            }
            for k in k..i {
                self.y[k] -= row[k] * value;
            }
            self.y[i] = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::of_this_machine;
    use super::*;

    #[test]
    fn factors_of_any_size_solve_their_systems() {
        for n in [1, 2, 15, 31, 32, 33, 64, 70, 101] {
            // A covariance that falls with distance, which has a factor.
            let entry =
                |i: usize, j: usize| (-0.3 * i.abs_diff(j) as f32).exp() + if i == j { 0.1 } else { 0.0 };
            let mut cholesky = Cholesky::default();
            let (rows, stride) = cholesky.prepare(n);
            for i in 0..n {
                for j in 0..=i {
                    rows[i * stride + j] = entry(i, j);
                }
            }
            let given = cholesky.clone();
            let x: Vec<f32> = (0..n).map(|i| (i as f32 * 0.7).sin()).collect();
            let y: Vec<f32> = (0..n).map(|i| (0..n).map(|j| entry(i, j) * x[j]).sum()).collect();
            for isa in of_this_machine() {
                let (mut cholesky, mut y) = (given.clone(), y.clone());
                cholesky.factor_on(isa);
                cholesky.solve_on(isa, &mut y);
                for (a, b) in y.iter().zip(&x) {
                    assert!((a - b).abs() < 1e-4, "{isa:?}, n {n}: {a} instead of {b}");
                }
            }
        }
    }
}
