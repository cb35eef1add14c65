//! Positions as the device reports them: lists or single values, counts or units, machine or work.
//!
//! Firmwares that report work positions send their offset only now and then; the last one is kept
//! and forgotten when the device restarts.

use super::AxisWire;
use crate::clock::Timestamp;
use crate::protocol::classify::Reply;
use crate::protocol::spec::{PositionFrom, Spec};
use crate::protocol::template::Template;
use crate::protocol::value::{Fields, Value};
use crate::units::Steps;

/// One axis as reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Position in mm or degrees.
    pub value: f64,
    /// The device's own counts, where it reports them.
    pub counts: Option<Steps>,
    /// When it was received.
    pub at: Timestamp,
}

#[derive(Debug)]
struct Axis {
    /// Place in lists.
    index: Option<usize>,
    /// Names of this axis' fields in replies.
    value_field: Option<String>,
    counts_field: Option<String>,
    counts_per_unit: f64,
    reading: Option<Reading>,
}

/// The last reading of each axis.
#[derive(Debug)]
pub(super) struct Positions {
    axes: Vec<Axis>,
    offset: Option<Vec<f64>>,
}

impl Positions {
    pub(super) fn new(spec: &Spec, axes: &[AxisWire], groups: &[Fields]) -> Self {
        let fill = |template: &String, fields: &Fields| {
            Template::parse(template).ok().and_then(|t| t.fill(fields).ok())
        };
        let axes = axes.iter().zip(groups).map(|(axis, fields)| {
            let (value_field, counts_field) = match &spec.position.from {
                PositionFrom::Named { value, counts } => {
                    (fill(value, fields), counts.as_ref().and_then(|c| fill(c, fields)))
                }
                PositionFrom::Single(name) => (Some(name.clone()), None),
                PositionFrom::Lists { .. } => (None, None),
            };
            Axis {
                index: spec.axis.order.iter().position(|w| *w == axis.wire),
                value_field,
                counts_field,
                counts_per_unit: axis.counts_per_unit.unwrap_or(1.0),
                reading: None,
            }
        });
        Positions { axes: axes.collect(), offset: None }
    }

    pub(super) fn readings(&self) -> Vec<Option<Reading>> {
        self.axes.iter().map(|a| a.reading).collect()
    }

    pub(super) fn forget_offset(&mut self) {
        self.offset = None;
    }

    /// Takes what a reply tells; true when a position changed.
    pub(super) fn take_in(
        &mut self,
        spec: &Spec,
        reply: &Reply,
        axis: Option<usize>,
        command: Option<&str>,
        now: Timestamp,
    ) -> bool {
        if reply.class != spec.position.class {
            return false;
        }
        let list = |name: &String| reply.fields.get(name).and_then(Value::as_list);
        let mut changed = false;
        match &spec.position.from {
            PositionFrom::Lists { machine, work, offset } => {
                if let Some(offset) = offset.as_ref().and_then(list) {
                    self.offset = Some(offset);
                }
                let work = work.as_ref().and_then(list);
                let from_work = || {
                    let (work, offset) = (work?, self.offset.as_ref()?);
                    Some(work.iter().zip(offset).map(|(w, o)| w + o).collect::<Vec<f64>>())
                };
                let Some(values) = list(machine).or_else(from_work) else { return false };
                for axis in &mut self.axes {
                    if let Some(value) = axis.index.and_then(|i| values.get(i)) {
                        changed |= axis.update(*value, None, spec.position.counts, now);
                    }
                }
            }
            PositionFrom::Named { .. } => {
                for axis in &mut self.axes {
                    let number = |name: &Option<String>| name.as_ref().and_then(|n| reply.fields.get(n));
                    let counts = number(&axis.counts_field).and_then(Value::as_i64);
                    if let Some(value) = number(&axis.value_field).and_then(Value::as_f64) {
                        changed |= axis.update(value, counts, spec.position.counts, now);
                    }
                }
            }
            PositionFrom::Single(name) => {
                let asked = spec.position.command.is_none() || spec.position.command.as_deref() == command;
                let axis = axis.and_then(|i| self.axes.get_mut(i)).filter(|_| asked);
                if let (Some(axis), Some(value)) = (axis, reply.number(name)) {
                    changed = axis.update(value, None, spec.position.counts, now);
                }
            }
        }
        changed
    }
}

impl Axis {
    fn update(&mut self, raw: f64, counts: Option<i64>, in_counts: bool, now: Timestamp) -> bool {
        let (value, counts) = if in_counts {
            (raw / self.counts_per_unit, Some(Steps(raw.round() as i64)))
        } else {
            (raw, counts.map(Steps))
        };
        let changed = self.reading.is_none_or(|r| r.value != value || r.counts != counts);
        self.reading = Some(Reading { value, counts, at: now });
        changed
    }
}
