//! `twinrig bench elastomer`: how fast the elastomer is, and how right for its time.
//!
//! Particle-steps a second of `mpm` and `impm` by size and threads with their memory, and how much that is of what the
//! machine could do; time to solution of the quasi-static
//! mode by tolerance; error against run time of all modes over their resolutions beside published figures of other
//! programs; what skipping saves. `--out` writes the tables as CSV, the curves as SVG and everything as JSON.
//! What exactly is measured: [`crate::trial::bench`].

use crate::cli::exit::Exit;
use crate::cli::screen;
use crate::trial::bench::{self, Effort, Report, Timing};
use std::path::PathBuf;

/// Measure the elastomer: throughput, time to solution, error against run time
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig bench elastomer --out bench\n  twinrig bench elastomer --quick --json"
)]
pub struct Args {
    /// Half a minute instead of a few
    #[arg(long)]
    pub quick: bool,
    /// The least that exercises every part; its figures mean little
    #[arg(long, hide = true)]
    pub smoke: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Write CSV, SVG and JSON into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

impl Args {
    /// Runs the benchmark.
    pub fn run(self) -> Exit {
        let effort = match (self.smoke, self.quick) {
            (true, _) => Effort::Smoke,
            (_, true) => Effort::Quick,
            _ => Effort::Full,
        };
        if let Some(Err(e)) = self.out.as_deref().map(super::prepare) {
            screen::error(e);
            return Exit::Refused;
        }
        let bars = screen::bars();
        let bar = screen::bar(&bars, "bench", 0);
        let measured = bench::run(effort, |done, total, what| {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
            bar.set_message(what.to_owned());
        });
        bar.finish_and_clear();
        let report = match measured {
            Ok(report) => report,
            Err(e) => {
                screen::error(e);
                return Exit::Failed;
            }
        };
        if self.json {
            screen::json(&report);
        } else {
            show(&report);
        }
        if let Some(folder) = &self.out {
            match bench::files::write(&report, folder) {
                Ok(written) => {
                    for path in written {
                        screen::note(format_args!("wrote {}", path.display()));
                    }
                }
                Err(e) => {
                    screen::error(e);
                    return Exit::Failed;
                }
            }
        }
        Exit::Done
    }
}

fn time(t: &Timing) -> String {
    format!("min {:8.3} s  median {:8.3} s  CPU {:8.3} s  (n = {})", t.min_s, t.median_s, t.cpu_s, t.repeats)
}

fn percent(part: Option<f64>) -> String {
    part.map_or("-".into(), |e| format!("{:.2} %", 100.0 * e))
}

fn show(report: &Report) {
    let m = &report.machine;
    let load = m.load_before.map_or(String::new(), |l| format!(", load {l} before"));
    screen::result(format_args!("{}, {} cores, {}, {}{load}", m.cpu, m.cores, m.simd, m.system));
    if m.debug_build {
        screen::warning(
            "this program was built without optimisation; build it with --release for figures that count",
        );
    }

    screen::result("\nParticle-steps a second (millions)");
    for t in &report.throughput {
        screen::result(format_args!(
            "  {:<5} {:<15} {:>9} particles, {:3.0} % computed {:2} threads  best {:6.1}  median {:6.1}  per CPU second {:6.1}  {:5.1} B/particle {:4.1} B/node {:6.2} GB",
            format!("{:?}", t.mode).to_lowercase(),
            format!("{:?}", t.law),
            t.particles,
            100.0 * t.computed,
            t.threads,
            t.best_particle_steps_per_s / 1e6,
            t.median_particle_steps_per_s / 1e6,
            t.particle_steps_per_cpu_s / 1e6,
            t.bytes_per_particle,
            t.bytes_per_node,
            t.bytes as f64 / 1e9
        ));
        screen::result(format_args!(
            "        of the machine's {:.0} GFLOP/s, {:.1} M/s at {:.0} flops each: {:.0} %; of its {:.0} GB/s at {:.0} bytes each: {:.0} %",
            t.roofline.flops_per_s / 1e9,
            t.bound_particle_steps_per_s / 1e6,
            t.flops_per_particle_step,
            100.0 * t.of_peak,
            t.roofline.bytes_per_s / 1e9,
            t.bytes_per_particle_step,
            100.0 * t.of_stream
        ));
    }
    for p in &report.peers {
        if let Some(rate) = p.particle_steps_per_s {
            screen::result(format_args!("  {:>6.2}  {}, {}", rate / 1e6, p.name, p.work));
        }
    }

    screen::result("\nTime to solution, quasi_static, stick, surface 201 x 201");
    for s in &report.solutions {
        let ended = match (&s.time, &s.error) {
            (Some(t), _) => format!("{}  stated error {}", time(t), percent(s.stated_error)),
            (None, error) => error.clone().unwrap_or_default(),
        };
        screen::result(format_args!("  {:<18} tolerance {:<6} {ended}", s.scene, s.tolerance));
    }

    screen::result("\nError against run time");
    for (scene, truth) in &report.curves.truths {
        screen::result(format_args!("  {scene}: the truth is {truth}"));
    }
    for p in &report.curves.points {
        screen::result(format_args!(
            "  {:<28} {:<24} {:<16} {:8.3} s  RMSE {:7.2} um ({:.2} % of depth)  force {:+.2} %  stated {}",
            p.scene,
            p.series,
            p.resolution,
            p.time.min_s,
            p.rmse_um,
            100.0 * p.of_depth,
            100.0 * p.force_error,
            percent(p.stated_error)
        ));
    }
    for (what, error) in &report.curves.failed {
        screen::result(format_args!("  {what}: {error}"));
    }
    for p in &report.peers {
        if let (Some(seconds), Some(low), Some(high)) = (p.seconds, p.error_low_um, p.error_high_um) {
            screen::result(format_args!(
                "  {:<28} {:<41} {seconds:8.3} s  RMSE {low} to {high} um",
                p.work, p.name
            ));
        }
    }

    screen::result("\nWhat skipping saves (processor time)");
    for s in &report.skips {
        screen::result(format_args!(
            "  {:<42} {:8.4} s instead of {:8.4} s, {:.1} times: {}{}",
            s.skip,
            s.with_s,
            s.without_s,
            s.factor(),
            s.work,
            s.apart_and_stated.map_or(String::new(), |[apart, stated]| format!(
                "; faces {:.2} % of the depth apart, {:.2} % stated",
                100.0 * apart,
                100.0 * stated
            ))
        ));
    }
}
