//! Devices: what moves, and what sees.
//!
//! A *mover* is any serial device with axes; what differs between firmwares is data. A *camera*
//! hands over frames with the proof of when they were exposed. The *virtual bench* imitates both,
//! down to the bytes and the delays. Nothing here sees a rig file, a plan or a dataset.

pub mod byte_log;
pub mod camera;
pub mod kinematics;
pub mod link;
pub mod mover;
pub mod port;
pub mod replay;
pub mod settings;
pub mod virtual_bench;
