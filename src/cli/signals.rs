//! Signals: the first one stops, the second one stops harder. `twinrig stop` counts as one.
//!
//! They are waited for on a thread of their own, with a runtime of its own: between a signal and the stop's bytes
//! there is no executor that is busy with something else (`twinrig bench stop` measures what is left).

use super::exit::Exit;
use crate::session::{StopLevel, StopSwitch};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use tokio::signal::unix::{SignalKind, signal};

/// Which signal was received, for the exit code.
#[derive(Debug, Clone)]
pub struct Signals {
    stop: StopSwitch,
    received: Arc<AtomicU8>,
    at_once: AtOnce,
}

/// What a second signal leaves behind, for whoever sent it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtOnce {
    /// Movers that were stopped wherever they were.
    Rig,
    /// A dataset; no mover was used.
    Dataset,
    /// The account of a simulation; no mover was used.
    Account,
}

impl std::fmt::Display for AtOnce {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            AtOnce::Rig => "stopped at once; home the rig before the next session",
            AtOnce::Dataset => "stopped at once; what is stored is consistent: the same command with --resume goes on",
            AtOnce::Account => {
                "stopped at once; what captures.jsonl lists is stored whole: --captures with the others, into another \
                 --out, goes on"
            }
        })
    }
}

/// The signal that `twinrig stop` counts as.
const TERMINATE: u8 = 15;

/// Links write their stop bytes on their own tasks when the port is busy: they get so long before the process ends.
const LAST_WORDS: std::time::Duration = std::time::Duration::from_millis(50);

impl Signals {
    /// Listens for SIGINT, SIGTERM and SIGHUP, and raises the switch on the first; a second one raises
    /// it to emergency and ends the process; `at_once` says what that leaves.
    ///
    /// # Errors
    /// When the system refuses to install a handler.
    pub fn listen(stop: StopSwitch, at_once: AtOnce) -> std::io::Result<Signals> {
        let signals = Signals { stop, received: Arc::default(), at_once };
        let listening = signals.clone();
        let mut first = true;
        on_each(move |number| {
            if first {
                listening.stop_by(number);
                super::screen::warning("stopping (once more to stop at once)");
                first = false;
            } else {
                listening.stop_at_once();
            }
        })?;
        Ok(signals)
    }

    /// What `twinrig stop` asks for, on whatever thread: as a first signal, or as a second one.
    pub fn stop_from_outside(&self, level: StopLevel) {
        match level {
            StopLevel::Emergency => {
                self.stop.raise(StopLevel::Emergency);
                let signals = self.clone();
                // Whoever asked is answered first.
                std::thread::spawn(move || signals.stop_at_once());
            }
            _ => {
                self.stop_by(TERMINATE);
                super::screen::warning("stopping: `twinrig stop` asks for it");
            }
        }
    }

    fn stop_by(&self, number: u8) {
        self.stop.raise(StopLevel::Controlled);
        self.received.store(number, Ordering::SeqCst);
    }

    fn stop_at_once(&self) {
        self.stop.raise(StopLevel::Emergency);
        std::thread::sleep(LAST_WORDS);
        super::screen::take_back();
        super::screen::error(self.at_once);
        std::process::exit(i32::from(Exit::StoppedHard.code()));
    }

    /// Waits for the first signal.
    pub async fn received(&self) {
        self.stop.raised_to(StopLevel::Controlled).await;
    }

    /// How the command ended if a signal ended it.
    pub fn exit(&self) -> Option<Exit> {
        match self.received.load(Ordering::SeqCst) {
            0 => None,
            number => Some(Exit::Stopped(number)),
        }
    }
}

/// Raises the priority of the calling thread where the system allows it (root, or a limit `nice` below 0): it sleeps
/// until it matters. Elsewhere it still comes before the simulation, whose threads give way.
fn come_first() {
    #[cfg(target_os = "linux")]
    {
        let thread = rustix::thread::gettid();
        if let Err(e) = rustix::process::setpriority_process(Some(thread), -15) {
            tracing::debug!("the thread of signals keeps its priority: {e}");
        }
    }
}

/// Calls `act` with the number of each SIGINT, SIGTERM and SIGHUP, on a thread of its own, until the process ends.
///
/// # Errors
/// When the system refuses to install a handler, or a thread.
pub fn on_each(mut act: impl FnMut(u8) + Send + 'static) -> std::io::Result<()> {
    let (ready, installed) = std::sync::mpsc::channel();
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        come_first();
        let runtime = match tokio::runtime::Builder::new_current_thread().enable_io().build() {
            Ok(runtime) => runtime,
            Err(e) => {
                _ = ready.send(Err(e));
                return;
            }
        };
        runtime.block_on(async move {
            let install = || {
                let interrupt = signal(SignalKind::interrupt())?;
                Ok((interrupt, signal(SignalKind::terminate())?, signal(SignalKind::hangup())?))
            };
            let (mut interrupt, mut terminate, mut hangup) = match install() {
                Ok(installed) => installed,
                Err(e) => {
                    _ = ready.send(Err(e));
                    return;
                }
            };
            _ = ready.send(Ok(()));
            loop {
                act(tokio::select! {
                    _ = interrupt.recv() => 2,
                    _ = terminate.recv() => TERMINATE,
                    _ = hangup.recv() => 1,
                });
            }
        });
    })?;
    installed.recv().unwrap_or_else(|_| Err(std::io::Error::other("the thread of signals ended at once")))
}
