//! What reaches the terminal: the only place that prints.
//!
//! Results go to standard output, everything else (progress, notes, errors) to standard error, so
//! that a script can pipe the one without the other. Colours appear on terminals only and respect
//! NO_COLOR. With `--json` the result is one JSON document on standard output.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is the module that prints")]

use crate::problem::legible;
use console::style;
use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use std::io::Write;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

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
    tell(legible(&line.to_string()));
}

/// A warning.
pub fn warning(line: impl std::fmt::Display) {
    let line = legible(&line.to_string());
    tell(format!("{} {line}", style("warning:").yellow().bold().for_stderr()));
}

/// An error with its causes.
pub fn error(line: impl std::fmt::Display) {
    let line = legible(&line.to_string());
    tell(format!("{} {line}", style("error:").red().bold().for_stderr()));
}

/// A display that has the terminal for itself.
struct Display {
    /// What was said meanwhile.
    held: Vec<String>,
    /// Makes the terminal what it was.
    put_back: fn(),
}

static DISPLAY: Mutex<Option<Display>> = Mutex::new(None);

/// Lines that are kept for when the display is gone.
const MOST_HELD: usize = 100;

/// A line on standard error, or on the display that has it.
fn tell(line: String) {
    let mut display = DISPLAY.lock().unwrap_or_else(PoisonError::into_inner);
    match display.as_mut() {
        Some(Display { held, .. }) => {
            if held.len() == MOST_HELD {
                held.remove(0);
            }
            held.push(line);
        }
        None => _ = writeln!(std::io::stderr(), "{line}"),
    }
}

/// The terminal for a display alone: what notes, warnings, errors and the log say meanwhile is not written over it. The
/// display shows the latest; all is told when this is dropped.
#[must_use = "the terminal is everybody's again when this is dropped"]
pub struct Alone(());

/// Takes the terminal for a display; `put_back` makes it what it was, should the process end at once.
pub fn alone(put_back: fn()) -> Alone {
    let display = Display { held: Vec::new(), put_back };
    *DISPLAY.lock().unwrap_or_else(PoisonError::into_inner) = Some(display);
    Alone(())
}

impl Alone {
    /// What was said last, in one line.
    pub fn latest(&self) -> Option<String> {
        let display = DISPLAY.lock().unwrap_or_else(PoisonError::into_inner);
        let plain = console::strip_ansi_codes(display.as_ref()?.held.last()?).into_owned();
        // Of a line of the log, what follows the time.
        let levels = ["WARN", "ERROR", "INFO", "DEBUG", "TRACE"];
        let from = levels.iter().filter_map(|level| plain.find(level)).min();
        Some(plain[from.unwrap_or(0)..].to_owned())
    }
}

impl Drop for Alone {
    fn drop(&mut self) {
        let display = DISPLAY.lock().unwrap_or_else(PoisonError::into_inner).take();
        display.into_iter().flat_map(|display| display.held).for_each(tell);
    }
}

/// Takes the terminal from a display that will not come to its end: the process ends now.
pub fn take_back() {
    let display = DISPLAY.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some(Display { held, put_back }) = display {
        put_back();
        held.into_iter().for_each(tell);
    }
}

/// Where the log is written: to standard error, or on the display that has it.
pub fn log() -> impl Write {
    Log(Vec::new())
}

/// An event of the log, whole when it is dropped.
struct Log(Vec<u8>);

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        String::from_utf8_lossy(&self.0).lines().for_each(|line| tell(line.to_owned()));
    }
}

/// A group of progress bars on standard error; silent when that is no terminal.
pub fn bars() -> MultiProgress {
    MultiProgress::new()
}

/// One bar of a group: `label [####    ] 12/48  0:31 left  what`.
pub fn bar(group: &MultiProgress, label: &'static str, length: u64) -> ProgressBar {
    let template = "{prefix:>10} [{bar:30}] {pos:>4}/{len}  {elapsed} elapsed, {rest} left  {wide_msg}";
    let rest = |state: &ProgressState, out: &mut dyn std::fmt::Write| {
        let left = left(state.elapsed(), state.pos(), state.len().unwrap_or_default());
        _ = write!(out, "{:#}", HumanDuration(left));
    };
    let style = ProgressStyle::with_template(template)
        .expect("the template is a constant")
        .with_key("rest", rest)
        .progress_chars("=> ");
    let bar = group.add(ProgressBar::new(length)).with_style(style).with_prefix(label);
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// Time left were what is left as quick as what is done. (Of the last pieces' pace, now quick, now slow, one hears of weeks.)
fn left(elapsed: Duration, done: u64, all: u64) -> Duration {
    elapsed.mul_f64(all.saturating_sub(done) as f64 / done.max(1) as f64)
}

/// Where bars stand, in one line: `real 12/48, 31 s left; simulated 8/48, 2 min left`.
pub fn progress_line(bars: &[&ProgressBar]) -> String {
    let one = |bar: &&ProgressBar| {
        let (done, all) = (bar.position(), bar.length().unwrap_or_default());
        let left = if (1..all).contains(&done) {
            format!(", {} left", HumanDuration(left(bar.elapsed(), done, all)))
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
