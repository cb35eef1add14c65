//! How a lamp's radiance falls off with the angle to its normal, as it is seen from a point.
//!
//! A flat lamp has one normal. A tube has all that are at right angles to its axis, and of those that a point sees the profile
//! takes the mean over the tube's width: from far off, as lamps are, it is the same everywhere along it.

use super::lanes::{Eight, Vectors};
use glam::Vec3;
use std::f32::consts::PI;

/// The profile of a lamp of radiance 1 along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    normals: Normals,
    /// Exponent of the cosine.
    power: f32,
}

/// Where a lamp faces.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Normals {
    /// One way.
    One(Vec3),
    /// All around an axis; and the mean of the profile over the width of what is seen from aside.
    Around(Vec3, f32),
}

impl Profile {
    /// Of a flat lamp.
    pub fn flat(normal: Vec3, power: f32) -> Self {
        Self { normals: Normals::One(normal), power }
    }

    /// Of a tube about an axis, a unit vector.
    pub fn around(axis: Vec3, power: f32) -> Self {
        // At the angle a from its middle line a tube is seen at the sine of a of its half width, under the cosine of a.
        let step = PI / MEAN_OF as f32;
        let cosines = (0..MEAN_OF).map(|k| ((k as f32 + 0.5) * step).sin());
        let mean = cosines.map(|cosine| cosine.powf(power + 1.0)).sum::<f32>() * 0.5 * step;
        Self { normals: Normals::Around(axis, mean), power }
    }

    /// Exponent of the cosine.
    pub fn power(&self) -> f32 {
        self.power
    }

    /// Length of a vector times the cosine between it and the nearest normal.
    pub fn along(&self, away: Vec3) -> f32 {
        match self.normals {
            Normals::One(normal) => away.dot(normal),
            Normals::Around(axis, _) => (away - axis * away.dot(axis)).length(),
        }
    }

    /// Radiance in a direction away from the lamp.
    pub fn radiance(&self, away: Vec3) -> f32 {
        let radiance = self.along(away.normalize_or_zero()).max(0.0).powf(self.power);
        match self.normals {
            Normals::One(_) => radiance,
            Normals::Around(_, mean) => radiance * mean,
        }
    }

    /// Radiance that eight points see, for unit vectors towards the lamp.
    #[inline(always)]
    pub fn seen(&self, towards: Vectors) -> Eight {
        let zero = Eight::all(0.0);
        match self.normals {
            Normals::One(normal) => towards.dot(Vectors::all(-normal)).max(zero).powf(self.power),
            Normals::Around(axis, mean) => {
                let along = towards.dot(Vectors::all(axis));
                let across = (Eight::all(1.0) - along * along).max(zero).sqrt();
                across.powf(self.power) * Eight::all(mean)
            }
        }
    }
}

/// Angles over which a tube's mean is taken.
const MEAN_OF: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn across_a_tube_the_profile_has_its_mean() {
        // Of sqrt(1 - s^2), 1 - s^2 and its square over the half width.
        for (power, truth) in [(0.0, 1.0), (1.0, PI / 4.0), (2.0, 2.0 / 3.0), (4.0, 8.0 / 15.0)] {
            let profile = Profile::around(Vec3::X, power);
            let aside = profile.radiance(Vec3::Y);
            assert!((aside / truth - 1.0).abs() < 1e-3, "{power}: {aside} {truth}");
            let leaning = Vec3::new(0.6, 0.0, 0.8);
            assert!((profile.radiance(leaning * 3.0) / truth - 0.8f32.powf(power)).abs() < 1e-3);
            let eight = profile.seen(Vectors::all(-leaning)).0[5];
            assert!((eight / profile.radiance(leaning) - 1.0).abs() < 1e-5);
        }
    }
}
