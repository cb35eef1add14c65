//! Particles, stored where they are: each block of cells owns its particles in batches of sixteen.
//!
//! Lengths are in grid cells, times in steps, masses in particle masses, so a velocity is cells per step and
//! the affine velocity C is per step. A particle's place is the tile node at the lower corner of its stencil
//! plus an offset of 0.5 to 1.5 cells from it: sixteen times finer than a coordinate of the whole pad in
//! single precision, and the kernels need nothing else.
//!
//! A batch takes 1728 bytes for 16 particles, 108 bytes a particle.

use super::grid::{TILE_ROW, TILE_SIDE};
use super::lanes::{Row, WIDTH};

/// Sixteen particles side by side.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Batch {
    /// Offset from the lower corner of the stencil, cells, 0.5 to 1.5.
    pub offset: [Row; 3],
    /// Velocity, cells per step.
    pub velocity: [Row; 3],
    /// Affine velocity C, row by row, per step.
    pub affine: [Row; 9],
    /// H = F - I, row by row.
    pub strain: [Row; 9],
    /// Index in the undeformed lattice, x inner, z outer.
    pub id: [u32; WIDTH],
    /// Tile node at the lower corner of the stencil.
    pub node: [u32; WIDTH],
    /// Bit i: particle i is held by the base.
    pub held: u16,
    /// How many lanes are in use.
    pub len: u16,
}

/// One particle on its own, on the way from one block to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// As in [`Batch`].
    pub offset: [f32; 3],
    /// As in [`Batch`].
    pub velocity: [f32; 3],
    /// As in [`Batch`].
    pub affine: [f32; 9],
    /// As in [`Batch`].
    pub strain: [f32; 9],
    /// As in [`Batch`].
    pub id: u32,
    /// Whether the base holds it.
    pub held: bool,
    /// Cell of the lower corner of its stencil, in the whole grid.
    pub cell: [i32; 3],
}

impl Batch {
    /// A batch without particles; unused lanes sit harmlessly in the middle of the first cell.
    pub fn empty() -> Self {
        Batch {
            offset: [Row([1.0; WIDTH]); 3],
            velocity: [Row::ZERO; 3],
            affine: [Row::ZERO; 9],
            strain: [Row::ZERO; 9],
            id: [0; WIDTH],
            node: [0; WIDTH],
            held: 0,
            len: 0,
        }
    }

    /// Reads lane `i`; `origin` is the block's first cell.
    pub fn get(&self, i: usize, origin: [i32; 3]) -> Particle {
        let at = tile_position(self.node[i]);
        Particle {
            offset: std::array::from_fn(|d| self.offset[d].0[i]),
            velocity: std::array::from_fn(|d| self.velocity[d].0[i]),
            affine: std::array::from_fn(|d| self.affine[d].0[i]),
            strain: std::array::from_fn(|d| self.strain[d].0[i]),
            id: self.id[i],
            held: self.held >> i & 1 == 1,
            cell: std::array::from_fn(|d| origin[d] + at[d] as i32),
        }
    }

    fn set(&mut self, i: usize, p: &Particle, node: u32) {
        for d in 0..3 {
            self.offset[d].0[i] = p.offset[d];
            self.velocity[d].0[i] = p.velocity[d];
        }
        for d in 0..9 {
            self.affine[d].0[i] = p.affine[d];
            self.strain[d].0[i] = p.strain[d];
        }
        self.id[i] = p.id;
        self.node[i] = node;
        self.held = self.held & !(1 << i) | u16::from(p.held) << i;
    }
}

/// Coordinates of a tile node within its tile.
#[inline(always)]
pub fn tile_position(node: u32) -> [u32; 3] {
    let side = TILE_SIDE as u32;
    [node % TILE_ROW as u32, node / TILE_ROW as u32 % side, node / TILE_ROW as u32 / side]
}

/// The particles of one block.
#[derive(Debug, Clone, Default)]
pub struct Bin {
    /// All full but the last.
    pub batches: Vec<Batch>,
}

impl Bin {
    /// How many particles.
    pub fn len(&self) -> usize {
        self.batches.last().map_or(0, |b| (self.batches.len() - 1) * WIDTH + b.len as usize)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.batches.is_empty()
    }

    /// Adds a particle that lies at `node` of this block's tile.
    pub fn push(&mut self, p: &Particle, node: u32) {
        if self.batches.last().is_none_or(|b| b.len as usize == WIDTH) {
            self.batches.push(Batch::empty());
        }
        let batch = self.batches.last_mut().expect("a batch with a free lane was just made sure of");
        let i = batch.len as usize;
        batch.len += 1;
        batch.set(i, p, node);
    }

    /// Takes particle `index` out; the last one takes its place.
    pub fn swap_remove(&mut self, index: usize, origin: [i32; 3]) -> Particle {
        let last = self.len() - 1;
        let taken = self.batches[index / WIDTH].get(index % WIDTH, origin);
        if index != last {
            let node = self.batches[last / WIDTH].node[last % WIDTH];
            let moved = self.batches[last / WIDTH].get(last % WIDTH, origin);
            self.batches[index / WIDTH].set(index % WIDTH, &moved, node);
        }
        let batch = self.batches.last_mut().expect("the block holds at least the particle taken");
        batch.len -= 1;
        // The freed lane must stay harmless: at rest, inside the tile.
        let free = Batch::empty().get(0, origin);
        batch.set(last % WIDTH, &free, 0);
        if batch.len == 0 {
            self.batches.pop();
        }
        taken
    }

    /// Every particle, in storage order.
    pub fn iter(&self, origin: [i32; 3]) -> impl Iterator<Item = Particle> + '_ {
        self.batches.iter().flat_map(move |b| (0..b.len as usize).map(move |i| b.get(i, origin)))
    }
}
