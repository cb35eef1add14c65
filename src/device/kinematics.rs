//! What a rig file says about an arm with joints: its chain, its tool, and what the tool may do.
//!
//! With this table a device's axes are *joints*, and what `[motion]` names are the axes of its *tool*: `x`, `y`, `z`
//! and, where the table has it, `theta`, in the pad frame. The mover turns one into the other
//! ([`super::mover`]); `check` finds poses that the arm cannot take ([`crate::plan`]).

use super::settings::{Approach, AxisSettings};
use crate::motion::{Arm, AxisKind, Chain, Coordinate, Joint, Place, ReachError};
use crate::pose::Pose;
use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// `[devices.<name>.kinematics]`: a serial chain of the device's axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kinematics {
    /// Where the base stands in the pad frame.
    pub base: Place,
    /// From the base to the tool; each names an axis of the device.
    pub joints: Vec<JointSettings>,
    /// The indenter's tip, seen from the last joint.
    pub tip: Place,
    /// Direction in the tip's frame that presses into the pad.
    pub press: [f64; 3],
    /// How far the tip may leave the straight line of a move, mm.
    #[serde(default = "default_line_mm")]
    pub line_mm: f64,
    /// In what steps the joints take a feed, deg/s; 0 where that is of no account. Feeds that are rounded differently
    /// part, the more the longer a move lasts: so moves are cut into pieces that end before `line_mm` is reached.
    #[serde(default)]
    pub feed_step_deg_s: f64,
    /// Where homing leads, with the tool upright: x, y and z in the pad frame, mm. From wherever the arm is, all
    /// joints move there evenly.
    pub ready_mm: [f64; 3],
    /// Feed of the fastest joint on the way there, deg/s.
    #[serde(default = "default_ready_deg_s")]
    pub ready_deg_s: f64,
    /// What the tool may do along (and about) each coordinate of the pad frame.
    pub tool: ToolTravel,
}

fn default_line_mm() -> f64 {
    0.05
}

fn default_ready_deg_s() -> f64 {
    20.0
}

/// One joint of the chain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSettings {
    /// The device's axis that drives it; its `min` and `max` are the joint's limits.
    pub axis: String,
    /// Where it sits when it is straight, seen from the joint before it.
    pub origin: Place,
    /// What it turns about, in its own frame; reversed where the axis counts the other way.
    pub about: [f64; 3],
    /// Position of the axis where the joint is straight, degrees.
    #[serde(default)]
    pub zero_deg: f64,
}

/// What the tool may do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolTravel {
    /// Along x.
    pub x: ToolAxis,
    /// Along y.
    pub y: ToolAxis,
    /// Along z.
    pub z: ToolAxis,
    /// About z; absent on an arm that does not control the rotation of its tool.
    pub theta: Option<ToolAxis>,
}

/// What the tool may do along one coordinate: an axis that several joints make together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolAxis {
    /// Lowest allowed position.
    pub min: f64,
    /// Highest allowed position.
    pub max: f64,
    /// Fastest allowed feed, per second.
    pub max_feed: f64,
    /// Acceleration, per second squared (time estimates).
    pub accel: f64,
    /// Largest accepted difference between where it was sent and where the measured joints put it.
    pub tolerance: f64,
    /// Always arrive from this side, overshooting by `distance`, against backlash.
    pub approach: Option<Approach>,
}

impl ToolAxis {
    fn as_axis(&self, kind: AxisKind) -> AxisSettings {
        let ToolAxis { min, max, max_feed, accel, tolerance, approach } = *self;
        let (wire, counts_per_unit) = (String::new(), None);
        AxisSettings { wire, kind, min, max, max_feed, accel, counts_per_unit, tolerance, approach }
    }
}

impl Kinematics {
    /// The axes of the tool, as any others are described.
    pub fn tool_axes(&self) -> BTreeMap<String, AxisSettings> {
        let ToolTravel { x, y, z, theta } = &self.tool;
        let each = [
            (Coordinate::X, Some(x)),
            (Coordinate::Y, Some(y)),
            (Coordinate::Z, Some(z)),
            (Coordinate::Theta, theta.as_ref()),
        ];
        let named = |(coordinate, axis): (Coordinate, Option<&ToolAxis>)| {
            let kind = if coordinate == Coordinate::Theta { AxisKind::Rotary } else { AxisKind::Linear };
            Some((coordinate.name().to_owned(), axis?.as_axis(kind)))
        };
        each.into_iter().filter_map(named).collect()
    }

    /// The arm that these joints make, with the limits of their axes; a joint whose axis is missing has none.
    pub fn arm(&self, axes: &BTreeMap<String, AxisSettings>) -> Arm {
        let joint = |j: &JointSettings| {
            let (min_deg, max_deg) = axes.get(&j.axis).map_or((-360.0, 360.0), |a| (a.min, a.max));
            let JointSettings { axis, origin, about, zero_deg } = j.clone();
            Joint { axis, origin, about, zero_deg, min_deg, max_deg }
        };
        let joints = self.joints.iter().map(joint).collect();
        let turns = self.tool.theta.is_some();
        let chain = Chain { base: self.base, joints, tip: self.tip, press: self.press, turns };
        Arm { chain, line_mm: self.line_mm }
    }

    /// Where homing leads.
    pub fn ready(&self) -> Pose {
        let [x, y, z] = self.ready_mm;
        Pose::new(x, y, z, 0.0)
    }

    /// Reports everything that cannot be right.
    pub fn check(&self, axes: &BTreeMap<String, AxisSettings>, problems: &mut Problems) {
        problems.range("line_mm", self.line_mm, 1e-3, 10.0, "mm");
        problems.range("feed_step_deg_s", self.feed_step_deg_s, 0.0, 30.0, "deg/s");
        problems.range("ready_deg_s", self.ready_deg_s, 0.01, 360.0, "deg/s");
        for (i, joint) in self.joints.iter().enumerate() {
            problems.within("joints", |p| {
                p.within(format!("[{i}]"), |p| {
                    let known = axes.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                    match axes.get(&joint.axis) {
                        None => {
                            let next = "name an axis of this device";
                            p.push("axis", format!("{:?}", joint.axis), known.clone(), next);
                        }
                        Some(axis) if axis.kind != AxisKind::Rotary => {
                            let next = "joints turn: name another axis, or correct its kind";
                            p.push("axis", format!("{:?}, a linear axis", joint.axis), "a rotary axis", next);
                        }
                        Some(_) => {}
                    }
                    if self.joints[..i].iter().any(|other| other.axis == joint.axis) {
                        let next = "each joint has an axis of its own";
                        p.push("axis", format!("{:?} a second time", joint.axis), known, next);
                    }
                });
            });
        }
        for (name, axis) in self.tool_axes() {
            problems.within("tool", |p| p.within(name.as_str(), |p| axis.check(p)));
            if axes.contains_key(&name) {
                problems.push(
                    &format!("tool.{name}"),
                    format!("an axis {name} of the tool and one of the device"),
                    "one axis of a name",
                    "call the joint otherwise",
                );
            }
        }
        for name in axes.keys().filter(|name| !self.joints.iter().any(|j| j.axis == **name)) {
            problems.push(
                "joints",
                format!("no joint of axis {name}"),
                "a joint for each axis of the device",
                format!("describe the joint that {name} drives, or leave the axis out"),
            );
        }
        // What limits lack is said where the axes are.
        let before = Problems::new();
        let sound = |mut p: Problems| {
            self.arm(axes).chain.check(&mut p);
            p
        };
        let found = sound(before).into_vec();
        let is_sound = found.is_empty();
        for problem in found.into_iter().filter(|p| !p.key.ends_with("max_deg")) {
            problems.push(&problem.key, problem.value, problem.allowed, problem.next);
        }
        let limited = |a: &AxisSettings| a.min.is_finite() && a.max.is_finite() && a.min < a.max;
        let reachable = is_sound && self.joints.iter().all(|j| axes.get(&j.axis).is_some_and(limited));
        if let (true, Err(error)) = (reachable, self.ready_joints(axes)) {
            let said = error.to_string();
            let (what, next) = said.rsplit_once("; ").unwrap_or((&said, "choose another pose"));
            problems.push("ready_mm", what, "a pose that the arm can take, tool upright", next);
        }
    }

    /// The corners of the tool's box of limits that the arm cannot take: how many of how many, and the worst of them,
    /// told. Such a box promises more than there is; poses in it that are out of reach are refused one by one.
    pub fn corners_out_of_reach(
        &self,
        axes: &BTreeMap<String, AxisSettings>,
    ) -> Option<(usize, usize, ReachError)> {
        let chain = self.arm(axes).chain;
        let ends = |axis: &ToolAxis| [axis.min, axis.max];
        let turns = self.tool.theta.as_ref().map_or(vec![0.0], |theta| ends(theta).to_vec());
        let (mut all, mut missed) = (0, Vec::new());
        for x in ends(&self.tool.x) {
            for y in ends(&self.tool.y) {
                for z in ends(&self.tool.z) {
                    for theta in &turns {
                        all += 1;
                        missed.extend(chain.joints(&Pose::new(x, y, z, *theta), &chain.middle_deg()).err());
                    }
                }
            }
        }
        let count = missed.len();
        let worst = missed.into_iter().max_by(|a, b| a.excess().total_cmp(&b.excess()))?;
        Some((count, all, worst))
    }

    /// The axis positions of the ready pose, in the order of the joints.
    pub fn ready_joints(&self, axes: &BTreeMap<String, AxisSettings>) -> Result<Vec<f64>, ReachError> {
        let chain = self.arm(axes).chain;
        chain.joints(&self.ready(), &chain.middle_deg())
    }
}
