//! The undeformed layer laid along a bent face, for the preconditioner.

use super::chart::Chart;
use super::grid::Grid;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// A frame for every column of control points ([`Chart::frame`]). What goes in by the transposed frame comes out by the
/// frame itself, so the preconditioner stays symmetric, also with axes that are not of unit length.
#[derive(Debug)]
pub struct Frames {
    turns: Vec<DMat3>,
}

impl Frames {
    /// Frames along the face of a pad that is not flat.
    pub fn new(grid: &Grid, chart: &Chart) -> Self {
        let at = |i: usize, n: usize, size: f64| {
            // Control points sit in the middle of cells, the outer ones beside the pad.
            (((i as f64 - 0.5) / n as f64).clamp(0.0, 1.0) - 0.5) * size
        };
        let turns = (0..grid.plane())
            .map(|n| {
                let x = at(n % grid.cx(), grid.nx, grid.size[0]);
                let y = at(n / grid.cx(), grid.ny, grid.size[1]);
                chart.frame(x, y)
            })
            .collect();
        Self { turns }
    }

    /// The frame of the middle of a cell.
    pub fn at_cell(&self, grid: &Grid, cell: [usize; 2]) -> DMat3 {
        self.turns[(cell[1] + 1) * grid.cx() + cell[0] + 1]
    }

    /// A field in its frames.
    pub fn enter(&self, grid: &Grid, field: &[f32], turned: &mut Vec<f32>) {
        turned.clear();
        turned.extend_from_slice(field);
        self.turn(grid, turned, |frame, v| frame.transpose() * v);
    }

    /// A field in its frames back in space.
    pub fn leave(&self, grid: &Grid, field: &mut [f32]) {
        self.turn(grid, field, |frame, v| *frame * v);
    }

    fn turn(&self, grid: &Grid, field: &mut [f32], by: impl Fn(&DMat3, DVec3) -> DVec3 + Sync) {
        let (x, rest) = field.split_at_mut(grid.at(1, 0));
        let (y, z) = rest.split_at_mut(grid.at(1, 0));
        let n = grid.plane();
        x.par_chunks_mut(n).zip(y.par_chunks_mut(n)).zip(z.par_chunks_mut(n)).for_each(|((x, y), z)| {
            for (((x, y), z), frame) in x.iter_mut().zip(y).zip(z).zip(&self.turns) {
                let v = by(frame, DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)));
                (*x, *y, *z) = (v.x as f32, v.y as f32, v.z as f32);
            }
        });
    }
}
