//! The face under a body, finer than the splines that carry it.
//!
//! At the edge of a contact the face bends within less than a cell, and beside an edge of the body the pressure rises without
//! bound: splines follow cell by cell, which shows as beads along slanted edges and as corners on the rim of a ball. What
//! they miss is local, and over a cell or two a pad is as good as a layer that gives way linearly. So the face is what it
//! would be without any pressure, which is smooth and taken from the splines, and the layer's answer to the pressure on it,
//! which is found anew on the lattice: nowhere negative, and nothing inside the body (the conjugate gradients of Polonsky and
//! Keer 1999, "A numerical method for solving rough contact problems based on the multi-level multi-summation and conjugate
//! gradient techniques"). That moves points along z only: the face of a nearly incompressible layer does not move along
//! itself when it is pressed.

mod grip;

pub use self::grip::{Borne, finer_to_hold};
use super::body::Body;
use super::compliance::Compliance;
use super::contact::Grip;
use crate::elastomer::Surface;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// The lattice has at least so many points across a cell.
const ACROSS_CELL: f64 = 4.0;
/// Though none closer than this, mm, where that leaves so many. Found by experiment: over cells of 0.28 mm the force of a bar
/// pressed 1 mm is 1 % too small at points 0.1 mm apart, and within 0.3 % at ones of half of that.
const CLOSE_ENOUGH_MM: f64 = 0.1;
/// See [`CLOSE_ENOUGH_MM`].
const LEAST_ACROSS_CELL: f64 = 3.0;
/// Standard deviation of the Gaussian that smooths what is left of the face without pressure, cells. Found by experiment:
/// from 0.4 to 1.1 a sharp pacman is as near to cells of 0.1 mm.
const SMOOTH: f64 = 0.65;
/// Around what is pressed so much more is looked at, cells.
const MARGIN: f64 = 5.0;
/// Over so many cells from where it ends to what is left as it is.
const FADE: f64 = 2.0;
/// Penetration and gap under pressure that may remain, mm.
const CLOSE_MM: f32 = 2e-4;
/// Iterations; a tenth of them is usual.
const MOST_ITERATIONS: u32 = 200;

/// Where its pressure and that of the splines are further apart than this part of the force, one of them is wrong.
const MOST_APART: f64 = 0.1;

/// Width of the band on either side of the contact's edge that tells how far the splines are off there, mm.
const BAND_MM: f64 = 0.2;
/// Error outside of that band per change inside of it, both as root mean squares over four times the contact's area, though
/// no less than over a circle of 3 mm. Found by experiment, with [`super::level::Level::error_in_relief`]'s constant part:
/// 21 bodies, sharp ones and edges rounded by 0.3 mm, pressed 0.3 to 0.8 mm over cells of 0.28, 0.42 and 0.63 mm, are off cells
/// of 0.10 to 0.14 mm by less than is stated, by a quarter of it at the median.
const TO_ERROR: f64 = 0.3;
/// See [`TO_ERROR`].
const LEAST_JUDGED_MM2: f64 = 9.0 * std::f64::consts::PI;

/// A face in relief states at least this part of what its splines do. Found by experiment: a socket pressed 0.8 mm over cells
/// of 0.63 mm is off by 1.5 % where its edge tells of 1.1 % and the splines of 6 %.
pub const LEAST_TO_SPLINES: f64 = 0.25;

/// A body that stands further in the face has been missed there, mm.
const MISSED_MM: f64 = 0.01;

/// A point with a part of its surroundings beside the body gives way further by so many times what it does by itself, times
/// that part over the rest. Found by experiment: as the edges of a square of 41 points go from one point to the next, its force
/// over its width stays within 0.7 %; without it, within 2.5 %.
const SOFT: f64 = 1.5;
/// Places in a quarter of a point's surroundings that are looked at; a power of two. None shares its column or row with another, but
/// for its mirror images, so that an edge along the lattice is found to a sixteenth of the way between points.
const PLACES: u32 = 8;
/// A smaller part of its surroundings is none.
const LEAST_PART: f64 = 0.03;

/// Points that are not worth another thread.
const FEW: usize = 1024;
/// Lines of a lattice that one thread smooths at once.
const LINES_AT_ONCE: usize = 16;

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
}

/// How many times finer than asked for the lattice has to be; nothing where it is too coarse to show what is finer than
/// a cell.
pub fn finer(spacing_mm: [f64; 2], cell_mm: [f64; 2]) -> Option<[usize; 2]> {
    let coarse = (0..2).any(|a| spacing_mm[a] > cell_mm[a]);
    let times = |a: usize| (spacing_mm[a] / widest_mm(cell_mm[a]) - 1e-6).ceil().max(1.0) as usize;
    (!coarse).then(|| [times(0), times(1)])
}

/// Points along x and y of the coarsest lattice that shows the relief over such cells on a pad of `size_mm`.
pub fn lattice(size_mm: [f64; 3], cell_mm: [f64; 2]) -> [usize; 2] {
    [0, 1].map(|a| (size_mm[a] / widest_mm(cell_mm[a])).ceil() as usize + 1)
}

/// Between the points of a lattice that shows the relief over such cells, at most.
fn widest_mm(cell_mm: f64) -> f64 {
    (cell_mm / ACROSS_CELL).max(CLOSE_ENOUGH_MM.min(cell_mm / LEAST_ACROSS_CELL))
}

/// The part of a lattice that is looked at.
#[derive(Debug, Clone, Copy)]
struct Window {
    from: [usize; 2],
    size: [usize; 2],
    /// Between points of the lattice, mm.
    spacing: [f64; 2],
}

impl Window {
    /// How many points it has.
    fn count(self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Where on the lattice one of them is.
    fn at(self, k: usize) -> (usize, usize) {
        (self.from[0] + k % self.size[0], self.from[1] + k / self.size[0])
    }

    /// Where in the lattice's values.
    fn index(self, face: &Surface, k: usize) -> usize {
        self.at(k).1 * face.nx + self.at(k).0
    }

    /// mm^2 of a point.
    fn area(self) -> f64 {
        self.spacing[0] * self.spacing[1]
    }
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
        let window = self.window(face, &pressed)?;
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
        let borne = self.grip.and_then(|grip| self.borne(grip, face, window, &pressure)).unwrap_or_default();
        self.lay(face, contact, window, &change, &under.at_body, &pressure);
        Some(Relief { force_n, misfit_mm, borne })
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

    /// Moves the face by `change`, less and less towards the ends of the window, and marks what is pressed.
    fn lay(
        &self,
        face: &mut Surface,
        contact: &mut [bool],
        window: Window,
        change: &[f32],
        at_body: &[Option<f64>],
        pressure: &[f32],
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
            (part * change[k].min(most), at_body[k].is_some() && is_covered(pressure, window.size[0], k))
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
    fn gap(&self, p: DVec3) -> Option<f64> {
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

    /// What is pressed, and its surroundings.
    fn window(&self, face: &Surface, pressed: &[f32]) -> Option<Window> {
        let spacing = [face.size_x_mm / (face.nx - 1) as f64, face.size_y_mm / (face.ny - 1) as f64];
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for (k, _) in pressed.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let (i, j) = (k % face.nx, k / face.nx);
            (low, high) = ([low[0].min(i), low[1].min(j)], [high[0].max(i), high[1].max(j)]);
        }
        (self.force_n > 0.0 && low[0] <= high[0]).then(|| {
            let count = [face.nx, face.ny];
            let margin = [0, 1].map(|a| (MARGIN * self.cell_mm[a] / spacing[a]).ceil() as usize);
            let from = [0, 1].map(|a| low[a].saturating_sub(margin[a]));
            let to = [0, 1].map(|a: usize| (high[a] + margin[a] + 1).min(count[a]));
            Window { from, size: [to[0] - from[0], to[1] - from[1]], spacing }
        })
    }
}

/// Finds the pressure with which nothing is inside the body and nothing that is not at it is pressed, and what the layer does
/// under it. `gap` is what there would be without any pressure; each point gives way by `soft` times its own pressure
/// besides, mm per MPa, of which its neighbours and the answer know nothing.
fn settle(
    gap: &[f32],
    soft: &[f32],
    layer: &mut Compliance,
    mut pressure: Vec<f32>,
) -> Option<[Vec<f32>; 2]> {
    let n = gap.len();
    for (p, gap) in pressure.iter_mut().zip(gap) {
        *p = if gap.is_finite() { p.max(0.0) } else { 0.0 };
    }
    let (mut given, mut way, mut along) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let largest = layer.largest();
    let mut answer = |pressure: &[f32], out: &mut [f32]| {
        layer.displacement(pressure, out);
        out.iter_mut().zip(pressure).zip(soft).for_each(|((out, p), soft)| *out += soft * p);
    };
    answer(&pressure, &mut given);
    let (mut last, mut conjugate) = (1.0, false);
    for _ in 0..MOST_ITERATIONS {
        // What is left to do.
        let (mut square, mut worst) = (0.0, 0.0f32);
        for k in 0..n {
            let gap = gap[k] + given[k];
            if pressure[k] > 0.0 {
                square += f64::from(gap).powi(2);
                worst = worst.max(gap.abs());
            } else {
                worst = worst.max(-gap);
            }
        }
        if worst <= CLOSE_MM {
            given.iter_mut().zip(&pressure).zip(soft).for_each(|((g, p), soft)| *g -= soft * p);
            return Some([pressure, given]);
        }
        // The way there, and how far along it.
        let beta = if conjugate { (square / last) as f32 } else { 0.0 };
        last = square;
        for k in 0..n {
            way[k] = if pressure[k] > 0.0 { gap[k] + given[k] + beta * way[k] } else { 0.0 };
        }
        answer(&way, &mut along);
        let (mut up, mut down) = (0.0, 0.0);
        for k in (0..n).filter(|k| pressure[*k] > 0.0) {
            up += f64::from(gap[k] + given[k]) * f64::from(way[k]);
            down += f64::from(along[k]) * f64::from(way[k]);
        }
        let step = if down > 0.0 { (up / down) as f32 } else { 1.0 / largest };
        // What lets go, and what comes to touch.
        conjugate = true;
        let mut as_it_was = true;
        for k in 0..n {
            let wanted = pressure[k] - step * way[k];
            let touches = wanted <= 0.0 && gap[k] + given[k] < 0.0;
            conjugate &= !touches;
            as_it_was &= wanted >= 0.0 && !touches;
            pressure[k] = if touches { -step * (gap[k] + given[k]) } else { wanted.max(0.0) };
        }
        if as_it_was {
            given.iter_mut().zip(&along).for_each(|(g, a)| *g -= step * a);
        } else {
            answer(&pressure, &mut given);
        }
    }
    None
}

/// What heights may be off, mm, by how much they change at the edge of the contact.
fn misfit_mm(change: &[f32], pressure: &[f32], window: Window) -> f64 {
    let area = window.area();
    let squares =
        at_edge(pressure, window.size[0], window.spacing).map(|k| f64::from(change[k]).powi(2)).sum::<f64>();
    let pressed_mm2 = pressure.iter().filter(|p| **p > 0.0).count() as f64 * area;
    let judged_mm2 = (4.0 * pressed_mm2).max(LEAST_JUDGED_MM2);
    let changed_mm = (squares * area / judged_mm2).sqrt();
    TO_ERROR * changed_mm
}

/// The points within [`BAND_MM`] along x and y of where pressed ones meet others.
fn at_edge(pressure: &[f32], nx: usize, spacing: [f64; 2]) -> impl Iterator<Item = usize> {
    let ny = pressure.len() / nx;
    let reach = spacing.map(|s| (BAND_MM / s).round() as usize);
    let pressed = |i: usize, j: usize| u32::from(pressure[j * nx + i] > 0.0);
    let around = |at: usize, reach: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
    // Of so many neighbours along x so many are pressed.
    let along: Vec<u32> =
        (0..pressure.len()).map(|k| around(k % nx, reach[0], nx).map(|i| pressed(i, k / nx)).sum()).collect();
    (0..pressure.len()).filter(move |k| {
        let (columns, rows) = (around(k % nx, reach[0], nx), around(k / nx, reach[1], ny));
        let all = (columns.len() * rows.len()) as u32;
        let sum: u32 = rows.map(|j| along[j * nx + k % nx]).sum();
        sum > 0 && sum < all
    })
}

/// Pressure of a point at the edge of the contact over that of its pressed neighbours, below which most of its part of the
/// face lies outside.
const COVERED: f32 = 0.1;

/// The points beside one.
fn neighbours(k: usize, nx: usize) -> impl Iterator<Item = usize> {
    [k.wrapping_sub(1), k + 1, k.wrapping_sub(nx), k + nx].into_iter()
}

/// How much further than a point its surroundings are from a body at a mean: the pressure of a point is that of all of them. On
/// the rounded edge of a cone the force is 1 % too large at points 0.1 mm apart where it is found from the points alone.
fn bent(gap: &[Option<f64>], nx: usize, k: usize) -> f64 {
    let bends = |n: usize| Some((*gap.get(n)?)? - gap[k]?);
    neighbours(k, nx).filter_map(bends).sum::<f64>() / 24.0
}

/// What part of the surroundings of a place is below a body, and how far at a mean.
fn part_below(p: DVec3, spacing: [f64; 2], below: impl Fn(DVec3) -> Option<f64>) -> (f64, f64) {
    let off = |k: u32| 0.5 * (f64::from(k) + 0.5) / f64::from(PLACES);
    let reversed = |k: u32| k.reverse_bits() >> (u32::BITS - PLACES.ilog2());
    let quarter = (0..PLACES).map(|k| [off(k) * spacing[0], off(reversed(k)) * spacing[1]]);
    let places = quarter.flat_map(|[x, y]| [[x, y], [-x, y], [x, -y], [-x, -y]]);
    let parts = places.filter_map(|[x, y]| below(p + DVec3::new(x, y, 0.0)));
    let (sum, n) = parts.fold((0.0, 0), |(sum, n), gap| (sum + gap, n + 1));
    (f64::from(n) / f64::from(4 * PLACES), sum / f64::from(n.max(1)))
}

/// Whether a point stands for a part of the face that is pressed.
fn is_covered(pressure: &[f32], nx: usize, k: usize) -> bool {
    let (sum, n) = neighbours(k, nx)
        .filter_map(|k| pressure.get(k).filter(|p| **p > 0.0))
        .fold((0.0, 0u8), |(sum, n), p| (sum + p, n + 1));
    pressure[k] > 0.0 && (n == 4 || pressure[k] * f32::from(n) >= COVERED * sum)
}

/// Smooths a field by a Gaussian whose standard deviations along x and y are given in points; at its ends it is continued as
/// its mirror image.
fn smooth(field: &mut [f32], [nx, ny]: [usize; 2], deviation: [f64; 2]) {
    let weights = deviation.map(|s| {
        let reach = (4.0 * s).ceil() as i64;
        let all: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / s).powi(2)).exp()).collect();
        let sum: f64 = all.iter().sum();
        all.iter().map(|w| (w / sum) as f32).collect::<Vec<_>>()
    });
    let mirrored = |at: i64, n: usize| {
        let period = 2 * (n as i64 - 1).max(1);
        let at = at.rem_euclid(period);
        at.min(period - at) as usize
    };
    let before = field.to_vec();
    let lines = LINES_AT_ONCE * nx;
    field.par_chunks_mut(lines).zip(before.par_chunks(lines)).for_each(|(field, before)| {
        let reach = (weights[0].len() / 2) as i64;
        let mut line = Vec::new();
        for (field, before) in field.chunks_mut(nx).zip(before.chunks(nx)) {
            line.clear();
            line.extend((-reach..nx as i64 + reach).map(|at| before[mirrored(at, nx)]));
            for (k, to) in field.iter_mut().enumerate() {
                *to = weights[0].iter().zip(&line[k..]).map(|(w, v)| w * v).sum();
            }
        }
    });
    let before = field.to_vec();
    field.par_chunks_mut(lines).enumerate().for_each(|(m, field)| {
        let reach = (weights[1].len() / 2) as i64;
        for (j, field) in field.chunks_mut(nx).enumerate() {
            field.fill(0.0);
            for (k, weight) in weights[1].iter().enumerate() {
                let from = mirrored((m * LINES_AT_ONCE + j) as i64 + k as i64 - reach, ny);
                field.iter_mut().zip(&before[from * nx..]).for_each(|(to, v)| *to += weight * v);
            }
        }
    });
}

#[cfg(test)]
mod tests;
