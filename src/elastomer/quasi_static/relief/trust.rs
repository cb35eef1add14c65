//! How deep a press may be for the force of a face in relief to be that of the pad.

use super::super::underside::Underside;

/// Down to the first part of a length the force is that of the relief, from the second on that of the splines, where the body has edges:
/// points in relief move along z, and along steep flanks a face does not. Found by experiment, against finite elements: a cylinder of 6 mm
/// with its edge rounded by 0.3 mm, without friction, presses 0.0 to 0.2 % too little in relief 0.5 mm deep in a pad of 4 mm and 1.4 to 1.8 % too hard 1 mm
/// deep, whatever the cells; by splines over cells of 0.42 mm 0.7 % too hard at both depths, of 0.25 mm -0.2 %. Nearer the face splines take
/// finer cells: a line 0.25 mm deep presses 3.5 % too hard over those of 0.42 mm.
const DOWN_TO: [f64; 2] = [0.125, 0.25];
/// That length is the pad's thickness, but no more than so many radii of a circle with the area touched. Found by experiment: a cone 1 mm across at its
/// tip presses 1.2 to 1.7 % too hard in relief 0.5 and 1 mm deep, 0 to 0.9 % by splines.
const OVER_RADIUS: f64 = 1.5;

/// From which depth to which, mm, the force of a face in relief comes to say nothing of that of the pad.
pub fn force_fades_mm(underside: &Underside, thickness_mm: f64) -> [f64; 2] {
    if !underside.has_edges {
        return [f64::INFINITY; 2];
    }
    DOWN_TO.map(|part| part * thickness_mm.min(OVER_RADIUS * underside.radius_mm()))
}

/// How much is left at a depth, from 1 to 0, of what fades from one depth to another.
pub fn left_at(depth_mm: f64, [from_mm, to_mm]: [f64; 2]) -> f64 {
    if depth_mm <= from_mm { 1.0 } else { ((to_mm - depth_mm) / (to_mm - from_mm)).max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fades_is_whole_before_and_nothing_after() {
        assert_eq!([0.1, 0.5, 0.75, 1.0, 2.0].map(|at| left_at(at, [0.5, 1.0])), [1.0, 1.0, 0.5, 0.0, 0.0]);
        assert_eq!(left_at(1e3, [f64::INFINITY; 2]), 1.0);
    }
}
