//! A pass over one block: grid to particles, then the same particles back to the grid.
//!
//! MLS-MPM (Hu et al. 2018) with quadratic B-splines, equations (1) to (7) of the paper as corrected: the
//! affine velocity is taken from the grid's velocities, and the particle's mass stands in the
//! affine momentum. In the solver's units (cell, step, particle mass):
//!
//! - to particles: v = sum w v_g, C = 4 sum w v_g (x_g - x_p)^T, then x += v and F += C F;
//! - to grid: m_g += w, p_g += w (v + (C - tau) (x_g - x_p)), tau scaled by 4 dt^2 / (rho dx^2).
//!
//! Both directions are one kernel because everything between two grid states is then in
//! registers: v and C are never stored, and a particle is read and written once a pass. What the paper calls a
//! step begins with particle to grid; here that part has been done at the end of the pass before.
//!
//! One register holds four nodes along x of four components (x, y, z, mass), so the stencil is nine
//! registers. Everything per particle that is not the stencil itself runs sixteen particles at a time; a
//! 16 x 16 transpose leads from one layout to the other.

use super::grid::{BLOCK, Nodes, Place, RIM, TILE, TILE_LAYER, Tile, tile_node, tile_position};
use super::lanes::{Kernel, Lanes, Pair, Row, WIDTH};
use super::particles::{Batch, Bin, Moving};
use super::spline::{AlongX, weights};
use super::stress::{Moduli, kirchhoff};
use crate::elastomer::Law;
use crate::elastomer::settings::Base;

/// A strain smaller than this is none. Ahead of a wave it falls off by decades from cell to cell; products
/// would be subnormal numbers, on which many processors are a hundred times slower. Even the cube
/// of this is a normal number.
const UNSTRAINED: f32 = 1e-12;

/// First node of the last row of a stencil, counted from its first.
const LAST_ROW: usize = 2 * TILE_LAYER + 2 * TILE[0];

/// The material in the kernels' units.
#[derive(Debug, Clone, Copy)]
pub struct Elastic {
    /// Constitutive law.
    pub law: Law,
    /// Lame parameters times 4 dt^2 / (rho dx^2).
    pub moduli: Moduli<f32>,
}

/// What a block reports after a pass.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    /// Momentum that the base gave to the particles it holds.
    pub base_impulse: [f64; 3],
    /// Sum of the squared velocities.
    pub speed_squared: f64,
    /// First particle that moved a cell or more in the step, or is not a number.
    pub runaway: Option<u32>,
    /// First particle whose volume is not positive.
    pub crushed: Option<u32>,
    /// Particles that left the block, taken out of it and not yet put on the grid.
    pub leavers: Vec<Moving>,
}

/// Grid to the particles of one block and back to its tile.
pub struct Pass<'a> {
    /// The block.
    pub place: &'a Place,
    /// Nodes of every active block.
    pub nodes: &'a [Nodes],
    /// The block's particles.
    pub bin: &'a mut Bin,
    /// Where their momentum goes; cleared first.
    pub tile: &'a mut Tile,
    /// Room for the velocities that they see; what it holds before and after means nothing.
    pub velocities: &'a mut Tile,
    /// What the next block begins with.
    pub next: Next,
    /// Material.
    pub elastic: Elastic,
    /// How held particles are held.
    pub base: Base,
    /// Whether x and F move on; otherwise only v and C change (a pass of the relative-rest loop).
    pub advance: bool,
}

/// Where the tile, the nodes and the particles of a block lie, for its memory to be asked for while another is at work. Any
/// address will do.
#[derive(Debug, Clone, Copy)]
pub struct Next {
    /// Its tile.
    pub tile: *const Row,
    /// Its nodes.
    pub nodes: *const Row,
    /// Its first batches.
    pub batches: *const Row,
}

impl Next {
    /// What is asked for with batch `b`, a line for each of its particles.
    #[inline(always)]
    fn part(self, b: usize) -> *const Row {
        const TILE_PARTS: usize = (size_of::<Tile>() / size_of::<Row>()).div_ceil(WIDTH);
        const NODE_PARTS: usize = (size_of::<Nodes>() / size_of::<Row>()).div_ceil(WIDTH);
        match b.checked_sub(TILE_PARTS) {
            None => self.tile.wrapping_add(WIDTH * b),
            Some(b) if b < NODE_PARTS => self.nodes.wrapping_add(WIDTH * b),
            Some(b) => self.batches.wrapping_add(WIDTH * (b - NODE_PARTS)),
        }
    }
}

// SAFETY: the addresses are never read through.
unsafe impl Send for Next {}
// SAFETY: as above.
unsafe impl Sync for Next {}

/// Copies the nodes that a block's particles touch into one tile.
#[inline(always)]
fn load_tile<L: Lanes>(place: &Place, nodes: &[Nodes], tile: &mut Tile) {
    // Neighbours along x first: a row of four reaches two nodes into the next row, which is written later.
    for n in [1, 3, 5, 7, 0, 2, 4, 6] {
        let from = &nodes[place.upper[n] as usize];
        let (x, _) = reach(n, 0);
        let (y, ny) = reach(n, 1);
        let (z, nz) = reach(n, 2);
        for k in 0..nz {
            for j in 0..ny {
                let to = tile.at_mut((k + z) * TILE_LAYER + (j + y) * TILE[0] + x);
                // SAFETY: `at_mut` checked that four nodes can be written.
                unsafe { L::load(&from.0[k * BLOCK[1] + j]).write(to) };
            }
        }
    }
}

/// Where neighbour `n` begins in a tile along axis `d`, and how many nodes it has there.
#[inline(always)]
fn reach(n: usize, d: usize) -> (usize, usize) {
    if n >> d & 1 == 1 { (BLOCK[d], RIM) } else { (0, BLOCK[d]) }
}

/// Row `r` of the nine of a stencil, those along y first, from where the last of them is.
#[inline(always)]
fn stencil_row<T>(last: *mut T, r: usize) -> *mut T {
    last.wrapping_sub(((2 - r / 3) * TILE_LAYER + (2 - r % 3) * TILE[0]) * 4)
}

/// Velocity and moments of one particle: `[v | first moment along x | along y | along z]`, four components each.
#[inline(always)]
fn gather_one<L: Lanes>(
    x: &AlongX<L>,
    offset: f32,
    wy: [f32; 3],
    wz: [f32; 3],
    row: impl Fn(usize) -> L,
) -> L {
    let [z0, z1, z2] = [L::fill(wz[0]), L::fill(wz[1]), L::fill(wz[2])];
    let mut rows = [L::fill(0.0); 3];
    let mut along_z = [L::fill(0.0); 3];
    for j in 0..3 {
        let [n0, n1, n2] = [row(j), row(3 + j), row(6 + j)];
        let t0 = n0 * z0;
        rows[j] = n1.mul_add(z1, n2.mul_add(z2, t0));
        along_z[j] = n2.mul_sub(z2, t0);
    }
    let [y0, y1, y2] = [L::fill(wy[0]), L::fill(wy[1]), L::fill(wy[2])];
    let t0 = rows[0] * y0;
    let sum = rows[1].mul_add(y1, rows[2].mul_add(y2, t0));
    let along_y = rows[2].mul_sub(y2, t0);
    let along_z = along_z[0].mul_add(y0, along_z[1].mul_add(y1, along_z[2] * y2));
    let w = x.weights(offset);
    L::moments(w * sum, w * along_y, w * along_z)
}

/// One particle's mass and momentum for its stencil: `add` takes a row, its value and the weight of that. `m` is `[momentum, mass |
/// A x | A y | A z]` at the middle node.
#[inline(always)]
fn scatter_one<L: Lanes>(
    x: &AlongX<L>,
    offset: f32,
    wyz: &[Row; 9],
    i: usize,
    m: &Row,
    mut add: impl FnMut(usize, L, L),
) {
    let w = x.weights(offset);
    let middle = w * x.step.mul_add(L::repeat_group::<1>(m), L::repeat_group::<0>(m));
    let along_y = w * L::repeat_group::<2>(m);
    let along_z = w * L::repeat_group::<3>(m);
    let rows = [middle - along_y, middle, middle + along_y];
    for j in 0..3 {
        let w = |k: usize| L::fill(wyz[3 * k + j].0[i]);
        add(j, rows[j] - along_z, w(0));
        add(3 + j, rows[j], w(1));
        add(6 + j, rows[j] + along_z, w(2));
    }
}

/// Motion of sixteen particles, component by component.
pub struct Motion {
    /// Cells per step.
    pub velocity: [Row; 3],
    /// Row by row, per step.
    pub affine: [Row; 9],
}

impl Motion {
    /// Rest.
    pub const NONE: Motion = Motion { velocity: [Row::ZERO; 3], affine: [Row::ZERO; 9] };
}

/// Rows on the way between the two layouts. Made once a block: to make them anew for every batch would cost as many
/// stores as the batch itself.
pub struct Between {
    /// Weights along y and z, or their products.
    weights: [Row; 9],
    /// What comes from the grid or goes to it, particle by particle.
    moments: [Row; WIDTH],
}

impl Between {
    /// Nothing.
    pub const EMPTY: Between = Between { weights: [Row::ZERO; 9], moments: [Row::ZERO; WIDTH] };
}

/// Subtracts the stress of twice sixteen particles from their C, which leaves the affine momentum.
/// Returns the lanes whose volume is not positive.
#[inline(always)]
fn add_stress<L: Lanes>(elastic: Elastic, strain: [&[Row; 9]; 2], affine: [&mut [Row; 9]; 2]) -> [u16; 2] {
    let mut h = [Pair(L::fill(0.0), L::fill(0.0)); 9];
    for k in 0..9 {
        h[k] = Pair(L::load(&strain[0][k]), L::load(&strain[1][k]));
    }
    let moduli = Moduli {
        mu: Pair(L::fill(elastic.moduli.mu), L::fill(elastic.moduli.mu)),
        lambda: Pair(L::fill(elastic.moduli.lambda), L::fill(elastic.moduli.lambda)),
    };
    let (tau, det) = kirchhoff(elastic.law, &h, moduli);
    let [first, second] = affine;
    for (k, s) in [0, 3, 5, 3, 1, 4, 5, 4, 2].into_iter().enumerate() {
        (L::load(&first[k]) - tau[s].0).store(&mut first[k]);
        (L::load(&second[k]) - tau[s].1).store(&mut second[k]);
    }
    let zero = L::fill(0.0);
    [!zero.less(det.0), !zero.less(det.1)]
}

/// Sixteen particles' way to the grid; only lanes of `lanes` are put there.
#[inline(always)]
pub fn scatter_batch<L: Lanes>(
    x: &AlongX<L>,
    motion: &Motion,
    offset: &[Row; 3],
    node: &[u16; WIDTH],
    lanes: u16,
    between: &mut Between,
    tile: &mut Tile,
) {
    let Between { weights: wyz, moments } = between;
    // Momentum as the middle node sees it: v - A g.
    let one = L::fill(1.0);
    let g = [L::load(&offset[0]) - one, L::load(&offset[1]) - one, L::load(&offset[2]) - one];
    let mut rows = [L::fill(0.0); WIDTH];
    for d in 0..3 {
        let a = [
            L::load(&motion.affine[3 * d]),
            L::load(&motion.affine[3 * d + 1]),
            L::load(&motion.affine[3 * d + 2]),
        ];
        let shift = a[0].mul_add(g[0], a[1].mul_add(g[1], a[2] * g[2]));
        rows[d] = L::load(&motion.velocity[d]) - shift;
        rows[4 + d] = a[0];
        rows[8 + d] = a[1];
        rows[12 + d] = a[2];
    }
    rows[3] = one;
    L::transpose(&mut rows);
    for i in 0..WIDTH {
        rows[i].store(&mut moments[i]);
    }
    let (wy, wz) = (weights(L::load(&offset[1])), weights(L::load(&offset[2])));
    for k in 0..3 {
        for j in 0..3 {
            (wy[j] * wz[k]).store(&mut wyz[3 * k + j]);
        }
    }
    let mut left = lanes;
    while left != 0 {
        let mut cell = node[left.trailing_zeros() as usize];
        let mut last = tile.at_mut(cell as usize + LAST_ROW);
        if !L::STENCIL_FITS {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            let row = |r: usize| stencil_row(last, r);
            // SAFETY: `last` is the last row of a stencil inside the tile; the others lie before it.
            let add = |r: usize, value: L, w: L| unsafe { value.mul_add(w, L::read(row(r))).write(row(r)) };
            scatter_one(x, offset[0].0[i], wyz, i, &moments[i], add);
            continue;
        }
        let mut stencil = [L::fill(0.0); 9];
        for r in 0..9 {
            // SAFETY: as above.
            stencil[r] = unsafe { L::read(stencil_row(last, r)) };
        }
        loop {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            let add = |r: usize, value: L, w: L| stencil[r] = value.mul_add(w, stencil[r]);
            scatter_one(x, offset[0].0[i], wyz, i, &moments[i], add);
            // Neighbours in a batch lie in one cell, as a rule, or in the one above: what they share of its stencil stays in
            // registers.
            let next = if left == 0 { break } else { node[left.trailing_zeros() as usize] };
            if next == cell {
                continue;
            }
            if next != cell + TILE_LAYER as u16 {
                break;
            }
            for r in 0..3 {
                // SAFETY: as above.
                unsafe { stencil[r].write(stencil_row(last, r)) };
            }
            cell = next;
            last = tile.at_mut(cell as usize + LAST_ROW);
            for r in 0..6 {
                stencil[r] = stencil[r + 3];
            }
            for r in 6..9 {
                // SAFETY: as above.
                stencil[r] = unsafe { L::read(stencil_row(last, r)) };
            }
        }
        for r in 0..9 {
            // SAFETY: as above.
            unsafe { stencil[r].write(stencil_row(last, r)) };
        }
    }
}

/// The kernel's state while it goes over the batches of a block.
struct Walk<'a, L> {
    x: AlongX<L>,
    place: &'a Place,
    velocities: &'a Tile,
    base: Base,
    advance: bool,
    next: Next,
    speed_squared: L,
    leaving: Vec<(usize, Moving)>,
    report: Report,
}

impl<L: Lanes> Walk<'_, L> {
    /// Grid to one batch: its motion, and with `advance` its new place and strain. Returns the lanes that stay in the
    /// block.
    #[inline(always)]
    fn receive(&mut self, b: usize, batch: &mut Batch, between: &mut Between, motion: &mut Motion) -> u16 {
        let used = batch.used();

        // From the grid, one particle at a time.
        let Between { weights: w, moments } = between;
        let (wy, wz) = (weights(L::load(&batch.offset[1])), weights(L::load(&batch.offset[2])));
        for j in 0..3 {
            wy[j].store(&mut w[j]);
            wz[j].store(&mut w[3 + j]);
        }
        // Memory is asked a line at a time, while there is other work: many at once would have to wait for each other. The
        // batch after the next lies behind this one.
        let soon = std::ptr::from_ref(batch).wrapping_add(2).cast::<Row>();
        let later = self.next.part(b);
        let mut i = 0;
        while i < batch.len as usize {
            let cell = batch.node[i];
            let last = self.velocities.at(cell as usize + LAST_ROW).cast_mut();
            // SAFETY: `last` is the last row of a stencil inside the tile; the others lie before it.
            let read = |r: usize| unsafe { L::read(stencil_row(last, r)) };
            let ask = |i: usize| {
                L::fetch_soon(soon.wrapping_add(i));
                L::fetch_later(later.wrapping_add(i));
            };
            let x = |i: usize| batch.offset[0].0[i];
            let y = |i: usize| [w[0].0[i], w[1].0[i], w[2].0[i]];
            let z = |i: usize| [w[3].0[i], w[4].0[i], w[5].0[i]];
            if !L::STENCIL_FITS {
                ask(i);
                gather_one(&self.x, x(i), y(i), z(i), read).store(&mut moments[i]);
                i += 1;
                continue;
            }
            let stencil: [L; 9] = std::array::from_fn(read);
            while i < batch.len as usize && batch.node[i] == cell {
                ask(i);
                gather_one(&self.x, x(i), y(i), z(i), |r| stencil[r]).store(&mut moments[i]);
                i += 1;
            }
        }
        let (one, four) = (L::fill(1.0), L::fill(4.0));
        let mut rows = [one; WIDTH];
        for i in 0..WIDTH {
            rows[i] = L::load(&moments[i]);
        }
        L::transpose(&mut rows);

        // Sixteen at a time: the moment about the particle is that about the middle node less g v.
        let mut v = [rows[0], rows[1], rows[2]];
        let mut c = [one; 9];
        for s in 0..3 {
            let g = L::load(&batch.offset[s]) - one;
            for r in 0..3 {
                c[3 * r + s] = four * (rows[4 * (s + 1) + r] - g * v[r]);
            }
        }
        if batch.held != 0 {
            for d in 0..3 {
                if self.base == Base::LowerHalfVz && d < 2 {
                    continue;
                }
                let mut row = Row::ZERO;
                v[d].keep(batch.held).store(&mut row);
                self.report.base_impulse[d] -= row.0.iter().map(|&x| f64::from(x)).sum::<f64>();
                v[d] = v[d].keep(!batch.held);
            }
            if self.base == Base::BondedLayers {
                for ck in &mut c {
                    *ck = ck.keep(!batch.held);
                }
            }
        }
        self.speed_squared = v[0].mul_add(v[0], v[1].mul_add(v[1], v[2].mul_add(v[2], self.speed_squared)));
        for d in 0..3 {
            v[d].store(&mut motion.velocity[d]);
        }
        for k in 0..9 {
            c[k].store(&mut motion.affine[k]);
        }
        let sane = v[0].less(one)
            & v[1].less(one)
            & v[2].less(one)
            & (-v[0]).less(one)
            & (-v[1]).less(one)
            & (-v[2]).less(one);
        if !sane & used != 0 {
            let i = (!sane & used).trailing_zeros() as usize;
            self.report.runaway = self.report.runaway.or(Some(batch.id[i]));
            return used;
        }
        if !self.advance {
            return used;
        }

        // Strain and place move on.
        let mut h = [one; 9];
        for k in 0..9 {
            h[k] = L::load(&batch.strain[k]);
        }
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
        used & !self.cross(b, batch, crossed & used, motion)
    }

    /// Gives particles that crossed a cell border their new cell. Returns the lanes that left the block.
    #[inline(always)]
    fn cross(&mut self, b: usize, batch: &mut Batch, mut crossed: u16, motion: &Motion) -> u16 {
        let mut gone = 0;
        while crossed != 0 {
            let i = crossed.trailing_zeros() as usize;
            crossed &= crossed - 1;
            let mut at = tile_position(batch.node[i]);
            for d in 0..3 {
                let f = &mut batch.offset[d].0[i];
                let shift = i32::from(*f > 1.5) - i32::from(*f < 0.5);
                *f -= shift as f32;
                at[d] += shift;
            }
            if (0..3).all(|d| at[d] >= 0 && at[d] < BLOCK[d] as i32) {
                batch.node[i] = tile_node(at.map(|x| x as usize));
                continue;
            }
            gone |= 1 << i;
            let origin = self.place.origin();
            let mut particle = batch.get(i, origin);
            particle.cell = [origin[0] + at[0], origin[1] + at[1], origin[2] + at[2]];
            let lane = |row: &Row| row.0[i];
            let moving = Moving {
                particle,
                velocity: motion.velocity.each_ref().map(lane),
                affine: motion.affine.each_ref().map(lane),
            };
            self.leaving.push((b * WIDTH + i, moving));
        }
        gone
    }
}

impl Kernel for Pass<'_> {
    type Output = Report;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Report {
        let Pass { place, nodes, bin, tile, velocities, next, elastic, base, advance } = self;
        load_tile::<L>(place, nodes, velocities);
        tile.0.fill(Row::ZERO);
        let mut walk = Walk {
            x: AlongX::<L>::in_registers(),
            place,
            velocities,
            base,
            advance,
            next,
            speed_squared: L::fill(0.0),
            leaving: Vec::new(),
            report: Report::default(),
        };
        let mut between = Between::EMPTY;
        // Batches go two by two. The stress of a pair is one long chain of products: while it lasts, the next pair comes from the
        // grid, and nothing waits for what was done just before it.
        let count = bin.batches.len();
        let batches_of = |pair: usize| 2 * pair..count.min(2 * pair + 2);
        let mut motions = [[Motion::NONE, Motion::NONE], [Motion::NONE, Motion::NONE]];
        let mut staying = [[0; 2]; 2];
        for pair in 0..=count.div_ceil(2) {
            let mut bad = [0; 2];
            if pair > 0 {
                let before = &bin.batches[batches_of(pair - 1)];
                let strain = [&before[0].strain, &before[before.len() - 1].strain];
                let [first, second] = &mut motions[(pair - 1) % 2];
                bad = add_stress::<L>(elastic, strain, [&mut first.affine, &mut second.affine]);
            }
            for b in batches_of(pair) {
                let motion = &mut motions[pair % 2][b % 2];
                staying[pair % 2][b % 2] = walk.receive(b, &mut bin.batches[b], &mut between, motion);
            }
            let Some(before) = pair.checked_sub(1) else { continue };
            for b in batches_of(before) {
                let (batch, motion) = (&bin.batches[b], &motions[before % 2][b % 2]);
                let lanes = staying[before % 2][b % 2];
                scatter_batch(&walk.x, motion, &batch.offset, &batch.node, lanes, &mut between, tile);
                let bad = bad[b % 2] & lanes;
                if bad != 0 && walk.report.crushed.is_none() {
                    walk.report.crushed = Some(batch.id[bad.trailing_zeros() as usize]);
                }
            }
        }
        let Walk { speed_squared, leaving, mut report, .. } = walk;
        let mut row = Row::ZERO;
        speed_squared.store(&mut row);
        report.speed_squared = row.0.iter().map(|&x| f64::from(x)).sum();
        // From the last to the first, so that what takes a leaver's place stays.
        for (index, moving) in leaving.into_iter().rev() {
            bin.swap_remove(index, place.origin());
            report.leavers.push(moving);
        }
        report
    }
}

/// Puts particles that came to a block on its tile. Returns the first whose volume is not positive.
pub struct Arrive<'a> {
    /// Who came, with the tile node of each.
    pub arrivals: &'a [(Moving, u16)],
    /// The block's tile; added to.
    pub tile: &'a mut Tile,
    /// Material.
    pub elastic: Elastic,
}

impl Kernel for Arrive<'_> {
    type Output = Option<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<u32> {
        let x = AlongX::<L>::in_registers();
        let (mut crushed, mut between) = (None, Between::EMPTY);
        for some in self.arrivals.chunks(WIDTH) {
            let mut offset = [Row([1.0; WIDTH]); 3];
            let mut motion = Motion::NONE;
            let mut strain = [Row::ZERO; 9];
            let mut node = [0; WIDTH];
            for (i, (m, at)) in some.iter().enumerate() {
                node[i] = *at;
                for d in 0..3 {
                    offset[d].0[i] = m.particle.offset[d];
                    motion.velocity[d].0[i] = m.velocity[d];
                }
                for k in 0..9 {
                    motion.affine[k].0[i] = m.affine[k];
                    strain[k].0[i] = m.particle.strain[k];
                }
            }
            let lanes = u16::MAX >> (WIDTH - some.len());
            let mut idle = Motion::NONE;
            let affine = [&mut motion.affine, &mut idle.affine];
            let [bad, _] = add_stress::<L>(self.elastic, [&strain, &strain], affine);
            scatter_batch(&x, &motion, &offset, &node, lanes, &mut between, self.tile);
            if bad & lanes != 0 && crushed.is_none() {
                crushed = Some(some[(bad & lanes).trailing_zeros() as usize].0.particle.id);
            }
        }
        crushed
    }
}
