//! Internal forces of the pad and their derivative, by sum factorisation.
//!
//! Work goes column by column: sixteen cells side by side in x, one row in y, all layers from the base to
//! the face. Each control layer is interpolated to the 2 x 2 Gauss points of the plane once, the depth
//! direction then combines three layers per cell, and the transpose runs the same way back. Rows are
//! grouped into slabs whose outputs are added in a fixed order, so that results do not depend on the
//! number of threads.

use super::chart::Chart;
use super::grid::{GAUSS, Grid};
use super::lanes::{Kernel, Lanes, WIDTH, dispatch};
use super::law::{
    BARRIER_BEGINS, COROTATED_FIELDS, Mat, NEO_HOOKEAN_FIELDS, barrier, cofactor, cofactor_change, inner,
    plus_identity, rotation, rotation_change, spin_stiffness_inverse, volume_change,
};
use super::stack::Stack;
use crate::elastomer::Law;
use rayon::prelude::*;

/// Numbers stored per cell beside those of its points: pressure, its slope, mean J, and whether a point of
/// the sixteen cells is in reach of the barrier.
const CELL_FIELDS: usize = 4;
/// Stiffness against uneven volume within a cell over the shear modulus.
const EVENNESS: f64 = 4.0;
/// A point with less volume than this counts as inverted.
pub const LEAST_VOLUME: f32 = 0.01;

/// What an evaluation of the internal forces says beside the forces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evaluation {
    /// Stored energy, N mm.
    pub energy: f64,
    /// Least volume ratio J over the points; not a number when any is not.
    pub least_volume: f32,
}

/// The elastic operator of a pad.
#[derive(Debug, Clone)]
pub struct Operator {
    grid: Grid,
    law: Law,
    /// What each layer of cells is made of, from the base up.
    moduli: Vec<Moduli>,
    slabs: Vec<(usize, usize)>,
    tables: Tables,
    /// Absent for a box.
    bend: Option<Bend>,
}

/// Elastic constants of a cell, MPa.
#[derive(Debug, Clone, Copy)]
struct Moduli {
    mu: f32,
    lambda: f32,
    /// Stiffness against uneven volume within a cell.
    evenness: f32,
}

/// The map from the grid's box to where the material rests, at every point, in the order of a [`sweep`]: the inverse
/// of its derivative and its determinant.
#[derive(Debug, Clone)]
struct Bend {
    data: Vec<f32>,
}

/// Numbers of a [`Bend`] per point.
const BEND_FIELDS: usize = 10;

impl Bend {
    fn new(grid: &Grid, chart: &Chart) -> Self {
        let per_cell = 8 * BEND_FIELDS * WIDTH;
        let per_row = per_cell * grid.hz.len() * (grid.nx / WIDTH);
        let mut data = vec![0.0; per_row * grid.ny];
        let bottoms: Vec<f64> = grid.knots_z()[2..].iter().map(|z| z - grid.size[2]).collect();
        data.par_chunks_mut(per_row).enumerate().for_each(|(j, row)| {
            for (n, cell) in row.chunks_mut(per_cell).enumerate() {
                let (block, k) = (n / grid.hz.len(), n % grid.hz.len());
                for p in 0..8 {
                    let [gx, gy, gz] = [p & 1, (p >> 1) & 1, p >> 2].map(|g| GAUSS[g]);
                    let y = (j as f64 + gy) * grid.hy - grid.size[1] / 2.0;
                    let z = bottoms[k] + gz * grid.hz[k];
                    for lane in 0..WIDTH {
                        let x = ((block * WIDTH + lane) as f64 + gx) * grid.hx - grid.size[0] / 2.0;
                        let jacobian = chart.jacobian(x, y, z);
                        let inverse = jacobian.inverse();
                        let mut put =
                            |n: usize, v: f64| cell[(p * BEND_FIELDS + n) * WIDTH + lane] = v as f32;
                        for a in 0..3 {
                            for c in 0..3 {
                                put(3 * a + c, inverse.col(c)[a]);
                            }
                        }
                        put(9, jacobian.determinant());
                    }
                }
            }
        });
        Self { data }
    }
}

/// What a [`Bend`] makes of the points of sixteen cells.
struct Metric<L> {
    /// Volume of a point over the mean of the cell's.
    share: [L; 8],
    /// Mean volume over that of the box's.
    volume: L,
}

impl<L: Lanes> Metric<L> {
    /// Of a box.
    #[inline(always)]
    fn flat() -> Self {
        Self { share: [L::splat(1.0); 8], volume: L::splat(1.0) }
    }

    /// Of sixteen bent cells, whose gradients become those in space.
    #[inline(always)]
    fn unbend(bend: &[f32], grad: &mut [Mat<L>; 8]) -> Self {
        let mut share = [L::splat(0.0); 8];
        let mut sum = L::splat(0.0);
        for (p, h) in grad.iter_mut().enumerate() {
            let inverse = read_matrix::<L>(&bend[p * BEND_FIELDS * WIDTH..]);
            share[p] = L::load(&bend[(p * BEND_FIELDS + 9) * WIDTH..]);
            sum = sum.add(share[p]);
            for line in h.iter_mut() {
                let of = *line;
                for (c, to) in line.iter_mut().enumerate() {
                    *to = of[2].fma(inverse[2][c], of[1].fma(inverse[1][c], of[0].mul(inverse[0][c])));
                }
            }
        }
        let volume = sum.mul(L::splat(0.125));
        let part = L::splat(1.0).div(volume);
        for s in &mut share {
            *s = s.mul(part);
        }
        Self { share, volume }
    }

    /// Stresses in space become those of the box.
    #[inline(always)]
    fn bend(bend: &[f32], stress: &mut [Mat<L>; 8]) {
        for (p, h) in stress.iter_mut().enumerate() {
            let inverse = read_matrix::<L>(&bend[p * BEND_FIELDS * WIDTH..]);
            let det = L::load(&bend[(p * BEND_FIELDS + 9) * WIDTH..]);
            for line in h.iter_mut() {
                let of = line.map(|v| v.mul(det));
                for (a, to) in line.iter_mut().enumerate() {
                    let i = &inverse[a];
                    *to = of[2].fma(i[2], of[1].fma(i[1], of[0].mul(i[0])));
                }
            }
        }
    }
}

/// Basis tables in single precision; `z` is `[cell][gauss][spline] = (value, slope)`.
#[derive(Debug, Clone)]
struct Tables {
    x: [[[f32; 3]; 2]; 2],
    y: [[[f32; 3]; 2]; 2],
    z: Vec<[[[f32; 3]; 2]; 2]>,
    weight: Vec<f32>,
}

/// The tangent at a displacement, point by point.
#[derive(Debug, Clone, Default)]
pub struct Tangent {
    data: Vec<f32>,
}

/// Stiffness against uneven volume within a cell, MPa.
pub fn evenness(mu: f64, lambda: f64) -> f64 {
    (EVENNESS * mu).min(lambda)
}

impl Operator {
    /// The operator of `law` on a grid that `chart` bends, if anything does.
    pub fn new(grid: Grid, law: Law, stack: &Stack, chart: Option<&Chart>) -> Self {
        let single = |b: &super::grid::CellBasis| {
            let cast = |m: [[f64; 3]; 2]| m.map(|row| row.map(|v| v as f32));
            [cast(b.value), cast(b.slope)]
        };
        let tables = Tables {
            x: single(&grid.x),
            y: single(&grid.y),
            z: grid.z.iter().map(single).collect(),
            weight: grid.hz.iter().map(|h| (grid.hx * grid.hy * h / 8.0) as f32).collect(),
        };
        // Four rows to a slab keep the overlap small and leave enough slabs for every core.
        let count = (grid.ny / 4).max(1);
        let slabs = (0..count).map(|s| (s * grid.ny / count, (s + 1) * grid.ny / count)).collect();
        let moduli = |(mu, lambda): (&f64, &f64)| Moduli {
            mu: *mu as f32,
            lambda: *lambda as f32,
            evenness: evenness(*mu, *lambda) as f32,
        };
        let moduli = stack.mu.iter().zip(&stack.lambda).map(moduli).collect();
        let bend = chart.map(|chart| Bend::new(&grid, chart));
        Self { grid, law, moduli, slabs, tables, bend }
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    fn cell_stride(&self) -> usize {
        let fields = match self.law {
            Law::FixedCorotated => COROTATED_FIELDS,
            Law::NeoHookean => NEO_HOOKEAN_FIELDS,
        };
        (8 * fields + CELL_FIELDS) * WIDTH
    }

    fn slab_len(&self, slab: (usize, usize)) -> usize {
        3 * self.grid.layers() * (slab.1 - slab.0 + 2) * self.grid.cx()
    }

    /// Internal forces at displacement `u` (layer 0 carries the reaction of the base); fills `tangent`.
    pub fn evaluate(&self, u: &[f32], force: &mut [f32], tangent: &mut Tangent) -> Evaluation {
        let row = self.cell_stride() * self.grid.hz.len() * (self.grid.nx / WIDTH);
        tangent.data.resize(row * self.grid.ny, 0.0);
        let mut rows: Vec<&mut [f32]> = Vec::with_capacity(self.slabs.len());
        let mut rest = tangent.data.as_mut_slice();
        for s in &self.slabs {
            let (head, tail) = rest.split_at_mut(row * (s.1 - s.0));
            rows.push(head);
            rest = tail;
        }
        let parts: Vec<(Vec<f32>, Evaluation)> = self
            .slabs
            .par_iter()
            .zip(rows)
            .map(|(&slab, data)| {
                let mut out = vec![0.0; self.slab_len(slab)];
                let found = dispatch(EvaluateSlab { op: self, slab, u, out: &mut out, data });
                (out, found)
            })
            .collect();
        let mut total = Evaluation { energy: 0.0, least_volume: f32::INFINITY };
        for (_, e) in &parts {
            total.energy += e.energy;
            // `min` would drop a NaN; this keeps it.
            if !(e.least_volume >= total.least_volume) {
                total.least_volume = e.least_volume;
            }
        }
        let outs: Vec<&[f32]> = parts.iter().map(|(o, _)| o.as_slice()).collect();
        self.gather_slabs(&outs, force, false);
        total
    }

    /// Applies the tangent to `d`; the bonded layer of the result is zero.
    pub fn apply(&self, tangent: &Tangent, d: &[f32], out: &mut [f32]) {
        let row = self.cell_stride() * self.grid.hz.len() * (self.grid.nx / WIDTH);
        let parts: Vec<Vec<f32>> = self
            .slabs
            .par_iter()
            .map(|&slab| {
                let mut part = vec![0.0; self.slab_len(slab)];
                let data = &tangent.data[row * slab.0..row * slab.1];
                dispatch(ApplySlab { op: self, slab, d, out: &mut part, data });
                part
            })
            .collect();
        let outs: Vec<&[f32]> = parts.iter().map(|o| o.as_slice()).collect();
        self.gather_slabs(&outs, out, true);
    }

    /// Adds the slabs' outputs in order.
    fn gather_slabs(&self, parts: &[&[f32]], out: &mut [f32], clear_base: bool) {
        let (g, cx) = (&self.grid, self.grid.cx());
        let layers = g.layers();
        out.par_chunks_mut(g.plane()).enumerate().for_each(|(plane, to)| {
            to.fill(0.0);
            if clear_base && plane % layers == 0 {
                return;
            }
            for (slab, part) in self.slabs.iter().zip(parts) {
                let len = (slab.1 - slab.0 + 2) * cx;
                let from = &part[plane * len..(plane + 1) * len];
                for (t, f) in to[slab.0 * cx..slab.0 * cx + len].iter_mut().zip(from) {
                    *t += f;
                }
            }
        });
    }
}

/// Interpolants of one control layer at the 2 x 2 Gauss points of the plane: `[component][gx][gy]`.
#[derive(Clone, Copy)]
struct Layer<L> {
    value: [[[L; 2]; 2]; 3],
    dx: [[[L; 2]; 2]; 3],
    dy: [[[L; 2]; 2]; 3],
}

impl<L: Lanes> Layer<L> {
    #[inline(always)]
    fn zero() -> Self {
        let z = [[[L::splat(0.0); 2]; 2]; 3];
        Self { value: z, dx: z, dy: z }
    }
}

/// Which sixteen cells of a sweep.
#[derive(Clone, Copy)]
struct Place {
    /// Layer of cells, from the base up.
    k: usize,
    /// Where their data begin.
    data: usize,
}

/// What happens at the eight points of sixteen cells: displacement gradients become weighted stresses.
trait CellWork<L: Lanes> {
    fn cell(&mut self, gradients: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>);
}

/// Runs over the columns of one slab.
#[inline(always)]
fn sweep<L: Lanes, W: CellWork<L>>(
    op: &Operator,
    slab: (usize, usize),
    u: &[f32],
    out: &mut [f32],
    work: &mut W,
) {
    let g = &op.grid;
    let (cx, layers, depth) = (g.cx(), g.layers(), g.hz.len());
    let rows = slab.1 - slab.0 + 2;
    let t = &op.tables;
    let stride = op.cell_stride();
    let mut data = 0;
    let bend_stride = 8 * BEND_FIELDS * WIDTH;
    let mut bend = slab.0 * (g.nx / WIDTH) * depth * bend_stride;
    for j in slab.0..slab.1 {
        for i0 in (0..g.nx).step_by(WIDTH) {
            let mut ring = [Layer::<L>::zero(); 3];
            let mut back = [Layer::<L>::zero(); 3];
            read_layer(op, u, 1, j, i0, &mut ring[1]);
            for k in 0..depth {
                read_layer(op, u, k + 2, j, i0, &mut ring[(k + 2) % 3]);
                let [value, slope] = &t.z[k];
                // Depth direction: gradients at the points, numbered gx + 2 gy + 4 gz.
                let mut grad = [[[L::splat(0.0); 3]; 3]; 8];
                for gz in 0..2 {
                    for gy in 0..2 {
                        for gx in 0..2 {
                            let h = &mut grad[gx + 2 * gy + 4 * gz];
                            for c in 0..3 {
                                let (a, b, d) = (&ring[k % 3], &ring[(k + 1) % 3], &ring[(k + 2) % 3]);
                                let mix = |w: &[f32; 3], x: L, y: L, z: L| {
                                    let first = x.mul(L::splat(w[0]));
                                    z.fma(L::splat(w[2]), y.fma(L::splat(w[1]), first))
                                };
                                h[c][0] = mix(&value[gz], a.dx[c][gx][gy], b.dx[c][gx][gy], d.dx[c][gx][gy]);
                                h[c][1] = mix(&value[gz], a.dy[c][gx][gy], b.dy[c][gx][gy], d.dy[c][gx][gy]);
                                h[c][2] = mix(
                                    &slope[gz],
                                    a.value[c][gx][gy],
                                    b.value[c][gx][gy],
                                    d.value[c][gx][gy],
                                );
                            }
                        }
                    }
                }
                let place = Place { k, data };
                match &op.bend {
                    None => work.cell(&mut grad, place, &Metric::flat()),
                    Some(all) => {
                        let here = &all.data[bend..bend + bend_stride];
                        let metric = Metric::unbend(here, &mut grad);
                        work.cell(&mut grad, place, &metric);
                        Metric::bend(here, &mut grad);
                        bend += bend_stride;
                    }
                }
                data += stride;
                // And back.
                let weight = t.weight[k];
                for a in 0..3 {
                    let layer = &mut back[(k + a) % 3];
                    // This cell is the first that the layer above it meets.
                    let first = a == 2;
                    for c in 0..3 {
                        for gy in 0..2 {
                            for gx in 0..2 {
                                for gz in 0..2 {
                                    let p = &grad[gx + 2 * gy + 4 * gz][c];
                                    let v = L::splat(value[gz][a] * weight);
                                    let s = L::splat(slope[gz][a] * weight);
                                    let dx = &mut layer.dx[c][gx][gy];
                                    let dy = &mut layer.dy[c][gx][gy];
                                    let of = &mut layer.value[c][gx][gy];
                                    if first && gz == 0 {
                                        (*dx, *dy, *of) = (p[0].mul(v), p[1].mul(v), p[2].mul(s));
                                    } else {
                                        (*dx, *dy, *of) =
                                            (p[0].fma(v, *dx), p[1].fma(v, *dy), p[2].fma(s, *of));
                                    }
                                }
                            }
                        }
                    }
                }
                write_layer(op, &back[k % 3], out, k, (j - slab.0, rows), i0);
            }
            for k in depth..layers {
                write_layer(op, &back[k % 3], out, k, (j - slab.0, rows), i0);
            }
            let _ = cx;
        }
    }
}

/// Plane directions: x along each of three rows, then y. (Nothing is mapped over arrays within: in builds for tests that is a call
/// for each element.)
#[inline(always)]
fn read_layer<L: Lanes>(op: &Operator, u: &[f32], k: usize, j: usize, i0: usize, out: &mut Layer<L>) {
    let (g, t) = (&op.grid, &op.tables);
    let cx = g.cx();
    for c in 0..3 {
        let plane = &u[g.at(c, k)..g.at(c, k) + g.plane()];
        for b in 0..3 {
            let row = &plane[(j + b) * cx + i0..(j + b) * cx + i0 + WIDTH + 2];
            let (p, q, r) = (L::load(row), L::load(&row[1..]), L::load(&row[2..]));
            for gx in 0..2 {
                let mix = |w: &[f32; 3]| r.fma(L::splat(w[2]), q.fma(L::splat(w[1]), p.mul(L::splat(w[0]))));
                let (v, d) = (mix(&t.x[0][gx]), mix(&t.x[1][gx]));
                for gy in 0..2 {
                    let (wv, wd) = (L::splat(t.y[0][gy][b]), L::splat(t.y[1][gy][b]));
                    let dx = &mut out.dx[c][gx][gy];
                    let dy = &mut out.dy[c][gx][gy];
                    let of = &mut out.value[c][gx][gy];
                    if b == 0 {
                        (*dx, *dy, *of) = (d.mul(wv), v.mul(wd), v.mul(wv));
                    } else {
                        (*dx, *dy, *of) = (d.fma(wv, *dx), v.fma(wd, *dy), v.fma(wv, *of));
                    }
                }
            }
        }
    }
}

/// Transpose of [`read_layer`], added to a slab's output; `row` is (first row, rows) of the slab.
#[inline(always)]
fn write_layer<L: Lanes>(
    op: &Operator,
    from: &Layer<L>,
    out: &mut [f32],
    k: usize,
    row: (usize, usize),
    i0: usize,
) {
    let (g, t) = (&op.grid, &op.tables);
    let cx = g.cx();
    for c in 0..3 {
        let plane = (c * g.layers() + k) * row.1 * cx;
        for b in 0..3 {
            let mut sums = [L::splat(0.0); 3];
            for gx in 0..2 {
                let mut v = L::splat(0.0);
                let mut d = L::splat(0.0);
                for gy in 0..2 {
                    let (wv, wd) = (L::splat(t.y[0][gy][b]), L::splat(t.y[1][gy][b]));
                    v = from.value[c][gx][gy].fma(wv, from.dy[c][gx][gy].fma(wd, v));
                    d = from.dx[c][gx][gy].fma(wv, d);
                }
                for (a, sum) in sums.iter_mut().enumerate() {
                    *sum = v.fma(L::splat(t.x[0][gx][a]), d.fma(L::splat(t.x[1][gx][a]), *sum));
                }
            }
            L::add_staggered(sums, &mut out[plane + (row.0 + b) * cx + i0..]);
        }
    }
}

struct EvaluateSlab<'a> {
    op: &'a Operator,
    slab: (usize, usize),
    u: &'a [f32],
    out: &'a mut [f32],
    data: &'a mut [f32],
}

impl Kernel for EvaluateSlab<'_> {
    type Output = Evaluation;
    #[inline(always)]
    fn run<L: Lanes>(self) -> Evaluation {
        let mut work = Evaluate {
            op: self.op,
            data: self.data,
            energy: 0.0,
            least: L::splat(f32::INFINITY),
            poison: L::splat(0.0),
        };
        sweep::<L, _>(self.op, self.slab, self.u, self.out, &mut work);
        let mut least = f32::INFINITY;
        for (l, p) in work.least.to_array().iter().zip(work.poison.to_array()) {
            // `poison` is 0 unless a number was infinite or not a number.
            let seen = l + p;
            if !(seen >= least) {
                least = seen;
            }
        }
        Evaluation { energy: work.energy, least_volume: least }
    }
}

struct Evaluate<'a, L> {
    op: &'a Operator,
    data: &'a mut [f32],
    energy: f64,
    least: L,
    poison: L,
}

impl<L: Lanes> CellWork<L> for Evaluate<'_, L> {
    #[inline(always)]
    fn cell(&mut self, grad: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>) {
        let op = self.op;
        let moduli = op.moduli[place.k];
        let (mu, lambda) = (L::splat(moduli.mu), L::splat(moduli.lambda));
        let one = L::splat(1.0);
        let zero = L::splat(0.0);
        let mut j1 = [zero; 8];
        let mut mean = zero;
        let mut least = L::splat(f32::INFINITY);
        for ((j, h), share) in j1.iter_mut().zip(grad.iter()).zip(&metric.share) {
            *j = volume_change(h);
            mean = j.fma(*share, mean);
            least = least.min(j.add(one));
            self.poison = j.mul(zero).add(self.poison);
        }
        self.least = self.least.min(least);
        // Elsewhere the barrier is exactly zero.
        let barred = least.to_array().iter().any(|j| *j < BARRIER_BEGINS);
        mean = mean.mul(L::splat(0.125));
        let data = &mut self.data[place.data..place.data + op.cell_stride()];
        // Volumetric terms of the cell: pressure factor and its slope.
        let mut energy = zero;
        let (pressure, slope) = match op.law {
            Law::FixedCorotated => {
                energy = lambda.mul(mean).mul(mean).mul(L::splat(4.0));
                (lambda.mul(mean), lambda)
            }
            Law::NeoHookean => {
                let log = lanes_ln_1p(mean);
                let inv = one.div(mean.add(one));
                energy = lambda.mul(log).mul(log).mul(L::splat(4.0)).add(energy);
                (lambda.mul(log).mul(inv), lambda.mul(one.sub(log)).mul(inv).mul(inv))
            }
        };
        pressure.store(&mut data[0..]);
        slope.store(&mut data[WIDTH..]);
        mean.add(one).store(&mut data[2 * WIDTH..]);
        L::splat(f32::from(u8::from(barred))).store(&mut data[3 * WIDTH..]);
        let even = L::splat(moduli.evenness);
        for (p, h) in grad.iter_mut().enumerate() {
            let mut own = zero;
            let f = plus_identity(h);
            let c = cofactor(&f);
            let uneven = j1[p].sub(mean);
            let leveling = even.mul(uneven);
            own = L::splat(0.5).mul(leveling).fma(uneven, own);
            match op.law {
                Law::FixedCorotated => {
                    let r = rotation(&f);
                    let k = spin_stiffness_inverse(&f, &r);
                    let data = &mut data[(CELL_FIELDS + p * COROTATED_FIELDS) * WIDTH..];
                    for i in 0..3 {
                        for j in 0..3 {
                            let n = 3 * i + j;
                            f[i][j].store(&mut data[n * WIDTH..]);
                            r[i][j].store(&mut data[(9 + n) * WIDTH..]);
                        }
                    }
                    for (n, v) in k.iter().enumerate() {
                        v.store(&mut data[(18 + n) * WIDTH..]);
                    }
                    let mut pressure = pressure;
                    if barred {
                        let [wall, push, _] = barrier(j1[p].add(one));
                        own = lambda.fma(wall, own);
                        pressure = lambda.fma(push, pressure);
                    }
                    let pressure = pressure.add(leveling);
                    let two_mu = mu.add(mu);
                    for i in 0..3 {
                        for j in 0..3 {
                            let e = f[i][j].sub(r[i][j]);
                            own = mu.mul(e).fma(e, own);
                            h[i][j] = two_mu.fma(e, pressure.mul(c[i][j]));
                        }
                    }
                }
                Law::NeoHookean => {
                    let data = &mut data[(CELL_FIELDS + p * NEO_HOOKEAN_FIELDS) * WIDTH..];
                    // F - C/J from the gradient alone: of the two, each near one, rounding would be left in a small press.
                    let of = *h;
                    let minors = cofactor(&of);
                    let volume = j1[p].add(one);
                    let shear = mu.div(volume);
                    let beyond = j1[p].sub(of[0][0].add(of[1][1]).add(of[2][2]));
                    let pressure = pressure.add(leveling);
                    let half_mu = mu.mul(L::splat(0.5));
                    own = lanes_ln_1p(j1[p]).fnma(mu, own);
                    for i in 0..3 {
                        own = mu.fma(of[i][i], own);
                        for j in 0..3 {
                            f[i][j].store(&mut data[(3 * i + j) * WIDTH..]);
                            own = half_mu.mul(of[i][j]).fma(of[i][j], own);
                            let turned = of[j][i].sub(minors[i][j]);
                            let sum = volume.fma(of[i][j], if i == j { turned.add(beyond) } else { turned });
                            h[i][j] = shear.fma(sum, pressure.mul(c[i][j]));
                        }
                    }
                }
            }
            energy = own.fma(metric.share[p], energy);
        }
        let weight = op.tables.weight[place.k];
        let energy = energy.mul(metric.volume);
        self.energy += f64::from(weight) * energy.to_array().iter().map(|e| f64::from(*e)).sum::<f64>();
    }
}

/// ln(1 + x) = 2 artanh(x / (2 + x)), by its series where that takes six terms (x from -0.4 to 0.66), else lane by lane.
#[inline(always)]
fn lanes_ln_1p<L: Lanes>(x: L) -> L {
    const FURTHEST: f32 = 0.25;
    let t = x.div(L::splat(2.0).add(x));
    if !t.to_array().iter().all(|t| t.abs() <= FURTHEST) {
        return L::load(&x.to_array().map(f32::ln_1p));
    }
    let s = t.mul(t);
    let mut sum = L::splat(1.0 / 11.0);
    for n in [9.0, 7.0, 5.0, 3.0, 1.0] {
        sum = sum.fma(s, L::splat(1.0 / n));
    }
    sum.mul(t.add(t))
}

struct ApplySlab<'a> {
    op: &'a Operator,
    slab: (usize, usize),
    d: &'a [f32],
    out: &'a mut [f32],
    data: &'a [f32],
}

impl Kernel for ApplySlab<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        match self.op.law {
            Law::FixedCorotated => {
                let mut work = ApplyCorotated { op: self.op, data: self.data };
                sweep::<L, _>(self.op, self.slab, self.d, self.out, &mut work);
            }
            Law::NeoHookean => {
                let mut work = ApplyNeoHookean { op: self.op, data: self.data };
                sweep::<L, _>(self.op, self.slab, self.d, self.out, &mut work);
            }
        }
    }
}

#[inline(always)]
fn read_matrix<L: Lanes>(data: &[f32]) -> Mat<L> {
    let mut m = [[L::splat(0.0); 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            m[i][j] = L::load(&data[(3 * i + j) * WIDTH..]);
        }
    }
    m
}

struct ApplyCorotated<'a> {
    op: &'a Operator,
    data: &'a [f32],
}

impl<L: Lanes> CellWork<L> for ApplyCorotated<'_> {
    #[inline(always)]
    fn cell(&mut self, grad: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>) {
        let data = &self.data[place.data..place.data + (CELL_FIELDS + 8 * COROTATED_FIELDS) * WIDTH];
        let moduli = self.op.moduli[place.k];
        let two_mu = L::splat(2.0 * moduli.mu);
        let (pressure, slope) = (L::load(data), L::load(&data[WIDTH..]));
        let even = L::splat(moduli.evenness);
        let mut change = L::splat(0.0);
        for (p, d) in grad.iter().enumerate() {
            let f = read_matrix::<L>(&data[(CELL_FIELDS + p * COROTATED_FIELDS) * WIDTH..]);
            change = inner(&cofactor(&f), d).fma(metric.share[p], change);
        }
        let change = change.mul(slope.sub(even)).mul(L::splat(0.125));
        let pressure = even.fnma(L::load(&data[2 * WIDTH..]), pressure);
        let lambda = L::splat(moduli.lambda);
        let barred = data[3 * WIDTH] > 0.0;
        for (p, d) in grad.iter_mut().enumerate() {
            let data = &data[(CELL_FIELDS + p * COROTATED_FIELDS) * WIDTH..];
            let f = read_matrix::<L>(data);
            let r = read_matrix::<L>(&data[9 * WIDTH..]);
            let mut k = [change; 6];
            for (n, v) in k.iter_mut().enumerate() {
                *v = L::load(&data[(18 + n) * WIDTH..]);
            }
            let (c, dc, dr) = (cofactor(&f), cofactor_change(&f, d), rotation_change(&r, &k, d));
            let det = f[0][0].fma(c[0][0], f[0][1].fma(c[0][1], f[0][2].mul(c[0][2])));
            let (mut pressure, mut stiffness) = (pressure, even);
            if barred {
                let [_, push, stiffen] = barrier(det);
                (pressure, stiffness) = (lambda.fma(push, pressure), lambda.fma(stiffen, even));
            }
            let pressure = pressure.add(even.mul(det));
            let change = stiffness.fma(inner(&c, d), change);
            for i in 0..3 {
                for j in 0..3 {
                    let twist = two_mu.mul(d[i][j].sub(dr[i][j]));
                    d[i][j] = change.fma(c[i][j], pressure.fma(dc[i][j], twist));
                }
            }
        }
    }
}

struct ApplyNeoHookean<'a> {
    op: &'a Operator,
    data: &'a [f32],
}

impl<L: Lanes> CellWork<L> for ApplyNeoHookean<'_> {
    #[inline(always)]
    fn cell(&mut self, grad: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>) {
        let data = &self.data[place.data..place.data + (CELL_FIELDS + 8 * NEO_HOOKEAN_FIELDS) * WIDTH];
        let moduli = self.op.moduli[place.k];
        let mu = L::splat(moduli.mu);
        let (pressure, slope) = (L::load(data), L::load(&data[WIDTH..]));
        let mut mean = L::splat(0.0);
        let mut own = [mean; 8];
        for (p, d) in grad.iter().enumerate() {
            let f = read_matrix::<L>(&data[(CELL_FIELDS + p * NEO_HOOKEAN_FIELDS) * WIDTH..]);
            own[p] = inner(&cofactor(&f), d);
            mean = own[p].fma(metric.share[p], mean);
        }
        let even = L::splat(moduli.evenness);
        let mean = mean.mul(slope.sub(even)).mul(L::splat(0.125));
        let pressure = even.fnma(L::load(&data[2 * WIDTH..]), pressure);
        for (p, d) in grad.iter_mut().enumerate() {
            let f = read_matrix::<L>(&data[(CELL_FIELDS + p * NEO_HOOKEAN_FIELDS) * WIDTH..]);
            let (c, dc) = (cofactor(&f), cofactor_change(&f, d));
            let det = f[0][0].fma(c[0][0], f[0][1].fma(c[0][1], f[0][2].mul(c[0][2])));
            let inv = L::splat(1.0).div(det);
            let mu_j = mu.mul(inv);
            let factor = even.fma(det, pressure.sub(mu_j));
            let along = mu_j.fma(inv, even).fma(own[p], mean);
            for i in 0..3 {
                for j in 0..3 {
                    d[i][j] = along.fma(c[i][j], factor.fma(dc[i][j], mu.mul(d[i][j])));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Logarithms([f32; WIDTH]);

    impl Kernel for Logarithms {
        type Output = [f32; WIDTH];
        #[inline(always)]
        fn run<L: Lanes>(self) -> [f32; WIDTH] {
            lanes_ln_1p(L::load(&self.0)).to_array()
        }
    }

    #[test]
    fn logarithms_are_those_of_the_standard_library() {
        for n in -99..1000 {
            // All within the series, or one of them far out.
            for spread in [1e-4, 0.5] {
                let x: [f32; WIDTH] = std::array::from_fn(|i| 0.01 * n as f32 + spread * i as f32 / 16.0);
                let found = dispatch(Logarithms(x));
                for (x, found) in x.iter().zip(found) {
                    let exact = f64::from(*x).ln_1p();
                    assert!((f64::from(found) - exact).abs() <= 3e-7 * exact.abs(), "{x}: {found} {exact}");
                }
            }
        }
    }
}
