//! Thorlabs APT: six-byte headers, some with data behind, no checksum, and messages that come by
//! themselves.
//!
//! A move is answered when it is *over* (`MOVE_COMPLETED`), a stop by `MOVE_STOPPED`, homing by
//! `MOVE_HOMED`; a move that another one preempts is never completed. Status updates, once started,
//! come every 100 ms and cease when the host has not acknowledged one for a second. Messages the
//! controller does not know are swallowed. Parameters that are set are given back as they came.
//!
//! Sources: frames of thorlabs-apt-protocol; Thorlabs, *APT Communications Protocol*. Not emulated:
//! several channels, jogging, triggers, the second encoder.

use super::motors::{Motors, PullOff};
use super::outbox::Outbox;
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::emulation::AptEmulation;
use std::collections::BTreeMap;
use std::time::Duration;

const HOST: u8 = 0x01;
const UPDATE_PERIOD: Duration = Duration::from_millis(100);
const KEEPALIVE: Duration = Duration::from_secs(1);

mod id {
    pub(super) const REQ_INFO: u16 = 0x0005;
    pub(super) const GET_INFO: u16 = 0x0006;
    pub(super) const START_UPDATES: u16 = 0x0011;
    pub(super) const STOP_UPDATES: u16 = 0x0012;
    pub(super) const SET_ENABLED: u16 = 0x0210;
    pub(super) const REQ_ENABLED: u16 = 0x0211;
    pub(super) const GET_ENABLED: u16 = 0x0212;
    pub(super) const SET_POSITION: u16 = 0x0410;
    pub(super) const SET_VELOCITY: u16 = 0x0413;
    pub(super) const REQ_BITS: u16 = 0x0429;
    pub(super) const GET_BITS: u16 = 0x042A;
    pub(super) const HOME: u16 = 0x0443;
    pub(super) const HOMED: u16 = 0x0444;
    pub(super) const MOVE_RELATIVE: u16 = 0x0448;
    pub(super) const SET_ABSOLUTE: u16 = 0x0450;
    pub(super) const MOVE_ABSOLUTE: u16 = 0x0453;
    pub(super) const MOVE_COMPLETED: u16 = 0x0464;
    pub(super) const STOP: u16 = 0x0465;
    pub(super) const STOPPED: u16 = 0x0466;
    pub(super) const REQ_STEPPER: u16 = 0x0480;
    pub(super) const GET_STEPPER: u16 = 0x0481;
    pub(super) const REQ_DC: u16 = 0x0490;
    pub(super) const GET_DC: u16 = 0x0491;
    pub(super) const ACK: u16 = 0x0492;
}

/// Parameters as (set, request, get, bytes of data): counters, velocity, jog, limit switches,
/// backlash, homing, relative and absolute move.
const PARAMETERS: [(u16, u16, u16, usize); 9] = [
    (0x0409, 0x040A, 0x040B, 6),
    (0x0410, 0x0411, 0x0412, 6),
    (0x0413, 0x0414, 0x0415, 14),
    (0x0416, 0x0417, 0x0418, 22),
    (0x0423, 0x0424, 0x0425, 16),
    (0x043A, 0x043B, 0x043C, 6),
    (0x0440, 0x0441, 0x0442, 14),
    (0x0445, 0x0446, 0x0447, 6),
    (0x0450, 0x0451, 0x0452, 6),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doing {
    Nothing,
    Moving,
    Homing,
    Stopping,
}

/// The emulated controller with one axis.
pub struct Apt {
    spec: AptEmulation,
    motors: Motors,
    outbox: Outbox,
    rx: Vec<u8>,
    parameters: BTreeMap<u16, Vec<u8>>,
    enabled: bool,
    doing: Doing,
    until: Timestamp,
    stalled: bool,
    update_at: Option<Timestamp>,
    acknowledged: Timestamp,
    t: Timestamp,
}

impl Apt {
    /// A controller that is switched on at `now`.
    pub fn new(
        spec: &AptEmulation,
        options: &EmulatorOptions,
        motors: Motors,
        outbox: Outbox,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut spec = spec.clone();
        if let Some(model) = options.identity.as_ref().and_then(|i| i.first()) {
            spec.model.clone_from(model);
        }
        if let Some((key, value)) = options.settings.iter().next() {
            let allowed = "a setting (this controller takes them as messages only)";
            return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
        }
        let motor = motors.axis(0);
        let (velocity, accel) = (motor.max_feed * spec.velocity_per_unit, motor.accel * spec.accel_per_unit);
        let mut velocities = vec![1, 0, 0, 0, 0, 0];
        velocities.extend((accel.round() as i32).to_le_bytes());
        velocities.extend((velocity.round() as i32).to_le_bytes());
        let parameters = BTreeMap::from([(id::SET_VELOCITY, velocities)]);
        Ok(Self {
            spec,
            motors,
            outbox,
            rx: Vec::new(),
            parameters,
            enabled: true,
            doing: Doing::Nothing,
            until: now,
            stalled: false,
            update_at: None,
            acknowledged: now,
            t: now,
        })
    }

    /// Takes complete messages off the receive buffer.
    fn take_messages(&mut self) {
        while self.rx.len() >= 6 {
            let long = self.rx[4] & 0x80 != 0;
            let length = if long { usize::from(u16::from_le_bytes([self.rx[2], self.rx[3]])) } else { 0 };
            if length > 255 {
                // Not a length that exists: the host and we are out of step.
                self.rx.clear();
                return;
            }
            if self.rx.len() < 6 + length {
                return;
            }
            let message: Vec<u8> = self.rx.drain(..6 + length).collect();
            let number = u16::from_le_bytes([message[0], message[1]]);
            self.message(number, [message[2], message[3]], &message[6..]);
        }
    }

    fn send(&mut self, number: u16, p: [u8; 2]) {
        let mut frame = number.to_le_bytes().to_vec();
        frame.extend([p[0], p[1], HOST, self.spec.address]);
        self.outbox.send(self.t, frame);
    }

    fn send_data(&mut self, number: u16, data: &[u8]) {
        let mut frame = number.to_le_bytes().to_vec();
        frame.extend((data.len() as u16).to_le_bytes());
        frame.extend([HOST | 0x80, self.spec.address]);
        frame.extend(data);
        self.outbox.send(self.t, frame);
    }

    fn message(&mut self, number: u16, p: [u8; 2], data: &[u8]) {
        let counts = |at: usize| {
            let bytes = data.get(at..at + 4)?;
            Some(f64::from(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])))
        };
        let per_unit = self.motors.axis(0).counts_per_unit;
        match number {
            id::REQ_INFO => self.send_info(),
            id::START_UPDATES => {
                self.acknowledged = self.t;
                self.update_at = Some(self.t.after(UPDATE_PERIOD));
            }
            id::STOP_UPDATES => self.update_at = None,
            id::ACK => self.acknowledged = self.t,
            id::SET_ENABLED => self.enabled = p[1] == 1,
            id::REQ_ENABLED => self.send(id::GET_ENABLED, [1, if self.enabled { 1 } else { 2 }]),
            id::REQ_DC | id::REQ_STEPPER => self.send_status(),
            id::REQ_BITS => {
                let mut data = vec![1, 0];
                data.extend(self.bits().to_le_bytes());
                self.send_data(id::GET_BITS, &data);
            }
            id::HOME => self.home(),
            id::MOVE_ABSOLUTE => {
                let stored = self.parameters.get(&id::SET_ABSOLUTE).and_then(|d| d.get(2..6));
                let stored = stored.map(|b| f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])));
                if let Some(target) = counts(2).or(stored) {
                    self.go(target / per_unit);
                }
            }
            id::MOVE_RELATIVE => {
                if let Some(by) = counts(2) {
                    self.go(self.motors.position(0, self.t) + by / per_unit);
                }
            }
            id::STOP => {
                self.until = if p[1] == 1 {
                    self.motors.halt(self.t);
                    self.t
                } else {
                    self.motors.stop(self.t)
                };
                self.doing = Doing::Stopping;
                self.settle();
            }
            _ => self.parameter(number, data),
        }
    }

    /// Sets a parameter, or gives it back.
    fn parameter(&mut self, number: u16, data: &[u8]) {
        if PARAMETERS.iter().any(|(set, ..)| *set == number) {
            self.parameters.insert(number, data.to_vec());
            let int = |at: usize| {
                data.get(at..at + 4).map(|b| f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])))
            };
            let motor = self.motors.axis_mut(0);
            match (number, int(6), int(10), int(2)) {
                (id::SET_VELOCITY, Some(accel), Some(feed), _) if accel > 0.0 && feed > 0.0 => {
                    motor.accel = accel / self.spec.accel_per_unit;
                    motor.max_feed = feed / self.spec.velocity_per_unit;
                }
                (id::SET_POSITION, _, _, Some(counts)) => {
                    let counter = counts / motor.counts_per_unit;
                    self.motors.redefine(0, self.t, counter);
                }
                _ => {}
            }
        } else if let Some((set, _, get, size)) =
            PARAMETERS.iter().find(|(_, request, ..)| *request == number)
        {
            let mut data = match *set {
                id::SET_POSITION => self.position_data(),
                _ => self.parameters.get(set).cloned().unwrap_or_default(),
            };
            data.resize(*size, 0);
            data[0] = 1;
            self.send_data(*get, &data);
        }
    }

    fn position_counts(&self) -> i32 {
        self.motors.axis(0).counts(self.motors.position(0, self.t)) as i32
    }

    fn position_data(&self) -> Vec<u8> {
        let mut data = vec![1, 0];
        data.extend(self.position_counts().to_le_bytes());
        data
    }

    fn bits(&self) -> u32 {
        let v = self.motors.velocity(0, self.t);
        let mut bits = 0;
        for (set, bit) in [
            (v > 0.0, 0x10),
            (v < 0.0, 0x20),
            (self.doing == Doing::Homing, 0x200),
            (self.motors.axis(0).referenced, 0x400),
            (self.doing == Doing::Nothing, 0x2000),
            (self.stalled, 0x4000),
            (self.enabled, 0x8000_0000),
        ] {
            if set {
                bits |= bit;
            }
        }
        bits
    }

    /// The fourteen bytes of a status: channel, position, velocity or encoder, bits.
    fn status_data(&self) -> Vec<u8> {
        let mut data = self.position_data();
        if self.spec.stepper {
            data.extend(self.position_counts().to_le_bytes());
        } else {
            let speed = self.motors.speed(self.t) * self.spec.velocity_per_unit / 65536.0;
            data.extend((speed.round() as u16).to_le_bytes());
            data.extend([0, 0]);
        }
        data.extend(self.bits().to_le_bytes());
        data
    }

    fn send_status(&mut self) {
        let number = if self.spec.stepper { id::GET_STEPPER } else { id::GET_DC };
        self.send_data(number, &self.status_data());
    }

    fn send_info(&mut self) {
        let mut data = self.spec.serial.to_le_bytes().to_vec();
        let mut model = self.spec.model.clone().into_bytes();
        model.resize(8, 0);
        data.extend(model);
        data.extend(16u16.to_le_bytes());
        data.extend(self.spec.firmware);
        let mut notes = self.spec.notes.clone().into_bytes();
        notes.resize(48, 0);
        data.extend(notes);
        data.extend([0; 12]);
        data.extend([1u16, 0, 1].into_iter().flat_map(u16::to_le_bytes));
        self.send_data(id::GET_INFO, &data);
    }

    fn go(&mut self, target: f64) {
        if !self.enabled {
            return;
        }
        let motor = self.motors.axis(0);
        let (target, feed, accel) = (target.clamp(motor.min, motor.max), motor.max_feed, motor.accel);
        self.stalled = false;
        self.until = self.motors.go(0, self.t, target, feed, accel);
        self.doing = Doing::Moving;
        self.settle();
    }

    fn home(&mut self) {
        let feed = 0.5 * self.motors.axis(0).max_feed;
        self.stalled = false;
        self.until = self.motors.seek_home(0, self.t, feed, PullOff { distance: 0.0, feed });
        self.doing = Doing::Homing;
        self.settle();
    }

    /// Says what is over.
    fn settle(&mut self) {
        if self.doing == Doing::Nothing || self.until > self.t {
            return;
        }
        match std::mem::replace(&mut self.doing, Doing::Nothing) {
            Doing::Homing => {
                self.motors.set_home(0);
                self.send(id::HOMED, [1, 0]);
            }
            Doing::Moving => self.send_data(id::MOVE_COMPLETED, &self.status_data()),
            Doing::Stopping => self.send_data(id::STOPPED, &self.status_data()),
            Doing::Nothing => {}
        }
    }
}

impl Firmware for Apt {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        self.rx.extend(bytes);
        self.take_messages();
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(t) = self.deadline().filter(|t| *t <= now) {
            self.t = self.t.max(t);
            self.settle();
            if let Some(at) = self.update_at.filter(|at| *at <= self.t) {
                let heard = self.t.since(self.acknowledged) < KEEPALIVE;
                self.update_at = heard.then(|| at.after(UPDATE_PERIOD));
                if heard {
                    self.send_status();
                }
            }
        }
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        let over = (self.doing != Doing::Nothing).then_some(self.until);
        [over, self.update_at].into_iter().flatten().min()
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.power_up(now);
        self.rx.clear();
        (self.doing, self.stalled, self.update_at, self.enabled) = (Doing::Nothing, false, None, true);
    }

    /// The axis stalls: the motion error bit, and no completion ever.
    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        if self.doing != Doing::Nothing {
            self.motors.halt(now);
            (self.doing, self.stalled) = (Doing::Nothing, true);
        }
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}
