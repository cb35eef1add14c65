//! What was measured on.

use crate::elastomer::mpm::lanes::Isa;
use serde::Serialize;

/// A machine as far as it matters for a time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Machine {
    /// Cores that this process may use.
    pub cores: usize,
    /// Model of the processor.
    pub cpu: String,
    /// Instruction set of the kernels.
    pub simd: &'static str,
    /// Operating system and architecture.
    pub system: String,
    /// Processes that wanted to run in the minute before; none where the system does not say.
    pub load_before: Option<f64>,
    /// Whether the program was built without optimisation.
    pub debug_build: bool,
}

impl Machine {
    /// This one.
    pub fn here() -> Machine {
        let read = |path: &str| std::fs::read_to_string(path).ok();
        let model = read("/proc/cpuinfo").and_then(|text| {
            let line = text.lines().find(|l| l.starts_with("model name"))?;
            line.split_once(':').map(|(_, name)| name.trim().to_owned())
        });
        let load = read("/proc/loadavg").and_then(|text| text.split(' ').next()?.parse().ok());
        Machine {
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            cpu: model.unwrap_or_else(|| "unknown processor".into()),
            simd: Isa::best().name(),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load_before: load,
            debug_build: cfg!(debug_assertions),
        }
    }
}
