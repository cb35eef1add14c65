//! G-code as GRBL reads it: words, modal state, and the errors it answers with.
//!
//! Source: NIST RS274/NGC as GRBL's documentation restricts it; numbers of errors from recorded
//! dialogues and the GRBL wiki. Arcs are checked as far as their missing words and then refused with
//! error 20: no bench needs them. Probing is refused the same way.

/// Codes of `error:<n>`.
pub mod code {
    /// A word without its letter.
    pub const LETTER: u8 = 1;
    /// A word without a number.
    pub const NUMBER: u8 = 2;
    /// A `$` line that is none.
    pub const STATEMENT: u8 = 3;
    /// A negative value.
    pub const NEGATIVE: u8 = 4;
    /// Homing is off.
    pub const HOMING_OFF: u8 = 5;
    /// Not idle.
    pub const NOT_IDLE: u8 = 8;
    /// Locked.
    pub const LOCKED: u8 = 9;
    /// Soft limits without homing.
    pub const SOFT_LIMITS: u8 = 10;
    /// Line too long.
    pub const OVERFLOW: u8 = 11;
    /// Jog beyond travel.
    pub const TRAVEL: u8 = 15;
    /// Forbidden word in a jog line.
    pub const JOG: u8 = 16;
    /// Word not supported.
    pub const UNSUPPORTED: u8 = 20;
    /// Two commands of one group.
    pub const MODAL_GROUP: u8 = 21;
    /// No feed.
    pub const NO_FEED: u8 = 22;
    /// Two commands that use axis words.
    pub const AXIS_COMMANDS: u8 = 24;
    /// Word repeated.
    pub const REPEATED: u8 = 25;
    /// Axis words missing.
    pub const NO_AXIS_WORDS: u8 = 26;
    /// Value word missing.
    pub const VALUE_MISSING: u8 = 28;
    /// G53 with something else than G0 or G1.
    pub const G53: u8 = 30;
    /// Axis words without a command.
    pub const AXIS_WORDS: u8 = 31;
    /// Arc without offsets.
    pub const ARC_OFFSETS: u8 = 35;
    /// Words nothing uses.
    pub const UNUSED: u8 = 36;
    /// grblHAL: a setting that does not exist.
    pub const HAL_SETTING: u8 = 53;
}

/// What a line asks for.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Nothing that takes time.
    Nothing,
    /// A straight move to machine coordinates; `feed` per second, `None` for rapid.
    Move {
        /// Machine coordinates of all axes.
        target: Vec<f64>,
        /// Feed along the path.
        feed: Option<f64>,
    },
    /// Wait for motion to end, then this many seconds.
    Dwell(f64),
    /// Wait for motion to end (program end and stop).
    Sync,
    /// Work offsets changed.
    Offsets,
}

/// Modal state and work offsets.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    letters: Vec<u8>,
    motion: u16,
    wcs: usize,
    plane: u16,
    inches: bool,
    incremental: bool,
    inverse_time: bool,
    feed: f64,
    systems: Vec<Vec<f64>>,
    g92: Vec<f64>,
    tool_length: f64,
    /// grblHAL knows more modal words.
    hal: bool,
}

#[derive(Debug, Default)]
struct Words {
    g: Vec<u16>,
    axis: Vec<Option<f64>>,
    value: [Option<f64>; 26],
}

impl Words {
    fn value(&self, letter: u8) -> Option<f64> {
        self.value[usize::from(letter - b'A')]
    }

    fn any_axis(&self) -> bool {
        self.axis.iter().any(Option::is_some)
    }
}

impl Program {
    /// The state after a reset, for axes of these letters.
    pub fn new(letters: &[u8], systems: usize, hal: bool) -> Self {
        let zeros = vec![0.0; letters.len()];
        Self {
            letters: letters.to_vec(),
            motion: 0,
            wcs: 0,
            plane: 17,
            inches: false,
            incremental: false,
            inverse_time: false,
            feed: 0.0,
            systems: vec![zeros.clone(); systems.max(6)],
            g92: zeros,
            tool_length: 0.0,
            hal,
        }
    }

    /// What a soft reset does: work coordinate systems survive, everything else does not.
    pub fn reset(&mut self) {
        let systems = std::mem::take(&mut self.systems);
        *self = Self { systems, ..Self::new(&self.letters, 0, self.hal) };
        let axes = self.letters.len();
        self.systems.iter_mut().for_each(|s| s.resize(axes, 0.0));
    }

    /// Machine coordinates minus work coordinates.
    pub fn offset(&self) -> Vec<f64> {
        self.systems[self.wcs].iter().zip(&self.g92).map(|(a, b)| a + b).collect()
    }

    /// Offsets of a coordinate system (0 is G54).
    pub fn system(&self, index: usize) -> &[f64] {
        &self.systems[index]
    }

    /// The G92 offset.
    pub fn g92(&self) -> &[f64] {
        &self.g92
    }

    /// Tool length offset.
    pub fn tool_length(&self) -> f64 {
        self.tool_length
    }

    /// Fills the template of `$G`.
    pub fn parser_state(&self, template: &str) -> String {
        template
            .replace("{motion}", &format!("G{}", self.motion))
            .replace("{wcs}", &format!("G{}", 54 + self.wcs))
            .replace("{units}", if self.inches { "G20" } else { "G21" })
            .replace("{distance}", if self.incremental { "G91" } else { "G90" })
            .replace("{feed_mode}", if self.inverse_time { "G93" } else { "G94" })
            .replace("{feed}", &format!("{:.0}", self.feed))
    }

    /// Splits a line (already without blanks, in capitals) into words.
    fn words(&self, line: &[u8]) -> Result<Words, u8> {
        let mut words = Words { axis: vec![None; self.letters.len()], ..Words::default() };
        let mut rest = line;
        while let Some((&letter, tail)) = rest.split_first() {
            if !letter.is_ascii_uppercase() {
                return Err(code::LETTER);
            }
            let end = number_length(tail);
            let text = std::str::from_utf8(&tail[..end]).unwrap_or_default();
            let number: f64 = text.parse().map_err(|_| code::NUMBER)?;
            rest = &tail[end..];
            if let Some(i) = self.letters.iter().position(|l| *l == letter) {
                if words.axis[i].replace(number).is_some() {
                    return Err(code::REPEATED);
                }
                continue;
            }
            match letter {
                b'G' => words.g.push((number * 10.0).round() as u16),
                b'M' => {
                    if ![0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 8.0, 9.0, 30.0].contains(&number) {
                        return Err(code::UNSUPPORTED);
                    }
                    if [0.0, 1.0, 2.0, 30.0].contains(&number) {
                        words.value[usize::from(b'M' - b'A')] = Some(number);
                    }
                }
                b'F' | b'I' | b'J' | b'K' | b'L' | b'N' | b'P' | b'Q' | b'R' | b'S' | b'T' => {
                    if number < 0.0 && matches!(letter, b'F' | b'N' | b'P' | b'S' | b'T') {
                        return Err(code::NEGATIVE);
                    }
                    if words.value[usize::from(letter - b'A')].replace(number).is_some() {
                        return Err(code::REPEATED);
                    }
                }
                _ => return Err(code::UNSUPPORTED),
            }
        }
        Ok(words)
    }

    /// Executes a line of G-code; `at` are machine coordinates where the last move ends.
    pub fn execute(&mut self, line: &[u8], at: &[f64]) -> Result<Action, u8> {
        let words = self.words(line)?;
        let mut next = self.clone();
        let action = next.apply(&words, at, false)?;
        *self = next;
        Ok(action)
    }

    /// Executes what follows `$J=`: always a feed move, and modal state is left alone.
    pub fn jog(&self, line: &[u8], at: &[f64]) -> Result<Action, u8> {
        let words = self.words(line)?;
        let mut scratch = self.clone();
        scratch.motion = 1;
        scratch.inverse_time = false;
        if words.g.iter().any(|g| ![200, 210, 900, 910, 530].contains(g)) {
            return Err(code::JOG);
        }
        if !words.any_axis() {
            return Err(code::NO_AXIS_WORDS);
        }
        if words.value(b'F').is_none() {
            return Err(code::NO_FEED);
        }
        scratch.apply(&words, at, true)
    }

    fn apply(&mut self, words: &Words, at: &[f64], jog: bool) -> Result<Action, u8> {
        // Modal words first, in any order; one command at most may claim the axis words.
        let (mut machine, mut explicit, mut claim) = (false, false, None);
        let mut seen = Vec::new();
        for g in &words.g {
            let group = match g {
                0 | 10 | 20 | 30 | 800 => 1,
                170..=190 => 2,
                900 | 910 => 3,
                930 | 940 => 5,
                200 | 210 => 6,
                430 | 431 | 490 => 8,
                540..=593 => 12,
                _ => 0,
            };
            if group != 0 && seen.contains(&group) {
                return Err(code::MODAL_GROUP);
            }
            seen.push(group);
            match g {
                0 | 10 | 20 | 30 => (self.motion, explicit) = (g / 10, true),
                800 => self.motion = 80,
                170 | 180 | 190 => self.plane = g / 10,
                200 => self.inches = true,
                210 => self.inches = false,
                900 => self.incremental = false,
                910 => self.incremental = true,
                930 => self.inverse_time = true,
                940 => self.inverse_time = false,
                530 => machine = true,
                540..=590 if g % 10 == 0 && usize::from(g / 10 - 54) < self.systems.len() => {
                    self.wcs = usize::from(g / 10 - 54);
                }
                591..=593 if usize::from(g - 585) < self.systems.len() => self.wcs = usize::from(g - 585),
                40 | 400 | 490 | 610 => {}
                500 | 980 | 990 if self.hal => {}
                100 | 280 | 300 | 281 | 301 | 920 | 921 => {
                    if claim.replace(*g).is_some() {
                        return Err(code::AXIS_COMMANDS);
                    }
                }
                _ => return Err(code::UNSUPPORTED),
            }
        }
        if explicit && claim.is_some_and(|g| [100, 280, 300, 920].contains(&g)) {
            return Err(code::AXIS_COMMANDS);
        }
        let scale = if self.inches { 25.4 } else { 1.0 };
        if let Some(f) = words.value(b'F') {
            self.feed = f * scale;
        }
        let offset = self.offset();
        let unused =
            |allowed: &[u8]| b"IJKLPQR".iter().any(|l| !allowed.contains(l) && words.value(*l).is_some());

        if words.g.contains(&40) {
            let seconds = words.value(b'P').ok_or(code::VALUE_MISSING)?;
            return Ok(Action::Dwell(seconds));
        }
        match claim {
            Some(920) => {
                if !words.any_axis() {
                    return Err(code::NO_AXIS_WORDS);
                }
                for (i, word) in words.axis.iter().enumerate() {
                    if let Some(x) = word {
                        self.g92[i] = at[i] - self.systems[self.wcs][i] - x * scale;
                    }
                }
                return Ok(Action::Offsets);
            }
            Some(921) => {
                self.g92.fill(0.0);
                return Ok(Action::Offsets);
            }
            Some(100) => {
                let (l, p) = (words.value(b'L'), words.value(b'P'));
                let (Some(l), Some(p)) = (l, p) else { return Err(code::VALUE_MISSING) };
                let system = if p == 0.0 { self.wcs } else { (p as usize).saturating_sub(1) };
                if system >= self.systems.len() || (l != 2.0 && l != 20.0) {
                    return Err(code::UNSUPPORTED);
                }
                for (i, word) in words.axis.iter().enumerate() {
                    if let Some(x) = word {
                        let x = x * scale;
                        self.systems[system][i] = if l == 20.0 { at[i] - self.g92[i] - x } else { x };
                    }
                }
                return Ok(Action::Offsets);
            }
            Some(280 | 300) => return Ok(Action::Move { target: vec![0.0; at.len()], feed: None }),
            _ => {}
        }
        if words.value(b'M').is_some() {
            return Ok(Action::Sync);
        }
        if !words.any_axis() && !explicit {
            return if unused(&[]) { Err(code::UNUSED) } else { Ok(Action::Nothing) };
        }

        // A move: implicit by axis words, or explicit.
        if machine && self.motion > 1 {
            return Err(code::G53);
        }
        match self.motion {
            80 => return Err(code::AXIS_WORDS),
            0 => {}
            _ if self.feed == 0.0 => return Err(code::NO_FEED),
            _ => {}
        }
        if self.motion >= 2 {
            if !words.any_axis() {
                return Err(code::NO_AXIS_WORDS);
            }
            let centre = b"IJKR".iter().any(|l| words.value(*l).is_some());
            return Err(if centre { code::UNSUPPORTED } else { code::ARC_OFFSETS });
        }
        if unused(&[]) {
            return Err(code::UNUSED);
        }
        if !words.any_axis() {
            return Ok(Action::Nothing);
        }
        let target: Vec<f64> = words
            .axis
            .iter()
            .enumerate()
            .map(|(i, word)| match word.map(|x| x * scale) {
                None => at[i],
                Some(x) if machine => x,
                Some(x) if self.incremental => at[i] + x,
                Some(x) => x + offset[i],
            })
            .collect();
        if self.motion == 0 && !jog {
            return Ok(Action::Move { target, feed: None });
        }
        // In inverse time F is moves per minute.
        let feed = if self.inverse_time {
            let length = target.iter().zip(at).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            length * self.feed / scale
        } else {
            self.feed
        };
        Ok(Action::Move { target, feed: Some(feed / 60.0) })
    }
}

/// Length of the number that `bytes` begin with, as GRBL reads it: no exponent.
fn number_length(bytes: &[u8]) -> usize {
    let sign = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let mut dots = 0;
    sign + bytes[sign..]
        .iter()
        .take_while(|b| {
            dots += usize::from(**b == b'.');
            b.is_ascii_digit() || (**b == b'.' && dots == 1)
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn program() -> Program {
        Program::new(b"XYZ", 6, false)
    }

    #[test]
    fn recorded_errors() {
        let mut p = program();
        let at = [4.0, 0.0, 0.0];
        assert_eq!(p.execute(b"G99", &at), Err(20));
        assert_eq!(p.execute(b"X", &at), Err(2));
        assert_eq!(p.execute(b"G1X5", &at), Err(22));
        assert!(p.execute(b"G1X5F300", &at).is_ok());
        assert_eq!(p.execute(b"G2X1Y1", &at), Err(35));
        assert_eq!(p.execute(b"FOO", &at), Err(2));
        assert_eq!(p.execute(b"N1G1X5F100*22", &at), Err(1));
        assert_eq!(p.execute(b"G1A10F100", &at), Err(20));
        // An exponent is no number here: `E` is a word that does not exist.
        assert!(p.execute(b"G1X1E-05F100", &at).is_err());
    }

    #[test]
    fn work_and_machine_coordinates() {
        let mut p = program();
        let at = [5.0, 0.0, 0.0];
        assert_eq!(p.execute(b"G92X0Y0Z0", &at), Ok(Action::Offsets));
        assert_eq!(p.offset(), [5.0, 0.0, 0.0]);
        let to = |x: f64, feed| Action::Move { target: vec![x, 0.0, 0.0], feed };
        assert_eq!(p.execute(b"G1X10F300", &at), Ok(to(15.0, Some(5.0))));
        assert_eq!(p.execute(b"G53G0X10", &at), Ok(to(10.0, None)));
        assert_eq!(p.jog(b"G91G21X20F300", &at), Ok(to(25.0, Some(5.0))));
        assert_eq!(p.jog(b"G91X1", &at), Err(22));
        // Modal state is as before the jog: absolute.
        assert_eq!(p.execute(b"G1X1", &at), Ok(to(6.0, Some(5.0))));
        p.reset();
        assert_eq!(p.offset(), [0.0; 3]);
    }
}
