//! Nodes: the fields of the lights at a point, and how much of each light the pad hides from it.

use super::Frame;
use crate::optics::fast::arrival::Arrival;
use crate::optics::fast::horizon::{Stand, slope_of, squeezed};
use crate::optics::fast::lanes::Vectors;
use crate::optics::fast::slots::POSITION;
use crate::optics::fast::source::{KEPT, Line, MOST_LINES, coarse, with_means};
use crate::optics::fast::tables::looked_up;
use crate::optics::fast::toward::Toward;
use crate::optics::fast::vector::{irradiance, of_point, quadrilateral};
use glam::Vec3;

/// A horizon that departs more from the mean of its neighbours, as a slope, is followed between them, too.
const BENT: f32 = 0.03;

impl<const N: usize> Frame<'_, N> {
    /// Fills up to eight nodes at once.
    #[inline(always)]
    pub fn fill(&self, points: &[Vec3], out: &mut [f32]) {
        self.fill_on(points, |k| points[k].into(), out);
    }

    /// The same, where the pad hides lights as from the `stands` of these points.
    #[inline(always)]
    pub fn fill_on(&self, points: &[Vec3], stands: impl Fn(usize) -> Stand, out: &mut [f32]) {
        let (once, slots) = (self.once, &self.slots);
        let stride = slots.stride();
        let mut eight = Vectors::all(points[0]);
        for (i, p) in points.iter().enumerate() {
            (eight.x.0[i], eight.y.0[i], eight.z.0[i]) = (*p).into();
        }
        for (l, (source, table)) in once.sources.iter().zip(&once.tables.direct).enumerate() {
            let phi = match (table, source.corners()) {
                (None, Some(corners)) => quadrilateral(&corners, eight),
                _ => Vectors::all(Vec3::ZERO),
            };
            for (i, (p, node)) in points.iter().zip(out.chunks_exact_mut(stride)).enumerate() {
                let phi = match table {
                    Some(table) => looked_up(table, source, once.view.slab.as_ref(), *p),
                    None if source.faces(*p) => {
                        let corners = source.corners().map(|corners| corners.map(|c| c - *p));
                        let of_edges = Vec3::new(phi.x.0[i], phi.y.0[i], phi.z.0[i]);
                        corners.and_then(of_point).unwrap_or(of_edges)
                    }
                    None => Vec3::ZERO,
                };
                node[slots.direct(l)..][..3].copy_from_slice(&phi.to_array());
            }
        }
        let grids =
            if slots.films == 1 { std::slice::from_ref(&once.total) } else { &once.tables.probes[..] };
        let greys = once.greys.as_deref().filter(|_| slots.grey).unwrap_or_default();
        for (k, (p, node)) in points.iter().zip(out.chunks_exact_mut(stride)).enumerate() {
            node[POSITION..3].copy_from_slice(&p.to_array());
            for (film, grid) in greys.iter().enumerate() {
                let values = grid.at(*p);
                node[slots.indirect(film)..][..values.len()].copy_from_slice(&values);
            }
            for (film, grid) in grids.iter().enumerate().filter(|_| !slots.grey) {
                let values = grid.at(*p);
                node[slots.indirect(film)..][..values.len()].copy_from_slice(&values);
            }
            for (l, source) in once.sources.iter().enumerate() {
                let lines = source.seen(*p, once.view.slab.as_ref());
                self.horizons(l, stands(k), &lines, node);
                // Behind a light there is nothing to take off.
                node[slots.gain(l)] = f32::from(u8::from(source.faces(*p)));
                if slots.varying() {
                    let numbers = &mut node[slots.line(l, 0)..][..6 * N.div_ceil(KEPT)];
                    let kept = lines.iter().step_by(KEPT).flatten();
                    for (numbers, end) in numbers.chunks_exact_mut(3).zip(kept) {
                        numbers.copy_from_slice(&end.to_array());
                    }
                }
                if once.tables.direct[l].is_some() {
                    let phi = Vec3::from_slice(&node[slots.direct(l)..]);
                    let of_lines = match Arrival::of(source, once.view.slab.as_ref()) {
                        Some(arrival) => arrival.of_lines(&lines),
                        None => outline(&lines),
                    };
                    // (Tables hold something just behind a lamp, too, where nothing shines.)
                    node[slots.gain(l)] *= phi.length() / of_lines.length().max(1e-12);
                }
            }
        }
    }

    /// Fills a node between others of which it is a mean: fields are interpolated anyway, only its place and the horizons
    /// of lights that the pad hides at one of them are its own.
    #[inline(always)]
    pub fn fill_between(&self, p: Vec3, parents: [&[f32]; 4], [u, v]: [f32; 2], node: &mut [f32]) {
        let slots = &self.slots;
        let [a, b, c, d] = parents.map(|parent| &parent[..node.len()]);
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        for (k, number) in node.iter_mut().enumerate() {
            *number = a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2] + d[k] * weights[3];
        }
        node[POSITION..3].copy_from_slice(&p.to_array());
        for (l, source) in self.once.sources.iter().enumerate() {
            if !self.effort.thorough && node[slots.light(l)] == 0.0 {
                continue;
            }
            let lines = match slots.varying() {
                true => {
                    let end = |k: usize, end: usize| Vec3::from_slice(&node[slots.line(l, k) + 3 * end..]);
                    with_means(|k| [end(k, 0), end(k, 1)])
                }
                false => source.seen(p, None),
            };
            self.horizons(l, p.into(), &lines, node);
        }
    }

    /// Fills a node with what the pad hides of lights at a point, and nothing else.
    pub fn fill_horizons(&self, from: Stand, node: &mut [f32]) {
        for (l, source) in self.once.sources.iter().enumerate() {
            self.horizons(l, from, &source.seen(from.point, self.once.view.slab.as_ref()), node);
        }
    }

    /// Fills a node's part on what the pad hides of a light, whose lines appear there.
    #[inline(always)]
    fn horizons(&self, l: usize, from: Stand, lines: &[Line; N], node: &mut [f32]) {
        let slots = &self.slots;
        let (mut hides, mut rises) = (false, false);
        let slopes = slots.horizons(l);
        let follow = |k: usize, hides: &mut bool, rises: &mut bool| {
            let sight = Toward::new(lines[k]);
            let horizon = sight.horizon(self.heights, from, slots.bent());
            *hides |= horizon > sight.from.min(sight.to);
            *rises |= horizon > sight.least();
            horizon
        };
        // A few lines first, the ones between where the pad is higher anywhere...
        for k in (0..N).step_by(coarse(N)) {
            node[slopes + k] = squeezed(follow(k, &mut hides, &mut rises));
        }
        let mut reach = coarse(N) / 2;
        let mut bends =
            rises || self.effort.thorough || (self.effort.fine && self.heights.rises_above(from.point.z));
        let mut flag = 0;
        while reach > 0 {
            let mut bent = false;
            for k in (reach..N).step_by(2 * reach) {
                let between = 0.5 * (node[slopes + k - reach] + node[slopes + k + reach]);
                node[slopes + k] = between;
                if bends {
                    let slope = follow(k, &mut hides, &mut rises);
                    node[slopes + k] = squeezed(slope);
                    bent |= (slope - slope_of(between)).abs() > BENT;
                }
            }
            flag += u8::from(bends);
            // ...or rises before one of these, and the finest only where the horizon bends.
            let wanted = bent || (reach == coarse(N) / 2 && rises);
            bends = wanted && self.effort.fine || self.effort.thorough;
            reach /= 2;
        }
        node[slots.light(l)] = if hides { f32::from(flag.max(1)) } else { 0.0 };
    }
}

/// Vector irradiance of a whole ribbon.
#[inline(always)]
fn outline<const N: usize>(lines: &[Line; N]) -> Vec3 {
    let corners = 2 * N.div_ceil(KEPT);
    let mut around = [Vec3::ZERO; 2 * MOST_LINES.div_ceil(KEPT)];
    for (k, [low, high]) in lines.iter().step_by(KEPT).enumerate() {
        around[k] = *low;
        around[corners - 1 - k] = *high;
    }
    irradiance(&around[..corners])
}
