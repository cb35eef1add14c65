//! Points of a face beside a sharp edge of the body, moved onto it.
//!
//! At such an edge a face bends within far less than the spacing of its lattice. Through points on either side of it a straight edge is
//! drawn with notches: which of them is under the body changes along it.

use crate::elastomer::{RimPoint, Surface};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// Halvings of the way between two points of a lattice, on which an edge is looked for.
const HALVINGS: u32 = 12;

/// Where an edge crosses the ways from a point to its neighbours along x and along y, the nearest of each.
type Crossings = [Option<DVec3>; 2];

/// What is nearer to a sharp edge that presses the face than its neighbours are, and where on the edge it belongs. `gap` is how far
/// below the body a place is, mm; nothing beside it.
pub fn rim(face: &Surface, contact: &[bool], gap: impl Fn(DVec3) -> Option<f64>) -> Vec<RimPoint> {
    let place = |k: usize| face.positions[k].as_dvec3();
    let mut crossings: BTreeMap<usize, (Crossings, bool)> = BTreeMap::new();
    for [k, n, axis] in sides(face) {
        let [under, beside] = match (contact[k], contact[n]) {
            (true, false) => [k, n],
            (false, true) => [n, k],
            _ => continue,
        };
        let Some((part, at)) = crossing(place(under), place(beside), &gap) else { continue };
        for (end, is_nearer) in [(under, part <= 0.5), (beside, part > 0.5)] {
            let (own, moves) = crossings.entry(end).or_default();
            *moves |= is_nearer;
            let far = |at: DVec3| at.distance_squared(place(end));
            if own[axis].is_none_or(|other| far(at) < far(other)) {
                own[axis] = Some(at);
            }
        }
    }
    let moved = crossings.into_iter().filter(|(_, (_, moves))| *moves);
    moved
        .filter_map(|(point, (own, _))| {
            let at = match own {
                [Some(a), Some(b)] => foot(place(point), a, b),
                [a, b] => a.or(b)?,
            };
            Some(RimPoint { point, at: at.as_vec3() })
        })
        .collect()
}

/// All pairs of neighbours on a lattice, and the axis along which they are.
fn sides(face: &Surface) -> impl Iterator<Item = [usize; 3]> {
    let (nx, n) = (face.nx, face.nx * face.ny);
    (0..n).flat_map(move |k| {
        let right = (k % nx + 1 < nx).then_some([k, k + 1, 0]);
        let down = (k + nx < n).then_some([k, k + nx, 1]);
        right.into_iter().chain(down)
    })
}

/// Where on the way from a touched point to one that is not the body ends, or steps up by more than they are apart; and after what
/// part of it. Nothing where the face has left a body with a round edge before.
fn crossing(under: DVec3, beside: DVec3, gap: impl Fn(DVec3) -> Option<f64>) -> Option<(f64, DVec3)> {
    let beyond = gap(beside).unwrap_or(f64::INFINITY);
    if beyond < under.truncate().distance(beside.truncate()) {
        return None;
    }
    let at = |part: f64| under.lerp(beside, part);
    let (mut inside, mut outside) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (inside + outside);
        match gap(at(middle)).is_some_and(|gap| gap < 0.5 * beyond) {
            true => inside = middle,
            false => outside = middle,
        }
    }
    // At a sharp edge what is drawn between the two stands in the body.
    let edge = at(inside);
    let gap_mm = gap(edge).filter(|gap| *gap <= 0.0)?;
    Some((inside, edge + DVec3::Z * gap_mm))
}

/// The place nearest to `p` on the line between two others, as it is seen along z.
fn foot(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let [way, off]: [DVec2; 2] = [b - a, p - a].map(DVec3::truncate);
    let length_squared = way.length_squared();
    if length_squared == 0.0 {
        return a;
    }
    a.lerp(b, (off.dot(way) / length_squared).clamp(0.0, 1.0))
}
