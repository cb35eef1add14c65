//! `twinrig bench stop`: from a signal to the stop's bytes on every port.
//!
//! Two processes. The *victim* is a session as far as stopping goes: it holds three ports through the ordinary links, keeps
//! all axes moving, and collects the simulated side of a plan beside it, once for each core: the twins simulate, render and
//! store what they have made. This process is the *witness*: it serves emulated
//! controllers on the far ends of the ports, sends SIGTERM at a random instant, and notes when the last
//! byte of each port's stop has come out at the far end. So a time contains everything: the kernel's
//! delivery of the signal, the victim's way to its ports, and the witness's own wake-up on the same busy machine.
//! It is measured with all ports alive, with one that takes no bytes any more, and with one that is gone.

mod victim;
mod witness;

use super::distribution::Distribution;
use crate::cli::exit::Exit;
use crate::cli::{options, screen};
use serde::Serialize;
use std::path::PathBuf;
use witness::{Fault, Witness};

/// Measure from a signal to the stop bytes on every port, under full load
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig bench stop\n  twinrig bench stop --stops 500 --json")]
pub struct Args {
    /// Stops for each of the three states of the ports
    #[arg(long, default_value_t = 200, value_parser = options::whole::<u32>(1..=100_000))]
    pub stops: u32,
    /// Rig file whose arm and stage are used
    #[arg(long, default_value = "rig_configs/virtual.toml")]
    pub rig: PathBuf,
    /// Plan that is simulated meanwhile
    #[arg(long, default_value = "rig_configs/plans/slip.toml")]
    pub plan: PathBuf,
    /// Without the simulation, for comparison
    #[arg(long)]
    pub idle: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Be the process that is stopped: its ports, in the order of the devices
    #[arg(long, hide = true, value_delimiter = ',')]
    pub victim: Vec<PathBuf>,
    /// Where the victim may write
    #[arg(long, hide = true, default_value = ".")]
    pub scratch: PathBuf,
}

/// What users are promised: the 99th percentile stays below this.
const TARGET_P99_MS: f64 = 20.0;

/// One state of the ports.
#[derive(Debug, Serialize)]
struct Row {
    ports: &'static str,
    /// From the signal until the stop's bytes are out at every port that lives.
    on_every_port: Distribution,
    /// From the signal until the victim has handed them to the operating system.
    handed_over: Distribution,
    /// Stops of which a port saw nothing within two seconds.
    missed: usize,
    /// Cores that the victim kept busy.
    cores: f64,
}

impl Args {
    /// Runs the benchmark.
    pub async fn run(self) -> Exit {
        if !self.victim.is_empty() {
            return victim::run(&self).await;
        }
        let mut rows = Vec::new();
        for fault in [Fault::None, Fault::Mute, Fault::Gone] {
            screen::note(format_args!("{}: {} stops ...", fault.words(), self.stops));
            let measured = match Witness::start(&self, fault).await {
                Ok(witness) => witness.measure(self.stops as usize).await,
                Err(e) => Err(e),
            };
            match measured {
                Ok(measured) => rows.push(Row {
                    ports: fault.words(),
                    on_every_port: Distribution::of(measured.arrived_ms),
                    handed_over: Distribution::of(measured.handed_over_ms),
                    missed: measured.missed,
                    cores: measured.cores,
                }),
                Err(e) => {
                    screen::error(e);
                    return Exit::Failed;
                }
            }
        }
        let met = rows.iter().all(|r| r.on_every_port.p99_ms < TARGET_P99_MS && r.missed == 0);
        if self.json {
            screen::json(&serde_json::json!({ "target_p99_ms": TARGET_P99_MS, "met": met, "rows": rows }));
        } else {
            for row in &rows {
                screen::result(format_args!("{} (victim on {:.1} cores)", row.ports, row.cores));
                screen::result(format_args!("  out at every port   {}", row.on_every_port));
                screen::result(format_args!("  handed to the system {}", row.handed_over));
                if row.missed > 0 {
                    screen::result(format_args!("  missed: {}", row.missed));
                }
            }
            let word = if met { "met" } else { "missed" };
            screen::result(format_args!("target: p99 below {TARGET_P99_MS} ms: {word}"));
        }
        if met { Exit::Done } else { Exit::Failed }
    }
}
