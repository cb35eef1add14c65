//! Lights as ribbons: a few upright lines from a low to a high point, side by side.
//!
//! What the pad hides of a light, and what dips below a surface's own horizon, is its lower part. Cutting each line at
//! the higher of the two horizons and taking off the irradiance of what is below leaves the light that arrives. The
//! lines of a rectangle are fixed; those of a tube turn with the receiver, and through a plate lines appear elsewhere.

use super::plate::Slab;
use super::profile::{Bulge, Profile};
use super::tables::arriving;
use crate::optics::{Light, LightShape, emitter::Emitter};
use glam::Vec3;

/// Lines of a ribbon, one more than a power of two (found by experiment: with 9 the shadow at the foot of a step shows
/// them). Where fewer will do, every other, every fourth or every eighth is taken.
pub const LINES: usize = 17;
/// As many where lamps are seen through slits between flanks (found by experiment: pictures of sharp lines 1 mm deep are 0.54 and 0.57 %
/// off with 17, 0.43 and 0.47 % with 33).
pub const MOST_LINES: usize = 33;
const _: () =
    assert!((LINES - 1).is_power_of_two() && (MOST_LINES - 1).is_power_of_two() && LINES <= MOST_LINES);
/// Where lines turn with the receiver, those between are means of their neighbours: of so many one is worked out.
pub const KEPT: usize = 2;

/// Lines between those that are always followed, of so many.
pub const fn coarse(lines: usize) -> usize {
    lines / 2
}

/// The two ends of a line: low, high.
pub type Line = [Vec3; 2];

/// A light as the pad sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Shape of the luminous surface.
    outline: Outline,
    /// Unit normal; 0 for a tube.
    normal: Vec3,
    /// Angular profile, where it has one.
    profile: Option<Profile>,
}

#[derive(Debug, Clone, PartialEq)]
enum Outline {
    /// Corners counter-clockwise as seen from the shining side, from the first to the second runs the low edge.
    Rectangle([Vec3; 4]),
    /// Centre, half of the level diameter, half of the upright one.
    Disc(Vec3, Vec3, Vec3),
    /// Ends of the axis, the radius, and how far its near side is before its axis.
    Tube(Vec3, Vec3, f32, Bulge),
}

/// A light as walls and camera see it.
#[derive(Debug, Clone)]
pub struct Lamp {
    /// As the pad sees it.
    pub source: Source,
    /// Middle of the luminous surface.
    pub center: Vec3,
    /// Corners of the box around it.
    pub bounds: [Vec3; 2],
    emitter: Emitter,
}

impl Lamp {
    /// From a light; None where there is no [`Source`].
    pub fn new(light: &Light) -> Option<Self> {
        let emitter = Emitter::new(light);
        let inf = Vec3::splat(f32::INFINITY);
        let points = light.shape.tessellate().positions;
        let bounds = points.iter().fold([inf, -inf], |[low, high], p| [low.min(*p), high.max(*p)]);
        Some(Self { source: Source::new(light)?, center: emitter.center, bounds, emitter })
    }

    /// A point of it for two numbers in the unit square, evenly spread over its area; its normal there, and that area, mm^2.
    pub fn place(&self, u: [f32; 2]) -> (Vec3, Vec3, f32) {
        let place = self.emitter.sample(u.into());
        (place.point, place.normal, 1.0 / place.pdf_area)
    }

    /// Radiance at this cosine to the normal of a point, of radiance 1 along it.
    pub fn radiance(&self, cos: f32) -> f32 {
        self.emitter.profile(cos)
    }

    /// A point just before the surface that shines at a receiver, by which it is told whether the light is hidden.
    pub fn middle_from(&self, receiver: Vec3) -> Vec3 {
        match self.source.outline {
            // Its nearest point: towards any other a tube hides itself.
            Outline::Tube(from, to, radius, _) => {
                let axis = to - from;
                let s = (receiver - from).dot(axis) / axis.length_squared().max(1e-20);
                let nearest = from + axis * s.clamp(0.0, 1.0);
                nearest + (receiver - nearest).normalize_or_zero() * (1.02 * radius)
            }
            _ => self.center + (receiver - self.center) * 1e-4,
        }
    }

    /// Irradiance of a receiver, of radiance 1, nothing in between.
    pub fn irradiance(&self, point: Vec3, normal: Vec3) -> f32 {
        match self.emitter.analytic {
            true => self.emitter.unoccluded(point, normal),
            false => arriving(&self.source, None, point).dot(normal).max(0.0),
        }
    }
}

impl Source {
    /// From a light; None when it is no ribbon (a mesh, or two-sided).
    pub fn new(light: &Light) -> Option<Self> {
        if light.two_sided {
            return None;
        }
        let (outline, normal) = match &light.shape {
            LightShape::Rectangle { center, half_u, half_v } => {
                let corner = |s: f32, t: f32| *center + *half_u * s + *half_v * t;
                let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                (Outline::Rectangle(level(corners)), half_u.cross(*half_v).normalize_or_zero())
            }
            LightShape::Disc { center, normal, radius } => {
                let across = Vec3::Z.cross(*normal);
                let across = if across.length() > 1e-4 { across.normalize() } else { Vec3::X };
                (Outline::Disc(*center, across * *radius, normal.cross(across) * *radius), *normal)
            }
            LightShape::Tube { from, to, radius } => {
                (Outline::Tube(*from, *to, *radius, Bulge::new(light.cosine_power)), Vec3::ZERO)
            }
            LightShape::Mesh(_) => return None,
        };
        let power = light.cosine_power;
        let profile = match outline {
            Outline::Tube(from, to, ..) => Some(Profile::around((to - from).normalize_or_zero(), power)),
            _ => (normal != Vec3::ZERO).then(|| Profile::flat(normal, power)),
        };
        Some(Self { outline, normal, profile: profile.filter(|_| power > 0.0) })
    }

    /// Whether its lines are the same from everywhere.
    pub fn is_fixed(&self) -> bool {
        matches!(self.outline, Outline::Rectangle(_))
    }

    /// Whether it is a tube.
    pub fn is_tube(&self) -> bool {
        matches!(self.outline, Outline::Tube(..))
    }

    /// Whether Lambert's formula for its corners is exact.
    pub fn corners(&self) -> Option<[Vec3; 4]> {
        match self.outline {
            Outline::Rectangle(corners) if self.profile.is_none() => Some(corners),
            _ => None,
        }
    }

    /// Whether a point is on the shining side.
    #[inline]
    pub fn faces(&self, point: Vec3) -> bool {
        match self.outline {
            Outline::Tube(..) => true,
            Outline::Rectangle([a, ..]) | Outline::Disc(a, ..) => {
                (point - a).dot(self.normal) > 1e-6 * (point - a).length()
            }
        }
    }

    /// Whether it stands beyond a plate.
    pub fn stands_beyond(&self, slab: &Slab) -> bool {
        self.around()[0].z >= slab.high
    }

    /// Corners of a rectangle around it; a tube's lies in its axis.
    pub fn around(&self) -> [Vec3; 4] {
        match self.outline {
            Outline::Rectangle(corners) => corners,
            Outline::Disc(center, across, up) => {
                [-across - up, across - up, across + up, up - across].map(|to| center + to)
            }
            Outline::Tube(from, to, ..) => [from, to, to, from],
        }
    }

    /// How far a tube's side is from its axis; nothing of what is flat.
    pub fn radius_mm(&self) -> f32 {
        match self.outline {
            Outline::Tube(.., radius, _) => radius,
            _ => 0.0,
        }
    }

    /// How long it is; nothing for a disc.
    pub fn length_mm(&self) -> Option<f32> {
        match self.outline {
            Outline::Rectangle([a, b, ..]) => Some(a.distance(b)),
            Outline::Tube(from, to, ..) => Some(from.distance(to)),
            Outline::Disc(..) => None,
        }
    }

    /// Its angular profile, where it has one.
    pub fn angular(&self) -> Option<Profile> {
        self.profile
    }

    /// Radiance in a direction away from it, for a light of radiance 1 along its normal.
    pub fn radiance(&self, away: Vec3) -> f32 {
        self.profile.map_or(1.0, |profile| profile.radiance(away))
    }

    /// Line `k` of `n + 1` evenly spread ones, as it stands for a receiver at `p`.
    pub fn line(&self, k: usize, n: usize, p: Vec3) -> Line {
        let s = k as f32 / n as f32;
        match self.outline {
            Outline::Rectangle([a, b, c, d]) => [a.lerp(b, s), d.lerp(c, s)],
            Outline::Disc(center, across, up) => {
                // Even in the angle: the area between two chords is then that of a trapezoid enlarged by `fill`.
                let phi = std::f32::consts::PI * (1.0 - s);
                let step = std::f32::consts::PI / n as f32;
                let fill = (step / step.sin()).sqrt();
                let (x, z) = (phi.cos() * fill, phi.sin() * fill);
                [center + across * x - up * z, center + across * x + up * z]
            }
            Outline::Tube(from, to, radius, bulge) => {
                let axis = (to - from).normalize_or(Vec3::X);
                let middle = from.lerp(to, 0.5);
                // The tangent planes through the receiver touch it here; nearer than the axis by r^2/d.
                let away = middle - p;
                let away = away - axis * away.dot(axis);
                let distance = away.length().max(radius * 1.001);
                let ahead = away / distance;
                let side = axis.cross(ahead);
                let sine = radius / distance;
                let half = radius * (1.0 - sine * sine).sqrt();
                let back = -ahead * (radius * sine);
                // The near side of its ends shows beyond them on the plane of the ribbon.
                let beyond = (distance - radius * sine) / (distance - radius * bulge.seen(sine)) - 1.0;
                let [from, to] = [from, to].map(|end| end + axis * ((end - p).dot(axis) * beyond));
                if axis.z.abs() < 0.7 {
                    let [a, b] = if side.z >= 0.0 { [from, to] } else { [to, from] };
                    let up = if side.z >= 0.0 { side } else { -side };
                    let at = a.lerp(b, s) + back;
                    [at - up * half, at + up * half]
                } else {
                    let [low, high] = if from.z < to.z { [from, to] } else { [to, from] };
                    let right = (high - low).normalize_or_zero().cross(ahead);
                    let shift = right * (half * (1.0 - 2.0 * s)) + back;
                    [low + shift, high + shift]
                }
            }
        }
    }

    /// The same for a receiver below a plate that it stands beyond: a tube is turned to where its light arrives from.
    pub fn line_beyond(&self, slab: &Slab, k: usize, n: usize, p: Vec3) -> Line {
        let [low, high] = self.line(k, n, p);
        if self.is_fixed() {
            return [low, high];
        }
        let middle = 0.5 * (low + high);
        self.line(k, n, middle - slab.in_air(p, middle))
    }

    /// Its lines as vectors from `p`, as they appear there.
    pub fn seen<const N: usize>(&self, p: Vec3, slab: Option<&Slab>) -> [Line; N] {
        if self.is_fixed() && slab.is_none() {
            return std::array::from_fn(|k| self.line(k, N - 1, p).map(|end| end - p));
        }
        let seen = |k: usize| {
            self.line(k / KEPT, (N - 1) / KEPT, p).map(|end| match slab {
                Some(slab) if slab.covers(p) && end.z >= slab.high => slab.towards(p, end),
                _ => end - p,
            })
        };
        if slab.is_none() {
            return with_means(seen);
        }
        // Where each costs a root to be found, a parabola through three of them gives the rest.
        let ends = [0, coarse(N), 2 * coarse(N)].map(seen);
        std::array::from_fn(|k| {
            let s = k as f32 / coarse(N) as f32;
            let weights = [0.5 * (s - 1.0) * (s - 2.0), s * (2.0 - s), 0.5 * s * (s - 1.0)];
            std::array::from_fn(|end| (0..3).map(|i| ends[i][end] * weights[i]).sum())
        })
    }
}

/// All lines from those that are worked out.
#[inline(always)]
pub fn with_means<const N: usize>(kept: impl Fn(usize) -> Line) -> [Line; N] {
    let mut lines = [[Vec3::ZERO; 2]; N];
    (0..N).step_by(KEPT).for_each(|k| lines[k] = kept(k));
    for k in (1..N).step_by(KEPT) {
        lines[k] = std::array::from_fn(|end| 0.5 * (lines[k - 1][end] + lines[k + 1][end]));
    }
    lines
}

/// Turns the corners so that the first edge is the lower of the two more level ones.
fn level(corners: [Vec3; 4]) -> [Vec3; 4] {
    let [a, b, c, d] = corners;
    let slope = |e: Vec3| e.z.abs() / e.length().max(1e-20);
    let [a, b, c, d] = if slope(b - a) <= slope(d - a) { [a, b, c, d] } else { [b, c, d, a] };
    if a.z + b.z <= c.z + d.z { [a, b, c, d] } else { [c, d, a, b] }
}
