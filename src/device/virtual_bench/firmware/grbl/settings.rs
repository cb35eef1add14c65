//! The `$` settings: numbered texts whose decimals are kept.

use super::super::motors::Motors;
use super::super::{EmulatorError, EmulatorOptions};
use crate::protocol::emulation::GrblEmulation;

/// Stored settings in the order of `$$`.
#[derive(Debug, Clone)]
pub struct Settings(Vec<(u16, String)>);

impl Settings {
    /// Reads the file's settings. A controller that a rig uses has been set up for it: with the
    /// rig's axes and the `set_up` settings. What the options say comes last.
    pub fn new(
        spec: &GrblEmulation,
        options: &EmulatorOptions,
        motors: &Motors,
        is_wired: bool,
    ) -> Result<Self, EmulatorError> {
        let mut settings = Settings(Vec::new());
        for line in &spec.settings {
            settings.0.push(entry(line)?);
        }
        if is_wired {
            for (i, m) in (0u16..).zip(motors.iter()) {
                let (feed, travel) = (m.max_feed * 60.0, m.max - m.min);
                for (base, value) in [(100, m.counts_per_unit), (110, feed), (120, m.accel), (130, travel)] {
                    settings.set(base + i, value);
                }
            }
        }
        if is_wired || options.set_up {
            for line in &spec.set_up {
                let (key, value) = entry(line)?;
                settings.set(key, value.parse().unwrap_or(0.0));
            }
        }
        for (key, value) in &options.settings {
            let number = key.parse::<u16>().ok();
            let known = settings.0.iter_mut().find(|(k, _)| Some(*k) == number);
            let Some((_, stored)) = known else {
                let allowed = "a setting of this firmware";
                return Err(EmulatorError::Setting { setting: key.clone(), value: value.clone(), allowed });
            };
            stored.clone_from(value);
        }
        Ok(settings)
    }

    /// All settings, in order.
    pub fn iter(&self) -> impl Iterator<Item = &(u16, String)> {
        self.0.iter()
    }

    /// A setting as a number; 0 if there is none.
    pub fn number(&self, key: u16) -> f64 {
        self.0.iter().find(|(k, _)| *k == key).and_then(|(_, v)| v.parse().ok()).unwrap_or(0.0)
    }

    /// A setting as a switch.
    pub fn is_on(&self, key: u16) -> bool {
        self.number(key) as i64 & 1 != 0
    }

    /// Stores a number with the decimals that the setting has; false if there is no such setting.
    pub fn set(&mut self, key: u16, value: f64) -> bool {
        let Some((_, stored)) = self.0.iter_mut().find(|(k, _)| *k == key) else { return false };
        let decimals = stored.split_once('.').map_or(0, |(_, d)| d.len());
        *stored = format!("{value:.decimals$}");
        true
    }
}

fn entry(line: &str) -> Result<(u16, String), EmulatorError> {
    let entry = line.split_once('=').and_then(|(k, v)| Some((k.parse().ok()?, v.to_owned())));
    entry.ok_or_else(|| EmulatorError::Setting {
        setting: "settings".into(),
        value: line.to_owned(),
        allowed: "number=value",
    })
}
