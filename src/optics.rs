//! The optics: what the camera inside the sensor sees of a deformed pad.
//!
//! A [`Scene`] is a pad surface, a housing, perhaps a clear plate, a lens and baffles, lights and a camera. The
//! [`reference`] renderer estimates its picture by path tracing, unbiased up to the scene's event
//! limit; it judges every faster method. What a sensor is made of is data ([`sensor`], built by
//! [`sensor_scene`]), and what a camera makes of linear light is a stage of its own ([`imaging`]).
//! [`imager`] puts them together: surface in, 8-bit picture and depth map out.
//!
//! Who else shares the work: the twin brings surfaces and keeps pictures; the elastomer is unknown here.
//!
//! Terms. *Radiance* is linear RGB without unit (a light's 1.0 is white of energy 100 in the paper's table).
//! *Event*: a scattering at a surface between camera and light; the light's own emission is none.
//! *Scene frame*: x right, y up, z towards the camera, mm; it is the pad frame of [`crate::pose`]
//! turned by 180 degrees about x ([`from_pad`], [`to_pad`]). Everything of a [`Scene`] is in the scene frame,
//! every border of this module to the twin is in the pad frame.
//!
//! What it does not do: subsurface scattering, spectra, polarisation, motion blur.

pub mod accel;
pub mod basis;
pub mod basis_folder;
pub mod bench;
pub mod bench_scene;
pub mod blur;
pub mod bsdf;
pub mod camera;
pub mod clearance;
pub mod emitter;
pub mod fast;
pub mod film;
pub mod ggx;
pub mod grain;
pub mod imager;
pub mod imaging;
pub mod irradiance;
pub mod judge;
pub mod lens_mesh;
pub mod light;
pub mod markers;
pub mod material;
pub mod mesh;
pub mod noise;
pub mod overlap;
#[cfg(test)]
mod pearson;
pub mod ratio;
pub mod reference;
pub mod render_file;
pub mod response;
pub mod reuse;
pub mod sampler;
pub mod scale;
pub mod scene;
pub mod sensor;
pub mod sensor_basis;
pub mod sensor_scene;
pub mod shape;
pub mod sightline;
pub mod store;
pub mod stress;
pub mod surface;
pub mod texture;
pub mod trial;

pub use basis::LightBasis;
pub use camera::Camera;
pub use film::Film;
pub use light::{Light, LightShape};
pub use material::{Albedo, Material};
pub use mesh::Mesh;
pub use scene::{Role, Scene, Surface};
pub use sensor::SensorOptics;
pub use surface::DisplacedSurface;
pub use texture::Texture;

use glam::Vec3;

/// Maps a point or direction of the pad frame into the scene frame.
pub fn from_pad(p: Vec3) -> Vec3 {
    Vec3::new(p.x, -p.y, -p.z)
}

/// Maps a point or direction of the scene frame into the pad frame; the inverse of [`from_pad`].
pub fn to_pad(p: Vec3) -> Vec3 {
    Vec3::new(p.x, -p.y, -p.z)
}

/// Why a picture could not be rendered. Every message says what to change.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("cannot {action} {path}: {reason}; check the path and its permissions")]
    File {
        /// `read` or `write`.
        action: &'static str,
        /// The file.
        path: String,
        /// What the system said.
        reason: String,
    },
    /// A scene file does not follow its format.
    #[error("the scene file {path} is not a tactile-bench scene: {reason}; {next}")]
    SceneFormat {
        /// The file, or `<text>`.
        path: String,
        /// What is wrong.
        reason: String,
        /// What to do about it.
        next: String,
    },
    /// A part of the scene cannot be rendered.
    #[error("{part} of the scene: {what}; {next}")]
    Scene {
        /// The surface, light or camera concerned.
        part: String,
        /// What is wrong with it.
        what: String,
        /// What to do about it.
        next: String,
    },
    /// The fast mode has no way to render this; the reference mode has.
    #[error("{key} = {value}: the fast mode renders {what}; the reference mode has no such limit")]
    NotFast {
        /// What of the scene.
        key: &'static str,
        /// The offending value.
        value: String,
        /// What the fast mode can do.
        what: String,
    },
    /// A file was read, but is not what it should be.
    #[error("{path}: {reason}; {next}")]
    Content {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
        /// What to do about it.
        next: &'static str,
    },
    /// What the caller gave makes no sense, by itself or together with the rest.
    #[error("{name} = {value}: {why}")]
    Argument {
        /// What the caller calls it, e.g. an option of the command line.
        name: &'static str,
        /// The offending value.
        value: String,
        /// The allowed range and the next move.
        why: String,
    },
    /// A setting makes no sense together with the scene.
    #[error("optics.{key} = {value}: {why}")]
    Setting {
        /// Key below `[optics]`.
        key: &'static str,
        /// The offending value.
        value: String,
        /// The allowed range and the next move.
        why: String,
    },
}
