//! The undeformed pad inverted: the preconditioner of the solver.
//!
//! A rectangular layer whose sides are held as Navier held the edges of a plate, displacements along a side zero and
//! the one across it free, is decoupled by sines and cosines in the plane: u_z and u_y run as sines along x, u_x as
//! cosines (the partners), and likewise along y. One small banded system through the depth is left for each pair of
//! wave numbers, real and symmetric. At these sizes (tens to a hundred wave numbers) a dense matrix is the fastest
//! transform. The pad's own sides are free. They differ in shear alone, which is soft: the stress across such a side is
//! zero as it is across a free one, so that a nearly incompressible pad can give way to all sides as it should. (On a
//! torus it cannot, and the iterations grow with lambda over mu: at nu 0.45 three times, at 0.49 beyond count.)
//!
//! Contact springs enter by the Woodbury formula, see `springs`.

use super::grid::{CellBasis, Grid};
use super::lanes::{Kernel, Lanes, WIDTH, dispatch};
use super::operator::evenness;
use super::stack::Stack;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Half bandwidth of a mode's system: two control layers of three components.
const BAND: usize = 8;
/// Most unknowns of a mode's system.
const MOST_ROWS: usize = 192;

/// The inverse of the rest-state operator, its sides held along themselves.
#[derive(Debug)]
pub struct RestLayer {
    cx: usize,
    cy: usize,
    /// Row strides: `cx` and `cy` rounded up to the SIMD width.
    sx: usize,
    layers: usize,
    x: Waves,
    y: Waves,
    /// `[theta_y][block of x modes][row][BAND + 1][WIDTH]`: 1/d, then l of the columns before.
    factors: Vec<f32>,
}

/// Orthonormal sines on n points, half a step from the ends of the period, and the cosines that are their partners, with
/// padded rows.
#[derive(Debug)]
struct Waves {
    n: usize,
    stride: usize,
    /// `forward[partner]`: mode rows over point columns; `back[partner]`: point rows over mode columns.
    forward: [Vec<f32>; 2],
    back: [Vec<f32>; 2],
}

impl Waves {
    fn new(n: usize) -> Self {
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

    /// Symbols of a mode's sines, and of their partners.
    fn symbols(&self, basis: &CellBasis, h: f64, m: usize) -> [[Symbol; 2]; 2] {
        let theta = PI * (m + 1) as f64 / self.n as f64;
        let even = symbols(basis, h, theta);
        let odd = if m + 1 == self.n { symbols(basis, h, 0.0) } else { even };
        [even, odd]
    }
}

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

impl RestLayer {
    /// Factors the rest state of a pad.
    pub fn new(grid: &Grid, stack: &Stack) -> Self {
        let (x, y) = (Waves::new(grid.cx()), Waves::new(grid.cy()));
        let layers = grid.layers();
        let rows = 3 * (layers - 1);
        assert!(rows <= MOST_ROWS, "a grid has at most {} layers", MOST_ROWS / 3);
        let blocks = x.stride / WIDTH;
        let per_block = rows * (BAND + 1) * WIDTH;
        let mut factors = vec![0.0; y.n * blocks * per_block];
        factors.par_chunks_mut(blocks * per_block).enumerate().for_each(|(my, out)| {
            let sy = y.symbols(&grid.y, grid.hy, my);
            for mx in 0..x.n {
                let sx = x.symbols(&grid.x, grid.hx, mx);
                let factor = factor_mode(grid, stack, &sx, &sy);
                let base = (mx / WIDTH) * per_block + mx % WIDTH;
                for (n, f) in factor.iter().enumerate() {
                    out[base + n * WIDTH] = *f as f32;
                }
            }
        });
        Self { cx: x.n, cy: y.n, sx: x.stride, layers, x, y, factors }
    }

    fn plane(&self) -> usize {
        self.cy * self.sx
    }

    /// Length of a field in wave space: component, layer without the base, y mode, padded x mode.
    pub fn waves_len(&self) -> usize {
        3 * (self.layers - 1) * self.plane()
    }

    /// Transforms a field to wave space and solves every mode.
    pub fn solve_to_waves(&self, r: &[f32], waves: &mut [f32]) {
        let n = self.cx * self.cy;
        let depth = self.layers - 1;
        waves.par_chunks_mut(self.plane()).enumerate().for_each(|(plane, out)| {
            let (c, k) = (plane / depth, plane % depth + 1);
            let from = &r[(c * self.layers + k) * n..][..n];
            self.plane_to_waves(c, from, out);
        });
        self.solve_modes(waves, 0);
    }

    /// Adds the response to a load on the face alone (three planes of control values, scaled by -1)
    /// to a solution in wave space.
    pub fn subtract_face_load(&self, load: &[f32], waves: &mut [f32], scratch: &mut Vec<f32>) {
        let n = self.cx * self.cy;
        let depth = self.layers - 1;
        scratch.clear();
        scratch.resize(self.waves_len(), 0.0);
        for c in 0..3 {
            let out = &mut scratch[(c * depth + depth - 1) * self.plane()..][..self.plane()];
            self.plane_to_waves(c, &load[c * n..(c + 1) * n], out);
        }
        self.solve_modes(scratch, depth - 1);
        waves.par_chunks_mut(self.plane()).zip(scratch.par_chunks(self.plane())).for_each(|(w, s)| {
            for (w, s) in w.iter_mut().zip(s) {
                *w -= s;
            }
        });
    }

    /// Response of the face, `[component][y mode][x mode]`, to a unit load of component `c` in every mode.
    pub fn face_modes(&self, c: usize) -> [Vec<f32>; 3] {
        let depth = self.layers - 1;
        let mut waves = vec![0.0; self.waves_len()];
        let top = |c: usize| (c * depth + depth - 1) * self.plane();
        waves[top(c)..top(c) + self.plane()].fill(1.0);
        self.solve_modes(&mut waves, depth - 1);
        std::array::from_fn(|d| {
            let rows = waves[top(d)..top(d) + self.plane()].chunks(self.sx);
            rows.flat_map(|row| row[..self.cx].iter().copied()).collect()
        })
    }

    /// The face of a solution in wave space: three planes of control values.
    pub fn face(&self, waves: &[f32], face: &mut [f32]) {
        let n = self.cx * self.cy;
        let depth = self.layers - 1;
        for c in 0..3 {
            let from = &waves[(c * depth + depth - 1) * self.plane()..][..self.plane()];
            self.plane_from_waves(c, from, &mut face[c * n..(c + 1) * n]);
        }
    }

    /// Back to control points.
    pub fn from_waves(&self, waves: &[f32], z: &mut [f32]) {
        let n = self.cx * self.cy;
        let depth = self.layers - 1;
        z.par_chunks_mut(n).enumerate().for_each(|(plane, out)| {
            let (c, k) = (plane / self.layers, plane % self.layers);
            if k == 0 {
                out.fill(0.0);
            } else {
                let from = &waves[(c * depth + k - 1) * self.plane()..][..self.plane()];
                self.plane_from_waves(c, from, out);
            }
        });
    }

    fn plane_to_waves(&self, c: usize, from: &[f32], out: &mut [f32]) {
        let mut padded = vec![0.0; self.plane()];
        for (to, from) in padded.chunks_mut(self.sx).zip(from.chunks(self.cx)) {
            to[..self.cx].copy_from_slice(from);
        }
        let (odd_x, odd_y) = (usize::from(c == 0), usize::from(c == 1));
        let mut half = vec![0.0; self.plane()];
        let (n, s) = (self.cy, self.sx);
        multiply(&self.y.forward[odd_y], self.y.stride, &padded, s, &mut half, n, n, s);
        multiply(&half, s, &self.x.back[odd_x], s, out, n, self.cx, s);
    }

    fn plane_from_waves(&self, c: usize, from: &[f32], out: &mut [f32]) {
        let (odd_x, odd_y) = (usize::from(c == 0), usize::from(c == 1));
        let mut half = vec![0.0; self.plane()];
        let mut padded = vec![0.0; self.plane()];
        let (n, s) = (self.cy, self.sx);
        multiply(&self.y.back[odd_y], self.y.stride, from, s, &mut half, n, n, s);
        multiply(&half, s, &self.x.forward[odd_x], s, &mut padded, n, self.cx, s);
        for (to, from) in out.chunks_mut(self.cx).zip(padded.chunks(s)) {
            to.copy_from_slice(&from[..self.cx]);
        }
    }

    /// Solves all modes; right-hand sides are zero below layer `from` (counted without the base).
    fn solve_modes(&self, waves: &mut [f32], from: usize) {
        let depth = self.layers - 1;
        // Hand each y mode its rows of every plane.
        let mut rows: Vec<Vec<&mut [f32]>> = (0..self.cy).map(|_| Vec::with_capacity(3 * depth)).collect();
        for plane in waves.chunks_mut(self.plane()) {
            for (row, piece) in rows.iter_mut().zip(plane.chunks_mut(self.sx)) {
                row.push(piece);
            }
        }
        let blocks = self.sx / WIDTH;
        let per_block = 3 * depth * (BAND + 1) * WIDTH;
        rows.into_par_iter().enumerate().for_each(|(m, row)| {
            let factors = &self.factors[m * blocks * per_block..][..blocks * per_block];
            dispatch(SolveRow { row, factors, depth, from });
        });
    }
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

struct SolveRow<'a> {
    row: Vec<&'a mut [f32]>,
    factors: &'a [f32],
    depth: usize,
    from: usize,
}

impl Kernel for SolveRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let rows = 3 * self.depth;
        let per_block = rows * (BAND + 1) * WIDTH;
        let mut x = [L::splat(0.0); MOST_ROWS + BAND];
        for b in 0..self.row[0].len() / WIDTH {
            let f = &self.factors[b * per_block..(b + 1) * per_block];
            let coefficient = |i: usize, d: usize| L::load(&f[(i * (BAND + 1) + d) * WIDTH..]);
            // Eight zero rows in front spare the band its case at the base.
            for v in x[..BAND + 3 * self.from].iter_mut() {
                *v = L::splat(0.0);
            }
            for i in 3 * self.from..rows {
                let mut sum = L::load(&self.row[(i % 3) * self.depth + i / 3][b * WIDTH..]);
                for d in 1..=BAND {
                    sum = coefficient(i, d).fnma(x[BAND + i - d], sum);
                }
                x[BAND + i] = sum;
            }
            for i in 0..rows {
                x[BAND + i] = x[BAND + i].mul(coefficient(i, 0));
            }
            for i in (0..rows).rev() {
                let v = x[BAND + i];
                v.store(&mut self.row[(i % 3) * self.depth + i / 3][b * WIDTH..]);
                for d in 1..=BAND {
                    x[BAND + i - d] = coefficient(i, d).fnma(v, x[BAND + i - d]);
                }
            }
        }
    }
}

/// out = a b with `rows` rows, `inner` inner and `columns` columns (a multiple of the SIMD width).
#[allow(clippy::too_many_arguments)]
fn multiply(
    a: &[f32],
    a_stride: usize,
    b: &[f32],
    b_stride: usize,
    out: &mut [f32],
    rows: usize,
    inner: usize,
    columns: usize,
) {
    dispatch(Multiply { a, a_stride, b, b_stride, out, rows, inner, columns });
}

struct Multiply<'a> {
    a: &'a [f32],
    a_stride: usize,
    b: &'a [f32],
    b_stride: usize,
    out: &'a mut [f32],
    rows: usize,
    inner: usize,
    columns: usize,
}

impl Multiply<'_> {
    /// A tile of R rows and C registers.
    #[inline(always)]
    fn tile<L: Lanes, const R: usize, const C: usize>(&mut self, row: usize, column: usize) {
        let mut sums = [[L::splat(0.0); C]; R];
        for i in 0..self.inner {
            let b = &self.b[i * self.b_stride + column..][..C * WIDTH];
            let b: [L; C] = std::array::from_fn(|c| L::load(&b[c * WIDTH..]));
            for (r, sum) in sums.iter_mut().enumerate() {
                let a = L::splat(self.a[(row + r) * self.a_stride + i]);
                for c in 0..C {
                    sum[c] = a.fma(b[c], sum[c]);
                }
            }
        }
        for (r, sum) in sums.iter().enumerate() {
            let to = &mut self.out[(row + r) * self.b_stride + column..][..C * WIDTH];
            for c in 0..C {
                sum[c].store(&mut to[c * WIDTH..]);
            }
        }
    }

    #[inline(always)]
    fn columns<L: Lanes, const R: usize>(&mut self, row: usize) {
        let mut column = 0;
        while column < self.columns {
            match (self.columns - column) / WIDTH {
                1 => {
                    self.tile::<L, R, 1>(row, column);
                    column += WIDTH;
                }
                2 | 3 => {
                    self.tile::<L, R, 2>(row, column);
                    column += 2 * WIDTH;
                }
                _ => {
                    self.tile::<L, R, 4>(row, column);
                    column += 4 * WIDTH;
                }
            }
        }
    }
}

impl Kernel for Multiply<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let mut row = 0;
        while row + 5 <= self.rows {
            self.columns::<L, 5>(row);
            row += 5;
        }
        while row < self.rows {
            self.columns::<L, 1>(row);
            row += 1;
        }
    }
}
