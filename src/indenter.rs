//! Indenters: rigid bodies known by their signed distance.
//!
//! The frame of an indenter has its lowest point (the tip) at the origin's height and its body
//! towards +z; x and y are those of the pad at zero rotation. Points are `DVec3` in mm.

use glam::DVec3;

/// A rigid indenter.
pub trait Indenter: Send + Sync + std::fmt::Debug {
    /// Name, the stem of its file.
    fn name(&self) -> &str;

    /// Signed distance from `p` to the surface, mm, negative inside. Exact near the surface;
    /// far away it may be a lower bound of the true distance.
    fn distance(&self, p: DVec3) -> f64;

    /// Signed distance and its unit gradient (outward normal) at `p`.
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3);

    /// Half extents of the body in x and y, mm: it lies within |x| <= hx, |y| <= hy.
    fn half_extent_mm(&self) -> [f64; 2];

    /// Height of the body's lower surface above the tip plane at (x, y), mm; `None` beside the body.
    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64>;
}
