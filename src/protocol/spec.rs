//! A protocol file, parsed and checked.
//!
//! Every table is typed and refuses unknown keys; names that refer to other tables (a command in a
//! step, a class that ends a wait) are checked after parsing. All problems are reported together,
//! each with its line.
//!
//! [`Spec::parse`] reads the text; the tables are in [`link`] (port, framing, flow), [`dialogue`]
//! (commands and replies), [`conduct`] (states, motion, completion, steps, tables of errors) and
//! [`vector`] (examples the file carries).

mod check;
pub mod conduct;
pub mod dialogue;
mod lines;
pub mod link;
pub mod vector;

use super::emulation::EmulatorSpec;
use super::value::{Bytes, Pattern};
use crate::problem::{Problem, Problems};
pub use conduct::*;
pub use dialogue::*;
pub use link::*;
use serde::Deserialize;
use std::collections::BTreeMap;
pub use vector::*;

/// The version of the schema that this program reads.
pub const SCHEMA: u32 = 1;

/// One firmware's protocol, in both directions.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// `[protocol]`: what this is.
    pub protocol: About,
    /// `[link]`: the serial port.
    pub link: LinkSpec,
    /// `[line]`: framing of a line protocol. Exactly one of `line` and `frame` is present.
    pub line: Option<LineSpec>,
    /// `[frame]`: framing of a binary protocol.
    pub frame: Option<FrameSpec>,
    /// `[flow]`: how much may be in flight.
    #[serde(default)]
    pub flow: FlowSpec,
    /// `[axis]`: how an axis is named and how its numbers are written.
    pub axis: AxisSpec,
    /// `[realtime]`: bytes that bypass every queue and are not acknowledged.
    #[serde(default)]
    pub realtime: BTreeMap<String, Bytes>,
    /// `[cmd.<name>]`: what can be sent.
    pub cmd: BTreeMap<String, CommandSpec>,
    /// `[[rx]]`: what can be received, tried in this order.
    pub rx: Vec<RxSpec>,
    /// `[state]`: from the device's words to ours.
    pub state: Option<StateSpec>,
    /// `[position]`: where positions are reported.
    pub position: PositionSpec,
    /// `[motion]`: which commands make a move.
    pub motion: MotionSpec,
    /// `[done]`: how the end of a move is known.
    pub done: DoneSpec,
    /// `[init]`: steps after identification, before anything else.
    #[serde(default)]
    pub init: Procedure,
    /// `[home]`: steps that reference the axes.
    pub home: Procedure,
    /// `[stop.<name>]`: `emergency` (required), `controlled`, and `homing` where a controlled stop does not end
    /// the search for references.
    pub stop: BTreeMap<String, Procedure>,
    /// `[recover.<name>]`: steps after an alarm, named by the alarm table.
    #[serde(default)]
    pub recover: BTreeMap<String, Procedure>,
    /// `[keepalive]`: a command to send now and then.
    pub keepalive: Option<Keepalive>,
    /// `[errors]`: refusals by code.
    #[serde(default)]
    pub errors: BTreeMap<String, Fault>,
    /// `[alarms]`: alarms by code.
    #[serde(default)]
    pub alarms: BTreeMap<String, Fault>,
    /// `[flags]`: conditions shown in every reply, by code; `F*` stands for a group.
    #[serde(default)]
    pub flags: BTreeMap<String, FlagSpec>,
    /// `[emulator]`: read by the emulator alone.
    pub emulator: Option<EmulatorSpec>,
    /// `[[vector]]`: bytes and the fields they stand for.
    #[serde(default)]
    pub vector: Vec<Vector>,
    /// `[[dialogue]]`: exchanges that must be understood from beginning to end.
    #[serde(default)]
    pub dialogue: Vec<Dialogue>,
}

/// `[protocol]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Name of the protocol.
    pub name: String,
    /// Version of the file's schema; 1.
    pub schema: u32,
    /// Who makes the firmware.
    #[serde(default)]
    pub vendor: String,
    /// Where its facts come from.
    #[serde(default)]
    pub sources: Vec<String>,
    /// What the banner or a line of the identity must match.
    pub firmware_match: Option<Pattern>,
    /// Command that asks for the identity, sent before anything else.
    pub identify: Option<String>,
}

/// What is wrong with a protocol file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.render())]
pub struct SpecError {
    /// Name of the file or protocol.
    pub name: String,
    /// Every problem, in order of lines.
    pub problems: Vec<SpecProblem>,
}

/// One problem and its line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpecProblem {
    /// Line in the file, from 1.
    pub line: usize,
    /// What is wrong there; without a key for an error of syntax.
    pub problem: Problem,
}

impl SpecError {
    fn render(&self) -> String {
        let lines = self.problems.iter().map(|SpecProblem { line, problem: p }| {
            let key = if p.key.is_empty() { String::new() } else { format!("{}: ", p.key) };
            format!("{}:{line}: {key}{}; allowed: {}; {}", self.name, p.value, p.allowed, p.next)
        });
        lines.collect::<Vec<_>>().join("\n")
    }
}

impl Spec {
    /// Reads a protocol file; `name` is what errors call it. Of what does not fit the types the first is
    /// told; whoever wants all of that reads the file by itself and calls [`Spec::check`].
    pub fn parse(name: &str, text: &str) -> Result<Spec, SpecError> {
        let fail = |problems| SpecError { name: name.to_owned(), problems };
        let spec: Spec = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(1, |span| lines::line_at(text, span.start));
            let problem = Problem {
                key: String::new(),
                value: e.message().to_owned(),
                allowed: "a protocol as in the shipped firmware_protocols/".to_owned(),
                next: "correct this line".to_owned(),
            };
            fail(vec![SpecProblem { line, problem }])
        })?;
        let mut found = Problems::new();
        spec.check(&mut found);
        let found = found.into_vec();
        if found.is_empty() {
            return Ok(spec);
        }
        let mut problems: Vec<SpecProblem> = found
            .into_iter()
            .map(|problem| SpecProblem { line: lines::line_of(text, &problem.key), problem })
            .collect();
        problems.sort_by_key(|p| p.line);
        Err(fail(problems))
    }

    /// Reports everything that the types cannot see: names that lead nowhere, fields that nobody fills,
    /// tables that do not agree.
    pub fn check(&self, problems: &mut Problems) {
        check::check(self, problems);
    }

    /// The class of that name.
    pub fn class(&self, name: &str) -> Option<&RxSpec> {
        self.rx.iter().find(|rx| rx.class == name)
    }

    /// Whether the device speaks in lines (and not in binary frames).
    pub fn is_line(&self) -> bool {
        self.line.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn every_shipped_file_is_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware_protocols");
        let mut read = 0;
        for name in crate::protocol::conformance::tests::all_shipped() {
            let path = folder.join(name).with_extension("toml");
            let text = std::fs::read_to_string(&path).unwrap();
            if let Err(e) = Spec::parse(&path.display().to_string(), &text) {
                panic!("{e}");
            }
            read += 1;
        }
        assert!(read >= 2);
    }

    fn grbl() -> String {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware_protocols/grbl.toml");
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_line() {
        let text = grbl().replace("max_line = 79", "max_lines = 79");
        let line = text.lines().position(|l| l.starts_with("max_lines")).unwrap() + 1;
        let error = Spec::parse("grbl.toml", &text).unwrap_err();
        assert_eq!(error.problems[0].line, line);
        assert!(error.to_string().contains("max_lines"), "{error}");
    }

    #[test]
    fn names_that_lead_nowhere_are_all_reported_with_their_lines() {
        let text = grbl()
            .replace(r#"steps = [{ send = "home", silent"#, r#"steps = [{ send = "hoem", silent"#)
            .replace(r#"recover = "unlock" }"#, r#"recover = "unlok" }"#);
        let error = Spec::parse("grbl.toml", &text).unwrap_err();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(error.problems.len(), 2, "{error}");
        assert!(lines[error.problems[0].line - 1].contains("hoem"), "{error}");
        assert!(lines[error.problems[1].line - 1].contains("unlok"), "{error}");
    }

    #[test]
    fn a_bad_pattern_and_a_bad_template_name_their_line() {
        for (good, bad) in [("match = '^ok$'", "match = '^ok($'"), ("tx = \"$X\"", "tx = \"$X{\"")] {
            let text = grbl().replace(good, bad);
            let error = Spec::parse("grbl.toml", &text).unwrap_err();
            let line = text.lines().position(|l| l == bad).unwrap() + 1;
            assert_eq!(error.problems[0].line, line, "{error}");
        }
    }
}
