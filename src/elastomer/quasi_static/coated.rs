//! How far the face of a layer under a coating gives way: both answer waves as elastic layers, and move together where they meet.
//!
//! Waves that run along x with k radians a mm, e^(i k x), in plane strain. In each layer displacements and stresses are what Papkovich
//! and Neuber's two functions, of amplitudes A and B, make of waves that die out from its upper and from its lower face,
//!
//! ```text
//! 2 mu u_x = -i k (A + z B) e^(s z)                      2 mu u_z = ((3 - 4 nu) B - s (A + z B)) e^(s z)
//! tau_xz = i k ((1 - 2 nu) B - s (A + z B)) e^(s z)      sigma_zz = (2 (1 - nu) s B - s^2 (A + z B)) e^(s z),   s = k, -k,
//! ```
//!
//! of which the four that fit what its faces do are found. (Layers put together by their stiffness as
//! Kausel and Roesset 1981, "Stiffness matrices for layered soils".)

use super::compliance;
use glam::{DMat2, DMat4, DVec2, DVec4};

/// An elastic layer.
#[derive(Debug, Clone, Copy)]
pub struct Layer {
    /// Young's modulus, MPa.
    pub youngs_modulus_mpa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Thickness, mm.
    pub thickness_mm: f64,
}

/// Tractions over displacements of the faces of a layer, along the wave and across it, MPa/mm: of the upper face by its own
/// displacement and by that of the lower, and the same of the lower face.
struct Stiffness {
    upper: DMat2,
    upper_by_lower: DMat2,
    lower_by_upper: DMat2,
    lower: DMat2,
}

impl Layer {
    /// How far it gives way as a whole when it is pressed everywhere, mm per MPa.
    fn squeezed(&self) -> f64 {
        let nu = self.poisson_ratio;
        (1.0 + nu) * (1.0 - 2.0 * nu) / (1.0 - nu) * self.thickness_mm / self.youngs_modulus_mpa
    }

    /// For a wave of `k` radians a mm.
    fn stiffness(&self, k: f64) -> Stiffness {
        let Self { youngs_modulus_mpa, poisson_ratio: nu, thickness_mm } = *self;
        let twice_mu = youngs_modulus_mpa / (1.0 + nu);
        let q = k * thickness_mm;
        // Displacements (times 2 mu, over k) and tractions (over k^2) on a level z = zeta / k from where a pair of waves begins, the
        // first of A = 1, the second of B = k.
        let displacements = |sign: f64, zeta: f64| {
            let fall = (sign * zeta).exp();
            [DVec2::new(-1.0, -sign) * fall, DVec2::new(-zeta, 3.0 - 4.0 * nu - sign * zeta) * fall]
        };
        let tractions = |sign: f64, zeta: f64| {
            let fall = (sign * zeta).exp();
            let second = DVec2::new(1.0 - 2.0 * nu - sign * zeta, 2.0 * (1.0 - nu) * sign - zeta);
            [DVec2::new(-sign, -1.0) * fall, second * fall]
        };
        // Columns: two waves that begin at the upper face, two that begin at the lower; rows: what they do to the upper face, and to
        // the lower, where outwards is down.
        let to_faces = |of: &dyn Fn(f64, f64) -> [DVec2; 2], outwards: f64| {
            let column = |above: DVec2, below: DVec2| {
                let below = below * outwards;
                DVec4::new(above.x, above.y, below.x, below.y)
            };
            let ([a, b], [a_below, b_below]) = (of(1.0, 0.0), of(1.0, -q));
            let ([c, d], [c_below, d_below]) = (of(-1.0, q), of(-1.0, 0.0));
            DMat4::from_cols(column(a, a_below), column(b, b_below), column(c, c_below), column(d, d_below))
        };
        let all = to_faces(&tractions, -1.0) * to_faces(&displacements, 1.0).inverse() * (twice_mu * k);
        let [a, b, c, d] = [all.x_axis, all.y_axis, all.z_axis, all.w_axis];
        Stiffness {
            upper: DMat2::from_cols(a.truncate().truncate(), b.truncate().truncate()),
            lower_by_upper: DMat2::from_cols(DVec2::new(a.z, a.w), DVec2::new(b.z, b.w)),
            upper_by_lower: DMat2::from_cols(c.truncate().truncate(), d.truncate().truncate()),
            lower: DMat2::from_cols(DVec2::new(c.z, c.w), DVec2::new(d.z, d.w)),
        }
    }
}

/// mm per MPa of a wave of pressure of `k` radians a mm on a coating whose bulk is bonded to a rigid base.
pub fn of_coated(k: f64, coating: &Layer, bulk: &Layer) -> f64 {
    if k * (coating.thickness_mm + bulk.thickness_mm) < compliance::SHALLOW {
        return coating.squeezed() + bulk.squeezed();
    }
    if k * coating.thickness_mm > compliance::DEEP {
        let Layer { youngs_modulus_mpa, poisson_ratio, thickness_mm } = *coating;
        return compliance::of_layer(k, youngs_modulus_mpa, poisson_ratio, thickness_mm, -1.0);
    }
    let below = bulk.stiffness(k).upper;
    let above = coating.stiffness(k);
    let face = above.upper - above.upper_by_lower * (above.lower + below).inverse() * above.lower_by_upper;
    face.inverse().y_axis.y
}

#[cfg(test)]
mod tests {
    use super::super::compliance::of_layer;
    use super::*;

    #[test]
    fn a_coating_of_the_same_stuff_is_none() {
        let layer =
            |thickness_mm: f64| Layer { youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, thickness_mm };
        for thickness_mm in [0.002, 0.05, 0.5, 3.0] {
            for k in [1e-3, 0.0026, 0.01, 0.1, 0.7, 3.0, 20.0, 200.0] {
                let coated = of_coated(k, &layer(thickness_mm), &layer(4.0 - thickness_mm));
                let whole = of_layer(k, 0.145, 0.45, 4.0, -1.0);
                assert!((coated / whole - 1.0).abs() < 1e-4, "{thickness_mm} {k}: {coated} {whole}");
            }
        }
    }

    #[test]
    fn coatings_answer_as_their_equations_have_it() {
        // Integrated through the depth (f64, 4000 Runge-Kutta steps a layer): a stiff one, and a soft one.
        let layer = |youngs_modulus_mpa, poisson_ratio, thickness_mm| Layer {
            youngs_modulus_mpa,
            poisson_ratio,
            thickness_mm,
        };
        for (k, stiff, soft) in [
            (0.05, 7.391_149, 6.694_031),
            (0.2, 10.606_995, 13.553_420),
            (0.5, 14.068_594, 18.436_410),
            (1.0, 9.961_192, 15.665_222),
            (2.0, 3.969_236, 12.279_614),
        ] {
            let found = of_coated(k, &layer(1.45, 0.3, 0.3), &layer(0.145, 0.45, 3.7));
            assert!((found / stiff - 1.0).abs() < 1e-6, "{k}: {found} {stiff}");
            let found = of_coated(k, &layer(0.03, 0.45, 0.5), &layer(0.145, 0.49, 3.5));
            assert!((found / soft - 1.0).abs() < 1e-6, "{k}: {found} {soft}");
        }
    }
}
