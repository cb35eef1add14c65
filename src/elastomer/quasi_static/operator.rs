//! Internal forces of the pad and their derivative, by sum factorisation.
//!
//! Work goes column by column: as many cells side by side in x as a register has lanes, one row in y, all layers from the base to
//! the face. Each control layer is interpolated to the 2 x 2 Gauss points of the plane once, the depth
//! direction then combines three layers per cell, and the transpose runs the same way back. Rows are
//! grouped into slabs whose outputs are added in a fixed order, so that results do not depend on the
//! number of threads.

mod apply;
mod bend;
mod evaluate;
mod sweep;

use self::apply::ApplySlab;
use self::bend::Bend;
use self::evaluate::EvaluateSlab;
use super::chart::Chart;
use super::grid::Grid;
use super::lanes::dispatch;
use super::law::{COROTATED_FIELDS, NEO_HOOKEAN_FIELDS};
use super::stack::Stack;
use crate::elastomer::Law;
use rayon::prelude::*;

/// Numbers stored per cell beside those of its points: pressure, its slope, mean J, and whether a point of
/// the cells beside it is in reach of the barrier.
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

/// Basis tables in single precision; `z` is `[cell][gauss][spline] = (value, slope)`.
#[derive(Debug, Clone)]
struct Tables {
    x: [[[f32; 3]; 2]; 2],
    y: [[[f32; 3]; 2]; 2],
    z: Vec<[[[f32; 3]; 2]; 2]>,
    weight: Vec<f32>,
}

/// The tangent at a displacement, point by point, as many cells side by side as the instruction set that made it has lanes.
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

    /// Numbers that the tangent has of a cell.
    fn cell_fields(&self) -> usize {
        let fields = match self.law {
            Law::FixedCorotated => COROTATED_FIELDS,
            Law::NeoHookean => NEO_HOOKEAN_FIELDS,
        };
        8 * fields + CELL_FIELDS
    }

    fn slab_len(&self, slab: (usize, usize)) -> usize {
        3 * self.grid.layers() * (slab.1 - slab.0 + 2) * self.grid.cx()
    }

    /// Internal forces at displacement `u` (layer 0 carries the reaction of the base); fills `tangent`.
    pub fn evaluate(&self, u: &[f32], force: &mut [f32], tangent: &mut Tangent) -> Evaluation {
        let row = self.cell_fields() * self.grid.hz.len() * self.grid.nx;
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
        let row = self.cell_fields() * self.grid.hz.len() * self.grid.nx;
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
