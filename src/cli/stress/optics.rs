//! `twinrig stress optics`: odd pads, lights, scales and scenes.
//!
//! Sharp indenters, drags of 5 mm, folds, lights that graze, touch walls or point elsewhere, albedos of 0 and 1, lattices
//! of 1 to a million triangles, scenes without anything: each is rendered by the fast mode and held against two
//! reference pictures, or refused with a message. A case fails when a pixel is no light or brighter than all light there is,
//! when the error is beyond what the mode said of itself, or when it is refused without need. Any failure ends the command
//! with code 1.

use crate::cli::exit::Exit;
use crate::cli::{options, screen};
use crate::optics::stress::{Outcome, Settings, Verdict, run};

/// Try odd pads, lights, scales and scenes on the fast optics
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig stress optics\n  twinrig stress optics --quick --json")]
pub struct Args {
    /// Every fourth case, on small pictures
    #[arg(long)]
    pub quick: bool,
    /// Error asked for
    #[arg(long, default_value_t = 0.005, value_parser = options::tolerance)]
    pub tolerance: f64,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the sweep.
    pub fn run(self) -> Exit {
        let settings = match self.quick {
            true => Settings { size: [64, 48], judge_samples: 32, tolerance: self.tolerance, every: 4 },
            false => Settings { size: [96, 72], judge_samples: 64, tolerance: self.tolerance, every: 1 },
        };
        let verdicts = run(&settings, |verdict| {
            if !self.json {
                show(verdict);
            }
        });
        let failed = verdicts.iter().filter(|v| !v.faults.is_empty()).count();
        match self.json {
            true => screen::json(
                &serde_json::json!({ "cases": verdicts.len(), "failed": failed, "verdicts": verdicts }),
            ),
            false => screen::result(format_args!("{} cases, {failed} failed", verdicts.len())),
        }
        if failed == 0 { Exit::Done } else { Exit::Failed }
    }
}

fn show(Verdict { case, outcome, faults }: &Verdict) {
    let mark = if faults.is_empty() { "ok    " } else { "FAILED" };
    match outcome {
        Outcome::Picture { error, floor, estimated } => screen::result(format_args!(
            "{mark} {case:36} error {:5.2} % (floor {:.2} %), estimated {:5.2} %",
            1e2 * error,
            1e2 * floor,
            1e2 * estimated
        )),
        Outcome::Refused { why } => screen::result(format_args!("{mark} {case:36} refused: {why}")),
    }
    faults.iter().for_each(|fault| screen::result(format_args!("       {fault}")));
}
