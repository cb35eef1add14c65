//! The command line: one file for each subcommand, whose module doc is its manual.
//!
//! Only this module prints ([`screen`]); every subcommand ends with a stated code ([`exit`]).

pub mod exit;
pub mod screen;
pub mod signals;

mod at_bench;
mod bench;
mod camera;
mod capture;
mod check;
mod collect;
mod devices;
mod drive;
mod dry_run;
mod emulate;
mod home;
mod jog;
mod move_to;
mod options;
mod picture_file;
mod protocol;
mod relight;
mod render;
mod replay;
mod report;
mod sessions;
mod simulate;
mod status;
mod stop;
mod stress;
mod verify;

use clap::{Parser, Subcommand};
use exit::Exit;
use std::ffi::OsString;
use std::process::ExitCode;

/// Collects paired real and simulated tactile images: drives the bench, runs the twin, stores both.
#[derive(Debug, Parser)]
#[command(name = "twinrig", version, propagate_version = true, arg_required_else_help = true)]
#[command(
    after_help = "Try it without hardware:\n  twinrig collect rig_configs/virtual.toml rig_configs/plans/small.toml --out data/try\n\n\
Exit codes: 0 done, 1 failed (resume continues), 2 refused (nothing touched), 130/143 stopped by a signal, 131 stopped twice.\n\
Logging: TWINRIG_LOG=debug tells more; the logs of the ports hold every byte; NO_COLOR turns colours off."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Collect(collect::Args),
    Check(check::Args),
    Simulate(simulate::Args),
    Drive(drive::Args),
    Devices(devices::Args),
    Home(home::Args),
    Move(move_to::Args),
    Jog(jog::Args),
    Stop(stop::Args),
    Status(status::Args),
    Capture(capture::Args),
    Camera(camera::Args),
    Verify(verify::Args),
    Report(report::Args),
    Emulate(emulate::Args),
    Render(render::Args),
    Relight(relight::Args),
    Protocol(protocol::Args),
    Bench(bench::Args),
    Stress(stress::Args),
    Replay(replay::Args),
}

/// Arguments with each value that begins as a number below 0 joined to its option, as in `--z=-.5`: so that whoever checks the value
/// tells what is allowed; alone it would be taken for an option that there is not.
fn joined(arguments: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    for argument in arguments {
        let below = argument.to_str().is_some_and(begins_below_0);
        let option = |last: &OsString| {
            last.to_str().is_some_and(|t| t.len() > 2 && t.starts_with("--") && !t.contains('='))
        };
        match joined.last_mut().filter(|last| below && option(last)) {
            Some(last) => {
                last.push("=");
                last.push(argument);
            }
            None => joined.push(argument),
        }
    }
    joined
}

/// Whether this is, or begins with, a number below 0: `-1`, `-.5`, `-1x5`, `-inf`, `-nan`.
fn begins_below_0(argument: &str) -> bool {
    argument.strip_prefix('-').is_some_and(|rest| {
        rest.trim_start_matches('.').starts_with(|c: char| c.is_ascii_digit())
            || ["inf", "infinity", "nan"].iter().any(|word| rest.eq_ignore_ascii_case(word))
    })
}

/// Parses the arguments, runs the subcommand, and turns its ending into an exit code.
pub fn main() -> ExitCode {
    let cli = Cli::parse_from(joined(std::env::args_os()));
    start_logging();
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(e) => {
            screen::error(format_args!("cannot start the runtime: {e}"));
            return Exit::Failed.into();
        }
    };
    let exit = runtime.block_on(async {
        match cli.command {
            Command::Collect(args) => args.run().await,
            Command::Check(args) => args.run(),
            Command::Simulate(args) => args.run().await,
            Command::Drive(args) => args.run().await,
            Command::Devices(args) => args.run(),
            Command::Home(args) => args.run().await,
            Command::Move(args) => args.run().await,
            Command::Jog(args) => args.run().await,
            Command::Stop(args) => args.run(),
            Command::Status(args) => args.run().await,
            Command::Capture(args) => args.run().await,
            Command::Camera(args) => args.run().await,
            Command::Verify(args) => args.run(),
            Command::Report(args) => args.run(),
            Command::Emulate(args) => args.run().await,
            Command::Render(args) => args.run(),
            Command::Relight(args) => args.run(),
            Command::Protocol(args) => args.run(),
            Command::Bench(args) => args.run().await,
            Command::Stress(args) => args.run().await,
            Command::Replay(args) => args.run(),
        }
    });
    // Blocking threads (a camera that hangs in its driver) must not keep the process alive.
    runtime.shutdown_timeout(std::time::Duration::from_millis(500));
    exit.into()
}

fn start_logging() {
    use tracing_subscriber::EnvFilter;
    let filter = EnvFilter::try_from_env("TWINRIG_LOG").unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(screen::log)
        .with_ansi(console::colors_enabled_stderr())
        .init();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_below_0_is_the_options_before_it_and_nothing_else_is() {
        let after = |arguments: &str| {
            let joined = joined(arguments.split(' ').map(OsString::from));
            joined.iter().map(|a| a.to_string_lossy()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(after("move rig --z -.5 --home"), "move rig --z=-.5 --home");
        assert_eq!(after("render --size -1x5 --json -o"), "render --size=-1x5 --json -o");
        assert_eq!(after("render --tolerance -inf"), "render --tolerance=-inf");
        for unchanged in
            ["a --z=-1 -2", "a --json --help", "a -- -1", "a -1", "a --set -x.y=1", "a --out -infile"]
        {
            assert_eq!(after(unchanged), unchanged);
        }
    }
}
