//! Renders a scene file, or a sensor untouched, with times: what the command `render` does, without its printing.

use super::basis::BasisError;
use super::bench_scene::{self, Variant};
use super::store::Store;
use super::{
    DisplacedSurface, Error, Film, LightBasis, Role, Scene, SensorOptics, fast, markers, reference,
    sensor_scene,
};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Which renderer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Path tracing, unbiased: [`reference`].
    Reference,
    /// Not unbiased, its error stated against `reference`.
    Fast,
}

/// What to render.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Variant of a scene file.
    pub variant: Variant,
    /// Renderer.
    pub mode: Mode,
    /// Samples a pixel (reference mode).
    pub samples: u32,
    /// relRMSE asked for (fast mode).
    pub tolerance: f64,
    /// Raster; absent: the scene's. The mesh never changes with it.
    pub size: Option<[usize; 2]>,
    /// How often the frame is rendered, at least once.
    pub repeat: u32,
    /// Seed of the random numbers.
    pub seed: u32,
    /// Whether to render one picture a light; the picture is then made of them.
    pub basis: bool,
    /// Where the fast mode keeps what it prepares.
    pub store: Option<Store>,
}

/// How long it took, seconds of wall time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Times {
    /// Mode that rendered.
    pub mode: Mode,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Samples a pixel; the fast mode has a tolerance instead.
    pub samples: Option<u32>,
    /// Reading the scene and everything a sensor needs once.
    pub one_off_s: f64,
    /// Each frame, with every structure that a changed pad would need anew.
    pub per_frame_s: Vec<f64>,
    /// The shortest of them.
    pub best_frame_s: f64,
    /// The part of a frame that makes the changed pad ready (its tree, its heights), at best; more samples do not
    /// lengthen it.
    pub best_structure_s: f64,
    /// The part that works out light, at best.
    pub best_light_s: f64,
    /// From one picture a light to the picture in the scene's colours, at best (with a basis).
    pub best_recolour_s: Option<f64>,
    /// Whether the picture is black: no light of the scene shines, or none of it comes back.
    pub is_dark: bool,
    /// The scene's lights, linear.
    #[serde(skip)]
    pub radiances: Vec<Vec3>,
    /// Whether what is needed once was there from an earlier run.
    pub prepared_before: bool,
    /// relRMSE to expect of the picture, of the reference mode its noise; with a basis of the sum of its pictures.
    pub estimated_error: Option<f64>,
    /// Whether that is within the tolerance asked for (fast mode).
    pub meets_tolerance: Option<bool>,
    /// relRMSE to expect of each picture of a basis, by light.
    pub basis_errors: Option<Vec<f64>>,
}

/// What was rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// The picture.
    pub picture: Film,
    /// One picture a light of radiance 1, where asked for.
    pub basis: Option<LightBasis>,
    /// How long it took.
    pub times: Times,
}

/// Renders the frame `repeat` times and returns the last picture.
///
/// # Errors
/// When the file is no scene, a part of it cannot be rendered, or not in this mode.
pub fn render_file(path: &Path, request: &Request) -> Result<Rendered, Error> {
    // On a thread of the pool: from any other, every parallel loop would wait for one to wake.
    rayon::scope(|_| render_on_pool(|| bench_scene::load(path, request.variant), untouched, request))
}

/// The same of a sensor: `face` is that of its pad untouched. Its coating shows with what is printed on it; an image of the
/// untouched sensor is not worn, which holds the lights already.
///
/// # Errors
/// When a part of the sensor cannot be rendered, or not in this mode.
pub fn render_sensor(
    sensor: &SensorOptics,
    face: &DisplacedSurface,
    request: &Request,
) -> Result<Rendered, Error> {
    if let (Mode::Fast, Some(why)) = (request.mode, sensor_scene::not_fast(sensor)) {
        return Err(why);
    }
    let load = || {
        let albedo = markers::printed(sensor).map(Arc::new);
        sensor_scene::scene(sensor, &sensor_scene::face(sensor, face), albedo.as_ref())
    };
    rayon::scope(|_| render_on_pool(load, Scene::clone, request))
}

/// `untouched` gives the scene before the press.
fn render_on_pool(
    load: impl FnOnce() -> Result<Scene, Error>,
    untouched: fn(&Scene) -> Scene,
    request: &Request,
) -> Result<Rendered, Error> {
    let start = Instant::now();
    let mut scene = load()?;
    if request.basis && scene.lights.is_empty() {
        return Err(Error::Argument {
            name: "--basis",
            value: "one picture a light".to_owned(),
            why: "the scene has no light; leave it out, or give the scene a light".to_owned(),
        });
    }
    if let Some([width, height]) = request.size {
        scene.camera = scene.camera.with_raster(width, height);
        scene.check()?;
    }
    let once = match request.mode {
        Mode::Reference => None,
        Mode::Fast => Some(match &request.store {
            Some(store) => store.prepare(&untouched(&scene))?,
            None => (fast::Precomputed::new(&untouched(&scene))?, false),
        }),
    };
    let prepared_before = once.as_ref().is_some_and(|(_, before)| *before);
    let one_off_s = start.elapsed().as_secs_f64();
    let settings = reference::Settings { samples: request.samples, seed: request.seed };
    let radiances: Vec<Vec3> = scene.lights.iter().map(|l| l.radiance).collect();
    // Paths do not depend on colours, but on which lights shine: a basis is rendered of white ones.
    let traced = if request.basis && once.is_none() { scene.in_white_light() } else { scene.clone() };
    let (mut per_frame_s, mut best) = (Vec::new(), [f64::INFINITY; 3]);
    let (mut picture, mut basis) = (Film::new(0, 0), None);
    let (mut estimated_error, mut basis_errors) = (None, None);
    let shorter = |best: &mut f64, start: Instant| *best = best.min(start.elapsed().as_secs_f64());
    for _ in 0..request.repeat.max(1) {
        let start = Instant::now();
        match &once {
            None => {
                let renderer = reference::Renderer::new(&traced)?;
                shorter(&mut best[0], start);
                let start = Instant::now();
                match request.basis {
                    true => {
                        let (films, noise) = renderer.basis_with_noise(&settings, &radiances);
                        basis = Some(films);
                        (basis_errors, estimated_error) =
                            noise.map(|noise| (noise.lights, noise.together)).unzip();
                    }
                    false => (picture, estimated_error) = renderer.render_with_noise(&settings),
                }
                shorter(&mut best[1], start);
            }
            Some((once, _)) => {
                let renderer = fast::Renderer::new(once, &scene, request.tolerance)?;
                shorter(&mut best[0], start);
                let start = Instant::now();
                match request.basis {
                    true => {
                        let (films, BasisError { lights, together }) = renderer.basis_with_error();
                        (basis, estimated_error, basis_errors) = (Some(films), Some(together), Some(lights));
                    }
                    false => {
                        let (film, error) = renderer.render_with_error();
                        (picture, estimated_error) = (film, Some(error));
                    }
                }
                shorter(&mut best[1], start);
            }
        }
        per_frame_s.push(start.elapsed().as_secs_f64());
        if let Some(basis) = &basis {
            let start = Instant::now();
            picture = basis.combine(&radiances);
            shorter(&mut best[2], start);
        }
    }
    let best_frame_s = per_frame_s.iter().copied().fold(f64::INFINITY, f64::min);
    let size = [picture.width, picture.height];
    let times = Times {
        mode: request.mode,
        size,
        samples: (request.mode == Mode::Reference).then_some(request.samples),
        one_off_s,
        per_frame_s,
        best_frame_s,
        best_structure_s: best[0],
        best_light_s: best[1],
        best_recolour_s: basis.as_ref().map(|_| best[2]),
        is_dark: picture.pixels.iter().all(|pixel| *pixel == Vec3::ZERO),
        radiances,
        prepared_before,
        estimated_error,
        meets_tolerance: estimated_error.filter(|_| once.is_some()).map(|error| error <= request.tolerance),
        basis_errors,
    };
    Ok(Rendered { picture, basis, times })
}

/// The scene before the press: the format's pads are flat at height 0.
fn untouched(scene: &Scene) -> Scene {
    let mut flat = scene.clone();
    for pad in flat.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        Arc::make_mut(&mut pad.mesh).positions.iter_mut().for_each(|p| p.z = 0.0);
    }
    flat
}
