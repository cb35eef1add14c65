//! Pixels that show the pad in part: at its rim, and beside what stands before it. How much of them is the pad's is sampled, and
//! the light on it is taken in the middle of that.

use super::cover::{SAMPLED_ERROR, SAMPLES, Values, place};
use super::desk::{Desk, Rectangle};
use super::frame::Frame;
use super::horizon::Stand;
use super::lanes::{Eight, Vectors, WIDTH};
use super::piece::on_top;
use super::raster::Sample;
use super::shade::Own;
use super::traces::add_squares;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Most quads that a pixel counts for, along an edge.
const MOST_MORE: f32 = 16.0;

/// What a pixel shows of the pad.
struct Visible {
    /// How much of the pixel that is.
    part: f32,
    /// Its middle, in the pixel and on the pad.
    at: Vec2,
    point: Vec3,
    normal: Vec3,
    albedo: Vec3,
}

impl<const N: usize> Frame<'_, N> {
    /// The values of what the samples of a pixel see of the pad, whatever stands before it.
    pub fn values(&self, x: usize, y: usize) -> Values {
        self.samples(x, y).map(|sample| sample.value)
    }

    /// What they see.
    fn samples(&self, x: usize, y: usize) -> [Sample; SAMPLES] {
        let [columns, rows] = self.once.view.corners();
        // (Its rim may lie between corners: those around see where.)
        let (xs, ys) = (x.saturating_sub(1)..(x + 3).min(columns), y.saturating_sub(1)..(y + 3).min(rows));
        let around = ys.flat_map(|y| xs.clone().map(move |x| y * columns + x));
        let triangles: Vec<u32> =
            around.map(|k| self.seen[k].triangle).filter(|triangle| *triangle != u32::MAX).collect();
        let pixel = Vec2::new(x as f32, y as f32);
        let Some(quads) = self.quads(&triangles) else {
            // None, or parts of the pad far from each other: as the nearest corner sees it.
            return std::array::from_fn(|k| {
                let at = (pixel + place(k)).round();
                self.seen[at.y as usize * columns + at.x as usize]
            });
        };
        on_top(self.vertices, self.nx, pixel, self.a_pixel_wider(quads))
    }

    /// These quads, and around them as many as a pixel is wide: the pad goes on beyond the last corner that sees it.
    fn a_pixel_wider(&self, [i0, i1, j0, j1]: [usize; 4]) -> [usize; 4] {
        let first = j0 * self.nx + i0;
        let beside = |k: usize| (self.vertices[k] - self.vertices[first]).truncate().length();
        let width = beside(first + 1).min(beside(first + self.nx));
        let more = (1.0 / width.max(1.0 / MOST_MORE)).ceil() as usize;
        let [columns, rows] = [self.nx - 1, self.vertices.len() / self.nx - 1];
        [i0.saturating_sub(more), (i1 + more).min(columns), j0.saturating_sub(more), (j1 + more).min(rows)]
    }

    /// What a pixel shows of the pad; None where it shows nothing of it.
    fn visible(&self, x: usize, y: usize) -> Option<Visible> {
        let once = self.once;
        let fixed = once.tables.covers.at(y * once.view.camera.width + x).copied().unwrap_or_else(|| {
            let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            // (Where only some of them see something fixed in front, it covers the pixel in part.)
            let fixed = corners.map(|(x, y)| once.fixed(x, y).unwrap_or(f32::NEG_INFINITY));
            [fixed.into_iter().fold(f32::INFINITY, f32::min); SAMPLES]
        });
        let samples = self.samples(x, y);
        let shows = |k: &usize| samples[*k].triangle != u32::MAX && samples[*k].value >= fixed[*k];
        let shown: Vec<usize> = (0..SAMPLES).filter(shows).collect();
        let first = samples[*shown.first()?];
        let share = 1.0 / shown.len() as f32;
        let at = shown.iter().map(|k| place(*k)).sum::<Vec2>() * share;
        let value = shown.iter().map(|k| samples[*k].value).sum::<f32>() * share;
        let point = super::View::point(self.ray_in([x, y], at), value);
        let normal: Vec3 = shown.iter().map(|k| self.normal(samples[*k].triangle)).sum();
        let albedo = |k: &usize| {
            let point = super::View::point(self.ray_in([x, y], place(*k)), samples[*k].value);
            self.albedo_at(samples[*k].triangle, point)
        };
        Some(Visible {
            part: shown.len() as f32 / SAMPLES as f32,
            at,
            point,
            normal: normal.normalize_or(self.normal(first.triangle)),
            albedo: shown.iter().map(albedo).sum::<Vec3>() * share,
        })
    }

    /// Start and direction of the ray of a place in a pixel.
    pub fn ray_in(&self, [x, y]: [usize; 2], at: Vec2) -> [Vec3; 2] {
        let row = [self.once.view.row(y), self.once.view.row(y + 1)];
        std::array::from_fn(|k| {
            let between = |row: &[[Vec3; 2]]| row[x][k].lerp(row[x + 1][k], at.x);
            between(row[0]).lerp(between(row[1]), at.y)
        })
    }
}

impl<const N: usize> Desk<'_, N> {
    /// A pixel that shows the pad in part: of the pad alone where something fixed is laid over it, else with what is beside.
    pub fn in_part(&mut self, x: usize, y: usize, [x0, y0, x1, y1]: Rectangle) {
        let once = self.frame.once;
        let films = self.sums.len();
        let visible = self.frame.visible(x, y);
        self.sums.fill(Vectors::all(Vec3::ZERO));
        if let Some(Visible { at, point, normal, .. }) = visible {
            let place = |k: usize, at: f32, low: usize, high: usize| {
                Eight::all(((k - low) as f32 + at) / (high - low) as f32)
            };
            let mut own = std::mem::take(&mut self.horizons);
            own.resize(self.frame.slots.stride(), 0.0);
            self.frame.fill_horizons(Stand::on(point, normal), &mut own);
            let horizons = Own { nodes: &own, at: [0; WIDTH] };
            let places = [place(x, at.x, x0, x1), place(y, at.y, y0, y1)];
            let (point, normal) = (Vectors::all(point), Vectors::all(normal));
            self.block.light(places, point, normal, &once.radiances, Some(horizons), &mut self.sums);
            self.horizons = own;
        }
        // What is fixed is laid over a pixel later, where it covers it in part.
        let covered = once.tables.covers.at(y * self.width + x).is_some();
        let part = if covered { 1.0 } else { visible.as_ref().map_or(0.0, |v| v.part) };
        let pad = visible.map_or(Vec3::ZERO, |v| v.albedo * (FRAC_1_PI * once.transmitted(x, y)));
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        let beside = corners.into_iter().filter(|(x, y)| self.frame.corner(*x, *y).is_none());
        let share = (1.0 - part) / beside.clone().count().max(1) as f32;
        let mut contrasts = Vec::with_capacity(films);
        for film in 0..films {
            let light = pad
                * Vec3::from_array(
                    [&self.sums[film].x, &self.sums[film].y, &self.sums[film].z].map(|e| e.0[0]),
                );
            let fixed: Vec3 = match covered {
                true => Vec3::ZERO,
                false => beside.clone().map(|(x, y)| once.fixed_light(film, films, x, y) * share).sum(),
            };
            if part > 0.0 && part < 1.0 {
                let weight = (SAMPLED_ERROR as f32 * part * (1.0 - part)).sqrt();
                contrasts.push((light - fixed / (1.0 - part)) * weight);
            }
            let veil = once.veil(film, films, x, y);
            self.out[film][(y - self.first) * self.width + x] = light * part + fixed + veil;
        }
        add_squares(self.spread, contrasts.into_iter(), &once.radiances);
    }
}
