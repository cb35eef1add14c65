//! An arm with joints as a machine with straight axes.
//!
//! A [`Chain`] knows where the tool is; an arm also knows how straight its moves have to be. Its tool's axes are the
//! coordinates of the pad frame, by name.

use super::chain::{Chain, ReachError};
use super::pose_map::Coordinate;
use crate::pose::Pose;

/// A chain, and how far its tip may leave a straight line.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    /// Its joints.
    pub chain: Chain,
    /// How far the tip may leave the straight line of a move, mm.
    pub line_mm: f64,
}

impl Arm {
    /// The coordinate that an axis of the tool is, by its name.
    pub fn coordinate(axis: &str) -> Option<Coordinate> {
        Coordinate::ALL.into_iter().find(|c| c.name() == axis)
    }

    /// Position of an axis of the tool for these joint positions; `None` for an axis that it has not.
    pub fn tool_axis(&self, axis: &str, joints_deg: &[f64]) -> Option<f64> {
        Some(Self::coordinate(axis)?.of(&self.chain.pose(joints_deg)))
    }

    /// Joint positions along the straight line to a pose, the last of them at it.
    ///
    /// # Errors
    /// When a pose on the way cannot be taken, or not without folding over.
    pub fn line(&self, from_deg: &[f64], to: &Pose) -> Result<Vec<Vec<f64>>, ReachError> {
        self.chain.line(from_deg, to, self.line_mm)
    }
}
