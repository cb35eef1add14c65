//! Would this plan be safe and possible on that rig? Answered without a device.
//!
//! The walk goes over every waypoint of the trajectory, the descent of the touch-off and the
//! overshoot of a one-sided approach, at the lowest and at the highest contact zero that can
//! result. Since every move is a straight line between two checked points of a box, no position on
//! the way can be outside. It is the first of three fences: the mover checks again before each
//! move, and the firmware has limits of its own.
//!
//! What is found:
//! - [`axes`]: targets outside the travel, feeds too fast, coordinates that no axis provides;
//! - [`reach`]: poses that an arm with joints cannot take, and lines on which it would have to fold over;
//! - [`contact`]: a press too deep for the pad or the indenter, an indenter that misses or leaves it,
//!   sideways motion that is neither in contact nor at clearance.
//!
//! Each rule reports its worst case once, under the key of the plan that causes it.

mod axes;
mod contact;
mod reach;
#[cfg(test)]
mod rules;

use super::Plan;
use crate::elastomer::Pad;
use crate::indenter::Indenter;
use crate::motion::{Arm, AxisLimits, AxisRole, PoseMap, Trajectory};
use crate::problem::Problems;
use std::collections::BTreeMap;
use std::sync::Arc;

pub use axes::check as check_axes;
pub use contact::{DEEPEST_SHARE, EDGE_MARGIN_MM};

/// What one axis of the rig may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fence {
    /// Travel, fastest feed, acceleration.
    pub limits: AxisLimits,
    /// Where a move begins its final approach, relative to its target: negative from below,
    /// positive from above, 0 where there is no one-sided approach.
    pub overshoot: f64,
}

/// The axes of a rig and what they do to the pose.
#[derive(Debug, Clone, PartialEq)]
pub struct RigFences {
    /// Which axis provides which coordinate.
    pub map: PoseMap,
    /// Every axis, by device and axis name.
    pub axes: BTreeMap<(String, String), Fence>,
    /// Devices whose axes are the joints of an arm: what those axes are then is made by it.
    pub arms: BTreeMap<String, Arm>,
}

impl RigFences {
    /// The fence of the axis in a role.
    pub fn fence(&self, role: &AxisRole) -> Option<&Fence> {
        self.axes.get(&(role.device.clone(), role.axis.clone()))
    }
}

/// Everything beside the plan that the check looks at.
#[derive(Debug, Clone, Copy)]
pub struct Bench<'a> {
    /// The axes.
    pub rig: &'a RigFences,
    /// The pad of the sensor.
    pub pad: &'a Pad,
    /// The plan's indenters by name.
    pub indenters: &'a BTreeMap<String, Arc<dyn Indenter>>,
}

/// Reports everything that makes `trajectory`, the expansion of `plan`, unsafe or impossible.
/// Key paths are those of the plan file.
pub fn check(plan: &Plan, trajectory: &Trajectory, bench: &Bench<'_>, problems: &mut Problems) {
    axes::check(plan, trajectory, bench.rig, problems);
    reach::check(plan, trajectory, bench.rig, problems);
    contact::check(plan, trajectory, bench, problems);
}

#[cfg(test)]
pub(crate) mod stand_ins {
    //! A bench for tests: generous axes, the paper's pad, and indenters made of boxes.

    use super::*;
    use crate::elastomer::{Law, Material};
    use crate::motion::AxisKind;
    use glam::DVec3;

    /// A square punch on a wider square base.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Punch {
        pub half_mm: f64,
        pub base_half_mm: f64,
        pub tall_mm: f64,
    }

    impl Indenter for Punch {
        fn name(&self) -> &str {
            "punch"
        }
        fn distance(&self, p: DVec3) -> f64 {
            self.distance_and_normal(p).0
        }
        fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
            (-p.z, DVec3::NEG_Z)
        }
        fn half_extent_mm(&self) -> [f64; 2] {
            [self.base_half_mm, self.base_half_mm]
        }
        fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
            let r = x_mm.abs().max(y_mm.abs());
            (r <= self.base_half_mm).then_some(if r <= self.half_mm { 0.0 } else { self.tall_mm })
        }
    }

    pub(crate) fn role(device: &str, axis: &str, sign: f64, origin: f64) -> AxisRole {
        AxisRole { device: device.into(), axis: axis.into(), sign, origin }
    }

    /// An arm with x, y and z that lifts the sensor (z runs the other way), a stage that turns.
    pub(crate) fn rig() -> RigFences {
        let map = PoseMap {
            x: Some(role("arm", "x", 1.0, 50.0)),
            y: Some(role("arm", "y", -1.0, 50.0)),
            z: role("arm", "z", -1.0, 20.0),
            theta: Some(role("stage", "turn", 1.0, 0.0)),
        };
        let linear =
            AxisLimits { kind: AxisKind::Linear, min: 0.0, max: 100.0, max_feed: 20.0, accel: 200.0 };
        let turn = AxisLimits { kind: AxisKind::Rotary, min: -90.0, max: 90.0, max_feed: 60.0, accel: 300.0 };
        let axes =
            [("arm", "x", linear), ("arm", "y", linear), ("arm", "z", linear), ("stage", "turn", turn)]
                .into_iter()
                .map(|(d, a, limits)| ((d.to_owned(), a.to_owned()), Fence { limits, overshoot: 0.0 }))
                .collect();
        RigFences { map, axes, arms: BTreeMap::new() }
    }

    pub(crate) fn pad() -> Pad {
        let material = Material {
            law: Law::FixedCorotated,
            youngs_modulus_mpa: 0.145,
            poisson_ratio: 0.45,
            density_g_mm3: 1.0,
        };
        Pad::slab([20.0, 20.0, 4.0], material)
    }

    pub(crate) fn indenters(plan: &Plan, half_mm: f64) -> BTreeMap<String, Arc<dyn Indenter>> {
        let punch: Arc<dyn Indenter> = Arc::new(Punch { half_mm, base_half_mm: 8.0, tall_mm: 3.0 });
        plan.indenters.iter().map(|i| (i.name.clone(), punch.clone())).collect()
    }
}
