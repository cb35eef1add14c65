//! Commands and their replies: flow control, line numbers, lost replies.
//!
//! A reply that does not come is the central case. What is done then stands in the protocol file:
//! - `idempotent`: the command is sent again;
//! - `resync`: the *same numbered line* is sent again; a device that has it already says so by asking
//!   for the next number, and nothing is executed twice;
//! - `never`: the outcome is unknown, and whoever asked must find out where the device is.
//!
//! After a lost reply, a late `ok` could be taken for the next command's. So a harmless command with
//! data of its own (`[flow] resync`) is put in between, and an `ok` counts for it only after its data.

mod overdue;

use super::{Failure, Outcome, Ticket};
use crate::clock::Timestamp;
use crate::protocol::classify::Reply;
use crate::protocol::encode::{EncodeError, encode};
use crate::protocol::spec::*;
use crate::protocol::value::{Fields, Value};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// How often a command is sent at most.
const MAX_ATTEMPTS: u32 = 4;
/// How long a request to send again may come without its `ok`.
const RESEND_GRACE_MS: u64 = 300;
/// Ticket of commands that nobody waits for.
const NOBODY: Ticket = Ticket(0);

#[derive(Debug)]
struct Queued {
    ticket: Ticket,
    name: String,
    axis: Option<usize>,
    fields: Fields,
    /// Time for the reply, where a step gives another than the command's own.
    timeout_ms: Option<u64>,
    attempts: u32,
}

#[derive(Debug)]
struct Flight {
    queued: Queued,
    bytes: Vec<u8>,
    number: Option<i64>,
    id: Option<i64>,
    deadline: Timestamp,
    timeout: Duration,
    collected: Vec<Reply>,
    refused: Option<Failure>,
    /// The device has said that it has this line already.
    received: bool,
}

#[derive(Debug)]
struct Resend {
    from: i64,
    due: Timestamp,
}

#[derive(Debug)]
pub(super) struct Exchange {
    spec: Arc<Spec>,
    patience: f64,
    queue: VecDeque<Queued>,
    aside: VecDeque<Queued>,
    flight: VecDeque<Flight>,
    next_line: i64,
    numbers_set: bool,
    history: VecDeque<(i64, Vec<u8>)>,
    resend: Option<Resend>,
    next_id: i64,
    acks_in_doubt: bool,
    again: Vec<u8>,
    notes: Vec<String>,
}

impl Exchange {
    pub(super) fn new(spec: Arc<Spec>, patience: f64) -> Self {
        let next_id = spec.flow.id.as_ref().map_or(0, |id| i64::from(id.min));
        Exchange {
            spec,
            patience,
            queue: VecDeque::new(),
            aside: VecDeque::new(),
            flight: VecDeque::new(),
            next_line: 1,
            numbers_set: false,
            history: VecDeque::new(),
            resend: None,
            next_id,
            acks_in_doubt: false,
            again: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Queues a command; refuses at once what cannot be written.
    pub(super) fn submit(
        &mut self,
        ticket: Ticket,
        name: &str,
        axis: Option<usize>,
        fields: Fields,
        timeout_ms: Option<u64>,
    ) -> Result<(), EncodeError> {
        let mut trial = fields.clone();
        if let Some(id) = &self.spec.flow.id {
            trial.insert(id.field.clone(), Value::Int(i64::from(id.max)));
        }
        encode(&self.spec, name, &trial, None)?;
        self.queue.push_back(Queued { ticket, name: name.to_owned(), axis, fields, timeout_ms, attempts: 0 });
        Ok(())
    }

    /// Sends a command before the queue, for nobody: clearing a latched error.
    pub(super) fn send_aside(&mut self, name: &str, fields: Fields) {
        self.aside.push_back(Queued {
            ticket: NOBODY,
            name: name.to_owned(),
            axis: None,
            fields,
            timeout_ms: None,
            attempts: 0,
        });
    }

    /// Bytes of a stop command: without a line number, under the id kept for stops.
    pub(super) fn encode_urgent(&self, name: &str, mut fields: Fields) -> Result<Vec<u8>, EncodeError> {
        if let Some(id) = &self.spec.flow.id {
            fields.insert(id.field.clone(), Value::Int(i64::from(id.urgent)));
        }
        encode(&self.spec, name, &fields, None)
    }

    /// The next reply may belong to something that was given up.
    pub(super) fn distrust_acks(&mut self) {
        self.acks_in_doubt = self.spec.flow.mode != FlowMode::IdMatched && self.spec.flow.resync.is_some();
    }

    pub(super) fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Names of the commands that wait for a reply.
    pub(super) fn awaited(&self) -> Vec<String> {
        self.flight.iter().map(|f| f.queued.name.clone()).collect()
    }

    /// Whether the device is silent by design while it works on what it was sent.
    pub(super) fn silent(&self) -> bool {
        self.flight.iter().any(|f| self.spec.cmd[&f.queued.name].silent)
    }

    pub(super) fn deadline(&self) -> Option<Timestamp> {
        let resend = self.resend.as_ref().map(|r| r.due);
        let oldest = match self.spec.flow.mode {
            FlowMode::IdMatched => self.flight.iter().map(|f| f.deadline).min(),
            _ => self.flight.front().map(|f| f.deadline),
        };
        [resend, oldest].into_iter().flatten().min()
    }

    /// The axis a reply is about, as far as the command it answers tells.
    pub(super) fn axis_of(&self, reply: &Reply) -> Option<usize> {
        self.flight_of(reply).and_then(|i| self.flight[i].queued.axis)
    }

    /// The command a reply answers.
    pub(super) fn command_of(&self, reply: &Reply) -> Option<String> {
        self.flight_of(reply).map(|i| self.flight[i].queued.name.clone())
    }

    fn flight_of(&self, reply: &Reply) -> Option<usize> {
        match &self.spec.flow.id {
            Some(id) if self.spec.flow.mode == FlowMode::IdMatched => {
                let got = reply.fields.get(&id.field).and_then(Value::as_i64)?;
                self.flight.iter().position(|f| f.id == Some(got))
            }
            _ => {
                // Named replies answer the first command that waits for that class.
                let named =
                    self.flight.iter().position(|f| self.spec.cmd[&f.queued.name].reply == reply.class);
                named.or(if self.flight.is_empty() { None } else { Some(0) })
            }
        }
    }

    /// Motion makes progress: whatever waits for its end may go on waiting.
    pub(super) fn progress(&mut self, now: Timestamp) {
        for f in &mut self.flight {
            if self.spec.cmd[&f.queued.name].waits_for_motion {
                f.deadline = now.after(f.timeout);
            }
        }
    }

    /// The device restarted: its line counter is zero. True when something was in flight.
    pub(super) fn restarted(&mut self) -> bool {
        self.numbers_set = false;
        self.next_line = 1;
        self.history.clear();
        self.resend = None;
        self.acks_in_doubt = false;
        !self.flight.is_empty()
    }

    /// Ends everything that waits, sent or not.
    pub(super) fn end_all(&mut self, failure: &Failure) -> Vec<(Ticket, Outcome)> {
        let mut ended = self.end_flight(failure);
        self.aside.clear();
        ended.extend(self.queue.drain(..).map(|q| (q.ticket, Err(failure.clone()))));
        ended
    }

    /// Ends what was sent; what was not is still to be sent.
    pub(super) fn end_flight(&mut self, failure: &Failure) -> Vec<(Ticket, Outcome)> {
        self.again.clear();
        self.resend = None;
        let sent = self.flight.drain(..).map(|f| (f.queued.ticket, Err(failure.clone())));
        sent.filter(|(ticket, _)| *ticket != NOBODY).collect()
    }

    /// Sends what flow control allows.
    pub(super) fn pump(&mut self, now: Timestamp, out: &mut Vec<u8>) {
        out.append(&mut self.again);
        if self.resend.is_some() {
            return;
        }
        loop {
            let Some(next) = self.choose() else { return };
            let name = next.name.clone();
            let id = self.id_for();
            let cmd = &self.spec.cmd[&name];
            let number = self.number_for(cmd, &name);
            let mut fields = next.fields.clone();
            if let (Some(spec), Some(id)) = (&self.spec.flow.id, id) {
                fields.insert(spec.field.clone(), Value::Int(id));
            }
            if let Some(n) = number {
                fields.insert("n".to_owned(), Value::Int(n));
            }
            let timeout =
                Duration::from_millis(next.timeout_ms.unwrap_or(cmd.timeout_ms)).mul_f64(self.patience);
            let waits = cmd.reply != "none";
            match encode(&self.spec, &name, &fields, number) {
                Ok(bytes) => {
                    if !self.fits(bytes.len()) {
                        self.queue.push_front(next);
                        return;
                    }
                    self.sent(number, &name, &bytes);
                    out.extend(&bytes);
                    if waits {
                        let deadline = now.after(timeout);
                        self.flight.push_back(Flight {
                            queued: Queued { attempts: next.attempts + 1, ..next },
                            bytes,
                            number,
                            id,
                            deadline,
                            timeout,
                            collected: Vec::new(),
                            refused: None,
                            received: false,
                        });
                    }
                }
                Err(e) => self.notes.push(format!("not sent: {e}")),
            }
        }
    }

    /// The next command to send: first what keeps the dialogue in step, then the queue.
    fn choose(&mut self) -> Option<Queued> {
        let busy = !self.flight.is_empty();
        let one = matches!(self.spec.flow.mode, FlowMode::OneInFlight | FlowMode::QueueIndex);
        if busy && one {
            return None;
        }
        if let Some(aside) = self.aside.pop_front() {
            return Some(aside);
        }
        let internal = |name: &String| Queued {
            ticket: NOBODY,
            name: name.clone(),
            axis: None,
            fields: Fields::new(),
            timeout_ms: None,
            attempts: 0,
        };
        if self.queue.is_empty() {
            return None;
        }
        if let Some(numbering) = self.spec.line.as_ref().and_then(|l| l.numbering.as_ref())
            && !self.numbers_set
        {
            return if busy { None } else { Some(internal(&numbering.reset)) };
        }
        if let Some(resync) = self.spec.flow.resync.as_ref().filter(|_| self.acks_in_doubt) {
            self.acks_in_doubt = false;
            return Some(internal(resync));
        }
        // Until the doubt is settled nothing overtakes the command that settles it.
        if self.flight.iter().any(|f| f.queued.ticket == NOBODY) {
            return None;
        }
        self.queue.pop_front()
    }

    fn number_for(&self, cmd: &CommandSpec, name: &str) -> Option<i64> {
        let numbering = self.spec.line.as_ref()?.numbering.as_ref()?;
        match name == numbering.reset {
            true => Some(0),
            false => (cmd.numbered && self.numbers_set).then_some(self.next_line),
        }
    }

    fn id_for(&mut self) -> Option<i64> {
        let id = self.spec.flow.id.as_ref()?;
        let used = self.next_id;
        self.next_id = if used >= i64::from(id.max) { i64::from(id.min) } else { used + 1 };
        Some(used)
    }

    fn fits(&self, bytes: usize) -> bool {
        match (self.spec.flow.mode, self.spec.flow.window_bytes) {
            (FlowMode::CharCount, Some(window)) => {
                let flying: usize = self.flight.iter().map(|f| f.bytes.len()).sum();
                flying == 0 || flying + bytes <= window
            }
            _ => true,
        }
    }

    fn sent(&mut self, number: Option<i64>, name: &str, bytes: &[u8]) {
        let Some(numbering) = self.spec.line.as_ref().and_then(|l| l.numbering.as_ref()) else { return };
        let Some(n) = number else { return };
        if name == numbering.reset {
            self.numbers_set = true;
            self.history.clear();
        }
        self.next_line = n + 1;
        self.history.push_back((n, bytes.to_vec()));
        while self.history.len() > numbering.history {
            self.history.pop_front();
        }
    }

    /// Takes a reply; returns the commands it ends.
    pub(super) fn take_in(
        &mut self,
        reply: &Reply,
        now: Timestamp,
        errors: &BTreeMap<String, Fault>,
    ) -> Vec<(Ticket, Outcome)> {
        if reply.role == Role::Busy {
            for f in &mut self.flight {
                f.deadline = now.after(f.timeout);
            }
            return Vec::new();
        }
        if reply.role == Role::Resend {
            self.on_resend(reply, now);
            return Vec::new();
        }
        let Some(at) = self.flight_of(reply) else {
            if matches!(reply.role, Role::Ack | Role::Nack) {
                self.notes.push(format!("a reply that nothing waits for: {}", reply.raw));
            }
            return Vec::new();
        };
        let rx = self.spec.class(&reply.class).cloned();
        let flight = &mut self.flight[at];
        let cmd = &self.spec.cmd[&flight.queued.name];
        let ends = match cmd.reply.as_str() {
            "ack" => reply.role == Role::Ack,
            class => reply.class == class && reply.role != Role::Nack,
        };
        let wanted = cmd.collect.contains(&reply.class) || cmd.needs.as_ref() == Some(&reply.class);
        if wanted || ends {
            flight.collected.push(reply.clone());
        }
        if reply.role == Role::Nack {
            let refused = refusal(&flight.queued.name, rx.as_ref(), reply, errors);
            if rx.is_some_and(|rx| rx.ack_follows) {
                flight.refused = Some(refused);
                return Vec::new();
            }
            return self.end(at, Err(refused));
        }
        if !ends {
            return Vec::new();
        }
        if let Some(resend) = self.resend.take() {
            // This `ok` closes the line that was asked for again, it accepts nothing.
            return self.send_again(resend.from, now);
        }
        self.accept(at)
    }

    /// The device has accepted a command, or so it seems.
    fn accept(&mut self, at: usize) -> Vec<(Ticket, Outcome)> {
        let flight = &mut self.flight[at];
        let cmd = &self.spec.cmd[&flight.queued.name];
        let has = |class: &String| flight.collected.iter().any(|r| r.class == *class);
        if flight.received && (cmd.waits_for_motion || cmd.needs.as_ref().is_some_and(|n| !has(n))) {
            // It was received once, but its answer is lost: ask anew, under a new number.
            let flight = self.flight.remove(at).expect("the index was just found");
            self.notes.push(format!("asking anew: {}", flight.queued.name));
            self.queue.push_front(flight.queued);
            return Vec::new();
        }
        if let Some(needed) = cmd.needs.as_ref().filter(|n| !has(n)) {
            self.notes.push(format!("an ok before the {needed} of {}: not its own", flight.queued.name));
            return Vec::new();
        }
        let outcome = match flight.refused.take() {
            Some(failure) => Err(failure),
            None => Ok(std::mem::take(&mut flight.collected)),
        };
        self.end(at, outcome)
    }

    fn end(&mut self, at: usize, outcome: Outcome) -> Vec<(Ticket, Outcome)> {
        let flight = self.flight.remove(at).expect("the index was just found");
        if flight.queued.ticket == NOBODY {
            if let Err(failure) = outcome {
                self.notes.push(format!("{}: {failure}", flight.queued.name));
            }
            return Vec::new();
        }
        vec![(flight.queued.ticket, outcome)]
    }
}

fn refusal(command: &str, rx: Option<&RxSpec>, reply: &Reply, errors: &BTreeMap<String, Fault>) -> Failure {
    let code = rx.and_then(|rx| rx.code.as_ref()).map(|field| reply.text(field)).unwrap_or_default();
    let usage = || FaultClass::Usage.advice().to_owned();
    let (text, next) = match errors.get(&code) {
        Some(fault) => (fault.text.clone(), fault.next_move()),
        None if code.is_empty() => (reply.raw.clone(), usage()),
        None => ("not in the protocol file's table".to_owned(), usage()),
    };
    Failure::Refused { command: command.to_owned(), code, text, next }
}
