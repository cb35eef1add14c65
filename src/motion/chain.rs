//! Arms with joints: where the tool is for given joint angles, and the angles for a given pose.
//!
//! A *chain* is a row of rotary joints from the base to the tool. *Forward* kinematics follows the row.
//! *Inverse* kinematics goes from a starting guess by damped least squares (Wampler 1986; Nakamura and
//! Hanafusa 1986): each step solves (J^T J + lambda^2 I) dq = J^T e, which stays tame where the arm is
//! stretched and J loses rank. Joint limits hold throughout: every step is clipped to them.
//!
//! What is asked for is the tip's position, and that the tool presses straight into the pad; the rotation
//! about the press direction is asked for where [`Chain::turns`] says so. (Five joints are enough for all of it
//! where the arm bends in one plane and the last joint rolls the tool, as on SO-101 and Koch.)
//!
//! *Straight lines*: joints that move evenly draw arcs. [`Chain::line`] halves a line until the arc between
//! neighbouring points stays within a tolerance of it.
//!
//! Lengths are mm, angles degrees. Angles count as the device's axes do; `zero_deg` of a joint is where it is
//! straight. The base stands in the pad frame, as does everything that comes out.
//! Nothing here knows a device, masses or collisions.

mod line;
mod reach;

use crate::pose::Pose;
use crate::problem::Problems;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// A serial chain of rotary joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Where the base stands in the pad frame.
    pub base: Place,
    /// From the base to the tool.
    pub joints: Vec<Joint>,
    /// The indenter's tip, seen from the last joint.
    pub tip: Place,
    /// Direction in the tip's frame that presses into the pad.
    pub press: [f64; 3],
    /// Whether the arm controls the rotation about the press direction.
    pub turns: bool,
}

/// A place relative to another: shifted, then turned about x, y and z of the other, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Place {
    /// Shift, mm.
    pub xyz_mm: [f64; 3],
    /// Roll, pitch and yaw, degrees.
    pub rpy_deg: [f64; 3],
}

/// One rotary joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// The device's axis that drives it.
    pub axis: String,
    /// Where it sits when it is straight, seen from the joint before it.
    pub origin: Place,
    /// What it turns about, in its own frame.
    pub about: [f64; 3],
    /// Position of the axis where the joint is straight, degrees.
    pub zero_deg: f64,
    /// Lowest position of the axis, degrees.
    pub min_deg: f64,
    /// Highest position of the axis, degrees.
    pub max_deg: f64,
}

/// A pose that the arm cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReachError {
    /// Too far, too near, or not with the tool upright.
    #[error(
        "({pose}) is out of the arm's reach: the nearest it comes is {off_mm:.2} mm away, tilted by {tilt_deg:.2} deg (from its first joint the pose is {distance_mm:.1} mm away; stretched out, the arm is {reach_mm:.1} mm long, with the tool upright it reaches less far); move the base of the arm, or choose another pose"
    )]
    OutOfReach {
        /// The pose asked for.
        pose: Pose,
        /// Distance that is left.
        off_mm: f64,
        /// Angle between the tool and the press direction that is left.
        tilt_deg: f64,
        /// Length of the stretched arm from its first joint to the tip.
        reach_mm: f64,
        /// Distance of the pose from the first joint.
        distance_mm: f64,
    },
    /// A joint would have to turn further than it may.
    #[error(
        "({pose}) needs joint {joint} at {value_deg:.2} deg, allowed are {min_deg} to {max_deg} deg; choose another pose, or correct the limits of the joint"
    )]
    BeyondJoint {
        /// The pose asked for.
        pose: Pose,
        /// The joint's axis.
        joint: String,
        /// The angle it would need.
        value_deg: f64,
        /// Lowest allowed.
        min_deg: f64,
        /// Highest allowed.
        max_deg: f64,
    },
    /// On a straight line the arm would have to fold over.
    #[error(
        "the straight line from ({from}) to ({to}) leads through a place where the arm would have to fold over; go there in two moves, through a pose further from its stretch"
    )]
    Folds {
        /// Where the line begins.
        from: Pose,
        /// Where it ends.
        to: Pose,
    },
}

impl ReachError {
    /// How bad it is, to tell the worst of many.
    pub fn excess(&self) -> f64 {
        match self {
            ReachError::OutOfReach { off_mm, tilt_deg, .. } => off_mm + tilt_deg,
            ReachError::BeyondJoint { value_deg, min_deg, max_deg, .. } => {
                (min_deg - value_deg).max(value_deg - max_deg)
            }
            ReachError::Folds { .. } => 0.0,
        }
    }
}

/// Where the tool is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tool {
    /// The tip, pad frame, mm.
    pub tip_mm: DVec3,
    /// The tip's frame in the pad frame.
    pub frame: DMat3,
}

/// Millimetres that weigh as much as a radian of tilt: about the length of such an arm.
const MM_PER_RAD: f64 = 100.0;
/// Near enough: a hundredth of what a servo of 4096 counts resolves at 200 mm.
const NEAR_MM: f64 = 1e-3;
/// Upright enough, radians.
const UPRIGHT_RAD: f64 = 1e-5;
/// Steps from one guess.
const MOST_STEPS: usize = 200;
/// A joint that turns further than this between neighbours of a line has changed its configuration.
const FOLD_DEG: f64 = 45.0;
/// Halvings of a line at most: 4096 pieces.
const MOST_HALVINGS: u32 = 12;

impl Place {
    fn turn(&self) -> DMat3 {
        let [r, p, y] = self.rpy_deg.map(f64::to_radians);
        DMat3::from_rotation_z(y) * DMat3::from_rotation_y(p) * DMat3::from_rotation_x(r)
    }
}

impl Chain {
    /// Reports everything that cannot be right.
    pub fn check(&self, problems: &mut Problems) {
        if self.joints.is_empty() {
            problems.push(
                "joints",
                "[]",
                "at least one joint",
                "describe the joints from the base to the tool",
            );
        }
        for (i, joint) in self.joints.iter().enumerate() {
            problems.within("joints", |p| {
                p.within(format!("[{i}]"), |p| {
                    // Not a number is not above anything.
                    let is_ordered = joint.min_deg < joint.max_deg;
                    if !is_ordered {
                        let allowed = format!("more than min_deg = {}", joint.min_deg);
                        p.push("max_deg", joint.max_deg, allowed, "set max_deg above min_deg");
                    }
                    if !is_direction(joint.about) {
                        p.push("about", format!("{:?}", joint.about), "a direction", "write e.g. [0, 0, 1]");
                    }
                });
            });
        }
        if !is_direction(self.press) {
            problems.push("press", format!("{:?}", self.press), "a direction", "write e.g. [0, 0, -1]");
        }
    }

    /// Where the tool is for these joint angles.
    pub fn tool(&self, joints_deg: &[f64]) -> Tool {
        self.walk(joints_deg, |_, _| {})
    }

    /// The pose for these joint angles; the tilt out of the press direction is lost in it.
    pub fn pose(&self, joints_deg: &[f64]) -> Pose {
        let tool = self.tool(joints_deg);
        let x = self.upright().mul_vec3(DVec3::X);
        let seen = tool.frame * x;
        let theta = seen.y.atan2(seen.x).to_degrees();
        Pose::new(tool.tip_mm.x, tool.tip_mm.y, tool.tip_mm.z, theta)
    }

    /// Length of the stretched arm from its first joint to the tip, mm.
    pub fn reach_mm(&self) -> f64 {
        let links = self.joints.iter().skip(1).map(|j| j.origin).chain([self.tip]);
        links.map(|place| DVec3::from(place.xyz_mm).length()).sum()
    }

    /// Where the first joint stands in the pad frame.
    fn shoulder_mm(&self) -> DVec3 {
        let first = self.joints.first().map_or(DVec3::ZERO, |joint| DVec3::from(joint.origin.xyz_mm));
        DVec3::from(self.base.xyz_mm) + self.base.turn() * first
    }

    /// Half way between the limits of every joint: where a search begins that knows nothing better.
    pub fn middle_deg(&self) -> Vec<f64> {
        self.joints.iter().map(|j| 0.5 * (j.min_deg + j.max_deg)).collect()
    }

    /// Follows the chain; `visit` gets each joint's place and what it turns about, pad frame.
    fn walk(&self, joints_deg: &[f64], mut visit: impl FnMut(DVec3, DVec3)) -> Tool {
        let (mut at, mut frame) = (DVec3::from(self.base.xyz_mm), self.base.turn());
        for (joint, angle) in self.joints.iter().zip(joints_deg) {
            at += frame * DVec3::from(joint.origin.xyz_mm);
            frame *= joint.origin.turn();
            let about = DVec3::from(joint.about).normalize();
            visit(at, frame * about);
            frame *= DMat3::from_axis_angle(about, (angle - joint.zero_deg).to_radians());
        }
        at += frame * DVec3::from(self.tip.xyz_mm);
        Tool { tip_mm: at, frame: frame * self.tip.turn() }
    }

    /// Turns the tip's frame so that it presses along -z of the pad frame, at theta 0.
    fn upright(&self) -> DMat3 {
        let press = DVec3::from(self.press).normalize();
        let turn = glam::DQuat::from_rotation_arc(DVec3::NEG_Z, press);
        DMat3::from_quat(turn)
    }
}

fn is_direction(v: [f64; 3]) -> bool {
    let length = DVec3::from(v).length();
    length.is_finite() && length > 1e-9
}

#[cfg(test)]
mod tests;
