//! The camera's own thread: takes every buffer the driver fills and passes it on.
//!
//! It never waits inside the `v4l` crate: that crate's `next()` queues the last buffer again before it waits,
//! and after a timeout it would queue it twice and fail for ever. So the thread polls, and calls
//! `next()` only when a buffer is there. After a restart all buffers are with the driver, and the first one
//! filled must be given up to get back in step.
//!
//! Buffers flagged ERROR are discarded and counted as dropped, gaps in the sequence too. A streaming error or
//! silence restarts the stream; if that does not help, or the device is gone, the queue learns why.

use super::super::formats::PixelFormat;
use super::super::queue::{FrameQueue, RawFrame};
use super::stamp::StampRule;
use crate::clock::Timestamp;
use crate::frame::FrameStamp;
use ::v4l::buffer::{Flags, Metadata};
use ::v4l::io::traits::{CaptureStream, Stream};
use ::v4l::prelude::MmapStream;
use rustix::event::PollFlags;
use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Buffers shared with the driver.
pub const BUFFERS: u32 = 4;
/// The thread looks up this often whether it is to stop.
const LOOK_UP_MS: i32 = 50;
/// Restarts without a frame in between before the camera counts as lost.
const RESTARTS: u32 = 3;
/// `errno` of a device that is gone.
const ENODEV: i32 = 19;

/// What the thread must know about the mode.
#[derive(Debug, Clone)]
pub struct Mode {
    /// Pixel format.
    pub format: PixelFormat,
    /// Its name.
    pub fourcc: String,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bytes a row.
    pub stride: u32,
    /// When a buffer was exposed.
    pub rule: StampRule,
    /// Exposure time, if known.
    pub exposure: Option<Duration>,
    /// Silence that calls for a restart.
    pub stall: Duration,
}

/// The running thread; dropping it stops the stream and waits for the thread.
pub struct Pump {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Pump {
    /// Starts streaming into `queue`.
    pub fn start(stream: MmapStream<'static>, mode: Mode, queue: FrameQueue) -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&stop);
        let run = move || Run::new(stream, mode, queue, told).run();
        let thread = std::thread::Builder::new().name("camera".into()).spawn(run)?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for Pump {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the camera's thread panicked");
        }
    }
}

/// Whether the driver has our buffers.
#[derive(PartialEq)]
enum Phase {
    /// Not streaming.
    Stopped,
    /// Streaming, every buffer with the driver.
    OutOfStep,
    /// Streaming, the last buffer taken is still ours.
    InStep,
}

struct Run {
    stream: MmapStream<'static>,
    mode: Mode,
    queue: FrameQueue,
    stop: Arc<AtomicBool>,
    phase: Phase,
    /// When the buffers now with the driver were given to it, oldest first: they come back in this order.
    queued: VecDeque<Timestamp>,
    last: Option<Last>,
    dropped: u32,
    heard: Instant,
    restarts: u32,
}

/// The last buffer seen, good or bad.
#[derive(Clone, Copy)]
struct Last {
    sequence: u32,
    arrived: Timestamp,
    /// The stream was restarted since, and its numbers began anew.
    restarted: bool,
}

impl Run {
    fn new(mut stream: MmapStream<'static>, mode: Mode, queue: FrameQueue, stop: Arc<AtomicBool>) -> Self {
        stream.set_timeout(Duration::ZERO);
        let (queued, heard) = (VecDeque::new(), Instant::now());
        let (phase, last) = (Phase::Stopped, None);
        Self { stream, mode, queue, stop, phase, queued, last, dropped: 0, heard, restarts: 0 }
    }

    fn run(mut self) {
        while !self.stop.load(Ordering::Relaxed) {
            let Err(error) = self.turn() else { continue };
            match error.raw_os_error() {
                Some(ENODEV) => {
                    self.queue.lose(error.to_string());
                    break;
                }
                _ if error.kind() == io::ErrorKind::Interrupted => {}
                _ if self.restarts >= RESTARTS => {
                    self.queue.lose(format!("{error} (after {RESTARTS} restarts)"));
                    break;
                }
                _ => self.restart(&error),
            }
        }
        self.finish();
    }

    /// One look at the device.
    fn turn(&mut self) -> io::Result<()> {
        if self.phase == Phase::Stopped {
            self.queued = std::iter::repeat_n(now(), BUFFERS as usize).collect();
            self.heard = Instant::now();
            return self.take();
        }
        if self.stream.handle().poll(PollFlags::IN.bits() as i16, LOOK_UP_MS)? == 0 {
            if self.heard.elapsed() > self.mode.stall {
                return Err(io::Error::new(io::ErrorKind::TimedOut, "no frame"));
            }
            return Ok(());
        }
        if self.phase == Phase::OutOfStep {
            match CaptureStream::dequeue(&mut self.stream) {
                Ok(_) => {
                    self.queued.pop_front();
                    self.phase = Phase::InStep;
                    self.heard = Instant::now();
                    return Ok(());
                }
                Err(e) if is_nothing_yet(&e) => return Ok(()),
                Err(e) => return Err(e),
            }
        }
        self.take()
    }

    /// Gives the last buffer back and takes the next one.
    fn take(&mut self) -> io::Result<()> {
        if self.phase == Phase::InStep {
            self.queued.push_back(now());
        }
        // Whatever happens in `next`, it has given all buffers to the driver first.
        self.phase = Phase::OutOfStep;
        let (bytes, meta) = match CaptureStream::next(&mut self.stream) {
            Ok(taken) => taken,
            Err(e) if is_nothing_yet(&e) => return Ok(()),
            Err(e) => return Err(e),
        };
        let arrived = now();
        self.phase = Phase::InStep;
        self.heard = Instant::now();
        self.restarts = 0;
        let queued = self.queued.pop_front().unwrap_or(arrived);
        let (meta, used) = (*meta, (meta.bytesused as usize).min(bytes.len()));
        let bytes = bytes[..used].to_vec();
        self.pass_on(bytes, &meta, arrived, queued);
        Ok(())
    }

    fn pass_on(&mut self, bytes: Vec<u8>, meta: &Metadata, arrived: Timestamp, queued: Timestamp) {
        if let Some(last) = self.last {
            self.dropped += gap(last, meta.sequence, arrived, self.mode.rule.period);
        }
        self.last = Some(Last { sequence: meta.sequence, arrived, restarted: false });
        if meta.flags.contains(Flags::ERROR) {
            tracing::debug!(sequence = meta.sequence, "frame flagged as damaged: discarded");
            self.dropped += 1;
            return;
        }
        let stamp = Timestamp(meta.timestamp.sec * 1_000_000_000 + meta.timestamp.usec * 1_000);
        let mode = &self.mode;
        self.queue.push(RawFrame {
            format: mode.format,
            width: mode.width,
            height: mode.height,
            stride: mode.stride,
            bytes,
            stamp: FrameStamp {
                exposed_at: mode.rule.exposed_at(stamp, meta.flags, arrived, queued),
                exposure: mode.exposure,
                sequence: meta.sequence,
                dropped_before: std::mem::take(&mut self.dropped),
                flags: meta.flags.bits(),
                fourcc: mode.fourcc.clone(),
                averaged: 1,
            },
        });
    }

    fn restart(&mut self, error: &io::Error) {
        self.restarts += 1;
        tracing::warn!(%error, attempt = self.restarts, "camera stream failed: restarting it");
        if let Err(e) = self.stream.stop() {
            tracing::debug!(error = %e, "stopping the failed stream");
        }
        self.phase = Phase::Stopped;
        if let Some(last) = &mut self.last {
            last.restarted = true;
        }
    }

    /// Stops before dropping: the stream's own drop panics on any error but a missing device.
    fn finish(mut self) {
        if let Err(error) = self.stream.stop()
            && error.raw_os_error() != Some(ENODEV)
        {
            tracing::warn!(%error, "the camera does not stop; its buffers stay mapped until exit");
            std::mem::forget(self.stream);
        }
    }
}

/// Frames lost between two buffers; after a restart, as many as the time between them had room for.
fn gap(last: Last, sequence: u32, arrived: Timestamp, period: Duration) -> u32 {
    if last.restarted {
        let periods = arrived.since(last.arrived).as_secs_f64() / period.as_secs_f64();
        return (periods.round() as u32).saturating_sub(1);
    }
    sequence.wrapping_sub(last.sequence).wrapping_sub(1)
}

fn is_nothing_yet(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock)
}

fn now() -> Timestamp {
    let ts = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    Timestamp(ts.tv_sec * 1_000_000_000 + ts.tv_nsec)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_drops_also_over_the_wrap_and_after_a_restart() {
        let period = Duration::from_millis(40);
        let last = Last { sequence: 7, arrived: Timestamp(0), restarted: false };
        assert_eq!(gap(last, 8, Timestamp(0), period), 0);
        assert_eq!(gap(last, 11, Timestamp(0), period), 3);
        assert_eq!(gap(Last { sequence: u32::MAX, ..last }, 1, Timestamp(0), period), 1);
        let restarted = Last { restarted: true, ..last };
        assert_eq!(gap(restarted, 0, Timestamp(400_000_000), period), 9);
        assert_eq!(gap(restarted, 0, Timestamp(0), period), 0);
    }
}
