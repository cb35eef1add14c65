//! Limits of one axis, and the one pure function that checks a target against them.
//!
//! The same function is called when a plan is checked and again before each move is sent;
//! the firmware's own limits are the third fence.

use serde::{Deserialize, Serialize};

/// Whether an axis counts millimetres or degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisKind {
    /// Positions in mm, feeds in mm/s.
    Linear,
    /// Positions in degrees, feeds in deg/s.
    Rotary,
}

impl AxisKind {
    /// The unit of positions on such an axis.
    pub fn unit(self) -> &'static str {
        match self {
            AxisKind::Linear => "mm",
            AxisKind::Rotary => "deg",
        }
    }
}

/// What an axis may do, in its own units (mm or degrees, and per second).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AxisLimits {
    /// Millimetres or degrees.
    pub kind: AxisKind,
    /// Lowest allowed position.
    pub min: f64,
    /// Highest allowed position.
    pub max: f64,
    /// Fastest allowed feed.
    pub max_feed: f64,
    /// Acceleration used for time estimates and by emulators.
    pub accel: f64,
}

/// A target or a feed outside the limits of an axis.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LimitError {
    /// The position is outside the travel.
    #[error(
        "axis {axis}: target {target} {unit} is outside {min} to {max} {unit}; choose a target inside, or correct the axis limits in the rig file"
    )]
    Position {
        /// Name of the axis in the rig file.
        axis: String,
        /// The refused target.
        target: f64,
        /// Lowest allowed position.
        min: f64,
        /// Highest allowed position.
        max: f64,
        /// `mm` or `deg`.
        unit: &'static str,
    },
    /// The feed is not positive or too fast.
    #[error(
        "axis {axis}: feed {feed} {unit}/s is outside 0 (exclusive) to {max_feed} {unit}/s; choose a feed inside"
    )]
    Feed {
        /// Name of the axis in the rig file.
        axis: String,
        /// The refused feed.
        feed: f64,
        /// Fastest allowed feed.
        max_feed: f64,
        /// `mm` or `deg`.
        unit: &'static str,
    },
}

impl AxisLimits {
    /// Checks a target position. NaN and infinities are never allowed.
    pub fn check_position(&self, axis: &str, target: f64) -> Result<(), LimitError> {
        if target >= self.min && target <= self.max {
            return Ok(());
        }
        let unit = self.kind.unit();
        Err(LimitError::Position { axis: axis.to_owned(), target, min: self.min, max: self.max, unit })
    }

    /// Checks a feed, in units per second.
    pub fn check_feed(&self, axis: &str, feed: f64) -> Result<(), LimitError> {
        if feed > 0.0 && feed <= self.max_feed {
            return Ok(());
        }
        Err(LimitError::Feed { axis: axis.to_owned(), feed, max_feed: self.max_feed, unit: self.kind.unit() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const Z: AxisLimits =
        AxisLimits { kind: AxisKind::Linear, min: -2.0, max: 50.0, max_feed: 5.0, accel: 100.0 };

    #[test]
    fn not_a_number_is_never_allowed() {
        assert!(Z.check_position("z", f64::NAN).is_err());
        assert!(Z.check_feed("z", f64::NAN).is_err());
        assert!(Z.check_feed("z", 0.0).is_err());
    }

    proptest! {
        #[test]
        fn what_passes_is_inside(target in proptest::num::f64::ANY) {
            prop_assert_eq!(Z.check_position("z", target).is_ok(), (-2.0..=50.0).contains(&target));
        }
    }
}
