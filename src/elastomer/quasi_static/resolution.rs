//! What an accuracy takes: cell sizes and stopping.

use super::grid::Grid;

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
}

impl Resolution {
    /// What a tolerance needs (found by experiment against converged solutions).
    pub fn for_tolerance(tolerance: f64) -> Self {
        let cell_mm = (0.46 * (tolerance / 0.01).powf(0.456)).clamp(0.1, 2.0);
        Self {
            cell_mm,
            first_height: 0.8,
            growth: 1.4,
            samples: 2,
            residual: (0.1 * tolerance).clamp(1e-4, 1e-3),
            penetration: (0.2 * tolerance).min(5e-3),
        }
    }

    /// This resolution last, before it the coarser ones that go ahead on a pad of `size` mm.
    pub fn cascade(&self, size: [f64; 3]) -> Vec<Self> {
        let mut all = vec![*self];
        let mut blocks = Grid::blocks(size[0], self.cell_mm);
        while blocks > 1 {
            blocks = blocks.div_ceil(2);
            let cell_mm = size[0] / (16 * blocks) as f64;
            all.insert(0, Self { cell_mm, residual: 1e-2, penetration: 1e-2, ..*self });
        }
        all
    }
}
