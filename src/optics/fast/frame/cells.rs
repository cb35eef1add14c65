//! How large the cells are that light bounces between.

use super::Frame;

/// Largest edge of a cell of the bounce, mm.
const CELL_MM: f32 = 0.26;
/// They are not quartered to less than this, mm: smaller ones take three times as long, and are hardly better.
const GROOVE_CELL_MM: f32 = 0.05;

impl<const N: usize> Frame<'_, N> {
    /// Pixels along the edge of a cell of the bounce, and by how many times that is finer than usual: between a sharp rim and
    /// the foot of its flank light goes to and fro within a few tenths of a millimetre, in a groove within less.
    pub(super) fn cell_px(&self) -> (usize, usize) {
        let usual = cell_px(self.once.pixel_mm);
        let finer = match self.effort.fine && self.heights.has_sharp_rims() {
            true if self.heights.has_grooves()
                && usual as f32 * self.once.pixel_mm >= 4.0 * GROOVE_CELL_MM =>
            {
                4
            }
            true => 2,
            false => 1,
        };
        let finer = finer.min(usual);
        (usual / finer, finer)
    }
}

/// Pixels along the edge of a cell of the bounce.
pub fn cell_px(pixel_mm: f32) -> usize {
    [8, 4, 2].into_iter().find(|n| *n as f32 * pixel_mm <= CELL_MM).unwrap_or(1)
}
