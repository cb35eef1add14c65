//! Which axis of which device moves the indenter along which coordinate of the pad frame.
//!
//! Motion is the indenter's relative to the sensor, whichever device moves: an arm that lifts the
//! sensor and a stage that slides the indenter are both just signs and origins here.

use crate::pose::Pose;
use serde::{Deserialize, Serialize};

/// One coordinate of the relative pose, as one device axis provides it:
/// `axis position = origin + sign * coordinate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisRole {
    /// Device of the rig file (`arm`, `stage`).
    pub device: String,
    /// Axis of that device.
    pub axis: String,
    /// +1 when the axis counts as the coordinate does, -1 when it runs the other way.
    pub sign: f64,
    /// Axis position at which the coordinate is 0, mm or degrees. For z: the nominal contact.
    pub origin: f64,
}

impl AxisRole {
    /// The axis position that puts the coordinate at `coordinate`.
    pub fn to_axis(&self, coordinate: f64) -> f64 {
        self.origin + self.sign * coordinate
    }

    /// The coordinate at an axis position.
    pub fn to_coordinate(&self, position: f64) -> f64 {
        (position - self.origin) * self.sign
    }
}

/// The four coordinates. One that no axis provides stays at 0, and plans that need it are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseMap {
    /// Along x of the pad frame.
    pub x: Option<AxisRole>,
    /// Along y of the pad frame.
    pub y: Option<AxisRole>,
    /// Along z of the pad frame: every rig presses.
    pub z: AxisRole,
    /// About z.
    pub theta: Option<AxisRole>,
}

/// A coordinate of the pad frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinate {
    /// Along x.
    X,
    /// Along y.
    Y,
    /// Along z.
    Z,
    /// About z.
    Theta,
}

impl Coordinate {
    /// All four, in order.
    pub const ALL: [Coordinate; 4] = [Coordinate::X, Coordinate::Y, Coordinate::Z, Coordinate::Theta];

    /// Its value in a pose.
    pub fn of(self, pose: &Pose) -> f64 {
        match self {
            Coordinate::X => pose.x_mm,
            Coordinate::Y => pose.y_mm,
            Coordinate::Z => pose.z_mm,
            Coordinate::Theta => pose.theta_deg,
        }
    }

    /// Its place in a pose.
    pub fn of_mut(self, pose: &mut Pose) -> &mut f64 {
        match self {
            Coordinate::X => &mut pose.x_mm,
            Coordinate::Y => &mut pose.y_mm,
            Coordinate::Z => &mut pose.z_mm,
            Coordinate::Theta => &mut pose.theta_deg,
        }
    }

    /// Its name as files write it.
    pub fn name(self) -> &'static str {
        match self {
            Coordinate::X => "x",
            Coordinate::Y => "y",
            Coordinate::Z => "z",
            Coordinate::Theta => "theta",
        }
    }
}

impl PoseMap {
    /// The axis that provides a coordinate, if one does.
    pub fn role(&self, coordinate: Coordinate) -> Option<&AxisRole> {
        match coordinate {
            Coordinate::X => self.x.as_ref(),
            Coordinate::Y => self.y.as_ref(),
            Coordinate::Z => Some(&self.z),
            Coordinate::Theta => self.theta.as_ref(),
        }
    }

    /// The pose that results from axis positions, asked for by device and axis name.
    pub fn pose(&self, mut position: impl FnMut(&str, &str) -> f64) -> Pose {
        let mut at =
            |role: Option<&AxisRole>| role.map_or(0.0, |r| r.to_coordinate(position(&r.device, &r.axis)));
        Pose::new(at(self.x.as_ref()), at(self.y.as_ref()), at(Some(&self.z)), at(self.theta.as_ref()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_runs_the_other_way_maps_back() {
        let z = AxisRole { device: "arm".into(), axis: "z".into(), sign: -1.0, origin: 20.0 };
        assert_eq!(z.to_axis(-0.5), 20.5);
        assert_eq!(z.to_coordinate(20.5), -0.5);
        let map = PoseMap { x: None, y: None, z, theta: None };
        assert_eq!(map.pose(|_, _| 18.0), Pose::new(0.0, 0.0, 2.0, 0.0));
    }
}
