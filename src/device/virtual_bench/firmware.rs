//! Firmware emulators: bytes and instants in, bytes and instants out.
//!
//! An [`Emulator`] is told what arrives and asked what is due; it reads no clock and opens no port,
//! so the same one runs under paused time, behind a pseudo-terminal, or inside a fuzz loop:
//!
//! ```text
//! emulator.receive(b"?", now);                       // at any time
//! let replies = emulator.poll(now);                  // everything sent by now
//! let wake = emulator.next_deadline();               // when to poll again without new input
//! ```
//!
//! What a firmware says comes from the `[emulator]` table of its protocol file; how its family
//! behaves is a dialect (a module below). A rig's axes replace the
//! firmware's own travel, feeds and counts. Positions after power-up are unknown to the firmware, as
//! on a real machine: it counts from zero wherever the axes are.

mod apt;
mod dobot;
#[cfg(test)]
mod frames;
mod grbl;
mod marlin;
mod motors;
mod outbox;
#[cfg(test)]
mod pitfalls;
mod planner;
#[cfg(test)]
mod replay;
mod rules;
mod servo_bus;
mod zaber;

use super::world::World;
use crate::clock::Timestamp;
use crate::device::settings::AxisSettings;
use crate::protocol::emulation::{Dialect, EmulatorSpec, HomeEnd};
use motors::Motors;
use outbox::Outbox;
use std::collections::BTreeMap;
use std::time::Duration;

/// What a bench or a test wants otherwise than the protocol file says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EmulatorOptions {
    /// Replaces the text that identifies the firmware: the banner and the answer to `$I`, the answer
    /// to `M115`. For a bench with the wrong device on a port.
    pub identity: Option<Vec<String>>,
    /// Whether somebody has set the controller up, as somebody has where a rig wires its axes: homing is on.
    pub set_up: bool,
    /// Stored settings (`"22"` -> `"1"` for `$22=1`) that differ from the file's.
    pub settings: BTreeMap<String, String>,
    /// True position of an axis (by wire name) at power-up; near its switch if absent.
    pub power_on: BTreeMap<String, f64>,
    /// What the firmware counts there at power-up; 0 if absent.
    pub counter: BTreeMap<String, f64>,
    /// Which end of an axis (by wire name) has the home switch, where the file's differs.
    pub home: BTreeMap<String, HomeEnd>,
    /// Baud rate for the time that bytes take; 115200 if absent.
    pub baud: Option<u32>,
}

/// Why an emulator cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EmulatorError {
    /// The rig wires an axis that the firmware has not.
    #[error(
        "axis {axis}: the emulated firmware has no axis {wire} (it has {has}); correct `wire` in the rig file, or add an [[emulator.axis]] to the protocol file"
    )]
    NoSuchAxis {
        /// Name in the rig file.
        axis: String,
        /// Name on the wire.
        wire: String,
        /// The names there are.
        has: String,
    },
    /// A setting of the `[emulator]` table or of the options cannot be read.
    #[error(
        "emulator setting {setting}: {value} is not {allowed}; correct it in the protocol file, or in --setting"
    )]
    Setting {
        /// Which setting.
        setting: String,
        /// As written.
        value: String,
        /// What would be right.
        allowed: &'static str,
    },
}

/// What a dialect implements.
trait Firmware: Send {
    /// Takes bytes that arrived at `now`; `advance(now)` has been called.
    fn receive(&mut self, bytes: &[u8], now: Timestamp);
    /// Does everything that was due by `now`.
    fn advance(&mut self, now: Timestamp);
    /// When something happens by itself.
    fn deadline(&self) -> Option<Timestamp>;
    /// Replies on their way.
    fn outbox(&mut self) -> &mut Outbox;
    /// The reset line is pulled, or the power returns: motors lose their way, texts are printed.
    fn restart(&mut self, now: Timestamp);
    /// A limit switch closes.
    fn trip(&mut self, now: Timestamp);
    /// The axes, for faults and for tests.
    fn motors(&mut self) -> &mut Motors;
}

/// An emulated device.
pub struct Emulator {
    firmware: Box<dyn Firmware>,
    now: Timestamp,
}

impl Emulator {
    /// A device that is switched on at `now`. `device` is its name in the world (`arm`, `stage`),
    /// `axes` what the rig wires to it (none: the firmware's own).
    pub fn new(
        spec: &EmulatorSpec,
        device: &str,
        axes: &BTreeMap<String, AxisSettings>,
        options: &EmulatorOptions,
        world: World,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        if let Some((name, axis)) = axes.iter().find(|(_, a)| !spec.axis.iter().any(|s| s.wire == a.wire)) {
            let has = spec.axis.iter().map(|s| s.wire.as_str()).collect::<Vec<_>>().join(", ");
            return Err(EmulatorError::NoSuchAxis { axis: name.clone(), wire: axis.wire.clone(), has });
        }
        let motors = Motors::new(device, &spec.axis, axes, options, world);
        let outbox = Outbox::new(Duration::from_micros(spec.latency_us), options.baud.unwrap_or(115_200));
        let firmware: Box<dyn Firmware> = match &spec.dialect {
            Dialect::Grbl(spec) => {
                let is_wired = !axes.is_empty();
                Box::new(grbl::Grbl::new(spec, options, motors, outbox, is_wired, now)?)
            }
            Dialect::ThorlabsApt(spec) => Box::new(apt::Apt::new(spec, options, motors, outbox, now)?),
            Dialect::Dobot(spec) => Box::new(dobot::Dobot::new(spec, options, motors, outbox, now)?),
            Dialect::ServoBus(spec) => {
                Box::new(servo_bus::ServoBus::new(spec, options, motors, outbox, now)?)
            }
            Dialect::Rules(spec) => Box::new(rules::Rules::new(spec, options, motors, outbox, now)?),
            Dialect::ZaberAscii(spec) => Box::new(zaber::Zaber::new(spec, options, motors, outbox, now)?),
            Dialect::Marlin(spec) => Box::new(marlin::Marlin::new(spec, options, motors, outbox, now)?),
        };
        Ok(Self { firmware, now })
    }

    /// Bytes from the client arrive at `now`. Instants never run backwards.
    pub fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.advance(now);
        self.firmware.receive(bytes, self.now);
        self.firmware.advance(self.now);
    }

    /// The bytes sent by `now` that were not asked for before.
    pub fn poll(&mut self, now: Timestamp) -> Vec<u8> {
        self.poll_replies(now).concat()
    }

    /// As [`Emulator::poll`], one element for each reply (a line with its end, a frame).
    pub fn poll_replies(&mut self, now: Timestamp) -> Vec<Vec<u8>> {
        self.advance(now);
        self.firmware.outbox().due(self.now)
    }

    /// When [`Emulator::poll`] will have something new without further input; `None` for never.
    pub fn next_deadline(&mut self) -> Option<Timestamp> {
        let sent = self.firmware.outbox().next();
        [sent, self.firmware.deadline()].into_iter().flatten().min()
    }

    /// Resets as the reset line or the power switch does: a DTR pulse on many boards.
    pub fn restart(&mut self, now: Timestamp) {
        self.advance(now);
        self.firmware.outbox().clear();
        self.firmware.restart(self.now);
    }

    /// A limit switch closes at `now`: what noise or a collision does.
    pub fn trip_limit(&mut self, now: Timestamp) {
        self.advance(now);
        self.firmware.trip(self.now);
    }

    /// Steps are lost on the axis of that wire name: truth moves by `by`, the counter does not.
    pub fn lose_steps(&mut self, wire: &str, by: f64, now: Timestamp) {
        self.advance(now);
        let motors = self.firmware.motors();
        if let Some(i) = motors.find(wire) {
            motors.lose(i, now, by);
        }
    }

    /// The counter of the axis of that wire name agrees with the truth again: what an absolute encoder sees.
    pub fn reseat(&mut self, wire: &str) {
        let motors = self.firmware.motors();
        if let Some(i) = motors.find(wire) {
            motors.set_home(i);
        }
    }

    /// What the firmware counts on the axis of that wire name.
    pub fn counted(&mut self, wire: &str, now: Timestamp) -> Option<f64> {
        self.advance(now);
        let motors = self.firmware.motors();
        motors.find(wire).map(|i| motors.position(i, now))
    }

    fn advance(&mut self, now: Timestamp) {
        self.now = self.now.max(now);
        self.firmware.advance(self.now);
    }
}
