//! `twinrig status RIG`: what a bench is doing, and where it is.
//!
//! A session that runs is asked, and goes on undisturbed. Where none runs, the ports of a real rig are opened, each
//! device is asked who it is and where it is, and the ports are closed again; nothing moves. (A controller that
//! is woken by a reset, such as GRBL, forgets its homing by this.)

use super::exit::Exit;
use super::options::RigOptions;
use super::screen;
use super::sessions::{load_and_find, tell_mute};
use crate::config::Setup;
use crate::control::Status;
use crate::device::mover::{Mover, Seen};
use serde_json::json;
use std::collections::BTreeMap;

/// Show what a bench is doing and where it is
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig status rig_configs/virtual.toml\n  twinrig status rig_configs/skin_marlin_grbl.toml --json"
)]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let (setup, found) = match load_and_find(&self.rig) {
            Ok(both) => both,
            Err(exit) => return exit,
        };
        if !found.sessions.is_empty() {
            let sessions: Vec<&Status> = found.sessions.iter().map(|s| &s.status).collect();
            if self.json {
                screen::json(&json!({ "sessions": sessions, "devices": {} }));
            } else {
                sessions.iter().for_each(|s| show_session(s));
            }
            return Exit::Done;
        }
        if setup.rig.is_virtual() {
            if self.json {
                screen::json(&json!({ "sessions": [], "devices": {} }));
            } else {
                screen::result(format_args!(
                    "no session of {} runs; a virtual bench exists only while one does",
                    setup.rig.name
                ));
            }
            return tell_mute(&found.mute);
        }
        let asked = self.ask_devices(&setup).await;
        let mute = tell_mute(&found.mute);
        if asked == Exit::Done { mute } else { asked }
    }

    async fn ask_devices(&self, setup: &Setup) -> Exit {
        let mut exit = Exit::Done;
        let mut devices = serde_json::Map::new();
        let mut seen_all = BTreeMap::new();
        for (device, opened) in crate::assemble::movers_alone(setup).await {
            match opened {
                Ok(mut mover) => {
                    let (seen, problem) = look(&mut mover).await;
                    if let Some(problem) = problem {
                        screen::error(format_args!("{device}: {problem}"));
                        exit = Exit::Failed;
                    }
                    devices.insert(device.clone(), json!(seen));
                    seen_all.insert(device, seen);
                }
                Err(e) => {
                    screen::error(&e);
                    devices.insert(device, json!({ "error": e.to_string() }));
                    exit = Exit::Failed;
                }
            }
        }
        if self.json {
            screen::json(&json!({ "sessions": [], "devices": devices }));
        } else {
            screen::result(format_args!("{}: no session runs", setup.rig.name));
            seen_all.iter().for_each(|(device, seen)| show_device(device, seen));
        }
        exit
    }
}

/// Where a device is; and why that is not all there is to know.
async fn look(mover: &mut Mover) -> (Seen, Option<String>) {
    let problem = mover.position().await.err().map(|e| e.to_string());
    (mover.observer().look(), problem)
}

fn show_session(status: &Status) {
    screen::result(format_args!(
        "{}: {} runs (process {}, since {})",
        status.rig.name, status.command, status.pid, status.begun_utc
    ));
    if status.stop != "running" {
        screen::result(format_args!("  it is stopping ({})", status.stop));
    }
    if let Some(out) = &status.out {
        screen::result(format_args!("  dataset {}", out.display()));
    }
    if let Some(p) = &status.progress {
        let indenter = p.indenter.as_deref().map(|i| format!(", indenter {i}")).unwrap_or_default();
        screen::result(format_args!(
            "  {} real and {} simulated of {} captures{indenter}",
            p.real, p.simulated, p.captures
        ));
    }
    if let Some(pose) = &status.pose {
        screen::result(format_args!("  at {pose} (relative to the nominal contact)"));
    }
    status.devices.iter().for_each(|(device, seen)| show_device(device, seen));
}

fn show_device(device: &str, seen: &Seen) {
    screen::result(format_args!(
        "  {device}: {} on {}: {}, {}",
        seen.protocol,
        seen.port,
        seen.state.as_ref().map_or_else(|| "state unknown".to_owned(), |s| format!("{s:?}").to_lowercase()),
        match seen.reference {
            crate::device::mover::Reference::Referenced => "position known",
            crate::device::mover::Reference::Homing => "homing",
            crate::device::mover::Reference::Unknown => "not homed",
            crate::device::mover::Reference::Suspect => "position lost",
        }
    ));
    if let Some(identity) = &seen.identity {
        screen::result(format_args!("    {}", identity.lines().next().unwrap_or_default()));
    }
    for axis in &seen.axes {
        let unit = axis.kind.unit();
        let at = axis.position.map_or_else(|| "?".to_owned(), |p| format!("{p:.3}"));
        screen::result(format_args!("    {} at {at} {unit} ({} to {})", axis.axis, axis.min, axis.max));
    }
    for why in [&seen.last_loss, &seen.link_lost].into_iter().flatten() {
        screen::result(format_args!("    {why}"));
    }
}
