//! The shipped files, built into the program so that it works from any directory.
//!
//! A test compares this list with the folders: a file that is added must be listed.

use super::lookup::Kind;
use std::path::Path;

macro_rules! shipped {
    ($folder:literal: $($name:literal)*) => {
        &[$(($name, include_str!(concat!("../../", $folder, "/", $name, ".toml")))),*]
    };
}

const RIGS: &[(&str, &str)] =
    shipped!("rig_configs": "virtual" "gelsight_printer" "servo_arm" "skin_marlin_grbl");

const PLANS: &[(&str, &str)] = shipped!("rig_configs/plans": "press" "slip" "rotate" "small");

const SENSORS: &[(&str, &str)] =
    shipped!("rig_configs/sensors": "digit" "domed" "gelsight" "gelsight_fots" "gelsight_markers" "skin");

const INDENTERS: &[(&str, &str)] = shipped!("rig_configs/indenters":
    "cone" "cross_lines" "curved_surface" "cylinder" "cylinder_shell" "cylinder_side" "dot_in" "dots"
    "flat_slab" "hexagon" "line" "moon" "pacman" "parallel_lines" "prism" "random" "sphere" "sphere2"
    "torus" "triangle" "wave1");

const PROTOCOLS: &[(&str, &str)] = shipped!("firmware_protocols":
    "dobot_magician" "dynamixel2" "dynamixel_p" "feetech_sts" "grbl" "grblhal" "marlin" "newport_smc100" "pi_gcs2"
    "thorlabs_apt" "thorlabs_apt_stepper" "zaber_ascii");

/// Pictures that shipped sensor files name.
const PICTURES: &[(&str, &[u8])] =
    &[("gelsight_fots.png", include_bytes!("../../rig_configs/sensors/gelsight_fots.png"))];

fn all(kind: Kind) -> &'static [(&'static str, &'static str)] {
    match kind {
        Kind::Rig => RIGS,
        Kind::Plan => PLANS,
        Kind::Sensor => SENSORS,
        Kind::Indenter => INDENTERS,
        Kind::Protocol => PROTOCOLS,
    }
}

/// Names of the shipped files of a kind.
pub fn names(kind: Kind) -> impl Iterator<Item = &'static str> {
    all(kind).iter().map(|(name, _)| *name)
}

/// The text of a shipped file.
pub fn text(kind: Kind, name: &str) -> Option<&'static str> {
    all(kind).iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

/// A picture that a shipped sensor file names.
pub fn picture(path: &Path) -> Option<&'static [u8]> {
    PICTURES.iter().find(|(name, _)| Path::new(name) == path).map(|(_, bytes)| *bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::sensor::SensorFile;
    use crate::problem::Problems;
    use std::collections::BTreeSet;

    #[test]
    fn what_a_shipped_sensor_wears_needs_no_folder() {
        for name in names(Kind::Sensor) {
            let file: SensorFile = toml::from_str(text(Kind::Sensor, name).unwrap()).unwrap();
            let mut problems = Problems::new();
            let checked = file.check(Some(name), None, &mut problems);
            assert!(problems.is_empty(), "{name}: {problems:?}");
            assert_eq!(checked.untouched.is_some(), file.untouched.is_some(), "{name}");
        }
    }

    #[test]
    fn the_list_is_what_lies_in_the_folders() {
        for kind in [Kind::Rig, Kind::Plan, Kind::Sensor, Kind::Indenter, Kind::Protocol] {
            let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(kind.folder());
            let files: BTreeSet<String> = std::fs::read_dir(folder)
                .unwrap()
                .map(|e| e.unwrap().path())
                .filter(|p| p.extension().is_some_and(|e| e == "toml"))
                .map(|p| p.file_stem().unwrap().to_str().unwrap().to_owned())
                .collect();
            assert_eq!(names(kind).map(str::to_owned).collect::<BTreeSet<_>>(), files, "{kind:?}");
        }
    }
}
