//! How far into the pad an indenter goes in one increment with friction. What it touches on the way stays where it touches, so the
//! longer the increment, the less is known of where that is.
//!
//! The pad knows no length but its thickness, so they are parts of it, and of how wide the body is; they go by the body alone, not by the
//! cells. Found by experiment: bodies that stick to a pad of 4 mm, pressed 1 mm in increments of 0.5 to 0.05 mm (the lab book has the
//! table). In increments as long as these normal forces are within 0.6 % of the shortest's, under a small cone within 1 %.

use super::resolution::LONGEST_INCREMENT_MM;
use super::underside::{USUAL_THICKNESS_MM, Underside};
use crate::indenter::Indenter;

/// Under a body that is round, and not wide; over the thickness.
const LONGEST: f64 = 0.125;
/// Under one that has edges, or is wide: what is squeezed out under it does not move in proportion to the way. In
/// twice as long ones a slab presses 1.5 %, a cap of radius 20 mm 1.1 to 1.6 % too little.
const SHORT: f64 = 0.0625;
/// A body is wide whose area touched is that of a circle with this radius over the thickness.
const WIDE: f64 = 0.8;
/// In shorter ones than this over the thickness, or this, mm, nothing presses but what is [`SMALL`].
const SHORTEST: f64 = 0.025;
/// See [`SHORTEST`].
const SHORTEST_MM: f64 = 0.1;
/// Over half of the body's narrower side. In longer ones a small sphere that is pressed again and again creeps. With edges also over the
/// radius of a circle with the area touched: cones 1 mm across at the tip press 1 to 2 % too little in increments twice as long.
const OVER_RADIUS: f64 = 0.125;
/// A body with edges is small whose area touched is that of a circle with less than this radius over the thickness. Its increments are
/// shorter by as much as it is smaller: over cells that resolve it a cone 1 mm across at the tip presses up to 1.1 % softer in increments
/// of 0.08 and 0.1 mm than in those of 0.025 mm, 0.3 % in those of 0.063 mm.
const SMALL: f64 = 0.225;
/// What is smaller than this is a pin, which no cells resolve.
const PIN: f64 = 0.125;

/// The longest increment under a body of this underside on a pad of this thickness, mm.
pub fn longest_mm(body: &dyn Indenter, underside: &Underside, thickness_mm: f64) -> f64 {
    let radius_mm = underside.radius_mm();
    let [hx, hy] = body.half_extent_mm();
    let of_pad = if underside.has_edges || radius_mm > WIDE * thickness_mm { SHORT } else { LONGEST };
    let narrowest = if underside.has_edges { radius_mm.min(hx).min(hy) } else { hx.min(hy) };
    let longest = (of_pad * thickness_mm).min(LONGEST_INCREMENT_MM);
    let shortest = (SHORTEST * thickness_mm).min(SHORTEST_MM);
    let usual = (OVER_RADIUS * narrowest).max(shortest).min(longest);
    let smallness = radius_mm / (SMALL * thickness_mm.min(USUAL_THICKNESS_MM));
    if underside.has_edges && (PIN / SMALL..1.0).contains(&smallness) {
        return usual.min((OVER_RADIUS * radius_mm * smallness).max(shortest / 2.0));
    }
    usual
}

/// Without friction: over half of a body's narrower side, where it has edges. In a longer one what is under its tip is pushed out by its
/// sides: a cone 1 mm across at the tip, 0.91 mm deep in two increments, pierces the face, which lies around its tip over cells of 0.25 mm
/// and finer, too, and takes a fifth less force.
const FREE_OVER_RADIUS: f64 = 0.5;

/// The longest increment under a body of this underside without friction, mm.
pub fn longest_free_mm(body: &dyn Indenter, underside: &Underside) -> f64 {
    let [hx, hy] = body.half_extent_mm();
    match underside.has_edges {
        true => (FREE_OVER_RADIUS * underside.radius_mm().min(hx).min(hy))
            .clamp(SHORTEST_MM, LONGEST_INCREMENT_MM),
        false => LONGEST_INCREMENT_MM,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};

    const PAD: [f64; 3] = [20.0, 20.0, 4.0];

    fn increment_mm(shape: Shape, size: [f64; 3]) -> f64 {
        let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.3, height_mm: 8.0, shape };
        let body = from_spec("body", &spec, None).expect("a body");
        longest_mm(body.as_ref(), &Underside::of(body.as_ref(), size), size[2])
    }

    fn dome(radius_mm: f64, diameter_mm: f64) -> Shape {
        Shape::Dome { radius_mm, diameter_mm }
    }

    fn cone(tip_diameter_mm: f64, half_angle_deg: f64) -> Shape {
        Shape::Cone { tip_diameter_mm, half_angle_deg }
    }

    fn flat(x_mm: f64, y_mm: f64) -> Shape {
        Shape::Flat { plan: Plan::Rectangle { x_mm, y_mm } }
    }

    #[test]
    fn increments_are_short_for_what_has_edges_or_is_wide_and_shorter_for_what_is_small() {
        for (shape, range) in [
            (dome(4.0, 8.0), 0.5..=0.5),
            (dome(2.0, 4.0), 0.25..=0.25),
            (dome(12.0, 16.0), 0.25..=0.25),
            (dome(20.0, 16.0), 0.25..=0.25),
            (flat(16.0, 16.0), 0.25..=0.25),
            (flat(40.0, 40.0), 0.25..=0.25),
            (flat(5.0, 7.0), 0.25..=0.25),
            (flat(2.0, 16.0), 0.125..=0.125),
            (flat(0.7, 16.0), 0.1..=0.1),
            (cone(0.2, 19.29), 0.1..=0.1),
            (cone(1.0, 10.0), 0.05..=0.055),
            (cone(1.0, 19.29), 0.06..=0.07),
            (cone(1.0, 30.0), 0.075..=0.085),
            (cone(1.0, 40.0), 0.1..=0.12),
            (cone(1.1, 40.0), 0.1..=0.12),
            (cone(1.0, 45.0), 0.11..=0.13),
            (cone(2.0, 19.29), 0.13..=0.16),
            (cone(4.0, 19.29), 0.25..=0.25),
        ] {
            let increment_mm = increment_mm(shape.clone(), PAD);
            let close = range.start() - 1e-9..=range.end() + 1e-9;
            assert!(close.contains(&increment_mm), "{increment_mm} mm instead of {range:?} for {shape:?}");
        }
    }

    #[test]
    fn a_thick_pad_has_the_increments_that_the_body_allows() {
        let thick = [40.0, 40.0, 20.0];
        assert_eq!(increment_mm(dome(4.0, 8.0), thick), 0.5);
        assert!((0.1..=0.125).contains(&increment_mm(dome(1.0, 2.0), thick)));
        assert!(increment_mm(cone(1.0, 19.29), thick) < 0.11);
    }

    #[test]
    fn half_the_pad_and_half_the_body_is_half_the_increment() {
        let half = PAD.map(|length| length / 2.0);
        for [body, small] in [
            [dome(4.0, 8.0), dome(2.0, 4.0)],
            [dome(10.0, 14.0), dome(5.0, 7.0)],
            [dome(20.0, 16.0), dome(10.0, 8.0)],
            [flat(40.0, 40.0), flat(20.0, 20.0)],
        ] {
            assert!((increment_mm(small, half) - increment_mm(body, PAD) / 2.0).abs() < 1e-9);
        }
    }
}
