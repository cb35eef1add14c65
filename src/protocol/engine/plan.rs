//! From a request to the acts that fulfil it; whatever cannot be written is refused here, before
//! anything is sent.

use super::task::{Act, Address, Move, Task, expand};
use super::*;
use crate::protocol::encode::encode;
use crate::protocol::template::{Template, decimal};

impl Engine {
    /// A request as a sequence of acts.
    pub(super) fn plan(&self, ticket: Ticket, request: Request) -> Result<Task, Failure> {
        let plain = |act| Move { act, optional: false, retry: 0, back: 0 };
        let send = |(name, axis, fields): Address| {
            plain(Act::Send { name, axis, fields, or_send: None, timeout: None })
        };
        let acts = match request {
            Request::Command { name, fields, axis } => {
                let mut acts = Vec::new();
                for (name, at, mut address) in self.addresses(&name) {
                    if axis.is_none_or(|wanted| at == Some(wanted)) || at.is_none() {
                        address.extend(fields.clone());
                        self.validate(&name, &address)?;
                        acts.push(send((name, at, address)));
                    }
                }
                acts
            }
            Request::Wake => match &self.spec.link.wake {
                Some(_) => {
                    let banner = self.spec.rx.iter().find(|rx| rx.role == Role::Banner);
                    let class = banner.map(|rx| rx.class.clone()).unwrap_or_default();
                    let timeout = self.spec.link.banner_timeout_ms.unwrap_or(3000);
                    let expect = Act::Expect { class, timeout };
                    // A board that was starting anyway introduces itself twice.
                    let expect = Move { act: expect, optional: false, retry: 2, back: 1 };
                    vec![plain(Act::Wake), expect, plain(Act::Sleep(200))]
                }
                None => Vec::new(),
            },
            Request::Identify => {
                let name = self.spec.protocol.identify.clone();
                name.map_or_else(Vec::new, |n| self.addresses(&n).into_iter().map(send).collect())
            }
            Request::Move { targets, feed, jog } => {
                let here: Vec<Option<f64>> = self.positions().iter().map(|p| p.map(|p| p.value)).collect();
                self.plan_move(&targets, feed, jog, &here)?.into_iter().map(send).collect()
            }
            Request::Settle { stall, expected } => vec![plain(Act::Settle { stall, expected })],
            // A question whose answer is lost may be asked again.
            Request::Position => vec![Move { act: Act::AskPositions, optional: false, retry: 2, back: 0 }],
            Request::Run(which) => return Ok(self.plan_procedure(ticket, &which)),
        };
        Ok(Task::new(ticket, acts))
    }

    /// A stop whose first `sent` steps are on the wire already.
    pub(super) fn plan_stop(&self, ticket: Ticket, procedure: &Procedure, sent: usize) -> Task {
        let mut acts = Vec::new();
        for (i, step) in procedure.steps.iter().enumerate() {
            let mut expanded = expand(step, &|name| self.addresses(name));
            if i < sent {
                expanded.retain(|m| !matches!(m.act, Act::Send { .. } | Act::Realtime(_)));
                // Begun again, if it must be, from the wait alone.
                expanded.iter_mut().for_each(|m| (m.retry, m.back) = (0, 0));
            }
            acts.extend(expanded);
        }
        let mut task = Task::new(ticket, acts);
        task.survives_alarm = true;
        task
    }

    fn plan_procedure(&self, ticket: Ticket, which: &Which) -> Task {
        let none = Procedure::default();
        let procedure = match which {
            Which::Init => &self.spec.init,
            Which::Home => &self.spec.home,
            Which::JogCancel => self.spec.motion.jog_cancel.as_ref().unwrap_or(&none),
            Which::Recover(name) => self.spec.recover.get(name).unwrap_or(&none),
        };
        let acts = procedure.steps.iter().flat_map(|s| expand(s, &|name| self.addresses(name))).collect();
        let mut task = Task::new(ticket, acts);
        task.survives_alarm = matches!(which, Which::Recover(_));
        task.trust = procedure.trust;
        task.homes = *which == Which::Home;
        task
    }

    /// Where a command goes: once, or once to each axis.
    pub(super) fn addresses(&self, name: &str) -> Vec<Address> {
        match self.spec.cmd.get(name).map(|c| c.scope) {
            Some(Scope::Axis) => {
                let each = self.groups.iter().enumerate();
                each.map(|(i, fields)| (name.to_owned(), Some(i), fields.clone())).collect()
            }
            _ => vec![(name.to_owned(), None, self.device_fields(Fields::new()))],
        }
    }

    /// Refuses what cannot be written, or not in this state, before anything is sent.
    pub(super) fn validate(&self, name: &str, fields: &Fields) -> Result<(), Failure> {
        let mut trial = fields.clone();
        if let Some(id) = &self.spec.flow.id {
            trial.insert(id.field.clone(), Value::Int(i64::from(id.max)));
        }
        trial.entry("n".to_owned()).or_insert(Value::Int(1));
        encode(&self.spec, name, &trial, None)?;
        let pre = &self.spec.cmd[name].pre;
        match self.state() {
            Some(state) if !pre.is_empty() && !pre.contains(&state) => {
                Err(Failure::WrongState { command: name.to_owned(), state })
            }
            _ => Ok(()),
        }
    }

    /// The commands of a move, all written once on trial, so that either all can be sent or none is. `here` is where
    /// the axes are, as far as it is known.
    pub(super) fn plan_move(
        &self,
        targets: &[(usize, f64)],
        feed: f64,
        jog: bool,
        here: &[Option<f64>],
    ) -> Result<Vec<Address>, Failure> {
        let names = if jog && !self.spec.motion.jog.is_empty() {
            &self.spec.motion.jog
        } else {
            &self.spec.motion.go
        };
        let axis = &self.spec.axis;
        let numbers = |at: usize, target: f64, feed: f64| {
            let mut fields = self.groups[at].clone();
            let scale = self.axes[at].counts_per_unit.unwrap_or(1.0);
            fields.insert("pos".to_owned(), Value::Text(decimal(target, axis.decimals).unwrap_or_default()));
            fields.insert("counts".to_owned(), Value::Int((target * scale).round() as i64));
            let counts = feed * scale.abs() * axis.feed_counts_scale;
            fields.insert("feed_counts".to_owned(), Value::Int(counts.round().max(1.0) as i64));
            fields.insert("feed".to_owned(), Value::Num(feed * axis.feed_scale));
            // As a whole number it is never 0, which to many means as fast as they can.
            let whole = (feed * axis.feed_scale).round().max(1.0);
            fields.insert("feed_whole".to_owned(), Value::Int(whole as i64));
            if let Some(accel) = self.axes[at].accel {
                let counts = (accel * scale.abs() * axis.accel_counts_scale).round().max(1.0);
                fields.insert("accel_counts".to_owned(), Value::Int(counts as i64));
                fields.insert("accel".to_owned(), Value::Num(accel));
            }
            fields
        };
        let field = |reason: String| EncodeError::Field { command: "move".to_owned(), reason };
        if let Some((_, target)) = targets.iter().find(|(_, t)| !t.is_finite()) {
            return Err(field(format!("target {target} is not a number")).into());
        }
        if !(feed.is_finite() && feed > 0.0) {
            return Err(field(format!("feed {feed} is not positive")).into());
        }
        // Axes that a whole pose needs beside those asked for stay where they are.
        let mut whole = targets.to_vec();
        if self.spec.motion.whole_pose {
            for (at, reading) in here.iter().enumerate() {
                if !whole.iter().any(|(i, _)| *i == at) {
                    let here = reading.ok_or_else(|| {
                        field(format!("the position of {} is not known", self.axes[at].name))
                    })?;
                    whole.push((at, here));
                }
            }
            whole.sort_by_key(|(i, _)| *i);
        }
        let word = match &axis.word {
            Some(word) => word.clone(),
            None => Template::parse("{letter}{pos}").expect("the default word is a template"),
        };
        let mut sends = Vec::new();
        for name in names {
            match self.spec.cmd[name].scope {
                Scope::Axis => {
                    let feeds = shares(&whole, here).into_iter().map(|share| feed * share);
                    let each = whole.iter().zip(feeds);
                    sends.extend(
                        each.map(|((at, t), feed)| (name.clone(), Some(*at), numbers(*at, *t, feed))),
                    );
                }
                Scope::Device => {
                    let mut fields = self.device_fields(Fields::new());
                    let mut words = Vec::new();
                    for (at, target) in &whole {
                        let own = numbers(*at, *target, feed);
                        // Binary protocols have words of their own: a field named like the axis; and a
                        // command that goes with a move, such as a question for errors, names none.
                        let names_axes = |tx: &Template| tx.names().any(|field| field == "axes");
                        if self.spec.cmd[name].tx.as_ref().is_some_and(names_axes) {
                            words.push(word.fill(&own).map_err(field)?);
                        }
                        fields.insert(self.axes[*at].wire.clone(), Value::Num(*target));
                    }
                    fields.insert("axes".to_owned(), Value::Text(words.join(" ")));
                    fields.insert("feed".to_owned(), Value::Num(feed * axis.feed_scale));
                    // Along a line no axis may be hurried more than it bears.
                    let accel = targets.iter().filter_map(|(at, _)| self.axes[*at].accel).reduce(f64::min);
                    fields.extend(accel.map(|a| ("accel".to_owned(), Value::Num(a))));
                    sends.push((name.clone(), None, fields));
                }
            }
        }
        for (name, _, fields) in &sends {
            self.validate(name, fields)?;
        }
        Ok(sends)
    }
}

/// What each axis gets of the feed along a line where every one is told its own: then all arrive together, and the
/// line is straight. One alone has all of it, and so has each while it is not known where they are.
fn shares(targets: &[(usize, f64)], here: &[Option<f64>]) -> Vec<f64> {
    let way = |(at, target): &(usize, f64)| Some((target - here.get(*at).copied().flatten()?).abs());
    let ways: Option<Vec<f64>> = targets.iter().map(way).collect();
    let Some(ways) = ways.filter(|ways| ways.len() > 1) else { return vec![1.0; targets.len()] };
    let length = ways.iter().map(|way| way * way).sum::<f64>().sqrt();
    // What hardly moves need not crawl, should it be elsewhere than was thought.
    ways.iter().map(|way| if length > 0.0 { (way / length).max(SLOWEST_SHARE) } else { 1.0 }).collect()
}

/// Smallest share of a feed that an axis gets.
const SLOWEST_SHARE: f64 = 0.01;
