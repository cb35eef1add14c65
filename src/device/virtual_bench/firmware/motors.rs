//! The axes of an emulated machine: where its counters say they are, and where they truly are.
//!
//! The world holds true positions; a motor adds its *slip*, the difference to what the firmware
//! counts. It is what power-up leaves unknown, what an abrupt stop changes (the axis runs out
//! further than the counter), and what homing sets to zero.

use super::super::world::World;
use super::EmulatorOptions;
use crate::clock::Timestamp;
use crate::device::settings::AxisSettings;
use crate::motion::Profile;
use crate::protocol::emulation::{EmulatedAxis, HomeEnd};
use std::collections::BTreeMap;

/// One axis of the firmware.
#[derive(Debug, Clone)]
pub struct Motor {
    /// Name on the wire.
    pub wire: String,
    /// Lowest position.
    pub min: f64,
    /// Highest position.
    pub max: f64,
    /// Fastest feed, per second.
    pub max_feed: f64,
    /// Acceleration, per second squared.
    pub accel: f64,
    /// Counts per unit.
    pub counts_per_unit: f64,
    /// Which end homes.
    pub home: HomeEnd,
    /// Whether it has been homed since power-up or the last loss of steps.
    pub referenced: bool,
    key: String,
    slip: f64,
    /// Until then the counter stands still although the axis runs out.
    frozen: (Timestamp, f64),
}

impl Motor {
    /// Position of the home switch.
    pub fn switch(&self) -> f64 {
        match self.home {
            HomeEnd::Min => self.min,
            HomeEnd::Max => self.max,
        }
    }

    /// Direction from the switch into the travel.
    pub fn inward(&self) -> f64 {
        match self.home {
            HomeEnd::Min => 1.0,
            HomeEnd::Max => -1.0,
        }
    }

    /// The nearest position that is a whole number of counts.
    pub fn snap(&self, position: f64) -> f64 {
        (position * self.counts_per_unit).round() / self.counts_per_unit
    }

    /// A position as counts.
    pub fn counts(&self, position: f64) -> i64 {
        (position * self.counts_per_unit).round() as i64
    }
}

/// All axes of one machine.
pub struct Motors {
    device: String,
    world: World,
    axes: Vec<Motor>,
}

impl Motors {
    /// The firmware's axes, those that the rig wires with the rig's own travel, in the world.
    pub fn new(
        device: &str,
        firmware: &[EmulatedAxis],
        rig: &BTreeMap<String, AxisSettings>,
        options: &EmulatorOptions,
        world: World,
    ) -> Self {
        let motor = |spec: &EmulatedAxis| {
            let wired = rig.iter().find(|(_, axis)| axis.wire == spec.wire);
            let mut motor = Motor {
                wire: spec.wire.clone(),
                min: spec.min,
                max: spec.max,
                max_feed: spec.max_feed,
                accel: spec.accel,
                counts_per_unit: spec.counts_per_unit,
                home: *options.home.get(&spec.wire).unwrap_or(&spec.home),
                referenced: false,
                key: format!("wire {}", spec.wire),
                slip: 0.0,
                frozen: (Timestamp(i64::MIN), 0.0),
            };
            if let Some((name, axis)) = wired {
                motor.key = name.clone();
                (motor.min, motor.max) = (axis.min, axis.max);
                (motor.max_feed, motor.accel) = (axis.max_feed, axis.accel);
                motor.counts_per_unit = axis.counts_per_unit.unwrap_or(spec.counts_per_unit);
            }
            motor
        };
        let mut axes: Vec<Motor> = firmware.iter().map(motor).collect();
        for motor in &mut axes {
            // Power-up near the switch: as far from harm as an unknown position can be.
            let near = motor.switch() + motor.inward() * 0.1 * (motor.max - motor.min);
            let at = options.power_on.get(&motor.wire).copied().unwrap_or(near);
            motor.slip = at - options.counter.get(&motor.wire).copied().unwrap_or(0.0);
            world.place(device, &motor.key, at);
        }
        Self { device: device.to_owned(), world, axes }
    }

    /// How many axes there are.
    pub fn count(&self) -> usize {
        self.axes.len()
    }

    /// One axis.
    pub fn axis(&self, i: usize) -> &Motor {
        &self.axes[i]
    }

    /// One axis, to change its limits and feeds.
    pub fn axis_mut(&mut self, i: usize) -> &mut Motor {
        &mut self.axes[i]
    }

    /// All axes, in the firmware's order.
    pub fn iter(&self) -> impl Iterator<Item = &Motor> {
        self.axes.iter()
    }

    /// All axes, to change their limits and feeds.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Motor> {
        self.axes.iter_mut()
    }

    /// Index of the axis of that name on the wire.
    pub fn find(&self, wire: &str) -> Option<usize> {
        self.axes.iter().position(|m| m.wire == wire)
    }

    /// What the firmware counts.
    pub fn position(&self, i: usize, t: Timestamp) -> f64 {
        match self.axes[i].frozen {
            (until, counter) if t < until => counter,
            _ => self.true_position(i, t) - self.axes[i].slip,
        }
    }

    /// What the firmware counts, for all axes.
    pub fn positions(&self, t: Timestamp) -> Vec<f64> {
        (0..self.count()).map(|i| self.position(i, t)).collect()
    }

    /// Where the axis truly is.
    pub fn true_position(&self, i: usize, t: Timestamp) -> f64 {
        self.world.position(&self.device, &self.axes[i].key, t)
    }

    /// Velocity of one axis.
    pub fn velocity(&self, i: usize, t: Timestamp) -> f64 {
        self.world.velocity(&self.device, &self.axes[i].key, t)
    }

    /// Speed along the path.
    pub fn speed(&self, t: Timestamp) -> f64 {
        (0..self.count()).map(|i| self.velocity(i, t).powi(2)).sum::<f64>().sqrt()
    }

    /// Declares the present position to be `counter`.
    pub fn redefine(&mut self, i: usize, t: Timestamp, counter: f64) {
        self.axes[i].slip = self.true_position(i, t) - counter;
    }

    /// Moves one axis alone; one that moves decelerates first. Returns when it arrives.
    pub fn go(&mut self, i: usize, t: Timestamp, target: f64, feed: f64, accel: f64) -> Timestamp {
        let rests = if self.velocity(i, t) == 0.0 { t } else { self.stop_one(i, t) };
        let profile = Profile::new(self.position(i, rests), self.axes[i].snap(target), feed, accel);
        self.follow(i, rests, profile)
    }

    fn follow(&self, i: usize, t: Timestamp, profile: Profile) -> Timestamp {
        let motor = &self.axes[i];
        self.world.follow(&self.device, &motor.key, t, profile.shifted(motor.slip));
        t.after(profile.duration())
    }

    /// Moves all axes along a straight line, `feed` along the path, no axis faster than it can;
    /// returns when they arrive.
    pub fn line(&mut self, t: Timestamp, target: &[f64], feed: f64) -> Timestamp {
        let from = self.positions(t);
        let to: Vec<f64> = self.axes.iter().zip(target).map(|(m, x)| m.snap(*x)).collect();
        let length = from.iter().zip(&to).map(|(a, b)| (b - a).powi(2)).sum::<f64>().sqrt();
        if length < 1e-9 {
            return t;
        }
        let share: Vec<f64> = from.iter().zip(&to).map(|(a, b)| (b - a).abs() / length).collect();
        let (mut feed, mut accel) = (feed, f64::INFINITY);
        for (motor, share) in self.axes.iter().zip(&share).filter(|(_, s)| **s > 1e-9) {
            feed = feed.min(motor.max_feed / share);
            accel = accel.min(motor.accel / share);
        }
        let mut end = t;
        for i in 0..self.count() {
            if share[i] > 1e-9 {
                let profile = Profile::new(from[i], to[i], feed * share[i], accel * share[i]);
                end = end.max(self.follow(i, t, profile));
            }
        }
        end
    }

    /// Decelerates all axes to rest; returns when they rest.
    pub fn stop(&mut self, t: Timestamp) -> Timestamp {
        self.axes.iter().map(|m| self.world.stop(&self.device, &m.key, t)).max().unwrap_or(t)
    }

    /// Decelerates one axis to rest; returns when it rests.
    pub fn stop_one(&mut self, i: usize, t: Timestamp) -> Timestamp {
        self.world.stop(&self.device, &self.axes[i].key, t)
    }

    /// Stops the pulses at once. The counters stay where they are; what moves runs out, so true
    /// positions are lost for every axis that was moving.
    pub fn halt(&mut self, t: Timestamp) {
        (0..self.count()).for_each(|i| self.halt_one(i, t));
    }

    /// As [`Motors::halt`], for one axis.
    pub fn halt_one(&mut self, i: usize, t: Timestamp) {
        if self.velocity(i, t) != 0.0 {
            let counter = self.axes[i].snap(self.position(i, t));
            self.halt_at(i, t, counter);
            self.axes[i].referenced = false;
        }
    }

    /// Lets an axis run out while its counter says `counter`.
    fn halt_at(&mut self, i: usize, t: Timestamp, counter: f64) {
        let rest = self.world.stop(&self.device, &self.axes[i].key, t);
        self.axes[i].slip = self.true_position(i, rest) - counter;
        self.axes[i].frozen = (rest, counter);
    }

    /// What switching on again does: nothing moves, and every counter starts from zero wherever its
    /// axis is.
    pub fn power_up(&mut self, t: Timestamp) {
        for i in 0..self.count() {
            self.halt_at(i, t, 0.0);
            self.axes[i].referenced = false;
        }
    }

    /// Seeks the switch, then backs off; the counters mean nothing until [`Motors::set_home`].
    /// Returns when it is done.
    pub fn seek_home(&mut self, i: usize, t: Timestamp, seek_feed: f64, pull_off: PullOff) -> Timestamp {
        let motor = &self.axes[i];
        let (device, key, switch) = (&self.device, &motor.key, motor.switch());
        let seek = Profile::new(self.true_position(i, t), switch, seek_feed, motor.accel);
        self.world.follow(device, key, t, seek);
        let touched = t.after(seek.duration());
        if pull_off.distance == 0.0 {
            return touched;
        }
        let back = switch + motor.inward() * pull_off.distance;
        let off = Profile::new(switch, back, pull_off.feed, motor.accel);
        self.world.follow(device, key, touched, off);
        touched.after(off.duration())
    }

    /// Homing of a machine that ends somewhere else than at a switch: to a true position.
    pub fn go_truly(&mut self, i: usize, t: Timestamp, target: f64, feed: f64) -> Timestamp {
        let profile = Profile::new(self.true_position(i, t), target, feed, self.axes[i].accel);
        self.world.follow(&self.device, &self.axes[i].key, t, profile);
        t.after(profile.duration())
    }

    /// Ends homing: counter and truth agree again.
    pub fn set_home(&mut self, i: usize) {
        self.axes[i].slip = 0.0;
        self.axes[i].referenced = true;
    }

    /// Displaces the true position against the counter: steps lost to a collision.
    pub fn lose(&mut self, i: usize, t: Timestamp, by: f64) {
        let at = self.true_position(i, t) + by;
        self.world.follow(&self.device, &self.axes[i].key, t, Profile::at_rest(at));
        self.axes[i].slip += by;
    }
}

/// How far and how fast an axis leaves its switch after homing.
#[derive(Debug, Clone, Copy)]
pub struct PullOff {
    /// Distance, mm or degrees.
    pub distance: f64,
    /// Feed, per second.
    pub feed: f64,
}
