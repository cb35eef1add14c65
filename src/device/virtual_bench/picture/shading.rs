//! Phong shading of the relief by the sensor's lights.
//!
//! With unit normal n (towards the camera), l towards a light of colour c, and the camera straight above
//! (v = z), each light adds c * (n.l + specular * (r.v)^16) * falloff, r the mirrored l (Phong 1975). The sum
//! is multiplied by the gel's pattern, by the lens's vignette, and by the loss of light on what is pressed in.
//! No shadows, no light from wall to wall: that is what the twin is for.

use super::Drag;
use super::look::{Gel, SensorLook, SideLight};
use super::relief::Relief;

/// Normals of one row.
struct Normals {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

/// The untouched gel.
pub fn flat(look: &SensorLook, gel: &Gel) -> Vec<f32> {
    let (w, h) = (look.width as usize, look.height as usize);
    let normals = Normals { x: vec![0.0; w], y: vec![0.0; w], z: vec![1.0; w] };
    let mut rgb = vec![0.0; w * h * 3];
    let mut light = vec![0.0; w * 3];
    for (y, row) in rgb.chunks_exact_mut(w * 3).enumerate() {
        light_row(&mut light, look, &normals, 0, y);
        let factors = gel.albedo[y * w..].iter().zip(&gel.vignette[y * w..]);
        for ((out, light), (albedo, vignette)) in
            row.chunks_exact_mut(3).zip(light.chunks_exact(3)).zip(factors)
        {
            out.iter_mut().zip(light).for_each(|(o, l)| *o = l * albedo * vignette);
        }
    }
    rgb
}

/// Draws the deformed part over the picture of the untouched gel.
pub fn shade(rgb: &mut [f32], look: &SensorLook, gel: &Gel, relief: &Relief, drag: &Drag) {
    let (w, h) = (look.width as usize, look.height as usize);
    // The window may reach beyond the picture by a part of a coarse cell.
    let columns = relief.width.min(w - relief.x0);
    let rows = relief.height.min(h - relief.y0);
    let dragged = (*drag != Drag::default()).then(|| Carried::new(look, relief, drag));
    let darkening = look.brightness_per_mm * look.mm_per_px as f32;
    let mut normals = Normals { x: vec![0.0; columns], y: vec![0.0; columns], z: vec![1.0; columns] };
    let mut light = vec![0.0; columns * 3];
    for row in 0..rows {
        normals_of_row(&mut normals, relief, row);
        light_row(&mut light, look, &normals, relief.x0, relief.y0 + row);
        let y = relief.y0 + row;
        let line = &relief.px[row * relief.width..][..columns];
        let out = &mut rgb[(y * w + relief.x0) * 3..][..columns * 3];
        let pixels = out.chunks_exact_mut(3).zip(light.chunks_exact(3)).zip(line);
        for (x, ((out, light), bump)) in (relief.x0..).zip(pixels) {
            let albedo = match &dragged {
                Some(carried) => carried.albedo(gel, w, h, x, y, *bump),
                None => gel.albedo[y * w + x],
            };
            let mut factor = albedo * gel.vignette[y * w + x];
            if darkening != 0.0 {
                factor *= (-darkening * bump).exp();
            }
            out.iter_mut().zip(light).for_each(|(o, l)| *o = l * factor);
        }
    }
}

/// Normals from central differences; the relief is in px, so a difference is a slope.
fn normals_of_row(normals: &mut Normals, relief: &Relief, row: usize) {
    let w = relief.width;
    let at = |row: usize| &relief.px[row * w..][..w];
    let (above, line, below) = (at(row.saturating_sub(1)), at(row), at((row + 1).min(relief.height - 1)));
    let out = normals.x.iter_mut().zip(&mut normals.y).zip(&mut normals.z);
    for (x, ((nx, ny), nz)) in out.enumerate() {
        let dx = 0.5 * (line[(x + 1).min(w - 1)] - line[x.saturating_sub(1)]);
        let dy = 0.5 * (below[x] - above[x]);
        let inverse = 1.0 / (1.0 + dx * dx + dy * dy).sqrt();
        (*nx, *ny, *nz) = (-dx * inverse, -dy * inverse, inverse);
    }
}

/// Light on each pixel of a row that begins at column `x0`.
fn light_row(light: &mut [f32], look: &SensorLook, normals: &Normals, x0: usize, y: usize) {
    for p in light.chunks_exact_mut(3) {
        p.copy_from_slice(&look.ambient);
    }
    let (w, h) = (look.width as f32, look.height as f32);
    let v = 2.0 * (y as f32 + 0.5) / h - 1.0;
    for SideLight { from: [fx, fy, fz], rgb, falloff } in &look.lights {
        let length = (fx * fx + fy * fy + fz * fz).sqrt();
        let [lx, ly, lz] = [fx / length, fy / length, fz / length];
        let flat = fx.hypot(*fy).max(1e-6);
        // Brighter on the light's own side: linear across the picture.
        let across = falloff * fx / flat * 2.0 / w;
        let start = 1.0 + falloff * (fy / flat * v + fx / flat * (2.0 * (x0 as f32 + 0.5) / w - 1.0));
        let all = normals.x.iter().zip(&normals.y).zip(&normals.z).enumerate();
        for (p, (x, ((nx, ny), nz))) in light.chunks_exact_mut(3).zip(all) {
            let diffuse = (lx * nx + ly * ny + lz * nz).max(0.0);
            let mirrored = (2.0 * diffuse * nz - lz).max(0.0);
            let s4 = mirrored * mirrored * mirrored * mirrored;
            let s16 = s4 * s4 * s4 * s4;
            let strength = (diffuse + look.specular * s16) * (start + across * x as f32).max(0.0);
            p[0] += rgb[0] * strength;
            p[1] += rgb[1] * strength;
            p[2] += rgb[2] * strength;
        }
    }
}

/// The gel's pattern, carried along where the relief is high.
struct Carried {
    shift_px: [f32; 2],
    twist_rad: f32,
    centre: [f32; 2],
    per_relief: f32,
}

impl Carried {
    fn new(look: &SensorLook, relief: &Relief, drag: &Drag) -> Self {
        Self {
            shift_px: [drag.x_mm, drag.y_mm].map(|d| (d / look.mm_per_px) as f32),
            twist_rad: drag.twist_deg.to_radians() as f32,
            centre: relief.centre,
            per_relief: 1.0 / relief.highest_px.max(1e-6),
        }
    }

    /// The pattern that stands at a pixel now, from where it stood before.
    fn albedo(&self, gel: &Gel, w: usize, h: usize, x: usize, y: usize, bump: f32) -> f32 {
        let carried = (bump * self.per_relief * 1.5).clamp(0.0, 1.0);
        if carried == 0.0 {
            return gel.albedo[y * w + x];
        }
        let (rx, ry) = (x as f32 - self.centre[0], y as f32 - self.centre[1]);
        let angle = self.twist_rad * carried;
        let u = x as f32 - self.shift_px[0] * carried + angle * ry;
        let v = y as f32 - self.shift_px[1] * carried - angle * rx;
        let (u, v) = (u.clamp(0.0, w as f32 - 1.001), v.clamp(0.0, h as f32 - 1.001));
        let (i, j) = (u as usize, v as usize);
        let (fx, fy) = (u - i as f32, v - j as f32);
        let row = |j: usize| {
            let k = j * w + i;
            gel.albedo[k] + (gel.albedo[k + 1] - gel.albedo[k]) * fx
        };
        row(j) + (row(j + 1) - row(j)) * fy
    }
}
