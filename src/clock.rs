//! Time: one clock for everything that waits or stamps.
//!
//! Stamps are nanoseconds of the system's monotonic clock, the one that V4L2 stamps frames with.
//! A virtual bench may run faster than the wall (`--speed`): its clock then gives *bench time*,
//! and every wait on it is shortened by the same factor, so nothing is skipped and every ratio
//! of durations stays. All waiting goes through tokio, so tests run under paused time.

use serde::{Deserialize, Serialize};
use std::time::Duration;
use tokio::time::Instant;

/// An instant of bench time, in nanoseconds of the monotonic clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// This instant moved by `by` into the future.
    pub fn after(self, by: Duration) -> Timestamp {
        Timestamp(self.0.saturating_add(i64::try_from(by.as_nanos()).unwrap_or(i64::MAX)))
    }

    /// This instant moved by `by` into the past.
    pub fn before(self, by: Duration) -> Timestamp {
        Timestamp(self.0.saturating_sub(i64::try_from(by.as_nanos()).unwrap_or(i64::MAX)))
    }

    /// Time from `earlier` to here; zero if `earlier` is later.
    pub fn since(self, earlier: Timestamp) -> Duration {
        Duration::from_nanos(u64::try_from(self.0.saturating_sub(earlier.0)).unwrap_or(0))
    }

    /// Seconds from `earlier` to here, negative if `earlier` is later. For formulas only.
    pub fn seconds_since(self, earlier: Timestamp) -> f64 {
        (self.0 - earlier.0) as f64 * 1e-9
    }
}

/// A clock that may run faster than the wall. Cheap to copy; all copies agree.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    origin: Instant,
    origin_ns: i64,
    speed: f64,
}

impl Clock {
    /// The wall's own pace: what a real bench uses.
    pub fn real_time() -> Self {
        Self::with_speed(1.0)
    }

    /// A clock that runs `speed` times faster than the wall (only a virtual bench may).
    pub fn with_speed(speed: f64) -> Self {
        assert!(speed.is_finite() && speed > 0.0, "clock speed must be positive, got {speed}");
        let ts = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        Self { origin: Instant::now(), origin_ns: ts.tv_sec * 1_000_000_000 + ts.tv_nsec, speed }
    }

    /// How many times faster than the wall this clock runs.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// The present instant of bench time.
    pub fn now(&self) -> Timestamp {
        let wall = Instant::now().saturating_duration_since(self.origin);
        Timestamp(self.origin_ns + (wall.as_nanos() as f64 * self.speed) as i64)
    }

    /// Wall time that `bench` time takes.
    pub fn wall(&self, bench: Duration) -> Duration {
        bench.div_f64(self.speed)
    }

    /// Waits for a span of bench time.
    pub async fn sleep(&self, bench: Duration) {
        tokio::time::sleep(self.wall(bench)).await;
    }

    /// Waits until an instant of bench time.
    pub async fn sleep_until(&self, at: Timestamp) {
        let ns = (at.0 - self.origin_ns).max(0) as f64 / self.speed;
        tokio::time::sleep_until(self.origin + Duration::from_nanos(ns as u64)).await;
    }

    /// Runs `future` for at most `bench` of bench time; `None` when the time is up.
    pub async fn timeout<F: Future>(&self, bench: Duration, future: F) -> Option<F::Output> {
        tokio::time::timeout(self.wall(bench), future).await.ok()
    }
}

/// What the time of a session goes into. The first four cannot be saved; the others are overhead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Motion, as long as its feed and acceleration make it.
    Motion,
    /// The search for references, as long as the device takes for it.
    Homing,
    /// Until vibrations have died.
    Settle,
    /// Frames of which captures and touch-off are made, while somebody waits and the shutter is open.
    Exposure,
    /// From a move's acceptance to the news of its end, beyond the motion.
    EndOfMotion,
    /// From a move to its acceptance.
    Command,
    /// Asking where the axes are.
    Position,
    /// From the wish for a frame to its arrival, beyond the exposure.
    Frame,
}

/// The name under which [`spent`] is traced.
pub const SPENT: &str = "twinrig::spent";

/// Tells where bench time went, for whoever keeps accounts (`twinrig bench session`). Costs nothing otherwise.
pub fn spent(part: Part, time: Duration) {
    let ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
    tracing::trace!(target: SPENT, part = ?part, ns);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_fast_clock_keeps_every_ratio() {
        let clock = Clock::with_speed(10.0);
        let (t0, wall0) = (clock.now(), Instant::now());
        clock.sleep(Duration::from_secs(20)).await;
        assert_eq!(clock.now().since(t0).as_secs(), 20);
        assert_eq!(wall0.elapsed().as_secs(), 2);
    }
}
