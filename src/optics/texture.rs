//! Linear RGB textures, bilinear or bicubic, clamped at the border.

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
    #[inline(always)]
    pub fn sample(&self, uv: Vec2) -> Vec3 {
        let x = (uv.x * self.width as f32 - 0.5).clamp(0.0, (self.width - 1) as f32);
        let y = (uv.y * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let (i1, j1) = ((i + 1).min(self.width - 1), (j + 1).min(self.height - 1));
        let [upper, lower] = [j, j1].map(|j| &self.texels[j * self.width..][..self.width]);
        let [left, right] = [1.0 - fx, fx];
        (upper[i] * left + upper[i1] * right) * (1.0 - fy) + (lower[i] * left + lower[i1] * right) * fy
    }

    /// The value at (u, v) by cubic splines through the texels (Catmull and Rom 1974): where a picture is moved by parts of a
    /// pixel, bilinear means would take three quarters of its finest grain's variance. Not below 0.
    pub fn sharp(&self, uv: Vec2) -> Vec3 {
        let at = uv * Vec2::new(self.width as f32, self.height as f32) - 0.5;
        let whole = at.floor();
        let weights = |t: f32| {
            let (t2, t3) = (t * t, t * t * t);
            [-t3 + 2.0 * t2 - t, 3.0 * t3 - 5.0 * t2 + 2.0, -3.0 * t3 + 4.0 * t2 + t, t3 - t2]
                .map(|w| 0.5 * w)
        };
        let (across, down) = (weights(at.x - whole.x), weights(at.y - whole.y));
        let texel = |at: f32, k: usize, n: usize| (at as i64 + k as i64 - 1).clamp(0, n as i64 - 1) as usize;
        let mut sum = Vec3::ZERO;
        for (j, down) in down.into_iter().enumerate() {
            let row = texel(whole.y, j, self.height) * self.width;
            for (i, across) in across.into_iter().enumerate() {
                sum += self.texels[row + texel(whole.x, i, self.width)] * (across * down);
            }
        }
        sum.max(Vec3::ZERO)
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

    #[test]
    fn cubic_samples_keep_texels_slopes_and_more_of_the_grain() {
        let n = 64;
        let grain = |k: usize| super::super::noise::normal(5, k as u32) as f32;
        let value = |k: usize| Vec3::new((k % n) as f32, (k / n) as f32, 10.0 + grain(k));
        let t = Texture { width: n, height: n, texels: (0..n * n).map(value).collect() };
        let at = |x: f32, y: f32| Vec2::new(x + 0.5, y + 0.5) / n as f32;
        assert!((t.sharp(at(7.0, 9.0)) - value(9 * n + 7)).length() < 1e-4);
        let between = t.sharp(at(20.3, 31.6));
        assert!((between.x - 20.3).abs() < 1e-3 && (between.y - 31.6).abs() < 1e-3, "{between}");
        assert!((t.sharp(Vec2::new(-3.0, -9.0)) - t.texels[0]).length() < 1e-4);
        let variance = |sampled: &dyn Fn(Vec2) -> Vec3| {
            let halves =
                (0..50 * 50).map(|k| sampled(at((5 + k % 50) as f32 + 0.5, (5 + k / 50) as f32 + 0.5)).z);
            halves.map(|z| (z - 10.0).powi(2)).sum::<f32>() / 2500.0
        };
        let (sharp, soft) = (variance(&|uv| t.sharp(uv)), variance(&|uv| t.sample(uv)));
        // (9^2 + 9^2 + 1 + 1) / 16^2 along each axis, instead of 1/2.
        assert!((sharp - 0.41).abs() < 0.04 && (soft - 0.25).abs() < 0.03, "{sharp} {soft}");
    }
}
