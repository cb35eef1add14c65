//! The blur of a lens: a Gaussian, rows first and columns then; the picture is continued by its border.

use super::Film;
use glam::Vec3;
use rayon::prelude::*;

/// Rows that are worth a thread's while.
const ROWS: usize = 8;

/// Blurs by a Gaussian of this standard deviation, pixels.
pub fn blur(film: &mut Film, sigma: f32) {
    let (width, height) = (film.width, film.height);
    if width == 0 || height == 0 {
        return;
    }
    let kernel = kernel(sigma);
    let radius = kernel.len() / 2;
    // Plain numbers, three a pixel: the compiler takes many at once.
    let mut flat = vec![0.0; 3 * film.pixels.len()];
    let rows = flat.par_chunks_mut(3 * width).zip(film.pixels.par_chunks(width)).with_min_len(ROWS);
    rows.for_each_init(Vec::new, |wide, (row, pixels)| {
        wide.clear();
        let before = std::iter::repeat_n(&pixels[0], radius);
        let after = std::iter::repeat_n(&pixels[width - 1], radius);
        wide.extend(before.chain(pixels).chain(after).flat_map(|p| p.to_array()));
        weigh(row, &kernel, |i| &wide[3 * i..3 * (i + width)]);
    });
    let rows = film.pixels.par_chunks_mut(width).enumerate().with_min_len(ROWS);
    rows.for_each_init(
        || vec![0.0; 3 * width],
        |sum, (y, pixels)| {
            weigh(sum, &kernel, |i| {
                let from = (y + i).saturating_sub(radius).min(height - 1) * 3 * width;
                &flat[from..from + 3 * width]
            });
            for (p, s) in pixels.iter_mut().zip(sum.chunks_exact(3)) {
                *p = Vec3::from_slice(s);
            }
        },
    );
}

/// A row as the sum of weighted rows.
fn weigh<'a>(row: &mut [f32], kernel: &[f32], source: impl Fn(usize) -> &'a [f32]) {
    row.fill(0.0);
    for (i, weight) in kernel.iter().enumerate() {
        row.iter_mut().zip(source(i)).for_each(|(p, s)| *p += s * weight);
    }
}

/// Weights out to three standard deviations, their sum 1.
fn kernel(sigma: f32) -> Vec<f32> {
    let radius = (3.0 * sigma).ceil() as i32;
    let weights = (-radius..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp());
    let sum: f32 = weights.clone().sum();
    weights.map(|w| w / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black() -> Film {
        Film::new(64, 48)
    }

    /// An edge under a Gaussian of width s is the normal distribution's integral: 0.1587 at a width before it.
    #[test]
    fn a_blurred_edge_is_the_integral_of_the_gaussian() {
        for upright in [true, false] {
            let mut edge = black();
            let along = |k: usize| if upright { k % 64 } else { k / 64 };
            edge.pixels
                .iter_mut()
                .enumerate()
                .filter(|(k, _)| along(*k) >= 24)
                .for_each(|(_, p)| *p = Vec3::ONE);
            blur(&mut edge, 4.0);
            // Pixel 24 begins at the edge: middles are half a pixel off.
            for (at, truth) in
                [(23, 0.450_26), (21, 0.266_0), (19, 0.130_3), (28, 0.869_7), (0, 0.0), (47, 1.0)]
            {
                let seen = if upright { edge.at(at, 20).x } else { edge.at(20, at).x };
                assert!((seen - truth).abs() < 3e-3, "{at} {seen}");
            }
        }
    }

    #[test]
    fn light_is_kept_and_spread_round() {
        let mut point = black();
        point.pixels[24 * 64 + 32] = Vec3::ONE;
        blur(&mut point, 2.0);
        let sum: f32 = point.pixels.iter().map(|p| p.x).sum();
        let peak = point.at(32, 24).x;
        assert!((sum - 1.0).abs() < 1e-4 && (peak - 1.0 / (std::f32::consts::TAU * 4.0)).abs() < 2e-3);
        assert!((point.at(34, 24).x - point.at(32, 22).x).abs() < 1e-7);
    }

    #[test]
    fn a_blur_wider_than_the_picture_leaves_an_even_one_alone() {
        let mut small = Film { width: 3, height: 2, pixels: vec![Vec3::splat(0.7); 6] };
        blur(&mut small, 5.0);
        assert!(small.pixels.iter().all(|p| (p.x - 0.7).abs() < 1e-5));
    }
}
