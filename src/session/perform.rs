//! The loop: from homing to the last retract.

use super::bench::{Bench, BenchError, Feeds, StillFrame, rms_difference};
use super::event::{Event, RealCapture};
use super::stop::StopLevel;
use super::touch_off::{TouchOffError, TouchOffSettings, find_contact};
use crate::frame::Frame;
use crate::motion::{Trajectory, Waypoint};
use crate::pose::Pose;
use std::collections::{BTreeMap, BTreeSet};
use std::future::Future;
use std::pin::Pin;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::mpsc;

/// Asks whoever is at the bench to mount an indenter; answers whether it was done.
pub type Operator = Box<dyn FnMut(&str) -> Pin<Box<dyn Future<Output = bool> + Send>> + Send>;

/// How a session is run.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionSettings {
    /// How the contact is found; `None`: it is given.
    pub touch_off: Option<TouchOffSettings>,
    /// Height of the contact above the nominal contact where it is given, mm.
    pub given_zero_mm: f64,
    /// Height at which sideways travel is safe, mm above the nominal contact.
    pub clearance_mm: f64,
    /// Feeds in the air.
    pub travel: Feeds,
    /// Largest difference of two frames of a still picture, code values.
    pub still_rms: f64,
    /// How long a frame or a still picture may take.
    pub frame_within: Duration,
    /// Frames thrown away before the first background, for exposure and lamps to settle.
    pub warmup_frames: u32,
    /// A new background every so many episodes, besides at every change of indenter; 0: never.
    pub background_every: u32,
    /// Largest accepted departure of the measured pose from the commanded one, mm (degrees for rotation).
    pub departure: f64,
}

impl SessionSettings {
    /// How fast to go to a waypoint: its own feeds, or those of travel where it has none.
    pub fn feeds(&self, waypoint: &Waypoint) -> Feeds {
        let or = |own: f64, travel: f64| if own > 0.0 { own } else { travel };
        Feeds {
            mm_s: or(waypoint.feed_mm_s, self.travel.mm_s),
            deg_s: or(waypoint.feed_deg_s, self.travel.deg_s),
        }
    }
}

/// Why a session ended early.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The bench failed.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// No contact.
    #[error("indenter {indenter}: {source}")]
    TouchOff {
        /// Indenter being touched off.
        indenter: String,
        /// What happened.
        source: TouchOffError,
    },
    /// The operator did not mount the indenter.
    #[error("indenter {indenter} was not confirmed; mount it and resume")]
    NotMounted {
        /// Which one.
        indenter: String,
    },
    /// Whoever receives the events has gone, for a reason of its own.
    #[error("nobody receives the captures any more")]
    NoReceiver,
}

impl SessionError {
    /// Whether this is the stop switch and nothing worse.
    pub fn is_stop(&self) -> bool {
        matches!(
            self,
            SessionError::Bench(BenchError::Stopped)
                | SessionError::TouchOff { source: TouchOffError::Bench(BenchError::Stopped), .. }
        )
    }

    /// Whether nothing can be in motion when this happens: a stop would only cost some devices their position.
    fn comes_between_moves(&self) -> bool {
        let looks = |e: &BenchError| matches!(e, BenchError::Camera(_) | BenchError::NotStill { .. });
        match self {
            SessionError::NoReceiver | SessionError::NotMounted { .. } => true,
            SessionError::Bench(e) => looks(e),
            SessionError::TouchOff { source: TouchOffError::Bench(e), .. } => looks(e),
            SessionError::TouchOff { .. } => true,
        }
    }

    /// A mover that the switch interrupted tells it in its own words; the cause is the switch.
    fn unless_stopped(self, bench: &Bench) -> SessionError {
        let of_a_mover = matches!(
            self,
            SessionError::Bench(BenchError::Mover { .. })
                | SessionError::TouchOff { source: TouchOffError::Bench(BenchError::Mover { .. }), .. }
        );
        if of_a_mover && bench.stop.is_raised() { BenchError::Stopped.into() } else { self }
    }
}

/// One run over a trajectory.
pub struct Session<'a> {
    /// The devices.
    pub bench: &'a mut Bench,
    /// What to do.
    pub trajectory: &'a Trajectory,
    /// How.
    pub settings: SessionSettings,
    /// Who mounts indenters.
    pub operator: Operator,
    /// Contact zeros already known, by indenter (from an earlier run of the same mounting).
    pub contact_zero_mm: BTreeMap<String, f64>,
    /// Where events go; the channel's bound is what paces the bench to the disk.
    pub events: mpsc::Sender<Event>,
}

impl Session<'_> {
    /// Performs every capture that is not `done`. Ends retracted, or says why it could not.
    pub async fn run(mut self, done: &BTreeSet<u32>) -> Result<(), SessionError> {
        let result = self.perform(done).await.map_err(|e| e.unless_stopped(self.bench));
        if result.as_ref().is_err_and(|e| !e.comes_between_moves()) {
            // Whatever failed, the other device may still be moving.
            self.bench.stop.raise(StopLevel::Controlled);
        }
        let mut retracted = self.retract().await;
        if result.is_ok() && retracted.is_err() {
            // Interrupted on the way up: stop like everybody else, then go on up.
            retracted = retracted.map_err(|e| e.unless_stopped(self.bench));
            self.bench.stop.raise(StopLevel::Controlled);
            if let Err(e) = self.retract().await {
                tracing::warn!("the arm could not be retracted: {e}");
            }
        }
        if result.is_err() || retracted.is_err() {
            self.bench.come_to_rest().await;
        }
        if let (Err(_), Err(e)) = (&result, &retracted) {
            tracing::warn!("the arm could not be retracted: {e}");
        }
        result.and(retracted)
    }

    async fn perform(&mut self, done: &BTreeSet<u32>) -> Result<(), SessionError> {
        for (device, identity) in self.bench.identify().await? {
            self.tell(Event::Identified { device, identity }).await?;
        }
        if !self.bench.is_referenced() {
            self.bench.home().await?;
            self.tell(Event::Homed).await?;
        }
        self.lift().await?;
        for _ in 0..self.settings.warmup_frames {
            self.bench.fresh_frame(self.settings.frame_within).await?;
        }

        let mut mounted: Option<String> = None;
        let mut backgrounds = Backgrounds::default();
        for (index, episode) in self.trajectory.episodes.iter().enumerate() {
            let index = index as u32;
            let due = |w: &Waypoint| w.capture.is_some_and(|c| !done.contains(&c));
            if !self.trajectory.waypoints_of(index).iter().any(due) {
                continue;
            }

            // Mount, photograph the untouched sensor, find the contact.
            let changed = mounted.as_deref() != Some(episode.indenter.as_str());
            if changed {
                self.lift().await?;
                self.ask_to_mount(&episode.indenter).await?;
                self.bench.forget_rest();
                if mounted.is_some() {
                    // No two mountings are equally high.
                    self.contact_zero_mm.remove(&episode.indenter);
                }
                mounted = Some(episode.indenter.clone());
                self.tell(Event::Mounted { indenter: episode.indenter.clone() }).await?;
            }
            let every = self.settings.background_every;
            if changed || (every > 0 && index.is_multiple_of(every)) {
                self.take_background(&episode.indenter, &mut backgrounds).await?;
            }
            let zero_mm = self.contact_zero(index, &episode.indenter, &backgrounds).await?;

            // Walk the episode.
            self.tell(Event::Episode { episode: index }).await?;
            for waypoint in self.trajectory.waypoints_of(index) {
                let target = Pose { z_mm: waypoint.pose.z_mm + zero_mm, ..waypoint.pose };
                self.bench.go(&target, self.settings.feeds(waypoint)).await?;
                if let Some(capture) = waypoint.capture.filter(|_| due(waypoint)) {
                    self.capture(capture, &waypoint.pose, zero_mm, &backgrounds).await?;
                }
            }
        }
        Ok(())
    }

    /// Up to where sideways travel is safe.
    async fn lift(&mut self) -> Result<(), SessionError> {
        self.bench.check_stop()?;
        Ok(self.bench.lift(self.settings.clearance_mm, self.settings.travel.mm_s).await?)
    }

    /// Waits for whoever is at the bench, but not longer than until the switch is raised.
    async fn ask_to_mount(&mut self, indenter: &str) -> Result<(), SessionError> {
        let stop = self.bench.stop.clone();
        tokio::select! {
            biased;
            () = stop.raised_to(StopLevel::Controlled) => Err(BenchError::Stopped.into()),
            done = (self.operator)(indenter) => match done {
                true => Ok(()),
                false => Err(SessionError::NotMounted { indenter: indenter.to_owned() }),
            },
        }
    }

    async fn take_background(
        &mut self,
        indenter: &str,
        backgrounds: &mut Backgrounds,
    ) -> Result<(), SessionError> {
        self.lift().await?;
        let still = self.bench.still_frame(self.settings.still_rms, self.settings.frame_within).await?;
        let frame = still.frame;
        let first = backgrounds.first.get_or_insert_with(|| frame.clone());
        backgrounds.drift_rms = rms_difference(first, &frame);
        backgrounds.last = Some(frame.clone());
        let (number, drift_rms) = (backgrounds.count, backgrounds.drift_rms);
        backgrounds.count += 1;
        self.tell(Event::Background { indenter: indenter.to_owned(), number, frame, drift_rms }).await
    }

    async fn contact_zero(
        &mut self,
        episode: u32,
        indenter: &str,
        backgrounds: &Backgrounds,
    ) -> Result<f64, SessionError> {
        if let Some(zero_mm) = self.contact_zero_mm.get(indenter) {
            return Ok(*zero_mm);
        }
        let (Some(settings), Some(background)) = (&self.settings.touch_off, &backgrounds.last) else {
            return Ok(self.settings.given_zero_mm);
        };
        let over = self.trajectory.waypoints_of(episode)[0].pose;
        let travel = self.settings.travel;
        self.bench.go(&Pose { z_mm: self.settings.clearance_mm, ..over }, travel).await?;
        let contact = find_contact(self.bench, &over, background, settings, travel, self.settings.still_rms)
            .await
            .map_err(|source| SessionError::TouchOff { indenter: indenter.to_owned(), source })?;
        self.lift().await?;
        self.contact_zero_mm.insert(indenter.to_owned(), contact.zero_mm);
        let (contact_zero_mm, frame) = (contact.zero_mm, contact.frame);
        self.tell(Event::Touched { indenter: indenter.to_owned(), contact_zero_mm, frame }).await?;
        Ok(contact_zero_mm)
    }

    async fn capture(
        &mut self,
        capture: u32,
        commanded: &Pose,
        zero_mm: f64,
        backgrounds: &Backgrounds,
    ) -> Result<(), SessionError> {
        let StillFrame { frame, rms: still_rms, settled_at } =
            self.bench.still_frame(self.settings.still_rms, self.settings.frame_within).await?;
        let settle = frame.stamp.exposed_at.since(settled_at);
        let (mut measured, mut positions) = self.measured(zero_mm).await?;
        // Many firmwares answer without a checksum: what was not measured on arrival is asked once more before it
        // is believed.
        if !self.bench.rests_at(&Pose { z_mm: measured.z_mm + zero_mm, ..measured }) {
            tracing::warn!("capture {capture}: read at {measured} instead of {commanded}; asking again");
            (measured, positions) = self.measured(zero_mm).await?;
        }
        let departed = self.departs(commanded, &measured);
        let nominal = Pose { z_mm: commanded.z_mm + zero_mm, ..*commanded };
        let utc = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let real = RealCapture {
            capture,
            commanded: *commanded,
            measured,
            contact_zero_mm: zero_mm,
            axes: self.bench.readings(&nominal, &positions),
            settled_at,
            settle,
            still_rms,
            frame,
            utc_ns: i64::try_from(utc.as_nanos()).unwrap_or(i64::MAX),
            departed,
            drift_rms: backgrounds.drift_rms,
        };
        self.tell(Event::Captured(Box::new(real))).await
    }

    /// Where the devices say the indenter is, relative to the contact; every one of them must be trusted.
    async fn measured(&mut self, zero_mm: f64) -> Result<(Pose, Vec<(String, String, f64)>), SessionError> {
        let (at, positions) = self.bench.measured().await?;
        self.bench.require_reference()?;
        Ok((Pose { z_mm: at.z_mm - zero_mm, ..at }, positions))
    }

    /// Whether a pose is not where it should be; what cannot be compared is not.
    fn departs(&self, commanded: &Pose, measured: &Pose) -> bool {
        let within = |off: f64| off <= self.settings.departure;
        !(within(commanded.distance_mm(measured)) && within((commanded.theta_deg - measured.theta_deg).abs()))
    }

    /// Lifts the arm if its position can be trusted; says so when it could not.
    async fn retract(&mut self) -> Result<(), SessionError> {
        if !self.bench.may_retract() {
            tracing::warn!(
                "the arm's position is not known, so it stays where it is; home the rig before anything else"
            );
            return Ok(());
        }
        self.bench.lift(self.settings.clearance_mm, self.settings.travel.mm_s).await?;
        // The receiver may be the very thing that failed.
        let _ = self.events.send(Event::Retracted).await;
        Ok(())
    }

    async fn tell(&mut self, event: Event) -> Result<(), SessionError> {
        self.events.send(event).await.map_err(|_| SessionError::NoReceiver)
    }
}

/// Pictures of the untouched sensor.
#[derive(Default)]
struct Backgrounds {
    first: Option<Frame>,
    last: Option<Frame>,
    count: u32,
    drift_rms: f64,
}
