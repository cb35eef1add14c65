//! From the splines of a coarse grid to those of a fine one.
//!
//! A control value of a quadratic spline is its blossom at the two knots inside its support (Ramshaw 1989): for knots
//! a and b and the polynomial f between them, 2 f((a + b)/2) - f(a)/2 - f(b)/2. Read from a coarse spline this gives
//! the fine one that agrees with it: exactly where the knots are nested, else to third order in the cell size.

use super::grid::Grid;
use rayon::prelude::*;

/// One axis: for every fine control point the coarse ones it is made of.
type Axis = Vec<Vec<(usize, f32)>>;

/// Carries displacements from a coarse grid to a fine grid of the same pad.
#[derive(Debug)]
pub struct Bridge {
    axes: [Axis; 3],
    coarse: [usize; 3],
}

impl Bridge {
    /// The bridge between two grids of one pad.
    pub fn new(coarse: &Grid, fine: &Grid) -> Self {
        let plane = |axis: usize, coarse_cells: usize, fine_cells: usize| {
            let h = fine.size[axis] / fine_cells as f64;
            let read = |x: f64| Grid::extended_trace(x, coarse.size[axis], coarse_cells);
            (0..fine_cells + 2).map(|i| blossom((i as f64 - 1.0) * h, i as f64 * h, read)).collect()
        };
        let (knots, read) = (fine.knots_z(), |z: f64| coarse.values_z(z));
        let depth = (0..fine.layers()).map(|k| blossom(knots[k + 1], knots[k + 2], read)).collect();
        Self {
            axes: [plane(0, coarse.nx, fine.nx), plane(1, coarse.ny, fine.ny), depth],
            coarse: [coarse.cx(), coarse.cy(), coarse.layers()],
        }
    }

    /// The fine field of a coarse one.
    pub fn carry(&self, from: &[f32]) -> Vec<f32> {
        let [cx, cy, layers] = self.coarse;
        let [ax, ay, az] = &self.axes;
        let along_x: Vec<f32> = from
            .par_chunks(cx)
            .with_min_len(64)
            .flat_map_iter(|row| {
                ax.iter().map(move |terms| terms.iter().map(|(i, w)| w * row[*i]).sum::<f32>())
            })
            .collect();
        let row = ax.len();
        let along_y = combine(&along_x, row, cy, ay);
        combine(&along_y, row * ay.len(), layers, az)
    }
}

/// Combines `count` consecutive runs of length `run`, group by group.
fn combine(from: &[f32], run: usize, count: usize, axis: &Axis) -> Vec<f32> {
    let mut out = vec![0.0; from.len() / count * axis.len()];
    out.par_chunks_mut(run * axis.len()).zip(from.par_chunks(run * count)).for_each(|(out, group)| {
        for (to, terms) in out.chunks_mut(run).zip(axis) {
            for (k, w) in terms {
                for (t, f) in to.iter_mut().zip(&group[k * run..(k + 1) * run]) {
                    *t += w * f;
                }
            }
        }
    });
    out
}

/// What the coarse control points give to the fine one whose inner knots are `a` and `b`.
fn blossom(a: f64, b: f64, read: impl Fn(f64) -> (usize, [f64; 3])) -> Vec<(usize, f32)> {
    let mut terms: Vec<(usize, f64)> = Vec::new();
    for (x, factor) in [(0.5 * (a + b), 2.0), (a, -0.5), (b, -0.5)] {
        let (cell, weights) = read(x);
        for (n, w) in weights.iter().enumerate() {
            match terms.iter_mut().find(|(i, _)| *i == cell + n) {
                Some((_, sum)) => *sum += factor * w,
                None => terms.push((cell + n, factor * w)),
            }
        }
    }
    terms.into_iter().filter(|(_, w)| w.abs() > 1e-9).map(|(i, w)| (i, w as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Control values of a polynomial of second degree in each coordinate, by its blossom.
    fn field(grid: &Grid) -> Vec<f32> {
        let polar = |c: [f64; 3], a: f64, b: f64| c[0] + c[1] * 0.5 * (a + b) + c[2] * a * b;
        let knots = grid.knots_z();
        let mut out = vec![0.0; grid.field_len()];
        for c in 0..3 {
            for k in 0..grid.layers() {
                for j in 0..grid.cy() {
                    for i in 0..grid.cx() {
                        let x = polar([1.0, 0.1, 0.02], (i as f64 - 1.0) * grid.hx, i as f64 * grid.hx);
                        let y = polar([0.5, -0.2, 0.01], (j as f64 - 1.0) * grid.hy, j as f64 * grid.hy);
                        let z = polar([0.1 + c as f64, 0.3, 0.05], knots[k + 1], knots[k + 2]);
                        out[grid.at(c, k) + j * grid.cx() + i] = (x * y * z) as f32;
                    }
                }
            }
        }
        out
    }

    #[test]
    fn quadratic_fields_cross_unchanged_between_grids_that_are_not_nested() {
        let size = [20.0, 16.0, 4.0];
        let coarse = Grid::new(size, 1.2, 0.8, 1.25);
        let fine = Grid::new(size, 0.42, 0.8, 1.25);
        let carried = Bridge::new(&coarse, &fine).carry(&field(&coarse));
        for (a, b) in carried.iter().zip(field(&fine)) {
            assert!((a - b).abs() < 1e-4 * b.abs().max(1.0), "{a} instead of {b}");
        }
    }
}
