//! To what a folder of results belongs: a run clears what an earlier one of the same plan and sensor left there, and nothing else.

use super::SimulateError;
use super::account::unwritten;
use crate::config::Setup;
use crate::motion::Trajectory;
use std::path::Path;

/// Its file: the hash of the trajectory, and the sensor in a line of its own.
const FILE: &str = "trajectory.blake3";
/// How that line begins.
const SENSOR: &str = "sensor ";

/// The plan and the sensor of a run.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Mark {
    trajectory: String,
    /// None in folders that tell of no sensor.
    sensor: Option<String>,
}

impl Mark {
    pub(super) fn of(trajectory: &Trajectory, setup: &Setup) -> Self {
        let sensor = setup.sensor.as_ref().map(|sensor| sensor.name.clone());
        Self { trajectory: trajectory.hash(), sensor }
    }

    /// Refuses a folder that holds something else: a dataset, or the simulation of another plan or sensor.
    pub(super) fn belongs_in(&self, folder: &Path) -> Result<(), SimulateError> {
        let occupied = |by: String| SimulateError::Occupied { path: folder.to_owned(), by };
        if folder.join("dataset.json").exists() {
            return Err(occupied("a dataset".to_owned()));
        }
        let Some(earlier) = std::fs::read_to_string(folder.join(FILE)).ok().map(|text| Self::read(&text))
        else {
            return Ok(());
        };
        if earlier.trajectory != self.trajectory {
            return Err(occupied("the simulation of another plan".to_owned()));
        }
        match (&earlier.sensor, &self.sensor) {
            (Some(earlier), Some(sensor)) if earlier != sensor => {
                Err(occupied(format!("the simulation of sensor {earlier}, and this is {sensor}")))
            }
            _ => Ok(()),
        }
    }

    /// Marks the folder, which is made where there is none.
    pub(super) fn leave_in(&self, folder: &Path) -> Result<(), SimulateError> {
        std::fs::create_dir_all(folder).map_err(|e| unwritten(folder, &e))?;
        let path = folder.join(FILE);
        let sensor = self.sensor.as_ref().map_or_else(String::new, |name| format!("{SENSOR}{name}\n"));
        std::fs::write(&path, format!("{}\n{sensor}", self.trajectory)).map_err(|e| unwritten(&path, &e))
    }

    fn read(text: &str) -> Self {
        let mut lines = text.lines().map(str::trim);
        let trajectory = lines.next().unwrap_or_default().to_owned();
        let sensor = lines.find_map(|line| line.strip_prefix(SENSOR)).map(str::to_owned);
        Self { trajectory, sensor }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_taken_again_by_its_own_plan_and_sensor_alone() {
        let folder = tempfile::tempdir().unwrap();
        let mark = |trajectory: &str, sensor: &str| Mark {
            trajectory: trajectory.to_owned(),
            sensor: Some(sensor.to_owned()),
        };
        let mine = mark("ab", "gelsight");
        let told =
            |mark: &Mark| mark.belongs_in(folder.path()).err().map(|e| e.to_string()).unwrap_or_default();
        assert_eq!(told(&mine), "");
        mine.leave_in(folder.path()).unwrap();
        assert_eq!(told(&mine), "");
        let other = told(&mark("ab", "digit"));
        for words in ["sensor gelsight", "this is digit", "choose another --out", "remove that folder"] {
            assert!(other.contains(words), "{other}");
        }
        assert!(told(&mark("cd", "gelsight")).contains("another plan"));
        // A folder that tells of no sensor is known by its plan.
        std::fs::write(folder.path().join(FILE), "ab\n").unwrap();
        assert_eq!(told(&mark("ab", "digit")), "");
        std::fs::write(folder.path().join("dataset.json"), "{}").unwrap();
        assert!(told(&mine).contains("a dataset"));
    }
}
