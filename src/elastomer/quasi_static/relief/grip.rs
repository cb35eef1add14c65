//! What a grip bears, on the lattice of the relief.
//!
//! Where what holds ends, the traction along the face rises without bound as the pressure beside an edge does, and splines that can bend
//! no faster than from cell to cell bear too much of it where they hold on, or too little where points at the rim have slipped: the
//! torque of a sphere that is turned goes up and down by 7 % with where its rim lies between the cells. So it is found as the
//! pressure is: the face without any traction is smooth and taken from the splines, and the layer's answer is found anew with
//! every touched point where the indenter holds it.

use super::settle::CLOSE_MM;
use super::{SOFT, Splined, Window, smooth};
use crate::elastomer::Surface;
use crate::elastomer::quasi_static::contact::Grip;
use crate::elastomer::quasi_static::shear::ShearCompliance;
use glam::DVec2;
use rayon::prelude::*;
use twinrig_fourier::Complex;

/// Standard deviation of the Gaussian that smooths the face without traction, cells. Found by experiment, against axisymmetric finite
/// elements: spheres of radius 2 and 4, 0.5 and 1 mm deep, turned by 5 degrees take 3.9 and 1.4 % less torque than they should with 0.65,
/// 2.6 and 0.7 % with 0.4, 1.6 and 0.0 % with this, and with 0.2 0.2 % less and 0.6 % more (15 degrees: 1.4 and 1.0 % more). How torques go
/// with the place on the grid is the same with all of these.
const SMOOTH: f64 = 0.3;
/// Iterations; a tenth of them is usual.
const MOST_ITERATIONS: u32 = 200;

/// Points that hold, at least, where that takes no lattice more than [`FINEST`] times as fine. Found by experiment, against
/// axisymmetric finite elements: a sphere of radius 4, 0.75 mm deep over the middle of the grid and turned by 15 degrees, takes 3.3 % less
/// torque than it should on 1200 points, 2.1 % less on four times as many; others, at other places, differ by less.
const LEAST_HOLDING: f64 = 1500.0;
/// See [`LEAST_HOLDING`].
const FINEST: f64 = 4.0;

/// How many times finer than asked for the lattice has to be for this grip, which a face in relief wants to be so many times finer.
pub fn finer_to_hold(grip: &Grip, asked: [usize; 2], times: [usize; 2]) -> [usize; 2] {
    let holding = grip.part() * (asked[0] * times[0] * asked[1] * times[1]) as f64;
    let finer = (LEAST_HOLDING / holding).sqrt().ceil().clamp(1.0, FINEST) as usize;
    times.map(|times| finer * times)
}

/// How much more is borne on the lattice than by the splines, on the face.
#[derive(Debug, Clone, Copy, Default)]
pub struct Borne {
    /// N along x and y.
    pub force_n: [f64; 2],
    /// About z through the pose, N mm.
    pub torque_n_mm: f64,
}

/// A vector along the face.
fn complex(v: DVec2) -> Complex<f32> {
    Complex::new(v.x as f32, v.y as f32)
}

impl Splined<'_> {
    /// What the grip bears where the face is touched, beyond what its splines do; nothing where that is not found.
    pub(super) fn borne(
        &self,
        grip: &Grip,
        face: &Surface,
        window: Window,
        touched: &[f64],
    ) -> Option<Borne> {
        // (Beside its free sides a pad yields more than a layer does.)
        let within =
            |axis: usize, n: usize| window.from[axis] > 0 && window.from[axis] + window.size[axis] < n;
        if !within(0, face.nx) || !within(1, face.ny) {
            return None;
        }
        let count = window.count();
        let rest = |k: usize| {
            let (i, j) = window.at(k);
            DVec2::from_array(face.rest_xy(i, j))
        };
        let place = |p: DVec2| [p.x / face.size_x_mm + 0.5, p.y / face.size_y_mm + 0.5];
        let moved = |k: usize| face.positions[window.index(face, k)].truncate().as_dvec2() - rest(k);

        // The face without traction.
        let splined: Vec<Complex<f32>> = (0..count)
            .into_par_iter()
            .map(|k| place(rest(k)))
            .map(|[x, y]| complex(grip.traction(x, y)))
            .collect();
        let mut layer = ShearCompliance::new(self.body, window.size, window.spacing);
        let mut given = vec![Complex::default(); count];
        layer.displacement(&splined, &mut given);
        let deviation = [0, 1].map(|axis| SMOOTH * self.cell_mm[axis] / window.spacing[axis]);
        let smoothed = |part: fn(&Complex<f32>) -> f32| {
            let of = |k: usize| part(&(complex(moved(k)) - given[k]));
            let mut field: Vec<f32> = (0..count).map(of).collect();
            smooth(&mut field, window.size, deviation);
            field
        };
        let (free_x, free_y) = (smoothed(|v| v.re), smoothed(|v| v.im));

        // Where the indenter has what it covers.
        let at = DVec2::new(self.pose.x_mm, self.pose.y_mm);
        let turned = DVec2::from_angle(self.pose.theta_deg.to_radians());
        let wanted: Vec<Option<Complex<f32>>> = (0..count)
            .into_par_iter()
            .map(|k| {
                let rest = rest(k);
                let [x, y] = place(rest);
                let offset = grip.held_at(x, y).filter(|_| touched[k] > 0.0)?;
                let way = at + turned.rotate(rest + offset) - rest;
                Some(complex(way) - Complex::new(free_x[k], free_y[k]))
            })
            .collect();

        let own = layer.own();
        let soft: Vec<f32> = touched
            .iter()
            .map(|part| if *part > 0.0 { (SOFT * (1.0 / part - 1.0)) as f32 * own } else { 0.0 })
            .collect();
        let traction = hold(&wanted, &soft, &mut layer, &splined)?;
        let mut held = vec![Complex::default(); count];
        layer.displacement(&traction, &mut held);
        let mut borne = Borne::default();
        for k in 0..count {
            let more = (traction[k] - splined[k]) * window.area() as f32;
            borne.force_n[0] += f64::from(more.re);
            borne.force_n[1] += f64::from(more.im);
            let arm = rest(k) + moved(k) - at;
            let twist = |arm: DVec2, t: Complex<f32>| arm.x * f64::from(t.im) - arm.y * f64::from(t.re);
            let shift = held[k] - given[k];
            borne.torque_n_mm += twist(arm, more)
                + twist(DVec2::new(f64::from(shift.re), f64::from(shift.im)), traction[k]) * window.area();
        }
        Some(borne)
    }
}

/// The tractions with which the layer moves every point that is held as far as wanted, those of the splines being the guess; by
/// conjugate gradients. Others bear nothing. Each point gives way by `soft` times its own traction besides, mm per MPa.
fn hold(
    wanted: &[Option<Complex<f32>>],
    soft: &[f32],
    layer: &mut ShearCompliance,
    guess: &[Complex<f32>],
) -> Option<Vec<Complex<f32>>> {
    let zero = Complex::default();
    let held = |k: usize, v: Complex<f32>| if wanted[k].is_some() { v } else { zero };
    let dot = |a: &[Complex<f32>], b: &[Complex<f32>]| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(a.re * b.re + a.im * b.im)).sum()
    };
    let mut traction: Vec<Complex<f32>> = guess.iter().enumerate().map(|(k, t)| held(k, *t)).collect();
    let mut along = vec![zero; wanted.len()];
    let mut answer = |traction: &[Complex<f32>], out: &mut [Complex<f32>]| {
        layer.displacement(traction, out);
        out.iter_mut().zip(traction).zip(soft).for_each(|((out, t), soft)| *out += t * *soft);
    };
    answer(&traction, &mut along);
    let mut left: Vec<Complex<f32>> =
        wanted.iter().zip(&along).map(|(wanted, given)| wanted.map_or(zero, |w| w - given)).collect();
    let mut way = left.clone();
    let mut square = dot(&left, &left);
    for _ in 0..MOST_ITERATIONS {
        if left.iter().all(|v| v.re.abs() <= CLOSE_MM && v.im.abs() <= CLOSE_MM) {
            return Some(traction);
        }
        answer(&way, &mut along);
        let step = (square / dot(&way, &along)) as f32;
        for k in 0..wanted.len() {
            traction[k] += way[k] * step;
            left[k] -= held(k, along[k]) * step;
        }
        let (before, now) = (square, dot(&left, &left));
        square = now;
        for (way, left) in way.iter_mut().zip(&left) {
            *way = left + *way * (now / before) as f32;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::super::super::Body;
    use super::super::super::tests::{pad, settings};
    use super::*;
    use crate::elastomer::{Friction, Law};

    #[test]
    fn a_disc_that_is_turned_takes_the_torque_of_reissner_and_sagoci() {
        let mut pad = pad(Law::NeoHookean);
        pad.thickness_mm = 400.0;
        let body = Body::new(&pad, &settings(Friction::Infinite));
        let g = pad.material.youngs_modulus_mpa / 2.0 / (1.0 + pad.material.poisson_ratio);
        for (radius_mm, spacing_mm, off) in
            [(1.3, 0.1, [0.0, 0.0]), (1.3, 0.1, [0.3, 0.45]), (2.3, 0.1, [0.5, 0.1])]
        {
            let n = (2.0 * radius_mm / spacing_mm) as usize + 10;
            let at = |k: usize| {
                let along = |i: usize, off: f64| (i as f64 - n as f64 / 2.0 + off) * spacing_mm;
                DVec2::new(along(k % n, off[0]), along(k / n, off[1]))
            };
            let angle = 0.01;
            let wanted: Vec<_> = (0..n * n)
                .map(|k| (at(k).length() < radius_mm).then(|| complex(at(k).perp() * angle)))
                .collect();
            let mut layer = ShearCompliance::new(&body, [n, n], [spacing_mm; 2]);
            let guess = vec![Complex::default(); n * n];
            let traction = hold(&wanted, &vec![0.0; n * n], &mut layer, &guess).expect("a round disc");
            let area = spacing_mm * spacing_mm;
            let torque: f64 = (0..n * n)
                .map(|k| {
                    at(k).perp_dot(DVec2::new(f64::from(traction[k].re), f64::from(traction[k].im))) * area
                })
                .sum();
            let counted = (wanted.iter().flatten().count() as f64 * area / std::f64::consts::PI).sqrt();
            let theory = 16.0 / 3.0 * g * counted.powi(3) * angle;
            assert!((torque / theory - 1.0).abs() < 0.015, "{radius_mm} {off:?}: {torque} {theory}");
        }
    }
}
