//! Thin bodies askew to the grid: blades, ridges, rings and pins that sample points may pass between.
//!
//! What is missed altogether leaves a face that is flat and sound in every other respect, so the truth comes from outside: a bonded
//! layer resists a flat body at least as a half-space of its material does, whose force goes as the body's electrostatic capacity
//! (Johnson, Contact Mechanics, 3.4 and 3.6).

use super::cases::{Body, Case};
use crate::draw::Draw;
use crate::indenter::spec::{Plan, Shape};
use crate::trial::scene;
use std::f64::consts::PI;

/// Draws a thin body, and how it stands to the grid.
pub fn draw_thin(case: &mut Case, draw: &mut Draw) {
    let width_mm = draw.of(&[0.01, 0.03, 0.1, 0.2]);
    let (name, plan) = match draw.below(4) {
        0 => ("blade", Plan::Rectangle { x_mm: width_mm, y_mm: draw.of(&[4.0, 8.0]) }),
        1 => ("ridges", Plan::Stripes { count: 4, width_mm, length_mm: 6.0, pitch_mm: 1.7 }),
        2 => {
            let outer_diameter_mm = draw.of(&[3.0, 7.0]);
            let inner_diameter_mm = outer_diameter_mm - 2.0 * width_mm;
            ("ring", Plan::Ring { outer_diameter_mm, inner_diameter_mm })
        }
        _ => ("pin", Plan::Disc { diameter_mm: 2.0 * width_mm }),
    };
    case.body = Body { name: format!("{name} {width_mm}"), spec: scene::spec(Shape::Flat { plan }, 0.0) };
    case.askew_deg = draw.of(&[0.0, 7.0, 20.0, 45.0]);
    case.at_mm = draw.of(&[[0.0, 0.0], [0.03, 0.01], [0.11, -0.07], [0.21, 0.2]]);
    case.depth_mm = draw.of(&[0.1, 0.3, 0.5]);
    case.slide_mm = draw.of(&[0.0, 0.0, 0.25]);
}

/// Force of a half-space of the pad's material against the case's body, or one of its ridges, linear and without friction, N.
///
/// # Panics
/// When the body is none that [`draw_thin`] draws.
pub fn half_space_n(case: &Case) -> f64 {
    let Shape::Flat { plan } = &case.body.spec.shape else { panic!("a thin body is flat: {:?}", case.body) };
    let capacity_mm = match *plan {
        Plan::Disc { diameter_mm } => capacity_of_ellipse_mm(0.5 * diameter_mm, 0.5 * diameter_mm),
        // The ellipse within.
        Plan::Rectangle { x_mm, y_mm } => capacity_of_ellipse_mm(0.5 * y_mm, 0.5 * x_mm),
        Plan::Stripes { width_mm, length_mm, .. } => capacity_of_ellipse_mm(0.5 * length_mm, 0.5 * width_mm),
        Plan::Ring { outer_diameter_mm, inner_diameter_mm } => {
            let (middle_mm, width_mm) = (
                0.25 * (outer_diameter_mm + inner_diameter_mm),
                0.5 * (outer_diameter_mm - inner_diameter_mm),
            );
            // A strip is a wire of a quarter of its width.
            PI * middle_mm / (32.0 * middle_mm / width_mm).ln()
        }
        ref other => panic!("no thin body: {other:?}"),
    };
    let m = &case.pad.material;
    PI * m.youngs_modulus_mpa / (1.0 - m.poisson_ratio.powi(2)) * capacity_mm * case.depth_mm
}

/// Capacity of an elliptic disc of the given semi-axes in free space over 4 pi epsilon, mm: by the arithmetic-geometric mean.
fn capacity_of_ellipse_mm(long_mm: f64, short_mm: f64) -> f64 {
    let (mut a, mut g) = (1.0, short_mm / long_mm);
    while a - g > 1e-12 {
        (a, g) = (0.5 * (a + g), (a * g).sqrt());
    }
    2.0 / PI * long_mm * a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capacities_are_the_known_ones() {
        // A disc's is 2 a / pi.
        assert!((capacity_of_ellipse_mm(1.5, 1.5) - 3.0 / PI).abs() < 1e-12);
        // A needle's tends to a / ln(4 a / b).
        let needle = capacity_of_ellipse_mm(4.0, 0.005);
        assert!((needle * (16.0f64 / 0.005).ln() / 4.0 - 1.0).abs() < 1e-3, "{needle}");
    }
}
