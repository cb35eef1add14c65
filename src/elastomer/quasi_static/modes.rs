//! What is left of the undeformed layer for a pair of wave numbers: a banded system through the depth.
//!
//! As many wave numbers along x are solved at once as a register holds, those of one wave number along y in a row. A
//! solution is a sweep from the base up and one back down; what loads the face alone enters between the two.

use super::grid::{CellBasis, Grid};
use super::lanes::{Kernel, Lanes, WIDTH, dispatch};
use super::operator::evenness;
use super::stack::Stack;
use super::waves::Waves;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Half bandwidth of a mode's system: two control layers of three components.
const BAND: usize = 8;
/// Most unknowns of a mode's system.
const MOST_ROWS: usize = 192;
/// Those of a pad of 4 mm without coating, down to cells of 0.14 mm.
const USUAL_ROWS: usize = 24;

/// Fourier symbols of one axis at one wave number: mass, stiffness, test slope against trial value.
#[derive(Clone, Copy)]
struct Symbol {
    mass: f64,
    stiffness: f64,
    cross: f64,
}

/// Symbols with full quadrature and with cell means.
fn symbols(basis: &CellBasis, h: f64, theta: f64) -> [Symbol; 2] {
    let mut out = [Symbol { mass: 0.0, stiffness: 0.0, cross: 0.0 }; 2];
    let mut add = |which: usize, v: &[f64; 3], d: &[f64; 3], w: f64| {
        for a in 0..3 {
            for b in 0..3 {
                let (sin, cos) = (theta * (b as f64 - a as f64)).sin_cos();
                out[which].mass += w * v[a] * v[b] * cos;
                out[which].stiffness += w * d[a] * d[b] * cos;
                out[which].cross += w * d[a] * v[b] * sin;
            }
        }
    };
    for g in 0..2 {
        add(0, &basis.value[g], &basis.slope[g], 0.5 * h);
    }
    let (v, d) = means(basis);
    add(1, &v, &d, h);
    out
}

/// Cell means of values and slopes.
fn means(basis: &CellBasis) -> ([f64; 3], [f64; 3]) {
    let mean = |m: &[[f64; 3]; 2]| std::array::from_fn(|a| 0.5 * (m[0][a] + m[1][a]));
    (mean(&basis.value), mean(&basis.slope))
}

/// The factored systems of all wave numbers. Unknowns of a mode are ordered by layer, then component.
#[derive(Debug)]
pub struct Modes {
    rows: usize,
    /// Wave numbers along x, and padded ones.
    count: usize,
    stride: usize,
    /// `[y mode][block of x modes][row][BAND + 1][WIDTH]`: 1/d, then l of the columns before.
    factors: Vec<f32>,
}

impl Modes {
    /// Factors the rest state of a pad with these waves along x and y.
    pub fn new(grid: &Grid, stack: &Stack, x: &Waves, y: &Waves) -> Self {
        let rows = 3 * (grid.layers() - 1);
        assert!(rows <= MOST_ROWS, "a grid has at most {} layers", MOST_ROWS / 3);
        let mut modes = Self { rows, count: x.n, stride: x.stride, factors: Vec::new() };
        let (row, per_block) = (modes.factors_of_row(), factors_of_block(rows));
        modes.factors = vec![0.0; y.n * row];
        modes.factors.par_chunks_mut(row).enumerate().for_each(|(my, out)| {
            let sy = axis_symbols(y, &grid.y, grid.hy, my);
            for mx in 0..x.n {
                let sx = axis_symbols(x, &grid.x, grid.hx, mx);
                let factor = factor_mode(grid, stack, &sx, &sy);
                let base = (mx / WIDTH) * per_block + mx % WIDTH;
                for (n, f) in factor.iter().enumerate() {
                    out[base + n * WIDTH] = *f as f32;
                }
            }
        });
        modes
    }

    fn factors_of_row(&self) -> usize {
        factors_of_block(self.rows) * (self.stride / WIDTH)
    }

    /// The systems of y mode `my`.
    fn line(&self, my: usize) -> Line<'_> {
        let factors = &self.factors[my * self.factors_of_row()..][..self.factors_of_row()];
        Line { rows: self.rows, count: self.count, stride: self.stride, factors }
    }

    /// Sweeps the right-hand sides of y mode `my`, `[row][x mode]`, up from the base, and tells what the face will be,
    /// `[component][x mode]`, if nothing more is added.
    pub fn up(&self, my: usize, rhs: &mut [f32], face: &mut [f32]) {
        dispatch(Up { of: self.line(my), rhs, face });
    }

    /// Takes a load on the face, `[component][x mode]`, from what [`Self::up`] has left, and sweeps it down to the
    /// solution.
    pub fn down(&self, my: usize, load: Option<&[f32]>, rhs: &mut [f32]) {
        dispatch(Down { of: self.line(my), load, rhs });
    }

    /// What the face answers in y mode `my`, `[component][x mode]`, to a unit load of component `c` in each x mode.
    pub fn face_response(&self, my: usize, c: usize) -> Vec<f32> {
        let mut rhs = vec![0.0; self.rows * self.stride];
        let mut face = vec![0.0; 3 * self.stride];
        rhs[(self.rows - 3 + c) * self.stride..][..self.stride].fill(1.0);
        self.up(my, &mut rhs, &mut face);
        face
    }
}

/// Symbols of the sines of a mode along one axis, and of their partners.
fn axis_symbols(waves: &Waves, basis: &CellBasis, h: f64, place: usize) -> [[Symbol; 2]; 2] {
    let number = waves.numbers[place];
    let even = symbols(basis, h, PI * number as f64 / waves.n as f64);
    let odd = if number == waves.n { symbols(basis, h, 0.0) } else { even };
    [even, odd]
}

/// Assembles and factors (L D L^T) one mode. Row order: layer, then component.
fn factor_mode(grid: &Grid, stack: &Stack, sx: &[[Symbol; 2]; 2], sy: &[[Symbol; 2]; 2]) -> Vec<f64> {
    let layers = grid.layers();
    let rows = 3 * (layers - 1);
    // a[row][BAND - (row - column)] holds the lower triangle.
    let mut a = vec![[0.0; BAND + 1]; rows];
    for (cell, (basis, h)) in grid.z.iter().zip(&grid.hz).enumerate() {
        let (mean_v, mean_d) = means(basis);
        let (mu, lambda) = (stack.mu[cell], stack.lambda[cell]);
        // Volume: cell means carry lambda less what levels volume out, full quadrature carries that.
        let even = evenness(mu, lambda);
        let mean = lambda - even;
        for p in 0..3 {
            for q in 0..3 {
                let (k, l) = (cell + p, cell + q);
                if k == 0 || l == 0 {
                    continue;
                }
                let full = |f: &dyn Fn(usize) -> f64| 0.5 * h * (f(0) + f(1));
                let m = full(&|g| basis.value[g][p] * basis.value[g][q]);
                let s = full(&|g| basis.slope[g][p] * basis.slope[g][q]);
                let dv = full(&|g| basis.slope[g][p] * basis.value[g][q]);
                let vd = full(&|g| basis.value[g][p] * basis.slope[g][q]);
                let (m1, s1) = (h * mean_v[p] * mean_v[q], h * mean_d[p] * mean_d[q]);
                let (dv1, vd1) = (h * mean_d[p] * mean_v[q], h * mean_v[p] * mean_d[q]);
                let ([[x, x1], [ox, ox1]], [[y, y1], [oy, oy1]]) = (sx, sy);
                let shear = |x: &Symbol, y: &Symbol| {
                    mu * (x.stiffness * y.mass * m + x.mass * y.stiffness * m + x.mass * y.mass * s)
                };
                let xx = mean * ox1.stiffness * y1.mass * m1
                    + (even + mu) * ox.stiffness * y.mass * m
                    + shear(ox, y);
                let yy = mean * x1.mass * oy1.stiffness * m1
                    + (even + mu) * x.mass * oy.stiffness * m
                    + shear(x, oy);
                let zz = mean * x1.mass * y1.mass * s1 + (even + mu) * x.mass * y.mass * s + shear(x, y);
                let xy = mean * x1.cross * y1.cross * m1 + (even + mu) * x.cross * y.cross * m;
                let xz = x.cross * y.mass * (mu * dv - even * vd) - mean * x1.cross * y1.mass * vd1;
                let yz = x.mass * y.cross * (mu * dv - even * vd) - mean * x1.mass * y1.cross * vd1;
                let zx = x.cross * y.mass * (mu * vd - even * dv) - mean * x1.cross * y1.mass * dv1;
                let zy = x.mass * y.cross * (mu * vd - even * dv) - mean * x1.mass * y1.cross * dv1;
                let block = [[xx, xy, xz], [xy, yy, yz], [zx, zy, zz]];
                for (i, line) in block.iter().enumerate() {
                    for (j, v) in line.iter().enumerate() {
                        let (row, column) = (3 * (k - 1) + i, 3 * (l - 1) + j);
                        if column <= row {
                            a[row][BAND - (row - column)] += v;
                        }
                    }
                }
            }
        }
    }
    let mut pivots = vec![0.0; rows];
    let mut out = vec![0.0; rows * (BAND + 1)];
    for i in 0..rows {
        let first = i.saturating_sub(BAND);
        for j in first..=i {
            let mut sum = a[i][BAND - (i - j)];
            for m in first.max(j.saturating_sub(BAND))..j {
                sum -= a[i][BAND - (i - m)] * a[j][BAND - (j - m)] * pivots[m];
            }
            if j < i {
                a[i][BAND - (i - j)] = sum / pivots[j];
            } else {
                pivots[i] = sum;
            }
        }
        out[i * (BAND + 1)] = 1.0 / pivots[i];
        for j in first..i {
            out[i * (BAND + 1) + (i - j)] = a[i][BAND - (i - j)];
        }
    }
    out
}

/// Coefficient `d` columns before the diagonal of a row of a block; of the diagonal itself the inverse.
#[inline(always)]
fn coefficient<L: Lanes>(block: &[f32], row: usize, d: usize) -> L {
    L::load(&block[(row * (BAND + 1) + d) * WIDTH..])
}

/// Numbers that [`WIDTH`] systems of so many rows have.
#[inline(always)]
fn factors_of_block(rows: usize) -> usize {
    rows * (BAND + 1) * WIDTH
}

/// The systems of one y mode.
#[derive(Clone, Copy)]
struct Line<'a> {
    rows: usize,
    count: usize,
    stride: usize,
    factors: &'a [f32],
}

impl<'a> Line<'a> {
    /// Factors of the wave numbers from `at` on, as far as their block goes.
    #[inline(always)]
    fn factors(self, at: usize) -> &'a [f32] {
        let block = factors_of_block(self.rows);
        &self.factors[at / WIDTH * block + at % WIDTH..(at / WIDTH + 1) * block]
    }

    /// Asks for a row of the block after that of `at`, once.
    #[inline(always)]
    fn fetch_next<L: Lanes>(self, at: usize, row: usize) {
        if at.is_multiple_of(WIDTH) {
            let next = ((at / WIDTH + 1) * self.rows + row) * (BAND + 1);
            for n in next..next + BAND + 1 {
                L::fetch(self.factors, n * WIDTH);
            }
        }
    }
}

struct Up<'a> {
    of: Line<'a>,
    rhs: &'a mut [f32],
    face: &'a mut [f32],
}

impl Kernel for Up<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        // Room for the most rows takes longer to clear than is worth it: sweeps of most pads use an eighth.
        if self.of.rows <= USUAL_ROWS {
            self.sweep::<L, { USUAL_ROWS + BAND }>();
        } else {
            self.sweep::<L, { MOST_ROWS + BAND }>();
        }
    }
}

impl Up<'_> {
    /// With room for ROOM rows, of which eight zero ones in front spare the band its case at the base.
    #[inline(always)]
    fn sweep<L: Lanes, const ROOM: usize>(self) {
        let (n, s) = (self.of.rows, self.of.stride);
        let mut x = [L::splat(0.0); ROOM];
        for at in (0..self.of.count).step_by(L::COUNT) {
            let f = self.of.factors(at);
            for i in 0..n {
                self.of.fetch_next::<L>(at, i);
                let mut sum = L::load(&self.rhs[i * s + at..]);
                // The row before comes last: the others are known earlier.
                for d in (1..=BAND).rev() {
                    sum = coefficient::<L>(f, i, d).fnma(x[BAND + i - d], sum);
                }
                x[BAND + i] = sum;
                sum.store(&mut self.rhs[i * s + at..]);
            }
            let last = &x[BAND + n - 3..BAND + n];
            let z = last[2].mul(coefficient(f, n - 1, 0));
            let y = coefficient::<L>(f, n - 1, 1).fnma(z, last[1].mul(coefficient(f, n - 2, 0)));
            let x = coefficient::<L>(f, n - 1, 2).fnma(z, last[0].mul(coefficient(f, n - 3, 0)));
            let x = coefficient::<L>(f, n - 2, 1).fnma(y, x);
            for (c, v) in [x, y, z].into_iter().enumerate() {
                v.store(&mut self.face[c * s + at..]);
            }
        }
    }
}

struct Down<'a> {
    of: Line<'a>,
    load: Option<&'a [f32]>,
    rhs: &'a mut [f32],
}

impl Kernel for Down<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (n, s) = (self.of.rows, self.of.stride);
        for at in (0..self.of.count).step_by(L::COUNT) {
            let f = self.of.factors(at);
            // The rows below, to which the row above still adds: the nearest first.
            let mut sums = [L::splat(0.0); BAND];
            let mut loads = [L::splat(0.0); 3];
            if let Some(load) = self.load {
                let x = L::load(&load[at..]);
                let [y, z] = [L::load(&load[s + at..]), L::load(&load[2 * s + at..])];
                let y = coefficient::<L>(f, n - 2, 1).fnma(x, y);
                let z = coefficient::<L>(f, n - 1, 1).fnma(y, coefficient::<L>(f, n - 1, 2).fnma(x, z));
                loads = [x, y, z];
            }
            for i in (0..n).rev() {
                self.of.fetch_next::<L>(at, i);
                let mut v = L::load(&self.rhs[i * s + at..]);
                if i + 3 >= n {
                    v = v.sub(loads[i + 3 - n]);
                }
                let v = v.mul(coefficient(f, i, 0)).add(sums[0]);
                v.store(&mut self.rhs[i * s + at..]);
                for d in 1..BAND {
                    sums[d - 1] = coefficient::<L>(f, i, d).fnma(v, sums[d]);
                }
                sums[BAND - 1] = L::splat(0.0).sub(coefficient::<L>(f, i, BAND).mul(v));
            }
        }
    }
}
