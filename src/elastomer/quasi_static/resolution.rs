//! What an accuracy takes: cell sizes and stopping.

use super::grid::Grid;
use super::increments;
use super::underside::{Underside, tip_width_mm};
use crate::elastomer::{Settings, Skip};
use crate::indenter::Indenter;

/// Residual, and penetration relative to depth, of levels that only guess.
pub const GUESS_RESIDUAL: f64 = 1e-2;
/// Cells of the face that an answer may cost: 96 along each side, of 0.21 mm on a pad of 20 mm.
const MOST_CELLS: usize = 96 * 96;
/// Longest way of the indenter in one increment, mm.
pub const LONGEST_INCREMENT_MM: f64 = 0.5;
/// At least so many cells go across what touches. Found by experiment: one cell across a needle 0.8 mm deep stated 15 %, and its
/// force was 33 % off.
const CELLS_OF_TIP: f64 = 1.5;
/// They need not be narrower than this for it, mm: finer ones are taken where an answer states too much.
const NARROWEST_FOR_TIP_MM: f64 = 0.5;
/// So many cells go into the radius of a circle as large as what touches of a body with edges, or into half of the body's narrower side
/// where that is less, at the default tolerance, and more at smaller ones. Found by experiment: the contact of a cone 1 mm across at its tip
/// is seen 8 and 3 % too small in radius 0.25 and 0.5 mm deep with 2.1 cells, within 0.8 % with these; its force 1 mm deep is 1.5 % off with
/// those, 0.8 % with these. A line 2 mm wide presses 1.5 to 2.2 % too hard, without friction 0.5 mm and with or without it 1 mm deep, with
/// 2.4 cells in half of its width, within 0.7 % with these (against half as many again).
const CELLS_OF_SMALL: f64 = 2.7;
/// Cells over the narrower ones that are taken for it, at most.
const LARGEST_STEP_FOR_SMALL: f64 = 1.8;
/// What has fewer cells even so is a pin or a blade, which no cells resolve: it gets as many, never more at small tolerances.
const CELLS_OF_PIN: f64 = 2.0;
/// Cells over the narrower ones that are taken for it, at most.
const LARGEST_STEP_FOR_PIN: f64 = 1.4;
/// Cells of the default tolerance, mm.
const USUAL_CELL_MM: f64 = 0.46;
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
    /// The same without friction, mm.
    pub free_increment_mm: f64,
}

impl Resolution {
    /// What a tolerance needs (found by experiment against converged solutions).
    pub fn for_tolerance(tolerance: f64) -> Self {
        let cell_mm = (USUAL_CELL_MM * (tolerance / 0.01).powf(0.456)).clamp(0.1, 2.0);
        Self {
            cell_mm,
            first_height: 1.2,
            growth: 1.4,
            samples: 2,
            residual: (0.1 * tolerance).clamp(1e-4, 1e-3),
            penetration: (0.2 * tolerance).min(5e-3),
            increment_mm: LONGEST_INCREMENT_MM,
            free_increment_mm: LONGEST_INCREMENT_MM,
        }
    }

    /// The same accuracy under this body: with cells that its tip does not fall between, and increments that are short for
    /// its size.
    pub fn for_body(self, body: &dyn Indenter, size: [f64; 3]) -> Self {
        self.for_underside(&Underside::of(body, size), body, size)
    }

    /// The same where the body's underside is known.
    pub(super) fn for_underside(self, underside: &Underside, body: &dyn Indenter, size: [f64; 3]) -> Self {
        let enough = CELLS_OF_TIP * self.cell_mm;
        let mut cell_mm = self.cell_mm;
        if cell_mm > NARROWEST_FOR_TIP_MM {
            let width_mm = tip_width_mm(body, size, enough);
            if width_mm < enough {
                cell_mm = (width_mm / CELLS_OF_TIP).max(NARROWEST_FOR_TIP_MM);
            }
        }
        let increment_mm = increments::longest_mm(body, underside, size[2]);
        let free_increment_mm = increments::longest_free_mm(body, underside);
        let usual = Self { cell_mm, increment_mm, free_increment_mm, ..self };
        if !underside.has_edges {
            return usual;
        }
        let radius_mm = underside.radius_mm();
        let [hx, hy] = body.half_extent_mm();
        let over_usual = self.cell_mm / USUAL_CELL_MM;
        let narrowest_mm = radius_mm.min(hx).min(hy);
        let is_resolved = narrowest_mm >= CELLS_OF_PIN * self.cell_mm / LARGEST_STEP_FOR_SMALL;
        let [enough_mm, least_mm] = if is_resolved {
            [narrowest_mm / CELLS_OF_SMALL * over_usual, self.cell_mm / LARGEST_STEP_FOR_SMALL]
        } else {
            [radius_mm / CELLS_OF_PIN * over_usual.max(1.0), self.cell_mm / LARGEST_STEP_FOR_PIN]
        };
        let narrower_mm = enough_mm.max(least_mm);
        if narrower_mm >= cell_mm {
            return usual;
        }
        let [now, wanted] = [cell_mm, narrower_mm].map(|cell_mm| Grid::blocks(size[0], cell_mm));
        (now..=wanted).rev().find_map(|blocks| usual.of_blocks(size, blocks)).unwrap_or(usual)
    }

    /// The same where cells of a pad of `size` mm are not saved, as the settings may have it.
    pub(super) fn with_skips_of(self, settings: &Settings, size: [f64; 3]) -> Self {
        let growth = if settings.skips(Skip::GrowingCells) { self.growth } else { 1.0 };
        let half_mm = size[0] / (32 * Grid::blocks(size[0], self.cell_mm)) as f64;
        let cell_mm = if settings.skips(Skip::Relief) { self.cell_mm } else { half_mm };
        Self { growth, cell_mm, ..self }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};

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
        let line = Shape::Flat { plan: Plan::Rectangle { x_mm: 2.0, y_mm: 16.0 } };
        assert!((0.3..0.32).contains(&cell_mm(line, 0.01)));
        let cone = |tip_diameter_mm| Shape::Cone { tip_diameter_mm, half_angle_deg: 19.29 };
        assert!(cell_mm(cone(1.0), 0.01) < usual(0.01) / 1.7 && cell_mm(cone(4.0), 0.01) == usual(0.01));
        let finest = cell_mm(cone(1.0), 0.0035);
        assert!(finest < cell_mm(cone(1.0), 0.01) / 1.15 && finest >= 20.0 / 96.0, "{finest} mm");
        assert!(cell_mm(cone(0.2), 0.01) > usual(0.01) / 1.6, "as narrow as a pin are no cells");
    }
}
