//! A slide, and how much it may pull.

use super::Walk;
use crate::elastomer::{ElastomerCapture, Error, Friction, PadShape};
use crate::pose::Pose;
use glam::DVec3;

/// Waypoints of a slide are not further apart than this, mm, but there are no more than [`MOST_WAYPOINTS`].
const STRIDE_MM: f64 = 0.25;
const MOST_WAYPOINTS: f64 = 12.0;

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
    let [hx, hy] = walk.body.half_extent_mm();
    let narrowest = hx.min(hy);
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
