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

/// How far a tube's near side is before its axis, in the mean of the light that comes from over its width. (A round side is pi/4 of the
/// radius before; one that is brighter in its middle is more.)
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bulge {
    /// From far off, of the radius.
    far: f32,
    /// How fast that grows with the radius over the distance: from nearby more of what is aside is seen beyond the middle.
    grows: f32,
}

impl Bulge {
    /// Of a tube whose profile has this exponent.
    pub fn new(power: f32) -> Self {
        let step = PI / MEAN_OF as f32;
        let [mut all, mut far, mut grows] = [0.0; 3];
        for k in 0..MEAN_OF {
            // As for the mean of the profile.
            let cosine = ((k as f32 + 0.5) * step).sin();
            let light = cosine.powf(power + 1.0);
            all += light;
            far += light * cosine;
            grows += light * (1.0 - cosine * cosine);
        }
        Self { far: far / all, grows: grows / all }
    }

    /// The same, of the radius, from where that is this part of the distance from the axis: all of it where the tube is touched.
    #[inline]
    pub fn seen(self, radius_over_distance: f32) -> f32 {
        let Self { far, grows } = self;
        let left = 1.0 - far;
        far + radius_over_distance * (left + (grows - left) * (1.0 - radius_over_distance))
    }
}

/// Angles over which a tube's means are taken.
const MEAN_OF: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tube_bulges_towards_whoever_looks() {
        for power in [0.0, 1.0, 4.0] {
            let bulge = Bulge::new(power);
            for part in [0.0, 0.1, 0.2, 0.5, 1.0f32] {
                // Past the axis at b radii light leaves under the sine b to the normal, which is turned by the sine of b times the
                // radius over the distance against the direction to the axis.
                let (mut sum, mut all) = (0.0, 0.0);
                for k in 0..2000 {
                    let b = (k as f32 + 0.5) / 1000.0 - 1.0;
                    let light = (1.0 - b * b).sqrt().powf(power);
                    all += light;
                    sum += light * (b.asin() - (b * part).asin()).cos();
                }
                let (found, truth) = (bulge.seen(part), sum / all);
                assert!((found - truth).abs() < 0.015, "{power} {part}: {found} {truth}");
            }
        }
    }

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
