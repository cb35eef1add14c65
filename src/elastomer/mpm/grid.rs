//! The sparse grid: which blocks of cells exist, and the memory of their nodes.
//!
//! Space is cut into blocks of 4 x 8 x 8 cells ([`BLOCK`]). A block is *active* when it or one of its 26 neighbours
//! holds particles; only active blocks have memory, and nothing else is ever cleared or visited.
//!
//! A particle touches the 3 x 3 x 3 nodes from the lower corner of its stencil, so the particles of a block
//! touch a *tile* of 6 x 10 x 10 nodes: the block's own 256 and a rim that belongs to the upper neighbours.
//! Every block scatters into its own tile; afterwards each block sums its nodes from its own
//! tile and those of its seven lower neighbours, always in the same order. So no two threads write the
//! same node, no atomics are needed, and the sum does not depend on the number of threads.
//!
//! A node takes 16 bytes, the tiles 38 bytes more per node of an occupied block.

use super::lanes::Row;

/// Cells along the sides of a block. Along x it must be 4: four nodes of four components fill a row.
pub const BLOCK: [usize; 3] = [4, 8, 8];
/// Nodes along the sides of a tile.
pub const TILE: [usize; 3] = [BLOCK[0] + RIM, BLOCK[1] + RIM, BLOCK[2] + RIM];
/// Nodes by which a tile is longer than its block.
pub const RIM: usize = 2;
/// Nodes from one layer of a tile to the next; from one row to the next it is `TILE[0]`.
pub const TILE_LAYER: usize = TILE[0] * TILE[1];
/// Nodes of a block.
pub const BLOCK_NODES: usize = BLOCK[0] * BLOCK[1] * BLOCK[2];
/// Marks a neighbour that is not active.
pub const NONE: u32 = u32::MAX;

/// Rows of sixteen floats in a tile; four nodes a row, with room for a read past the last node.
const TILE_ROWS: usize = (TILE_LAYER * TILE[2] + 4).div_ceil(4);

/// Mass and momentum (or mass and velocity) on the nodes of a tile: x, y, z, mass.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Tile(pub [Row; TILE_ROWS]);

impl Tile {
    /// All zero.
    pub fn zero() -> Self {
        Tile([Row::ZERO; TILE_ROWS])
    }

    /// First float of a node.
    #[inline(always)]
    pub fn at(&self, node: usize) -> *const f32 {
        assert!(node + 4 <= TILE_ROWS * 4, "a stencil row lies inside the tile");
        // SAFETY: the node and the three after it lie inside the array.
        unsafe { self.0.as_ptr().cast::<f32>().add(node * 4) }
    }

    /// First float of a node, to write.
    #[inline(always)]
    pub fn at_mut(&mut self, node: usize) -> *mut f32 {
        assert!(node + 4 <= TILE_ROWS * 4, "a stencil row lies inside the tile");
        // SAFETY: the node and the three after it lie inside the array.
        unsafe { self.0.as_mut_ptr().cast::<f32>().add(node * 4) }
    }
}

/// Velocity on the nodes of a block; row `k BLOCK[1] + j` holds the four nodes along x.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Nodes(pub [Row; BLOCK[1] * BLOCK[2]]);

impl Nodes {
    /// All zero.
    pub fn zero() -> Self {
        Nodes([Row::ZERO; BLOCK[1] * BLOCK[2]])
    }
}

/// An active block and its active neighbours; bit 0 of a neighbour's index is one step along x, bit 1 y, bit 2 z.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Coordinates in blocks.
    pub block: [i32; 3],
    /// The neighbours whose tiles reach into this block; the first is the block itself.
    pub lower: [u32; 8],
    /// The neighbours into which this block's tile reaches; the first is the block itself.
    pub upper: [u32; 8],
}

impl Place {
    /// First cell of the block.
    pub fn origin(&self) -> [i32; 3] {
        std::array::from_fn(|d| self.block[d] * BLOCK[d] as i32)
    }
}

/// Where the grid lies and which of its blocks are active.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Cell width, mm.
    pub dx_mm: f64,
    /// Position of node (0, 0, 0), pad frame, mm.
    pub lower_mm: [f64; 3],
    /// Extent in blocks.
    pub blocks: [usize; 3],
    /// Slot of each block, or [`NONE`].
    table: Vec<u32>,
    /// The active blocks, x fastest.
    pub places: Vec<Place>,
}

impl Grid {
    /// A grid without active blocks that covers the box from `lower_mm` to `upper_mm`; node (0, 0, 0) of the
    /// pad frame's origin falls on a node.
    pub fn new(dx_mm: f64, lower_mm: [f64; 3], upper_mm: [f64; 3]) -> Self {
        let side = BLOCK.map(|b| dx_mm * b as f64);
        let lower: [f64; 3] = std::array::from_fn(|d| (lower_mm[d] / side[d]).floor() * side[d]);
        let blocks: [usize; 3] =
            std::array::from_fn(|d| ((upper_mm[d] - lower[d]) / side[d]).ceil() as usize + 1);
        let table = vec![NONE; blocks.iter().product()];
        Self { dx_mm, lower_mm: lower, blocks, table, places: Vec::new() }
    }

    /// The lower corner of the stencil of a point, and the point's offset from it (0.5 to 1.5 cells).
    pub fn locate(&self, x_mm: [f64; 3]) -> ([i32; 3], [f32; 3]) {
        let mut cell = [0; 3];
        let mut offset = [0.0; 3];
        for d in 0..3 {
            let x = (x_mm[d] - self.lower_mm[d]) / self.dx_mm;
            let base = (x - 0.5).floor();
            cell[d] = base as i32;
            offset[d] = (x - base) as f32;
        }
        (cell, offset)
    }

    /// Where a particle is, mm.
    pub fn position_mm(&self, cell: [i32; 3], offset: [f32; 3]) -> [f64; 3] {
        std::array::from_fn(|d| self.lower_mm[d] + (f64::from(cell[d]) + f64::from(offset[d])) * self.dx_mm)
    }

    fn table_index(&self, block: [i32; 3]) -> Option<usize> {
        let [x, y, z] = block.map(|b| usize::try_from(b).unwrap_or(usize::MAX));
        let [nx, ny, nz] = self.blocks;
        (x < nx && y < ny && z < nz).then(|| (z * ny + y) * nx + x)
    }

    /// Slot of a block, if it is active.
    pub fn slot(&self, block: [i32; 3]) -> Option<usize> {
        let slot = self.table[self.table_index(block)?];
        (slot != NONE).then_some(slot as usize)
    }

    /// Whether the block and its neighbours lie inside the grid.
    pub fn encloses(&self, block: [i32; 3]) -> bool {
        (0..3).all(|d| block[d] >= 1 && (block[d] as usize) + 1 < self.blocks[d])
    }

    /// Makes the given blocks and their neighbours active, and no others. Slots are renumbered.
    pub fn activate(&mut self, occupied: impl Iterator<Item = [i32; 3]>) {
        self.table.fill(NONE);
        for b in occupied {
            for n in 0..27 {
                let near = [b[0] + n % 3 - 1, b[1] + n / 3 % 3 - 1, b[2] + n / 9 - 1];
                let index =
                    self.table_index(near).expect("an occupied block and its neighbours lie inside the grid");
                self.table[index] = 0;
            }
        }
        let [nx, ny, _] = self.blocks;
        let mut found = Vec::new();
        for (index, slot) in self.table.iter_mut().enumerate() {
            if *slot != NONE {
                *slot = found.len() as u32;
                found.push([(index % nx) as i32, (index / nx % ny) as i32, (index / nx / ny) as i32]);
            }
        }
        self.places = found
            .iter()
            .map(|&block| {
                let neighbour = |sign: i32, n: i32| {
                    let near = [
                        block[0] + sign * (n & 1),
                        block[1] + sign * (n >> 1 & 1),
                        block[2] + sign * (n >> 2),
                    ];
                    self.slot(near).map_or(NONE, |s| s as u32)
                };
                Place {
                    block,
                    lower: std::array::from_fn(|n| neighbour(-1, n as i32)),
                    upper: std::array::from_fn(|n| neighbour(1, n as i32)),
                }
            })
            .collect();
    }
}

/// Block and tile node of the lower corner of a stencil.
pub fn home(cell: [i32; 3]) -> ([i32; 3], u16) {
    let side = |d: usize| BLOCK[d] as i32;
    let block = std::array::from_fn(|d| cell[d].div_euclid(side(d)));
    let [x, y, z]: [usize; 3] = std::array::from_fn(|d| cell[d].rem_euclid(side(d)) as usize);
    (block, tile_node([x, y, z]))
}

/// Number of a node in its tile.
#[inline(always)]
pub fn tile_node([x, y, z]: [usize; 3]) -> u16 {
    (z * TILE_LAYER + y * TILE[0] + x) as u16
}

/// Coordinates of a tile's node.
#[inline(always)]
pub fn tile_position(node: u16) -> [i32; 3] {
    let node = i32::from(node);
    [node % TILE[0] as i32, node / TILE[0] as i32 % TILE[1] as i32, node / TILE_LAYER as i32]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_found_again_and_its_neighbours_are_active() {
        let mut grid = Grid::new(0.13, [-3.0, -2.0, -5.0], [3.0, 2.0, 2.0]);
        for x in [[0.0, 0.0, 0.0], [1.234, -1.5, -4.0], [-2.0, 1.99, 1.0]] {
            let (cell, offset) = grid.locate(x);
            let back = grid.position_mm(cell, offset);
            assert!((0..3).all(|d| (back[d] - x[d]).abs() < 1e-7 && (0.5..=1.5).contains(&offset[d])));
        }
        grid.activate([[2, 2, 2], [3, 2, 2]].into_iter());
        assert_eq!(grid.places.len(), 4 * 3 * 3);
        let here = grid.slot([2, 2, 2]).expect("just activated");
        let place = &grid.places[here];
        assert_eq!(place.lower[0] as usize, here);
        assert_eq!(place.upper[1] as usize, grid.slot([3, 2, 2]).expect("just activated"));
        assert_eq!(place.lower[4] as usize, grid.slot([2, 2, 1]).expect("a neighbour"));
        assert!(grid.slot([0, 2, 2]).is_none());
    }
}
