//! Verification: every sum, every pair, every table.

use super::columns::read_text_by_key;
use super::{Dataset, Error, MANIFEST, StoredFile};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// One thing that is not as it should be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The file concerned, relative to the dataset.
    pub path: String,
    /// What is wrong with it, and what to do.
    pub problem: String,
}

/// What verification found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verification {
    /// Captures the trajectory has.
    pub captures: usize,
    /// Real sides stored.
    pub real: usize,
    /// Simulated sides stored.
    pub sim: usize,
    /// Rows: pairs, or single sides of a one-sided dataset.
    pub rows: usize,
    /// Files whose sums were checked.
    pub files: usize,
    /// Everything that is wrong.
    pub findings: Vec<Finding>,
}

/// Checks a dataset as it lies on the disk.
pub fn verify(root: &Path) -> Result<Verification, Error> {
    let dataset = Dataset::open(root)?;
    let mut findings = Vec::new();
    let mut files = 0;
    let rows = dataset.rows();

    // Every file of every journal line.
    let mut stored: Vec<StoredFile> = Vec::new();
    for line in super::locked(&dataset.real).lines().values() {
        stored.extend(line.files.iter().cloned());
    }
    for line in super::locked(&dataset.sim).lines().values() {
        stored.extend(line.files.iter().cloned());
    }
    for file in &stored {
        files += 1;
        match std::fs::read(root.join(&file.path)) {
            Err(e) => findings
                .push(finding(&file.path, format!("cannot be read ({e}); collect --resume does it again"))),
            Ok(bytes) if sum(&bytes) != file.blake3 => {
                findings.push(finding(
                    &file.path,
                    "differs from the sum in the journal; collect --resume does it again".into(),
                ));
            }
            Ok(_) => {}
        }
    }

    // The trajectory is the one the provenance names.
    if dataset.trajectory().hash() != dataset.provenance().trajectory_hash {
        findings.push(finding(
            "trajectory.json",
            "is not the trajectory that dataset.json names; restore it".into(),
        ));
    }

    // What describes the rows is as it was when they were last written down.
    let in_journals: BTreeSet<&str> = stored.iter().map(|f| f.path.as_str()).collect();
    let manifest = std::fs::read_to_string(root.join(MANIFEST)).unwrap_or_default();
    for (written, path) in manifest.lines().filter_map(|line| line.split_once("  ")) {
        if in_journals.contains(path) || path.ends_with(".parquet") {
            continue;
        }
        files += 1;
        match std::fs::read(root.join(path)) {
            Err(e) => findings.push(finding(path, format!("cannot be read ({e}); restore it from a backup"))),
            Ok(bytes) if sum(&bytes) != written => {
                let why = "differs from the sum in MANIFEST.blake3; restore it from a backup, or run twinrig report if it was changed on purpose";
                findings.push(finding(path, why.into()));
            }
            Ok(_) => {}
        }
    }
    if !rows.is_empty() && manifest.is_empty() {
        findings.push(finding(MANIFEST, "is missing; twinrig report writes it".into()));
    }

    // The tables say what the journals say.
    let mut by_split: BTreeMap<&str, BTreeMap<i64, Vec<Option<String>>>> = BTreeMap::new();
    for row in &rows {
        let real = row.real.as_ref().map(|l| l.files[0].blake3.clone());
        let sim = |i: usize| row.sim.as_ref().and_then(|l| l.files.get(i)).map(|f| f.blake3.clone());
        let sums = vec![real, sim(0), sim(1), sim(2)];
        by_split.entry(dataset.split_of(row.capture)).or_default().insert(i64::from(row.capture), sums);
    }
    for (split, expected) in by_split {
        let path = format!("data/{split}/metadata.parquet");
        let table = std::fs::read(root.join(&path)).map_err(|e| e.to_string());
        let columns = ["real_blake3", "sim_blake3", "depth_blake3", "contact_mask_blake3"];
        match table.and_then(|bytes| read_text_by_key(bytes, "capture", &columns)) {
            Err(why) => {
                findings.push(finding(&path, format!("cannot be read ({why}); twinrig report rebuilds it")))
            }
            Ok(found) if found != expected => {
                findings
                    .push(finding(&path, "disagrees with the journals; twinrig report rebuilds it".into()));
            }
            Ok(_) => {}
        }
    }

    // Nothing lies among the data that no journal knows, but what a run that was cut off had begun; and no
    // journal tells of captures that the plan does not have.
    let (done_real, done_sim) = (dataset.done_real(), dataset.done_sim());
    let captures = dataset.trajectory().captures.len() as u32;
    let mut below = Vec::new();
    files_below(root, Path::new("data"), &mut below, &mut findings);
    below.sort();
    for path in below {
        let is_table = path.ends_with("metadata.parquet");
        let begun = capture_of(&path).is_some_and(|(side, capture)| {
            let done = if side == "real" { &done_real } else { &done_sim };
            capture < captures && !done.contains(&capture)
        });
        if !is_table && !begun && !in_journals.contains(path.as_str()) {
            let why = "is in no journal, so load_dataset may take it for data; move it out of data/";
            findings.push(finding(&path, why.into()));
        }
    }
    for (journal, done) in [("journal/real.ndjson", &done_real), ("journal/sim.ndjson", &done_sim)] {
        let beyond: Vec<String> = done.range(captures..).map(u32::to_string).collect();
        if !beyond.is_empty() {
            let (list, last) = (beyond.join(", "), captures.saturating_sub(1));
            let why =
                format!("tells of captures {list}, but the plan ends at {last}; it belongs to another plan");
            findings.push(finding(journal, why));
        }
    }

    let (real, sim) = (done_real.len(), done_sim.len());
    Ok(Verification {
        captures: dataset.trajectory().captures.len(),
        real,
        sim,
        rows: rows.len(),
        files,
        findings,
    })
}

/// Side and capture that a file below `data/` is named after.
fn capture_of(path: &str) -> Option<(&str, u32)> {
    let mut words = path.rsplit('/');
    let (file, side) = (words.next()?, words.next()?);
    let capture = file.split('.').next()?.parse().ok()?;
    ["real", "sim", "depth", "contact"].contains(&side).then_some((side, capture))
}

/// All files below a folder of a dataset, by their path in it. What cannot be looked into is a finding: nobody
/// knows what lies there.
fn files_below(root: &Path, folder: &Path, found: &mut Vec<String>, findings: &mut Vec<Finding>) {
    let text = |path: &Path| path.to_string_lossy().replace('\\', "/");
    let unread = |path: &Path, e: &std::io::Error| {
        let why = format!(
            "cannot be looked into ({e}), so nothing is known of what lies there; mend its permissions"
        );
        finding(&text(path), why)
    };
    let entries = match std::fs::read_dir(root.join(folder)) {
        Ok(entries) => entries,
        // Before the first capture there is no such folder.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return,
        Err(e) => return findings.push(unread(folder, &e)),
    };
    for entry in entries {
        let entry = match entry {
            Ok(entry) => entry,
            Err(e) => {
                findings.push(unread(folder, &e));
                continue;
            }
        };
        let path = folder.join(entry.file_name());
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => files_below(root, &path, found, findings),
            Ok(_) => found.push(text(&path)),
            Err(e) => findings.push(unread(&path, &e)),
        }
    }
}

fn finding(path: &str, problem: String) -> Finding {
    Finding { path: path.to_owned(), problem }
}

fn sum(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Whether a stored file is there and has its sum.
pub fn sum_matches(root: &Path, file: &StoredFile) -> bool {
    std::fs::read(root.join(&file.path)).is_ok_and(|bytes| sum(&bytes) == file.blake3)
}
