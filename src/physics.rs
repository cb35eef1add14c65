//! The lower layers of twinrig: its vocabulary, shapes and pictures, the elastomer and the optics. They are a package
//! of their own for the sake of compiling (`physics/Cargo.toml` says why); `twinrig` shows their modules as its own,
//! and its crate doc tells the layers.

pub mod cache;
pub mod clock;
pub mod draw;
pub mod elastomer;
pub mod frame;
pub mod image;
pub mod indenter;
pub mod optics;
pub mod percent;
pub mod pose;
pub mod problem;
pub mod units;
mod wakeful;
