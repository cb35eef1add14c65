//! The benchmark of the elastomer: throughput, time to solution, error against run time, what skipping saves.
//!
//! Stages, each a file: [`throughput`] (particle-steps per second of the explicit modes by size and threads, their
//! memory, and the roofline of the machine), [`solution`] (time to solution of the quasi-static mode by tolerance), [`curves`] (error against run time of
//! all modes over their resolutions), [`skips`] (the same work with and without doing what a scene does not need).
//! [`peers`] holds other people's published figures, [`machine`] says on what was measured, [`files`] writes
//! tables and pictures.
//!
//! Every time is given as the least and the median of its repeats, and as processor time: on a machine that others use, the
//! least is nearest to the truth, and the distance to the median is the noise.

pub mod curves;
pub mod files;
pub mod machine;
pub mod peers;
pub mod skips;
pub mod solution;
pub mod throughput;
pub mod timing;

pub use timing::Timing;

use crate::elastomer::Error;
use serde::Serialize;

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effort {
    /// The least that exercises every part; its figures mean little.
    Smoke,
    /// About half a minute.
    Quick,
    /// A few minutes.
    Full,
}

/// All that was measured.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// On what.
    pub machine: machine::Machine,
    /// How much.
    pub effort: Effort,
    /// Explicit modes by size and threads.
    pub throughput: Vec<crate::elastomer::mpm::bench::Throughput>,
    /// Quasi-static mode by tolerance.
    pub solutions: Vec<solution::Solution>,
    /// Error against run time.
    pub curves: curves::Curves,
    /// What skipping saves.
    pub skips: Vec<skips::Skip>,
    /// Other people's figures.
    pub peers: Vec<peers::Peer>,
}

/// One thing to measure.
type Stage = (String, Box<dyn FnOnce(&mut Report) -> Result<(), Error> + Send>);

/// Measures everything; `progress` hears how many of how many stages are done and what comes next.
///
/// # Errors
/// When the standard scenes themselves cannot be set up. A solver that gives up is a row with its error.
pub fn run(effort: Effort, mut progress: impl FnMut(usize, usize, &str)) -> Result<Report, Error> {
    let mut stages: Vec<Stage> = Vec::new();
    throughput::plan(effort, &mut stages);
    solution::plan(effort, &mut stages);
    curves::plan(effort, &mut stages);
    skips::plan(effort, &mut stages);
    let mut report = Report {
        machine: machine::Machine::here(),
        effort,
        throughput: Vec::new(),
        solutions: Vec::new(),
        curves: curves::Curves::default(),
        skips: Vec::new(),
        peers: peers::all(),
    };
    let total = stages.len();
    for (done, (name, stage)) in stages.into_iter().enumerate() {
        progress(done, total, &name);
        // On a thread of the pool: from outside, every parallel loop would wait to be woken twice.
        rayon::scope(|_| stage(&mut report))?;
    }
    progress(total, total, "");
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smoke_run_measures_every_part_and_its_files_hold_it() {
        let mut heard = Vec::new();
        let report = run(Effort::Smoke, |done, total, _| heard.push((done, total))).expect("standard scenes");
        assert!(heard.len() > 5 && heard.last() == Some(&(heard.len() - 1, heard.len() - 1)));
        assert!(report.throughput.iter().all(|t| t.particle_steps_per_s > 1e4));
        assert!(report.solutions.iter().all(|s| s.time.as_ref().is_some_and(|t| t.min_s > 0.0)));
        let series: std::collections::BTreeSet<&str> =
            report.curves.points.iter().map(|p| p.series.as_str()).collect();
        assert!(["quasi_static", "mpm", "impm"].iter().all(|s| series.contains(s)), "{series:?}");
        // The coarse quasi-static solution is far nearer to the truth than the coarse transient.
        let error = |s: &str| {
            report.curves.points.iter().filter(|p| p.series == s).map(|p| p.rmse_um).fold(0.0, f64::max)
        };
        assert!(error("quasi_static") < 0.5 * error("mpm"), "{:?}", report.curves);
        let folder = tempfile::tempdir().expect("a folder");
        let written = files::write(&report, folder.path()).expect("room for a few kilobytes");
        assert!(written.len() >= 5 && written.iter().all(|p| p.exists()));
        let csv = std::fs::read_to_string(folder.path().join("error_vs_time.csv")).expect("just written");
        assert!(csv.lines().count() > report.curves.points.len() && csv.contains("peer"));
        // Every row of the throughput has all columns, and none beats the machine.
        let csv = std::fs::read_to_string(folder.path().join("throughput.csv")).expect("just written");
        let columns: Vec<usize> = csv
            .lines()
            .map(|l| l.split('"').step_by(2).map(|part| part.matches(',').count()).sum())
            .collect();
        assert!(columns.len() > 2 && columns.iter().all(|n| *n == columns[0]), "{columns:?}");
        assert!(report.throughput.iter().all(|t| t.of_peak > 0.0 && t.of_peak < 1.0 && t.of_stream > 0.0));
        let svg = std::fs::read_to_string(folder.path().join("error_vs_time.svg")).expect("just written");
        assert!(svg.starts_with("<svg") && svg.contains("quasi_static"));
    }
}
