//! What an accuracy takes: cell sizes and stopping.

use super::grid::Grid;
use crate::indenter::Indenter;

/// Residual, and penetration relative to depth, of levels that only guess.
pub const GUESS_RESIDUAL: f64 = 1e-2;
/// Cells of the face that an answer may cost: 96 along each side, of 0.21 mm on a pad of 20 mm.
const MOST_CELLS: usize = 96 * 96;
/// Longest way of the indenter in one increment with friction, mm; over its radius, though not below the shortest; and
/// under a body with edges: anchors follow the path. Found by experiment: in increments as long as that, presses are
/// within 0.5 % of the force of eight (in one stride of 1 mm they lose 1 to 8 %), and a small sphere that is pressed
/// again and again in longer ones creeps.
pub const LONGEST_INCREMENT_MM: f64 = 0.5;
/// See [`LONGEST_INCREMENT_MM`].
const INCREMENT_OVER_RADIUS: f64 = 0.125;
/// See [`LONGEST_INCREMENT_MM`].
const SHORTEST_MM: f64 = 0.1;
/// See [`LONGEST_INCREMENT_MM`].
const EDGED_INCREMENT_MM: f64 = 0.34;
/// The same under a body that spreads: what is squeezed out under it does not move in proportion to the way, and sticks where it
/// touches. Found by experiment: a cap of radius 20 mm that sticks to a pad of 4 mm presses 1.6 % too little 1 mm deep in increments of
/// 0.5 mm, in these 0.1 %.
const SPREADING_INCREMENT_MM: f64 = 0.25;
/// A body spreads whose underside is wider, half a millimetre above the tip, than just above it by this part of a circle with the pad's
/// thickness for radius.
const SPREADS: f64 = 0.5;
/// Just above the tip, mm.
const AT_TIP_MM: f64 = 0.05;
/// A body with edges and no more of its underside within half a millimetre of the tip takes the shortest increments, mm^2. Found by
/// experiment: a cone, 1 mm across, that sticks presses 2.4 % too little 1 mm deep in increments of 0.34 mm, in these 0.1 % too much.
const SMALL_MM2: f64 = 3.0;
/// An edge is where the slope of the underside changes by this much across a cell.
const EDGE_SLOPE: f64 = 0.7;
/// Height above the tip up to which edges and area count, mm: as deep as most presses go.
const TOUCHED_UP_TO_MM: f64 = 0.5;
/// At least so many cells go across what touches. Found by experiment: one cell across a needle 0.8 mm deep stated 15 %, and its
/// force was 33 % off.
const CELLS_OF_TIP: f64 = 1.5;
/// They need not be narrower than this for it, mm: finer ones are taken where an answer states too much.
const NARROWEST_FOR_TIP_MM: f64 = 0.5;
/// Power of the cell size with which the stated error falls (found by experiment: flat bodies with rounded edges).
const ORDER: f64 = 1.5;
/// Cells over the finer ones of one step, at most: what states far too much mostly states far less as soon as the relief tells (the
/// first 0.1 mm of a sphere of radius 4 over cells of 0.63 mm: 8 %, over those of 0.42 mm 0.7 %).
const LARGEST_STEP: f64 = 1.5;

/// Resolution and stopping that meet an error relative to depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolution {
    /// Cell size in the plane, mm.
    pub cell_mm: f64,
    /// Height of the uppermost cells relative to their width.
    pub first_height: f64,
    /// Growth of cell heights away from the face.
    pub growth: f64,
    /// Contact samples along one edge of a cell.
    pub samples: usize,
    /// Residual relative to the contact force.
    pub residual: f64,
    /// Penetration that may remain, relative to depth.
    pub penetration: f64,
    /// Longest way into the pad in one increment with friction, mm.
    pub increment_mm: f64,
}

impl Resolution {
    /// What a tolerance needs (found by experiment against converged solutions).
    pub fn for_tolerance(tolerance: f64) -> Self {
        let cell_mm = (0.46 * (tolerance / 0.01).powf(0.456)).clamp(0.1, 2.0);
        Self {
            cell_mm,
            first_height: 1.2,
            growth: 1.4,
            samples: 2,
            residual: (0.1 * tolerance).clamp(1e-4, 1e-3),
            penetration: (0.2 * tolerance).min(5e-3),
            increment_mm: LONGEST_INCREMENT_MM,
        }
    }

    /// The same accuracy under this body: with cells that its tip does not fall between, and increments that are short for
    /// its size.
    pub fn for_body(self, body: &dyn Indenter, size: [f64; 3]) -> Self {
        let [hx, hy] = body.half_extent_mm();
        let short = (INCREMENT_OVER_RADIUS * hx.min(hy)).max(SHORTEST_MM);
        let [at_tip_mm2, touched_mm2] =
            [AT_TIP_MM, TOUCHED_UP_TO_MM].map(|up| self.underside_mm2(body, size, up));
        let circle_mm2 = std::f64::consts::PI * size[2] * size[2];
        let longest = match self.sees_edges(body, size) {
            true if touched_mm2 <= SMALL_MM2 => SHORTEST_MM,
            _ if touched_mm2 - at_tip_mm2 > SPREADS * circle_mm2 => SPREADING_INCREMENT_MM,
            true => EDGED_INCREMENT_MM,
            false => LONGEST_INCREMENT_MM,
        };
        let enough = CELLS_OF_TIP * self.cell_mm;
        let mut cell_mm = self.cell_mm;
        if cell_mm > NARROWEST_FOR_TIP_MM {
            let width_mm = tip_width_mm(body, size, enough);
            if width_mm < enough {
                cell_mm = (width_mm / CELLS_OF_TIP).max(NARROWEST_FOR_TIP_MM);
            }
        }
        Self { cell_mm, increment_mm: longest.min(short), ..self }
    }

    /// How many cells a body reaches from its axis over the pad.
    fn reach(&self, body: &dyn Indenter, size: [f64; 3]) -> [i32; 2] {
        let half = body.half_extent_mm();
        [0, 1].map(|a| (half[a].min(size[a] / 2.0) / self.cell_mm).ceil() as i32)
    }

    /// How much of a body's underside, as much as the pad can touch, lies less than `up_to_mm` above its tip.
    fn underside_mm2(&self, body: &dyn Indenter, size: [f64; 3], up_to_mm: f64) -> f64 {
        let (cell, [nx, ny]) = (self.cell_mm, self.reach(body, size));
        let points = (-ny..=ny).flat_map(|j| (-nx..=nx).map(move |i| (f64::from(i), f64::from(j))));
        let low = |(i, j): &(f64, f64)| body.lower_surface(i * cell, j * cell).is_some_and(|z| z <= up_to_mm);
        points.filter(low).count() as f64 * cell * cell
    }

    /// Whether the underside of a body, as much as the pad can touch, bends sharply or ends between three neighbours
    /// on a lattice of cells.
    fn sees_edges(&self, body: &dyn Indenter, size: [f64; 3]) -> bool {
        let (cell, reach) = (self.cell_mm, self.reach(body, size));
        let height = |i: i32, j: i32| {
            body.lower_surface(f64::from(i) * cell, f64::from(j) * cell).unwrap_or(f64::INFINITY)
        };
        let edged = |a: f64, b: f64, c: f64| b <= TOUCHED_UP_TO_MM && (a - 2.0 * b + c) / cell > EDGE_SLOPE;
        (-reach[1]..=reach[1]).any(|j| {
            (-reach[0]..=reach[0]).any(|i| {
                let at = height(i, j);
                edged(height(i - 1, j), at, height(i + 1, j)) || edged(height(i, j - 1), at, height(i, j + 1))
            })
        })
    }

    /// Cells with which the error may be expected to fall from `stated` to `wanted` on a pad of `size` mm, though at
    /// most half as many again along each side; nothing where this is fine enough, or would take too many.
    pub fn refined(&self, size: [f64; 3], stated: f64, wanted: f64) -> Option<Self> {
        if stated <= wanted {
            return None;
        }
        let now = Grid::blocks(size[0], self.cell_mm);
        let times = (stated / wanted).powf(1.0 / ORDER).min(LARGEST_STEP);
        self.of_blocks(size, ((now as f64 * times).ceil() as usize).max(now + 1))
    }

    /// The next finer cells on a pad of `size` mm; nothing where they would be too many.
    pub fn next_finer(&self, size: [f64; 3]) -> Option<Self> {
        self.of_blocks(size, Grid::blocks(size[0], self.cell_mm) + 1)
    }

    fn of_blocks(&self, size: [f64; 3], blocks: usize) -> Option<Self> {
        let cell_mm = size[0] / (16 * blocks) as f64;
        let cells = 16.0 * blocks as f64 * (size[1] / cell_mm);
        (cells <= MOST_CELLS as f64).then_some(Self { cell_mm, ..*self })
    }

    /// This resolution last, before it the coarser ones that go ahead on a pad of `size` mm.
    pub fn cascade(&self, size: [f64; 3]) -> Vec<Self> {
        let mut all = vec![*self];
        let mut blocks = Grid::blocks(size[0], self.cell_mm);
        while blocks > 1 {
            blocks = blocks.div_ceil(2);
            let cell_mm = size[0] / (16 * blocks) as f64;
            all.insert(0, Self { cell_mm, residual: GUESS_RESIDUAL, penetration: GUESS_RESIDUAL, ..*self });
        }
        all
    }
}

/// How wide the widest part of a body's underside is that a pad of `size` mm can touch, mm: of a ridge its width, not its length. At
/// least `enough` is as good as any, and is taken where none of the points looked at finds an underside.
fn tip_width_mm(body: &dyn Indenter, size: [f64; 3], enough: f64) -> f64 {
    const PITCH_MM: f64 = NARROWEST_FOR_TIP_MM / 4.0;
    let half = body.half_extent_mm();
    let [nx, ny] = [0, 1].map(|a| (half[a].min(size[a] / 2.0) / PITCH_MM).ceil() as i32);
    let points = (-ny..=ny).flat_map(|j| (-nx..=nx).map(move |i| (i, j)));
    let underside = points.clone().map(|(i, j)| {
        let height = body.lower_surface(f64::from(i) * PITCH_MM, f64::from(j) * PITCH_MM);
        height.is_some_and(|z| z <= TOUCHED_UP_TO_MM)
    });
    let underside: Vec<bool> = underside.collect();
    let touches = |i: i32, j: i32| {
        i.abs() <= nx && j.abs() <= ny && underside[((j + ny) * (2 * nx + 1) + i + nx) as usize]
    };
    let longest = (enough / PITCH_MM).ceil() as i32;
    // From a point both ways along a row, a column or a diagonal, as long as it touches.
    let width = |i: i32, j: i32, [u, v]: [i32; 2]| {
        let run =
            |sign: i32| (1..longest).take_while(|k| touches(i + sign * k * u, j + sign * k * v)).count();
        (run(1) + run(-1) + 1) as f64 * PITCH_MM * f64::from(u * u + v * v).sqrt()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};

    #[test]
    fn increments_are_short_for_what_spreads_and_for_what_is_small() {
        let increment_mm = |shape: Shape| {
            let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.3, height_mm: 8.0, shape };
            let body = from_spec("body", &spec, None).expect("a body");
            Resolution::for_tolerance(0.01).for_body(body.as_ref(), [20.0, 20.0, 4.0]).increment_mm
        };
        let dome = |radius_mm, diameter_mm| Shape::Dome { radius_mm, diameter_mm };
        let cone = Shape::Cone { tip_diameter_mm: 1.0, half_angle_deg: 19.29 };
        assert_eq!(increment_mm(dome(4.0, 8.0)), LONGEST_INCREMENT_MM);
        assert_eq!(increment_mm(dome(20.0, 16.0)), SPREADING_INCREMENT_MM);
        assert_eq!(increment_mm(cone), SHORTEST_MM);
    }

    #[test]
    fn cells_are_narrower_than_what_touches() {
        let cell_mm = |shape: Shape, tolerance: f64| {
            let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
            let body = from_spec("body", &spec, None).expect("a body");
            Resolution::for_tolerance(tolerance).for_body(body.as_ref(), [20.0, 20.0, 4.0]).cell_mm
        };
        let usual = |tolerance: f64| Resolution::for_tolerance(tolerance).cell_mm;
        let stripe = |x_mm: f64| Shape::Flat { plan: Plan::Rectangle { x_mm, y_mm: 10.0 } };
        let sphere = Shape::Dome { radius_mm: 4.0, diameter_mm: 8.0 };
        assert!(usual(0.1) > 1.2 && cell_mm(sphere, 0.1) == usual(0.1));
        assert!((cell_mm(stripe(1.0), 0.1) - 1.0 / CELLS_OF_TIP).abs() < 0.1);
        assert_eq!(cell_mm(stripe(0.2), 0.1), NARROWEST_FOR_TIP_MM);
        assert_eq!(cell_mm(stripe(0.2), 0.005), usual(0.005));
    }
}
