//! Parts of a body that points a given distance apart may pass between: blades, fins, the walls of tubes, pins.

use super::Indenter;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// What is at least so wide is met by a lattice of this spacing, mm.
pub const WIDE_MM: f64 = 0.1;

/// A body's underside this much above what else is near it hides it, mm: as much as the spacing's half diagonal, 45 degrees.
const NEAR_MM: f64 = 0.5 * WIDE_MM * std::f64::consts::SQRT_2;
/// A point this part of a distance above a flat underside is as far inside, if no wall is near.
const FAR_INSIDE: f64 = 0.999;
/// How far inside a wall a point is put, mm.
const INSIDE_MM: f64 = 1e-4;
/// Gap to what counts as being in the tube, mm: so much more than its radius that no step up is short.
const MET_MM: f64 = 1.2 * NEAR_MM;
/// What leans less, as the horizontal part of its normal, is no wall.
const LEVEL: f64 = 1e-3;
/// Steps to the nearest wall: one, where the distance is exact.
const MOST_HOPS: usize = 8;

/// Points of the undersides of a body's thin parts in its own frame, about one for each [`WIDE_MM`] along them.
pub fn parts(body: &dyn Indenter) -> Vec<DVec3> {
    let [hx, hy] = body.half_extent_mm();
    let cells = |half: f64| ((2.0 * half / WIDE_MM).ceil() as usize).max(1);
    let middle = |i: usize, half: f64| 2.0 * half * ((i as f64 + 0.5) / cells(half) as f64) - half;
    let row = |j: usize| -> Vec<DVec3> {
        let y = middle(j, hy);
        (0..cells(hx)).filter_map(|i| thin_near(body, DVec2::new(middle(i, hx), y))).collect()
    };
    (0..cells(hy)).into_par_iter().flat_map_iter(row).collect()
}

/// A point of something thin over `at`, or within [`MET_MM`] of it and lower than what is over it.
fn thin_near(body: &dyn Indenter, at: DVec2) -> Option<DVec3> {
    let own_mm = body.lower_surface(at.x, at.y);
    let thin_from = |from: DVec3| {
        let wall = wall_near(body, from)?;
        wall.is_thin(body).then_some(wall.inside)
    };
    // Up a tube of that radius until something is in it...
    let top_mm = own_mm.map_or(body.height_mm(), |own_mm| own_mm - NEAR_MM);
    let mut z_mm = 0.0;
    while z_mm <= top_mm {
        let gap_mm = body.distance(at.extend(z_mm));
        if gap_mm <= MET_MM {
            return thin_from(at.extend(z_mm));
        }
        z_mm += (gap_mm * gap_mm - NEAR_MM * NEAR_MM).sqrt();
    }
    // ...or what is over the point itself, where a wall is nearer than its underside.
    let above = at.extend(own_mm? + WIDE_MM);
    if body.distance(above) < -FAR_INSIDE * WIDE_MM { None } else { thin_from(above) }
}

/// A point just inside the body, and which way is out of it there.
struct Wall {
    inside: DVec3,
    outward: DVec2,
}

/// The nearest wall.
fn wall_near(body: &dyn Indenter, from: DVec3) -> Option<Wall> {
    let mut p = from;
    for _ in 0..MOST_HOPS {
        let (gap_mm, normal) = body.distance_and_normal(p);
        p -= normal * (gap_mm + INSIDE_MM);
        if let Some(underside_mm) = body.lower_surface(p.x, p.y) {
            let lean = normal.truncate().length();
            let outward = normal.truncate() / lean;
            return (lean > LEVEL).then_some(Wall { inside: p.with_z(underside_mm), outward });
        }
    }
    None
}

impl Wall {
    /// Whether one is beyond it at about the same height, as far inwards as what is wide goes.
    fn is_thin(&self, body: &dyn Indenter) -> bool {
        let beyond = self.inside.truncate() - self.outward * WIDE_MM;
        let underside_mm = body.lower_surface(beyond.x, beyond.y);
        underside_mm.is_none_or(|z_mm| z_mm > self.inside.z + WIDE_MM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};
    use std::sync::Arc;

    fn flat(plan: Plan) -> Arc<dyn Indenter> {
        body(Shape::Flat { plan })
    }

    fn body(shape: Shape) -> Arc<dyn Indenter> {
        let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
        from_spec("body", &spec, None).expect("a body")
    }

    #[test]
    fn thin_parts_are_found_all_along_whatever_their_width() {
        for width_mm in [0.01, 0.03, 0.08] {
            let blade = flat(Plan::Rectangle { x_mm: width_mm, y_mm: 8.0 });
            let ring = flat(Plan::Ring { outer_diameter_mm: 6.0, inner_diameter_mm: 6.0 - 2.0 * width_mm });
            let ridges = flat(Plan::Stripes { count: 4, width_mm, length_mm: 6.0, pitch_mm: 1.7 });
            for (name, body, length_mm) in
                [("blade", blade, 8.0), ("ring", ring, 18.8), ("ridges", ridges, 24.0)]
            {
                let found = parts(body.as_ref());
                let under = found.iter().filter(|p| body.lower_surface(p.x, p.y).is_some()).count();
                assert_eq!(under, found.len(), "{name}");
                let enough = 0.9 * length_mm / WIDE_MM;
                assert!(found.len() as f64 >= enough, "{name} {width_mm}: {} of {enough}", found.len());
            }
            let pin = parts(flat(Plan::Disc { diameter_mm: width_mm }).as_ref());
            assert!(!pin.is_empty() && pin.iter().all(|p| p.truncate().length() < width_mm), "{pin:?}");
        }
    }

    #[test]
    fn what_is_wide_has_none() {
        let wide = [
            flat(Plan::Rectangle { x_mm: 0.2, y_mm: 10.0 }),
            flat(Plan::Disc { diameter_mm: 6.0 }),
            flat(Plan::Regular { corners: 6, across_corners_mm: 6.0 }),
            body(Shape::Dome { radius_mm: 4.0, diameter_mm: 8.0 }),
            body(Shape::Cone { tip_diameter_mm: 0.5, half_angle_deg: 45.0 }),
        ];
        for body in wide {
            assert_eq!(parts(body.as_ref()), [], "{body:?}");
        }
    }
}
