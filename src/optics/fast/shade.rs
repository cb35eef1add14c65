//! From the lattice's samples to the colour of a pixel.

use super::Precomputed;
use super::horizon::Heights;
use super::probes;
use super::raster::{Sample, corners};
use super::tables::LIGHTS_A_TABLE;
use crate::optics::{Albedo, Mesh};
use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// A pad seen by the sensor, ready to be shaded.
pub struct Shading<'a> {
    pub once: &'a Precomputed,
    pub mesh: &'a Mesh,
    pub nx: usize,
    pub albedo: &'a Albedo,
    pub heights: &'a Heights,
    pub doubts: &'a [bool],
    /// Samples along each edge of a pixel.
    pub grain: usize,
}

impl Shading<'_> {
    /// The colour of pixel (x, y); `rows` are its `grain` rows of samples, `width` samples long.
    pub fn pixel(&self, x: usize, y: usize, rows: &[Sample], width: usize) -> Vec3 {
        let camera = &self.once.camera;
        let grain = self.grain;
        let mut sum_static = Vec3::ZERO;
        let mut seen = [(u32::MAX, Vec3::ZERO, Vec2::ZERO); 16];
        let (mut count, mut offset, mut depth, mut normal) = (0, Vec2::ZERO, 0.0, Vec3::ZERO);
        for v in 0..grain {
            for u in 0..grain {
                let sample = rows[v * width + x * grain + u];
                if let Some((value, radiance)) = self.once.fixed(x, y, u, v, grain)
                    && value > sample.value
                {
                    sum_static += radiance;
                    continue;
                }
                if sample.triangle == u32::MAX {
                    continue;
                }
                let n = match seen[..count].last() {
                    Some((id, n, _)) if *id == sample.triangle => *n,
                    _ => self.normal(sample.triangle),
                };
                let within = Vec2::new(u as f32 + 0.5, v as f32 + 0.5);
                let at = Vec2::new(x as f32, y as f32) + within / grain as f32;
                seen[count] = (sample.triangle, n, at);
                count += 1;
                offset += within;
                depth += 1.0 / sample.value;
                normal += n;
            }
        }
        let share = 1.0 / (grain * grain) as f32;
        if count == 0 {
            return sum_static * share;
        }
        let per = 1.0 / count as f32;
        let at = Vec2::new(x as f32, y as f32) + offset * (per / grain as f32);
        let (origin, direction) = camera.ray(at.x, at.y, Vec2::ZERO);
        let point = origin + direction * (depth * per / direction.dot(camera.forward));
        let mean = normal * per;
        let unit = mean.normalize_or_zero();

        let (field, rest) = self.direct(point, unit);
        let (numbers, _) = self.once.probes.at(point);
        let even = rest + probes::irradiance(&numbers, unit);
        let reflected = match self.albedo {
            Albedo::Constant(albedo) => *albedo * ((field * mean).max(Vec3::ZERO) + even) * count as f32,
            Albedo::Texture(texture) => {
                let mut sum = Vec3::ZERO;
                for (id, n, at) in &seen[..count] {
                    let (origin, direction) = camera.ray(at.x, at.y, Vec2::ZERO);
                    let uv = self.uv(*id, origin, direction);
                    sum += texture.sample(uv) * ((field * *n).max(Vec3::ZERO) + even);
                }
                sum
            }
        };
        (sum_static + reflected * FRAC_1_PI) * share
    }

    /// Normal of a triangle, on the side of the camera.
    #[inline(always)]
    fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = corners(triangle, self.nx).map(|k| self.mesh.positions[k]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        if n.dot(self.once.camera.origin - a) < 0.0 { -n } else { n }
    }

    /// Texture coordinate where a ray meets the plane of a triangle.
    fn uv(&self, triangle: u32, origin: Vec3, direction: Vec3) -> Vec2 {
        let [a, b, c] = corners(triangle, self.nx).map(|k| self.mesh.positions[k]);
        let n = (b - a).cross(c - a);
        let t = n.dot(a - origin) / n.dot(direction);
        uv(self.mesh, self.nx, triangle, origin + direction * t)
    }

    /// Direct irradiance: the matrix that gives it from a normal, and the part that is already worked out for the mean
    /// normal because something of the light is hidden.
    #[inline(always)]
    fn direct(&self, point: Vec3, normal: Vec3) -> (Mat3, Vec3) {
        let panels = &self.once.panels;
        let cell = self.heights.coarse_cell(point.truncate());
        let doubts = &self.doubts[cell * panels.len()..(cell + 1) * panels.len()];
        // Rows: colours; the transpose is built by columns.
        let (mut x, mut y, mut z) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        let mut rest = Vec3::ZERO;
        for (t, table) in self.once.direct.iter().enumerate() {
            let (values, inside) = table.at(point);
            let first = t * LIGHTS_A_TABLE;
            for k in first..(first + LIGHTS_A_TABLE).min(panels.len()) {
                let panel = &panels[k];
                let radiance = self.once.radiances[k];
                let above = panel.corners.iter().all(|c| (*c - point).dot(normal) > 0.0);
                let near = (point - panel.corners[0]).dot(panel.normal) < self.once.near_mm;
                if doubts[k] || !above || !inside || near {
                    rest += radiance * self.heights.irradiance(point, normal, panel);
                } else {
                    let base = 3 * (k - first);
                    x += radiance * values[base];
                    y += radiance * values[base + 1];
                    z += radiance * values[base + 2];
                }
            }
        }
        (Mat3::from_cols(x, y, z), rest)
    }
}

/// Texture coordinate at a point of a triangle's plane; 0 where the mesh carries none.
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
