//! Removing a global shift between two pictures.
//!
//! Real and simulated pictures of one press may be shifted against each other as a whole, because the
//! camera does not look exactly where the model thinks. [`find`] estimates the shift: the integer
//! part by phase correlation (Kuglin and Hines 1975) of the brightness slopes, the rest by
//! Gauss-Newton on the squared difference. [`consensus`] is the median over many pairs, to be
//! estimated once per dataset, never per picture, so that it cannot hide an error of the simulation.
//! [`apply`] shifts and crops both pictures to what they share. Rotation and scale are not looked for.

use super::{Error, Picture, View, same_size};
use serde::{Deserialize, Serialize};
use twinrig_fourier::{Complex, Direction, plan};

/// By how much a picture lies to the right of and below another, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Shift {
    /// To the right.
    pub dx_px: f64,
    /// Downwards.
    pub dy_px: f64,
}

/// Where `moved` lies relative to `fixed`.
///
/// # Errors
/// When the sizes differ.
pub fn find<'a>(fixed: impl Into<View<'a>>, moved: impl Into<View<'a>>) -> Result<Shift, Error> {
    let (fixed, moved) = (fixed.into(), moved.into());
    same_size("the second picture", (fixed.width, fixed.height), (moved.width, moved.height))?;
    let (w, h) = (fixed.width as usize, fixed.height as usize);
    let (a, b) = (grey(fixed), grey(moved));
    let start = phase_correlation(&a, &b, w, h);
    Ok(refine(&a, &b, w, h, start))
}

/// The median shift of many pairs; `None` for none.
pub fn consensus(shifts: &[Shift]) -> Option<Shift> {
    let median = |pick: fn(&Shift) -> f64| {
        let mut values: Vec<f64> = shifts.iter().map(pick).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        (n > 0).then(|| (values[(n - 1) / 2] + values[n / 2]) / 2.0)
    };
    Some(Shift { dx_px: median(|s| s.dx_px)?, dy_px: median(|s| s.dy_px)? })
}

/// Brings `moved` back by `shift` (bilinear) and crops both pictures to the part they share.
///
/// # Errors
/// When the sizes differ or nothing is left.
pub fn apply<'a>(
    fixed: impl Into<View<'a>>,
    moved: impl Into<View<'a>>,
    shift: Shift,
) -> Result<(Picture, Picture), Error> {
    let (fixed, moved) = (fixed.into(), moved.into());
    same_size("the second picture", (fixed.width, fixed.height), (moved.width, moved.height))?;
    let (x0, y0) = origin(shift);
    // Columns c of `fixed` from there on for which c + d lies in the picture.
    let span = |size: u32, low: u32, d: f64| {
        let high = (f64::from(size) - 1.0 - d.max(0.0)).floor();
        if high < f64::from(low) { 0 } else { high as u32 - low + 1 }
    };
    let (width, height) = (span(fixed.width, x0, shift.dx_px), span(fixed.height, y0, shift.dy_px));
    let kept = fixed.crop(x0, y0, width, height)?;
    let mut rgb = Vec::with_capacity(kept.rgb.len());
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (f64::from(x0 + x) + shift.dx_px, f64::from(y0 + y) + shift.dy_px);
            let (i, j) = (u.floor(), v.floor());
            let (fx, fy) = (u - i, v - j);
            let at = |di: f64, dj: f64| {
                let column = ((i + di) as u32).min(moved.width - 1);
                moved.pixel(column, ((j + dj) as u32).min(moved.height - 1))
            };
            let (p, q, r, s) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0));
            rgb.extend((0..3).map(|c| {
                let top = f64::from(p[c]) * (1.0 - fx) + f64::from(q[c]) * fx;
                let bottom = f64::from(r[c]) * (1.0 - fx) + f64::from(s[c]) * fx;
                (top * (1.0 - fy) + bottom * fy).round() as u8
            }));
        }
    }
    Ok((kept, Picture { width, height, rgb }))
}

/// Top left corner, in the fixed picture, of what [`apply`] keeps.
pub fn origin(shift: Shift) -> (u32, u32) {
    let low = |d: f64| (-d).ceil().max(0.0) as u32;
    (low(shift.dx_px), low(shift.dy_px))
}

fn grey(view: View<'_>) -> Vec<f64> {
    view.rgb.chunks_exact(3).map(|p| p.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0).collect()
}

/// Integer shift of the highest phase correlation.
fn phase_correlation(a: &[f64], b: &[f64], w: usize, h: usize) -> Shift {
    let spectrum = |p: &[f64]| {
        let mut s = windowed_slopes(p, w, h);
        transform(&mut s, w, h, Direction::Forward);
        s
    };
    let (sa, sb) = (spectrum(a), spectrum(b));
    let mut cross: Vec<Complex<f32>> = sa.iter().zip(&sb).map(|(x, y)| x.conj() * y).collect();
    // Whitening, with a floor so that empty frequencies do not turn into noise.
    let mean = cross.iter().map(|c| f64::from(c.norm())).sum::<f64>() / cross.len() as f64;
    let floor = mean as f32 * 1e-2 + f32::MIN_POSITIVE;
    cross.iter_mut().for_each(|c| *c /= c.norm() + floor);
    transform(&mut cross, w, h, Direction::Inverse);
    let peak = (0..cross.len()).max_by(|&i, &j| cross[i].re.total_cmp(&cross[j].re)).unwrap_or(0);
    let signed = |i: usize, n: usize| if i > n / 2 { i as f64 - n as f64 } else { i as f64 };
    Shift { dx_px: signed(peak % w, w), dy_px: signed(peak / w, h) }
}

/// Horizontal slope as the real part, vertical slope as the imaginary part, faded out at the border.
fn windowed_slopes(p: &[f64], w: usize, h: usize) -> Vec<Complex<f32>> {
    let hann = |i: usize, n: usize| (std::f64::consts::PI * (i as f64 + 0.5) / n as f64).sin().powi(2);
    let at = |i: usize, j: usize| p[j.min(h - 1) * w + i.min(w - 1)];
    let slope = |k: usize| {
        let (i, j) = (k % w, k / w);
        let fade = hann(i, w) * hann(j, h);
        let dx = at(i + 1, j) - at(i.saturating_sub(1), j);
        let dy = at(i, j + 1) - at(i, j.saturating_sub(1));
        Complex::new((dx * fade) as f32, (dy * fade) as f32)
    };
    (0..w * h).map(slope).collect()
}

/// Two-dimensional FFT in place. (Single precision is plenty for the place of a peak, a whole pixel.)
fn transform(data: &mut [Complex<f32>], w: usize, h: usize, direction: Direction) {
    plan(w, direction).process(data);
    let mut columns: Vec<Complex<f32>> = (0..w * h).map(|k| data[(k % h) * w + k / h]).collect();
    plan(h, direction).process(&mut columns);
    for (k, value) in columns.into_iter().enumerate() {
        data[(k % h) * w + k / h] = value;
    }
}

/// Gauss-Newton on the squared difference, with offset and gain of the brightness left free.
fn refine(a: &[f64], b: &[f64], w: usize, h: usize, start: Shift) -> Shift {
    let mut d = [start.dx_px, start.dy_px];
    for _ in 0..20 {
        let (x0, x1) = inner(w, d[0]);
        let (y0, y1) = inner(h, d[1]);
        if x0 >= x1 || y0 >= y1 {
            return start;
        }
        // Normal equations for (dx, dy, offset, gain) of: b(x + d) = offset + gain a(x).
        let mut m = [[0.0; 5]; 4];
        for j in y0..y1 {
            for i in x0..x1 {
                let (value, gx, gy) = sample(b, w, i as f64 + d[0], j as f64 + d[1]);
                let row = [gx, gy, -1.0, -a[j * w + i], -value];
                for r in 0..4 {
                    for c in r..5 {
                        m[r][c] += row[r] * row[c];
                    }
                }
            }
        }
        let full = std::array::from_fn(|r| std::array::from_fn(|c| m[r.min(c)][r.max(c)]));
        let Some(step) = solve(full) else { return start };
        let length = step[0].hypot(step[1]);
        let scale = if length > 1.0 { 1.0 / length } else { 1.0 };
        d = [d[0] + step[0] * scale, d[1] + step[1] * scale];
        if length < 1e-4 {
            break;
        }
    }
    // The refinement may only finish what correlation began.
    let far = (d[0] - start.dx_px).hypot(d[1] - start.dy_px) > 3.0;
    if far { start } else { Shift { dx_px: d[0], dy_px: d[1] } }
}

/// Rows or columns that stay inside after a shift by `d`, with a margin.
fn inner(size: usize, d: f64) -> (usize, usize) {
    let margin = d.abs().ceil() as usize + 2;
    (margin.min(size), size.saturating_sub(margin))
}

/// Bilinear value and slopes at (x, y).
fn sample(p: &[f64], w: usize, x: f64, y: f64) -> (f64, f64, f64) {
    let (i, j) = (x.floor() as usize, y.floor() as usize);
    let (fx, fy) = (x - i as f64, y - j as f64);
    let k = j * w + i;
    let value = |k: usize| {
        (p[k] * (1.0 - fx) + p[k + 1] * fx) * (1.0 - fy) + (p[k + w] * (1.0 - fx) + p[k + w + 1] * fx) * fy
    };
    (value(k), (value(k + 1) - value(k - 1)) / 2.0, (value(k + w) - value(k - w)) / 2.0)
}

/// Solves a 4 x 4 system given with its right-hand side as the fifth column.
fn solve(mut m: [[f64; 5]; 4]) -> Option<[f64; 4]> {
    for k in 0..4 {
        let pivot = (k..4).max_by(|&i, &j| m[i][k].abs().total_cmp(&m[j][k].abs()))?;
        m.swap(k, pivot);
        if m[k][k].abs() < 1e-12 {
            return None;
        }
        let row = m[k];
        for (_, other) in m.iter_mut().enumerate().filter(|(r, _)| *r != k) {
            let factor = other[k] / row[k];
            other.iter_mut().zip(row).for_each(|(o, v)| *o -= factor * v);
        }
    }
    Some(std::array::from_fn(|k| m[k][4] / m[k][k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth scene, so that it can be shifted by fractions exactly.
    fn scene(dx: f64, dy: f64, gain: f64) -> Picture {
        let (width, height) = (96u32, 80u32);
        let blobs = [
            (30.0, 25.0, 7.0, 120.0),
            (60.0, 50.0, 10.0, -70.0),
            (45.0, 60.0, 4.0, 90.0),
            (75.0, 20.0, 5.0, 60.0),
        ];
        let value = |k: u32| {
            let (x, y) = (f64::from(k % width) - dx, f64::from(k / width) - dy);
            let bumps: f64 = blobs
                .iter()
                .map(|(cx, cy, s, a)| a * (-((x - cx).powi(2) + (y - cy).powi(2)) / (2.0 * s * s)).exp())
                .sum();
            (gain * (100.0 + bumps) + 5.0 * (gain - 1.0)).round().clamp(0.0, 255.0) as u8
        };
        let rgb = (0..width * height).flat_map(|k| [value(k); 3]).collect();
        Picture { width, height, rgb }
    }

    #[test]
    fn known_shifts_are_found_to_a_fiftieth_of_a_pixel_even_with_other_brightness() {
        let fixed = scene(0.0, 0.0, 1.0);
        for (dx, dy) in [(0.0, 0.0), (3.0, -2.0), (0.37, 0.81), (-6.6, 4.25), (11.5, 9.5)] {
            let shift = find(&fixed, &scene(dx, dy, 0.9)).unwrap();
            let error = (shift.dx_px - dx).hypot(shift.dy_px - dy);
            assert!(error < 0.02, "({dx}, {dy}) found as {shift:?}");
        }
    }

    #[test]
    fn applying_a_found_shift_makes_the_pictures_alike() {
        let (fixed, moved) = (scene(0.0, 0.0, 1.0), scene(4.4, -2.3, 1.0));
        let shift = find(&fixed, &moved).unwrap();
        let (a, b) = apply(&fixed, &moved, shift).unwrap();
        assert_eq!((a.width, a.height), (91, 77));
        let before = super::super::metrics::compare(&fixed, &moved).unwrap();
        let after = super::super::metrics::compare(&a, &b).unwrap();
        assert!(after.mse < 1.0 && before.mse > 50.0, "{before:?} {after:?}");
        assert!(apply(&fixed, &moved, Shift { dx_px: 200.0, dy_px: 0.0 }).is_err());
    }

    #[test]
    fn the_consensus_ignores_outliers() {
        let s = |dx_px: f64, dy_px: f64| Shift { dx_px, dy_px };
        let shifts = [s(1.0, 2.0), s(1.1, 2.1), s(0.9, 1.9), s(40.0, -30.0), s(1.0, 2.0)];
        assert_eq!(consensus(&shifts), Some(s(1.0, 2.0)));
        assert_eq!(consensus(&[]), None);
    }
}
