//! Stress and tangent of the two laws, several cells at a time.
//!
//! Volumetric terms use the mean of J over a cell's eight points (mean dilatation: Nagtegaal, Parks and
//! Rice 1974; Simo, Taylor and Pister 1985): one volumetric constraint per cell, so that nearly
//! incompressible pads do not lock, and still a potential. With J' the mean of J and C = cof F:
//!
//! - fixed-corotated: W = mu |F - R|^2 + lambda/2 (J' - 1)^2, P = 2 mu (F - R) + lambda (J' - 1) C;
//! - neo-Hookean: W = mu/2 (|F|^2 - 3) - mu ln J + lambda/2 (ln J')^2, P = mu (F - C/J) + lambda ln J'/J' C.
//!
//! Volume uneven within a cell would cost next to nothing, and cells under a sharp edge collapse that way; so it
//! costs kappa/2 (J - J')^2, kappa a few mu: nothing in a homogeneous deformation, and no locking.
//!
//! The fixed-corotated pressure saturates in compression, so its points could turn inside out at a sharp
//! edge. A barrier b(J) = lambda (J0 - J)^3 / J below J0 = 0.25 prevents that; above, it is exactly zero.
//!
//! The derivative of the cofactor is the tensor cross product F x dF (Bonet, Gil and Ortigosa 2015), that
//! of the rotation follows from K = (tr V I - V)^-1 with V the left stretch.

use super::lanes::Lanes;

/// A 3 x 3 matrix, `m[row][column]`.
pub type Mat<L> = [[L; 3]; 3];

/// Numbers stored per point for the fixed-corotated tangent: F, R and the six of K.
pub const COROTATED_FIELDS: usize = 24;
/// Numbers stored per point for the neo-Hookean tangent: F.
pub const NEO_HOOKEAN_FIELDS: usize = 9;

/// Volume ratio below which the barrier of the fixed-corotated law acts.
pub const BARRIER_BEGINS: f32 = 0.25;

const NEXT: [usize; 3] = [1, 2, 0];
const AFTER: [usize; 3] = [2, 0, 1];

/// Cofactor matrix.
#[inline(always)]
pub fn cofactor<L: Lanes>(f: &Mat<L>) -> Mat<L> {
    let mut out = *f;
    for i in 0..3 {
        let (p, q) = (NEXT[i], AFTER[i]);
        for j in 0..3 {
            let (r, s) = (NEXT[j], AFTER[j]);
            out[i][j] = f[p][s].fnma(f[q][r], f[p][r].mul(f[q][s]));
        }
    }
    out
}

/// Derivative of the cofactor of `f` along `d`.
#[inline(always)]
pub fn cofactor_change<L: Lanes>(f: &Mat<L>, d: &Mat<L>) -> Mat<L> {
    let mut out = *f;
    for i in 0..3 {
        let (p, q) = (NEXT[i], AFTER[i]);
        for j in 0..3 {
            let (r, s) = (NEXT[j], AFTER[j]);
            let plus = d[p][r].fma(f[q][s], f[p][r].mul(d[q][s]));
            out[i][j] = d[p][s].fnma(f[q][r], f[p][s].fnma(d[q][r], plus));
        }
    }
    out
}

/// Sum of products, element by element.
#[inline(always)]
pub fn inner<L: Lanes>(a: &Mat<L>, b: &Mat<L>) -> L {
    let mut sum = a[0][0].mul(b[0][0]);
    for i in 0..3 {
        for j in 0..3 {
            if i + j > 0 {
                sum = a[i][j].fma(b[i][j], sum);
            }
        }
    }
    sum
}

/// det(I + h) - 1 without cancellation.
#[inline(always)]
pub fn volume_change<L: Lanes>(h: &Mat<L>) -> L {
    let c = cofactor(h);
    let det = h[0][0].fma(c[0][0], h[0][1].fma(c[0][1], h[0][2].mul(c[0][2])));
    let minors = c[0][0].add(c[1][1]).add(c[2][2]);
    let trace = h[0][0].add(h[1][1]).add(h[2][2]);
    trace.add(minors).add(det)
}

/// The barrier at volume ratio `j`, in units of lambda: energy, slope and curvature.
#[inline(always)]
pub fn barrier<L: Lanes>(j: L) -> [L; 3] {
    let t = L::splat(BARRIER_BEGINS).sub(j).max(L::splat(0.0));
    let inv = L::splat(1.0).div(j.max(L::splat(1e-6)));
    let q = t.mul(inv);
    let two = L::splat(2.0);
    let energy = t.mul(t).mul(q);
    // -(3 t^2/J + t^3/J^2) and 6 t/J + 6 t^2/J^2 + 2 t^3/J^3.
    let slope = L::splat(0.0).sub(t.mul(q).mul(q.add(L::splat(3.0))));
    let curvature = two.mul(q).mul(q.mul(q).add(L::splat(3.0).mul(q)).add(L::splat(3.0)));
    [energy, slope, curvature]
}

/// I + h.
#[inline(always)]
pub fn plus_identity<L: Lanes>(h: &Mat<L>) -> Mat<L> {
    let one = L::splat(1.0);
    let mut f = *h;
    for i in 0..3 {
        f[i][i] = f[i][i].add(one);
    }
    f
}

/// Rotation of the polar decomposition by Newton's iteration R <- (R + R^-T)/2 (Higham 1986), which
/// converges quadratically; seven steps serve stretches from 0.05 to 20.
#[inline(always)]
pub fn rotation<L: Lanes>(f: &Mat<L>) -> Mat<L> {
    let half = L::splat(0.5);
    let mut r = *f;
    for step in 0..7 {
        let c = cofactor(&r);
        let det = r[0][0].fma(c[0][0], r[0][1].fma(c[0][1], r[0][2].mul(c[0][2])));
        let scale = half.div(det);
        let mut moved = L::splat(0.0);
        for i in 0..3 {
            for j in 0..3 {
                let next = half.fma(r[i][j], scale.mul(c[i][j]));
                let change = next.sub(r[i][j]);
                moved = moved.max(change.mul(change));
                r[i][j] = next;
            }
        }
        // The step squares its error: a change below 3e-4 leaves less than 1e-7.
        if step >= 1 && moved.to_array()[..L::COUNT].iter().all(|m| *m < 1e-7) {
            break;
        }
    }
    r
}

/// Element (i, j) of A B^T.
#[inline(always)]
fn of_rows<L: Lanes>(a: &Mat<L>, b: &Mat<L>, i: usize, j: usize) -> L {
    a[i][0].fma(b[j][0], a[i][1].fma(b[j][1], a[i][2].mul(b[j][2])))
}

/// K = (tr V I - V)^-1 with V = F R^T, as (xx, yy, zz, xy, xz, yz).
#[inline(always)]
pub fn spin_stiffness_inverse<L: Lanes>(f: &Mat<L>, r: &Mat<L>) -> [L; 6] {
    let (vx, vy, vz) = (of_rows(f, r, 0, 0), of_rows(f, r, 1, 1), of_rows(f, r, 2, 2));
    let zero = L::splat(0.0);
    let (a, b, c) = (vy.add(vz), vx.add(vz), vx.add(vy));
    let (xy, xz, yz) = (of_rows(f, r, 0, 1), of_rows(f, r, 0, 2), of_rows(f, r, 1, 2));
    let (d, e, g) = (zero.sub(xy), zero.sub(xz), zero.sub(yz));
    // Adjugate of the symmetric matrix [a d e; d b g; e g c] over its determinant.
    let xx = g.fnma(g, b.mul(c));
    let xy = d.fnma(c, e.mul(g));
    let xz = e.fnma(b, d.mul(g));
    let det = a.fma(xx, d.fma(xy, e.mul(xz)));
    let inv = L::splat(1.0).div(det);
    let yy = e.fnma(e, a.mul(c));
    let zz = d.fnma(d, a.mul(b));
    let yz = a.fnma(g, d.mul(e));
    [xx.mul(inv), yy.mul(inv), zz.mul(inv), xy.mul(inv), xz.mul(inv), yz.mul(inv)]
}

/// Change of the rotation along `d`: dR = [omega]x R, omega = K axl(dF R^T - R dF^T).
#[inline(always)]
pub fn rotation_change<L: Lanes>(r: &Mat<L>, k: &[L; 6], d: &Mat<L>) -> Mat<L> {
    let ax = of_rows(d, r, 2, 1).sub(of_rows(d, r, 1, 2));
    let ay = of_rows(d, r, 0, 2).sub(of_rows(d, r, 2, 0));
    let az = of_rows(d, r, 1, 0).sub(of_rows(d, r, 0, 1));
    let wx = k[0].fma(ax, k[3].fma(ay, k[4].mul(az)));
    let wy = k[3].fma(ax, k[1].fma(ay, k[5].mul(az)));
    let wz = k[4].fma(ax, k[5].fma(ay, k[2].mul(az)));
    let mut out = *r;
    for j in 0..3 {
        out[0][j] = wz.fnma(r[1][j], wy.mul(r[2][j]));
        out[1][j] = wx.fnma(r[2][j], wz.mul(r[0][j]));
        out[2][j] = wy.fnma(r[0][j], wx.mul(r[1][j]));
    }
    out
}
