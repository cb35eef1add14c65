//! What needs a real kernel's devices: run by `tests/vm/run` in a virtual machine that has them.
#![cfg(target_os = "linux")]
// What was measured is printed, for whoever runs this by hand.
#![allow(clippy::print_stdout)]
// There is one of each device: tests take turns, over their waits too.
#![allow(clippy::await_holding_lock)]

mod camera;
mod serial;
