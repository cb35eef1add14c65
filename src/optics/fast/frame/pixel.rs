//! What a pixel sees of the pad.

use super::Frame;
use crate::optics::fast::View;
use crate::optics::fast::raster::corners;
use crate::optics::{Albedo, Mesh};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

impl<const N: usize> Frame<'_, N> {
    /// What a corner of a pixel sees of the pad, if nothing fixed is in front.
    #[inline(always)]
    pub fn corner(&self, x: usize, y: usize) -> Option<(Vec3, u32)> {
        let view = &self.once.view;
        let sample = self.seen[y * view.corners()[0] + x];
        let hidden = self.once.fixed(x, y).is_some_and(|value| value > sample.value);
        (sample.triangle != u32::MAX && !hidden)
            .then(|| (View::point(view.row(y)[x], sample.value), sample.triangle))
    }

    /// How high what the corners of a pixel see of the pad is in the mean, mm, over the level of the view.
    pub(super) fn height_mm(&self, x: usize, y: usize) -> Option<f32> {
        let view = &self.once.view;
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        let heights = corners.iter().filter_map(|&(x, y)| {
            let value = self.seen[y * view.corners()[0] + x].value;
            (value > 1e-6).then(|| View::point(view.row(y)[x], value).z)
        });
        let (sum, n) = heights.fold((0.0, 0.0f32), |(s, n), z| (s + z, n + 1.0));
        (n > 0.0).then(|| sum / n)
    }

    /// By pixel: whether something fixed is before the pad at all its corners; empty where nothing fixed shows. (Of one that
    /// it covers in part the picture has at first what is the pad's.)
    pub(super) fn hidden(&self) -> Vec<bool> {
        if self.once.tables.fixed.is_empty() {
            return Vec::new();
        }
        let [width, height] = self.once.view.corners().map(|n| n - 1);
        let hidden = |k: usize| {
            let (x, y) = (k % width, k / width);
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            four.iter().all(|(x, y)| self.corner(*x, *y).is_none()) && self.once.tables.covers.at(k).is_none()
        };
        (0..width * height).into_par_iter().with_min_len(4096).map(hidden).collect()
    }

    /// Normal of a triangle, towards the camera.
    #[inline(always)]
    pub fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = corners(triangle, self.nx).map(|k| self.mesh.positions[k]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        if n.dot(self.once.view.camera.origin - a) < 0.0 { -n } else { n }
    }

    /// Albedo at a point of a triangle.
    #[inline(always)]
    pub fn albedo_at(&self, triangle: u32, p: Vec3) -> Vec3 {
        match self.albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Texture(texture) => texture.sample(uv(self.mesh, self.nx, triangle, p)),
        }
    }
}

/// Texture coordinate at a point of a triangle's plane; 0 where the mesh carries none.
#[inline(always)]
pub fn uv(mesh: &Mesh, nx: usize, triangle: u32, point: Vec3) -> Vec2 {
    if mesh.uvs.is_empty() {
        return Vec2::ZERO;
    }
    let ids = corners(triangle, nx);
    let [a, b, c] = ids.map(|k| mesh.positions[k]);
    let [ta, tb, tc] = ids.map(|k| mesh.uvs[k]);
    let (e, f, p) = (b - a, c - a, point - a);
    let n = e.cross(f);
    let scale = 1.0 / n.length_squared().max(1e-30);
    let (wb, wc) = (p.cross(f).dot(n) * scale, e.cross(p).dot(n) * scale);
    ta + (tb - ta) * wb + (tc - ta) * wc
}
