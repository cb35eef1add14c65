//! How an imager's light is rendered: by the method that was asked for, or the one that it is left to.

use crate::optics::reuse::{Basis, Seen};
use crate::optics::sensor::SensorOptics;
use crate::optics::sensor_scene::not_fast;
use crate::optics::store::Store;
use crate::optics::{Error, Scene, fast, reference};
use glam::Vec3;
use std::sync::Arc;

/// How the light is rendered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// Path tracing: [`reference`].
    Reference(reference::Settings),
    /// [`fast`], where the sensor allows it.
    Fast {
        /// relRMSE asked for.
        tolerance: f64,
        /// What path tracing is asked for where the fast mode cannot (at least [`FALLBACK_SAMPLES`]).
        fallback: reference::Settings,
    },
}

impl Method {
    /// Its name in files and records.
    pub fn name(&self) -> &'static str {
        match self {
            Method::Reference(_) => "reference",
            Method::Fast { .. } => "fast",
        }
    }

    /// relRMSE asked for, where that is what is chosen.
    pub fn tolerance(&self) -> Option<f64> {
        match self {
            Method::Reference(_) => None,
            Method::Fast { tolerance, .. } => Some(*tolerance),
        }
    }

    /// Samples a pixel, where that is what is chosen.
    pub fn samples(&self) -> Option<u32> {
        match self {
            Method::Reference(settings) => Some(settings.samples),
            Method::Fast { .. } => None,
        }
    }
}

impl From<reference::Settings> for Method {
    fn from(settings: reference::Settings) -> Self {
        Method::Reference(settings)
    }
}

/// Fewest samples a pixel where the fast mode falls back: who asked for a small error gets no picture of noise.
pub const FALLBACK_SAMPLES: u32 = 64;

/// A method with what it needs once.
#[derive(Debug, Clone)]
pub(super) enum Engine {
    Reference(reference::Settings),
    Fast { once: Arc<fast::Precomputed>, tolerance: f64, fallback: reference::Settings },
}

impl Engine {
    /// Makes a method ready for a sensor whose untouched face is at `rest`, and tells why where another one has to do.
    ///
    /// # Errors
    /// When the scene cannot be rendered by any.
    pub fn prepare(
        method: Method,
        sensor: &SensorOptics,
        rest: &Scene,
        store: Option<&Store>,
    ) -> Result<(Self, Option<String>), Error> {
        let (tolerance, fallback) = match method {
            Method::Reference(settings) => return Ok((Engine::Reference(settings), None)),
            Method::Fast { tolerance, fallback } => (tolerance, fallback),
        };
        let samples = fallback.samples.max(FALLBACK_SAMPLES);
        let fallback = reference::Settings { samples, ..fallback };
        let prepared = match (not_fast(sensor), store) {
            (Some(why), _) => Err(why),
            (None, Some(store)) => store.prepare(rest).map(|(once, _)| once),
            (None, None) => fast::Precomputed::new(rest),
        };
        match prepared {
            Ok(once) => Ok((Engine::Fast { once: Arc::new(once), tolerance, fallback }, None)),
            Err(why @ Error::NotFast { .. }) => Ok((Engine::Reference(fallback), Some(why.to_string()))),
            Err(e) => Err(e),
        }
    }

    /// The renderer of a scene, for one picture a light where that `is_light_by_light`. One pad that the fast mode cannot render
    /// is left to the reference mode: it is no reason to lose those that come after it.
    ///
    /// # Errors
    /// When the scene cannot be rendered.
    pub fn ready(&self, scene: &Scene, is_light_by_light: bool) -> Result<Ready<'_>, Error> {
        // (Without a light there is nothing to add up.)
        let is_light_by_light = is_light_by_light && !scene.lights.is_empty();
        let radiances = is_light_by_light.then(|| scene.lights.iter().map(|l| l.radiance).collect());
        let ready = |renderer, not_fast| Ready { renderer, not_fast, radiances };
        let traced = |settings: &reference::Settings| {
            // (Paths do not depend on colours, but on which lights shine.)
            let white = is_light_by_light.then(|| scene.in_white_light());
            let renderer = reference::Renderer::new(white.as_ref().unwrap_or(scene))?;
            Ok::<_, Error>(Renderer::Reference(Box::new(renderer), *settings))
        };
        match self {
            Engine::Reference(settings) => Ok(ready(traced(settings)?, None)),
            Engine::Fast { once, tolerance, fallback } => {
                match fast::Renderer::new(once, scene, *tolerance) {
                    Ok(renderer) => Ok(ready(Renderer::Fast(Box::new(renderer)), None)),
                    Err(why @ Error::NotFast { .. }) => Ok(ready(traced(fallback)?, Some(why.to_string()))),
                    Err(e) => Err(e),
                }
            }
        }
    }

    /// What it renders by.
    pub fn method(&self) -> Method {
        match self {
            Engine::Reference(settings) => Method::Reference(*settings),
            Engine::Fast { tolerance, fallback, .. } => {
                Method::Fast { tolerance: *tolerance, fallback: *fallback }
            }
        }
    }
}

/// A renderer of one pad.
pub(super) struct Ready<'a> {
    renderer: Renderer<'a>,
    /// Why it is not the fast one where that was asked for.
    not_fast: Option<String>,
    /// Of the scene's lights, where there is to be a picture of each.
    radiances: Option<Vec<Vec3>>,
}

enum Renderer<'a> {
    Reference(Box<reference::Renderer>, reference::Settings),
    Fast(Box<fast::Renderer<'a>>),
}

impl Ready<'_> {
    /// The light on the pad, what pixels see of it, and what relRMSE to expect: of the reference mode its noise.
    pub fn seen(self) -> Seen {
        let sights = match &self.renderer {
            Renderer::Reference(renderer, _) => renderer.sights(),
            Renderer::Fast(renderer) => renderer.sights(),
        };
        let (light, basis, estimated_error) = match (&self.renderer, &self.radiances) {
            (Renderer::Reference(renderer, settings), None) => {
                let (light, noise) = renderer.render_with_noise(settings);
                (light, None, noise)
            }
            (Renderer::Fast(renderer), None) => {
                let (light, error) = renderer.render_with_error();
                (light, None, Some(error))
            }
            (Renderer::Reference(renderer, settings), Some(radiances)) => {
                let (films, noise) = renderer.basis_with_noise(settings, radiances);
                let (errors, together) = noise.map(|noise| (noise.lights, noise.together)).unzip();
                (films.combine(radiances), Some(Basis { films, errors }), together)
            }
            (Renderer::Fast(renderer), Some(radiances)) => {
                let (films, error) = renderer.basis_with_error();
                let basis = Basis { films, errors: Some(error.lights) };
                (basis.films.combine(radiances), Some(basis), Some(error.together))
            }
        };
        Seen { light, basis, estimated_error, sights, not_fast: self.not_fast }
    }
}
