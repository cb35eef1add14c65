//! What the optics must bear: odd pads, lights, scales and scenes, each rendered by the fast mode or refused.
//!
//! A case ends well when its picture is finite, not negative, below what its lights can give at all, and no farther from
//! the reference than its own estimate says, pixel by pixel and in the means of squares, in which there is less noise and as
//! much of what is too bright or too dark; or when it is refused with a typed error where a refusal is due. The presses
//! and lights here are others than those that the estimate's constants were found on, so they test its honesty. So do scenes that
//! are drawn at random (`random`), in which nobody's idea of what is hard is left.

mod cameras;
mod cases;
mod grazing;
pub(crate) mod lamps;
mod random;

use super::judge::{Judge, Judged};
use super::trial::{Trial, bound};
use super::{Error, Film, Scene, fast, reference};
use cases::cases;
use glam::Vec3;
use serde::Serialize;

/// How much to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns and rows of the pictures.
    pub size: [usize; 2],
    /// Samples a pixel of each of the two judging pictures.
    pub judge_samples: u32,
    /// relRMSE asked for.
    pub tolerance: f64,
    /// Every so many-th case only.
    pub every: usize,
    /// Only cases whose names hold this.
    pub only: Option<String>,
    /// So many scenes of a seed, drawn at random, instead of the usual cases.
    pub drawn: Option<(u64, u32)>,
}

/// How a case ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Outcome {
    /// Rendered.
    Picture {
        /// relRMSE against the reference, its noise taken off.
        error: f64,
        /// Below this the judges cannot tell.
        floor: f64,
        /// The same two of the means of squares.
        means: [f64; 2],
        /// What the mode said of itself.
        estimated: f64,
        /// Whether the judges' noise is more than that: the case tells nothing finer than its floor.
        undecided: bool,
    },
    /// Refused.
    Refused {
        /// The message.
        why: String,
    },
}

/// A case and its verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// What was tried.
    pub case: String,
    /// How it ended.
    pub outcome: Outcome,
    /// What is wrong with that; none when all is well.
    pub faults: Vec<String>,
}

/// What a case may end as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Due {
    Picture,
    Refusal,
    Either,
    /// A refusal, and a picture by the reference mode.
    Reference,
}

/// Makes what a case tries.
type Make = Box<dyn Fn(&Settings) -> Result<Trial, Error>>;

struct Case {
    name: String,
    due: Due,
    make: Make,
    /// So many times the samples judge it: the edge of a lamp is noise in a few pixels, of which the floor tells too little.
    times: u32,
}

impl Case {
    fn judged_closely(self) -> Self {
        Self { times: CLOSELY, ..self }
    }
}

/// How many times the samples of other cases.
const CLOSELY: u32 = 4;

/// Tries all cases; `tell` hears each verdict as it falls.
pub fn run(settings: &Settings, mut tell: impl FnMut(&Verdict)) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    // Cases of one sensor follow each other: it is prepared once for all of them.
    let mut prepared: Option<([u8; 32], fast::Precomputed)> = None;
    let wanted = |case: &&Case| settings.only.as_ref().is_none_or(|part| case.name.contains(part));
    let cases = settings.drawn.map_or_else(cases, |(seed, count)| random::cases(seed, count));
    for case in cases.iter().filter(wanted).step_by(settings.every.max(1)) {
        let verdict = try_case(case, settings, &mut prepared);
        tell(&verdict);
        verdicts.push(verdict);
    }
    verdicts
}

fn try_case(
    case: &Case,
    settings: &Settings,
    prepared: &mut Option<([u8; 32], fast::Precomputed)>,
) -> Verdict {
    let mut faults = Vec::new();
    let outcome = match picture_of(case, settings, prepared, &mut faults) {
        Ok(outcome) => outcome,
        Err(e) => Outcome::Refused { why: e.to_string() },
    };
    match (&outcome, case.due) {
        (Outcome::Refused { why }, Due::Picture) => faults.push(format!("it was refused: {why}")),
        (Outcome::Picture { .. }, Due::Refusal | Due::Reference) => {
            faults.push("it was not refused".to_owned());
        }
        (Outcome::Refused { .. }, Due::Reference) => faults.extend(not_traced(case, settings)),
        _ => {}
    }
    Verdict { case: case.name.clone(), outcome, faults }
}

/// What is wrong with a case's picture by the reference mode.
fn not_traced(case: &Case, settings: &Settings) -> Option<String> {
    let traced = || {
        let scene = (case.make)(settings)?.scene;
        let samples = settings.judge_samples;
        Ok::<_, Error>(reference::Renderer::new(&scene)?.render(&reference::Settings { samples, seed: 0xa }))
    };
    match traced() {
        Ok(film) if film.pixels.iter().any(|p| !(p.is_finite() && p.cmpge(Vec3::ZERO).all())) => {
            Some("the reference mode's picture is no light".to_owned())
        }
        Ok(film) if film.mean() == Vec3::ZERO => Some("the reference mode's picture is black".to_owned()),
        Ok(_) => None,
        Err(e) => Some(format!("the reference mode refused it, too: {e}")),
    }
}

fn picture_of(
    case: &Case,
    settings: &Settings,
    prepared: &mut Option<([u8; 32], fast::Precomputed)>,
    faults: &mut Vec<String>,
) -> Result<Outcome, Error> {
    let most_times = if settings.drawn.is_some() { CLOSELY * CLOSELY } else { CLOSELY };
    let Trial { scene, untouched } = (case.make)(settings)?;
    let key = fast::Precomputed::key(&untouched);
    let once = match prepared.take() {
        Some((of, once)) if of == key => once,
        _ => fast::Precomputed::new(&untouched)?,
    };
    let radiances: Vec<Vec3> = scene.lights.iter().map(|l| l.radiance).collect();
    let once = once.with_radiances(&radiances)?;
    let (film, estimated) = fast::Renderer::new(&once, &scene, settings.tolerance)?.render_with_error();
    *prepared = Some((key, once));
    let most = bound(&scene) * 1.001;
    let broken = film.pixels.iter().filter(|p| !(p.is_finite() && p.cmpge(Vec3::ZERO).all())).count();
    if broken > 0 || !estimated.is_finite() {
        faults.push(format!("{broken} pixels are no light (estimate {estimated})"));
    }
    let bright = film.pixels.iter().filter(|p| !p.cmple(most).all()).count();
    if bright > 0 {
        faults.push(format!("{bright} pixels are brighter than all light there is ({most})"));
    }
    let mut times = case.times;
    let mut trial = judged(&scene, &film, settings.judge_samples * times, estimated)?;
    while trial.undecided && times < most_times {
        times *= CLOSELY;
        trial = judged(&scene, &film, settings.judge_samples * times, estimated)?;
    }
    for judged in [trial.pixels, trial.means].iter().filter(|judged| !judged.agrees_with(estimated)) {
        faults.push(format!("the error is {:.4}, the estimate said {estimated:.4}", judged.error));
    }
    let Verdicts { pixels: Judged { error, floor }, means, undecided } = trial;
    Ok(Outcome::Picture { error, floor, means: [means.error, means.floor], estimated, undecided })
}

/// What was found of a picture's pixels and of the means of squares of them.
struct Verdicts {
    pixels: Judged,
    means: Judged,
    undecided: bool,
}

fn judged(scene: &Scene, film: &Film, samples: u32, estimated: f64) -> Result<Verdicts, Error> {
    let judge = Judge::new(scene, samples)?;
    let pixels = judge.judged(film);
    let means = judge.of_means(SQUARE).judged(&film.shrunk(SQUARE));
    Ok(Verdicts { pixels, means, undecided: pixels.floor.min(means.floor) > estimated })
}

/// Pixels along a side of the squares whose means are judged.
const SQUARE: usize = 8;

#[cfg(test)]
mod tests {
    use super::cases::changed;
    use super::*;

    /// All cases, on small pictures.
    fn small() -> Settings {
        Settings { size: [32, 24], judge_samples: 16, tolerance: 0.005, every: 1, only: None, drawn: None }
    }

    /// Some of the cases on small pictures (the command does all of them): each ends well.
    #[test]
    fn one_triangle_is_refused_and_traced() {
        let settings = Settings { judge_samples: 4, ..small() };
        let cases = cases();
        let mut of_one = cases.into_iter().filter(|case| case.name.contains("of 1 triangle"));
        let mut case = of_one.next().unwrap();
        let verdict = try_case(&case, &settings, &mut None);
        let Outcome::Refused { why } = &verdict.outcome else { panic!("{verdict:?}") };
        assert!(why.contains("reference") && verdict.faults.is_empty(), "{verdict:?}");
        // What the reference mode cannot render either is a fault.
        case.make = Box::new(|s| changed(|s| s.surfaces.clear())(s));
        assert!(!try_case(&case, &settings, &mut None).faults.is_empty());
    }

    #[test]
    fn a_pad_that_rises_over_lamps_is_refused_and_traced() {
        let settings = Settings { judge_samples: 4, only: Some("rises over lamps".to_owned()), ..small() };
        let verdicts = run(&settings, |_| {});
        let [Verdict { outcome: Outcome::Refused { why }, faults, .. }] = &verdicts[..] else {
            panic!("{verdicts:?}")
        };
        assert!(why.contains("under the pad's face") && faults.is_empty(), "{why} {faults:?}");
    }

    #[test]
    fn every_ninth_case_ends_well() {
        let settings = Settings { every: 9, ..small() };
        end_well(&settings, 4);
    }

    #[test]
    fn scenes_drawn_at_random_end_well() {
        let settings = Settings { judge_samples: 64, drawn: Some((1, 8)), ..small() };
        end_well(&settings, 7);
    }

    fn end_well(settings: &Settings, more_than: usize) {
        let verdicts = run(settings, |_| {});
        let bad: Vec<&Verdict> = verdicts.iter().filter(|v| !v.faults.is_empty()).collect();
        assert!(bad.is_empty() && verdicts.len() > more_than, "{bad:#?}");
    }
}
