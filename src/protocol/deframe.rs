//! Bytes to units: whole lines or whole frames, however the reads were split or merged.
//!
//! What arrives is bytes, not text: boot noise, half lines and two replies in one read are normal.
//! A frame protocol finds its place again by the sync bytes, the length and the checksum; a frame
//! that pauses inside is given up after a time.

use super::encode::{take, unstuff};
use super::spec::*;
use super::value::{Fields, Value};
use crate::clock::Timestamp;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// One thing the device sent.
#[derive(Debug, Clone, PartialEq)]
pub enum Unit {
    /// A line without its end and without its (correct) checksum.
    Line(Vec<u8>),
    /// A frame, its header fields and its payload.
    Frame {
        /// Header fields by name.
        header: Fields,
        /// The payload, inserted bytes taken out.
        payload: Vec<u8>,
    },
    /// Bytes that were dropped: a wrong checksum, or nothing that could be a frame.
    Garbled(Vec<u8>),
}

/// Longest line that is believed; beyond it the bytes are noise.
const MAX_LINE: usize = 4096;

/// Cuts the stream of received bytes into units.
#[derive(Debug)]
pub struct Deframer {
    spec: Arc<Spec>,
    buffer: VecDeque<u8>,
    last_byte: Option<Timestamp>,
}

impl Deframer {
    /// A deframer at the beginning of a stream.
    pub fn new(spec: Arc<Spec>) -> Self {
        Self { spec, buffer: VecDeque::new(), last_byte: None }
    }

    /// Forgets a unit that has begun.
    pub fn clear(&mut self) {
        self.buffer.clear();
    }

    /// Takes received bytes, gives the units they complete.
    pub fn push(&mut self, bytes: &[u8], now: Timestamp) -> Vec<Unit> {
        let spec = self.spec.clone();
        let mut units = Vec::new();
        if let (Some(frame), Some(last)) = (&spec.frame, self.last_byte)
            && !self.buffer.is_empty()
            && now.since(last) > Duration::from_millis(frame.inter_byte_timeout_ms)
        {
            units.push(Unit::Garbled(self.buffer.drain(..).collect()));
        }
        self.last_byte = Some(now);
        self.buffer.extend(bytes);
        match (&spec.line, &spec.frame) {
            (Some(line), _) => self.lines(line, &mut units),
            (None, Some(frame)) => self.frames(frame, &mut units),
            (None, None) => self.buffer.clear(),
        }
        units
    }

    fn lines(&mut self, line: &LineSpec, units: &mut Vec<Unit>) {
        let eol = &line.rx_eol.0;
        let last = eol.last().copied().unwrap_or(b'\n');
        while let Some(end) = self.buffer.iter().position(|b| *b == last) {
            let mut text: Vec<u8> = self.buffer.drain(..=end).collect();
            text.pop();
            while text.last().is_some_and(|b| *b == b'\r' || eol.contains(b)) {
                text.pop();
            }
            while text.first().is_some_and(|b| *b == b'\r' || *b == b'\n') {
                text.remove(0);
            }
            if !text.is_empty() {
                units.push(check_line(line, text));
            }
        }
        if self.buffer.len() > MAX_LINE {
            units.push(Unit::Garbled(self.buffer.drain(..).collect()));
        }
    }

    fn frames(&mut self, frame: &FrameSpec, units: &mut Vec<Unit>) {
        let mut dropped = Vec::new();
        loop {
            let bytes = self.buffer.make_contiguous();
            match read_frame(&self.spec, frame, bytes) {
                Read::Incomplete => break,
                Read::Whole { length, header, payload } => {
                    flush(&mut dropped, units);
                    self.buffer.drain(..length);
                    units.push(Unit::Frame { header, payload });
                }
                // Not the beginning of a frame: look one byte further on.
                Read::Wrong => dropped.extend(self.buffer.pop_front()),
            }
        }
        flush(&mut dropped, units);
    }
}

fn flush(dropped: &mut Vec<u8>, units: &mut Vec<Unit>) {
    if !dropped.is_empty() {
        units.push(Unit::Garbled(std::mem::take(dropped)));
    }
}

fn check_line(line: &LineSpec, mut text: Vec<u8>) -> Unit {
    let Some(sum) = line.checksum.as_ref().filter(|s| s.rx == ChecksumRx::VerifyIfPresent) else {
        return Unit::Line(text);
    };
    let Some(at) = text.iter().rposition(|b| *b == sum.separator as u8) else { return Unit::Line(text) };
    let digits = std::str::from_utf8(&text[at + 1..]).unwrap_or("");
    let value = match sum.digits {
        ChecksumDigits::HexUpper if digits.len() == 2 => u16::from_str_radix(digits, 16).ok(),
        ChecksumDigits::HexUpper => None,
        ChecksumDigits::Decimal => digits.parse().ok(),
    };
    let Some(value) = value else { return Unit::Line(text) };
    if sum.kind.of(text[..at].get(sum.skip..).unwrap_or_default()) != value {
        return Unit::Garbled(text);
    }
    text.truncate(at);
    Unit::Line(text)
}

enum Read {
    Incomplete,
    Wrong,
    Whole { length: usize, header: Fields, payload: Vec<u8> },
}

fn read_frame(spec: &Spec, frame: &FrameSpec, bytes: &[u8]) -> Read {
    let sync = &frame.sync.0;
    let common = sync.len().min(bytes.len());
    if bytes[..common] != sync[..common] {
        return Read::Wrong;
    }
    let header_len: usize = frame.header.iter().map(|f| f.kind.width()).sum();
    let payload_at = sync.len() + header_len;
    if bytes.is_empty() || bytes.len() < payload_at {
        return Read::Incomplete;
    }
    let mut header = Fields::new();
    let mut starts = std::collections::BTreeMap::new();
    let mut at = sync.len();
    for field in &frame.header {
        let width = field.kind.width();
        starts.insert(field.name.as_str(), at);
        header.insert(field.name.clone(), take(&bytes[at..at + width], field.kind, frame.endian));
        at += width;
    }
    let number = |name: &str| header.get(name).and_then(Value::as_i64).unwrap_or(0);
    let carries = match &frame.length.only_when {
        Some(test) => number(&test.field) as u64 & test.mask != 0,
        None => true,
    };
    let payload_len = if carries { number(&frame.length.field) - frame.length.extra as i64 } else { 0 };
    let believable = usize::try_from(payload_len).ok().filter(|n| *n <= frame.max_payload);
    let Some(payload_len) = believable else { return Read::Wrong };
    // Without sync bytes only known headers tell a frame from noise.
    if sync.is_empty() && !spec.rx.iter().any(|rx| rx.when.iter().all(|(k, v)| number(k) == *v)) {
        return Read::Wrong;
    }
    let sum_len = frame.checksum.as_ref().map_or(0, |c| c.kind.width());
    let length = payload_at + payload_len + sum_len;
    if bytes.len() < length {
        return Read::Incomplete;
    }
    if let Some(sum) = &frame.checksum {
        let from = sum.from.as_ref().and_then(|name| starts.get(name.as_str())).copied().unwrap_or(0);
        let mut expected = Vec::new();
        let value = sum.kind.of(&bytes[from..length - sum_len]);
        super::encode::put_sum(&mut expected, sum.kind, value, frame.endian);
        if bytes[length - sum_len..length] != expected[..] {
            return Read::Wrong;
        }
    }
    let mut payload = bytes[payload_at..length - sum_len].to_vec();
    if let Some(stuffing) = &frame.stuffing {
        payload = unstuff(&payload, stuffing);
    }
    if let Some(test) = &frame.length.only_when
        && carries
        && let Some(Value::Int(flags)) = header.get_mut(&test.field)
    {
        *flags &= !(test.mask as i64);
    }
    Read::Whole { length, header, payload }
}
