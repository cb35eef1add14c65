//! A line protocol emulated from rules alone, so that a new device needs no Rust.
//!
//! A rule is a pattern for a line, the states in which it is allowed, verbs of a closed set that it
//! performs, and a reply with placeholders. The group `axis` of the pattern names the axis by its
//! wire name. A line without it is for all axes: every one performs it, `{error}` is the first that any of them has,
//! and the other placeholders are the first axis's. What is refused leaves an error behind, which a reply shows as
//! `{error}` and so clears.
//!
//! Placeholders of a reply: `{axis}`, `{position}`, `{feed}`, `{state}`, `{error}`, `{identity}`.

use super::motors::{Motors, PullOff};
use super::outbox::Outbox;
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::emulation::{Rule, RuleState, RuleVerb, RulesEmulation};
use crate::protocol::value::Fields;

/// The emulated controllers, one for each axis, on one line.
pub struct Rules {
    spec: RulesEmulation,
    motors: Motors,
    outbox: Outbox,
    axes: Vec<Axis>,
    line: Vec<u8>,
    t: Timestamp,
}

#[derive(Debug, Clone)]
struct Axis {
    until: Option<Timestamp>,
    homing: bool,
    error: String,
}

impl Rules {
    /// Controllers that are switched on at `now`.
    pub fn new(
        spec: &RulesEmulation,
        options: &EmulatorOptions,
        motors: Motors,
        outbox: Outbox,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut spec = spec.clone();
        if let Some(identity) = options.identity.as_ref().and_then(|i| i.first()) {
            spec.identity.clone_from(identity);
        }
        if let Some((key, value)) = options.settings.iter().next() {
            let allowed = "a setting (a device made of rules stores none)";
            return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
        }
        let axis = Axis { until: None, homing: false, error: spec.no_error.clone() };
        let axes = vec![axis; motors.count()];
        Ok(Self { spec, motors, outbox, axes, line: Vec::new(), t: now })
    }

    fn state(&self, i: usize) -> RuleState {
        match self.axes[i] {
            Axis { until: Some(_), homing: true, .. } => RuleState::Homing,
            Axis { until: Some(_), .. } => RuleState::Moving,
            _ if !self.motors.axis(i).referenced => RuleState::Unreferenced,
            _ => RuleState::Idle,
        }
    }

    fn take_line(&mut self, line: &[u8]) {
        let found = self.spec.rule.iter().find_map(|r| Some((r.clone(), r.matches.captures(line)?)));
        let Some((rule, fields)) = found else {
            let unknown = self.spec.unknown.clone();
            return self.axes.iter_mut().for_each(|a| a.error.clone_from(&unknown));
        };
        let axes = match fields.get("axis") {
            Some(wire) => match self.motors.find(&wire.to_text()) {
                Some(i) => i..i + 1,
                None => return,
            },
            None => 0..self.axes.len(),
        };
        for i in axes.clone() {
            if let Err(refusal) = self.perform(&rule, &fields, i) {
                self.axes[i].error = refusal;
            }
        }
        if let Some(template) = &rule.reply {
            let has_error = |i: &usize| self.axes[*i].error != self.spec.no_error;
            let error_of = axes.clone().find(has_error).unwrap_or(axes.start);
            let reply = self.fill(template, axes.start, error_of);
            self.outbox.send(self.t, format!("{reply}{}", self.spec.eol));
        }
    }

    fn perform(&mut self, rule: &Rule, fields: &Fields, i: usize) -> Result<(), String> {
        if let Some(refusal) = rule.refuse.get(&self.state(i)) {
            return Err(refusal.clone());
        }
        for verb in &rule.does {
            let number = |group: &str| {
                fields.get(group).and_then(|v| v.as_f64()).ok_or_else(|| self.spec.out_of_range.clone())
            };
            match verb {
                RuleVerb::MoveTo(group) => self.go(i, number(group)?)?,
                RuleVerb::MoveBy(group) => self.go(i, self.motors.position(i, self.t) + number(group)?)?,
                RuleVerb::Home => {
                    let feed = 0.5 * self.motors.axis(i).max_feed;
                    let until = self.motors.seek_home(i, self.t, feed, PullOff { distance: 0.0, feed });
                    (self.axes[i].until, self.axes[i].homing) = (Some(until), true);
                }
                RuleVerb::Stop => {
                    if self.axes[i].until.is_some() {
                        self.axes[i].until = Some(self.motors.stop_one(i, self.t));
                        self.axes[i].homing = false;
                    }
                }
                RuleVerb::Reset => {
                    self.motors.halt_one(i, self.t);
                    self.motors.axis_mut(i).referenced = false;
                    self.axes[i].until = None;
                }
                RuleVerb::SetFeed(group) => {
                    let feed = number(group)?;
                    if !(feed > 0.0 && feed <= self.spec.max_feed) {
                        return Err(self.spec.out_of_range.clone());
                    }
                    self.motors.axis_mut(i).max_feed = feed;
                }
            }
        }
        Ok(())
    }

    fn go(&mut self, i: usize, target: f64) -> Result<(), String> {
        let motor = self.motors.axis(i);
        if !(target >= motor.min && target <= motor.max) {
            return Err(self.spec.out_of_range.clone());
        }
        let (feed, accel) = (motor.max_feed, motor.accel);
        let until = self.motors.go(i, self.t, target, feed, accel);
        self.axes[i].until = (until > self.t).then_some(until);
        Ok(())
    }

    fn fill(&mut self, template: &str, i: usize, error_of: usize) -> String {
        let state = self.spec.states.get(&self.state(i)).cloned().unwrap_or_default();
        let motor = self.motors.axis(i);
        let position = motor.snap(self.motors.position(i, self.t)) + 0.0;
        let mut text = template
            .replace("{axis}", &motor.wire)
            .replace("{position}", &format!("{position:.*}", self.spec.decimals))
            .replace("{feed}", &format!("{:.*}", self.spec.decimals, motor.max_feed))
            .replace("{identity}", &self.spec.identity)
            .replace("{state}", &state);
        if text.contains("{error}") {
            let error = std::mem::replace(&mut self.axes[error_of].error, self.spec.no_error.clone());
            text = text.replace("{error}", &error);
        }
        text
    }
}

impl Firmware for Rules {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    if !line.is_empty() {
                        self.take_line(&line);
                    }
                }
                _ if self.line.len() < 256 => self.line.push(*byte),
                _ => {}
            }
        }
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(t) = self.deadline().filter(|t| *t <= now) {
            self.t = self.t.max(t);
            for i in 0..self.axes.len() {
                if self.axes[i].until.is_some_and(|until| until <= self.t) {
                    self.axes[i].until = None;
                    if std::mem::take(&mut self.axes[i].homing) {
                        self.motors.set_home(i);
                    }
                }
            }
        }
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        self.axes.iter().filter_map(|a| a.until).min()
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.power_up(now);
        self.line.clear();
        for axis in &mut self.axes {
            *axis = Axis { until: None, homing: false, error: self.spec.no_error.clone() };
        }
    }

    /// A limit switch: everything stops and has to be homed again.
    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.halt(now);
        self.axes.iter_mut().for_each(|a| (a.until, a.homing) = (None, false));
        self.motors.iter_mut().for_each(|m| m.referenced = false);
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}
