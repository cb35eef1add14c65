//! The load of a session: the twin's side of a collection, on every core and onto the disk. One collection does not keep
//! all cores busy all the time, so there are as many as cores.

use crate::assemble;
use crate::collection::Collection;
use crate::config::Setup;
use crate::dataset::Dataset;
use crate::session::{StopLevel, StopSwitch};
use crate::twin::Twin;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Collections that simulate, render and store a plan over and over until this is dropped.
pub(super) struct Load {
    stop: StopSwitch,
}

/// Why there is none.
#[derive(Debug, thiserror::Error)]
pub(super) enum LoadError {
    #[error("a load needs a plan to simulate")]
    NoPlan,
    #[error(transparent)]
    Twin(#[from] assemble::TwinError),
    #[error(transparent)]
    Provenance(#[from] assemble::ProvenanceError),
}

impl Load {
    /// Begins to collect the simulated side of a setup's plan, in folders below `scratch` that are thrown away.
    pub(super) fn start(setup: &Setup, scratch: &Path) -> Result<Load, LoadError> {
        let plan = setup.plan.as_ref().ok_or(LoadError::NoPlan)?;
        // Not the switch of the session that is stopped: this load goes on while that is measured.
        let stop = StopSwitch::new();
        for core in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            let (twin, provenance) = (Arc::new(assemble::twin(setup)?), assemble::provenance(setup)?);
            let (trajectory, folder) = (plan.trajectory.clone(), scratch.join(format!("load-{core}")));
            let until = stop.clone();
            tokio::spawn(async move {
                while !until.is_raised() {
                    let dataset = match Dataset::create(&folder, provenance.clone(), &trajectory) {
                        Ok(dataset) => Arc::new(dataset),
                        Err(e) => return tracing::error!("there is no load: {e}"),
                    };
                    let ended = collect(dataset, twin.clone(), until.clone()).await;
                    let cleared = std::fs::remove_dir_all(&folder).map_err(|e| e.to_string());
                    if let Err(e) = ended.and(cleared) {
                        return tracing::error!("the load has ended: {e}");
                    }
                }
            });
        }
        Ok(Load { stop })
    }
}

async fn collect(dataset: Arc<Dataset>, twin: Arc<Twin>, stop: StopSwitch) -> Result<(), String> {
    let (progress, _watched) = tokio::sync::mpsc::unbounded_channel();
    let collection = Collection { dataset, session: None, twin: Some(twin), stop, progress };
    collection.run().await.map(drop).map_err(|e| e.to_string())
}

impl Drop for Load {
    fn drop(&mut self) {
        self.stop.raise(StopLevel::Controlled);
    }
}

/// Seconds of processor time that this process has used, on all cores together.
pub(super) fn cpu_seconds() -> f64 {
    let ts = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    ts.tv_sec as f64 + ts.tv_nsec as f64 * 1e-9
}

/// A folder for what nobody keeps: it goes when this is dropped.
pub(super) struct ThrownAway(pub(super) PathBuf);

impl ThrownAway {
    /// One of this process in the system's folder for such things.
    pub(super) fn new(purpose: &str) -> ThrownAway {
        ThrownAway(std::env::temp_dir().join(format!("twinrig-bench-{purpose}-{}", std::process::id())))
    }
}

impl Drop for ThrownAway {
    fn drop(&mut self) {
        if let Err(e) = std::fs::remove_dir_all(&self.0)
            && e.kind() != std::io::ErrorKind::NotFound
        {
            crate::cli::screen::warning(format_args!("{} stays behind: {e}", self.0.display()));
        }
    }
}
