//! What a reply means for state, position and trust: banners, alarms, flags, and the tables that devices tell themselves.

use super::*;
use crate::protocol::classify::{says_unreferenced, state_of};

/// Why trust is lost where the state itself says so.
const UNREFERENCED: &str = "the device says that its positions are not valid";

impl Engine {
    /// What a reply means.
    pub(super) fn take_in(&mut self, reply: Reply, now: Timestamp) {
        // Between reset and banner only the banner, an alarm and events are about the present.
        if self.deaf && !matches!(reply.role, Role::Banner | Role::Alarm | Role::Event | Role::Info) {
            self.note(format!("ignored until the banner: {}", reply.raw));
            return;
        }
        let axis = self.exchange.axis_of(&reply);
        self.classes_seen.push(reply.clone());
        match reply.role {
            Role::Banner => self.on_banner(&reply, now),
            Role::Alarm => self.on_alarm(&reply),
            _ => {}
        }
        if let Some((state, sub)) = state_of(&self.spec, &reply.fields) {
            self.state_reports += 1;
            self.sub_state = sub;
            match axis {
                Some(i) => self.states[i] = Some(state),
                None => self.states.fill(Some(state)),
            }
        }
        if let Some(says) = says_unreferenced(&self.spec, &reply.fields) {
            let told = &mut self.unreferenced[axis.map_or(0..self.axes.len(), |i| i..i + 1)];
            let begins = says && told.contains(&false);
            told.fill(says);
            if begins {
                self.events.push(Event::TrustLost(UNREFERENCED.to_owned()));
            }
        }
        let from = self.exchange.command_of(&reply);
        if self.positions.take_in(&self.spec, &reply, axis, from.as_deref(), now) {
            self.exchange.progress(now);
        }
        if let Some(index) =
            self.spec.done.field.as_ref().and_then(|f| reply.fields.get(f)).and_then(Value::as_i64)
            && from.as_ref().is_some_and(|cmd| self.spec.cmd.get(cmd).is_some_and(|c| c.moves))
        {
            self.queue_index = Some(index);
        }
        self.on_flag(&reply);
        self.learn_tables(&reply);
        if let Some(name) = self.spec.class(&reply.class).and_then(|rx| rx.then.clone()) {
            self.exchange.send_aside(&name, self.device_fields(Fields::new()));
        }
        let finished = self.exchange.take_in(&reply, now, &self.errors);
        self.finish_commands(finished);
    }

    fn on_banner(&mut self, reply: &Reply, now: Timestamp) {
        let expected =
            !self.live || self.deaf || self.banner_expected_until.is_some_and(|until| now <= until);
        self.deaf = false;
        self.mute = false;
        self.banner = Some(reply.raw.clone());
        self.positions.forget_offset();
        self.states.fill(None);
        let in_flight = self.exchange.restarted();
        self.events.push(Event::Banner { text: reply.raw.clone(), expected });
        let failure = Failure::Restarted;
        if expected {
            // What was in flight was dropped by the reset; the task knows what it did.
            if self.live || self.spec.flow.after_reset.is_some() {
                let dropped = self.exchange.end_flight(&failure);
                self.finish_commands(dropped);
            }
            // It may have arrived after the reset and be answered yet.
            if in_flight {
                self.exchange.distrust_acks();
            }
        } else {
            self.events.push(Event::TrustLost(format!("the device restarted by itself: {}", reply.raw)));
            self.end_everything(failure);
        }
    }

    fn on_alarm(&mut self, reply: &Reply) {
        let code = self.spec.class(&reply.class).and_then(|rx| rx.code.as_ref()).map(|f| reply.text(f));
        let code = code.unwrap_or_else(|| reply.text("text"));
        let fault = self.alarms.get(&code).or_else(|| self.alarms.get("*")).cloned();
        let next = fault.as_ref().map_or_else(|| FaultClass::Hardware.advice().to_owned(), Fault::next_move);
        let (text, trust, recover, mutes) = match fault {
            Some(f) => (f.text, f.trust, f.recover, f.mutes),
            None => ("an alarm the protocol file does not know".to_owned(), Trust::Lost, None, false),
        };
        if self.spec.state.is_some() {
            self.states.fill(Some(MotionState::Alarm));
            self.state_reports += 1;
        }
        self.mute = mutes;
        self.events.push(Event::Alarm { code: code.clone(), text: text.clone() });
        if trust == Trust::Lost {
            self.events.push(Event::TrustLost(format!("alarm {code}: {text}")));
        }
        // A stop or a recovery goes on: an alarm is what it may have caused.
        let failure = Failure::Alarm { code, text, trust, recover, next };
        let dropped = self.exchange.end_all(&failure);
        if self.task.as_ref().is_some_and(|t| t.ends_on_alarm()) {
            self.end_task(Err(failure));
        }
        self.finish_commands(dropped);
    }

    /// The flag that says that positions are not valid, if the device shows one: a search for references that ends
    /// so was cut short, by a restart for instance.
    pub(super) fn unreferenced(&self) -> Option<Failure> {
        if self.unreferenced.contains(&true) {
            return Some(Failure::Flag { code: "its state".to_owned(), text: UNREFERENCED.to_owned() });
        }
        let code = self.flag.clone()?;
        let spec = self.spec.flags.get(&code).filter(|spec| spec.trust == Trust::Lost)?;
        Some(Failure::Flag { code, text: spec.text.clone() })
    }

    fn on_flag(&mut self, reply: &Reply) {
        let Some(name) = self.spec.class(&reply.class).and_then(|rx| rx.flag.as_ref()) else { return };
        let Some(code) = reply.fields.get(name).map(Value::to_text) else { return };
        if self.flag.as_ref() == Some(&code) {
            return;
        }
        self.flag = Some(code.clone());
        let group = code.get(..1).map(|c| format!("{c}*")).unwrap_or_default();
        let Some(spec) = self.spec.flags.get(&code).or_else(|| self.spec.flags.get(&group)).cloned() else {
            self.note(format!("unknown flag {code}"));
            return;
        };
        if spec.action == FlagAction::Ignore {
            return;
        }
        self.events.push(Event::Flag { code: code.clone(), text: spec.text.clone() });
        if spec.trust == Trust::Lost {
            self.events.push(Event::TrustLost(format!("{code}: {}", spec.text)));
        }
        if spec.action == FlagAction::FailMove {
            self.flag_failure = Some(Failure::Flag { code, text: spec.text });
            if let Some(clear) = &spec.clear {
                for fields in self.addressed(clear) {
                    self.exchange.send_aside(clear, fields);
                }
            }
        }
    }

    /// Devices that enumerate their alarms and errors know them better than the file.
    fn learn_tables(&mut self, reply: &Reply) {
        let learns = self.spec.class(&reply.class).and_then(|rx| rx.learns);
        let (table, trust) = match learns {
            Some(FaultTable::Alarms) => (&mut self.alarms, Trust::Lost),
            Some(FaultTable::Errors) => (&mut self.errors, Trust::Keep),
            None => return,
        };
        let code = reply.text("code");
        let told = [reply.text("title"), reply.text("text")];
        let text = told.iter().filter(|t| !t.is_empty()).cloned().collect::<Vec<_>>().join(": ");
        let class = if learns == Some(FaultTable::Alarms) { FaultClass::Hardware } else { FaultClass::Usage };
        let unknown = Fault { text: text.clone(), class, trust, mutes: false, recover: None, next: None };
        table.entry(code).or_insert(unknown).text = text;
    }
}
