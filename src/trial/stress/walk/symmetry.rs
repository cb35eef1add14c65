//! Symmetry: whether a body, and the face under it, are their own mirror images in x and in y.

use crate::elastomer::ElastomerCapture;
use crate::indenter::Indenter;
use crate::trial::scene;
use glam::DVec3;

/// Whether a body is its own mirror image in x and in y.
pub(super) fn is_mirrored(body: &dyn Indenter) -> bool {
    let [hx, hy] = body.half_extent_mm();
    let at = |k: u32, half: f64, step: f64| half * ((f64::from(k) * step).fract() * 2.2 - 1.1);
    (0..200).all(|k| {
        let p = DVec3::new(at(k, hx, 0.618), at(k, hy, 0.414), 0.3 * f64::from(k % 7));
        let d = body.distance(p);
        [[-1.0, 1.0], [1.0, -1.0]]
            .iter()
            .all(|m| (body.distance(DVec3::new(m[0] * p.x, m[1] * p.y, p.z)) - d).abs() < 1e-9)
    })
}

/// Largest difference between the heights of a surface and of its mirror images, mm, away from the edge of the contact:
/// there a point that touches or not moves the face by itself, and errors are not counted.
pub(super) fn asymmetry_mm(now: &ElastomerCapture) -> f64 {
    let s = &now.surface;
    let z = |i: usize, j: usize| s.positions[j * s.nx + i].z;
    let edge = edge_of_contact(now);
    let mut most = 0.0f32;
    for j in 0..s.ny {
        for i in 0..s.nx {
            for (p, q) in [(s.nx - 1 - i, j), (i, s.ny - 1 - j)] {
                if !edge[j * s.nx + i] && !edge[q * s.nx + p] {
                    most = most.max((z(i, j) - z(p, q)).abs());
                }
            }
        }
    }
    f64::from(most)
}

/// The points within [`EDGE_BAND_MM`] of one that touches where they do not, or does not where they do; at least their
/// neighbours.
fn edge_of_contact(now: &ElastomerCapture) -> Vec<bool> {
    let s = &now.surface;
    let pitch = [s.size_x_mm / (s.nx - 1) as f64, s.size_y_mm / (s.ny - 1) as f64];
    let reach = pitch.map(|p| ((scene::EDGE_BAND_MM / p) as usize).max(1));
    let near = |at: usize, reach: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
    let touches = |i: usize, j: usize| now.contact[j * s.nx + i];
    (0..s.nx * s.ny)
        .map(|n| (n % s.nx, n / s.nx))
        .map(|(i, j)| {
            let mut around =
                near(j, reach[1], s.ny).flat_map(|q| near(i, reach[0], s.nx).map(move |p| (p, q)));
            around.any(|(p, q)| touches(p, q) != touches(i, j))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_is_its_own_mirror_image_and_a_skew_body_is_not() {
        assert!(is_mirrored(scene::sphere(3.0).as_ref()));
        let plan =
            crate::indenter::spec::Plan::Polygon { corners_mm: vec![[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]] };
        let shape = crate::indenter::spec::Shape::Flat { plan };
        let skew = crate::indenter::from_spec("skew", &scene::spec(shape, 0.0), None).expect("a triangle");
        assert!(!is_mirrored(skew.as_ref()));
    }
}
