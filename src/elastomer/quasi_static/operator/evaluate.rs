//! Stored energy, stresses and the tangent's numbers at the points of a slab.

use super::super::lanes::{Kernel, Lanes};
use super::super::law::{
    BARRIER_BEGINS, COROTATED_FIELDS, Mat, NEO_HOOKEAN_FIELDS, barrier, cofactor, plus_identity, rotation,
    spin_stiffness_inverse, volume_change,
};
use super::bend::Metric;
use super::sweep::{CellWork, Place, sweep};
use super::{CELL_FIELDS, Evaluation, Operator};
use crate::elastomer::Law;

pub(super) struct EvaluateSlab<'a> {
    pub(super) op: &'a Operator,
    pub(super) slab: (usize, usize),
    pub(super) u: &'a [f32],
    pub(super) out: &'a mut [f32],
    pub(super) data: &'a mut [f32],
}

impl Kernel for EvaluateSlab<'_> {
    type Output = Evaluation;
    #[inline(always)]
    fn run<L: Lanes>(self) -> Evaluation {
        let mut work = Evaluate {
            op: self.op,
            data: self.data,
            energy: 0.0,
            least: L::splat(f32::INFINITY),
            poison: L::splat(0.0),
        };
        sweep::<L, _>(self.op, self.slab, self.u, self.out, &mut work);
        let mut least = f32::INFINITY;
        for (l, p) in work.least.to_array()[..L::COUNT].iter().zip(work.poison.to_array()) {
            // `poison` is 0 unless a number was infinite or not a number.
            let seen = l + p;
            if !(seen >= least) {
                least = seen;
            }
        }
        Evaluation { energy: work.energy, least_volume: least }
    }
}

struct Evaluate<'a, L> {
    op: &'a Operator,
    data: &'a mut [f32],
    energy: f64,
    least: L,
    poison: L,
}

impl<L: Lanes> CellWork<L> for Evaluate<'_, L> {
    #[inline(always)]
    fn cell(&mut self, grad: &mut [Mat<L>; 8], place: Place, metric: &Metric<L>) {
        let op = self.op;
        let moduli = op.moduli[place.k];
        let (mu, lambda) = (L::splat(moduli.mu), L::splat(moduli.lambda));
        let one = L::splat(1.0);
        let zero = L::splat(0.0);
        let mut j1 = [zero; 8];
        let mut mean = zero;
        let mut least = L::splat(f32::INFINITY);
        for ((j, h), share) in j1.iter_mut().zip(grad.iter()).zip(&metric.share) {
            *j = volume_change(h);
            mean = j.fma(*share, mean);
            least = least.min(j.add(one));
            self.poison = j.mul(zero).add(self.poison);
        }
        self.least = self.least.min(least);
        // Elsewhere the barrier is exactly zero.
        let barred = least.to_array()[..L::COUNT].iter().any(|j| *j < BARRIER_BEGINS);
        mean = mean.mul(L::splat(0.125));
        let data = &mut self.data[place.data..place.data + op.cell_fields() * L::COUNT];
        // Volumetric terms of the cell: pressure factor and its slope.
        let mut energy = zero;
        let (pressure, slope) = match op.law {
            Law::FixedCorotated => {
                energy = lambda.mul(mean).mul(mean).mul(L::splat(4.0));
                (lambda.mul(mean), lambda)
            }
            Law::NeoHookean => {
                let log = lanes_ln_1p(mean);
                let inv = one.div(mean.add(one));
                energy = lambda.mul(log).mul(log).mul(L::splat(4.0)).add(energy);
                (lambda.mul(log).mul(inv), lambda.mul(one.sub(log)).mul(inv).mul(inv))
            }
        };
        pressure.store(&mut data[0..]);
        slope.store(&mut data[L::COUNT..]);
        mean.add(one).store(&mut data[2 * L::COUNT..]);
        L::splat(f32::from(u8::from(barred))).store(&mut data[3 * L::COUNT..]);
        let even = L::splat(moduli.evenness);
        for (p, h) in grad.iter_mut().enumerate() {
            let mut own = zero;
            let f = plus_identity(h);
            let c = cofactor(&f);
            let uneven = j1[p].sub(mean);
            let leveling = even.mul(uneven);
            own = L::splat(0.5).mul(leveling).fma(uneven, own);
            match op.law {
                Law::FixedCorotated => {
                    let r = rotation(&f);
                    let k = spin_stiffness_inverse(&f, &r);
                    let data = &mut data[(CELL_FIELDS + p * COROTATED_FIELDS) * L::COUNT..];
                    for i in 0..3 {
                        for j in 0..3 {
                            let n = 3 * i + j;
                            f[i][j].store(&mut data[n * L::COUNT..]);
                            r[i][j].store(&mut data[(9 + n) * L::COUNT..]);
                        }
                    }
                    for (n, v) in k.iter().enumerate() {
                        v.store(&mut data[(18 + n) * L::COUNT..]);
                    }
                    let mut pressure = pressure;
                    if barred {
                        let [wall, push, _] = barrier(j1[p].add(one));
                        own = lambda.fma(wall, own);
                        pressure = lambda.fma(push, pressure);
                    }
                    let pressure = pressure.add(leveling);
                    let two_mu = mu.add(mu);
                    for i in 0..3 {
                        for j in 0..3 {
                            let e = f[i][j].sub(r[i][j]);
                            own = mu.mul(e).fma(e, own);
                            h[i][j] = two_mu.fma(e, pressure.mul(c[i][j]));
                        }
                    }
                }
                Law::NeoHookean => {
                    let data = &mut data[(CELL_FIELDS + p * NEO_HOOKEAN_FIELDS) * L::COUNT..];
                    // F - C/J from the gradient alone: of the two, each near one, rounding would be left in a small press.
                    let of = *h;
                    let minors = cofactor(&of);
                    let volume = j1[p].add(one);
                    let shear = mu.div(volume);
                    let beyond = j1[p].sub(of[0][0].add(of[1][1]).add(of[2][2]));
                    let pressure = pressure.add(leveling);
                    let half_mu = mu.mul(L::splat(0.5));
                    own = lanes_ln_1p(j1[p]).fnma(mu, own);
                    for i in 0..3 {
                        own = mu.fma(of[i][i], own);
                        for j in 0..3 {
                            f[i][j].store(&mut data[(3 * i + j) * L::COUNT..]);
                            own = half_mu.mul(of[i][j]).fma(of[i][j], own);
                            let turned = of[j][i].sub(minors[i][j]);
                            let sum = volume.fma(of[i][j], if i == j { turned.add(beyond) } else { turned });
                            h[i][j] = shear.fma(sum, pressure.mul(c[i][j]));
                        }
                    }
                }
            }
            energy = own.fma(metric.share[p], energy);
        }
        let weight = op.tables.weight[place.k];
        let energy = energy.mul(metric.volume);
        self.energy += f64::from(weight) * energy.to_array().map(f64::from).iter().sum::<f64>();
    }
}

/// ln(1 + x) = 2 artanh(x / (2 + x)), by its series where that takes six terms (x from -0.4 to 0.66), else lane by lane.
#[inline(always)]
fn lanes_ln_1p<L: Lanes>(x: L) -> L {
    const FURTHEST: f32 = 0.25;
    let t = x.div(L::splat(2.0).add(x));
    if !t.to_array()[..L::COUNT].iter().all(|t| t.abs() <= FURTHEST) {
        return L::load(&x.to_array().map(f32::ln_1p));
    }
    let s = t.mul(t);
    let mut sum = L::splat(1.0 / 11.0);
    for n in [9.0, 7.0, 5.0, 3.0, 1.0] {
        sum = sum.fma(s, L::splat(1.0 / n));
    }
    sum.mul(t.add(t))
}

#[cfg(test)]
mod tests {
    use super::super::super::lanes::{WIDTH, dispatch};
    use super::*;

    struct Logarithms([f32; WIDTH]);

    impl Kernel for Logarithms {
        type Output = [f32; WIDTH];
        #[inline(always)]
        fn run<L: Lanes>(self) -> [f32; WIDTH] {
            let mut out = self.0;
            for at in (0..WIDTH).step_by(L::COUNT) {
                lanes_ln_1p(L::load(&self.0[at..])).store(&mut out[at..]);
            }
            out
        }
    }

    #[test]
    fn logarithms_are_those_of_the_standard_library() {
        for n in -99..1000 {
            // All within the series, or one of them far out.
            for spread in [1e-4, 0.5] {
                let x: [f32; WIDTH] = std::array::from_fn(|i| 0.01 * n as f32 + spread * i as f32 / 16.0);
                let found = dispatch(Logarithms(x));
                for (x, found) in x.iter().zip(found) {
                    let exact = f64::from(*x).ln_1p();
                    assert!((f64::from(found) - exact).abs() <= 3e-7 * exact.abs(), "{x}: {found} {exact}");
                }
            }
        }
    }
}
