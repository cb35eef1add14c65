//! Linear RGB textures, bilinear, clamped at the border.

use glam::{Vec2, Vec3};

/// A picture on a surface. Texel (i, j) is centred on u = (i + 0.5)/width, v = (j + 0.5)/height, so row 0
/// lies at v = 0; who makes the texture coordinates decides whether that is the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Texels along u.
    pub width: usize,
    /// Texels along v.
    pub height: usize,
    /// Linear values, u inner.
    pub texels: Vec<Vec3>,
}

impl Texture {
    /// A texture from a function of the texel's centre (u, v).
    pub fn from_fn(width: usize, height: usize, value: impl Fn(f64, f64) -> Vec3) -> Self {
        let texels = (0..width * height)
            .map(|k| {
                value(((k % width) as f64 + 0.5) / width as f64, ((k / width) as f64 + 0.5) / height as f64)
            })
            .collect();
        Self { width, height, texels }
    }

    /// A texture from 8-bit code values, row 0 first, decoded by the sRGB transfer function.
    pub fn from_srgb8(width: usize, height: usize, rgb: &[u8]) -> Self {
        let decode = super::film::srgb_to_linear;
        let texels = rgb
            .chunks_exact(3)
            .take(width * height)
            .map(|p| Vec3::new(decode(p[0]), decode(p[1]), decode(p[2])))
            .collect();
        Self { width, height, texels }
    }

    /// The value at (u, v), bilinear between texel centres.
    #[inline]
    pub fn sample(&self, uv: Vec2) -> Vec3 {
        let x = (uv.x * self.width as f32 - 0.5).clamp(0.0, (self.width - 1) as f32);
        let y = (uv.y * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let (i1, j1) = ((i + 1).min(self.width - 1), (j + 1).min(self.height - 1));
        let row = |j: usize| self.texels[j * self.width + i].lerp(self.texels[j * self.width + i1], fx);
        row(j).lerp(row(j1), fy)
    }

    /// The mean over all texels.
    pub fn mean(&self) -> Vec3 {
        self.texels.iter().sum::<Vec3>() / self.texels.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texel_centres_are_exact_and_the_middle_is_the_mean() {
        let t = Texture::from_fn(4, 2, |u, v| Vec3::new(u as f32, v as f32, 0.0));
        for (u, v) in [(0.125, 0.25), (0.875, 0.75), (0.5, 0.5), (0.3, 0.6)] {
            assert!((t.sample(Vec2::new(u, v)) - Vec3::new(u, v, 0.0)).length() < 1e-6);
        }
        assert_eq!(t.sample(Vec2::new(-3.0, 9.0)), Vec3::new(0.125, 0.75, 0.0));
    }
}
