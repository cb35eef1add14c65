//! The grid's part of a pass: momentum to velocity, and what pad and indenter give each other.
//!
//! A node's momentum is the sum over the tiles that reach it; divided by its mass it is the velocity that
//! both bodies share there (equation (5) of the paper). The momentum that the indenter's points brought less
//! what they would take away with the common velocity is the impulse on the pad: summed over the nodes it
//! is the contact force.

use super::grid::{BLOCK, NONE, Nodes, Place, RIM, TILE, TILE_LAYER, Tile};
use super::lanes::{Kernel, Lanes, Row};
use super::transfer::reach;

/// A node slower than this, in cells per step, stands still: see the same threshold for strains.
const STILL: f32 = 1e-15;

/// Momentum handed from the indenter to the grid in one pass, in the solver's units.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exchange {
    /// Momentum given to the pad.
    pub impulse: [f64; 3],
    /// Its moment about the z axis through the pad frame's origin.
    pub torque: f64,
}

/// Sums a block's nodes from the tiles that reach into it and turns momentum into velocity.
pub struct Update<'a> {
    /// The block.
    pub place: &'a Place,
    /// The pad's tiles; empty blocks have none.
    pub tiles: &'a [Option<Box<Tile>>],
    /// The indenter's tiles of this step.
    pub indenter: &'a [Option<Box<Tile>>],
    /// Position of the block's first node from the pad frame's origin, cells.
    pub first_node: [f64; 3],
    /// Result.
    pub nodes: &'a mut Nodes,
}

/// Adds to `sum` what neighbour `n`'s tile holds of this block's nodes.
#[inline(always)]
fn add_tile<L: Lanes>(sum: &mut Nodes, n: usize, tile: &Tile) {
    let (x, _) = reach(n, 0);
    let (y, ny) = reach(n, 1);
    let (z, nz) = reach(n, 2);
    for k in 0..nz {
        for j in 0..ny {
            // SAFETY: `at` checked that four nodes can be read.
            let row = unsafe { L::read(tile.at((k + z) * TILE_LAYER + (j + y) * TILE[0] + x)) };
            // Of a lower neighbour along x only the nodes of the rim are this block's.
            let row = if x > 0 { row.keep((1 << (4 * RIM)) - 1) } else { row };
            let to = &mut sum.0[k * BLOCK[1] + j];
            (L::load(to) + row).store(to);
        }
    }
}

/// Adds all tiles that reach into a block; false when there are none.
#[inline(always)]
fn add_all<L: Lanes>(sum: &mut Nodes, place: &Place, tiles: &[Option<Box<Tile>>]) -> bool {
    let mut any = false;
    for n in 0..8 {
        let slot = place.lower[n];
        if slot != NONE
            && let Some(tile) = &tiles[slot as usize]
        {
            if !any {
                sum.0.fill(Row::ZERO);
            }
            any = true;
            add_tile::<L>(sum, n, tile);
        }
    }
    any
}

impl Kernel for Update<'_> {
    type Output = Exchange;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Exchange {
        let mut exchange = Exchange::default();
        if !add_all::<L>(self.nodes, self.place, self.tiles) {
            return exchange;
        }
        let mut foreign = Nodes::zero();
        let meets = add_all::<L>(&mut foreign, self.place, self.indenter);
        // Nodes that nothing reached keep velocity zero: their momentum is zero, too.
        let (least, still) = (L::fill(f32::MIN_POSITIVE), L::fill(STILL));
        for (r, row) in self.nodes.0.iter_mut().enumerate() {
            let pad = *row;
            let total = if meets { L::load(&pad) + L::load(&foreign.0[r]) } else { L::load(&pad) };
            let v = total.over(total.fourth_of_group().larger(least));
            v.keep(still.less(v.larger(-v))).store(row);
            if !meets {
                continue;
            }
            for i in 0..4 {
                let at = |row: &Row, d: usize| f64::from(row.0[4 * i + d]);
                let mass = at(&foreign.0[r], 3);
                if mass == 0.0 || at(&pad, 3) == 0.0 {
                    continue;
                }
                let mut given = [0.0; 3];
                for d in 0..3 {
                    given[d] = at(&foreign.0[r], d) - mass * at(row, d);
                    exchange.impulse[d] += given[d];
                }
                let x = self.first_node[0] + i as f64;
                let y = self.first_node[1] + (r % BLOCK[1]) as f64;
                exchange.torque += x * given[1] - y * given[0];
            }
        }
        exchange
    }
}
