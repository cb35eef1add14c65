//! Bytes on their way out, each reply with the instant at which its last byte has been sent.

use crate::clock::Timestamp;
use std::collections::VecDeque;
use std::time::Duration;

/// Replies in order. A reply leaves after the firmware's latency and takes its time on the wire.
#[derive(Debug)]
pub struct Outbox {
    queue: VecDeque<(Timestamp, Vec<u8>)>,
    latency: Duration,
    byte_time: Duration,
    free_at: Timestamp,
}

impl Outbox {
    /// An empty outbox of a firmware with that latency on a wire with that baud rate.
    pub fn new(latency: Duration, baud: u32) -> Self {
        // Start bit, eight data bits, stop bit.
        let byte_time = Duration::from_secs_f64(10.0 / f64::from(baud.max(1)));
        Self { queue: VecDeque::new(), latency, byte_time, free_at: Timestamp(i64::MIN) }
    }

    /// Sends one reply (a line, a frame) that the firmware makes at `now`.
    pub fn send(&mut self, now: Timestamp, reply: impl Into<Vec<u8>>) {
        let reply = reply.into();
        let wire = self.byte_time * u32::try_from(reply.len()).unwrap_or(u32::MAX);
        self.free_at = now.after(self.latency).max(self.free_at).after(wire);
        self.queue.push_back((self.free_at, reply));
    }

    /// The replies that have been sent by `now`.
    pub fn due(&mut self, now: Timestamp) -> Vec<Vec<u8>> {
        let mut out = Vec::new();
        while self.queue.front().is_some_and(|(at, _)| *at <= now) {
            out.extend(self.queue.pop_front().map(|(_, reply)| reply));
        }
        out
    }

    /// When the next reply will have been sent.
    pub fn next(&self) -> Option<Timestamp> {
        self.queue.front().map(|(at, _)| *at)
    }

    /// Forgets what has not been sent: the power is off.
    pub fn clear(&mut self) {
        self.queue.clear();
    }
}
