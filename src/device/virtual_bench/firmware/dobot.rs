//! Dobot Magician: binary frames, and a queue of commands that each get an index.
//!
//! A frame is `AA AA length id ctrl parameters sum`; bit 0 of `ctrl` writes, bit 1 queues. A queued
//! command is answered at once with its index; that it is done is seen in the current index. Nothing
//! moves until the queue is started. A target out of reach raises an alarm, *and the index advances*;
//! an alarm holds up the queue until it is cleared. Frames with a wrong sum are not answered.
//!
//! Sources: frames of pydobot; Dobot, *Magician Communication Protocol*. Not emulated: the joint
//! angles of the elbow (j2 and j3 are 0), jogging, I/O, end effectors.

use super::motors::Motors;
use super::outbox::Outbox;
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::checksum::ChecksumKind;
use crate::protocol::emulation::DobotEmulation;
use std::collections::{BTreeMap, VecDeque};

/// Alarm bit of a target that the arm cannot plan a way to.
const ALARM_PLAN: u8 = 0x10;
/// Alarm bit of a limit switch.
const ALARM_LIMIT: u8 = 0x40;

/// Parameter: speeds and accelerations along lines and of r.
const COORDINATE_SPEED: u8 = 81;
/// Parameter: percentages of speed and acceleration.
const COMMON_RATIO: u8 = 83;

#[derive(Debug, Clone)]
enum Queued {
    /// To x, y, z, r; relative for modes 6 to 9.
    Move {
        mode: u8,
        target: [f64; 4],
    },
    Home,
    /// A parameter that takes its turn.
    Parameter {
        id: u8,
        value: Vec<u8>,
    },
}

/// The emulated arm.
pub struct Dobot {
    spec: DobotEmulation,
    motors: Motors,
    outbox: Outbox,
    rx: Vec<u8>,
    /// Each with its index: what a stop drops is never counted as done, and what comes after it is not behind.
    queue: VecDeque<(u64, Queued)>,
    next_index: u64,
    /// Index of what runs, and of what was done last.
    begun_index: u64,
    done_index: u64,
    started: bool,
    running: Option<Timestamp>,
    homing: bool,
    alarms: [u8; 16],
    parameters: BTreeMap<u8, Vec<u8>>,
    t: Timestamp,
}

impl Dobot {
    /// An arm that is switched on at `now`.
    pub fn new(
        spec: &DobotEmulation,
        options: &EmulatorOptions,
        motors: Motors,
        outbox: Outbox,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut spec = spec.clone();
        if let Some(name) = options.identity.as_ref().and_then(|i| i.first()) {
            spec.name.clone_from(name);
        }
        if let Some((key, value)) = options.settings.iter().next() {
            let allowed = "a setting (this arm takes them as frames only)";
            return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
        }
        Ok(Self {
            spec,
            motors,
            outbox,
            rx: Vec::new(),
            queue: VecDeque::new(),
            next_index: 0,
            begun_index: 0,
            done_index: 0,
            started: false,
            running: None,
            homing: false,
            alarms: [0; 16],
            parameters: BTreeMap::new(),
            t: now,
        })
    }

    fn take_frames(&mut self) {
        loop {
            // Resynchronise on the two sync bytes.
            let Some(start) = self.rx.windows(2).position(|w| w == [0xaa, 0xaa]) else {
                let keep = usize::from(self.rx.last() == Some(&0xaa));
                self.rx.drain(..self.rx.len() - keep);
                return;
            };
            self.rx.drain(..start);
            let Some(length) = self.rx.get(2).map(|n| usize::from(*n)) else { return };
            if length < 2 {
                self.rx.drain(..2);
                continue;
            }
            if self.rx.len() < 4 + length {
                return;
            }
            let body = &self.rx[3..3 + length];
            if ChecksumKind::TwosComplement.of(body) != u16::from(self.rx[3 + length]) {
                self.rx.drain(..2);
                continue;
            }
            let body = body.to_vec();
            self.rx.drain(..4 + length);
            self.frame(body[0], body[1], &body[2..]);
        }
    }

    fn reply(&mut self, id: u8, ctrl: u8, parameters: &[u8]) {
        let mut frame = vec![0xaa, 0xaa, (2 + parameters.len()) as u8, id, ctrl];
        frame.extend(parameters);
        frame.push(ChecksumKind::TwosComplement.of(&frame[3..]) as u8);
        self.outbox.send(self.t, frame);
    }

    fn frame(&mut self, id: u8, ctrl: u8, parameters: &[u8]) {
        let (writes, queues) = (ctrl & 1 != 0, ctrl & 2 != 0);
        // x, y, z, r as little-endian floats.
        let float = |i: usize| {
            let b = parameters.get(i..i + 4)?;
            Some(f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        };
        match (id, writes) {
            (0, false) => {
                let serial = self.spec.serial.clone().into_bytes();
                self.reply(id, ctrl, &serial);
            }
            (1, false) => {
                let name = self.spec.name.clone().into_bytes();
                self.reply(id, ctrl, &name);
            }
            (2, false) => self.reply(id, ctrl, &self.spec.version.clone()),
            (10, false) => self.reply(id, ctrl, &self.pose()),
            (20, false) => self.reply(id, ctrl, &self.alarms.clone()),
            (20, true) => {
                self.alarms = [0; 16];
                self.reply(id, ctrl, &[]);
            }
            (84, true) => {
                let target = [float(1), float(5), float(9), float(13)];
                let [Some(x), Some(y), Some(z), Some(r)] = target else { return };
                let command = Queued::Move { mode: parameters[0], target: [x, y, z, r] };
                self.enqueue(id, ctrl, command);
            }
            (31, true) => self.enqueue(id, ctrl, Queued::Home),
            (0xf0, true) => self.switch(id, ctrl, true),
            (0xf1, true) => self.switch(id, ctrl, false),
            (0xf2, true) => {
                // A forced stop breaks off what runs; the steps of an arm that brakes are kept.
                self.motors.stop(self.t);
                (self.running, self.homing) = (None, false);
                self.queue.clear();
                self.switch(id, ctrl, false);
            }
            (0xf5, true) => {
                self.queue.clear();
                self.reply(id, ctrl, &[]);
            }
            (0xf6, false) => self.reply(id, ctrl, &self.done_index.to_le_bytes()),
            (_, true) => {
                if queues {
                    self.enqueue(id, ctrl, Queued::Parameter { id, value: parameters.to_vec() });
                } else {
                    self.parameters.insert(id, parameters.to_vec());
                    self.reply(id, ctrl, &[]);
                }
            }
            (_, false) => {
                if let Some(stored) = self.parameters.get(&id).cloned() {
                    self.reply(id, ctrl, &stored);
                }
            }
        }
    }

    fn switch(&mut self, id: u8, ctrl: u8, started: bool) {
        self.started = started;
        self.reply(id, ctrl, &[]);
    }

    fn enqueue(&mut self, id: u8, ctrl: u8, command: Queued) {
        self.next_index += 1;
        self.queue.push_back((self.next_index, command));
        self.reply(id, ctrl, &self.next_index.to_le_bytes());
    }

    fn pose(&self) -> Vec<u8> {
        let p = self.motors.positions(self.t);
        let j1 = p[1].atan2(p[0]).to_degrees();
        [p[0], p[1], p[2], p[3], j1, 0.0, 0.0, p[3] - j1]
            .iter()
            .flat_map(|x| (*x as f32).to_le_bytes())
            .collect()
    }

    /// Starts queued commands until one takes time.
    fn go_on(&mut self) {
        while self.started && self.running.is_none() && self.alarms == [0; 16] {
            let Some((index, command)) = self.queue.pop_front() else { return };
            self.begun_index = index;
            match command {
                Queued::Parameter { id, value } => {
                    self.parameters.insert(id, value);
                    self.done_index = self.begun_index;
                }
                Queued::Home => {
                    let until = (0..self.motors.count()).map(|i| {
                        let feed = 0.5 * self.motors.axis(i).max_feed;
                        self.motors.go_truly(i, self.t, self.spec.home_pose[i], feed)
                    });
                    self.running = until.max();
                    self.homing = true;
                }
                Queued::Move { mode, target } => self.start_move(mode, target),
            }
        }
    }

    fn start_move(&mut self, mode: u8, target: [f64; 4]) {
        let now = self.motors.positions(self.t);
        let relative = (6..=9).contains(&mode);
        let target: Vec<f64> =
            target.iter().zip(&now).map(|(x, at)| if relative { at + x } else { *x }).collect();
        let radius = (target[0].powi(2) + target[1].powi(2)).sqrt();
        let inside = self.motors.iter().zip(&target).all(|(m, x)| *x >= m.min && *x <= m.max);
        if !inside || radius < self.spec.reach_mm[0] || radius > self.spec.reach_mm[1] {
            self.alarms[2] |= ALARM_PLAN;
            self.done_index = self.begun_index;
            return;
        }
        let fastest = self.motors.iter().map(|m| m.max_feed).fold(f64::MAX, f64::min);
        // Of the coordinate speeds the first is along lines, the second of r; a line that only turns has r's.
        let turns_alone = (0..3).all(|i| (target[i] - now[i]).abs() < 1e-6);
        let speed = self.parameter(COORDINATE_SPEED, usize::from(turns_alone)).unwrap_or(fastest);
        let ratio = self.parameter(COMMON_RATIO, 0).unwrap_or(100.0) / 100.0;
        let feed = (speed * ratio).clamp(1e-3, fastest);
        self.running = Some(self.motors.line(self.t, &target, feed));
    }

    /// One number of a stored parameter, where it was ever set.
    fn parameter(&self, id: u8, at: usize) -> Option<f64> {
        let bytes = self.parameters.get(&id)?.get(4 * at..4 * at + 4)?;
        Some(f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])))
    }

    fn settle(&mut self) {
        if self.running.is_some_and(|until| until <= self.t) {
            self.running = None;
            self.done_index = self.begun_index;
            if std::mem::take(&mut self.homing) {
                (0..self.motors.count()).for_each(|i| self.motors.set_home(i));
            }
        }
        self.go_on();
    }
}

impl Firmware for Dobot {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        self.rx.extend(bytes);
        self.take_frames();
        self.go_on();
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(t) = self.running.filter(|t| *t <= now) {
            self.t = self.t.max(t);
            self.settle();
        }
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        self.running
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.power_up(now);
        self.rx.clear();
        self.queue.clear();
        (self.next_index, self.begun_index, self.done_index) = (0, 0, 0);
        (self.started, self.running, self.homing, self.alarms) = (false, None, false, [0; 16]);
    }

    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.halt(now);
        (self.running, self.homing) = (None, false);
        self.alarms[4] |= ALARM_LIMIT;
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}
