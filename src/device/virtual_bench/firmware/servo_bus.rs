//! Servos on a half-duplex bus: Dynamixel protocol 2.0 and Feetech STS.
//!
//! Both are memories with addresses: reading and writing registers is all there is, and writing the
//! goal of a servo whose torque is on moves it. Every servo answers for itself; a write to all of
//! them (id 254) is not answered, a ping to all is, by each in turn. Servos are absolute: they know
//! their angle from power-up, and it is their first goal. Torque that returns drives a servo to the goal it had,
//! wherever it is meanwhile (pollen-robotics/reachy_mini#1136), unless the model holds where it is
//! (`holds_on_torque`). A frame with a wrong checksum is not answered.
//!
//! Sources: frames of dynamixel-sdk and feetech-servo-sdk; ROBOTIS e-Manual, *Protocol 2.0*. Not
//! emulated: bulk commands, load, temperature, the 1-degree backlash of the cheap ones.

use super::motors::Motors;
use super::outbox::Outbox;
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::checksum::ChecksumKind;
use crate::protocol::emulation::{Register, ServoEmulation, ServoFraming};

const BROADCAST: u8 = 0xfe;
const MEMORY: usize = 1024;

mod instruction {
    pub(super) const PING: u8 = 0x01;
    pub(super) const READ: u8 = 0x02;
    pub(super) const WRITE: u8 = 0x03;
    pub(super) const REG_WRITE: u8 = 0x04;
    pub(super) const ACTION: u8 = 0x05;
    pub(super) const REBOOT: u8 = 0x08;
    pub(super) const STATUS: u8 = 0x55;
    pub(super) const SYNC_READ: u8 = 0x82;
    pub(super) const SYNC_WRITE: u8 = 0x83;
}

/// Servo id, instruction, parameters.
type Instruction = (u8, u8, Vec<u8>);

/// Errors of Dynamixel 2.0.
mod error {
    pub(super) const INSTRUCTION: u8 = 2;
    pub(super) const RANGE: u8 = 6;
}

struct Servo {
    id: u8,
    memory: Vec<u8>,
    until: Timestamp,
    prepared: Option<(usize, Vec<u8>)>,
    fault: u8,
}

/// The emulated bus; a servo's motor is that of the same index in [`Motors`].
pub struct ServoBus {
    spec: ServoEmulation,
    servos: Vec<Servo>,
    motors: Motors,
    outbox: Outbox,
    rx: Vec<u8>,
    t: Timestamp,
}

impl ServoBus {
    /// A bus that is switched on at `now`.
    pub fn new(
        spec: &ServoEmulation,
        options: &EmulatorOptions,
        mut motors: Motors,
        outbox: Outbox,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut spec = spec.clone();
        if let Some(model) = options.identity.as_ref().and_then(|i| i.first()) {
            let bad = |_| EmulatorError::Setting {
                setting: "identity".into(),
                value: model.clone(),
                allowed: "a model number",
            };
            spec.model = model.parse().map_err(bad)?;
        }
        if let Some((key, value)) = options.settings.iter().next() {
            let allowed = "a setting (servos take them as register writes only)";
            return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
        }
        for (name, register) in &spec.registers {
            if register.bytes > 8 || register.address + register.bytes > MEMORY {
                return Err(EmulatorError::Setting {
                    setting: format!("registers.{name}"),
                    value: format!("{} bytes at {}", register.bytes, register.address),
                    allowed: "at most 8 bytes within 1024",
                });
            }
        }
        // An absolute encoder knows where it is.
        (0..motors.count()).for_each(|i| motors.set_home(i));
        let servo = |m: &super::motors::Motor| {
            let id = m.wire.parse().map_err(|_| EmulatorError::Setting {
                setting: "axis.wire".into(),
                value: m.wire.clone(),
                allowed: "a servo id from 0 to 252",
            })?;
            Ok(Servo { id, memory: vec![0; MEMORY], until: now, prepared: None, fault: 0 })
        };
        let servos = motors.iter().map(servo).collect::<Result<Vec<_>, EmulatorError>>()?;
        let mut bus = Self { spec, servos, motors, outbox, rx: Vec::new(), t: now };
        for i in 0..bus.servos.len() {
            let (id, model) = (i64::from(bus.servos[i].id), i64::from(bus.spec.model));
            let initial = bus.spec.initial.clone();
            bus.set(i, "id", id);
            bus.set(i, "model", model);
            initial.iter().for_each(|(name, value)| bus.set(i, name, *value));
            bus.stay(i, now);
        }
        Ok(bus)
    }

    fn load(&self, i: usize, name: &str) -> i64 {
        let Some(register) = self.spec.registers.get(name) else { return 0 };
        let bytes = &self.servos[i].memory[register.address..register.address + register.bytes];
        let value = bytes.iter().rev().fold(0, |value, b| value << 8 | i64::from(*b));
        // Registers of four bytes count both ways.
        if register.bytes == 4 { i64::from(value as i32) } else { value }
    }

    /// Position, velocity and the moving flag as they are now.
    fn refresh(&mut self, i: usize) {
        let motor = self.motors.axis(i);
        let counts = motor.counts(self.motors.position(i, self.t));
        let moving = i64::from(self.t < self.servos[i].until);
        self.set(i, "position", counts);
        self.set(i, "moving", moving);
    }

    fn take_frames(&mut self) {
        while let Some((length, frame)) = self.next_frame() {
            self.rx.drain(..length);
            if let Some((id, code, parameters)) = frame {
                self.instruction(id, code, &parameters);
            }
        }
    }

    /// The next frame and how many bytes it takes, with `None` for bytes to skip.
    fn next_frame(&self) -> Option<(usize, Option<Instruction>)> {
        let rx = &self.rx;
        let sync: &[u8] = match self.spec.framing {
            ServoFraming::Dynamixel2 => &[0xff, 0xff, 0xfd, 0x00],
            ServoFraming::Feetech => &[0xff, 0xff],
        };
        let start = rx.windows(sync.len()).position(|w| w == sync);
        match start {
            Some(0) => {}
            Some(n) => return Some((n, None)),
            None if rx.len() >= sync.len() => return Some((rx.len() + 1 - sync.len(), None)),
            None => return None,
        }
        match self.spec.framing {
            ServoFraming::Dynamixel2 => {
                let length = usize::from(u16::from_le_bytes([*rx.get(5)?, *rx.get(6)?]));
                let total = 7 + length;
                if length < 3 {
                    return Some((2, None));
                }
                if rx.len() < total {
                    return None;
                }
                let crc = u16::from_le_bytes([rx[total - 2], rx[total - 1]]);
                if ChecksumKind::Crc16.of(&rx[..total - 2]) != crc {
                    return Some((2, None));
                }
                Some((total, Some((rx[4], rx[7], unstuff(&rx[8..total - 2])))))
            }
            ServoFraming::Feetech => {
                let length = usize::from(*rx.get(3)?);
                let total = 4 + length;
                if length < 2 {
                    return Some((1, None));
                }
                if rx.len() < total {
                    return None;
                }
                if ChecksumKind::InvertedSum.of(&rx[2..total - 1]) != u16::from(rx[total - 1]) {
                    return Some((1, None));
                }
                Some((total, Some((rx[2], rx[4], rx[5..total - 1].to_vec()))))
            }
        }
    }

    fn status(&mut self, i: usize, error: u8, parameters: &[u8]) {
        let id = self.servos[i].id;
        let error = error | self.servos[i].fault;
        let frame = match self.spec.framing {
            ServoFraming::Dynamixel2 => {
                let mut body = vec![instruction::STATUS, error];
                body.extend(parameters);
                let body = stuff(&body);
                let mut frame = vec![0xff, 0xff, 0xfd, 0x00, id];
                frame.extend((body.len() as u16 + 2).to_le_bytes());
                frame.extend(body);
                let crc = ChecksumKind::Crc16.of(&frame);
                frame.extend(crc.to_le_bytes());
                frame
            }
            ServoFraming::Feetech => {
                let mut frame = vec![0xff, 0xff, id, (parameters.len() + 2) as u8, error];
                frame.extend(parameters);
                frame.push(ChecksumKind::InvertedSum.of(&frame[2..]) as u8);
                frame
            }
        };
        self.outbox.send(self.t, frame);
    }

    /// Splits an address (and a length) off parameters: two bytes each, or one.
    fn numbers<const N: usize>(&self, parameters: &[u8]) -> Option<([usize; N], Vec<u8>)> {
        let wide = self.spec.framing == ServoFraming::Dynamixel2;
        let size = if wide { 2 } else { 1 };
        let mut out = [0; N];
        for (k, number) in out.iter_mut().enumerate() {
            let bytes = parameters.get(k * size..(k + 1) * size)?;
            *number = bytes.iter().rev().fold(0, |n, b| n << 8 | usize::from(*b));
        }
        Some((out, parameters[N * size..].to_vec()))
    }

    fn instruction(&mut self, id: u8, code: u8, parameters: &[u8]) {
        match code {
            instruction::SYNC_WRITE => {
                let Some(([at, size], rest)) = self.numbers::<2>(parameters) else { return };
                for part in rest.chunks_exact(size + 1) {
                    if let Some(i) = self.servos.iter().position(|s| s.id == part[0]) {
                        self.write(i, at, &part[1..]);
                    }
                }
                return;
            }
            instruction::SYNC_READ => {
                let Some(([at, size], ids)) = self.numbers::<2>(parameters) else { return };
                for id in ids {
                    if let Some(i) = self.servos.iter().position(|s| s.id == id) {
                        self.read(i, at, size);
                    }
                }
                return;
            }
            _ => {}
        }
        let answers = id != BROADCAST || code == instruction::PING;
        for i in 0..self.servos.len() {
            if id != BROADCAST && self.servos[i].id != id {
                continue;
            }
            let error = match code {
                instruction::PING => {
                    let model = self.spec.model.to_le_bytes();
                    let reply = [model[0], model[1], self.spec.firmware];
                    let wide = self.spec.framing == ServoFraming::Dynamixel2;
                    self.status(i, 0, if wide { &reply } else { &[] });
                    continue;
                }
                instruction::READ if answers => {
                    match self.numbers::<2>(parameters) {
                        Some(([at, size], _)) => self.read(i, at, size),
                        None => self.status(i, error::INSTRUCTION, &[]),
                    }
                    continue;
                }
                instruction::WRITE => match self.numbers::<1>(parameters) {
                    Some(([at], data)) => self.write(i, at, &data),
                    None => error::INSTRUCTION,
                },
                instruction::REG_WRITE => match self.numbers::<1>(parameters) {
                    Some(([at], data)) => {
                        self.servos[i].prepared = Some((at, data));
                        0
                    }
                    None => error::INSTRUCTION,
                },
                instruction::ACTION => {
                    self.servos[i].prepared.take().map_or(0, |(at, data)| self.write(i, at, &data))
                }
                instruction::REBOOT => {
                    self.motors.halt_one(i, self.t);
                    self.motors.set_home(i);
                    self.servos[i].fault = 0;
                    self.set(i, "torque", 0);
                    self.stay(i, self.t);
                    0
                }
                _ => error::INSTRUCTION,
            };
            if answers {
                self.status(i, error, &[]);
            }
        }
    }

    fn set(&mut self, i: usize, name: &str, value: i64) {
        if let Some(Register { address, bytes }) = self.spec.registers.get(name).copied() {
            self.servos[i].memory[address..address + bytes].copy_from_slice(&value.to_le_bytes()[..bytes]);
        }
    }

    fn read(&mut self, i: usize, at: usize, size: usize) {
        self.refresh(i);
        match self.servos[i].memory.get(at..at + size).map(<[u8]>::to_vec) {
            Some(bytes) => self.status(i, 0, &bytes),
            None => self.status(i, error::RANGE, &[]),
        }
    }

    fn write(&mut self, i: usize, at: usize, data: &[u8]) -> u8 {
        if at + data.len() > self.servos[i].memory.len() {
            return error::RANGE;
        }
        let (before, was_on) = (self.servos[i].memory.clone(), self.load(i, "torque") != 0);
        self.servos[i].memory[at..at + data.len()].copy_from_slice(data);
        let touches = |name: &str| {
            let register = self.spec.registers.get(name);
            register.is_some_and(|r| r.address < at + data.len() && at < r.address + r.bytes)
        };
        let (goal, torque) = (touches("goal"), touches("torque"));
        if goal {
            let motor = self.motors.axis(i);
            let target = self.load(i, "goal") as f64 / motor.counts_per_unit;
            let half = 0.5 / motor.counts_per_unit;
            if target < motor.min - half || target > motor.max + half {
                self.servos[i].memory = before;
                return error::RANGE;
            }
            if self.load(i, "torque") != 0 {
                self.go(i, target);
            }
        }
        if torque && self.load(i, "torque") == 0 {
            self.servos[i].until = self.motors.stop_one(i, self.t);
        } else if torque && self.spec.holds_on_torque {
            // It brakes, and what it reaches is its new goal.
            let rests = self.motors.stop_one(i, self.t);
            self.stay(i, rests);
            self.servos[i].until = rests;
        } else if torque && !was_on {
            let goal = self.load(i, "goal") as f64 / self.motors.axis(i).counts_per_unit;
            self.go(i, goal);
        }
        0
    }

    /// Where it is at `t` becomes its goal.
    fn stay(&mut self, i: usize, t: Timestamp) {
        let counts = self.motors.axis(i).counts(self.motors.position(i, t));
        self.set(i, "goal", counts);
    }

    fn go(&mut self, i: usize, target: f64) {
        let motor = self.motors.axis(i);
        let (fastest, accel) = (motor.max_feed, motor.accel);
        // A speed of 0 means as fast as it can.
        let asked = self.load(i, "speed") as f64 * self.spec.speed_unit;
        let feed = if asked > 0.0 { asked.min(fastest) } else { fastest };
        self.servos[i].until = self.motors.go(i, self.t, target, feed, accel);
    }
}

/// Inserts the byte that keeps parameters from looking like a header.
fn stuff(body: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(body.len());
    for byte in body {
        out.push(*byte);
        if out.ends_with(&[0xff, 0xff, 0xfd]) {
            out.push(0xfd);
        }
    }
    out
}

fn unstuff(body: &[u8]) -> Vec<u8> {
    let mut out: Vec<u8> = Vec::with_capacity(body.len());
    let mut skip = false;
    for byte in body {
        if std::mem::take(&mut skip) && *byte == 0xfd {
            continue;
        }
        out.push(*byte);
        skip = out.ends_with(&[0xff, 0xff, 0xfd]);
    }
    out
}

impl Firmware for ServoBus {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        self.rx.extend(bytes);
        self.take_frames();
    }

    fn advance(&mut self, now: Timestamp) {
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        None
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.halt(now);
        self.rx.clear();
        for i in 0..self.servos.len() {
            self.motors.set_home(i);
            self.servos[i].fault = 0;
            self.servos[i].prepared = None;
            self.set(i, "torque", 0);
            self.stay(i, now);
        }
    }

    /// Overload: torque goes off, and every status carries the alert bit until a reboot.
    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        for i in 0..self.servos.len() {
            if self.motors.velocity(i, now) != 0.0 {
                self.servos[i].until = self.motors.stop_one(i, now);
                self.servos[i].fault =
                    if self.spec.framing == ServoFraming::Dynamixel2 { 0x80 } else { 0x20 };
                self.set(i, "torque", 0);
            }
        }
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stuffing_is_undone(body in proptest::collection::vec(prop_oneof![Just(0xffu8), Just(0xfd), any::<u8>()], 0..40)) {
            let stuffed = stuff(&body);
            prop_assert!(!stuffed.windows(4).any(|w| w == [0xff, 0xff, 0xfd, 0x00]) || body.is_empty());
            prop_assert_eq!(unstuff(&stuffed), body);
        }
    }
}
