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

mod lines;
mod main_loop;
mod motion;
mod program;
mod realtime;
mod report;
mod reset;
mod settings;

use super::motors::Motors;
use super::outbox::Outbox;
use super::planner::{Block, Planner};
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::emulation::{GrblEmulation, SilentState};
use program::Program;
use report::Cadence;
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

    fn is_silent_in(&self, state: SilentState) -> bool {
        self.spec.silent_in.contains(&state)
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
