//! Bayer mosaics to RGB by bilinear interpolation.
//!
//! Every missing colour is the mean of its nearest neighbours of that colour; borders mirror, so that
//! a neighbour keeps its colour. Sharper methods invent colour at edges, which a tactile picture made of
//! colour gradients cannot afford.

/// A 2 x 2 mosaic, given by where its red pixel stands: (column, row), each 0 or 1.
/// Blue is on the other diagonal end, green takes the rest.
#[derive(Debug, Clone, Copy)]
pub struct Mosaic {
    /// Column and row of the red pixel in the 2 x 2 cell.
    pub red: (usize, usize),
}

/// Fills `rgb` from the mosaic in `bytes`.
pub fn interpolate(rgb: &mut [u8], bytes: &[u8], w: usize, h: usize, stride: usize, mosaic: Mosaic) {
    // Reflect at the borders without repeating the edge: parity, and so colour, is kept.
    let mirror = |i: isize, n: usize| -> usize {
        let n = n as isize;
        let i = if i < 0 { -i } else { i };
        (if i >= n { 2 * (n - 1) - i } else { i }).clamp(0, n - 1) as usize
    };
    let at = |x: isize, y: isize| u32::from(bytes[mirror(y, h) * stride + mirror(x, w)]);
    for y in 0..h {
        for x in 0..w {
            let (xi, yi) = (x as isize, y as isize);
            let own = at(xi, yi);
            let across = || at(xi - 1, yi) + at(xi + 1, yi);
            let along = || at(xi, yi - 1) + at(xi, yi + 1);
            let corners =
                || at(xi - 1, yi - 1) + at(xi + 1, yi - 1) + at(xi - 1, yi + 1) + at(xi + 1, yi + 1);
            let red_column = x % 2 == mosaic.red.0;
            let red_row = y % 2 == mosaic.red.1;
            let pixel = match (red_column, red_row) {
                (true, true) => [own, (across() + along() + 2) / 4, (corners() + 2) / 4],
                (false, false) => [(corners() + 2) / 4, (across() + along() + 2) / 4, own],
                // Green: in a red row red stands left and right, in a blue row above and below.
                (false, true) => [across().div_ceil(2), own, along().div_ceil(2)],
                (true, false) => [along().div_ceil(2), own, across().div_ceil(2)],
            };
            let i = (y * w + x) * 3;
            rgb[i..i + 3].copy_from_slice(&pixel.map(|c| c as u8));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mosaic a sensor would read from a picture.
    fn sampled(
        picture: impl Fn(usize, usize) -> [u8; 3],
        w: usize,
        h: usize,
        red: (usize, usize),
    ) -> Vec<u8> {
        (0..h)
            .flat_map(|y| (0..w).map(move |x| (x, y)))
            .map(|(x, y)| {
                let channel = match (x % 2 == red.0, y % 2 == red.1) {
                    (true, true) => 0,
                    (false, false) => 2,
                    _ => 1,
                };
                picture(x, y)[channel]
            })
            .collect()
    }

    #[test]
    fn a_uniform_colour_and_a_linear_ramp_come_back_exactly() {
        for red in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (w, h) = (8, 6);
            let mut rgb = vec![0; w * h * 3];
            interpolate(&mut rgb, &sampled(|_, _| [200, 100, 50], w, h, red), w, h, w, Mosaic { red });
            assert!(rgb.chunks_exact(3).all(|p| p == [200, 100, 50]), "{red:?}");

            // Bilinear interpolation reproduces what is linear, away from the mirrored border.
            let ramp = |x: usize, y: usize| [(4 * x + 8 * y) as u8; 3];
            interpolate(&mut rgb, &sampled(ramp, w, h, red), w, h, w, Mosaic { red });
            for y in 1..h - 1 {
                for x in 1..w - 1 {
                    assert_eq!(rgb[(y * w + x) * 3..][..3], ramp(x, y), "{red:?} at {x}, {y}");
                }
            }
        }
    }
}
