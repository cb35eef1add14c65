//! A sensor by itself: by the path of its file, or by its name.

use super::document::{Document, Reading};
use super::lookup::{Kind, Lookup, NotFound, by_path};
use super::report::{ConfigError, Finding};
use super::sensor::{SensorConfig, SensorFile};
use std::path::Path;

/// Reads and checks a sensor: a file, or a name of those in `rig_configs/sensors/` and of the shipped ones. A file need not be
/// called as its sensor: nobody asks for that by its name, and a changed copy goes by any.
///
/// # Errors
/// When there is none of that path or name, or with everything that is wrong in it.
pub fn sensor_file(path_or_name: &Path) -> Result<SensorConfig, ConfigError> {
    let is_name = path_or_name.extension().is_none() && path_or_name.components().count() == 1;
    let found = match path_or_name.to_str() {
        Some(name) if is_name => Lookup::default().find(Kind::Sensor, name),
        _ => by_path(Kind::Sensor, path_or_name),
    };
    let mut findings = Vec::new();
    let sensor = match found {
        Ok(source) => {
            let (stem, folder) = (is_name.then(|| source.name.clone()), source.folder.clone());
            Document::parse(source, &mut findings).and_then(|document| {
                let check = |file: &SensorFile, problems: &mut _| {
                    file.check(stem.as_deref(), folder.as_deref(), problems)
                };
                document.read(check, &mut findings).and_then(Reading::into_sound)
            })
        }
        Err(NotFound { asked, allowed, next }) => {
            let file = path_or_name.display().to_string();
            findings.push(Finding { file, at: None, key: String::new(), value: asked, allowed, next });
            None
        }
    };
    sensor.filter(|_| findings.is_empty()).ok_or(ConfigError { findings })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_is_found_by_its_name_and_by_its_file_and_all_that_is_wrong_is_told() {
        assert_eq!(sensor_file(Path::new("digit")).unwrap().name, "digit");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        let text = include_str!("../../rig_configs/sensors/gelsight.toml");
        std::fs::write(&path, text).unwrap();
        assert_eq!(sensor_file(&path).unwrap().optics.lights.len(), 4);
        std::fs::write(&path, text.replace("energy = 1000.0", "radiance = [1.0, 2.0, 3.0]")).unwrap();
        let keys: Vec<String> =
            sensor_file(&path).unwrap_err().findings.into_iter().map(|finding| finding.key).collect();
        assert!(keys.iter().any(|key| key == "optics.lights[1].radiance"), "{keys:?}");
        assert!(!keys.iter().any(|key| key == "name"), "{keys:?}");
        let near = sensor_file(Path::new("gelsigt")).unwrap_err();
        assert!(near.findings[0].next.contains("gelsight"), "{near}");
    }
}
