//! `twinrig stop RIG`: stop whatever moves on a bench.
//!
//! A session that runs is asked to stop, as Ctrl-C in its own terminal would: it decelerates, retracts the arm and
//! ends with its dataset consistent (exit code 143 there). With `--now` it stops at once, even at the price of
//! the positions. Where no session runs, the ports are opened and the protocol's stop bytes are written to
//! every one of them, which stops what a killed program left in motion.

use super::exit::Exit;
use super::options::RigOptions;
use super::screen;
use super::sessions::{load_and_find, tell_mute};
use crate::assemble;
use crate::config::Setup;
use crate::control::{Answer, Found, Request};
use crate::device::mover::after_hard_stop;
use crate::protocol::StopKind;
use serde_json::json;

/// Stop a running session, or the devices themselves
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig stop rig_configs/virtual.toml\n  twinrig stop rig_configs/skin_marlin_grbl.toml --now"
)]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// At once, even at the price of the positions
    #[arg(long)]
    pub now: bool,
    /// Print what was stopped as one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        let (setup, found) = match load_and_find(&self.rig) {
            Ok(both) => both,
            Err(exit) => return exit,
        };
        if !found.sessions.is_empty() {
            return self.ask(&found);
        }
        if setup.rig.is_virtual() {
            if self.json {
                screen::json(&json!({ "sessions": [], "ports": {} }));
            } else {
                screen::result(format_args!(
                    "no session of {} runs; a virtual bench has nothing else to stop",
                    setup.rig.name
                ));
            }
            return tell_mute(&found.mute);
        }
        let written = self.write(&setup);
        let mute = tell_mute(&found.mute);
        if written == Exit::Done { mute } else { written }
    }

    /// Asks every session of this rig.
    fn ask(&self, found: &Found) -> Exit {
        let mut exit = Exit::Done;
        let mut stopped = Vec::new();
        for session in &found.sessions {
            match session.ask(Request::Stop { now: self.now }) {
                Ok(Answer::Stopped { pid, command }) => {
                    if !self.json {
                        let how = if self.now { "stopped at once" } else { "stopping" };
                        screen::result(format_args!(
                            "{how}: {command} on {} (process {pid})",
                            session.status.rig.name
                        ));
                    }
                    stopped.push(json!({ "pid": pid, "command": command, "rig": session.status.rig.name }));
                }
                Ok(other) => {
                    screen::error(format_args!("process {} answers {other:?}", session.status.pid));
                    exit = Exit::Failed;
                }
                Err(e) => {
                    screen::error(e);
                    exit = Exit::Failed;
                }
            }
        }
        if self.json {
            screen::json(&json!({ "sessions": stopped, "ports": {} }));
        }
        exit
    }

    /// Writes to the ports.
    fn write(&self, setup: &Setup) -> Exit {
        let kind = if self.now { StopKind::Emergency } else { StopKind::Controlled };
        let mut exit = Exit::Done;
        let mut ports = serde_json::Map::new();
        for (device, stopped) in assemble::stop_ports(setup, kind) {
            let port = setup.rig.devices[&device].port.to_string();
            match stopped {
                Ok(bytes) => {
                    let shown = bytes.escape_ascii().to_string();
                    if !self.json {
                        screen::result(format_args!("{device}: stop written to {port}: {shown}"));
                    }
                    let spec = &setup.protocols[&setup.rig.devices[&device].protocol];
                    let left = if self.now { after_hard_stop(spec) } else { None };
                    if let (Some(afterwards), false) = (left, self.json) {
                        screen::warning(format_args!("{device}: {afterwards}"));
                    }
                    ports.insert(device, json!({ "port": port, "written": shown, "afterwards": left }));
                }
                Err(e) => {
                    screen::error(&e);
                    ports.insert(device, json!({ "port": port, "error": e.to_string() }));
                    exit = Exit::Failed;
                }
            }
        }
        if self.json {
            screen::json(&json!({ "sessions": [], "ports": ports }));
        } else if exit == Exit::Done {
            screen::note("no session was running; what the devices do now is not known: home before moving");
        }
        exit
    }
}
