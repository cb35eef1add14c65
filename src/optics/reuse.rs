//! What was rendered before and need not be again: pictures of a pad that has not moved since.
//!
//! Captures before contact, after retraction and at rest show the same pad to the bit, and a picture follows from its pad
//! alone: the untouched one and the last are kept. What moved ever so little is rendered: a picture must not depend
//! on those that came before it.

use super::reference::Sight;
use super::{Film, LightBasis, Mesh};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A picture and what it is of.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// The light.
    pub light: Film,
    /// What that is the sum of, where it was rendered light by light.
    pub basis: Option<Basis>,
    /// relRMSE to expect, where it is known.
    pub estimated_error: Option<f64>,
    /// What the centre of each pixel sees.
    pub sights: Vec<Option<Sight>>,
    /// Why the fast mode left it to the reference mode, where it did.
    pub not_fast: Option<String>,
}

/// One picture a light.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    /// The pictures.
    pub films: LightBasis,
    /// relRMSE to expect of each, where it is known.
    pub errors: Option<Vec<f64>>,
}

/// Pictures kept by their pad: the first and the last.
#[derive(Debug, Default)]
pub struct Reuse {
    kept: Mutex<Vec<(Arc<Mesh>, Arc<Seen>)>>,
}

impl Reuse {
    /// The picture of a pad: one that is kept, or what `render` gives.
    ///
    /// # Errors
    /// Those of `render`.
    pub fn or_render<E>(
        &self,
        pad: &Arc<Mesh>,
        render: impl FnOnce() -> Result<Seen, E>,
    ) -> Result<Arc<Seen>, E> {
        let same = |mesh: &Arc<Mesh>| Arc::ptr_eq(mesh, pad) || mesh == pad;
        let found = self.kept().iter().find(|(mesh, _)| same(mesh)).map(|(_, seen)| seen.clone());
        if let Some(seen) = found {
            return Ok(seen);
        }
        let seen = Arc::new(render()?);
        let mut kept = self.kept();
        kept.truncate(1);
        kept.push((pad.clone(), seen.clone()));
        Ok(seen)
    }

    fn kept(&self) -> MutexGuard<'_, Vec<(Arc<Mesh>, Arc<Seen>)>> {
        // A panic elsewhere leaves whole entries behind.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_first_and_the_last_pad_are_not_rendered_again_and_any_other_is() {
        let pad = |z: f32| {
            let at = |k: usize| Vec3::new((k % 3) as f32, (k / 3) as f32, if k == 4 { z } else { 0.0 });
            Arc::new(Mesh::from_lattice(3, 3, (0..9).map(at).collect(), Vec::new()))
        };
        let reuse = Reuse::default();
        let rendered = std::cell::Cell::new(0);
        let picture = |z: f32| {
            let render = || {
                rendered.set(rendered.get() + 1);
                let light = Film { width: 1, height: 1, pixels: vec![Vec3::splat(z)] };
                Ok::<Seen, std::fmt::Error>(Seen {
                    light,
                    basis: None,
                    estimated_error: None,
                    sights: Vec::new(),
                    not_fast: None,
                })
            };
            reuse.or_render(&pad(z), render).unwrap().light.pixels[0].x
        };
        let shown: Vec<f32> = [0.0, 0.0, 0.5, 0.5, 0.0, 0.5000001, 0.5, 0.0].map(picture).to_vec();
        assert_eq!(shown, [0.0, 0.0, 0.5, 0.5, 0.0, 0.5000001, 0.5, 0.0]);
        assert_eq!(rendered.get(), 4);
    }
}
