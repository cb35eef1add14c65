//! The pad as a body of particles on its grid, and the phases of a pass over all blocks.
//!
//! Every phase is a parallel loop over blocks that writes only what belongs to the block, and every sum
//! over blocks is taken in the order of the blocks, so a run does not depend on the number of threads.

use super::cloud::{Cloud, ScatterCloud, spline};
use super::grid::{BLOCK, Grid, Nodes, Tile, home};
use super::lanes::Isa;
use super::particles::{Bin, Particle};
use super::scheme::Scheme;
use super::transfer::{Exchange, Gather, Gathered, Scatter, Update};
use crate::elastomer::settings::Base;
use crate::pose::Pose;
use rayon::prelude::*;

/// Space around the pad into which its material may move, mm, as a part of its thickness.
const MARGIN_PER_THICKNESS: f64 = 1.0;
/// Layers of particles that the bonded base pins (the predecessor's number).
const BONDED_LAYERS: usize = 3;

/// What stopped a pass: the first offending particle and what was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Index in the undeformed lattice.
    pub particle: usize,
    /// What was seen.
    pub what: String,
}

/// The pad.
#[derive(Debug, Clone)]
pub struct Body {
    /// Its numbers.
    pub scheme: Scheme,
    /// How its base is held.
    pub base: Base,
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// Where the grid lies.
    pub grid: Grid,
    /// Particles of each active block.
    pub bins: Vec<Bin>,
    tiles: Vec<Tile>,
    nodes: Vec<Nodes>,
    cloud_tiles: Vec<Option<Box<Tile>>>,
    /// Momentum that the base gave in the last gather, solver's units.
    pub base_impulse: [f64; 3],
}

impl Body {
    /// The undeformed pad at rest.
    pub fn new(scheme: Scheme, base: Base, isa: Isa) -> Self {
        let [nx, ny, nz] = scheme.particles;
        let held_layers = match base {
            Base::BondedLayers => BONDED_LAYERS,
            Base::LowerHalfVz => nz / 2,
        };
        let particles = (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| (i, j, k))));
        let placed = particles
            .enumerate()
            .map(|(id, (i, j, k))| (scheme.rest_position_mm(i, j, k), id as u32, k < held_layers));
        Self::with_particles(scheme.clone(), base, isa, placed)
    }

    /// Any cloud of undeformed particles at rest: position in mm, index, and whether the base holds it.
    pub fn with_particles(
        scheme: Scheme,
        base: Base,
        isa: Isa,
        particles: impl Iterator<Item = ([f64; 3], u32, bool)>,
    ) -> Self {
        let margin = MARGIN_PER_THICKNESS * scheme.size_mm[2] + 2.0 * BLOCK as f64 * scheme.dx_mm;
        let [x, y, z] = scheme.size_mm;
        let lower = [-x / 2.0 - margin, -y / 2.0 - margin, -z - margin];
        let upper = [x / 2.0 + margin, y / 2.0 + margin, margin];
        let grid = Grid::new(scheme.dx_mm, lower, upper);
        let mut body = Self {
            scheme,
            base,
            isa,
            grid,
            bins: Vec::new(),
            tiles: Vec::new(),
            nodes: Vec::new(),
            cloud_tiles: Vec::new(),
            base_impulse: [0.0; 3],
        };
        let all: Vec<Particle> = particles
            .map(|(x_mm, id, held)| {
                let (cell, offset) = body.grid.locate(x_mm);
                Particle { offset, velocity: [0.0; 3], affine: [0.0; 9], strain: [0.0; 9], id, held, cell }
            })
            .collect();
        let mut blocks: Vec<[i32; 3]> = all.iter().map(|p| home(p.cell).0).collect();
        blocks.sort_unstable();
        blocks.dedup();
        body.grid.activate(blocks.into_iter());
        body.bins = vec![Bin::default(); body.grid.places.len()];
        body.allocate();
        for p in all {
            let (block, node) = home(p.cell);
            let slot = body.grid.slot(block).expect("the block of every particle was activated");
            body.bins[slot].push(&p, node);
        }
        body
    }

    fn allocate(&mut self) {
        let n = self.grid.places.len();
        self.tiles.resize_with(n, Tile::zero);
        self.nodes.resize_with(n, Nodes::zero);
        self.cloud_tiles.clear();
        self.cloud_tiles.resize_with(n, || None);
    }

    /// How many particles.
    pub fn len(&self) -> usize {
        self.bins.iter().map(Bin::len).sum()
    }

    /// Bytes in use for particles, and for tiles and nodes.
    pub fn memory_bytes(&self) -> (usize, usize) {
        let batches: usize = self.bins.iter().map(|b| b.batches.capacity()).sum();
        let places = self.grid.places.len();
        (
            batches * size_of::<super::particles::Batch>(),
            places * (size_of::<Tile>() + size_of::<Nodes>() + size_of::<super::grid::Place>()),
        )
    }

    /// Puts the indenter's momentum on the grid; it stays there for every pass of a step.
    pub fn scatter_cloud(&mut self, cloud: &Cloud, from: &Pose, to: &Pose) {
        let (grid, isa) = (&self.grid, self.isa);
        self.cloud_tiles.par_iter_mut().zip(&grid.places).for_each(|(tile, place)| {
            isa.run(ScatterCloud {
                cloud,
                from,
                to,
                lower_mm: grid.lower_mm,
                dx_mm: grid.dx_mm,
                origin: place.origin(),
                tile,
            });
        });
    }

    /// Takes the indenter's momentum off the grid.
    pub fn clear_cloud(&mut self) {
        self.cloud_tiles.fill(None);
    }

    /// Particles to grid, and grid momentum to velocity. Returns what the indenter gave.
    pub fn to_grid(&mut self) -> Result<Exchange, Fault> {
        let (isa, law, moduli) = (self.isa, self.scheme.law, self.scheme.scaled_moduli());
        let crushed: Vec<Option<u32>> = self
            .bins
            .par_iter()
            .zip(&mut self.tiles)
            .map(
                |(bin, tile)| if bin.is_empty() { None } else { isa.run(Scatter { bin, tile, law, moduli }) },
            )
            .collect();
        if let Some(particle) = crushed.into_iter().flatten().min() {
            let what =
                "the volume of a particle is no longer positive (det F <= 0 or not a number)".to_owned();
            return Err(Fault { particle: particle as usize, what });
        }
        let (grid, tiles, bins, indenter) = (&self.grid, &self.tiles, &self.bins, &self.cloud_tiles);
        let parts: Vec<Exchange> = self
            .nodes
            .par_iter_mut()
            .zip(&grid.places)
            .map(|(nodes, place)| {
                let origin = place.origin();
                let first_node =
                    std::array::from_fn(|d| grid.lower_mm[d] / grid.dx_mm + f64::from(origin[d]));
                isa.run(Update { place, tiles, bins, indenter, first_node, nodes })
            })
            .collect();
        let mut sum = Exchange::default();
        for part in parts {
            sum.touched |= part.touched;
            sum.torque += part.torque;
            for d in 0..3 {
                sum.impulse[d] += part.impulse[d];
            }
        }
        Ok(sum)
    }

    /// Grid to particles; with `advance` the particles move on and find their new cells.
    pub fn to_particles(&mut self, advance: bool) -> Result<(), Fault> {
        let (isa, base, nodes) = (self.isa, self.base, &self.nodes);
        let reports: Vec<Gathered> = self
            .bins
            .par_iter_mut()
            .zip(&self.grid.places)
            .map(|(bin, place)| {
                if bin.is_empty() {
                    Gathered::default()
                } else {
                    isa.run(Gather { place, nodes, bin, base, advance })
                }
            })
            .collect();
        if let Some(particle) = reports.iter().filter_map(|r| r.runaway).min() {
            let what =
                "a particle moved a cell or more in one step, or its velocity is not a number".to_owned();
            return Err(Fault { particle: particle as usize, what });
        }
        self.base_impulse = [0.0; 3];
        for r in &reports {
            for d in 0..3 {
                self.base_impulse[d] += r.base_impulse[d];
            }
        }
        self.move_in(reports)
    }

    /// Gives the particles that left a block to the block they came to.
    fn move_in(&mut self, reports: Vec<Gathered>) -> Result<(), Fault> {
        let mut changed = false;
        for (slot, report) in reports.iter().enumerate() {
            changed |= !report.leavers.is_empty() && self.bins[slot].is_empty();
            for p in &report.leavers {
                let (block, node) = home(p.cell);
                if !self.grid.encloses(block) {
                    let what = "a particle left the space around the pad".to_owned();
                    return Err(Fault { particle: p.id as usize, what });
                }
                let slot = self
                    .grid
                    .slot(block)
                    .expect("a particle moves less than a block, and neighbours are active");
                changed |= self.bins[slot].is_empty();
                self.bins[slot].push(p, node);
            }
        }
        if changed {
            let old = std::mem::take(&mut self.grid.places);
            let full: Vec<([i32; 3], Bin)> = old
                .into_iter()
                .zip(std::mem::take(&mut self.bins))
                .filter(|(_, bin)| !bin.is_empty())
                .map(|(place, bin)| (place.block, bin))
                .collect();
            self.grid.activate(full.iter().map(|(block, _)| *block));
            self.bins = vec![Bin::default(); self.grid.places.len()];
            for (block, bin) in full {
                let slot = self.grid.slot(block).expect("just activated");
                self.bins[slot] = bin;
            }
            self.allocate();
        }
        Ok(())
    }

    /// Velocity of the grid at a place, cells per step: what a particle there is about to get.
    pub fn grid_velocity(&self, cell: [i32; 3], offset: [f32; 3]) -> [f64; 3] {
        let w = offset.map(spline);
        let mut v = [0.0; 3];
        for n in 0..27usize {
            let (i, j, k) = (n % 3, n / 3 % 3, n / 9);
            let node = [cell[0] + i as i32, cell[1] + j as i32, cell[2] + k as i32];
            let side = BLOCK as i32;
            if let Some(slot) = self.grid.slot(node.map(|x| x.div_euclid(side))) {
                let [x, y, z] = node.map(|x| x.rem_euclid(side) as usize);
                let row = &self.nodes[slot].0[z * BLOCK + y].0;
                let weight = f64::from(w[0][i] * w[1][j] * w[2][k]);
                for d in 0..3 {
                    v[d] += weight * f64::from(row[4 * x + d]);
                }
            }
        }
        v
    }

    /// The particle nearest to a point, within one block of it.
    pub fn nearest(&self, x_mm: [f64; 3]) -> Option<Particle> {
        let (cell, _) = self.grid.locate(x_mm);
        let (block, _) = home(cell);
        let mut best: Option<(f64, Particle)> = None;
        for n in 0..27 {
            let near = [block[0] + n % 3 - 1, block[1] + n / 3 % 3 - 1, block[2] + n / 9 - 1];
            let Some(slot) = self.grid.slot(near) else { continue };
            for p in self.bins[slot].iter(self.grid.places[slot].origin()) {
                let y = self.grid.position_mm(p.cell, p.offset);
                let d: f64 = (0..3).map(|d| (y[d] - x_mm[d]).powi(2)).sum();
                if best.is_none_or(|(least, q)| d < least || d == least && p.id < q.id) {
                    best = Some((d, p));
                }
            }
        }
        best.map(|(_, p)| p)
    }

    /// Every particle, block by block.
    pub fn particles(&self) -> impl Iterator<Item = Particle> + '_ {
        self.bins.iter().zip(&self.grid.places).flat_map(|(bin, place)| bin.iter(place.origin()))
    }

    /// Blocks with their first cells, for sums over particles in parallel.
    pub fn blocks(&self) -> impl IndexedParallelIterator<Item = (&Bin, [i32; 3])> {
        self.bins.par_iter().zip(&self.grid.places).map(|(bin, place)| (bin, place.origin()))
    }
}
