//! `twinrig stress optics`: odd pads, lights, scales and scenes.
//!
//! Sharp indenters, drags of 5 mm, folds, lights that graze, touch walls or point elsewhere, albedos of 0 and 1, lattices
//! of 1 to a million triangles, scenes without anything: each is rendered by the fast mode and held against two
//! reference pictures, or refused with a message. A case fails when a pixel is no light or brighter than all light there is,
//! when the error is beyond what the mode said of itself, or when it is refused without need. Where the reference's own
//! noise is more than that, the case is called undecided. Any failure ends the command with code 1.

use crate::cli::exit::Exit;
use crate::cli::{options, screen};
use crate::optics::imager::Notice;
use crate::optics::stress::{Outcome, Settings, Verdict, run};

/// Try odd pads, lights, scales and scenes on the fast optics
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig stress optics\n  twinrig stress optics --only plate\n  twinrig stress optics --quick --json\n  twinrig stress optics --random 50 --seed 7\n  twinrig stress optics --random 50 --seed 7 --only 7:23,"
)]
pub struct Args {
    /// Every fourth case, on small pictures
    #[arg(long)]
    pub quick: bool,
    /// Only cases whose names hold this
    #[arg(long, value_name = "PART")]
    pub only: Option<String>,
    /// Scenes drawn at random, so many, instead of the usual cases
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub random: Option<u32>,
    /// Which scenes: those of a seed are always the same
    #[arg(long, default_value_t = 1, requires = "random")]
    pub seed: u64,
    /// Error asked for; from 0.002 to 0.01 it picks the work
    #[arg(long, default_value_t = 0.005, value_parser = options::tolerance)]
    pub tolerance: f64,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the sweep.
    pub fn run(self) -> Exit {
        Notice::of_tolerance(self.tolerance).into_iter().for_each(screen::warning);
        let (size, judge_samples, every) = if self.quick { ([64, 48], 32, 4) } else { ([96, 72], 64, 1) };
        let drawn = self.random.map(|count| (self.seed, count));
        let settings =
            Settings { size, judge_samples, tolerance: self.tolerance, every, only: self.only, drawn };
        let verdicts = run(&settings, |verdict| {
            if !self.json {
                show(verdict);
            }
        });
        if let ([], Some(part)) = (verdicts.as_slice(), &settings.only) {
            screen::error(format_args!(
                "--only {part}: no case has that in its name; run without it to see all names"
            ));
            return Exit::Refused;
        }
        let failed = verdicts.iter().filter(|v| !v.faults.is_empty()).count();
        let undecided =
            verdicts.iter().filter(|v| matches!(v.outcome, Outcome::Picture { undecided: true, .. })).count();
        match self.json {
            true => screen::json(
                &serde_json::json!({ "cases": verdicts.len(), "failed": failed, "undecided": undecided, "verdicts": verdicts }),
            ),
            false => screen::result(format_args!(
                "{} cases, {failed} failed, {undecided} undecided",
                verdicts.len()
            )),
        }
        if failed == 0 { Exit::Done } else { Exit::Failed }
    }
}

fn show(Verdict { case, outcome, faults }: &Verdict) {
    let unsure = matches!(outcome, Outcome::Picture { undecided: true, .. });
    let mark = match (faults.is_empty(), unsure) {
        (false, _) => "FAILED   ",
        (true, true) => "undecided",
        (true, false) => "ok       ",
    };
    match outcome {
        Outcome::Picture { error, floor, means, estimated, .. } => screen::result(format_args!(
            "{mark} {case:36} error {:5.2} % (floor {:.2} %), of means {:5.2} % ({:.2} %), estimated {:5.2} %",
            1e2 * error,
            1e2 * floor,
            1e2 * means[0],
            1e2 * means[1],
            1e2 * estimated
        )),
        Outcome::Refused { why } => screen::result(format_args!("{mark} {case:36} refused: {why}")),
    }
    faults.iter().for_each(|fault| screen::result(format_args!("       {fault}")));
}
