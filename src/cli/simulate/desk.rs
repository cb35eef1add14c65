//! Where outcomes arrive: each is rendered, written and accounted for.

use super::account::{Account, Ended};
use super::verdict::Verdicts;
use super::{Args, SimulateError, screen};
use crate::dataset::depth;
use crate::image::{npy, png};
use crate::motion::Trajectory;
use crate::optics::basis_folder;
use crate::optics::judge::Judged;
use crate::pose::Pose;
use crate::twin::{Deformed, Outcome, Picture, Twin, Wear};

pub(super) struct Desk<'a> {
    pub args: &'a Args,
    pub twin: &'a Twin,
    /// What the pad wears; `None` where nothing is rendered.
    pub wear: Option<&'a Wear>,
    pub trajectory: &'a Trajectory,
    pub bar: &'a indicatif::ProgressBar,
    pub account: Account,
    pub verdicts: Verdicts,
}

impl Desk<'_> {
    /// Answers whether the work goes on.
    pub fn take(&self, outcome: Outcome) -> bool {
        let taken = match outcome {
            Outcome::Failed { captures, error } => self.failed(&captures, &error.to_string()),
            Outcome::Deformed(deformed) => {
                self.twin.tell_doubts(&deformed, self.trajectory);
                self.store(&deformed)
            }
        };
        taken.map_err(|e| self.account.fail(e)).is_ok()
    }

    fn failed(&self, captures: &[u32], why: &str) -> Result<(), SimulateError> {
        self.bar.inc(captures.len() as u64);
        self.bar.suspend(|| screen::warning(format_args!("captures {captures:?}: {why}")));
        captures.iter().try_for_each(|capture| {
            let mark = &self.trajectory.captures[*capture as usize];
            let mut line =
                self.row(*capture, "failed", self.trajectory.waypoints[mark.waypoint as usize].pose);
            line["error"] = serde_json::json!(why);
            self.account.add(*capture, Ended::Failed, line.to_string())
        })
    }

    fn store(&self, deformed: &Deformed) -> Result<(), SimulateError> {
        let picture = match self.wear {
            Some(wear) => Some(self.twin.picture(&deformed.pad, wear, deformed.captures[0])?),
            None => None,
        };
        let judged = self.judged(deformed)?;
        for capture in &deformed.captures {
            let surface = &deformed.pad.surface;
            if self.args.surface {
                let bytes = npy::encode(surface.ny, surface.nx, &surface.positions);
                self.write(&format!("surface/{capture:06}.npy"), &bytes)?;
            }
            if let Some(basis) = picture.as_ref().and_then(|picture| picture.basis.as_ref()) {
                basis_folder::write(&self.args.out.join(format!("basis/{capture:06}")), basis)?;
            }
            if let Some(picture) = &picture {
                self.write(&format!("sim/{capture:06}.png"), &png::encode(&picture.image)?)?;
                let (w, h) = (picture.image.width, picture.image.height);
                self.write(&format!("depth/{capture:06}.tiff"), &depth::encode(w, h, &picture.depth_mm)?)?;
            }
            if let (Some(judged), Some(picture)) = (judged, &picture) {
                self.verdicts.add(*capture, judged, picture.estimated_error);
            }
            let line = self.line(*capture, deformed, picture.as_ref().map(|picture| (picture, judged)));
            self.account.add(*capture, Ended::Simulated, line)?;
            self.bar.inc(1);
        }
        Ok(())
    }

    /// How far its picture is from the truth, where that is asked for.
    fn judged(&self, deformed: &Deformed) -> Result<Option<Judged>, SimulateError> {
        let asked = self.args.judge.zip(self.wear);
        Ok(asked.map(|(samples, wear)| self.twin.judged(&deformed.pad, wear, samples)).transpose()?)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), SimulateError> {
        let path = self.args.out.join(name);
        std::fs::write(&path, bytes).map_err(|e| SimulateError::Write { path, why: e.to_string() })
    }

    /// What every line of `captures.jsonl` tells.
    fn row(&self, capture: u32, status: &str, pose: Pose) -> serde_json::Value {
        let mark = &self.trajectory.captures[capture as usize];
        serde_json::json!({
            "capture": capture,
            "status": status,
            "indenter": self.trajectory.episodes[mark.episode as usize].indenter,
            "pose": pose,
        })
    }

    /// The line of a capture that was simulated.
    fn line(&self, capture: u32, deformed: &Deformed, picture: Option<(&Picture, Option<Judged>)>) -> String {
        let (forces, pad) = (&deformed.pad.forces, &deformed.pad);
        let mut line = self.row(capture, "simulated", deformed.pose);
        line["normal_force_n"] = serde_json::json!(forces.normal_force_n);
        line["shear_force_n"] = serde_json::json!(forces.shear_force_n);
        line["torque_n_mm"] = serde_json::json!(forces.torque_n_mm);
        line["solver"] = serde_json::json!(pad.stats);
        line["seconds"] = serde_json::json!(deformed.took.as_secs_f64());
        if let Some((picture, judged)) = picture {
            line["render_seconds"] = serde_json::json!(picture.took.as_secs_f64());
            line["optics_mode"] = serde_json::json!(picture.method.name());
            line["spp"] = serde_json::json!(picture.method.samples());
            line["light_error"] = serde_json::json!(picture.estimated_error);
            line["light_meets_tolerance"] = serde_json::json!(picture.meets_tolerance);
            if let Some(Judged { error, floor }) = judged {
                line["light_error_found"] = serde_json::json!(error);
                line["light_error_floor"] = serde_json::json!(floor);
            }
        }
        line.to_string()
    }
}
