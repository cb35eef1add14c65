//! The grid's part of a pass: momentum to velocity, and what pad and indenter give each other.
//!
//! A node's momentum is the sum over the tiles that reach it; divided by its mass it is the velocity that
//! both bodies share there (equation (5) of the paper). The momentum that the indenter's points brought less
//! what they would take away with the common velocity is the impulse on the pad: summed over the nodes it
//! is the contact force.

use super::grid::{BLOCK, NONE, Nodes, Place, RIM, TILE, TILE_LAYER, Tile};
use super::lanes::{Kernel, Lanes, Row};
use std::ptr::null;

/// A node slower than this, in cells per step, stands still: see the same threshold for strains.
const STILL: f32 = 1e-15;
/// The lanes of a row that are components of velocity; the fourth of a node is its mass.
const VELOCITY: u16 = 0x7777;

/// Momentum handed from the indenter to the grid in one pass, in the solver's units.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exchange {
    /// Momentum given to the pad.
    pub impulse: [f64; 3],
    /// Its moment about the z axis through the pad frame's origin.
    pub torque: f64,
}

/// What comes of summing a block's nodes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Summed {
    /// What the indenter gave there.
    pub exchange: Exchange,
    /// Whether any of the nodes moves.
    pub moving: bool,
}

/// Sums a block's nodes from the tiles that reach into it and turns momentum into velocity.
pub struct Update<'a> {
    /// The block.
    pub place: &'a Place,
    /// The pad's tiles; empty blocks have none.
    pub tiles: &'a [Option<Box<Tile>>],
    /// The indenter's tiles of this step.
    pub indenter: &'a [Option<Box<Tile>>],
    /// The tile below the block that comes next.
    pub below_next: Option<&'a Tile>,
    /// Position of the block's first node from the pad frame's origin, cells.
    pub first_node: [f64; 3],
    /// Result.
    pub nodes: &'a mut Nodes,
}

/// The tiles that reach into a block, in the order in which they are added.
type Reaching<'a> = [Option<&'a Tile>; 8];

fn reaching<'a>(place: &Place, tiles: &'a [Option<Box<Tile>>]) -> Reaching<'a> {
    place.lower.map(|slot| if slot == NONE { None } else { tiles[slot as usize].as_deref() })
}

/// Four nodes along x of a block, summed from all tiles. Only rows in the rims of the tiles below have more than two.
#[inline(always)]
fn sum_row<L: Lanes>(tiles: &Reaching, j: usize, k: usize) -> L {
    let mut sum = L::fill(0.0);
    for z in 0..if k < RIM { 2 } else { 1 } {
        for y in 0..if j < RIM { 2 } else { 1 } {
            let node = (k + z * BLOCK[2]) * TILE_LAYER + (j + y * BLOCK[1]) * TILE[0];
            if let Some(tile) = tiles[4 * z + 2 * y] {
                // SAFETY: `at` checked that four nodes can be read.
                sum = sum + unsafe { L::read(tile.at(node)) };
            }
            if let Some(tile) = tiles[4 * z + 2 * y + 1] {
                // SAFETY: as above. Of a lower neighbour along x only the nodes of the rim are this block's.
                sum = sum + unsafe { L::read(tile.at(node + BLOCK[0])) }.keep((1 << (4 * RIM)) - 1);
            }
        }
    }
    sum
}

impl Kernel for Update<'_> {
    type Output = Summed;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Summed {
        let mut exchange = Exchange::default();
        let (own, foreign) = (reaching(self.place, self.tiles), reaching(self.place, self.indenter));
        if own.iter().all(Option::is_none) {
            return Summed::default();
        }
        let meets = foreign.iter().any(Option::is_some);
        // Nodes that nothing reached keep velocity zero: their momentum is zero, too.
        let (none, least, still) = (L::fill(0.0), L::fill(f32::MIN_POSITIVE), L::fill(STILL));
        let (mut pad, mut theirs) = (Row::ZERO, Row::ZERO);
        let mut moving = 0;
        // The next block's memory is asked for meanwhile.
        let next = self.tiles.get(self.place.lower[0] as usize + 1).and_then(Option::as_deref);
        let next_tile = next.map_or(null(), |tile| tile.0.as_ptr());
        let next_nodes = self.nodes.0.as_ptr_range().end;
        let lines = size_of::<Tile>().div_ceil(size_of::<Nodes>());
        // Of the tile below the next block only the rim was not read lately.
        let below =
            self.below_next.map_or(null(), |tile| tile.at((BLOCK[2] * TILE_LAYER) as _).cast::<Row>());
        for (r, row) in self.nodes.0.iter_mut().enumerate() {
            L::fetch_later(next_nodes.wrapping_add(r));
            if r < RIM * TILE_LAYER / 4 {
                L::fetch_later(below.wrapping_add(r));
            }
            for line in 0..lines {
                L::fetch_later(next_tile.wrapping_add(lines * r + line));
            }
            let (j, k) = (r % BLOCK[1], r / BLOCK[1]);
            let mut total: L = sum_row(&own, j, k);
            let mut shared = 0;
            if meets {
                let added: L = sum_row(&foreign, j, k);
                shared = none.less(total.fourth_of_group()) & none.less(added.fourth_of_group());
                if shared != 0 {
                    total.store(&mut pad);
                    added.store(&mut theirs);
                }
                total = total + added;
            }
            let v = total.over(total.fourth_of_group().larger(least));
            let felt = still.less(v.larger(-v));
            moving |= felt & VELOCITY;
            v.keep(felt).store(row);
            if shared == 0 {
                continue;
            }
            for i in (0..4).filter(|i| shared >> (4 * i) & 1 == 1) {
                let at = |row: &Row, d: usize| f64::from(row.0[4 * i + d]);
                let mass = at(&theirs, 3);
                let mut given = [0.0; 3];
                for d in 0..3 {
                    given[d] = at(&theirs, d) - mass * at(row, d);
                    exchange.impulse[d] += given[d];
                }
                let x = self.first_node[0] + i as f64;
                let y = self.first_node[1] + (r % BLOCK[1]) as f64;
                exchange.torque += x * given[1] - y * given[0];
            }
        }
        Summed { exchange, moving: moving != 0 }
    }
}
