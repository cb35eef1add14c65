//! Symmetry that a way has to keep: what it has not kept is an error that can be seen without knowing the answer.
//!
//! A mirrored body that comes straight down over the middle of the pad leaves a mirrored face, as long as the pad is
//! stable, and so does one that then slides along the mirror. Near the depth at which it is not, and where what sticks is dragged
//! far, rounding and what the stopping leaves decide to which side it gives.

use super::grid::Grid;
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;

/// Points at which a body is compared with its mirror images, every second as low as its tip: what stands a little below a flat underside
/// is seen from there alone.
const PROBES: u32 = 400;
/// Difference of distances that is none, mm.
const SAME_MM: f64 = 1e-6;

/// Whether an indenter there is in the mirrors that the middle of a pad is, across x and across y.
pub fn mirrors_of(pose: &Pose) -> [bool; 2] {
    [pose.x_mm, pose.y_mm].map(|off_mm| [off_mm, pose.theta_deg] == [0.0; 2])
}

/// How far the displacements of control points of the face are from those of their mirror images.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lost {
    /// The largest difference along any axis, mm.
    pub most_mm: f64,
    /// Integral over the face of the squared differences, mm^4; across the mirror of which it is more.
    squares_mm4: f64,
}

impl Lost {
    /// Root mean square of the differences as vectors, over this much of the face, mm.
    pub fn rms_mm(&self, over_mm2: f64) -> f64 {
        (self.squares_mm4 / over_mm2).sqrt()
    }
}

/// What a way has lost of its symmetry; nothing where nothing is mirrored. The way from rest on must have led through poses in the
/// `mirrors`.
pub fn lost(grid: &Grid, u: &[f32], indenter: &dyn Indenter, mirrors: [bool; 2]) -> Lost {
    if mirrors == [false; 2] {
        return Lost::default();
    }
    let (cx, plane) = (grid.cx(), grid.plane());
    let cy = plane / cx;
    let of_body = mirrors_of_body(indenter);
    let mirrored = [0, 1].map(|across| mirrors[across] && of_body[across]);
    let (mut most, mut squares) = (0.0f32, [0.0; 2]);
    for axis in 0..3 {
        let moved = &u[grid.at(axis, grid.layers() - 1)..][..plane];
        for (n, along) in moved.iter().enumerate() {
            let (i, j) = (n % cx, n / cx);
            for (across, image) in [j * cx + cx - 1 - i, (cy - 1 - j) * cx + i].into_iter().enumerate() {
                // What moves across the mirror moves the other way in it.
                let sign = if across == axis { -1.0 } else { 1.0 };
                if mirrored[across] {
                    let off = (along - sign * moved[image]).abs();
                    most = most.max(off);
                    squares[across] += f64::from(off).powi(2);
                }
            }
        }
    }
    Lost { most_mm: f64::from(most), squares_mm4: squares[0].max(squares[1]) * grid.hx * grid.hy }
}

/// Whether a body is its own image when x changes sign, and when y does.
fn mirrors_of_body(body: &dyn Indenter) -> [bool; 2] {
    let [hx, hy] = body.half_extent_mm();
    // Low-discrepancy sequences over a little more than the body.
    let at = |k: u32, half: f64, step: f64| half * ((f64::from(k) * step).fract() * 2.2 - 1.1);
    [DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0)].map(|mirror| {
        (0..PROBES).all(|k| {
            let z_mm = 0.3 * f64::from(k % 2 * (k % 7));
            let p = DVec3::new(at(k, hx, 0.618), at(k, hy, 0.414), z_mm);
            (body.distance(mirror * p) - body.distance(p)).abs() < SAME_MM
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::QuasiStaticSolver;
    use super::super::tests::{Sphere, pad};
    use super::*;
    use crate::elastomer::{Elastomer, Error, Friction, Law, Settings};
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};

    #[test]
    fn what_differs_between_the_sides_of_a_mirrored_press_is_told() {
        let grid = Grid::new([4.0, 4.0, 1.0], 0.5, 1.0, 1.4);
        let mut u = vec![0.0; grid.field_len()];
        let centred = mirrors_of(&Pose::new(0.0, 0.0, -0.2, 0.0));
        assert_eq!(lost(&grid, &u, &Sphere(1.0), centred).most_mm, 0.0);
        u[grid.at(2, grid.layers() - 1) + 3 * grid.cx() + 2] = 0.01;
        assert_eq!(lost(&grid, &u, &Sphere(1.0), centred).most_mm, f64::from(0.01f32));
        let mut u = vec![0.0; grid.field_len()];
        // To either side of the middle, as the two sides of a body push.
        let at = grid.at(0, grid.layers() - 1) + 3 * grid.cx();
        (u[at + 2], u[at + grid.cx() - 3]) = (-0.01, 0.01);
        let image = grid.at(0, grid.layers() - 1) + (grid.plane() / grid.cx() - 4) * grid.cx();
        (u[image + 2], u[image + grid.cx() - 3]) = (-0.01, 0.01);
        assert_eq!(lost(&grid, &u, &Sphere(1.0), centred).most_mm, 0.0);
        u[at + 2] = 0.01;
        assert_eq!(lost(&grid, &u, &Sphere(1.0), centred).most_mm, f64::from(0.02f32));
        // Across either mirror two points differ by that: as a mean over eight cells by half of it.
        let rms_mm = lost(&grid, &u, &Sphere(1.0), centred).rms_mm(8.0 * grid.hx * grid.hy);
        assert!((rms_mm - 0.01).abs() < 1e-6, "{rms_mm}");
        // Beside the middle nothing is known, but along a mirror what is across it.
        let mirrors = |x_mm, y_mm, theta_deg| mirrors_of(&Pose::new(x_mm, y_mm, -0.2, theta_deg));
        assert_eq!(lost(&grid, &u, &Sphere(1.0), mirrors(1.0, 1.0, 0.0)).most_mm, 0.0);
        assert_eq!(lost(&grid, &u, &Sphere(1.0), mirrors(0.0, 0.0, 1.0)).most_mm, 0.0);
        assert_eq!(lost(&grid, &u, &Sphere(1.0), mirrors(1.0, 0.0, 0.0)).most_mm, f64::from(0.02f32));
        assert_eq!(lost(&grid, &u, &Sphere(1.0), mirrors(0.0, 1.0, 0.0)).most_mm, f64::from(0.02f32));
    }

    #[test]
    fn what_left_the_mirror_and_came_back_is_not_taken_for_what_has_lost_its_symmetry() {
        let settings =
            Settings { tolerance: 0.02, friction: Friction::Coefficient(0.5), ..Settings::default() };
        let at = |x_mm: f64, y_mm: f64, z_mm: f64| Pose::new(x_mm, y_mm, z_mm, 0.0);
        let (pad, sphere) = (pad(Law::NeoHookean), std::sync::Arc::new(Sphere(4.0)));
        for (way, keeps) in [
            ([at(0.2, 0.0, -0.5), at(0.4, 0.0, -0.5)], true),
            ([at(0.2, 0.2, -0.5), at(0.4, 0.0, -0.5)], false),
        ] {
            let mut solver = QuasiStaticSolver::new(&pad, &settings, sphere.clone(), &at(0.0, 0.0, 0.1))
                .expect("a solver");
            solver.advance(&at(0.0, 0.0, -0.5)).expect("a press");
            way.iter().for_each(|pose| solver.advance(pose).expect("a slide"));
            let level = solver.finest();
            let lost = lost(level.grid(), level.displacement(), sphere.as_ref(), [false, true]).most_mm / 0.5;
            let stated = level.estimated_error(sphere.as_ref()).expect("a contact");
            assert!(if keeps { lost < 0.01 } else { lost > 0.1 }, "{lost} lost");
            assert!(stated < 0.03, "{stated} stated with {lost} lost");
        }
    }

    #[test]
    fn a_pad_that_is_all_but_unstable_does_not_give_way_for_want_of_an_answer() {
        let plan = Plan::Rectangle { x_mm: 8.0, y_mm: 8.0 };
        let shape = Shape::Socket { plan, cavity_radius_mm: 2.0 };
        let socket = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
        let socket = from_spec("socket", &socket, None).expect("a body");
        let friction = Friction::Coefficient(0.5);
        let settings =
            Settings { tolerance: 0.1, friction, poisson_ratio: Some(0.49), ..Settings::default() };
        let at = |z_mm: f64| Pose::new(0.0, 0.0, z_mm, 0.0);
        let pad = pad(Law::NeoHookean);
        let mut solver = QuasiStaticSolver::new(&pad, &settings, socket.clone(), &at(0.1)).expect("a solver");
        for depth in [1.0, 1.4] {
            // (None is an answer, too.)
            match solver.advance(&at(-depth)) {
                Err(Error::NotConverged { .. }) => return,
                ended => ended.expect("an equilibrium"),
            }
            let level = solver.finest();
            let lost = lost(level.grid(), level.displacement(), socket.as_ref(), [true; 2]).most_mm / depth;
            // (With the residual that is usual 0.09 of 1.4 mm.)
            assert!(lost < 0.02, "{lost} at {depth} mm");
        }
    }
}
