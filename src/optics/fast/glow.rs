//! What a press changes in the light on walls and lamps that the camera sees beside the pad: a flank throws light at a lamp
//! before it, and keeps other light from a wall. Beside so bright a thing as a lamp the whole picture is dark: a hundredth of
//! what it shows is more than all errors of the pad.
//!
//! What shows is taken together in spots. From each the pad's profile is followed all around, outwards, as it is and as it lay
//! untouched: what rises over all before it is seen from there, with its own light. The difference of the two is what the press
//! changes, so that what both have wrong does not count. One bounce; only for level faces, whose heights tell a press from
//! the face itself.

use super::bounce::Cell;
use super::cover::{Covers, SAMPLES, place};
use super::echo;
use super::fixed::{Look, Looks};
use super::grid::Grid;
use super::horizon::Heights;
use super::skyline;
use super::source::Source;
use super::view::View;
use super::wall_shadow;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Directions looked into from a spot: as many for each for which walls are known.
const AROUND: usize = 2 * echo::AROUND;
/// Steps outwards grow with the distance by this part.
const STEP: f32 = 0.1;
/// What moves by less is no press, mm.
const LEAST_MM: f32 = 0.02;
/// Higher over the face than this, mm, spots are twice as large, and so on each time that it doubles: what comes from the pad
/// changes less there.
const NEAR_MM: f32 = 2.0;
const MOST_DOUBLED: u32 = 3;
/// Samples of a partly covered pixel from one that is looked at to the next.
const EVERY: usize = 8;

/// A piece of what shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Spot {
    /// Its middle, mm.
    pub point: Vec3,
    /// Unit normal on the side that shows.
    pub normal: Vec3,
    /// Diffuse reflectance.
    pub albedo: Vec3,
    /// Whether it is a lamp's shining side.
    pub shines: bool,
    /// Irradiance straight from each light of radiance 1, the pad untouched.
    pub direct: Vec<f32>,
}

/// What shows, and where.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Glow {
    pub spots: Vec<Spot>,
    /// Pixels, row by row, and the spot that each shows.
    pub pixels: Vec<[u32; 2]>,
}

/// What the pixels of a spot have in common: block and its size, where it faces, and the lamp that it is of.
type Key = ([usize; 2], u32, [i32; 3], Option<usize>);

impl Glow {
    /// Of pixels whose corners all show something fixed, and of those that it covers in part. `edge` is that of the smallest
    /// spots, in pixels.
    pub fn new(looks: &Looks<'_>, corners: &[Look], covers: &Covers, columns: usize, edge: usize) -> Self {
        let (width, height) = (columns - 1, corners.len() / columns - 1);
        let shown = |k: usize| -> Option<Look> {
            let (x, y) = (k % width, k / width);
            if covers.at(k).is_some() {
                let at = Vec2::new(x as f32, y as f32);
                let mut samples = (0..SAMPLES).step_by(EVERY).map(|s| looks.at(at + place(s), 1));
                return samples.find(|look| look.shows);
            }
            let corner = y * columns + x;
            let four = [corner, corner + 1, corner + columns, corner + columns + 1];
            four.iter().all(|k| corners[*k].shows).then(|| corners[corner].clone())
        };
        let found: Vec<Option<Look>> = (0..width * height).into_par_iter().map(shown).collect();
        let mut known: HashMap<Key, usize> = HashMap::new();
        let (mut pixels, mut members) = (Vec::new(), Vec::<(Vec3, f32, usize)>::new());
        let looks_of: Vec<(usize, Look)> =
            found.into_iter().enumerate().filter_map(|(k, look)| Some((k, look?))).collect();
        for (n, (k, look)) in looks_of.iter().enumerate() {
            let doubled = (looks.over_face(look.point) / NEAR_MM).max(1.0).log2() as u32;
            let doubled = doubled.min(MOST_DOUBLED);
            let block = [k % width, k / width].map(|at| at / (edge << doubled));
            let facing = (look.normal * 8.0).round().as_ivec3().to_array();
            let spot = *known.entry((block, doubled, facing, look.part)).or_insert_with(|| {
                members.push((Vec3::ZERO, 0.0, n));
                members.len() - 1
            });
            members[spot].0 += look.point;
            members[spot].1 += 1.0;
            pixels.push([*k as u32, spot as u32]);
        }
        let spots = members.into_par_iter().map(|(sum, count, first)| {
            let Look { normal, albedo, part, lamp, .. } = looks_of[first].1;
            let point = sum / count;
            Spot { point, normal, albedo, shines: lamp.is_some(), direct: looks.direct(point, normal, part) }
        });
        Self { spots: spots.collect(), pixels }
    }

    /// Whether the numbers belong together: as read from a file.
    pub fn fit(&self, pixels: usize, lights: usize) -> bool {
        self.pixels.iter().all(|[k, spot]| (*k as usize) < pixels && (*spot as usize) < self.spots.len())
            && self.spots.iter().all(|spot| spot.direct.len() == lights)
    }
}

/// Part of a shining face that is wrong where it meets the pad, and up to which height over that, mm: there each lights the other,
/// within less than nodes and probes resolve.
const FOOT_ERROR: f32 = 0.012;
const FOOT_MM: f32 = 0.35;

impl Spot {
    /// Part of what shows here, and of the pad beside it, that is wrong.
    pub fn foot_error(&self, level: f32) -> f32 {
        let height = (self.point.z - level) / FOOT_MM;
        if self.shines { FOOT_ERROR / (1.0 + height.powi(4)) } else { 0.0 }
    }
}

/// A pressed pad and what it was, as spots see it. By picture where there are several.
pub struct Pressed<'a> {
    pub view: &'a View,
    pub heights: &'a Heights,
    /// Height of the untouched face, mm.
    pub level: f32,
    /// Mean albedo of the pad.
    pub albedo: Vec3,
    /// Cells of the picture along x, and pixels along the edge of one.
    pub columns: usize,
    pub cell_px: usize,
    /// Edge of a cell on the pad, mm.
    pub edge_mm: f32,
    pub cells: &'a [Cell],
    /// Sums of their irradiance over the area of the surface, and what that is multiplied with.
    pub lights: &'a [Vec<Vec3>],
    pub gains: &'a [Vec<Vec3>],
    /// Irradiance of the untouched face, and radiance of the walls around it.
    pub grounds: &'a [Grid<3>],
    pub skylines: &'a [Grid<{ skyline::NUMBERS }>],
    pub sources: &'a [Source],
    pub radiances: &'a [Vec3],
}

impl Pressed<'_> {
    /// What the radiance of each spot changes by, by picture.
    pub fn changes(&self, glow: &Glow) -> Vec<Vec<Vec3>> {
        let films = self.lights.len();
        let moved = |cell: &Cell| (cell.position.z / cell.count - self.level).abs() > LEAST_MM;
        if glow.spots.is_empty() || !self.cells.iter().any(|cell| cell.count > 0.0 && moved(cell)) {
            return vec![vec![Vec3::ZERO; glow.spots.len()]; films];
        }
        // Irradiance of each cell, as it is.
        let of_film = |(lights, gains): (&Vec<Vec3>, &Vec<Vec3>)| -> Vec<Vec3> {
            let all = self.cells.iter().zip(lights.iter().zip(gains));
            all.map(|(cell, (light, gain))| *light / cell.area.max(1e-12) * *gain).collect()
        };
        let lit: Vec<Vec<Vec3>> = self.lights.iter().zip(self.gains).map(of_film).collect();
        let of_spot = |spot: &Spot| {
            // (What stands above a plate is seen without it, and lit through it.)
            if self.view.slab.is_some_and(|slab| spot.point.z > slab.low) {
                return vec![Vec3::ZERO; films];
            }
            let mut light = self.gathered(spot, &lit);
            self.shadow(spot, &mut light);
            light.iter_mut().for_each(|light| *light *= spot.albedo * FRAC_1_PI);
            light
        };
        let spots: Vec<Vec<Vec3>> = glow.spots.par_iter().map(of_spot).collect();
        (0..films).map(|film| spots.iter().map(|spot| spot[film]).collect()).collect()
    }

    /// By how much the irradiance of a spot changes that comes from the pad, and from walls that it hides.
    fn gathered(&self, spot: &Spot, lit: &[Vec<Vec3>]) -> Vec<Vec3> {
        let films = lit.len();
        let mut sums = vec![Vec3::ZERO; films];
        let [low, high] = self.heights.extent();
        let reach = (high - low).length() + (spot.point.truncate() - (low + high) * 0.5).length();
        let skies: Vec<_> = self.skylines.iter().map(|sky| sky.at(spot.point)).collect();
        let sent = self.albedo * FRAC_1_PI;
        for direction in 0..AROUND {
            let phi = (direction as f32 + 0.5) * (TAU / AROUND as f32);
            let ahead = Vec2::new(phi.cos(), phi.sin());
            let facing = Facing { ahead: spot.normal.truncate().dot(ahead), up: spot.normal.z };
            if facing.ahead <= 0.0 && facing.up >= 0.0 {
                continue;
            }
            // How much of the view is behind what has been seen so far: of the pad as it is, and as it was.
            let nothing = facing.until(f32::NEG_INFINITY);
            let (mut now, mut before) = ([f32::NEG_INFINITY, nothing], [f32::NEG_INFINITY, nothing]);
            let mut distance = 0.5 * self.edge_mm;
            while distance < reach {
                let at = spot.point.truncate() + ahead * distance;
                if at.cmpge(low).all() && at.cmple(high).all() {
                    let z = self.heights.at(at);
                    let seen = |top: &mut [f32; 2], z: f32| {
                        let slope = (z - spot.point.z) / distance;
                        let weight = if slope > top[0] { facing.until(slope) } else { top[1] };
                        let more = weight - top[1];
                        *top = [slope.max(top[0]), weight];
                        more
                    };
                    let (seen_now, seen_before) = (seen(&mut now, z), seen(&mut before, self.level));
                    if seen_now > 0.0 || seen_before > 0.0 {
                        let cell = self.cell_at(at.extend(z));
                        for (film, sum) in sums.iter_mut().enumerate() {
                            let ground = Vec3::from(self.grounds[film].at(at.extend(f32::MIN)));
                            let light = cell.map_or(ground, |k| lit[film][k]);
                            *sum += (light * seen_now - ground * seen_before) * sent;
                        }
                    }
                }
                distance += self.edge_mm.max(STEP * distance);
            }
            // What rises over the untouched pad's end hides walls, what sank shows more of them.
            let around = direction * echo::AROUND / AROUND;
            for (sum, sky) in sums.iter_mut().zip(&skies) {
                let wall = Vec3::from_slice(&sky[3 * around * echo::RISES..]);
                *sum -= wall * (now[1] - before[1]);
            }
        }
        sums.iter_mut().for_each(|sum| *sum *= TAU / AROUND as f32);
        sums
    }

    /// The cell that a point of the pad is seen in.
    fn cell_at(&self, p: Vec3) -> Option<usize> {
        let at = self.view.project(p) / self.cell_px as f32;
        let is_inside = at.x >= 0.0 && at.y >= 0.0 && (at.x as usize) < self.columns;
        let k = is_inside.then(|| at.y as usize * self.columns + at.x as usize)?;
        self.cells.get(k).filter(|cell| cell.count > 0.0 && cell.area > 0.0).map(|_| k)
    }

    /// Takes off what the pressed pad hides of lights.
    fn shadow(&self, spot: &Spot, light: &mut [Vec3]) {
        let lit = || spot.direct.iter().enumerate().filter(|(_, direct)| **direct > 0.0);
        if lit().count() == 0 || !wall_shadow::may_hide(spot.point, self.level, self.heights) {
            return;
        }
        for (l, direct) in lit() {
            let lost = direct * wall_shadow::hidden(&self.sources[l], spot.point, self.heights);
            match light.len() {
                1 => light[0] -= self.radiances[l] * lost,
                _ => light[l] -= Vec3::splat(lost),
            }
        }
    }
}

/// A spot's normal: how far it faces ahead, and upwards.
#[derive(Clone, Copy)]
struct Facing {
    ahead: f32,
    up: f32,
}

impl Facing {
    /// The integral of the cosine, where that is above 0, over the solid angle up to a slope, by angle around; from where it starts
    /// is the same for all slopes. Differences are what comes from in between, by radiance.
    fn until(self, slope: f32) -> f32 {
        // From here on, or up to here, it faces what is ahead.
        let edge = if self.up == 0.0 { f32::NEG_INFINITY } else { -self.ahead / self.up };
        let slope = match self.up >= 0.0 {
            true => slope.max(edge),
            false => slope.min(edge),
        };
        let (angle, sine2, product) = match slope.is_finite() {
            true => {
                let cosine2 = 1.0 / (1.0 + slope * slope);
                (slope.atan(), slope * slope * cosine2, slope * cosine2)
            }
            false => (FRAC_PI_2.copysign(slope), 1.0, 0.0),
        };
        0.5 * (self.ahead * (angle + product) + self.up * sine2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::bench_scene::Variant;
    use crate::optics::fast::tests::scene;
    use crate::optics::fast::{Precomputed, Renderer};
    use crate::optics::{LightShape, reference};

    /// Against sums over the angle.
    #[test]
    fn what_is_seen_up_to_a_slope_is_the_integral_of_the_cosine() {
        for (ahead, up) in [(1.0f32, 0.0f32), (0.6, 0.8), (0.6, -0.8), (-0.6, -0.8), (0.0, -1.0)] {
            let facing = Facing { ahead, up };
            for to in [-3.0f32, -0.7, 0.0, 0.4] {
                let from = -FRAC_PI_2;
                let n = 20_000;
                let step = (to.atan() - from) / n as f32;
                let sum: f32 = (0..n)
                    .map(|k| from + (k as f32 + 0.5) * step)
                    .map(|a| (ahead * a.cos() + up * a.sin()).max(0.0) * a.cos() * step)
                    .sum();
                let found = facing.until(to) - facing.until(f32::NEG_INFINITY);
                assert!((found - sum).abs() < 2e-4, "{ahead} {up} {to}: {found} {sum}");
            }
        }
    }

    /// A ball before a lamp that stands in the view lights its face.
    #[test]
    fn a_press_before_a_lamp_lights_it() {
        let ball = |x: f32, y: f32| (1.0 - ((x - 3.0).powi(2) + y * y) / 4.0).max(0.0);
        let make = |height: fn(f32, f32) -> f32| {
            let mut scene = scene(Variant::Ac, height);
            scene.lights.truncate(1);
            let (center, half_u) = (Vec3::new(6.03, 0.0, 1.5), -3.0 * Vec3::Y);
            scene.lights[0].shape = LightShape::Rectangle { center, half_u, half_v: Vec3::Z };
            scene
        };
        let (untouched, pressed) = (make(|_, _| 0.0), make(ball));
        let once = Precomputed::new(&untouched).unwrap();
        let of_lamp = |film: &crate::optics::Film| {
            let whole = (20..28).flat_map(|y| [55, 56].map(|x| film.pixels[y * 64 + x].x));
            whole.sum::<f32>() / 16.0
        };
        let fast = [&untouched, &pressed].map(|s| Renderer::new(&once, s, 0.005).unwrap().render());
        let settings = reference::Settings { samples: 64, seed: 1 };
        let truth = [&untouched, &pressed].map(|s| reference::Renderer::new(s).unwrap().render(&settings));
        let [[a, b], [c, d]] = [fast, truth].map(|both| both.map(|film| of_lamp(&film)));
        assert!((b - a - (d - c)).abs() < 0.25 * (d - c).abs() && d - c > 2e-3, "{a} {b}, {c} {d}");
        // A picture by light has the same.
        let basis = Renderer::new(&once, &pressed, 0.005).unwrap().basis();
        let radiance = pressed.lights[0].radiance.x;
        assert!((of_lamp(&basis.films[0]) * radiance / b - 1.0).abs() < 1e-3);
    }
}
