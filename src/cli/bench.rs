//! `twinrig bench`: how fast it is, measured on this machine. One file for each benchmark.

mod distribution;
mod elastomer;
mod load;
mod optics;
mod optics_plot;
mod session;
mod stop;

use super::exit::Exit;
use std::path::Path;

/// Measure this machine: stops, sessions, elastomer, optics
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig bench stop\n  twinrig bench session --json\n  twinrig bench elastomer --quick\n  twinrig bench optics --out bench/optics"
)]
pub struct Args {
    #[command(subcommand)]
    pub what: What,
}

/// The benchmarks.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    Stop(stop::Args),
    Session(session::Args),
    Elastomer(elastomer::Args),
    Optics(optics::Args),
}

impl Args {
    /// Runs the benchmark.
    pub async fn run(self) -> Exit {
        match self.what {
            What::Stop(args) => args.run().await,
            What::Session(args) => args.run().await,
            What::Elastomer(args) => args.run(),
            What::Optics(args) => args.run(),
        }
    }
}

/// Makes a folder and writes into it on trial: whoever names an impossible one shall know before minutes are measured.
///
/// # Errors
/// Why nothing can be written there.
fn prepare(folder: &Path) -> Result<(), String> {
    // A name without a folder is in the present one.
    let place = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let trial = place.join(format!(".twinrig-bench-{}", std::process::id()));
    let tried = std::fs::create_dir_all(place)
        .and_then(|()| std::fs::write(&trial, "twinrig"))
        .and_then(|()| std::fs::remove_file(&trial));
    tried.map_err(|e| {
        format!(
            "--out: cannot write into {}: {e}; make room, mend permissions, or choose another folder",
            place.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_made_and_left_empty_and_none_is_made_below_a_file() {
        let above = tempfile::tempdir().expect("a folder");
        let folder = above.path().join("a/b");
        for _ in 0..2 {
            prepare(&folder).expect("there is room");
            assert_eq!(std::fs::read_dir(&folder).expect("it is there").count(), 0);
        }
        prepare(Path::new("")).expect("the present one");
        std::fs::write(folder.join("file"), "").expect("a file");
        let refused = prepare(&folder.join("file/c")).expect_err("a file is no folder");
        assert!(refused.contains("a/b/file/c") && refused.contains("choose another folder"), "{refused}");
    }
}
