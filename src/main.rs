//! The `twinrig` program.

fn main() {}
