//! Where what a sensor needs once is kept between runs.
//!
//! The optics read no environment and no configuration: whoever puts the program together (`assemble`) says which
//! folder, or none.

use super::fast::Precomputed;
use super::{Error, Scene};
use crate::cache;
use std::path::PathBuf;

/// A folder of prepared sensors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store(cache::Store);

/// Files that hold one each; about forty sensors of 640 x 480 pixels.
const KIND: cache::Kind = cache::Kind { magic: *b"twinrig optics 1", what: "sensor", most_bytes: 1 << 30 };

impl Store {
    /// In a folder, which is made when something is to be kept.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self(cache::Store::new(folder, &KIND))
    }

    /// Takes the sensor from the folder, or prepares it and keeps it; and whether it was there.
    ///
    /// # Errors
    /// When the scene is none for the fast mode.
    pub fn prepare(&self, untouched: &Scene) -> Result<(Precomputed, bool), Error> {
        let key = Precomputed::key(untouched);
        let decoded = |content: &[u8]| Precomputed::decode(untouched, content).transpose();
        if let Some(once) = self.0.take(&key, decoded) {
            return once.map(|once| (once, true));
        }
        let once = Precomputed::new(untouched)?;
        self.0.keep(&key, &once.encode());
        Ok((once, false))
    }
}
