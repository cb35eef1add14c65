//! The indenter as particles with prescribed velocity.
//!
//! Only the skin that can meet the pad is sampled: a shell under the surface, two grid cells thick, as far
//! up as the pad is thick. The lattice is half as wide as the pad's and its outermost points are moved
//! onto the surface, so that nothing leaks between them and the lower face is smooth. Each point has the
//! mass of a pad particle, as in the predecessor; the denser lattice makes the indenter eight times as
//! dense as the pad, so a shared node moves nearly with the indenter.
//!
//! Points are kept in buckets of the indenter's own frame. Each block of the grid asks for the points in
//! its cells, so a moving and turning cloud needs no sorting. Blocks away from the pad never ask, nor those beside it for points so
//! high that they share no node with it.

use super::grid::{BLOCK, Tile, tile_node};
use super::lanes::{Kernel, Lanes, Row, WIDTH};
use super::spline::AlongX;
use super::transfer::{Between, Motion, scatter_batch};
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::{DVec3, IVec3};

/// Thickness of the sampled shell, grid cells.
const SHELL_CELLS: f64 = 2.0;
/// Side of a bucket, grid cells: smaller ones leave more lanes of batches empty, larger ones reach further beyond a block.
const SIDE_CELLS: f64 = 2.0;

/// Sixteen points, indenter frame, mm; those beyond `len` lie nowhere near.
#[derive(Debug, Clone)]
struct Points {
    x: Row,
    y: Row,
    z: Row,
    len: usize,
}

/// The sampled indenter.
#[derive(Debug)]
pub struct Cloud {
    buckets: Buckets,
    /// Box around all points, indenter frame, mm.
    bounds: [DVec3; 2],
    /// How many points.
    pub len: usize,
    /// The lowest point, the calibration particle x_o of Algorithm 1, indenter frame, mm.
    pub lowest: DVec3,
    /// Largest distance of a point from the indenter's axis, mm.
    pub radius_mm: f64,
}

impl Cloud {
    /// Samples the lower skin of `indenter` up to `reach_mm` above its tip.
    /// `None` when nothing of the body lies there.
    pub fn sample(indenter: &dyn Indenter, spacing_mm: f64, dx_mm: f64, reach_mm: f64) -> Option<Self> {
        let shell = SHELL_CELLS * dx_mm;
        let [hx, hy] = indenter.half_extent_mm();
        let count = |half: f64| (half / spacing_mm).ceil() as i32 + 1;
        let (nx, ny) = (count(hx), count(hy));
        let nz = (reach_mm / spacing_mm).ceil() as i32;
        let at = |i: i32, j: i32, k: i32| DVec3::new(i as f64, j as f64, k as f64) * spacing_mm;
        let mut points = Vec::new();
        // Cubes of the lattice that lie wholly outside the shell are passed over after one look: the
        // distance is exact or a lower bound of the true one, so a large value is always true.
        const CUBE: i32 = 8;
        let half_diagonal = spacing_mm * f64::from(CUBE) * 0.5 * 3f64.sqrt();
        for k0 in (-1..=nz).step_by(CUBE as usize) {
            for j0 in (-ny..=ny).step_by(CUBE as usize) {
                for i0 in (-nx..=nx).step_by(CUBE as usize) {
                    let middle = (at(i0, j0, k0) + at(i0 + CUBE - 1, j0 + CUBE - 1, k0 + CUBE - 1)) * 0.5;
                    let d = indenter.distance(middle);
                    if d > half_diagonal + spacing_mm || d < -(half_diagonal + shell) {
                        continue;
                    }
                    for k in k0..(k0 + CUBE).min(nz + 1) {
                        for j in j0..(j0 + CUBE).min(ny + 1) {
                            for i in i0..(i0 + CUBE).min(nx + 1) {
                                points.extend(on_or_below(indenter, at(i, j, k), spacing_mm, shell));
                            }
                        }
                    }
                }
            }
        }
        // A flat face has many lowest points. One on the axis stands still in a turn and could not measure
        // it, one at the rim feels the edge: take one half way out.
        let floor = points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let face = || points.iter().filter(|p| p.z <= floor + 1e-6);
        let half_way = face().map(|p| p.truncate().length()).fold(0.0, f64::max) / 2.0;
        let off = |p: &DVec3| (p.truncate().length() - half_way).abs();
        let lowest = *face().min_by(|p, q| off(p).total_cmp(&off(q)))?;
        let buckets = Buckets::of(&points, dx_mm);
        let radius_mm = points.iter().map(|p| p.truncate().length()).fold(0.0, f64::max);
        let bounds = points.iter().fold([lowest, lowest], |[lo, hi], p| [lo.min(*p), hi.max(*p)]);
        Some(Self { buckets, bounds, len: points.len(), lowest, radius_mm })
    }

    /// Every point, indenter frame, mm.
    pub fn points(&self) -> Vec<DVec3> {
        let of = |b: &Points| -> Vec<DVec3> {
            (0..b.len).map(|i| glam::Vec3::new(b.x.0[i], b.y.0[i], b.z.0[i]).as_dvec3()).collect()
        };
        self.buckets.batches.iter().flat_map(of).collect()
    }

    /// The batches whose buckets can reach into a box of the indenter's frame.
    fn within(&self, lower: DVec3, upper: DVec3) -> impl Iterator<Item = &Points> {
        // Only the part of the box where points are; far from the cloud that is empty.
        let (lower, upper) = (lower.max(self.bounds[0]), upper.min(self.bounds[1]));
        let far = upper.cmplt(lower).any();
        (!far).then(|| self.buckets.within(lower, upper)).into_iter().flatten()
    }
}

/// Points by cubes of the indenter's frame, x running fastest.
#[derive(Debug)]
struct Buckets {
    /// Side of a cube, mm.
    side_mm: f64,
    /// The first cube, and how many there are along each axis.
    first: IVec3,
    count: IVec3,
    /// Where the points of each cube begin, and where those of the last end.
    begins: Vec<usize>,
    batches: Vec<Points>,
}

impl Buckets {
    fn of(points: &[DVec3], dx_mm: f64) -> Self {
        let side_mm = dx_mm * SIDE_CELLS;
        let cube = |p: &DVec3, side: f64| (*p / side).floor().as_ivec3();
        let first = points.iter().map(|p| cube(p, side_mm)).reduce(IVec3::min).unwrap_or_default();
        let last = points.iter().map(|p| cube(p, side_mm)).reduce(IVec3::max).unwrap_or_default();
        let count = last - first + IVec3::ONE;
        let mut lists: Vec<Vec<DVec3>> = vec![Vec::new(); count.element_product() as usize];
        for p in points {
            lists[index(cube(p, side_mm) - first, count)].push(*p);
        }
        let (mut begins, mut batches) = (Vec::new(), Vec::new());
        for mut list in lists {
            begins.push(batches.len());
            // Those of one cell of the grid stay together, as a rule: see [`super::body::Body`]'s own order.
            list.sort_by_key(|p| cube(p, dx_mm).to_array());
            batches.extend(list.chunks(WIDTH).map(Points::of));
        }
        begins.push(batches.len());
        Self { side_mm, first, count, begins, batches }
    }

    /// The batches of the cubes that a box meets, which lies within the box around all points.
    fn within(&self, lower: DVec3, upper: DVec3) -> impl Iterator<Item = &Points> {
        let cube = |p: DVec3| {
            ((p / self.side_mm).floor().as_ivec3() - self.first).clamp(IVec3::ZERO, self.count - IVec3::ONE)
        };
        let (lo, hi) = (cube(lower), cube(upper));
        (lo.z..=hi.z).flat_map(move |z| (lo.y..=hi.y).map(move |y| (y, z))).flat_map(move |(y, z)| {
            let at = |x: i32| index(IVec3::new(x, y, z), self.count);
            &self.batches[self.begins[at(lo.x)]..self.begins[at(hi.x) + 1]]
        })
    }
}

/// Where a cube comes among `count`.
fn index(cube: IVec3, count: IVec3) -> usize {
    ((cube.z * count.y + cube.y) * count.x + cube.x) as usize
}

impl Points {
    /// At most sixteen.
    fn of(chunk: &[DVec3]) -> Self {
        let row =
            |c: fn(&DVec3) -> f64| Row(std::array::from_fn(|i| chunk.get(i).map_or(1e6, |p| c(p) as f32)));
        Points { x: row(|p| p.x), y: row(|p| p.y), z: row(|p| p.z), len: chunk.len() }
    }
}

/// The lattice point itself, inside; moved onto the surface, near it; nothing elsewhere.
fn on_or_below(indenter: &dyn Indenter, p: DVec3, spacing_mm: f64, shell_mm: f64) -> Option<DVec3> {
    let d = indenter.distance(p);
    if d > 0.5 * spacing_mm || d < -shell_mm {
        return None;
    }
    if d <= -0.5 * spacing_mm {
        return Some(p);
    }
    let (d, normal) = indenter.distance_and_normal(p);
    Some(p - normal * d)
}

/// Where a pose puts points of the indenter's frame, in cells of the grid.
#[derive(Debug, Clone, Copy)]
struct Placed {
    /// Cosine and sine over the cell width, 1/mm.
    cos: f64,
    sin: f64,
    /// Of the origin.
    shift: [f64; 3],
}

impl Placed {
    fn new(pose: &Pose, lower_mm: [f64; 3], dx_mm: f64) -> Self {
        let (s, c) = pose.theta_deg.to_radians().sin_cos();
        let shift = [pose.x_mm, pose.y_mm, pose.z_mm];
        let shift = std::array::from_fn(|d| (shift[d] - lower_mm[d]) / dx_mm);
        Self { cos: c / dx_mm, sin: s / dx_mm, shift }
    }
}

/// The indenter's motion over one step.
#[derive(Debug)]
pub struct CloudStep<'a> {
    cloud: &'a Cloud,
    /// At the beginning and at the end.
    from: Placed,
    to: Placed,
    dx_mm: f64,
}

impl<'a> CloudStep<'a> {
    /// From one pose to another, on a grid whose node (0, 0, 0) lies at `lower_mm` in the pad frame.
    pub fn new(cloud: &'a Cloud, from: &Pose, to: &Pose, lower_mm: [f64; 3], dx_mm: f64) -> Self {
        let placed = |pose: &Pose| Placed::new(pose, lower_mm, dx_mm);
        Self { cloud, from: placed(from), to: placed(to), dx_mm }
    }

    /// Whether any point can belong to the block whose first cell this is.
    pub fn reaches(&self, origin: [i32; 3]) -> bool {
        self.near(corners_of(origin, BLOCK[2])).next().is_some()
    }

    /// The points that can lie, at the beginning, in a box of the grid given by its middle and half its sides, cells.
    fn near(&self, (middle, half): (DVec3, DVec3)) -> impl Iterator<Item = &Points> {
        let (c, s) = (self.from.cos * self.dx_mm, self.from.sin * self.dx_mm);
        let p = middle - DVec3::from_array(self.from.shift);
        let middle = DVec3::new(c * p.x + s * p.y, c * p.y - s * p.x, p.z) * self.dx_mm;
        let (c, s) = (c.abs(), s.abs());
        let half = DVec3::new(c * half.x + s * half.y, s * half.x + c * half.y, half.z) * self.dx_mm;
        self.cloud.within(middle - half, middle + half)
    }
}

/// Where the points lie whose stencils have their lower corners in the lowest `layers` of a block: the middle of that box and half
/// its sides, with a little to spare, cells. They lie half a cell further up than the corners.
fn corners_of(origin: [i32; 3], layers: usize) -> (DVec3, DVec3) {
    let half = DVec3::new(BLOCK[0] as f64, BLOCK[1] as f64, layers as f64) * 0.5;
    (DVec3::from_array(origin.map(|o| f64::from(o) + 0.5)) + half, half * 1.001)
}

/// The indenter's motion as one block sees it.
pub struct ScatterCloud<'a> {
    /// What moves.
    pub step: &'a CloudStep<'a>,
    /// First cell of the block.
    pub origin: [i32; 3],
    /// How many of its layers of cells are looked for points in; those above touch no node that the pad touches.
    pub layers: usize,
    /// The tile to fill, kept from step to step; `None` when no point is near.
    pub tile: &'a mut Option<Box<Tile>>,
}

impl Kernel for ScatterCloud<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let sides = [BLOCK[0], BLOCK[1], self.layers].map(|n| n as f32);
        let CloudStep { from, to, dx_mm, .. } = *self.step;
        let fill = |x: f64| L::fill(x as f32);
        let (cos, sin, per_mm) = (fill(from.cos), fill(from.sin), fill(1.0 / dx_mm));
        let (cos_more, sin_more) = (fill(to.cos - from.cos), fill(to.sin - from.sin));
        let (along_x, mut between) = (AlongX::<L>::in_registers(), Between::EMPTY);
        let mut filled = false;
        for points in self.step.near(corners_of(self.origin, self.layers)) {
            let (px, py, pz) = (L::load(&points.x), L::load(&points.y), L::load(&points.z));
            // Position and displacement are affine in the indenter's coordinates.
            let x = [
                px.mul_add(cos, py.mul_add(-sin, fill(from.shift[0]))),
                px.mul_add(sin, py.mul_add(cos, fill(from.shift[1]))),
                pz.mul_add(per_mm, fill(from.shift[2])),
            ];
            // Membership is decided on coordinates of the whole grid, so a point falls to exactly one block.
            let mut inside = u16::MAX >> (WIDTH - points.len);
            let mut offset = [Row::ZERO; 3];
            let mut corner = [Row::ZERO; 3];
            for d in 0..3 {
                let base = (x[d] - L::fill(0.5)).floor();
                let local = base - L::fill(self.origin[d] as f32);
                inside &= L::fill(-0.5).less(local) & local.less(L::fill(sides[d] - 0.5));
                (x[d] - base).store(&mut offset[d]);
                local.store(&mut corner[d]);
            }
            if inside == 0 {
                continue;
            }
            if !filled {
                self.tile.get_or_insert_with(|| Box::new(Tile::zero())).0.fill(Row::ZERO);
                filled = true;
            }
            let Some(tile) = self.tile.as_deref_mut() else { continue };
            let mut motion = Motion::NONE;
            let v = [
                px.mul_add(cos_more, py.mul_add(-sin_more, fill(to.shift[0] - from.shift[0]))),
                px.mul_add(sin_more, py.mul_add(cos_more, fill(to.shift[1] - from.shift[1]))),
                fill(to.shift[2] - from.shift[2]),
            ];
            for d in 0..3 {
                v[d].store(&mut motion.velocity[d]);
            }
            let mut node = [0; WIDTH];
            for i in (0..WIDTH).filter(|i| inside >> i & 1 == 1) {
                node[i] = tile_node([0, 1, 2].map(|d| corner[d].0[i] as usize));
            }
            scatter_batch(&along_x, &motion, &offset, &node, inside, &mut between, tile);
        }
        if !filled {
            *self.tile = None;
        }
    }
}
