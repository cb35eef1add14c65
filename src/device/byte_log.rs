//! A log of one port: every byte read and written, and everything else the protocol engine was told, with
//! its instant; so that any field failure can be replayed ([`super::replay`]).
//!
//! One record a line: seconds since the log began (to the nanosecond), a sign, and the rest:
//!
//! | sign | rest |
//! |---|---|
//! | `>` | bytes written to the device |
//! | `<` | bytes read from it |
//! | `!` | bytes of a stop that went out by the port's second door |
//! | `?` | a request, as JSON |
//! | `=` | how a request ended: its number, a word, and why |
//! | `*` | another input: nothing (the engine's time had come), `live`, `stop KIND written\|unwritten`, `lost WHY` |
//! | `#` | a remark; the first line says what speaks here ([`Header`]) |
//!
//! Bytes are text with escapes. The file is rotated at a size: `<log>.1` is the part before it, `<log>.2` the one before
//! that, and so on. So many are kept that weeks can be replayed from their beginning, and no session fills the disk.

use crate::clock::Timestamp;
use crate::protocol::{AxisWire, Failure, Outcome, Request, StopKind, Ticket};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Size at which a file is rotated: days of polling, still opened by any editor.
const ROTATE_BYTES: u64 = 16 << 20;

/// Parts of a log that are kept besides the one that is written.
const KEPT_PARTS: u32 = 7;

/// Which way bytes went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// To the device.
    Sent,
    /// From the device.
    Received,
    /// To the device, by a stop.
    Stop,
}

/// The first line of a log: what a replay needs to know of the engine that was at work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// Version of this form of log.
    pub twinrig_log: u32,
    /// The protocol, as the rig file names it.
    pub protocol: String,
    /// The device's axes.
    pub axes: Vec<AxisWire>,
    /// By what the engine's time limits were multiplied.
    pub patience: f64,
    /// Whether this file is the later part of a log that was rotated.
    #[serde(default)]
    pub continued: bool,
}

/// The version of the form of log that is written.
pub const LOG_VERSION: u32 = 1;

/// What an engine is told beside bytes.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// A request.
    Request(Request),
    /// From now on a banner means a restart.
    Live,
    /// Its time had come.
    Wake,
    /// A stop; `written` when its bytes were on the wire already.
    Stop {
        /// How to stop.
        kind: StopKind,
        /// Whether the second door took the bytes.
        written: bool,
    },
    /// The port is gone.
    Lost(String),
}

/// An open log.
#[derive(Debug)]
pub struct ByteLog {
    path: PathBuf,
    /// Not buffered: a killed session is the one whose log is wanted.
    file: File,
    written: u64,
    rotate_at: u64,
    begun: Option<Timestamp>,
    header: Option<Header>,
}

impl ByteLog {
    /// Begins a log at `path`; an older file of that name is kept as `<path>.1`, as a part before this one would be.
    pub fn create(path: &Path) -> io::Result<ByteLog> {
        Self::with_limit(path, ROTATE_BYTES)
    }

    fn with_limit(path: &Path, rotate_at: u64) -> io::Result<ByteLog> {
        make_room(path)?;
        let file = File::create(path)?;
        Ok(ByteLog { path: path.to_owned(), file, written: 0, rotate_at, begun: None, header: None })
    }

    /// Writes down bytes.
    pub fn bytes(&mut self, at: Timestamp, direction: Direction, bytes: &[u8]) -> io::Result<()> {
        let sign = match direction {
            Direction::Sent => '>',
            Direction::Received => '<',
            Direction::Stop => '!',
        };
        self.record(at, sign, &escape(bytes))
    }

    /// Writes down something to know.
    pub fn remark(&mut self, at: Timestamp, text: &str) -> io::Result<()> {
        self.record(at, '#', &escape(text.as_bytes()))
    }

    /// Writes down who speaks here; again in every file of a rotated log.
    pub fn header(&mut self, at: Timestamp, header: Header) -> io::Result<()> {
        self.record(at, '#', &serde_json::to_string(&header)?)?;
        self.header = Some(Header { continued: true, ..header });
        Ok(())
    }

    /// Writes down what the engine is told.
    pub fn input(&mut self, at: Timestamp, input: &Input) -> io::Result<()> {
        match input {
            Input::Request(request) => self.record(at, '?', &serde_json::to_string(request)?),
            Input::Live => self.record(at, '*', "live"),
            Input::Wake => self.record(at, '*', ""),
            Input::Stop { kind, written } => {
                let written = if *written { "written" } else { "unwritten" };
                self.record(at, '*', &format!("stop {} {written}", stop_word(*kind)))
            }
            Input::Lost(why) => self.record(at, '*', &format!("lost {}", escape(why.as_bytes()))),
        }
    }

    /// Writes down how a request ended.
    pub fn outcome(&mut self, at: Timestamp, ticket: Ticket, outcome: &Outcome) -> io::Result<()> {
        let why = outcome.as_ref().err().map(Failure::to_string).unwrap_or_default();
        let text = format!("{} {} {}", ticket.0, outcome_word(outcome), escape(why.as_bytes()));
        self.record(at, '=', text.trim_end())
    }

    fn record(&mut self, at: Timestamp, sign: char, text: &str) -> io::Result<()> {
        let begun = *self.begun.get_or_insert(at);
        let ns = at.0 - begun.0;
        let line = format!("{:>5}.{:09} {sign} {text}\n", ns / 1_000_000_000, ns % 1_000_000_000);
        self.file.write_all(line.as_bytes())?;
        self.written += line.len() as u64;
        if self.written >= self.rotate_at {
            make_room(&self.path)?;
            self.file = File::create(&self.path)?;
            self.written = 0;
            if let Some(header) = self.header.clone() {
                self.header(at, header)?;
            }
        }
        Ok(())
    }
}

/// The word of a log for a kind of stop.
pub fn stop_word(kind: StopKind) -> &'static str {
    match kind {
        StopKind::Controlled => "controlled",
        StopKind::Homing => "homing",
        StopKind::Emergency => "emergency",
    }
}

/// The word of a log for an outcome.
pub fn outcome_word(outcome: &Outcome) -> &'static str {
    match outcome {
        Ok(_) => "done",
        Err(Failure::Refused { .. }) => "refused",
        Err(Failure::NoReply { .. }) => "no_reply",
        Err(Failure::Restarted) => "restarted",
        Err(Failure::Alarm { .. }) => "alarm",
        Err(Failure::Flag { .. }) => "flag",
        Err(Failure::Stalled { .. }) => "stalled",
        Err(Failure::LinkLost(_)) => "link_lost",
        Err(Failure::Stopped) => "stopped",
        Err(Failure::ResendLoop { .. }) => "resend_loop",
        Err(Failure::WrongState { .. }) => "wrong_state",
        Err(Failure::Encode(_)) => "not_sent",
    }
}

/// The file that holds the part of a log so many parts before the one at `path`.
fn part(path: &Path, before: u32) -> PathBuf {
    if before == 0 {
        return path.to_owned();
    }
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{before}"));
    PathBuf::from(name)
}

/// Moves every part one further back, the last of them out.
fn make_room(path: &Path) -> io::Result<()> {
    for before in (0..KEPT_PARTS).rev() {
        let from = part(path, before);
        if from.exists() {
            std::fs::rename(from, part(path, before + 1))?;
        }
    }
    Ok(())
}

/// A log with the parts before it, as far back as one continues another.
///
/// # Errors
/// When the log itself cannot be read; a part that is missing is where it begins.
pub fn whole(path: &Path) -> io::Result<String> {
    let mut text = std::fs::read_to_string(path)?;
    for before in 1..=KEPT_PARTS {
        let is_later = |text: &str| Header::of(text).is_some_and(|header| header.continued);
        match std::fs::read_to_string(part(path, before)) {
            Ok(older) if is_later(&text) => text = older + &text,
            _ => break,
        }
    }
    Ok(text)
}

impl Header {
    /// The header of a log, if it begins with one.
    fn of(text: &str) -> Option<Header> {
        let first = Record::read(text.lines().next()?)?;
        serde_json::from_str(&first.text).ok()
    }
}

fn escape(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len() + 8);
    for b in bytes {
        match b {
            b'\\' => out.push_str("\\\\"),
            b'\n' => out.push_str("\\n"),
            b'\r' => out.push_str("\\r"),
            0x20..=0x7e => out.push(*b as char),
            _ => out.push_str(&format!("\\x{b:02x}")),
        }
    }
    out
}

/// One record of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Since the log began.
    pub at: Timestamp,
    /// One of the signs above.
    pub sign: char,
    /// The rest of the line as written.
    pub text: String,
}

impl Record {
    /// Reads a line of a log; `None` when it is not one.
    pub fn read(line: &str) -> Option<Record> {
        let (seconds, rest) = line.trim_start().split_once(' ')?;
        let (whole, fraction) = seconds.split_once('.')?;
        let whole: i64 = whole.parse().ok()?;
        let ns: i64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
        let mut chars = rest.chars();
        let sign = chars.next().filter(|c| "><!?=*#".contains(*c))?;
        let text = chars.as_str();
        let text = text.strip_prefix(' ').unwrap_or(text).to_owned();
        Some(Record { at: Timestamp(whole.checked_mul(1_000_000_000)?.checked_add(ns)?), sign, text })
    }

    /// The bytes of a record that holds bytes.
    pub fn bytes(&self) -> Option<Vec<u8>> {
        unescape(&self.text)
    }

    /// What the engine was told, of a `?` or `*` record.
    pub fn input(&self) -> Option<Input> {
        match (self.sign, self.text.split_once(' ').unwrap_or((&self.text, ""))) {
            ('?', _) => serde_json::from_str(&self.text).ok().map(Input::Request),
            ('*', ("", _)) => Some(Input::Wake),
            ('*', ("live", _)) => Some(Input::Live),
            ('*', ("lost", why)) => Some(Input::Lost(String::from_utf8_lossy(&unescape(why)?).into_owned())),
            ('*', ("stop", rest)) => {
                let (kind, written) = rest.split_once(' ')?;
                let kinds = [StopKind::Controlled, StopKind::Homing, StopKind::Emergency];
                let kind = kinds.into_iter().find(|k| stop_word(*k) == kind)?;
                Some(Input::Stop { kind, written: written == "written" })
            }
            _ => None,
        }
    }

    /// Number and word of a `=` record.
    pub fn outcome(&self) -> Option<(Ticket, &str)> {
        let mut words = self.text.split(' ');
        let ticket = words.next()?.parse().ok()?;
        words.next().filter(|_| self.sign == '=').map(|word| (Ticket(ticket), word))
    }
}

fn unescape(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len());
    let mut chars = text.bytes();
    while let Some(b) = chars.next() {
        if b != b'\\' {
            out.push(b);
            continue;
        }
        out.push(match chars.next()? {
            b'n' => b'\n',
            b'r' => b'\r',
            b'\\' => b'\\',
            b'x' => {
                let digits = [chars.next()?, chars.next()?];
                u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?
            }
            _ => return None,
        });
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_byte_and_every_nanosecond_comes_back(
            bytes in proptest::collection::vec(any::<u8>(), 0..80), ns in 0..100_000_000_000_000i64,
        ) {
            let line = format!("{:>5}.{:09} < {}", ns / 1_000_000_000, ns % 1_000_000_000, escape(&bytes));
            let record = Record::read(&line).unwrap();
            prop_assert_eq!(record.bytes().unwrap(), bytes);
            prop_assert_eq!((record.at, record.sign), (Timestamp(ns), '<'));
        }
    }

    #[test]
    fn inputs_and_outcomes_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port.log");
        let mut log = ByteLog::create(&path).unwrap();
        let inputs = [
            Input::Request(Request::Move { targets: vec![(0, 0.1 + 0.2)], feed: 5.0, jog: false }),
            Input::Request(Request::Settle { stall: std::time::Duration::from_millis(3000), expected: None }),
            Input::Request(Request::Run(crate::protocol::Which::Recover("limit".to_owned()))),
            Input::Live,
            Input::Wake,
            Input::Stop { kind: StopKind::Emergency, written: true },
            Input::Lost("reading failed: \u{e9}".to_owned()),
        ];
        for input in &inputs {
            log.input(Timestamp(7), input).unwrap();
        }
        log.outcome(Timestamp(8), Ticket(3), &Err(Failure::Stopped)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let records: Vec<Record> = text.lines().map(|l| Record::read(l).unwrap()).collect();
        let back: Vec<Input> = records.iter().filter_map(Record::input).collect();
        assert_eq!(back, inputs);
        assert_eq!(records.last().unwrap().outcome(), Some((Ticket(3), "stopped")));
    }

    #[test]
    fn a_log_that_was_rotated_often_is_whole_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port.log");
        let header = |continued| Header {
            twinrig_log: LOG_VERSION,
            protocol: "grbl".to_owned(),
            axes: Vec::new(),
            patience: 1.0,
            continued,
        };
        // An older session's log of that name lies there already: it is no part of this one.
        let mut before = ByteLog::create(&path).unwrap();
        before.header(Timestamp(0), header(false)).unwrap();
        before.bytes(Timestamp(0), Direction::Sent, b"of yesterday").unwrap();
        drop(before);
        let sent =
            |text: &str| text.lines().filter(|l| l.contains(" > ")).map(str::to_owned).collect::<Vec<_>>();
        for (writes, lost) in [(10, false), (25, false), (200, true)] {
            let mut log = ByteLog::with_limit(&path, 400).unwrap();
            log.header(Timestamp(0), header(false)).unwrap();
            for i in 0..writes {
                log.bytes(Timestamp(i * 1_000_000), Direction::Sent, format!("$J=G90 X{i}\n").as_bytes())
                    .unwrap();
            }
            drop(log);
            let whole = whole(&path).unwrap();
            assert_eq!(Header::of(&whole).unwrap().continued, lost, "{writes}");
            let found = sent(&whole);
            assert!(found.last().unwrap().ends_with(&format!("X{}\\n", writes - 1)), "{found:?}");
            if lost {
                assert!(found.len() > 30 && found.len() < 200);
            } else {
                assert_eq!(found.len() as i64, writes, "{whole}");
            }
        }
    }

    #[test]
    fn a_log_takes_so_much_of_the_disk_and_no_more() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port.log");
        let mut log = ByteLog::with_limit(&path, 200).unwrap();
        for i in 0..200 {
            log.bytes(Timestamp(i * 1_000_000), Direction::Sent, b"$J=G90 X1\n").unwrap();
        }
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 1 + KEPT_PARTS as usize);
        assert!(std::fs::metadata(&path).unwrap().len() <= 240);
    }
}
