//! Directions as plans write them: words of the camera's image, or degrees.

use crate::motion::SlideDirection;
use serde::{Deserialize, Deserializer, Serialize};

/// A slide direction in a plan file: `"left"`, `"right"`, `"up"`, `"down"`, or degrees from right
/// towards down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrittenDirection(pub SlideDirection);

impl<'de> Deserialize<'de> for WrittenDirection {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = WrittenDirection;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("\"left\", \"right\", \"up\", \"down\", or degrees from right towards down")
            }
            fn visit_f64<E: serde::de::Error>(self, v: f64) -> Result<WrittenDirection, E> {
                if v.is_finite() && v.abs() <= 360.0 {
                    Ok(WrittenDirection(SlideDirection { deg: v.rem_euclid(360.0) }))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Float(v), &self))
                }
            }
            fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<WrittenDirection, E> {
                self.visit_f64(v as f64)
            }
            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<WrittenDirection, E> {
                let deg = match v {
                    "right" => 0.0,
                    "down" => 90.0,
                    "left" => 180.0,
                    "up" => 270.0,
                    _ => return Err(E::unknown_variant(v, &["left", "right", "up", "down"])),
                };
                Ok(WrittenDirection(SlideDirection { deg }))
            }
        }
        d.deserialize_any(Visitor)
    }
}

/// Which way the indenter turns, as seen in the camera's image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpinDirection {
    /// Clockwise: positive about z.
    Cw,
    /// Counter-clockwise: negative about z.
    Ccw,
}

impl SpinDirection {
    /// `angle_deg` with the sign of the direction.
    pub fn signed_deg(self, angle_deg: f64) -> f64 {
        match self {
            SpinDirection::Cw => angle_deg,
            SpinDirection::Ccw => 0.0 - angle_deg,
        }
    }
}

/// The unit vector of a slide in the pad frame. Exact along the axes, so that a slide to the left
/// has no y at all.
pub fn unit_vector(direction: SlideDirection) -> [f64; 2] {
    match direction.deg.rem_euclid(360.0) {
        0.0 => [1.0, 0.0],
        90.0 => [0.0, 1.0],
        180.0 => [-1.0, 0.0],
        270.0 => [0.0, -1.0],
        deg => {
            let (s, c) = deg.to_radians().sin_cos();
            [c, s]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_is_minus_x_down_is_plus_y_and_clockwise_is_positive() {
        assert_eq!(unit_vector(SlideDirection { deg: 180.0 }), [-1.0, 0.0]);
        assert_eq!(unit_vector(SlideDirection { deg: 90.0 }), [0.0, 1.0]);
        assert_eq!(unit_vector(SlideDirection { deg: -90.0 }), [0.0, -1.0]);
        let [x, y] = unit_vector(SlideDirection { deg: 30.0 });
        assert!((x - 0.75_f64.sqrt()).abs() < 1e-12 && (y - 0.5).abs() < 1e-12);
        assert_eq!(SpinDirection::Cw.signed_deg(45.0), 45.0);
        assert_eq!(SpinDirection::Ccw.signed_deg(45.0), -45.0);
        assert!(SpinDirection::Ccw.signed_deg(0.0).is_sign_positive());
    }
}
