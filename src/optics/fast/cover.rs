//! Pixels that something fixed covers in part: a wall or a lamp beside the pad, or above it. A lamp whose shining side the
//! camera sees may be many times as bright as the pad, so the corners of a pixel do not tell where its edge is. What of
//! such a pixel is in front of what does not change with the pad: depths are sampled once per sensor.

use super::fixed::{Look, Looks, SAMPLE_RAYS};
use super::traces::Pieces;
use crate::optics::Film;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Samples of a pixel.
pub const SAMPLES: usize = 89;
/// Step of the lattice that they lie on: with Fibonacci numbers it is even along every edge.
const STEP: usize = 55;
/// Variance of the mean of so many samples about an edge, as part of their own (found by drawing edges; along the pixel's own
/// edges it is a tenth).
pub const SAMPLED_ERROR: f64 = 6e-4;

/// Where a sample lies in its pixel.
pub fn place(k: usize) -> Vec2 {
    Vec2::new(k as f32 + 0.5, (k * STEP % SAMPLES) as f32 + 0.5) / SAMPLES as f32
}

/// Values of the samples of a pixel: inverse depths, minus infinity where there is nothing.
pub type Values = [f32; SAMPLES];

/// Pixels that are covered in part, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Covers {
    /// Which.
    pub pixels: Vec<u32>,
    /// The values of what covers them.
    pub values: Vec<Values>,
    /// Its mean radiance where it shows, by light of radiance 1.
    pub lights: Vec<Vec<Vec3>>,
}

/// How a picture's pixels take what covers them.
pub struct Laid<'a> {
    /// Radiance of what covers them, by picture and pixel.
    pub lights: &'a [Vec<Vec3>],
    /// How much of a pixel shows the pad, and how much something fixed.
    pub parts: &'a [[f32; 2]],
    /// What the scene has for the pictures' lights.
    pub radiances: &'a [Vec3],
}

impl Covers {
    /// Samples the pixels about which corners differ: in whether something fixed shows there, or in which lamp shines there.
    pub fn new(looks: &Looks<'_>, corners: &[Look], [columns, rows]: [usize; 2], lights: usize) -> Self {
        let [width, height] = [columns - 1, rows - 1];
        let differs = |x: usize, y: usize| {
            let k = y * columns + x;
            let shows = |k: usize| (corners[k].shows, corners[k].high, corners[k].lamp);
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
        let sampled = |k: usize| {
            let at = Vec2::new((k % width) as f32, (k / width) as f32);
            let (mut values, mut showing, mut sums) = ([0.0; SAMPLES], 0, vec![Vec3::ZERO; lights]);
            for (s, value) in values.iter_mut().enumerate() {
                let look = looks.at(at + place(s), SAMPLE_RAYS);
                *value = look.value;
                if look.shows {
                    showing += 1;
                    sums.iter_mut().zip(&look.lights).for_each(|(sum, light)| *sum += *light);
                }
            }
            sums.iter_mut().for_each(|sum| *sum /= showing.max(1) as f32);
            // (An edge may run through a corner and past all samples.)
            (showing > 0 || differs(k % width, k / width)).then_some((k as u32, values, sums))
        };
        let found: Vec<_> =
            (0..width * height).into_par_iter().filter(|k| near(*k)).filter_map(sampled).collect();
        Self {
            pixels: found.iter().map(|f| f.0).collect(),
            values: found.iter().map(|f| f.1).collect(),
            lights: (0..lights).map(|l| found.iter().map(|f| f.2[l]).collect()).collect(),
        }
    }

    /// Whether each number has its place in a view of so many pixels.
    pub fn fit(&self, pixels: usize) -> bool {
        let n = self.pixels.len();
        let ordered = self.pixels.windows(2).all(|p| p[0] < p[1]);
        ordered
            && self.pixels.last().is_none_or(|last| (*last as usize) < pixels)
            && self.values.len() == n
            && self.lights.iter().all(|l| l.len() == n)
    }

    /// The values of what covers a pixel; None where it is not covered in part.
    pub fn at(&self, pixel: usize) -> Option<&Values> {
        self.pixels.binary_search(&(pixel as u32)).ok().map(|k| &self.values[k])
    }

    /// By pixel: how much of it shows the pad, of which `pad` gives the values, and how much something fixed.
    pub fn parts(&self, pad: impl Fn(usize) -> Values + Sync) -> Vec<[f32; 2]> {
        let parts = |(pixel, fixed): (&u32, &Values)| {
            let (mut seen, mut covered) = (0.0, 0.0);
            for (pad, fixed) in pad(*pixel as usize).iter().zip(fixed) {
                if fixed > pad {
                    covered += 1.0;
                } else if *pad > f32::NEG_INFINITY {
                    seen += 1.0;
                }
            }
            [seen, covered].map(|count| count / SAMPLES as f32)
        };
        self.pixels.par_iter().zip(&self.values).map(parts).collect()
    }

    /// Lays what covers pixels over pictures of the pad alone. What the error of the covered parts amounts to, summed over
    /// pixels and channels as squares, is added to `spread`. `veil` is what a plate mirrors into a pixel of a picture.
    pub fn lay(
        &self,
        films: &mut [Film],
        laid: &Laid<'_>,
        veil: impl Fn(usize, usize) -> Vec3,
        spread: &mut [f64],
    ) {
        let mut pads = vec![Vec3::ZERO; films.len()];
        for (at, (pixel, [seen, covered])) in self.pixels.iter().zip(laid.parts).enumerate() {
            let k = *pixel as usize;
            for (index, (film, pad)) in films.iter_mut().zip(&mut pads).enumerate() {
                let veil = veil(index, k);
                *pad = film.pixels[k] - veil;
                film.pixels[k] = *pad * *seen + laid.lights[index][at] * *covered + veil;
            }
            let mut pieces = Pieces::new(films.len());
            pieces.add(*seen, pads.iter().copied(), laid.radiances);
            pieces.add(*covered, laid.lights.iter().map(|light| light[at]), laid.radiances);
            // (Where neither is there is nothing, which is dark.)
            pieces.add_variances(1.0, SAMPLED_ERROR, spread);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Precomputed;
    use super::super::tests::scene;
    use super::super::view::View;
    use super::SAMPLES;
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
        let camera = &once.view.camera;
        let [columns, _] = once.view.corners();
        let width = once.view.camera.width;
        let value = |k: usize| once.tables.fixed[k];
        let at = |k: usize| View::point(once.view.row(k / columns)[k % columns], value(k));
        let high = |k: usize| value(k) > 0.0 && at(k).z > 7.9;
        let whole = (0..width * once.view.camera.height)
            .filter(|k| covers.at(*k).is_none())
            .filter(|k| {
                let corner = k / width * columns + k % width;
                [corner, corner + 1, corner + columns, corner + columns + 1].iter().all(|c| high(*c))
            })
            .count();
        // (Nothing of the pad is as near.)
        let parts = covers.parts(|_| [1.0 / (camera.origin.z - 1.0); SAMPLES]);
        let covered = whole as f32 + parts.iter().map(|p| p[1]).sum::<f32>();
        // The camera looks straight down, so the lamp's picture is as large as it is near.
        let edge = 2.0 * half / (2.0 * camera.tan_half_x * (camera.origin.z - center.z)) * width as f32;
        assert!((covered / (edge * edge) - 1.0).abs() < 0.003, "{covered} of {}", edge * edge);
        assert!(parts.iter().any(|part| part[1] < 0.9), "no pixel is covered in part");
    }
}
