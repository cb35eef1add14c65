//! Over how much of the face an error is a mean.

/// No less than a circle of 3 mm in radius, mm^2.
const LEAST_MM2: f64 = 9.0 * std::f64::consts::PI;

/// The part of the face that an error is a root mean square over, mm^2, where so much of it is pressed: a circle of twice
/// its radius, or [`LEAST_MM2`].
pub fn judged_mm2(pressed_mm2: f64) -> f64 {
    (4.0 * pressed_mm2).max(LEAST_MM2)
}
