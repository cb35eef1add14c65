//! The orders with which the solver converges, against closed forms and finite elements.

use super::truth::against_finite_elements;
use super::*;
use crate::elastomer::quasi_static::compliance::of_layer;

/// Least squares slope of the logarithms of errors over those of cell sizes.
fn order(cells_mm: &[f64], errors: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().map(|x| x.ln()).sum::<f64>() / v.len() as f64;
    let (h, e) = (mean(cells_mm), mean(errors));
    let (mut cross, mut square) = (0.0, 0.0);
    for (cell_mm, error) in cells_mm.iter().zip(errors) {
        cross += (cell_mm.ln() - h) * (error.ln() - e);
        square += (cell_mm.ln() - h).powi(2);
    }
    cross / square
}

/// By how much waves of pressure of 0.7 to 1.6 radians a mm along both axes, or nearly so, move the face further or less than they do
/// the exact bonded layer's, root mean square, over cells as high as wide, 16 or more of them along the sides. (Of a single wave the error
/// may change its sign from cells to cells.)
fn off_exact_layer(poisson_ratio: f64, side_mm: f64, cell_mm: f64) -> f64 {
    let size = [side_mm, side_mm, 4.0];
    let material = Material { poisson_ratio, ..pad(Law::NeoHookean).material };
    let grid = Grid::new(size, cell_mm, 1.0, 1.0);
    assert!((grid.hx - cell_mm).abs() < 1e-9 && grid.hz.iter().all(|h| (h - cell_mm).abs() < 1e-9));
    let layer = RestLayer::new(&grid, &Stack::coated(&grid, &material, None));
    let period = grid.cx() as f64 * grid.hx;
    let responses = &layer.face_modes(2)[2];
    let off = |k: f64| {
        let half_waves = (k * period / std::f64::consts::PI).round();
        let k = std::f64::consts::PI * half_waves / period;
        let response = f64::from(responses[(half_waves as usize - 1) * (grid.cx() + 1)]);
        // What of a wave its splines carry, each way and along each axis.
        let carried = ((0.5 * k * grid.hx).sin() / (0.5 * k * grid.hx)).powi(3);
        let found = response * grid.hx * grid.hy * carried.powi(4);
        found / of_layer(k * 2f64.sqrt(), material.youngs_modulus_mpa, poisson_ratio, size[2], -1.0) - 1.0
    };
    let squares = [0.7, 1.0, 1.3, 1.6].map(|k| off(k).powi(2));
    (squares.iter().sum::<f64>() / 4.0).sqrt()
}

#[test]
fn a_linear_layer_converges_with_the_order_of_its_splines_or_of_its_volumes() {
    // Compliance is an energy: splines of degree p = 2 give it with order 2 p. Where volume is a mean over each cell, lest the pad lock,
    // which it is where lambda is above four times mu, pressure jumps from cell to cell, and the order is 2.
    for (poisson_ratio, side_mm, cells_mm, orders, least) in
        [(0.3, 16.0, [1.0, 0.5, 1.0 / 3.0], 3.5..7.0, 1e-3), (0.45, 8.0, [0.5, 0.25, 0.125], 1.7..2.5, 2e-3)]
    {
        let errors = cells_mm.map(|cell_mm| off_exact_layer(poisson_ratio, side_mm, cell_mm));
        let order = order(&cells_mm, &errors);
        assert!(orders.contains(&order), "nu {poisson_ratio}: order {order}, {errors:?}");
        assert!(errors[2] < least, "nu {poisson_ratio}: {errors:?}");
    }
}

#[test]
fn a_pressed_face_converges_with_the_order_that_an_unknown_contact_edge_leaves() {
    let cells_mm = [1.25, 0.625, 20.0 / 48.0, 0.312_5];
    let errors_um = cells_mm.map(|cell_mm| {
        let usual = Resolution::for_tolerance(0.01);
        let resolution = Resolution { cell_mm, residual: 1e-4, penetration: 2e-4, ..usual };
        let free = settings(Friction::Coefficient(0.0));
        let start = Pose::new(0.0, 0.0, 0.5, 0.0);
        let pad = pad(Law::FixedCorotated);
        let sphere = Arc::new(Sphere(4.0));
        let mut s = QuasiStaticSolver::with_resolution(&pad, &free, resolution, sphere, &start).unwrap();
        s.advance(&Pose::new(0.0, 0.0, -0.25, 0.0)).expect("an easy press");
        against_finite_elements(&s).0
    });
    let order = order(&cells_mm, &errors_um);
    assert!(order > 1.5, "order {order}: {errors_um:?} um");
}
