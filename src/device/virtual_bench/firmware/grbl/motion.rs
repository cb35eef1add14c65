//! Motion: blocks on their way into the planner, soft limits and homing.

use super::super::motors::{Motor, PullOff};
use super::super::planner::Block;
use super::{Grbl, State, Waiting};
use std::time::Duration;

impl Grbl {
    pub(super) fn planned(&self) -> Vec<f64> {
        self.planner.target().map_or_else(|| self.motors.positions(self.t), <[f64]>::to_vec)
    }

    pub(super) fn is_within_travel(&self, target: &[f64]) -> bool {
        let inside = |(m, x): (&Motor, &f64)| *x >= m.min - 1e-6 && *x <= m.max + 1e-6;
        !self.settings.is_on(20) || self.motors.iter().zip(target).all(inside)
    }

    /// A soft limit: decelerate if in motion, then ALARM:2.
    pub(super) fn violate(&mut self) {
        if self.state == State::Run {
            let until = self.planner.hold(&mut self.motors, self.t);
            self.waiting = Waiting::Braking { until };
        } else {
            self.alarm(2);
        }
    }

    pub(super) fn queue(&mut self, target: Vec<f64>, feed: Option<f64>, jog: bool) {
        let (feed, percent) = match feed {
            Some(feed) => (feed, self.feed_override),
            None => (f64::MAX, 100),
        };
        let block = Block { target, feed: feed * if jog { 1.0 } else { f64::from(percent) / 100.0 } };
        if self.planner.free() == 0 {
            self.waiting = Waiting::Room { block, jog };
        } else {
            self.start(block, jog);
        }
    }

    pub(super) fn start(&mut self, block: Block, jog: bool) {
        // A block without length is dropped: nothing moves and the state stays.
        let from = self.planned();
        let length = from.iter().zip(&block.target).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let counts = self.motors.iter().map(|m| m.counts_per_unit).fold(1.0, f64::max);
        if length * counts < 0.5 {
            return;
        }
        self.planner.push(&mut self.motors, self.t, block);
        match (self.state, jog) {
            (State::Idle, true) => self.state = State::Jog { cancelled: None },
            (State::Idle, false) => self.state = State::Run,
            _ => {}
        }
    }

    pub(super) fn sync(&mut self, dwell: Duration) {
        self.waiting = Waiting::Sync(dwell);
    }

    /// All axes seek their switches at `$25` and leave them by `$27` at `$24`.
    pub(super) fn home(&mut self) {
        self.state = State::Home;
        let pull_off = PullOff { distance: self.settings.number(27), feed: self.settings.number(24) / 60.0 };
        let seek = self.settings.number(25) / 60.0;
        let mut until = self.t;
        for i in 0..self.motors.count() {
            until = until.max(self.motors.seek_home(i, self.t, seek, pull_off));
        }
        self.waiting = Waiting::Homing { until };
    }
}
