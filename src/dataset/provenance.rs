//! Where a dataset comes from: everything needed to make it again, and to refuse what does not belong.

use super::Error;
use serde::{Deserialize, Serialize};

/// Version of the layout on disk.
pub const SCHEMA: &str = "1.1.0";

/// The content of `dataset.json`, written once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the layout on disk.
    pub schema: String,
    /// Version of the program that made it.
    pub tool_version: String,
    /// When it was begun, RFC 3339, UTC.
    pub created_utc: String,
    /// Name of the rig.
    pub rig: String,
    /// Name of the plan.
    pub plan: String,
    /// Name of the sensor.
    pub sensor: String,
    /// Whether the real side is made up by the virtual bench.
    pub real_is_virtual: bool,
    /// How many captures the trajectory has.
    pub captures: u32,
    /// Split of each capture, by index.
    pub splits: Vec<String>,
    /// Seed of everything random.
    pub seed: u64,
    /// BLAKE3 of the trajectory.
    pub trajectory_hash: String,
    /// BLAKE3 of what the rig file says about devices, motion and camera, overrides included.
    pub rig_hash: String,
    /// BLAKE3 of everything that determines the simulation.
    pub simulation_hash: String,
    /// The rig file, verbatim.
    pub rig_toml: String,
    /// The plan file, verbatim.
    pub plan_toml: String,
    /// The sensor file, verbatim.
    pub sensor_toml: String,
    /// Overrides of the command line, in order.
    pub overrides: Vec<String>,
}

impl Provenance {
    /// Refuses to continue a dataset that another rig, plan or simulation began.
    pub fn must_match(&self, asked: &Provenance, dataset: &std::path::Path) -> Result<(), Error> {
        let major = |v: &str| v.split('.').next().map(str::to_owned);
        let pairs = [
            (
                "another version of the layout",
                major(&self.schema).unwrap_or_default(),
                major(&asked.schema).unwrap_or_default(),
            ),
            ("another rig", self.rig.clone(), asked.rig.clone()),
            ("another plan", self.plan.clone(), asked.plan.clone()),
            ("another sensor", self.sensor.clone(), asked.sensor.clone()),
            ("another trajectory", self.trajectory_hash.clone(), asked.trajectory_hash.clone()),
            ("other devices in the rig file", self.rig_hash.clone(), asked.rig_hash.clone()),
            ("other simulation settings", self.simulation_hash.clone(), asked.simulation_hash.clone()),
        ];
        match pairs.into_iter().find(|(_, has, wants)| has != wants) {
            None => Ok(()),
            Some((what, has, wants)) => Err(Error::Belongs {
                dataset: dataset.to_owned(),
                what,
                has: short(&has),
                wants: short(&wants),
            }),
        }
    }
}

/// Hashes are told by their first twelve digits.
fn short(text: &str) -> String {
    let is_hash = text.len() == 64 && text.bytes().all(|b| b.is_ascii_hexdigit());
    if is_hash { text[..12].to_owned() } else { text.to_owned() }
}
