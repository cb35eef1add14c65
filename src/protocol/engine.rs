//! The client's state machine: requests and received bytes in, bytes to send and events out.
//!
//! It reads no clock and opens no port; the caller hands in every instant. Three layers:
//! - [`exchange`]: single commands, flow control, line numbers, what to do when a reply is lost;
//! - [`task`]: sequences (homing, stop, recovery, waiting for the end of motion), one at a time;
//! - [`meaning`]: what each reply means for both, and for state, position and trust.
//!
//! Terms: *deaf* is the time between a reset we sent and the banner, when an `ok` belongs to a line
//! that was dropped; *mute* is a device that by design answers nothing until it is reset; *trust*
//! is whether positions are still valid.
//!
//! It never decides to move: what is sent again after a lost reply is only what the protocol file
//! marks as harmless to send again.

mod exchange;
mod meaning;
mod plan;
mod position;
mod settle;
mod task;
mod terms;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod transcripts;

use super::classify::{Reply, classify};
use super::deframe::{Deframer, Unit};
use super::encode::EncodeError;
use super::spec::*;
use super::value::{Fields, Value};
use crate::clock::Timestamp;
use exchange::Exchange;
use position::Positions;
pub use position::Reading;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;
use task::Task;
pub use terms::{AxisWire, Event, Failure, Outcome, Output, Request, StopKind, Ticket, Which};

/// The client's side of one device.
#[derive(Debug)]
pub struct Engine {
    spec: Arc<Spec>,
    axes: Vec<AxisWire>,
    groups: Vec<Fields>,
    patience: f64,
    deframer: Deframer,
    exchange: Exchange,
    positions: Positions,
    states: Vec<Option<MotionState>>,
    sub_state: Option<String>,
    /// Counts reports of state, so that a wait can tell a fresh one from an old one.
    state_reports: u64,
    classes_seen: Vec<Reply>,
    flag: Option<String>,
    /// Which axes say that their positions are not valid.
    unreferenced: Vec<bool>,
    flag_failure: Option<Failure>,
    deaf: bool,
    mute: bool,
    banner_expected_until: Option<Timestamp>,
    live: bool,
    banner: Option<String>,
    queue_index: Option<i64>,
    /// When the device first said that it is at rest, and has not taken it back.
    rested_at: Option<Timestamp>,
    /// Fault tables as the file has them, replaced where the device tells its own.
    errors: BTreeMap<String, Fault>,
    alarms: BTreeMap<String, Fault>,
    task: Option<Task>,
    tasks: VecDeque<Task>,
    next_ticket: u64,
    next_keepalive: Option<Timestamp>,
    urgent: Vec<u8>,
    events: Vec<Event>,
    /// The last thing the device said that is no reply of this protocol.
    strange: Option<String>,
}

impl Engine {
    /// An engine for a device with these axes. `patience` multiplies every time limit (1 on a real
    /// bench; the clock's speed on a virtual one, whose replies still take wall time).
    pub fn new(spec: Arc<Spec>, axes: Vec<AxisWire>, patience: f64) -> Result<Engine, EncodeError> {
        let mut groups = Vec::new();
        for axis in &axes {
            let field =
                |reason: String| EncodeError::Field { command: format!("axis {}", axis.name), reason };
            let captured = spec.axis.wire.captures(axis.wire.as_bytes()).ok_or_else(|| {
                field(format!("wire \"{}\" does not match {}", axis.wire, spec.axis.wire.as_str()))
            })?;
            if spec.axis.counts && axis.counts_per_unit.is_none() {
                return Err(field(format!("{} speaks in counts: give counts_per_unit", spec.protocol.name)));
            }
            groups.push(captured.into_iter().map(|(k, v)| (k, whole(v))).collect());
        }
        let count = axes.len();
        Ok(Engine {
            deframer: Deframer::new(spec.clone()),
            exchange: Exchange::new(spec.clone(), patience),
            positions: Positions::new(&spec, &axes, &groups),
            states: vec![None; count],
            sub_state: None,
            state_reports: 0,
            classes_seen: Vec::new(),
            flag: None,
            unreferenced: vec![false; count],
            flag_failure: None,
            deaf: false,
            mute: false,
            banner_expected_until: None,
            live: false,
            banner: None,
            queue_index: None,
            rested_at: None,
            errors: spec.errors.clone(),
            alarms: spec.alarms.clone(),
            task: None,
            tasks: VecDeque::new(),
            next_ticket: 1,
            next_keepalive: None,
            urgent: Vec::new(),
            events: Vec::new(),
            strange: None,
            spec,
            axes,
            groups,
            patience,
        })
    }

    /// The protocol.
    pub fn spec(&self) -> &Arc<Spec> {
        &self.spec
    }

    /// The axes.
    pub fn axes(&self) -> &[AxisWire] {
        &self.axes
    }

    /// The device's state over all axes: the busiest of them.
    pub fn state(&self) -> Option<MotionState> {
        let order = [
            MotionState::Alarm,
            MotionState::Homing,
            MotionState::Moving,
            MotionState::Hold,
            MotionState::Off,
            MotionState::Idle,
        ];
        if self.states.iter().any(Option::is_none) {
            return None;
        }
        order.into_iter().find(|s| self.states.contains(&Some(*s)))
    }

    /// The last reported position of each axis, in the order of the axes.
    pub fn positions(&self) -> Vec<Option<Reading>> {
        self.positions.readings()
    }

    /// When the device first said, of the last motion whose end was asked for, that it had ended; `None` where only the
    /// end of the asking tells.
    pub fn rested_at(&self) -> Option<Timestamp> {
        self.rested_at
    }

    /// The words the firmware introduced itself with.
    pub fn banner(&self) -> Option<&str> {
        self.banner.as_deref()
    }

    /// The last thing the device said that is no reply of this protocol.
    pub fn strange(&self) -> Option<&str> {
        self.strange.as_deref()
    }

    /// Whether the device by design answers nothing at present.
    pub fn is_silent(&self) -> bool {
        self.mute || self.deaf || self.exchange.silent()
    }

    /// Names of the commands that wait for a reply.
    pub fn awaited(&self) -> Vec<String> {
        self.exchange.awaited()
    }

    /// From now on an unexpected banner means that the device restarted.
    pub fn set_live(&mut self) {
        self.live = true;
    }

    /// Asks something of the device.
    pub fn submit(&mut self, request: Request) -> Ticket {
        let ticket = self.ticket();
        match self.plan(ticket, request) {
            Ok(task) => self.tasks.push_back(task),
            Err(failure) => self.events.push(Event::Finished(ticket, Err(failure))),
        }
        ticket
    }

    /// Whether something is in progress.
    pub fn is_busy(&self) -> bool {
        self.task.is_some() || !self.tasks.is_empty()
    }

    /// The bytes a move would send, one entry for each command; nothing is sent.
    pub fn preview_move(
        &self,
        targets: &[(usize, f64)],
        feed: f64,
        here: &[f64],
    ) -> Result<Vec<Vec<u8>>, Failure> {
        let here: Vec<Option<f64>> = here.iter().copied().map(Some).collect();
        let sends = self.plan_move(targets, feed, false, &here)?;
        sends.into_iter().map(|(name, _, fields)| Ok(self.exchange.encode_urgent(&name, fields)?)).collect()
    }

    /// Puts a command straight into flow control, beside whatever task runs; this is how a stream of
    /// commands fills the device's buffer.
    pub fn stream(&mut self, name: &str, fields: Fields) -> Ticket {
        let ticket = self.ticket();
        let fields = self.device_fields(fields);
        if let Err(e) = self.exchange.submit(ticket, name, None, fields, None) {
            self.events.push(Event::Finished(ticket, Err(e.into())));
        }
        ticket
    }

    /// Sends real-time bytes now, such as those that resume after a hold.
    pub fn realtime(&mut self, name: &str, now: Timestamp) -> Result<(), EncodeError> {
        let bytes = self.spec.realtime.get(name).ok_or_else(|| EncodeError::Unknown {
            protocol: self.spec.protocol.name.clone(),
            command: format!("(real-time) {name}"),
        })?;
        self.urgent.extend(&bytes.0);
        self.realtime_sent(name, now);
        Ok(())
    }

    /// The bytes that begin a stop, for whoever can write them without waiting.
    pub fn stop_bytes(&self, kind: StopKind) -> Vec<u8> {
        let mut bytes = Vec::new();
        for step in self.leading_sends(self.stop_procedure(kind)) {
            if let Some(name) = &step.realtime {
                bytes.extend(self.spec.realtime.get(name).map(|b| b.0.as_slice()).unwrap_or_default());
            } else if let Some(name) = &step.send {
                for fields in self.addressed(name) {
                    bytes.extend(self.exchange.encode_urgent(name, fields).unwrap_or_default());
                }
            }
        }
        bytes
    }

    /// Stops: drops everything that waits, puts the stop's bytes before all others (unless the
    /// caller has written them already), then runs the rest of its steps.
    pub fn urgent(&mut self, kind: StopKind, bytes_already_written: bool, now: Timestamp) -> Ticket {
        let ticket = self.ticket();
        self.end_everything(Failure::Stopped);
        if !bytes_already_written {
            self.urgent.extend(self.stop_bytes(kind));
        }
        let procedure = self.stop_procedure(kind).clone();
        let sent = self.leading_sends(&procedure).len();
        for step in &procedure.steps[..sent] {
            if let Some(name) = &step.realtime {
                self.realtime_sent(name, now);
            }
        }
        if procedure.trust == Trust::Lost {
            self.events.push(Event::TrustLost("stopped at once".to_owned()));
        }
        // Replies to what was dropped may still come.
        self.exchange.distrust_acks();
        self.task = Some(self.plan_stop(ticket, &procedure, sent));
        ticket
    }

    fn leading_sends<'a>(&self, procedure: &'a Procedure) -> Vec<&'a Step> {
        task::leading_sends(procedure, self.spec.position.command.as_deref())
    }

    fn stop_procedure(&self, kind: StopKind) -> &Procedure {
        let stop = &self.spec.stop;
        let names: &[&str] = match kind {
            StopKind::Homing => &["homing", "controlled", "emergency"],
            StopKind::Controlled => &["controlled", "emergency"],
            StopKind::Emergency => &["emergency"],
        };
        names.iter().find_map(|name| stop.get(*name)).expect("a checked file has [stop.emergency]")
    }

    /// Takes received bytes.
    pub fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        for unit in self.deframer.push(bytes, now) {
            if let Unit::Garbled(bytes) = &unit {
                self.strange = Some(bytes.escape_ascii().to_string());
                self.note(format!("unreadable bytes: {}", super::value::hex(bytes)));
                continue;
            }
            let awaited = self.awaited();
            let awaited: Vec<&str> = awaited.iter().map(String::as_str).collect();
            let replies = classify(&self.spec, &unit, &awaited);
            if replies.is_empty() {
                let raw = match &unit {
                    Unit::Line(text) => String::from_utf8_lossy(text).into_owned(),
                    Unit::Frame { header, payload } => {
                        let fields = header.iter().map(|(name, value)| format!("{name} {}", value.to_text()));
                        let fields = fields.collect::<Vec<_>>().join(", ");
                        format!("a frame with {fields}, payload {}", super::value::hex(payload))
                    }
                    Unit::Garbled(bytes) => bytes.escape_ascii().to_string(),
                };
                self.strange = Some(raw.clone());
                self.note(format!("unknown reply: {raw}"));
            }
            for reply in replies {
                self.take_in(reply, now);
            }
        }
    }

    /// The line is gone: everything that waits ends, nothing more is sent.
    pub fn link_lost(&mut self, reason: &str) {
        self.events.push(Event::TrustLost(format!("the link was lost: {reason}")));
        self.end_everything(Failure::LinkLost(reason.to_owned()));
    }

    /// Does what is due and hands out what there is.
    pub fn poll(&mut self, now: Timestamp) -> Output {
        let finished = self.exchange.on_time(now);
        self.finish_commands(finished);
        self.run_tasks(now);
        self.keep_alive(now);
        if self.deaf && self.banner_expected_until.is_some_and(|until| until <= now) {
            self.deaf = false;
            self.note("no banner after a reset".to_owned());
        }
        let mut output = Output::default();
        if !self.mute && !self.deaf {
            self.exchange.pump(now, &mut output.bytes);
        }
        self.events.extend(self.exchange.notes().into_iter().map(Event::Note));
        output.urgent = std::mem::take(&mut self.urgent);
        output.events = std::mem::take(&mut self.events);
        let deaf_until = self.banner_expected_until.filter(|_| self.deaf);
        let task = self.task.as_ref().and_then(Task::wake);
        let waits = [self.exchange.deadline(), task, self.next_keepalive, deaf_until];
        output.wake = waits.into_iter().flatten().min();
        output
    }

    fn keep_alive(&mut self, now: Timestamp) {
        let Some(keepalive) = self.spec.keepalive.clone().filter(|_| self.live && !self.is_silent()) else {
            return;
        };
        let every = Duration::from_millis(keepalive.every_ms);
        match self.next_keepalive {
            Some(due) if due > now => {}
            Some(_) => {
                self.next_keepalive = Some(now.after(every));
                self.stream(&keepalive.command, Fields::new());
            }
            None => self.next_keepalive = Some(now.after(every)),
        }
    }

    fn ticket(&mut self) -> Ticket {
        let ticket = Ticket(self.next_ticket);
        self.next_ticket += 1;
        ticket
    }

    fn note(&mut self, text: String) {
        self.events.push(Event::Note(text));
    }

    fn patient(&self, ms: u64) -> Duration {
        Duration::from_millis(ms).mul_f64(self.patience)
    }

    /// Fields for a command that concerns the device: what all axes agree on, then the file's own.
    fn device_fields(&self, mut fields: Fields) -> Fields {
        if let Some(first) = self.groups.first() {
            for (name, value) in first {
                if self.groups.iter().all(|g| g.get(name) == Some(value)) {
                    fields.entry(name.clone()).or_insert_with(|| value.clone());
                }
            }
        }
        for (name, value) in &self.spec.axis.device_fields {
            fields.insert(name.clone(), value.clone());
        }
        let letters: Vec<String> =
            self.groups.iter().filter_map(|g| g.get("letter")).map(Value::to_text).collect();
        fields.entry("letters".to_owned()).or_insert_with(|| Value::Text(letters.join(" ")));
        fields
    }

    /// Fields for each sending of a command: one, or one for each axis.
    fn addressed(&self, name: &str) -> Vec<Fields> {
        match self.spec.cmd.get(name).map(|c| c.scope) {
            Some(Scope::Axis) => self.groups.clone(),
            _ => vec![self.device_fields(Fields::new())],
        }
    }

    fn realtime_sent(&mut self, name: &str, now: Timestamp) {
        if self.spec.flow.reset.as_deref() == Some(name) {
            self.expect_banner(now);
        }
    }

    /// We have reset the device: until its banner, replies belong to lines that were dropped.
    fn expect_banner(&mut self, now: Timestamp) {
        self.deaf = self.spec.flow.after_reset.is_some();
        self.mute = false;
        self.banner_expected_until = Some(now.after(self.patient(3000)));
        let dropped = self.exchange.end_all(&Failure::Stopped);
        self.finish_commands(dropped);
    }

    fn finish_commands(&mut self, finished: Vec<(Ticket, Outcome)>) {
        for (ticket, outcome) in finished {
            match &mut self.task {
                Some(task) if task.waits_for(ticket) => task.answers.push_back((ticket, outcome)),
                _ => self.events.push(Event::Finished(ticket, outcome)),
            }
        }
    }

    fn end_task(&mut self, outcome: Outcome) {
        if let Some(task) = self.task.take() {
            self.events.push(Event::Finished(task.ticket, outcome));
        }
    }

    fn end_everything(&mut self, failure: Failure) {
        let dropped = self.exchange.end_all(&failure);
        self.finish_commands(dropped);
        self.end_task(Err(failure.clone()));
        for task in std::mem::take(&mut self.tasks) {
            self.events.push(Event::Finished(task.ticket, Err(failure.clone())));
        }
    }
}

/// Digits are numbers; anything else stays text.
fn whole(value: Value) -> Value {
    match &value {
        Value::Text(t) => t.parse().map(Value::Int).unwrap_or(value),
        _ => value,
    }
}
