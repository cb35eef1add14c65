//! Physics of the quasi-static solver against other people's numbers.

mod elastic;
mod friction;
mod long_ways;
mod narrow;
mod order;
mod pads;
mod skips;
mod stated;
mod truth;

use super::grid::Grid;
use super::layer::{Passage, RestLayer};
use super::operator::Operator;
use super::stack::Stack;
use super::*;
use crate::elastomer::{ContactForces, Friction, Law, Material, PadShape};
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
    let material = Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 };
    Pad::slab([20.0, 20.0, 4.0], material)
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

fn solver(friction: Friction, indenter: Arc<dyn Indenter>, law: Law) -> QuasiStaticSolver {
    QuasiStaticSolver::new(&pad(law), &settings(friction), indenter, &Pose::new(0.0, 0.0, 1.0, 0.0))
        .expect("settings are in range")
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

#[test]
fn a_long_slide_ends_in_full_sliding_at_coulombs_force() {
    let mut s = solver(Friction::Coefficient(0.2), Arc::new(Sphere(4.0)), Law::NeoHookean);
    s.advance(&Pose::new(-0.5, 0.0, -0.3, 0.0)).expect("an easy press");
    for i in 1..=4 {
        s.advance(&Pose::new(-0.5 + 0.25 * f64::from(i), 0.0, -0.3, 0.0)).expect("a slide");
    }
    let f = s.capture(2, 2).expect("a lattice").forces;
    let ratio = -f.shear_force_n[0] / f.normal_force_n;
    // The face slips along a slope and over stretched material, so the force is a little above mu N.
    assert!((0.2..0.2 * 1.06).contains(&ratio), "{f:?}");
    assert!(f.shear_force_n[1].abs() < 1e-3 * f.normal_force_n);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::FixedCorotated);
            s.advance(&Pose::new(0.1, 0.0, -0.3, 0.0)).expect("an easy press");
            // The first by the splines alone, the second in relief.
            [31, 101].map(|n| s.capture(n, n).expect("a lattice"))
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn a_pose_that_no_indenter_can_have_is_refused() {
    for pose in [
        Pose::new(f64::NAN, 0.0, -0.4, 0.0),
        Pose::new(0.0, 0.0, f64::NEG_INFINITY, 0.0),
        Pose::new(0.0, 0.0, -4.0, 0.0),
        Pose::new(0.0, 1e6, 1.0, 0.0),
    ] {
        let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::NeoHookean);
        assert!(matches!(s.advance(&pose), Err(Error::Pose { .. })), "{pose}");
    }
}

#[test]
fn a_waypoint_that_is_asked_for_again_is_as_it_was_and_takes_nothing() {
    let mut s = solver(Friction::Coefficient(0.5), Arc::new(Punch(2.7, 0.3)), Law::FixedCorotated);
    let pose = Pose::new(0.0, 0.0, -0.5, 0.0);
    s.advance(&pose).expect("an easy press");
    let first = s.capture(51, 51).expect("a lattice");
    s.advance(&pose).expect("where it is");
    let again = s.capture(51, 51).expect("a lattice");
    assert_eq!((again.stats.iterations, again.stats.passes), (0, 0));
    assert_eq!(first.surface.positions, again.surface.positions);
    assert_eq!(first.forces, again.forces);
}

#[test]
fn contact_at_the_edge_is_refused_and_before_touch_nothing_is_computed() {
    let mut s = solver(Friction::Infinite, Arc::new(Sphere(4.0)), Law::FixedCorotated);
    s.advance(&Pose::new(5.0, 5.0, 0.2, 30.0)).expect("the air is free");
    let c = s.capture(5, 5).expect("a lattice");
    assert_eq!((c.stats.iterations, c.forces), (0, ContactForces { normal_force_n: -0.0, ..c.forces }));
    let refused = s.advance(&Pose::new(9.5, 0.0, -0.2, 0.0));
    assert!(matches!(refused, Err(Error::OffPad { .. })), "{refused:?}");
}

#[test]
fn a_fork_goes_on_as_the_original_does_to_the_bit() {
    let mut s = solver(Friction::Coefficient(0.5), Arc::new(Sphere(4.0)), Law::NeoHookean);
    s.advance(&Pose::new(0.0, 0.0, -0.2, 0.0)).expect("an easy press");
    let mut fork = s.fork();
    let slide = [0.1, 0.2].map(|x_mm| Pose::new(x_mm, 0.0, -0.2, 0.0));
    let [original, forked] = [&mut s as &mut dyn Elastomer, fork.as_mut()].map(|s| {
        slide.iter().for_each(|pose| s.advance(pose).expect("an easy slide"));
        s.capture(41, 41).expect("a lattice").surface
    });
    assert_eq!(original, forked);
}

#[test]
fn a_nearly_incompressible_pad_that_is_let_go_comes_back_and_at_once() {
    let mut pad = Pad { size_x_mm: 8.0, size_y_mm: 8.0, thickness_mm: 2.0, ..pad(Law::NeoHookean) };
    pad.material.poisson_ratio = 0.499;
    let settings = Settings { tolerance: 0.1, ..settings(Friction::Coefficient(0.0)) };
    let start = Pose::new(0.0, 0.0, 0.3, 0.0);
    let mut s = QuasiStaticSolver::new(&pad, &settings, Arc::new(Sphere(1.0)), &start).expect("in range");
    let [shallow, deep, lifted] = [-0.06, -0.2, -0.06].map(|z_mm| {
        s.advance(&Pose::new(0.0, 0.0, z_mm, 0.0)).expect("an easy way");
        let c = s.capture(2, 2).expect("a lattice");
        (c.forces.normal_force_n, c.stats.iterations)
    });
    assert!(deep.0 > 5.0 * shallow.0, "{deep:?}");
    assert!((lifted.0 / shallow.0 - 1.0).abs() < 2e-3, "{lifted:?} after {shallow:?}");
    // Halved for every direction without stiffness that is met on the way, it takes 52.
    assert!(lifted.1 < 35, "{lifted:?}");
}
