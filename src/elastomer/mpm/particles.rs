//! Particles, stored where they are: each block of cells owns its particles in batches of sixteen.
//!
//! Lengths are in grid cells, times in steps, masses in particle masses, so a velocity is cells per step and
//! the affine velocity C is per step. A particle's place is the tile node at the lower corner of its stencil
//! plus an offset of 0.5 to 1.5 cells from it: sixteen times finer than a coordinate of the whole pad in
//! single precision, and the kernels need nothing else.
//!
//! Velocity and C are not stored: they come from the grid and go back to it within one pass
//! ([`super::transfer`]). A batch takes 896 bytes for 16 particles, 56 bytes a particle.

use super::grid::tile_position;
use super::lanes::{Row, WIDTH};

/// Sixteen particles side by side.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Batch {
    /// Offset from the lower corner of the stencil, cells, 0.5 to 1.5.
    pub offset: [Row; 3],
    /// H = F - I, row by row.
    pub strain: [Row; 9],
    /// Index in the undeformed lattice, x inner, z outer.
    pub id: [u32; WIDTH],
    /// Tile node at the lower corner of the stencil.
    pub node: [u16; WIDTH],
    /// Bit i: particle i is held by the base.
    pub held: u16,
    /// How many lanes are in use.
    pub len: u16,
}

/// One particle on its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// As in [`Batch`].
    pub offset: [f32; 3],
    /// As in [`Batch`].
    pub strain: [f32; 9],
    /// As in [`Batch`].
    pub id: u32,
    /// Whether the base holds it.
    pub held: bool,
    /// Cell of the lower corner of its stencil, in the whole grid.
    pub cell: [i32; 3],
}

/// A particle with its motion, about to be put on the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// The particle.
    pub particle: Particle,
    /// Velocity, cells per step.
    pub velocity: [f32; 3],
    /// Affine velocity C, row by row, per step.
    pub affine: [f32; 9],
}

impl Batch {
    /// A batch without particles; unused lanes sit harmlessly in the middle of the first cell.
    pub fn empty() -> Self {
        Batch {
            offset: [Row([1.0; WIDTH]); 3],
            strain: [Row::ZERO; 9],
            id: [0; WIDTH],
            node: [0; WIDTH],
            held: 0,
            len: 0,
        }
    }

    /// Which lanes are in use.
    #[inline(always)]
    pub fn used(&self) -> u16 {
        u16::MAX >> (WIDTH - self.len as usize)
    }

    /// Reads lane `i`; `origin` is the block's first cell.
    pub fn get(&self, i: usize, origin: [i32; 3]) -> Particle {
        let at = tile_position(self.node[i]);
        Particle {
            offset: std::array::from_fn(|d| self.offset[d].0[i]),
            strain: std::array::from_fn(|d| self.strain[d].0[i]),
            id: self.id[i],
            held: self.held >> i & 1 == 1,
            cell: std::array::from_fn(|d| origin[d] + at[d]),
        }
    }

    fn set(&mut self, i: usize, p: &Particle, node: u16) {
        for d in 0..3 {
            self.offset[d].0[i] = p.offset[d];
        }
        for d in 0..9 {
            self.strain[d].0[i] = p.strain[d];
        }
        self.id[i] = p.id;
        self.node[i] = node;
        self.held = self.held & !(1 << i) | u16::from(p.held) << i;
    }
}

/// The particles of one block.
#[derive(Debug, Clone, Default)]
pub struct Bin {
    /// All full but the last.
    pub batches: Vec<Batch>,
    /// Whether nothing moved there in the last pass and nothing came since: another such pass would leave all as it is.
    pub still: bool,
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
    pub fn push(&mut self, p: &Particle, node: u16) {
        self.still = false;
        if self.batches.last().is_none_or(|b| b.len as usize == WIDTH) {
            // Room for one batch more, not for twice as many: blocks hardly grow.
            self.batches.reserve_exact(1);
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
        // The freed lane must stay harmless: undeformed, inside the tile.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bin_gives_back_what_it_got() {
        let particle = |id: u32| Particle {
            offset: [0.6, 1.0, 1.4],
            strain: std::array::from_fn(|k| id as f32 + k as f32),
            id,
            held: id.is_multiple_of(3),
            cell: [8, 9, 10],
        };
        let mut bin = Bin::default();
        for id in 0..40 {
            bin.push(&particle(id), super::super::grid::home([8, 9, 10]).1);
        }
        let origin = [8, 8, 8];
        for (index, id) in [(5, 5), (38, 38), (5, 39), (0, 0)] {
            assert_eq!(bin.swap_remove(index, origin), particle(id));
        }
        let mut left: Vec<Particle> = bin.iter(origin).collect();
        left.sort_by_key(|p| p.id);
        let expected: Vec<Particle> =
            (0..40).filter(|id| ![0, 5, 38, 39].contains(id)).map(particle).collect();
        assert_eq!(left, expected);
        assert_eq!(bin.batches.len(), 3);
    }
}
