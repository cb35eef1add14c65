//! Particle-steps per second of the explicit modes, by size and threads, and what they keep in memory.

use super::{Effort, Stage};
use crate::elastomer::mpm::bench::{Load, throughput};
use crate::elastomer::{Law, Mode};

/// The predecessor's coarse and the paper's lattice, and the largest that is asked for.
const COARSE: [usize; 3] = [101, 101, 21];
const PAPER: [usize; 3] = [201, 201, 41];
const LARGEST: [usize; 3] = [401, 401, 81];

/// Adds the measurements.
pub(super) fn plan(effort: Effort, stages: &mut Vec<Stage>) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut threads = vec![1, 2, 4, 8, 16];
    threads.retain(|t| *t < cores);
    threads.push(cores);
    let mut add = |load: Load| {
        let Load { mode, law, particles: [x, y, z], threads, rest_is_computed, .. } = load;
        let rest = if rest_is_computed { "" } else { ", what is at rest passed over" };
        let name = format!("throughput {mode:?} {law:?} {x}x{y}x{z}, {threads} threads{rest}");
        let stage = move |report: &mut super::Report| {
            report.throughput.push(throughput(&load)?);
            Ok(())
        };
        stages.push((name, Box::new(stage)));
    };
    match effort {
        Effort::Smoke => {
            add(Load::of([41, 41, 9], 1, 3));
            add(Load { mode: Mode::Impm, rest_is_computed: false, ..Load::of([41, 41, 9], cores, 3) });
        }
        Effort::Quick => {
            for threads in [1, cores] {
                add(Load::of(COARSE, threads, 20));
            }
            add(Load { mode: Mode::Impm, ..Load::of(COARSE, cores, 20) });
        }
        Effort::Full => {
            for (particles, steps) in [(COARSE, 60), (PAPER, 20)] {
                for threads in &threads {
                    add(Load::of(particles, *threads, steps));
                }
                add(Load { rest_is_computed: false, ..Load::of(particles, cores, steps) });
                add(Load { mode: Mode::Impm, ..Load::of(particles, cores, steps) });
                add(Load { law: Law::NeoHookean, ..Load::of(particles, cores, steps) });
            }
            add(Load::of(LARGEST, cores, 2));
        }
    }
}
