//! Solids made by sweeping plane regions: upright (along z), along y, and revolved about z.
//!
//! Every swept solid is kept as its *core*, the solid eroded by the edge round, and grown again by
//! that round when it is asked for a distance. So faces stay in place, every convex edge is rounded
//! by the same radius, and the distance outside stays exact: it is the core's minus the round.
//! Unions are exact outside, intersections inside; elsewhere both are bounds, and exact near the
//! surface as long as the parts are further apart than the distances asked for.

use super::outline::Outline;
use glam::{DVec2, DVec3};

/// A rigid solid, mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// A plan region in (x, y), from height `z0` to `z1`.
    Upright {
        /// The plan, eroded by `round`.
        core: Outline,
        /// Lower face.
        z0: f64,
        /// Upper face.
        z1: f64,
        /// Edge round.
        round: f64,
    },
    /// A section in (x, z), for |y| up to `half_length`.
    Along {
        /// The section, eroded by `round`.
        core: Outline,
        /// Half the length.
        half_length: f64,
        /// Edge round.
        round: f64,
    },
    /// A section in (distance from the axis, z), turned about the z axis.
    Revolved {
        /// The right half of the section, eroded by `round`.
        core: Outline,
        /// Edge round.
        round: f64,
    },
    /// Another solid moved sideways.
    Shifted {
        /// By how much.
        by: DVec2,
        /// Which.
        solid: Box<Solid>,
    },
    /// Everything that is in any part.
    Union(Vec<Solid>),
    /// Everything that is in all parts.
    Intersection(Vec<Solid>),
}

impl Solid {
    /// Signed distance and its unit gradient at `p`.
    pub fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        match self {
            Solid::Upright { core, z0, z1, round } => {
                let (d, g) = core.distance(DVec2::new(p.x, p.y));
                let (w, up) = slab(p.z, z0 + round, z1 - round);
                let (d, n) = both(d, g.extend(0.0), w, DVec3::Z * up);
                (d - round, n)
            }
            Solid::Along { core, half_length, round } => {
                let (d, g) = core.distance(DVec2::new(p.x, p.z));
                let (w, out) = slab(p.y, round - half_length, half_length - round);
                let (d, n) = both(d, DVec3::new(g.x, 0.0, g.y), w, DVec3::Y * out);
                (d - round, n)
            }
            Solid::Revolved { core, round } => {
                let rho = p.x.hypot(p.y);
                let (d, g) = core.distance(DVec2::new(rho, p.z));
                let radial = if rho > 0.0 { DVec2::new(p.x, p.y) / rho } else { DVec2::X };
                (d - round, (radial * g.x).extend(g.y))
            }
            Solid::Shifted { by, solid } => solid.distance_and_normal(p - by.extend(0.0)),
            Solid::Union(parts) => nearest(parts, p, |d, best| d < best),
            Solid::Intersection(parts) => nearest(parts, p, |d, best| d > best),
        }
    }

    /// Height of the lower surface at (x, y); `None` beside the solid.
    pub fn lower_surface(&self, at: DVec2) -> Option<f64> {
        match self {
            Solid::Upright { core, z0, round, .. } => {
                let beside = core.distance(at).0.max(0.0);
                (beside <= *round).then(|| z0 + round - (round * round - beside * beside).sqrt())
            }
            Solid::Along { core, half_length, round } => {
                let beside = (at.y.abs() - (half_length - round)).max(0.0);
                let reach = (round * round - beside * beside).max(0.0).sqrt();
                (beside <= *round).then(|| core.lowest_at(at.x, reach)).flatten()
            }
            Solid::Revolved { core, round } => core.lowest_at(at.length(), *round),
            Solid::Shifted { by, solid } => solid.lower_surface(at - *by),
            Solid::Union(parts) => parts.iter().filter_map(|s| s.lower_surface(at)).reduce(f64::min),
            Solid::Intersection(parts) => {
                let heights: Option<Vec<f64>> = parts.iter().map(|s| s.lower_surface(at)).collect();
                heights?.into_iter().reduce(f64::max)
            }
        }
    }

    /// Half extents in x and y about the origin.
    pub fn half_extent(&self) -> DVec2 {
        let outline_reach = |core: &Outline| {
            let (low, high) = core.bounds();
            (low.abs()).max(high.abs())
        };
        match self {
            Solid::Upright { core, round, .. } => outline_reach(core) + *round,
            Solid::Along { core, half_length, round } => {
                DVec2::new(outline_reach(core).x + round, *half_length)
            }
            Solid::Revolved { core, round } => DVec2::splat(outline_reach(core).x + round),
            Solid::Shifted { by, solid } => solid.half_extent() + by.abs(),
            Solid::Union(parts) => parts.iter().map(Self::half_extent).fold(DVec2::ZERO, DVec2::max),
            Solid::Intersection(parts) => {
                parts.iter().map(Self::half_extent).fold(DVec2::INFINITY, DVec2::min)
            }
        }
    }
}

/// Signed distance to low <= z <= high, and the sign of its gradient.
fn slab(z: f64, low: f64, high: f64) -> (f64, f64) {
    if low - z > z - high { (low - z, -1.0) } else { (z - high, 1.0) }
}

/// Signed distance of the product of two regions that live in perpendicular directions.
fn both(d: f64, dn: DVec3, w: f64, wn: DVec3) -> (f64, DVec3) {
    if d > 0.0 && w > 0.0 {
        let length = d.hypot(w);
        (length, (dn * d + wn * w) / length)
    } else if d > w {
        (d, dn)
    } else {
        (w, wn)
    }
}

fn nearest(parts: &[Solid], p: DVec3, better: impl Fn(f64, f64) -> bool) -> (f64, DVec3) {
    parts
        .iter()
        .map(|s| s.distance_and_normal(p))
        .reduce(|best, next| if better(next.0, best.0) { next } else { best })
        .expect("a compound solid has parts")
}
