//! Where the indenter is, relative to the sensor.
//!
//! Everything in the program speaks of one frame, the *pad frame*: origin at the centre of the
//! undeformed contact face; seen in the camera's upright image x points right, y down, z away
//! from the camera, out of the pad towards the indenter. It is right-handed. An indentation is
//! negative z, and a positive rotation about z is clockwise in the image.

use serde::{Deserialize, Serialize};

/// Pose of the indenter's tip in the pad frame. `z_mm` is the height of the tip: 0 touches the
/// undeformed face, -0.5 is pressed half a millimetre deep.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// To the right in the camera's image, mm.
    pub x_mm: f64,
    /// Downwards in the camera's image, mm.
    pub y_mm: f64,
    /// Out of the pad, towards the indenter, mm.
    pub z_mm: f64,
    /// Rotation of the indenter about z, right-handed (clockwise in the image), degrees.
    pub theta_deg: f64,
}

impl Pose {
    /// A pose from its four numbers (mm, mm, mm, degrees).
    pub const fn new(x_mm: f64, y_mm: f64, z_mm: f64, theta_deg: f64) -> Self {
        Self { x_mm, y_mm, z_mm, theta_deg }
    }

    /// How deep the tip is below the undeformed face, mm (0 when it is above).
    pub fn depth_mm(&self) -> f64 {
        (-self.z_mm).max(0.0)
    }

    /// Distance travelled by the tip from here to there, mm; rotation does not count.
    pub fn distance_mm(&self, to: &Pose) -> f64 {
        ((to.x_mm - self.x_mm).powi(2) + (to.y_mm - self.y_mm).powi(2) + (to.z_mm - self.z_mm).powi(2)).sqrt()
    }

    /// The pose a fraction `s` of the way to `to`, each coordinate linearly.
    pub fn lerp(&self, to: &Pose, s: f64) -> Pose {
        let mix = |a: f64, b: f64| a + (b - a) * s;
        Pose::new(
            mix(self.x_mm, to.x_mm),
            mix(self.y_mm, to.y_mm),
            mix(self.z_mm, to.z_mm),
            mix(self.theta_deg, to.theta_deg),
        )
    }

    /// Maps a point of the indenter's own frame (tip at the origin, body towards +z) into the pad frame.
    pub fn to_pad(&self, p: glam::DVec3) -> glam::DVec3 {
        let (s, c) = self.theta_deg.to_radians().sin_cos();
        glam::DVec3::new(c * p.x - s * p.y + self.x_mm, s * p.x + c * p.y + self.y_mm, p.z + self.z_mm)
    }

    /// Maps a point of the pad frame into the indenter's own frame; the inverse of [`Pose::to_pad`].
    pub fn to_indenter(&self, p: glam::DVec3) -> glam::DVec3 {
        let (s, c) = self.theta_deg.to_radians().sin_cos();
        let (x, y) = (p.x - self.x_mm, p.y - self.y_mm);
        glam::DVec3::new(c * x + s * y, -s * x + c * y, p.z - self.z_mm)
    }
}

impl std::fmt::Display for Pose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // What rounds to nothing has no sign.
        let [x, y, z] = [self.x_mm, self.y_mm, self.z_mm].map(|mm| (mm * 1e3).round() / 1e3 + 0.0);
        let theta = (self.theta_deg * 1e2).round() / 1e2 + 0.0;
        write!(f, "x {x:.3} y {y:.3} z {z:.3} mm, {theta:.2} deg")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_rounds_to_nothing_is_written_without_a_sign() {
        let pose = Pose::new(-1e-5, -0.0, -0.0004, -0.004);
        assert_eq!(pose.to_string(), "x 0.000 y 0.000 z 0.000 mm, 0.00 deg");
        assert_eq!(
            Pose::new(-0.0006, 1.0, -2.0, -45.0).to_string(),
            "x -0.001 y 1.000 z -2.000 mm, -45.00 deg"
        );
    }

    #[test]
    fn frames_are_inverse_and_positive_rotation_is_clockwise_in_the_image() {
        let pose = Pose::new(1.0, -2.0, 0.5, 90.0);
        let p = glam::DVec3::new(1.0, 0.0, 0.0);
        let q = pose.to_pad(p);
        // +x (right) turns to +y, which is down in the image: clockwise.
        assert!((q - glam::DVec3::new(1.0, -1.0, 0.5)).length() < 1e-12);
        assert!((pose.to_indenter(q) - p).length() < 1e-12);
    }
}
