//! Options that several subcommands share.

use crate::optics::fast::TOLERANCES;
use clap::Args;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

/// A rig file with overrides.
#[derive(Debug, Clone, Args)]
pub struct RigOptions {
    /// Rig file, e.g. rig_configs/virtual.toml
    pub rig: PathBuf,
    #[command(flatten)]
    pub overrides: Overrides,
}

/// A rig file and a plan with overrides.
#[derive(Debug, Clone, Args)]
pub struct RigAndPlan {
    /// Rig file, e.g. rig_configs/virtual.toml
    pub rig: PathBuf,
    /// Plan file, e.g. rig_configs/plans/slip.toml
    pub plan: PathBuf,
    #[command(flatten)]
    pub overrides: Overrides,
}

/// Settings overridden on the command line.
#[derive(Debug, Clone, Args)]
pub struct Overrides {
    /// Override a setting (may be repeated): a key of the rig file, or of the plan or the sensor after plan. or
    /// sensor., e.g. --set elastomer.tolerance=0.002 --set plan.repeats=2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// How fast a virtual bench runs.
#[derive(Debug, Clone, Args)]
pub struct Speed {
    /// Run a virtual bench this many times faster than real time (waits are shortened, never skipped)
    #[arg(long, default_value_t = 1.0, value_parser = parse_speed)]
    pub speed: f64,
}

/// A raster as WIDTHxHEIGHT, with so many pixels each way.
pub fn raster(text: &str, allowed: RangeInclusive<usize>) -> Result<[usize; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    parsed.filter(|raster| raster.iter().all(|n| allowed.contains(n))).ok_or_else(|| {
        let (least, most) = (allowed.start(), allowed.end());
        format!("{text:?} is no raster; write WIDTHxHEIGHT with {least} to {most} each, e.g. 320x240")
    })
}

/// A whole number from a range.
pub fn whole<T>(
    allowed: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    move |text| match text.parse() {
        Ok(n) if allowed.contains(&n) => Ok(n),
        _ => Err(format!("{text:?} is not a whole number from {} to {}", allowed.start(), allowed.end())),
    }
}

/// A quantity in this unit. Its range is the bench's, and is checked when that is known, before anything moves.
pub fn quantity(unit: &'static str) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!(
            "{text:?} is not a number of {unit} within the limits of the rig's axes; write e.g. 0.5"
        )),
    }
}

/// A relRMSE that the fast optics may be asked for: the range of a rig file's optics.tolerance.
pub fn tolerance(text: &str) -> Result<f64, String> {
    let [least, most] = TOLERANCES;
    match text.parse::<f64>() {
        Ok(tolerance) if (least..=most).contains(&tolerance) => Ok(tolerance),
        _ => Err(format!("a tolerance is from {least} to {most}; 0.005 asks for half a percent")),
    }
}

fn parse_speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(speed) if (0.1..=1000.0).contains(&speed) => Ok(speed),
        _ => Err(format!("{text:?} is not a speed from 0.1 to 1000; 1 is real time")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_are_numbers_and_finite() {
        assert_eq!(quantity("mm")("-.5"), Ok(-0.5));
        for bad in ["-.5x", "", "nan", "inf"] {
            assert!(quantity("mm")(bad).unwrap_err().contains("number of mm within the limits"), "{bad}");
        }
    }

    #[test]
    fn tolerances_and_rasters_are_told_what_is_allowed() {
        assert_eq!(tolerance("0.01"), Ok(0.01));
        for bad in ["7", "0", "-1", "NaN", "x", "0.00001"] {
            assert!(tolerance(bad).unwrap_err().contains("from 0.0001 to 0.5"), "{bad}");
        }
        assert_eq!(raster("640x480", 1..=640), Ok([640, 480]));
        for bad in ["640", "641x4", "0x4", "4x", "4x-1"] {
            assert!(raster(bad, 1..=640).unwrap_err().contains("1 to 640 each"), "{bad}");
        }
    }
}
