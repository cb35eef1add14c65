//! The tangent at the points of a slab, applied to a change of displacement.

use super::super::lanes::{Kernel, Lanes};
use super::super::law::{
    COROTATED_FIELDS, Mat, NEO_HOOKEAN_FIELDS, barrier, cofactor, cofactor_change, inner, rotation_change,
};
use super::bend::Metric;
use super::sweep::{CellWork, Place, read_matrix, sweep};
use super::{CELL_FIELDS, Operator};
use crate::elastomer::Law;

pub(super) struct ApplySlab<'a> {
    pub(super) op: &'a Operator,
    pub(super) slab: (usize, usize),
    pub(super) d: &'a [f32],
    pub(super) out: &'a mut [f32],
    pub(super) data: &'a [f32],
}

impl Kernel for ApplySlab<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        match self.op.law {
            Law::FixedCorotated => {
                let mut work = ApplyCorotated { op: self.op, data: self.data };
                sweep::<L, _>(self.op, self.slab, self.d, self.out, &mut work);
            }
            Law::NeoHookean => {
                let mut work = ApplyNeoHookean { op: self.op, data: self.data };
                sweep::<L, _>(self.op, self.slab, self.d, self.out, &mut work);
            }
        }
    }
}

struct ApplyCorotated<'a> {
    op: &'a Operator,
    data: &'a [f32],
}

impl<L: Lanes> CellWork<L> for ApplyCorotated<'_> {
    #[inline(always)]
    fn cell(&mut self, grad: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>) {
        let data = &self.data[place.data..place.data + (CELL_FIELDS + 8 * COROTATED_FIELDS) * L::COUNT];
        let moduli = self.op.moduli[place.k];
        let two_mu = L::splat(2.0 * moduli.mu);
        let (pressure, slope) = (L::load(data), L::load(&data[L::COUNT..]));
        let even = L::splat(moduli.evenness);
        let mut change = L::splat(0.0);
        for (p, d) in grad.iter().enumerate() {
            let f = read_matrix::<L>(&data[(CELL_FIELDS + p * COROTATED_FIELDS) * L::COUNT..], L::COUNT);
            change = inner(&cofactor(&f), d).fma(metric.share[p], change);
        }
        let change = change.mul(slope.sub(even)).mul(L::splat(0.125));
        let pressure = even.fnma(L::load(&data[2 * L::COUNT..]), pressure);
        let lambda = L::splat(moduli.lambda);
        let barred = data[3 * L::COUNT] > 0.0;
        for (p, d) in grad.iter_mut().enumerate() {
            fetch_next::<L>(self.data, place, p, COROTATED_FIELDS);
            let data = &data[(CELL_FIELDS + p * COROTATED_FIELDS) * L::COUNT..];
            let f = read_matrix::<L>(data, L::COUNT);
            let r = read_matrix::<L>(&data[9 * L::COUNT..], L::COUNT);
            let mut k = [change; 6];
            for (n, v) in k.iter_mut().enumerate() {
                *v = L::load(&data[(18 + n) * L::COUNT..]);
            }
            let (c, dc, dr) = (cofactor(&f), cofactor_change(&f, d), rotation_change(&r, &k, d));
            let det = f[0][0].fma(c[0][0], f[0][1].fma(c[0][1], f[0][2].mul(c[0][2])));
            let (mut pressure, mut stiffness) = (pressure, even);
            if barred {
                let [_, push, stiffen] = barrier(det);
                (pressure, stiffness) = (lambda.fma(push, pressure), lambda.fma(stiffen, even));
            }
            let pressure = pressure.add(even.mul(det));
            let change = stiffness.fma(inner(&c, d), change);
            for i in 0..3 {
                for j in 0..3 {
                    let twist = two_mu.mul(d[i][j].sub(dr[i][j]));
                    d[i][j] = change.fma(c[i][j], pressure.fma(dc[i][j], twist));
                }
            }
        }
    }
}

struct ApplyNeoHookean<'a> {
    op: &'a Operator,
    data: &'a [f32],
}

impl<L: Lanes> CellWork<L> for ApplyNeoHookean<'_> {
    #[inline(always)]
    fn cell(&mut self, grad: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>) {
        let data = &self.data[place.data..place.data + (CELL_FIELDS + 8 * NEO_HOOKEAN_FIELDS) * L::COUNT];
        let moduli = self.op.moduli[place.k];
        let mu = L::splat(moduli.mu);
        let (pressure, slope) = (L::load(data), L::load(&data[L::COUNT..]));
        let mut mean = L::splat(0.0);
        let mut own = [mean; 8];
        for (p, d) in grad.iter().enumerate() {
            let f = read_matrix::<L>(&data[(CELL_FIELDS + p * NEO_HOOKEAN_FIELDS) * L::COUNT..], L::COUNT);
            own[p] = inner(&cofactor(&f), d);
            mean = own[p].fma(metric.share[p], mean);
        }
        let even = L::splat(moduli.evenness);
        let mean = mean.mul(slope.sub(even)).mul(L::splat(0.125));
        let pressure = even.fnma(L::load(&data[2 * L::COUNT..]), pressure);
        for (p, d) in grad.iter_mut().enumerate() {
            fetch_next::<L>(self.data, place, p, NEO_HOOKEAN_FIELDS);
            let f = read_matrix::<L>(&data[(CELL_FIELDS + p * NEO_HOOKEAN_FIELDS) * L::COUNT..], L::COUNT);
            let (c, dc) = (cofactor(&f), cofactor_change(&f, d));
            let det = f[0][0].fma(c[0][0], f[0][1].fma(c[0][1], f[0][2].mul(c[0][2])));
            let inv = L::splat(1.0).div(det);
            let mu_j = mu.mul(inv);
            let factor = even.fma(det, pressure.sub(mu_j));
            let along = mu_j.fma(inv, even).fma(own[p], mean);
            for i in 0..3 {
                for j in 0..3 {
                    d[i][j] = along.fma(c[i][j], factor.fma(dc[i][j], mu.mul(d[i][j])));
                }
            }
        }
    }
}

/// Asks for what the next cells have, of themselves with the first point and the `fields` of each: the tangent is larger than what is
/// near a core, and is read in strides that no machine foresees.
#[inline(always)]
fn fetch_next<L: Lanes>(data: &[f32], place: Place, point: usize, fields: usize) {
    /// Numbers that come from memory at once.
    const LINE: usize = 16;
    let next = place.data + (CELL_FIELDS + 8 * fields) * L::COUNT;
    let own = if point == 0 { 0 } else { CELL_FIELDS };
    let from = next + (own + point * fields) * L::COUNT;
    let to = next + (CELL_FIELDS + (point + 1) * fields) * L::COUNT;
    for at in (from..to).step_by(LINE) {
        L::fetch(data, at);
    }
}
