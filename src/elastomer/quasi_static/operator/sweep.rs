//! The way over the columns of a slab: control layers are interpolated to the points, what is done there is carried back.

use super::super::lanes::{Lanes, WIDTH};
use super::super::law::Mat;
use super::Operator;
use super::bend::{BEND_FIELDS, Metric};

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

/// Which cells of a sweep, as many side by side as there are lanes.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Layer of cells, from the base up.
    pub(super) k: usize,
    /// Where their data begin.
    pub(super) data: usize,
}

/// What happens at the eight points of these cells: displacement gradients become weighted stresses.
pub(super) trait CellWork<L: Lanes> {
    fn cell(&mut self, gradients: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>);
}

/// Runs over the columns of one slab.
#[inline(always)]
pub(super) fn sweep<L: Lanes, W: CellWork<L>>(
    op: &Operator,
    slab: (usize, usize),
    u: &[f32],
    out: &mut [f32],
    work: &mut W,
) {
    let g = &op.grid;
    let (layers, depth) = (g.layers(), g.hz.len());
    let rows = slab.1 - slab.0 + 2;
    let t = &op.tables;
    let stride = op.cell_fields() * L::COUNT;
    let mut data = 0;
    let bend_stride = 8 * BEND_FIELDS * WIDTH;
    let flat = Metric::flat();
    let mut grad = [[[L::splat(0.0); 3]; 3]; 8];
    for j in slab.0..slab.1 {
        for i0 in (0..g.nx).step_by(L::COUNT) {
            let mut bend = (j * (g.nx / WIDTH) + i0 / WIDTH) * depth * bend_stride;
            let mut ring = [Layer::<L>::zero(); 3];
            let mut back = [Layer::<L>::zero(); 3];
            read_layer(op, u, 1, j, i0, &mut ring[1]);
            for k in 0..depth {
                read_layer(op, u, k + 2, j, i0, &mut ring[(k + 2) % 3]);
                let [value, slope] = &t.z[k];
                // Depth direction: gradients at the points, numbered gx + 2 gy + 4 gz.
                for gz in 0..2 {
                    for gy in 0..2 {
                        for gx in 0..2 {
                            let h = &mut grad[gx + 2 * gy + 4 * gz];
                            for c in 0..3 {
                                let (a, b, d) = (&ring[k % 3], &ring[(k + 1) % 3], &ring[(k + 2) % 3]);
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
                // (The work stands once for both: it is most of what is compiled here.)
                let here = op.bend.as_ref().map(|all| &all.data[bend + i0 % WIDTH..bend + bend_stride]);
                let bent;
                let metric = match here {
                    None => &flat,
                    Some(here) => {
                        bent = Metric::unbend(here, &mut grad);
                        &bent
                    }
                };
                work.cell(&mut grad, place, metric);
                if let Some(here) = here {
                    Metric::bend(here, &mut grad);
                    bend += bend_stride;
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
        }
    }
}

/// Three neighbours by their weights.
#[inline(always)]
fn mix<L: Lanes>(weights: &[f32; 3], x: L, y: L, z: L) -> L {
    let first = x.mul(L::splat(weights[0]));
    z.fma(L::splat(weights[2]), y.fma(L::splat(weights[1]), first))
}

/// Plane directions: x along each of three rows, then y. (Nothing is mapped over arrays within, and no closure is called: where these
/// are not inlined, as in builds for tests, they are calls and know no instruction set.)
#[inline(always)]
fn read_layer<L: Lanes>(op: &Operator, u: &[f32], k: usize, j: usize, i0: usize, out: &mut Layer<L>) {
    let (g, t) = (&op.grid, &op.tables);
    let cx = g.cx();
    for c in 0..3 {
        let plane = &u[g.at(c, k)..g.at(c, k) + g.plane()];
        for b in 0..3 {
            let row = &plane[(j + b) * cx + i0..(j + b) * cx + i0 + L::COUNT + 2];
            let (p, q, r) = (L::load(row), L::load(&row[1..]), L::load(&row[2..]));
            for gx in 0..2 {
                let (v, d) = (mix(&t.x[0][gx], p, q, r), mix(&t.x[1][gx], p, q, r));
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

/// A matrix of each of several cells, element by element, `stride` apart.
#[inline(always)]
pub(super) fn read_matrix<L: Lanes>(data: &[f32], stride: usize) -> Mat<L> {
    let mut m = [[L::splat(0.0); 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            m[i][j] = L::load(&data[(3 * i + j) * stride..]);
        }
    }
    m
}
