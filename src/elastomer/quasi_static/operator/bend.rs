//! Cells of a pad that is not a box: gradients and stresses between the grid's box and space.

use super::super::chart::Chart;
use super::super::grid::{GAUSS, Grid};
use super::super::lanes::{Lanes, WIDTH};
use super::super::law::Mat;
use super::sweep::read_matrix;
use rayon::prelude::*;

/// The map from the grid's box to where the material rests, at every point, in the order of a [`sweep`](super::sweep): the inverse
/// of its derivative and its determinant.
#[derive(Debug, Clone)]
pub(super) struct Bend {
    pub(super) data: Vec<f32>,
}

/// Numbers of a [`Bend`] per point.
pub(super) const BEND_FIELDS: usize = 10;

impl Bend {
    pub(super) fn new(grid: &Grid, chart: &Chart) -> Self {
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

/// What a [`Bend`] makes of the points of several cells.
pub(super) struct Metric<L> {
    /// Volume of a point over the mean of the cell's.
    pub(super) share: [L; 8],
    /// Mean volume over that of the box's.
    pub(super) volume: L,
}

impl<L: Lanes> Metric<L> {
    /// Of a box.
    #[inline(always)]
    pub(super) fn flat() -> Self {
        Self { share: [L::splat(1.0); 8], volume: L::splat(1.0) }
    }

    /// Of bent cells, whose gradients become those in space.
    #[inline(always)]
    pub(super) fn unbend(bend: &[f32], grad: &mut [Mat<L>; 8]) -> Self {
        let mut share = [L::splat(0.0); 8];
        let mut sum = L::splat(0.0);
        for (p, h) in grad.iter_mut().enumerate() {
            let inverse = read_matrix::<L>(&bend[p * BEND_FIELDS * WIDTH..], WIDTH);
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
    pub(super) fn bend(bend: &[f32], stress: &mut [Mat<L>; 8]) {
        for (p, h) in stress.iter_mut().enumerate() {
            let inverse = read_matrix::<L>(&bend[p * BEND_FIELDS * WIDTH..], WIDTH);
            let det = L::load(&bend[(p * BEND_FIELDS + 9) * WIDTH..]);
            for line in h.iter_mut() {
                let of = [line[0].mul(det), line[1].mul(det), line[2].mul(det)];
                for (a, to) in line.iter_mut().enumerate() {
                    let i = &inverse[a];
                    *to = of[2].fma(i[2], of[1].fma(i[1], of[0].mul(i[0])));
                }
            }
        }
    }
}
