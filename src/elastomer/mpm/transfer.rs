//! The three transfers of a pass, as kernels over one block: particles to grid, grid, grid to particles.
//!
//! MLS-MPM (Hu et al. 2018) with quadratic B-splines, equations (1) to (7) of the paper as corrected: the
//! affine velocity is taken from the grid's velocities, and the particle's mass stands in the
//! affine momentum. In the solver's units (cell, step, particle mass):
//!
//! - to grid: m_g += w, p_g += w (v + (C - tau) (x_g - x_p)), tau scaled by 4 dt^2 / (rho dx^2);
//! - grid: v_g = p_g / m_g;
//! - to particles: v = sum w v_g, C = 4 sum w v_g (x_g - x_p)^T, then x += v and F += C F.
//!
//! One register holds four nodes along x of four components (x, y, z, mass), so the stencil is nine
//! registers. Everything per particle that is not the stencil itself runs sixteen particles at a time; a
//! 16 x 16 transpose leads from one layout to the other.

use super::grid::{BLOCK, NONE, Nodes, Place, TILE_LAYER, TILE_ROW, TILE_SIDE, Tile};
use super::lanes::{Kernel, Lanes, Row, WIDTH};
use super::particles::{Bin, Particle, tile_position};
use super::stress::{Moduli, kirchhoff};
use crate::elastomer::Law;
use crate::elastomer::settings::Base;

/// A node slower than this (cells per step) stands still, and a strain smaller than this is none. Ahead of
/// a wave both fall off by decades from cell to cell; their products would be subnormal numbers, on which
/// many processors are a hundred times slower. Even the cube of the least strain is a normal number.
const STILL: f32 = 1e-15;
const UNSTRAINED: f32 = 1e-12;

/// Lane patterns of the B-spline along x: node i = lane / 4, weight c (f - r)^2 + a, distance i - f.
struct Spline<L> {
    c: L,
    r: L,
    a: L,
    i_less_r: L,
}

/// Repeats one value per node over its four components.
const fn per_node(v: [f32; 4]) -> Row {
    let mut row = [0.0; WIDTH];
    let mut i = 0;
    while i < WIDTH {
        row[i] = v[i / 4];
        i += 1;
    }
    Row(row)
}

// The fourth node has no weight. Written as squares, no weight is ever negative.
const SPLINE_C: Row = per_node([0.5, -1.0, 0.5, 0.0]);
const SPLINE_R: Row = per_node([1.5, 1.0, 0.5, 0.0]);
const SPLINE_A: Row = per_node([0.0, 0.75, 0.0, 0.0]);
const SPLINE_I_LESS_R: Row = per_node([-1.5, 0.0, 1.5, 3.0]);

impl<L: Lanes> Spline<L> {
    #[inline(always)]
    fn new() -> Self {
        Self {
            c: L::load(&SPLINE_C),
            r: L::load(&SPLINE_R),
            a: L::load(&SPLINE_A),
            i_less_r: L::load(&SPLINE_I_LESS_R),
        }
    }

    /// Weights and distances of the four nodes along x from an offset.
    #[inline(always)]
    fn at(&self, offset: f32) -> (L, L) {
        let t = L::fill(offset) - self.r;
        ((self.c * t).mul_add(t, self.a), self.i_less_r - t)
    }
}

/// For sixteen particles: weights along y and z, and weights times distance.
struct Weights {
    y: [Row; 3],
    y_dy: [Row; 3],
    z: [Row; 3],
    z_dz: [Row; 3],
}

impl Weights {
    #[inline(always)]
    fn new<L: Lanes>(offset_y: &Row, offset_z: &Row) -> Self {
        let mut out =
            Weights { y: [Row::ZERO; 3], y_dy: [Row::ZERO; 3], z: [Row::ZERO; 3], z_dz: [Row::ZERO; 3] };
        weights_along::<L>(offset_y, &mut out.y, &mut out.y_dy);
        weights_along::<L>(offset_z, &mut out.z, &mut out.z_dz);
        out
    }
}

/// Weights of the three nodes along one axis, and the same times the distance to the node.
// A function, not a closure: closures are not inlined into kernels and then lose the instruction set.
#[inline(always)]
fn weights_along<L: Lanes>(offset: &Row, weight: &mut [Row; 3], moment: &mut [Row; 3]) {
    let f = L::load(offset);
    let (lo, mid, hi) = (L::fill(1.5) - f, f - L::fill(1.0), f - L::fill(0.5));
    let half = L::fill(0.5);
    let w = [half * lo * lo, L::fill(0.75) - mid * mid, half * hi * hi];
    for i in 0..3 {
        w[i].store(&mut weight[i]);
        (w[i] * (L::fill(i as f32) - f)).store(&mut moment[i]);
    }
}

/// Particles of one block to its tile. Returns the first particle whose volume is not positive.
pub struct Scatter<'a> {
    /// The block's particles.
    pub bin: &'a Bin,
    /// Where they go; cleared first.
    pub tile: &'a mut Tile,
    /// Constitutive law.
    pub law: Law,
    /// Lame parameters times 4 dt^2 / (rho dx^2).
    pub moduli: Moduli<f32>,
}

impl Kernel for Scatter<'_> {
    type Output = Option<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<u32> {
        let spline = Spline::<L>::new();
        let moduli = Moduli { mu: L::fill(self.moduli.mu), lambda: L::fill(self.moduli.lambda) };
        let mut crushed = None;
        self.tile.0.fill(Row::ZERO);
        for batch in &self.bin.batches {
            // Stress, sixteen particles at a time.
            let h: [L; 9] = std::array::from_fn(|k| L::load(&batch.strain[k]));
            let (tau, det) = kirchhoff(self.law, &h, moduli);
            let used = u16::MAX >> (WIDTH - batch.len as usize);
            let bad = !L::fill(0.0).less(det) & used;
            if bad != 0 && crushed.is_none() {
                crushed = Some(batch.id[bad.trailing_zeros() as usize]);
            }
            let c = |k: usize| L::load(&batch.affine[k]);
            let zero = L::fill(0.0);
            // Velocity and mass, then the columns of C - tau.
            let mut rows = [
                L::load(&batch.velocity[0]),
                L::load(&batch.velocity[1]),
                L::load(&batch.velocity[2]),
                L::fill(1.0),
                c(0) - tau[0],
                c(3) - tau[3],
                c(6) - tau[5],
                zero,
                c(1) - tau[3],
                c(4) - tau[1],
                c(7) - tau[4],
                zero,
                c(2) - tau[5],
                c(5) - tau[4],
                c(8) - tau[2],
                zero,
            ];
            L::transpose(&mut rows);
            let mut momentum = [Row::ZERO; WIDTH];
            for i in 0..WIDTH {
                rows[i].store(&mut momentum[i]);
            }
            let weights = Weights::new::<L>(&batch.offset[1], &batch.offset[2]);
            // The stencil, one particle at a time.
            for i in 0..batch.len as usize {
                let (w, d) = spline.at(batch.offset[0].0[i]);
                let m = &momentum[i];
                let at_rest = w * d.mul_add(L::repeat_group::<1>(m), L::repeat_group::<0>(m));
                let along_y = w * L::repeat_group::<2>(m);
                let along_z = w * L::repeat_group::<3>(m);
                let wz: [L; 3] = std::array::from_fn(|k| L::fill(weights.z[k].0[i]));
                let wz_dz: [L; 3] = std::array::from_fn(|k| L::fill(weights.z_dz[k].0[i]));
                let base = batch.node[i] as usize;
                // One check for the whole stencil.
                let to = self.tile.at_mut(base + 2 * TILE_LAYER + 2 * TILE_ROW);
                for j in 0..3 {
                    let wy = L::fill(weights.y[j].0[i]);
                    let a = at_rest.mul_add(wy, along_y * L::fill(weights.y_dy[j].0[i]));
                    let b = along_z * wy;
                    for k in 0..3 {
                        // SAFETY: `to` is the last row of the stencil; the others lie before it in the tile.
                        unsafe {
                            let node = to.sub(((2 - k) * TILE_LAYER + (2 - j) * TILE_ROW) * 4);
                            a.mul_add(wz[k], b.mul_add(wz_dz[k], L::read(node))).write(node);
                        }
                    }
                }
            }
        }
        crushed
    }
}

/// Momentum handed from the indenter to the grid in one pass, in the solver's units.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exchange {
    /// Momentum given to the pad.
    pub impulse: [f64; 3],
    /// Its moment about the z axis through the pad frame's origin.
    pub torque: f64,
    /// Whether a node felt both the pad and the indenter.
    pub touched: bool,
}

/// Sums a block's nodes from the tiles that reach into it and turns momentum into velocity.
pub struct Update<'a> {
    /// The block.
    pub place: &'a Place,
    /// The pad's tiles; those of empty blocks hold nothing of use.
    pub tiles: &'a [Tile],
    /// Which blocks hold particles.
    pub bins: &'a [Bin],
    /// The indenter's tiles of this step.
    pub indenter: &'a [Option<Box<Tile>>],
    /// Position of the block's first node from the pad frame's origin, cells.
    pub first_node: [f64; 3],
    /// Result.
    pub nodes: &'a mut Nodes,
}

/// Adds to `sum` what neighbour `n`'s tile holds of this block's nodes.
#[inline(always)]
fn add_tile<L: Lanes>(sum: &mut [L; BLOCK * BLOCK], n: usize, tile: &Tile) {
    let reach = |bit: usize| if n >> bit & 1 == 1 { (BLOCK, TILE_SIDE - BLOCK) } else { (0, BLOCK) };
    let ((x, _), (y, ny), (z, nz)) = (reach(0), reach(1), reach(2));
    for k in 0..nz {
        for j in 0..ny {
            // SAFETY: `at` checked that four nodes can be read.
            let row = unsafe { L::read(tile.at((k + z) * TILE_LAYER + (j + y) * TILE_ROW + x)) };
            // Of a lower neighbour along x only the two nodes of the rim are this block's.
            let row = if x > 0 { row.keep(0x00ff) } else { row };
            sum[k * BLOCK + j] = sum[k * BLOCK + j] + row;
        }
    }
}

impl Kernel for Update<'_> {
    type Output = Exchange;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Exchange {
        let mut exchange = Exchange::default();
        let mut sum = [L::fill(0.0); BLOCK * BLOCK];
        let mut any = false;
        for (n, &slot) in self.place.lower.iter().enumerate() {
            if slot != NONE && !self.bins[slot as usize].is_empty() {
                any = true;
                add_tile(&mut sum, n, &self.tiles[slot as usize]);
            }
        }
        if !any {
            return exchange;
        }
        let mut foreign = [L::fill(0.0); BLOCK * BLOCK];
        let mut meets = false;
        for (n, &slot) in self.place.lower.iter().enumerate() {
            if slot != NONE
                && let Some(tile) = &self.indenter[slot as usize]
            {
                meets = true;
                add_tile(&mut foreign, n, tile);
            }
        }
        // Nodes that nothing reached keep velocity zero: their momentum is zero, too.
        let least = L::fill(f32::MIN_POSITIVE);
        for r in 0..BLOCK * BLOCK {
            let total = if meets { sum[r] + foreign[r] } else { sum[r] };
            let mut row = Row::ZERO;
            total.store(&mut row);
            let mass = L::load(&per_node_of(&row));
            let v = total.over(mass.larger(least));
            v.keep(L::fill(STILL).less(v.larger(-v))).store(&mut self.nodes.0[r]);
        }
        if meets {
            for r in 0..BLOCK * BLOCK {
                let mut before = Row::ZERO;
                let mut pad = Row::ZERO;
                foreign[r].store(&mut before);
                sum[r].store(&mut pad);
                let after = &self.nodes.0[r].0;
                for i in 0..BLOCK {
                    let mass = f64::from(before.0[4 * i + 3]);
                    if mass == 0.0 || pad.0[4 * i + 3] == 0.0 {
                        continue;
                    }
                    exchange.touched = true;
                    let given: [f64; 3] = std::array::from_fn(|d| {
                        f64::from(before.0[4 * i + d]) - mass * f64::from(after[4 * i + d])
                    });
                    let x = self.first_node[0] + i as f64;
                    let y = self.first_node[1] + (r % BLOCK) as f64;
                    for d in 0..3 {
                        exchange.impulse[d] += given[d];
                    }
                    exchange.torque += x * given[1] - y * given[0];
                }
            }
        }
        exchange
    }
}

/// The mass of each node in all its four components.
#[inline(always)]
fn per_node_of(row: &Row) -> Row {
    Row(std::array::from_fn(|i| row.0[i / 4 * 4 + 3]))
}

/// What a block reports after its particles were updated.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gathered {
    /// Momentum that the base gave to the particles it holds.
    pub base_impulse: [f64; 3],
    /// First particle that moved a cell or more in the step, or is not a number.
    pub runaway: Option<u32>,
    /// Particles that left the block, taken out of it.
    pub leavers: Vec<Particle>,
}

/// Grid to the particles of one block.
pub struct Gather<'a> {
    /// The block.
    pub place: &'a Place,
    /// Nodes of every active block.
    pub nodes: &'a [Nodes],
    /// The block's particles.
    pub bin: &'a mut Bin,
    /// How held particles are held.
    pub base: Base,
    /// Whether x and F move on; otherwise only v and C change (a pass of the relative-rest loop).
    pub advance: bool,
}

impl Gather<'_> {
    /// Copies the nodes that this block's particles touch into one tile.
    #[inline(always)]
    fn load_tile<L: Lanes>(&self, tile: &mut Tile) {
        // Neighbours along x first: a row of four reaches two nodes into the next row, which is written later.
        for n in [1, 3, 5, 7, 0, 2, 4, 6] {
            let from = &self.nodes[self.place.upper[n] as usize];
            let reach = |bit: usize| if n >> bit & 1 == 1 { (BLOCK, TILE_SIDE - BLOCK) } else { (0, BLOCK) };
            let ((x, _), (y, ny), (z, nz)) = (reach(0), reach(1), reach(2));
            for k in 0..nz {
                for j in 0..ny {
                    let to = tile.at_mut((k + z) * TILE_LAYER + (j + y) * TILE_ROW + x);
                    // SAFETY: `at_mut` checked that four nodes can be written.
                    unsafe { L::load(&from.0[k * BLOCK + j]).write(to) };
                }
            }
        }
    }
}

impl Kernel for Gather<'_> {
    type Output = Gathered;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Gathered {
        let mut out = Gathered::default();
        let mut tile = Tile::zero();
        self.load_tile::<L>(&mut tile);
        let spline = Spline::<L>::new();
        let mut leaving: Vec<(usize, [i32; 3])> = Vec::new();
        for (b, batch) in self.bin.batches.iter_mut().enumerate() {
            let weights = Weights::new::<L>(&batch.offset[1], &batch.offset[2]);
            let mut rows = [L::fill(0.0); WIDTH];
            // The stencil, one particle at a time: velocity and the three columns of C.
            let mut gathered = [Row::ZERO; WIDTH];
            for i in 0..batch.len as usize {
                let (w, d) = spline.at(batch.offset[0].0[i]);
                let wz: [L; 3] = std::array::from_fn(|k| L::fill(weights.z[k].0[i]));
                let wz_dz: [L; 3] = std::array::from_fn(|k| L::fill(weights.z_dz[k].0[i]));
                let from = tile.at(batch.node[i] as usize + 2 * TILE_LAYER + 2 * TILE_ROW);
                let (mut sum, mut on_y, mut on_z) = (L::fill(0.0), L::fill(0.0), L::fill(0.0));
                for j in 0..3 {
                    let node = |k: usize| {
                        // SAFETY: `from` is the last row of the stencil; the others lie before it in the tile.
                        unsafe { L::read(from.sub(((2 - k) * TILE_LAYER + (2 - j) * TILE_ROW) * 4)) }
                    };
                    let (n0, n1, n2) = (node(0), node(1), node(2));
                    let plain = n2.mul_add(wz[2], n1.mul_add(wz[1], n0 * wz[0]));
                    let moment = n2.mul_add(wz_dz[2], n1.mul_add(wz_dz[1], n0 * wz_dz[0]));
                    let wy = L::fill(weights.y[j].0[i]);
                    sum = plain.mul_add(wy, sum);
                    on_y = plain.mul_add(L::fill(weights.y_dy[j].0[i]), on_y);
                    on_z = moment.mul_add(wy, on_z);
                }
                let weighted = w * sum;
                L::sum_groups(weighted, weighted * d, w * on_y, w * on_z).store(&mut gathered[i]);
            }
            for i in 0..WIDTH {
                rows[i] = L::load(&gathered[i]);
            }
            L::transpose(&mut rows);

            // Sixteen particles at a time from here on.
            let mut v = [rows[0], rows[1], rows[2]];
            let four = L::fill(4.0);
            let mut c: [L; 9] = std::array::from_fn(|k| four * rows[4 * (k % 3 + 1) + k / 3]);
            if batch.held != 0 {
                for d in 0..3 {
                    if self.base == Base::LowerHalfVz && d < 2 {
                        continue;
                    }
                    let mut row = Row::ZERO;
                    v[d].keep(batch.held).store(&mut row);
                    out.base_impulse[d] -= row.0.iter().map(|&x| f64::from(x)).sum::<f64>();
                    v[d] = v[d].keep(!batch.held);
                }
                if self.base == Base::BondedLayers {
                    for ck in &mut c {
                        *ck = ck.keep(!batch.held);
                    }
                }
            }
            for d in 0..3 {
                v[d].store(&mut batch.velocity[d]);
            }
            for k in 0..9 {
                c[k].store(&mut batch.affine[k]);
            }
            let used = u16::MAX >> (WIDTH - batch.len as usize);
            let one = L::fill(1.0);
            let sane = (0..3).fold(u16::MAX, |m, d| m & v[d].less(one) & (-v[d]).less(one));
            if !sane & used != 0 {
                let i = (!sane & used).trailing_zeros() as usize;
                out.runaway = out.runaway.or(Some(batch.id[i]));
                continue;
            }
            if !self.advance {
                continue;
            }
            let h: [L; 9] = std::array::from_fn(|k| L::load(&batch.strain[k]));
            for r in 0..3 {
                for s in 0..3 {
                    let ch = c[3 * r].mul_add(h[s], c[3 * r + 1].mul_add(h[3 + s], c[3 * r + 2] * h[6 + s]));
                    let moved = h[3 * r + s] + (c[3 * r + s] + ch);
                    let felt = L::fill(UNSTRAINED).less(moved.larger(-moved));
                    moved.keep(felt).store(&mut batch.strain[3 * r + s]);
                }
            }
            let mut crossed = 0;
            for d in 0..3 {
                let x = L::load(&batch.offset[d]) + v[d];
                crossed |= x.less(L::fill(0.5)) | L::fill(1.5).less(x);
                x.store(&mut batch.offset[d]);
            }
            // A few particles a step come into another cell, fewer into another block.
            let mut crossed = crossed & used;
            while crossed != 0 {
                let i = crossed.trailing_zeros() as usize;
                crossed &= crossed - 1;
                let mut at = tile_position(batch.node[i]).map(|x| x as i32);
                for (d, x) in at.iter_mut().enumerate() {
                    let f = &mut batch.offset[d].0[i];
                    let shift = i32::from(*f > 1.5) - i32::from(*f < 0.5);
                    *f -= shift as f32;
                    *x += shift;
                }
                if at.iter().all(|x| (0..BLOCK as i32).contains(x)) {
                    batch.node[i] =
                        (at[2] as usize * TILE_LAYER + at[1] as usize * TILE_ROW + at[0] as usize) as u32;
                } else {
                    leaving.push((b * WIDTH + i, at));
                }
            }
        }
        // From the last to the first, so that what takes a leaver's place stays.
        let origin = self.place.origin();
        for &(index, at) in leaving.iter().rev() {
            let mut p = self.bin.swap_remove(index, origin);
            p.cell = std::array::from_fn(|d| origin[d] + at[d]);
            out.leavers.push(p);
        }
        out
    }
}
