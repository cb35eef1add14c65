//! What is saved by not doing what a scene does not need: the same work done both ways, in turn.
//!
//! Each row names a skip, the time with it and without it. Where the program has no switch, the work without
//! the skip is what a simulator that lacks it would have to do.

use super::timing::once;
use super::{Effort, Stage};
use crate::elastomer::mpm::ExplicitSolver;
use crate::elastomer::quasi_static::{QuasiStaticSolver, Resolution};
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
    /// Root mean square of what the skip changes in the heights of the face, relative to depth, and the error it states; absent where
    /// it is not compared.
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

/// Depth of the presses whose faces are compared, mm.
const DEPTH_MM: f64 = 0.5;
/// Points of those faces along each side.
const SURFACE: usize = 201;

/// Name of the skip, the work that is measured, and how.
const ROWS: [(&str, &str, Measure); 8] = [
    (
        "nothing is solved before first touch",
        "0.4 mm of travel in the air against as much in a contact of 0.1 mm",
        before_first_touch,
    ),
    (
        "slides fork from one press",
        "a press of 0.5 mm and 0.25 mm to the left and to the right",
        shared_press,
    ),
    (
        "a waypoint starts from the one before",
        "captures at 0.3, 0.4, 0.5 and 0.6 mm, each from the one before or each from rest",
        warm_start,
    ),
    ("no tangential unknowns without friction", "a press of 0.5 mm, friction 0 against 0.5", no_friction),
    (
        "cells grow away from the face",
        "a press of 0.5 mm, each cell 1.4 times as high as the one above it, against all as high as the first",
        coarse_below,
    ),
    (
        "fine where it is pressed alone",
        "a sharp punch pressed 0.5 mm, in relief over the usual cells, against cells half as wide everywhere",
        fine_where_pressed,
    ),
    (
        "no explicit step before first touch",
        "mpm, 51x51x11: 2 mm of travel in the air, before and after a touch",
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

fn solver(friction: Friction, tolerance: f64) -> Result<Box<dyn Elastomer>, Error> {
    let settings = scene::quasi_static(friction, tolerance);
    let start = Pose::new(0.0, 0.0, 0.5, 0.0);
    elastomer::solver(&scene::pad(Law::NeoHookean), &settings, scene::sphere(4.0), &start)
}

fn at(x_mm: f64, z_mm: f64) -> Pose {
    Pose::new(x_mm, 0.0, z_mm, 0.0)
}

/// Least processor times of two ways to do something, taken in turn so that a busy machine is so for both.
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
    let base = solver(Friction::Infinite, tolerance)?;
    let travel = |height: f64| {
        let mut state = base.fork();
        state.advance(&at(0.0, height))?;
        (1..=4).try_for_each(|n| state.advance(&at(0.1 * f64::from(n), height)))
    };
    compare(repeats, || travel(0.2), || travel(-0.1))
}

fn shared_press(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let press = || {
        let mut state = solver(Friction::Infinite, tolerance)?;
        state.advance(&at(0.0, -0.5)).map(|()| state)
    };
    let slide = |mut state: Box<dyn Elastomer>, way: f64| state.advance(&at(way, -0.5));
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

fn warm_start(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let depths = [-0.3, -0.4, -0.5, -0.6];
    compare(
        repeats,
        || {
            let mut state = solver(Friction::Infinite, tolerance)?;
            depths.iter().try_for_each(|z| state.advance(&at(0.0, *z)))
        },
        || depths.iter().try_for_each(|z| solver(Friction::Infinite, tolerance)?.advance(&at(0.0, *z))),
    )
}

fn no_friction(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let press = |mu| solver(Friction::Coefficient(mu), tolerance)?.advance(&at(0.0, -0.5));
    compare(repeats, || press(0.0), || press(0.5))
}

fn explicit_before_touch(_: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = Settings { mode: Mode::Mpm, particles: [51, 51, 11], ..Settings::default() };
    let start = at(0.0, 5.0);
    let base = elastomer::solver(&scene::pad(Law::NeoHookean), &settings, scene::sphere(4.0), &start)?;
    // A little inside the reach of the grid, and out again: from then on the pad is computed.
    let mut touched = base.fork();
    touched.advance(&at(0.0, 0.5))?;
    touched.advance(&start)?;
    let travel = |state: &dyn Elastomer| {
        let mut state = state.fork();
        (1..=4).try_for_each(|n| state.advance(&at(0.5 * f64::from(n), 5.0)))
    };
    compare(repeats, || travel(base.as_ref()), || travel(touched.as_ref()))
}

fn explicit_rest(_: f64, repeats: usize) -> Result<Effect, Error> {
    let settings = Settings { mode: Mode::Mpm, particles: [101, 101, 21], ..Settings::default() };
    let pad = scene::pad(Law::FixedCorotated);
    let press = |rest_is_computed: bool| {
        let mut solver = ExplicitSolver::new(&pad, &settings, scene::sphere(4.0), &at(0.0, 0.0))?;
        solver.compute_rest(rest_is_computed);
        solver.advance(&at(0.0, -1.0))?;
        solver.capture(SURFACE, SURFACE)
    };
    let (passed, all) = (press(false)?, press(true)?);
    let everywhere = f64::INFINITY;
    let [apart_um, _] = scene::height_difference_um(&passed.surface, &all.surface, everywhere, everywhere);
    let (times, _) = compare(repeats, || press(false).map(|_| ()), || press(true).map(|_| ()))?;
    Ok((times, Some([1e-3 * apart_um, 0.0])))
}

/// A press of 0.5 mm over cells as given, and what the face is then.
fn pressed(
    indenter: &Arc<dyn Indenter>,
    tolerance: f64,
    resolution: Resolution,
) -> Result<ElastomerCapture, Error> {
    let settings = scene::quasi_static(Friction::Infinite, tolerance);
    let (pad, start) = (scene::pad(Law::NeoHookean), at(0.0, 0.1));
    let mut solver =
        QuasiStaticSolver::with_resolution(&pad, &settings, resolution, Arc::clone(indenter), &start)?;
    solver.advance(&at(0.0, -DEPTH_MM))?;
    solver.capture(SURFACE, SURFACE)
}

/// The same press over two resolutions, the first of which is the one with the skip.
fn two_resolutions(
    indenter: &Arc<dyn Indenter>,
    tolerance: f64,
    repeats: usize,
    resolutions: [Resolution; 2],
) -> Result<Effect, Error> {
    let [with, without] = resolutions.map(|resolution| pressed(indenter, tolerance, resolution));
    let (with, without) = (with?, without?);
    let everywhere = f64::INFINITY;
    let [apart_um, _] = scene::height_difference_um(&with.surface, &without.surface, everywhere, everywhere);
    let press = |resolution| pressed(indenter, tolerance, resolution).map(|_| ());
    let (times, _) = compare(repeats, || press(resolutions[0]), || press(resolutions[1]))?;
    let stated = with.stats.estimated_error.unwrap_or(0.0);
    Ok((times, Some([1e-3 * apart_um / DEPTH_MM, stated])))
}

fn coarse_below(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let usual = Resolution::for_tolerance(tolerance);
    two_resolutions(&scene::sphere(4.0), tolerance, repeats, [usual, Resolution { growth: 1.0, ..usual }])
}

fn fine_where_pressed(tolerance: f64, repeats: usize) -> Result<Effect, Error> {
    let usual = Resolution::for_tolerance(tolerance);
    let finer = Resolution { cell_mm: usual.cell_mm / 2.0, ..usual };
    two_resolutions(&scene::punch(5.4, 0.0), tolerance, repeats, [usual, finer])
}
