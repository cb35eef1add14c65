//! Lines and their answers: G-code, jogs and what begins with `$`.

use super::program::{Action, code};
use super::{Grbl, State, Waiting, report};
use std::time::Duration;

impl Grbl {
    pub(super) fn execute(&mut self, line: &[u8], overflow: bool) {
        let is_gcode = line.first().is_some_and(|b| *b != b'$');
        if let (true, Some(number), true) = (self.spec.hal, self.sticky_error, is_gcode) {
            return self.answer(Err(number));
        }
        let result = if overflow {
            Err(code::OVERFLOW)
        } else if line.is_empty() {
            Ok(())
        } else if let Some(statement) = line.strip_prefix(b"$") {
            self.statement(statement)
        } else if matches!(self.state, State::Alarm | State::Jog { .. }) {
            Err(code::LOCKED)
        } else {
            self.gcode(line)
        };
        if self.spec.hal {
            self.sticky_error = if is_gcode || result.is_err() { result.err() } else { None };
        }
        match (&self.waiting, result) {
            (Waiting::Nothing, result) => self.answer(result),
            (_, _) => self.ok_owed = true,
        }
    }

    pub(super) fn answer(&mut self, result: Result<(), u8>) {
        match result {
            Ok(()) => self.say("ok"),
            Err(number) => self.say(&format!("error:{number}")),
        }
    }

    fn gcode(&mut self, line: &[u8]) -> Result<(), u8> {
        let at = self.planned();
        match self.program.execute(line, &at)? {
            Action::Nothing => {}
            Action::Offsets => self.cadence.offset_changed(),
            Action::Move { target, feed } => {
                if !self.is_within_travel(&target) {
                    self.violate();
                } else if self.state != State::Check {
                    self.queue(target, feed, false);
                }
            }
            Action::Dwell(_) | Action::Sync if self.state == State::Check => {}
            Action::Dwell(seconds) => self.sync(Duration::from_secs_f64(seconds.min(1e6))),
            Action::Sync => self.sync(Duration::ZERO),
        }
        Ok(())
    }

    /// Executes a line that begins with `$`, given what follows.
    fn statement(&mut self, line: &[u8]) -> Result<(), u8> {
        if let Some(words) = line.strip_prefix(b"J=") {
            return self.jog(words);
        }
        let calm = matches!(self.state, State::Idle | State::Alarm);
        match line {
            b"" => self.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"),
            b"G" => {
                let state = self.program.parser_state(&self.spec.parser_state);
                self.say(&state);
            }
            b"X" => {
                if self.state == State::Alarm {
                    self.say("[MSG:Caution: Unlocked]");
                    self.state = State::Idle;
                }
            }
            b"C" if self.state == State::Check => {
                self.say("[MSG:Disabled]");
                self.answer(Ok(()));
                self.state = State::Idle;
                self.start_up();
            }
            b"C" if self.state == State::Idle => {
                self.say("[MSG:Enabled]");
                self.state = State::Check;
            }
            b"H" if !self.settings.is_on(22) => return Err(code::HOMING_OFF),
            b"$" | b"#" | b"I" | b"N" | b"H" | b"SLP" if !calm => return Err(code::NOT_IDLE),
            b"$" => {
                let lines: Vec<String> = self.settings.iter().map(|(k, v)| format!("${k}={v}")).collect();
                lines.iter().for_each(|l| self.say(l));
            }
            b"#" => {
                let hal = self.spec.hal;
                let systems = &self.spec.coordinate_systems;
                let lines = report::parameters(&self.program, systems, &self.motors, hal);
                lines.iter().for_each(|l| self.say(l));
            }
            b"I" => self.spec.identify.clone().iter().for_each(|l| self.say(l)),
            b"EA" | b"EE" if self.spec.hal => {
                let (name, texts) = match line {
                    b"EA" => ("ALARMCODE", self.spec.alarm_texts.clone()),
                    _ => ("ERRORCODE", self.spec.error_texts.clone()),
                };
                for (number, text) in texts.iter().filter_map(|t| t.split_once('=')) {
                    self.say(&format!("[{name}:{number}||{text}]"));
                }
            }
            b"N" => ["$N0=", "$N1="].iter().for_each(|l| self.say(l)),
            b"H" => self.home(),
            b"SLP" => {
                self.say("[MSG:Sleeping]");
                self.state = State::Sleep;
            }
            _ if !calm => return Err(code::NOT_IDLE),
            _ => return self.store(line),
        }
        Ok(())
    }

    /// `$<number>=<value>`.
    fn store(&mut self, line: &[u8]) -> Result<(), u8> {
        let text = String::from_utf8_lossy(line);
        let (key, value) = text.split_once('=').ok_or(code::STATEMENT)?;
        let key: u16 = key.parse().map_err(|_| if self.spec.hal { code::STATEMENT } else { code::NUMBER })?;
        let value: f64 = value.parse().map_err(|_| code::NUMBER)?;
        if value < 0.0 {
            return Err(code::NEGATIVE);
        }
        if key == 20 && value != 0.0 && !self.settings.is_on(22) {
            return Err(code::SOFT_LIMITS);
        }
        if !self.settings.set(key, value) {
            return Err(if self.spec.hal { code::HAL_SETTING } else { code::STATEMENT });
        }
        if key == 22 && value == 0.0 {
            self.settings.set(20, 0.0);
        }
        self.apply_settings();
        Ok(())
    }

    fn jog(&mut self, words: &[u8]) -> Result<(), u8> {
        if !matches!(self.state, State::Idle | State::Jog { .. }) {
            return Err(code::NOT_IDLE);
        }
        let Action::Move { target, feed } = self.program.jog(words, &self.planned())? else {
            return Ok(());
        };
        if !self.is_within_travel(&target) {
            return Err(code::TRAVEL);
        }
        // A jog that arrives while one is being cancelled is dropped with the rest of the queue.
        if !matches!(self.state, State::Jog { cancelled: Some(_) }) {
            self.queue(target, feed, true);
        }
        Ok(())
    }
}
