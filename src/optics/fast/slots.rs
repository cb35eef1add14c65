//! What a node of the picture's coarse raster holds, as a row of numbers.

use super::probes;
use super::source::KEPT;

/// Where each number stands, with so many lines to a light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slots<const N: usize> {
    lights: usize,
    /// Pictures that are made at once: one, or one a light.
    pub films: usize,
    /// Whether lines of lights appear elsewhere from every node.
    varying: bool,
    /// Whether a plate bends all of them.
    bent: bool,
    /// Whether one number stands for three colours in the indirect light.
    pub grey: bool,
}

/// The node's position.
pub const POSITION: usize = 0;

impl<const N: usize> Slots<N> {
    pub fn new(lights: usize, films: usize, varying: bool, bent: bool, grey: bool) -> Self {
        Self { lights, films, varying: varying || bent, bent, grey }
    }

    pub fn bent(&self) -> bool {
        self.bent
    }

    /// Vector irradiance of light `l`.
    pub fn direct(&self, l: usize) -> usize {
        3 + 3 * l
    }

    /// Polynomial of the indirect irradiance of a picture.
    pub fn indirect(&self, film: usize) -> usize {
        self.direct(self.lights) + self.indirect_numbers() * film
    }

    /// How many numbers that polynomial has.
    pub fn indirect_numbers(&self) -> usize {
        if self.grey { probes::TERMS } else { probes::NUMBERS }
    }

    fn per_light(&self) -> usize {
        2 + N + if self.varying { 6 * N.div_ceil(KEPT) } else { 0 }
    }

    /// Above 0 where the pad hides something of light `l`.
    pub fn light(&self, l: usize) -> usize {
        self.indirect(self.films) + self.per_light() * l
    }

    /// What the ribbon's irradiance is multiplied with to give the table's.
    pub fn gain(&self, l: usize) -> usize {
        self.light(l) + 1
    }

    /// Slopes of the pad's horizon by line, [squeezed](super::horizon::squeezed).
    pub fn horizons(&self, l: usize) -> usize {
        self.light(l) + 2
    }

    /// The ends of a line that is kept, as they appear; only where lines vary.
    pub fn line(&self, l: usize, line: usize) -> usize {
        self.horizons(l) + N + 6 * (line / KEPT)
    }

    /// Whether there is room for lines.
    pub fn varying(&self) -> bool {
        self.varying
    }

    /// Numbers of a node.
    pub fn stride(&self) -> usize {
        self.light(self.lights)
    }
}
