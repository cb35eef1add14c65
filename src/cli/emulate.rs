//! `twinrig emulate PROTOCOL --link PATH`: a firmware emulator for other people's clients.
//!
//! Opens a pseudo-terminal, links its far end at PATH, and answers there as the firmware would, in its own
//! time, until it is interrupted. A controller that has settings is set up as one that a rig uses (a GRBL homes); with
//! `--setting` it is otherwise. A path at which another emulator answers is refused. PROTOCOL is the name of a shipped protocol (`grbl`, `marlin`, ...) or the
//! path of a protocol file with an `[emulator]` table.

use super::exit::Exit;
use super::options::Speed;
use super::screen;
use super::signals::on_each;
use crate::clock::Clock;
use crate::device::virtual_bench::serve::pty::{PortOptions, serve_port};
use crate::device::virtual_bench::{Emulator, EmulatorOptions, Fault, FaultPlan, Faulty, World};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// Serve a firmware emulator on a pseudo-terminal
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig emulate marlin --link /tmp/printer\n  twinrig emulate grbl --link /tmp/stage --speed 10\n  twinrig emulate ./my_stage.toml --link /tmp/mine\n  twinrig emulate grbl --link /tmp/stage --fault reset@byte:900 --fault lose@reply:40"
)]
pub struct Args {
    /// Name of a shipped protocol, or path of a protocol file
    pub protocol: String,
    /// Where to link the pseudo-terminal
    #[arg(long, value_name = "PATH")]
    pub link: PathBuf,
    /// Something that goes wrong once: lose, double, late, garble, split, merge, noise, reset, alarm, unplug,
    /// swallow_request or mute, at a reply or a byte of the replies (from 0) or so long after the start
    #[arg(long = "fault", value_name = "KIND@PLACE")]
    pub faults: Vec<Fault>,
    /// A stored setting that differs, such as 22=0 for a GRBL as it comes, which does not home
    #[arg(long = "setting", value_name = "KEY=VALUE", value_parser = setting)]
    pub settings: Vec<(String, String)>,
    #[command(flatten)]
    pub speed: Speed,
}

fn setting(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').map(|(key, value)| (key.trim_start_matches('$'), value));
    let (key, value) = pair
        .filter(|(key, value)| !key.is_empty() && !value.is_empty())
        .ok_or("write the name of the setting, an equals sign and its value: 22=0")?;
    Ok((key.to_owned(), value.to_owned()))
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let spec = match crate::config::protocol(&self.protocol) {
            Ok(spec) => spec,
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        };
        let Some(described) = &spec.emulator else {
            screen::error(format_args!(
                "protocol {} has no [emulator] table; add one to the file",
                self.protocol
            ));
            return Exit::Refused;
        };
        let clock = Clock::with_speed(self.speed.speed);
        let settings = self.settings.iter().cloned().collect();
        let options = EmulatorOptions { set_up: true, settings, ..EmulatorOptions::default() };
        let world = World::without_pad();
        let emulator =
            match Emulator::new(described, "emulated", &BTreeMap::new(), &options, world, clock.now()) {
                Ok(emulator) => emulator,
                Err(e) => {
                    screen::error(e);
                    return Exit::Refused;
                }
            };
        let device = Arc::new(Mutex::new(Faulty::new(emulator, FaultPlan(self.faults.clone()), clock.now())));
        // An emulator is ended by a signal and by nothing else: that is its proper end, of which nobody need be told.
        let ended = Arc::new(Notify::new());
        let end = ended.clone();
        if let Err(e) = on_each(move |_| end.notify_one()) {
            screen::error(format_args!("signals cannot be caught: {e}"));
            return Exit::Failed;
        }
        let options = PortOptions { link: Some(self.link.clone()), reset_on_open: false };
        let served = serve_port(&device, clock, &options, |path| {
            screen::result(format_args!("{} answers at {}", self.protocol, path.display()));
        });
        tokio::select! {
            served = served => match served {
                Ok(_) => Exit::Done,
                Err(e) => {
                    screen::error(format_args!("{}: {e}; choose another --link", self.link.display()));
                    Exit::Failed
                }
            },
            () = ended.notified() => Exit::Done,
        }
    }
}
