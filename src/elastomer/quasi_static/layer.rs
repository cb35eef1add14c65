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
use super::mirror::Plane;
use super::modes::Modes;
use super::stack::Stack;
use super::waves::{Kind, Product, TILE_ROWS, Waves};
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
    /// Planes of what comes in, and then of the load on the face, folded along both axes ([`super::mirror`]): `[component][layer without the base][y][x]`.
    folded: Vec<f32>,
    /// `[y mode][layer without the base][component][padded x mode]`.
    waves: Vec<f32>,
    /// The face as it will be if no load is added: `[y mode][component][padded folded x]`.
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

    fn points(&self) -> Plane {
        Plane([self.x.n, self.y.n])
    }

    /// Unknowns of a mode.
    fn rows(&self) -> usize {
        3 * (self.layers - 1)
    }

    /// Some y modes from `first` on of a folded plane of component `c`, to x modes in rows `stride` apart.
    fn to_waves(
        &self,
        c: usize,
        first: usize,
        folded: &[f32],
        half: &mut [f32],
        out: &mut [f32],
        stride: usize,
    ) {
        let ([odd_x, odd_y], s, n) = (partners(c), self.x.stride, self.x.n);
        let rows = half.len() / s;
        for Kind { waves, points } in self.y.kinds(odd_y) {
            let (from, to) = (waves.start.max(first), waves.end.min(first + rows));
            if from < to {
                let y = (&self.y.forward[odd_y][from * self.y.table_stride..], self.y.table_stride);
                let plane = (&folded[points.start * n..], n);
                Product { a: y, b: plane, rows: to - from, inner: points.len(), columns: n }
                    .to(&mut half[(from - first) * s..], s);
            }
        }
        for Kind { waves, points } in self.x.kinds(odd_x) {
            let x = (&self.x.back[odd_x][points.start * self.x.table_stride..], self.x.table_stride);
            Product { a: (&half[points.start..], s), b: x, rows, inner: points.len(), columns: waves.len() }
                .to(&mut out[waves.start..], stride);
        }
    }

    /// Takes a field to wave space and sweeps every mode up to the face.
    pub fn enter(&self, r: &[f32], passage: &mut Passage) {
        let (n, s, per_mode) = (self.plane(), self.x.stride, self.rows() * self.x.stride);
        let Passage { folded, waves, face } = passage;
        folded.resize(self.rows() * n, 0.0);
        waves.resize(self.y.n * per_mode, 0.0);
        face.resize(self.y.n * 3 * s, 0.0);
        folded.par_chunks_exact_mut(n).enumerate().for_each(|(i, folded)| {
            let (c, k) = (i / (self.layers - 1), i % (self.layers - 1) + 1);
            self.points().fold(&r[(c * self.layers + k) * n..][..n], folded);
        });
        let pieces = waves.par_chunks_mut(TILE_ROWS * per_mode);
        let faces = face.par_chunks_mut(TILE_ROWS * 3 * s);
        pieces.zip(faces).enumerate().for_each(|(tile, (waves, face))| {
            let first = tile * TILE_ROWS;
            let mut half = vec![0.0; waves.len() / self.rows()];
            for i in 0..self.rows() {
                let (k, c) = (i / 3, i % 3);
                let plane = &folded[(c * (self.layers - 1) + k) * n..][..n];
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

    /// Some rows of x modes of component `c`, `stride` apart, back to folded points.
    fn along_x(&self, c: usize, from: &[f32], rows: usize, to: &mut [f32], stride: usize) {
        let odd = partners(c)[0];
        for Kind { waves, points } in self.x.kinds(odd) {
            let x = (&self.x.forward[odd][waves.start * self.x.table_stride..], self.x.table_stride);
            Product {
                a: (&from[waves.start..], stride),
                b: x,
                rows,
                inner: waves.len(),
                columns: points.len(),
            }
            .to(&mut to[points.start..], stride);
        }
    }

    /// Rows of y modes of component `c`, `stride` apart, of folded points along x back to a plane of control values.
    fn along_y(&self, c: usize, from: &[f32], stride: usize, plane: &mut [f32]) {
        let (odd, n) = (partners(c)[1], self.x.n);
        let mut folded = vec![0.0; plane.len()];
        for Kind { waves, points } in self.y.kinds(odd) {
            let y = (&self.y.back[odd][points.start * self.y.table_stride..], self.y.table_stride);
            let modes = (&from[waves.start * stride..], stride);
            Product { a: y, b: modes, rows: points.len(), inner: waves.len(), columns: n }
                .to(&mut folded[points.start * n..], n);
        }
        self.points().unfold(&folded, plane);
    }

    /// The face, three planes of control values, if no load is added.
    pub fn face(&self, passage: &Passage, face: &mut [f32]) {
        let s = self.x.stride;
        face.par_chunks_mut(self.plane()).enumerate().for_each(|(c, plane)| {
            self.along_y(c, &passage.face[c * s..], 3 * s, plane);
        });
    }

    /// Takes away the response to a load on the face, three planes of control values, if there is any, and goes back
    /// to control points.
    pub fn leave(&self, passage: &mut Passage, load: Option<&[f32]>, z: &mut [f32]) {
        let (n, s, rows) = (self.plane(), self.x.stride, self.rows());
        let per_mode = rows * s;
        let Passage { folded, waves, .. } = passage;
        if let Some(load) = load {
            for (plane, folded) in load.chunks_exact(n).zip(folded.chunks_exact_mut(n)) {
                self.points().fold(plane, folded);
            }
        }
        waves.par_chunks_mut(TILE_ROWS * per_mode).enumerate().for_each(|(tile, waves)| {
            let first = tile * TILE_ROWS;
            let count = waves.len() / per_mode;
            let mut loads = vec![0.0; count * 3 * s];
            if load.is_some() {
                let mut half = vec![0.0; count * s];
                for (c, plane) in folded.chunks_exact(n).take(3).enumerate() {
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
                self.along_y(c, &waves[(3 * (k - 1) + c) * s..], per_mode, out);
            }
        });
    }

    /// Response of the face, `[component][half waves along y - 1][half waves along x - 1]`, to a unit load of component `c` in
    /// every mode.
    pub fn face_modes(&self, c: usize) -> [Vec<f32>; 3] {
        let (s, n) = (self.x.stride, self.x.n);
        let mut out = [0; 3].map(|_| vec![0.0; self.plane()]);
        for (place, wave_y) in self.y.numbers.iter().enumerate() {
            let face = self.modes.face_response(place, c);
            for (out, row) in out.iter_mut().zip(face.chunks(s)) {
                for (wave_x, response) in self.x.numbers.iter().zip(row) {
                    out[(wave_y - 1) * n + wave_x - 1] = *response;
                }
            }
        }
        out
    }
}
