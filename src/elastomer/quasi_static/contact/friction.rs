//! What happens between two solves: multipliers, anchors and friction bounds follow the displacement.

use super::side::{ANOTHER_SIDE, Entry, Side};
use super::{Contacts, Sample};
use crate::elastomer::Friction;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;

/// Tangential over normal penalty with infinite friction, and with a coefficient: the softer, the milder the
/// kink between holding and slipping, which Newton's steps would overshoot; multipliers take the error out.
pub(super) const STICK_SOFTNESS: f64 = 0.3;
/// See [`STICK_SOFTNESS`].
pub(super) const SLIP_SOFTNESS: f64 = 0.1;

/// What infinite friction bears where the contact is whole. Pads do not hold by an edge under no pressure: released one by one such
/// points would unzip for hundreds of solves. Found by experiment: spheres of radius 3 and 4 (0.25 to 1 mm deep), a cone, dots, a line,
/// a torus, slid by up to two depths, drag within 5 % of what they do over cells of 0.2 mm with both numbers a thousand, most within
/// 2.5 %; with a strength of 2 the spheres drag 10 %, the cone 38 % less.
const WHOLE: Hold = Hold { coefficient: 8.0, strength: 6.0 };
/// What it bears once torn loose: as rubber slides. Found by experiment: less than that at which the face folds ahead of moon, pacman,
/// socket, torus and spheres that are dragged by 5 mm; with a strength of 2 it does, at a pace of ten seconds a millimetre.
const TORN: Hold = Hold { coefficient: 0.8, strength: 1.0 };

/// Power of the part of the way at which a point would have met the indenter, had the pad stood still, that
/// gives the part at which it does. Found by experiment: a sphere of radius 4 with infinite friction, pressed
/// 1 mm in two increments, is then within 0.5 % of the force of ten.
const LATENESS: f64 = 1.25;
/// Rounds of an increment in which the bounds of what sticks follow the pressure.
const BOUND_ROUNDS: u32 = 3;
/// Rounds in which tangential multipliers are brought up to date, of what sticks and of what slides: the softer springs of the
/// latter need more.
const MULTIPLIER_ROUNDS: [u32; 2] = [3, 6];
/// Rounds after which the side that deep points are pushed out by is chosen anew.
const SIDE_ROUNDS: u32 = 5;

/// Where a point holds on to the indenter.
#[derive(Debug, Clone, Copy)]
pub struct Anchor {
    /// The tangential plane, and the point in it.
    pub(super) side: Side,
    /// Largest tangential traction, MPa.
    pub(super) bound: f64,
    /// Tangential multiplier: the traction on the pad with no slip since the anchor was set, MPa.
    held: DVec3,
}

impl Anchor {
    /// Tangential traction on the pad of a point at `p`, were there no bound.
    pub(super) fn trial(&self, p: DVec3, stiffness: f64) -> DVec3 {
        self.held - self.side.along(p - self.side.at) * stiffness
    }

    /// Lays the tangential plane as the indenter is where the point has slipped to: traction along the plane that it came from
    /// presses there, or lifts. A side round a corner is not followed.
    fn lean(&mut self, normal: DVec3) {
        if normal.dot(self.side.normal) > ANOTHER_SIDE {
            let length = self.held.length();
            self.side.normal = normal;
            self.held = self.side.along(self.held).normalize_or_zero() * length;
        }
    }
}

/// What infinite friction can bear.
#[derive(Debug, Clone, Copy)]
struct Hold {
    /// Largest tangential traction over the pressure.
    coefficient: f64,
    /// The same over the shear modulus.
    strength: f64,
}

/// How much traction the face can take along the indenter.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrictionLaw {
    pub(super) friction: Friction,
    shear_modulus_mpa: f64,
    /// How far what sticks has torn loose, and what infinite friction so bears.
    torn: f64,
    hold: Hold,
}

impl FrictionLaw {
    /// That of a face of a shear modulus along which nothing has gone yet.
    pub(super) fn new(friction: Friction, shear_modulus_mpa: f64) -> Self {
        Self { friction, shear_modulus_mpa, torn: 0.0, hold: WHOLE }
    }

    /// Sets how far what sticks has torn loose, from 0 to 1.
    fn set_torn(&mut self, part: f64) {
        self.torn = part;
        let between = |whole: f64, torn: f64| whole * (torn / whole).powf(part);
        self.hold = Hold {
            coefficient: between(WHOLE.coefficient, TORN.coefficient),
            strength: between(WHOLE.strength, TORN.strength),
        };
    }

    /// Largest tangential traction under a pressure, MPa.
    fn bound(self, pressure: f64) -> f64 {
        match self.friction {
            Friction::Infinite => {
                (self.hold.strength * self.shear_modulus_mpa).min(self.hold.coefficient * pressure)
            }
            Friction::Coefficient(mu) => mu * pressure,
        }
    }
}

/// What changed between two solves.
#[derive(Debug, Clone, Copy, Default)]
pub struct Updated {
    /// Points that were anchored or let go.
    pub events: usize,
    /// Largest penetration or gap of a loaded point, mm.
    pub violation_mm: f64,
    /// Change of the friction bounds, relative to the friction force.
    pub bound_change: f64,
}

impl Contacts {
    /// Sets how far what sticks has torn loose, from 0 (it holds) to 1 (it slides); no point then holds more than it may.
    pub fn set_torn(&mut self, part: f64) {
        let (part, before) = (part.clamp(0.0, 1.0), self.law.torn);
        if part == before || !self.sticks() {
            return;
        }
        self.law.set_torn(part);
        let tears = part > before;
        for s in self.samples.iter_mut().filter(|_| tears) {
            if let Some(anchor) = &mut s.anchor {
                anchor.bound = anchor.bound.min(self.law.bound(s.pressure.max(0.0)));
                anchor.held = anchor.held.clamp_length_max(anchor.bound);
            }
        }
    }

    /// The part of what sticks that has not torn loose, from 0 to 1; nothing with a friction coefficient.
    pub fn holding(&self) -> f64 {
        if self.sticks() { 1.0 - self.law.torn } else { 0.0 }
    }

    /// Brings multipliers, anchors and friction bounds up to date after a round (counted from 1) at `pose`.
    ///
    /// What holds, what slips and how much each can bear depend on one another, and brought up to date for
    /// ever they may chase one another in circles. So tangential multipliers stand still from a round on
    /// (what they then miss is a fraction of a micrometre of creep), and of what sticks, whose
    /// bounds are no physics, the bounds before them. Those of what slides always follow: they contract. The planes of
    /// what slips follow as long as the multipliers: a sphere of radius 4 in increments of 0.25 mm drags 2 to 3 % more
    /// along the planes that its points come from than in the shortest, and along those that they come to as in these.
    pub fn update(&mut self, indenter: &dyn Indenter, poses: [&Pose; 2], u: &[f32], round: u32) -> Updated {
        if round <= SIDE_ROUNDS {
            self.choose_sides(indenter, poses[1], u);
        }
        let mut out = Updated::default();
        let rubs = self.has_friction();
        let tangent = rubs || self.anchored;
        let slides = !self.sticks() || self.law.torn >= 1.0;
        let bounds_follow = slides || round <= BOUND_ROUNDS;
        let multiplier_rounds = MULTIPLIER_ROUNDS[usize::from(slides)];
        // A point that loses its pressure in an early round may be back in the next; later it lets go for good.
        let revocable = round <= multiplier_rounds;
        let (mut change, mut total) = (0.0, 0.0);
        let mut samples = std::mem::take(&mut self.samples);
        let met = |s: &Sample| s.entry.filter(|_| s.pressure > 0.0).map_or(0.0, |e| e.fraction);
        self.latest = samples.iter().map(met).fold(self.latest, f64::max);
        let count = self.lattice.per_cell();
        for cell in samples.chunks_mut(count) {
            let mean = cell.iter().map(|s| s.pressure).sum::<f64>() / count as f64;
            out.violation_mm = out.violation_mm.max((mean - cell[0].multiplier).abs() / self.stiffness);
            let (mut held, mut slipping) = ((DVec3::ZERO, 0), (DVec3::ZERO, 0));
            for s in cell.iter_mut() {
                s.multiplier = mean;
                let was_loaded = std::mem::replace(&mut s.loaded, s.pressure > 0.0);
                if !tangent {
                    continue;
                }
                let bound = self.law.bound(s.pressure);
                if !s.loaded && !revocable {
                    if s.anchor.take().is_some() {
                        s.let_go = true;
                        out.events += 1;
                    }
                } else if let Some(anchor) = &mut s.anchor {
                    // (What bears nothing has no bound to tell it by.)
                    let was_loaded = if rubs { anchor.bound > 0.0 } else { was_loaded };
                    out.events += usize::from(s.loaded != was_loaded);
                    let mut trial = anchor.trial(s.seen, self.tangential);
                    if s.loaded && revocable && s.pushed_by.is_none() && trial.length() >= anchor.bound {
                        anchor.lean(Side::nearest(indenter, s.seen).1.normal);
                        trial = anchor.trial(s.seen, self.tangential);
                    }
                    let bound = match s.loaded {
                        false => 0.0,
                        true if bounds_follow || anchor.bound == 0.0 => bound,
                        true => anchor.bound,
                    };
                    let now = trial.clamp_length_max(bound);
                    change += (now - trial.clamp_length_max(anchor.bound)).length();
                    total += s.pressure.max(now.length());
                    anchor.bound = bound;
                    let sum = if trial.length() >= bound { &mut slipping } else { &mut held };
                    *sum = (sum.0 + now, sum.1 + 1);
                } else if s.loaded && !s.let_go {
                    s.anchor = Some(self.touch(s, indenter, poses, u, bound));
                    out.events += 1;
                    held.1 += 1;
                }
            }
            if round > multiplier_rounds {
                continue;
            }
            // The multipliers become the mean traction of the points that hold, as far as the bounds allow.
            let (sum, n) = if held.1 > 0 { held } else { slipping };
            let mean = sum / f64::from(n.max(1));
            for anchor in cell.iter_mut().filter_map(|s| s.anchor.as_mut()) {
                let now = mean.clamp_length_max(anchor.bound);
                if now.length() < anchor.bound {
                    change += (now - anchor.held).length();
                }
                anchor.held = now;
            }
        }
        self.samples = samples;
        out.bound_change = if total > 0.0 { change / total } else { 0.0 };
        out
    }

    /// The anchor of a point that touched during this increment: where it was on the indenter when it
    /// would have met it, had the pad stood still.
    fn touch(
        &self,
        s: &Sample,
        indenter: &dyn Indenter,
        [old_pose, pose]: [&Pose; 2],
        u: &[f32],
        bound: f64,
    ) -> Anchor {
        // Pressed, the face recedes: the last point to touch does so at the end of the way, those before it in
        // proportion. Beside a sliding indenter it stands still.
        let share = |e: Entry| match self.latest {
            1.0 => e.fraction,
            latest => (e.fraction / latest.max(1e-9)).min(1.0).powf(LATENESS),
        };
        let fraction = s.entry.map_or(1.0, share);
        let now = self.value(u, s.cell, s.sub);
        let then = s.old_u + (now - s.old_u) * fraction;
        let p = old_pose.lerp(pose, fraction).to_indenter(s.rest + then);
        let (gap, nearest) = Side::nearest(indenter, p);
        let side =
            s.entry.map(|e| e.side).filter(|side| side.came_by_instead(gap, &nearest)).unwrap_or(nearest);
        Anchor { side, bound, held: DVec3::ZERO }
    }

    /// Part of the points under pressure that were let go in this increment and came back: they hold nothing until it ends.
    pub fn idle_part(&self) -> f64 {
        let pressed = self.samples.iter().filter(|s| s.pressure > 0.0);
        let (idle, all) = pressed.fold((0, 0), |(idle, all), s| (idle + u32::from(s.let_go), all + 1));
        f64::from(idle) / f64::from(all.max(1))
    }

    /// Ends an increment: anchors of sliding points follow, so that their spring carries the bound.
    pub fn end_increment(&mut self, indenter: &dyn Indenter) {
        for s in &mut self.samples {
            s.anchor = s.anchor.filter(|_| s.pressure > 0.0);
            if s.let_go && s.pressure > 0.0 {
                // Touching again: it holds where it is, without traction.
                let bound = self.law.bound(s.pressure);
                s.anchor = Some(Anchor { side: s.touched(indenter), bound, held: DVec3::ZERO });
            }
            let Some(anchor) = s.anchor else { continue };
            let trial = anchor.trial(s.seen, self.tangential);
            if trial.length() > anchor.bound {
                let side = s.touched(indenter);
                let held = side.along(trial).normalize_or_zero() * anchor.bound;
                s.anchor = Some(Anchor { side, held, ..anchor });
            }
        }
    }
}
