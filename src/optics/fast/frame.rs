//! One picture: nodes every few pixels, and the blocks between them.
//!
//! Each pixel's position and normal come from the points of the pad that its four corners see: the normal of their two
//! diagonals is the mean over the pixel, whatever the mesh does within. Where the corners see different things (the
//! pad's rim, a fold, a wall in front) the pixel is the mean of what its corners see.

mod cells;
mod fill;
mod fixed;
mod pixel;
mod rebound;
mod shading;

pub use cells::cell_px;
pub use pixel::uv;

use super::Precomputed;
use super::horizon::Heights;
use super::lanes::WIDTH;
use super::raster::Sample;
use super::slots::{POSITION, Slots};
use crate::optics::{Albedo, Film, Mesh};
use glam::Vec3;
use rebound::Rebound;

/// Pixels between nodes.
pub const NODE_PX: usize = WIDTH;
/// 1/sqrt(3).
const RMS: f32 = 0.577_350_3;

/// How finely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Cells of the heights that hide light, in distances of the lattice's points: as a rule, and of pads with sharp rims.
    pub cells: [f32; 2],
    /// No block is larger, mm.
    pub block_mm: f32,
    /// No block with a shadow's edge is divided further, mm.
    pub shadow_mm: f32,
    /// A block is divided when the light at its middle departs by more from what its corners' horizons give there, as part
    /// of the mean irradiance of the picture.
    pub shadow: f32,
    /// The field of a light is worked out at each pixel of a block where else it would be wrong by more, as part of the same.
    pub field: f32,
    /// A block is divided when its middle departs from its corners' mean by more, mm.
    pub curved_mm: f32,
    /// Whether bent horizons are followed finely, and strong light bounces again.
    pub fine: bool,
    /// Whether nodes follow from those around them where they may, and the bounce looks at half as many distances: of pads without
    /// sharp rims.
    pub sparse: bool,
    /// Whether flanks light their surroundings.
    pub bounce: bool,
    /// Whether nothing is skipped that a scene does not need: to measure what skipping saves.
    pub thorough: bool,
}

impl Effort {
    /// Whether what bounces may have to be traced: where flanks face each other, and no plate bends what is seen.
    pub fn is_traced(&self, once: &Precomputed, heights: &Heights) -> bool {
        self.bounce && self.fine && once.view.slab.is_none() && heights.has_grooves()
    }
}

/// Pictures, and what tells of their error.
pub struct Pictures {
    /// One, or one a light.
    pub films: Vec<Film>,
    /// What a single picture is without what the press changes in the light that bounces; only of faces with grooves.
    pub still: Option<Film>,
    /// Their means over all pixels.
    pub means: Vec<Vec3>,
    /// Sum over pixels and channels of the squares of what the bounce changed; this and what follows as in [`traces`](super::traces).
    pub bounced: Vec<f64>,
    /// How much of the light of upright flanks falls on themselves, as a part of what the picture shows.
    pub notched: f64,
    /// Mean square of what walls gave back of the press, as a part of the mean light.
    pub echoed: Vec<f64>,
    /// Sum over pixels and channels of the squares of what the press changed in the light on fixed parts.
    pub glowed: Vec<f64>,
    /// The same of what is wrong at the feet of lamps.
    pub feet: Vec<f64>,
    /// The same of the light of walls that show, and of what of lamps does not shine.
    pub walls: Vec<f64>,
    /// Sum over pixels and channels of the variances of what mixed pixels are means of.
    pub spread: Vec<f64>,
    /// Rms over the face of |n - n0|^2, which tells how steep the press made it.
    pub steepness: f64,
    /// How differently the pad has moved beyond the picture's border, in the mean, mm.
    pub border_mm: f64,
    /// Lights beyond whose plane some of the pad is, and the part that is before it.
    pub sided: Vec<(usize, f64)>,
}

/// A pad seen by the sensor, ready to be shaded, with so many lines to a light.
pub struct Frame<'a, const N: usize> {
    pub once: &'a Precomputed,
    pub mesh: &'a Mesh,
    /// Points of the pad's lattice along x.
    pub nx: usize,
    pub albedo: &'a Albedo,
    pub heights: &'a Heights,
    /// What the corners of pixels see of the pad.
    pub seen: &'a [Sample],
    /// Its vertices in the raster.
    pub vertices: &'a [Vec3],
    pub effort: Effort,
    pub slots: Slots<N>,
    /// Irradiance against which errors are held.
    pub level: f32,
    /// Lights beyond whose plane some of the pad is: there their light ends.
    pub sided: Vec<usize>,
}

impl<const N: usize> Frame<'_, N> {
    /// The pictures, one or one a light.
    pub fn render(mut self) -> Pictures {
        let nodes = self.nodes();
        self.level = self.mean_level(&nodes);
        self.sided = self.sided(&nodes);
        let (mut films, mut shaded) = self.shade(&nodes);
        let is_traced = self.slots.films == 1 && self.effort.is_traced(self.once, self.heights);
        let still = is_traced.then(|| films[0].clone());
        let border = shaded.border(self.once.pixel_mm);
        let border_mm = border.uneven_mm(self.heights, |p| self.once.total.lift(p));
        let Rebound { bounced, echoed, glows, notched } = match self.effort.bounce {
            true => self.rebound(&shaded, border_mm, &mut films),
            false => Rebound::nothing(films.len()),
        };
        let [glowed, feet, walls] = self.lay_fixed(&mut films, &glows, &mut shaded.spread);
        Pictures {
            means: films.iter().map(Film::mean).collect(),
            films,
            still,
            bounced,
            notched,
            echoed,
            steepness: shaded.steepness(|p| self.once.total.rest_normal(p)),
            border_mm,
            sided: self.sided.iter().map(|l| (*l, self.faced(&nodes, *l))).collect(),
            glowed,
            feet,
            walls,
            spread: shaded.spread,
        }
    }

    /// What a light's irradiance counts for: the rms of its colours; alike for all where each has a picture of its own.
    #[inline(always)]
    pub fn strength(&self, l: usize) -> f32 {
        if self.slots.films > 1 { 1.0 } else { self.once.radiances[l].length() * RMS }
    }

    /// Mean irradiance at the nodes, as errors count: what a level pad gets.
    pub(super) fn mean_level(&self, nodes: &[f32]) -> f32 {
        let (slots, lights) = (&self.slots, self.once.sources.len());
        let (mut sum, mut count) = (0.0, 0.0f32);
        for node in nodes.chunks_exact(slots.stride()).filter(|n| !n[POSITION].is_nan()) {
            sum += (0..lights).map(|l| node[slots.direct(l) + 2].max(0.0) * self.strength(l)).sum::<f32>();
            count += 1.0;
        }
        // Of several pictures each has its part.
        let films = slots.films as f32;
        sum / (count.max(1.0) * films)
    }

    /// The part of the nodes that are before a light.
    fn faced(&self, nodes: &[f32], l: usize) -> f64 {
        let seen = || nodes.chunks_exact(self.slots.stride()).filter(|n| !n[POSITION].is_nan());
        seen().filter(|n| n[self.slots.gain(l)] > 0.0).count() as f64 / seen().count().max(1) as f64
    }

    /// Lights that some nodes face and others do not.
    fn sided(&self, nodes: &[f32]) -> Vec<usize> {
        let seen = || nodes.chunks_exact(self.slots.stride()).filter(|n| !n[POSITION].is_nan());
        let faced = |l: usize| move |n: &[f32]| n[self.slots.gain(l)] > 0.0;
        (0..self.once.sources.len()).filter(|l| seen().any(faced(*l)) && !seen().all(faced(*l))).collect()
    }
}
