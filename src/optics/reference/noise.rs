//! What noise is left in a path-traced picture, told by the picture itself.
//!
//! The first and the second half of a pixel's samples are stratified each, and scrambled independently of its neighbours'; by how much
//! the two differ follows how far their mean may be off. Taken for independent they state a little more than there is: the whole is
//! stratified, too. (See the tests.)

use crate::optics::basis::BasisError;
use crate::optics::{Film, LightBasis};
use glam::{DVec3, Vec3};

/// A picture with what its two halves say of it.
#[derive(Debug, Clone)]
pub(super) struct Traced {
    /// The mean over all samples.
    pub picture: Film,
    /// By how much the mean of the first half of them is above that of the second.
    pub difference: Film,
}

/// How many of `samples` are in the first half.
pub(super) fn first_half(samples: u32) -> u32 {
    samples / 2
}

impl Traced {
    pub fn new(width: usize, height: usize) -> Self {
        Self { picture: Film::new(width, height), difference: Film::new(width, height) }
    }

    /// Puts a pixel's sums over the two halves of so many samples.
    pub fn put(&mut self, pixel: usize, [first, second]: [DVec3; 2], samples: u32) {
        let of_first = first_half(samples);
        let mean = |sum: DVec3, n: u32| if n > 0 { sum / f64::from(n) } else { DVec3::ZERO };
        self.picture.pixels[pixel] = mean(first + second, samples).as_vec3();
        self.difference.pixels[pixel] = (mean(first, of_first) - mean(second, samples - of_first)).as_vec3();
    }
}

/// relRMSE to expect of a mean of so many samples, whose halves differ by that; a single sample tells none.
pub(super) fn noise(picture: &Film, difference: &Film, samples: u32) -> Option<f64> {
    let (n, of_first) = (f64::from(samples), f64::from(first_half(samples)));
    let squares = difference.pixels.iter().map(|d| d.as_dvec3().length_squared()).sum::<f64>();
    let of_difference = (squares / (3 * difference.pixels.len().max(1)) as f64).sqrt();
    // Of independent samples the difference has n^2 / (n1 n2) times the variance of the mean.
    let of_mean = of_difference * (of_first * (n - of_first)).sqrt() / n;
    let light = f64::from(picture.mean().element_sum()) / 3.0;
    let relative = if of_mean == 0.0 { 0.0 } else { of_mean / light };
    (samples > 1).then_some(relative)
}

/// The same of pictures of lights of radiance 1, and of their sum in these radiances.
pub(super) fn noise_of_basis(
    pictures: &LightBasis,
    differences: Vec<Film>,
    radiances: &[Vec3],
    samples: u32,
) -> Option<BasisError> {
    let lights = pictures.films.iter().zip(&differences).map(|(p, d)| noise(p, d, samples));
    let lights = lights.collect::<Option<Vec<f64>>>()?;
    let differences = LightBasis { names: pictures.names.clone(), films: differences };
    let together = noise(&pictures.combine(radiances), &differences.combine(radiances), samples)?;
    Some(BasisError { lights, together })
}

#[cfg(test)]
mod tests {
    use super::super::{Renderer, Settings};
    use crate::optics::Scene;
    use crate::optics::bench_scene::{self, Variant};
    use glam::Vec3;

    fn scene(variant: Variant, [width, height]: [usize; 2]) -> Scene {
        let file = include_str!("../../../tests/data/optics/tactile-bench-1.json");
        let mut scene = bench_scene::parse(file, variant).unwrap();
        scene.camera = scene.camera.with_raster(width, height);
        scene
    }

    #[test]
    fn the_noise_stated_is_that_which_another_seed_shows_or_a_little_more() {
        for (variant, samples) in [(Variant::Ac, 16), (Variant::Ac, 64), (Variant::Ac, 7), (Variant::B, 16)] {
            let renderer = Renderer::new(&scene(variant, [64, 48])).unwrap();
            let [(a, stated), (b, _)] =
                [1, 2].map(|seed| renderer.render_with_noise(&Settings { samples, seed }));
            let (stated, shown) = (stated.unwrap(), a.relative_rmse(&b) / 2f64.sqrt());
            assert!((0.95..1.4).contains(&(stated / shown)), "{variant:?} {samples}: {stated} {shown}");
        }
    }

    #[test]
    fn a_single_sample_tells_no_noise_and_a_basis_tells_that_of_its_sum() {
        let scene = scene(Variant::Ac, [32, 24]);
        let radiances: Vec<Vec3> = scene.lights.iter().map(|light| light.radiance).collect();
        let white = Renderer::new(&scene.in_white_light()).unwrap();
        let settings = Settings { samples: 16, seed: 3 };
        let (basis, noise) = white.basis_with_noise(&settings, &radiances);
        let noise = noise.unwrap();
        let (again, _) = white.basis_with_noise(&Settings { seed: 4, ..settings }, &radiances);
        let shown = |a: &super::Film, b: &super::Film| a.relative_rmse(b) / 2f64.sqrt();
        let of_sum = shown(&basis.combine(&radiances), &again.combine(&radiances));
        assert!((0.9..1.6).contains(&(noise.together / of_sum)), "{} {of_sum}", noise.together);
        for ((a, b), stated) in basis.films.iter().zip(&again.films).zip(&noise.lights) {
            assert!((0.9..1.6).contains(&(stated / shown(a, b))), "{stated} {}", shown(a, b));
        }
        let once = Settings { samples: 1, seed: 3 };
        assert_eq!(white.render_with_noise(&once).1, None);
        assert_eq!(white.basis_with_noise(&once, &radiances).1, None);
    }
}
