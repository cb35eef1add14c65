//! The elastic operator, its tangent, and the layer that inverts it at rest.

use super::*;

/// Control values of the displacement u_z = stretch (z + t), u_x = shear (z + t).
fn homogeneous(grid: &Grid, stretch: f64, shear: f64) -> Vec<f32> {
    let mut knots = vec![0.0; 3];
    for h in &grid.hz {
        knots.push(knots[knots.len() - 1] + h);
    }
    let end = knots[knots.len() - 1];
    knots.extend([end, end]);
    let mut u = vec![0.0; grid.field_len()];
    for k in 0..grid.layers() {
        let z = 0.5 * (knots[k + 1] + knots[k + 2]);
        u[grid.at(2, k)..][..grid.plane()].fill((stretch * z) as f32);
        u[grid.at(0, k)..][..grid.plane()].fill((shear * z) as f32);
    }
    u
}

/// Force of the pad on its base, per area, for a homogeneous deformation.
fn base_traction(law: Law, stretch: f64, shear: f64) -> [f64; 2] {
    let material = pad(law).material;
    let grid = Grid::new([8.0, 8.0, 4.0], 0.5, 0.8, 1.25);
    let u = homogeneous(&grid, stretch, shear);
    let operator = Operator::new(grid.clone(), law, &Stack::coated(&grid, &material, None), None);
    let mut force = vec![0.0; grid.field_len()];
    operator.evaluate(&u, &mut force, &mut operator::Tangent::default());
    let sum = |c: usize| -> f64 {
        force[grid.at(c, 0)..][..grid.plane()].iter().map(|v| f64::from(*v)).sum::<f64>() / -64.0
    };
    [sum(0), sum(2)]
}

#[test]
fn patch_tests_are_exact_for_both_laws() {
    let m = pad(Law::NeoHookean).material;
    let (mu, lambda) = (m.mu_mpa(), m.lambda_mpa());
    for l in [0.7f64, 0.95, 1.3] {
        let [_, corotated] = base_traction(Law::FixedCorotated, l - 1.0, 0.0);
        assert!((corotated - (2.0 * mu + lambda) * (l - 1.0)).abs() < 1e-5, "l {l}: {corotated}");
        let [_, neo] = base_traction(Law::NeoHookean, l - 1.0, 0.0);
        assert!((neo - (mu * (l - 1.0 / l) + lambda * l.ln() / l)).abs() < 1e-5, "l {l}: {neo}");
    }
    let [neo, _] = base_traction(Law::NeoHookean, 0.0, 0.25);
    assert!((neo - mu * 0.25).abs() < 1e-5, "{neo}");
    // Simple shear of 0.25 under the fixed-corotated law: 0.0125965 MPa (analytic tables).
    let [corotated, _] = base_traction(Law::FixedCorotated, 0.0, 0.25);
    assert!((corotated - 0.012_596_5).abs() < 1e-5, "{corotated}");
}

/// A smooth field with no symmetry, zero at the base and within `margin` control points of the sides.
pub(super) fn wavy(grid: &Grid, size: f32, margin: usize) -> Vec<f32> {
    let mut u = vec![0.0; grid.field_len()];
    for c in 0..3 {
        for k in 1..grid.layers() {
            for j in margin..grid.cy() - margin {
                for i in margin..grid.cx() - margin {
                    let phase = 0.7 * i as f32 + 1.1 * j as f32 * (1.0 + c as f32) + 0.4 * k as f32;
                    u[grid.at(c, k) + j * grid.cx() + i] = size * phase.sin();
                }
            }
        }
    }
    u
}

/// Squares of what a tangent is off the central difference of forces `eps` to both sides, over its own; the bonded
/// layer does not count.
pub(super) fn off_difference(grid: &Grid, forces: &[Vec<f32>; 2], eps: f32, along: &[f32]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for i in (0..grid.field_len()).filter(|i| !(i / grid.plane()).is_multiple_of(grid.layers())) {
        let difference = (forces[1][i] - forces[0][i]) / (2.0 * eps);
        error += f64::from(difference - along[i]).powi(2);
        norm += f64::from(along[i]).powi(2);
    }
    error / norm
}

#[test]
fn the_tangent_is_the_derivative_of_the_forces_and_symmetric() {
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        let grid = Grid::new([8.0, 8.0, 4.0], 0.5, 0.8, 1.25);
        let operator = Operator::new(grid.clone(), law, &Stack::uniform(&grid, 0.05, 0.45), None);
        let n = grid.field_len();
        let (u, d) = (wavy(&grid, 0.1, 0), wavy(&grid, 1.0, 3));
        let mut tangent = operator::Tangent::default();
        let mut forces = [vec![0.0; n], vec![0.0; n]];
        let eps = 1e-3;
        for (f, sign) in forces.iter_mut().zip([-eps, eps]) {
            let moved: Vec<f32> = u.iter().zip(&d).map(|(u, d)| u + sign * d).collect();
            operator.evaluate(&moved, f, &mut tangent);
        }
        let mut here = vec![0.0; n];
        operator.evaluate(&u, &mut here, &mut tangent);
        let mut along = vec![0.0; n];
        operator.apply(&tangent, &d, &mut along);
        let off = off_difference(&grid, &forces, eps, &along);
        assert!(off < 1e-5, "{law:?}: {}", off.sqrt());
        let e: Vec<f32> = wavy(&grid, 1.0, 1).iter().rev().copied().collect();
        let mut back = vec![0.0; n];
        operator.apply(&tangent, &e, &mut back);
        let mut masked = e.clone();
        for c in 0..3 {
            masked[grid.at(c, 0)..][..grid.plane()].fill(0.0);
        }
        operator.apply(&tangent, &masked, &mut back);
        let (a, b) = (fields::dot(&masked, &along), fields::dot(&d, &back));
        assert!((a - b).abs() < 1e-4 * fields::dot(&along, &along).sqrt() * fields::dot(&e, &e).sqrt());
    }
}

#[test]
fn the_rest_layer_inverts_the_operator_away_from_the_sides() {
    let grid = Grid::new([8.0, 8.0, 4.0], 0.5, 0.8, 1.25);
    let stack = Stack::uniform(&grid, 0.05, 0.45);
    let operator = Operator::new(grid.clone(), Law::FixedCorotated, &stack, None);
    let layer = RestLayer::new(&grid, &stack);
    let n = grid.field_len();
    let x = wavy(&grid, 1.0, 5);
    let (mut force, mut back) = (vec![0.0; n], vec![0.0; n]);
    let mut tangent = operator::Tangent::default();
    operator.evaluate(&vec![0.0; n], &mut force, &mut tangent);
    operator.apply(&tangent, &x, &mut force);
    let mut passage = Passage::default();
    layer.enter(&force, &mut passage);
    let mut face = vec![0.0; 3 * grid.plane()];
    layer.face(&passage, &mut face);
    layer.leave(&mut passage, None, &mut back);
    for (c, face) in face.chunks(grid.plane()).enumerate() {
        let known = &back[grid.at(c, grid.layers() - 1)..];
        assert!(
            face.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-4),
            "the face is known before the rest"
        );
    }
    let error = x.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(error < 1e-3, "{error}");
}
