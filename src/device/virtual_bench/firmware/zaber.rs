//! Zaber ASCII: addressed devices on one line, message ids, an LRC, and a state in every reply.
//!
//! A command names a device and an axis (0: all of them) and may carry an id, which the reply
//! repeats. Each reply tells whether the axis is busy and its most urgent flag: `WR` until it has
//! been homed, `FS` after a stall, `NI` when one movement interrupted another. Absolute moves before
//! homing are carried out in the firmware's invented coordinates: to refuse them is the client's
//! duty. A line with a wrong LRC is not answered. Replies carry an LRC when the command did, or when
//! `comm.checksum` is 1.
//!
//! Sources: recorded dialogue of the vendor's client; zaber.com, ASCII Protocol Manual. Not
//! emulated: lockstep, streams, triggers, joystick, continuation of long replies.

use super::motors::{Motors, PullOff};
use super::outbox::Outbox;
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::checksum::ChecksumKind;
use crate::protocol::emulation::ZaberEmulation;
use std::collections::{BTreeMap, BTreeSet};

/// Speed data is microsteps per second times this.
const SPEED_SCALE: f64 = 1.6384;

/// One axis: its motor is that of the same index in [`Motors`].
#[derive(Debug)]
struct Axis {
    device: u32,
    number: u32,
    settings: BTreeMap<String, String>,
    flags: BTreeSet<&'static str>,
    busy: Option<Timestamp>,
    homing: bool,
    /// What starts when the axis rests: the movement that interrupted another.
    next: Option<(f64, f64)>,
}

/// The emulated chain of devices.
pub struct Zaber {
    axes: Vec<Axis>,
    settings: BTreeMap<String, String>,
    motors: Motors,
    outbox: Outbox,
    line: Vec<u8>,
    t: Timestamp,
}

/// Where a command is addressed, and how its reply begins.
#[derive(Debug, Clone, Copy)]
struct Address {
    device: u32,
    axis: u32,
    id: Option<u32>,
    lrc: bool,
}

type Refusal = &'static str;

impl Zaber {
    /// A chain that is switched on at `now`.
    pub fn new(
        spec: &ZaberEmulation,
        options: &EmulatorOptions,
        motors: Motors,
        outbox: Outbox,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut settings = spec.settings.clone();
        if let Some(id) = options.identity.as_ref().and_then(|i| i.first()) {
            settings.insert("deviceid".into(), id.clone());
        }
        for (key, value) in &options.settings {
            let Some(stored) = settings.get_mut(key) else {
                let allowed = "a setting of this device";
                return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
            };
            stored.clone_from(value);
        }
        let axis = |m: &super::motors::Motor| {
            let address = m.wire.split_once('/').and_then(|(d, a)| Some((d.parse().ok()?, a.parse().ok()?)));
            let (device, number) = address.ok_or_else(|| EmulatorError::Setting {
                setting: "axis.wire".into(),
                value: m.wire.clone(),
                allowed: "device/axis, such as 1/1",
            })?;
            let mut settings = spec.axis_settings.clone();
            let data = |x: f64| (x.round() as i64).to_string();
            settings.insert("maxspeed".into(), data(m.max_feed * m.counts_per_unit * SPEED_SCALE));
            settings.insert("accel".into(), data(m.accel * m.counts_per_unit * SPEED_SCALE / 1e4));
            settings.insert("limit.min".into(), m.counts(m.min).to_string());
            settings.insert("limit.max".into(), m.counts(m.max).to_string());
            let flags = BTreeSet::from(["WR"]);
            Ok(Axis { device, number, settings, flags, busy: None, homing: false, next: None })
        };
        let axes = motors.iter().map(axis).collect::<Result<_, EmulatorError>>()?;
        Ok(Self { axes, settings, motors, outbox, line: Vec::new(), t: now })
    }

    fn take_line(&mut self, line: &[u8]) {
        let Some(body) = line.strip_prefix(b"/") else { return };
        let (body, lrc) = match body.iter().rposition(|b| *b == b':') {
            Some(i) if body.len() == i + 3 => (&body[..i], Some(&body[i + 1..])),
            _ => (body, None),
        };
        if let Some(lrc) = lrc {
            let sum = format!("{:02X}", ChecksumKind::Lrc8.of(body));
            if !sum.as_bytes().eq_ignore_ascii_case(lrc) {
                return;
            }
        }
        let text = String::from_utf8_lossy(body).into_owned();
        let mut words: Vec<&str> = text.split_ascii_whitespace().collect();
        let mut numbers = [None; 3];
        for number in &mut numbers {
            let Some(n) = words.first().and_then(|w| w.parse::<u32>().ok()) else { break };
            *number = Some(n);
            words.remove(0);
        }
        let address = Address {
            device: numbers[0].unwrap_or(0),
            axis: numbers[1].unwrap_or(0),
            id: numbers[2],
            lrc: lrc.is_some(),
        };
        let devices: BTreeSet<u32> = self
            .axes
            .iter()
            .map(|a| a.device)
            .filter(|d| address.device == 0 || *d == address.device)
            .collect();
        for device in devices {
            let address = Address { device, ..address };
            let indices: Vec<usize> = self.indices(address);
            let result =
                if indices.is_empty() { Err("BADAXIS") } else { self.command(&words, address, &indices) };
            self.reply(address, result);
        }
    }

    /// The axes that an address means.
    fn indices(&self, address: Address) -> Vec<usize> {
        let meant = |a: &Axis| a.device == address.device && (address.axis == 0 || a.number == address.axis);
        (0..self.axes.len()).filter(|i| meant(&self.axes[*i])).collect()
    }

    fn is_busy(&self, i: usize) -> bool {
        self.axes[i].busy.is_some_and(|until| self.t < until) || self.axes[i].next.is_some()
    }

    /// The most urgent flag: faults, then warnings, then notes.
    fn flag(&self, indices: &[usize]) -> &'static str {
        let urgency = |f: &&'static str| match f.as_bytes()[0] {
            b'F' => 0,
            b'W' => 1,
            _ => 2,
        };
        indices.iter().flat_map(|i| self.axes[*i].flags.iter().copied()).min_by_key(urgency).unwrap_or("--")
    }

    fn reply(&mut self, address: Address, result: Result<String, Refusal>) {
        let indices = self.indices(Address {
            axis: if self.indices(address).is_empty() { 0 } else { address.axis },
            ..address
        });
        let busy = if indices.iter().any(|i| self.is_busy(*i)) { "BUSY" } else { "IDLE" };
        let flag = self.flag(&indices);
        let id = address.id.map_or(String::new(), |id| format!(" {id:02}"));
        let (verdict, data) = match &result {
            Ok(data) => ("OK", data.as_str()),
            Err(refusal) => ("RJ", *refusal),
        };
        let body = format!("{:02} {}{id} {verdict} {busy} {flag} {data}", address.device, address.axis);
        self.say('@', &body, address.lrc);
    }

    fn say(&mut self, kind: char, body: &str, lrc: bool) {
        let always = self.settings.get("comm.checksum").is_some_and(|v| v == "1");
        let sum = format!(":{:02X}", ChecksumKind::Lrc8.of(body.as_bytes()));
        let tail = if lrc || always { sum.as_str() } else { "" };
        self.outbox.send(self.t, format!("{kind}{body}{tail}\r\n"));
    }

    fn command(&mut self, words: &[&str], address: Address, axes: &[usize]) -> Result<String, Refusal> {
        let done = Ok("0".to_owned());
        match words {
            [] => {}
            ["home"] => axes.iter().for_each(|i| self.home(*i)),
            ["stop"] => axes.iter().for_each(|i| self.stop(*i)),
            ["estop"] => axes.iter().for_each(|i| self.estop(*i)),
            ["move", how, data @ ..] => {
                for i in axes {
                    self.start_move(*i, how, data)?;
                }
            }
            ["get", "pos" | "encoder.pos"] => return Ok(self.listing(axes, |z, i| z.counts(i).to_string())),
            ["get", key] => return self.get(key, axes),
            ["set", key, value] => self.set(key, value, address, axes)?,
            ["warnings"] => {
                let flags: BTreeSet<&str> =
                    axes.iter().flat_map(|i| self.axes[*i].flags.iter().copied()).collect();
                let list: String = flags.iter().map(|f| format!(" {f}")).collect();
                return Ok(format!("{:02}{list}", flags.len()));
            }
            ["warnings", "clear"] => {
                for i in axes {
                    // What is still true comes back at once.
                    let unreferenced = !self.motors.axis(*i).referenced;
                    self.axes[*i].flags.retain(|f| *f == "WR" && unreferenced);
                }
            }
            ["system", "reset"] => {
                self.reply(address, done);
                self.restart(self.t);
                return Ok("0".into());
            }
            _ => return Err("BADCOMMAND"),
        }
        done
    }

    fn listing(&self, axes: &[usize], f: impl Fn(&Self, usize) -> String) -> String {
        axes.iter().map(|i| f(self, *i)).collect::<Vec<_>>().join(" ")
    }

    fn counts(&self, i: usize) -> i64 {
        self.motors.axis(i).counts(self.motors.position(i, self.t))
    }

    fn get(&self, key: &str, axes: &[usize]) -> Result<String, Refusal> {
        if key == "system.axiscount" {
            let device = self.axes[axes[0]].device;
            return Ok(self.axes.iter().filter(|a| a.device == device).count().to_string());
        }
        if let Some(value) = self.settings.get(key) {
            return Ok(value.clone());
        }
        if axes.iter().any(|i| !self.axes[*i].settings.contains_key(key)) {
            return Err("BADCOMMAND");
        }
        Ok(self.listing(axes, |z, i| z.axes[i].settings[key].clone()))
    }

    fn set(&mut self, key: &str, value: &str, address: Address, axes: &[usize]) -> Result<(), Refusal> {
        if address.axis == 0 && self.settings.contains_key(key) {
            self.settings.insert(key.to_owned(), value.to_owned());
            return Ok(());
        }
        let number: f64 = value.parse().map_err(|_| "BADDATA")?;
        for i in axes {
            let counts = self.motors.axis(*i).counts_per_unit;
            if key == "pos" {
                self.motors.redefine(*i, self.t, number / counts);
                continue;
            }
            let Some(stored) = self.axes[*i].settings.get_mut(key) else { return Err("BADCOMMAND") };
            value.clone_into(stored);
            let motor = self.motors.axis_mut(*i);
            match key {
                "maxspeed" if number > 0.0 => motor.max_feed = number / SPEED_SCALE / counts,
                "accel" if number > 0.0 => motor.accel = number * 1e4 / SPEED_SCALE / counts,
                "limit.min" => motor.min = number / counts,
                "limit.max" => motor.max = number / counts,
                "maxspeed" | "accel" => return Err("BADDATA"),
                _ => {}
            }
        }
        Ok(())
    }

    fn start_move(&mut self, i: usize, how: &str, data: &[&str]) -> Result<(), Refusal> {
        let motor = self.motors.axis(i);
        let number = data.first().map(|d| d.parse::<f64>().map_err(|_| "BADDATA")).transpose()?;
        let (target, feed) = match (how, number) {
            ("min", None) => (motor.min, motor.max_feed),
            ("max", None) => (motor.max, motor.max_feed),
            ("abs", Some(n)) => (n / motor.counts_per_unit, motor.max_feed),
            ("rel", Some(n)) => (self.motors.position(i, self.t) + n / motor.counts_per_unit, motor.max_feed),
            ("vel", Some(0.0)) => {
                self.stop(i);
                return Ok(());
            }
            ("vel", Some(n)) => {
                let end = if n > 0.0 { motor.max } else { motor.min };
                (end, n.abs() / SPEED_SCALE / motor.counts_per_unit)
            }
            ("abs" | "rel" | "vel", None) => return Err("BADDATA"),
            _ => return Err("BADCOMMAND"),
        };
        let half = 0.5 / motor.counts_per_unit;
        if target < motor.min - half || target > motor.max + half {
            return Err("BADDATA");
        }
        // Faults and notes end with the next move; warnings stay.
        self.axes[i].flags.retain(|f| f.starts_with('W'));
        if self.is_busy(i) {
            self.axes[i].flags.insert("NI");
            self.stop(i);
            self.axes[i].next = Some((target, feed));
        } else {
            self.go(i, target, feed);
        }
        Ok(())
    }

    fn go(&mut self, i: usize, target: f64, feed: f64) {
        let accel = self.motors.axis(i).accel;
        let arrives = self.motors.go(i, self.t, target, feed, accel);
        self.axes[i].busy = (arrives > self.t).then_some(arrives);
    }

    fn home(&mut self, i: usize) {
        let feed = 0.5 * self.motors.axis(i).max_feed;
        let until = self.motors.seek_home(i, self.t, feed, PullOff { distance: 0.0, feed });
        (self.axes[i].busy, self.axes[i].homing, self.axes[i].next) = (Some(until), true, None);
        self.settle();
    }

    fn stop(&mut self, i: usize) {
        let rests = self.motors.stop_one(i, self.t);
        let axis = &mut self.axes[i];
        (axis.busy, axis.homing, axis.next) = ((rests > self.t).then_some(rests), false, None);
    }

    /// Stops without deceleration: what moved has lost its reference.
    fn estop(&mut self, i: usize) {
        if self.motors.velocity(i, self.t) != 0.0 {
            self.motors.halt_one(i, self.t);
            self.axes[i].flags.insert("WR");
        }
        let axis = &mut self.axes[i];
        (axis.busy, axis.homing, axis.next) = (None, false, None);
    }

    /// Ends what is over: homing sets the reference, an interrupting move begins, alerts are sent.
    fn settle(&mut self) {
        for i in 0..self.axes.len() {
            if self.axes[i].busy.is_none_or(|until| until > self.t) {
                continue;
            }
            self.axes[i].busy = None;
            if std::mem::take(&mut self.axes[i].homing) {
                self.motors.set_home(i);
                self.axes[i].flags.clear();
            }
            match self.axes[i].next.take() {
                Some((target, feed)) => self.go(i, target, feed),
                None => self.alert(i),
            }
        }
    }

    fn alert(&mut self, i: usize) {
        if self.settings.get("comm.alert").is_some_and(|v| v == "1") {
            let flag = self.flag(&[i]);
            let body = format!("{:02} {} IDLE {flag}", self.axes[i].device, self.axes[i].number);
            self.say('!', &body, false);
        }
    }
}

impl Firmware for Zaber {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    self.take_line(&line);
                }
                // A new command begins wherever a slash is: what came before was torn.
                b'/' => self.line = vec![b'/'],
                _ if self.line.len() < 256 => self.line.push(*byte),
                _ => {}
            }
        }
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(t) = self.deadline().filter(|t| *t <= now) {
            self.t = self.t.max(t);
            self.settle();
        }
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        self.axes.iter().filter_map(|a| a.busy).min()
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.power_up(now);
        self.line.clear();
        for axis in &mut self.axes {
            axis.flags = BTreeSet::from(["WR"]);
            (axis.busy, axis.homing, axis.next) = (None, false, None);
        }
    }

    /// The axis stalls: it stops, and neither it nor anybody knows where.
    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        for i in 0..self.axes.len() {
            if self.motors.velocity(i, now) != 0.0 {
                self.estop(i);
                self.axes[i].flags.insert("FS");
            }
        }
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}
