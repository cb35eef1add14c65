//! The pad of the published figures, spheres and punches, and how two surfaces are compared.

use crate::elastomer::{Friction, Law, Material, Mode, Pad, Settings, Surface};
use crate::indenter::spec::{Plan, Shape};
use crate::indenter::{self, Indenter, IndenterSpec};
use std::sync::Arc;

/// Half the width of the band at the contact's edge that is not scored, mm.
pub(super) const EDGE_BAND_MM: f64 = 0.1;

/// 20 x 20 x 4 mm, E = 0.145 MPa, nu = 0.45: the predecessor's pad.
pub fn pad(law: Law) -> Pad {
    // Density as in its units; only the explicit modes use it.
    let material = Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 };
    Pad::slab([20.0, 20.0, 4.0], material)
}

/// A body by its shape alone.
pub fn spec(shape: Shape, edge_round_mm: f64) -> IndenterSpec {
    IndenterSpec { description: String::new(), edge_round_mm, height_mm: 8.0, shape }
}

/// A sphere.
pub fn sphere(radius_mm: f64) -> Arc<dyn Indenter> {
    let shape = Shape::Dome { radius_mm, diameter_mm: 2.0 * radius_mm };
    let spec = IndenterSpec { height_mm: 8.0f64.max(radius_mm + 1.0), ..spec(shape, 0.0) };
    indenter::from_spec("sphere", &spec, None).expect("a sphere of sound radius is a sound body")
}

/// A flat round punch with its edge rounded.
pub fn punch(diameter_mm: f64, edge_round_mm: f64) -> Arc<dyn Indenter> {
    let shape = Shape::Flat { plan: Plan::Disc { diameter_mm } };
    indenter::from_spec("punch", &spec(shape, edge_round_mm), None).expect("the round fits into the punch")
}

/// Quasi-static settings.
pub fn quasi_static(friction: Friction, tolerance: f64) -> Settings {
    Settings { mode: Mode::QuasiStatic, friction, tolerance, ..Settings::default() }
}

/// Root mean square and largest difference of the heights of two surfaces on the same lattice, um, over the points that
/// lie at rest within `within_mm` of (0, 0) and not at the contact's edge of radius `edge_mm`.
pub fn height_difference_um(a: &Surface, b: &Surface, within_mm: f64, edge_mm: f64) -> [f64; 2] {
    let (mut sum, mut count, mut most) = (0.0, 0u32, 0.0f64);
    for j in 0..a.ny {
        for i in 0..a.nx {
            let [x, y] = a.rest_xy(i, j);
            let r = x.hypot(y);
            if r > within_mm || (r - edge_mm).abs() < EDGE_BAND_MM {
                continue;
            }
            let k = j * a.nx + i;
            let d = 1e3 * f64::from(a.positions[k].z - b.positions[k].z);
            sum += d * d;
            count += 1;
            most = most.max(d.abs());
        }
    }
    [(sum / f64::from(count.max(1))).sqrt(), most]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_shift_of_the_surface_is_its_difference() {
        let flat = |z: f32| Surface {
            nx: 21,
            ny: 21,
            size_x_mm: 20.0,
            size_y_mm: 20.0,
            positions: vec![Vec3::new(0.0, 0.0, z); 441],
        };
        let [rmse, most] = height_difference_um(&flat(0.0), &flat(-0.002), 5.0, 1.0);
        assert!((rmse - 2.0).abs() < 1e-4 && (most - 2.0).abs() < 1e-4);
    }
}
