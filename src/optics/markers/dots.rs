//! Printed dots one by one: no print puts each of them where it should be, makes it as large, as round and as dark as the next.

use crate::optics::noise::Normals;
use crate::optics::sampler::hash;
use crate::optics::sensor::MarkerSpec;
use glam::{DVec2, IVec2};

/// No dot departs by more than so many times the rms.
const MOST: f64 = 2.5;
/// However little ink there is, so much of the coat under a dot is covered.
const LEAST_INK: f64 = 0.2;

/// A dot.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Dot {
    /// Its middle, from where the lattice has a dot, mm.
    middle: DVec2,
    radius: f64,
    /// By how much it is longer than wide, as cosine and sine of twice the angle of its longer axis.
    stretch: DVec2,
    /// What of the coat it covers.
    ink: f64,
}

impl Dot {
    /// The dot of a place of the lattice.
    fn of(markers: &MarkerSpec, [column, row]: [i32; 2]) -> Self {
        let normals = Normals::new(hash(markers.seed, 0x0d07));
        let place = hash(hash(0x0d07, column.cast_unsigned()), row.cast_unsigned());
        let normal = |k: u32| f64::from(normals.at(hash(place, k))).clamp(-MOST, MOST);
        let moved = DVec2::new(normal(0), normal(1)) * (markers.place_rms * markers.pitch_mm);
        Self {
            middle: DVec2::new(f64::from(column), f64::from(row)) * markers.pitch_mm + moved,
            radius: 0.5 * markers.diameter_mm * (1.0 + markers.size_rms * normal(2)),
            stretch: DVec2::new(normal(3), normal(4)) * (markers.size_rms * std::f64::consts::FRAC_1_SQRT_2),
            ink: (1.0 - markers.faint_rms * normal(5).abs()).max(LEAST_INK),
        }
    }

    /// Whether a point is within it.
    fn covers(&self, p: DVec2) -> bool {
        let from = p - self.middle;
        let square = from.length_squared();
        // (cos 2a and sin 2a of the angle a of the point, times the square.)
        let twice = DVec2::new(from.x * from.x - from.y * from.y, 2.0 * from.x * from.y);
        square < (self.radius * (1.0 + self.stretch.dot(twice) / square.max(1e-12))).powi(2)
    }
}

/// The dots of a rectangle.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dots {
    first: IVec2,
    columns: usize,
    pitch_mm: f64,
    dots: Vec<Dot>,
    /// No dot reaches farther from its middle, and none is nearer to it at its rim, mm.
    reach_mm: [f64; 2],
}

impl Dots {
    /// Those that a point between two corners may be on. Coordinates are from the dot of the lattice's origin on, mm.
    pub(super) fn of(markers: &MarkerSpec, low: DVec2, high: DVec2) -> Self {
        let index = |p: DVec2| (p / markers.pitch_mm).floor().as_ivec2();
        let (first, last) = (index(low) - 1, index(high) + 2);
        let [columns, rows] = (last - first + 1).to_array();
        let places = (0..rows).flat_map(|j| (0..columns).map(move |i| first + IVec2::new(i, j)));
        let dots: Vec<Dot> = places.map(|place| Dot::of(markers, place.to_array())).collect();
        let radii =
            dots.iter().map(|dot| [1.0, -1.0].map(|to| dot.radius * (1.0 + to * dot.stretch.length())));
        let reach_mm = radii.fold([0.0, f64::INFINITY], |[most, least], [outer, inner]| {
            [f64::max(most, outer), f64::min(least, inner)]
        });
        Self { first, columns: columns.unsigned_abs() as usize, pitch_mm: markers.pitch_mm, dots, reach_mm }
    }

    /// What of the coat is covered within `around` of a point, on average, by a raster of so many points each way.
    pub(super) fn cover(&self, p: DVec2, step: DVec2, samples: usize) -> f64 {
        let near = self.near(p);
        let reach = 0.5 * step.length();
        let [outer, inner] = [self.reach_mm[0] + reach, self.reach_mm[1] - reach];
        let (mut clear, mut within) = (true, 0.0f64);
        for dot in near {
            let distance = (p - dot.middle).length();
            clear &= distance > outer;
            within = within.max(if distance < inner { dot.ink } else { 0.0 });
        }
        if clear || within > 0.0 {
            return within;
        }
        let mut sum = 0.0;
        for k in 0..samples * samples {
            let at = DVec2::new((k % samples) as f64 + 0.5, (k / samples) as f64 + 0.5) / samples as f64;
            let at = p + (at - 0.5) * step;
            sum += near.iter().filter(|dot| dot.covers(at)).fold(0.0, |ink, dot| f64::max(ink, dot.ink));
        }
        sum / (samples * samples) as f64
    }

    /// The four of the lattice's places around a point: a dot is less than a pitch wide and hardly off its place.
    fn near(&self, p: DVec2) -> [&Dot; 4] {
        let cell = (p / self.pitch_mm).floor().as_ivec2() - self.first;
        let at = |i: i32, j: i32| {
            let row = (cell.y + j).max(0).unsigned_abs() as usize;
            let column = (cell.x + i).max(0).unsigned_abs() as usize;
            &self.dots[(row * self.columns + column).min(self.dots.len() - 1)]
        };
        [at(0, 0), at(1, 0), at(0, 1), at(1, 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_depart_by_what_is_asked_for_and_another_seed_has_others() {
        let spec = |rest: &str| -> MarkerSpec {
            toml::from_str(&format!("pitch_mm = 2.0\ndiameter_mm = 0.8\n{rest}")).unwrap()
        };
        let dots = |spec: &MarkerSpec| Dots::of(spec, DVec2::ZERO, DVec2::splat(100.0)).dots;
        let markers = spec("place_rms = 0.03\nsize_rms = 0.05\nfaint_rms = 0.1");
        let many = dots(&markers);
        let rms = |f: &dyn Fn(&Dot) -> f64| {
            (many.iter().map(|dot| f(dot).powi(2)).sum::<f64>() / many.len() as f64).sqrt()
        };
        let off = |dot: &Dot| dot.middle / 2.0 - (dot.middle / 2.0).round();
        for (found, asked) in [
            (rms(&|dot| off(dot).x), 0.03),
            (rms(&|dot| off(dot).y), 0.03),
            (rms(&|dot| dot.radius / 0.4 - 1.0), 0.05),
            (rms(&|dot| dot.stretch.length()), 0.05),
            (rms(&|dot| 1.0 - dot.ink), 0.1),
        ] {
            assert!((found / asked - 1.0).abs() < 0.06, "{found} {asked}");
        }
        assert_eq!(dots(&markers), many);
        assert_ne!(dots(&spec("place_rms = 0.03\nsize_rms = 0.05\nfaint_rms = 0.1\nseed = 1")), many);
        // The same part of the face has the same dots, whatever else is in view.
        let few = Dots::of(&markers, DVec2::splat(50.0), DVec2::splat(51.0));
        assert!(few.dots.iter().all(|dot| many.contains(dot)));
        // An exact print has none of it.
        let exact = dots(&spec("place_rms = 0.0\nsize_rms = 0.0\nfaint_rms = 0.0"));
        assert!(
            exact.iter().all(|d| off(d) == DVec2::ZERO
                && d.radius == 0.4
                && d.stretch == DVec2::ZERO
                && d.ink == 1.0)
        );
    }

    #[test]
    fn a_dot_longer_than_wide_covers_as_much_as_its_outline_tells() {
        let dot = Dot { middle: DVec2::new(1.0, 2.0), radius: 0.5, stretch: DVec2::new(0.2, 0.0), ink: 0.9 };
        let on = |x: f64, y: f64| dot.covers(DVec2::new(1.0 + x, 2.0 + y));
        assert!(on(0.59, 0.0) && !on(0.61, 0.0) && on(0.0, 0.39) && !on(0.0, 0.41) && on(0.0, 0.0));
    }
}
