//! Pixels that something fixed covers in part, high above the pad: a lamp whose shining side the camera sees may be many
//! times as bright as the pad beside it, so the corners of a pixel do not tell where its edge is. How much of each such
//! pixel is covered does not change with the pad: it is sampled once per sensor.

use super::fixed::{Look, Looks};
use crate::optics::Film;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Samples along the edge of a pixel.
const GRID: usize = 16;
/// Variance of the mean of so many samples about an edge, as part of their own: they err by N^(-3/4).
const SAMPLED_ERROR: f64 = 1.0 / (GRID * GRID * GRID) as f64;

/// Pixels that are covered in part, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Covers {
    /// Which.
    pub pixels: Vec<u32>,
    /// How much of each is covered.
    pub parts: Vec<f32>,
    /// Radiance of what covers them times that part, by light of radiance 1.
    pub lights: Vec<Vec<Vec3>>,
}

impl Covers {
    /// Samples the pixels about which corners differ: in whether something fixed stands there, or in which lamp shines there.
    pub fn new(looks: &Looks<'_>, corners: &[Look], [columns, rows]: [usize; 2], lights: usize) -> Self {
        let [width, height] = [columns - 1, rows - 1];
        let differs = |x: usize, y: usize| {
            let k = y * columns + x;
            let shows = |k: usize| (corners[k].high, corners[k].lamp);
            let four = [k, k + 1, k + columns, k + columns + 1].map(shows);
            four.iter().any(|c| *c != four[0])
        };
        // What lies between corners shows in neighbours.
        let near = |k: usize| {
            let (x, y) = (k % width, k / width);
            let (xs, ys) =
                (x.saturating_sub(1)..(x + 2).min(width), y.saturating_sub(1)..(y + 2).min(height));
            ys.clone().any(|y| xs.clone().any(|x| differs(x, y)))
        };
        let low = |x: usize, y: usize| {
            let k = y * columns + x;
            [k, k + 1, k + columns, k + columns + 1].iter().any(|k| corners[*k].shows && !corners[*k].high)
        };
        let sampled = |k: usize| {
            if low(k % width, k / width) {
                return None;
            }
            let at = Vec2::new((k % width) as f32, (k / width) as f32);
            let (mut covered, mut sums) = (0, vec![Vec3::ZERO; lights]);
            for s in 0..GRID * GRID {
                let within = Vec2::new((s % GRID) as f32 + 0.5, (s / GRID) as f32 + 0.5) / GRID as f32;
                let look = looks.at(at + within);
                if look.high {
                    covered += 1;
                    sums.iter_mut().zip(&look.lights).for_each(|(sum, light)| *sum += *light);
                } else if look.shows {
                    // Something low shows beside it, which a press may hide.
                    return None;
                }
            }
            let share = 1.0 / (GRID * GRID) as f32;
            sums.iter_mut().for_each(|sum| *sum *= share);
            (covered > 0).then_some((k as u32, covered as f32 * share, sums))
        };
        let found: Vec<_> =
            (0..width * height).into_par_iter().filter(|k| near(*k)).filter_map(sampled).collect();
        Self {
            pixels: found.iter().map(|f| f.0).collect(),
            parts: found.iter().map(|f| f.1).collect(),
            lights: (0..lights).map(|l| found.iter().map(|f| f.2[l]).collect()).collect(),
        }
    }

    /// Whether each number has its place in a view of so many pixels.
    pub fn fit(&self, pixels: usize) -> bool {
        let n = self.pixels.len();
        let ordered = self.pixels.windows(2).all(|p| p[0] < p[1]);
        ordered
            && self.pixels.last().is_none_or(|last| (*last as usize) < pixels)
            && self.parts.len() == n
            && self.lights.iter().all(|l| l.len() == n)
    }

    /// Whether a pixel is covered in part.
    pub fn contain(&self, pixel: usize) -> bool {
        self.pixels.binary_search(&(pixel as u32)).is_ok()
    }

    /// Lays what covers pixels over a picture of the pad, `light` being its radiance there. What the error of the covered parts
    /// amounts to, summed over pixels and channels as squares.
    pub fn lay(&self, film: &mut Film, light: &[Vec3], veil: impl Fn(usize) -> Vec3) -> f64 {
        let mut spread = 0.0;
        for ((pixel, part), light) in self.pixels.iter().zip(&self.parts).zip(light) {
            let k = *pixel as usize;
            let pad = film.pixels[k] - veil(k);
            film.pixels[k] += *light - pad * *part;
            let contrast = *light / *part - pad;
            spread += SAMPLED_ERROR * f64::from(part * (1.0 - part) * contrast.length_squared());
        }
        spread
    }
}

#[cfg(test)]
mod tests {
    use super::super::Precomputed;
    use super::super::tests::scene;
    use super::super::view::View;
    use crate::optics::LightShape;
    use crate::optics::bench_scene::Variant;
    use glam::Vec3;

    #[test]
    fn as_much_is_covered_as_a_lamp_hides() {
        let mut scene = scene(Variant::Ac, |_, _| 0.0);
        let (center, half) = (Vec3::new(-1.83, 0.21, 8.0), 0.93);
        scene.lights[0].shape =
            LightShape::Rectangle { center, half_u: half * Vec3::X, half_v: half * Vec3::Y };
        let once = Precomputed::new(&scene).unwrap();
        let covers = &once.tables.covers;
        let [columns, _] = once.view.corners();
        let width = once.view.camera.width;
        let value = |k: usize| once.tables.fixed[k];
        let at = |k: usize| View::point(once.view.row(k / columns)[k % columns], value(k));
        let high = |k: usize| value(k) > 0.0 && at(k).z > 7.9;
        let whole = (0..width * once.view.camera.height)
            .filter(|k| !covers.contain(*k))
            .filter(|k| {
                let corner = k / width * columns + k % width;
                [corner, corner + 1, corner + columns, corner + columns + 1].iter().all(|c| high(*c))
            })
            .count();
        let covered = whole as f32 + covers.parts.iter().sum::<f32>();
        // The camera looks straight down, so the lamp's picture is as large as it is near.
        let camera = &once.view.camera;
        let edge = 2.0 * half / (2.0 * camera.tan_half_x * (camera.origin.z - center.z)) * width as f32;
        assert!((covered / (edge * edge) - 1.0).abs() < 0.003, "{covered} of {}", edge * edge);
        assert!(covers.parts.iter().any(|part| *part < 0.9), "no pixel is covered in part");
    }
}
