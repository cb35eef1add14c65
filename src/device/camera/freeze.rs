//! Freezing a camera: from automatics that have found their values to a lock at these values.
//!
//! The rig file's lock says what every picture of a dataset is taken with. Its values are found once, by
//! letting exposure, gain, white balance and focus settle on a scene that is typical, and writing down what they
//! settled on. Here is which controls that concerns; setting and reading back is the business of the source.

use super::controls;
use super::list::ControlListing;
use std::collections::BTreeMap;

/// An automatic, the value that switches it off, and what it governs.
const AUTOMATICS: [(u32, i64, &[u32]); 5] = [
    // V4L2_EXPOSURE_MANUAL is 1; 0 and 3 are automatic.
    (0x009a_0901, 1, &[0x009a_0902]),
    // The automatic may lengthen the frame period otherwise.
    (0x009a_0903, 0, &[]),
    (0x0098_090c, 0, &[0x0098_091a]),
    (0x0098_0912, 0, &[0x0098_0913]),
    (0x009a_090c, 0, &[0x009a_090a]),
];

/// Without an automatic, and yet part of how a picture looks.
const OTHERS: [u32; 2] = [0x0098_0918, 0x0098_091c];

/// The lock that keeps a camera as it is now: keys and values of `[camera.controls]`.
///
/// Controls that the camera lacks are left out; a value that is governed but cannot be read is left to the
/// manual setting that the camera has when the automatic goes off.
pub fn freeze(now: &[ControlListing]) -> BTreeMap<String, i64> {
    let mut lock = BTreeMap::new();
    let mut keep = |id: u32, value: Option<i64>| {
        let Some(control) = now.iter().find(|c| c.id == id) else { return false };
        let Some(value) = value.or(control.value) else { return false };
        let has = control.menu.is_empty() || control.menu.iter().any(|(v, _)| *v == value);
        let is_possible = (control.min..=control.max).contains(&value) && has;
        if is_possible {
            lock.insert(control.name.clone(), value);
        }
        is_possible
    };
    for (automatic, off, governed) in AUTOMATICS {
        keep(automatic, Some(off));
        for id in governed {
            keep(*id, None);
        }
    }
    for id in OTHERS {
        keep(id, None);
    }
    lock
}

/// Automatics of a camera that a lock leaves on, by name: each would change pictures behind one's back.
pub fn left_on(now: &[ControlListing], lock: &BTreeMap<String, i64>) -> Vec<String> {
    let locked = |id: u32| lock.keys().any(|key| controls::parse(key) == controls::ControlId::Number(id));
    let is_on = |id: u32, off: i64| now.iter().find(|c| c.id == id).filter(|c| c.value != Some(off));
    AUTOMATICS
        .iter()
        .filter(|(id, ..)| !locked(*id))
        .filter_map(|(id, off, _)| Some(is_on(*id, *off)?.name.clone()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn control(id: u32, name: &str, value: Option<i64>, menu: &[i64]) -> ControlListing {
        let menu = menu.iter().map(|v| (*v, format!("item {v}"))).collect();
        ControlListing { name: name.into(), id, min: 0, max: 5000, step: 1, default: 0, value, menu }
    }

    #[test]
    fn automatics_go_off_and_what_they_found_stays() {
        let webcam = [
            control(0x009a_0901, "auto_exposure", Some(3), &[1, 3]),
            control(0x009a_0902, "exposure_time_absolute", Some(156), &[]),
            control(0x009a_0903, "exposure_dynamic_framerate", Some(1), &[]),
            control(0x0098_090c, "white_balance_automatic", Some(1), &[]),
            control(0x0098_091a, "white_balance_temperature", Some(4600), &[]),
            control(0x0098_0913, "gain", Some(64), &[]),
            control(0x0098_0918, "power_line_frequency", Some(2), &[0, 1, 2]),
            control(0x0098_0900, "brightness", Some(0), &[]),
        ];
        let expected = [
            ("auto_exposure", 1),
            ("exposure_dynamic_framerate", 0),
            ("exposure_time_absolute", 156),
            ("power_line_frequency", 2),
            ("white_balance_automatic", 0),
            ("white_balance_temperature", 4600),
        ];
        let lock = freeze(&webcam);
        let mut expected: BTreeMap<String, i64> = expected.map(|(k, v)| (k.to_owned(), v)).into();
        // Gain has no automatic here, and is part of the look all the same.
        expected.insert("gain".into(), 64);
        assert_eq!(lock, expected);
        assert!(left_on(&webcam, &lock).is_empty());
        let all = ["auto_exposure", "exposure_dynamic_framerate", "white_balance_automatic"];
        assert_eq!(left_on(&webcam, &BTreeMap::new()), all);
        // The rig file may use the older names.
        let older = [("exposure_auto".to_owned(), 1)].into();
        assert!(!left_on(&webcam, &older).contains(&"auto_exposure".to_owned()));
    }

    #[test]
    fn a_menu_without_manual_is_left_alone() {
        let odd = [
            control(0x009a_0901, "auto_exposure", Some(0), &[0, 3]),
            control(0x009a_0902, "exposure_time_absolute", None, &[]),
        ];
        assert!(freeze(&odd).is_empty());
        assert_eq!(left_on(&odd, &BTreeMap::new()), ["auto_exposure"]);
    }
}
