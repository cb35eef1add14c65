//! What reaches the terminal: the only place that prints.
//!
//! Results go to standard output, everything else (progress, notes, errors) to standard error, so
//! that a script can pipe the one without the other. Colours appear on terminals only and respect
//! NO_COLOR. With `--json` the result is one JSON document on standard output.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is the module that prints")]

use console::style;
use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressStyle};
use std::io::Write;

/// Prints a line of the result. A closed pipe (`| head`) is no error.
pub fn result(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Prints a value as one JSON document.
pub fn json(value: &impl serde::Serialize) {
    match serde_json::to_string_pretty(value) {
        Ok(text) => result(text),
        Err(e) => error(format_args!("this result cannot be written as JSON: {e}")),
    }
}

/// A note for whoever watches.
pub fn note(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// A warning.
pub fn warning(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{} {line}", style("warning:").yellow().bold().for_stderr());
}

/// An error with its causes.
pub fn error(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{} {line}", style("error:").red().bold().for_stderr());
}

/// A group of progress bars on standard error; silent when that is no terminal.
pub fn bars() -> MultiProgress {
    MultiProgress::new()
}

/// One bar of a group: `label [####    ] 12/48  0:31 left  what`.
pub fn bar(group: &MultiProgress, label: &'static str, length: u64) -> ProgressBar {
    let template = "{prefix:>10} [{bar:30}] {pos:>4}/{len}  {elapsed} elapsed, {eta} left  {wide_msg}";
    let style =
        ProgressStyle::with_template(template).expect("the template is a constant").progress_chars("=> ");
    let bar = group.add(ProgressBar::new(length)).with_style(style).with_prefix(label);
    bar.enable_steady_tick(std::time::Duration::from_millis(250));
    bar
}

/// Where bars stand, in one line: `real 12/48, 31 s left; simulated 8/48, 2 min left`.
pub fn progress_line(bars: &[&ProgressBar]) -> String {
    let one = |bar: &&ProgressBar| {
        let (done, all) = (bar.position(), bar.length().unwrap_or_default());
        let left = if (1..all).contains(&done) {
            format!(", {} left", HumanDuration(bar.eta()))
        } else {
            String::new()
        };
        format!("{} {done}/{all}{left}", bar.prefix())
    };
    bars.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// Paints lines over the ones painted before, `over` of them, in the place where the cursor is. For displays that
/// live; the terminal may be in raw mode.
pub fn paint(lines: &[String], over: usize) {
    use crossterm::{cursor, queue, terminal};
    let mut out = std::io::stderr();
    let width = usize::from(console::Term::stderr().size().1).max(20);
    if over > 0 {
        let up = u16::try_from(over).unwrap_or(u16::MAX);
        _ = queue!(out, cursor::MoveToPreviousLine(up));
    }
    _ = queue!(out, terminal::Clear(terminal::ClearType::FromCursorDown));
    for line in lines {
        // A line that wraps would be painted over by halves.
        _ = write!(out, "{}\r\n", console::truncate_str(line, width - 1, "…"));
    }
    _ = out.flush();
}

/// Asks a question on the terminal; `None` when standard input is not one.
pub fn ask(question: &str) -> Option<String> {
    if !console::user_attended() {
        return None;
    }
    let _ = write!(std::io::stderr(), "{} {question} ", style("?").cyan().bold().for_stderr());
    let _ = std::io::stderr().flush();
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer).ok()?;
    Some(answer.trim().to_owned())
}
