//! Locking: the controls of the rig file, set in order and read back.
//!
//! A control that the camera lacks, cannot set, or rounds to another value is an error: a dataset whose
//! exposure was thought to be locked is worth less than none.

use super::ioctl::{self, ControlInfo};
use super::{CameraError, CameraSettings, ControlListing, controls};
use ::v4l::Device;
use controls::ControlId;

/// A control as it reads back.
pub struct Locked {
    /// Number.
    pub id: u32,
    /// Name as `v4l2-ctl` writes it.
    pub name: String,
    /// Value.
    pub value: i64,
}

/// Sets the controls of the settings and returns them as read back, in the order set.
pub fn lock(device: &Device, settings: &CameraSettings, camera: &str) -> Result<Vec<Locked>, CameraError> {
    let handle = device.handle();
    let known = ioctl::controls(&handle);
    let mut wanted: Vec<(&ControlInfo, i64)> = Vec::new();
    for (key, value) in &settings.controls {
        let refused = |given: String| CameraError::Control {
            camera: camera.to_owned(),
            control: key.clone(),
            asked: *value,
            given,
        };
        let info = resolve(&known, key).ok_or_else(|| refused("no such control".into()))?;
        if !info.is_settable() {
            return Err(refused("a control that cannot be set".into()));
        }
        wanted.push((info, *value));
    }
    wanted.sort_by_key(|(info, _)| (controls::rank(info.id), info.id));

    for (info, value) in &wanted {
        let refused = |given: String| CameraError::Control {
            camera: camera.to_owned(),
            control: controls::comparable(&info.name),
            asked: *value,
            given,
        };
        let raw = i32::try_from(*value).map_err(|_| refused("a number too large for a control".into()))?;
        ioctl::set(&handle, info.id, raw)
            .map_err(|e| refused(format!("{e} (allowed: {} to {})", info.min, info.max)))?;
    }
    // Only now, all of them: a later control may have changed an earlier one.
    let mut locked = Vec::new();
    for (info, value) in wanted.into_iter().filter(|(info, _)| info.is_readable()) {
        let name = controls::comparable(&info.name);
        let refused = |given: String| CameraError::Control {
            camera: camera.to_owned(),
            control: name.clone(),
            asked: value,
            given,
        };
        match ioctl::get(&handle, info.id) {
            Ok(read) if read == value => locked.push(Locked { id: info.id, name, value }),
            Ok(read) => {
                return Err(refused(format!("{read} (allowed: {} to {})", info.min, info.max)));
            }
            Err(e) => return Err(refused(e.to_string())),
        }
    }
    Ok(locked)
}

/// The control that a key of `[camera.controls]` names.
fn resolve<'a>(known: &'a [ControlInfo], key: &str) -> Option<&'a ControlInfo> {
    let by_name = |name: &str| known.iter().find(|info| controls::comparable(&info.name) == name);
    match controls::parse(key) {
        ControlId::Number(id) => {
            known.iter().find(|info| info.id == id).or_else(|| by_name(&controls::comparable(key)))
        }
        ControlId::DriverName(name) => by_name(&name),
    }
}

/// All controls that hold one number, for `twinrig devices`.
pub fn listing(device: &Device) -> Vec<ControlListing> {
    let handle = device.handle();
    let menu = |info: &ControlInfo| -> Vec<(i64, String)> {
        if !info.is_menu() {
            return Vec::new();
        }
        let last = info.max.min(info.min + 255);
        (info.min.max(0)..=last)
            .filter_map(|i| Some((i, ioctl::menu_item(&handle, info, i as u32)?)))
            .collect()
    };
    ioctl::controls(&handle)
        .into_iter()
        .filter(ControlInfo::is_settable)
        .map(|info| ControlListing {
            name: controls::comparable(&info.name),
            value: info.is_readable().then(|| ioctl::get(&handle, info.id).ok()).flatten(),
            menu: menu(&info),
            id: info.id,
            min: info.min,
            max: info.max,
            step: info.step,
            default: info.default,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(id: u32, name: &str) -> ControlInfo {
        let name = name.to_owned();
        ControlInfo { id, name, kind: 1, min: 0, max: 9, step: 1, default: 0, flags: 0 }
    }

    #[test]
    fn keys_resolve_by_number_by_standard_name_and_by_the_drivers_own() {
        let known = [
            info(0x0098_0913, "Gain"),
            info(0x009a_0901, "Auto Exposure"),
            info(0x00f0_f000, "Test Pattern"),
        ];
        let id = |key: &str| resolve(&known, key).map(|i| i.id);
        assert_eq!(id("gain"), Some(0x0098_0913));
        assert_eq!(id("exposure_auto"), Some(0x009a_0901));
        assert_eq!(id("test_pattern"), Some(0x00f0_f000));
        assert_eq!(id("0x00f0f000"), Some(0x00f0_f000));
        assert_eq!(id("focus_absolute"), None);
    }
}
