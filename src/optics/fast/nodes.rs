//! The nodes of a picture, every few pixels: what blocks between them are interpolated from.
//!
//! Where little will do, every second along x and y is worked out and those between follow from their four neighbours,
//! unless the pad bends there, a light is near, or one of the four sees something else.

use super::frame::{Frame, NODE_PX};
use super::lanes::{WIDTH, Work, with_widest};
use super::shade::falls_off;
use super::slots::POSITION;
use glam::Vec3;
use rayon::prelude::*;

/// Nodes from one that is worked out to the next, where little will do.
const SPARSE: usize = 2;

impl<const N: usize> Frame<'_, N> {
    /// Nodes along x and y.
    pub fn node_counts(&self) -> [usize; 2] {
        let camera = &self.once.view.camera;
        [camera.width.div_ceil(NODE_PX) + 1, camera.height.div_ceil(NODE_PX) + 1]
    }

    /// All nodes, row by row. A node where no pad is seen has no number as its position.
    pub(super) fn nodes(&self) -> Vec<f32> {
        let [columns, rows] = self.node_counts();
        let every = |step: usize, n: usize| -> Vec<usize> {
            (0..n - 1).step_by(step).chain(std::iter::once(n - 1)).collect()
        };
        if !self.effort.sparse || self.effort.thorough {
            return self.worked_out(&every(1, columns), &every(1, rows));
        }
        let (few_columns, few_rows) = (every(SPARSE, columns), every(SPARSE, rows));
        let few = self.worked_out(&few_columns, &few_rows);
        let wrong = (self.effort.field * self.mean_level(&few)).max(1e-30);
        let weights = (0..self.once.sources.len()).map(|l| self.strength(l) / wrong).collect();
        let sparse = Sparse { columns: few_columns, rows: few_rows, nodes: few, weights };
        let stride = self.slots.stride();
        let mut nodes = vec![0.0; columns * rows * stride];
        nodes.par_chunks_mut(columns * stride).enumerate().for_each(|(row, out)| {
            with_widest(Between { frame: self, sparse: &sparse, row, out });
        });
        nodes
    }

    fn worked_out(&self, columns: &[usize], rows: &[usize]) -> Vec<f32> {
        let width = columns.len() * self.slots.stride();
        let mut nodes = vec![0.0; width * rows.len()];
        nodes.par_chunks_mut(width).zip(rows).for_each(|(out, &row)| {
            with_widest(NodeRow { frame: self, columns, row, out });
        });
        nodes
    }

    /// Where the corner of pixels at a node stands, in pixels.
    fn pixel_of(&self, [i, j]: [usize; 2]) -> [usize; 2] {
        let camera = &self.once.view.camera;
        [(i * NODE_PX).min(camera.width), (j * NODE_PX).min(camera.height)]
    }

    /// Works out nodes, up to eight at once.
    #[inline(always)]
    fn fill_nodes(&self, at: &[[usize; 2]], nodes: &mut [f32]) {
        let mut points = [Vec3::ZERO; WIDTH];
        let mut seen = [false; WIDTH];
        for (k, at) in at.iter().enumerate() {
            let [x, y] = self.pixel_of(*at);
            if let Some((p, _)) = self.corner(x, y) {
                (points[k], seen[k]) = (p, true);
            }
        }
        self.fill(&points[..at.len()], nodes);
        for (node, _) in nodes.chunks_exact_mut(self.slots.stride()).zip(seen).filter(|(_, seen)| !seen) {
            node[POSITION] = f32::NAN;
        }
    }
}

struct NodeRow<'a, const N: usize> {
    frame: &'a Frame<'a, N>,
    columns: &'a [usize],
    row: usize,
    out: &'a mut [f32],
}

impl<const N: usize> Work for NodeRow<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { frame, columns, row, out } = self;
        let stride = frame.slots.stride();
        for (columns, nodes) in columns.chunks(WIDTH).zip(out.chunks_mut(WIDTH * stride)) {
            let mut at = [[0; 2]; WIDTH];
            columns.iter().zip(&mut at).for_each(|(i, at)| *at = [*i, row]);
            frame.fill_nodes(&at[..columns.len()], nodes);
        }
    }
}

/// Nodes that have been worked out.
struct Sparse {
    columns: Vec<usize>,
    rows: Vec<usize>,
    nodes: Vec<f32>,
    /// What irradiance of a light counts for, as part of what may be wrong.
    weights: Vec<f32>,
}

/// A row of all nodes.
struct Between<'a, const N: usize> {
    frame: &'a Frame<'a, N>,
    sparse: &'a Sparse,
    row: usize,
    out: &'a mut [f32],
}

impl<const N: usize> Work for Between<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { frame, sparse, row, out } = self;
        let stride = frame.slots.stride();
        let (j, ahead) = place(&sparse.rows, row);
        let mut alone = Vec::with_capacity(WIDTH);
        let mut own = vec![0.0; WIDTH * stride];
        let mut put = |alone: &mut Vec<[usize; 2]>, out: &mut [f32]| {
            frame.fill_nodes(alone, &mut own[..alone.len() * stride]);
            for (at, node) in alone.drain(..).zip(own.chunks_exact(stride)) {
                out[at[0] * stride..][..stride].copy_from_slice(node);
            }
        };
        for i in 0..out.len() / stride {
            let (k, aside) = place(&sparse.columns, i);
            let node =
                |k: usize, j: usize| &sparse.nodes[(j * sparse.columns.len() + k) * stride..][..stride];
            if [k + aside, j + ahead] == [k, j] {
                out[i * stride..][..stride].copy_from_slice(node(k, j));
                continue;
            }
            let (right, below) = (k + aside, j + ahead);
            let four = [node(k, j), node(right, j), node(k, below), node(right, below)];
            let [x, y] = frame.pixel_of([i, row]);
            let [x0, y0] = frame.pixel_of([sparse.columns[k], sparse.rows[j]]);
            let [x1, y1] = frame.pixel_of([sparse.columns[right], sparse.rows[below]]);
            let part = |at: usize, from: usize, to: usize| (at - from) as f32 / (to - from).max(1) as f32;
            let uv = [part(x, x0, x1), part(y, y0, y1)];
            match frame.corner(x, y).filter(|(p, _)| frame.follows(*p, four, uv, &sparse.weights)) {
                Some((p, _)) => frame.fill_between(p, four, uv, &mut out[i * stride..][..stride]),
                None => {
                    alone.push([i, row]);
                    if alone.len() == WIDTH {
                        put(&mut alone, out);
                    }
                }
            }
        }
        if !alone.is_empty() {
            put(&mut alone, out);
        }
    }
}

/// Which of `some` is the last that is not after `at`, and 1 if `at` lies between that and the next.
fn place(some: &[usize], at: usize) -> (usize, usize) {
    let k = some.partition_point(|s| *s <= at) - 1;
    (k, usize::from(some[k] != at))
}

impl<const N: usize> Frame<'_, N> {
    /// Whether what a node holds follows from four around it: the pad does not bend between them, no light is near, and they are
    /// all on the same side of each.
    #[inline(always)]
    fn follows(&self, p: Vec3, four: [&[f32]; 4], [u, v]: [f32; 2], weights: &[f32]) -> bool {
        if four.iter().any(|n| n[POSITION].is_nan()) {
            return false;
        }
        let [a, b, c, d] = four.map(|n| n[POSITION + 2]);
        let mean = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
        let bent = (p.z - mean).abs();
        if bent.max((a + d - b - c).abs()) > self.effort.curved_mm {
            return false;
        }
        let [first, .., last] = four.map(|n| Vec3::from_slice(&n[POSITION..]));
        let size2 = (last - first).length_squared();
        self.once.sources.iter().zip(weights).enumerate().all(|(l, (source, weight))| {
            let faced = four.map(|n| n[self.slots.gain(l)] > 0.0);
            let field = Vec3::from_slice(&four[0][self.slots.direct(l)..]).abs().max_element() * weight;
            faced.iter().all(|f| *f == faced[0]) && !falls_off(&source.around(), p, field, size2, bent)
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::optics::bench_scene::Variant;
    use crate::optics::fast::tests::scene;
    use crate::optics::fast::{Precomputed, Renderer};
    use crate::optics::{LightShape, Scene};
    use glam::Vec3;

    /// The middle of the benchmark scene, in pixels as small as those of its own camera.
    fn middle(height: fn(f32, f32) -> f32, first: Option<&LightShape>) -> Scene {
        let mut scene = scene(Variant::Ac, height);
        scene.camera.tan_half_x /= 8.0;
        scene.camera = scene.camera.with_raster(75, 61);
        if let Some(shape) = first {
            scene.lights[0].shape = shape.clone();
            // (Hanging over the pad it would hide others.)
            scene.lights.truncate(1);
        }
        scene
    }

    fn ball(x: f32, y: f32) -> f32 {
        0.5 * (-(x * x + y * y) / 4.0).exp()
    }

    #[test]
    fn nodes_that_follow_from_others_change_next_to_nothing() {
        let disc = LightShape::Disc { center: Vec3::new(-2.2, 0.3, 1.6), normal: -Vec3::Z, radius: 0.4 };
        let (from, to) = (Vec3::new(-2.2, -3.0, 1.8), Vec3::new(-2.2, 3.0, 1.8));
        let tube = LightShape::Tube { from, to, radius: 0.2 };
        for (first, most) in [(None, 1e-3), (Some(disc), 3e-3), (Some(tube), 3e-3)] {
            let once = Precomputed::new(&middle(|_, _| 0.0, first.as_ref())).unwrap();
            let pressed = middle(ball, first.as_ref());
            let [few, all] = [true, false].map(|sparse| {
                let mut renderer = Renderer::new(&once, &pressed, 0.01).unwrap();
                assert!(renderer.effort.sparse);
                renderer.effort.sparse = sparse;
                renderer.pictures(1).films.swap_remove(0)
            });
            assert_ne!(few, all);
            let squares = few.pixels.iter().zip(&all.pixels).map(|(a, b)| (*a - *b).length_squared());
            let rms = (squares.sum::<f32>() / (3 * all.pixels.len()) as f32).sqrt();
            let apart = 3.0 * rms / all.mean().element_sum();
            assert!(apart < most, "{first:?}: {apart}");
        }
    }

    #[test]
    fn sharp_rims_have_all_their_nodes() {
        let once = Precomputed::new(&middle(|_, _| 0.0, None)).unwrap();
        let step = middle(|x, _| if x < 0.0 { 0.6 } else { 0.0 }, None);
        let renderer = Renderer::new(&once, &step, 0.01).unwrap();
        assert!(renderer.heights.has_sharp_rims() && !renderer.effort.sparse);
    }
}
