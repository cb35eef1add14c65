//! A slide, and how much it may pull.

use super::Walk;
use crate::elastomer::{ElastomerCapture, Error, Friction, PadShape};
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;

/// Waypoints of a slide are not further apart than this, mm, but there are no more than [`MOST_WAYPOINTS`].
const STRIDE_MM: f64 = 0.25;
const MOST_WAYPOINTS: f64 = 12.0;
/// Points from a body's axis to its furthest side at which it is looked whether there is any of it.
const POINTS_OUTWARDS: f64 = 60.0;

/// Slides, and hands over what was captured on the way.
pub(super) fn slide(
    walk: &mut Walk<'_>,
    way_mm: f64,
    direction_deg: f64,
) -> Result<Vec<ElastomerCapture>, Error> {
    let mut captures = Vec::new();
    let start = walk.pose;
    let energy = walk.last.as_ref().map_or(0.0, |c| c.stats.elastic_energy_n_mm);
    walk.work = [0.0; 2];
    let (sin, cos) = direction_deg.to_radians().sin_cos();
    let narrowest = narrowest_mm(walk.body.as_ref());
    let parts = (way_mm / STRIDE_MM).ceil().clamp(4.0, MOST_WAYPOINTS) as u32;
    for n in 1..=parts {
        let s = way_mm * f64::from(n) / f64::from(parts);
        let now = walk.go(Pose { x_mm: start.x_mm + s * cos, y_mm: start.y_mm + s * sin, ..start })?;
        let f = now.forces;
        captures.push(now.clone());
        let normal = f.normal_force_n.max(walk.least_force());
        let along = f.shear_force_n[0] * cos + f.shear_force_n[1] * sin;
        if walk.case.pad.shape != PadShape::Cuboid {
            // On a slope the normal pushes along the slide as well.
            continue;
        }
        walk.checks.hold("force along the slide", along / normal, 0.05);
        let shear = f.shear_force_n[0].hypot(f.shear_force_n[1]) / normal;
        match walk.case.settings.friction {
            Friction::Coefficient(0.0) => {
                walk.checks.hold("shear without friction", shear, 0.03 + walk.claim)
            }
            // Stretched material and, where they are shallow, slopes raise the force above mu N by less than half; steep
            // flanks plough.
            Friction::Coefficient(mu) if mu <= 0.5 && walk.case.depth_mm <= 0.2 * narrowest => {
                let ploughing = shear_of_ploughing(&now, mu, [cos, sin]) + 0.05;
                walk.checks.hold("shear against Coulomb", shear, ploughing.max(1.5 * mu + 0.05));
            }
            _ => {}
        }
    }
    walk.judge_work(energy);
    Ok(captures)
}

/// How wide a body is where it is narrow, seen along its axis: half of its lesser side, or twice its area over the length of its
/// outline where that is less. (The radius of a disc, the wall of a ring. Upright walls plough, which heights do not show: a sharp ring
/// whose wall is 0.8 mm wide, 0.25 mm deep with friction 0.5, is dragged with 0.92 of its normal force over cells of three sizes.)
fn narrowest_mm(body: &dyn Indenter) -> f64 {
    let half = body.half_extent_mm();
    let pitch = half[0].max(half[1]) / POINTS_OUTWARDS;
    let [nx, ny] = half.map(|half| (half / pitch).ceil() as i32 + 1);
    let under = |i: i32, j: i32| {
        usize::from(body.lower_surface(f64::from(i) * pitch, f64::from(j) * pitch).is_some())
    };
    let (mut points, mut sides) = (0, 0);
    for (i, j) in (-ny..=ny).flat_map(|j| (-nx..=nx).map(move |i| (i, j))) {
        points += under(i, j);
        sides += under(i, j).abs_diff(under(i + 1, j)) + under(i, j).abs_diff(under(i, j + 1));
    }
    // Steps along the rows and columns are longer than what they follow, by 4 / pi in the mean of all directions.
    let outline_mm = std::f64::consts::FRAC_PI_4 * sides as f64 * pitch;
    let across_mm = 2.0 * points as f64 * pitch * pitch / outline_mm.max(pitch);
    half[0].min(half[1]).min(across_mm)
}

/// Most that a slide may pull, over the normal force, were the same pressure on all that touches: friction along the face and the
/// push of what stands in front, where friction takes from the normal force; what stands behind pushes nothing forwards. (Of a
/// cone of half angle a that touches all around (1 / pi) cot a without friction.)
fn shear_of_ploughing(now: &ElastomerCapture, mu: f64, direction: [f64; 2]) -> f64 {
    let s = &now.surface;
    let at = |n: usize| s.positions[n].as_dvec3();
    let way = DVec3::new(direction[0], direction[1], 0.0);
    let [mut along, mut up, mut level] = [0.0f64; 3];
    for corner in (1..s.ny).flat_map(|j| (1..s.nx).map(move |i| j * s.nx + i)) {
        let [a, b, c, d] = [corner - s.nx - 1, corner - s.nx, corner - 1, corner];
        if ![a, b, c, d].iter().any(|&n| now.contact[n]) {
            continue;
        }
        let area = 0.5 * (at(d) - at(a)).cross(at(c) - at(b));
        let normal = area.normalize_or(DVec3::Z);
        let rubs = mu * area.length() * way.reject_from_normalized(normal).normalize_or_zero();
        along += rubs.dot(way) + (-area.dot(way)).max(0.0);
        up += area.z - rubs.z.max(0.0);
        level += area.z;
    }
    if level > 0.0 { along / up.max(0.5 * level) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::from_spec;
    use crate::indenter::spec::{Plan, Shape};
    use crate::trial::scene;

    #[test]
    fn a_disc_is_as_wide_as_its_radius_a_ring_as_its_wall_and_a_bar_as_half_of_it() {
        let narrowest =
            |shape| narrowest_mm(from_spec("body", &scene::spec(shape, 0.0), None).expect("a body").as_ref());
        let flat = |plan| narrowest(Shape::Flat { plan });
        for (found, is) in [
            (flat(Plan::Disc { diameter_mm: 6.0 }), 3.0),
            (flat(Plan::Ring { outer_diameter_mm: 7.0, inner_diameter_mm: 5.4 }), 0.8),
            (flat(Plan::Rectangle { x_mm: 1.0, y_mm: 8.0 }), 0.5),
            (narrowest(Shape::Dome { radius_mm: 4.0, diameter_mm: 8.0 }), 4.0),
        ] {
            assert!((found / is - 1.0).abs() < 0.04, "{found} mm instead of {is}");
        }
    }
}
