//! twinrig drives a tactile-sensor bench, runs the identical trajectory in a simulator, and stores
//! paired real and simulated datasets.

// Layer 0: vocabulary.
pub mod clock;
pub mod frame;
pub mod pose;
pub mod problem;
pub mod units;
// Layer 1a: shapes, images.
pub mod image;
pub mod indenter;
// Layer 1b: pure domains.
pub mod elastomer;
pub mod motion;
pub mod optics;
pub mod protocol;
// Layer 2: uses of the domains.
pub mod dataset;
pub mod device;
pub mod plan;
// Layer 3a: activities.
// Layer 4a: configuration.
pub mod config;
