//! The numbers of a report, for scripts: what the page says in its tables, in full precision.

use super::facts::{Facts, Shot, Where};
use crate::dataset::ImageScores;
use crate::image::bootstrap::grouped_mean_interval;
use serde::Serialize;

/// What `twinrig report --json` prints beside the path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Numbers {
    /// Captures the plan has.
    pub planned: usize,
    /// Captures of which there is a row.
    pub rows: usize,
    /// Real sides stored.
    pub real: usize,
    /// Simulated sides stored.
    pub simulated: usize,
    /// Captures whose sides were compared.
    pub compared: usize,
    /// Captures whose sides could not be compared.
    pub refused: Vec<Refused>,
    /// Whether the real side was made by the virtual bench.
    pub real_is_virtual: bool,
    /// Means over captures, over all of them and by indenter.
    pub scores: Vec<Score>,
    /// Time that the elastomer took, all captures together, s.
    pub elastomer_s: f64,
    /// Time that rendering took, s.
    pub render_s: f64,
    /// Largest distance of a measured pose from the commanded one, um.
    pub farthest_from_commanded_um: Option<f64>,
    /// Largest change of the background since the session began, code values RMS.
    pub largest_drift_rms: Option<f64>,
}

/// A capture that could not be compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Refused {
    /// Its index.
    pub capture: u32,
    /// Why.
    pub why: String,
}

/// One score, as a mean; captures with an infinite one (equal pictures) are left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// Of the captures of this indenter; of all where absent.
    pub indenter: Option<String>,
    /// `contact`, the box around what touching changes, or `whole`.
    pub place: &'static str,
    /// `psnr_db`, `ssim` or `mse`.
    pub score: &'static str,
    /// Of the simulation.
    pub simulation: Option<f64>,
    /// Of the untouched sensor's picture in its place.
    pub null_predictor: Option<f64>,
    /// Simulation minus null predictor, capture by capture.
    pub gain: Option<f64>,
    /// Its 95 % interval by resampling episodes; absent for fewer than three of them.
    pub gain_interval_95: Option<[f64; 2]>,
    /// Captures that have the score.
    pub captures: usize,
}

type Pick = fn(ImageScores) -> f64;
const SCORES: [(&str, Pick); 3] = [("psnr_db", |s| s.psnr_db), ("ssim", |s| s.ssim), ("mse", |s| s.mse)];

impl Numbers {
    pub(super) fn of(facts: &Facts) -> Numbers {
        let shots = &facts.shots;
        let mut scores = of_shots(None, &shots.iter().collect::<Vec<_>>());
        for name in facts.indenters() {
            scores.extend(of_shots(Some(name), &facts.of_indenter(name).collect::<Vec<_>>()));
        }
        let sims = || shots.iter().filter_map(|s| s.sim.as_ref()).map(|l| &l.record);
        let reals = || shots.iter().filter_map(|s| s.real.as_ref()).map(|l| &l.record);
        let refused = facts
            .pairing
            .refused
            .iter()
            .map(|(capture, why)| Refused { capture: *capture, why: why.clone() });
        Numbers {
            planned: facts.planned,
            rows: shots.len(),
            real: reals().count(),
            simulated: sims().count(),
            compared: facts.pairing.pairs.len(),
            refused: refused.collect(),
            real_is_virtual: facts.provenance.real_is_virtual,
            scores,
            elastomer_s: sims().map(|r| r.elastomer_ms * 1e-3).sum(),
            render_s: sims().map(|r| r.render_ms * 1e-3).sum(),
            farthest_from_commanded_um: reals()
                .map(|r| r.measured.distance_mm(&r.commanded) * 1e3)
                .reduce(f64::max),
            largest_drift_rms: reals().map(|r| r.drift_rms).reduce(f64::max),
        }
    }
}

/// All scores of some captures; none where nothing was compared.
fn of_shots(indenter: Option<&str>, shots: &[&Shot]) -> Vec<Score> {
    let mut scores = Vec::new();
    for (place, at) in [("contact", Where::Contact), ("whole", Where::Full)] {
        for (score, pick) in SCORES {
            let picked: Vec<(usize, f64, f64)> = (shots.iter())
                .filter_map(|s| s.scores(at).map(|(m, n)| (s.mark.episode as usize, pick(m), pick(n))))
                .collect();
            if picked.is_empty() {
                continue;
            }
            let mean = |values: &mut dyn Iterator<Item = f64>| {
                let finite: Vec<f64> = values.filter(|v| v.is_finite()).collect();
                (!finite.is_empty()).then(|| finite.iter().sum::<f64>() / finite.len() as f64)
            };
            let gains: Vec<f64> = picked.iter().map(|(_, m, n)| m - n).collect();
            let groups: Vec<usize> = picked.iter().map(|(episode, ..)| *episode).collect();
            let episodes: std::collections::BTreeSet<usize> = groups.iter().copied().collect();
            let interval = grouped_mean_interval(&gains, &groups, 0.95, super::tables::RESAMPLES, 1);
            scores.push(Score {
                indenter: indenter.map(str::to_owned),
                place,
                score,
                simulation: mean(&mut picked.iter().map(|(_, m, _)| *m)),
                null_predictor: mean(&mut picked.iter().map(|(.., n)| *n)),
                gain: interval.map(|i| i.mean),
                gain_interval_95: interval.filter(|_| episodes.len() >= 3).map(|i| [i.low, i.high]),
                captures: picked.len(),
            });
        }
    }
    scores
}
