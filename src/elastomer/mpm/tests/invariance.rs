//! What must not change: rigid motion, momentum, the number of threads, the instruction set.

use super::*;
use glam::DMat3;

#[test]
fn a_rigid_translation_stays_without_stress() {
    let scheme = cube_scheme(Law::FixedCorotated);
    let mut body = free_block(&scheme, DVec3::new(130.0, -70.0, 40.0), DMat3::ZERO);
    let before = body.momentum().0;
    let n = body.len();
    run(&mut body, 60).expect("nothing happens");
    let worst = body.particles().flat_map(|p| p.strain).map(f32::abs).fold(0.0, f32::max);
    assert!(worst < 1e-6, "strain {worst}");
    let after = body.momentum().0;
    for d in 0..3 {
        assert!((after[d] / before[d] - 1.0).abs() < 1e-6);
    }
    assert_eq!(body.len(), n);
    // Every particle is where its velocity carried it, through many cells and blocks.
    let way = DVec3::new(130.0, -70.0, 40.0) * scheme.dt_s * 60.0;
    let [nx, ny, _] = scheme.particles;
    for p in body.particles() {
        let id = p.id as usize;
        let rest = DVec3::from_array(scheme.rest_position_mm(id % nx, id / nx % ny, id / nx / ny));
        let now = DVec3::from_array(body.grid.position_mm(p.cell, p.offset));
        assert!((now - rest - way).length() < 2e-6, "particle {id}");
    }
}

#[test]
fn a_spinning_block_keeps_its_angular_momentum() {
    let scheme = cube_scheme(Law::NeoHookean);
    let omega = 8.0;
    let spin = DMat3::from_cols(DVec3::Y * omega, DVec3::NEG_X * omega, DVec3::ZERO);
    let mut body = free_block(&scheme, DVec3::ZERO, spin);
    let (_, before) = body.momentum();
    run(&mut body, 300).expect("a slow spin");
    let (p, after) = body.momentum();
    assert!((after[2] / before[2] - 1.0).abs() < 1e-5, "{} {}", before[2], after[2]);
    assert!(p.iter().all(|p| p.abs() < 1e-5 * before[2].abs()));
}

#[test]
fn free_vibration_gains_no_energy() {
    let mut scheme = cube_scheme(Law::FixedCorotated);
    scheme.dt_s = 0.5 * scheme.stability_limit_s();
    let stretch = DMat3::from_diagonal(DVec3::new(-10.0, -10.0, 20.0));
    let mut body = free_block(&scheme, DVec3::ZERO, stretch);
    let energy = |body: &Body| {
        let moduli = scheme.moduli_pa;
        let elastic: f64 = body
            .particles()
            .map(|p| stress::energy_density(scheme.law, &p.strain.map(f64::from), moduli))
            .sum();
        // Per particle volume, so that Pa and rho v^2 compare.
        elastic + 0.5 * body.speed_squared * scheme.density * scheme.unit_speed_mm_s().powi(2)
    };
    run(&mut body, 1).expect("a small stretch");
    let begun = energy(&body);
    for _ in 0..40 {
        run(&mut body, 25).expect("a free vibration");
        // Symplectic Euler lets the energy oscillate by a part of omega dt.
        assert!(energy(&body) < 1.05 * begun);
    }
    assert!(energy(&body) < begun);
}

/// A press and a slide, on a pool of `threads`, as bits.
fn bits(threads: usize, isa: Isa) -> (Vec<u32>, u64) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool");
    pool.install(|| {
        let s = settings(Mode::Impm, [33, 33, 9]);
        let ball = Arc::new(shapes::Ball { radius_mm: 2.0 });
        let start = Pose::new(0.0, 0.0, 0.5, 0.0);
        let mut solver =
            ExplicitSolver::with_isa(&pad([8.0, 8.0, 2.0]), &s, ball, &start, isa).expect("sound settings");
        solver.advance(&Pose::new(0.0, 0.0, -0.4, 0.0)).expect("a press");
        solver.advance(&Pose::new(0.4, 0.1, -0.4, 5.0)).expect("a slide and a turn");
        let c = solver.capture(65, 65).expect("a state");
        let bits = c.surface.positions.iter().flat_map(|p| p.to_array()).map(f32::to_bits).collect();
        (bits, c.forces.normal_force_n.to_bits())
    })
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for isa in Isa::available() {
        let one = bits(1, isa);
        assert_eq!(one, bits(2, isa), "{isa:?}");
        assert_eq!(one, bits(3, isa), "{isa:?}");
    }
}

#[test]
fn instruction_sets_agree_to_rounding() {
    let (truth, _) = bits(2, Isa::best());
    for isa in Isa::available() {
        let (other, _) = bits(2, isa);
        let worst = truth
            .iter()
            .zip(&other)
            .map(|(a, b)| (f32::from_bits(*a) - f32::from_bits(*b)).abs())
            .fold(0.0, f32::max);
        assert!(worst < 2e-5, "{isa:?}: {worst} mm");
    }
}

/// A press, a slide and a return, with the relative-rest loop: blocks wake, meet the indenter and come to see it go.
#[test]
fn passing_over_what_is_at_rest_changes_no_bit() {
    let pad = pad([20.0, 20.0, 2.0]);
    let start = Pose::new(-4.0, 0.0, 0.0, 0.0);
    let follow = |without: Vec<Skip>| {
        let settings = Settings { rest_limit: 3, without, ..settings(Mode::Impm, [61, 61, 9]) };
        let mut solver =
            ExplicitSolver::new(&pad, &settings, Arc::new(shapes::Ball { radius_mm: 2.0 }), &start)
                .expect("a sound pad");
        let mut seen = Vec::new();
        for (x, z) in [(-4.0, -0.3), (-3.0, -0.3), (-3.0, 0.6), (-1.0, 1.0)] {
            solver.advance(&Pose::new(x, 0.0, z, 0.0)).expect("a short way");
            let c = solver.capture(61, 61).expect("a whole face");
            let positions: Vec<[u32; 3]> =
                c.surface.positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
            let forces = [c.forces.normal_force_n, c.forces.torque_n_mm, c.stats.elastic_energy_n_mm];
            let part = solver.body.computed as f64 / solver.body.len() as f64;
            seen.push(((positions, forces.map(f64::to_bits)), part));
        }
        seen
    };
    let (passed, all) = (follow(Vec::new()), follow(vec![Skip::Rest]));
    for ((passed, part), (all, whole)) in passed.iter().zip(&all) {
        assert!(passed == all);
        assert!(*whole == 1.0 && *part <= 1.0);
    }
    // The far end of the pad has heard nothing of the press.
    assert!(passed[0].1 < 0.8, "{}", passed[0].1);
}
