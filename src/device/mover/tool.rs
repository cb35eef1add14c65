//! The tool of an arm with joints: axes of the pad frame in front of the axes on the wire.
//!
//! A move of the tool is planned before its first byte is sent: a one-sided approach if there is one, then for each
//! leg the joint positions along a straight line ([`crate::motion::Arm`]), every one within the joints' limits. A
//! leg becomes *pieces*, each one move of all joints in which they start and arrive together; each ends at rest and is
//! measured before the next is sent, and the last one settles. A piece that would hurry a joint beyond its limit is
//! slower instead.
//!
//! Why pieces do not run into each other: a servo that is given another goal in mid-move plans anew from whatever it does
//! then, by a rule that the vendors' tables do not state, and its neighbours on the bus are told a millisecond or more
//! later, one after the other. So neither the path between two goals nor the instant of arrival would be known, and the
//! tip could leave its line by more than `line_mm` without anybody seeing it: what proves a piece is that it has ended.
//!
//! *Where the tool is* follows from the measured joints. What is compared with a target is that, not what was sent.
//! But the next move begins where the last one was sent, where the joints are within their tolerance of it:
//! or else what a servo rounds away would add up, move by move, in the coordinates that were to stay.
//!
//! After homing, the arm goes to its ready pose: from wherever it is, all joints evenly, slowly.

use super::observer::SeenAxis;
use super::travel::{Reached, check_feed, check_targets, legs};
use super::{Measured, Mover, MoverError};
use crate::device::settings::{AxisSettings, MoverSettings};
use crate::motion::{Arm, Coordinate};
use crate::pose::Pose;
use crate::protocol::Request;
use std::collections::BTreeMap;
use std::time::Duration;

/// The tool in front of the joints.
#[derive(Debug, Clone)]
pub(super) struct Tool {
    arm: Arm,
    /// Its axes by name.
    pub(super) axes: BTreeMap<String, AxisSettings>,
    /// Index on the wire of each joint of the chain.
    order: Vec<usize>,
    /// Where the last move led, as it was sent.
    sent: Option<Sent>,
}

/// A place of the tool, and the joints that make it.
#[derive(Debug, Clone, PartialEq)]
struct Sent {
    pose: Pose,
    /// In the order of the chain.
    joints: Vec<f64>,
}

/// One move of all joints.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Piece {
    /// By index on the wire.
    pub(super) targets: Vec<(usize, f64)>,
    /// Along the line that the joints draw, deg/s.
    pub(super) feed: f64,
    /// Where the axes on the wire are before.
    pub(super) from: Vec<f64>,
}

impl Piece {
    /// Where the axes on the wire are after it.
    fn to(&self) -> Vec<f64> {
        let mut to = self.from.clone();
        self.targets.iter().for_each(|(at, target)| to[*at] = *target);
        to
    }
}

/// A joint that turns less does not move.
const NO_TURN_DEG: f64 = 1e-9;

impl Tool {
    /// The tool of a device, if its axes are joints.
    pub(super) fn new(settings: &MoverSettings) -> Option<Tool> {
        let arm = settings.arm()?;
        let at = |axis: &String| settings.axes.keys().position(|name| name == axis);
        let order = arm.chain.joints.iter().filter_map(|joint| at(&joint.axis)).collect();
        Some(Tool { arm, axes: settings.pose_axes(), order, sent: None })
    }

    /// Where an axis was last sent: one of the tool, or a joint.
    pub(super) fn sent_to(&self, axis: &str) -> Option<f64> {
        let sent = self.sent.as_ref()?;
        if self.axes.contains_key(axis) {
            return Some(Arm::coordinate(axis)?.of(&sent.pose));
        }
        let at = self.arm.chain.joints.iter().position(|joint| joint.axis == axis)?;
        sent.joints.get(at).copied()
    }

    /// The axes of the tool for these positions on the wire.
    pub(super) fn seen(&self, wire: Option<&[f64]>) -> Vec<SeenAxis> {
        let pose = wire.map(|wire| self.pose(wire));
        let seen = |(name, axis): (&String, &AxisSettings)| SeenAxis {
            axis: name.clone(),
            kind: axis.kind,
            position: pose.and_then(|pose| Some(Arm::coordinate(name)?.of(&pose))),
            min: axis.min,
            max: axis.max,
        };
        self.axes.iter().map(seen).collect()
    }

    /// The pieces of a leg of the tool from a place on the way of a plan, of which no joint was ever measured.
    pub(super) fn pieces_from(
        &self,
        here: &[f64],
        leg: &[(usize, f64)],
        feed: f64,
        settings: &MoverSettings,
    ) -> Result<Vec<Piece>, MoverError> {
        let mut pose = Pose::default();
        self.put(&mut pose, &here.iter().copied().enumerate().collect::<Vec<_>>());
        let from = Sent { joints: self.arm.chain.joints(&pose, &self.arm.chain.middle_deg())?, pose };
        let mut to = pose;
        self.put(&mut to, leg);
        Ok(self.pieces(&from, &to, feed, settings)?.0)
    }

    /// A straight line of the tool as moves of its joints, and the place where they lead.
    fn pieces(
        &self,
        from: &Sent,
        to: &Pose,
        feed: f64,
        settings: &MoverSettings,
    ) -> Result<(Vec<Piece>, Sent), MoverError> {
        let mut before = from.joints.clone();
        let mut pieces: Vec<Piece> = Vec::new();
        for joints in self.arm.line(&from.joints, to)? {
            let (a, b) = (self.arm.chain.pose(&before), self.arm.chain.pose(&joints));
            let turn = if self.arm.chain.turns { b.theta_deg - a.theta_deg } else { 0.0 };
            let seconds = a.distance_mm(&b).hypot(turn) / feed;
            let parts = (seconds / self.longest_s(settings)).ceil().max(1.0);
            for k in 1..=parts as u32 {
                let s = f64::from(k) / parts;
                let end: Vec<f64> = before.iter().zip(&joints).map(|(a, b)| a + (b - a) * s).collect();
                let begin = pieces.last().map_or_else(|| before.clone(), |piece| self.joints(&piece.to()));
                pieces.extend(self.piece(&begin, &end, seconds / parts, f64::INFINITY, settings));
            }
            before = joints;
        }
        Ok((pieces, Sent { pose: *to, joints: before }))
    }

    /// How long a piece may last, s, so that rounded feeds do not lead the tip off its line: half a step of the feed
    /// is how much faster one joint may be than it should, and the stretched arm what it turns.
    fn longest_s(&self, settings: &MoverSettings) -> f64 {
        let step = settings.kinematics.as_ref().map_or(0.0, |k| k.feed_step_deg_s).to_radians();
        if step > 0.0 { self.arm.line_mm / (0.5 * step * self.arm.chain.reach_mm()) } else { f64::INFINITY }
    }

    /// All joints evenly from one place to another, in `seconds` or in as many more as the slowest of them needs;
    /// `None` where nothing moves.
    fn piece(
        &self,
        from: &[f64],
        to: &[f64],
        seconds: f64,
        fastest: f64,
        settings: &MoverSettings,
    ) -> Option<Piece> {
        let ways: Vec<f64> = from.iter().zip(to).map(|(a, b)| (b - a).abs()).collect();
        let joints = self.arm.chain.joints.iter().zip(&ways);
        let least =
            joints.map(|(j, way)| way / settings.axes[&j.axis].max_feed.min(fastest)).fold(0.0, f64::max);
        let length = ways.iter().map(|way| way * way).sum::<f64>().sqrt();
        let targets = self.order.iter().copied().zip(to.iter().copied()).collect();
        let feed = length / seconds.max(least);
        (length > NO_TURN_DEG).then(|| Piece { targets, feed, from: self.wire(from) })
    }

    /// Positions on the wire in the order of the chain.
    fn joints(&self, wire: &[f64]) -> Vec<f64> {
        self.order.iter().map(|at| wire[*at]).collect()
    }

    /// The other way round.
    fn wire(&self, joints: &[f64]) -> Vec<f64> {
        let mut wire = vec![0.0; joints.len()];
        self.order.iter().zip(joints).for_each(|(at, position)| wire[*at] = *position);
        wire
    }

    fn pose(&self, wire: &[f64]) -> Pose {
        self.arm.chain.pose(&self.joints(wire))
    }

    /// Sets coordinates, given by the index of the tool's axis.
    fn put(&self, pose: &mut Pose, targets: &[(usize, f64)]) {
        for (at, target) in targets {
            if let Some(coordinate) = self.axes.keys().nth(*at).and_then(|name| Arm::coordinate(name)) {
                *coordinate.of_mut(pose) = *target;
            }
        }
    }

    /// The pieces of a straight move of some of the tool's axes, with the legs that a one-sided approach makes of it,
    /// and the place where it leads.
    fn way(
        &self,
        from: &Sent,
        axes: &BTreeMap<String, AxisSettings>,
        targets: &[(usize, f64)],
        feed: f64,
        settings: &MoverSettings,
    ) -> Result<(Vec<Piece>, Sent), MoverError> {
        let mut at = from.clone();
        let places = self.places(&at, axes);
        check_feed(axes, targets, feed, &places)?;
        let mut way = Vec::new();
        for leg in legs(axes, targets, &places) {
            let mut to = at.pose;
            self.put(&mut to, &leg);
            let (pieces, place) = self.pieces(&at, &to, feed, settings)?;
            way.extend(pieces);
            at = place;
        }
        Ok((way, at))
    }

    /// The positions of its axes at a place.
    fn places(&self, at: &Sent, axes: &BTreeMap<String, AxisSettings>) -> Vec<f64> {
        axes.keys().filter_map(|name| Some(Arm::coordinate(name)?.of(&at.pose))).collect()
    }

    /// Where the tool is for planning: where it was sent, if that is where the joints are, or else as measured.
    fn place(&self, here: &[Measured], settings: &MoverSettings) -> Sent {
        let wire: Vec<f64> = here.iter().map(|measured| measured.position).collect();
        let joints = self.joints(&wire);
        let as_sent = |sent: &&Sent| {
            let each = self.arm.chain.joints.iter().zip(sent.joints.iter().zip(&joints));
            each.into_iter()
                .all(|(joint, (a, b))| (a - b).abs() <= settings.axes[&joint.axis].tolerance + 1e-9)
        };
        let measured = || Sent { pose: self.arm.chain.pose(&joints), joints: joints.clone() };
        self.sent.as_ref().filter(as_sent).cloned().unwrap_or_else(measured)
    }

    /// Whether the measured joints have put the tool within its tolerances.
    fn within_tolerance(&self, to: &Pose, measured: &[Measured]) -> Result<(), MoverError> {
        let wire: Vec<f64> = measured.iter().map(|m| m.position).collect();
        let pose = self.pose(&wire);
        for (name, axis) in &self.axes {
            let Some(coordinate) = Arm::coordinate(name) else { continue };
            let missed_by = (coordinate.of(&pose) - coordinate.of(to)).abs();
            if missed_by.is_nan() || missed_by > axis.tolerance + 1e-9 {
                return Err(MoverError::NotReached {
                    axis: name.clone(),
                    target: coordinate.of(to),
                    measured: coordinate.of(&pose),
                    tolerance: axis.tolerance,
                    unit: axis.kind.unit(),
                });
            }
        }
        Ok(())
    }
}

impl Mover {
    /// Moves axes of the tool in straight lines, and proves by the joints where it ended.
    pub(super) async fn move_tool(
        &mut self,
        axes: &BTreeMap<String, AxisSettings>,
        targets: &[(usize, f64)],
        feed: f64,
    ) -> Result<Reached, MoverError> {
        let here = self.resting_axes().await?;
        let Some(tool) = self.tool.clone() else { return Err(self.no_tool()) };

        // All of the way is planned before any of it is sent.
        let from = tool.place(&here, &self.settings);
        let (way, at) = tool.way(&from, axes, targets, feed, &self.settings)?;

        self.forget_sent();
        let mut reached = Reached::nowhere(here, self.clock.now());
        let last = way.len().saturating_sub(1);
        for (i, piece) in way.iter().enumerate() {
            self.still_allowed()?;
            let settling = if i == last { self.settling() } else { Duration::ZERO };
            let part = self.travel(&piece.targets, &reached.measured, piece.feed, settling).await?;
            reached = Reached { recoveries: reached.recoveries + part.recoveries, ..part };
        }
        tool.within_tolerance(&at.pose, &reached.measured)?;
        self.remember_sent(at);
        reached.measured = self.with_tool(reached.measured);
        Ok(reached)
    }

    /// Where homing leads the axes of the tool, by name; `None` for a device whose axes are no joints.
    pub fn ready(&self) -> Option<BTreeMap<String, f64>> {
        let ready = self.settings.kinematics.as_ref()?.ready();
        let axes = self.tool.as_ref()?.axes.keys();
        Some(axes.filter_map(|name| Some((name.clone(), Arm::coordinate(name)?.of(&ready)))).collect())
    }

    /// Refuses moves, one after the other, that the arm cannot do from where it is, or from where homing will lead it.
    /// Nothing is sent; what is no arm has nothing to refuse that a move does not check first.
    pub async fn rehearse(
        &mut self,
        from_home: bool,
        moves: &[(Vec<(&str, f64)>, f64)],
    ) -> Result<(), MoverError> {
        let (Some(tool), Some(kinematics)) = (self.tool.clone(), self.settings.kinematics.clone()) else {
            return Ok(());
        };
        let mut at = if from_home {
            Sent { joints: kinematics.ready_joints(&self.settings.axes)?, pose: kinematics.ready() }
        } else {
            tool.place(&self.resting_axes().await?, &self.settings)
        };
        let axes = self.settings.pose_axes();
        for (targets, feed) in moves {
            let targets = check_targets(&axes, targets)?;
            at = tool.way(&at, &axes, &targets, *feed, &self.settings)?.1;
        }
        Ok(())
    }

    /// One piece of a glide of the tool: returns when the joints have been told.
    pub(super) async fn glide_tool(&mut self, targets: &[(usize, f64)], feed: f64) -> Result<(), MoverError> {
        let Some(tool) = self.tool.clone() else { return Err(self.no_tool()) };
        // While the piece before is under way, the next one begins where that one leads.
        let at = match (&tool.sent, &self.resting) {
            (Some(sent), None) => sent.clone(),
            _ => tool.place(&self.resting_axes().await?, &self.settings),
        };
        let mut to = at.pose;
        tool.put(&mut to, targets);
        let (_, place) = tool.pieces(&at, &to, feed, &self.settings)?;
        let seconds = at.pose.distance_mm(&to).hypot(to.theta_deg - at.pose.theta_deg) / feed;
        let piece = tool.piece(&at.joints, &place.joints, seconds, f64::INFINITY, &self.settings);
        self.resting = None;
        self.forget_sent();
        if let Some(Piece { targets, feed, .. }) = piece {
            self.call(Request::Move { targets, feed, jog: false }).await?;
        }
        self.remember_sent(place);
        Ok(())
    }

    /// After homing: to the ready pose, all joints evenly from wherever they are.
    pub(super) async fn make_ready(&mut self) -> Result<(), MoverError> {
        let (Some(tool), Some(kinematics)) = (self.tool.clone(), self.settings.kinematics.clone()) else {
            return Ok(());
        };
        let joints = kinematics.ready_joints(&self.settings.axes)?;
        let here = self.read_positions().await?;
        let wire: Vec<f64> = here.iter().map(|measured| measured.position).collect();
        self.forget_sent();
        let piece = tool.piece(&tool.joints(&wire), &joints, 0.0, kinematics.ready_deg_s, &self.settings);
        if let Some(piece) = piece {
            self.still_allowed()?;
            self.travel(&piece.targets, &here, piece.feed, self.settling()).await?;
        }
        self.remember_sent(Sent { pose: kinematics.ready(), joints });
        Ok(())
    }

    /// The axes of the tool before those on the wire.
    pub(super) fn with_tool(&self, axes: Vec<Measured>) -> Vec<Measured> {
        let Some(tool) = &self.tool else { return axes };
        let wire: Vec<f64> = axes.iter().map(|measured| measured.position).collect();
        let (pose, at) = (tool.pose(&wire), axes.iter().map(|m| m.at).max());
        let coordinates = Coordinate::ALL.into_iter().filter(|c| tool.axes.contains_key(c.name()));
        let seen = coordinates.filter_map(|coordinate| {
            let (axis, position) = (coordinate.name().to_owned(), coordinate.of(&pose));
            Some(Measured { axis, position, counts: None, at: at? })
        });
        seen.chain(axes.iter().cloned()).collect()
    }

    fn forget_sent(&mut self) {
        self.tool.iter_mut().for_each(|tool| tool.sent = None);
    }

    fn remember_sent(&mut self, sent: Sent) {
        self.tool.iter_mut().for_each(|tool| tool.sent = Some(sent.clone()));
    }

    fn no_tool(&self) -> MoverError {
        MoverError::NotSupported { protocol: self.spec.protocol.name.clone(), what: "kinematics" }
    }
}
