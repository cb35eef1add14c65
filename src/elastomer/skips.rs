//! What is not done because a scene does not need it, and how to have it done all the same.
//!
//! Every skip has a word for `elastomer.without`: what is named there is done as a simulator without the skip would do it.
//! That shows what a skip saves (`twinrig bench elastomer`), and that an answer does not hang on it. Some skips change no bit of an
//! answer; the others change it by less than its stated error.

use super::Mode;
use serde::{Deserialize, Serialize};

/// Something that is not done where it is not needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Skip {
    /// Nothing is computed before the first touch. Without: each increment through the air is looked at on every grid, or stepped
    /// through. Exact, but for the forces of an explicit capture within ten steps of the first touch, which are means of the last ten.
    FirstTouch,
    /// A waypoint starts from the one before. Without: each is followed to from rest, along the whole way since the pad was at rest,
    /// its straight parts in one, for what sticks or rubs depends on the way. Within the stated errors.
    WarmStart,
    /// Cells grow in height away from the face. Without: all are as high as the uppermost. Within the stated errors.
    GrowingCells,
    /// The face is finer than the cells where it is pressed, and there alone. Without: cells half as wide everywhere, and the face as
    /// their splines have it. Within the stated errors.
    Relief,
    /// What touches without friction has no anchors along the face. Without: it has, and they bear nothing. Within the stated errors.
    Frictionless,
    /// Blocks of particles at rest stay as they are. Without: they are computed. Exact.
    Rest,
    /// Paths with a common beginning (the left and the right slide of one press) walk it once. Without: each episode presses by
    /// itself. Exact, but for the noise of pictures: captures in one place share theirs no more.
    SharedPaths,
    /// A path ends at the last waypoint that a capture needs. Without: each episode that has one is walked to its end. Exact.
    NeededWaypoints,
}

impl Skip {
    /// All of them.
    pub const ALL: [Skip; 8] = [
        Skip::FirstTouch,
        Skip::WarmStart,
        Skip::GrowingCells,
        Skip::Relief,
        Skip::Frictionless,
        Skip::Rest,
        Skip::SharedPaths,
        Skip::NeededWaypoints,
    ];

    /// The word that a rig file has for it.
    pub fn name(self) -> &'static str {
        match self {
            Skip::FirstTouch => "first_touch",
            Skip::WarmStart => "warm_start",
            Skip::GrowingCells => "growing_cells",
            Skip::Relief => "relief",
            Skip::Frictionless => "frictionless",
            Skip::Rest => "rest",
            Skip::SharedPaths => "shared_paths",
            Skip::NeededWaypoints => "needed_waypoints",
        }
    }

    /// The modes that have it.
    pub fn modes(self) -> &'static [Mode] {
        match self {
            Skip::FirstTouch | Skip::SharedPaths | Skip::NeededWaypoints => {
                &[Mode::QuasiStatic, Mode::Impm, Mode::Mpm]
            }
            Skip::WarmStart | Skip::GrowingCells | Skip::Relief | Skip::Frictionless => &[Mode::QuasiStatic],
            Skip::Rest => &[Mode::Impm, Mode::Mpm],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skips_are_called_as_files_call_them() {
        for skip in Skip::ALL {
            assert_eq!(serde_json::to_value(skip).expect("a word"), skip.name());
        }
    }
}
