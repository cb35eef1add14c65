//! Camera controls: their names, their ids, and the order in which a lock holds.
//!
//! A value that an automatic still owns is refused or overwritten by the driver, so every automatic is
//! switched off before the value it governs is set. Ids are those of `linux/v4l2-controls.h`; names are
//! those that `v4l2-ctl` prints, old and new ones, or the driver's own, compared without case and marks.

/// Standard controls with their names, in locking order: each automatic before what it governs.
const LOCKING_ORDER: [(u32, &[&str]); 14] = [
    (0x009a_0901, &["exposure_auto", "auto_exposure"]),
    (0x009a_0903, &["exposure_auto_priority", "exposure_dynamic_framerate"]),
    (0x009a_0902, &["exposure_absolute", "exposure_time_absolute"]),
    (0x0098_090c, &["white_balance_temperature_auto", "white_balance_automatic"]),
    (0x0098_091a, &["white_balance_temperature"]),
    (0x0098_0912, &["gain_automatic", "autogain"]),
    (0x0098_0913, &["gain"]),
    (0x009a_090c, &["focus_auto", "focus_automatic_continuous"]),
    (0x009a_090a, &["focus_absolute"]),
    (0x0098_0918, &["power_line_frequency"]),
    (0x0098_091c, &["backlight_compensation"]),
    (0x0098_0900, &["brightness"]),
    (0x0098_0901, &["contrast"]),
    (0x0098_0902, &["saturation"]),
];

/// Exposure time in units of 100 us.
pub const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;

/// What a key of `[camera.controls]` stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ControlId {
    /// A control by number.
    Number(u32),
    /// A name that only the driver can resolve, in comparable form.
    DriverName(String),
}

/// Reads a key of `[camera.controls]`: a standard name, `0x...`, or a driver's own name.
pub fn parse(key: &str) -> ControlId {
    let name = comparable(key);
    if let Some(hex) = key.trim().to_ascii_lowercase().strip_prefix("0x")
        && let Ok(id) = u32::from_str_radix(hex, 16)
    {
        return ControlId::Number(id);
    }
    match LOCKING_ORDER.iter().find(|(_, names)| names.contains(&name.as_str())) {
        Some((id, _)) => ControlId::Number(*id),
        None => ControlId::DriverName(name),
    }
}

/// A name as `v4l2-ctl` would write it: lower case, words joined by one underscore.
pub fn comparable(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for c in name.chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_lowercase());
        } else if !out.is_empty() && !out.ends_with('_') {
            out.push('_');
        }
    }
    out.trim_end_matches('_').to_owned()
}

/// Where a control stands in the locking order; those without a place come last.
pub fn rank(id: u32) -> usize {
    LOCKING_ORDER.iter().position(|(known, _)| *known == id).unwrap_or(LOCKING_ORDER.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_automatic_comes_before_what_it_governs() {
        let pairs = [
            (0x009a_0901, 0x009a_0902),
            (0x0098_090c, 0x0098_091a),
            (0x0098_0912, 0x0098_0913),
            (0x009a_090c, 0x009a_090a),
        ];
        for (automatic, value) in pairs {
            assert!(rank(automatic) < rank(value), "{automatic:#x} before {value:#x}");
        }
        assert!(rank(0x00f0_f000) > rank(0x0098_0902));
    }

    #[test]
    fn names_old_new_and_foreign_are_understood() {
        assert_eq!(parse("exposure_auto"), parse("Auto Exposure"));
        assert_eq!(parse("exposure_time_absolute"), ControlId::Number(EXPOSURE_ABSOLUTE));
        assert_eq!(parse("0x00F0f027"), ControlId::Number(0x00f0_f027));
        assert_eq!(parse("Exposure (Absolute)"), ControlId::Number(EXPOSURE_ABSOLUTE));
        assert_eq!(parse("Gain, Automatic"), ControlId::Number(0x0098_0912));
        assert_eq!(
            parse("Percentage of Dropped Buffers"),
            ControlId::DriverName("percentage_of_dropped_buffers".into())
        );
    }
}
