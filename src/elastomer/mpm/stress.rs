//! Kirchhoff stress from the displacement gradient, without a singular value decomposition.
//!
//! The state is H = F - I, not F, so that small strains keep all their digits in single precision.
//! With b = F F^T = I + B, B = H + H^T + H H^T, both laws need only symmetric matrices:
//!
//! - neo-Hookean: tau = P F^T = mu B + lambda ln J I;
//! - fixed corotated: tau = 2 mu (F - R) F^T + lambda J (J - 1) I, and R F^T = sqrt(b) = V, the left
//!   stretch, so tau = 2 mu (B - U) + lambda J (J - 1) I with U = V - I.
//!
//! V follows from its invariants i1, i2, i3 = J by Cayley-Hamilton (Hoger and Carlson 1984):
//! V = (i1 i3 I + (i1^2 - i2) b - b^2) / (i1 i2 - i3). The first invariant is the largest root of
//! (i1^2 - I_b)^2 = 4 II_b + 8 J i1, reached by Newton's method from above, where the function is convex:
//! i1 <= sqrt(3 I_b). All is written in the departures e1 = i1 - 3, e2 = i2 - 3, e3 = J - 1, which
//! are small where the strain is, so nothing cancels.

use super::lanes::{Kernel, Lanes, Number, Row};
use super::particles::Bin;
use crate::elastomer::Law;

/// A symmetric matrix: xx, yy, zz, xy, yz, zx.
pub type Symmetric<T> = [T; 6];

/// Lame parameters in the solver's units.
#[derive(Debug, Clone, Copy)]
pub struct Moduli<T> {
    /// Shear modulus.
    pub mu: T,
    /// First Lame parameter.
    pub lambda: T,
}

/// Most Newton steps for the first invariant; from any strain with J > 0 fewer are needed.
const NEWTON_LIMIT: usize = 12;

/// B = F F^T - I and J - 1 for H = F - I, row by row (`h[3 * row + column]`).
#[inline(always)]
pub fn left_strain<T: Number>(h: &[T; 9]) -> (Symmetric<T>, T) {
    let b = [
        h[0] + h[0] + dot(h, 0, 0),
        h[4] + h[4] + dot(h, 1, 1),
        h[8] + h[8] + dot(h, 2, 2),
        h[1] + h[3] + dot(h, 0, 1),
        h[5] + h[7] + dot(h, 1, 2),
        h[6] + h[2] + dot(h, 2, 0),
    ];
    // det(I + H) - 1 = tr H + sum of principal minors + det H.
    let minor_x = h[4] * h[8] - h[5] * h[7];
    let minor_y = h[8] * h[0] - h[6] * h[2];
    let minor_z = h[0] * h[4] - h[1] * h[3];
    let det =
        h[0].mul_add(minor_x, h[1].mul_add(h[5] * h[6] - h[3] * h[8], h[2] * (h[3] * h[7] - h[4] * h[6])));
    let e3 = (h[0] + h[4] + h[8]) + ((minor_x + minor_y + minor_z) + det);
    (b, e3)
}

/// e2 from i1^2 = I_b + 2 i2.
#[inline(always)]
fn second_from_first<T: Number>(e1: T, trace: T) -> T {
    T::splat(0.5) * ((T::splat(6.0) + e1).mul_add(e1, -trace))
}

/// Row `i` of H times row `j`.
// Functions, not closures, wherever kernels call more than once: see [`super::spline::weights`].
#[inline(always)]
fn dot<T: Number>(h: &[T; 9], i: usize, j: usize) -> T {
    h[3 * i].mul_add(h[3 * j], h[3 * i + 1].mul_add(h[3 * j + 1], h[3 * i + 2] * h[3 * j + 2]))
}

/// The departures e1 and e2 of the stretch's invariants from 3.
#[inline(always)]
fn stretch_invariants<T: Number>(b: &Symmetric<T>, e3: T) -> (T, T) {
    let trace = b[0] + b[1] + b[2];
    let second = b[0].mul_add(b[1], b[1].mul_add(b[2], b[2] * b[0]))
        - b[3].mul_add(b[3], b[4].mul_add(b[4], b[5] * b[5]));
    // II_b + 2 J i1 = i2^2 and i1^2 = I_b + 2 i2, both less their values at rest.
    let constant = trace + trace + second + T::splat(6.0) * e3;
    let slope = T::splat(2.0) + (e3 + e3);
    let start = T::splat(9.0) + T::splat(3.0) * trace;
    let mut e1 = (T::splat(3.0) * trace).over(start.larger(T::splat(0.0)).root() + T::splat(3.0));
    for _ in 0..NEWTON_LIMIT {
        let e2 = second_from_first(e1, trace);
        let value = (T::splat(6.0) + e2).mul_add(e2, -constant) - slope * e1;
        let derivative = (T::splat(6.0) + (e2 + e2)) * (T::splat(3.0) + e1) - slope;
        let step = value.over(derivative);
        e1 = e1 - step;
        if (step * step).all_below(T::splat(T::SQUARED_STEP)) {
            break;
        }
    }
    (e1, second_from_first(e1, trace))
}

/// ln(1 + e) for e > -1, exact for small e.
#[inline(always)]
fn log1p<T: Number>(e: T) -> T {
    // One halving, ln(1 + e) = 2 ln sqrt(1 + e), then ln(1 + d) = 2 atanh(d / (2 + d)) by its series,
    // which is exact to 1e-8 for J from 0.1 to 10.
    let d = e.over((T::splat(1.0) + e).larger(T::splat(0.0)).root() + T::splat(1.0));
    let s = d.over(T::splat(2.0) + d);
    let s2 = s * s;
    let mut sum = T::splat(1.0 / 23.0);
    for k in (0..11).rev() {
        sum = sum.mul_add(s2, T::splat(1.0 / (2.0 * f64::from(k) + 1.0)));
    }
    T::splat(4.0) * s * sum
}

/// Kirchhoff stress tau = J sigma = P F^T, and J, for H = F - I.
#[inline(always)]
pub fn kirchhoff<T: Number>(law: Law, h: &[T; 9], moduli: Moduli<T>) -> (Symmetric<T>, T) {
    let (b, e3) = left_strain(h);
    let j = T::splat(1.0) + e3;
    let tau = match law {
        Law::NeoHookean => {
            let p = moduli.lambda * log1p(e3);
            let mut tau = [p; 6];
            for k in 0..3 {
                tau[k] = moduli.mu.mul_add(b[k], p);
                tau[3 + k] = moduli.mu * b[3 + k];
            }
            tau
        }
        Law::FixedCorotated => {
            let (e1, e2) = stretch_invariants(&b, e3);
            // U K = (4 + e1)(e1 - e2 + e3) I + (4 + 6 e1 + e1^2 - e2) B - B^2, K = i1 i2 - i3.
            let k = T::splat(8.0) + T::splat(3.0) * (e1 + e2) + e1.mul_add(e2, -e3);
            let per_k = T::splat(1.0).over(k);
            let u0 = (T::splat(4.0) + e1) * (e1 - e2 + e3) * per_k;
            let u1 = (T::splat(4.0) + (T::splat(6.0) + e1).mul_add(e1, -e2)) * per_k;
            let two_mu = moduli.mu + moduli.mu;
            let (on_b, on_b2) = (two_mu * (T::splat(1.0) - u1), two_mu * per_k);
            let p = moduli.lambda * j * e3 - two_mu * u0;
            let [xx, yy, zz, xy, yz, zx] = b;
            let square = [
                xx.mul_add(xx, xy.mul_add(xy, zx * zx)),
                xy.mul_add(xy, yy.mul_add(yy, yz * yz)),
                zx.mul_add(zx, yz.mul_add(yz, zz * zz)),
                xx.mul_add(xy, xy.mul_add(yy, zx * yz)),
                xy.mul_add(zx, yy.mul_add(yz, yz * zz)),
                zx.mul_add(xx, yz.mul_add(xy, zz * zx)),
            ];
            let mut tau = [p; 6];
            for k in 0..6 {
                tau[k] = on_b.mul_add(b[k], on_b2 * square[k]);
            }
            for k in 0..3 {
                tau[k] = tau[k] + p;
            }
            tau
        }
    };
    (tau, j)
}

/// Stored energy per reference volume, for reports.
#[inline(always)]
pub fn energy_density<T: Number>(law: Law, h: &[T; 9], moduli: Moduli<T>) -> T {
    let (b, e3) = left_strain(h);
    let trace = b[0] + b[1] + b[2];
    let half = T::splat(0.5);
    match law {
        Law::NeoHookean => {
            let ln_j = log1p(e3);
            moduli.mu * (half * trace - ln_j) + half * moduli.lambda * ln_j * ln_j
        }
        // |F - R|^2 = tr b - 2 i1 + 3.
        Law::FixedCorotated => {
            let (e1, _) = stretch_invariants(&b, e3);
            moduli.mu * (trace - (e1 + e1)) + half * moduli.lambda * e3 * e3
        }
    }
}

/// Sums the stored energies of a block's particles, per particle volume.
pub struct Stored<'a> {
    /// The block's particles.
    pub bin: &'a Bin,
    /// Constitutive law.
    pub law: Law,
    /// Lame parameters.
    pub moduli: Moduli<f64>,
}

impl Kernel for Stored<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f64 {
        let moduli = Moduli { mu: L::splat(self.moduli.mu), lambda: L::splat(self.moduli.lambda) };
        let (zero, mut total) = (L::splat(0.0), 0.0);
        for batch in &self.bin.batches {
            let mut h = [zero; 9];
            for k in 0..9 {
                h[k] = L::load(&batch.strain[k]);
            }
            let mut row = Row::ZERO;
            // Differences of nearly equal numbers: the smallest may come out negative.
            energy_density(self.law, &h, moduli).larger(zero).keep(batch.used()).store(&mut row);
            total += row.0.iter().map(|&e| f64::from(e)).sum::<f64>();
        }
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const A: Moduli<f64> = Moduli { mu: 0.05, lambda: 0.45 };
    const B: Moduli<f64> = Moduli { mu: 0.15 / 2.8, lambda: 0.15 * 0.4 / (1.4 * 0.2) };

    /// material, law, stretch l, axial P and lateral Cauchy stress (MPa): `analytic/patch_tests.csv`.
    #[allow(clippy::type_complexity)]
    const UNIAXIAL: &[(Moduli<f64>, Law, f64, f64, f64)] = &[
        (A, Law::FixedCorotated, 0.7, -0.165, -0.135),
        (A, Law::FixedCorotated, 0.95, -0.0275, -0.0225),
        (A, Law::FixedCorotated, 1.3, 0.165, 0.135),
        (A, Law::NeoHookean, 0.7, -0.26571961, -0.22929104),
        (A, Law::NeoHookean, 0.95, -0.029428403, -0.024296824),
        (A, Law::NeoHookean, 1.3, 0.11735686, 0.090818399),
        (B, Law::FixedCorotated, 0.8, -0.064285714, -0.042857143),
        (B, Law::FixedCorotated, 1.1, 0.032142857, 0.021428571),
        (B, Law::NeoHookean, 0.8, -0.083877737, -0.059770594),
        (B, Law::NeoHookean, 1.1, 0.028794191, 0.018566918),
    ];

    /// material, law, shear g, s13, s11, s33 (MPa): the same file.
    #[allow(clippy::type_complexity)]
    const SHEAR: &[(Moduli<f64>, Law, f64, f64, f64, f64)] = &[
        (A, Law::FixedCorotated, 0.05, 0.0025007809, 0.0001562744, 3.1235359e-05),
        (A, Law::FixedCorotated, 0.25, 0.012596527, 0.003921344, 0.00077221233),
        (A, Law::FixedCorotated, 1.0, 0.05527864, 0.065835921, 0.010557281),
        (B, Law::FixedCorotated, 0.5, 0.027585469, 0.016991752, 0.0031990178),
        (A, Law::NeoHookean, 0.5, 0.025, 0.0125, 0.0),
        (B, Law::NeoHookean, 0.25, 0.013392857, 0.0033482143, 0.0),
    ];

    #[test]
    fn uniaxial_strain_agrees_with_the_exact_table() {
        for &(m, law, l, axial, lateral) in UNIAXIAL {
            let h = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, l - 1.0];
            let (tau, j) = kirchhoff(law, &h, m);
            // Axial: P = tau / l; with two unstretched directions Cauchy = tau / J, J = l.
            assert!((tau[2] / l - axial).abs() < 5e-8 * axial.abs().max(0.1), "{law:?} {l}: {}", tau[2] / l);
            assert!(
                (tau[0] / j - lateral).abs() < 5e-8 * lateral.abs().max(0.1),
                "{law:?} {l}: {}",
                tau[0] / j
            );
            assert!(tau[3..].iter().all(|s| s.abs() < 1e-15));
        }
    }

    #[test]
    fn simple_shear_agrees_with_the_exact_table() {
        for &(m, law, g, s13, s11, s33) in SHEAR {
            let (tau, j) = kirchhoff(law, &[0.0, 0.0, g, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], m);
            assert!((j - 1.0).abs() < 1e-15);
            for (got, want) in [(tau[5], s13), (tau[0], s11), (tau[2], s33)] {
                assert!((got - want).abs() < 2e-10 + 6e-8 * want.abs(), "{law:?} g {g}: {got} {want}");
            }
        }
    }

    fn rotation(x: f64, y: f64, z: f64) -> glam::DMat3 {
        glam::DMat3::from_euler(glam::EulerRot::XYZ, x, y, z)
    }

    fn rows_less_identity(f: glam::DMat3) -> [f64; 9] {
        let h = f - glam::DMat3::IDENTITY;
        std::array::from_fn(|k| h.col(k % 3)[k / 3])
    }

    proptest! {
        #[test]
        fn a_rotation_carries_no_stress(x in -3.0..3.0f64, y in -1.5..1.5f64, z in -3.0..3.0f64) {
            let h = rows_less_identity(rotation(x, y, z));
            for law in [Law::FixedCorotated, Law::NeoHookean] {
                let (tau, _) = kirchhoff(law, &h, A);
                prop_assert!(tau.iter().all(|s| s.abs() < 1e-13));
                prop_assert!(energy_density(law, &h, A).abs() < 1e-13);
            }
        }

        /// The stretch found from invariants squares to b: tau against F - R by an explicit stretch.
        #[test]
        fn the_root_is_the_root(
            l in prop::array::uniform3(0.2..2.5f64),
            q in prop::array::uniform3(-3.0..3.0f64),
            r in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let (q, r) = (rotation(q[0], q[1], q[2]), rotation(r[0], r[1], r[2]));
            let stretch = |d: [f64; 3]| q * glam::DMat3::from_diagonal(glam::DVec3::from_array(d)) * q.transpose();
            let v = stretch(l);
            let f = v * r;
            let det = l[0] * l[1] * l[2];
            let expected = (v * v - v) * (2.0 * A.mu) + glam::DMat3::IDENTITY * (A.lambda * det * (det - 1.0));
            let (tau, j) = kirchhoff(Law::FixedCorotated, &rows_less_identity(f), A);
            prop_assert!((j - det).abs() < 1e-12 * (1.0 + det));
            let got = [tau[0], tau[1], tau[2], tau[3], tau[4], tau[5]];
            let want = [expected.x_axis.x, expected.y_axis.y, expected.z_axis.z,
                        expected.x_axis.y, expected.y_axis.z, expected.z_axis.x];
            for (g, w) in got.iter().zip(want) {
                prop_assert!((g - w).abs() < 1e-9, "{g} {w}");
            }
        }

        /// The stress is the derivative of the energy: d psi / dF : (dF) = tau : (dF F^-1).
        #[test]
        fn work_is_energy(a in prop::array::uniform9(-0.25..0.25f64), d in prop::array::uniform9(-1.0..1.0f64)) {
            for law in [Law::FixedCorotated, Law::NeoHookean] {
                let eps = 1e-6;
                let moved = |s: f64| -> [f64; 9] { std::array::from_fn(|k| a[k] + s * eps * d[k]) };
                let slope = (energy_density(law, &moved(1.0), A) - energy_density(law, &moved(-1.0), A)) / (2.0 * eps);
                let mat = |m: &[f64; 9]| glam::DMat3::from_cols_array(m).transpose();
                let f = mat(&a) + glam::DMat3::IDENTITY;
                let l = mat(&d) * f.inverse();
                let (t, _) = kirchhoff(law, &a, A);
                let tau = glam::DMat3::from_cols_array(&[t[0], t[3], t[5], t[3], t[1], t[4], t[5], t[4], t[2]]);
                let power: f64 = (0..3).map(|i| tau.col(i).dot(l.col(i))).sum();
                prop_assert!((power - slope).abs() < 1e-8 + 1e-6 * power.abs(), "{law:?} {power} {slope}");
            }
        }
    }
}
