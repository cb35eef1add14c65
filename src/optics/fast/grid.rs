//! A table over the space in which the pad moves: position across, and height above the untouched face.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// `N` numbers at each node, linear in between.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid<const N: usize> {
    places: Places,
    values: Vec<[f32; N]>,
}

/// Where nodes stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    pub(super) low: Vec2,
    pub(super) per_mm: Vec2,
    pub(super) nodes: [usize; 3],
    pub(super) lift_low: f32,
    pub(super) lift_per_mm: f32,
    /// Height of the untouched face at the nodes across.
    pub(super) rest: Vec<f32>,
}

/// Where the nodes of a grid shall stand.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Corners of the rectangle across.
    pub across: [Vec2; 2],
    /// Distance of nodes across, mm, at most.
    pub step_mm: f32,
    /// Heights above the untouched face.
    pub lift_mm: [f32; 2],
    /// Distance of nodes upwards, mm, at most.
    pub lift_step_mm: f32,
}

impl Places {
    /// From a layout; `rest` gives the height of the untouched face.
    pub fn new(layout: &Layout, rest: impl Fn(Vec2) -> f32) -> Self {
        let [low, high] = layout.across;
        let count = |length: f32, step: f32| ((length / step).ceil() as usize).clamp(1, 400) + 1;
        let size = high - low;
        let rise = layout.lift_mm[1] - layout.lift_mm[0];
        let nodes =
            [count(size.x, layout.step_mm), count(size.y, layout.step_mm), count(rise, layout.lift_step_mm)];
        let mut places = Self {
            low,
            per_mm: Vec2::new((nodes[0] - 1) as f32, (nodes[1] - 1) as f32) / size,
            nodes,
            lift_low: layout.lift_mm[0],
            lift_per_mm: (nodes[2] - 1) as f32 / rise,
            rest: Vec::new(),
        };
        places.rest = (0..nodes[0] * nodes[1]).map(|k| rest(places.across(k))).collect();
        places
    }

    fn across(&self, column: usize) -> Vec2 {
        let [nx, ..] = self.nodes;
        self.low + Vec2::new((column % nx) as f32, (column / nx) as f32) / self.per_mm
    }

    /// Places on the untouched face alone, with so many steps for one across.
    pub fn face(&self, steps: usize) -> Self {
        let [nx, ny, _] = self.nodes;
        let nodes = [(nx - 1) * steps + 1, (ny - 1) * steps + 1, 2];
        let between = |k: usize| {
            let q = Vec2::new((k % nodes[0]) as f32, (k / nodes[0]) as f32) / steps as f32;
            let (i, j) = ((q.x as usize).min(nx - 2), (q.y as usize).min(ny - 2));
            let (s, t) = (q.x - i as f32, q.y - j as f32);
            let at = |i: usize, j: usize| self.rest[j * nx + i];
            let row = |j: usize| at(i, j) * (1.0 - s) + at(i + 1, j) * s;
            row(j) * (1.0 - t) + row(j + 1) * t
        };
        let rest = (0..nodes[0] * nodes[1]).map(between).collect();
        // (The second level stands just above the first.)
        Self { per_mm: self.per_mm * steps as f32, nodes, lift_low: 0.0, lift_per_mm: 1e3, rest, ..*self }
    }

    /// Whether the untouched face is no level plane.
    pub fn is_curved(&self) -> bool {
        self.rest.iter().any(|z| (z - self.rest[0]).abs() > 1e-4)
    }

    /// The four columns of nodes around a point, and the weight of each; beyond the grid those of its border.
    #[inline(always)]
    fn around(&self, point: Vec3) -> ([usize; 4], [f32; 4]) {
        let [nx, ny, _] = self.nodes;
        let q = (point.truncate() - self.low) * self.per_mm;
        let x = q.x.clamp(0.0, (nx - 1) as f32);
        let y = q.y.clamp(0.0, (ny - 1) as f32);
        let (i, j) = ((x as usize).min(nx - 2), (y as usize).min(ny - 2));
        let (fx, fy) = (x - i as f32, y - j as f32);
        let columns = [j * nx + i, j * nx + i + 1, (j + 1) * nx + i, (j + 1) * nx + i + 1];
        (columns, [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy])
    }

    /// How many nodes there are.
    pub fn count(&self) -> usize {
        self.rest.len() * self.nodes[2]
    }

    /// Where node `k` stands.
    pub fn point(&self, k: usize) -> Vec3 {
        let (column, level) = (k / self.nodes[2], k % self.nodes[2]);
        let lift = self.lift_low + level as f32 / self.lift_per_mm;
        self.across(column).extend(self.rest[column] + lift)
    }
}

impl<const N: usize> Grid<N> {
    /// Fills a grid. `rest` gives the height of the untouched face, `value` what to store at a point.
    pub fn new(
        layout: &Layout,
        rest: impl Fn(Vec2) -> f32 + Sync,
        value: impl Fn(Vec3) -> [f32; N] + Sync,
    ) -> Self {
        let places = Places::new(layout, rest);
        let values = (0..places.count()).into_par_iter().map(|k| value(places.point(k))).collect();
        Self { places, values }
    }

    /// The same with half the steps, for what is smooth: in the middle between two nodes is the cubic through the four around it.
    pub fn halved(&self, rest: impl Fn(Vec2) -> f32) -> Self {
        let [nx, ny, nz] = self.places.nodes;
        let values = doubled(&self.values, [nx * ny, nz, 1]);
        let values = doubled(&values, [ny, nx, 2 * nz - 1]);
        let values = doubled(&values, [1, ny, (2 * nx - 1) * (2 * nz - 1)]);
        let mut places = Places {
            nodes: self.places.nodes.map(|n| 2 * n - 1),
            per_mm: 2.0 * self.places.per_mm,
            lift_per_mm: 2.0 * self.places.lift_per_mm,
            rest: Vec::new(),
            ..self.places
        };
        places.rest =
            (0..places.nodes[0] * places.nodes[1]).map(|column| rest(places.across(column))).collect();
        Self { places, values }
    }

    /// A grid of known numbers, as many as places.
    pub fn from_values(places: Places, values: Vec<[f32; N]>) -> Self {
        Self { places, values }
    }

    /// Where its nodes stand, and their numbers.
    pub fn parts(&self) -> (&Places, &[[f32; N]]) {
        (&self.places, &self.values)
    }

    /// How far a point is above the untouched face, mm.
    pub fn lift(&self, point: Vec3) -> f32 {
        let (columns, weights) = self.places.around(point);
        point.z - (0..4).map(|c| self.places.rest[columns[c]] * weights[c]).sum::<f32>()
    }

    /// Normal of the untouched face under a point.
    pub fn rest_normal(&self, point: Vec3) -> Vec3 {
        let places = &self.places;
        let [nx, ny, _] = places.nodes;
        let q = (point.truncate() - places.low) * places.per_mm;
        let cell = |q: f32, n: usize| (q.max(0.0) as usize).min(n - 2);
        let at = |i: usize, j: usize| places.rest[(cell(q.y, ny) + j) * nx + cell(q.x, nx) + i];
        let slope = Vec2::new(at(1, 0) - at(0, 0), at(0, 1) - at(0, 0)) * places.per_mm;
        (-slope).extend(1.0).normalize()
    }

    /// The numbers at a point; beyond the grid those of its border.
    #[inline(always)]
    pub fn at(&self, point: Vec3) -> [f32; N] {
        let places = &self.places;
        let nz = places.nodes[2];
        let (columns, weights) = places.around(point);
        let rest: f32 = (0..4).map(|c| places.rest[columns[c]] * weights[c]).sum();
        let lift = (point.z - rest - places.lift_low) * places.lift_per_mm;
        let z = lift.clamp(0.0, (nz - 1) as f32);
        let level = (z as usize).min(nz - 2);
        let fz = z - level as f32;
        let mut out = [0.0; N];
        for c in 0..4 {
            let base = columns[c] * nz + level;
            let (a, b) = (&self.values[base], &self.values[base + 1]);
            let (wa, wb) = (weights[c] * (1.0 - fz), weights[c] * fz);
            for n in 0..N {
                out[n] += a[n] * wa + b[n] * wb;
            }
        }
        out
    }
}

/// Numbers along an axis, and those in the middle between them; so many lie before it, along it, and after it.
fn doubled<const N: usize>(values: &[[f32; N]], [before, along, after]: [usize; 3]) -> Vec<[f32; N]> {
    let mut out = Vec::with_capacity(before * (2 * along - 1) * after);
    for first in (0..before).map(|b| b * along * after) {
        for k in 0..2 * along - 1 {
            let (node, parts): (usize, &[f32]) = match (k % 2, k / 2) {
                (0, node) => (node, &[1.0]),
                _ if along < 4 => (k / 2, &[0.5, 0.5]),
                (_, 0) => (0, &[0.3125, 0.9375, -0.3125, 0.0625]),
                (_, node) if node + 2 == along => (along - 4, &[0.0625, -0.3125, 0.9375, 0.3125]),
                (_, node) => (node - 1, &[-0.0625, 0.5625, 0.5625, -0.0625]),
            };
            out.extend((0..after).map(|a| {
                let of = |i: usize| &values[first + (node + i) * after + a];
                std::array::from_fn(|n| parts.iter().enumerate().map(|(i, part)| part * of(i)[n]).sum())
            }));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_fields_are_exact_and_the_border_holds_beyond() {
        let layout = Layout {
            across: [Vec2::new(-3.0, -2.0), Vec2::new(3.0, 2.0)],
            step_mm: 0.7,
            lift_mm: [-0.5, 1.5],
            lift_step_mm: 0.3,
        };
        let grid = Grid::new(&layout, |p| 0.2 * p.x, |p| [p.x, p.y, p.z, 1.0]);
        for p in [Vec3::new(0.1, 0.3, 0.2), Vec3::new(-2.9, 1.9, 0.4), Vec3::new(3.0, -2.0, 2.0)] {
            let v = grid.at(p);
            assert!((Vec3::new(v[0], v[1], v[2]) - p).length() < 1e-5, "{p} {v:?}");
        }
        let v = grid.at(Vec3::new(5.0, 0.0, 0.6));
        assert!((v[0] - 3.0).abs() < 1e-5);
    }

    #[test]
    fn with_half_the_steps_cubics_are_exact_at_every_node() {
        let layout = Layout {
            across: [Vec2::new(-3.0, -2.0), Vec2::new(3.0, 2.0)],
            step_mm: 0.8,
            lift_mm: [-0.5, 1.5],
            lift_step_mm: 0.5,
        };
        let rest = |p: Vec2| 0.1 * p.x;
        let cubic = |p: Vec3| [p.x * p.x * p.x - p.y, p.y * p.y * p.z + 1.0, p.x * p.y * p.z];
        let coarse = Grid::new(&layout, rest, cubic);
        let fine = coarse.halved(rest);
        let (places, values) = fine.parts();
        assert_eq!((places.nodes, values.len()), (coarse.places.nodes.map(|n| 2 * n - 1), places.count()));
        for (k, found) in values.iter().enumerate() {
            let truth = cubic(places.point(k));
            assert!(
                (0..3).all(|n| (found[n] - truth[n]).abs() < 2e-5),
                "{}: {found:?} {truth:?}",
                places.point(k)
            );
        }
    }
}
