//! Lets the twin do what the dataset lacks, and stores it.

use super::{CollectionError, Progress};
use crate::dataset::{Dataset, SimRecord, depth};
use crate::image::png;
use crate::pose::Pose;
use crate::twin::branches::grow;
use crate::twin::{FollowedPoses, Outcome, Picture, Twin, Walk, Wear};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;
use tokio::sync::{mpsc, watch};

pub(super) struct Simulation {
    pub dataset: Arc<Dataset>,
    pub twin: Arc<Twin>,
    pub background: watch::Receiver<Option<Arc<Vec<u8>>>>,
    pub measured: watch::Receiver<BTreeSet<u32>>,
    /// Whether no session runs beside: then what is not there will not come.
    pub alone: bool,
    pub cancel: Arc<AtomicBool>,
    pub progress: mpsc::UnboundedSender<Progress>,
}

type NotSimulated = Vec<(Vec<u32>, String)>;

impl Simulation {
    /// Simulates and stores; answers what could not be simulated.
    pub fn run(self) -> Result<NotSimulated, CollectionError> {
        let done = self.dataset.done_sim();
        let all = 0..self.dataset.trajectory().captures.len() as u32;
        let wanted: BTreeSet<u32> = all.filter(|c| !done.contains(c)).collect();
        if wanted.is_empty() {
            return Ok(Vec::new());
        }
        let Some(wear) = self.wait_for_background()? else { return Ok(Vec::new()) };
        match self.twin.follow {
            FollowedPoses::Commanded => self.commanded(&wanted, &wear),
            FollowedPoses::Measured => self.measured(&wanted, &wear),
        }
    }

    /// The picture of the untouched sensor; `None` when the collection ends before there is one.
    fn wait_for_background(&self) -> Result<Option<Wear>, CollectionError> {
        loop {
            let bytes = self.background.borrow().clone();
            if let Some(bytes) = bytes {
                let picture = png::decode(&bytes)?;
                return Ok(Some(self.twin.crew.together(|| self.twin.wear(Some(&picture)))?));
            }
            if self.alone {
                return Ok(Some(self.twin.crew.together(|| self.twin.wear(None))?));
            }
            if self.ended(&self.background) {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// One tree for the whole trajectory: episodes share what they have in common.
    fn commanded(&self, wanted: &BTreeSet<u32>, wear: &Wear) -> Result<NotSimulated, CollectionError> {
        let trajectory = self.dataset.trajectory();
        let roots = grow(trajectory, wanted, &self.twin.model.settings, |i| trajectory.waypoints[i].pose);
        self.walk(&roots, wear)
    }

    /// Every episode as soon as all its captures are measured; those that wait when a walk ends share the next.
    fn measured(&self, wanted: &BTreeSet<u32>, wear: &Wear) -> Result<NotSimulated, CollectionError> {
        let trajectory = self.dataset.trajectory();
        let captures_of =
            |episode: usize| trajectory.waypoints_of(episode as u32).iter().filter_map(|w| w.capture);
        let is_wanted = |episode: &usize| captures_of(*episode).any(|c| wanted.contains(&c));
        let pose_of = |i: usize| -> Pose {
            let commanded = &trajectory.waypoints[i];
            let measured = commanded.capture.and_then(|c| self.dataset.real(c));
            measured.map_or(commanded.pose, |line| line.record.measured)
        };
        let mut awaited: Vec<usize> = (0..trajectory.episodes.len()).filter(is_wanted).collect();
        let mut not_simulated = Vec::new();
        while !awaited.is_empty() {
            // Asked in this order: what came last is seen although the bench has ended since.
            let ended = self.alone || self.ended(&self.measured);
            let is_measured = |episode: &usize| {
                let measured = self.measured.borrow();
                captures_of(*episode).all(|c| measured.contains(&c))
            };
            let (ready, rest): (Vec<_>, Vec<_>) = awaited.into_iter().partition(is_measured);
            awaited = rest;
            if ready.is_empty() {
                if ended {
                    break;
                }
                std::thread::sleep(Duration::from_millis(20));
                continue;
            }
            tracing::debug!(episodes = ?ready, "simulating measured poses");
            let due = ready.into_iter().flat_map(captures_of).filter(|c| wanted.contains(c)).collect();
            let roots = grow(trajectory, &due, &self.twin.model.settings, pose_of);
            not_simulated.extend(self.walk(&roots, wear)?);
        }
        Ok(not_simulated)
    }

    fn walk(
        &self,
        roots: &[crate::twin::branches::Root],
        wear: &Wear,
    ) -> Result<NotSimulated, CollectionError> {
        let not_simulated = Mutex::new(Vec::new());
        let failure = OnceLock::new();
        let emit = |outcome: Outcome| match outcome {
            Outcome::Failed { captures, error } => {
                let why = error.to_string();
                let _ = self
                    .progress
                    .send(Progress::NotSimulated { captures: captures.clone(), why: why.clone() });
                // A push leaves the list whole whatever happens elsewhere.
                not_simulated.lock().unwrap_or_else(PoisonError::into_inner).push((captures, why));
                true
            }
            Outcome::Deformed(deformed) => {
                self.twin.tell_doubts(&deformed, self.dataset.trajectory());
                let stored = self
                    .twin
                    .picture(&deformed.pad, wear, deformed.captures[0])
                    .map_err(CollectionError::from)
                    .and_then(|picture| self.store(&deformed, &picture));
                // The first failure ends the walk; what others fail of after it is not told.
                stored.map_err(|e| failure.set(e)).is_ok()
            }
        };
        let (model, crew) = (&self.twin.model, &self.twin.crew);
        let lattice = self.twin.lattice_for_pictures();
        Walk { model, lattice, crew, cancel: &self.cancel, emit: &emit }.run(roots);
        match failure.into_inner() {
            Some(e) => Err(e),
            None => Ok(not_simulated.into_inner().unwrap_or_else(PoisonError::into_inner)),
        }
    }

    fn store(&self, deformed: &crate::twin::Deformed, picture: &Picture) -> Result<(), CollectionError> {
        let png = png::encode(&picture.image)?;
        let tiff = depth::encode(picture.image.width, picture.image.height, &picture.depth_mm)?;
        let contact = png::encode_mask(&picture.contact)?;
        let (settings, material) = (&self.twin.model.settings, self.twin.model.material());
        for capture in &deformed.captures {
            let (forces, stats) = (&deformed.pad.forces, &deformed.pad.stats);
            let record = SimRecord {
                config_hash: self.dataset.provenance().simulation_hash.clone(),
                engine_version: env!("CARGO_PKG_VERSION").into(),
                pose: deformed.pose,
                poses: self.twin.follow.name().into(),
                elastomer_mode: name_of(&settings.mode),
                law: name_of(&material.law),
                youngs_modulus_mpa: material.youngs_modulus_mpa,
                poisson_ratio: material.poisson_ratio,
                friction: match settings.friction {
                    crate::elastomer::Friction::Infinite => None,
                    crate::elastomer::Friction::Coefficient(mu) => Some(mu),
                },
                // What was truly done: where the fast mode cannot, the reference mode was used.
                optics_mode: picture.method.name().into(),
                spp: picture.method.samples(),
                seed: self.twin.seed,
                elastomer_ms: deformed.took.as_secs_f64() * 1e3,
                render_ms: picture.took.as_secs_f64() * 1e3,
                normal_force_n: forces.normal_force_n,
                shear_force_n: forces.shear_force_n,
                torque_n_mm: forces.torque_n_mm,
                contact_area_mm2: stats.contact_area_mm2,
                held: stats.held,
                contact_box_px: picture.contact_box_px,
                iterations: stats.iterations,
                passes_per_step: stats.passes_per_step,
                limit_hits: stats.limit_hits,
                particles: stats.particles,
                residual: stats.residual,
                estimated_error: stats.estimated_error,
                light_error: picture.estimated_error,
                light_meets_tolerance: picture.meets_tolerance,
            };
            self.dataset.append_sim(*capture, record, &png, &tiff, &contact)?;
            let _ = self.progress.send(Progress::Simulated { capture: *capture });
        }
        Ok(())
    }

    /// Whether what is waited for will not come any more.
    fn ended<T>(&self, watch: &watch::Receiver<T>) -> bool {
        self.cancel.load(Ordering::Relaxed) || watch.has_changed().is_err()
    }
}

/// The name a file would use for a setting.
fn name_of(value: &impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}
