//! The virtual world: what virtual movers move and the virtual camera sees.
//!
//! Movers report every leg of motion as a feed profile with its start; the camera asks for the
//! scene at the instant of an exposure, which may lie a little in the past, so legs are kept for a
//! while. Positions here are *true* ones. What a firmware believes about them (before homing, after
//! lost steps) is its own affair, and so is the nominal contact of the rig file: the pad's face is
//! `contact_offset_mm` above where the rig file says, so that touch-off has something to find.
//!
//! An arm with joints has its tool where its joints put it: true joints, true kinematics.
//!
//! Nothing here answers bytes and nothing here draws.

use crate::clock::Timestamp;
use crate::indenter::Indenter;
use crate::motion::{Arm, PoseMap, Profile};
use crate::pose::Pose;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard};

/// Legs of motion remembered for each axis.
const HISTORY: usize = 256;

/// The shared world. Clones are handles to the same one.
#[derive(Clone)]
pub struct World(Arc<Mutex<Inner>>);

struct Inner {
    map: Option<PoseMap>,
    /// Devices whose axes are joints.
    arms: BTreeMap<String, Arm>,
    contact_offset_mm: f64,
    axes: BTreeMap<(String, String), VecDeque<Leg>>,
    indenter: Option<Arc<dyn Indenter>>,
}

#[derive(Clone, Copy)]
struct Leg {
    starts: Timestamp,
    profile: Profile,
}

/// What there is to see at one instant.
#[derive(Debug, Clone)]
pub struct WorldScene {
    /// True pose of the mounted indenter relative to the pad's true face.
    pub pose: Pose,
    /// What is mounted.
    pub indenter: Option<Arc<dyn Indenter>>,
}

impl WorldScene {
    /// Whether another scene shows the same body in the same place.
    pub fn is(&self, other: &WorldScene) -> bool {
        let same_body = match (&self.indenter, &other.indenter) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        same_body && self.pose == other.pose
    }
}

impl World {
    /// A world with a pad whose true face lies `contact_offset_mm` above the nominal contact.
    pub fn new(map: PoseMap, contact_offset_mm: f64) -> Self {
        Self::with_arms(map, BTreeMap::new(), contact_offset_mm)
    }

    /// As [`World::new`], where the axes of some devices are the joints of arms.
    pub fn with_arms(map: PoseMap, arms: BTreeMap<String, Arm>, contact_offset_mm: f64) -> Self {
        Self::with_map(Some(map), arms, contact_offset_mm)
    }

    /// A world with movers only, for emulators that nobody watches. Its pose is always zero.
    pub fn without_pad() -> Self {
        Self::with_map(None, BTreeMap::new(), 0.0)
    }

    fn with_map(map: Option<PoseMap>, arms: BTreeMap<String, Arm>, contact_offset_mm: f64) -> Self {
        let inner = Inner { map, arms, contact_offset_mm, axes: BTreeMap::new(), indenter: None };
        World(Arc::new(Mutex::new(inner)))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // A panic elsewhere cannot leave the world half changed: every change is one assignment.
        self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Puts an axis somewhere, at rest, forgetting what it did before.
    pub fn place(&self, device: &str, axis: &str, at: f64) {
        let leg = Leg { starts: Timestamp(i64::MIN), profile: Profile::at_rest(at) };
        self.lock().axes.insert((device.to_owned(), axis.to_owned()), VecDeque::from([leg]));
    }

    /// From `starts` on, the axis follows `profile`; legs that were to start later are dropped.
    pub fn follow(&self, device: &str, axis: &str, starts: Timestamp, profile: Profile) {
        let mut inner = self.lock();
        let legs = inner.axes.entry((device.to_owned(), axis.to_owned())).or_default();
        while legs.back().is_some_and(|leg| leg.starts >= starts) {
            legs.pop_back();
        }
        legs.push_back(Leg { starts, profile });
        if legs.len() > HISTORY {
            legs.pop_front();
        }
    }

    /// True position of an axis; 0 for one that no mover ever placed.
    pub fn position(&self, device: &str, axis: &str, t: Timestamp) -> f64 {
        self.lock().position(device, axis, t)
    }

    /// True velocity of an axis, per second.
    pub fn velocity(&self, device: &str, axis: &str, t: Timestamp) -> f64 {
        let inner = self.lock();
        inner.leg(device, axis, t).map_or(0.0, |(profile, elapsed_s)| profile.velocity_at(elapsed_s))
    }

    /// Decelerates an axis to rest from `t` on; returns when it rests.
    pub fn stop(&self, device: &str, axis: &str, t: Timestamp) -> Timestamp {
        let stop = self.lock().leg(device, axis, t).map(|(profile, elapsed_s)| profile.stop_at(elapsed_s));
        let Some(stop) = stop else { return t };
        self.follow(device, axis, t, stop);
        t.after(stop.duration())
    }

    /// Mounts an indenter, or takes it off: what the operator does between indenters.
    pub fn mount(&self, indenter: Option<Arc<dyn Indenter>>) {
        self.lock().indenter = indenter;
    }

    /// Height of the pad's true face above the nominal contact, mm: what touch-off should find.
    pub fn contact_offset_mm(&self) -> f64 {
        self.lock().contact_offset_mm
    }

    /// What there is to see at `t`.
    pub fn scene_at(&self, t: Timestamp) -> WorldScene {
        let inner = self.lock();
        let mut pose = match &inner.map {
            Some(map) => map.pose(|device, axis| inner.pose_axis(device, axis, t)),
            None => Pose::default(),
        };
        pose.z_mm -= inner.contact_offset_mm;
        WorldScene { pose, indenter: inner.indenter.clone() }
    }
}

impl Inner {
    /// The leg that is active at `t`, and the seconds since it began.
    fn leg(&self, device: &str, axis: &str, t: Timestamp) -> Option<(Profile, f64)> {
        let legs = self.axes.get(&(device.to_owned(), axis.to_owned()))?;
        let leg = legs.iter().rev().find(|leg| leg.starts <= t).or(legs.front())?;
        let placed = leg.starts.0 == i64::MIN;
        Some((leg.profile, if placed { 0.0 } else { t.seconds_since(leg.starts) }))
    }

    /// An axis that poses are made of: the tool's where there is one, or else the device's own.
    fn pose_axis(&self, device: &str, axis: &str, t: Timestamp) -> f64 {
        let of_the_tool = self.arms.get(device).and_then(|arm| {
            let joints: Vec<f64> =
                arm.chain.joints.iter().map(|joint| self.position(device, &joint.axis, t)).collect();
            arm.tool_axis(axis, &joints)
        });
        of_the_tool.unwrap_or_else(|| self.position(device, axis, t))
    }

    fn position(&self, device: &str, axis: &str, t: Timestamp) -> f64 {
        self.leg(device, axis, t).map_or(0.0, |(profile, elapsed_s)| profile.position_at(elapsed_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::AxisRole;
    use std::time::Duration;

    fn pressing() -> World {
        let role = AxisRole { device: "arm".into(), axis: "z".into(), sign: -1.0, origin: 20.0 };
        World::new(PoseMap { x: None, y: None, z: role, theta: None }, 0.1)
    }

    #[test]
    fn the_camera_sees_a_press_while_and_after_it_happens() {
        let (world, t0) = (pressing(), Timestamp(5_000_000_000));
        world.place("arm", "z", 15.0);
        assert!((world.scene_at(t0).pose.z_mm - 4.9).abs() < 1e-9);
        world.follow("arm", "z", t0, Profile::new(15.0, 20.0, 10.0, 100.0));
        let half = t0.after(Duration::from_millis(300));
        assert!((world.scene_at(half).pose.z_mm - 2.4).abs() < 1e-9);
        assert!((world.scene_at(t0.after(Duration::from_secs(9))).pose.z_mm + 0.1).abs() < 1e-9);
        // An exposure that began before the move still sees the indenter up.
        assert!((world.scene_at(t0.before(Duration::from_millis(1))).pose.z_mm - 4.9).abs() < 1e-9);
    }

    #[test]
    fn a_stop_replaces_legs_that_were_still_to_come() {
        let (world, t0) = (pressing(), Timestamp(0));
        world.place("arm", "z", 0.0);
        world.follow("arm", "z", t0.after(Duration::from_secs(5)), Profile::new(0.0, 20.0, 10.0, 100.0));
        world.follow("arm", "z", t0.after(Duration::from_secs(1)), Profile::at_rest(0.0));
        assert_eq!(world.position("arm", "z", t0.after(Duration::from_secs(60))), 0.0);
    }
}
