//! The pressure between a layer and a body that do not pass through each other: the conjugate gradients of Polonsky and Keer 1999,
//! "A numerical method for solving rough contact problems based on the multi-level multi-summation and conjugate gradient techniques".

use super::super::compliance::Compliance;

/// Penetration and gap under pressure that may remain, mm.
pub const CLOSE_MM: f32 = 2e-4;
/// Iterations; a tenth of them is usual.
const MOST_ITERATIONS: u32 = 200;

/// Finds the pressure with which nothing is inside the body and nothing that is not at it is pressed, and what the layer does
/// under it. `gap` is what there would be without any pressure; each point gives way by `soft` times its own pressure
/// besides, mm per MPa, of which its neighbours and the answer know nothing.
pub fn settle(
    gap: &[f32],
    soft: &[f32],
    layer: &mut Compliance,
    mut pressure: Vec<f32>,
) -> Option<[Vec<f32>; 2]> {
    let n = gap.len();
    for (p, gap) in pressure.iter_mut().zip(gap) {
        *p = if gap.is_finite() { p.max(0.0) } else { 0.0 };
    }
    let (mut given, mut way, mut along) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let largest = layer.largest();
    let mut answer = |pressure: &[f32], out: &mut [f32]| {
        layer.displacement(pressure, out);
        out.iter_mut().zip(pressure).zip(soft).for_each(|((out, p), soft)| *out += soft * p);
    };
    answer(&pressure, &mut given);
    let (mut last, mut conjugate) = (1.0, false);
    for _ in 0..MOST_ITERATIONS {
        // What is left to do.
        let (mut square, mut worst) = (0.0, 0.0f32);
        for k in 0..n {
            let gap = gap[k] + given[k];
            if pressure[k] > 0.0 {
                square += f64::from(gap).powi(2);
                worst = worst.max(gap.abs());
            } else {
                worst = worst.max(-gap);
            }
        }
        if worst <= CLOSE_MM {
            given.iter_mut().zip(&pressure).zip(soft).for_each(|((g, p), soft)| *g -= soft * p);
            return Some([pressure, given]);
        }
        // The way there, and how far along it.
        let beta = if conjugate { (square / last) as f32 } else { 0.0 };
        last = square;
        for k in 0..n {
            way[k] = if pressure[k] > 0.0 { gap[k] + given[k] + beta * way[k] } else { 0.0 };
        }
        answer(&way, &mut along);
        let (mut up, mut down) = (0.0, 0.0);
        for k in (0..n).filter(|k| pressure[*k] > 0.0) {
            up += f64::from(gap[k] + given[k]) * f64::from(way[k]);
            down += f64::from(along[k]) * f64::from(way[k]);
        }
        let step = if down > 0.0 { (up / down) as f32 } else { 1.0 / largest };
        // What lets go, and what comes to touch.
        conjugate = true;
        let mut as_it_was = true;
        for k in 0..n {
            let wanted = pressure[k] - step * way[k];
            let touches = wanted <= 0.0 && gap[k] + given[k] < 0.0;
            conjugate &= !touches;
            as_it_was &= wanted >= 0.0 && !touches;
            pressure[k] = if touches { -step * (gap[k] + given[k]) } else { wanted.max(0.0) };
        }
        if as_it_was {
            given.iter_mut().zip(&along).for_each(|(g, a)| *g -= step * a);
        } else {
            answer(&pressure, &mut given);
        }
    }
    None
}
