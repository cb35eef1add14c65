//! What serde cannot see: names that must exist, tables that must agree; and the line of each key.

use super::*;
use toml::de::{DeTable, DeValue};

/// Line of a byte offset, from 1.
pub(super) fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes()[..offset.min(text.len())].iter().filter(|b| **b == b'\n').count() + 1
}

/// Everything that is wrong with a file that parses.
pub(super) fn problems(spec: &Spec, text: &str) -> Vec<SpecProblem> {
    let mut check = Check { spec, found: Vec::new() };
    check.all();
    let tree = DeTable::parse(text).ok();
    let mut problems: Vec<SpecProblem> = check
        .found
        .into_iter()
        .map(|(path, message)| {
            let line = tree.as_ref().map_or(1, |t| line_at(text, locate(t.get_ref(), &path)));
            SpecProblem { line, key: path.join("."), message }
        })
        .collect();
    problems.sort_by_key(|p| p.line);
    problems
}

/// Byte offset of the deepest part of `path` that exists.
fn locate(table: &DeTable<'_>, path: &[String]) -> usize {
    let mut best = 0;
    let mut table = table;
    let mut rest = path;
    while let Some((key, tail)) = rest.split_first() {
        let Some((at, mut value)) = table.get_key_value(key.as_str()) else { break };
        best = at.span().start;
        rest = tail;
        if let (DeValue::Array(list), Some((index, tail))) = (value.get_ref(), rest.split_first())
            && let Some(item) = index.parse().ok().and_then(|i: usize| list.get(i))
        {
            best = item.span().start;
            value = item;
            rest = tail;
        }
        match value.get_ref() {
            DeValue::Table(inner) => table = inner,
            _ => break,
        }
    }
    best
}

struct Check<'a> {
    spec: &'a Spec,
    found: Vec<(Vec<String>, String)>,
}

impl Check<'_> {
    fn push(&mut self, path: &[&str], message: String) {
        self.found.push((path.iter().map(|s| (*s).to_owned()).collect(), message));
    }

    fn command(&mut self, path: &[&str], name: &str) {
        if !self.spec.cmd.contains_key(name) {
            let known = self.spec.cmd.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            self.push(
                path,
                format!("there is no command \"{name}\"; choose one of {known}, or add [cmd.{name}]"),
            );
        }
    }

    fn class(&mut self, path: &[&str], name: &str) {
        if self.spec.class(name).is_none() {
            let known: Vec<&str> = self.spec.rx.iter().map(|rx| rx.class.as_str()).collect();
            self.push(
                path,
                format!("there is no reply class \"{name}\"; choose one of {}", known.join(", ")),
            );
        }
    }

    fn realtime(&mut self, path: &[&str], name: &str) {
        if !self.spec.realtime.contains_key(name) {
            self.push(path, format!("there are no real-time bytes \"{name}\"; add them to [realtime]"));
        }
    }

    fn all(&mut self) {
        let spec = self.spec;
        if spec.protocol.schema != SCHEMA {
            let message =
                format!("schema {} is not known; this program reads {SCHEMA}", spec.protocol.schema);
            self.push(&["protocol", "schema"], message);
        }
        if spec.line.is_some() == spec.frame.is_some() {
            self.push(&["protocol"], "exactly one of the tables [line] and [frame] is needed".to_owned());
        }
        if let Some(name) = &spec.protocol.identify {
            self.command(&["protocol", "identify"], name);
        }
        self.flow();
        self.commands();
        self.replies();
        self.motion();
        self.procedures();
        self.faults();
        self.dialogues();
        for (i, vector) in spec.vector.iter().enumerate() {
            let at = i.to_string();
            if let Some(cmd) = &vector.cmd {
                self.command(&["vector", &at, "cmd"], cmd);
            }
            if let Some(class) = &vector.class {
                self.class(&["vector", &at, "class"], class);
            }
            if vector.cmd.is_some() != vector.tx.is_some() || vector.rx.is_some() == vector.tx.is_some() {
                self.push(&["vector", &at], "a vector is either cmd and tx, or rx and class".to_owned());
            }
        }
    }

    fn dialogues(&mut self) {
        let spec = self.spec;
        for (i, dialogue) in spec.dialogue.iter().enumerate() {
            for (j, turn) in dialogue.turns.iter().enumerate() {
                let (at, turn_at) = (i.to_string(), j.to_string());
                let path = ["dialogue", at.as_str(), "turns", turn_at.as_str()];
                if let Some(cmd) = &turn.cmd {
                    self.command(&path, cmd);
                }
                let known = ["done", "refused", "failed", "pending"];
                if let Some(ends) = turn.ends.as_ref().filter(|e| !known.contains(&e.as_str())) {
                    self.push(&path, format!("ends \"{ends}\" is not one of {}", known.join(", ")));
                }
            }
        }
    }

    fn flow(&mut self) {
        let spec = self.spec;
        if spec.flow.mode == FlowMode::CharCount && spec.flow.window_bytes.is_none() {
            let message = "character counting needs window_bytes, the size of the device's buffer".to_owned();
            self.push(&["flow", "mode"], message);
        }
        if spec.flow.mode == FlowMode::IdMatched && spec.flow.id.is_none() {
            self.push(&["flow", "mode"], "matched ids need [flow.id]".to_owned());
        }
        if let Some(name) = &spec.flow.resync {
            self.command(&["flow", "resync"], name);
        }
        if let Some(reset) = &spec.flow.reset {
            self.realtime(&["flow", "reset"], reset);
        }
        if let Some(banner) = &spec.flow.after_reset {
            self.class(&["flow", "after_reset"], banner);
        }
        if let Some(numbering) = spec.line.as_ref().and_then(|l| l.numbering.as_ref()) {
            self.class(&["line", "numbering", "resend"], &numbering.resend);
            self.command(&["line", "numbering", "reset"], &numbering.reset);
        }
        if let Some(keepalive) = &spec.keepalive {
            self.command(&["keepalive", "command"], &keepalive.command);
        }
        if let Some(frame) = &spec.frame {
            let known = |name: &str| frame.header.iter().any(|f| f.name == name);
            let mut names = vec![(vec!["frame", "length", "field"], frame.length.field.as_str())];
            if let Some(test) = &frame.length.only_when {
                names.push((vec!["frame", "length", "only_when"], &test.field));
            }
            if let Some(from) = frame.checksum.as_ref().and_then(|c| c.from.as_ref()) {
                names.push((vec!["frame", "checksum", "from"], from));
            }
            if let Some(stuffing) = &frame.stuffing {
                names.push((vec!["frame", "stuffing", "from"], &stuffing.from));
            }
            for (path, name) in names {
                if !known(name) {
                    self.push(&path, format!("there is no header field \"{name}\""));
                }
            }
        }
    }

    fn commands(&mut self) {
        let spec = self.spec;
        for (name, cmd) in &spec.cmd {
            let path = ["cmd", name.as_str(), "reply"];
            match cmd.reply.as_str() {
                "ack" | "none" => {}
                class => self.class(&path, class),
            }
            if let Some(class) = &cmd.needs {
                self.class(&["cmd", name, "needs"], class);
            }
            let binary = !cmd.header.is_empty() || !cmd.payload.is_empty();
            if spec.is_line() && (cmd.tx.is_none() || binary) {
                self.push(
                    &path[..2],
                    "a line protocol's command has tx, and neither header nor payload".to_owned(),
                );
            }
            if !spec.is_line() && (cmd.tx.is_some() || cmd.header.is_empty()) {
                self.push(&path[..2], "a binary protocol's command has header, and no tx".to_owned());
            }
        }
    }

    fn replies(&mut self) {
        let spec = self.spec;
        for (i, rx) in spec.rx.iter().enumerate() {
            let at = i.to_string();
            if spec.is_line() != rx.pattern.is_some() {
                let message = "a class of a line protocol has match, of a binary protocol when".to_owned();
                self.push(&["rx", &at], message);
            }
            if let Some(cmd) = &rx.after {
                self.command(&["rx", &at, "after"], cmd);
            }
            if let Some(cmd) = &rx.then {
                self.command(&["rx", &at, "then"], cmd);
            }
            if let Some(pattern) = &rx.pattern {
                let named = [&rx.inner, &rx.code, &rx.flag, &rx.split.as_ref().map(|s| s.field.clone())];
                for name in named.into_iter().flatten() {
                    if !pattern.groups().any(|g| g == name) {
                        self.push(&["rx", &at, "match"], format!("there is no group (?P<{name}>...) in it"));
                    }
                }
            }
        }
    }

    fn motion(&mut self) {
        let spec = self.spec;
        self.class(&["position", "class"], &spec.position.class);
        if let Some(name) = &spec.position.command {
            self.command(&["position", "command"], name);
        }
        if let Some(name) = &spec.position.realtime {
            self.realtime(&["position", "realtime"], name);
        }
        for name in &spec.motion.go {
            self.command(&["motion", "move"], name);
        }
        for name in &spec.motion.jog {
            self.command(&["motion", "jog"], name);
        }
        if let Some(name) = &spec.done.command {
            self.command(&["done", "command"], name);
        }
        if let Some(name) = &spec.done.realtime {
            self.realtime(&["done", "realtime"], name);
        }
        if let Some(name) = &spec.done.event {
            self.class(&["done", "event"], name);
        }
        let asks = spec.done.command.is_some() || spec.done.realtime.is_some();
        if !asks {
            let message = "completion needs command or realtime: a question, also as the fallback of events";
            self.push(&["done"], message.to_owned());
        }
        let needs_state = matches!(spec.done.method, DoneMethod::PollState | DoneMethod::Event);
        if needs_state && spec.state.is_none() {
            self.push(&["done", "method"], "asking for the state needs a table [state]".to_owned());
        }
        if spec.done.method == DoneMethod::QueueIndex && spec.done.field.is_none() {
            self.push(&["done", "method"], "queue_index needs field, where the index is reported".to_owned());
        }
    }

    fn procedures(&mut self) {
        let spec = self.spec;
        if !spec.stop.contains_key("emergency") {
            self.push(&["stop"], "a table [stop.emergency] is needed: how to stop at once".to_owned());
        }
        self.procedure(&["init"], &spec.init);
        self.procedure(&["home"], &spec.home);
        if let Some(cancel) = &spec.motion.jog_cancel {
            self.procedure(&["motion", "jog_cancel"], cancel);
        }
        for (name, procedure) in &spec.stop {
            if !["emergency", "controlled", "homing"].contains(&name.as_str()) {
                let text = format!("\"{name}\" is no way to stop: emergency, controlled, homing");
                self.push(&["stop", name], text);
            }
            self.procedure(&["stop", name], procedure);
        }
        for (name, procedure) in &spec.recover {
            self.procedure(&["recover", name], procedure);
        }
    }

    fn procedure(&mut self, path: &[&str], procedure: &Procedure) {
        for (i, step) in procedure.steps.iter().enumerate() {
            let at = i.to_string();
            let mut at_step = path.to_vec();
            at_step.extend(["steps", at.as_str()]);
            for cmd in [&step.send, &step.or_send].into_iter().flatten() {
                self.command(&at_step, cmd);
            }
            if let Some(name) = &step.realtime {
                self.realtime(&at_step, name);
            }
            if let Some(class) = &step.expect {
                self.class(&at_step, class);
            }
            let waits = step.expect.is_some() || !step.until_state.is_empty();
            if waits && step.send.is_none() && step.timeout_ms.is_none() {
                self.push(&at_step, "a wait needs timeout_ms".to_owned());
            }
            if step.send.is_some() && step.realtime.is_some() {
                self.push(&at_step, "one step sends one thing: send or realtime".to_owned());
            }
        }
    }

    fn faults(&mut self) {
        let spec = self.spec;
        for (table, faults) in [("errors", &spec.errors), ("alarms", &spec.alarms)] {
            for (code, fault) in faults {
                if let Some(name) = &fault.recover
                    && !spec.recover.contains_key(name)
                {
                    self.push(&[table, code], format!("there is no table [recover.{name}]"));
                }
            }
        }
        for (code, flag) in &spec.flags {
            if let Some(cmd) = &flag.clear {
                self.command(&["flags", code, "clear"], cmd);
            }
        }
    }
}
