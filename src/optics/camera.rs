//! The camera: pinhole, with optional radial distortion and an optional thin lens.

use glam::{Vec2, Vec3};

/// Radial distortion of the lens (Brown's model, two coefficients): a point at undistorted image position
/// q (in units of the focal length) appears at q (1 + k1 r^2 + k2 r^4).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Coefficient of r^2.
    pub k1: f32,
    /// Coefficient of r^4.
    pub k2: f32,
}

/// A thin lens: what is not at the focal distance is blurred.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinLens {
    /// Radius of the aperture, mm.
    pub aperture_radius_mm: f32,
    /// Distance along the axis at which the picture is sharp, mm.
    pub focus_mm: f32,
}

/// A camera in the scene frame. Pixel (0, 0) is the upper left one, row 0 on top.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Optical centre, mm.
    pub origin: Vec3,
    /// Unit vector towards the right edge of the picture.
    pub right: Vec3,
    /// Unit vector towards its upper edge.
    pub up: Vec3,
    /// Unit vector along the optical axis.
    pub forward: Vec3,
    /// Half of the horizontal field of view, as a tangent; pixels are square.
    pub tan_half_x: f32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Radial distortion.
    pub distortion: Option<Distortion>,
    /// Finite aperture.
    pub lens: Option<ThinLens>,
}

impl Camera {
    /// A pinhole at (x, y) above the pad that looks straight down on it, its picture upright.
    pub fn above(origin: Vec3, tan_half_x: f32, width: usize, height: usize) -> Self {
        Self {
            origin,
            right: Vec3::X,
            up: Vec3::Y,
            forward: Vec3::NEG_Z,
            tan_half_x,
            width,
            height,
            distortion: None,
            lens: None,
        }
    }

    /// Whether its distortion shows some directions twice, or never reaches the picture's corners.
    pub fn folds(&self) -> bool {
        let corner = Vec2::new(self.tan_half_x, self.tan_half_y()).length();
        self.distortion.is_some_and(|d| !d.reaches(corner))
    }

    /// Half of the vertical field of view, as a tangent.
    pub fn tan_half_y(&self) -> f32 {
        self.tan_half_x * self.height as f32 / self.width as f32
    }

    /// The same camera with another raster; the horizontal field of view stays.
    pub fn with_raster(&self, width: usize, height: usize) -> Self {
        Self { width, height, ..self.clone() }
    }

    /// The ray (origin, unit direction) of the point (px, py) of the raster, in pixels from the upper
    /// left corner; `lens` is a point of the unit disc and matters only where there is a thin lens.
    #[inline]
    pub fn ray(&self, px: f32, py: f32, lens: Vec2) -> (Vec3, Vec3) {
        let image = Vec2::new(
            self.tan_half_x * (2.0 * px / self.width as f32 - 1.0),
            self.tan_half_y() * (1.0 - 2.0 * py / self.height as f32),
        );
        let q = match self.distortion {
            None => image,
            Some(d) => d.undistort(image),
        };
        let along = self.forward + self.right * q.x + self.up * q.y;
        match self.lens {
            None => (self.origin, along.normalize()),
            Some(thin) => {
                let through = self.right * lens.x + self.up * lens.y;
                let start = self.origin + through * thin.aperture_radius_mm;
                let sharp = self.origin + along * thin.focus_mm;
                (start, (sharp - start).normalize())
            }
        }
    }
}

impl Distortion {
    /// Where an undistorted image point appears.
    pub fn distort(&self, q: Vec2) -> Vec2 {
        let r2 = q.length_squared();
        q * (1.0 + r2 * (self.k1 + r2 * self.k2))
    }

    /// Whether every point of the picture up to so far from its middle is the image of one direction.
    pub fn reaches(&self, image: f32) -> bool {
        let mut r = 0.0f32;
        while r * (1.0 + r * r * (self.k1 + r * r * self.k2)) < image {
            let r2 = r * r;
            if 1.0 + r2 * (3.0 * self.k1 + 5.0 * r2 * self.k2) <= 0.0 {
                return false;
            }
            r += 0.01 * image;
        }
        true
    }

    /// The inverse of [`Distortion::distort`], by Newton's method on the radius.
    pub fn undistort(&self, image: Vec2) -> Vec2 {
        let rd = image.length();
        if rd == 0.0 {
            return image;
        }
        let mut r = rd;
        for _ in 0..8 {
            let r2 = r * r;
            let value = r * (1.0 + r2 * (self.k1 + r2 * self.k2)) - rd;
            let slope = 1.0 + r2 * (3.0 * self.k1 + 5.0 * r2 * self.k2);
            r -= value / slope;
        }
        image * (r / rd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_see_the_plane_where_the_benchmark_says() {
        let camera =
            Camera::above(Vec3::Z * 19.0, (50.69235188389338_f64 / 2.0).to_radians().tan() as f32, 640, 480);
        for (px, py) in [(0.0, 0.0), (319.0, 100.0), (639.0, 479.0)] {
            let (o, d) = camera.ray(px + 0.5, py + 0.5, Vec2::ZERO);
            let at = o - d * (o.z / d.z);
            assert!((at.x - (-9.0 + 18.0 * (px + 0.5) / 640.0)).abs() < 1e-5);
            assert!((at.y - (6.75 - 13.5 * (py + 0.5) / 480.0)).abs() < 1e-5);
        }
    }

    #[test]
    fn distortion_and_its_inverse_agree() {
        let d = Distortion { k1: -0.2, k2: 0.05 };
        for q in [Vec2::new(0.5, 0.3), Vec2::new(-0.1, 0.0), Vec2::new(0.7, -0.4)] {
            assert!((d.undistort(d.distort(q)) - q).length() < 1e-5);
        }
    }

    #[test]
    fn a_thin_lens_is_sharp_at_its_focus() {
        let mut camera = Camera::above(Vec3::Z * 19.0, 0.5, 64, 48);
        let (o, d) = camera.ray(10.0, 20.0, Vec2::ZERO);
        let sharp = o - d * (o.z / d.z);
        camera.lens = Some(ThinLens { aperture_radius_mm: 0.7, focus_mm: 19.0 });
        for lens in [Vec2::X, Vec2::new(-0.3, 0.8)] {
            let (o, d) = camera.ray(10.0, 20.0, lens);
            assert!((o - d * (o.z / d.z) - sharp).length() < 1e-4);
        }
    }
}
