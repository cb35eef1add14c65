//! Whether a protocol file does what it says: its own vectors, run through the codec, and its own dialogues,
//! held by the engine.
//!
//! Used by the tests of this crate for the shipped files, and by the command line for anybody's.

use super::classify::{classify, state_of};
use super::deframe::{Deframer, Unit};
use super::encode::encode;
use super::engine::{Engine, Event, Failure};
use super::spec::{Dialogue, Spec, Vector};
use super::value::hex;
use crate::clock::Timestamp;
use std::sync::Arc;

/// What a case is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CaseKind {
    /// A `[[vector]]`: one command or one reply.
    Vector,
    /// A `[[dialogue]]`: an exchange from beginning to end.
    Dialogue,
}

/// One vector or dialogue of a file, and whether it holds.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Case {
    /// Vector or dialogue.
    pub kind: CaseKind,
    /// Which one of its kind, from 1, in the order of the file.
    pub number: usize,
    /// The command or class that a vector is about, with `>` for sent and `<` for received; the name of
    /// a dialogue.
    pub what: String,
    /// Of a dialogue the turn that went otherwise, from 1.
    pub turn: Option<usize>,
    /// Of a vector the key that does not hold, such as `tx` or `fields.value`.
    pub part: Option<String>,
    /// What differs; `None` when it holds.
    pub failure: Option<String>,
}

impl Case {
    /// Its key in the file, e.g. `vector[2]` or `dialogue[0].turns[3]`.
    pub fn key(&self) -> String {
        match (self.kind, self.turn) {
            (CaseKind::Vector, _) => {
                let part = self.part.as_ref().map(|part| format!(".{part}")).unwrap_or_default();
                format!("vector[{}]{part}", self.number - 1)
            }
            (CaseKind::Dialogue, None | Some(0)) => format!("dialogue[{}]", self.number - 1),
            (CaseKind::Dialogue, Some(turn)) => format!("dialogue[{}].turns[{}]", self.number - 1, turn - 1),
        }
    }
}

/// How a file fared.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Conformance {
    /// Every vector, then every dialogue.
    pub cases: Vec<Case>,
    /// Commands and classes that no vector shows.
    pub untested: Vec<String>,
}

impl Conformance {
    /// Cases that do not hold.
    pub fn failures(&self) -> impl Iterator<Item = &Case> {
        self.cases.iter().filter(|c| c.failure.is_some())
    }

    /// How many cases of a kind there are.
    pub fn count(&self, kind: CaseKind) -> usize {
        self.cases.iter().filter(|c| c.kind == kind).count()
    }
}

/// Runs every vector and every dialogue of a file.
pub fn check(spec: &Arc<Spec>) -> Conformance {
    let mut report = check_vectors(spec);
    for (i, dialogue) in spec.dialogue.iter().enumerate() {
        let held = hold(spec, dialogue);
        report.cases.push(Case {
            kind: CaseKind::Dialogue,
            number: i + 1,
            what: dialogue.name.clone(),
            turn: held.as_ref().err().map(|(turn, _)| *turn),
            part: None,
            failure: held.err().map(|(_, message)| message),
        });
    }
    report
}

/// Holds a dialogue with the engine; a hundred milliseconds pass between turns.
fn hold(spec: &Arc<Spec>, dialogue: &Dialogue) -> Result<(), (usize, String)> {
    let mut engine = Engine::new(spec.clone(), Vec::new(), 1.0).map_err(|e| (0, e.to_string()))?;
    let mut now = Timestamp(0);
    let mut last = None;
    let mut events = Vec::new();
    for (i, turn) in dialogue.turns.iter().enumerate() {
        let wrong = |message: String| (i + 1, message);
        now = now.after(std::time::Duration::from_millis(100));
        if let Some(cmd) = &turn.cmd {
            last = Some(engine.stream(cmd, turn.args.clone()));
        }
        if let Some(rx) = &turn.rx {
            engine.receive(&rx.0, now);
        }
        let output = engine.poll(now);
        let sent: Vec<u8> = output.urgent.into_iter().chain(output.bytes).collect();
        let want = turn.tx.as_ref().map(|b| b.0.as_slice()).unwrap_or_default();
        if sent != want {
            return Err(wrong(format!("sent {}, the file says {}", show(&sent), show(want))));
        }
        events.extend(output.events);
        let outcome = events.iter().find_map(|e| match e {
            Event::Finished(ticket, outcome) if Some(*ticket) == last => Some(outcome),
            _ => None,
        });
        let is = match outcome {
            None => "pending",
            Some(Ok(_)) => "done",
            Some(Err(Failure::Refused { .. })) => "refused",
            Some(Err(_)) => "failed",
        };
        if let Some(ends) = turn.ends.as_ref().filter(|e| *e != is) {
            return Err(wrong(format!("the last command is {is}, the file says {ends}")));
        }
    }
    Ok(())
}

/// Runs every vector of a file.
pub fn check_vectors(spec: &Arc<Spec>) -> Conformance {
    let mut cases = Vec::new();
    for (i, vector) in spec.vector.iter().enumerate() {
        let (sign, name) = if vector.tx.is_some() { ('>', &vector.cmd) } else { ('<', &vector.class) };
        let result = if vector.tx.is_some() { check_tx(spec, vector) } else { check_rx(spec, vector) };
        let what = format!("{sign} {}", name.as_deref().unwrap_or("(any class)"));
        let (part, failure) = result.err().unzip();
        cases.push(Case { kind: CaseKind::Vector, number: i + 1, what, turn: None, part, failure });
    }
    let shown = |name: &str| {
        spec.vector.iter().any(|v| v.cmd.as_deref() == Some(name) || v.class.as_deref() == Some(name))
    };
    let names = spec.cmd.keys().map(|c| ("command", c)).chain(spec.rx.iter().map(|rx| ("class", &rx.class)));
    let untested =
        names.filter(|(_, name)| !shown(name)).map(|(kind, name)| format!("{kind} {name}")).collect();
    Conformance { cases, untested }
}

/// The key of a vector that does not hold, and why.
type Wrong = (String, String);

fn check_tx(spec: &Spec, vector: &Vector) -> Result<(), Wrong> {
    let wrong = |part: &str, why: String| (part.to_owned(), why);
    let (Some(cmd), Some(want)) = (&vector.cmd, &vector.tx) else {
        return Err(wrong("tx", "cmd and tx are needed together".to_owned()));
    };
    let got = encode(spec, cmd, &vector.args, vector.number).map_err(|e| wrong("cmd", e.to_string()))?;
    if got == want.0 {
        Ok(())
    } else {
        Err(wrong("tx", format!("bytes are {}, the file says {}", show(&got), show(&want.0))))
    }
}

fn check_rx(spec: &Arc<Spec>, vector: &Vector) -> Result<(), Wrong> {
    let wrong = |part: &str, why: String| (part.to_owned(), why);
    let bytes = vector.rx.as_ref().ok_or_else(|| wrong("class", "rx is needed".to_owned()))?;
    let mut deframer = Deframer::new(spec.clone());
    let mut input = bytes.0.clone();
    if let Some(line) = spec.line.as_ref().filter(|l| !input.ends_with(&l.rx_eol.0)) {
        input.extend(&line.rx_eol.0);
    }
    let units = deframer.push(&input, Timestamp(0));
    let [unit] = &units[..] else {
        return Err(wrong("rx", format!("{} is {} units, not one", show(&input), units.len())));
    };
    if let Unit::Garbled(_) = unit {
        return Err(wrong("rx", format!("{} has a wrong checksum or length", show(&input))));
    }
    let awaited: Vec<&str> = vector.after.iter().map(String::as_str).collect();
    let replies = classify(spec, unit, &awaited);
    let reply = replies.last().ok_or_else(|| wrong("rx", format!("no class recognises {}", show(&input))))?;
    if let Some(class) = vector.class.as_ref().filter(|c| **c != reply.class) {
        return Err(wrong("class", format!("class is {}, the file says {class}", reply.class)));
    }
    for (name, want) in &vector.fields {
        let at = format!("fields.{name}");
        match reply.fields.get(name) {
            Some(got) if got.same(want) => {}
            Some(got) => {
                return Err((
                    at,
                    format!("field {name} is {}, the file says {}", got.to_text(), want.to_text()),
                ));
            }
            None => {
                let there: Vec<String> = reply
                    .fields
                    .iter()
                    .map(|(name, value)| format!("{name} = {}", value.to_text()))
                    .collect();
                return Err((at, format!("there is no field {name}; there are: {}", there.join(", "))));
            }
        }
    }
    let state = state_of(spec, &reply.fields).map(|(s, _)| s);
    match vector.state {
        Some(want) if state != Some(want) => {
            let is = state.map_or_else(|| "none that [state] knows".to_owned(), |s| s.word().to_owned());
            Err(wrong("state", format!("state is {is}, the file says {}", want.word())))
        }
        _ => Ok(()),
    }
}

/// Bytes for a message: as text where they are text.
pub fn show(bytes: &[u8]) -> String {
    if bytes.iter().all(|b| (0x20..0x7f).contains(b) || matches!(b, b'\n' | b'\r')) {
        format!("{:?}", String::from_utf8_lossy(bytes))
    } else {
        hex(bytes)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::path::Path;
    use std::sync::{Mutex, PoisonError};

    /// A shipped protocol. Each is read once: its patterns take longer to compile than a session with its emulator.
    pub(crate) fn shipped(name: &str) -> Arc<Spec> {
        static READ: Mutex<BTreeMap<String, Arc<Spec>>> = Mutex::new(BTreeMap::new());
        let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
        read.entry(name.to_owned()).or_insert_with(|| parse(name)).clone()
    }

    fn parse(name: &str) -> Arc<Spec> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("firmware_protocols/{name}.toml"));
        let text = std::fs::read_to_string(&path).expect("shipped protocol files are readable");
        Arc::new(Spec::parse(name, &text).unwrap_or_else(|e| panic!("{e}")))
    }

    /// Names of all shipped protocols.
    pub(crate) fn all_shipped() -> Vec<String> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware_protocols");
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .expect("the folder is there")
            .map(|e| e.expect("readable").path())
            .filter(|path| path.extension().is_some_and(|e| e == "toml"))
            .map(|path| path.file_stem().expect("a name").to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn every_vector_of_every_shipped_file_holds() {
        for name in all_shipped() {
            let report = check(&shipped(&name));
            assert!(report.count(CaseKind::Vector) > 0, "{name} has no vectors");
            assert!(report.count(CaseKind::Dialogue) > 0, "{name} has no dialogue");
            assert_eq!(report.failures().collect::<Vec<_>>(), Vec::<&Case>::new(), "{name}");
        }
    }

    #[test]
    fn every_command_and_class_of_the_shipped_files_is_shown_by_a_vector() {
        let mut without = Vec::new();
        for name in all_shipped() {
            let untested = check_vectors(&shipped(&name)).untested;
            without.extend(untested.into_iter().map(|what| format!("{name}: {what}")));
        }
        // Newport's manual does not print what its controller answers to VE.
        assert_eq!(without, ["newport_smc100: class version"]);
    }

    #[test]
    fn a_wrong_dialogue_is_found() {
        let mut spec = (*shipped("grbl")).clone();
        spec.dialogue[0].turns[0].tx = Some(crate::protocol::Bytes(b"$Q\n".to_vec()));
        let report = check(&Arc::new(spec));
        let failures: Vec<&Case> = report.failures().collect();
        assert_eq!((failures.len(), failures[0].turn), (1, Some(1)));
        assert_eq!(failures[0].key(), "dialogue[0].turns[0]");
    }

    #[test]
    fn a_wrong_vector_is_found() {
        let mut spec = (*shipped("grbl")).clone();
        spec.vector[0].tx = Some(crate::protocol::Bytes(b"$J=G90\n".to_vec()));
        let report = check_vectors(&Arc::new(spec));
        let failures: Vec<&Case> = report.failures().collect();
        assert_eq!((failures.len(), failures[0].key()), (1, "vector[0].tx".to_owned()));
        assert!(failures[0].failure.as_ref().unwrap().contains("G21"));
    }

    #[test]
    fn a_wrong_field_and_a_wrong_state_are_pointed_at_in_words() {
        let mut spec = (*shipped("newport_smc100")).clone();
        let at = |class: &str| spec.vector.iter().position(|v| v.class.as_deref() == Some(class)).unwrap();
        let (position, status) = (at("position"), at("status"));
        spec.vector[position].fields.insert("value".to_owned(), crate::protocol::Value::Num(6.0));
        spec.vector[status].state = Some(crate::protocol::spec::MotionState::Moving);
        let report = check_vectors(&Arc::new(spec));
        let told: Vec<(String, &str)> =
            report.failures().map(|c| (c.key(), c.failure.as_deref().unwrap())).collect();
        assert_eq!(
            told,
            [
                (format!("vector[{position}].fields.value"), "field value is 5.000, the file says 6"),
                (format!("vector[{status}].state"), "state is idle, the file says moving"),
            ]
        );
    }
}
