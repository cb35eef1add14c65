//! A log of a port, lived through again: what was sent and why, what came back and what it meant, and where
//! the engine of today would have done otherwise.
//!
//! The engine is a function of what it is told and when, and a log holds all of that. So the replay tells a
//! fresh engine the same things at the same instants, and compares what it wants to send with what was sent,
//! and how it ends each request with how it ended. The first difference is either a change of the program or
//! of the protocol file since the log was written, or a log that is not what it seems: what follows it means
//! nothing, so there the replay ends.
//!
//! A log whose beginning was lost to rotation is not judged: nobody knows the state it begins in. Its
//! requests and bytes are told all the same.

use super::byte_log::{Header, Input, LOG_VERSION, Record, outcome_word, stop_word};
use super::link::Outgoing;
use crate::clock::Timestamp;
use crate::protocol::value::hex;
use crate::protocol::{
    Deframer, EncodeError, Engine, Event, Outcome, Request, Spec, StopKind, Ticket, Unit, classify,
};
use serde::{Serialize, Serializer};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Bytes that the engine wanted to send and the log never shows are a difference after this time.
const WRITTEN_WITHIN: Duration = Duration::from_secs(5);

/// Why a log cannot be replayed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// It does not begin as a log does.
    #[error(
        "line 1 is not the first line of a port's log ({found:?}); give a file of logs/, or one of TWINRIG_LOGS"
    )]
    NoHeader {
        /// What it is.
        found: String,
    },
    /// It was written by another version.
    #[error("the log has version {found}; this program reads {LOG_VERSION}: use the release that wrote it")]
    Version {
        /// Its version.
        found: u32,
    },
    /// A line is not a record.
    #[error("line {line} is not a record of a log: {text:?}; restore it, or cut the log there")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// What it says.
        text: String,
    },
    /// The protocol file does not fit the axes of the log.
    #[error("the protocol does not fit this log: {0}; give the right file with --protocol")]
    Protocol(#[from] EncodeError),
}

/// What a record tells.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Told {
    /// A request was made.
    Asked {
        /// Its number.
        request: u64,
        /// In words.
        what: String,
    },
    /// A request ended.
    Ended {
        /// Its number.
        request: u64,
        /// `done`, or the kind of failure.
        how: String,
    },
    /// Bytes went out.
    Sent {
        /// As text or hex.
        bytes: String,
    },
    /// Bytes of a stop went out by the second door.
    StopSent {
        /// As text or hex.
        bytes: String,
    },
    /// A whole line or frame came in.
    Received {
        /// As text or hex.
        bytes: String,
        /// Classes of the protocol file that recognised it; none for what it does not know.
        classes: Vec<String>,
    },
    /// A stop was called.
    Stopped {
        /// `controlled` or `emergency`.
        how: String,
    },
    /// The port was gone.
    Lost {
        /// Why.
        why: String,
    },
    /// The engine's conclusion about something: trust lost, an alarm, a line sent again.
    Remark {
        /// In words.
        text: String,
    },
}

/// A step of the story.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    /// Line of the log, from 1.
    pub line: usize,
    /// Since the log began.
    #[serde(serialize_with = "in_seconds")]
    pub at: Timestamp,
    /// What.
    pub told: Told,
}

fn in_seconds<S: Serializer>(at: &Timestamp, s: S) -> Result<S::Ok, S::Error> {
    s.serialize_f64(at.0 as f64 * 1e-9)
}

/// Where the engine of today would do otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Line of the log, from 1.
    pub line: usize,
    /// Since the log began.
    #[serde(serialize_with = "in_seconds")]
    pub at: Timestamp,
    /// What the log says.
    pub log: String,
    /// What the engine does.
    pub engine: String,
}

/// A log lived through.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Story {
    /// What spoke there.
    pub header: Header,
    /// What happened, up to the first difference.
    pub steps: Vec<Step>,
    /// The first difference.
    pub difference: Option<Difference>,
    /// Whether engine and log could be compared; a log without its beginning cannot.
    pub judged: bool,
    /// Requests made.
    pub requests: usize,
    /// Requests that ended otherwise than `done`.
    pub failed: usize,
}

/// The first line of a log.
///
/// # Errors
/// When it is not one.
pub fn header(text: &str) -> Result<Header, ReplayError> {
    let first = text.lines().next().unwrap_or_default();
    let read = Record::read(first).filter(|r| r.sign == '#').and_then(|r| serde_json::from_str(&r.text).ok());
    let header: Header =
        read.ok_or_else(|| ReplayError::NoHeader { found: first.chars().take(60).collect() })?;
    match header.twinrig_log {
        LOG_VERSION => Ok(header),
        found => Err(ReplayError::Version { found }),
    }
}

/// Lives through a log with the engine of that protocol.
///
/// # Errors
/// When the text is not a log, or the protocol does not fit it.
pub fn replay(text: &str, spec: &Arc<Spec>) -> Result<Story, ReplayError> {
    let header = header(text)?;
    let mut replay = Replay::new(spec, &header)?;
    let mut last = Timestamp(0);
    for (i, line) in text.lines().enumerate().skip(1) {
        // The last line of a log may be cut short: whoever wrote it was killed.
        let cut_short = i + 1 == text.lines().count() && !text.ends_with('\n');
        let Some(record) = Record::read(line) else {
            if cut_short {
                break;
            }
            return Err(ReplayError::Line { line: i + 1, text: line.to_owned() });
        };
        last = record.at;
        replay.live_through(i + 1, &record)?;
        if replay.difference.is_some() {
            break;
        }
    }
    replay.unwritten(text.lines().count(), last);
    let failed = |s: &&Step| matches!(&s.told, Told::Ended { how, .. } if how != "done");
    Ok(Story {
        requests: replay.requests,
        failed: replay.steps.iter().filter(failed).count(),
        judged: replay.judged,
        header,
        difference: replay.difference,
        steps: replay.steps,
    })
}

struct Replay {
    spec: Arc<Spec>,
    engine: Engine,
    outgoing: Outgoing,
    /// When the first of the outgoing bytes was wanted.
    wanted_at: Option<Timestamp>,
    ended: VecDeque<(Ticket, Outcome)>,
    /// Bytes of a stop that the log must show next.
    stop_bytes: Option<Vec<u8>>,
    /// For the story alone: units as they come in.
    deframer: Deframer,
    judged: bool,
    requests: usize,
    steps: Vec<Step>,
    difference: Option<Difference>,
}

impl Replay {
    fn new(spec: &Arc<Spec>, header: &Header) -> Result<Replay, ReplayError> {
        let mut replay = Replay {
            engine: Engine::new(spec.clone(), header.axes.clone(), header.patience)?,
            outgoing: Outgoing::new(spec.clone()),
            wanted_at: None,
            ended: VecDeque::new(),
            stop_bytes: None,
            deframer: Deframer::new(spec.clone()),
            judged: !header.continued,
            requests: 0,
            steps: Vec::new(),
            difference: None,
            spec: spec.clone(),
        };
        replay.poll(Timestamp(0));
        Ok(replay)
    }

    fn poll(&mut self, now: Timestamp) {
        let output = self.engine.poll(now);
        self.outgoing.push_urgent(output.urgent);
        self.outgoing.push(output.bytes);
        if self.outgoing.is_empty() {
            self.wanted_at = None;
        } else {
            self.wanted_at.get_or_insert(now);
        }
        self.ended.extend(output.events.into_iter().filter_map(|e| match e {
            Event::Finished(ticket, outcome) => Some((ticket, outcome)),
            _ => None,
        }));
    }

    fn step(&mut self, line: usize, record: &Record, told: Told) {
        self.steps.push(Step { line, at: record.at, told });
    }

    fn differ(&mut self, line: usize, at: Timestamp, log: String, engine: String) {
        if self.judged && self.difference.is_none() {
            self.difference = Some(Difference { line, at, log, engine });
        }
    }

    fn live_through(&mut self, line: usize, record: &Record) -> Result<(), ReplayError> {
        let at = record.at;
        let broken = || ReplayError::Line { line, text: format!("{} {}", record.sign, record.text) };
        match record.sign {
            // Remarks: the engine's words at that time, or the header of a part after rotation.
            '#' if record.text.starts_with("{\"twinrig_log\"") => {}
            '#' => self.step(line, record, Told::Remark { text: record.text.clone() }),
            '>' => {
                let bytes = record.bytes().ok_or_else(broken)?;
                self.step(line, record, Told::Sent { bytes: show(&bytes) });
                self.compare_sent(line, at, &bytes);
            }
            '!' => {
                let bytes = record.bytes().ok_or_else(broken)?;
                self.step(line, record, Told::StopSent { bytes: show(&bytes) });
                self.compare_stop(line, at, &bytes);
            }
            '<' => {
                self.none_unheard(line, record);
                let bytes = record.bytes().ok_or_else(broken)?;
                self.tell_received(line, record, &bytes);
                self.engine.receive(&bytes, at);
                self.poll(at);
            }
            '=' => {
                let (ticket, word) = record.outcome().ok_or_else(broken)?;
                let (request, how) = (ticket.0, record.text.split_once(' ').map_or("", |(_, how)| how));
                self.step(line, record, Told::Ended { request, how: how.to_owned() });
                self.compare_ended(line, at, ticket, word);
            }
            _ => {
                self.none_unheard(line, record);
                self.input(line, record, record.input().ok_or_else(broken)?);
                self.poll(at);
            }
        }
        self.unwritten(line, at);
        Ok(())
    }

    fn input(&mut self, line: usize, record: &Record, input: Input) {
        match input {
            Input::Wake => {}
            Input::Live => self.engine.set_live(),
            Input::Request(request) => {
                self.requests += 1;
                let what = describe(&request, &self.engine);
                let ticket = self.engine.submit(request);
                self.step(line, record, Told::Asked { request: ticket.0, what });
            }
            Input::Stop { kind, written } => {
                self.step(line, record, Told::Stopped { how: stop_word(kind).to_owned() });
                self.outgoing.drop_unbegun();
                self.wanted_at = None;
                self.stop_bytes = written.then(|| self.engine.stop_bytes(kind));
                self.engine.urgent(kind, written, record.at);
            }
            Input::Lost(why) => {
                self.engine.link_lost(&why);
                self.step(line, record, Told::Lost { why });
            }
        }
    }

    /// The classes of what has come in whole by now.
    fn tell_received(&mut self, line: usize, record: &Record, bytes: &[u8]) {
        let awaited = self.engine.awaited();
        let awaited: Vec<&str> = awaited.iter().map(String::as_str).collect();
        for unit in self.deframer.push(bytes, record.at) {
            let classes = classify(&self.spec, &unit, &awaited).into_iter().map(|r| r.class).collect();
            let bytes = match &unit {
                Unit::Line(text) => show(text),
                Unit::Frame { header, payload } => {
                    let fields: Vec<String> =
                        header.iter().map(|(name, value)| format!("{name}={}", value.to_text())).collect();
                    format!("{} [{}]", fields.join(" "), hex(payload))
                }
                Unit::Garbled(bytes) => format!("unreadable {}", hex(bytes)),
            };
            self.step(line, record, Told::Received { bytes, classes });
        }
    }

    fn compare_sent(&mut self, line: usize, at: Timestamp, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let front = self.outgoing.front().unwrap_or_default();
            let n = front.len().min(rest.len());
            if n == 0 || front[..n] != rest[..n] {
                let wants = if front.is_empty() { "nothing".to_owned() } else { show(front) };
                self.differ(line, at, format!("sent {}", show(bytes)), format!("wants to send {wants}"));
                return;
            }
            self.outgoing.wrote(n);
            rest = &rest[n..];
        }
        self.wanted_at = if self.outgoing.is_empty() { None } else { Some(at) };
    }

    fn compare_stop(&mut self, line: usize, at: Timestamp, bytes: &[u8]) {
        // Where the owner let go of a device in motion, no stop was called: the bytes end the log.
        let wanted = self.stop_bytes.take().unwrap_or_else(|| self.engine.stop_bytes(StopKind::Controlled));
        if !bytes.ends_with(&wanted) {
            self.differ(
                line,
                at,
                format!("stopped by {}", show(bytes)),
                format!("stops by {}", show(&wanted)),
            );
        }
    }

    fn compare_ended(&mut self, line: usize, at: Timestamp, ticket: Ticket, word: &str) {
        let says = format!("request {} ended: {word}", ticket.0);
        match self.ended.pop_front() {
            Some((ours, outcome)) if ours == ticket && outcome_word(&outcome) == word => {}
            Some((ours, outcome)) => self.differ(line, at, says, ends(ours, &outcome)),
            None => self.differ(line, at, says, format!("request {} has not ended yet", ticket.0)),
        }
    }

    /// The log tells the end of a request at once; whatever else comes first has passed over it.
    fn none_unheard(&mut self, line: usize, record: &Record) {
        if let Some((ticket, outcome)) = self.ended.pop_front() {
            let says = format!("{} {} and no end of request {}", record.sign, record.text, ticket.0);
            self.differ(line, record.at, says, ends(ticket, &outcome));
        }
    }

    /// What was wanted long ago must have been written.
    fn unwritten(&mut self, line: usize, now: Timestamp) {
        let long_ago = self.wanted_at.is_some_and(|at| now.since(at) > WRITTEN_WITHIN);
        if let Some(front) = self.outgoing.front().filter(|_| long_ago).map(show) {
            self.differ(
                line,
                now,
                "nothing was sent".to_owned(),
                format!("wanted to send {front} long before"),
            );
        }
    }
}

fn ends(ticket: Ticket, outcome: &Outcome) -> String {
    let why = outcome.as_ref().err().map(|f| format!(" ({f})")).unwrap_or_default();
    format!("ends request {}: {}{why}", ticket.0, outcome_word(outcome))
}

/// A request in words.
fn describe(request: &Request, engine: &Engine) -> String {
    let name = |at: usize| engine.axes().get(at).map_or_else(|| at.to_string(), |a| a.name.clone());
    match request {
        Request::Command { name, .. } => format!("command {name}"),
        Request::Wake => "wake".to_owned(),
        Request::Identify => "identify".to_owned(),
        Request::Move { targets, feed, jog } => {
            let targets: Vec<String> = targets.iter().map(|(i, t)| format!("{} to {t}", name(*i))).collect();
            format!("{} {} at {feed}/s", if *jog { "jog" } else { "move" }, targets.join(", "))
        }
        Request::Settle { stall, .. } => format!("wait for the end of motion (stall {stall:?})"),
        Request::Position => "position".to_owned(),
        Request::Run(which) => format!("run {which:?}").to_lowercase(),
    }
}

/// Bytes for a reader: as text where they are text.
fn show(bytes: impl AsRef<[u8]>) -> String {
    crate::protocol::conformance::show(bytes.as_ref())
}

#[cfg(test)]
mod tests;
