//! Writing into a rig file: keys are set, and everything else stays as its author wrote it, comments included.
//!
//! The new file replaces the old one only when it loads, and says what it was meant to say.

use super::load::load;
use std::collections::BTreeMap;
use std::path::Path;
use toml_edit::{DocumentMut, Item, Table, value};

/// Why a rig file was not changed.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// It cannot be read or written.
    #[error("{path}: {why}; it is as it was")]
    File {
        /// The file.
        path: String,
        /// The system's words.
        why: String,
    },
    /// It cannot be edited.
    #[error("{path} cannot be edited: {why}; write these lines yourself:\n{lines}")]
    Form {
        /// The file.
        path: String,
        /// What is in the way.
        why: String,
        /// What was to be written.
        lines: String,
    },
}

/// Writes `[camera.controls]` of a rig file: keys that are there get new values, others are added, none is
/// removed but those that `replaced` names (other names of what is written).
///
/// # Errors
/// When the file cannot be read, edited or written, or would not load any more. It is then as it was.
pub fn write_controls(
    rig: &Path,
    controls: &BTreeMap<String, i64>,
    replaced: &[String],
) -> Result<(), EditError> {
    let path = rig.display().to_string();
    let lines = controls_toml(controls);
    let file = |e: std::io::Error| EditError::File { path: path.clone(), why: e.to_string() };
    let form = |why: String| EditError::Form { path: path.clone(), why, lines: lines.clone() };
    let text = std::fs::read_to_string(rig).map_err(file)?;
    let new = edited(&text, controls, replaced).map_err(form)?;

    // Tried beside the old one, so that what it names is found.
    let target = rig.canonicalize().map_err(file)?;
    let mut name = std::ffi::OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(".new.toml");
    let trial = target.with_file_name(name);
    std::fs::write(&trial, &new).map_err(file)?;
    let loads = load(&trial, None, &[]).map_err(|e| e.to_string());
    let as_meant = loads.and_then(|setup| {
        let is_there = |(key, value): (&String, &i64)| setup.rig.camera.controls.get(key) == Some(value);
        match controls.iter().all(is_there) {
            true => Ok(()),
            false => Err("the values do not arrive where they are looked for".to_owned()),
        }
    });
    if let Err(why) = as_meant {
        _ = std::fs::remove_file(&trial);
        return Err(form(why));
    }
    let placed = crate::dataset::atomic::place(&target, new.as_bytes(), None);
    _ = std::fs::remove_file(&trial);
    placed.map_err(|e| EditError::File { path, why: e.to_string() })
}

/// The table as a rig file has it.
pub fn controls_toml(controls: &BTreeMap<String, i64>) -> String {
    let lines: Vec<String> = controls.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    format!("[camera.controls]\n{}", lines.join("\n"))
}

/// The text with the controls in it.
fn edited(text: &str, controls: &BTreeMap<String, i64>, replaced: &[String]) -> Result<String, String> {
    let mut document: DocumentMut = text.parse().map_err(|e: toml_edit::TomlError| e.to_string())?;
    let camera =
        document.get_mut("camera").and_then(Item::as_table_like_mut).ok_or("it has no [camera] table")?;
    let table = camera.entry("controls").or_insert_with(|| Item::Table(Table::new()));
    let table = table.as_table_like_mut().ok_or("camera.controls is no table")?;
    for key in replaced {
        table.remove(key);
    }
    for (key, new) in controls {
        match table.get_mut(key) {
            // The comment behind a value stays behind it.
            Some(Item::Value(old)) => {
                let decor = old.decor().clone();
                *old = toml_edit::Value::from(*new);
                *old.decor_mut() = decor;
            }
            _ => _ = table.insert(key, value(*new)),
        }
    }
    Ok(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controls(pairs: &[(&str, i64)]) -> BTreeMap<String, i64> {
        pairs.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect()
    }

    #[test]
    fn comments_stay_and_values_change() {
        let text = "# mine\nschema = 1 # one\n\n[camera] # the eye\nsource = \"v4l\"\n\n[camera.controls]\n\
                    # measured in May\ngain = 3 # low\nauto_exposure = 1\n\n[session]\nstill_rms = 2.0\n";
        let new = edited(text, &controls(&[("gain", 64), ("white_balance_automatic", 0)]), &[]).unwrap();
        assert_eq!(
            new,
            text.replace("gain = 3 # low", "gain = 64 # low")
                .replace("auto_exposure = 1\n", "auto_exposure = 1\nwhite_balance_automatic = 0\n")
        );
        let renamed = edited(text, &controls(&[("exposure_auto", 1)]), &["auto_exposure".into()]).unwrap();
        assert!(renamed.contains("exposure_auto = 1") && !renamed.contains("auto_exposure"), "{renamed}");
    }

    #[test]
    fn a_table_is_added_and_an_inline_one_is_extended() {
        let new = edited("[camera]\nsource = \"v4l\"\n[session]\n", &controls(&[("gain", 1)]), &[]).unwrap();
        assert!(new.contains("[camera.controls]\ngain = 1\n"), "{new}");
        let inline = "[camera]\nsource = \"v4l\"\ncontrols = { gain = 2, focus_auto = 0 }\n";
        let new = edited(inline, &controls(&[("gain", 5)]), &[]).unwrap();
        assert!(new.contains("controls = { gain = 5, focus_auto = 0 }"), "{new}");
        assert!(edited("camera = 3\n", &controls(&[]), &[]).is_err());
    }

    #[test]
    fn a_file_that_would_not_load_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        // A virtual camera has no controls to lock.
        let text = include_str!("../../rig_configs/virtual.toml");
        std::fs::write(&path, text).unwrap();
        let error = write_controls(&path, &controls(&[("gain", 5)]), &[]).unwrap_err();
        assert!(matches!(&error, EditError::Form { lines, .. } if lines.contains("gain = 5")), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");

        let real = text.replace("source = \"virtual\"", "source = \"v4l\"\ndevice = \"0\" # the eye");
        let real = real.replace("sensor = \"any\"", "sensor = \"gelsight\"").replace("[virtual]", "[unused]");
        let real =
            real.split("[unused]").next().unwrap().replace("port = \"virtual\"", "port = \"/dev/ttyX\"");
        let real = real.replacen("/dev/ttyX", "/dev/ttyY", 1);
        std::fs::write(&path, &real).unwrap();
        write_controls(&path, &controls(&[("gain", 5)]), &[]).unwrap();
        let new = std::fs::read_to_string(&path).unwrap();
        assert!(new.contains("device = \"0\" # the eye") && new.contains("gain = 5"), "{new}");
        assert_eq!(load(&path, None, &[]).unwrap().rig.camera.controls["gain"], 5);
    }
}
