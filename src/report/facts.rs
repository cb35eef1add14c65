//! Everything the page speaks about, gathered once.

use crate::dataset::{Dataset, ImageScores, Line, PairMetrics, Provenance, RealRecord, SimRecord};
use crate::image::PixelBox;
use crate::motion::{CaptureMark, Primitive};
use crate::pairing::Pairing;
use std::collections::BTreeMap;

/// One capture with whatever there is of it.
#[derive(Debug, Clone)]
pub struct Shot {
    pub capture: u32,
    pub mark: CaptureMark,
    pub indenter: String,
    pub primitive: Primitive,
    pub location_mm: [f64; 2],
    pub real: Option<Line<RealRecord>>,
    pub sim: Option<Line<SimRecord>>,
    pub metrics: Option<PairMetrics>,
    pub region: Option<PixelBox>,
}

/// The dataset as the page sees it.
pub struct Facts {
    pub provenance: Provenance,
    pub shots: Vec<Shot>,
    pub planned: usize,
    pub pairing: Pairing,
    pub sessions: Vec<serde_json::Value>,
}

/// Which of the scores of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Where {
    Full,
    Contact,
}

impl Facts {
    pub fn gather(dataset: &Dataset, pairing: &Pairing) -> Facts {
        let trajectory = dataset.trajectory();
        let scored: BTreeMap<u32, _> = pairing.pairs.iter().map(|p| (p.capture, p)).collect();
        let shot = |row: crate::dataset::Row| {
            let mark = trajectory.captures[row.capture as usize].clone();
            let episode = &trajectory.episodes[mark.episode as usize];
            let pair = scored.get(&row.capture);
            Shot {
                capture: row.capture,
                indenter: episode.indenter.clone(),
                primitive: episode.primitive,
                location_mm: episode.location_mm,
                mark,
                metrics: pair.map(|p| p.metrics),
                region: pair.and_then(|p| p.region),
                real: row.real,
                sim: row.sim,
            }
        };
        let notes =
            std::fs::read_to_string(dataset.root().join("journal/sessions.ndjson")).unwrap_or_default();
        Facts {
            provenance: dataset.provenance().clone(),
            shots: dataset.rows().into_iter().map(shot).collect(),
            planned: trajectory.captures.len(),
            pairing: pairing.clone(),
            // A torn last note is not worth a word here: the journals of the captures are what counts.
            sessions: notes.lines().filter_map(|l| serde_json::from_str(l).ok()).collect(),
        }
    }

    /// Names of the indenters, in order of appearance.
    pub fn indenters(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for shot in &self.shots {
            if !names.contains(&shot.indenter.as_str()) {
                names.push(&shot.indenter);
            }
        }
        names
    }

    pub fn of_indenter<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Shot> {
        self.shots.iter().filter(move |s| s.indenter == name)
    }
}

impl Shot {
    /// Scores of the simulation and of the null predictor.
    pub fn scores(&self, place: Where) -> Option<(ImageScores, ImageScores)> {
        let m = self.metrics?;
        match place {
            Where::Full => Some((m.full, m.null_full)),
            Where::Contact => m.contact.zip(m.null_contact),
        }
    }

    /// Distance slid, to the right (or down) positive.
    pub fn signed_slip_mm(&self) -> f64 {
        let (s, c) = self.mark.slip_direction_deg.to_radians().sin_cos();
        let along = if c.abs() > 0.5 { c } else { s };
        if along < 0.0 { -self.mark.slip_mm } else { self.mark.slip_mm }
    }

    /// What was done, in few words.
    pub fn caption(&self) -> String {
        let m = &self.mark;
        let mut text = format!("#{} · {} · {:.2} mm deep", self.capture, self.indenter, m.depth_mm);
        match self.primitive {
            Primitive::Press => {
                text += &format!(" at ({:.1}, {:.1})", self.location_mm[0], self.location_mm[1]);
            }
            Primitive::Slip if m.slip_mm == 0.0 => text += " · before the slide",
            Primitive::Slip => {
                text += &format!(" · slid {:.1} mm {}", m.slip_mm, direction(m.slip_direction_deg))
            }
            Primitive::Rotate if m.rotation_deg == 0.0 => text += " · before the turn",
            Primitive::Rotate => {
                let sense = if m.rotation_deg > 0.0 { "clockwise" } else { "counter-clockwise" };
                text += &format!(" · turned {:.0}° {sense}", m.rotation_deg.abs());
            }
        }
        text
    }
}

fn direction(deg: f64) -> String {
    match deg.rem_euclid(360.0).round() as i64 {
        0 | 360 => "right".into(),
        90 => "down".into(),
        180 => "left".into(),
        270 => "up".into(),
        other => format!("at {other}°"),
    }
}
