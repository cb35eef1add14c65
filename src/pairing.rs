//! Pairing: real and simulated frame of one capture, compared.
//!
//! Frames are joined by capture mark, never by nearest time. Each comparison is made over the whole
//! picture and over the contact region (the box around the simulated contact, widened by a margin), and each
//! stands beside the *null predictor*: the untouched sensor's picture shown instead of the simulation. Most of
//! a tactile image never changes, so a number without its null says little.
//!
//! The untouched picture is the one taken before the indenter's captures in the same run. A global shift
//! between the two sides is estimated once for the whole dataset and reported; it is removed only when
//! asked for ([`Alignment`]), so that it cannot hide an error of the model.
//!
//! Nothing is run here: a dataset can be paired again years later.

use crate::dataset::{self, Dataset, ImageScores, PairMetrics};
use crate::image::align::{self, Shift};
use crate::image::metrics::{Metrics, compare_whole_and_within};
use crate::image::{self, Mask, Picture, PixelBox, View, arithmetic, png};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// By how many pixels the contact box is widened on each side, so that the rim of the contact counts.
pub const CONTACT_MARGIN_PX: u32 = 12;

/// At most so many pairs, evenly spread, take part in estimating the global shift.
const SHIFT_PAIRS: usize = 15;

/// Name of the picture of the untouched sensor that stands in when a run has none of its own.
const FIRST_BACKGROUND: &str = "background-000";

/// What is done about a global shift between the sides.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// Pictures are compared as they are.
    #[default]
    Off,
    /// The estimated shift is removed, both pictures cropped to what they share.
    Estimated,
    /// This shift (of the simulated against the real picture) is removed.
    Given(Shift),
}

/// One pair, scored.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// Which capture.
    pub capture: u32,
    /// The scores.
    pub metrics: PairMetrics,
    /// The contact region in pixels of the real picture, margin included.
    pub region: Option<PixelBox>,
}

/// A whole dataset, paired.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Pairing {
    /// The pairs, by capture.
    pub pairs: Vec<Pair>,
    /// Captures with both sides that could not be compared, and why.
    pub refused: Vec<(u32, String)>,
    /// The estimated shift of the simulated against the real pictures; absent without enough contact.
    pub shift: Option<Shift>,
    /// The shift that was removed before comparing.
    pub removed: Option<Shift>,
}

impl Pairing {
    /// The scores by capture, as the dataset's tables take them.
    pub fn metrics(&self) -> BTreeMap<u32, PairMetrics> {
        self.pairs.iter().map(|p| (p.capture, p.metrics)).collect()
    }
}

/// One capture's pictures.
struct Pictures {
    real: Picture,
    sim: Picture,
    untouched: Arc<Picture>,
}

/// Pairs everything a dataset has both sides of, on all cores.
///
/// # Errors
/// When the dataset has pairs but no picture of the untouched sensor. A pair whose files cannot be read or
/// compared is listed in [`Pairing::refused`] instead.
pub fn pair(dataset: &Dataset, alignment: Alignment) -> Result<Pairing, Error> {
    let rows: Vec<dataset::Row> =
        dataset.rows().into_iter().filter(|r| r.real.is_some() && r.sim.is_some()).collect();
    if rows.is_empty() {
        return Ok(Pairing::default());
    }
    let backgrounds = Backgrounds::of(dataset, &rows)?;
    let shift = estimate_shift(dataset, &rows, &backgrounds);
    let removed = match alignment {
        Alignment::Off => None,
        Alignment::Estimated => shift,
        Alignment::Given(shift) => Some(shift),
    };
    let scored: Vec<Result<Pair, (u32, String)>> = rows
        .par_iter()
        .map(|row| score(dataset, row, &backgrounds, removed).map_err(|e| (row.capture, e.to_string())))
        .collect();
    let mut pairing = Pairing { shift, removed, ..Pairing::default() };
    for pair in scored {
        match pair {
            Ok(pair) => pairing.pairs.push(pair),
            Err(refused) => pairing.refused.push(refused),
        }
    }
    Ok(pairing)
}

fn score(
    dataset: &Dataset,
    row: &dataset::Row,
    backgrounds: &Backgrounds,
    removed: Option<Shift>,
) -> Result<Pair, Error> {
    let mut pictures = read(dataset, row, backgrounds)?;
    let region = region(row, pictures.real.width, pictures.real.height);
    let mut mask = region.map(|r| Mask::from_box(pictures.real.width, pictures.real.height, r));
    if let Some(shift) = removed {
        // The untouched picture comes from the same camera as the real one: it is cropped, not shifted.
        let (real, sim) = align::apply(&pictures.real, &pictures.sim, shift)?;
        let (x, y) = align::origin(shift);
        let untouched = View::from(&*pictures.untouched).crop(x, y, real.width, real.height)?;
        mask = mask.map(|m| {
            Mask::from_fn(real.width, real.height, |i, j| m.inside[((j + y) * m.width + i + x) as usize])
        });
        pictures = Pictures { real, sim, untouched: Arc::new(untouched) };
    }
    let (full, contact) = compare_whole_and_within(&pictures.real, &pictures.sim, mask.as_ref())?;
    let (null_full, null_contact) =
        compare_whole_and_within(&pictures.real, &*pictures.untouched, mask.as_ref())?;
    let metrics = PairMetrics {
        full: scores(full),
        contact: contact.map(scores),
        null_full: scores(null_full),
        null_contact: null_contact.map(scores),
    };
    Ok(Pair { capture: row.capture, metrics, region })
}

fn scores(m: Metrics) -> ImageScores {
    ImageScores { mse: m.mse, psnr_db: m.psnr_db, ssim: m.ssim }
}

/// The contact box with its margin.
fn region(row: &dataset::Row, width: u32, height: u32) -> Option<PixelBox> {
    let [x0, y0, x1, y1] = row.sim.as_ref()?.record.contact_box_px?;
    let m = CONTACT_MARGIN_PX;
    Some(PixelBox {
        x0: x0.saturating_sub(m),
        y0: y0.saturating_sub(m),
        x1: x1.saturating_add(m).min(width),
        y1: y1.saturating_add(m).min(height),
    })
}

fn read(dataset: &Dataset, row: &dataset::Row, backgrounds: &Backgrounds) -> Result<Pictures, Error> {
    let (Some(real), Some(sim)) = (&row.real, &row.sim) else {
        return Err(Error::Unpaired { capture: row.capture });
    };
    Ok(Pictures {
        real: png::decode(&dataset.read_file(&real.files[0])?)?,
        sim: png::decode(&dataset.read_file(&sim.files[0])?)?,
        untouched: backgrounds.of_row(dataset, row),
    })
}

/// Where the simulated contact lies relative to the real one, from what touching changes in each.
fn estimate_shift(dataset: &Dataset, rows: &[dataset::Row], backgrounds: &Backgrounds) -> Option<Shift> {
    let touching: Vec<&dataset::Row> =
        rows.iter().filter(|r| r.sim.as_ref().is_some_and(|s| s.record.contact_box_px.is_some())).collect();
    let stride = touching.len().div_ceil(SHIFT_PAIRS).max(1);
    let one = |row: &&dataset::Row| -> Option<Shift> {
        let p = read(dataset, row, backgrounds).ok()?;
        let real = arithmetic::difference(&p.real, &*p.untouched, 1.0).ok()?;
        let sim = arithmetic::difference(&p.sim, &*p.untouched, 1.0).ok()?;
        align::find(&real, &sim).ok()
    };
    let chosen: Vec<&dataset::Row> = touching.into_iter().step_by(stride).collect();
    let shifts: Vec<Shift> = chosen.par_iter().filter_map(one).collect();
    (shifts.len() >= 3).then(|| align::consensus(&shifts)).flatten()
}

/// Pictures of the untouched sensor by run and indenter.
struct Backgrounds {
    by_run: BTreeMap<(String, String), Arc<Picture>>,
    first: Option<Arc<Picture>>,
}

impl Backgrounds {
    fn of(dataset: &Dataset, rows: &[dataset::Row]) -> Result<Backgrounds, Error> {
        let decode = |name: &str| -> Result<Option<Arc<Picture>>, Error> {
            dataset.background(name).map(|b| Ok(Arc::new(png::decode(&b)?))).transpose()
        };
        let names = names(dataset);
        let mut by_run = BTreeMap::new();
        for row in rows {
            let key = key(dataset, row);
            if by_run.contains_key(&key) {
                continue;
            }
            // `<run>-<number>-<indenter>`: the first of this run and indenter.
            let own = names.iter().find(|n| {
                let middle = n
                    .strip_prefix(&format!("{}-", key.0))
                    .and_then(|n| n.strip_suffix(&format!("-{}", key.1)));
                middle.is_some_and(|m| m.chars().all(|c| c.is_ascii_digit()))
            });
            if let Some(picture) = own.map(|n| decode(n)).transpose()?.flatten() {
                by_run.insert(key, picture);
            }
        }
        let first = decode(FIRST_BACKGROUND)?;
        let all_have_one = rows.iter().all(|r| by_run.contains_key(&key(dataset, r)));
        if first.is_none() && !all_have_one {
            return Err(Error::NoBackground { dataset: dataset.root().display().to_string() });
        }
        Ok(Backgrounds { by_run, first })
    }

    fn of_row(&self, dataset: &Dataset, row: &dataset::Row) -> Arc<Picture> {
        let own = self.by_run.get(&key(dataset, row));
        own.or(self.first.as_ref()).expect("checked when the backgrounds were read").clone()
    }
}

/// Stems of the files under `background/`, sorted.
fn names(dataset: &Dataset) -> Vec<String> {
    let files = std::fs::read_dir(dataset.root().join("background")).into_iter().flatten().flatten();
    let stem = |e: std::fs::DirEntry| e.file_name().to_string_lossy().strip_suffix(".png").map(str::to_owned);
    let mut names: Vec<String> = files.filter_map(stem).collect();
    names.sort();
    names
}

fn key(dataset: &Dataset, row: &dataset::Row) -> (String, String) {
    let trajectory = dataset.trajectory();
    let episode = trajectory.captures[row.capture as usize].episode as usize;
    let run = row.real.as_ref().map(|r| r.record.session.clone()).unwrap_or_default();
    (run, trajectory.episodes[episode].indenter.clone())
}

/// Why pictures could not be paired.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The dataset.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The pictures.
    #[error(transparent)]
    Image(#[from] image::Error),
    /// One side is missing.
    #[error("capture {capture} has only one side; resume the collection")]
    Unpaired {
        /// Which.
        capture: u32,
    },
    /// Nothing to compare with.
    #[error(
        "{dataset} has no picture of the untouched sensor (background/{FIRST_BACKGROUND}.png), so there is no null predictor; collect again or restore it"
    )]
    NoBackground {
        /// The folder.
        dataset: String,
    },
}

#[cfg(test)]
pub(crate) mod tests;
