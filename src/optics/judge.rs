//! How far a picture is from the truth.
//!
//! The truth is two reference pictures of different seeds, A and B. Their noise is independent, so the mean of (F - A)(F - B)
//! over the pixels is an unbiased estimate of the mean square of F - truth, however noisy A and B are: short references judge
//! small errors. What is left of their noise is told by [`Judge::floor`].

use super::{Error, Film, Scene, reference};

/// What was found of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// relRMSE against the truth, the judges' noise taken off.
    pub error: f64,
    /// Below this the judges cannot tell.
    pub floor: f64,
}

impl Judged {
    /// Whether that is what the picture states of itself, as far as the judges can tell: an estimate is no bound.
    pub fn agrees_with(self, stated: f64) -> bool {
        self.error <= HONEST.0 * stated + HONEST.1 + self.floor
    }
}

/// Errors may exceed the estimate by this factor, and by this much, before it is called dishonest.
const HONEST: (f64, f64) = (1.15, 0.0005);

/// Seeds of the judges, and one in place of that which a picture has.
const SEEDS: [u32; 2] = [0xa, 0xb];
const SPARE: u32 = 0xc;

/// Two reference pictures.
#[derive(Debug, Clone)]
pub struct Judge {
    pictures: [Film; 2],
}

impl Judge {
    /// Renders them, so many samples a pixel each.
    ///
    /// # Errors
    /// When the scene cannot be rendered.
    pub fn new(scene: &Scene, samples: u32) -> Result<Self, Error> {
        Self::of_seeds(scene, samples, SEEDS)
    }

    /// Those that share no random numbers with a picture of that seed: their noise must be independent of its own.
    ///
    /// # Errors
    /// As [`Judge::new`].
    pub fn apart_from(seed: u32, scene: &Scene, samples: u32) -> Result<Self, Error> {
        Self::of_seeds(scene, samples, SEEDS.map(|own| if own == seed { SPARE } else { own }))
    }

    fn of_seeds(scene: &Scene, samples: u32, seeds: [u32; 2]) -> Result<Self, Error> {
        let renderer = reference::Renderer::new(scene)?;
        let picture = |seed| renderer.render(&reference::Settings { samples, seed });
        Ok(Self { pictures: seeds.map(picture) })
    }

    /// Who judges pictures shrunk to the means of squares of `grain` pixels.
    pub fn of_means(&self, grain: usize) -> Self {
        Self { pictures: self.pictures.each_ref().map(|picture| picture.shrunk(grain)) }
    }

    /// What they find of a picture.
    pub fn judged(&self, film: &Film) -> Judged {
        Judged { error: self.error(film), floor: self.floor() }
    }

    /// relRMSE of a picture, the judges' own noise taken off.
    pub fn error(&self, film: &Film) -> f64 {
        let [a, b] = &self.pictures;
        let product: f64 = film
            .pixels
            .iter()
            .zip(a.pixels.iter().zip(&b.pixels))
            .map(|(f, (a, b))| (*f - *a).as_dvec3().dot((*f - *b).as_dvec3()))
            .sum();
        (product / self.numbers()).max(0.0).sqrt() / self.mean()
    }

    /// Errors below this drown in the judges' noise (two standard errors of the mean square). Noise is not even: where a few
    /// pixels have most of it, at the mirrored edge of a lamp, little of it averages out.
    pub fn floor(&self) -> f64 {
        let [a, b] = &self.pictures;
        // The three colours of a pixel share their paths, so that the square of what they have together, of normal noise, has
        // three times the square of its mean, which is twice that of either judge.
        let fourths =
            a.pixels.iter().zip(&b.pixels).map(|(a, b)| (*a - *b).as_dvec3().length_squared().powi(2));
        let standard_error = (fourths.sum::<f64>() / 12.0).sqrt() / self.numbers();
        (2.0 * standard_error).sqrt() / self.mean()
    }

    /// relRMSE of one of them.
    pub fn noise(&self) -> f64 {
        let [a, b] = &self.pictures;
        let square: f64 =
            a.pixels.iter().zip(&b.pixels).map(|(a, b)| (*a - *b).as_dvec3().length_squared()).sum();
        (0.5 * square / self.numbers()).sqrt() / self.mean()
    }

    fn numbers(&self) -> f64 {
        (self.pictures[0].pixels.len() * 3) as f64
    }

    fn mean(&self) -> f64 {
        let sum = |film: &Film| f64::from(film.mean().element_sum()) / 3.0;
        (0.5 * (sum(&self.pictures[0]) + sum(&self.pictures[1]))).max(1e-30)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn two_noisy_judges_find_a_small_error_and_none_where_there_is_none() {
        let n = 40_000;
        let noise = |seed: u32, k: usize| super::super::noise::normal(seed, k as u32) as f32;
        let film = |f: &dyn Fn(usize) -> f32| Film {
            width: 200,
            height: 200,
            pixels: (0..n).map(|k| Vec3::splat(f(k))).collect(),
        };
        let judge = Judge { pictures: [1, 2].map(|seed| film(&|k| 1.0 + 0.05 * noise(seed, k))) };
        assert!(judge.error(&film(&|_| 1.0)) < judge.floor());
        let off = film(&|k| if k % 2 == 0 { 1.01 } else { 0.99 });
        assert!((judge.error(&off) - 0.01).abs() < 2e-3, "{} {}", judge.error(&off), judge.floor());
        assert!((judge.noise() - 0.05).abs() < 2e-3);
        // Even noise leaves 0.05 (4 / 40 000)^(1/4); as much in one of a hundred pixels leaves the root of ten times that.
        assert!((judge.floor() / 0.005 - 1.0).abs() < 0.05, "{}", judge.floor());
        let rare = |seed, k: usize| if k.is_multiple_of(100) { 1.0 + 0.5 * noise(seed, k) } else { 1.0 };
        let judge = Judge { pictures: [1, 2].map(|seed| film(&|k| rare(seed, k))) };
        assert!((judge.noise() - 0.05).abs() < 5e-3);
        assert!((judge.floor() / 0.0158 - 1.0).abs() < 0.15, "{}", judge.floor());
    }

    #[test]
    fn no_picture_is_judged_by_itself() {
        use crate::optics::bench_scene::{Variant, parse};
        let mut scene = parse(crate::optics::trial::SCENE, Variant::Ac).unwrap();
        scene.camera = scene.camera.with_raster(16, 12);
        let renderer = reference::Renderer::new(&scene).unwrap();
        for seed in SEEDS {
            let own = renderer.render(&reference::Settings { samples: 4, seed });
            let judge = Judge::apart_from(seed, &scene, 4).unwrap();
            assert_eq!(Judge::new(&scene, 4).unwrap().error(&own), 0.0);
            assert!(judge.error(&own) > 0.3 * judge.noise(), "{} {}", judge.error(&own), judge.noise());
        }
    }
}
