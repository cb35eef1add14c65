//! The part of the face that the indenter can reach.
//!
//! A sample point that it cannot reach exchanges nothing and has nothing to remember. So points are kept for a window of
//! cells alone, which is widened as soon as the displaced face, or the next pose, may bring another point under the
//! indenter: a quadratic spline lies between the least and the greatest of its control values.

use super::super::chart::Chart;
use super::super::grid::Grid;
use super::{Contacts, Sample};
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use std::ops::Range;

/// What rounding may add to a displacement, mm.
const ROUNDING_MM: f64 = 1e-6;

/// The sample points of the whole face, at rest.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    /// Cells along x and y.
    cells: [usize; 2],
    /// Width of a cell along x and y, mm.
    width_mm: [f64; 2],
    /// Of the pad, mm.
    size_mm: [f64; 2],
    /// Points along one edge of a cell.
    pub(super) per_axis: usize,
    /// Area of a point on a flat face, mm^2.
    pub(super) area_mm2: f64,
    /// What bends the face, if anything does.
    pub(super) chart: Option<Chart>,
}

impl Lattice {
    /// Of the face of `grid`.
    pub fn new(grid: &Grid, chart: Option<Chart>, per_axis: usize) -> Self {
        Self {
            cells: [grid.nx, grid.ny],
            width_mm: [grid.hx, grid.hy],
            size_mm: [grid.size[0], grid.size[1]],
            per_axis,
            area_mm2: grid.hx * grid.hy / (per_axis * per_axis) as f64,
            chart,
        }
    }

    /// Points of a cell.
    pub fn per_cell(&self) -> usize {
        self.per_axis * self.per_axis
    }

    /// Points of the face along x and y.
    pub fn points(&self) -> [usize; 2] {
        self.cells.map(|n| n * self.per_axis)
    }

    /// Where a point lies between the sides of its cell, counted along one axis, as a part of them.
    pub fn offset(&self, along: usize) -> f64 {
        (along as f64 + 0.5) / self.per_axis as f64
    }

    /// Where a point is in [`Self::points`].
    pub fn place(&self, cell: [usize; 2], sub: usize) -> [usize; 2] {
        [cell[0] * self.per_axis + sub % self.per_axis, cell[1] * self.per_axis + sub / self.per_axis]
    }

    /// Rest position of a point.
    fn rest(&self, cell: [usize; 2], sub: usize) -> DVec3 {
        let along = [sub % self.per_axis, sub / self.per_axis];
        let [x, y] = [0, 1]
            .map(|a| -self.size_mm[a] / 2.0 + self.width_mm[a] * (cell[a] as f64 + self.offset(along[a])));
        DVec3::new(x, y, self.chart.map_or(0.0, |chart| chart.height_mm(x, y)))
    }

    /// A point that nothing has touched.
    pub fn untouched(&self, cell: [usize; 2], sub: usize) -> Sample {
        let rest = self.rest(cell, sub);
        let stretch = self.chart.map_or(1.0, |chart| chart.stretch(rest.x, rest.y));
        Sample {
            cell,
            sub,
            rest,
            area: self.area_mm2 * stretch,
            multiplier: 0.0,
            loaded: false,
            anchor: None,
            let_go: false,
            gap: f64::INFINITY,
            seen: DVec3::ZERO,
            pressure: 0.0,
            old_u: DVec3::ZERO,
            pushed_by: None,
            entry: None,
        }
    }

    /// Rest positions of the points that may be under the indenter, row by row.
    pub fn under(&self, indenter: &dyn Indenter, pose: &Pose) -> impl Iterator<Item = DVec3> + '_ {
        let window = self.window(indenter, pose, [[0.0; 2]; 2]);
        window.cells().flat_map(move |cell| (0..self.per_cell()).map(move |sub| self.rest(cell, sub)))
    }

    /// The cells with points that may be under the indenter when displacements along x and y are between these bounds, mm.
    fn window(&self, indenter: &dyn Indenter, pose: &Pose, moved_mm: [[f64; 2]; 2]) -> Window {
        let [hx, hy] = indenter.half_extent_mm();
        let (sin, cos) = pose.theta_deg.to_radians().sin_cos();
        let half = [cos.abs() * hx + sin.abs() * hy, sin.abs() * hx + cos.abs() * hy];
        let at = [pose.x_mm, pose.y_mm];
        let [x, y] = [0, 1].map(|a| {
            let [least, most] = moved_mm[a];
            let from_side = at[a] + self.size_mm[a] / 2.0;
            let first = (from_side - half[a] - most - ROUNDING_MM) / self.width_mm[a];
            let last = (from_side + half[a] - least + ROUNDING_MM) / self.width_mm[a];
            // (A conversion ends at 0, and at the largest number.)
            first.floor() as usize..(last.ceil() as usize).min(self.cells[a])
        });
        Window { x, y }
    }
}

/// Some cells of the face, whole rows of a rectangle.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Window {
    x: Range<usize>,
    y: Range<usize>,
}

impl Window {
    fn is_empty(&self) -> bool {
        self.x.is_empty() || self.y.is_empty()
    }

    /// Cells along x.
    pub fn width(&self) -> usize {
        self.x.len()
    }

    /// The least rectangle around both.
    fn with(&self, other: &Self) -> Self {
        if other.is_empty() {
            return self.clone();
        }
        if self.is_empty() {
            return other.clone();
        }
        let around = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        Self { x: around(&self.x, &other.x), y: around(&self.y, &other.y) }
    }

    fn contains(&self, cell: [usize; 2]) -> bool {
        self.x.contains(&cell[0]) && self.y.contains(&cell[1])
    }

    /// Row by row.
    pub fn cells(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let x = self.x.clone();
        self.y.clone().flat_map(move |j| x.clone().map(move |i| [i, j]))
    }
}

impl Contacts {
    /// Keeps points for an increment that begins from displacement `u`: those that have something to remember, and those
    /// that the indenter may meet.
    pub(super) fn keep_within_reach(&mut self, indenter: &dyn Indenter, poses: [&Pose; 2], u: &[f32]) {
        let moved_mm = self.displacement_bounds(u);
        let mut window = Window::default();
        for pose in poses {
            window = window.with(&self.lattice.window(indenter, pose, moved_mm));
        }
        for s in self.samples.iter().filter(|s| s.remembers()) {
            let [i, j] = s.cell;
            window = window.with(&Window { x: i..i + 1, y: j..j + 1 });
        }
        self.keep(window);
    }

    /// Adds the points that displacement `u` may bring under the indenter.
    pub(super) fn reach(&mut self, indenter: &dyn Indenter, pose: &Pose, u: &[f32]) {
        let window = self.lattice.window(indenter, pose, self.displacement_bounds(u));
        self.keep(window.with(&self.window));
    }

    /// Keeps the points of these cells alone.
    fn keep(&mut self, window: Window) {
        if window == self.window {
            return;
        }
        let mut kept =
            std::mem::take(&mut self.samples).into_iter().filter(|s| window.contains(s.cell)).peekable();
        let lattice = &self.lattice;
        let points = window.cells().flat_map(|cell| (0..lattice.per_cell()).map(move |sub| (cell, sub)));
        self.samples = points
            .map(|(cell, sub)| {
                kept.next_if(|s| s.cell == cell).unwrap_or_else(|| lattice.untouched(cell, sub))
            })
            .collect();
        self.window = window;
    }

    /// Least and greatest displacement of the face along x and along y, mm.
    fn displacement_bounds(&self, u: &[f32]) -> [[f64; 2]; 2] {
        [0, 1].map(|c| {
            let (mut least, mut most) = (0.0f32, 0.0f32);
            for v in &u[self.face[c]..self.face[c] + self.plane] {
                least = if *v < least { *v } else { least };
                most = if *v > most { *v } else { most };
            }
            [f64::from(least), f64::from(most)]
        })
    }
}

impl Sample {
    /// Whether this has anything to remember of what touched it.
    fn remembers(&self) -> bool {
        self.loaded || self.pressure != 0.0 || self.multiplier != 0.0 || self.anchor.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastomer::Friction;
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};

    /// All points of the face that are under the indenter when it is displaced by `moved_mm`.
    fn all_under(
        lattice: &Lattice,
        half: [f64; 2],
        pose: &Pose,
        moved_mm: DVec3,
    ) -> Vec<([usize; 2], usize)> {
        let whole = Window { x: 0..lattice.cells[0], y: 0..lattice.cells[1] };
        let points = whole.cells().flat_map(|cell| (0..lattice.per_cell()).map(move |sub| (cell, sub)));
        let inside = |(cell, sub): &([usize; 2], usize)| {
            let p = pose.to_indenter(lattice.rest(*cell, *sub) + moved_mm);
            p.x.abs() <= half[0] && p.y.abs() <= half[1]
        };
        points.filter(inside).collect()
    }

    #[test]
    fn every_point_under_the_indenter_is_kept_wherever_the_face_has_moved() {
        let shape = Shape::Flat { plan: Plan::Rectangle { x_mm: 9.0, y_mm: 0.7 } };
        let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 4.0, shape };
        let bar = from_spec("bar", &spec, None).unwrap();
        let grid = Grid::new([20.0, 14.0, 4.0], 0.9, 1.0, 1.3);
        let mut found = 0;
        for (x, y, theta) in
            [(0.0, 0.0, 0.0), (3.1, -2.2, 30.0), (-8.0, 6.0, 100.0), (14.0, 0.0, 75.0), (40.0, 0.0, 0.0)]
        {
            for moved in [DVec3::ZERO, DVec3::new(0.8, -0.3, -0.5), DVec3::new(-2.5, 1.1, 0.1)] {
                let pose = Pose::new(x, y, -0.5, theta);
                let mut contacts = Contacts::new(&grid, None, 2, 1.0, Friction::Infinite, 0.05);
                let mut u = vec![0.0; grid.field_len()];
                for (face, moved) in contacts.face.iter().zip(moved.to_array()) {
                    u[*face..face + grid.plane()].fill(moved as f32);
                }
                contacts.reach(bar.as_ref(), &pose, &u);
                let under = all_under(&contacts.lattice, bar.half_extent_mm(), &pose, moved);
                let kept = |(cell, sub): &([usize; 2], usize)| {
                    contacts.samples.iter().any(|s| s.cell == *cell && s.sub == *sub)
                };
                assert!(under.iter().all(kept), "{pose:?} {moved}");
                found += under.len();
            }
        }
        assert!(found > 300, "{found} points were looked for");
    }

    #[test]
    fn a_window_that_grows_or_moves_on_keeps_what_points_remember() {
        let spec = IndenterSpec {
            description: String::new(),
            edge_round_mm: 0.0,
            height_mm: 4.0,
            shape: Shape::Dome { radius_mm: 2.0, diameter_mm: 4.0 },
        };
        let ball = from_spec("ball", &spec, None).unwrap();
        let grid = Grid::new([20.0, 14.0, 4.0], 0.9, 1.0, 1.3);
        let mut contacts = Contacts::new(&grid, None, 2, 1.0, Friction::Infinite, 0.05);
        let u = vec![0.0; grid.field_len()];
        let [here, there] = [Pose::new(-3.0, 0.0, -0.5, 0.0), Pose::new(4.0, 1.0, -0.5, 0.0)];
        contacts.reach(ball.as_ref(), &here, &u);
        let few = contacts.samples.len();
        let marked = contacts.samples[few / 2].cell;
        for s in contacts.samples.iter_mut().filter(|s| s.cell == marked) {
            s.multiplier = 0.25;
        }
        for widen in [true, false] {
            match widen {
                true => contacts.reach(ball.as_ref(), &there, &u),
                false => contacts.keep_within_reach(ball.as_ref(), [&there, &there], &u),
            }
            let remembered = contacts.samples.iter().filter(|s| s.multiplier == 0.25);
            assert!(remembered.clone().all(|s| s.cell == marked) && remembered.count() == 4);
            assert!(contacts.samples.is_sorted_by_key(|s| (s.cell[1], s.cell[0], s.sub)));
            assert_eq!(contacts.samples.len(), 4 * contacts.window.x.len() * contacts.window.y.len());
        }
        contacts.keep_within_reach(ball.as_ref(), [&here, &here], &u);
        assert_eq!(contacts.samples.len(), few);
    }
}
