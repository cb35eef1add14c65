//! Signals: the first one stops, the second one stops harder.

use super::exit::Exit;
use crate::session::{StopLevel, StopSwitch};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use tokio::signal::unix::{SignalKind, signal};

/// Which signal was received, for the exit code.
#[derive(Debug, Clone, Default)]
pub struct Signals {
    received: Arc<AtomicU8>,
}

impl Signals {
    /// Listens for SIGINT, SIGTERM and SIGHUP, and raises the switch on the first; a second one raises
    /// it to emergency and ends the process.
    ///
    /// # Errors
    /// When the system refuses to install a handler.
    pub fn listen(stop: StopSwitch) -> std::io::Result<Signals> {
        let signals = Signals::default();
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let mut hangup = signal(SignalKind::hangup())?;
        let received = signals.received.clone();
        tokio::spawn(async move {
            let mut first = true;
            loop {
                let number = tokio::select! {
                    _ = interrupt.recv() => 2,
                    _ = terminate.recv() => 15,
                    _ = hangup.recv() => 1,
                };
                if first {
                    stop.raise(StopLevel::Controlled);
                    received.store(number, Ordering::SeqCst);
                    super::screen::warning(
                        "stopping: motion stops, the arm retracts, the dataset stays consistent (once more to stop at once)",
                    );
                    first = false;
                } else {
                    stop.raise(StopLevel::Emergency);
                    // Links write their stop bytes on their own tasks: give them their few milliseconds.
                    tokio::time::sleep(std::time::Duration::from_millis(50)).await;
                    super::screen::error("stopped at once; home the rig before the next session");
                    std::process::exit(i32::from(Exit::StoppedHard.code()));
                }
            }
        });
        Ok(signals)
    }

    /// How the command ended if a signal ended it.
    pub fn exit(&self) -> Option<Exit> {
        match self.received.load(Ordering::SeqCst) {
            0 => None,
            number => Some(Exit::Stopped(number)),
        }
    }
}
