//! The picture that the virtual camera sees: cheap, plausible, and not the twin's.
//!
//! Another model than the twin's on purpose, so that pairing has something to measure. It follows Gomes,
//! Paoletti and Luo, *Generation of GelSight Tactile Images for Sim2Real Learning* (RA-L 6(2), 2021):
//! 1. **relief** ([`relief`]): the indenter's height map clipped by the depth of the press, rounded by a
//!    narrow Gaussian, with the surroundings of the contact from a difference of two wider ones;
//! 2. **shading** ([`shading`]): four lights, each with its colour and place, by Phong's model, on code
//!    values;
//! 3. **look** ([`look`]): what a gel looks like untouched (texture, dirt, vignette, light falling off);
//! 4. **noise** ([`noise`]): shot and read noise, gain and offset of the sensor.
//!
//! Added by us: the gel's texture is carried along when a pressed indenter slides or turns ([`Drag`]),
//! and gel piles up ahead of it. Amounts are found by experiment, to look like the pictures of a GelSight
//! (FOTS). There is no physics here and no time: who asks, and when, is
//! [`super::camera`]'s affair.

pub mod look;
pub mod noise;
mod relief;
mod shading;

use crate::indenter::Indenter;
use crate::pose::Pose;
use look::{Gel, SensorLook};
use relief::{IndenterMap, Relief};
use std::sync::{Arc, Mutex};

/// How far the gel's face is carried along by the indenter that touches it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drag {
    /// To the right, mm.
    pub x_mm: f64,
    /// Down, mm.
    pub y_mm: f64,
    /// Clockwise, degrees.
    pub twist_deg: f64,
}

/// Part of a gel's face is carried along at most as far as this fraction of the depth of the press...
const LARGEST_DRAG_PER_DEPTH: f64 = 0.5;
/// ...or twisted by so much per millimetre of depth; then the indenter slips. Both found by experiment.
const LARGEST_TWIST_DEG_PER_MM: f64 = 8.0;

impl Drag {
    /// The drag after the indenter has moved from one pose to the next: it sticks until the limit, then slips.
    pub fn followed(self, from: &Pose, to: &Pose) -> Drag {
        let depth_mm = to.depth_mm();
        if depth_mm <= 0.0 || from.depth_mm() <= 0.0 {
            return Drag::default();
        }
        let (x, y) = (self.x_mm + to.x_mm - from.x_mm, self.y_mm + to.y_mm - from.y_mm);
        let (length, limit) = (x.hypot(y), LARGEST_DRAG_PER_DEPTH * depth_mm);
        let keep = if length > limit { limit / length } else { 1.0 };
        let twist_limit = LARGEST_TWIST_DEG_PER_MM * depth_mm;
        let twist_deg = (self.twist_deg + to.theta_deg - from.theta_deg).clamp(-twist_limit, twist_limit);
        Drag { x_mm: x * keep, y_mm: y * keep, twist_deg }
    }
}

/// Draws pictures of one sensor.
pub struct Picture {
    look: SensorLook,
    shift_px: [f64; 2],
    gel: Gel,
    untouched: Vec<f32>,
    /// The last indenter's height map: the lower surface of a solid is dear, and it never changes.
    map: Mutex<Option<Arc<IndenterMap>>>,
}

impl Picture {
    /// A sensor with this look; `shift_px` moves everything that touches it right and down in the image.
    pub fn new(look: SensorLook, shift_px: [f64; 2], seed: u64) -> Self {
        let gel = Gel::new(&look, seed);
        let mut picture = Self { look, shift_px, gel, untouched: Vec::new(), map: Mutex::new(None) };
        picture.untouched = shading::flat(&picture.look, &picture.gel);
        picture
    }

    /// What was asked for.
    pub fn look(&self) -> &SensorLook {
        &self.look
    }

    /// The picture in code values (`height * width * 3`, not yet clipped) with the indenter at `pose`.
    pub fn draw(&self, pose: &Pose, indenter: Option<&Arc<dyn Indenter>>, drag: &Drag) -> Vec<f32> {
        let mut rgb = self.untouched.clone();
        if let Some(indenter) = indenter
            && let Some(relief) = self.relief(pose, indenter, drag)
        {
            shading::shade(&mut rgb, &self.look, &self.gel, &relief, drag);
        }
        rgb
    }

    fn relief(&self, pose: &Pose, indenter: &Arc<dyn Indenter>, drag: &Drag) -> Option<Relief> {
        if pose.z_mm >= 0.0 {
            return None;
        }
        let map = self.map_of(indenter);
        Relief::of(&self.look, self.shift_px, pose, &map, drag)
    }

    fn map_of(&self, indenter: &Arc<dyn Indenter>) -> Arc<IndenterMap> {
        let mut cached = self.map.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        match &*cached {
            Some(map) if map.is_of(indenter) => Arc::clone(map),
            _ => {
                let map = Arc::new(IndenterMap::new(indenter, 0.5 * self.look.mm_per_px));
                *cached = Some(Arc::clone(&map));
                map
            }
        }
    }
}

#[cfg(test)]
mod tests;
