//! Paths of light between any two points by way of a plate: mirrored in it where both are on one side, else through it.

use super::Slab;
use crate::optics::bsdf::fresnel;
use glam::{Vec2, Vec3};

/// A path from a point outside of the plate to one anywhere.
#[derive(Debug, Clone, Copy)]
pub struct Way {
    /// The unit vector in which the far end appears from the near one, and in which light leaves it there.
    pub appears: Vec3,
    pub leaves: Vec3,
    /// Part of the light that arrives. (Radiance in the plate counts over n^2.)
    pub part: f32,
    /// Solid angle filled by a square millimetre of the far end that faces the way there.
    pub angle_per_mm2: f32,
}

/// Where the near end is, of a path whose far end is below the plate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Near {
    Below,
    Within,
    Above,
}

impl Slab {
    /// The path from `y`, outside of the plate, to `p`, one of several: the higher the `order`, the more reflections inside, and the
    /// less light arrives.
    pub fn way(&self, p: Vec3, y: Vec3, order: usize) -> Way {
        // From above it is the same upside down.
        let turned = y.z > self.high;
        let height = |p: Vec3| if turned { self.low + self.high - p.z } else { p.z };
        let (near_z, far_z) = (height(p), height(y));
        let near = match near_z {
            z if z < self.low => Near::Below,
            z if z <= self.high => Near::Within,
            _ => Near::Above,
        };
        let whole = order as f32 * self.glass();
        let (air, glass) = match near {
            Near::Below => (2.0 * self.low - far_z - near_z, 2.0 * whole),
            Near::Within if order.is_multiple_of(2) => (self.low - far_z, whole + near_z - self.low),
            Near::Within => (self.low - far_z, whole + self.high - near_z),
            Near::Above => (near_z - far_z - self.glass(), 2.0 * whole + self.glass()),
        };
        let (flat, air) = ((y - p).truncate(), air.max(1e-4));
        let r = flat.length();
        let x = self.tangent(r, air, glass);
        let cos = 1.0 / (1.0 + x * x).sqrt();
        let face = fresnel(cos, self.ior);
        let crossed = (1.0 - face) * (1.0 - face);
        let part = match (near, order) {
            (Near::Below, 0) => face,
            (Near::Below, _) => crossed * face.powi(2 * order as i32 - 1),
            (Near::Within, _) => (1.0 - face) * face.powi(order as i32),
            (Near::Above, _) => crossed * face.powi(2 * order as i32),
        };
        let angle = self.angle_per_mm2([x, cos], r, air, glass);
        let ahead = if r > 0.0 { flat / r } else { Vec2::X };
        let sine = x * cos;
        // (In glass a ring of directions is narrower.)
        let (sine_near, angle_per_mm2) = match near {
            Near::Within => (sine / self.ior, angle * cos / (self.ior * self.ior)),
            _ => (sine, angle),
        };
        let cos_near = (1.0 - sine_near * sine_near).max(1e-8).sqrt();
        let angle_per_mm2 = if near == Near::Within { angle_per_mm2 / cos_near } else { angle_per_mm2 };
        let looks_up = near == Near::Below || (near == Near::Within && !order.is_multiple_of(2));
        let upwards = |up: bool| if up != turned { 1.0 } else { -1.0 };
        Way {
            appears: (ahead * sine_near).extend(cos_near * upwards(looks_up)),
            leaves: (-ahead * sine).extend(cos * upwards(true)),
            part,
            angle_per_mm2,
        }
    }
}
