//! Exit codes: the same for every subcommand, so that a script can tell what happened.
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | failed at run time; what was stored is consistent and can be resumed |
//! | 2 | wrong usage: arguments, a file, a plan; nothing was touched |
//! | 130 | stopped by Ctrl-C: motion stopped, arm retracted if trusted, dataset consistent |
//! | 143 | stopped by SIGTERM: likewise |
//! | 131 | a second signal: motion stopped at once, nothing else done |

use std::process::ExitCode;

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done,
    /// Failed at run time.
    Failed,
    /// Wrong usage; nothing was touched.
    Refused,
    /// Stopped by a signal (its number).
    Stopped(u8),
    /// Stopped by a second signal.
    StoppedHard,
}

impl Exit {
    /// The process exit code.
    pub fn code(self) -> u8 {
        match self {
            Exit::Done => 0,
            Exit::Failed => 1,
            Exit::Refused => 2,
            Exit::Stopped(signal) => 128 + signal,
            Exit::StoppedHard => 131,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> ExitCode {
        ExitCode::from(exit.code())
    }
}
