//! What goes over the control socket: one JSON line each way.

use crate::config::RigConfig;
use crate::device::mover::Seen;
use crate::pose::Pose;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a session is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// What are you doing, and where are the axes?
    Status,
    /// Stop: decelerate, retract, end; or, `now`, at once, even at the price of the positions.
    Stop {
        /// At once.
        #[serde(default)]
        now: bool,
    },
}

/// What a session answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "answer", rename_all = "snake_case")]
pub enum Answer {
    /// To [`Request::Status`].
    Status(Box<Status>),
    /// To [`Request::Stop`]: every mover's stop has been called.
    Stopped {
        /// The process that stops.
        pid: u32,
        /// Its subcommand.
        command: String,
    },
    /// The request was not understood.
    Refused {
        /// Why.
        why: String,
    },
}

/// What a session is doing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Its process.
    pub pid: u32,
    /// Its subcommand.
    pub command: String,
    /// When it began.
    pub begun_utc: String,
    /// Which rig.
    pub rig: RigKey,
    /// `running`, `controlled` or `emergency`: how hard it is being stopped.
    pub stop: String,
    /// Where the dataset goes.
    pub out: Option<PathBuf>,
    /// How far it is.
    pub progress: Option<Progress>,
    /// The indenter relative to the nominal contact, once every axis has told where it is.
    pub pose: Option<Pose>,
    /// The devices by name.
    pub devices: BTreeMap<String, Seen>,
}

/// How far a session is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// What there is to do.
    pub captures: u64,
    /// Real captures stored.
    pub real: u64,
    /// Simulated captures stored.
    pub simulated: u64,
    /// The indenter at work.
    pub indenter: Option<String>,
}

/// By what a rig is known from outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RigKey {
    /// Its name.
    pub name: String,
    /// Its file, without links.
    pub file: PathBuf,
    /// Whether its devices are emulated.
    pub is_virtual: bool,
    /// Its ports, as the file writes them and as they resolve.
    pub ports: Vec<String>,
}

impl RigKey {
    /// The key of a rig that was read from a file.
    pub fn new(rig: &RigConfig, file: &Path) -> RigKey {
        let mut ports = Vec::new();
        for settings in rig.devices.values().filter(|d| !d.port.is_virtual()) {
            let written = settings.port.to_string();
            let resolved =
                crate::device::port::resolve(&settings.port).ok().and_then(|p| p.canonicalize().ok());
            ports.extend(resolved.map(|p| p.display().to_string()).filter(|p| *p != written));
            ports.push(written);
        }
        RigKey {
            name: rig.name.clone(),
            file: file.canonicalize().unwrap_or_else(|_| file.to_owned()),
            is_virtual: rig.is_virtual(),
            ports,
        }
    }

    /// Whether both mean the same bench: a port is held by one session alone; a virtual bench is known
    /// by its file, and there may be several.
    pub fn is_same_bench(&self, other: &RigKey) -> bool {
        match (self.is_virtual, other.is_virtual) {
            (true, true) => self.file == other.file,
            (false, false) => self.ports.iter().any(|p| other.ports.contains(p)),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(is_virtual: bool, file: &str, ports: &[&str]) -> RigKey {
        let ports = ports.iter().map(|p| (*p).to_owned()).collect();
        RigKey { name: "n".into(), file: file.into(), is_virtual, ports }
    }

    #[test]
    fn a_real_bench_is_known_by_its_ports_and_a_virtual_one_by_its_file() {
        let bench = key(false, "/a.toml", &["/dev/serial/by-id/x", "/dev/ttyUSB0"]);
        assert!(bench.is_same_bench(&key(false, "/b.toml", &["/dev/ttyUSB0"])));
        assert!(!bench.is_same_bench(&key(false, "/a.toml", &["/dev/ttyUSB1"])));
        assert!(key(true, "/v.toml", &[]).is_same_bench(&key(true, "/v.toml", &[])));
        assert!(!key(true, "/v.toml", &[]).is_same_bench(&key(true, "/w.toml", &[])));
        assert!(!key(true, "/v.toml", &[]).is_same_bench(&key(false, "/v.toml", &[])));
    }

    #[test]
    fn requests_are_short_to_type_and_strange_ones_are_refused() {
        let read = |text: &str| serde_json::from_str::<Request>(text);
        assert_eq!(read(r#"{"ask":"status"}"#).unwrap(), Request::Status);
        assert_eq!(read(r#"{"ask":"stop"}"#).unwrap(), Request::Stop { now: false });
        assert_eq!(read(r#"{"ask":"stop","now":true}"#).unwrap(), Request::Stop { now: true });
        assert!(read(r#"{"ask":"home"}"#).is_err());
    }
}
