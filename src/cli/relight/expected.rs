//! What relRMSE to expect of a sum of pictures, one a light.

use crate::optics::LightBasis;
use glam::Vec3;

/// relRMSE to expect of a sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Expected {
    /// As the renderer stated it, of the colours in which it rendered.
    Stated(f64),
    /// What its parts tell of it in other colours.
    AtMost(f64),
}

impl Expected {
    /// The relRMSE.
    pub(super) fn value(self) -> f64 {
        match self {
            Self::Stated(error) | Self::AtMost(error) => error,
        }
    }

    /// Whether it is off by less, most likely.
    pub(super) fn is_bound(self) -> bool {
        matches!(self, Self::AtMost(_))
    }
}

impl std::fmt::Display for Expected {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = 100.0 * self.value();
        match self {
            Self::Stated(_) => write!(f, "about {percent:.2} %"),
            Self::AtMost(_) => write!(f, "at most {percent:.2} %, if the errors of all lights add up"),
        }
    }
}

/// relRMSE of a sum, at most: errors of several lights may add up, and what is alike in all channels of white light is more of
/// the mean where a colour has but one.
pub(super) fn most_of_sum(basis: &LightBasis, radiances: &[Vec3], errors: &[f64]) -> f64 {
    let lights = basis.films.iter().zip(radiances).zip(errors);
    let [mut whole, mut off] = [0.0; 2];
    for ((film, radiance), error) in lights {
        let mean = film.mean();
        whole += f64::from((mean * *radiance).element_sum());
        off += error * f64::from(mean.element_sum() * (radiance.length_squared() / 3.0).sqrt());
    }
    if whole > 0.0 { off / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Film;

    #[test]
    fn a_sum_is_off_by_no_more_than_its_parts_together_and_a_pure_colour_by_more_than_white() {
        let film = |light: f32| Film { width: 1, height: 1, pixels: vec![Vec3::splat(light)] };
        let basis = LightBasis { names: vec![String::new(); 2], films: vec![film(3.0), film(1.0)] };
        let of = |radiances: [Vec3; 2]| most_of_sum(&basis, &radiances, &[0.01, 0.03]);
        assert!((of([Vec3::ONE; 2]) - 0.015).abs() < 1e-9);
        assert!((of([Vec3::ZERO, Vec3::splat(7.0)]) - 0.03).abs() < 1e-9);
        assert!((of([2.0 * Vec3::X, Vec3::ZERO]) - 0.01 * 3f64.sqrt()).abs() < 1e-8);
        assert_eq!(of([Vec3::ZERO; 2]), 0.0);
    }
}
