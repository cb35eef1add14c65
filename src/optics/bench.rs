//! Error against run time of both modes, and what leaving out saves.
//!
//! Every error is taken against two reference pictures ([`Judge`]), so it holds down to their floor. Times are the
//! shortest of a few repeats, processor seconds beside wall seconds: the caller lends the processor's clock. A frame's time is
//! with everything that a changed pad needs anew; what a sensor needs once is told apart.

pub mod cases;
pub mod features;

use super::bench_scene::Variant;
use super::judge::Judge;
use super::reuse::{Reuse, Seen};
use super::trial::{Press, Trial};
use super::{Albedo, Error, Film, Material, Mesh, Role, Scene, Surface, fast, reference};
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// How much to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Variants of the scene.
    pub scenes: Vec<Variant>,
    /// Whether to measure what skips save and features cost.
    pub effects: bool,
    /// Columns and rows of the pictures whose errors are taken.
    pub size: [usize; 2],
    /// Samples a pixel of each of the two judging pictures.
    pub judge_samples: u32,
    /// Samples a pixel of the reference mode's points.
    pub samples: Vec<u32>,
    /// Tolerances of the fast mode's points.
    pub tolerances: Vec<f64>,
    /// Frames a time is the shortest of.
    pub repeat: u32,
    /// Hard cases: those whose name contains this, at this tolerance.
    pub cases: Option<(String, f64)>,
}

/// A point of a curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// Variant of the scene.
    pub scene: String,
    /// `reference`, `fast`, or a peer.
    pub method: String,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Samples a pixel or tolerance.
    pub setting: f64,
    /// Processor seconds a frame.
    pub cpu_s: f64,
    /// Wall seconds a frame; of peers it is not known.
    pub wall_s: Option<f64>,
    /// Seconds once a sensor, wall.
    pub once_s: Option<f64>,
    /// relRMSE.
    pub error: f64,
    /// What the mode said of itself.
    pub estimated: Option<f64>,
}

/// What leaving out saves, or a feature costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Effect {
    /// What.
    pub what: String,
    /// Processor seconds with it left out (or without the feature).
    pub without_s: f64,
    /// Processor seconds with it done.
    pub with_s: f64,
    /// `with_s / without_s`.
    pub ratio: f64,
    /// relRMSE between the two pictures, where they should be one.
    pub difference: Option<f64>,
}

/// How much of a picture stays when a press goes deeper, as shares from 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StillLight {
    /// Which press.
    pub what: String,
    /// Of the face's points: those that stay where they were, to the bit.
    pub same_points: f64,
    /// Of the pixels: those whose light stays, to the bit.
    pub same_pixels: f64,
    /// Of the pixels: those whose light stays within a ten-thousandth.
    pub nearly_same_pixels: f64,
}

/// Everything measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Threads at work.
    pub threads: usize,
    /// Errors below this are not told apart from 0, by scene.
    pub floors: Vec<(String, f64)>,
    /// Ours.
    pub points: Vec<Point>,
    /// Other people's, as published beside the benchmark scene.
    pub peers: Vec<Point>,
    /// What skips save and features cost.
    pub effects: Vec<Effect>,
    /// What stays between pictures; measured by whoever has an elastomer.
    pub still_light: Vec<StillLight>,
    /// Hard cases.
    pub cases: Vec<cases::Case>,
    /// Rays a processor second through the reference's tree, one for each pixel's centre.
    pub camera_rays_per_s: f64,
    /// Rays of all kinds a processor second while the reference renders, all else that it does in that time.
    pub rays_per_s: f64,
    /// Rays of all kinds that the reference traces for a sample.
    pub rays_per_sample: f64,
}

/// Samples a pixel while rays are counted.
const RAY_SAMPLES: u32 = 4;

/// Peers on scene Ac: method, size, samples, CPU seconds, relRMSE (measured with Cycles of Blender 4.5 and Mitsuba 3.9
/// on a Zen 5; two free cores halve the wall time).
const PEERS: [(&str, [usize; 2], f64, f64, f64); 12] = [
    ("Cycles", [640, 480], 16.0, 20.5, 0.0997),
    ("Cycles", [320, 240], 16.0, 4.9, 0.0998),
    ("Cycles", [320, 240], 64.0, 20.8, 0.0401),
    ("Cycles", [320, 240], 128.0, 40.5, 0.0271),
    ("Cycles + OIDN", [320, 240], 16.0, 5.8, 0.0077),
    ("Cycles + OIDN", [320, 240], 128.0, 41.8, 0.0038),
    ("Mitsuba independent", [640, 480], 128.0, 36.8, 0.0746),
    ("Mitsuba multijitter", [640, 480], 64.0, 20.0, 0.0357),
    ("Mitsuba multijitter", [320, 240], 16.0, 1.4, 0.085),
    ("Mitsuba multijitter", [320, 240], 64.0, 5.5, 0.0358),
    ("Mitsuba multijitter", [320, 240], 256.0, 19.2, 0.0168),
    ("Cycles + OIDN", [640, 480], 16.0, 23.0, 0.0077),
];

/// Measures everything. `cpu` tells the processor seconds that the program has used.
///
/// # Errors
/// When a scene cannot be rendered.
pub fn run(settings: &Settings, cpu: &dyn Fn() -> f64, mut tell: impl FnMut(&str)) -> Result<Report, Error> {
    let clock = Clock { cpu, repeat: settings.repeat.max(1) };
    let (mut points, mut floors) = (Vec::new(), Vec::new());
    for &variant in &settings.scenes {
        let name = variant.name();
        tell(&format!("scene {name}: judging pictures ..."));
        let trial = Trial::own(variant, settings.size)?;
        let judge = Judge::new(&trial.scene, settings.judge_samples)?;
        floors.push((name.to_owned(), judge.floor()));
        let start = Instant::now();
        let once = fast::Precomputed::new(&trial.untouched)?;
        let once_s = start.elapsed().as_secs_f64();
        let point = |method: &str, setting: f64, took: Took, error: f64| Point {
            scene: name.to_owned(),
            method: method.to_owned(),
            size: settings.size,
            setting,
            cpu_s: took.cpu_s,
            wall_s: Some(took.wall_s),
            once_s: None,
            error,
            estimated: None,
        };
        for &tolerance in &settings.tolerances {
            let (took, film) = clock.time(|| frame(&once, &trial.scene, tolerance))?;
            let (film, estimated) = film;
            points.push(Point {
                once_s: Some(once_s),
                estimated: Some(estimated),
                ..point("fast", tolerance, took, judge.error(&film))
            });
        }
        for &samples in &settings.samples {
            tell(&format!("scene {name}: reference, {samples} samples ..."));
            let once = Clock { repeat: 1, ..clock };
            let (took, film) = once.time(|| {
                let settings = reference::Settings { samples, seed: 1 };
                Ok(reference::Renderer::new(&trial.scene)?.render(&settings))
            })?;
            points.push(point("reference", f64::from(samples), took, judge.error(&film)));
        }
    }
    let hard = match &settings.cases {
        Some((which, tolerance)) => {
            let (size, judge_samples) = (settings.size, settings.judge_samples);
            let settings = cases::Settings { size, judge_samples, tolerance: *tolerance };
            cases::run(&settings, which, &clock, &mut tell)?
        }
        None => Vec::new(),
    };
    if settings.effects {
        tell("skips and features ...");
    }
    let peer = |(method, size, setting, cpu_s, error): (&str, [usize; 2], f64, f64, f64)| Point {
        scene: "Ac".to_owned(),
        method: method.to_owned(),
        size,
        setting,
        cpu_s,
        wall_s: None,
        once_s: None,
        error,
        estimated: None,
    };
    let renderer = reference::Renderer::new(&Trial::own(Variant::Ac, settings.size)?.scene)?;
    let (took, sights) = clock.time(|| Ok(renderer.sights()))?;
    let counted = reference::Settings { samples: RAY_SAMPLES, seed: 1 };
    let (whole, rays) = clock.time(|| Ok(renderer.render_counting_rays(&counted).1))?;
    Ok(Report {
        threads: rayon::current_num_threads(),
        floors,
        points,
        peers: PEERS.map(peer).to_vec(),
        effects: if settings.effects { effects(settings, &clock)? } else { Vec::new() },
        still_light: Vec::new(),
        cases: hard,
        camera_rays_per_s: sights.len() as f64 / took.cpu_s.max(1e-9),
        rays_per_s: rays as f64 / whole.cpu_s.max(1e-9),
        rays_per_sample: rays as f64 / (sights.len() as f64 * f64::from(RAY_SAMPLES)),
    })
}

/// A frame as a session renders it: the changed pad made ready, the light, the estimate.
fn frame(once: &fast::Precomputed, scene: &Scene, tolerance: f64) -> Result<(Film, f64), Error> {
    Ok(fast::Renderer::new(once, scene, tolerance)?.render_with_error())
}

/// Seconds, at best.
#[derive(Debug, Clone, Copy)]
struct Took {
    cpu_s: f64,
    wall_s: f64,
}

#[derive(Clone, Copy)]
struct Clock<'a> {
    cpu: &'a dyn Fn() -> f64,
    repeat: u32,
}

impl Clock<'_> {
    /// The shortest of some repeats, and the last result.
    fn time<T>(&self, mut work: impl FnMut() -> Result<T, Error>) -> Result<(Took, T), Error> {
        let mut took = Took { cpu_s: f64::INFINITY, wall_s: f64::INFINITY };
        let mut last = None;
        for _ in 0..self.repeat {
            let (start, cpu) = (Instant::now(), (self.cpu)());
            last = Some(work()?);
            took.cpu_s = took.cpu_s.min((self.cpu)() - cpu);
            took.wall_s = took.wall_s.min(start.elapsed().as_secs_f64());
        }
        Ok((took, last.expect("there is at least one repeat")))
    }

    /// Both in turn, so that whatever else the machine does befalls both.
    fn compare<T>(
        &self,
        what: &str,
        mut without: impl FnMut() -> Result<T, Error>,
        mut with: impl FnMut() -> Result<T, Error>,
        difference: impl Fn(&T, &T) -> Option<f64>,
    ) -> Result<Effect, Error> {
        let once = Clock { repeat: 1, ..*self };
        let (mut a, mut b, mut far) = (f64::INFINITY, f64::INFINITY, None);
        for _ in 0..self.repeat {
            let (took, first) = once.time(&mut without)?;
            a = a.min(took.cpu_s);
            let (took, second) = once.time(&mut with)?;
            b = b.min(took.cpu_s);
            far = difference(&first, &second);
        }
        Ok(Effect { what: what.to_owned(), without_s: a, with_s: b, ratio: b / a.max(1e-9), difference: far })
    }
}

/// What each skip saves and each feature costs, on a ball's press in the fast mode.
fn effects(settings: &Settings, clock: &Clock) -> Result<Vec<Effect>, Error> {
    let tolerance = 0.005;
    let lattice = [641, 481];
    let pressed = |variant, press| Trial::new(variant, press, settings.size, lattice);
    let ball = pressed(Variant::Ac, Press::Sphere)?;
    let once = fast::Precomputed::new(&ball.untouched)?;
    let apart = |a: &Film, b: &Film| Some(a.relative_rmse(b));
    let untold = |_: &Film, _: &Film| None;
    let fast_frame =
        |once: &fast::Precomputed, scene: &Scene| frame(once, scene, tolerance).map(|(film, _)| film);
    let thorough = |once: &fast::Precomputed, scene: &Scene| {
        Ok(fast::Renderer::new(once, scene, tolerance)?.thorough().render())
    };
    let mut effects = vec![clock.compare(
        "shadow tests also where no light can be hidden",
        || fast_frame(&once, &ball.scene),
        || thorough(&once, &ball.scene),
        apart,
    )?];
    let flat = &ball.untouched;
    effects.push(clock.compare(
        "the same on an untouched pad",
        || fast_frame(&once, flat),
        || thorough(&once, flat),
        apart,
    )?);
    let reuse = Reuse::default();
    let pad = &ball.scene.surfaces[0].mesh;
    let seen = || {
        let seen = reuse.or_render(pad, || {
            let light = fast_frame(&once, &ball.scene)?;
            let sights = Vec::new();
            Ok::<Seen, Error>(Seen { light, basis: None, estimated_error: None, sights, not_fast: None })
        })?;
        Ok(seen.light.clone())
    };
    // The last picture is there before the clock starts.
    seen()?;
    effects.push(clock.compare(
        "a pad that has not moved since the last picture, rendered again",
        seen,
        || fast_frame(&once, &ball.scene),
        apart,
    )?);
    effects.extend(bounces(&ball, tolerance, clock)?);
    let empty_plate = pressed(Variant::Ac, Press::Sphere)?.changed(add_plate_of_air);
    let once_plate = fast::Precomputed::new(&empty_plate.untouched)?;
    effects.push(clock.compare(
        "plate code on a scene without a plate (a plate of air)",
        || fast_frame(&once, &ball.scene),
        || fast_frame(&once_plate, &empty_plate.scene),
        apart,
    )?);
    let few = Clock { repeat: 1, ..*clock };
    effects.push(few.compare(
        "what a sensor needs once, done for every frame",
        || fast_frame(&once, &ball.scene),
        || fast_frame(&fast::Precomputed::new(&ball.untouched)?, &ball.scene),
        apart,
    )?);
    let textured = pressed(Variant::At, Press::Sphere)?;
    let once_textured = fast::Precomputed::new(&textured.untouched)?;
    effects.push(clock.compare(
        "a texture",
        || fast_frame(&once, &ball.scene),
        || fast_frame(&once_textured, &textured.scene),
        untold,
    )?);
    let plate = pressed(Variant::B, Press::Sphere)?;
    let once_real = fast::Precomputed::new(&plate.untouched)?;
    effects.push(clock.compare(
        "a plate",
        || fast_frame(&once, &ball.scene),
        || fast_frame(&once_real, &plate.scene),
        untold,
    )?);
    let radiances: Vec<Vec3> = ball.scene.lights.iter().map(|l| l.radiance).collect();
    let basis = fast::Renderer::new(&once, &ball.scene, tolerance)?.basis();
    effects.push(clock.compare(
        "one picture for each of four lights",
        || fast_frame(&once, &ball.scene),
        || Ok(fast::Renderer::new(&once, &ball.scene, tolerance)?.basis().combine(&radiances)),
        apart,
    )?);
    effects.push(clock.compare(
        "rendering other colours instead of adding up what is there",
        || Ok(basis.combine(&radiances)),
        || fast_frame(&once, &ball.scene),
        apart,
    )?);
    Ok(effects)
}

/// What it costs to look for what bounces where nothing does.
fn bounces(ball: &Trial, tolerance: f64, clock: &Clock) -> Result<[Effect; 2], Error> {
    let black = ball.clone().changed(|s| {
        s.surfaces[0].material = Material::Lambert { albedo: Albedo::Constant(Vec3::ZERO) };
    });
    let single = ball.clone().changed(|s| s.max_events = 1);
    type Apart = fn(&Film, &Film) -> Option<f64>;
    let effect = |what: &str, trial: &Trial, apart: Apart| {
        let once = fast::Precomputed::new(&trial.untouched)?;
        let renderer = || fast::Renderer::new(&once, &trial.scene, tolerance);
        clock.compare(what, || Ok(renderer()?.render()), || Ok(renderer()?.bouncing().render()), apart)
    };
    // (What bounces is a second event: where that is one too many, the picture with it is another.)
    Ok([
        effect("the bounce on a pad that reflects nothing", &black, |a, b| Some(a.relative_rmse(b)))?,
        effect("the bounce where light is scattered once", &single, |_, _| None)?,
    ])
}

/// A plate that bends nothing: the plate's code runs, the picture stays.
fn add_plate_of_air(scene: &mut Scene) {
    scene.surfaces.push(Surface {
        name: "plate".to_owned(),
        role: Role::Plate,
        mesh: Arc::new(Mesh::cuboid(Vec3::new(-10.1, -7.6, 1.5), Vec3::new(10.1, 7.6, 3.5))),
        material: Material::Dielectric { ior: 1.0 },
    });
    // Each passage of a face counts.
    scene.max_events *= 2;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_run_measures_both_modes() {
        let settings = Settings {
            scenes: vec![Variant::Ac],
            effects: false,
            size: [32, 24],
            judge_samples: 8,
            samples: vec![1, 4],
            tolerances: vec![0.01],
            repeat: 1,
            cases: None,
        };
        let start = Instant::now();
        let cpu = move || start.elapsed().as_secs_f64();
        let report = run(&settings, &cpu, |_| {}).unwrap();
        let of = |method: &str, setting: f64| {
            let found = report.points.iter().find(|p| p.method == method && p.setting == setting);
            found.map(|p| p.error).unwrap()
        };
        assert!(report.points.len() == 3 && report.camera_rays_per_s > 0.0);
        // A sample has a ray from the camera; most have others.
        assert!(report.rays_per_s > 0.0 && report.rays_per_sample > 1.0, "{}", report.rays_per_sample);
        assert!(of("reference", 4.0) < of("reference", 1.0));
        assert!(of("fast", 0.01) < of("reference", 4.0));
        // Both ways of doing a thing are timed, and their results held against each other.
        let clock = Clock { cpu: &cpu, repeat: 2 };
        let effect = clock.compare("x", || Ok(1.0), || Ok(1.5), |a, b| Some(b - a)).unwrap();
        assert_eq!(effect.difference, Some(0.5));
    }
}
