//! The pad as a body of particles on its grid, and the phases of a pass over all blocks.
//!
//! Every phase is a parallel loop over blocks that writes only what belongs to the block, and every sum
//! over blocks is taken in the order of the blocks, so a run does not depend on the number of threads.

use super::cloud::{Cloud, CloudStep, ScatterCloud};
use super::grid::{BLOCK, Grid, NONE, Nodes, Place, RIM, TILE, TILE_LAYER, Tile, home, tile_position};
use super::lanes::Isa;
use super::particles::{Bin, Moving, Particle};
use super::scheme::Scheme;
use super::spline::weights_of;
use super::transfer::{Arrive, Elastic, Next, Pass, Report};
use super::update::{Exchange, Summed, Update};
use crate::elastomer::settings::Base;
use crate::pose::Pose;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::ptr::null;

/// Space around the pad into which its material may move, as a part of its thickness.
const MARGIN_PER_THICKNESS: f64 = 1.0;
/// Layers of particles that the bonded base pins (the predecessor's number).
const BONDED_LAYERS: usize = 3;

/// What stopped a pass: the first offending particle and what was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Index in the undeformed lattice.
    pub particle: usize,
    /// What was seen.
    pub what: &'static str,
}

const RUNAWAY: &str = "a particle moved a cell or more in one step, or its velocity is not a number";
const CRUSHED: &str = "the volume of a particle is no longer positive (det F <= 0 or not a number)";
const ESCAPED: &str = "a particle left the space around the pad";

/// The pad. Between passes its velocity lives in the tiles.
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
    /// Mass and momentum that each block's particles put on the grid; none where there are no particles.
    tiles: Vec<Option<Box<Tile>>>,
    nodes: Vec<Nodes>,
    known: Vec<Known>,
    cloud_tiles: Vec<Option<Box<Tile>>>,
    /// Momentum that the base gave in the last pass, solver's units.
    pub base_impulse: [f64; 3],
    /// Sum of the particles' squared velocities in the last pass, cells per step.
    pub speed_squared: f64,
    /// Particles in the blocks that the last pass computed.
    pub computed: usize,
    /// Whether blocks at rest are computed all the same. Nothing but time comes of it: a block is passed over
    /// when what it sees is exactly zero and was in its last pass.
    pub rest_is_computed: bool,
}

/// What is known of a block's nodes.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    /// Whether they are the sums of the tiles as those are.
    summed: bool,
    /// Whether any of them moved when last summed.
    moving: bool,
    /// Whether the indenter was in the sums.
    met: bool,
}

/// How many layers of a block's cells, from the lowest, are below a node that the pad reaches: in the block or in those that its
/// tile reaches into.
fn layers_below_pad(place: &Place, places: &[Place], tiles: &[Option<Box<Tile>>]) -> usize {
    let reached = |upper: usize| {
        let place = &places[place.upper[upper] as usize];
        let from = |lower: usize| place.lower[lower] != NONE && tiles[place.lower[lower] as usize].is_some();
        let nodes = if (0..4).any(from) { BLOCK[2] } else { usize::from((4..8).any(from)) * RIM };
        if nodes == 0 { 0 } else { nodes + (upper >> 2) * BLOCK[2] }
    };
    let upper = (0..8).filter(|&n| place.upper[n] != NONE);
    upper.map(reached).max().unwrap_or(0).min(BLOCK[2])
}

/// The tile of a block is another than it was.
fn forget_sums(known: &mut [Known], place: &Place) {
    for &slot in place.upper.iter().filter(|&&slot| slot != NONE) {
        known[slot as usize].summed = false;
    }
}

impl Body {
    /// The undeformed pad at rest.
    pub fn new(scheme: Scheme, base: Base, isa: Isa) -> Self {
        let [nx, ny, nz] = scheme.particles;
        let held_layers = match base {
            Base::BondedLayers => BONDED_LAYERS,
            Base::LowerHalfVz => nz / 2,
        };
        let mut body = Self::empty(scheme, base, isa);
        let slab = |body: &Self, i: usize| -> Vec<Moving> {
            let lattice = (0..ny).flat_map(|j| (0..nz).map(move |k| (j, k)));
            lattice
                .map(|(j, k)| {
                    let id = ((k * ny + j) * nx + i) as u32;
                    body.at_rest(body.scheme.rest_position_mm(i, j, k), id, k < held_layers)
                })
                .collect()
        };
        // Slab by slab, so that the whole pad never exists twice.
        let mut blocks = BTreeSet::new();
        for i in 0..nx {
            blocks.extend(slab(&body, i).iter().map(|m| home(m.particle.cell).0));
        }
        body.activate(blocks.into_iter().map(|block| (block, Bin::default(), None)).collect());
        for i in 0..nx {
            let particles = slab(&body, i);
            body.put(&particles);
        }
        body.sort();
        body
    }

    /// Puts the particles of each block in the order of their cells: those of one cell share a stencil, which stays in registers.
    /// Columns along z, for cells beside each other there share rows of the grid exactly or not at all; along x rows would overlap in
    /// part, and a load that overlaps a recent store in part has to wait for it.
    fn sort(&mut self) {
        for (bin, place) in self.bins.iter_mut().zip(&self.grid.places) {
            let origin = place.origin();
            let mut particles: Vec<Particle> = bin.iter(origin).collect();
            particles.sort_by_key(|p| (p.cell, p.id));
            *bin = Bin::default();
            particles.iter().for_each(|p| bin.push(p, home(p.cell).1));
        }
    }

    /// Space for a body without particles.
    pub fn empty(scheme: Scheme, base: Base, isa: Isa) -> Self {
        let widest = BLOCK.iter().copied().max().unwrap_or(1) as f64;
        let margin = MARGIN_PER_THICKNESS * scheme.size_mm[2] + 2.0 * widest * scheme.dx_mm;
        let [x, y, z] = scheme.size_mm;
        let lower = [-x / 2.0 - margin, -y / 2.0 - margin, -z - margin];
        let upper = [x / 2.0 + margin, y / 2.0 + margin, margin];
        Self {
            grid: Grid::new(scheme.dx_mm, lower, upper),
            scheme,
            base,
            isa,
            bins: Vec::new(),
            tiles: Vec::new(),
            nodes: Vec::new(),
            known: Vec::new(),
            cloud_tiles: Vec::new(),
            base_impulse: [0.0; 3],
            speed_squared: 0.0,
            computed: 0,
            rest_is_computed: false,
        }
    }

    /// An undeformed particle at rest.
    pub fn at_rest(&self, x_mm: [f64; 3], id: u32, held: bool) -> Moving {
        let (cell, offset) = self.grid.locate(x_mm);
        let particle = Particle { offset, strain: [0.0; 9], id, held, cell };
        Moving { particle, velocity: [0.0; 3], affine: [0.0; 9] }
    }

    /// Puts the first particles into an empty body.
    pub fn fill(&mut self, particles: &[Moving]) {
        let blocks: BTreeSet<[i32; 3]> = particles.iter().map(|m| home(m.particle.cell).0).collect();
        self.activate(blocks.into_iter().map(|block| (block, Bin::default(), None)).collect());
        self.put(particles);
    }

    /// Adds undeformed particles to blocks that are active.
    fn put(&mut self, particles: &[Moving]) {
        let mut arrivals: BTreeMap<usize, Vec<(Moving, u16)>> = BTreeMap::new();
        for m in particles {
            let (block, node) = home(m.particle.cell);
            let slot = self.grid.slot(block).expect("the block of every particle was activated");
            self.bins[slot].push(&m.particle, node);
            arrivals.entry(slot).or_default().push((*m, node));
        }
        // An undeformed particle always has a volume.
        let _ = self.arrive(&arrivals);
    }

    /// Makes these blocks the occupied ones.
    fn activate(&mut self, full: Vec<([i32; 3], Bin, Option<Box<Tile>>)>) {
        self.grid.activate(full.iter().map(|(block, ..)| *block));
        let n = self.grid.places.len();
        self.bins = vec![Bin::default(); n];
        self.tiles = vec![None; n];
        for (block, bin, tile) in full {
            let slot = self.grid.slot(block).expect("just activated");
            self.bins[slot] = bin;
            self.tiles[slot] = tile;
        }
        self.nodes.resize_with(n, Nodes::zero);
        self.known = vec![Known::default(); n];
        self.cloud_tiles.clear();
        self.cloud_tiles.resize_with(n, || None);
    }

    fn elastic(&self) -> Elastic {
        Elastic { law: self.scheme.law, moduli: self.scheme.scaled_moduli() }
    }

    /// How many particles.
    pub fn len(&self) -> usize {
        self.bins.iter().map(Bin::len).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bins.iter().all(Bin::is_empty)
    }

    /// Bytes in use for particles, and for tiles and nodes.
    pub fn memory_bytes(&self) -> (usize, usize) {
        let batches: usize = self.bins.iter().map(|b| b.batches.capacity()).sum();
        let tiles = self.tiles.iter().chain(&self.cloud_tiles).flatten().count();
        let per_place = size_of::<Nodes>() + size_of::<Place>() + size_of::<Bin>();
        (
            batches * size_of::<super::particles::Batch>(),
            self.grid.places.len() * per_place + tiles * size_of::<Tile>(),
        )
    }

    /// Puts the indenter's momentum on the grid; it stays there for every pass of a step.
    pub fn scatter_cloud(&mut self, cloud: &Cloud, from: &Pose, to: &Pose) {
        let (grid, isa) = (&self.grid, self.isa);
        let step = CloudStep::new(cloud, from, to, grid.lower_mm, grid.dx_mm);
        let tiles = &self.tiles;
        self.cloud_tiles.par_iter_mut().zip(&grid.places).for_each(|(tile, place)| {
            let origin = place.origin();
            let layers = if step.reaches(origin) { layers_below_pad(place, &grid.places, tiles) } else { 0 };
            if layers == 0 {
                *tile = None;
            } else {
                isa.run(ScatterCloud { step: &step, origin, layers, tile });
            }
        });
    }

    /// Grid momentum to velocity. Returns what the indenter gave.
    pub fn update_grid(&mut self) -> Exchange {
        let (grid, tiles, indenter, isa) = (&self.grid, &self.tiles, &self.cloud_tiles, self.isa);
        let rest_is_computed = self.rest_is_computed;
        let parts: Vec<Exchange> = self
            .nodes
            .par_iter_mut()
            .zip(&mut self.known)
            .zip(&grid.places)
            .map(|((nodes, known), place)| {
                let met = place.lower.iter().any(|&slot| slot != NONE && indenter[slot as usize].is_some());
                if known.summed && !known.met && !met && !rest_is_computed {
                    return Exchange::default();
                }
                let origin = place.origin();
                let first_node =
                    std::array::from_fn(|d| grid.lower_mm[d] / grid.dx_mm + f64::from(origin[d]));
                let after = grid.places.get(place.lower[0] as usize + 1).map_or(NONE, |next| next.lower[4]);
                let below_next = tiles.get(after as usize).and_then(Option::as_deref);
                let update = Update { place, tiles, indenter, below_next, first_node, nodes };
                let Summed { exchange, moving } = isa.run(update);
                *known = Known { summed: true, moving, met };
                exchange
            })
            .collect();
        let mut sum = Exchange::default();
        for part in parts {
            sum.torque += part.torque;
            for d in 0..3 {
                sum.impulse[d] += part.impulse[d];
            }
        }
        sum
    }

    /// Grid to particles and back; with `advance` the particles move on and find their new cells.
    pub fn pass(&mut self, advance: bool) -> Result<(), Fault> {
        let (isa, base, elastic, nodes) = (self.isa, self.base, self.elastic(), &self.nodes);
        let next = |slot: usize| Next {
            tile: self.tiles.get(slot).and_then(Option::as_ref).map_or(null(), |t| t.0.as_ptr()),
            nodes: nodes.get(slot).map_or(null(), |n| n.0.as_ptr()),
            batches: self.bins.get(slot).map_or(null(), |bin| bin.batches.as_ptr().cast()),
        };
        let nexts: Vec<Next> = (0..self.bins.len()).map(|slot| next(slot + 1)).collect();
        let (known, rest_is_computed) = (&self.known, self.rest_is_computed);
        let reports: Vec<Option<Report>> = self
            .bins
            .par_iter_mut()
            .zip(&mut self.tiles)
            .zip(&self.grid.places)
            .zip(&nexts)
            .map_init(
                || Box::new(Tile::zero()),
                |velocities, (((bin, tile), place), &next)| {
                    let tile = tile.as_deref_mut()?;
                    let still = place.upper.iter().all(|&slot| slot == NONE || !known[slot as usize].moving);
                    if still && bin.still && !rest_is_computed {
                        return None;
                    }
                    let pass = Pass { place, nodes, bin, tile, velocities, next, elastic, base, advance };
                    let report = isa.run(pass);
                    bin.still = still;
                    Some(report)
                },
            )
            .collect();
        self.computed = 0;
        for (slot, report) in reports.iter().enumerate() {
            if let Some(report) = report {
                self.computed += self.bins[slot].len() + report.leavers.len();
                forget_sums(&mut self.known, &self.grid.places[slot]);
            }
        }
        let first = |which: fn(&Report) -> Option<u32>| reports.iter().flatten().filter_map(which).min();
        for (particle, what) in [(first(|r| r.runaway), RUNAWAY), (first(|r| r.crushed), CRUSHED)] {
            if let Some(particle) = particle {
                return Err(Fault { particle: particle as usize, what });
            }
        }
        self.base_impulse = [0.0; 3];
        self.speed_squared = 0.0;
        for r in reports.iter().flatten() {
            self.speed_squared += r.speed_squared;
            for d in 0..3 {
                self.base_impulse[d] += r.base_impulse[d];
            }
        }
        self.move_in(&reports)
    }

    /// Gives the particles that left a block to the block they came to.
    fn move_in(&mut self, reports: &[Option<Report>]) -> Result<(), Fault> {
        let mut changed = false;
        let mut arrivals: BTreeMap<usize, Vec<(Moving, u16)>> = BTreeMap::new();
        for (from, report) in reports.iter().enumerate() {
            for m in report.iter().flat_map(|report| &report.leavers) {
                let p = &m.particle;
                let (block, node) = home(p.cell);
                if !self.grid.encloses(block) {
                    return Err(Fault { particle: p.id as usize, what: ESCAPED });
                }
                let to = self
                    .grid
                    .slot(block)
                    .expect("a particle moves less than a block, and neighbours are active");
                self.bins[to].push(p, node);
                arrivals.entry(to).or_default().push((*m, node));
                changed |= self.tiles[to].is_none() || self.bins[from].is_empty();
            }
        }
        if let Some(particle) = self.arrive(&arrivals) {
            return Err(Fault { particle: particle as usize, what: CRUSHED });
        }
        if changed {
            let places = std::mem::take(&mut self.grid.places);
            let (bins, tiles) = (std::mem::take(&mut self.bins), std::mem::take(&mut self.tiles));
            let full = places.into_iter().zip(bins).zip(tiles).filter(|((_, bin), _)| !bin.is_empty());
            let full = full.map(|((place, bin), tile)| (place.block, bin, tile)).collect();
            self.activate(full);
        }
        Ok(())
    }

    /// Puts newcomers on the tiles of their blocks. Returns the first whose volume is not positive.
    fn arrive(&mut self, arrivals: &BTreeMap<usize, Vec<(Moving, u16)>>) -> Option<u32> {
        let (isa, elastic) = (self.isa, self.elastic());
        let mut crushed = None;
        for (&slot, arrivals) in arrivals {
            forget_sums(&mut self.known, &self.grid.places[slot]);
            let tile = self.tiles[slot].get_or_insert_with(|| Box::new(Tile::zero()));
            crushed = crushed.or(isa.run(Arrive { arrivals, tile, elastic }));
        }
        crushed
    }

    /// Total momentum and its moment about the pad frame's origin, solver's units.
    pub fn momentum(&self) -> ([f64; 3], [f64; 3]) {
        let (mut p, mut l) = ([0.0; 3], [0.0; 3]);
        for (tile, place) in self.tiles.iter().zip(&self.grid.places) {
            let Some(tile) = tile else { continue };
            for node in 0..TILE_LAYER * TILE[2] {
                let at = tile_position(node as u16);
                let q: [f64; 3] = std::array::from_fn(|d| f64::from(tile.0[node / 4].0[node % 4 * 4 + d]));
                let x: [f64; 3] = std::array::from_fn(|d| {
                    self.grid.lower_mm[d] / self.grid.dx_mm + f64::from(place.origin()[d] + at[d])
                });
                for d in 0..3 {
                    let (e, f) = ((d + 1) % 3, (d + 2) % 3);
                    p[d] += q[d];
                    l[d] += x[e] * q[f] - x[f] * q[e];
                }
            }
        }
        (p, l)
    }

    /// Velocity of the grid at a place, cells per step: what a particle there is about to get.
    pub fn grid_velocity(&self, cell: [i32; 3], offset: [f32; 3]) -> [f64; 3] {
        let w = offset.map(weights_of);
        let mut v = [0.0; 3];
        for n in 0..27usize {
            let at = [n % 3, n / 3 % 3, n / 9];
            let node: [i32; 3] = std::array::from_fn(|d| cell[d] + at[d] as i32);
            let block = std::array::from_fn(|d| node[d].div_euclid(BLOCK[d] as i32));
            if let Some(slot) = self.grid.slot(block) {
                let [x, y, z]: [usize; 3] =
                    std::array::from_fn(|d| node[d].rem_euclid(BLOCK[d] as i32) as usize);
                let row = &self.nodes[slot].0[z * BLOCK[1] + y].0;
                let weight = f64::from(w[0][at[0]] * w[1][at[1]] * w[2][at[2]]);
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
