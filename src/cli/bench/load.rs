//! The load of a session: the twin at work on every core.

use crate::config::Setup;
use crate::twin::branches::grow;
use crate::twin::{Outcome, Twin, Walk};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// A twin that simulates and renders a plan over and over until this is dropped.
pub(super) struct Load {
    cancel: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Why there is none.
#[derive(Debug, thiserror::Error)]
pub(super) enum LoadError {
    #[error("a load needs a plan to simulate")]
    NoPlan,
    #[error(transparent)]
    Twin(#[from] crate::assemble::TwinError),
    #[error("the thread of the load cannot be started: {0}")]
    Thread(#[from] std::io::Error),
}

impl Load {
    /// Begins to simulate the plan of a setup, as a collection does.
    pub(super) fn start(setup: &Setup) -> Result<Load, LoadError> {
        let plan = setup.plan.as_ref().ok_or(LoadError::NoPlan)?;
        let trajectory = plan.trajectory.clone();
        let twin = crate::assemble::twin(setup)?;
        let cancel = Arc::new(AtomicBool::new(false));
        let cancelled = cancel.clone();
        let work = move || {
            let wanted: BTreeSet<u32> = (0..trajectory.captures.len() as u32).collect();
            let roots = grow(&trajectory, &wanted, |i| trajectory.waypoints[i].pose);
            let Twin { pool, .. } = &twin;
            pool.install(|| {
                let wear = match twin.wear(None) {
                    Ok(wear) => wear,
                    Err(e) => return tracing::warn!("there is no load: {e}"),
                };
                while !cancelled.load(Ordering::Relaxed) {
                    let mut emit = |outcome: Outcome| {
                        if let Outcome::Deformed(deformed) = outcome
                            && let Err(e) = twin.picture(&deformed.pad, &wear, deformed.captures[0])
                        {
                            tracing::warn!("the load renders nothing: {e}");
                        }
                        !cancelled.load(Ordering::Relaxed)
                    };
                    let lattice = twin.lattice_for_pictures();
                    Walk { model: &twin.model, lattice, cancel: &cancelled, emit: &mut emit }.run(&roots);
                }
            });
        };
        let thread = std::thread::Builder::new().name("load".into()).spawn(work)?;
        Ok(Load { cancel, thread: Some(thread) })
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.cancel.store(true, Ordering::Relaxed);
        // A step of the solver is finished first.
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::warn!("the load ended in a panic");
        }
    }
}

/// Seconds of processor time that this process has used, on all cores together.
pub(super) fn cpu_seconds() -> f64 {
    let ts = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    ts.tv_sec as f64 + ts.tv_nsec as f64 * 1e-9
}
