//! How a block is divided until what its nodes hold can be interpolated.

use super::{Desk, NOWHERE, Rectangle};
use crate::optics::fast::horizon::slope_of;
use crate::optics::fast::shade::falls_off;
use crate::optics::fast::slots::POSITION;
use crate::optics::fast::source::coarse;
use crate::optics::fast::toward::Toward;
use glam::Vec3;

/// A block within which so much of the light comes and goes is divided, whatever its middle says.
const JUMP: f32 = 0.5;

/// What a block is divided for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finer {
    /// Everything.
    Fields,
    /// The edges of shadows alone.
    Horizons,
}

impl<const N: usize> Desk<'_, N> {
    /// Divides a block until what it holds can be interpolated, and shades its parts. (One place calls for shading, all of
    /// which is inlined and takes seconds to compile.)
    #[inline(always)]
    pub(super) fn divide(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        // Parts that wait, with their nodes in the arena; the whole keeps its own.
        let stride = self.frame.slots.stride();
        let mut arena = std::mem::take(&mut self.arena);
        let mut waiting = std::mem::take(&mut self.waiting);
        arena.clear();
        let mut at_hand = Some((rectangle, None::<[usize; 4]>));
        while let Some((rectangle, ids)) = at_hand {
            let parents = match ids {
                None => four,
                Some(ids) => ids.map(|k| &arena[k * stride..][..stride]),
            };
            let Some(finer) = self.finer(rectangle, parents) else {
                self.shade(rectangle, parents);
                at_hand = waiting.pop().map(|(part, ids)| (part, Some(ids)));
                continue;
            };
            let ids = ids.unwrap_or_else(|| {
                four.iter().for_each(|n| arena.extend_from_slice(n));
                [0, 1, 2, 3]
            });
            let [x0, y0, x1, y1] = rectangle;
            let (mx, my) = ((x0 + x1) / 2, (y0 + y1) / 2);
            let next = arena.len() / stride;
            let inner = [(mx, y0), (x0, my), (mx, my), (x1, my), (mx, y1)].map(|(x, y)| self.point(x, y));
            let (old, fresh) = {
                let at = arena.len();
                arena.resize(at + inner.len() * stride, 0.0);
                arena.split_at_mut(at)
            };
            match finer {
                Finer::Fields => self.frame.fill(&inner, fresh),
                Finer::Horizons => {
                    let (u, v) = ((mx - x0) as f32 / (x1 - x0) as f32, (my - y0) as f32 / (y1 - y0) as f32);
                    let parents = ids.map(|k| &old[k * stride..][..stride]);
                    let places = [[u, 0.0], [0.0, v], [u, v], [1.0, v], [u, 1.0]];
                    for ((node, p), at) in fresh.chunks_exact_mut(stride).zip(inner).zip(places) {
                        self.frame.fill_between(p, parents, at, node);
                    }
                }
            }
            let [a, b, c, d] = ids;
            let [top, left, middle, right, bottom] = [0, 1, 2, 3, 4].map(|k| next + k);
            waiting.push(([x0, y0, mx, my], [a, top, left, middle]));
            waiting.push(([mx, y0, x1, my], [top, b, middle, right]));
            waiting.push(([x0, my, mx, y1], [left, middle, c, bottom]));
            at_hand = Some(([mx, my, x1, y1], Some([middle, right, bottom, d])));
        }
        (self.arena, self.waiting) = (arena, waiting);
    }

    /// Whether a block must be divided, and can be, and for what.
    #[inline(always)]
    fn finer(&self, rectangle: Rectangle, four: [&[f32]; 4]) -> Option<Finer> {
        let [x0, y0, x1, y1] = rectangle;
        let (effort, size) = (&self.frame.effort, (x1 - x0).max(y1 - y0) as f32 * self.frame.once.pixel_mm);
        if x1 - x0 < 2 || y1 - y0 < 2 {
            return None;
        }
        let (mx, my) = ((x0 + x1) / 2, (y0 + y1) / 2);
        let curved = || {
            let [a, b, c, d] = four.map(|n| n[POSITION + 2]);
            let mean = 0.25 * (a + b + c + d);
            // (The second tells a crease that cuts off a corner.)
            (self.point(mx, my).z - mean).abs() > effort.curved_mm || (a + d - b - c).abs() > effort.curved_mm
        };
        // Where the plane of a light runs through it.
        let ends = || {
            let faced = |l: usize| four.iter().filter(|n| n[self.frame.slots.gain(l)] > 0.0).count();
            self.frame.sided.iter().any(|l| ![0, 4].contains(&faced(*l)))
        };
        // Where light without a closed form falls off.
        let falls = || {
            let [p, q, r] = [four[0], four[3], four[1]].map(|n| Vec3::from_slice(&n[POSITION..]));
            let size2 = (q - p).length_squared().max((r - p).length_squared());
            let tabulated = |l: &usize| self.frame.once.tables.direct[*l].is_some();
            (0..self.frame.once.sources.len()).filter(tabulated).any(|l| {
                let phi = Vec3::from_slice(&four[0][self.frame.slots.direct(l)..]);
                let field = phi.abs().max_element() * self.block.weights[l];
                falls_off(&self.frame.once.sources[l].around(), 0.5 * (p + q), field, size2, 0.0)
            })
        };
        let wanted = if size > effort.block_mm || curved() || ends() || falls() {
            Finer::Fields
        } else if size > effort.shadow_mm && self.bends([mx, my], rectangle, four) {
            Finer::Horizons
        } else {
            return None;
        };
        let inner = [(mx, y0), (x0, my), (mx, my), (x1, my), (mx, y1)];
        inner.iter().all(|&(x, y)| self.point(x, y).x != NOWHERE).then_some(wanted)
    }

    /// Whether interpolated horizons would be wrong by too much light at the middle of a block.
    #[inline(always)]
    fn bends(&self, [mx, my]: [usize; 2], [x0, y0, x1, y1]: Rectangle, four: [&[f32]; 4]) -> bool {
        let frame = self.frame;
        let slots = &frame.slots;
        let flagged = |l: usize| four.iter().any(|n| n[slots.light(l)] > 0.0);
        if frame.effort.thorough || !(0..frame.once.sources.len()).any(flagged) {
            return frame.effort.thorough;
        }
        let p = self.point(mx, my);
        if p.x == NOWHERE {
            return false;
        }
        let (u, v) = ((mx - x0) as f32 / (x1 - x0) as f32, (my - y0) as f32 / (y1 - y0) as f32);
        let between = |k: usize| {
            let (top, bottom) =
                (four[0][k] * (1.0 - u) + four[1][k] * u, four[2][k] * (1.0 - u) + four[3][k] * u);
            top * (1.0 - v) + bottom * v
        };
        let vector = |k: usize| Vec3::new(between(k), between(k + 1), between(k + 2));
        let [a, b, c, d] = four.map(|n| Vec3::from_slice(&n[POSITION..]));
        let normal = (c - b).cross(d - a).normalize_or(Vec3::Z);
        let normal = if normal.z < 0.0 { -normal } else { normal };
        let (mut wrong, mut jumped) = (0.0, 0.0);
        for (l, source) in frame.once.sources.iter().enumerate().filter(|(l, _)| flagged(*l)) {
            let light = vector(slots.direct(l)).dot(normal).max(0.0) * frame.strength(l);
            if light <= frame.effort.shadow * frame.level {
                continue;
            }
            let (mut departs, mut jumps) = (0.0, 0.0f32);
            for k in (0..N).step_by(coarse(N)) {
                let line = match slots.varying() {
                    true => [0, 3].map(|end| vector(slots.line(l, k) + end)),
                    false => source.line(k, N - 1, p).map(|end| end - p),
                };
                let sight = Toward::new(line);
                let cut =
                    |slope: f32| ((slope - sight.from) / (sight.to - sight.from).max(1e-6)).clamp(0.0, 1.0);
                let horizon = sight.horizon(frame.heights, p, slots.bent());
                departs += (cut(horizon) - cut(slope_of(between(slots.horizons(l) + k)))).abs();
                let cuts = four.map(|n| cut(slope_of(n[slots.horizons(l) + k])));
                let most = cuts.iter().fold(0.0f32, |most, c| most.max(*c));
                jumps += most - cuts.iter().fold(1.0f32, |least, c| least.min(*c));
            }
            wrong += light * departs / 3.0;
            jumped += light * jumps / 3.0;
        }
        jumped > JUMP * frame.level || wrong > frame.effort.shadow * frame.level
    }
}
