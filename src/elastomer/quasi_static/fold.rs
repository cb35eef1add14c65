//! Folds: where the face, seen from above, lies over itself.
//!
//! A wall that is dragged through a soft pad piles up what is before it until that leans over. Such a face may be an equilibrium,
//! but it is none that heights over a lattice can tell, nor one that a camera behind it would see.

use super::grid::{Grid, uniform_values};

/// Places in a cell along one side. (Slopes run straight between the edges of cells and are steepest there: of two places a fold of half a
/// cell may show in none.)
const PLACES: usize = 4;

/// Which part of the face has been turned over.
pub fn part(grid: &Grid, u: &[f32]) -> f64 {
    let (cx, top) = (grid.cx(), grid.layers() - 1);
    let [x, y] = [0, 1].map(|axis| &u[grid.at(axis, top)..][..grid.plane()]);
    let places: [f64; PLACES] = std::array::from_fn(|n| (n as f64 + 0.5) / PLACES as f64);
    let slopes = |t: f64, h: f64| [(t - 1.0) / h, (1.0 - 2.0 * t) / h, t / h];
    let tables = |h: f64| places.map(|t| (uniform_values(t), slopes(t, h)));
    let (across, along) = (tables(grid.hx), tables(grid.hy));
    let mut turned = 0usize;
    for (i, j) in (0..grid.ny).flat_map(|j| (0..grid.nx).map(move |i| (i, j))) {
        for ((wx, sx), (wy, sy)) in across.iter().flat_map(|a| along.iter().map(move |b| (a, b))) {
            let of = |plane: &[f32], a: &[f64; 3], b: &[f64; 3]| {
                let at = |m: usize, n: usize| f64::from(plane[(j + n) * cx + i + m]);
                (0..3).map(|n| b[n] * (0..3).map(|m| a[m] * at(m, n)).sum::<f64>()).sum::<f64>()
            };
            let [xx, xy] = [1.0 + of(x, sx, wy), of(x, wx, sy)];
            let [yx, yy] = [of(y, sx, wy), 1.0 + of(y, wx, sy)];
            turned += usize::from(xx * yy - xy * yx <= 0.0);
        }
    }
    turned as f64 / (grid.nx * grid.ny * PLACES * PLACES) as f64
}

#[cfg(test)]
mod tests {
    use super::super::tests::{pad, settings};
    use super::super::{Body, Resolution};
    use super::*;
    use crate::elastomer::{Friction, Law};
    use crate::pose::Pose;

    #[test]
    fn what_is_pulled_over_its_neighbour_is_counted_and_what_is_stretched_is_not() {
        let body = Body::new(&pad(Law::NeoHookean), &settings(Friction::Infinite));
        let level = body.level(&Resolution::for_tolerance(0.02), Pose::new(0.0, 0.0, 1.0, 0.0), false);
        let grid = level.grid();
        let (cx, top, h) = (grid.cx(), grid.layers() - 1, grid.hx as f32);
        let mut u = vec![0.0f32; grid.at(2, top) + grid.plane()];
        assert_eq!(part(grid, &u), 0.0);
        // Columns from the middle on move left: as far as a cell leaves them in order, three cells do not.
        let mut shifted = |by: f32| {
            for (n, x) in u[grid.at(0, top)..][..grid.plane()].iter_mut().enumerate() {
                *x = if n % cx > cx / 2 { -by } else { by };
            }
            part(grid, &u)
        };
        assert_eq!(shifted(-2.0 * h), 0.0);
        let turned = shifted(1.5 * h);
        // (Two thirds of each of the two cells that the jump bends, in which three of four places lie.)
        assert!((turned * grid.nx as f64 - 1.5).abs() < 0.1, "{turned}");
    }
}
