//! The undeformed pad inverted: the preconditioner of the solver.
//!
//! A rectangular layer whose sides are held as Navier held the edges of a plate, displacements along a side zero and
//! the one across it free, is decoupled by sines and cosines in the plane ([`super::waves`]): u_z and u_y run as sines
//! along x, u_x as cosines (the partners), and likewise along y. One small banded system through the depth is left for
//! each pair of wave numbers ([`super::modes`]), real and symmetric. The pad's own sides are free. They differ in shear
//! alone, which is soft: the stress across such a side is zero as it is across a free one, so that a nearly
//! incompressible pad can give way to all sides as it should. (On a torus it cannot, and the iterations grow with lambda
//! over mu: at nu 0.45 three times, at 0.49 beyond count.)
//!
//! Contact springs enter by the Woodbury formula, see `springs`: they ask for the face between the sweeps up and down
//! and answer with a load on it.

use super::grid::Grid;
use super::modes::Modes;
use super::stack::Stack;
use super::waves::{Product, TILE_ROWS, Waves};
use rayon::prelude::*;

/// The inverse of the rest-state operator, its sides held along themselves.
#[derive(Debug)]
pub struct RestLayer {
    layers: usize,
    x: Waves,
    y: Waves,
    modes: Modes,
}

/// A field on its way through the inverse.
#[derive(Debug, Default)]
pub struct Passage {
    /// `[y mode][layer without the base][component][padded x mode]`.
    waves: Vec<f32>,
    /// The face as it will be if no load is added: `[y mode][component][padded x]`.
    face: Vec<f32>,
}

/// The part that a component's waves play along x and y.
fn partners(c: usize) -> [usize; 2] {
    [usize::from(c == 0), usize::from(c == 1)]
}

impl RestLayer {
    /// Factors the rest state of a pad.
    pub fn new(grid: &Grid, stack: &Stack) -> Self {
        let (x, y) = (Waves::new(grid.cx()), Waves::new(grid.cy()));
        let modes = Modes::new(grid, stack, &x, &y);
        Self { layers: grid.layers(), x, y, modes }
    }

    fn plane(&self) -> usize {
        self.x.n * self.y.n
    }

    /// Unknowns of a mode.
    fn rows(&self) -> usize {
        3 * (self.layers - 1)
    }

    /// Some y modes from `first` on of a plane of control values of component `c`, to x modes in rows `stride` apart.
    fn to_waves(
        &self,
        c: usize,
        first: usize,
        plane: &[f32],
        half: &mut [f32],
        out: &mut [f32],
        stride: usize,
    ) {
        let ([odd_x, odd_y], s, n) = (partners(c), self.x.stride, self.x.n);
        let rows = half.len() / s;
        let y = (&self.y.forward[odd_y][first * self.y.stride..], self.y.stride);
        Product { a: y, b: (plane, n), rows, inner: self.y.n, columns: n }.to(half, s);
        let x = (self.x.back[odd_x].as_slice(), s);
        Product { a: (half, s), b: x, rows, inner: n, columns: n }.to(out, stride);
    }

    /// Takes a field to wave space and sweeps every mode up to the face.
    pub fn enter(&self, r: &[f32], passage: &mut Passage) {
        let (n, s, per_mode) = (self.plane(), self.x.stride, self.rows() * self.x.stride);
        passage.waves.resize(self.y.n * per_mode, 0.0);
        passage.face.resize(self.y.n * 3 * s, 0.0);
        let pieces = passage.waves.par_chunks_mut(TILE_ROWS * per_mode);
        let faces = passage.face.par_chunks_mut(TILE_ROWS * 3 * s);
        pieces.zip(faces).enumerate().for_each(|(tile, (waves, face))| {
            let first = tile * TILE_ROWS;
            let mut half = vec![0.0; waves.len() / self.rows()];
            for i in 0..self.rows() {
                let (k, c) = (i / 3 + 1, i % 3);
                let plane = &r[(c * self.layers + k) * n..];
                self.to_waves(c, first, plane, &mut half, &mut waves[i * s..], per_mode);
            }
            let mut modes = vec![0.0; face.len()];
            for (m, (waves, modes)) in waves.chunks_mut(per_mode).zip(modes.chunks_mut(3 * s)).enumerate() {
                self.modes.up(first + m, waves, modes);
            }
            for c in 0..3 {
                self.along_x(c, &modes[c * s..], half.len() / s, &mut face[c * s..], 3 * s);
            }
        });
    }

    /// Some rows of x modes of component `c`, `stride` apart, back to points.
    fn along_x(&self, c: usize, from: &[f32], rows: usize, to: &mut [f32], stride: usize) {
        let x = (self.x.forward[partners(c)[0]].as_slice(), self.x.stride);
        let n = self.x.n;
        Product { a: (from, stride), b: x, rows, inner: n, columns: n }.to(to, stride);
    }

    /// Rows of y modes of component `c`, `from.1` apart, back to a plane of control values.
    fn along_y(&self, c: usize, from: (&[f32], usize), plane: &mut [f32]) {
        let y = (self.y.back[partners(c)[1]].as_slice(), self.y.stride);
        let n = self.x.n;
        Product { a: y, b: from, rows: self.y.n, inner: self.y.n, columns: n }.to(plane, n);
    }

    /// The face, three planes of control values, if no load is added.
    pub fn face(&self, passage: &Passage, face: &mut [f32]) {
        let s = self.x.stride;
        face.par_chunks_mut(self.plane()).enumerate().for_each(|(c, plane)| {
            self.along_y(c, (&passage.face[c * s..], 3 * s), plane);
        });
    }

    /// Takes away the response to a load on the face, three planes of control values, if there is any, and goes back
    /// to control points.
    pub fn leave(&self, passage: &mut Passage, load: Option<&[f32]>, z: &mut [f32]) {
        let (n, s, rows) = (self.plane(), self.x.stride, self.rows());
        let per_mode = rows * s;
        passage.waves.par_chunks_mut(TILE_ROWS * per_mode).enumerate().for_each(|(tile, waves)| {
            let first = tile * TILE_ROWS;
            let count = waves.len() / per_mode;
            let mut loads = vec![0.0; count * 3 * s];
            if let Some(load) = load {
                let mut half = vec![0.0; count * s];
                for (c, plane) in load.chunks(n).enumerate() {
                    self.to_waves(c, first, plane, &mut half, &mut loads[c * s..], 3 * s);
                }
            }
            for (m, (waves, loads)) in waves.chunks_mut(per_mode).zip(loads.chunks(3 * s)).enumerate() {
                self.modes.down(first + m, load.map(|_| loads), waves);
            }
            let solved = waves.to_vec();
            for i in 0..rows {
                self.along_x(i % 3, &solved[i * s..], count, &mut waves[i * s..], per_mode);
            }
        });
        z.par_chunks_mut(n).enumerate().for_each(|(plane, out)| {
            let (c, k) = (plane / self.layers, plane % self.layers);
            if k == 0 {
                out.fill(0.0);
            } else {
                self.along_y(c, (&passage.waves[(3 * (k - 1) + c) * s..], per_mode), out);
            }
        });
    }

    /// Response of the face, `[component][y mode][x mode]`, to a unit load of component `c` in every mode.
    pub fn face_modes(&self, c: usize) -> [Vec<f32>; 3] {
        let s = self.x.stride;
        let mut out = [Vec::new(), Vec::new(), Vec::new()];
        for my in 0..self.y.n {
            let face = self.modes.face_response(my, c);
            for (out, row) in out.iter_mut().zip(face.chunks(s)) {
                out.extend_from_slice(&row[..self.x.n]);
            }
        }
        out
    }
}
