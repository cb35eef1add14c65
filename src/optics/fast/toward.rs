//! The way from a point of the pad towards a light, and the horizon under which it is seen.

use super::horizon::{Heights, Stand};
use super::source::Line;
use glam::{Vec2, Vec3};

/// Horizons are followed this far below a light, as a slope, so that they can be interpolated.
const BELOW: f32 = 0.05;

/// A line of a light as it is looked at from a point of the pad.
#[derive(Debug, Clone, Copy)]
pub struct Toward {
    ahead: Vec2,
    distance: f32,
    /// Slope under which its lower end appears.
    pub from: f32,
    /// The same of its upper end.
    pub to: f32,
}

impl Toward {
    /// Towards a line that is given by its ends, from the point that looks at it, mm.
    #[inline(always)]
    pub fn new([low, high]: Line) -> Self {
        let middle = (low + high).truncate() * 0.5;
        let distance = middle.length().max(1e-6);
        let ahead = middle / distance;
        let slope = |q: Vec3| q.z / q.truncate().dot(ahead).max(1e-3 * distance);
        Self { ahead, distance, from: slope(low), to: slope(high) }
    }

    /// From here upwards horizons are followed.
    #[inline(always)]
    pub fn least(&self) -> f32 {
        self.from.min(self.to) - BELOW
    }

    /// Slope up to which the pad hides what lies that way; whether the light is `bent` on its way, through a plate.
    #[inline(always)]
    pub fn horizon(&self, heights: &Heights, from: impl Into<Stand>, bent: bool) -> f32 {
        // A light that appears through a plate has no distance: the pad's rim ends the line of sight.
        let distance = if bent { f32::INFINITY } else { self.distance };
        heights.horizon(from, self.ahead, distance, self.least(), self.from.max(self.to))
    }
}
