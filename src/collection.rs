//! Collecting: bench and twin at the same time, into one dataset.
//!
//! The session performs the trajectory and hands over captures; a recorder stores each as it comes. The
//! twin walks the same trajectory on other cores and a second recorder stores its side. A collection lasts
//! as long as the slower of the two, not as both.
//!
//! The twin wears the session's own background as texture, so it waits for the first one. When it follows
//! the measured poses it waits for each of them. When the bench fails or is stopped, what the twin has
//! finished stays, and the rest is done on resuming.
//!
//! What this module does not do: open devices, choose settings, print.

mod recorder;
mod simulation;

use crate::dataset::{self, Dataset};
use crate::session::{Session, SessionError, StopLevel, StopSwitch};
use crate::twin::Twin;
use recorder::Recorder;
use simulation::Simulation;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::{mpsc, watch};

/// Name of the picture of the untouched sensor that the twin wears.
pub const BACKGROUND: &str = "background-000";

/// What to collect.
pub struct Collection<'a> {
    /// Where to.
    pub dataset: Arc<Dataset>,
    /// The bench's part; `None` when only the twin is to run.
    pub session: Option<SessionPart<'a>>,
    /// The twin's part; `None` when only the bench is to run.
    pub twin: Option<Arc<Twin>>,
    /// Stops both.
    pub stop: StopSwitch,
    /// Receives what happens, for whoever watches.
    pub progress: mpsc::UnboundedSender<Progress>,
}

/// A session and the receiver of its events.
pub struct SessionPart<'a> {
    /// The session.
    pub session: Session<'a>,
    /// Its events.
    pub events: mpsc::Receiver<crate::session::Event>,
    /// What is noted in every row of this run.
    pub run: recorder::RunNotes,
}

pub use recorder::RunNotes;

/// What happens while collecting.
#[derive(Debug, Clone, PartialEq)]
pub enum Progress {
    /// Something worth a line.
    Note(String),
    /// An indenter is mounted and about to work.
    Indenter(String),
    /// A real capture is stored.
    Real {
        /// Which.
        capture: u32,
    },
    /// A simulated capture is stored.
    Simulated {
        /// Which.
        capture: u32,
    },
    /// Captures that could not be simulated.
    NotSimulated {
        /// Which.
        captures: Vec<u32>,
        /// Why.
        why: String,
    },
}

/// How a collection ended.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ending {
    /// Captures that could not be simulated, and why.
    pub not_simulated: Vec<(Vec<u32>, String)>,
    /// Whether the stop switch ended it.
    pub stopped: bool,
}

/// Why a collection ended early. What was stored stays and can be resumed.
#[derive(Debug, thiserror::Error)]
pub enum CollectionError {
    /// The bench.
    #[error(transparent)]
    Session(SessionError),
    /// The disk.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The pictures.
    #[error(transparent)]
    Optics(#[from] crate::optics::Error),
    /// The images.
    #[error(transparent)]
    Image(#[from] crate::image::Error),
    /// A part of the program ended without an answer.
    #[error(
        "the {part} ended unexpectedly; this is a defect of the program: please report it with the log (TWINRIG_LOG=debug)"
    )]
    Vanished {
        /// Which.
        part: &'static str,
    },
}

impl Collection<'_> {
    /// Collects everything the dataset does not have yet.
    pub async fn run(self) -> Result<Ending, CollectionError> {
        let done_real = self.dataset.done_real();
        let cancel = Arc::new(AtomicBool::new(false));
        let is_full = Arc::new(AtomicBool::new(false));
        let (background, has_background) = watch::channel(self.dataset.background(BACKGROUND).map(Arc::new));
        let (measured, has_measured) = watch::channel(BTreeSet::<u32>::new());
        measured.send_replace(done_real.clone());

        let simulation = self.twin.map(|twin| {
            let simulation = Simulation {
                dataset: self.dataset.clone(),
                twin,
                background: has_background,
                measured: has_measured,
                alone: self.session.is_none(),
                cancel: cancel.clone(),
                progress: self.progress.clone(),
            };
            let (running, is_full) = (tokio::task::spawn_blocking(move || simulation.run()), is_full.clone());
            tokio::spawn(async move {
                let ended = running.await.unwrap_or(Err(CollectionError::Vanished { part: "twin" }));
                // A disk that takes no pictures of the twin will soon take none of the camera.
                is_full.store(matches!(ended, Err(CollectionError::Dataset(_))), Ordering::Relaxed);
                ended
            })
        });
        let stopped_twin = tokio::spawn({
            let (stop, cancel) = (self.stop.clone(), cancel.clone());
            async move {
                stop.raised_to(StopLevel::Controlled).await;
                cancel.store(true, Ordering::Relaxed);
            }
        });

        let bench = match self.session {
            None => Ok(()),
            Some(part) => {
                let recorder = Recorder {
                    dataset: self.dataset.clone(),
                    run: part.run,
                    background,
                    measured,
                    end: is_full,
                    progress: self.progress.clone(),
                };
                let recording = tokio::task::spawn_blocking(move || recorder.run(part.events));
                let performed = part.session.run(&done_real).await;
                let recorded = recording.await.map_err(|_| CollectionError::Vanished { part: "recorder" });
                match (performed, recorded.and_then(|r| r)) {
                    // A capture that was made but not stored is the worse news, whatever else happened.
                    (performed, Err(why)) => {
                        if let Err(e) = performed {
                            tracing::warn!("the session ended as well: {e}");
                        }
                        Err(why)
                    }
                    (Err(e), Ok(())) => Err(CollectionError::Session(e)),
                    (Ok(()), Ok(())) => Ok(()),
                }
            }
        };
        if bench.is_err() {
            // The twin's finished captures are stored; the rest belongs to the resumed run.
            cancel.store(true, Ordering::Relaxed);
        }
        let simulated = match simulation {
            None => Ok(Vec::new()),
            Some(task) => task.await.unwrap_or(Err(CollectionError::Vanished { part: "twin" })),
        };
        stopped_twin.abort();
        let stopped = self.stop.is_raised();
        match (bench, simulated) {
            (Err(CollectionError::Session(e)), Ok(not_simulated)) if e.is_stop() => {
                Ok(Ending { not_simulated, stopped: true })
            }
            (Err(CollectionError::Session(SessionError::NoReceiver)), Err(why)) => Err(why),
            (Err(CollectionError::Session(e)), Err(why)) if e.is_stop() => Err(why),
            (Err(e), _) | (_, Err(e)) => Err(e),
            (Ok(()), Ok(not_simulated)) => Ok(Ending { not_simulated, stopped }),
        }
    }
}
