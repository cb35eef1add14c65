//! Contact springs in the preconditioner, by the Woodbury formula.
//!
//! Springs at the face add a matrix of low rank B E B^T to the rest state C. The inverse of the sum is
//! C^-1 - C^-1 B (E^-1 + B^T C^-1 B)^-1 B^T C^-1, and B^T C^-1 B depends on the distance of two cells and on those
//! of their images in the sides alone: a table. Springs are gathered by cell (or by blocks of cells when the contact is
//! large), which is enough for a preconditioner.

use super::cholesky::Cholesky;
use super::contact::Contacts;
use super::frames::Frames;
use super::grid::Grid;
use super::layer::{Passage, RestLayer};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Above this many springs, cells are gathered in blocks: on an ordinary grid, and on a fine one, whose
/// passes cost more than a larger factor does.
const MOST_SPRINGS: [usize; 2] = [1100, 1400];
/// Control points of a layer from which a grid counts as fine.
const FINE_PLANE: usize = 6000;

/// Displacement of the face at the middle of one cell for a unit force on another.
///
/// A product of two waves is half the difference or sum of waves of the difference and of the sum of their places, so
/// the response is that of an endless layer to the force and to its images in the sides: a table over distances,
/// read at four of them.
#[derive(Debug)]
pub struct FaceGreen {
    /// Distances in the table along x and y: from 0 to the furthest image.
    reach: [usize; 2],
    /// `[displacement component][force component][distance y][distance x]`.
    table: Vec<f32>,
}

/// Weights of the control points at the middle of a cell.
const MIDDLE: [f64; 3] = [0.125, 0.75, 0.125];

/// The part that a component's waves play along an axis: the component of that axis has the partners.
fn is_partner(component: usize, axis: usize) -> bool {
    component == axis
}

impl FaceGreen {
    /// Reads the response of the face from the rest layer, mode by mode.
    pub fn new(grid: &Grid, layer: &RestLayer) -> Self {
        let points = [grid.cx(), grid.cy()];
        let reach = points.map(|n| 2 * n);
        let mut table = Vec::with_capacity(9 * reach[0] * reach[1]);
        let responses: Vec<[Vec<f32>; 3]> = (0..3).map(|c| layer.face_modes(c)).collect();
        for d in 0..3 {
            for c in 0..3 {
                let [x, y] = [0, 1].map(|axis| distance_waves(points[axis], reach[axis], [d, c], axis));
                let modes = &responses[c][d];
                for wave_y in y.chunks(points[1]) {
                    let mut over_x = vec![0.0f32; points[0]];
                    for (w, row) in wave_y.iter().zip(modes.chunks(points[0])) {
                        for (o, r) in over_x.iter_mut().zip(row) {
                            *o += w * r;
                        }
                    }
                    let at = |wave_x: &[f32]| wave_x.iter().zip(&over_x).map(|(w, o)| w * o).sum::<f32>();
                    table.extend(x.chunks(points[0]).map(at));
                }
            }
        }
        Self { reach, table }
    }

    /// Displacement at cell `at` for unit forces on cell `from`: rows of displacement, columns of force.
    fn response(&self, at: [usize; 2], from: [usize; 2]) -> DMat3 {
        let mut out = DMat3::ZERO;
        // Places of cells in waves are i + 3/2.
        let difference = [0, 1].map(|a| at[a].abs_diff(from[a]));
        let sum = [0, 1].map(|a| at[a] + from[a] + 3);
        let backwards = [0, 1].map(|a| at[a] < from[a]);
        let [nx, ny] = self.reach;
        for d in 0..3 {
            for c in 0..3 {
                let table = &self.table[(3 * d + c) * nx * ny..][..nx * ny];
                // Signs of the direct and of the mirrored wave along an axis.
                let signs = |axis: usize| match (is_partner(d, axis), is_partner(c, axis)) {
                    (false, false) => [1.0, -1.0],
                    (true, true) => [1.0, 1.0],
                    (false, true) => [if backwards[axis] { 1.0 } else { -1.0 }, -1.0],
                    (true, false) => [if backwards[axis] { -1.0 } else { 1.0 }, -1.0],
                };
                let ([dx, mx], [dy, my]) = (signs(0), signs(1));
                let along_x = |y: usize| dx * table[y * nx + difference[0]] + mx * table[y * nx + sum[0]];
                out.col_mut(c)[d] = f64::from(dy * along_x(difference[1]) + my * along_x(sum[1]));
            }
        }
        out
    }
}

/// Waves of distances on an axis of `n` points, smoothed by the weights of cell middles on both ends:
/// `[distance][mode]`.
fn distance_waves(n: usize, reach: usize, components: [usize; 2], axis: usize) -> Vec<f32> {
    let partners = components.map(|c| is_partner(c, axis));
    let mut out = Vec::with_capacity(n * reach);
    for distance in 0..reach {
        for m in 0..n {
            let last = m + 1 == n;
            let theta = if last && partners == [true, true] { 0.0 } else { PI * (m + 1) as f64 / n as f64 };
            let smooth = MIDDLE[1] + 2.0 * MIDDLE[0] * theta.cos();
            let angle = theta * distance as f64;
            let wave = if partners[0] == partners[1] { angle.cos() } else { angle.sin() };
            // Half of the product of two norms.
            let norm = if last { 0.5 } else { 1.0 } / n as f64;
            out.push((norm * smooth * smooth * wave) as f32);
        }
    }
    out
}

/// Cells that share springs.
#[derive(Debug, Clone, Default)]
struct Group {
    cells: Vec<[usize; 2]>,
    /// xx, yy, zz, xy, xz, yz of their stiffness, N/mm.
    stiffness: [f64; 6],
    normal: DVec3,
    /// Directions of the springs, and how stiff each is, N/mm.
    along: Vec<(DVec3, f64)>,
    /// The first of them in the system.
    first: usize,
}

impl Group {
    /// Whether the springs of another are so near to these that those of the system may stay.
    fn is_like(&self, other: &Self) -> bool {
        let near =
            |(v, e): &(DVec3, f64), (w, f): &(DVec3, f64)| v.dot(*w) > 0.98 && (0.7..1.4).contains(&(e / f));
        self.cells == other.cells
            && self.along.len() == other.along.len()
            && self.along.iter().zip(&other.along).all(|(a, b)| near(a, b))
    }
}

/// The preconditioner: rest layer with the springs of the present contact.
#[derive(Debug, Default)]
pub struct Springs {
    groups: Vec<Group>,
    /// Of E^-1 + B^T C^-1 B.
    factor: Cholesky,
    passage: Passage,
    face: Vec<f32>,
    load: Vec<f32>,
    y: Vec<f32>,
    /// The residual in the frames of the face.
    turned: Vec<f32>,
}

impl Springs {
    /// The same springs, factored.
    pub fn fork(&self) -> Self {
        Self { groups: self.groups.clone(), factor: self.factor.clone(), ..Self::default() }
    }

    /// Gathers the springs of a linearised contact and factors their system.
    pub fn update(&mut self, grid: &Grid, green: &FaceGreen, frames: Option<&Frames>, contacts: &Contacts) {
        let mut block = 1;
        let most = MOST_SPRINGS[usize::from(grid.plane() >= FINE_PLANE)];
        let (groups, m) = loop {
            let found = gather(grid, frames, contacts, block);
            if found.1 <= most {
                break found;
            }
            block *= 2;
        };
        if self.groups.len() == groups.len() && self.groups.iter().zip(&groups).all(|(a, b)| a.is_like(b)) {
            return;
        }
        let (mut rest, stride) = self.factor.prepare(m);
        let mut rows = Vec::with_capacity(groups.len());
        for g in &groups {
            let (head, tail) = rest.split_at_mut(g.along.len() * stride);
            rows.push(head);
            rest = tail;
        }
        rows.into_par_iter().zip(&groups).enumerate().for_each(|(n, (rows, a))| {
            for b in &groups[..=n] {
                let mean = mean_response(green, a, b);
                for ((to, _), row) in a.along.iter().zip(rows.chunks_mut(stride)) {
                    for (q, (from, _)) in b.along.iter().enumerate() {
                        row[b.first + q] = to.dot(mean * *from) as f32;
                    }
                }
            }
            for (p, (row, (_, stiffness))) in rows.chunks_mut(stride).zip(&a.along).enumerate() {
                row[a.first + p] += (1.0 / stiffness) as f32;
            }
        });
        self.factor.factor();
        self.groups = groups;
    }

    /// z = M^-1 r.
    pub fn apply(
        &mut self,
        grid: &Grid,
        layer: &RestLayer,
        frames: Option<&Frames>,
        r: &[f32],
        z: &mut [f32],
    ) {
        match frames {
            None => layer.enter(r, &mut self.passage),
            Some(frames) => {
                frames.enter(grid, r, &mut self.turned);
                layer.enter(&self.turned, &mut self.passage);
            }
        }
        if !self.groups.is_empty() {
            let (n, cx) = (grid.plane(), grid.cx());
            self.face.resize(3 * n, 0.0);
            layer.face(&self.passage, &mut self.face);
            self.y.clear();
            for g in &self.groups {
                let mut mean = DVec3::ZERO;
                for [i, j] in &g.cells {
                    for d in 0..3 {
                        for b in 0..3 {
                            let row = &self.face[d * n + (j + b) * cx + i..][..3];
                            let along =
                                MIDDLE[0] * f64::from(row[0] + row[2]) + MIDDLE[1] * f64::from(row[1]);
                            mean[d] += MIDDLE[b] * along;
                        }
                    }
                }
                mean /= g.cells.len() as f64;
                self.y.extend(g.along.iter().map(|(v, _)| v.dot(mean) as f32));
            }
            self.factor.solve(&mut self.y);
            self.load.clear();
            self.load.resize(3 * n, 0.0);
            for g in &self.groups {
                let mut share = DVec3::ZERO;
                for ((v, _), y) in g.along.iter().zip(&self.y[g.first..]) {
                    share += *v * f64::from(*y);
                }
                share /= g.cells.len() as f64;
                for [i, j] in &g.cells {
                    for d in 0..3 {
                        for b in 0..3 {
                            let row = &mut self.load[d * n + (j + b) * cx + i..][..3];
                            for (to, weight) in row.iter_mut().zip(MIDDLE) {
                                *to += (share[d] * MIDDLE[b] * weight) as f32;
                            }
                        }
                    }
                }
            }
        }
        let load = if self.groups.is_empty() { None } else { Some(self.load.as_slice()) };
        layer.leave(&mut self.passage, load, z);
        if let Some(frames) = frames {
            frames.leave(grid, z);
        }
    }
}

/// Mean displacement of one group for a unit force spread over another.
fn mean_response(green: &FaceGreen, at: &Group, from: &Group) -> DMat3 {
    let mut sum = DMat3::ZERO;
    for p in &at.cells {
        for q in &from.cells {
            sum += green.response(*p, *q);
        }
    }
    sum * (1.0 / (at.cells.len() * from.cells.len()) as f64)
}

/// Springs of cells gathered in blocks of `block` x `block`, and how many there are.
fn gather(grid: &Grid, frames: Option<&Frames>, contacts: &Contacts, block: usize) -> (Vec<Group>, usize) {
    let across = grid.nx.div_ceil(block);
    let mut places: Vec<Option<Group>> = vec![None; across * grid.ny.div_ceil(block)];
    for a in contacts.active() {
        let slot = &mut places[(a.cell[1] / block) * across + a.cell[0] / block];
        let g = slot.get_or_insert_with(Group::default);
        if g.cells.last() != Some(&a.cell) && !g.cells.contains(&a.cell) {
            g.cells.push(a.cell);
        }
        for (sum, k) in g.stiffness.iter_mut().zip(a.stiffness) {
            *sum += k;
        }
        g.normal += a.normal;
    }
    let mut count = 0;
    let mut groups: Vec<Group> = places.into_iter().flatten().collect();
    for g in &mut groups {
        let n = g.normal.normalize_or(DVec3::NEG_Z);
        let t = n.any_orthonormal_vector();
        let axes = [n, t, n.cross(t)];
        let stiff = axes.map(|d| d.dot(times(&g.stiffness, d)));
        let largest = stiff.iter().copied().fold(0.0, f64::max);
        g.along = axes.into_iter().zip(stiff).filter(|(_, e)| *e > 1e-3 * largest).collect();
        if let Some(frames) = frames {
            let frame = frames.at_cell(grid, g.cells[0]);
            g.along.iter_mut().for_each(|(v, _)| *v = frame.transpose() * *v);
        }
        g.first = count;
        count += g.along.len();
    }
    (groups, count)
}

/// A symmetric matrix (xx, yy, zz, xy, xz, yz) times a vector.
fn times(k: &[f64; 6], d: DVec3) -> DVec3 {
    DVec3::new(
        k[0] * d.x + k[3] * d.y + k[4] * d.z,
        k[3] * d.x + k[1] * d.y + k[5] * d.z,
        k[4] * d.x + k[5] * d.y + k[2] * d.z,
    )
}

#[cfg(test)]
mod tests {
    use super::super::stack::Stack;
    use super::*;

    /// Mean displacement of a cell for a unit force along `c` on another, through the layer itself.
    fn solved(grid: &Grid, layer: &RestLayer, at: [usize; 2], from: [usize; 2], c: usize) -> DVec3 {
        let (cx, n) = (grid.cx(), grid.plane());
        let over = |cell: [usize; 2], visit: &mut dyn FnMut(usize, f64)| {
            for b in 0..3 {
                for a in 0..3 {
                    visit((cell[1] + b) * cx + cell[0] + a, MIDDLE[a] * MIDDLE[b]);
                }
            }
        };
        let (mut load, mut face) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        over(from, &mut |at, weight| load[c * n + at] = -weight as f32);
        let mut passage = Passage::default();
        let mut z = vec![0.0; grid.field_len()];
        layer.enter(&z.clone(), &mut passage);
        layer.leave(&mut passage, Some(&load), &mut z);
        for (c, face) in face.chunks_mut(n).enumerate() {
            face.copy_from_slice(&z[grid.at(c, grid.layers() - 1)..][..n]);
        }
        let mut out = DVec3::ZERO;
        for d in 0..3 {
            over(at, &mut |at, weight| out[d] += weight * f64::from(face[d * n + at]));
        }
        out
    }

    #[test]
    fn the_response_by_images_is_the_response_of_the_layer_also_beside_its_sides() {
        let grid = Grid::new([20.0, 14.0, 4.0], 1.2, 0.8, 1.25);
        let layer = RestLayer::new(&grid, &Stack::uniform(&grid, 0.05, 0.45));
        let green = FaceGreen::new(&grid, &layer);
        let cells = [[0, 0], [3, 1], [8, 5], [15, 10], [14, 0]];
        for at in cells {
            for from in cells {
                let response = green.response(at, from);
                for c in 0..3 {
                    let truth = solved(&grid, &layer, at, from, c);
                    let error = (response.col(c) - truth).length();
                    assert!(
                        error < 1e-4 * solved(&grid, &layer, from, from, c).length(),
                        "{at:?} {from:?} {c}"
                    );
                }
            }
        }
    }
}
