//! Where a dataset comes from: everything needed to make it again, and to refuse what does not belong.

use super::Error;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

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
        let names = [
            (
                "another version of the layout",
                major(&self.schema).unwrap_or_default(),
                major(&asked.schema).unwrap_or_default(),
            ),
            ("another rig", self.rig.clone(), asked.rig.clone()),
            ("another plan", self.plan.clone(), asked.plan.clone()),
            ("another sensor", self.sensor.clone(), asked.sensor.clone()),
        ];
        let hashes = [
            ("another trajectory", &self.trajectory_hash, &asked.trajectory_hash),
            ("other devices in the rig file", &self.rig_hash, &asked.rig_hash),
            ("other simulation settings", &self.simulation_hash, &asked.simulation_hash),
        ];
        let belongs = |what, how| Err(Error::Belongs { dataset: dataset.to_owned(), what, how });
        if let Some((what, has, wants)) = names.into_iter().find(|(_, has, wants)| has != wants) {
            return belongs(what, format!("it has {has}, this run has {wants}"));
        }
        match hashes.into_iter().find(|(_, has, wants)| has != wants) {
            None => Ok(()),
            Some((what, ..)) => belongs(what, self.differences(asked)),
        }
    }

    /// The keys of the three files, and the overrides, that are not what they were.
    fn differences(&self, asked: &Provenance) -> String {
        let mut told = Vec::new();
        let files = [
            ("rig file", &self.rig_toml, &asked.rig_toml),
            ("plan file", &self.plan_toml, &asked.plan_toml),
            ("sensor file", &self.sensor_toml, &asked.sensor_toml),
        ];
        for (file, has, wants) in files {
            let (has, wants) = (leaves(has), leaves(wants));
            let keys: BTreeSet<&String> = has.keys().chain(wants.keys()).collect();
            for key in keys.into_iter().filter(|key| has.get(*key) != wants.get(*key)) {
                let shown = |value: Option<&String>| value.map_or("absent", String::as_str).to_owned();
                told.push(format!(
                    "{key} of the {file} was {} and is {}",
                    shown(has.get(key)),
                    shown(wants.get(key))
                ));
            }
        }
        let only = |one: &[String], other: &[String]| -> Vec<String> {
            one.iter().filter(|set| !other.contains(set)).cloned().collect()
        };
        told.extend(
            only(&self.overrides, &asked.overrides).into_iter().map(|s| format!("--set {s} is missing")),
        );
        told.extend(only(&asked.overrides, &self.overrides).into_iter().map(|s| format!("--set {s} is new")));
        if self.tool_version != asked.tool_version {
            told.push(format!("this program was version {}, is {}", self.tool_version, asked.tool_version));
        }
        if told.is_empty() {
            return "rig, plan, sensor and --set are the same: an indenter file that the plan names has changed"
                .to_owned();
        }
        let more = told.len().saturating_sub(MOST_DIFFERENCES);
        told.truncate(MOST_DIFFERENCES);
        let more = if more == 0 { String::new() } else { format!(", and {more} more") };
        format!("{}{more}", told.join(", "))
    }
}

/// So many differences are told.
const MOST_DIFFERENCES: usize = 6;

/// Every value of a file by its dotted key.
fn leaves(text: &str) -> BTreeMap<String, String> {
    fn walk(value: &toml::Value, key: &str, found: &mut BTreeMap<String, String>) {
        match value {
            toml::Value::Table(table) => {
                for (name, inner) in table {
                    let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                    walk(inner, &key, found);
                }
            }
            toml::Value::Array(items) if items.iter().any(toml::Value::is_table) => {
                for (i, inner) in items.iter().enumerate() {
                    walk(inner, &format!("{key}[{i}]"), found);
                }
            }
            other => _ = found.insert(key.to_owned(), other.to_string()),
        }
    }
    let mut found = BTreeMap::new();
    // What is kept was read once; what cannot be parsed has no keys to tell.
    if let Ok(table) = text.parse::<toml::Table>() {
        walk(&toml::Value::Table(table), "", &mut found);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn begun() -> Provenance {
        Provenance {
            schema: SCHEMA.into(),
            tool_version: "0.1.0".into(),
            created_utc: String::new(),
            rig: "bench".into(),
            plan: "slip".into(),
            sensor: "skin".into(),
            real_is_virtual: true,
            captures: 2,
            splits: vec![],
            seed: 0,
            trajectory_hash: "t".into(),
            rig_hash: "r".into(),
            simulation_hash: "s".into(),
            rig_toml: "[elastomer]\ntolerance = 0.01\n[optics]\nseed = 1\n".into(),
            plan_toml: "indenters = [{ name = \"moon\" }]\n".into(),
            sensor_toml: String::new(),
            overrides: vec!["optics.mode=fast".into()],
        }
    }

    #[test]
    fn a_refusal_names_the_keys_that_differ_and_both_values() {
        let begun = begun();
        let mut asked = begun.clone();
        assert!(begun.must_match(&asked, "data".as_ref()).is_ok());
        asked.simulation_hash = "other".into();
        asked.rig_toml = "[elastomer]\ntolerance = 0.02\nmode = \"impm\"\n[optics]\nseed = 1\n".into();
        asked.plan_toml = "indenters = [{ name = \"dot\" }]\n".into();
        asked.overrides = vec!["optics.samples=4".into()];
        let said = begun.must_match(&asked, "data".as_ref()).unwrap_err().to_string();
        for part in [
            "other simulation settings: ",
            "elastomer.mode of the rig file was absent and is \"impm\"",
            "elastomer.tolerance of the rig file was 0.01 and is 0.02",
            "indenters[0].name of the plan file was \"moon\" and is \"dot\"",
            "--set optics.mode=fast is missing",
            "--set optics.samples=4 is new",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert!(!said.contains("optics.seed"), "{said}");
    }
}
