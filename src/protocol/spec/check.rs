//! What serde cannot see: names that must exist, fields that somebody must fill, tables that must agree.
//!
//! Everything is found at once. Paths are those of the file (`rx[2].code`), so that whoever has the text
//! can name the line.

mod emulation;
mod steps;

use super::*;
use crate::problem::Problems;
use crate::protocol::template::Template;
use std::collections::BTreeSet;

/// Everything that is wrong with a file that parses.
pub(super) fn check(spec: &Spec, problems: &mut Problems) {
    let mut check = Check { spec, problems };
    check.about();
    check.flow();
    check.commands();
    check.templates();
    check.replies();
    check.motion();
    check.procedures();
    check.faults();
    check.dialogues();
    check.vectors();
    check.emulation();
}

/// Fields of a move beside those of the axis: what the engine fills in for `[motion] move`.
const OF_A_MOVE: [&str; 7] = ["pos", "counts", "feed", "feed_whole", "feed_counts", "accel", "accel_counts"];

struct Check<'a, 'p> {
    spec: &'a Spec,
    problems: &'p mut Problems,
}

fn list<'n>(names: impl IntoIterator<Item = &'n str>) -> String {
    let names: Vec<&str> = names.into_iter().collect();
    if names.is_empty() { "none is described yet".to_owned() } else { names.join(", ") }
}

impl Check<'_, '_> {
    /// A name that must be that of a command.
    fn command(&mut self, key: &str, name: &str) {
        if !self.spec.cmd.contains_key(name) {
            let known = list(self.spec.cmd.keys().map(String::as_str));
            let next = format!("choose one of them, or add a table [cmd.{name}]");
            self.problems.push(key, quoted(name), format!("a command: {known}"), next);
        }
    }

    /// A name that must be that of a class of replies.
    fn class(&mut self, key: &str, name: &str) {
        if self.spec.class(name).is_none() {
            let known = list(self.spec.rx.iter().map(|rx| rx.class.as_str()));
            let next = format!("choose one of them, or add [[rx]] with class = \"{name}\"");
            self.problems.push(key, quoted(name), format!("a class of replies: {known}"), next);
        }
    }

    /// A name that must be that of real-time bytes.
    fn realtime(&mut self, key: &str, name: &str) {
        if !self.spec.realtime.contains_key(name) {
            let known = list(self.spec.realtime.keys().map(String::as_str));
            let next = format!("choose one of them, or add `{name} = ...` to [realtime]");
            self.problems.push(key, quoted(name), format!("real-time bytes: {known}"), next);
        }
    }

    fn about(&mut self) {
        let spec = self.spec;
        if spec.protocol.schema != SCHEMA {
            let next = "write the version that this program reads, or use a matching release";
            self.problems.push("protocol.schema", spec.protocol.schema, SCHEMA.to_string(), next);
        }
        if spec.line.is_some() == spec.frame.is_some() {
            let found = if spec.line.is_some() { "both [line] and [frame]" } else { "no framing at all" };
            self.problems.push(
                "protocol",
                found,
                "exactly one of the tables [line] and [frame]",
                "describe lines of text in [line], binary frames in [frame]",
            );
        }
        if let Some(name) = &spec.protocol.identify {
            self.command("protocol.identify", name);
        }
        if spec.link.wake.is_some() && !spec.rx.iter().any(|rx| rx.role == Role::Banner) {
            self.problems.push(
                "link.wake",
                "bytes that nothing answers",
                "with wake, a class with role = \"banner\"",
                "add [[rx]] with the banner, or remove wake",
            );
        }
    }

    fn flow(&mut self) {
        let spec = self.spec;
        let rates = std::iter::once(("link.baud", spec.link.baud));
        let others = spec.link.baud_alternatives.iter().map(|baud| ("link.baud_alternatives", *baud));
        for (key, baud) in rates.chain(others) {
            self.problems.range(key, f64::from(baud), 300.0, 1e7, "baud");
        }
        if let Some(bytes) = spec.flow.window_bytes {
            self.problems.range("flow.window_bytes", bytes as f64, 16.0, 65_536.0, "bytes");
        }
        if spec.flow.mode == FlowMode::CharCount && spec.flow.window_bytes.is_none() {
            self.problems.push(
                "flow.mode",
                quoted("char_count"),
                "character counting with window_bytes",
                "add window_bytes, the size of the device's buffer",
            );
        }
        if spec.flow.mode == FlowMode::IdMatched && spec.flow.id.is_none() {
            self.problems.push(
                "flow.mode",
                quoted("id_matched"),
                "matched ids with a table [flow.id]",
                "add [flow.id] with field, max and urgent",
            );
        }
        if let Some(name) = &spec.flow.resync {
            self.command("flow.resync", name);
            if spec.cmd.get(name).is_some_and(|cmd| cmd.needs.is_none()) {
                self.problems.push(
                    "flow.resync",
                    quoted(name),
                    "a command with `needs`, data that no other command has",
                    format!("add `needs` to [cmd.{name}]: without it a late reply cannot be told"),
                );
            }
        }
        if let Some(reset) = &spec.flow.reset {
            self.realtime("flow.reset", reset);
        }
        if let Some(banner) = &spec.flow.after_reset {
            self.class("flow.after_reset", banner);
        }
        if let Some(numbering) = spec.line.as_ref().and_then(|l| l.numbering.as_ref()) {
            self.class("line.numbering.resend", &numbering.resend);
            self.command("line.numbering.reset", &numbering.reset);
        }
        if let Some(keepalive) = &spec.keepalive {
            self.command("keepalive.command", &keepalive.command);
        }
        let Some(frame) = &spec.frame else { return };
        let mut names = vec![("frame.length.field", frame.length.field.as_str())];
        names.extend(frame.length.only_when.as_ref().map(|t| ("frame.length.only_when", t.field.as_str())));
        let sum_from = frame.checksum.as_ref().and_then(|c| c.from.as_deref());
        names.extend(sum_from.map(|from| ("frame.checksum.from", from)));
        names.extend(frame.stuffing.as_ref().map(|s| ("frame.stuffing.from", s.from.as_str())));
        for (key, name) in names {
            self.header_field(key, name);
        }
    }

    fn header_field(&mut self, key: &str, name: &str) {
        let Some(frame) = &self.spec.frame else { return };
        if !frame.header.iter().any(|f| f.name == name) {
            let known = list(frame.header.iter().map(|f| f.name.as_str()));
            let next = "choose one of them, or add it to frame.header";
            self.problems.push(key, quoted(name), format!("a header field: {known}"), next);
        }
    }

    fn commands(&mut self) {
        let spec = self.spec;
        for (name, cmd) in &spec.cmd {
            let key = |key: &str| format!("cmd.{name}.{key}");
            if !["ack", "none"].contains(&cmd.reply.as_str()) {
                self.class(&key("reply"), &cmd.reply);
            }
            let acks = spec.rx.iter().any(|rx| rx.role == Role::Ack);
            if cmd.reply == "ack" && !acks {
                self.problems.push(
                    &format!("cmd.{name}"),
                    "reply = \"ack\" (the default)",
                    "a reply that some class can give; none has role = \"ack\"",
                    "name the class that answers it, or write reply = \"none\"",
                );
            }
            if let Some(class) = &cmd.needs {
                self.class(&key("needs"), class);
            }
            for (i, class) in cmd.collect.iter().enumerate() {
                self.class(&key(&format!("collect[{i}]")), class);
            }
            let binary = !cmd.header.is_empty() || !cmd.payload.is_empty();
            if spec.line.is_some() && (cmd.tx.is_none() || binary) {
                self.problems.push(
                    &format!("cmd.{name}"),
                    if binary { "header or payload" } else { "no tx" },
                    "tx alone, as for every command of a line protocol",
                    "write its text as `tx = \"...\"`",
                );
            }
            if spec.line.is_none() && (cmd.tx.is_some() || cmd.header.is_empty()) {
                self.problems.push(
                    &format!("cmd.{name}"),
                    if cmd.tx.is_some() { "tx" } else { "no header" },
                    "header (and payload), as for every command of a binary protocol",
                    "write what tells it from others as `header = { ... }`",
                );
            }
            for field in cmd.header.keys() {
                self.header_field(&key(&format!("header.{field}")), field);
            }
        }
    }

    /// Every field of what the engine sends by itself must be one that it fills.
    fn templates(&mut self) {
        let spec = self.spec;
        let mut filled: BTreeSet<&str> = spec.axis.wire.groups().collect();
        filled.extend(spec.axis.device_fields.keys().map(String::as_str));
        filled.extend(["letters", "n"]);
        filled.extend(spec.flow.id.as_ref().map(|id| id.field.as_str()));
        if let Some(frame) = &spec.frame {
            filled.insert(&frame.length.field);
        }
        if let Some(line) = &spec.line {
            let envelope = line.envelope.iter().map(|t| ("line.envelope", t));
            let numbering = line.numbering.iter().map(|n| ("line.numbering.line", &n.line));
            for (key, template) in envelope.chain(numbering) {
                let known = |name: &str| filled.contains(name) || ["sp", "body"].contains(&name);
                self.template(key, template, &known);
            }
        }
        let of_a_move: BTreeSet<&String> = spec.motion.go.iter().chain(&spec.motion.jog).collect();
        for name in sent_by_itself(spec) {
            let Some(cmd) = spec.cmd.get(name) else { continue };
            let moves = of_a_move.contains(&name.to_owned());
            let whole = moves && cmd.scope == Scope::Device;
            // Binary moves of the whole device name their axes as the rig's wires do.
            let named_like_a_wire = |field: &str| whole && spec.axis.wire.is_match(field.as_bytes());
            let known = |field: &str| {
                filled.contains(field)
                    || moves && OF_A_MOVE.contains(&field) && !(whole && ["pos", "counts"].contains(&field))
                    || whole && field == "axes"
                    || field == HERE_COUNTS && cmd.scope == Scope::Axis && spec.position.counts
                    || named_like_a_wire(field)
            };
            if let Some(template) = &cmd.tx {
                self.template(&format!("cmd.{name}.tx"), template, &known);
                if whole && template.names().any(|field| field == "axes") {
                    self.word();
                }
            }
            for (i, field) in cmd.payload.iter().enumerate() {
                if field.default.is_none() && !known(&field.name) {
                    self.unfilled(&format!("cmd.{name}.payload[{i}]"), &field.name, name);
                }
            }
            for field in spec.frame.iter().flat_map(|f| &f.header) {
                let fixed = cmd.header.contains_key(&field.name) || field.default.is_some();
                if !fixed && !known(&field.name) {
                    self.unfilled(&format!("cmd.{name}.header"), &field.name, name);
                }
            }
        }
    }

    /// One axis of `{axes}` is written by `axis.word`.
    fn word(&mut self) {
        let axis = &self.spec.axis;
        let default = Template::parse("{letter}{pos}").expect("the default word is a template");
        let word = axis.word.as_ref().unwrap_or(&default);
        let known = |name: &str| axis.wire.groups().any(|g| g == name) || OF_A_MOVE.contains(&name);
        self.template("axis", word, &known);
    }

    fn template(&mut self, key: &str, template: &Template, known: &dyn Fn(&str) -> bool) {
        let unknown: Vec<String> = template.names().filter(|n| !known(n)).map(str::to_owned).collect();
        for name in unknown {
            self.unfilled(key, &name, "it");
        }
    }

    fn unfilled(&mut self, key: &str, field: &str, command: &str) {
        let groups = list(self.spec.axis.wire.groups());
        self.problems.push(
            key,
            format!("the field {field} is filled by nobody"),
            format!(
                "groups of axis.wire ({groups}), of device_fields; in moves also {}",
                OF_A_MOVE.join(", ")
            ),
            format!(
                "name the group (?P<{field}>...) in axis.wire, give {command} a fixed value, or correct it"
            ),
        );
    }

    fn replies(&mut self) {
        let spec = self.spec;
        let mut seen: BTreeSet<(&str, Option<&String>)> = BTreeSet::new();
        for (i, rx) in spec.rx.iter().enumerate() {
            let at = format!("rx[{i}]");
            let key = |key: &str| format!("rx[{i}].{key}");
            if !seen.insert((rx.class.as_str(), rx.after.as_ref())) {
                let next = "give each its own name, or join their patterns";
                self.problems.push(&key("class"), quoted(&rx.class), "a name of its own", next);
            }
            if spec.line.is_some() != rx.pattern.is_some() {
                let (found, allowed, next) = if rx.pattern.is_some() {
                    ("match", "when, as for every class of a binary protocol", "write `when = { ... }`")
                } else {
                    ("no match", "match, as for every class of a line protocol", "write `match = '^...$'`")
                };
                self.problems.push(&at, found, allowed, next);
            }
            if let Some(cmd) = &rx.after {
                self.command(&key("after"), cmd);
            }
            if let Some(cmd) = &rx.then {
                self.command(&key("then"), cmd);
            }
            for field in rx.when.keys() {
                self.header_field(&key(&format!("when.{field}")), field);
            }
            let carried = self.carried(rx);
            let split = rx.split.as_ref().map(|s| s.field.clone());
            let named = [
                ("inner", rx.inner.as_ref()),
                ("code", rx.code.as_ref()),
                ("flag", rx.flag.as_ref()),
                ("split.field", split.as_ref()),
            ];
            let refusing = rx.nack_when.keys().map(|field| ("nack_when", field));
            for (of, name) in named.into_iter().filter_map(|(of, n)| Some((of, n?))).chain(refusing) {
                if !carried.contains(name) {
                    self.not_carried(&key(of), name, &rx.class);
                }
            }
        }
    }

    /// Names of the fields that a class carries, as far as the file tells them.
    fn carried(&self, rx: &RxSpec) -> BTreeSet<String> {
        let groups = rx.pattern.iter().flat_map(|p| p.groups().map(str::to_owned));
        let payload = rx.payload.iter().map(|f| f.name.clone());
        let header = self.spec.frame.iter().flat_map(|f| f.header.iter().map(|h| h.name.clone()));
        groups.chain(payload).chain(header).collect()
    }

    fn not_carried(&mut self, key: &str, field: &str, class: &str) {
        let carried = self.spec.class(class).map(|rx| self.carried(rx)).unwrap_or_default();
        let next = if self.spec.is_line() {
            format!("add a group (?P<{field}>...) to its match, or correct the name")
        } else {
            format!("add {field} to its payload, or correct the name")
        };
        let allowed = format!("a field of {class}: {}", list(carried.iter().map(String::as_str)));
        self.problems.push(key, quoted(field), allowed, next);
    }

    fn motion(&mut self) {
        let spec = self.spec;
        self.class("position.class", &spec.position.class);
        if let Some(name) = &spec.position.command {
            self.command("position.command", name);
        }
        if let Some(name) = &spec.position.realtime {
            self.realtime("position.realtime", name);
        }
        if let (PositionFrom::Single(field), Some(rx)) =
            (&spec.position.from, spec.class(&spec.position.class))
            && !self.carried(rx).contains(field)
        {
            self.not_carried("position.from", field, &spec.position.class);
        }
        for (key, names) in [("move", &spec.motion.go), ("jog", &spec.motion.jog)] {
            for (i, name) in names.iter().enumerate() {
                self.command(&format!("motion.{key}[{i}]"), name);
            }
        }
        if spec.motion.go.is_empty() {
            let next = "name the commands of [cmd] that make a move";
            self.problems.push("motion.move", "[]", "at least one command", next);
        }
        if !spec.motion.go.is_empty()
            && !spec.motion.go.iter().any(|n| spec.cmd.get(n).is_some_and(|c| c.moves))
        {
            self.problems.push(
                "motion.move",
                "commands none of which is marked as moving",
                "one with `moves = true`: losing its reply makes the position unknown",
                "add `moves = true` to the command that starts the motion",
            );
        }
        if let Some(name) = &spec.done.command {
            self.command("done.command", name);
        }
        if let Some(name) = &spec.done.realtime {
            self.realtime("done.realtime", name);
        }
        if let Some(name) = &spec.done.event {
            self.class("done.event", name);
        }
        if spec.done.command.is_none() && spec.done.realtime.is_none() {
            self.problems.push(
                "done",
                "no question",
                "command or realtime: a question, also as the fallback of events",
                "name a command that asks for the state, or one that waits for the end of motion",
            );
        }
        let needs_state = matches!(spec.done.method, DoneMethod::PollState | DoneMethod::Event);
        if needs_state && spec.state.is_none() {
            let next = "add [state] with the device's words for idle and moving";
            self.problems.push("done.method", "asking for the state", "a table [state] with it", next);
        }
        if let Some(state) = &spec.state {
            // A split field bears names that only the device knows.
            let splits = spec.rx.iter().any(|rx| rx.split.is_some());
            let carried = spec.rx.iter().any(|rx| self.carried(rx).contains(&state.field));
            if !carried && !splits {
                self.problems.push(
                    "state.field",
                    quoted(&state.field),
                    "a field that some class carries",
                    format!(
                        "add a group (?P<{}>...) or payload field to the class that tells it",
                        state.field
                    ),
                );
            }
            if needs_state && state.idle.is_empty() {
                let next = "add the words that mean idle";
                self.problems.push(
                    "state.idle",
                    "[]",
                    "at least one word: a move ends when it is heard",
                    next,
                );
            }
        }
        if spec.done.method == DoneMethod::QueueIndex && spec.done.field.is_none() {
            let next = "add field, the name under which the index is reported";
            self.problems.push("done.method", quoted("queue_index"), "queue_index with field", next);
        }
    }

    fn dialogues(&mut self) {
        for (i, dialogue) in self.spec.dialogue.iter().enumerate() {
            for (j, turn) in dialogue.turns.iter().enumerate() {
                let at = format!("dialogue[{i}].turns[{j}]");
                if let Some(cmd) = &turn.cmd {
                    self.command(&at, cmd);
                }
                let known = ["done", "refused", "failed", "pending"];
                if let Some(ends) = turn.ends.as_ref().filter(|e| !known.contains(&e.as_str())) {
                    let value = format!("ends = {ends:?}");
                    self.problems.push(&at, value, known.join(", "), "choose one of them");
                }
            }
        }
    }

    fn vectors(&mut self) {
        for (i, vector) in self.spec.vector.iter().enumerate() {
            let at = format!("vector[{i}]");
            if let Some(cmd) = &vector.cmd {
                self.command(&format!("{at}.cmd"), cmd);
            }
            if let Some(cmd) = &vector.after {
                self.command(&format!("{at}.after"), cmd);
            }
            if let Some(class) = &vector.class {
                self.class(&format!("{at}.class"), class);
            }
            if vector.cmd.is_some() != vector.tx.is_some() || vector.rx.is_some() == vector.tx.is_some() {
                self.problems.push(
                    &at,
                    "neither one thing nor the other",
                    "cmd with tx (and args), or rx with class (and fields)",
                    "make it two vectors, or add what is missing",
                );
            }
        }
    }
}

fn quoted(name: &str) -> String {
    format!("{name:?}")
}

/// Commands that the engine sends without being given fields.
fn sent_by_itself(spec: &Spec) -> BTreeSet<&str> {
    let steps = [&spec.init, &spec.home]
        .into_iter()
        .chain(spec.stop.values())
        .chain(spec.recover.values())
        .chain(spec.motion.jog_cancel.iter())
        .flat_map(|p| &p.steps)
        .flat_map(|s| [&s.send, &s.or_send]);
    let mut names: BTreeSet<&str> = steps.flatten().map(String::as_str).collect();
    let asked = [&spec.protocol.identify, &spec.position.command, &spec.done.command, &spec.flow.resync];
    names.extend(asked.into_iter().flatten().map(String::as_str));
    names.extend(spec.motion.go.iter().chain(&spec.motion.jog).map(String::as_str));
    names.extend(spec.keepalive.iter().map(|k| k.command.as_str()));
    names.extend(spec.rx.iter().filter_map(|rx| rx.then.as_deref()));
    names
}
