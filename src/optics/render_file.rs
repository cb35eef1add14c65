//! Renders a scene file, with times: what the command `render` does, without its printing.

use super::bench_scene::{self, Variant};
use super::store::Store;
use super::{Error, Film, Role, Scene, fast, reference};
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
    /// Variant of the scene.
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
    /// Samples a pixel.
    pub samples: u32,
    /// Reading the scene and everything a sensor needs once.
    pub one_off_s: f64,
    /// Each frame, with every structure that a changed pad would need anew.
    pub per_frame_s: Vec<f64>,
    /// The shortest of them.
    pub best_frame_s: f64,
    /// Whether what is needed once was there from an earlier run.
    pub prepared_before: bool,
    /// relRMSE to expect (fast mode).
    pub estimated_error: Option<f64>,
}

/// Renders the frame `repeat` times and returns the last picture.
///
/// # Errors
/// When the file is no scene, a part of it cannot be rendered, or not in this mode.
pub fn render_file(path: &Path, request: &Request) -> Result<(Film, Times), Error> {
    let start = Instant::now();
    let mut scene = bench_scene::load(path, request.variant)?;
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
    let mut per_frame_s = Vec::new();
    let (mut picture, mut estimated_error) = (Film::new(0, 0), None);
    for _ in 0..request.repeat.max(1) {
        let start = Instant::now();
        (picture, estimated_error) = match &once {
            None => (reference::Renderer::new(&scene)?.render(&settings), None),
            Some((once, _)) => {
                let (film, error) = fast::Renderer::new(once, &scene, request.tolerance)?.render_with_error();
                (film, Some(error))
            }
        };
        per_frame_s.push(start.elapsed().as_secs_f64());
    }
    let best_frame_s = per_frame_s.iter().copied().fold(f64::INFINITY, f64::min);
    let size = [picture.width, picture.height];
    let times = Times {
        mode: request.mode,
        size,
        samples: request.samples,
        one_off_s,
        per_frame_s,
        best_frame_s,
        prepared_before,
        estimated_error,
    };
    Ok((picture, times))
}

/// The scene before the press: the format's pads are flat at height 0.
fn untouched(scene: &Scene) -> Scene {
    let mut flat = scene.clone();
    for pad in flat.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        Arc::make_mut(&mut pad.mesh).positions.iter_mut().for_each(|p| p.z = 0.0);
    }
    flat
}
