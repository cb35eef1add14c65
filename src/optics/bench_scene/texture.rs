//! The texture of variant At.

use crate::optics::Texture;
use glam::DVec3;

/// The texture of variant At: dark dots at 2 mm pitch on a wavy ground, on the 20 x 15 mm pad.
pub(super) fn bench_texture() -> Texture {
    use std::f64::consts::TAU;
    Texture::from_fn(640, 480, |u, v| {
        let (x, y) = (20.0 * u - 10.0, 15.0 * v - 7.5);
        let nearest = |c: f64| c - (2.0 * ((c - 1.0) / 2.0).round() + 1.0);
        let q = nearest(x).hypot(nearest(y));
        let m = 1.0 - 0.85 * (-(q / 0.25).powi(4)).exp();
        let rgb = DVec3::new(
            0.55 + 0.15 * (TAU * x / 5.0).sin(),
            0.50 + 0.20 * (TAU * (x + y) / 4.0).sin(),
            0.45 + 0.15 * (TAU * y / 3.0).cos(),
        );
        (m * rgb).as_vec3()
    })
}
