//! The indenter as particles with prescribed velocity.
//!
//! Only the skin that can meet the pad is sampled: a shell under the surface, two grid cells thick, as far
//! up as the pad is thick. The lattice is half as wide as the pad's and its outermost points are moved
//! onto the surface, so that nothing leaks between them and the lower face is smooth. Each point has the
//! mass of a pad particle, as in the predecessor; the denser lattice makes the indenter eight times as
//! dense as the pad, so a shared node moves nearly with the indenter.
//!
//! Points are kept in buckets of the indenter's own frame. Each block of the grid asks for the points in
//! its cells, so a moving and turning cloud needs no sorting, and blocks away from the pad never ask.

use super::grid::{BLOCK, TILE, TILE_LAYER, Tile};
use super::lanes::{Kernel, Lanes, Row, WIDTH};
use super::spline::weights_of;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use std::collections::BTreeMap;

/// Thickness of the sampled shell, grid cells.
const SHELL_CELLS: f64 = 2.0;

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
    /// Side of a bucket, mm.
    side_mm: f64,
    buckets: BTreeMap<[i32; 3], Vec<Points>>,
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
        let side_mm = dx_mm * BLOCK[0] as f64;
        let mut sorted: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
        for p in &points {
            sorted.entry((*p / side_mm).floor().as_ivec3().to_array()).or_default().push(*p);
        }
        let pack = |chunk: &[DVec3]| {
            let row = |c: fn(&DVec3) -> f64| {
                Row(std::array::from_fn(|i| chunk.get(i).map_or(1e6, |p| c(p) as f32)))
            };
            Points { x: row(|p| p.x), y: row(|p| p.y), z: row(|p| p.z), len: chunk.len() }
        };
        let buckets =
            sorted.into_iter().map(|(key, list)| (key, list.chunks(WIDTH).map(pack).collect())).collect();
        let radius_mm = points.iter().map(|p| p.truncate().length()).fold(0.0, f64::max);
        let bounds = points.iter().fold([lowest, lowest], |[lo, hi], p| [lo.min(*p), hi.max(*p)]);
        Some(Self { side_mm, buckets, bounds, len: points.len(), lowest, radius_mm })
    }

    /// Every point, indenter frame, mm.
    pub fn points(&self) -> Vec<DVec3> {
        let of = |b: &Points| -> Vec<DVec3> {
            (0..b.len).map(|i| glam::Vec3::new(b.x.0[i], b.y.0[i], b.z.0[i]).as_dvec3()).collect()
        };
        self.buckets.values().flatten().flat_map(of).collect()
    }

    /// The batches whose buckets can reach into the box of half sides `half_mm` around a point of the pad frame.
    fn near(&self, pose: &Pose, centre_mm: DVec3, half_mm: DVec3) -> impl Iterator<Item = &Points> {
        let middle = pose.to_indenter(centre_mm);
        let (s, c) = pose.theta_deg.to_radians().sin_cos();
        let (s, c) = (s.abs(), c.abs());
        let half = DVec3::new(c * half_mm.x + s * half_mm.y, s * half_mm.x + c * half_mm.y, half_mm.z);
        // Only the part of the box where points are; far from the cloud that is empty.
        let lo = ((middle - half).max(self.bounds[0]) / self.side_mm).floor().as_ivec3();
        let hi = (middle + half).min(self.bounds[1]);
        let far = hi.cmplt((middle - half).max(self.bounds[0])).any();
        let hi = (hi / self.side_mm).floor().as_ivec3()
            - if far { glam::IVec3::MAX / 2 } else { glam::IVec3::ZERO };
        (lo.z..=hi.z).flat_map(move |z| {
            (lo.y..=hi.y)
                .flat_map(move |y| (lo.x..=hi.x).filter_map(move |x| self.buckets.get(&[x, y, z])).flatten())
        })
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

/// The indenter's motion over one step, as one block sees it.
pub struct ScatterCloud<'a> {
    /// The points.
    pub cloud: &'a Cloud,
    /// Pose at the beginning of the step.
    pub from: &'a Pose,
    /// Pose at its end.
    pub to: &'a Pose,
    /// Position of the grid's node (0, 0, 0), pad frame, mm.
    pub lower_mm: [f64; 3],
    /// Cell width, mm.
    pub dx_mm: f64,
    /// First cell of the block.
    pub origin: [i32; 3],
    /// The tile to fill, kept from step to step; `None` when no point is near.
    pub tile: &'a mut Option<Box<Tile>>,
}

impl Kernel for ScatterCloud<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        // The lower corners of stencils in the block belong to points half a cell further up.
        let half = DVec3::from_array(BLOCK.map(|b| 0.5 * b as f64 * self.dx_mm));
        let origin = DVec3::from_array(self.origin.map(|o| f64::from(o) + 0.5));
        let centre = DVec3::from_array(self.lower_mm) + origin * self.dx_mm + half;
        // Position in cells and displacement per step are affine in the indenter's coordinates.
        let affine = |pose: &Pose| {
            let (s, c) = pose.theta_deg.to_radians().sin_cos();
            let shift = [pose.x_mm, pose.y_mm, pose.z_mm];
            (
                c / self.dx_mm,
                s / self.dx_mm,
                std::array::from_fn::<f64, 3, _>(|d| (shift[d] - self.lower_mm[d]) / self.dx_mm),
            )
        };
        let (c0, s0, t0) = affine(self.from);
        let (c1, s1, t1) = affine(self.to);
        let fill = |x: f64| L::fill(x as f32);
        let mut filled = false;
        for points in self.cloud.near(self.from, centre, half * 1.001) {
            let (px, py, pz) = (L::load(&points.x), L::load(&points.y), L::load(&points.z));
            let x = [
                px.mul_add(fill(c0), py.mul_add(fill(-s0), fill(t0[0]))),
                px.mul_add(fill(s0), py.mul_add(fill(c0), fill(t0[1]))),
                pz.mul_add(fill(1.0 / self.dx_mm), fill(t0[2])),
            ];
            // Membership is decided on coordinates of the whole grid, so a point falls to exactly one block.
            let mut inside = u16::MAX >> (WIDTH - points.len);
            let mut offset = [Row::ZERO; 3];
            let mut corner = [Row::ZERO; 3];
            for d in 0..3 {
                let base = (x[d] - L::fill(0.5)).floor();
                let local = base - L::fill(self.origin[d] as f32);
                inside &= L::fill(-0.5).less(local) & local.less(L::fill(BLOCK[d] as f32 - 0.5));
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
            let v = [
                px.mul_add(fill(c1 - c0), py.mul_add(fill(s0 - s1), fill(t1[0] - t0[0]))),
                px.mul_add(fill(s1 - s0), py.mul_add(fill(c1 - c0), fill(t1[1] - t0[1]))),
                fill(t1[2] - t0[2]),
            ];
            let mut velocity = [Row::ZERO; 3];
            for d in 0..3 {
                v[d].store(&mut velocity[d]);
            }
            while inside != 0 {
                let i = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let at = |d: usize| corner[d].0[i] as usize;
                let weight = |d: usize| weights_of(offset[d].0[i]);
                let (wx, wy, wz) = (weight(0), weight(1), weight(2));
                let p = [velocity[0].0[i], velocity[1].0[i], velocity[2].0[i], 1.0];
                let row =
                    L::load(&Row(std::array::from_fn(|l| if l < 12 { wx[l / 4] * p[l % 4] } else { 0.0 })));
                let to = tile.at_mut((at(2) + 2) * TILE_LAYER + (at(1) + 2) * TILE[0] + at(0));
                for k in 0..3 {
                    for j in 0..3 {
                        // SAFETY: `to` is the last row of the stencil; the others lie before it in the tile.
                        unsafe {
                            let node = to.sub(((2 - k) * TILE_LAYER + (2 - j) * TILE[0]) * 4);
                            row.mul_add(L::fill(wy[j] * wz[k]), L::read(node)).write(node);
                        }
                    }
                }
            }
        }
        if !filled {
            *self.tile = None;
        }
    }
}
