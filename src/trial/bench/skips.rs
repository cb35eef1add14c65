//! What is saved by not doing what a scene does not need: the same work done both ways, in turn.
//!
//! Each row names a skip, the time with it and without it. Without means that `elastomer.without` names it. The two skips that are the
//! twin's (one press for two slides, no waypoint after the last that a capture needs) are told by what its paths ask of the
//! elastomer with them and without.

use super::timing::once;
use super::{Effort, Stage};
use crate::elastomer::{self, Elastomer, ElastomerCapture, Error, Friction, Law, Mode, Settings};
use crate::indenter::Indenter;
use crate::pose::Pose;
use crate::trial::scene;
use serde::Serialize;
use std::sync::Arc;

/// Effect of one skip.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Skip {
    /// What is not done.
    pub skip: &'static str,
    /// The work that was measured.
    pub work: &'static str,
    /// Processor time with the skip, s.
    pub with_s: f64,
    /// Without it, s.
    pub without_s: f64,
    /// Root mean square of what the skip changes in the heights of the face, relative to depth, and the errors that both ways state
    /// together; absent where faces are not compared.
    pub apart_and_stated: Option<[f64; 2]>,
}

impl Skip {
    /// How many times faster.
    pub fn factor(&self) -> f64 {
        self.without_s / self.with_s
    }
}

/// Processor times with and without a skip, and [`Skip::apart_and_stated`].
type Effect = ([f64; 2], Option<[f64; 2]>);

/// Tolerance and repeats to the least processor times with and without the skip, and what it changes.
type Measure = fn(f64, usize) -> Result<Effect, Error>;

/// Depth of most presses, mm.
const DEPTH_MM: f64 = 0.5;
/// Depth of the explicit one, mm.
const EXPLICIT_DEPTH_MM: f64 = 1.0;
/// Points of the faces that are compared, along each side.
const SURFACE: usize = 201;

/// Name of the skip, the work that is measured, and how.
const ROWS: [(&str, &str, Measure); 9] = [
    (
        "nothing is solved before first touch",
        "0.4 mm of travel 0.2 mm above the face, against looking at the face every 0.1 mm",
        before_first_touch,
    ),
    (
        "slides fork from one press",
        "a press of 0.5 mm and 0.25 mm to the left and to the right, against a press for each",
        shared_press,
    ),
    (
        "nothing is solved for waypoints that no capture needs",
        "a press of 0.5 mm, whose capture alone is wanted, against 0.25 mm to the left and the retract besides",
        needed_waypoints,
    ),
    (
        "a waypoint starts from the one before",
        "waypoints at 0.3, 0.4, 0.5 and 0.6 mm, against each from rest",
        warm_start,
    ),
    (
        "no tangential unknowns without friction",
        "a press of 0.5 mm without friction, against one with anchors that bear nothing",
        no_friction,
    ),
    (
        "cells grow away from the face",
        "a press of 0.5 mm, each cell 1.4 times as high as the one above it, against all as high as the first",
        coarse_below,
    ),
    (
        "fine where it is pressed alone",
        "a sharp punch pressed 0.5 mm and read, in relief over the usual cells, against cells half as wide everywhere",
        fine_where_pressed,
    ),
    (
        "no explicit step before first touch",
        "mpm, 51x51x11: 2 mm of travel in the air, against stepping through it",
        explicit_before_touch,
    ),
    (
        "what is at rest is no explicit step",
        "mpm, 101x101x21: a press of 1 mm from first touch, blocks that stay as they are passed over, against all computed",
        explicit_rest,
    ),
];

/// Adds the measurements.
pub(super) fn plan(effort: Effort, stages: &mut Vec<Stage>) {
    let (tolerance, repeats) = match effort {
        Effort::Smoke => (0.1, 1),
        Effort::Quick => (0.1, 2),
        Effort::Full => (0.02, 3),
    };
    for (skip, work, measure) in ROWS {
        let stage = move |report: &mut super::Report| {
            // On one thread: others would stay awake, and their time be counted, whether there is work for them or not.
            let ([with_s, without_s], apart_and_stated) = on_one_thread(|| measure(tolerance, repeats))?;
            report.skips.push(Skip { skip, work, with_s, without_s, apart_and_stated });
            Ok(())
        };
        stages.push((format!("skip: {skip}"), Box::new(stage)));
    }
}

fn on_one_thread<T: Send>(work: impl FnOnce() -> Result<T, Error> + Send) -> Result<T, Error> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| Error::Setting {
        key: "threads",
        value: "1".to_owned(),
        allowed: format!("as many as the system makes ({e})"),
        next: "end other programs".to_owned(),
    })?;
    pool.install(work)
}

fn at(x_mm: f64, z_mm: f64) -> Pose {
    Pose::new(x_mm, 0.0, z_mm, 0.0)
}

/// A pad at rest under the usual sphere.
fn solver(friction: Friction, tolerance: f64) -> Result<Box<dyn Elastomer>, Error> {
    let settings = scene::quasi_static(friction, tolerance);
    elastomer::solver(&scene::pad(Law::NeoHookean), &settings, scene::sphere(4.0), &at(0.0, DEPTH_MM))
}

/// A scene in which something is skipped or is not.
struct Scene {
    settings: Settings,
    body: Arc<dyn Indenter>,
    start: Pose,
    /// What the heights of the faces are told relative to, mm.
    depth_mm: f64,
}

impl Scene {
    /// The usual sphere over the usual pad.
    fn of(settings: Settings, start: Pose) -> Self {
        Self { settings, body: scene::sphere(4.0), start, depth_mm: DEPTH_MM }
    }

    /// Least processor times of the work with and without the skip, taken in turn so that a busy machine is so for both, and how far
    /// the faces that it ends with are apart.
    fn effect(
        &self,
        skip: elastomer::Skip,
        repeats: usize,
        work: impl Fn(&mut dyn Elastomer) -> Result<(), Error>,
    ) -> Result<Effect, Error> {
        let ready = |without| {
            let settings = Settings { without, ..self.settings.clone() };
            elastomer::solver(&scene::pad(Law::NeoHookean), &settings, Arc::clone(&self.body), &self.start)
        };
        let (with, without) = (ready(Vec::new())?, ready(vec![skip])?);
        let face = |from: &dyn Elastomer, least_s: &mut f64| -> Result<ElastomerCapture, Error> {
            let mut state = from.fork();
            let (done, [_, cpu_s]) = once(|| work(state.as_mut()));
            done?;
            *least_s = least_s.min(cpu_s);
            state.capture(SURFACE, SURFACE)
        };
        let (mut least_s, mut apart_and_stated) = ([f64::INFINITY; 2], None);
        for _ in 0..repeats {
            let [with_s, without_s] = &mut least_s;
            let (with, without) = (face(with.as_ref(), with_s)?, face(without.as_ref(), without_s)?);
            let everywhere = f64::INFINITY;
            let [apart_um, _] =
                scene::height_difference_um(&with.surface, &without.surface, everywhere, everywhere);
            let stated = [&with, &without].iter().filter_map(|face| face.stats.estimated_error).sum();
            apart_and_stated = Some([1e-3 * apart_um / self.depth_mm, stated]);
        }
        Ok((least_s, apart_and_stated))
    }
}

/// Least processor times of two ways to do something, taken in turn.
fn compare(
    repeats: usize,
    mut with: impl FnMut() -> Result<(), Error>,
    mut without: impl FnMut() -> Result<(), Error>,
) -> Result<Effect, Error> {
    let mut least = [f64::INFINITY; 2];
    for _ in 0..repeats {
        let (done, [_, cpu]) = once(&mut with);
        done?;
        least[0] = least[0].min(cpu);
        let (done, [_, cpu]) = once(&mut without);
        done?;
        least[1] = least[1].min(cpu);
    }
    Ok((least, None))
}

fn before_first_touch(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = scene::quasi_static(Friction::Infinite, tolerance);
    let travel =
        |state: &mut dyn Elastomer| (1..=4).try_for_each(|n| state.advance(&at(0.1 * f64::from(n), 0.2)));
    Scene::of(settings, at(0.0, 0.2)).effect(elastomer::Skip::FirstTouch, repeats, travel)
}

fn shared_press(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let base = solver(Friction::Infinite, tolerance)?;
    let press = || {
        let mut state = base.fork();
        state.advance(&at(0.0, -DEPTH_MM)).map(|()| state)
    };
    let slide = |mut state: Box<dyn Elastomer>, way: f64| state.advance(&at(way, -DEPTH_MM));
    compare(
        repeats,
        || {
            let pressed = press()?;
            slide(pressed.fork(), -0.25)?;
            slide(pressed, 0.25)
        },
        || {
            slide(press()?, -0.25)?;
            slide(press()?, 0.25)
        },
    )
}

fn needed_waypoints(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let base = solver(Friction::Infinite, tolerance)?;
    let go = |way: &[Pose]| {
        let mut state = base.fork();
        way.iter().try_for_each(|pose| state.advance(pose))
    };
    let way = [at(0.0, -DEPTH_MM), at(-0.25, -DEPTH_MM), at(-0.25, DEPTH_MM)];
    compare(repeats, || go(&way[..1]), || go(&way))
}

fn warm_start(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = scene::quasi_static(Friction::Infinite, tolerance);
    let press = |state: &mut dyn Elastomer| {
        [-0.3, -0.4, -0.5, -0.6].iter().try_for_each(|z_mm| state.advance(&at(0.0, *z_mm)))
    };
    let scene = Scene { depth_mm: 0.6, ..Scene::of(settings, at(0.0, 0.1)) };
    scene.effect(elastomer::Skip::WarmStart, repeats, press)
}

fn press(state: &mut dyn Elastomer) -> Result<(), Error> {
    state.advance(&at(0.0, -DEPTH_MM))
}

fn no_friction(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = scene::quasi_static(Friction::Coefficient(0.0), tolerance);
    Scene::of(settings, at(0.0, 0.1)).effect(elastomer::Skip::Frictionless, repeats, press)
}

fn coarse_below(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = scene::quasi_static(Friction::Infinite, tolerance);
    Scene::of(settings, at(0.0, 0.1)).effect(elastomer::Skip::GrowingCells, repeats, press)
}

fn fine_where_pressed(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = scene::quasi_static(Friction::Infinite, tolerance);
    let scene = Scene { body: scene::punch(5.4, 0.0), ..Scene::of(settings, at(0.0, 0.1)) };
    // Read, too: that is when the face gets its relief.
    scene.effect(elastomer::Skip::Relief, repeats, |state| {
        press(state)?;
        state.capture(SURFACE, SURFACE).map(|_| ())
    })
}

fn explicit_before_touch(_: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = Settings { mode: Mode::Mpm, particles: [51, 51, 11], ..Settings::default() };
    let travel =
        |state: &mut dyn Elastomer| (1..=4).try_for_each(|n| state.advance(&at(0.5 * f64::from(n), 5.0)));
    Scene::of(settings, at(0.0, 5.0)).effect(elastomer::Skip::FirstTouch, repeats, travel)
}

fn explicit_rest(_: f64, repeats: usize) -> Result<Effect, Error> {
    let law = Some(Law::FixedCorotated);
    let settings = Settings { mode: Mode::Mpm, law, particles: [101, 101, 21], ..Settings::default() };
    let scene = Scene { depth_mm: EXPLICIT_DEPTH_MM, ..Scene::of(settings, at(0.0, 0.0)) };
    scene.effect(elastomer::Skip::Rest, repeats, |state| state.advance(&at(0.0, -EXPLICIT_DEPTH_MM)))
}
