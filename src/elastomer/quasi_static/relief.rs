//! The face under a body, finer than the splines that carry it.
//!
//! At the edge of a contact the face bends within less than a cell, and beside an edge of the body the pressure rises without
//! bound: splines follow cell by cell, which shows as beads along slanted edges and as corners on the rim of a ball. What
//! they miss is local, and over a cell or two a pad is as good as a layer that gives way linearly. So the face is what it
//! would be without any pressure, which is smooth and taken from the splines, and the layer's answer to the pressure on it,
//! which is found anew on the lattice: nowhere negative, and nothing inside the body ([`settle`]). That moves points along z
//! only: the face of a nearly incompressible layer does not move along itself when it is pressed.

mod grip;
mod misfit;
mod rim;
mod settle;
mod smooth;
mod surroundings;
mod trust;
mod window;

pub use self::grip::{Borne, finer_to_hold};
use self::misfit::misfit_mm;
pub use self::rim::rim;
use self::settle::settle;
use self::smooth::smooth;
use self::surroundings::{bent, neighbours, part_below, touched};
pub use self::trust::{force_fades_mm, left_at};
use self::window::Window;
pub use self::window::{finer, lattice};
use super::body::Body;
use super::compliance::Compliance;
use super::contact::Grip;
use crate::elastomer::Surface;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Standard deviation of the Gaussian that smooths what is left of the face without pressure, cells. Found by experiment:
/// from 0.4 to 1.1 a sharp pacman is as near to cells of 0.1 mm.
const SMOOTH: f64 = 0.65;
/// Over so many cells from where it ends to what is left as it is.
const FADE: f64 = 2.0;

/// Where its pressure and that of the splines are further apart than this part of the force, one of them is wrong.
const MOST_APART: f64 = 0.1;

/// A face in relief states at least this part of what its splines do. Found by experiment: a socket pressed 0.8 mm over cells
/// of 0.63 mm is off by 1.5 % where its edge tells of 1.1 % and the splines of 6 %.
pub const LEAST_TO_SPLINES: f64 = 0.25;

/// A body that stands further in the face has been missed there, mm.
const MISSED_MM: f64 = 0.01;

/// A point with a part of its surroundings beside the body gives way further by so many times what it does by itself, times
/// that part over the rest. Found by experiment: as the edges of a square of 41 points go from one point to the next, its force
/// over its width stays within 0.7 %; without it, within 2.5 %.
const SOFT: f64 = 1.5;
/// A smaller part of its surroundings is none.
const LEAST_PART: f64 = 0.03;

/// Points that are not worth another thread.
const FEW: usize = 1024;

/// What is known of a face from its splines.
pub struct Splined<'a> {
    pub body: &'a Body,
    pub indenter: &'a dyn Indenter,
    pub pose: &'a Pose,
    /// Edges of a cell, mm.
    pub cell_mm: [f64; 2],
    /// Pressure along z at a place of the undeformed face, MPa.
    pub pressure: &'a (dyn Fn(f64, f64) -> f64 + Sync),
    /// The force of all of it, N.
    pub force_n: f64,
    /// What holds the face along itself, where that is to be found anew.
    pub grip: Option<&'a Grip>,
}

/// What a face in relief tells besides.
pub struct Relief {
    /// The force of the pressure that was found, N.
    pub force_n: f64,
    /// Root mean square of what heights may be off, but for a band at the contact's edge, mm; infinite where the body
    /// stands in the face beside what was looked at.
    pub misfit_mm: f64,
    /// What the grip bears besides; nothing where that was not asked for or not found.
    pub borne: Borne,
    /// What is touched, as it is seen along z, mm^2.
    pub seen_mm2: f64,
}

/// What stands over the points of a window without any pressure.
struct Under {
    /// How far the splines' face is below the body, mm; nothing beside it.
    at_body: Vec<Option<f64>>,
    /// What would be between the face and the body, mm, and how much further a point gives way than its neighbours know,
    /// mm per MPa.
    gap: Vec<f32>,
    soft: Vec<f32>,
}

impl Splined<'_> {
    /// Brings a face into shape, and tells where it is pressed. `rest_z` is the height of the undeformed face. Where no pressure
    /// is found that does, or what presses does so by friction alone, the face is left as the splines have it.
    pub fn relieve(
        &self,
        face: &mut Surface,
        contact: &mut [bool],
        rest_z: impl Fn(f64, f64) -> f64 + Sync,
    ) -> Option<Relief> {
        let pressed = self.pressed(face);
        let window = Window::around(face, &pressed, self.cell_mm).filter(|_| self.force_n > 0.0)?;
        let pressure = self.balanced(face, &pressed, window)?;
        let splined: Vec<f32> = (0..window.count())
            .into_par_iter()
            .with_min_len(FEW)
            .map(|k| {
                let (i, j) = window.at(k);
                let [x, y] = face.rest_xy(i, j);
                face.positions[window.index(face, k)].z - rest_z(x, y) as f32
            })
            .collect();
        let mut layer = Compliance::new(self.body, window.size, window.spacing);
        let free = self.free(&splined, &pressure, &mut layer, window);
        let under = self.under(face, window, &splined, &free, layer.own());
        let [pressure, given] = settle(&under.gap, &under.soft, &mut layer, pressure)?;
        let force_n = pressure.iter().map(|p| f64::from(*p)).sum::<f64>() * window.area();
        if (force_n / self.force_n - 1.0).abs() > MOST_APART {
            return None;
        }
        let change: Vec<f32> = (0..window.count()).map(|k| free[k] - given[k] - splined[k]).collect();
        let misfit_mm = match self.misses(face, window) {
            true => f64::INFINITY,
            false => misfit_mm(&change, &pressure, window),
        };
        let touched: Vec<f64> =
            (0..window.count()).map(|k| touched(&pressure, &under.at_body, window.size[0], k)).collect();
        let borne = self.grip.and_then(|grip| self.borne(grip, face, window, &touched)).unwrap_or_default();
        self.lay(face, contact, window, &change, &under.at_body, &touched);
        let mut parts = vec![0.0; face.nx * face.ny];
        (0..window.count()).for_each(|k| parts[window.index(face, k)] = touched[k]);
        let seen_mm2 = face.parts_seen_mm2(|k| parts[k]);
        Some(Relief { force_n, misfit_mm, borne, seen_mm2 })
    }

    /// The splines' pressure at every point of the lattice, MPa.
    fn pressed(&self, face: &Surface) -> Vec<f32> {
        (0..face.nx * face.ny)
            .into_par_iter()
            .with_min_len(FEW)
            .map(|k| face.rest_xy(k % face.nx, k / face.nx))
            .map(|[x, y]| (self.pressure)(x, y) as f32)
            .collect()
    }

    /// The same in the window, with the splines' force; nothing where it has little to do with that.
    fn balanced(&self, face: &Surface, pressed: &[f32], window: Window) -> Option<Vec<f32>> {
        let mut pressure: Vec<f32> = (0..window.count()).map(|k| pressed[window.index(face, k)]).collect();
        let sum: f64 = pressure.iter().map(|p| f64::from(*p)).sum::<f64>() * window.area();
        if sum < 0.5 * self.force_n {
            return None;
        }
        pressure.iter_mut().for_each(|p| *p *= (self.force_n / sum) as f32);
        Some(pressure)
    }

    /// What the face would be without pressure, mm above the undeformed one: the splines' less what the layer does of it.
    fn free(&self, splined: &[f32], pressure: &[f32], layer: &mut Compliance, window: Window) -> Vec<f32> {
        let mut given = vec![0.0; window.count()];
        layer.displacement(pressure, &mut given);
        let mut free: Vec<f32> = splined.iter().zip(&given).map(|(u, g)| u + g).collect();
        smooth(&mut free, window.size, [0, 1].map(|a| SMOOTH * self.cell_mm[a] / window.spacing[a]));
        free
    }

    /// How far the face is below the body, and what part of a point's surroundings is. `own` is what a point gives way by itself.
    fn under(&self, face: &Surface, window: Window, splined: &[f32], free: &[f32], own: f32) -> Under {
        // (However far the splines stand inside, for they cannot bend as sharply as the body's edge: without what is more than 0.3
        // cells inside, rims a quarter of the pad down have corners, and sharp bodies lose 3 to 9 % of their force.)
        let below = |p: DVec3| self.gap(p);
        let place = |k: usize| face.positions[window.index(face, k)].as_dvec3();
        let at_body: Vec<Option<f64>> =
            (0..window.count()).into_par_iter().with_min_len(FEW).map(|k| below(place(k))).collect();
        let unpressed: Vec<Option<f64>> = (0..window.count())
            .map(|k| at_body[k].map(|gap| gap + f64::from(splined[k] - free[k])))
            .collect();
        let felt = |k: usize| {
            let whole = neighbours(k, window.size[0])
                .all(|n| at_body.get(n).is_none_or(|b| b.is_some() == at_body[k].is_some()));
            let (part, mean) = match at_body[k] {
                Some(gap) if whole => (1.0, gap + bent(&unpressed, window.size[0], k)),
                None if whole => return (f32::INFINITY, 0.0),
                _ => part_below(place(k), window.spacing, below),
            };
            match part >= LEAST_PART {
                true => (mean as f32 + splined[k] - free[k], (SOFT * (1.0 / part - 1.0)) as f32 * own),
                false => (f32::INFINITY, 0.0),
            }
        };
        let (gap, soft) = (0..window.count()).into_par_iter().with_min_len(FEW).map(felt).unzip();
        Under { at_body, gap, soft }
    }

    /// Moves the face by `change`, less and less towards the ends of the window, and marks what is touched altogether.
    fn lay(
        &self,
        face: &mut Surface,
        contact: &mut [bool],
        window: Window,
        change: &[f32],
        at_body: &[Option<f64>],
        touched: &[f64],
    ) {
        let fade = [0, 1].map(|a| FADE * self.cell_mm[a] / window.spacing[a]);
        let count = [face.nx, face.ny];
        let moved = |k: usize| {
            let (i, j) = window.at(k);
            let inside = |at: usize, axis: usize| {
                let (low, high) = (window.from[axis], window.from[axis] + window.size[axis] - 1);
                let below = if low == 0 { f64::INFINITY } else { (at - low) as f64 };
                let above = if high == count[axis] - 1 { f64::INFINITY } else { (high - at) as f64 };
                let t = (below.min(above) / fade[axis]).min(1.0);
                t * t * (3.0 - 2.0 * t)
            };
            let part = (inside(i, 0) * inside(j, 1)) as f32;
            // A soft point has not given way as far as the body reaches, and what bends is nearer than it is at a mean.
            let most = at_body[k].map_or(f32::INFINITY, |gap| gap as f32);
            (part * change[k].min(most), touched[k] == 1.0)
        };
        let moved: Vec<(f32, bool)> =
            (0..window.count()).into_par_iter().with_min_len(FEW).map(moved).collect();
        for (k, (higher, touches)) in moved.into_iter().enumerate() {
            let to = window.index(face, k);
            face.positions[to].z += higher;
            contact[to] = touches;
        }
    }

    /// How far a place is below the body, mm; nothing beside it.
    pub fn gap(&self, p: DVec3) -> Option<f64> {
        let local = self.pose.to_indenter(p);
        self.indenter.lower_surface(local.x, local.y).map(|low| low + self.pose.z_mm - p.z)
    }

    /// Whether the body stands in the face where no pressure of the splines tells of it.
    fn misses(&self, face: &Surface, window: Window) -> bool {
        let axis = DVec2::new(self.pose.x_mm, self.pose.y_mm);
        let seen = |at: usize, axis: usize| at.wrapping_sub(window.from[axis]) < window.size[axis];
        let [hx, hy] = self.indenter.half_extent_mm();
        // (What lies further from its axis is not below it.)
        let near = |p: Vec3| (p.truncate().as_dvec2() - axis).length_squared() <= hx * hx + hy * hy;
        face.positions.par_iter().with_min_len(FEW).enumerate().any(|(k, p)| {
            !(seen(k % face.nx, 0) && seen(k / face.nx, 1))
                && near(*p)
                && self.gap(p.as_dvec3()).is_some_and(|gap| gap < 0.0)
                && self.indenter.distance(self.pose.to_indenter(p.as_dvec3())) < -MISSED_MM
        })
    }
}

#[cfg(test)]
mod tests;
