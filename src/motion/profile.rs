//! Trapezoidal feed profile: how long a move takes, and where it is at an instant.
//!
//! A profile is at most three phases of constant acceleration: speed up, cruise, slow down. A
//! controlled stop is a profile of one phase.

use std::time::Duration;

/// Constant acceleration for a while; velocities and accelerations are signed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Phase {
    position: f64,
    velocity: f64,
    accel: f64,
    lasts_s: f64,
}

impl Phase {
    fn position_at(&self, t: f64) -> f64 {
        self.position + t * (self.velocity + 0.5 * self.accel * t)
    }
}

/// A straight move along one coordinate with constant acceleration, cruise, constant deceleration.
/// Short moves never reach the feed (triangular profile).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    phases: [Phase; 3],
    to: f64,
    /// Magnitude of the acceleration: what a stop decelerates with.
    accel: f64,
}

impl Profile {
    /// A move from `from` to `to` at `feed` (units/s) with `accel` (units/s^2), both positive.
    pub fn new(from: f64, to: f64, feed: f64, accel: f64) -> Self {
        let distance = (to - from).abs();
        if distance == 0.0 {
            return Self::at_rest(to);
        }
        let sign = (to - from).signum();
        let ramp_distance = feed * feed / accel;
        let (peak, cruise_s) = if distance < ramp_distance {
            ((distance * accel).sqrt(), 0.0)
        } else {
            (feed, (distance - ramp_distance) / feed)
        };
        let ramp_s = peak / accel;
        let up = Phase { position: from, velocity: 0.0, accel: sign * accel, lasts_s: ramp_s };
        let cruise =
            Phase { position: up.position_at(ramp_s), velocity: sign * peak, accel: 0.0, lasts_s: cruise_s };
        let down = Phase {
            position: cruise.position_at(cruise_s),
            velocity: sign * peak,
            accel: -sign * accel,
            lasts_s: ramp_s,
        };
        Self { phases: [up, cruise, down], to, accel }
    }

    /// A profile that stays where it is.
    pub fn at_rest(at: f64) -> Self {
        let still = Phase { position: at, ..Phase::default() };
        Self { phases: [still; 3], to: at, accel: 1.0 }
    }

    /// Where the move ends.
    pub fn target(&self) -> f64 {
        self.to
    }

    /// The same motion displaced by `by`.
    pub fn shifted(mut self, by: f64) -> Self {
        for phase in &mut self.phases {
            phase.position += by;
        }
        self.to += by;
        self
    }

    /// How long the move takes.
    pub fn duration(&self) -> Duration {
        Duration::from_secs_f64(self.total_s())
    }

    fn total_s(&self) -> f64 {
        self.phases.iter().map(|p| p.lasts_s).sum()
    }

    /// The phase that is active after `elapsed_s`, and the time spent in it; `None` at rest.
    fn phase_at(&self, elapsed_s: f64) -> Option<(&Phase, f64)> {
        let mut t = elapsed_s.max(0.0);
        for phase in &self.phases {
            if t < phase.lasts_s {
                return Some((phase, t));
            }
            t -= phase.lasts_s;
        }
        None
    }

    /// Position after `elapsed_s` seconds.
    pub fn position_at(&self, elapsed_s: f64) -> f64 {
        self.phase_at(elapsed_s).map_or(self.to, |(phase, t)| phase.position_at(t))
    }

    /// Signed velocity after `elapsed_s` seconds, units/s.
    pub fn velocity_at(&self, elapsed_s: f64) -> f64 {
        if elapsed_s < 0.0 {
            return 0.0;
        }
        self.phase_at(elapsed_s).map_or(0.0, |(phase, t)| phase.velocity + phase.accel * t)
    }

    /// The profile of a controlled stop that begins `elapsed_s` seconds into this move: it starts
    /// with the velocity the move has then, and decelerates at the move's own rate.
    pub fn stop_at(&self, elapsed_s: f64) -> Profile {
        let (at, v) = (self.position_at(elapsed_s), self.velocity_at(elapsed_s));
        if v == 0.0 {
            return Self::at_rest(at);
        }
        let run_out = 0.5 * v * v.abs() / self.accel;
        let down = Phase {
            position: at,
            velocity: v,
            accel: -self.accel.copysign(v),
            lasts_s: v.abs() / self.accel,
        };
        let rest = Phase { position: at + run_out, ..Phase::default() };
        Self { phases: [down, rest, rest], to: at + run_out, accel: self.accel }
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

    #[test]
    fn a_stop_from_cruise_runs_out_by_v_squared_over_two_a() {
        let stop = Profile::new(0.0, -10.0, 2.0, 4.0).stop_at(2.75);
        assert!((stop.target() - -5.5).abs() < 1e-9);
        assert!((stop.duration().as_secs_f64() - 0.5).abs() < 1e-9);
        assert!((stop.velocity_at(0.25) - -1.0).abs() < 1e-9);
        assert!((stop.position_at(0.25) - -5.375).abs() < 1e-9);
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

        #[test]
        fn a_stop_continues_the_motion_and_never_passes_the_target(
            to in -50.0..50.0f64, feed in 0.1..20.0f64, accel in 1.0..500.0f64, s in 0.0..1.0f64,
        ) {
            let p = Profile::new(0.0, to, feed, accel);
            let t = s * p.duration().as_secs_f64();
            let stop = p.stop_at(t);
            prop_assert!((stop.position_at(0.0) - p.position_at(t)).abs() < 1e-9);
            prop_assert!((stop.velocity_at(0.0) - p.velocity_at(t)).abs() < 1e-9);
            prop_assert!(stop.target().abs() <= to.abs() + 1e-6);
        }
    }
}
