//! The twin: our physical model of the rig, following the same trajectory.
//!
//! It turns a trajectory into simulated captures: [`branches`] finds what paths have in common,
//! [`simulate`] walks them with an elastomer (its [`crew`] several at a time), [`view`] makes the picture, the depth map and the
//! contact mask that the sensor's camera would give. It knows motion, elastomer and optics; it opens no device and no file.
//!
//! What it leaves out: the indenter's own colour (the coating is opaque), heat, creep, dust.

mod agenda;
pub mod branches;
pub mod contact_mask;
pub mod crew;
pub mod doubt;
pub mod simulate;
pub mod view;

pub use crew::Crew;
pub use doubt::Doubts;
pub use simulate::{Deformed, Model, Outcome, Walk};
pub use view::{Picture, View, Wear, untouched_face};

use crate::elastomer::ElastomerCapture;
use crate::image;
use crate::motion::Trajectory;
use crate::optics;
use crate::optics::judge::Judged;
use serde::{Deserialize, Serialize};

/// Which poses the twin follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FollowedPoses {
    /// Those of the plan.
    #[default]
    Commanded,
    /// Those the bench reported.
    Measured,
}

impl FollowedPoses {
    /// Its name as files write it.
    pub fn name(self) -> &'static str {
        match self {
            FollowedPoses::Commanded => "commanded",
            FollowedPoses::Measured => "measured",
        }
    }
}

/// Everything the twin needs.
#[derive(Debug)]
pub struct Twin {
    /// Pad, solver settings, indenters.
    pub model: Model,
    /// Camera, lights, picture.
    pub view: View,
    /// Which poses to follow.
    pub follow: FollowedPoses,
    /// Seed of everything random.
    pub seed: u64,
    /// The cores it works on.
    pub crew: Crew,
    /// What was said of answers that are in doubt.
    pub doubts: Doubts,
}

impl Twin {
    /// Gets ready to wear a picture of the untouched sensor (or none).
    pub fn wear(&self, untouched: Option<&image::Picture>) -> Result<Wear, optics::Error> {
        self.view.wear(untouched, &self.model.pad)
    }

    /// The picture of a deformed pad; `capture` numbers it, so that each has its own noise.
    pub fn picture(
        &self,
        pad: &ElastomerCapture,
        wear: &Wear,
        capture: u32,
    ) -> Result<Picture, optics::Error> {
        self.view.picture(pad, wear, capture)
    }

    /// How far the light of that picture is from two of the reference mode, of so many samples a pixel each.
    pub fn judged(&self, pad: &ElastomerCapture, wear: &Wear, samples: u32) -> Result<Judged, optics::Error> {
        self.view.judged(pad, wear, samples)
    }

    /// Warns, once, of an answer of the elastomer that is in doubt. Its captures are those of `trajectory`.
    pub fn tell_doubts(&self, deformed: &Deformed, trajectory: &Trajectory) {
        let mut marks = deformed.captures.iter().map(|capture| &trajectory.captures[*capture as usize]);
        let slid = marks.any(|mark| mark.slip_mm != 0.0 || mark.rotation_deg != 0.0);
        self.doubts.tell(&deformed.captures, slid, &deformed.pad.stats, &self.model.settings);
    }

    /// Lattice on which the pad's face is sampled for pictures.
    pub fn lattice_for_pictures(&self) -> [usize; 2] {
        self.model.settings.surface
    }
}
