//! Resets and alarms: what they stop, clear and say.

use super::report::Cadence;
use super::{Grbl, State, Waiting};
use std::time::Duration;

impl Grbl {
    /// The end of a reset: state as after power-up except settings, counters and the lock.
    pub(super) fn start_up(&mut self) {
        if std::mem::take(&mut self.ok_owed) {
            self.say("ok");
        }
        self.rx.clear();
        self.line.clear();
        (self.overflow, self.comment, self.status_asked) = (false, false, false);
        self.sticky_error = None;
        self.waiting = Waiting::Nothing;
        self.planner.clear();
        self.program.reset();
        self.cadence = Cadence::after_reset(self.spec.hal);
        (self.feed_override, self.rapid_override) = (100, 100);
        self.say("");
        let banner = self.spec.banner.clone();
        self.say(&banner);
        match self.state {
            State::Alarm | State::Sleep => {
                self.state = State::Alarm;
                self.say("[MSG:'$H'|'$X' to unlock]");
            }
            _ => self.state = State::Idle,
        }
    }

    /// Prints an alarm and falls asleep; a critical one wakes up mute, any other one resets.
    pub(super) fn alarm(&mut self, number: u8) {
        self.state = State::Alarm;
        self.planner.clear();
        self.say(&format!("ALARM:{number}"));
        let until = self.t.after(Duration::from_millis(self.spec.alarm_delay_ms));
        self.waiting = Waiting::AlarmSleep { until, critical: number <= 2 };
    }

    pub(super) fn reset(&mut self) {
        match self.waiting {
            // The sleep ends by clearing what came meanwhile, or in the reset it was heading for.
            Waiting::AlarmSleep { .. } => return,
            Waiting::Mute => return self.start_up(),
            _ => {}
        }
        let moving = match self.state {
            State::Run | State::Jog { .. } | State::Home => true,
            State::Hold { rests } => self.t < rests,
            _ => false,
        };
        if moving {
            let homing = self.state == State::Home;
            self.motors.halt(self.t);
            self.alarm(if homing { 6 } else { 3 });
        } else {
            self.start_up();
        }
    }
}
