//! Contact springs in the preconditioner, by the Woodbury formula.
//!
//! Springs at the face add a matrix of low rank B E B^T to the rest state C. The inverse of the sum is
//! C^-1 - C^-1 B (E^-1 + B^T C^-1 B)^-1 B^T C^-1, and on the torus B^T C^-1 B depends on the distance
//! of two cells alone: a table. Springs are gathered by cell (or by blocks of cells when the contact is
//! large), which is enough for a preconditioner.

use super::contact::Contacts;
use super::grid::Grid;
use super::lanes::{Kernel, Lanes, WIDTH, dispatch};
use super::layer::RestLayer;
use glam::DVec3;

/// Above this many springs, cells are gathered in blocks: on an ordinary grid, and on a fine one, whose
/// passes cost more than a larger factor does.
const MOST_SPRINGS: [usize; 2] = [640, 1400];
/// Control points of a layer from which a grid counts as fine.
const FINE_PLANE: usize = 6000;

/// Displacement of the face at the middle of one cell for a unit force on another.
#[derive(Debug)]
pub struct FaceGreen {
    cx: usize,
    cy: usize,
    /// `[force component][offset y][offset x][displacement component]`.
    table: Vec<f32>,
}

/// Weights of the control points at the middle of a cell.
const MIDDLE: [f64; 3] = [0.125, 0.75, 0.125];

impl FaceGreen {
    /// Probes the rest layer with a force in each direction.
    pub fn new(grid: &Grid, layer: &RestLayer) -> Self {
        let (cx, cy, n) = (grid.cx(), grid.cy(), grid.plane());
        let (i0, j0) = (cx / 2, cy / 2);
        let mut table = vec![0.0; 9 * n];
        let mut face = vec![0.0; 3 * n];
        let mut waves = vec![0.0; layer.waves_len()];
        let mut scratch = Vec::new();
        for c in 0..3 {
            let mut load = vec![0.0; 3 * n];
            for b in 0..3 {
                for a in 0..3 {
                    load[c * n + (j0 + b) * cx + i0 + a] = (MIDDLE[a] * MIDDLE[b]) as f32;
                }
            }
            waves.fill(0.0);
            layer.subtract_face_load(&load, &mut waves, &mut scratch);
            layer.face(&waves, &mut face);
            // The edge scaling of the layer belongs outside the formula.
            layer.unscale_face(&mut face);
            for dj in 0..cy {
                for di in 0..cx {
                    for d in 0..3 {
                        let mut sum = 0.0;
                        for b in 0..3 {
                            for a in 0..3 {
                                let (i, j) = ((i0 + di + a) % cx, (j0 + dj + b) % cy);
                                sum -= MIDDLE[a] * MIDDLE[b] * f64::from(face[d * n + j * cx + i]);
                            }
                        }
                        table[((c * cy + dj) * cx + di) * 3 + d] = sum as f32;
                    }
                }
            }
        }
        Self { cx, cy, table }
    }

    /// Displacement along `to` at cell (i, j) for a unit force along `along` at cell (k, l).
    fn response(&self, at: [usize; 2], to: DVec3, from: [usize; 2], along: DVec3) -> f64 {
        let di = (at[0] + self.cx - from[0]) % self.cx;
        let dj = (at[1] + self.cy - from[1]) % self.cy;
        let force = along.to_array();
        let to = to.to_array();
        let mut sum = 0.0;
        for (c, f) in force.iter().enumerate() {
            let u = &self.table[((c * self.cy + dj) * self.cx + di) * 3..][..3];
            sum += f * (0..3).map(|d| to[d] * f64::from(u[d])).sum::<f64>();
        }
        sum
    }
}

/// One spring of the preconditioner.
#[derive(Debug, Clone)]
struct Spring {
    /// Cells it pulls on, with equal weight.
    cells: Vec<[usize; 2]>,
    along: DVec3,
}

/// The preconditioner: rest layer with the springs of the present contact.
#[derive(Debug, Default)]
pub struct Springs {
    springs: Vec<Spring>,
    /// Lower Cholesky factor of E^-1 + B^T C^-1 B, rows padded to the SIMD width.
    factor: Vec<f32>,
    stride: usize,
    waves: Vec<f32>,
    scratch: Vec<f32>,
    face: Vec<f32>,
    load: Vec<f32>,
    y: Vec<f32>,
}

impl Springs {
    /// Gathers the springs of a linearised contact and factors their system.
    pub fn update(&mut self, grid: &Grid, green: &FaceGreen, contacts: &Contacts) {
        let mut block = 1;
        let most = MOST_SPRINGS[usize::from(grid.plane() >= FINE_PLANE)];
        let (springs, stiffness) = loop {
            let found = gather(grid, contacts, block);
            if found.0.len() <= most {
                break found;
            }
            block *= 2;
        };
        let m = springs.len();
        self.stride = m.div_ceil(WIDTH) * WIDTH;
        self.factor.clear();
        self.factor.resize(m * self.stride, 0.0);
        for r in 0..m {
            for s in 0..=r {
                let (a, b) = (&springs[r], &springs[s]);
                let mut sum = 0.0;
                for p in &a.cells {
                    for q in &b.cells {
                        sum += green.response(*p, a.along, *q, b.along);
                    }
                }
                sum /= (a.cells.len() * b.cells.len()) as f64;
                if r == s {
                    sum += 1.0 / stiffness[r];
                }
                self.factor[r * self.stride + s] = sum as f32;
            }
        }
        dispatch(Cholesky { a: &mut self.factor, n: m, stride: self.stride });
        self.springs = springs;
    }

    /// z = M^-1 r.
    pub fn apply(&mut self, grid: &Grid, layer: &RestLayer, r: &[f32], z: &mut [f32]) {
        self.waves.resize(layer.waves_len(), 0.0);
        layer.solve_to_waves(r, &mut self.waves);
        if !self.springs.is_empty() {
            let (n, cx) = (grid.plane(), grid.cx());
            self.face.resize(3 * n, 0.0);
            layer.face(&self.waves, &mut self.face);
            layer.unscale_face(&mut self.face);
            self.y.clear();
            for s in &self.springs {
                let mut sum = 0.0;
                for [i, j] in &s.cells {
                    for (d, along) in s.along.to_array().iter().enumerate() {
                        for b in 0..3 {
                            for a in 0..3 {
                                let u = self.face[d * n + (j + b) * cx + i + a];
                                sum += along * MIDDLE[a] * MIDDLE[b] * f64::from(u);
                            }
                        }
                    }
                }
                self.y.push((sum / s.cells.len() as f64) as f32);
            }
            solve_cholesky(&self.factor, self.stride, &mut self.y);
            self.load.clear();
            self.load.resize(3 * n, 0.0);
            for (s, y) in self.springs.iter().zip(&self.y) {
                let share = f64::from(*y) / s.cells.len() as f64;
                for [i, j] in &s.cells {
                    for (d, along) in s.along.to_array().iter().enumerate() {
                        for b in 0..3 {
                            for a in 0..3 {
                                self.load[d * n + (j + b) * cx + i + a] +=
                                    (share * along * MIDDLE[a] * MIDDLE[b]) as f32;
                            }
                        }
                    }
                }
            }
            layer.unscale_face(&mut self.load);
            layer.subtract_face_load(&self.load, &mut self.waves, &mut self.scratch);
        }
        layer.from_waves(&self.waves, z);
    }
}

/// Springs of cells gathered in blocks of `block` x `block`, and their stiffness in N/mm.
fn gather(grid: &Grid, contacts: &Contacts, block: usize) -> (Vec<Spring>, Vec<f64>) {
    let across = grid.nx.div_ceil(block);
    let mut groups: Vec<Option<Group>> = vec![None; across * grid.ny.div_ceil(block)];
    for a in contacts.active() {
        let slot = &mut groups[(a.cell[1] / block) * across + a.cell[0] / block];
        let g = slot.get_or_insert_with(Group::default);
        if g.cells.last() != Some(&a.cell) && !g.cells.contains(&a.cell) {
            g.cells.push(a.cell);
        }
        for (sum, k) in g.stiffness.iter_mut().zip(a.stiffness) {
            *sum += k;
        }
        g.normal += a.normal;
    }
    let (mut springs, mut stiffness) = (Vec::new(), Vec::new());
    for g in groups.into_iter().flatten() {
        let n = g.normal.normalize_or(DVec3::NEG_Z);
        let t = n.any_orthonormal_vector();
        let b = n.cross(t);
        let along = |d: DVec3| d.dot(Group::times(&g.stiffness, d));
        let largest = along(n).max(along(t)).max(along(b));
        for d in [n, t, b] {
            let e = along(d);
            if e > 1e-3 * largest {
                springs.push(Spring { cells: g.cells.clone(), along: d });
                stiffness.push(e);
            }
        }
    }
    (springs, stiffness)
}

#[derive(Debug, Clone, Default)]
struct Group {
    cells: Vec<[usize; 2]>,
    /// xx, yy, zz, xy, xz, yz.
    stiffness: [f64; 6],
    normal: DVec3,
}

impl Group {
    fn times(k: &[f64; 6], d: DVec3) -> DVec3 {
        DVec3::new(
            k[0] * d.x + k[3] * d.y + k[4] * d.z,
            k[3] * d.x + k[1] * d.y + k[5] * d.z,
            k[4] * d.x + k[5] * d.y + k[2] * d.z,
        )
    }
}

struct Cholesky<'a> {
    a: &'a mut [f32],
    n: usize,
    stride: usize,
}

impl Kernel for Cholesky<'_> {
    type Output = ();
    /// Row by row; the upper triangle stays zero, so that padded dot products are exact.
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (n, s) = (self.n, self.stride);
        for i in 0..n {
            let (before, row) = self.a.split_at_mut(i * s);
            let row = &mut row[..s];
            for j in 0..i {
                let other = &before[j * s..(j + 1) * s];
                let value = row[j];
                row[j] = 0.0;
                // Entries of `row` from j on still hold the matrix, but `other` is zero beyond j.
                let mut sum = [L::splat(0.0); 2];
                let mut k = 0;
                while k + 2 * WIDTH <= j {
                    sum[0] = L::load(&row[k..]).fma(L::load(&other[k..]), sum[0]);
                    sum[1] = L::load(&row[k + WIDTH..]).fma(L::load(&other[k + WIDTH..]), sum[1]);
                    k += 2 * WIDTH;
                }
                while k < j {
                    sum[0] = L::load(&row[k..]).fma(L::load(&other[k..]), sum[0]);
                    k += WIDTH;
                }
                let dot: f32 = sum[0].add(sum[1]).to_array().iter().sum();
                row[j] = (value - dot) / other[j];
            }
            let dot: f32 = row[..i].iter().map(|v| v * v).sum();
            // The matrix is positive definite; rounding may say otherwise where springs nearly repeat.
            let floor = 1e-6 * row[i].abs();
            row[i] = (row[i] - dot).max(floor).sqrt();
        }
    }
}

fn solve_cholesky(l: &[f32], stride: usize, y: &mut [f32]) {
    let n = y.len();
    for i in 0..n {
        let row = &l[i * stride..i * stride + i];
        let dot: f32 = row.iter().zip(&*y).map(|(a, b)| a * b).sum();
        y[i] = (y[i] - dot) / l[i * stride + i];
    }
    for i in (0..n).rev() {
        y[i] /= l[i * stride + i];
        let v = y[i];
        for (t, a) in y[..i].iter_mut().zip(&l[i * stride..i * stride + i]) {
            *t -= a * v;
        }
    }
}
