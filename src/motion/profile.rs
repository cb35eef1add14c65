//! Trapezoidal feed profile: how long a move takes, and where it is at an instant.

use std::time::Duration;

/// A straight move along one coordinate with constant acceleration, cruise, constant deceleration.
/// Short moves never reach the feed (triangular profile).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    from: f64,
    to: f64,
    accel: f64,
    peak: f64,
    ramp_s: f64,
    cruise_s: f64,
}

impl Profile {
    /// A move from `from` to `to` at `feed` (units/s) with `accel` (units/s^2), both positive.
    pub fn new(from: f64, to: f64, feed: f64, accel: f64) -> Self {
        let distance = (to - from).abs();
        let ramp_distance = feed * feed / accel;
        let (peak, cruise) = if distance < ramp_distance {
            ((distance * accel).sqrt(), 0.0)
        } else {
            (feed, (distance - ramp_distance) / feed)
        };
        Self { from, to, accel, peak, ramp_s: peak / accel, cruise_s: cruise }
    }

    /// A profile that stays where it is.
    pub fn at_rest(at: f64) -> Self {
        Self { from: at, to: at, accel: 1.0, peak: 0.0, ramp_s: 0.0, cruise_s: 0.0 }
    }

    /// Where the move ends.
    pub fn target(&self) -> f64 {
        self.to
    }

    /// How long the move takes.
    pub fn duration(&self) -> Duration {
        Duration::from_secs_f64(2.0 * self.ramp_s + self.cruise_s)
    }

    /// Position after `elapsed_s` seconds.
    pub fn position_at(&self, elapsed_s: f64) -> f64 {
        let total = 2.0 * self.ramp_s + self.cruise_s;
        if elapsed_s >= total {
            return self.to;
        }
        let t = elapsed_s.max(0.0);
        let travelled = if t < self.ramp_s {
            0.5 * self.accel * t * t
        } else if t < self.ramp_s + self.cruise_s {
            self.peak * (t - 0.5 * self.ramp_s)
        } else {
            let left = total - t;
            (self.to - self.from).abs() - 0.5 * self.accel * left * left
        };
        self.from + travelled.copysign(self.to - self.from)
    }

    /// Signed velocity after `elapsed_s` seconds, units/s.
    pub fn velocity_at(&self, elapsed_s: f64) -> f64 {
        let total = 2.0 * self.ramp_s + self.cruise_s;
        if elapsed_s < 0.0 || elapsed_s >= total {
            return 0.0;
        }
        let speed = (self.accel * elapsed_s).min(self.peak).min(self.accel * (total - elapsed_s));
        speed.copysign(self.to - self.from)
    }

    /// The profile of a controlled stop that begins `elapsed_s` seconds into this move.
    pub fn stop_at(&self, elapsed_s: f64) -> Profile {
        let (at, v) = (self.position_at(elapsed_s), self.velocity_at(elapsed_s));
        let run_out = 0.5 * v * v.abs() / self.accel;
        // A deceleration from |v| to rest is the second half of a move that peaks at |v|.
        Profile {
            from: at,
            to: at + run_out,
            accel: self.accel,
            peak: v.abs(),
            ramp_s: v.abs() / self.accel,
            cruise_s: 0.0,
        }
        .second_half()
    }

    fn second_half(self) -> Profile {
        // Approximated by the same run-out distance covered from rest: exact in distance and end point.
        Profile::new(self.from, self.to, self.peak.max(1e-9), self.accel.max(1e-9))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_long_move_takes_distance_over_feed_plus_one_ramp() {
        let p = Profile::new(0.0, 10.0, 2.0, 4.0);
        assert!((p.duration().as_secs_f64() - 5.5).abs() < 1e-9);
        assert!((p.position_at(2.75) - 5.0).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn position_is_continuous_and_never_overshoots(
            from in -50.0..50.0f64, to in -50.0..50.0f64, feed in 0.1..20.0f64, accel in 1.0..500.0f64, s in 0.0..1.0f64,
        ) {
            let p = Profile::new(from, to, feed, accel);
            let total = p.duration().as_secs_f64();
            let x = p.position_at(s * total);
            prop_assert!(x >= from.min(to) - 1e-6 && x <= from.max(to) + 1e-6);
            let dt = 1e-6;
            prop_assert!((p.position_at(s * total + dt) - x).abs() <= feed * dt * 1.01 + 1e-9);
        }
    }
}
