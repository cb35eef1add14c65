//! Lights made ready for sampling: where their surface is, how to pick a point of it.

use super::{Light, LightShape, irradiance};
use glam::{Vec2, Vec3};

/// A light with what the integrator asks of it.
#[derive(Debug, Clone)]
pub struct Emitter {
    /// Radiance along the normal.
    pub radiance: Vec3,
    /// Whether the irradiance of a diffuse receiver is known in closed form.
    pub analytic: bool,
    /// Middle of the luminous surface.
    pub center: Vec3,
    /// Luminance of the radiance.
    pub luminance: f32,
    area: f32,
    two_sided: bool,
    cosine_power: f32,
    shape: Shape,
}

#[derive(Debug, Clone)]
enum Shape {
    /// Corners counter-clockwise as seen from the shining side, unit normal.
    Rectangle([Vec3; 4], Vec3),
    /// Triangles and the running sum of their areas.
    Triangles(Vec<[Vec3; 3]>, Vec<f32>),
}

/// A point picked on a light.
#[derive(Debug, Clone, Copy)]
pub struct LightPoint {
    /// The point.
    pub point: Vec3,
    /// Unit normal of the shining side.
    pub normal: Vec3,
    /// Density per area.
    pub pdf_area: f32,
}

impl Emitter {
    /// Its image in a mirror at this height, at right angles to z.
    pub fn mirrored(&self, height: f32) -> Self {
        let over = |p: Vec3| p.with_z(2.0 * height - p.z);
        let shape = match &self.shape {
            Shape::Rectangle([a, b, c, d], normal) => {
                Shape::Rectangle([over(*a), over(*d), over(*c), over(*b)], normal.with_z(-normal.z))
            }
            Shape::Triangles(triangles, running) => {
                let turned = |[a, b, c]: &[Vec3; 3]| [over(*a), over(*c), over(*b)];
                Shape::Triangles(triangles.iter().map(turned).collect(), running.clone())
            }
        };
        Self { center: over(self.center), shape, ..*self }
    }

    /// Prepares a light.
    pub fn new(light: &Light) -> Self {
        let mesh = light.shape.tessellate();
        let triangles: Vec<_> = (0..mesh.triangles.len()).map(|k| mesh.corners(k)).collect();
        let mut area = 0.0;
        let mut center = Vec3::ZERO;
        let mut running = Vec::with_capacity(triangles.len());
        for [a, b, c] in &triangles {
            let part = (b - a).cross(c - a).length() / 2.0;
            area += part;
            center += (a + b + c) / 3.0 * part;
            running.push(area);
        }
        let shape = match &light.shape {
            LightShape::Rectangle { center, half_u, half_v } => {
                let corner = |s: f32, t: f32| *center + *half_u * s + *half_v * t;
                let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                Shape::Rectangle(corners, half_u.cross(*half_v).normalize_or_zero())
            }
            _ => Shape::Triangles(triangles, running),
        };
        Self {
            radiance: light.radiance,
            analytic: matches!(shape, Shape::Rectangle(..)) && light.cosine_power == 0.0,
            center: if area > 0.0 { center / area } else { center },
            luminance: light.radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722)),
            area,
            two_sided: light.two_sided,
            cosine_power: light.cosine_power,
            shape,
        }
    }

    /// Profile of the radiance at the cosine between its normal and the direction to the receiver.
    #[inline]
    pub fn profile(&self, cos: f32) -> f32 {
        let cos = if self.two_sided { cos.abs() } else { cos };
        match (cos > 0.0, self.cosine_power == 0.0) {
            (false, _) => 0.0,
            (true, true) => 1.0,
            (true, false) => cos.powf(self.cosine_power),
        }
    }

    /// Irradiance of a receiver for radiance 1, nothing in between: exact where `analytic`, else a guess (by
    /// the light's middle) that is good for choosing among lights only.
    #[inline]
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> f32 {
        if let (true, Shape::Rectangle(corners, n)) = (self.analytic, &self.shape) {
            if self.two_sided && (point - corners[0]).dot(*n) < 0.0 {
                let [a, b, c, d] = *corners;
                return irradiance::polygon(point, normal, &[a, d, c, b]);
            }
            return irradiance::polygon(point, normal, corners);
        }
        let to = self.center - point;
        let d2 = to.length_squared().max(self.area / std::f32::consts::PI).max(1e-20);
        self.area * (to.dot(normal) / d2.sqrt()).max(0.1) / d2
    }

    /// Picks a point, uniformly over the area.
    #[inline]
    pub fn sample(&self, u: Vec2) -> LightPoint {
        let pdf_area = 1.0 / self.area;
        match &self.shape {
            Shape::Rectangle(c, normal) => LightPoint {
                point: c[0] + (c[1] - c[0]) * u.x + (c[3] - c[0]) * u.y,
                normal: *normal,
                pdf_area,
            },
            Shape::Triangles(triangles, running) => {
                let wanted = u.x * self.area;
                let k = running.partition_point(|&r| r <= wanted).min(triangles.len() - 1);
                let before = if k == 0 { 0.0 } else { running[k - 1] };
                let rest = ((wanted - before) / (running[k] - before)).clamp(0.0, 1.0);
                let [a, b, c] = triangles[k];
                let root = rest.sqrt();
                let point = a + (b - a) * (1.0 - root) + (c - a) * (u.y * root);
                LightPoint { point, normal: (b - a).cross(c - a).normalize_or_zero(), pdf_area }
            }
        }
    }

    /// Density per area of [`Emitter::sample`].
    pub fn pdf_area(&self) -> f32 {
        1.0 / self.area
    }

    /// Whether the light has a luminous surface at all.
    pub fn is_dark(&self) -> bool {
        self.area <= 0.0 || self.radiance == Vec3::ZERO
    }
}

#[cfg(test)]
mod tests;
