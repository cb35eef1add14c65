//! A mover: one serial device with named axes, whose motion can be trusted.
//!
//! *Reference* says what is known of the positions: `Unknown` after connecting, `Homing`,
//! `Referenced`, and `Suspect` after anything that may have lost them (a restart in mid-run, a lost
//! link, an alarm that loses position, a stall, a hard stop). Only a referenced device moves; the
//! others only home.
//!
//! *A move* ([`Mover::move_to`]) is checked against the limits before a byte is sent, and has ended
//! when the device says so in its protocol's way (idle, confirmed; or a barrier), *and* the measured
//! position is within tolerance of the target, *and* it still is after the settling time. A reply
//! that is lost never leads to a second move: first the device is asked until it is at rest and its
//! position is known ([`travel`]).
//!
//! *An arm with joints* has the axes of its tool in front of those on the wire ([`tool`]): they are what is moved,
//! measured and limited by name; joints follow.
//!
//! It knows no other device and no plan; interlocks between devices are the session's.

#[cfg(test)]
mod after_stop;
mod error;
#[cfg(test)]
mod faults;
mod glide;
mod observer;
#[cfg(test)]
mod pitfalls;
#[cfg(test)]
mod tests;
mod tool;
#[cfg(test)]
mod tool_tests;
mod travel;

use super::byte_log::{Header, LOG_VERSION};
use super::link::{Link, LinkOptions, StopHandle};
use super::settings::{AxisSettings, MoverSettings};
use crate::clock::{Clock, Part, Timestamp, spent};
use crate::motion::AxisLimits;
use crate::protocol::{AxisWire, Engine, Failure, Outcome, Pattern, Request, Spec, StopKind, Which};
use crate::units::Steps;
pub use error::MoverError;
use observer::Homed;
pub use observer::{Observer, Seen, SeenAxis};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tool::Tool;
pub use travel::Reached;

/// What is known of the positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// Never homed since connecting.
    Unknown,
    /// Searching the switches.
    Homing,
    /// Positions are valid.
    Referenced,
    /// Positions were valid once; something happened.
    Suspect,
}

/// One axis as the device reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Name in the rig file.
    pub axis: String,
    /// Position, mm or degrees.
    pub position: f64,
    /// The device's own counts, where it reports them.
    pub counts: Option<Steps>,
    /// When the report arrived.
    pub at: Timestamp,
}

/// A serial device with axes.
#[derive(Debug)]
pub struct Mover {
    link: Link,
    spec: Arc<Spec>,
    settings: MoverSettings,
    clock: Clock,
    names: Vec<String>,
    /// The tool in front of the axes, where they are joints.
    tool: Option<Tool>,
    homed: Homed,
    /// Where the last move was measured to end; forgotten with the next one, and with trust.
    resting: Option<Vec<Measured>>,
    identity: Option<String>,
    /// Recovery that the last alarm asks for.
    recover: Option<String>,
}

impl Mover {
    /// Connects over a stream: wakes the firmware and verifies who it is. Nothing moves.
    pub async fn connect<S>(
        stream: S,
        spec: Arc<Spec>,
        settings: MoverSettings,
        clock: Clock,
    ) -> Result<Mover, MoverError>
    where
        S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        Self::connect_with(stream, spec, settings, clock, LinkOptions::default()).await
    }

    /// Connects as [`Mover::connect`] does, with a byte log and the port's second door for stops.
    pub async fn connect_with<S>(
        stream: S,
        spec: Arc<Spec>,
        settings: MoverSettings,
        clock: Clock,
        options: LinkOptions,
    ) -> Result<Mover, MoverError>
    where
        S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let patience = clock.speed().max(1.0);
        let engine = engine_for(&spec, &settings, patience)?;
        let mut options = options;
        if let Some(log) = &mut options.log {
            let (protocol, axes) = (settings.protocol.clone(), wires(&settings));
            let header = Header { twinrig_log: LOG_VERSION, protocol, axes, patience, continued: false };
            if let Err(e) = log.header(clock.now(), header) {
                tracing::warn!("the byte log cannot be written: {e}");
                options.log = None;
            }
        }
        let names = settings.axes.keys().cloned().collect();
        let tool = Tool::new(&settings);
        let link = Link::start(stream, engine, clock, options);
        let mut mover = Mover {
            link,
            spec,
            settings,
            clock,
            names,
            tool,
            homed: Homed::default(),
            resting: None,
            identity: None,
            recover: None,
        };
        mover.introduce().await.map_err(|e| mover.unless_it_speaks_otherwise(e))?;
        mover.link.set_live();
        Ok(mover)
    }

    /// Wakes the device, asks who it is, and sets it up.
    async fn introduce(&mut self) -> Result<(), MoverError> {
        if self.spec.link.wake.is_some() {
            match self.call(Request::Wake).await {
                // Whoever had it before left it in motion: the reset has stopped it, and it says what that cost.
                Err(Failure::Alarm { .. }) => self.call(Request::Wake).await?,
                other => other?,
            };
        } else {
            // A board that resets on opening speaks by itself; one that does not needs no wait, but
            // cannot be told from the other.
            self.clock.sleep(Duration::from_millis(self.spec.link.open_settle_ms)).await;
        }
        // A board that was starting anyway introduces itself twice: once by itself, once when woken.
        let mut tries = 0;
        loop {
            match self.identify().await {
                Err(MoverError::Device(Failure::Restarted)) if tries < 3 => tries += 1,
                other => break other.map(drop)?,
            };
        }
        self.call(Request::Run(Which::Init)).await?;
        Ok(())
    }

    /// No reply from a device that speaks another language is another error than silence, and so is no reply from one
    /// that a hard stop silences.
    fn unless_it_speaks_otherwise(&self, error: MoverError) -> MoverError {
        match (error, self.link.telemetry().strange) {
            (MoverError::Device(Failure::NoReply { .. }), Some(said)) => MoverError::SpeaksOtherwise {
                protocol: self.spec.protocol.name.clone(),
                said: said.chars().take(60).collect(),
            },
            (MoverError::Device(silence @ Failure::NoReply { .. }), None) => self.unless_halted(silence),
            (error, _) => error,
        }
    }

    fn unless_halted(&self, silence: Failure) -> MoverError {
        match after_hard_stop(&self.spec) {
            Some(afterwards) => {
                MoverError::Halted { silence: Box::new(silence), afterwards: afterwards.to_owned() }
            }
            None => silence.into(),
        }
    }

    /// Asks the firmware who it is and verifies the answer; returns its words.
    pub async fn identify(&mut self) -> Result<String, MoverError> {
        let replies = self.call(Request::Identify).await?;
        let mut words: Vec<String> = self.link.telemetry().banner.into_iter().collect();
        for reply in &replies {
            words.push(reply.raw.clone());
            // Where the answer is a value inside a reply, the value is what identifies.
            words.extend(["data", "text"].iter().map(|f| reply.text(f)).filter(|t| !t.is_empty()));
        }
        let rig = match &self.settings.identity {
            Some(text) => Some(
                Pattern::new(text)
                    .map_err(|reason| MoverError::IdentityPattern { pattern: text.clone(), reason })?,
            ),
            None => None,
        };
        for pattern in [self.spec.protocol.firmware_match.as_ref(), rig.as_ref()].into_iter().flatten() {
            if !words.iter().any(|w| pattern.is_match(w.as_bytes())) {
                let expected = pattern.as_str().to_owned();
                return Err(MoverError::WrongIdentity { says: words.join(" | "), expected });
            }
        }
        let mut said: Vec<String> = self.link.telemetry().banner.into_iter().collect();
        said.extend(
            replies
                .into_iter()
                .filter(|r| r.role != crate::protocol::spec::Role::Ack || r.class == "reply")
                .map(|r| r.raw),
        );
        let identity = said.join("; ");
        self.identity = Some(identity.clone());
        Ok(identity)
    }

    /// What the firmware said when it was last asked.
    pub fn identity(&self) -> Option<&str> {
        self.identity.as_deref()
    }

    /// The rig file's description.
    pub fn settings(&self) -> &MoverSettings {
        &self.settings
    }

    /// The protocol.
    pub fn spec(&self) -> &Arc<Spec> {
        &self.spec
    }

    /// The link, for whoever watches telemetry.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// What is known of the positions.
    pub fn reference(&self) -> Reference {
        self.homed.reference(&self.link.telemetry())
    }

    /// A look at this mover for whoever does not own it. Its identity is that of now.
    pub fn observer(&self) -> Observer {
        let axes = self.settings.axes.iter();
        Observer {
            telemetry: self.link.watch(),
            homed: self.homed.clone(),
            port: self.settings.port.to_string(),
            protocol: self.settings.protocol.clone(),
            identity: self.identity.clone(),
            axes: axes.map(|(name, a)| (name.clone(), a.kind, [a.min, a.max])).collect(),
            tool: self.tool.clone(),
        }
    }

    /// References the axes: recovers from an alarm where one is pending, then homes.
    pub async fn home(&mut self) -> Result<(), MoverError> {
        self.end_of_stop().await?;
        self.homed.begin();
        self.resting = None;
        self.link.set_homing(true);
        let result = self.search_reference().await;
        self.link.set_homing(false);
        let losses = self.link.telemetry().trust_losses;
        self.homed.end(result.is_ok().then_some(losses));
        match result {
            Err(MoverError::Device(silence @ Failure::NoReply { .. })) => {
                return Err(self.unless_halted(silence));
            }
            other => other?,
        }
        self.make_ready().await
    }

    async fn search_reference(&mut self) -> Result<(), MoverError> {
        if let Some(name) = self.recover.take() {
            tracing::info!("recovering from an alarm by [recover.{name}]");
            self.call(Request::Run(Which::Recover(name))).await?;
        }
        let begun = self.clock.now();
        self.call(Request::Run(Which::Home)).await?;
        let homed = self.clock.now();
        let stall = Duration::from_millis(self.settings.stall_ms);
        self.call(Request::Settle { stall, expected: Some(Duration::ZERO) }).await?;
        let ended = self.clock.now();
        self.read_positions().await?;
        spent(Part::Homing, homed.since(begun));
        spent(Part::EndOfMotion, ended.since(homed));
        spent(Part::Position, self.clock.now().since(ended));
        Ok(())
    }

    /// Asks the device where it is: of an arm with joints first the tool, then the joints.
    pub async fn position(&mut self) -> Result<Vec<Measured>, MoverError> {
        self.end_of_stop().await?;
        let axes = self.read_positions().await?;
        Ok(self.with_tool(axes))
    }

    /// Where the device is, for planning the next move: where the last one was measured to end, if nothing has
    /// happened since, or else as it tells now. What proves an arrival or a capture is always asked.
    pub async fn resting(&mut self) -> Result<Vec<Measured>, MoverError> {
        let axes = self.resting_axes().await?;
        Ok(self.with_tool(axes))
    }

    async fn resting_axes(&mut self) -> Result<Vec<Measured>, MoverError> {
        let nothing_happened = !self.stop_handle().is_stopped() && self.reference() == Reference::Referenced;
        if let Some(resting) = self.resting.clone().filter(|_| nothing_happened) {
            return Ok(resting);
        }
        self.end_of_stop().await?;
        let asked = self.clock.now();
        let here = self.read_positions().await;
        spent(Part::Position, self.clock.now().since(asked));
        here
    }

    async fn read_positions(&mut self) -> Result<Vec<Measured>, MoverError> {
        self.call(Request::Position).await?;
        self.told_positions()
    }

    /// The positions as they were told last.
    fn told_positions(&self) -> Result<Vec<Measured>, MoverError> {
        let telemetry = self.link.telemetry();
        let mut all = Vec::new();
        for (axis, reading) in self.names.iter().zip(&telemetry.positions) {
            let reading = reading.ok_or_else(|| MoverError::NoPosition { axis: axis.clone() })?;
            all.push(Measured {
                axis: axis.clone(),
                position: reading.value,
                counts: reading.counts,
                at: reading.at,
            });
        }
        Ok(all)
    }

    /// Largest accepted difference between where an axis was sent and where it is, in its unit.
    pub fn tolerance(&self, axis: &str) -> Option<f64> {
        let of_the_tool = self.tool.as_ref().and_then(|tool| tool.axes.get(axis));
        of_the_tool.or_else(|| self.settings.axes.get(axis)).map(|settings| settings.tolerance)
    }

    /// Where an axis was last sent, where a move has led it there and nothing has happened since: of an arm with
    /// joints each of them, too.
    pub fn sent_to(&self, axis: &str) -> Option<f64> {
        self.tool.as_ref()?.sent_to(axis)
    }

    /// The handle that stops this device at once, from any thread.
    pub fn stop_handle(&self) -> StopHandle {
        self.link.stop_handle()
    }

    /// Stops, and waits until the stop's steps have ended.
    pub async fn stop(&mut self, kind: StopKind) -> Result<(), MoverError> {
        self.resting = None;
        self.stop_handle().stop(kind);
        self.end_of_stop().await
    }

    /// Where a stop was called: waits for the end of its steps, then allows motion again.
    async fn end_of_stop(&mut self) -> Result<(), MoverError> {
        if self.stop_handle().is_stopped() {
            self.resting = None;
            self.link.finish_stop().await?;
        }
        Ok(())
    }

    /// Runs a request and remembers what an alarm asks for.
    async fn call(&mut self, request: Request) -> Outcome {
        let outcome = self.link.call(request).await;
        if let Err(Failure::Alarm { recover: Some(name), .. }) = &outcome {
            self.recover = Some(name.clone());
        }
        outcome
    }

    /// Limits of all axes by name that poses are made of.
    pub fn limits(&self) -> BTreeMap<String, AxisLimits> {
        self.settings.pose_axes().iter().map(|(name, axis)| (name.clone(), axis.limits())).collect()
    }
}

/// What a stop at once leaves behind, where the device needs a person's hand then.
pub fn after_hard_stop(spec: &Spec) -> Option<&str> {
    spec.stop.get("emergency")?.afterwards.as_deref()
}

/// An engine for a device of the rig file; refuses axes that the protocol cannot name.
fn engine_for(spec: &Arc<Spec>, settings: &MoverSettings, patience: f64) -> Result<Engine, MoverError> {
    Ok(Engine::new(spec.clone(), wires(settings), patience)?)
}

fn wires(settings: &MoverSettings) -> Vec<AxisWire> {
    let wire = |(name, axis): (&String, &AxisSettings)| AxisWire {
        name: name.clone(),
        wire: axis.wire.clone(),
        counts_per_unit: axis.counts_per_unit,
        accel: Some(axis.accel),
    };
    settings.axes.iter().map(wire).collect()
}

/// Whether a protocol can serve a device of the rig file, without opening anything.
pub fn check_settings(spec: &Arc<Spec>, settings: &MoverSettings) -> Result<(), MoverError> {
    engine_for(spec, settings, 1.0).map(drop)
}

/// The bytes that stop a device, for a port that nobody has connected to: what a running link would write.
pub fn stop_bytes(spec: &Arc<Spec>, settings: &MoverSettings, kind: StopKind) -> Result<Vec<u8>, MoverError> {
    Ok(engine_for(spec, settings, 1.0)?.stop_bytes(kind))
}

/// The bytes that a move would send, one entry for each command: for a dry run. The limits are
/// checked as for a real move; line numbers and checksums that depend on them are left out. `here` tells where
/// axes are; one that is not named is taken to be at its target.
pub fn preview_move(
    spec: &Arc<Spec>,
    settings: &MoverSettings,
    here: &BTreeMap<String, f64>,
    targets: &[(&str, f64)],
    feed: f64,
) -> Result<Vec<Vec<u8>>, MoverError> {
    let engine = engine_for(spec, settings, 1.0)?;
    let axes = settings.pose_axes();
    let indexed = travel::check_targets(&axes, targets)?;
    let target_of = |at: usize| indexed.iter().find(|(i, _)| *i == at).map_or(0.0, |(_, target)| *target);
    let mut here: Vec<f64> =
        axes.keys().enumerate().map(|(at, name)| here.get(name).copied().unwrap_or(target_of(at))).collect();
    let mut bytes = Vec::new();
    for leg in travel::legs(&axes, &indexed, &here) {
        match Tool::new(settings) {
            Some(tool) => {
                for piece in tool.pieces_from(&here, &leg, feed, settings)? {
                    bytes.extend(engine.preview_move(&piece.targets, piece.feed, &piece.from)?);
                }
            }
            None => bytes.extend(engine.preview_move(&leg, feed, &here)?),
        }
        leg.iter().for_each(|(at, target)| here[*at] = *target);
    }
    Ok(bytes)
}
