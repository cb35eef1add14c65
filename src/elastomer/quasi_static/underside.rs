//! What of a body touches first: how much, how wide, and whether it has edges. It goes by the body and the pad, not by the cells.

use crate::indenter::Indenter;
use std::f64::consts::PI;

/// Height above the tip up to which a body is looked at, over the thickness, of a thick pad over that of a usual one: half as deep as
/// presses go.
const TOUCHED: f64 = 0.125;
/// The usual thickness, mm.
pub const USUAL_THICKNESS_MM: f64 = 4.0;
/// Distance of the points where a body is looked at, over that thickness; wide bodies are looked at in no more than so many points from
/// the middle to either side.
const PITCH: f64 = 0.05;
/// See [`PITCH`].
const MOST_POINTS: f64 = 100.0;
/// An edge is where the slope of the underside changes by this much from one point to the next, or the body ends. (Of a kink that lies
/// between points each of them sees a part: where the slope changes by twice as much, one always sees enough.)
const EDGE_SLOPE: f64 = 0.35;
/// Height above the tip up to which its width counts, mm.
const WIDTH_UP_TO_MM: f64 = 0.5;
/// Distance of the points between which a width is measured, mm.
const WIDTH_PITCH_MM: f64 = 0.125;

/// The underside of a body, as high up as it touches when it is pressed in by an eighth of the pad.
#[derive(Debug)]
pub struct Underside {
    /// How much of it there is, seen along z, mm^2.
    touched_mm2: f64,
    /// Whether it bends sharply or ends.
    pub has_edges: bool,
}

impl Underside {
    /// Of a body, as far from its axis as the pad's corners are from one another.
    pub fn of(body: &dyn Indenter, [x_mm, y_mm, thickness_mm]: [f64; 3]) -> Self {
        let half = body.half_extent_mm().map(|half| half.min(x_mm.hypot(y_mm)));
        let thickness_mm = thickness_mm.min(USUAL_THICKNESS_MM);
        let pitch = (PITCH * thickness_mm).max(half[0].max(half[1]) / MOST_POINTS);
        let [nx, ny] = half.map(|half| (half / pitch).ceil() as i32 + 1);
        let height = |i: i32, j: i32| body.lower_surface(f64::from(i) * pitch, f64::from(j) * pitch);
        let row = |j: i32| (-nx..=nx).map(move |i| height(i, j).unwrap_or(f64::INFINITY)).collect::<Vec<_>>();
        let touched = |z: f64| z <= TOUCHED * thickness_mm;
        let bends = |a: f64, b: f64, c: f64| (a - 2.0 * b + c) / pitch > EDGE_SLOPE;
        let [mut before, mut here] = [row(-ny - 1), row(-ny)];
        let (mut points, mut has_edges) = (0, false);
        for j in -ny..=ny {
            let after = row(j + 1);
            for (i, z) in here.iter().enumerate().filter(|(_, z)| touched(**z)) {
                points += 1;
                let beside = |i: Option<usize>| i.and_then(|i| here.get(i)).copied().unwrap_or(f64::INFINITY);
                has_edges |= bends(beside(i.checked_sub(1)), *z, beside(Some(i + 1)));
                has_edges |= bends(before[i], *z, after[i]);
            }
            (before, here) = (here, after);
        }
        Self { touched_mm2: f64::from(points) * pitch * pitch, has_edges }
    }

    /// The radius of a circle as large, mm.
    pub fn radius_mm(&self) -> f64 {
        (self.touched_mm2 / PI).sqrt()
    }
}

/// How wide the widest part of a body's underside is that a pad of `size` mm can touch, mm: of a ridge its width, not its length. At
/// least `enough` is as good as any, and is taken where none of the points looked at finds an underside.
pub fn tip_width_mm(body: &dyn Indenter, size: [f64; 3], enough: f64) -> f64 {
    let half = body.half_extent_mm();
    let [nx, ny] = [0, 1].map(|a| (half[a].min(size[a] / 2.0) / WIDTH_PITCH_MM).ceil() as i32);
    let points = (-ny..=ny).flat_map(|j| (-nx..=nx).map(move |i| (i, j)));
    let underside = points.clone().map(|(i, j)| {
        let height = body.lower_surface(f64::from(i) * WIDTH_PITCH_MM, f64::from(j) * WIDTH_PITCH_MM);
        height.is_some_and(|z| z <= WIDTH_UP_TO_MM)
    });
    let underside: Vec<bool> = underside.collect();
    let touches = |i: i32, j: i32| {
        i.abs() <= nx && j.abs() <= ny && underside[((j + ny) * (2 * nx + 1) + i + nx) as usize]
    };
    let longest = (enough / WIDTH_PITCH_MM).ceil() as i32;
    // From a point both ways along a row, a column or a diagonal, as long as it touches.
    let width = |i: i32, j: i32, [u, v]: [i32; 2]| {
        let run =
            |sign: i32| (1..longest).take_while(|k| touches(i + sign * k * u, j + sign * k * v)).count();
        (run(1) + run(-1) + 1) as f64 * WIDTH_PITCH_MM * f64::from(u * u + v * v).sqrt()
    };
    let mut widest = 0.0f64;
    for (i, j) in points.filter(|&(i, j)| touches(i, j)) {
        let narrowest = |least: f64, way| if least <= widest { least } else { least.min(width(i, j, way)) };
        widest = widest.max([[1, 0], [0, 1], [1, 1], [1, -1]].into_iter().fold(enough, narrowest));
        if widest >= enough {
            break;
        }
    }
    if widest > 0.0 { widest } else { enough }
}
