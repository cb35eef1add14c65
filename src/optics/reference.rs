//! The reference renderer: path tracing, unbiased up to the scene's event limit.
//!
//! It is the judge of every faster method. What it estimates, per pixel: the mean over the pixel's square
//! (and the lens) of the radiance that arrives after 1 to `max_events` scatterings, or directly from a light.
//! How a path is followed stands in [`path`]; here are the scene made ready, the tiles and the film.
//!
//! A picture depends on scene, samples and seed alone: not on threads, not on tiles. Two pictures of the
//! same seed use the same random numbers, so that their ratio is less noisy than either.

mod by_plate;
mod choice;
mod glimpse;
mod noise;
mod path;
mod plate;
mod prepared;

use super::basis::BasisError;
use super::{Error, Film, LightBasis, Scene, bsdf::Lobe, bsdf::refract, sampler::Sampler, to_pad};
use glam::{DVec3, Vec3};
use noise::Traced;
pub use path::Known;
use path::Path;
use prepared::Prepared;
use rayon::prelude::*;

/// What can be chosen about a reference picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Samples a pixel; powers of two are stratified best.
    pub samples: u32,
    /// Seed of the random numbers.
    pub seed: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: 128, seed: 0 }
    }
}

/// A scene ready for rendering.
#[derive(Debug, Clone)]
pub struct Renderer {
    prepared: Prepared,
}

/// A point of the pad's face as a pixel sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The point, pad frame, mm.
    pub point: Vec3,
    /// Its texture coordinate.
    pub uv: glam::Vec2,
}

/// Edge of the tiles that threads take, pixels.
const TILE: usize = 16;

impl Renderer {
    /// Checks the scene and builds the tree over its triangles.
    ///
    /// # Errors
    /// When a part of the scene cannot be rendered.
    pub fn new(scene: &Scene) -> Result<Self, Error> {
        Ok(Self { prepared: Prepared::new(scene)? })
    }

    /// The picture.
    pub fn render(&self, settings: &Settings) -> Film {
        self.render_counting_rays(settings).0
    }

    /// The picture, and how many rays of all kinds it took.
    pub fn render_counting_rays(&self, settings: &Settings) -> (Film, u64) {
        let (mut traced, rays) = self.traced(settings, 1, |_| 0);
        (traced.swap_remove(0).picture, rays)
    }

    /// The picture, and what relRMSE its noise is expected to be; that of a single sample a pixel is not known.
    pub fn render_with_noise(&self, settings: &Settings) -> (Film, Option<f64>) {
        let Traced { picture, difference } = self.traced(settings, 1, |_| 0).0.swap_remove(0);
        let noise = noise::noise(&picture, &difference, settings.samples.max(1));
        (picture, noise)
    }

    /// One picture for each light, in the scene's order; they add up to [`Renderer::render`]. The paths are
    /// followed once, so all of them cost little more than one picture.
    pub fn render_lights(&self, settings: &Settings) -> Vec<Film> {
        self.traced_lights(settings).into_iter().map(|traced| traced.picture).collect()
    }

    /// [`Renderer::render_lights`] with the lights' names, and with the noise of each and of their sum in these radiances. The
    /// scene's lights must be of radiance 1.
    pub fn basis_with_noise(
        &self,
        settings: &Settings,
        radiances: &[Vec3],
    ) -> (LightBasis, Option<BasisError>) {
        let halves = |traced: Traced| (traced.picture, traced.difference);
        let (films, differences) = self.traced_lights(settings).into_iter().map(halves).unzip();
        let basis = LightBasis { names: self.prepared.names.clone(), films };
        let error = noise::noise_of_basis(&basis, differences, radiances, settings.samples.max(1));
        (basis, error)
    }

    /// What bounces to a diffuse pad and on to the camera, without the light that comes straight from lights, where the light that
    /// leaves the pad is `known` already: a path ends there, which leaves far less noise than there is in a picture.
    pub fn bounced(&self, settings: &Settings, known: &Known<'_>) -> Film {
        let paths = || Path::of_bounces(&self.prepared, known);
        self.traced_by(paths, settings, 1, |_| 0).0.swap_remove(0).picture
    }

    fn traced_lights(&self, settings: &Settings) -> Vec<Traced> {
        self.traced(settings, self.prepared.emitters.len(), |light| light).0
    }

    /// What the centre of each pixel sees of the pad's face, row 0 on top: through plates as Snell's law leads
    /// (reflections and frost apart), None where something else is in the way.
    pub fn sights(&self) -> Vec<Option<Sight>> {
        let camera = &self.prepared.camera;
        (0..camera.width * camera.height)
            .into_par_iter()
            .map(|k| {
                let (x, y) = ((k % camera.width) as f32 + 0.5, (k / camera.width) as f32 + 0.5);
                self.sight(camera.ray(x, y, glam::Vec2::ZERO))
            })
            .collect()
    }

    fn sight(&self, (mut origin, mut direction): (Vec3, Vec3)) -> Option<Sight> {
        for _ in 0..self.prepared.max_events {
            let surfel = self.prepared.trace(origin, direction)?;
            if surfel.pad {
                return Some(Sight { point: to_pad(surfel.hit.point), uv: surfel.uv });
            }
            let (Lobe::Dielectric { eta } | Lobe::RoughDielectric { eta, .. }) = surfel.bsdf.lobe else {
                return None;
            };
            direction = refract(-direction, surfel.normal, eta)?;
            origin = surfel.hit.point - surfel.normal * self.prepared.offset;
        }
        None
    }

    /// `films` pictures, the light `k` goes to picture `film_of(k)`; and how many rays they took.
    fn traced(
        &self,
        settings: &Settings,
        films: usize,
        film_of: impl Fn(usize) -> usize + Sync,
    ) -> (Vec<Traced>, u64) {
        self.traced_by(|| Path::new(&self.prepared), settings, films, film_of)
    }

    /// The same along other paths.
    fn traced_by<'a>(
        &'a self,
        paths: impl Fn() -> Path<'a> + Sync,
        settings: &Settings,
        films: usize,
        film_of: impl Fn(usize) -> usize + Sync,
    ) -> (Vec<Traced>, u64) {
        let camera = &self.prepared.camera;
        let (width, height) = (camera.width, camera.height);
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let samples = settings.samples.max(1);
        let tiles: Vec<(Vec<[DVec3; 2]>, u64)> = (0..columns * rows)
            .into_par_iter()
            .map(|tile| {
                let mut path = paths();
                let mut sums = Vec::new();
                for (x, y) in pixels_of(tile, columns, width, height) {
                    let sampler = Sampler::new(settings.seed, x as u32, y as u32, samples);
                    let base = sums.len();
                    sums.resize(base + films, [DVec3::ZERO; 2]);
                    for index in 0..samples {
                        let half = usize::from(index >= noise::first_half(samples));
                        path.follow(&sampler, index, x as f32, y as f32, &mut |light, value| {
                            sums[base + film_of(light)][half] += value.as_dvec3();
                        });
                    }
                }
                (sums, path.rays())
            })
            .collect();
        let mut pictures = vec![Traced::new(width, height); films];
        for (tile, (sums, _)) in tiles.iter().enumerate() {
            for ((x, y), sum) in pixels_of(tile, columns, width, height).zip(sums.chunks_exact(films.max(1)))
            {
                for (picture, halves) in pictures.iter_mut().zip(sum) {
                    picture.put(y * width + x, *halves, samples);
                }
            }
        }
        (pictures, tiles.iter().map(|(_, rays)| rays).sum())
    }
}

/// The pixels of a tile, row by row.
fn pixels_of(
    tile: usize,
    columns: usize,
    width: usize,
    height: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let (x0, y0) = (tile % columns * TILE, tile / columns * TILE);
    (y0..(y0 + TILE).min(height)).flat_map(move |y| (x0..(x0 + TILE).min(width)).map(move |x| (x, y)))
}
