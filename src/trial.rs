//! Trials of the elastomer: how fast and how right it is, and what it takes; and of what its presses leave to the optics.
//!
//! [`bench`] measures (throughput, time to solution, error against run time, what is saved by skipping);
//! [`stress`] hunts for an answer that is wrong without saying so. Both give plain data; the command line prints
//! it. [`still_light`] tells how much of a picture a deeper press leaves as it was. [`scene`] holds what they share: the pad of the published figures, spheres, and how surfaces are compared.
//!
//! **What it does not do.** No files but those that [`bench::files`] is asked to write, no processes: whoever wants
//! a case that can be stopped runs it in a process of its own.

pub mod bench;
pub mod features;
pub mod scene;
pub mod still_light;
pub mod stress;
