//! The same method written a second time, plainly: double precision, a dense grid, no blocks, no batches,
//! the rotation by an explicit polar decomposition. It is the oracle for the fast kernels.

use super::super::scheme::Scheme;
use crate::elastomer::Law;
use glam::{DMat3, DVec3};
use std::collections::HashMap;

/// One particle, in mm and s.
#[derive(Debug, Clone)]
pub struct Point {
    pub x: DVec3,
    pub v: DVec3,
    pub c: DMat3,
    pub f: DMat3,
    pub held: bool,
}

/// The rotation of F by Newton's iteration on the polar decomposition.
fn rotation(f: DMat3) -> DMat3 {
    let mut r = f;
    for _ in 0..40 {
        r = (r + r.inverse().transpose()) * 0.5;
    }
    r
}

fn first_piola(law: Law, f: DMat3, mu: f64, lambda: f64) -> DMat3 {
    let inverse_transposed = f.inverse().transpose();
    let j = f.determinant();
    match law {
        Law::FixedCorotated => (f - rotation(f)) * (2.0 * mu) + inverse_transposed * (lambda * (j - 1.0) * j),
        Law::NeoHookean => (f - inverse_transposed) * mu + inverse_transposed * (lambda * j.ln()),
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The 27 nodes of a point with weight and distance.
fn stencil(x: DVec3, origin: DVec3, dx: f64) -> Vec<([i32; 3], f64, DVec3)> {
    let at = (x - origin) / dx;
    let base = (at - 0.5).floor();
    let f = at - base;
    let w = |f: f64| [0.5 * (1.5 - f).powi(2), 0.75 - (f - 1.0).powi(2), 0.5 * (f - 0.5).powi(2)];
    let (wx, wy, wz) = (w(f.x), w(f.y), w(f.z));
    let mut out = Vec::with_capacity(27);
    for k in 0..3 {
        for j in 0..3 {
            for i in 0..3 {
                let step = DVec3::new(i as f64, j as f64, k as f64);
                let node = (base + step).as_ivec3().to_array();
                out.push((node, wx[i] * wy[j] * wz[k], (step - f) * dx));
            }
        }
    }
    out
}

/// One step of `mpm`: pad particles and indenter points (position and velocity).
pub fn step(scheme: &Scheme, origin: DVec3, points: &mut [Point], indenter: &[(DVec3, DVec3)]) {
    let (dx, dt) = (scheme.dx_mm, scheme.dt_s);
    let mass = scheme.particle_mass_g();
    let volume = mass / scheme.density;
    let mut grid: HashMap<[i32; 3], (f64, DVec3)> = HashMap::new();
    for p in points.iter() {
        let stress =
            first_piola(scheme.law, p.f, scheme.moduli_pa.mu, scheme.moduli_pa.lambda) * p.f.transpose();
        let affine = p.c * mass - stress * (dt * 4.0 / (dx * dx) * volume);
        for (node, w, d) in stencil(p.x, origin, dx) {
            let cell = grid.entry(node).or_default();
            cell.0 += w * mass;
            cell.1 += (p.v * mass + affine * d) * w;
        }
    }
    for (x, v) in indenter {
        for (node, w, _) in stencil(*x, origin, dx) {
            let cell = grid.entry(node).or_default();
            cell.0 += w * mass;
            cell.1 += *v * (w * mass);
        }
    }
    for p in points.iter_mut() {
        let (mut v, mut b) = (DVec3::ZERO, DMat3::ZERO);
        for (node, w, d) in stencil(p.x, origin, dx) {
            let (m, momentum) = grid[&node];
            if m > 0.0 {
                v += momentum / m * w;
                b += outer(momentum / m * w, d);
            }
        }
        (p.v, p.c) = if p.held { (DVec3::ZERO, DMat3::ZERO) } else { (v, b * (4.0 / (dx * dx))) };
        p.x += p.v * dt;
        p.f += p.c * p.f * dt;
    }
}
