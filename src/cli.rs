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

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use exit::Exit;
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

/// Options take a number below 0 for a value, so that whoever checks it tells what is allowed; else it would be taken for an option
/// that there is not.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|arg| match arg.get_action().takes_values() && !arg.is_positional() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    });
    command.mut_subcommands(with_negative_numbers)
}

/// Parses the arguments, runs the subcommand, and turns its ending into an exit code.
pub fn main() -> ExitCode {
    let cli = Cli::from_arg_matches(&with_negative_numbers(Cli::command()).get_matches())
        .unwrap_or_else(|error| error.exit());
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
