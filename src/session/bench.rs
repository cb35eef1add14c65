//! The bench as one machine: movers that together make the indenter's pose, and a camera.
//!
//! Poses here are in the frame of the *nominal* contact (the origins of the rig file); the contact
//! zero that touch-off finds is added by the session. The bench keeps the order of moves that makes
//! dragging impossible, and asks the devices where they are instead of believing what it sent.

use super::event::AxisReading;
use super::stop::{StopLevel, StopSwitch};
use crate::clock::{Clock, Part, Timestamp, spent};
use crate::device::camera::{Camera, CameraError};
use crate::device::mover::{Mover, MoverError, Observer, Reached, Reference};
use crate::frame::Frame;
use crate::image;
use crate::motion::{AxisLimits, AxisRole, Coordinate, PoseMap};
use crate::pose::Pose;
use crate::protocol::StopKind;
use std::collections::BTreeMap;
use std::future::poll_fn;
use std::task::Poll;
use std::time::Duration;

/// Movers, camera, and how they make a pose.
pub struct Bench {
    /// Devices of the rig file by name.
    pub movers: BTreeMap<String, Mover>,
    /// Which axis makes which coordinate.
    pub map: PoseMap,
    /// The camera inside the sensor.
    pub camera: Box<dyn Camera>,
    /// Bench time.
    pub clock: Clock,
    /// Stops everything.
    pub stop: StopSwitch,
    /// The pose that was reached last, as it was asked for.
    pub reached: Option<Pose>,
    /// When the last motion had ended, before settling.
    pub rested_at: Option<Timestamp>,
    /// When it had settled, until that has been looked at, or something else than a mover may have changed the picture.
    pub settled_at: Option<Timestamp>,
}

/// A picture of a bench at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct StillFrame {
    /// The frame.
    pub frame: Frame,
    /// What it and the one before it differ by, code values.
    pub rms: f64,
    /// Since when everything had settled; the exposure began after that.
    pub settled_at: Timestamp,
}

/// How fast to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feeds {
    /// Along straight lines, mm/s.
    pub mm_s: f64,
    /// About z, deg/s.
    pub deg_s: f64,
}

/// Why the bench could not do something.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A mover failed.
    #[error("device {device}: {source}")]
    Mover {
        /// Which, by its name in the rig file.
        device: String,
        /// Why.
        source: Box<MoverError>,
    },
    /// The camera failed.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Somebody raised the stop switch.
    #[error("stopped")]
    Stopped,
    /// The picture does not come to rest.
    #[error(
        "the picture is not still: consecutive frames differ by {rms:.2} code values after {waited:?}, allowed {allowed}; look for vibration or flicker, or raise session.still_rms"
    )]
    NotStill {
        /// Difference of the last two frames.
        rms: f64,
        /// Allowed difference.
        allowed: f64,
        /// How long was waited.
        waited: Duration,
    },
    /// A move would drag the indenter through the pad.
    #[error(
        "a move from ({from}) to ({to}) would go sideways and down at once below the surface; retract first"
    )]
    Drag {
        /// Present pose.
        from: Pose,
        /// Refused pose.
        to: Pose,
    },
    /// No axis provides a coordinate that must change.
    #[error(
        "this rig has no axis for {coordinate}; the pose ({to}) needs it: add motion.{coordinate} to the rig file or choose another plan"
    )]
    NoAxis {
        /// The missing coordinate.
        coordinate: &'static str,
        /// The pose that needs it.
        to: Pose,
    },
}

impl Bench {
    /// Asks every device who it is; a wrong answer is an error, and nothing has moved.
    pub async fn identify(&mut self) -> Result<Vec<(String, String)>, BenchError> {
        let mut identities = Vec::new();
        for (name, mover) in &mut self.movers {
            let identity = mover.identify().await.map_err(of_device(name))?;
            identities.push((name.clone(), identity));
        }
        Ok(identities)
    }

    /// References all axes, the pressing one first: homing lifts it away from the sensor.
    pub async fn home(&mut self) -> Result<(), BenchError> {
        self.forget_rest();
        let press = self.map.z.device.clone();
        let rest: Vec<_> = self.movers.keys().filter(|name| **name != press).cloned().collect();
        for name in std::iter::once(press).chain(rest) {
            self.check_stop()?;
            self.guarded(&name, async |mover: &mut Mover| mover.home().await).await?;
        }
        Ok(())
    }

    /// Looks at every device, for whoever does not own the bench.
    pub fn observers(&self) -> BTreeMap<String, Observer> {
        self.movers.iter().map(|(name, mover)| (name.clone(), mover.observer())).collect()
    }

    /// Whether every axis knows where it is.
    pub fn is_referenced(&self) -> bool {
        self.movers.values().all(|m| m.reference() == Reference::Referenced)
    }

    /// Limits of the axis that makes a coordinate, in the axis' own counting.
    pub fn limits(&self, coordinate: Coordinate) -> Option<AxisLimits> {
        let role = self.map.role(coordinate)?;
        self.movers.get(&role.device)?.limits().get(&role.axis).copied()
    }

    /// Lowest and highest value of a coordinate that its axis allows.
    pub fn range(&self, coordinate: Coordinate) -> Option<[f64; 2]> {
        let (role, limits) = (self.map.role(coordinate)?, self.limits(coordinate)?);
        let ends = [role.to_coordinate(limits.min), role.to_coordinate(limits.max)];
        Some([ends[0].min(ends[1]), ends[0].max(ends[1])])
    }

    /// Whether the pressing axis knows where it is, so that it may be retracted.
    pub fn may_retract(&self) -> bool {
        self.movers.get(&self.map.z.device).is_some_and(|m| m.reference() == Reference::Referenced)
    }

    /// Where the devices say the indenter is, with every axis asked.
    pub async fn measured(&mut self) -> Result<(Pose, Vec<(String, String, f64)>), BenchError> {
        let asked = self.clock.now();
        let asking = self.movers.iter_mut().map(|(name, mover)| async move {
            let readings = mover.position().await.map_err(of_device(name))?;
            Ok(readings.into_iter().map(|r| (name.clone(), r.axis, r.position)).collect::<Vec<_>>())
        });
        let told: Result<Vec<_>, BenchError> = all(asking).await.into_iter().collect();
        let positions = told?.concat();
        spent(Part::Position, self.clock.now().since(asked));
        let find = |device: &str, axis: &str| {
            positions.iter().find(|(d, a, _)| d == device && a == axis).map_or(f64::NAN, |(_, _, p)| *p)
        };
        Ok((self.map.pose(find), positions))
    }

    /// Where the indenter rests, for planning: asked only of devices that do not know it from their last move.
    async fn resting(&mut self) -> Result<Pose, BenchError> {
        let mut positions = BTreeMap::new();
        for (name, mover) in &mut self.movers {
            for reading in mover.resting().await.map_err(of_device(name))? {
                positions.insert((name.clone(), reading.axis), reading.position);
            }
        }
        let find = |device: &str, axis: &str| {
            positions.get(&(device.to_owned(), axis.to_owned())).copied().unwrap_or(f64::NAN)
        };
        Ok(self.map.pose(find))
    }

    /// Pairs what was measured with what was asked for at `commanded`.
    pub fn readings(&self, commanded: &Pose, measured: &[(String, String, f64)]) -> Vec<AxisReading> {
        let mut readings = Vec::new();
        for coordinate in Coordinate::ALL {
            let Some(role) = self.map.role(coordinate) else { continue };
            let asked = role.to_axis(coordinate.of(commanded));
            let told = measured.iter().find(|(d, a, _)| *d == role.device && *a == role.axis);
            readings.push(AxisReading {
                device: role.device.clone(),
                axis: role.axis.clone(),
                commanded: asked,
                measured: told.map_or(f64::NAN, |(_, _, p)| *p),
            });
        }
        // What was measured of an arm is its joints: they are the proof.
        for (device, axis, position) in measured {
            let is_a_role = readings.iter().any(|r| r.device == *device && r.axis == *axis);
            let sent = self.movers.get(device).and_then(|mover| mover.sent_to(axis));
            if let Some(commanded) = sent.filter(|_| !is_a_role) {
                let (device, axis) = (device.clone(), axis.clone());
                readings.push(AxisReading { device, axis, commanded, measured: *position });
            }
        }
        readings
    }

    /// Goes to a pose in the order that never drags, and returns when everything has settled there.
    pub async fn go(&mut self, to: &Pose, feeds: Feeds) -> Result<(), BenchError> {
        let measured = self.resting().await?;
        let from = self.as_asked(measured);
        self.reached = None;
        self.go_from(&from, to, feeds).await?;
        self.reached = Some(*to);
        Ok(())
    }

    /// Whether a pose is where the last move led, each axis within its tolerance.
    pub fn rests_at(&self, pose: &Pose) -> bool {
        self.reached.is_some_and(|asked| self.as_asked(*pose) == asked)
    }

    /// The pose with what is where it was sent in the words it was sent by: a device rounds, and what it has
    /// rounded away is no way to go.
    fn as_asked(&self, measured: Pose) -> Pose {
        let mut pose = measured;
        let Some(asked) = self.reached else { return pose };
        for coordinate in Coordinate::ALL {
            let Some(role) = self.map.role(coordinate) else { continue };
            let tolerance =
                self.movers.get(&role.device).and_then(|m| m.tolerance(&role.axis)).unwrap_or(0.0);
            if (coordinate.of(&asked) - coordinate.of(&measured)).abs() <= tolerance {
                *coordinate.of_mut(&mut pose) = coordinate.of(&asked);
            }
        }
        pose
    }

    async fn go_from(&mut self, from: &Pose, to: &Pose, feeds: Feeds) -> Result<(), BenchError> {
        let sideways = [Coordinate::X, Coordinate::Y, Coordinate::Theta]
            .into_iter()
            .any(|c| self.map.role(c).is_some() && !same(c.of(from), c.of(to)));
        let down = to.z_mm < from.z_mm && !same(to.z_mm, from.z_mm);
        if sideways && down && from.z_mm < -AT_REST_MM {
            return Err(BenchError::Drag { from: *from, to: *to });
        }
        let lines = lines(from, to, feeds);
        self.rehearse(&lines, false).await?;
        for (line, feed) in lines {
            self.go_along(&line, feed).await?;
        }
        Ok(())
    }

    /// Refuses a pose that an arm cannot be led to from where homing leads it, before anything is homed: what is not
    /// given stays as homing leaves it.
    pub async fn refuse_from_home(
        &mut self,
        given: impl Fn(Coordinate) -> Option<f64>,
        feeds: Feeds,
    ) -> Result<(), BenchError> {
        let mut from = Pose::default();
        for coordinate in Coordinate::ALL {
            let Some(role) = self.map.role(coordinate) else { continue };
            let ready = self.movers.get(&role.device).and_then(Mover::ready);
            if let Some(position) = ready.and_then(|ready| ready.get(&role.axis).copied()) {
                *coordinate.of_mut(&mut from) = role.to_coordinate(position);
            }
        }
        let mut to = from;
        for coordinate in Coordinate::ALL {
            *coordinate.of_mut(&mut to) = given(coordinate).unwrap_or(coordinate.of(&from));
        }
        self.rehearse(&lines(&from, &to, feeds), true).await
    }

    /// Lets each arm plan its part of some lines; nothing is sent.
    async fn rehearse(&mut self, lines: &[Line], from_home: bool) -> Result<(), BenchError> {
        let map = self.map.clone();
        for (name, mover) in self.movers.iter_mut().filter(|(_, mover)| mover.ready().is_some()) {
            let mut moves = Vec::new();
            for (line, feed) in lines {
                let own = line.iter().filter_map(|(c, value)| {
                    let role = map.role(*c).filter(|role| role.device == *name)?;
                    Some((role.axis.as_str(), role.to_axis(*value)))
                });
                moves.push((own.collect::<Vec<_>>(), *feed));
            }
            moves.retain(|(own, _)| !own.is_empty());
            mover.rehearse(from_home, &moves).await.map_err(of_device(name))?;
        }
        Ok(())
    }

    /// Lifts the indenter straight up to a height; nothing else moves, and no other device is asked: it
    /// may be the one that failed. It lifts after a stop, too.
    pub async fn lift(&mut self, z_mm: f64, mm_s: f64) -> Result<(), BenchError> {
        let role = self.map.z.clone();
        let mover = self.mover(&role.device);
        let here = mover.position().await.map_err(of_device(&role.device))?;
        let here = here.into_iter().find(|reading| reading.axis == role.axis);
        if here.is_some_and(|reading| role.to_coordinate(reading.position) >= z_mm) {
            return Ok(());
        }
        let target = [(role.axis.as_str(), role.to_axis(z_mm))];
        self.forget_rest();
        let lifted =
            self.mover(&role.device).move_to(&target, mm_s).await.map_err(of_device(&role.device))?;
        self.has_settled(&lifted);
        Ok(())
    }

    /// Waits until the stop of every device has come to its end: decelerated, held, acknowledged.
    pub async fn come_to_rest(&mut self) {
        for (name, mover) in &mut self.movers {
            if let Err(e) = mover.position().await {
                tracing::warn!("{name} after its stop: {e}");
            }
        }
    }

    /// Tells of devices that were trusted whether they still are.
    pub(super) fn require_kept(&self, trusted: &[(String, Observer)]) -> Result<(), BenchError> {
        self.require_referenced(|device| trusted.iter().any(|(name, _)| name == device))
    }

    /// Refuses a picture of which nobody knows where it was taken.
    pub fn require_reference(&self) -> Result<(), BenchError> {
        self.require_referenced(|_| true)
    }

    fn require_referenced(&self, which: impl Fn(&str) -> bool) -> Result<(), BenchError> {
        for (device, mover) in self.movers.iter().filter(|(device, _)| which(device)) {
            if mover.reference() != Reference::Referenced {
                let last = mover.link().telemetry().last_loss;
                let reason = last.as_deref().unwrap_or("the link was lost").to_owned();
                return Err(of_device(device)(MoverError::PositionLost { reason }));
            }
        }
        Ok(())
    }

    /// One straight move of each device involved, one device after the other.
    async fn go_along(&mut self, lines: &[(Coordinate, f64)], feed: f64) -> Result<(), BenchError> {
        let mut by_device: BTreeMap<String, Vec<(AxisRole, f64)>> = BTreeMap::new();
        for (coordinate, value) in lines {
            let Some(role) = self.map.role(*coordinate).cloned() else {
                let mut to = Pose::default();
                *coordinate.of_mut(&mut to) = *value;
                return Err(BenchError::NoAxis { coordinate: coordinate.name(), to });
            };
            let target = role.to_axis(*value);
            by_device.entry(role.device.clone()).or_default().push((role, target));
        }
        for (device, targets) in by_device {
            self.check_stop()?;
            let targets: Vec<_> = targets.iter().map(|(role, t)| (role.axis.as_str(), *t)).collect();
            self.move_device(&device, &targets, feed).await?;
        }
        Ok(())
    }

    /// One move of one device; notes since when all is at rest.
    async fn move_device(
        &mut self,
        device: &str,
        targets: &[(&str, f64)],
        feed: f64,
    ) -> Result<(), BenchError> {
        self.forget_rest();
        let reached =
            self.guarded(device, async |mover: &mut Mover| mover.move_to(targets, feed).await).await?;
        self.has_settled(&reached);
        Ok(())
    }

    fn has_settled(&mut self, reached: &Reached) {
        (self.rested_at, self.settled_at) = (Some(reached.rested_at), Some(reached.settled_at));
    }

    /// Lets one device act, and stops it when another one is lost meanwhile: an arm that has restarted has let go of the
    /// sensor, and a slide must not go on below it.
    async fn guarded<T>(
        &mut self,
        device: &str,
        act: impl AsyncFnOnce(&mut Mover) -> Result<T, MoverError>,
    ) -> Result<T, BenchError> {
        let (others, switch) = (self.trusted_but(device), self.stop.clone());
        let mover = self.mover(device);
        let stop = mover.stop_handle();
        let mut acting = std::pin::pin!(act(mover));
        tokio::select! {
            biased;
            ended = &mut acting => ended.map_err(of_device(device)),
            (other, reason) = first_lost(others) => {
                // A stop of all has stopped this one, too, and may be what the other lost its position by.
                if !switch.is_raised() {
                    tracing::warn!("{device} is stopped: {other} was lost ({reason})");
                    stop.stop(StopKind::Controlled);
                }
                // Its own end is a stop now; what matters is why.
                _ = acting.await;
                Err(of_device(&other)(MoverError::PositionLost { reason }))
            }
        }
    }

    /// Looks at the devices beside one whose positions are trusted.
    pub(super) fn trusted_but(&self, device: &str) -> Vec<(String, Observer)> {
        let others = self
            .movers
            .iter()
            .filter(|(name, mover)| name.as_str() != device && mover.reference() == Reference::Referenced);
        others.map(|(name, mover)| (name.clone(), mover.observer())).collect()
    }

    /// From now on nobody knows since when the picture is at rest: something moves, or somebody's hands do.
    pub fn forget_rest(&mut self) {
        (self.rested_at, self.settled_at) = (None, None);
    }

    /// A frame exposed after everything has settled that agrees with one before it, how much the two differ, and since
    /// when all had settled: since the end of the last move's settling where nothing was looked at since, else since
    /// now. The one before may have been exposed while the bench settled: what was still then and still looks the
    /// same is still.
    pub async fn still_frame(
        &mut self,
        allowed_rms: f64,
        within: Duration,
    ) -> Result<StillFrame, BenchError> {
        let begun = self.clock.now();
        let settled_at = self.settled_at.take().map_or(begun, |at| at.min(begun));
        let mut before = self.frame_since(self.rested_at.map_or(begun, |at| at.min(begun)), within).await?;
        let mut fresh_from = settled_at;
        loop {
            self.check_stop()?;
            let frame = self.frame_since(fresh_from, within).await?;
            let rms = rms_difference(&before, &frame);
            if rms <= allowed_rms {
                return Ok(StillFrame { frame, rms, settled_at });
            }
            let waited = self.clock.now().since(begun);
            if waited >= within {
                return Err(BenchError::NotStill { rms, allowed: allowed_rms, waited });
            }
            before = frame;
            fresh_from = self.clock.now();
        }
    }

    /// The next frame exposed from now on.
    pub async fn fresh_frame(&mut self, within: Duration) -> Result<Frame, BenchError> {
        self.frame_since(self.clock.now(), within).await
    }

    /// The next frame exposed at `t` or later.
    async fn frame_since(&mut self, t: Timestamp, within: Duration) -> Result<Frame, BenchError> {
        let asked = self.clock.now();
        tokio::select! {
            frame = self.camera.frame_after(t, within) => {
                let (frame, now) = (frame?, self.clock.now());
                // Of an exposure counts what was waited for: the rest had passed while the bench settled.
                let (opened, lasted) = (frame.stamp.exposed_at, frame.stamp.exposure.unwrap_or_default());
                let exposure = opened.after(lasted).min(now).since(opened.max(asked));
                spent(Part::Exposure, exposure);
                spent(Part::Frame, now.since(asked).saturating_sub(exposure));
                Ok(frame)
            }
            () = self.stop.raised_to(StopLevel::Controlled) => Err(BenchError::Stopped),
        }
    }

    fn mover(&mut self, device: &str) -> &mut Mover {
        self.movers.get_mut(device).expect("configuration refuses a motion role of an unknown device")
    }

    /// Refuses to go on once somebody has raised the switch.
    pub fn check_stop(&self) -> Result<(), BenchError> {
        if self.stop.is_raised() { Err(BenchError::Stopped) } else { Ok(()) }
    }
}

/// Waits until one of some devices is lost; which, and why.
pub(super) async fn first_lost(others: Vec<(String, Observer)>) -> (String, String) {
    let wait = |(name, mut seen): (String, Observer)| Box::pin(async move { (name, seen.lost().await) });
    let mut waiting: Vec<_> = others.into_iter().map(wait).collect();
    poll_fn(|context| {
        let mut each = waiting.iter_mut().map(|one| one.as_mut().poll(context));
        each.find(Poll::is_ready).unwrap_or(Poll::Pending)
    })
    .await
}

/// Coordinates that go along one straight line, and how fast.
type Line = (Vec<(Coordinate, f64)>, f64);

/// The lines of a way that never drags: sideways before down, and after up; a turn by itself, at its own feed.
fn lines(from: &Pose, to: &Pose, feeds: Feeds) -> Vec<Line> {
    let changed = |c: &Coordinate| !same(c.of(from), c.of(to));
    let flat = [Coordinate::X, Coordinate::Y].into_iter().filter(changed);
    let mut lines: Vec<Line> = vec![(flat.map(|c| (c, c.of(to))).collect(), feeds.mm_s)];
    if changed(&Coordinate::Theta) {
        lines.push((vec![(Coordinate::Theta, to.theta_deg)], feeds.deg_s));
    }
    let height = (vec![(Coordinate::Z, to.z_mm)], feeds.mm_s);
    let up = changed(&Coordinate::Z) && to.z_mm > from.z_mm;
    lines.insert(if up { 0 } else { lines.len() }, height);
    lines.retain(|(line, _)| !line.is_empty());
    lines
}

/// Waits for all of some futures at once, answers in their order.
async fn all<F: Future>(futures: impl Iterator<Item = F>) -> Vec<F::Output> {
    let mut pending: Vec<_> = futures.map(|future| (Box::pin(future), None)).collect();
    poll_fn(|context| {
        for (future, answer) in pending.iter_mut().filter(|(_, answer)| answer.is_none()) {
            if let Poll::Ready(ready) = future.as_mut().poll(context) {
                *answer = Some(ready);
            }
        }
        match pending.iter().all(|(_, answer)| answer.is_some()) {
            true => Poll::Ready(pending.iter_mut().filter_map(|(_, answer)| answer.take()).collect()),
            false => Poll::Pending,
        }
    })
    .await
}

/// Says whose error it is.
pub(super) fn of_device(device: &str) -> impl FnOnce(MoverError) -> BenchError + '_ {
    move |source| BenchError::Mover { device: device.to_owned(), source: Box::new(source) }
}

/// Smaller differences are no motion: no axis of such a bench resolves a nanometre.
const SAME: f64 = 1e-6;

/// A tip less deep than this is not in contact: it is what one step of the finest stage moves.
const AT_REST_MM: f64 = 1e-3;

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() < SAME
}

/// Root mean square difference of two frames in code values; infinite when their sizes differ.
pub fn rms_difference(a: &Frame, b: &Frame) -> f64 {
    image::arithmetic::rms_difference(a, b).unwrap_or(f64::INFINITY)
}
