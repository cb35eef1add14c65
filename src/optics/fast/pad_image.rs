//! The pad's own image in a plate above it: what a press takes from it or adds to it lights the pad, too.
//!
//! Between two places of the face there is one path by each face of the plate, in closed form (see [`Slab::image`](super::plate::Slab)). So it is worked
//! out once what a place sees of what each [cell](super::echo) sends in each direction; in every frame that is multiplied with what cells
//! send more than untouched. A cell before a crest sends less to where the light would come down beyond it.

use super::echo::{DIRECTIONS, RISES, level_part, on_face, range_of};
use super::grid::Places;
use super::plate::ORDERS;
use super::probes::{self, NUMBERS, TERMS};
use super::view::View;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f32::consts::FRAC_1_PI;

/// A cell is looked at in so many places each way: it may be as wide as the plate is high.
const PLACES: usize = 3;

/// What places see of cells, mirrored. Nothing without a plate.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PadImage {
    /// By place: how many parts it sees.
    pub counts: Vec<u32>,
    /// What each of these is of: the number of a cell, times [`DIRECTIONS`], and one of its directions.
    pub of: Vec<u32>,
    /// What a power of 1 that is sent there adds to each term.
    pub parts: Vec<[f32; TERMS]>,
}

impl PadImage {
    /// What is seen from all places of cells that are `cell_px` pixels of the view wide, `size` of them along x and y. `scatterings` is how
    /// often light may be scattered before it reaches the pad, each second event being a face.
    pub fn new(
        view: &View,
        places: &Places,
        (cell_px, size): (usize, [usize; 2]),
        scatterings: u32,
        rest: impl Fn(Vec2) -> f32 + Sync,
    ) -> Self {
        let Some(slab) = view.slab else { return Self::default() };
        // (Besides what the camera's path takes anyway, the lower face is one event, each way to the upper one and back two more.)
        let orders = ORDERS.min((scatterings as usize).saturating_sub(1));
        let weights_of = probes::by_direction(places.is_curved());
        let in_cell = PLACES * PLACES;
        let shown = |k: usize| {
            let (cell, place) = (k / in_cell, k % in_cell);
            let corner = Vec2::new((cell % size[0]) as f32, (cell / size[0]) as f32);
            let within = Vec2::new((place % PLACES) as f32 + 0.5, (place / PLACES) as f32 + 0.5);
            let [start, along] = view.ray((corner + within / PLACES as f32) * cell_px as f32);
            on_face(start, along, &rest)
        };
        let cells: Vec<Vec3> = (0..size[0] * size[1] * in_cell).map(shown).collect();
        let seen_from = |place: usize| {
            let from = places.point(place);
            let mut seen: BTreeMap<u32, [f32; TERMS]> = BTreeMap::new();
            for (k, to) in cells.iter().enumerate() {
                for order in 0..orders {
                    let image = slab.image(from, *to, order);
                    // Light that arrives from there left the cell upwards the other way round.
                    let arrives = image.direction;
                    let direction = range_of(Vec3::new(-arrives.x, -arrives.y, arrives.z));
                    // A level cell that sends a power P there has the radiance P / (pi area) by the part that goes there.
                    let power = FRAC_1_PI / (level_part(direction % RISES) * in_cell as f32);
                    let light = power * image.reflected * image.angle_per_mm2 * arrives.z;
                    let terms = seen.entry((k / in_cell * DIRECTIONS + direction) as u32).or_default();
                    for (sum, weight) in terms.iter_mut().zip(weights_of(arrives)) {
                        *sum += weight * light;
                    }
                }
            }
            seen
        };
        let all: Vec<BTreeMap<u32, [f32; TERMS]>> =
            (0..places.count()).into_par_iter().map(seen_from).collect();
        let counts = all.iter().map(|seen| seen.len() as u32).collect();
        let (of, parts) = all.into_iter().flatten().unzip();
        Self { counts, of, parts }
    }

    /// Adds what comes back by the plate of what is `sent` (by cell, picture and direction) to the numbers of places, by place and picture.
    pub fn add(&self, sent: &[Vec3], films: usize, values: &mut [[f32; NUMBERS]]) {
        let mut first = 0;
        for (count, out) in self.counts.iter().zip(values.chunks_exact_mut(films)) {
            let all = first..first + *count as usize;
            first = all.end;
            for (of, parts) in self.of[all.clone()].iter().zip(&self.parts[all]) {
                let (cell, direction) = (*of as usize / DIRECTIONS, *of as usize % DIRECTIONS);
                for (film, numbers) in out.iter_mut().enumerate() {
                    let power = sent[(cell * films + film) * DIRECTIONS + direction].to_array();
                    for (numbers, part) in numbers.chunks_exact_mut(3).zip(parts) {
                        numbers.iter_mut().zip(power).for_each(|(number, power)| *number += power * part);
                    }
                }
            }
        }
    }

    /// Whether its numbers belong together, for so many places and cells.
    pub fn fits(&self, places: usize, cells: usize) -> bool {
        let sum: usize = self.counts.iter().map(|count| *count as usize).sum();
        [0, places].contains(&self.counts.len())
            && (self.of.len(), self.parts.len()) == (sum, sum)
            && self.of.iter().all(|of| (*of as usize) < cells * DIRECTIONS)
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::Layout;
    use super::super::plate::Slab;
    use super::*;
    use crate::optics::Camera;
    use crate::optics::bsdf::fresnel;

    #[test]
    fn a_wide_even_face_is_seen_mirrored_as_the_plate_reflects_diffuse_light() {
        let slab = Slab { low: 1.5, high: 1.5 + 1e-3, ior: 1.5 };
        let camera = Camera::above(Vec3::Z * 40.0, 1.0, 80, 80);
        let view = View::new(&camera, Some(slab));
        let layout = Layout {
            across: [Vec2::splat(-1.0), Vec2::splat(1.0)],
            step_mm: 1.0,
            lift_mm: [0.0, 1.0],
            lift_step_mm: 1.0,
        };
        let places = Places::new(&layout, |_| 0.0);
        let size = [80; 2];
        let image = PadImage::new(&view, &places, (1, size), 8, |_| 0.0);
        assert!(image.fits(places.count(), size[0] * size[1]));
        // Cells of a square millimetre, of radiosity 1, the second of two pictures half as bright.
        let directions = (0..DIRECTIONS).map(|k| Vec3::splat(level_part(k % RISES)));
        let of_cell = directions.clone().chain(directions.map(|power| power * 0.5));
        let sent: Vec<Vec3> = (0..size[0] * size[1]).flat_map(|_| of_cell.clone()).collect();
        let mut values = vec![[0.0; NUMBERS]; 2 * places.count()];
        image.add(&sent, 2, &mut values);
        // The mean reflectance of both faces for diffuse light.
        let steps = 4000;
        let reflected = |k: usize| {
            let face = fresnel((1.0 - (k as f32 + 0.5) / steps as f32).sqrt(), 1.5);
            2.0 * face / (1.0 + face) / steps as f32
        };
        let theory: f32 = (0..steps).map(reflected).sum();
        for numbers in values.chunks_exact(2) {
            let [e, half] = [0, 1].map(|film| probes::irradiance(&numbers[film], Vec3::Z).x);
            assert!((e / theory - 1.0).abs() < 0.05 && (half / e - 0.5).abs() < 1e-3, "{e} {half} {theory}");
        }
        let none = PadImage::new(&View::new(&camera, None), &places, (1, size), 8, |_| 0.0);
        assert_eq!(none, PadImage::default());
    }
}
