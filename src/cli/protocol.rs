//! `twinrig protocol list|lint|test`: protocol files, the shipped ones and one's own.
//!
//! `lint` loads files and says everything that is wrong with them, each with file, line, what was written,
//! what would be accepted and the next move. `test` also runs what a file carries about itself: its vectors
//! through the codec, its dialogues through the engine that will speak with the device.
//!
//! Exit codes: 0 sound; 1 a vector or a dialogue does not hold; 2 a file is refused.

use super::exit::Exit;
use super::screen;
use crate::config::{self, ConfigError, ProtocolFile};
use crate::protocol::Spec;
use crate::protocol::conformance::{self, CaseKind, Conformance};
use crate::protocol::spec::{DoneMethod, FlowMode};
use clap::Subcommand;
use serde::Serialize;

/// List, check and test protocol files
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig protocol list\n  twinrig protocol lint ./my_stage.toml\n  twinrig protocol test grbl marlin --json\n  twinrig protocol test firmware_protocols/*.toml"
)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Show the shipped protocols
    #[command(after_help = "Example:\n  twinrig protocol list --json")]
    List {
        /// Print one JSON document
        #[arg(long)]
        json: bool,
    },
    /// Check files; every problem is shown at once, with its line
    #[command(
        after_help = "Examples:\n  twinrig protocol lint ./my_stage.toml\n  twinrig protocol lint grbl"
    )]
    Lint(Files),
    /// Check files, then run their vectors and dialogues
    #[command(
        after_help = "Examples:\n  twinrig protocol test ./my_stage.toml\n  twinrig protocol test grbl marlin --json"
    )]
    Test(Files),
}

#[derive(Debug, clap::Args)]
struct Files {
    /// Path of a protocol file, or the name of a shipped one
    #[arg(required = true, value_name = "FILE")]
    files: Vec<String>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// One line of the list.
#[derive(Debug, Serialize)]
struct Listed {
    name: &'static str,
    vendor: String,
    framing: &'static str,
    flow: FlowMode,
    done: DoneMethod,
    emulated: bool,
    vectors: usize,
    dialogues: usize,
}

/// What became of one file.
#[derive(Debug, Serialize)]
struct Verdict {
    file: String,
    /// Why it is refused.
    refused: Option<ConfigError>,
    /// How its cases fared.
    tested: Option<Conformance>,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        match self.action {
            Action::List { json } => list(json),
            Action::Lint(files) => each(&files, false),
            Action::Test(files) => each(&files, true),
        }
    }
}

fn list(json: bool) -> Exit {
    let mut listed = Vec::new();
    for name in config::shipped_protocols() {
        match config::protocol(name) {
            Ok(spec) => listed.push(Listed::of(name, &spec)),
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        }
    }
    if json {
        screen::json(&listed);
        return Exit::Done;
    }
    screen::result(format_args!(
        "{:<24} {:<18} {:<8} {:<14} {:<12} {:>7} {:>9}",
        "name", "vendor", "framing", "flow", "end of move", "vectors", "dialogues"
    ));
    for l in &listed {
        screen::result(format_args!(
            "{:<24} {:<18} {:<8} {:<14} {:<12} {:>7} {:>9}",
            l.name,
            l.vendor,
            l.framing,
            word(&l.flow),
            word(&l.done),
            l.vectors,
            l.dialogues
        ));
    }
    Exit::Done
}

impl Listed {
    fn of(name: &'static str, spec: &Spec) -> Listed {
        Listed {
            name,
            vendor: spec.protocol.vendor.clone(),
            framing: if spec.is_line() { "lines" } else { "frames" },
            flow: spec.flow.mode,
            done: spec.done.method,
            emulated: spec.emulator.is_some(),
            vectors: spec.vector.len(),
            dialogues: spec.dialogue.len(),
        }
    }
}

/// The word that files use for a setting.
fn word(setting: &impl Serialize) -> String {
    let value = serde_json::to_value(setting).unwrap_or_default();
    value.as_str().unwrap_or_default().to_owned()
}

fn each(files: &Files, test: bool) -> Exit {
    let mut exit = Exit::Done;
    let mut verdicts = Vec::new();
    for name in &files.files {
        let (file, tested, refused) = match config::protocol_file(name) {
            Ok(file) => {
                let tested = test.then(|| conformance::check(&file.spec));
                (Some(file), tested, None)
            }
            Err(e) => (None, None, Some(e)),
        };
        if refused.is_some() {
            exit = Exit::Refused;
        } else if exit == Exit::Done && tested.as_ref().is_some_and(|t| t.failures().next().is_some()) {
            exit = Exit::Failed;
        }
        let verdict = Verdict { file: name.clone(), refused, tested };
        if !files.json {
            verdict.show(file.as_ref());
        }
        verdicts.push(verdict);
    }
    if files.json {
        screen::json(&verdicts);
    }
    exit
}

impl Verdict {
    fn show(&self, file: Option<&ProtocolFile>) {
        if let Some(e) = &self.refused {
            screen::error(e);
        }
        let Some(file) = file else { return };
        let spec = &file.spec;
        let Some(tested) = &self.tested else {
            screen::result(format_args!(
                "{}: sound ({}: {} commands, {} classes of replies, {} vectors, {} dialogues)",
                self.file,
                spec.protocol.name,
                spec.cmd.len(),
                spec.rx.len(),
                spec.vector.len(),
                spec.dialogue.len()
            ));
            return;
        };
        screen::result(format_args!("{} ({})", self.file, spec.protocol.name));
        for case in &tested.cases {
            let kind = if case.kind == CaseKind::Vector { "vector" } else { "dialogue" };
            let verdict = if case.failure.is_some() { "FAILS" } else { "holds" };
            screen::result(format_args!("  {kind:<8} {:>3}  {verdict}  {}", case.number, case.what));
            if let Some(failure) = &case.failure {
                let line = file.document.line_of(&case.key()).unwrap_or(1);
                let turn = case.turn.map(|t| format!("turn {t}: ")).unwrap_or_default();
                screen::result(format_args!("      {}:{line}: {turn}{failure}", file.document.source.path));
            }
        }
        if !tested.untested.is_empty() {
            screen::result(format_args!("  without a vector: {}", tested.untested.join(", ")));
        }
        let failed = tested.failures().count();
        screen::result(format_args!(
            "  {} vectors and {} dialogues, {}",
            tested.count(CaseKind::Vector),
            tested.count(CaseKind::Dialogue),
            if failed == 0 { "all hold".to_owned() } else { format!("{failed} of them FAIL") }
        ));
    }
}
