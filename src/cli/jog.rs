//! `twinrig jog RIG`: move the bench by hand.
//!
//! | keys | do |
//! |---|---|
//! | left, right; up, down | x; y as in the picture |
//! | page up, page down | z, away from the sensor and towards it |
//! | `,` `.` | turn against and with the clock |
//! | `+` `-` | step size |
//! | `f` `s` | faster, slower |
//! | `h` | home all axes |
//! | space | stop all devices now |
//! | `q`, Esc, Ctrl-C | stop and quit |
//!
//! A touch is one step. A key that is held moves for as long as its repeats arrive: when none has come for 150 ms,
//! when it is let go or when the window loses the focus (where the terminal tells), the motion ends. Nothing
//! moves beyond a limit, nor below the nominal contact without `--press`, nor before the axes are homed.

mod keys;
mod terminal;

use super::at_bench::{AtBench, Wanted};
use super::exit::Exit;
use super::options::{self, RigOptions, Speed};
use super::screen;
use crate::control::Board;
use crate::motion::Coordinate;
use crate::session::bench::Feeds;
use crate::session::jog::{Doing, Hold, Jog, Pace, View, Wish};
use crate::session::{Bench, StopLevel};
use keys::{Key, Meaning};
use std::time::Duration;
use tokio::sync::{mpsc, watch};

/// Move the bench by hand, with the keyboard
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Keys: arrows x and y, page up/down z, , and . turn, + - step, f s feed, h home, space stop, q quit.\n\n\
Examples:\n  twinrig jog rig_configs/virtual.toml\n  twinrig jog rig_configs/skin_marlin_grbl.toml --press --feed 0.5"
)]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// First step size, mm
    #[arg(long, default_value_t = 0.1, value_parser = options::quantity("mm"))]
    pub step: f64,
    /// Feed along lines, mm/s
    #[arg(long, default_value_t = 2.0, value_parser = options::quantity("mm/s"))]
    pub feed: f64,
    /// Feed of the rotation, deg/s
    #[arg(long, default_value_t = 10.0, value_parser = options::quantity("deg/s"))]
    pub turn: f64,
    /// Allow heights below the nominal contact
    #[arg(long)]
    pub press: bool,
    #[command(flatten)]
    pub speed: Speed,
}

/// Step sizes to choose from, mm; a turning step is ten times as many degrees.
const STEPS_MM: [f64; 7] = [0.01, 0.02, 0.05, 0.1, 0.5, 1.0, 5.0];
/// Largest first step, mm.
const LONGEST_STEP_MM: f64 = 10.0;
/// Nobody stops by hand what goes faster, mm/s and degrees/s.
const FASTEST_MM_S: f64 = 50.0;
const FASTEST_DEG_S: f64 = 180.0;
/// Degrees for a millimetre.
const DEG_PER_MM: f64 = 10.0;
/// How often the display is painted.
const PAINT: Duration = Duration::from_millis(100);

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let wished = [
            ("step", self.step, LONGEST_STEP_MM, "mm"),
            ("feed", self.feed, FASTEST_MM_S, "mm/s"),
            ("turn", self.turn, FASTEST_DEG_S, "deg/s"),
        ];
        for (name, value, most, unit) in wished {
            // NaN is in no range.
            if !(value > 0.0 && value <= most) {
                screen::error(format_args!(
                    "--{name} {value:?} is outside 0 to {most} {unit}; choose a value inside, or leave it out; nothing was moved"
                ));
                return Exit::Refused;
            }
        }
        if !terminal::is_one() {
            screen::error("jogging needs a terminal to read keys from; use `twinrig move` in a script");
            return Exit::Refused;
        }
        let wanted = Wanted::by_hand("jog", &self.rig, &self.speed);
        let mut at = match AtBench::open(wanted).await {
            Ok(at) => at,
            Err(exit) => return exit,
        };
        let mut terminal = match terminal::Terminal::open() {
            Ok(terminal) => terminal,
            Err(e) => {
                screen::error(format_args!("the terminal does not give single keys: {e}"));
                return Exit::Failed;
            }
        };
        let (wishes, wished) = mpsc::unbounded_channel();
        let (view, seen) = watch::channel(View::default());
        let mut pace = self.pace();
        let hold = Hold::new(terminal.tells_repeats());
        let display = Display::new(&at.assembled.bench, at.board().clone(), terminal.tells_repeats());
        let stop = at.assembled.bench.stop.clone();
        let jog = Jog::new(&mut at.assembled.bench, pace, self.press, hold, wished, view);
        let mut jogged = Box::pin(jog.run());
        let alone = screen::alone(terminal::put_back);
        let mut painted = 0;
        // Not a sleep of its own in every turn: the repeats of a held key would put it off for ever.
        let mut paint = tokio::time::interval(PAINT);
        paint.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let ended = loop {
            tokio::select! {
                ended = &mut jogged => break ended,
                key = terminal.key() => match meaning(key) {
                    Some(Meaning::Wish(wish)) => _ = wishes.send(wish),
                    Some(Meaning::Step(up)) => {
                        pace.step_mm = next_step(pace.step_mm, up);
                        pace.step_deg = pace.step_mm * DEG_PER_MM;
                        _ = wishes.send(Wish::Pace(pace));
                    }
                    Some(Meaning::Faster(up)) => {
                        let factor = if up { 2.0 } else { 0.5 };
                        let Feeds { mm_s, deg_s } = pace.feeds;
                        pace.feeds = Feeds {
                            mm_s: (mm_s * factor).clamp(0.01, 100.0),
                            deg_s: (deg_s * factor).clamp(0.1, 360.0),
                        };
                        _ = wishes.send(Wish::Pace(pace));
                    }
                    None => {}
                },
                _ = paint.tick() => {
                    let lines = display.lines(&seen.borrow(), pace, alone.latest());
                    screen::paint(&lines, painted);
                    painted = lines.len();
                }
            }
        };
        drop((terminal, jogged, alone));
        if ended.is_err() {
            stop.raise(StopLevel::Controlled);
        }
        at.finish(ended)
    }

    fn pace(&self) -> Pace {
        let feeds = Feeds { mm_s: self.feed, deg_s: self.turn };
        Pace { step_mm: self.step, step_deg: self.step * DEG_PER_MM, feeds }
    }
}

/// A terminal that is gone wants nothing any more.
fn meaning(key: Option<Key>) -> Option<Meaning> {
    match key {
        Some(key) => keys::meaning(key),
        None => Some(Meaning::Wish(Wish::Quit)),
    }
}

/// The next larger or smaller step size.
fn next_step(now: f64, up: bool) -> f64 {
    let next = match up {
        true => STEPS_MM.iter().find(|s| **s > now * 1.001),
        false => STEPS_MM.iter().rfind(|s| **s < now * 0.999),
    };
    next.copied().unwrap_or(now)
}

/// What is painted.
struct Display {
    ranges: Vec<(Coordinate, [f64; 2])>,
    board: Board,
    tells_repeats: bool,
}

impl Display {
    fn new(bench: &Bench, board: Board, tells_repeats: bool) -> Display {
        let ranges = Coordinate::ALL.into_iter().filter_map(|c| Some((c, bench.range(c)?))).collect();
        Display { ranges, board, tells_repeats }
    }

    fn lines(&self, view: &View, pace: Pace, latest: Option<String>) -> Vec<String> {
        // What the devices last told, also while they move.
        let pose = self.board.status(StopLevel::Running).pose.or(view.pose);
        let mut lines = Vec::new();
        for (coordinate, [low, high]) in &self.ranges {
            let unit = if *coordinate == Coordinate::Theta { "deg" } else { "mm" };
            let at = pose.map(|p| coordinate.of(&p));
            let shown = at.map_or_else(|| "?".to_owned(), |at| format!("{at:9.3}"));
            let limits = format!("{low:.1} [{}] {high:.1}", bar(at, *low, *high));
            lines.push(format!("{:>5} {shown:>9} {unit:<3}  {limits}", coordinate.name()));
        }
        let doing = match view.doing {
            Doing::Rest if !view.is_referenced => "not homed: press h".to_owned(),
            Doing::Rest => "at rest".to_owned(),
            Doing::Step(d) => format!("step of {}", d.coordinate.name()),
            Doing::Glide(d) => format!("{} while the key is held", d.coordinate.name()),
            Doing::Homing => "homing".to_owned(),
        };
        lines.push(format!(
            "step {} mm, {} deg   feed {} mm/s, {} deg/s   {doing}",
            pace.step_mm, pace.step_deg, pace.feeds.mm_s, pace.feeds.deg_s
        ));
        lines.push(
            "arrows x y   page up/down z   , . turn   + - step   f s feed   h home   space stop   q quit"
                .into(),
        );
        if !self.tells_repeats {
            lines.push(
                "(this terminal tells no key releases: motion ends 150 ms after the last repeat)".into(),
            );
        }
        lines.push(view.says.clone());
        lines.push(latest.unwrap_or_default());
        lines
    }
}

/// Where between its ends a coordinate is.
fn bar(at: Option<f64>, low: f64, high: f64) -> String {
    const WIDTH: usize = 30;
    let mut cells = vec!['-'; WIDTH];
    if let Some(at) = at {
        let part = ((at - low) / (high - low)).clamp(0.0, 1.0);
        cells[((part * WIDTH as f64) as usize).min(WIDTH - 1)] = '#';
    }
    cells.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_sizes_go_up_and_down_and_end() {
        assert_eq!(next_step(0.1, true), 0.5);
        assert_eq!(next_step(0.1, false), 0.05);
        assert_eq!(next_step(0.3, true), 0.5);
        assert_eq!(next_step(5.0, true), 5.0);
        assert_eq!(next_step(0.01, false), 0.01);
    }

    #[test]
    fn the_bar_shows_the_ends() {
        assert!(bar(Some(-1.0), 0.0, 1.0).starts_with('#'));
        assert!(bar(Some(1.0), 0.0, 1.0).ends_with('#'));
        assert!(!bar(None, 0.0, 1.0).contains('#'));
    }
}
