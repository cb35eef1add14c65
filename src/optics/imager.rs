//! Surface in, picture and depth map out: a sensor made ready for many captures.
//!
//! What does not change between captures is done once: the untouched picture, from which texture mode
//! `ratio` and the automatic exposure follow. Pictures of one imager share their random numbers, so the noise of
//! the ratio vanishes where nothing moved.

mod engine;
mod notice;

use super::basis_folder::Contents;
use super::judge::{Judge, Judged};
use super::ratio::Worn;
use super::reuse::{Basis, Reuse, Seen};
use super::sensor::{SensorOptics, TextureMode};
use super::sensor_basis::SensorCamera;
use super::sensor_scene::{face, scene};
use super::store::Store;
use super::surface::DisplacedSurface;
use super::{Error, Film, Role, Scene, Texture, imaging, markers, reference, response};
use engine::Engine;
pub use engine::{FALLBACK_SAMPLES, Method};
use glam::{Vec2, Vec3};
pub use notice::Notice;
use notice::clipped;
use std::sync::Arc;
use std::time::Instant;

/// An 8-bit image of the untouched sensor.
#[derive(Debug, Clone, Copy)]
pub struct Background<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` code values, row 0 on top.
    pub rgb: &'a [u8],
}

/// A sensor ready to be seen.
#[derive(Debug, Clone)]
pub struct Imager {
    sensor: SensorOptics,
    engine: Engine,
    /// relRMSE asked for, of whatever renders.
    tolerance: Option<f64>,
    background: Option<Texture>,
    /// What is on the coating.
    albedo: Option<Arc<Texture>>,
    /// Light on the untouched sensor under the lens's blur, and where each pixel sees the face.
    untouched: Film,
    untouched_uv: Vec<Option<Vec2>>,
    exposure: f32,
    notices: Vec<Notice>,
    /// Whether pictures are made of one a light.
    is_light_by_light: bool,
    /// Pictures of pads that may not have moved since.
    reuse: Arc<Reuse>,
}

/// What an imager makes of one surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Code values, row 0 on top.
    pub rgb: Vec<u8>,
    /// The rendered light before image formation.
    pub light: Film,
    /// One picture a light, of which that is the sum, where [asked for](Imager::light_by_light).
    pub basis: Option<Contents>,
    /// Pad-frame height of what each pixel's centre sees, mm, row 0 on top; NaN where it sees no pad.
    pub depth_mm: Vec<f32>,
    /// relRMSE to expect of the light, of the reference mode its noise; a single sample a pixel tells none.
    pub estimated_error: Option<f64>,
    /// Whether that is within the tolerance asked for; None where none was.
    pub meets_tolerance: Option<bool>,
    /// How its light was truly rendered.
    pub method: Method,
    /// Set when the error is above what was asked for, or the picture was left to the reference mode.
    pub notice: Option<Notice>,
    /// Seconds for mesh and tree.
    pub build_s: f64,
    /// Seconds for rendering and image formation.
    pub render_s: f64,
}

impl Imager {
    /// Renders the untouched face once. `background` is the image of the untouched sensor; without it, textures
    /// are left out and the picture is the coating's.
    ///
    /// # Errors
    /// When the sensor or the face cannot be rendered, or the background is cut short.
    pub fn new(
        sensor: &SensorOptics,
        method: impl Into<Method>,
        background: Option<Background<'_>>,
        untouched: &DisplacedSurface,
    ) -> Result<Self, Error> {
        Self::with_store(sensor, method, background, untouched, None)
    }

    /// The same, with a folder in which the fast mode keeps what it prepares.
    ///
    /// # Errors
    /// As [`Imager::new`].
    pub fn with_store(
        sensor: &SensorOptics,
        method: impl Into<Method>,
        background: Option<Background<'_>>,
        untouched: &DisplacedSurface,
        store: Option<&Store>,
    ) -> Result<Self, Error> {
        if let Some(b) = background.filter(|b| b.rgb.len() != b.width * b.height * 3 || b.rgb.is_empty()) {
            return Err(Error::Setting {
                key: "texture",
                value: format!("{} code values for {} x {} pixels", b.rgb.len(), b.width, b.height),
                why: "the image of the untouched sensor is cut short; take it again".to_owned(),
            });
        }
        let clipped = background.as_ref().and_then(clipped);
        let background = background.map(|b| {
            let light = |code: &u8| response::decode(*code, &sensor.image);
            let texels = b.rgb.chunks_exact(3).map(|p| Vec3::new(light(&p[0]), light(&p[1]), light(&p[2])));
            Texture { width: b.width, height: b.height, texels: texels.collect() }
        });
        let albedo = match (&background, sensor.texture) {
            (Some(background), TextureMode::Lit) => Some(background.clone()),
            // The markers are in the image, and ride on it.
            (Some(_), TextureMode::Ratio) => None,
            _ => markers::printed(sensor),
        };
        let method = method.into();
        let mut imager = Self {
            sensor: sensor.clone(),
            tolerance: method.tolerance(),
            albedo: albedo.map(Arc::new),
            engine: Engine::Reference(reference::Settings::default()),
            background,
            untouched: Film::new(0, 0),
            untouched_uv: Vec::new(),
            exposure: 1.0,
            notices: clipped.into_iter().collect(),
            is_light_by_light: false,
            reuse: Arc::default(),
        };
        let rest = imager.scene(&untouched.at_rest())?;
        let (engine, fell_back) = Engine::prepare(method, sensor, &rest, store)?;
        imager.engine = engine;
        if let Method::Fast { tolerance, .. } = imager.method() {
            imager.notices.extend(Notice::of_tolerance(tolerance));
        }
        if rest.lights.iter().all(|light| light.radiance == Vec3::ZERO) {
            imager.notices.push(Notice::Dark);
        }
        let seen = imager.seen(&rest)?.0;
        if let (Some(why), Method::Reference(settings)) = (fell_back, imager.method()) {
            let noise = seen.estimated_error;
            imager.notices.push(Notice::FellBack { why, samples: settings.samples, noise });
        }
        imager.untouched = imaging::blurred(&seen.light, &sensor.image).into_owned();
        imager.untouched_uv = seen.sights.iter().map(|s| s.map(|s| s.uv)).collect();
        let image_mean = imager.background.as_ref().map(|b| b.mean().element_sum() / 3.0);
        imager.exposure = imaging::exposure(&sensor.image, &seen.light, image_mean);
        Ok(imager)
    }

    /// From now on a picture is made of one a light, which it brings along: it takes up to half as long again. (Untouched, the
    /// reference mode then has noise of its own against the picture before, up to one code of a worn image.)
    pub fn light_by_light(mut self) -> Self {
        self.is_light_by_light = true;
        // What is kept was made otherwise.
        self.reuse = Arc::default();
        self
    }

    /// How light is truly rendered: after a fall back that is not what was asked for.
    pub fn method(&self) -> Method {
        self.engine.method()
    }

    /// What holds for all pictures.
    pub fn notices(&self) -> &[Notice] {
        &self.notices
    }

    /// The picture of a face. `index` numbers the capture, for the camera's noise (a picture that is made of the
    /// untouched image has that one's).
    ///
    /// # Errors
    /// When the face is no lattice or has positions that are not finite.
    pub fn picture(&self, surface: &DisplacedSurface, index: u32) -> Result<Picture, Error> {
        let start = Instant::now();
        let scene = self.scene(surface)?;
        let (seen, made_ready) = self.seen(&scene)?;
        let made_ready = made_ready.unwrap_or_else(Instant::now);
        let build_s = made_ready.duration_since(start).as_secs_f64();
        let Seen { light, basis, estimated_error, sights, not_fast } = &*seen;
        let estimated_error = *estimated_error;
        let rgb = match (&self.background, self.sensor.texture) {
            (Some(background), TextureMode::Ratio) => {
                let worn = Worn { image: background, light: &self.untouched, uv: &self.untouched_uv };
                // The image has been through the camera, and brings its blur and noise along: none is added to it. What
                // a press does to the light comes through the same lens.
                let light = imaging::blurred(light, &self.sensor.image);
                response::encode(&worn.relit(&light, sights), &self.sensor.image)
            }
            _ => imaging::expose(light, &self.sensor.image, self.exposure, index),
        };
        let depth_mm = sights.iter().map(|s| s.map_or(f32::NAN, |s| s.point.z)).collect();
        let (method, notice) = match (self.method(), not_fast, estimated_error) {
            (Method::Fast { fallback, .. }, Some(why), _) => {
                let (why, samples) = (why.clone(), fallback.samples);
                let notice = Notice::PictureFellBack { why, samples, noise: estimated_error };
                (Method::Reference(fallback), Some(notice))
            }
            (method @ Method::Fast { tolerance, .. }, None, Some(estimated)) => {
                (method, Notice::of_error(estimated, tolerance))
            }
            (method, ..) => (method, None),
        };
        let meets_tolerance = estimated_error.zip(self.tolerance).map(|(error, asked)| error <= asked);
        let basis = basis.as_ref().map(|Basis { films, errors }| Contents {
            basis: films.clone(),
            radiances: scene.lights.iter().map(|l| l.radiance).collect(),
            errors: errors.clone(),
            error_of_sum: estimated_error,
            camera: Some(self.camera()),
        });
        let render_s = made_ready.elapsed().as_secs_f64();
        let light = light.clone();
        Ok(Picture {
            rgb,
            light,
            basis,
            depth_mm,
            estimated_error,
            meets_tolerance,
            method,
            notice,
            build_s,
            render_s,
        })
    }

    /// How far the light of that picture is from two of the reference mode, of so many samples a pixel each. (It is not rendered again
    /// if it was the last.)
    ///
    /// # Errors
    /// As [`Imager::picture`].
    pub fn judged(&self, surface: &DisplacedSurface, samples: u32) -> Result<Judged, Error> {
        let scene = self.scene(surface)?;
        let (seen, _) = self.seen(&scene)?;
        let (Method::Reference(own) | Method::Fast { fallback: own, .. }) = self.method();
        Ok(Judge::apart_from(own.seed, &scene, samples)?.judged(&seen.light))
    }

    /// How the camera forms pictures of light, for whoever changes that afterwards.
    fn camera(&self) -> SensorCamera {
        SensorCamera::exposed(&self.sensor, self.exposure, self.untouched.width)
    }

    fn scene(&self, surface: &DisplacedSurface) -> Result<Scene, Error> {
        scene(&self.sensor, &face(&self.sensor, surface), self.albedo.as_ref())
    }

    /// The light on a pad and what pixels see of it, and when the pad was ready to be rendered; None where it has not moved
    /// and was not rendered again.
    fn seen(&self, scene: &Scene) -> Result<(Arc<Seen>, Option<Instant>), Error> {
        let mut ready = None;
        let mut render = || {
            let renderer = self.engine.ready(scene, self.is_light_by_light)?;
            ready = Some(Instant::now());
            Ok(renderer.seen())
        };
        let seen = match scene.surface(Role::Pad) {
            Some(pad) => self.reuse.or_render(&pad.mesh, render)?,
            None => Arc::new(render()?),
        };
        Ok((seen, ready))
    }
}

/// Pad-frame height of the face on the camera's pixel grid, mm, row 0 on top; NaN where a pixel sees no pad.
///
/// # Errors
/// When the face is no lattice or has positions that are not finite.
pub fn depth_map(sensor: &SensorOptics, surface: &DisplacedSurface) -> Result<Vec<f32>, Error> {
    let renderer = reference::Renderer::new(&scene(sensor, surface, None)?)?;
    Ok(renderer.sights().iter().map(|s| s.map_or(f32::NAN, |s| s.point.z)).collect())
}

#[cfg(test)]
mod tests;
