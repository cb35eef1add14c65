//! GRBL 1.1 and grblHAL: one line at a time, real-time bytes at any time, silence where it is due.
//!
//! Modelled as the firmware is built: bytes that mean something at once are picked off on arrival,
//! the rest waits in a ring until the main loop has finished the line before. A line may block the
//! main loop (full planner, dwell, homing, an alarm's sleep); while it does, its `ok` is owed, and a
//! reset pays the debt *before* the banner: the stale `ok` that clients must ignore.
//!
//! Silent by design: during `$H` nothing is answered, not even `?`. After ALARM:1 and ALARM:2 the
//! firmware sleeps, forgets a reset that came meanwhile, says `[MSG:Reset to continue]`, and answers
//! nothing until the next reset.
//!
//! Sources: recorded dialogues of GRBL 1.1h (AVR) and grblHAL; the GRBL wiki (*Interface*,
//! *Jogging*, *Configuration*). Not emulated: safety door, probing, arcs, spindle.

mod program;
mod report;
mod settings;

use super::motors::{Motors, PullOff};
use super::outbox::Outbox;
use super::planner::{Block, Planner};
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::emulation::{GrblEmulation, SilentState};
use program::{Action, Program, code};
use report::{Cadence, Status};
use settings::Settings;
use std::collections::VecDeque;
use std::time::Duration;

/// What the status line calls the state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    Alarm,
    Check,
    Run,
    Hold { rests: Timestamp },
    Jog { cancelled: Option<Timestamp> },
    Home,
    Sleep,
}

/// What keeps the main loop from the next line.
#[derive(Debug, Clone)]
enum Waiting {
    Nothing,
    /// A move that does not fit into the planner.
    Room {
        block: Block,
        jog: bool,
    },
    /// Motion must end; then a dwell.
    Sync(Duration),
    Dwell {
        until: Timestamp,
    },
    Homing {
        until: Timestamp,
    },
    /// A soft limit was violated in motion: decelerate first.
    Braking {
        until: Timestamp,
    },
    /// Asleep after an alarm was printed.
    AlarmSleep {
        until: Timestamp,
        critical: bool,
    },
    /// Mute until a reset.
    Mute,
}

/// The emulated controller.
pub struct Grbl {
    spec: GrblEmulation,
    settings: Settings,
    motors: Motors,
    planner: Planner,
    program: Program,
    outbox: Outbox,
    cadence: Cadence,
    state: State,
    waiting: Waiting,
    rx: VecDeque<u8>,
    line: Vec<u8>,
    overflow: bool,
    comment: bool,
    ok_owed: bool,
    status_asked: bool,
    sticky_error: Option<u8>,
    feed_override: u32,
    rapid_override: u32,
    t: Timestamp,
}

impl Grbl {
    /// A controller that is switched on at `now`; `is_wired` when a rig uses its axes.
    pub fn new(
        spec: &GrblEmulation,
        options: &EmulatorOptions,
        motors: Motors,
        outbox: Outbox,
        is_wired: bool,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut spec = spec.clone();
        if let Some(identity) = &options.identity {
            spec.banner = identity.first().cloned().unwrap_or_default();
            spec.identify = identity.iter().skip(1).cloned().collect();
        }
        let settings = Settings::new(&spec, options, &motors, is_wired)?;
        let letters: Vec<u8> = motors.iter().filter_map(|m| m.wire.bytes().next()).collect();
        let mut grbl = Self {
            planner: Planner::new(spec.planner_blocks),
            program: Program::new(&letters, spec.coordinate_systems.len(), spec.hal),
            cadence: Cadence::after_reset(spec.hal),
            state: State::Idle,
            waiting: Waiting::Nothing,
            rx: VecDeque::new(),
            line: Vec::new(),
            overflow: false,
            comment: false,
            ok_owed: false,
            status_asked: false,
            sticky_error: None,
            feed_override: 100,
            rapid_override: 100,
            t: now,
            spec,
            settings,
            motors,
            outbox,
        };
        grbl.apply_settings();
        if grbl.settings.is_on(22) {
            grbl.state = State::Alarm;
        }
        grbl.start_up();
        Ok(grbl)
    }

    fn say(&mut self, line: &str) {
        self.outbox.send(self.t, format!("{line}\r\n"));
    }

    /// Feeds, accelerations and travel follow the stored settings.
    fn apply_settings(&mut self) {
        for (i, motor) in (0u16..).zip(self.motors.iter_mut()) {
            let number = |base: u16| self.settings.number(base + i);
            motor.counts_per_unit = number(100);
            motor.max_feed = number(110) / 60.0;
            motor.accel = number(120);
            let switch = motor.switch();
            let far = switch + motor.inward() * number(130);
            (motor.min, motor.max) = (switch.min(far), switch.max(far));
        }
    }

    /// The end of a reset: state as after power-up except settings, counters and the lock.
    fn start_up(&mut self) {
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
    fn alarm(&mut self, number: u8) {
        self.state = State::Alarm;
        self.planner.clear();
        self.say(&format!("ALARM:{number}"));
        let until = self.t.after(Duration::from_millis(self.spec.alarm_delay_ms));
        self.waiting = Waiting::AlarmSleep { until, critical: number <= 2 };
    }

    fn reset(&mut self) {
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

    fn realtime(&mut self, byte: u8) -> bool {
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

    fn is_silent_in(&self, state: SilentState) -> bool {
        self.spec.silent_in.contains(&state)
    }

    fn report_status(&mut self, full: bool) {
        let state = match self.state {
            State::Idle => "Idle",
            State::Alarm => "Alarm",
            State::Check => "Check",
            State::Run => "Run",
            State::Hold { rests } if self.t < rests => "Hold:1",
            State::Hold { .. } => "Hold:0",
            State::Jog { .. } => "Jog",
            State::Home => "Home",
            State::Sleep => "Sleep",
        };
        let busy = matches!(self.state, State::Run | State::Hold { .. } | State::Jog { .. } | State::Home);
        if full {
            self.cadence = Cadence::after_reset(true);
            self.cadence.offset_changed();
        }
        let machine: Vec<f64> =
            self.motors.iter().zip(self.motors.positions(self.t)).map(|(m, x)| m.snap(x)).collect();
        let homed = self.motors.iter().all(|m| m.referenced);
        let line = Status {
            state,
            machine: &machine,
            offset: &self.program.offset(),
            mask: self.settings.number(10) as u32,
            free: (self.planner.free(), self.spec.rx_bytes.saturating_sub(self.rx.len())),
            speed: self.motors.speed(self.t) * 60.0,
            feed_override: self.feed_override,
            rapid_override: self.rapid_override,
            rare: self.cadence.next(busy),
            hal: self.spec.hal.then(|| (self.settings.is_on(22), homed)),
        }
        .render();
        self.say(&line);
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

    fn answer(&mut self, result: Result<(), u8>) {
        match result {
            Ok(()) => self.say("ok"),
            Err(number) => self.say(&format!("error:{number}")),
        }
    }

    fn execute(&mut self, line: &[u8], overflow: bool) {
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

    fn planned(&self) -> Vec<f64> {
        self.planner.target().map_or_else(|| self.motors.positions(self.t), <[f64]>::to_vec)
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

    fn is_within_travel(&self, target: &[f64]) -> bool {
        let inside = |(m, x): (&super::motors::Motor, &f64)| *x >= m.min - 1e-6 && *x <= m.max + 1e-6;
        !self.settings.is_on(20) || self.motors.iter().zip(target).all(inside)
    }

    /// A soft limit: decelerate if in motion, then ALARM:2.
    fn violate(&mut self) {
        if self.state == State::Run {
            let until = self.planner.hold(&mut self.motors, self.t);
            self.waiting = Waiting::Braking { until };
        } else {
            self.alarm(2);
        }
    }

    fn queue(&mut self, target: Vec<f64>, feed: Option<f64>, jog: bool) {
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

    fn start(&mut self, block: Block, jog: bool) {
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

    fn sync(&mut self, dwell: Duration) {
        self.waiting = Waiting::Sync(dwell);
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

    /// All axes seek their switches at `$25` and leave them by `$27` at `$24`.
    fn home(&mut self) {
        self.state = State::Home;
        let pull_off = PullOff { distance: self.settings.number(27), feed: self.settings.number(24) / 60.0 };
        let seek = self.settings.number(25) / 60.0;
        let mut until = self.t;
        for i in 0..self.motors.count() {
            until = until.max(self.motors.seek_home(i, self.t, seek, pull_off));
        }
        self.waiting = Waiting::Homing { until };
    }

    /// The earliest thing that happens by itself.
    fn next_event(&self) -> Option<Timestamp> {
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
    fn event(&mut self) {
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

    /// The blocked line is done.
    fn unblock(&mut self) {
        self.waiting = Waiting::Nothing;
        self.ok_owed = false;
        self.answer(Ok(()));
    }

    /// Lets a blocked line go on where the planner allows it, then reads further lines.
    fn go_on(&mut self) {
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
}

impl Firmware for Grbl {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        for byte in bytes {
            if !self.realtime(*byte) && self.rx.len() < self.spec.rx_bytes {
                self.rx.push_back(*byte);
            }
            self.go_on();
        }
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(t) = self.next_event().filter(|t| *t <= now) {
            self.t = self.t.max(t);
            self.event();
            self.go_on();
        }
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        self.next_event()
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.power_up(now);
        self.ok_owed = false;
        self.state = if self.settings.is_on(22) { State::Alarm } else { State::Idle };
        self.start_up();
    }

    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        if !matches!(self.waiting, Waiting::AlarmSleep { .. } | Waiting::Mute) {
            self.motors.halt(now);
            self.alarm(1);
        }
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}
