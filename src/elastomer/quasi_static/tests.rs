//! Physics of the quasi-static solver against other people's numbers.

use super::*;
use crate::elastomer::{Law, Material};
use glam::DVec3;

/// A sphere whose lowest point is the tip.
#[derive(Debug)]
pub(super) struct Sphere(pub f64);

impl Indenter for Sphere {
    fn name(&self) -> &str {
        "sphere"
    }
    fn distance(&self, p: DVec3) -> f64 {
        (p - DVec3::new(0.0, 0.0, self.0)).length() - self.0
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let d = p - DVec3::new(0.0, 0.0, self.0);
        (d.length() - self.0, d.normalize_or(DVec3::NEG_Z))
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [self.0, self.0]
    }
    fn lower_surface(&self, x: f64, y: f64) -> Option<f64> {
        let s = self.0 * self.0 - x * x - y * y;
        (s >= 0.0).then(|| self.0 - s.sqrt())
    }
}

pub(super) fn pad(law: Law) -> Pad {
    Pad {
        shape: PadShape::Cuboid,
        size_x_mm: 20.0,
        size_y_mm: 20.0,
        thickness_mm: 4.0,
        material: Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 },
    }
}

pub(super) fn settings(friction: Friction) -> Settings {
    Settings { mode: crate::elastomer::Mode::QuasiStatic, friction, ..Settings::default() }
}

/// A cylinder of radius a with its lower edge rounded by r.
#[derive(Debug)]
pub(super) struct Punch(pub f64, pub f64);

impl Punch {
    fn eval(&self, p: DVec3) -> (f64, DVec3) {
        // 2D: q = (rho, z); rounded box |rho| <= a, 0 <= z <= 20.
        let rho = p.x.hypot(p.y);
        let dir = if rho > 0.0 { DVec3::new(p.x / rho, p.y / rho, 0.0) } else { DVec3::X };
        let (a, r) = (self.0 - self.1, self.1);
        let (zc, hz) = (10.0, 10.0 - self.1);
        let (dx, dz) = (rho - a, (p.z - zc).abs() - hz);
        let sz = if p.z >= zc { 1.0 } else { -1.0 };
        if dx > 0.0 && dz > 0.0 {
            let l = dx.hypot(dz);
            (l - r, dir * (dx / l) + DVec3::Z * (sz * dz / l))
        } else if dx > dz {
            (dx - r, dir)
        } else {
            (dz - r, DVec3::Z * sz)
        }
    }
}

impl Indenter for Punch {
    fn name(&self) -> &str {
        "punch"
    }
    fn distance(&self, p: DVec3) -> f64 {
        self.eval(p).0
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        self.eval(p)
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [self.0, self.0]
    }
    fn lower_surface(&self, _: f64, _: f64) -> Option<f64> {
        None
    }
}

/// Converged finite elements: frictionless sphere R 4, d 0.25 mm, fixed-corotated, E 0.145, nu 0.45.
/// Columns: r, height, rest radius, u_r, u_theta, u_z (mm, um).
const SPHERE_BY_FINITE_ELEMENTS: &str = include_str!("sphere_by_finite_elements.csv");

fn solver(friction: Friction, indenter: Arc<dyn Indenter>, law: Law) -> QuasiStaticSolver {
    QuasiStaticSolver::new(&pad(law), &settings(friction), indenter, &Pose::new(0.0, 0.0, 1.0, 0.0))
        .expect("settings are in range")
}

/// Displacement of the face at rest position (x, y), mm.
fn displacement(s: &QuasiStaticSolver, x: f64, y: f64) -> DVec3 {
    let grid = s.machine.operator.grid();
    let (i, wx) = Grid::trace(x, grid.size[0], grid.nx);
    let (j, wy) = Grid::trace(y, grid.size[1], grid.ny);
    let mut out = [0.0; 3];
    for (c, o) in out.iter_mut().enumerate() {
        let plane = &s.u[grid.at(c, grid.layers() - 1)..];
        for b in 0..3 {
            for a in 0..3 {
                *o += wx[a] * wy[b] * f64::from(plane[(j + b) * grid.cx() + i + a]);
            }
        }
    }
    DVec3::from_array(out)
}

#[test]
fn a_frictionless_sphere_agrees_with_finite_elements() {
    let mut s = solver(Friction::Coefficient(0.0), Arc::new(Sphere(4.0)), Law::FixedCorotated);
    s.advance(&Pose::new(0.0, 0.0, -0.25, 0.0)).expect("an easy press");
    let forces = s.capture(201, 201).expect("a lattice").forces;
    assert!((forces.normal_force_n - 0.0794).abs() < 0.01 * 0.0794, "{forces:?}");
    let (mut sum, mut n, mut bulge) = (0.0, 0, 0.0f64);
    for line in SPHERE_BY_FINITE_ELEMENTS.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|v| v.parse().expect("a number")).collect();
        for direction in 0..8 {
            let (sin, cos) = (0.1 + 0.785 * f64::from(direction)).sin_cos();
            let u_z = 1e3 * displacement(&s, row[2] * cos, row[2] * sin).z;
            bulge = bulge.max(u_z);
            // Twice the contact radius of 1.094 mm.
            if row[2] < 2.19 {
                sum += (u_z - row[5]).powi(2);
                n += 1;
            }
        }
    }
    let rmse_um = (sum / f64::from(n)).sqrt();
    assert!(rmse_um < 2.5, "1 % of the depth is 2.5 um: {rmse_um}");
    assert!((bulge - 2.41).abs() < 0.24, "{bulge}");
}

#[test]
fn the_base_carries_what_the_indenter_presses_and_unloading_returns_to_rest() {
    let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::NeoHookean);
    s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("an easy press");
    let c = s.capture(21, 21).expect("a lattice");
    let balance = (c.stats.base_reaction_n - c.forces.normal_force_n).abs() / c.forces.normal_force_n;
    assert!(balance < 1e-3, "{balance}");
    assert!(c.contact[10 * 21 + 10] && !c.contact[0]);
    s.advance(&Pose::new(0.0, 0.0, 0.1, 0.0)).expect("lifting off");
    let c = s.capture(21, 21).expect("a lattice");
    assert!(c.surface.positions.iter().all(|p| p.z.abs() < 1e-3));
}
