//! Real-time bytes: those that mean something at once, whatever the main loop is at.

use super::{Grbl, State, Waiting};
use crate::protocol::emulation::SilentState;

impl Grbl {
    pub(super) fn realtime(&mut self, byte: u8) -> bool {
        let mute = matches!(self.waiting, Waiting::Mute);
        match byte {
            0x18 => self.reset(),
            _ if mute && (byte >= 0x80 || b"?!~".contains(&byte)) => {}
            b'?' => self.ask_status(false),
            b'!' => self.hold(),
            b'~' => self.resume(),
            0x80 if self.spec.hal => self.ask_status(false),
            0x87 if self.spec.hal => self.ask_status(true),
            0x81 if self.spec.hal => self.resume(),
            0x82 if self.spec.hal => self.hold(),
            0x19 if self.spec.hal => self.stop_hal(),
            0x85 => {
                if let State::Jog { cancelled: None } = self.state {
                    self.cancel_jog();
                }
            }
            0x90..=0x97 => self.override_feed(byte),
            0x80.. => {}
            _ => return false,
        }
        true
    }

    fn ask_status(&mut self, full: bool) {
        match self.waiting {
            Waiting::AlarmSleep { .. } => {}
            Waiting::Homing { .. } if self.is_silent_in(SilentState::Homing) => self.status_asked = true,
            _ => self.report_status(full),
        }
    }

    fn hold(&mut self) {
        match self.state {
            State::Run => {
                let rests = self.planner.hold(&mut self.motors, self.t);
                self.state = State::Hold { rests };
            }
            State::Jog { cancelled: None } => self.cancel_jog(),
            _ => {}
        }
    }

    fn cancel_jog(&mut self) {
        let rests = self.planner.hold(&mut self.motors, self.t);
        self.planner.clear();
        self.state = State::Jog { cancelled: Some(rests) };
    }

    fn resume(&mut self) {
        // A resume that comes before the hold is complete is forgotten.
        if let State::Hold { rests } = self.state
            && self.t >= rests
        {
            self.state = State::Run;
            self.planner.resume(&mut self.motors, self.t);
        }
    }

    /// grblHAL's stop byte: decelerate, drop the queue, no alarm.
    fn stop_hal(&mut self) {
        if matches!(self.state, State::Run | State::Jog { .. } | State::Hold { .. }) {
            self.say("[MSG:Stop]");
            self.cancel_jog();
        }
    }

    fn override_feed(&mut self, byte: u8) {
        let feed = i64::from(self.feed_override);
        match byte {
            0x95 => self.rapid_override = 100,
            0x96 => self.rapid_override = 50,
            0x97 => self.rapid_override = 25,
            _ => {
                let wanted = match byte {
                    0x90 => 100,
                    0x91 => feed + 10,
                    0x92 => feed - 10,
                    0x93 => feed + 1,
                    _ => feed - 1,
                };
                self.feed_override = wanted.clamp(10, 200) as u32;
            }
        }
        self.cadence.overrides_changed();
    }
}
