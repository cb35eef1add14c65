//! What cameras are connected, in which modes they work, and what can be set on them.

use serde::Serialize;

/// One camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraListing {
    /// What to write as `source`.
    pub source: String,
    /// What to write as `device`: the path by identity where there is one.
    pub device: String,
    /// The device node or index.
    pub node: String,
    /// Name of the card.
    pub name: String,
    /// Driver and bus.
    pub driver: String,
    /// Modes it works in.
    pub modes: Vec<CameraMode>,
    /// What can be set.
    pub controls: Vec<ControlListing>,
    /// Why less is known than should be.
    pub problem: Option<String>,
}

/// One pixel format at one size, or a range of sizes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraMode {
    /// Pixel format.
    pub fourcc: String,
    /// Whether we can decode it.
    pub decodable: bool,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Largest size, where `width` x `height` is the smallest of a range.
    pub up_to: Option<[u32; 2]>,
    /// Frame rates, 1/s.
    pub frames_per_second: Vec<f64>,
}

/// One control.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ControlListing {
    /// What to write in `[camera.controls]`.
    pub name: String,
    /// The same as a number.
    pub id: u32,
    /// Smallest value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Distance between values.
    pub step: u64,
    /// Value after power-up.
    pub default: i64,
    /// Value now, where it can be read.
    pub value: Option<i64>,
    /// Names of the values of a menu.
    pub menu: Vec<(i64, String)>,
}

impl std::fmt::Display for CameraListing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "  {}  {} ({}), source = \"{}\"", self.device, self.name, self.driver, self.source)?;
        if let Some(problem) = &self.problem {
            write!(f, "\n    {problem}")?;
        }
        for mode in self.modes.iter().filter(|mode| mode.decodable) {
            write!(f, "\n    {} {}x{}", mode.fourcc, mode.width, mode.height)?;
            if let Some([width, height]) = mode.up_to {
                write!(f, " to {width}x{height}")?;
            }
            let rates: Vec<String> = mode.frames_per_second.iter().map(|r| format!("{r:.0}")).collect();
            if !rates.is_empty() {
                write!(f, " at {} /s", rates.join(", "))?;
            }
        }
        let mut others: Vec<&str> =
            self.modes.iter().filter(|mode| !mode.decodable).map(|mode| mode.fourcc.trim()).collect();
        others.dedup();
        if !others.is_empty() {
            write!(f, "\n    not decoded by this program: {}", others.join(" "))?;
        }
        for control in &self.controls {
            let value = control.value.map_or_else(|| "?".to_owned(), |v| v.to_string());
            write!(
                f,
                "\n    {} = {value} ({} to {}, default {})",
                control.name, control.min, control.max, control.default
            )?;
        }
        Ok(())
    }
}

/// All cameras of this machine.
pub fn list() -> Vec<CameraListing> {
    #[cfg(target_os = "linux")]
    return super::v4l::list();
    #[cfg(any(target_os = "macos", target_os = "windows"))]
    return super::nokhwa::list();
    #[allow(unreachable_code)]
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_chosen_is_listed_in_full_and_the_rest_in_a_line() {
        let mode = |fourcc: &str, decodable, width| CameraMode {
            fourcc: fourcc.into(),
            decodable,
            width,
            height: 480,
            up_to: None,
            frames_per_second: vec![15.0, 30.0],
        };
        let modes = vec![
            mode("YUYV", true, 640),
            mode("H264", false, 640),
            mode("H264", false, 320),
            mode("Y10 ", false, 640),
        ];
        let listing = CameraListing {
            source: "v4l".into(),
            device: "/dev/video0".into(),
            node: "/dev/video0".into(),
            name: "vivid".into(),
            driver: "vivid".into(),
            modes,
            controls: vec![],
            problem: None,
        };
        let lines: Vec<String> = listing.to_string().lines().map(|l| l.trim().to_owned()).collect();
        assert_eq!(lines[1..], ["YUYV 640x480 at 15, 30 /s", "not decoded by this program: H264 Y10"]);
    }
}
