//! What a GRBL reports: the status line with its cadence of rare fields, and the `$` listings.
//!
//! `WCO:` and `Ov:` come now and then: two counters run down with each report, to 10 when idle and
//! to 30 (offset) or 20 (overrides) when busy, and a change zeroes them. Found in recorded dialogues
//! of 1.1h, which this reproduces report by report.

use super::super::motors::Motors;
use super::program::Program;
use super::{Grbl, State};

/// Counters of the rare fields.
#[derive(Debug, Clone, Default)]
pub struct Cadence {
    offset: u32,
    overrides: u32,
    /// grblHAL has not yet sent its first report.
    opening: bool,
}

/// Which rare fields a report carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rare {
    /// `WCO:`.
    pub offset: bool,
    /// `Ov:`.
    pub overrides: bool,
    /// grblHAL: the fields that only the first report after a reset has.
    pub opening: bool,
}

impl Cadence {
    /// As after a reset.
    pub fn after_reset(hal: bool) -> Self {
        // grblHAL sends its overrides first and the offset in the second report.
        Cadence { offset: u32::from(hal), overrides: 0, opening: hal }
    }

    /// The next report carries the offset.
    pub fn offset_changed(&mut self) {
        self.offset = 0;
    }

    /// The next report carries the overrides.
    pub fn overrides_changed(&mut self) {
        self.overrides = 0;
    }

    /// Counts one report.
    pub fn next(&mut self, busy: bool) -> Rare {
        let mut rare = Rare { opening: std::mem::take(&mut self.opening), ..Rare::default() };
        if self.offset > 0 {
            self.offset -= 1;
        } else {
            self.offset = if busy { 29 } else { 9 };
            self.overrides = self.overrides.max(1);
            rare.offset = true;
        }
        if self.overrides > 0 {
            self.overrides -= 1;
        } else {
            self.overrides = if busy { 19 } else { 9 };
            rare.overrides = true;
        }
        rare
    }
}

/// Everything a status line shows.
pub struct Status<'a> {
    /// State word with its sub-state.
    pub state: &'a str,
    /// Machine coordinates.
    pub machine: &'a [f64],
    /// Machine minus work coordinates.
    pub offset: &'a [f64],
    /// `$10`.
    pub mask: u32,
    /// Free planner blocks and receive bytes.
    pub free: (usize, usize),
    /// Speed along the path, per minute.
    pub speed: f64,
    /// Feed override, percent.
    pub feed_override: u32,
    /// Rapid override, percent.
    pub rapid_override: u32,
    /// Rare fields to show.
    pub rare: Rare,
    /// For grblHAL: whether homing is enabled, and done.
    pub hal: Option<(bool, bool)>,
}

impl Status<'_> {
    /// The line without its end.
    pub fn render(&self) -> String {
        let mut line = format!("<{}", self.state);
        if self.mask & 1 != 0 {
            line += &format!("|MPos:{}", triple(self.machine));
        } else {
            let work: Vec<f64> = self.machine.iter().zip(self.offset).map(|(m, o)| m - o).collect();
            line += &format!("|WPos:{}", triple(&work));
        }
        if self.mask & 2 != 0 {
            line += &format!("|Bf:{},{}", self.free.0, self.free.1);
        }
        line += &format!("|FS:{:.0},0", self.speed.floor());
        if self.rare.offset {
            line += &format!("|WCO:{}", triple(self.offset));
        }
        if self.rare.overrides {
            line += &format!("|Ov:{},{},100", self.feed_override, self.rapid_override);
        }
        if let (Some((enabled, homed)), true) = (self.hal, self.rare.opening) {
            line += "|A:";
            if enabled {
                line += &format!("|H:{}", u8::from(homed));
            }
            line += "|TLR:0";
        }
        line + ">"
    }
}

impl Grbl {
    pub(super) fn report_status(&mut self, full: bool) {
        let state = match self.state {
            State::Idle => "Idle",
            State::Alarm => "Alarm",
            State::Check => "Check",
            State::Run => "Run",
            State::Hold { rests } if self.t < rests => "Hold:1",
            State::Hold { .. } => "Hold:0",
            State::Jog { .. } => "Jog",
            State::Home => "Home",
            State::Sleep => "Sleep",
        };
        let busy = matches!(self.state, State::Run | State::Hold { .. } | State::Jog { .. } | State::Home);
        if full {
            self.cadence = Cadence::after_reset(true);
            self.cadence.offset_changed();
        }
        let machine: Vec<f64> =
            self.motors.iter().zip(self.motors.positions(self.t)).map(|(m, x)| m.snap(x)).collect();
        let homed = self.motors.iter().all(|m| m.referenced);
        let line = Status {
            state,
            machine: &machine,
            offset: &self.program.offset(),
            mask: self.settings.number(10) as u32,
            free: (self.planner.free(), self.spec.rx_bytes.saturating_sub(self.rx.len())),
            speed: self.motors.speed(self.t) * 60.0,
            feed_override: self.feed_override,
            rapid_override: self.rapid_override,
            rare: self.cadence.next(busy),
            hal: self.spec.hal.then(|| (self.settings.is_on(22), homed)),
        }
        .render();
        self.say(&line);
    }
}

fn triple(values: &[f64]) -> String {
    // Adding zero turns a negative zero into a plain one.
    values.iter().map(|x| format!("{:.3}", (x * 1000.0).round() / 1000.0 + 0.0)).collect::<Vec<_>>().join(",")
}

/// Lines of `$#`.
pub fn parameters(program: &Program, systems: &[String], motors: &Motors, hal: bool) -> Vec<String> {
    let zeros = triple(&vec![0.0; motors.count()]);
    let mut lines: Vec<String> = systems
        .iter()
        .enumerate()
        .map(|(i, name)| format!("[{name}:{}]", triple(program.system(i))))
        .collect();
    lines.push(format!("[G28:{zeros}]"));
    lines.push(format!("[G30:{zeros}]"));
    lines.push(format!("[G92:{}]", triple(program.g92())));
    let tool = format!("{:.3}", program.tool_length());
    lines.push(if hal { format!("[TLO:{zeros}]") } else { format!("[TLO:{tool}]") });
    lines.push(format!("[PRB:{zeros}:0]"));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rare_fields_come_as_recorded() {
        // Reports 1 to 25 after the reset in grbl11h_avr_motion, with busy as recorded.
        let mut cadence = Cadence::after_reset(false);
        let seen: Vec<Rare> = (0..25).map(|_| cadence.next(true)).collect();
        let with = |f: fn(&Rare) -> bool| -> Vec<usize> {
            seen.iter().enumerate().filter(|(_, r)| f(r)).map(|(i, _)| i).collect()
        };
        assert_eq!(with(|r| r.offset), [0]);
        assert_eq!(with(|r| r.overrides), [1, 21]);
    }
}
