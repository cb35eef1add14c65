//! How much work a tolerance takes, and what error to expect of a picture.

use super::frame::{self, Effort};
use super::{Renderer, Source};
use crate::optics::Albedo;

impl Effort {
    /// What it takes (found by experiment on the scenes of the tests).
    pub(super) fn for_tolerance(tolerance: f64) -> Self {
        // Few pixels have a shadow's edge: there an error may be larger.
        let [shadow, field] = [8.0, 0.2].map(|part| part * tolerance as f32);
        if tolerance >= 0.009 {
            Self {
                cell: 2.0,
                block_mm: 0.26,
                shadow_mm: 0.13,
                curved_mm: 0.04,
                shadow,
                field,
                fine: false,
                ..Self::FINEST
            }
        } else if tolerance >= 0.004 {
            Self { block_mm: 0.26, curved_mm: 0.02, shadow, field, ..Self::FINEST }
        } else {
            Self { shadow, field, ..Self::FINEST }
        }
    }

    const FINEST: Self = Self {
        cell: 1.1,
        block_mm: 0.13,
        shadow_mm: 0.07,
        shadow: 0.0,
        field: 0.0,
        curved_mm: 0.01,
        fine: true,
        bounce: true,
        thorough: false,
    };
}

/// Error of a pad of one colour, and of a textured one, without anything of what follows.
const BASE_ERROR: [f64; 2] = [0.002, 0.0025];
/// What a plate adds: its light is solved by fewer rays than it takes.
const PLATE_ERROR: f64 = 0.004;
/// What a curved face adds: what its press changes in the light of the walls is left out.
const CURVED_ERROR: f64 = 0.004;
/// What a tube adds: the wall behind it is lit more unevenly than patches resolve.
const TUBE_ERROR: f64 = 0.016;
/// Part of the bounce that is wrong or left out.
const BOUNCE_ERROR: f64 = 0.2;
/// Part of what walls give back of the press that is wrong.
const ECHO_ERROR: f64 = 0.25;
/// What steep flanks add, by the rms of |n - n0|^2 over the untouched normal n0: shadows' edges are interpolated between nodes.
/// More so where bent horizons are not followed finely.
const STEEP_ERROR: [f64; 2] = [0.04, 0.055];

impl Renderer<'_> {
    /// What relRMSE to expect. It follows from the picture itself: the light that flanks send each other is worked out with
    /// one bounce on a coarse raster, and a part of what that changed is taken for its error, as is a part of what walls
    /// give back; pixels over creases are means of a few pieces, and their variance tells the error of the mean. The constants were found by comparing
    /// with the reference (see the tests).
    pub(super) fn estimated_error(&self, pictures: &frame::Pictures) -> f64 {
        let film = &pictures.films[0];
        let n = (film.pixels.len() * 3) as f64;
        let mean = f64::from(film.mean().element_sum() / 3.0).max(1e-30);
        let bounce = BOUNCE_ERROR * (pictures.bounced / n).sqrt() / mean;
        let spread = (pictures.spread / n).sqrt() / mean;
        let base = BASE_ERROR[usize::from(matches!(self.albedo, Albedo::Texture(_)))];
        let echo = ECHO_ERROR * pictures.echoed.sqrt();
        let steep = STEEP_ERROR[usize::from(!self.effort.fine)] * pictures.steepness;
        let plate = if self.once.view.slab.is_some() { PLATE_ERROR } else { 0.0 };
        let curved = if self.once.total.parts().0.is_curved() { CURVED_ERROR } else { 0.0 };
        let tube = if self.once.sources.iter().any(Source::is_tube) { TUBE_ERROR } else { 0.0 };
        [base, bounce, echo, spread, steep, plate, tube, curved].iter().map(|e| e * e).sum::<f64>().sqrt()
    }
}
