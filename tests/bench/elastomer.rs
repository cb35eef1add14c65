//! The kernels of the elastomer: a pass of the explicit modes, a press of the quasi-static one.
//!
//! `cargo bench`; for figures with a stated machine, errors and memory use `twinrig bench elastomer`.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use twinrig::elastomer::mpm::lanes::Isa;
use twinrig::elastomer::{self, Elastomer, ExplicitSolver, Friction, Law, Mode, Settings};
use twinrig::pose::Pose;
use twinrig::trial::scene;

/// One step in contact, pass by pass of every instruction set this machine has.
fn explicit(c: &mut Criterion) {
    let mut group = c.benchmark_group("explicit step");
    for (mode, law, isa) in Isa::available()
        .into_iter()
        .map(|isa| (Mode::Mpm, Law::FixedCorotated, isa))
        .chain([(Mode::Impm, Law::FixedCorotated, Isa::best()), (Mode::Mpm, Law::NeoHookean, Isa::best())])
    {
        let settings = Settings { mode, particles: [101, 101, 21], ..Settings::default() };
        let start = Pose::new(0.0, 0.0, 0.0, 0.0);
        let sphere = scene::sphere(4.0);
        let mut solver = ExplicitSolver::with_isa(&scene::pad(law), &settings, sphere, &start, isa)
            .expect("the predecessor's pad is sound");
        solver.advance(&Pose::new(0.0, 0.0, -0.3, 0.0)).expect("a small press");
        // As far as one step goes, up and down by turns.
        let stride = settings.speed_mm_s * solver.body().scheme.dt_s * 0.999;
        let mut z = -0.3;
        group.throughput(Throughput::Elements(solver.body().len() as u64));
        group.bench_function(format!("{mode:?} {law:?} {}", isa.name()), |b| {
            b.iter(|| {
                z = if z < -0.3 - 0.5 * stride { -0.3 } else { -0.3 - stride };
                solver.advance(&Pose::new(0.0, 0.0, z, 0.0)).expect("a step");
            });
        });
    }
    group.finish();
}

/// From rest to an equilibrium, and one waypoint further.
fn quasi_static(c: &mut Criterion) {
    let mut group = c.benchmark_group("quasi-static");
    for tolerance in [0.05, 0.02] {
        let settings = scene::quasi_static(Friction::Infinite, tolerance);
        let start = Pose::new(0.0, 0.0, 0.1, 0.0);
        let solver = elastomer::solver(&scene::pad(Law::NeoHookean), &settings, scene::sphere(4.0), &start)
            .expect("the predecessor's pad is sound");
        group.bench_function(format!("press 0.5 mm, tolerance {tolerance}"), |b| {
            b.iter_batched(
                || solver.fork(),
                |mut s| s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("a press"),
                BatchSize::LargeInput,
            );
        });
        let mut pressed = solver.fork();
        pressed.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("a press");
        group.bench_function(format!("0.1 mm further, tolerance {tolerance}"), |b| {
            b.iter_batched(
                || pressed.fork(),
                |mut s| s.advance(&Pose::new(0.0, 0.0, -0.6, 0.0)).expect("a press"),
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(4));
    targets = explicit, quasi_static
}
criterion_main!(benches);
