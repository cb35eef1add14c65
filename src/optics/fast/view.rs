//! Where the camera sees a point of the pad, and what a point of the raster sees.
//!
//! A ray that leaves through a plate runs on as if it had started on the plate's lower face: so every point of the
//! raster has a start and a direction, and a point of the pad on it is start + along / value, where the value is
//! linear enough in the raster to be interpolated over a triangle (exactly so without a plate: it is the inverse depth).

use super::plate::Slab;
use crate::optics::Camera;
use glam::{Vec2, Vec3};

/// A camera, perhaps above a plate.
#[derive(Debug, Clone)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// The plate below it.
    pub slab: Option<Slab>,
    /// By point of the corner raster, row by row: start and direction of its ray.
    rays: Vec<[Vec3; 2]>,
}

impl View {
    /// Works out the rays of all corners of pixels.
    pub fn new(camera: &Camera, slab: Option<Slab>) -> Self {
        let mut view = Self { camera: camera.clone(), slab, rays: Vec::new() };
        let [columns, rows] = view.corners();
        view.rays = (0..columns * rows)
            .map(|k| view.ray(Vec2::new((k % columns) as f32, (k / columns) as f32)))
            .collect();
        view
    }

    /// Corners of pixels along x and y.
    pub fn corners(&self) -> [usize; 2] {
        [self.camera.width + 1, self.camera.height + 1]
    }

    /// The rays of a row of corners.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &[[Vec3; 2]] {
        let [columns, _] = self.corners();
        &self.rays[row * columns..(row + 1) * columns]
    }

    /// Start and direction of the ray of a point of the raster, in pixels.
    pub fn ray(&self, at: Vec2) -> [Vec3; 2] {
        let (origin, direction) = self.camera.ray(at.x, at.y, Vec2::ZERO);
        match &self.slab {
            None => [origin, direction / direction.dot(self.camera.forward)],
            Some(slab) => slab.below(origin, direction),
        }
    }

    /// The point at a value on a ray.
    #[inline(always)]
    pub fn point([start, along]: [Vec3; 2], value: f32) -> Vec3 {
        start + along / value
    }

    /// Whether a point is within the raster, be there something before it or not.
    pub fn sees(&self, p: Vec3) -> bool {
        let at = self.project(p).truncate();
        let raster = Vec2::new(self.camera.width as f32, self.camera.height as f32);
        at.cmpge(Vec2::ZERO).all() && at.cmple(raster).all()
    }

    /// Raster coordinates in pixels, and the value; not a number behind the camera.
    #[inline(always)]
    pub fn project(&self, p: Vec3) -> Vec3 {
        let camera = &self.camera;
        let to = p - camera.origin;
        let (mut q, value) = match &self.slab {
            None => {
                let depth = to.dot(camera.forward);
                let q = Vec2::new(to.dot(camera.right), to.dot(camera.up)) / depth;
                (q, if depth > 0.0 { 1.0 / depth } else { f32::NAN })
            }
            Some(slab) => {
                let (tangent, value) = slab.apparent(camera.origin, p);
                (Vec2::new(tangent.dot(camera.right.truncate()), tangent.dot(camera.up.truncate())), value)
            }
        };
        if let Some(d) = camera.distortion {
            q = d.distort(q);
        }
        let (width, height) = (camera.width as f32, camera.height as f32);
        let image = Vec2::new(q.x / camera.tan_half_x, q.y / camera.tan_half_y());
        Vec3::new((1.0 + image.x) * 0.5 * width, (1.0 - image.y) * 0.5 * height, value)
    }
}
