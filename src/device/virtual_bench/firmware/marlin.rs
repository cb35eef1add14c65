//! Marlin 1.1 to 2.1: a queue of lines, an `ok` for each, and long commands that keep the rest
//! waiting.
//!
//! Received bytes become lines; a line is checked (number, checksum) when it is *read* and executed
//! when its turn comes. A bad line flushes what was received behind it and asks for a resend, with
//! an `ok` that acknowledges nothing. `ok` after a move means queued. M400, G4 and G28 block, and
//! say so every two seconds. Soft endstops clamp silently. M114 tells where the planner ends, not
//! where the machine is; `Count` tells the steps made.
//!
//! Sources: the recorded dialogue of Marlin 1.1.6 (Creality); marlinfw.org. Not emulated: heaters,
//! extruders (E is accepted and counted), bed levelling, SD cards.

use super::motors::{Motors, PullOff};
use super::outbox::Outbox;
use super::planner::{Block, Planner};
use super::{EmulatorError, EmulatorOptions, Firmware};
use crate::clock::Timestamp;
use crate::protocol::emulation::MarlinEmulation;
use std::collections::VecDeque;
use std::time::Duration;

/// What the command at the head of the queue waits for.
#[derive(Debug, Clone)]
enum Waiting {
    Nothing,
    /// Room in the planner.
    Room(Block),
    /// The end of motion, then a dwell, then the answer.
    Sync {
        dwell: Duration,
        then: Then,
    },
    Until {
        until: Timestamp,
        then: Then,
    },
    /// Homing: the axis that moves and when it arrives, and the axes still to come.
    Homing {
        active: Option<(usize, Timestamp)>,
        left: VecDeque<usize>,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    Ok,
    Position,
}

/// The emulated printer.
pub struct Marlin {
    spec: MarlinEmulation,
    motors: Motors,
    planner: Planner,
    outbox: Outbox,
    rx: VecDeque<u8>,
    line: Vec<u8>,
    queue: VecDeque<Vec<u8>>,
    waiting: Waiting,
    busy_at: Timestamp,
    last_line: i64,
    relative: bool,
    inches: bool,
    feed: f64,
    endstops: bool,
    /// M120: switches are watched at all times, not during homing alone.
    watches_switches: bool,
    extruder: f64,
    target: Vec<f64>,
    killed: bool,
    t: Timestamp,
}

impl Marlin {
    /// A printer that is switched on at `now`.
    pub fn new(
        spec: &MarlinEmulation,
        options: &EmulatorOptions,
        motors: Motors,
        outbox: Outbox,
        now: Timestamp,
    ) -> Result<Self, EmulatorError> {
        let mut spec = spec.clone();
        if let Some(identity) = &options.identity {
            spec.identify.clone_from(identity);
        }
        if let Some((key, value)) = options.settings.iter().next() {
            let allowed = "a setting that Marlin stores (it has none here)";
            return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
        }
        let mut marlin = Self {
            planner: Planner::new(spec.planner_blocks),
            target: motors.positions(now),
            spec,
            motors,
            outbox,
            rx: VecDeque::new(),
            line: Vec::new(),
            queue: VecDeque::new(),
            waiting: Waiting::Nothing,
            busy_at: now,
            last_line: 0,
            relative: false,
            inches: false,
            feed: 25.0,
            endstops: true,
            watches_switches: false,
            extruder: 0.0,
            killed: false,
            t: now,
        };
        marlin.boot();
        Ok(marlin)
    }

    fn say(&mut self, line: &str) {
        self.outbox.send(self.t, format!("{line}\n"));
    }

    fn boot(&mut self) {
        for line in self.spec.boot.clone() {
            self.say(&line);
        }
    }

    /// Moves received bytes into the command queue while there is room.
    fn read_lines(&mut self) {
        while self.queue.len() < self.spec.queue_lines
            && let Some(byte) = self.rx.pop_front()
        {
            match byte {
                b'\n' | b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    let text = strip_comment(&line);
                    if !text.is_empty() {
                        self.accept(text);
                    }
                }
                _ if self.line.len() < 95 => self.line.push(byte),
                _ => {}
            }
        }
    }

    /// Checks number and checksum of a line and queues it.
    fn accept(&mut self, line: &[u8]) {
        let star = line.iter().rposition(|b| *b == b'*');
        let mut body = &line[..star.unwrap_or(line.len())];
        if line[0] == b'N' && line.get(1).is_some_and(|b| b.is_ascii_digit() || *b == b'-') {
            let (number, rest) = leading_number(&line[1..]);
            let is_m110 = line.windows(4).any(|w| w == b"M110");
            // `N<a> M110 N<b>` sets the counter to b.
            let number = match (is_m110, line[1..].iter().position(|b| *b == b'N')) {
                (true, Some(i)) => leading_number(&line[i + 2..]).0,
                _ => number,
            };
            if number != self.last_line + 1 && !is_m110 {
                return self.refuse("Line Number is not Last Line Number+1", true);
            }
            let Some(star) = star else {
                return self.refuse("No Checksum with line number", true);
            };
            let sum = line[..star].iter().fold(0u8, |s, b| s ^ b);
            if leading_number(&line[star + 1..]).0 != i64::from(sum) {
                return self.refuse("checksum mismatch", true);
            }
            self.last_line = number;
            let skipped = line.len() - 1 - rest.len();
            body = body[1 + skipped..].trim_ascii();
        } else if star.is_some() {
            return self.refuse("No Line Number with checksum", false);
        }
        if !self.spec.emergency_parser && body == b"M112" {
            return self.kill();
        }
        self.queue.push_back(body.to_vec());
    }

    /// With an emergency parser M112 and M410 act as soon as their line is complete.
    fn emergency(&mut self) {
        let bytes = self.rx.make_contiguous();
        let line = bytes.split_last().map_or(&[][..], |(_, head)| head);
        let start = line.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
        match line[start..].trim_ascii() {
            b"M112" => self.kill(),
            b"M410" => self.quick_stop(),
            _ => {}
        }
    }

    fn refuse(&mut self, why: &str, resend: bool) {
        let last = self.last_line;
        self.say(&format!("Error:{why}, Last Line: {last}"));
        if resend {
            self.rx.clear();
            self.say(&format!("Resend: {}", last + 1));
            self.say("ok");
        }
    }

    fn kill(&mut self) {
        self.motors.halt(self.t);
        self.planner.clear();
        self.queue.clear();
        if !self.spec.kill_text.is_empty() {
            let text = self.spec.kill_text.clone();
            self.say(&text);
        }
        self.killed = true;
    }

    /// Stops without deceleration and drops every queued move.
    fn quick_stop(&mut self) {
        self.motors.halt(self.t);
        self.planner.clear();
        self.target = self.motors.positions(self.t);
        if matches!(self.waiting, Waiting::Room(_) | Waiting::Homing { .. }) {
            self.waiting = Waiting::Nothing;
            self.say("ok");
        }
    }

    fn execute(&mut self, line: &[u8]) {
        let (command, words) = split_command(line);
        match command.as_str() {
            "G0" | "G1" => return self.line_move(&words),
            "G4" => {
                let ms = word(&words, b'P').unwrap_or(0.0) + 1000.0 * word(&words, b'S').unwrap_or(0.0);
                return self.sync(Duration::from_secs_f64((ms / 1000.0).clamp(0.0, 1e6)), Then::Ok);
            }
            "M400" => return self.sync(Duration::ZERO, Then::Ok),
            "G28" => return self.start_homing(&words),
            "G20" => self.inches = true,
            "G21" => self.inches = false,
            "G90" => self.relative = false,
            "G91" => self.relative = true,
            "G92" => self.set_position(&words),
            "M110" => {
                if let Some(n) = word(&words, b'N') {
                    self.last_line = n as i64;
                }
            }
            "M114" if self.spec.position_waits => return self.sync(Duration::ZERO, Then::Position),
            "M114" => self.report_position(),
            "M115" => self.spec.identify.clone().iter().for_each(|l| self.say(l)),
            "M105" => {
                let text = format!("ok {}", self.spec.temperatures);
                return self.say(&text);
            }
            "M113" => {
                if let Some(s) = word(&words, b'S') {
                    self.spec.busy_ms = (s * 1000.0) as u64;
                }
            }
            "M120" => self.watches_switches = true,
            "M121" => self.watches_switches = false,
            "M211" => self.soft_endstops(&words),
            "M92" | "M503" => {
                let steps = self.motors.iter().map(|m| format!(" {}{:.2}", m.wire, m.counts_per_unit));
                let steps = steps.collect::<String>();
                let listing = if command == "M92" {
                    vec!["echo: M92{steps}".to_owned()]
                } else {
                    self.spec.settings.clone()
                };
                listing.iter().for_each(|l| self.say(&l.replace("{steps}", &steps)));
            }
            "M410" => self.quick_stop(),
            "M112" => return self.kill(),
            _ => {
                let is_code =
                    matches!(line[0], b'G' | b'M' | b'T') && line.get(1).is_some_and(u8::is_ascii_digit);
                let known = KNOWN_WITHOUT_EFFECT.contains(&command.as_str());
                if !is_code || (self.spec.reports_unknown_codes && !known) {
                    self.say(&format!("echo:Unknown command: \"{}\"", String::from_utf8_lossy(line)));
                }
            }
        }
        self.say("ok");
    }

    fn line_move(&mut self, words: &[(u8, f64)]) {
        let scale = if self.inches { 25.4 } else { 1.0 };
        if let Some(f) = word(words, b'F').filter(|f| *f > 0.0) {
            self.feed = f * scale / 60.0;
        }
        if let Some(e) = word(words, b'E').filter(|_| self.motors.find("E").is_none()) {
            self.extruder = if self.relative { self.extruder + e } else { e };
        }
        for i in 0..self.motors.count() {
            let motor = self.motors.axis(i);
            let Some(x) = motor.wire.bytes().next().and_then(|letter| word(words, letter)) else { continue };
            let wanted = if self.relative { self.target[i] + x * scale } else { x * scale };
            // Soft endstops clamp without a word.
            let allowed = if self.endstops { wanted.clamp(motor.min, motor.max) } else { wanted };
            self.target[i] = allowed;
        }
        let block = Block { target: self.target.clone(), feed: self.feed };
        if self.planner.free() == 0 {
            self.wait(Waiting::Room(block));
        } else {
            self.planner.push(&mut self.motors, self.t, block);
            self.say("ok");
        }
    }

    fn set_position(&mut self, words: &[(u8, f64)]) {
        for i in 0..self.motors.count() {
            let letter = self.motors.axis(i).wire.bytes().next();
            if let Some(x) = letter.and_then(|l| word(words, l)) {
                self.target[i] = x;
                self.motors.redefine(i, self.t, x);
            }
        }
    }

    fn report_position(&mut self) {
        let mut line = String::new();
        for (m, x) in self.motors.iter().zip(&self.target) {
            line += &format!("{}:{:.2} ", m.wire, x);
        }
        if self.motors.find("E").is_none() {
            line += &format!("E:{:.2} ", self.extruder);
        }
        line += "Count";
        for (m, x) in self.motors.iter().zip(self.motors.positions(self.t)).filter(|(m, _)| m.wire != "E") {
            line += &format!(" {}:{}", m.wire, m.counts(x));
        }
        self.say(&line);
    }

    fn soft_endstops(&mut self, words: &[(u8, f64)]) {
        if let Some(s) = word(words, b'S') {
            self.endstops = s != 0.0;
        }
        let state = if self.endstops { "On " } else { "Off" };
        let side = |pick: fn(&super::motors::Motor) -> f64| -> String {
            self.motors
                .iter()
                .filter(|m| m.wire != "E")
                .map(|m| format!(" {}{:.2}", m.wire, pick(m)))
                .collect()
        };
        let (min, max) = (side(|m| m.min), side(|m| m.max));
        self.say(&format!("echo:Soft endstops: {state}  Min:{min}  Max:{max}"));
    }

    fn sync(&mut self, dwell: Duration, then: Then) {
        self.wait(Waiting::Sync { dwell, then });
    }

    fn wait(&mut self, waiting: Waiting) {
        self.busy_at = self.t.after(Duration::from_millis(self.spec.busy_ms.max(1)));
        self.waiting = waiting;
    }

    fn start_homing(&mut self, words: &[(u8, f64)]) {
        let left: VecDeque<usize> = (0..self.motors.count())
            .filter(|i| {
                let wire = &self.motors.axis(*i).wire;
                wire != "E" && (words.is_empty() || words.iter().any(|(l, _)| wire.as_bytes() == [*l]))
            })
            .collect();
        self.wait(Waiting::Homing { active: None, left });
    }

    fn home_axis(&mut self, i: usize) -> Timestamp {
        let feed = self.spec.homing_feed.get(&self.motors.axis(i).wire).copied().unwrap_or(20.0);
        let touched = self.motors.seek_home(i, self.t, feed, PullOff { distance: 0.0, feed });
        // Time for the second, slow touch that every printer makes.
        touched.after(Duration::from_secs_f64(10.0 / feed))
    }

    fn finish(&mut self, then: Then) {
        self.waiting = Waiting::Nothing;
        if then == Then::Position {
            self.report_position();
        }
        self.say("ok");
    }

    fn next_event(&self) -> Option<Timestamp> {
        if self.killed {
            return None;
        }
        let waiting = match &self.waiting {
            Waiting::Until { until, .. } | Waiting::Homing { active: Some((_, until)), .. } => Some(*until),
            _ => None,
        };
        let blocked = !matches!(self.waiting, Waiting::Nothing);
        let busy = (blocked && self.spec.busy_ms > 0).then_some(self.busy_at);
        [waiting, busy, self.planner.ends()].into_iter().flatten().min()
    }

    fn event(&mut self) {
        if self.planner.ends().is_some_and(|t| t <= self.t) {
            self.planner.next(&mut self.motors);
        }
        match self.waiting.clone() {
            Waiting::Until { until, then } if until <= self.t => self.finish(then),
            Waiting::Homing { active: Some((i, until)), left } if until <= self.t => {
                self.motors.set_home(i);
                self.target[i] = self.motors.axis(i).switch();
                self.waiting = Waiting::Homing { active: None, left };
            }
            _ => {}
        }
        let blocked = !matches!(self.waiting, Waiting::Nothing);
        if blocked && self.spec.busy_ms > 0 && self.busy_at <= self.t {
            self.say("echo:busy: processing");
            self.busy_at = self.busy_at.after(Duration::from_millis(self.spec.busy_ms));
        }
    }

    /// Executes queued lines until one blocks.
    fn go_on(&mut self) {
        while !self.killed {
            match self.waiting.clone() {
                Waiting::Room(block) if self.planner.free() > 0 => {
                    self.waiting = Waiting::Nothing;
                    self.planner.push(&mut self.motors, self.t, block);
                    self.say("ok");
                }
                Waiting::Sync { dwell, then } if self.planner.is_empty() => {
                    if dwell.is_zero() {
                        self.finish(then);
                    } else {
                        self.waiting = Waiting::Until { until: self.t.after(dwell), then };
                    }
                }
                Waiting::Homing { active: None, mut left } if self.planner.is_empty() => {
                    match left.pop_front() {
                        None => self.finish(Then::Ok),
                        Some(i) => {
                            let active = Some((i, self.home_axis(i)));
                            self.waiting = Waiting::Homing { active, left };
                        }
                    }
                }
                Waiting::Nothing => {
                    self.read_lines();
                    let Some(line) = self.queue.pop_front() else { return };
                    self.execute(&line);
                }
                _ => {
                    self.read_lines();
                    return;
                }
            }
        }
    }
}

/// Codes that a printer accepts and that change nothing here.
const KNOWN_WITHOUT_EFFECT: [&str; 12] =
    ["M17", "M18", "M84", "M82", "M83", "M104", "M106", "M107", "M140", "M155", "M201", "M220"];

fn strip_comment(line: &[u8]) -> &[u8] {
    let end = line.iter().position(|b| *b == b';').unwrap_or(line.len());
    line[..end].trim_ascii()
}

/// A whole number at the start, 0 if there is none, and what follows it.
fn leading_number(bytes: &[u8]) -> (i64, &[u8]) {
    let bytes = bytes.trim_ascii_start();
    let sign = usize::from(bytes.first() == Some(&b'-'));
    let end = sign + bytes[sign..].iter().take_while(|b| b.is_ascii_digit()).count();
    let number = std::str::from_utf8(&bytes[..end]).ok().and_then(|t| t.parse().ok()).unwrap_or(0);
    (number, &bytes[end..])
}

/// `G1 X2 F3` as `G1` and its words. Marlin ignores what it cannot read.
fn split_command(line: &[u8]) -> (String, Vec<(u8, f64)>) {
    let text = String::from_utf8_lossy(line);
    let compact = text.trim();
    let head =
        compact.char_indices().skip(1).find(|(_, c)| !c.is_ascii_digit()).map_or(compact.len(), |(i, _)| i);
    let (command, rest) = compact.split_at(head);
    let mut words = Vec::new();
    let bytes = rest.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let letter = bytes[i];
        i += 1;
        if letter.is_ascii_uppercase() {
            let start = i;
            while i < bytes.len() && (bytes[i].is_ascii_digit() || b"+-.".contains(&bytes[i])) {
                i += 1;
            }
            words.push((letter, rest[start..i].parse().unwrap_or(0.0)));
        }
    }
    let digits = command.get(1..).unwrap_or_default();
    let number = digits.parse::<u32>().map_or_else(|_| digits.to_owned(), |n| n.to_string());
    (format!("{}{number}", command.get(..1).unwrap_or_default()), words)
}

fn word(words: &[(u8, f64)], letter: u8) -> Option<f64> {
    words.iter().find(|(l, _)| *l == letter).map(|(_, x)| *x)
}

impl Firmware for Marlin {
    fn receive(&mut self, bytes: &[u8], now: Timestamp) {
        self.t = now;
        for byte in bytes {
            if self.killed {
                return;
            }
            if self.rx.len() < self.spec.rx_bytes {
                self.rx.push_back(*byte);
            }
            if self.spec.emergency_parser && *byte == b'\n' {
                self.emergency();
            }
            self.go_on();
        }
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(t) = self.next_event().filter(|t| *t <= now) {
            self.t = self.t.max(t);
            self.event();
            self.go_on();
        }
        self.t = now;
    }

    fn deadline(&self) -> Option<Timestamp> {
        self.next_event()
    }

    fn outbox(&mut self) -> &mut Outbox {
        &mut self.outbox
    }

    fn restart(&mut self, now: Timestamp) {
        self.t = now;
        self.motors.power_up(now);
        self.planner.clear();
        self.rx.clear();
        self.line.clear();
        self.queue.clear();
        self.waiting = Waiting::Nothing;
        (self.last_line, self.relative, self.inches, self.feed) = (0, false, false, 25.0);
        (self.endstops, self.extruder, self.killed) = (true, 0.0, false);
        self.watches_switches = false;
        self.target.fill(0.0);
        self.boot();
    }

    /// Unless it was told M120, Marlin watches its switches while homing alone: a hit at another time is a
    /// crash that loses steps without a word. With M120 the move is cut short, and M114 goes on telling its end.
    fn trip(&mut self, now: Timestamp) {
        self.t = now;
        if self.watches_switches && !self.killed {
            let at = self.motors.positions(now);
            let axis = (0..self.motors.count()).find(|i| self.motors.velocity(*i, now) != 0.0).unwrap_or(0);
            self.motors.halt(now);
            self.planner.clear();
            let hit = format!("echo:endstops hit:  {}:{:.2}", self.motors.axis(axis).wire, at[axis]);
            return self.say(&hit);
        }
        for i in 0..self.motors.count() {
            if self.motors.velocity(i, now) != 0.0 {
                self.motors.lose(i, now, 0.5 * self.motors.axis(i).inward());
            }
        }
    }

    fn motors(&mut self) -> &mut Motors {
        &mut self.motors
    }
}
