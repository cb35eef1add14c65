//! The face as it lies on the indenter.
//!
//! Between the sample points of the contact the face's splines enter a body a little, and beside its edges, where the
//! pressure of a flat body is largest, they sag below it by a few hundredths of a millimetre, a cell at a time. Where a
//! face lies that is pressed is known better than that: on the body. So what is inside is brought to the surface, and so is
//! what hangs a little below a plane that is pressed within a cell of it: contact with a plane ends at its edge.

use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Deepest that a point may be inside to be brought out, and furthest below to be brought up, cells: what is further is no
/// matter of splines.
const FURTHEST: f64 = 0.12;
/// Normals of a plane agree this far, as a cosine (half a degree).
const SAME_NORMAL: f64 = 0.99996;
/// Points of a plane are this far off it at most, mm.
const OFF_PLANE_MM: f64 = 1e-3;

/// A lattice of points of the face.
pub struct Face<'a> {
    /// Points along x.
    pub nx: usize,
    /// Where they are, y outer, mm.
    pub positions: &'a mut [Vec3],
    /// Which are pressed.
    pub pressed: &'a [bool],
    /// Points across a cell, along x and y.
    pub across: [usize; 2],
    /// Width of a cell, mm.
    pub cell_mm: f64,
}

/// A point near the body's surface.
#[derive(Debug, Clone, Copy)]
struct Near {
    distance: f64,
    normal: DVec3,
    /// Nearest point of the surface.
    foot: DVec3,
}

impl Face<'_> {
    /// Lays it on the indenter.
    pub fn lie_on(self, indenter: &dyn Indenter, pose: &Pose) {
        let furthest = FURTHEST * self.cell_mm;
        let [hx, hy] = indenter.half_extent_mm();
        let near = |p: &Vec3| {
            let p = pose.to_indenter(p.as_dvec3());
            if p.x.abs() > hx + furthest || p.y.abs() > hy + furthest {
                return None;
            }
            let (distance, normal) = indenter.distance_and_normal(p);
            let near = distance.abs() <= furthest && normal.is_finite();
            near.then(|| Near { distance, normal, foot: p - normal * distance })
        };
        let near: Vec<Option<Near>> = self.positions.par_iter().map(near).collect();
        let (nx, pressed, across) = (self.nx, self.pressed, self.across);
        let ny = near.len() / nx;
        let hangs_below_a_plane = |k: usize, point: &Near| {
            let (i, j) = (k % nx, k / nx);
            let columns = i.saturating_sub(across[0])..(i + across[0] + 1).min(nx);
            (j.saturating_sub(across[1])..(j + across[1] + 1).min(ny)).any(|j| {
                columns.clone().map(|i| j * nx + i).filter(|k| pressed[*k]).filter_map(|k| near[k]).any(
                    |other| {
                        other.normal.dot(point.normal) > SAME_NORMAL
                            && (other.foot - point.foot).dot(point.normal).abs() < OFF_PLANE_MM
                    },
                )
            })
        };
        self.positions.par_iter_mut().enumerate().for_each(|(k, p)| {
            let Some(point) = near[k] else { return };
            if point.distance < 0.0 || hangs_below_a_plane(k, &point) {
                *p = pose.to_pad(point.foot).as_vec3();
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{self, IndenterSpec};
    use std::sync::Arc;

    fn solid(shape: Shape) -> Arc<dyn Indenter> {
        let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
        indenter::from_spec("body", &spec, None).unwrap()
    }

    /// Lays a face on a body pressed 0.5 mm, all of it `off` mm below the body, and pressed within 2.5 mm of the middle. By
    /// distance from the middle up to 2.8 mm: how far from the body it is then.
    fn left(body: &dyn Indenter, off: f64) -> Vec<(f64, f64)> {
        let pose = Pose::new(0.0, 0.0, -0.5, 0.0);
        let n = 61;
        let at = |k: usize| [(k % n) as f64 * 0.1 - 3.0, (k / n) as f64 * 0.1 - 3.0];
        let height = |x: f64, y: f64| body.lower_surface(x, y).unwrap_or(2.0) - 0.5;
        let mut positions: Vec<Vec3> =
            (0..n * n).map(at).map(|[x, y]| DVec3::new(x, y, height(x, y) - off).as_vec3()).collect();
        let pressed: Vec<bool> = (0..n * n).map(at).map(|[x, y]| x.hypot(y) < 2.5).collect();
        let face =
            Face { nx: n, positions: &mut positions, pressed: &pressed, across: [4, 4], cell_mm: 0.46 };
        face.lie_on(body, &pose);
        positions
            .iter()
            .enumerate()
            .filter(|(k, _)| at(*k)[0].hypot(at(*k)[1]) < 2.8)
            .map(|(k, p)| (at(k)[0].hypot(at(k)[1]), body.distance(pose.to_indenter(p.as_dvec3()))))
            .collect()
    }

    #[test]
    fn what_sags_beside_the_edge_of_a_plane_is_brought_up_and_what_is_inside_out() {
        let punch = solid(Shape::Flat { plan: Plan::Disc { diameter_mm: 6.0 } });
        for off in [0.03, -0.03] {
            let left = left(&*punch, off);
            assert!(left.len() > 2000 && left.iter().all(|(_, d)| d.abs() < 1e-6), "{off}");
        }
        // What is a tenth of a millimetre away is not touched.
        assert!(left(&*punch, 0.1).iter().all(|(_, d)| (d - 0.1).abs() < 1e-6));
    }

    #[test]
    fn a_face_that_leaves_a_sphere_leaves_it() {
        let sphere = solid(Shape::Dome { radius_mm: 4.0, diameter_mm: 8.0 });
        for (r, d) in left(&*sphere, 0.03) {
            assert!(if r < 2.5 { d.abs() < 1e-4 } else { d > 0.02 }, "{d} at {r}");
        }
        assert!(left(&*sphere, -0.03).iter().all(|(_, d)| d.abs() < 1e-4));
    }
}
