//! The lattice that a face in relief is found on, and the part of it that is looked at.

use crate::elastomer::Surface;

/// The lattice has at least so many points across a cell.
const ACROSS_CELL: f64 = 4.0;
/// Though none closer than this, mm, where that leaves so many. Found by experiment: over cells of 0.28 mm the force of a bar
/// pressed 1 mm is 1 % too small at points 0.1 mm apart, and within 0.3 % at ones of half of that.
const CLOSE_ENOUGH_MM: f64 = 0.1;
/// See [`CLOSE_ENOUGH_MM`].
const LEAST_ACROSS_CELL: f64 = 3.0;
/// Around what is pressed so much more is looked at, cells.
const MARGIN: f64 = 5.0;

/// How many times finer than asked for the lattice has to be; nothing where it is too coarse to show what is finer than
/// a cell.
pub fn finer(spacing_mm: [f64; 2], cell_mm: [f64; 2]) -> Option<[usize; 2]> {
    let coarse = (0..2).any(|a| spacing_mm[a] > cell_mm[a]);
    let times = |a: usize| (spacing_mm[a] / widest_mm(cell_mm[a]) - 1e-6).ceil().max(1.0) as usize;
    (!coarse).then(|| [times(0), times(1)])
}

/// Points along x and y of the coarsest lattice that shows the relief over such cells on a pad of `size_mm`.
pub fn lattice(size_mm: [f64; 3], cell_mm: [f64; 2]) -> [usize; 2] {
    [0, 1].map(|a| (size_mm[a] / widest_mm(cell_mm[a])).ceil() as usize + 1)
}

/// Between the points of a lattice that shows the relief over such cells, at most.
fn widest_mm(cell_mm: f64) -> f64 {
    (cell_mm / ACROSS_CELL).max(CLOSE_ENOUGH_MM.min(cell_mm / LEAST_ACROSS_CELL))
}

/// The part of a lattice that is looked at.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    pub from: [usize; 2],
    pub size: [usize; 2],
    /// Between points of the lattice, mm.
    pub spacing: [f64; 2],
}

impl Window {
    /// What is pressed, and its surroundings; nothing where nothing is.
    pub fn around(face: &Surface, pressed: &[f32], cell_mm: [f64; 2]) -> Option<Self> {
        let spacing = [face.size_x_mm / (face.nx - 1) as f64, face.size_y_mm / (face.ny - 1) as f64];
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for (k, _) in pressed.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let (i, j) = (k % face.nx, k / face.nx);
            (low, high) = ([low[0].min(i), low[1].min(j)], [high[0].max(i), high[1].max(j)]);
        }
        (low[0] <= high[0]).then(|| {
            let count = [face.nx, face.ny];
            let margin = [0, 1].map(|a| (MARGIN * cell_mm[a] / spacing[a]).ceil() as usize);
            let from = [0, 1].map(|a| low[a].saturating_sub(margin[a]));
            let to = [0, 1].map(|a: usize| (high[a] + margin[a] + 1).min(count[a]));
            Self { from, size: [to[0] - from[0], to[1] - from[1]], spacing }
        })
    }

    /// How many points it has.
    pub fn count(self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Where on the lattice one of them is.
    pub fn at(self, k: usize) -> (usize, usize) {
        (self.from[0] + k % self.size[0], self.from[1] + k / self.size[0])
    }

    /// Where in the lattice's values.
    pub fn index(self, face: &Surface, k: usize) -> usize {
        self.at(k).1 * face.nx + self.at(k).0
    }

    /// mm^2 of a point.
    pub fn area(self) -> f64 {
        self.spacing[0] * self.spacing[1]
    }
}
