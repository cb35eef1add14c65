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

/// By how much a wave of pressure of about `k` radians a mm along both axes moves the face further or less than it does the exact
/// bonded layer's, over cells as high as wide.
fn off_exact_layer(cell_mm: f64, k: f64) -> f64 {
    let (size, material) = ([16.0, 16.0, 4.0], pad(Law::NeoHookean).material);
    let grid = Grid::new(size, cell_mm, 1.0, 1.0);
    assert!((grid.hx - cell_mm).abs() < 1e-9 && grid.hz.iter().all(|h| (h - cell_mm).abs() < 1e-9));
    let layer = RestLayer::new(&grid, &Stack::coated(&grid, &material, None));
    let period = grid.cx() as f64 * grid.hx;
    let half_waves = (k * period / std::f64::consts::PI).round();
    let k = std::f64::consts::PI * half_waves / period;
    let place = (half_waves as usize - 1) * (grid.cx() + 1);
    let response = f64::from(layer.face_modes(2)[2][place]);
    // What of a wave its splines carry, each way and along each axis.
    let carried = ((0.5 * k * grid.hx).sin() / (0.5 * k * grid.hx)).powi(3);
    let found = response * grid.hx * grid.hy * carried.powi(4);
    let exact = of_layer(k * 2f64.sqrt(), material.youngs_modulus_mpa, material.poisson_ratio, size[2], -1.0);
    (found / exact - 1.0).abs()
}

#[test]
fn a_linear_layer_converges_with_the_fourth_power_of_its_cells() {
    // Compliance is an energy: splines of degree p = 2 give it with order 2 p.
    let cells_mm = [1.0, 0.5, 0.25];
    let errors = cells_mm.map(|cell_mm| off_exact_layer(cell_mm, 1.2));
    let order = order(&cells_mm, &errors);
    assert!((3.5..4.7).contains(&order), "order {order}: {errors:?}");
    assert!(errors[2] < 1e-4, "{errors:?}");
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
