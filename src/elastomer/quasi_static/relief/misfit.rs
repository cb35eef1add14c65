//! How far heights in relief may be off.

use super::super::judged::judged_mm2;
use super::window::Window;

/// Width of the band on either side of the contact's edge that tells how far the splines are off there, mm.
const BAND_MM: f64 = 0.2;
/// Error outside of that band per change inside of it, both as root mean squares over [`judged_mm2`]. Found by experiment, with
/// [`super::super::level::Level::error_in_relief`]'s constant part: 21 bodies, sharp ones and edges rounded by 0.3 mm, pressed 0.3 to 0.8 mm over cells of 0.28, 0.42 and 0.63 mm, are off cells
/// of 0.10 to 0.14 mm by less than is stated, by a quarter of it at the median.
const TO_ERROR: f64 = 0.3;

/// What heights may be off, mm, by how much they change at the edge of the contact.
pub fn misfit_mm(change: &[f32], pressure: &[f32], window: Window) -> f64 {
    let area = window.area();
    let squares =
        at_edge(pressure, window.size[0], window.spacing).map(|k| f64::from(change[k]).powi(2)).sum::<f64>();
    let pressed_mm2 = pressure.iter().filter(|p| **p > 0.0).count() as f64 * area;
    let changed_mm = (squares * area / judged_mm2(pressed_mm2)).sqrt();
    TO_ERROR * changed_mm
}

/// The points within [`BAND_MM`] along x and y of where pressed ones meet others.
fn at_edge(pressure: &[f32], nx: usize, spacing: [f64; 2]) -> impl Iterator<Item = usize> {
    let ny = pressure.len() / nx;
    let reach = spacing.map(|s| (BAND_MM / s).round() as usize);
    let pressed = |i: usize, j: usize| u32::from(pressure[j * nx + i] > 0.0);
    let around = |at: usize, reach: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
    // Of so many neighbours along x so many are pressed.
    let along: Vec<u32> =
        (0..pressure.len()).map(|k| around(k % nx, reach[0], nx).map(|i| pressed(i, k / nx)).sum()).collect();
    (0..pressure.len()).filter(move |k| {
        let (columns, rows) = (around(k % nx, reach[0], nx), around(k / nx, reach[1], ny));
        let all = (columns.len() * rows.len()) as u32;
        let sum: u32 = rows.map(|j| along[j * nx + k % nx]).sum();
        sum > 0 && sum < all
    })
}
