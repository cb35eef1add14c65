//! The `twinrig` program: parse arguments, start logging, dispatch, exit with a stated code.

fn main() -> std::process::ExitCode {
    twinrig::cli::main()
}
