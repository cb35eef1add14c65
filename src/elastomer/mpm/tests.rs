//! Physics of the explicit modes against analytic truth, and the fast kernels against a plain oracle.

mod contact;
mod invariance;
mod reference;
mod shapes;

use super::particles::Moving;
use super::*;
use crate::elastomer::settings::Base;
use crate::elastomer::{Friction, Law, Material};

/// A pad of the predecessor's material.
fn pad(size: [f64; 3]) -> Pad {
    let material = Material {
        law: Law::FixedCorotated,
        youngs_modulus_mpa: 0.145,
        poisson_ratio: 0.45,
        density_g_mm3: 1.0,
    };
    Pad::slab(size, material)
}

fn settings(mode: Mode, particles: [usize; 3]) -> Settings {
    Settings { mode, particles, ..Settings::default() }
}

/// A cube of 4 x 4 x 4 mm with a coarse lattice, free in space, with a velocity field in mm/s and 1/s.
fn free_block(scheme: &Scheme, velocity: DVec3, gradient: glam::DMat3) -> Body {
    let mut body = Body::empty(scheme.clone(), Base::BondedLayers, Isa::best());
    let speed = scheme.unit_speed_mm_s();
    let [nx, ny, nz] = scheme.particles;
    let mut all = Vec::new();
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                let x = scheme.rest_position_mm(i, j, k);
                let id = ((k * ny + j) * nx + i) as u32;
                let v = (velocity + gradient * (DVec3::from_array(x) + DVec3::Z * 2.0)) / speed;
                let c = gradient * scheme.dt_s;
                all.push(Moving {
                    velocity: v.as_vec3().to_array(),
                    affine: std::array::from_fn(|k| c.col(k % 3)[k / 3] as f32),
                    ..body.at_rest(x, id, false)
                });
            }
        }
    }
    body.fill(&all);
    body
}

fn cube_scheme(law: Law) -> Scheme {
    let settings = Settings { law: Some(law), ..settings(Mode::Mpm, [11, 11, 11]) };
    Scheme::new(&pad([4.0, 4.0, 4.0]), &settings).expect("a sound scheme")
}

fn run(body: &mut Body, steps: usize) -> Result<(), Fault> {
    for _ in 0..steps {
        body.update_grid();
        body.pass(true)?;
    }
    Ok(())
}

#[test]
fn settings_that_cannot_work_are_refused_by_name() {
    let refused = |change: fn(&mut Settings), key: &str| {
        let mut s = settings(Mode::Impm, [21, 21, 5]);
        change(&mut s);
        match Scheme::new(&pad([20.0, 20.0, 4.0]), &s) {
            Err(Error::Setting { key: k, .. }) => assert_eq!(k, format!("elastomer.{key}")),
            other => panic!("{key} was accepted: {other:?}"),
        }
    };
    refused(|s| s.mode = Mode::QuasiStatic, "mode");
    refused(|s| s.friction = Friction::Coefficient(0.5), "friction");
    refused(|s| s.poisson_ratio = Some(0.5), "poisson_ratio");
    refused(|s| s.youngs_modulus_mpa = Some(-1.0), "youngs_modulus_mpa");
    refused(|s| s.particles = [21, 21, 2], "particles");
    refused(|s| s.particles = [201, 21, 5], "particles");
    refused(|s| s.dx_mm = Some(0.3), "dx_mm");
    refused(|s| s.dt_s = Some(0.01), "dt_s");
    refused(|s| s.dt_s = Some(f64::NAN), "dt_s");
    refused(|s| s.speed_mm_s = 5000.0, "speed_mm_s");
    refused(|s| s.rest_limit = 0, "rest_limit");
    refused(|s| s.rest_threshold = 0.0, "rest_threshold");
}

#[test]
fn the_literal_numbers_of_the_predecessor_are_accepted() {
    // 93 % of the stability limit, which is 1.07e-4 s.
    let s = Settings { dx_mm: Some(33.0 / 256.0), dt_s: Some(1e-4), ..settings(Mode::Impm, [201, 201, 41]) };
    let literal = Scheme::new(&pad([20.0, 20.0, 4.0]), &s).expect("the paper's own numbers");
    assert!((literal.stability_limit_s() - 1.0705e-4).abs() < 1e-8);
    let defaults =
        Scheme::new(&pad([20.0, 20.0, 4.0]), &settings(Mode::Impm, [201, 201, 41])).expect("defaults");
    assert_eq!((defaults.dx_mm, defaults.dt_s), (literal.dx_mm, literal.dt_s));
    // A coarser lattice keeps the Courant number.
    let coarse =
        Scheme::new(&pad([20.0, 20.0, 4.0]), &settings(Mode::Impm, [101, 101, 21])).expect("defaults");
    assert!(
        (coarse.dt_s / coarse.stability_limit_s() - literal.dt_s / literal.stability_limit_s()).abs() < 1e-9
    );
}

/// ANALYTIC.md section 6: c' = -4 tau(f) / (rho dx^2), f' = c f.
#[test]
fn a_lone_particle_is_the_exact_oscillator() {
    let mut scheme = cube_scheme(Law::FixedCorotated);
    scheme.dt_s = scheme.stability_limit_s() / 100.0;
    let (mu, lambda) = (scheme.moduli_pa.mu, scheme.moduli_pa.lambda);
    let k = 4.0 / (scheme.density * scheme.dx_mm.powi(2));
    let omega = 2.0 * ((3.0 * lambda + 2.0 * mu) / scheme.density).sqrt() / scheme.dx_mm;
    let tau = |f: f64| 2.0 * mu * f * (f - 1.0) + lambda * f.powi(3) * (f.powi(3) - 1.0);
    let c0 = 0.05 * omega;
    let mut body = Body::empty(scheme.clone(), Base::BondedLayers, Isa::best());
    let mut lone = body.at_rest([0.03, 0.21, -1.1], 0, false);
    for d in 0..3 {
        lone.affine[4 * d] = (c0 * scheme.dt_s) as f32;
    }
    body.fill(&[lone]);
    let (mut f, mut c) = (1.0, c0);
    let (substeps, h) = (20, scheme.dt_s / 20.0);
    let mut worst: f64 = 0.0;
    for _ in 0..700 {
        run(&mut body, 1).expect("a stable step");
        for _ in 0..substeps {
            let half = c - 0.5 * h * k * tau(f);
            f *= (h * half).exp();
            c = half - 0.5 * h * k * tau(f);
        }
        let p = body.particles().next().expect("one particle");
        worst = worst.max((f64::from(p.strain[0]) + 1.0 - f).abs());
        assert!(p.strain[1].abs() < 1e-5);
    }
    // Symplectic Euler is of first order: the error is about omega dt / 2 = 1 % of the amplitude, 0.05.
    assert!(worst < 0.0025, "{worst}");
}

#[test]
fn the_stability_limit_is_where_it_is_said_to_be() {
    for (part, stable) in [(0.98, true), (1.03, false)] {
        let mut scheme = cube_scheme(Law::NeoHookean);
        scheme.dt_s = part * scheme.stability_limit_s();
        let mut body = Body::empty(scheme, Base::BondedLayers, Isa::best());
        let mut lone = body.at_rest([0.0, 0.0, -2.0], 0, false);
        for d in 0..3 {
            lone.affine[4 * d] = 1e-5;
        }
        body.fill(&[lone]);
        let fine =
            run(&mut body, 1000).is_ok() && body.particles().all(|p| p.strain.iter().all(|h| h.abs() < 1e-3));
        assert_eq!(fine, stable, "at {part} of the limit");
    }
}

/// A bonded pad that moves up as a whole is turned back by the wave from its base: the top feels it after H / c_p.
#[test]
fn the_compression_wave_runs_at_its_speed() {
    // Wide enough that nothing comes back from the sides meanwhile.
    let s = settings(Mode::Mpm, [71, 71, 33]);
    let scheme = Scheme::new(&pad([7.0, 7.0, 3.2]), &s).expect("a sound scheme");
    let mut body = Body::empty(scheme.clone(), Base::BondedLayers, Isa::best());
    let [nx, ny, nz] = scheme.particles;
    let mut all = Vec::new();
    for id in 0..nx * ny * nz {
        let (i, j, k) = (id % nx, id / nx % ny, id / nx / ny);
        let mut m = body.at_rest(scheme.rest_position_mm(i, j, k), id as u32, k < 3);
        m.velocity[2] = if k < 3 { 0.0 } else { 1e-4 };
        all.push(m);
    }
    body.fill(&all);
    let centre = (ny / 2) * nx + nx / 2;
    let (mut peak, mut at) = (0.0, 0.0);
    for step in 1..=46 {
        run(&mut body, 1).expect("a stable step");
        let u = surface::top_displacement(&body)[centre].z;
        if u > peak {
            (peak, at) = (u, f64::from(step) * scheme.dt_s);
        }
    }
    let c_p = ((scheme.moduli_pa.lambda + 2.0 * scheme.moduli_pa.mu) / scheme.density).sqrt();
    assert!((c_p - 741.6).abs() < 0.5);
    // From the uppermost pinned layer to half a spacing above the top one.
    let height = scheme.size_mm[2] - 1.5 * scheme.spacing_mm[2];
    // A front of one cell lags behind the long waves by a cell or two.
    let lag_cells = (at * c_p - height) / scheme.dx_mm;
    assert!(lag_cells > -1.0 && lag_cells < 2.5, "{} of {}", at, height / c_p);
}

#[test]
fn single_precision_loses_little_against_the_plain_oracle() {
    use self::reference::{Point, step};
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        let s = Settings { law: Some(law), ..settings(Mode::Mpm, [25, 25, 9]) };
        let ball = Arc::new(shapes::Ball { radius_mm: 2.0 });
        let mut pose = Pose::new(0.11, -0.07, 0.0, 0.0);
        let mut solver = ExplicitSolver::new(&pad([4.8, 4.8, 1.6]), &s, ball, &pose).expect("a sound scheme");
        let scheme = solver.body.scheme.clone();
        let mut points: Vec<(u32, Point)> = solver
            .body
            .particles()
            .map(|p| {
                let x = DVec3::from_array(solver.body.grid.position_mm(p.cell, p.offset));
                let at_rest =
                    Point { x, v: DVec3::ZERO, c: glam::DMat3::ZERO, f: glam::DMat3::IDENTITY, held: p.held };
                (p.id, at_rest)
            })
            .collect();
        points.sort_by_key(|(id, _)| *id);
        let mut points: Vec<Point> = points.into_iter().map(|(_, p)| p).collect();
        let origin = DVec3::from_array(solver.body.grid.lower_mm);
        let local = solver.cloud.points();
        for n in 1..=25 {
            let next =
                Pose::new(0.11 + 0.004 * f64::from(n), -0.07, -0.02 * f64::from(n), 0.3 * f64::from(n));
            let cloud: Vec<(DVec3, DVec3)> = local
                .iter()
                .map(|p| (pose.to_pad(*p), (next.to_pad(*p) - pose.to_pad(*p)) / scheme.dt_s))
                .collect();
            step(&scheme, origin, &mut points, &cloud);
            solver.step_to(&next).expect("a gentle press");
            pose = next;
        }
        let mut worst: f64 = 0.0;
        for p in solver.body.particles() {
            let x = DVec3::from_array(solver.body.grid.position_mm(p.cell, p.offset));
            worst = worst.max((x - points[p.id as usize].x).length());
        }
        let deepest = surface::top_displacement(&solver.body).iter().map(|u| -u.z).fold(0.0, f64::max);
        assert!(deepest > 0.4, "{deepest}");
        // A ten-thousandth of a micrometre per step on a press of half a millimetre.
        assert!(worst < 3e-6, "{law:?}: {worst}");
    }
}
