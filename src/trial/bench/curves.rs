//! Error against run time: every mode over its resolutions, on two scenes with a truth.
//!
//! - `press 0.25 mm, frictionless`: sphere R 4, fixed corotated; the truth is a converged finite-element profile that
//!   a second code confirmed (force 0.1 %, height 0.03 um). The explicit modes stick, so they are not on it.
//! - `press 1 mm, stick`: sphere R 4, fixed corotated; the truth is this program's own quasi-static mode with
//!   a tolerance several times finer than any on the curve, which the first scene vouches for.
//!
//! The error is the root mean square difference of the heights of material points with r < max(2a, 3 mm), a band of
//! 0.2 mm at the contact's edge left out. The explicit modes press at the predecessor's 200 mm/s, `mpm` also at a tenth
//! of it: at full speed the error is a transient's, slower it is the gap that the shared grid keeps.

use super::timing::repeat;
use super::{Effort, Stage, Timing};
use crate::elastomer::{self, ElastomerCapture, Error, Friction, Law, Mode, Settings};
use crate::pose::Pose;
use crate::trial::scene;
use serde::Serialize;

/// Points of the surface along each side.
const LATTICE: usize = 201;
/// Radius of the sphere, mm.
const RADIUS_MM: f64 = 4.0;
/// Force of the finite elements at 0.25 mm, N, and contact radius, mm.
const FEM_FORCE_N: f64 = 0.0794;
const FEM_CONTACT_MM: f64 = 1.094;
/// r, height, rest radius, u_r, u_theta, u_z (mm, um).
const FEM_PROFILE: &str = include_str!("../../elastomer/quasi_static/sphere_by_finite_elements.csv");

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// Scene.
    pub scene: &'static str,
    /// Mode, with its speed where that is not the predecessor's.
    pub series: String,
    /// Lattice or tolerance.
    pub resolution: String,
    /// How long it took.
    pub time: Timing,
    /// Error of the surface, um.
    pub rmse_um: f64,
    /// The same, of the depth.
    pub of_depth: f64,
    /// Error of the normal force, relative.
    pub force_error: f64,
    /// Error that the solver states, of the depth.
    pub stated_error: Option<f64>,
}

/// One step on the way to the curves.
type Part = Box<dyn FnOnce(&mut Curves) -> Result<(), Error> + Send>;

/// All runs and what they were compared with.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Curves {
    /// What the truth of each scene is.
    pub truths: Vec<(&'static str, String)>,
    /// The runs.
    pub points: Vec<Point>,
    /// Runs that ended in an error.
    pub failed: Vec<(String, String)>,
    #[serde(skip)]
    truth: Option<ElastomerCapture>,
}

const FRICTIONLESS: &str = "press 0.25 mm, frictionless";
const STICK: &str = "press 1 mm, stick";

/// Adds the measurements.
pub(super) fn plan(effort: Effort, stages: &mut Vec<Stage>) {
    let (tolerances, truth, repeats): (&[f64], f64, usize) = match effort {
        Effort::Smoke => (&[0.05], 0.02, 1),
        Effort::Quick => (&[0.05, 0.02], 0.006, 2),
        Effort::Full => (&[0.05, 0.02, 0.01, 0.005], 0.0015, 3),
    };
    let layers: &[usize] = match effort {
        Effort::Smoke => &[4],
        Effort::Quick => &[4, 10, 20],
        Effort::Full => &[4, 8, 10, 20, 40],
    };
    let mut add = |name: String, stage: Part| {
        stages.push((name, Box::new(move |report: &mut super::Report| stage(&mut report.curves))));
    };
    add("truth of the curves".into(), Box::new(move |curves| find_truth(curves, truth)));
    for &tolerance in tolerances {
        let stage = move |curves: &mut Curves| {
            let run = |scene, friction, depth| Run {
                scene,
                series: "quasi_static".into(),
                resolution: format!("tolerance {tolerance}"),
                settings: scene::quasi_static(friction, tolerance),
                depth_mm: depth,
                repeats,
            };
            curves.add(run(FRICTIONLESS, Friction::Coefficient(0.0), 0.25));
            curves.add(run(STICK, Friction::Infinite, 1.0));
            Ok(())
        };
        add(format!("error against time, tolerance {tolerance}"), Box::new(stage));
    }
    for &n in layers {
        let particles = [5 * n + 1, 5 * n + 1, n + 1];
        for (mode, name, speed_mm_s) in [
            (Mode::Mpm, "mpm", 200.0),
            (Mode::Impm, "impm", 200.0),
            (Mode::Mpm, "mpm, ten times slower", 20.0),
        ] {
            if speed_mm_s < 200.0 && (n > 20 || effort == Effort::Smoke || effort == Effort::Quick && n > 10)
            {
                continue;
            }
            let run = Run {
                scene: STICK,
                series: name.into(),
                resolution: format!("{}x{}x{}", particles[0], particles[1], particles[2]),
                settings: Settings {
                    mode,
                    particles,
                    speed_mm_s,
                    friction: Friction::Infinite,
                    ..Settings::default()
                },
                depth_mm: 1.0,
                repeats: if n < 20 { repeats } else { 1 },
            };
            let stage = move |curves: &mut Curves| {
                curves.add(run);
                Ok(())
            };
            add(format!("error against time, {name} {particles:?}"), Box::new(stage));
        }
    }
}

fn press(settings: &Settings, depth_mm: f64) -> Result<ElastomerCapture, Error> {
    // The explicit modes feel the indenter from three cells away; cells are 33/256 mm at 201 particles along x.
    let clear = match settings.mode {
        Mode::QuasiStatic => 0.1,
        Mode::Mpm | Mode::Impm => 3.0 * 33.0 / 256.0 * 200.0 / (settings.particles[0] - 1) as f64,
    };
    let start = Pose::new(0.0, 0.0, clear, 0.0);
    let mut solver =
        elastomer::solver(&scene::pad(Law::FixedCorotated), settings, scene::sphere(RADIUS_MM), &start)?;
    solver.advance(&Pose::new(0.0, 0.0, -depth_mm, 0.0))?;
    solver.capture(LATTICE, LATTICE)
}

fn find_truth(curves: &mut Curves, tolerance: f64) -> Result<(), Error> {
    let truth = press(&scene::quasi_static(Friction::Infinite, tolerance), 1.0)?;
    curves.truths.push((FRICTIONLESS, "converged finite elements, confirmed by a second code".into()));
    curves.truths.push((STICK, format!("this program's quasi-static mode at tolerance {tolerance}")));
    curves.truth = Some(truth);
    Ok(())
}

/// One point of a curve, before it is run.
struct Run {
    scene: &'static str,
    series: String,
    resolution: String,
    settings: Settings,
    depth_mm: f64,
    repeats: usize,
}

impl Curves {
    fn add(&mut self, run: Run) {
        let Run { scene, series, resolution, settings, depth_mm, repeats } = run;
        let (capture, time) = match repeat(repeats, || press(&settings, depth_mm)) {
            Ok(done) => done,
            Err(error) => {
                return self.failed.push((format!("{scene}, {series} {resolution}"), error.to_string()));
            }
        };
        let (rmse_um, true_force) = if scene == FRICTIONLESS {
            (against_finite_elements_um(&capture), FEM_FORCE_N)
        } else {
            let Some(truth) = &self.truth else { return };
            let contact_mm = (truth.stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
            let within = (2.0 * contact_mm).max(3.0);
            let [rmse, _] = scene::height_difference_um(&capture.surface, &truth.surface, within, contact_mm);
            (rmse, truth.forces.normal_force_n)
        };
        self.points.push(Point {
            scene,
            series,
            resolution,
            time,
            rmse_um,
            of_depth: 1e-3 * rmse_um / depth_mm,
            force_error: (capture.forces.normal_force_n - true_force) / true_force,
            stated_error: capture.stats.estimated_error,
        });
    }
}

/// Root mean square difference of u_z at material points, um, where r < 3 mm.
fn against_finite_elements_um(capture: &ElastomerCapture) -> f64 {
    let read = |line: &str| {
        let field = |n: usize| -> f64 {
            line.split(',').nth(n).and_then(|v| v.parse().ok()).expect("the built-in profile holds numbers")
        };
        [field(2), field(5)]
    };
    let profile: Vec<[f64; 2]> = FEM_PROFILE.lines().skip(1).map(read).collect();
    let truth = |r: f64| -> f64 {
        let n = profile.partition_point(|p| p[0] <= r).clamp(1, profile.len() - 1);
        let ([r0, z0], [r1, z1]) = (profile[n - 1], profile[n]);
        z0 + (z1 - z0) * (r - r0) / (r1 - r0)
    };
    let s = &capture.surface;
    let (mut sum, mut count) = (0.0, 0u32);
    for j in 0..s.ny {
        for i in 0..s.nx {
            let [x, y] = s.rest_xy(i, j);
            let r = x.hypot(y);
            if r < 3.0 && (r - FEM_CONTACT_MM).abs() > 0.1 {
                sum += (1e3 * f64::from(s.positions[j * s.nx + i].z) - truth(r)).powi(2);
                count += 1;
            }
        }
    }
    (sum / f64::from(count.max(1))).sqrt()
}
