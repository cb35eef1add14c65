//! The main loop: it reads lines until one blocks it, and goes on once what it waits for has happened.

use super::{Grbl, State, Waiting};
use crate::clock::Timestamp;
use crate::protocol::emulation::SilentState;

impl Grbl {
    /// The main loop: characters into lines, lines into actions, until something blocks.
    fn main_loop(&mut self) {
        while matches!(self.waiting, Waiting::Nothing)
            && self.state != State::Sleep
            && let Some(byte) = self.rx.pop_front()
        {
            match byte {
                b'\n' | b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    self.comment = false;
                    let overflow = std::mem::take(&mut self.overflow);
                    self.execute(&line, overflow);
                }
                b'(' | b';' => self.comment = true,
                b')' => self.comment = false,
                _ if self.comment || byte <= b' ' || byte == b'/' => {}
                _ if self.line.len() >= self.spec.line_chars => self.overflow = true,
                _ => self.line.push(byte.to_ascii_uppercase()),
            }
        }
    }

    /// Lets a blocked line go on where the planner allows it, then reads further lines.
    pub(super) fn go_on(&mut self) {
        loop {
            match self.waiting.clone() {
                Waiting::Room { block, jog } if self.planner.free() > 0 => {
                    self.unblock();
                    self.start(block, jog);
                }
                Waiting::Sync(dwell) if self.planner.is_empty() => {
                    if dwell.is_zero() {
                        self.unblock();
                    } else {
                        self.waiting = Waiting::Dwell { until: self.t.after(dwell) };
                    }
                }
                Waiting::Nothing => {
                    self.main_loop();
                    let stuck = matches!(self.waiting, Waiting::Nothing);
                    if stuck {
                        return;
                    }
                }
                _ => return,
            }
        }
    }

    /// The blocked line is done.
    fn unblock(&mut self) {
        self.waiting = Waiting::Nothing;
        self.ok_owed = false;
        self.answer(Ok(()));
    }

    /// The earliest thing that happens by itself.
    pub(super) fn next_event(&self) -> Option<Timestamp> {
        let waiting = match self.waiting {
            Waiting::Dwell { until }
            | Waiting::Homing { until }
            | Waiting::Braking { until }
            | Waiting::AlarmSleep { until, .. } => Some(until),
            _ => None,
        };
        let jog = if let State::Jog { cancelled } = self.state { cancelled } else { None };
        [waiting, jog, self.planner.ends()].into_iter().flatten().min()
    }

    /// Does what happens at `self.t`.
    pub(super) fn event(&mut self) {
        if self.planner.ends().is_some_and(|t| t <= self.t) {
            self.planner.next(&mut self.motors);
            if self.planner.is_empty() && matches!(self.state, State::Run | State::Jog { .. }) {
                self.state = State::Idle;
            }
        }
        if let State::Jog { cancelled: Some(rests) } = self.state
            && rests <= self.t
        {
            self.state = State::Idle;
        }
        match self.waiting {
            Waiting::Dwell { until } if until <= self.t => self.unblock(),
            Waiting::Homing { until } if until <= self.t => {
                if std::mem::take(&mut self.status_asked) {
                    self.report_status(false);
                }
                (0..self.motors.count()).for_each(|i| self.motors.set_home(i));
                self.state = State::Idle;
                self.unblock();
            }
            Waiting::Braking { until } if until <= self.t => self.alarm(2),
            Waiting::AlarmSleep { until, critical } if until <= self.t => {
                if critical && self.is_silent_in(SilentState::CriticalAlarm) {
                    self.say("[MSG:Reset to continue]");
                    self.waiting = Waiting::Mute;
                } else {
                    self.start_up();
                }
            }
            _ => {}
        }
    }
}
