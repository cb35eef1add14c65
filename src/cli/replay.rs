//! `twinrig replay LOG`: a port's log, lived through again.
//!
//! Every session writes a log of each port: `collect` into `logs/` of the dataset, other commands that open
//! devices into `$TWINRIG_LOGS` (by default `twinrig/logs` in the user's folder for state). The log is fed
//! through the engine of its protocol, which says what was asked, sent, received and concluded, and where the
//! engine of today would do otherwise.
//!
//! Exit codes: 0 the engine would do the same; 1 it would not, and the first difference is shown; 2 the file is
//! no log, or its protocol cannot be found.

use super::exit::Exit;
use super::screen;
use crate::config;
use crate::device::byte_log::whole;
use crate::device::replay::{self, Step, Story, Told};
use std::path::PathBuf;

/// Steps that are shown before a difference.
const CONTEXT: usize = 12;

/// Replay the log of a port and find the first difference
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig replay data/slip/logs/20260101T120000/arm.log\n  twinrig replay arm.log --all\n  twinrig replay stage.log --protocol ./my_stage.toml --json"
)]
pub struct Args {
    /// Log of a port
    log: PathBuf,
    /// Protocol file or name, where it is not the shipped one that the log names
    #[arg(long, value_name = "FILE")]
    protocol: Option<String>,
    /// Show every byte, not requests, ends and conclusions alone
    #[arg(long)]
    all: bool,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        match self.story() {
            Ok(story) => {
                if self.json {
                    screen::json(&story);
                } else {
                    show(&story, self.all);
                }
                if story.difference.is_some() { Exit::Failed } else { Exit::Done }
            }
            Err(message) => {
                screen::error(message);
                Exit::Refused
            }
        }
    }

    fn story(&self) -> Result<Story, String> {
        let text =
            whole(&self.log).map_err(|e| format!("{}: {e}; give the log of a port", self.log.display()))?;
        let wrong = |e: replay::ReplayError| format!("{}: {e}", self.log.display());
        let header = replay::header(&text).map_err(wrong)?;
        let name = self.protocol.as_ref().unwrap_or(&header.protocol);
        let spec = config::protocol(name).map_err(|e| match self.protocol {
            Some(_) => e.to_string(),
            None => format!("{e}\n    the log names protocol {name}: give its file with --protocol"),
        })?;
        replay::replay(&text, &spec).map_err(wrong)
    }
}

fn show(story: &Story, all: bool) {
    let header = &story.header;
    let axes: Vec<String> = header.axes.iter().map(|a| format!("{} = {}", a.name, a.wire)).collect();
    screen::result(format_args!("protocol {}, axes {}", header.protocol, axes.join(", ")));
    let matters = |s: &&Step| {
        let bytes = matches!(s.told, Told::Sent { .. } | Told::Received { .. });
        let unknown = matches!(&s.told, Told::Received { classes, .. } if classes.is_empty());
        all || !bytes || unknown
    };
    let from =
        if story.difference.is_some() { story.steps.len().saturating_sub(CONTEXT) } else { usize::MAX };
    for (i, step) in story.steps.iter().enumerate() {
        if i >= from || matters(&step) {
            line(step);
        }
    }
    if let Some(d) = &story.difference {
        screen::result(format_args!("first difference, line {} at {:.6} s:", d.line, d.at.0 as f64 * 1e-9));
        screen::result(format_args!("    log:    {}", d.log));
        screen::result(format_args!("    engine: {}", d.engine));
        return;
    }
    let verdict = if story.judged {
        "the engine of today would do the same"
    } else {
        "not compared: the beginning of this log was lost to rotation"
    };
    screen::result(format_args!(
        "{} requests, {} of them failed; {} steps; {verdict}",
        story.requests,
        story.failed,
        story.steps.len()
    ));
}

fn line(step: &Step) {
    let (sign, text) = match &step.told {
        Told::Asked { request, what } => ('?', format!("request {request}: {what}")),
        Told::Ended { request, how } => ('=', format!("request {request}: {how}")),
        Told::Sent { bytes } => ('>', bytes.clone()),
        Told::StopSent { bytes } => ('!', bytes.clone()),
        Told::Received { bytes, classes } if classes.is_empty() => ('<', format!("{bytes}  (unknown)")),
        Told::Received { bytes, classes } => ('<', format!("{bytes}  ({})", classes.join(", "))),
        Told::Stopped { how } => ('*', format!("stop, {how}")),
        Told::Lost { why } => ('*', format!("the link is lost: {why}")),
        Told::Remark { text } => ('#', text.clone()),
    };
    screen::result(format_args!("{:>6} {:>14.6} {sign} {text}", step.line, step.at.0 as f64 * 1e-9));
}
