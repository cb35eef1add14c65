//! A table over the space in which the pad moves: position across, and height above the untouched face.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// `N` numbers at each node, linear in between.
#[derive(Debug, Clone)]
pub struct Grid<const N: usize> {
    low: Vec2,
    per_mm: Vec2,
    nodes: [usize; 3],
    lift_low: f32,
    lift_per_mm: f32,
    /// Height of the untouched face at the nodes across.
    rest: Vec<f32>,
    values: Vec<[f32; N]>,
}

/// Where the nodes of a grid stand.
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

impl<const N: usize> Grid<N> {
    /// Fills a grid. `rest` gives the height of the untouched face, `value` what to store at a point.
    pub fn new(
        layout: &Layout,
        rest: impl Fn(Vec2) -> f32 + Sync,
        value: impl Fn(Vec3) -> [f32; N] + Sync,
    ) -> Self {
        let [low, high] = layout.across;
        let count = |length: f32, step: f32| ((length / step).ceil() as usize).clamp(1, 400) + 1;
        let size = high - low;
        let rise = layout.lift_mm[1] - layout.lift_mm[0];
        let nodes =
            [count(size.x, layout.step_mm), count(size.y, layout.step_mm), count(rise, layout.lift_step_mm)];
        let per_mm = Vec2::new((nodes[0] - 1) as f32, (nodes[1] - 1) as f32) / size;
        let lift_per_mm = (nodes[2] - 1) as f32 / rise;
        let at = |k: usize| low + Vec2::new((k % nodes[0]) as f32, (k / nodes[0]) as f32) / per_mm;
        let rest: Vec<f32> = (0..nodes[0] * nodes[1]).map(|k| rest(at(k))).collect();
        let values = (0..rest.len() * nodes[2])
            .into_par_iter()
            .map(|k| {
                let (column, level) = (k / nodes[2], k % nodes[2]);
                let lift = layout.lift_mm[0] + level as f32 / lift_per_mm;
                value(at(column).extend(rest[column] + lift))
            })
            .collect();
        Self { low, per_mm, nodes, lift_low: layout.lift_mm[0], lift_per_mm, rest, values }
    }

    /// The numbers at a point; beyond the grid those of its border, and false.
    #[inline]
    pub fn at(&self, point: Vec3) -> ([f32; N], bool) {
        let [nx, ny, nz] = self.nodes;
        let q = (point.truncate() - self.low) * self.per_mm;
        let x = q.x.clamp(0.0, (nx - 1) as f32);
        let y = q.y.clamp(0.0, (ny - 1) as f32);
        let (i, j) = ((x as usize).min(nx - 2), (y as usize).min(ny - 2));
        let (fx, fy) = (x - i as f32, y - j as f32);
        let columns = [j * nx + i, j * nx + i + 1, (j + 1) * nx + i, (j + 1) * nx + i + 1];
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        let rest: f32 = (0..4).map(|c| self.rest[columns[c]] * weights[c]).sum();
        let lift = (point.z - rest - self.lift_low) * self.lift_per_mm;
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
        let tolerance = 1e-3;
        let inside =
            (q.x - x).abs() <= tolerance && (q.y - y).abs() <= tolerance && (lift - z).abs() <= tolerance;
        (out, inside)
    }
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
            let (v, inside) = grid.at(p);
            assert!(inside && (Vec3::new(v[0], v[1], v[2]) - p).length() < 1e-5, "{p} {v:?}");
        }
        let (v, inside) = grid.at(Vec3::new(5.0, 0.0, 0.6));
        assert!(!inside && (v[0] - 3.0).abs() < 1e-5);
    }
}
