//! A twin from its configuration.

use crate::cache;
use crate::config::{OpticsMode, Setup, TwinPoses};
use crate::optics::store::Store;
use crate::optics::{imager::Method, reference};
use crate::twin::{Crew, Doubts, FollowedPoses, Model, Twin, View};
use std::collections::BTreeMap;

/// Why there can be no twin.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// Nothing says which sensor.
    #[error("this rig names no sensor of its own; give a plan, which names one")]
    NoSensor,
    /// The system refused threads.
    #[error("the twin's threads cannot be started: {0}; lower twin.threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Where prepared sensors are kept, if this user keeps anything.
pub fn optics_store() -> Option<Store> {
    cache::folder().map(|folder| Store::new(folder.join("optics")))
}

/// The twin of a setup.
pub fn twin(setup: &Setup) -> Result<Twin, TwinError> {
    let sensor = setup.sensor.as_ref().ok_or(TwinError::NoSensor)?;
    let (rig, optics) = (&setup.rig, setup.rig.optics);
    let traced = reference::Settings { samples: optics.samples, seed: optics.seed };
    let method = match optics.mode {
        OpticsMode::Reference => Method::Reference(traced),
        OpticsMode::Fast => Method::Fast { tolerance: optics.tolerance, fallback: traced },
    };
    let indenters = setup.plan.as_ref().map_or_else(BTreeMap::new, |p| p.bodies());
    Ok(Twin {
        model: Model { pad: sensor.pad.clone(), settings: rig.elastomer.clone(), indenters },
        view: View {
            sensor: sensor.optics.clone(),
            method,
            store: optics_store(),
            untouched: sensor.untouched.clone(),
        },
        follow: match rig.twin.poses {
            TwinPoses::Commanded => FollowedPoses::Commanded,
            TwinPoses::Measured => FollowedPoses::Measured,
        },
        seed: u64::from(optics.seed),
        crew: Crew::new(rig.twin.threads)?,
        doubts: Doubts::default(),
    })
}
