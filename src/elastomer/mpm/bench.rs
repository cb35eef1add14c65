//! Throughput of the explicit step, in particle-steps per second.
//!
//! The case is the peers': the predecessor's pad under a sphere of radius 4 mm that presses at 200 mm/s. It is first
//! pressed a little, so that contact, boundaries and re-binning are part of what is measured. Particles
//! of the indenter are not counted, though their work is.
//!
//! Beside the rate stands what the machine could do at best ([`super::roofline`]): the flops of the kernels, counted by running
//! them on lanes that count, against the peak; and the memory read and written against the stream.

use super::ExplicitSolver;
use super::lanes::Isa;
use super::roofline::Roofline;
use crate::elastomer::{Elastomer, Error, Law, Material, Mode, Pad, Settings, Skip};
use crate::indenter::Indenter;
use crate::pose::Pose;
use glam::DVec3;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Depth at which the measurement begins, mm.
const START_DEPTH_MM: f64 = 0.3;

/// Flops of a pass per particle, grid and contact included, whole registers counted: of the sixteen lanes of a stencil's row
/// twelve or nine are used. Counted on the lattice of the paper (1667 and 1578), in the way of the test below; small pads have more,
/// because their blocks are not full, and large strains a little more, because the stretch takes more iterations.
fn flops_per_particle_step(law: Law) -> f64 {
    match law {
        Law::FixedCorotated => 1670.0,
        Law::NeoHookean => 1580.0,
    }
}

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Throughput {
    /// Particles of the pad.
    pub particles: u64,
    /// Points of the indenter.
    pub indenter_points: u64,
    /// Explicit mode.
    pub mode: Mode,
    /// Threads of the pool.
    pub threads: usize,
    /// Instruction set.
    pub isa: &'static str,
    /// Part of the particle-steps that was computed; the rest was in blocks at rest, which stay as they are to the bit.
    pub computed: f64,
    /// Constitutive law.
    pub law: Law,
    /// Steps measured.
    pub steps: u64,
    /// Passes in them: one a step, and those of the relative-rest loop.
    pub passes: u64,
    /// Time for them, s.
    pub seconds: f64,
    /// Processor time for them on all threads together, s.
    pub cpu_s: f64,
    /// Particles times passes per second.
    pub particle_steps_per_s: f64,
    /// The same from the median step.
    pub median_particle_steps_per_s: f64,
    /// The same from the fastest step: what an undisturbed machine would give.
    pub best_particle_steps_per_s: f64,
    /// Particles times passes per second of processor time, which other programs disturb less.
    pub particle_steps_per_cpu_s: f64,
    /// Memory per particle, bytes.
    pub bytes_per_particle: f64,
    /// Memory per node of active blocks, bytes.
    pub bytes_per_node: f64,
    /// All memory of particles and grid, bytes.
    pub bytes: u64,
    /// Flops of the kernels per particle-step.
    pub flops_per_particle_step: f64,
    /// Bytes read and written per particle-step: every particle, tile and node once each way.
    pub bytes_per_particle_step: f64,
    /// What the machine can do on as many threads.
    pub roofline: Roofline,
    /// Particle-steps a second at which the peak of fused products would be reached.
    pub bound_particle_steps_per_s: f64,
    /// Part of that bound that the best rate of what was computed reaches.
    pub of_peak: f64,
    /// Part of the memory's stream that it needs.
    pub of_stream: f64,
}

/// A ball; only here, so that the measurement needs no indenter file.
#[derive(Debug)]
struct Ball {
    radius_mm: f64,
}

impl Indenter for Ball {
    fn name(&self) -> &str {
        "ball"
    }

    fn distance(&self, p: DVec3) -> f64 {
        (p - DVec3::Z * self.radius_mm).length() - self.radius_mm
    }

    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let out = p - DVec3::Z * self.radius_mm;
        (out.length() - self.radius_mm, out.normalize_or(DVec3::NEG_Z))
    }

    fn half_extent_mm(&self) -> [f64; 2] {
        [self.radius_mm; 2]
    }

    fn lower_surface(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let left = self.radius_mm.powi(2) - x_mm * x_mm - y_mm * y_mm;
        (left >= 0.0).then(|| self.radius_mm - left.sqrt())
    }
}

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// `mpm` or `impm`.
    pub mode: Mode,
    /// Constitutive law.
    pub law: Law,
    /// Particles along x, y and z.
    pub particles: [usize; 3],
    /// Threads of the pool.
    pub threads: usize,
    /// Steps to measure.
    pub steps: u64,
    /// Instruction set.
    pub isa: Isa,
    /// Whether blocks at rest are computed all the same.
    pub rest_is_computed: bool,
}

impl Load {
    /// The paper's law without its relative-rest loop, every particle computed, on the best instruction set.
    pub fn of(particles: [usize; 3], threads: usize, steps: u64) -> Self {
        let (mode, law, isa) = (Mode::Mpm, Law::FixedCorotated, Isa::best());
        Load { mode, law, particles, threads, steps, isa, rest_is_computed: true }
    }
}

/// Measures how many particle-steps a second a load is done with.
///
/// # Errors
/// [`Error::Setting`] for a lattice that cannot work, or no threads or steps.
pub fn throughput(load: &Load) -> Result<Throughput, Error> {
    let &Load { threads, steps, .. } = load;
    if threads == 0 || steps == 0 {
        return Err(Error::Setting {
            key: "threads",
            value: threads.to_string(),
            allowed: "at least 1, and at least 1 step".to_owned(),
            next: format!("ask for more than {threads} threads and {steps} steps"),
        });
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| Error::Setting {
        key: "threads",
        value: threads.to_string(),
        allowed: format!("as many as the system makes ({e})"),
        next: "ask for fewer".to_owned(),
    })?;
    pool.install(|| measure(load))
}

fn measure(load: &Load) -> Result<Throughput, Error> {
    let &Load { mode, law, particles, threads, steps, isa, rest_is_computed } = load;
    let material = Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 };
    let pad = Pad::slab([20.0, 20.0, 4.0], material);
    let without = if rest_is_computed { vec![Skip::Rest] } else { Vec::new() };
    let settings = Settings { mode, particles, without, ..Settings::default() };
    let start = Pose::new(0.0, 0.0, 0.0, 0.0);
    let mut solver =
        ExplicitSolver::with_isa(&pad, &settings, Arc::new(Ball { radius_mm: 4.0 }), &start, isa)?;
    solver.advance(&Pose::new(0.0, 0.0, -START_DEPTH_MM, 0.0))?;
    // Press on, and back when it gets deep, always at the speed of the settings.
    let stride = settings.speed_mm_s * solver.body().scheme.dt_s;
    let (mut z, mut direction) = (-START_DEPTH_MM, -1.0);
    let count = solver.body().len() as f64;
    let before = solver.tally.passes;
    let (mut rates, mut computed, mut best_computed) = (Vec::new(), 0, 0.0f64);
    let (begun, cpu_begun) = (Instant::now(), cpu_seconds());
    for _ in 0..steps {
        if z < -1.0 {
            direction = 1.0;
        } else if z > -START_DEPTH_MM {
            direction = -1.0;
        }
        z += direction * stride;
        let (one, passes) = (Instant::now(), solver.tally.passes);
        solver.tally.computed = 0;
        solver.step_to(&Pose::new(0.0, 0.0, z, 0.0))?;
        let (passes, one_s) = ((solver.tally.passes - passes) as f64, one.elapsed().as_secs_f64());
        rates.push(count * passes / one_s);
        best_computed = best_computed.max(solver.tally.computed as f64 / one_s);
        computed += solver.tally.computed;
    }
    let (seconds, cpu_s) = (begun.elapsed().as_secs_f64(), cpu_seconds() - cpu_begun);
    let passes = solver.tally.passes - before;
    rates.sort_by(f64::total_cmp);
    let (of_particles, of_grid) = solver.body().memory_bytes();
    let nodes = solver.body().grid.places.len() * super::grid::BLOCK_NODES;
    let bytes = (of_particles + of_grid) as f64;
    let (flops_each, bytes_each) = (flops_per_particle_step(law), 2.0 * bytes / count);
    let roofline = Roofline::measure(isa);
    let bound = roofline.flops_per_s / flops_each;
    Ok(Throughput {
        particles: count as u64,
        indenter_points: solver.cloud.len as u64,
        mode,
        threads,
        isa: isa.name(),
        computed: computed as f64 / (count * passes as f64),
        law,
        steps,
        passes,
        seconds,
        cpu_s,
        particle_steps_per_s: count * passes as f64 / seconds,
        median_particle_steps_per_s: rates[rates.len() / 2],
        best_particle_steps_per_s: rates[rates.len() - 1],
        particle_steps_per_cpu_s: count * passes as f64 / cpu_s,
        bytes_per_particle: of_particles as f64 / count,
        bytes_per_node: of_grid as f64 / nodes as f64,
        bytes: bytes as u64,
        flops_per_particle_step: flops_each,
        bytes_per_particle_step: bytes_each,
        roofline,
        bound_particle_steps_per_s: bound,
        of_peak: best_computed / bound,
        of_stream: best_computed * bytes_each / roofline.bytes_per_s,
    })
}

/// Seconds of processor time that this process has used, on all cores together.
fn cpu_seconds() -> f64 {
    let ts = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    ts.tv_sec as f64 + ts.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of a press, on lanes that count.
    #[test]
    fn the_flops_stated_are_those_that_the_kernels_do() {
        for law in [Law::FixedCorotated, Law::NeoHookean] {
            let material =
                Material { law, youngs_modulus_mpa: 0.145, poisson_ratio: 0.45, density_g_mm3: 1.0 };
            let (mode, particles, without) = (Mode::Mpm, [61, 61, 41], vec![Skip::Rest]);
            let settings = Settings { mode, particles, without, ..Settings::default() };
            let (pad, ball) = (Pad::slab([6.0, 6.0, 4.0], material), Arc::new(Ball { radius_mm: 4.0 }));
            let start = Pose::new(0.0, 0.0, 0.0, 0.0);
            let mut solver =
                ExplicitSolver::with_isa(&pad, &settings, ball, &start, Isa::best()).expect("a sound pad");
            solver.advance(&Pose::new(0.0, 0.0, -START_DEPTH_MM, 0.0)).expect("a press");
            solver.body.isa = Isa::Counted;
            super::super::lanes::counted::take();
            let passes = solver.tally.passes;
            solver.step_to(&Pose::new(0.0, 0.0, -START_DEPTH_MM - 0.02, 0.0)).expect("a step further");
            let done = super::super::lanes::counted::take() as f64;
            let each = done / (solver.tally.passes - passes) as f64 / solver.body.len() as f64;
            let stated = flops_per_particle_step(law);
            // An eleventh of the paper's pad under the same ball: that and the edges cost a fifth more.
            let more = each / stated;
            assert!(more > 1.0 && more < 1.2, "{law:?}: {each} counted, {stated} stated");
        }
    }

    #[test]
    fn the_measurement_measures() {
        let t = throughput(&Load::of([41, 41, 9], 2, 3)).expect("a small pad");
        assert_eq!((t.particles, t.threads, t.steps, t.passes), (41 * 41 * 9, 2, 3, 3));
        assert!(t.particle_steps_per_s > 0.0 && t.best_particle_steps_per_s >= t.median_particle_steps_per_s);
        // What the module docs state, with room for blocks that are not full on so small a pad.
        assert!(t.bytes_per_particle >= 56.0 && t.bytes_per_particle < 150.0);
        assert_eq!(t.computed, 1.0);
        assert!(t.bytes_per_node > 16.0 && t.bytes_per_node < 80.0);
        assert!(throughput(&Load::of([41, 41, 9], 0, 3)).is_err());
    }
}
