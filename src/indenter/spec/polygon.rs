//! Whether corners in order go once around a face: no side crosses, touches or lies on another, and there is something between
//! them to press with.

use crate::problem::Problems;
use glam::DVec2;

/// Corners and sides nearer than this are one, mm.
const APART_MM: f64 = 1e-6;

/// Least mean width (twice the area over the outline's length), mm: that of the smallest rectangle, 0.01 mm square.
const LEAST_WIDTH_MM: f64 = 0.005;

/// Reports what keeps corners from being the outline of a face.
pub(super) fn check(p: &mut Problems, corners: &[[f64; 2]]) {
    let n = corners.len();
    if n < 3 {
        p.push("corners_mm", format!("{n} corners"), "at least 3 corners", "add corners");
        return;
    }
    if corners.iter().flatten().any(|v| !v.is_finite() || v.abs() > 50.0) {
        p.push("corners_mm", "a coordinate", "-50 to 50 mm", "choose coordinates from -50 to 50 mm");
        return;
    }
    let outline = Corners(corners);
    let doubles = (0..n).filter(|i| outline.at(*i).distance(outline.at(i + 1)) < APART_MM);
    let doubles: Vec<usize> = doubles.collect();
    if !doubles.is_empty() {
        for i in doubles {
            let key = format!("corners_mm.[{i}]");
            p.push(&key, format!("{:?}", corners[i]), "distinct corners", "remove it");
        }
        return;
    }
    // Neighbours that fold back first: what else touches there follows from it.
    let neighbours = (1..n).map(|j| (j - 1, j)).chain([(0, n - 1)]);
    let others = (0..n).flat_map(|i| (i + 2..n).map(move |j| (i, j))).filter(|pair| *pair != (0, n - 1));
    let mut meetings = neighbours.chain(others).filter_map(|(i, j)| outline.meeting(i, j));
    if let Some(first) = meetings.next() {
        let others = match meetings.count() {
            0 => String::new(),
            1 => " (and 1 more pair of sides)".to_owned(),
            count => format!(" (and {count} more pairs of sides)"),
        };
        p.push(
            "corners_mm",
            first + &others,
            "a simple polygon: its sides share nothing but the corner between them",
            "put the corners in order around the outline, each once, and leave out those that it runs back to",
        );
        return;
    }
    let (area, least) = (outline.area(), LEAST_WIDTH_MM * outline.length() / 2.0);
    if area < least {
        p.push(
            "corners_mm",
            format!("{n} corners with {area:.6} mm2 between them, from {} on", outline.told(0)),
            format!("at least {least:.6} mm2 for an outline that is {:.3} mm long", outline.length()),
            "move the corners apart, so that a face is between them",
        );
    }
}

/// Corners in order; the first follows the last.
struct Corners<'a>(&'a [[f64; 2]]);

impl Corners<'_> {
    fn at(&self, i: usize) -> DVec2 {
        self.0[i % self.0.len()].into()
    }

    /// A corner's number and place.
    fn told(&self, i: usize) -> String {
        format!("corner {} at {}", i % self.0.len(), self.at(i))
    }

    /// How sides `i` and `j` (after it) meet where they must not.
    fn meeting(&self, i: usize, j: usize) -> Option<String> {
        let closes = i == 0 && j + 1 == self.0.len();
        if j == i + 1 || closes {
            let k = if j == i + 1 { j } else { 0 };
            let (before, after) = (k + self.0.len() - 1, k + 1);
            let [from, corner, to] = [before, k, after].map(|i| self.at(i));
            let folds = distance(from, [corner, to]) < APART_MM || distance(to, [corner, from]) < APART_MM;
            return folds.then(|| {
                let [from, corner, to] = [before, k, after].map(|i| self.told(i));
                format!("the sides from {from} and to {to} lie on each other at {corner}")
            });
        }
        let (a, b) = ([self.at(i), self.at(i + 1)], [self.at(j), self.at(j + 1)]);
        let is_beside =
            |a: [DVec2; 2], b: [DVec2; 2]| (a[0].max(a[1]) + APART_MM).cmplt(b[0].min(b[1])).any();
        if is_beside(a, b) || is_beside(b, a) {
            return None;
        }
        let touch = || {
            let ends = [distance(a[0], b), distance(a[1], b), distance(b[0], a), distance(b[1], a)];
            ends.into_iter().any(|d| d < APART_MM)
        };
        let how = match cross(a, b) {
            true => "cross",
            false if touch() => "touch",
            false => return None,
        };
        let [a0, a1, b0, b1] = [i, i + 1, j, j + 1].map(|i| self.told(i));
        Some(format!("the sides from {a0} to {a1} and from {b0} to {b1} {how}"))
    }

    /// mm2.
    fn area(&self) -> f64 {
        let first = self.at(0);
        let twice = |i: usize| (self.at(i) - first).perp_dot(self.at(i + 1) - first);
        (0..self.0.len()).map(twice).sum::<f64>().abs() / 2.0
    }

    /// All sides together, mm.
    fn length(&self) -> f64 {
        (0..self.0.len()).map(|i| self.at(i).distance(self.at(i + 1))).sum()
    }
}

/// Distance of a point from a side.
fn distance(p: DVec2, [a, b]: [DVec2; 2]) -> f64 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a.lerp(b, along))
}

/// Whether two line segments share a point in their interiors.
fn cross([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::Problem;

    fn found(corners: &[[f64; 2]]) -> Vec<Problem> {
        let mut problems = Problems::new();
        check(&mut problems, corners);
        problems.into_vec()
    }

    fn refused(corners: &[[f64; 2]]) -> String {
        match &found(corners)[..] {
            [problem] => format!("{}: {}", problem.key, problem.value),
            other => panic!("{corners:?}: {other:?}"),
        }
    }

    #[test]
    fn outlines_that_meet_themselves_are_refused_with_the_corners() {
        let line = refused(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]);
        assert!(line.contains("lie on each other at corner 2 at [2, 0] (and 1 more pair"), "{line}");
        // There and back: as a spike on a square, and as a corner that comes again.
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let spike = refused(&[square[0], square[1], [4.0, 0.0], square[1], square[2], square[3]]);
        assert!(
            spike.contains("from corner 1 at [2, 0] and to corner 3 at [2, 0] lie on each other"),
            "{spike}"
        );
        let back = refused(&[[2.0, 0.0], [2.0, 2.0], [2.0, 0.0]]);
        assert!(back.starts_with("corners_mm[2]: [2.0, 0.0]"), "{back}");

        let bow = refused(&[square[0], square[2], square[1], square[3]]);
        assert!(
            bow.contains("from corner 0 at [0, 0] to corner 1 at [2, 2]") && bow.ends_with("cross"),
            "{bow}"
        );
        // A corner on a side, a corner at another, a side on a side.
        let on = refused(&[square[0], square[1], square[2], [1.0, 0.0], square[3]]);
        assert!(on.contains("touch") && on.contains("corner 3 at [1, 0]"), "{on}");
        let at = refused(&[[0.0, 0.0], [2.0, -1.0], [2.0, 1.0], [0.0, 0.0], [-2.0, 1.0], [-2.0, -1.0]]);
        assert!(at.contains("touch"), "{at}");
        let slit = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0]];
        let slit = refused(&[&slit[..], &[[2.0, 2.0], [2.0, 3.0], [0.0, 3.0]]].concat());
        assert!(slit.contains("touch") || slit.contains("lie on each other"), "{slit}");
    }

    #[test]
    fn a_sliver_is_no_face() {
        let sliver = |height: f64| [[0.0, 0.0], [10.0, 0.0], [5.0, height]];
        assert!(refused(&sliver(1e-4)).contains("3 corners with 0.000500 mm2 between them"));
        assert_eq!(found(&sliver(0.011)), []);
        assert!(refused(&[[0.0, 0.0], [0.004, 0.0], [0.004, 0.004], [0.0, 0.004]]).contains("0.000016 mm2"));
        assert_eq!(found(&[[0.0, 0.0], [0.011, 0.0], [0.011, 0.011], [0.0, 0.011]]), []);
    }

    #[test]
    fn outlines_of_faces_pass_either_way_around() {
        let turned = |n: u32, radius: &dyn Fn(u32) -> f64| -> Vec<[f64; 2]> {
            let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
            (0..n).map(|i| (DVec2::from_angle(angle(i)) * radius(i)).to_array()).collect()
        };
        let mut faces = vec![
            vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
            // A corner within a straight side.
            vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]],
            // An L, and a comb with a gap of 1 um.
            vec![[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]],
            vec![
                [0.0, 0.0],
                [4.0, 0.0],
                [4.0, 3.0],
                [2.001, 3.0],
                [2.001, 1.0],
                [2.0, 1.0],
                [2.0, 3.0],
                [0.0, 3.0],
            ],
            // A star, a fine star with sharp points, a circle.
            turned(10, &|i| if i % 2 == 0 { 4.0 } else { 1.5 }),
            turned(120, &|i| if i % 2 == 0 { 4.0 } else { 0.5 }),
            turned(720, &|_| 3.0),
        ];
        faces.extend(faces.clone().into_iter().map(|face| face.into_iter().rev().collect()));
        for face in faces {
            assert_eq!(found(&face), [], "{face:?}");
        }
    }
}
