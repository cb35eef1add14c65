//! Opening a bench for a command that uses it and puts it back: load, assemble, catch signals.

use super::exit::Exit;
use super::options::{RigOptions, Speed};
use super::screen;
use super::signals::{AtOnce, Signals};
use crate::assemble::{self, Assembled, BenchOptions};
use crate::config::Setup;
use crate::control::{Board, RigKey, Server};
use crate::session::{BenchError, StopLevel, StopSwitch};
use std::path::{Path, PathBuf};

/// A bench at hand.
pub struct AtBench {
    /// What was loaded.
    pub setup: Setup,
    /// What was assembled.
    pub assembled: Assembled,
    /// Which signal arrived, if one did.
    pub signals: Signals,
    /// What those who ask are shown.
    board: Board,
    /// Answers `twinrig status` and `twinrig stop`.
    _control: Option<Server>,
}

/// What a command wants of its bench.
pub struct Wanted<'a> {
    /// Its name, for those who ask.
    pub command: &'static str,
    /// The rig file.
    pub rig: &'a Path,
    /// The plan, where there is one.
    pub plan: Option<&'a Path>,
    /// The overrides.
    pub set: &'a [String],
    /// Times faster than real time.
    pub speed: f64,
}

impl<'a> Wanted<'a> {
    /// Of a command that moves a bench without a plan.
    pub fn by_hand(command: &'static str, rig: &'a RigOptions, speed: &Speed) -> Self {
        Self { command, rig: &rig.rig, plan: None, set: &rig.overrides.set, speed: speed.speed }
    }
}

impl AtBench {
    /// Loads the files, opens the movers, verifies who they are; the camera is left alone. On failure the error has
    /// been printed.
    pub async fn open(wanted: Wanted<'_>) -> Result<AtBench, Exit> {
        let Wanted { command, rig, plan, set, speed } = wanted;
        let setup = crate::config::load(rig, plan, set).map_err(|e| {
            screen::error(e);
            Exit::Refused
        })?;
        let stop = StopSwitch::new();
        let signals = Signals::listen(stop.clone(), AtOnce::Rig).map_err(|e| {
            screen::error(format_args!("signals cannot be caught: {e}"));
            Exit::Failed
        })?;
        let (board, control) = answer_others(command, &setup, rig, &stop, &signals);
        let options = BenchOptions { speed, logs: session_logs(), no_camera: true };
        let assembled = assemble::bench(&setup, &options, stop).await.map_err(|e| {
            screen::error(&e);
            match e {
                assemble::BenchError::RealTimeOnly { .. } => Exit::Refused,
                _ => Exit::Failed,
            }
        })?;
        board.show_devices(assembled.bench.observers());
        Ok(AtBench { setup, assembled, signals, board, _control: control })
    }

    /// What those who ask are shown.
    pub fn board(&self) -> &Board {
        &self.board
    }

    /// Turns the result of motion into an exit code: on failure everything is stopped first.
    pub fn finish(self, result: Result<(), BenchError>) -> Exit {
        match result {
            Ok(()) => self.signals.exit().unwrap_or(Exit::Done),
            Err(e) => {
                self.assembled.bench.stop.raise(StopLevel::Controlled);
                if self.signals.exit().is_none() {
                    screen::error(e);
                }
                self.signals.exit().unwrap_or(Exit::Failed)
            }
        }
    }
}

/// Begins to answer other programs. A session that cannot be reached is told so, and goes on.
pub(super) fn answer_others(
    command: &'static str,
    setup: &Setup,
    rig: &Path,
    stop: &StopSwitch,
    signals: &Signals,
) -> (Board, Option<Server>) {
    let board = Board::new(command, RigKey::new(&setup.rig, rig), setup.rig.motion.clone());
    let signals = signals.clone();
    let on_stop = Box::new(move |level| signals.stop_from_outside(level));
    match Server::start(board.clone(), stop.clone(), on_stop) {
        Ok(server) => (board, Some(server)),
        Err(e) => {
            screen::warning(format_args!(
                "`twinrig stop` and `twinrig status` do not reach this session: {e}"
            ));
            (board, None)
        }
    }
}

/// Folders of sessions that are kept.
const KEPT_SESSIONS: usize = 50;

/// A new folder for the byte logs of this session: in `$TWINRIG_LOGS`, or else in the user's folder for
/// state. The oldest folders of many are removed.
fn session_logs() -> Option<PathBuf> {
    let state = || {
        let own = std::env::var_os("XDG_STATE_HOME").map(PathBuf::from);
        let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".local/state"));
        Some(own.or_else(home)?.join("twinrig/logs"))
    };
    let logs = std::env::var_os("TWINRIG_LOGS").map(PathBuf::from).or_else(state)?;
    let now = jiff::Timestamp::now().strftime("%Y%m%dT%H%M%S").to_string();
    let session = format!("{now}-{}", std::process::id());
    if let Err(e) = std::fs::create_dir_all(logs.join(&session)) {
        screen::warning(format_args!(
            "no logs of the ports: {} cannot be made ({e}); set TWINRIG_LOGS to a folder",
            logs.display()
        ));
        return None;
    }
    // Names begin with the time, so they sort by age; what does not look like ours is left alone.
    let is_ours =
        |name: &String| name.len() > 16 && name.as_bytes()[8] == b'T' && name.as_bytes()[15] == b'-';
    let entries = std::fs::read_dir(&logs).into_iter().flatten().flatten();
    let mut sessions: Vec<String> = entries.filter_map(|e| e.file_name().into_string().ok()).collect();
    sessions.retain(is_ours);
    sessions.sort();
    for old in sessions.iter().rev().skip(KEPT_SESSIONS) {
        if let Err(e) = std::fs::remove_dir_all(logs.join(old)) {
            tracing::debug!("{old} stays: {e}");
        }
    }
    Some(logs.join(session))
}

/// Where the bench is, as a document.
pub async fn whereabouts(bench: &mut crate::session::Bench) -> Result<serde_json::Value, BenchError> {
    let (pose, positions) = bench.measured().await?;
    let axes: Vec<_> = positions
        .iter()
        .map(|(device, axis, position)| serde_json::json!({ "device": device, "axis": axis, "position": position }))
        .collect();
    Ok(serde_json::json!({ "pose": pose, "axes": axes }))
}

/// Prints where the bench is.
pub fn show(place: &serde_json::Value, json: bool) {
    if json {
        screen::json(place);
        return;
    }
    let coordinate = |name: &str| place["pose"][name].as_f64().unwrap_or(f64::NAN);
    screen::result(format_args!(
        "x {:.3} y {:.3} z {:.3} mm, {:.2} deg (relative to the nominal contact)",
        coordinate("x_mm"),
        coordinate("y_mm"),
        coordinate("z_mm"),
        coordinate("theta_deg")
    ));
    for axis in place["axes"].as_array().into_iter().flatten() {
        screen::result(format_args!(
            "  {} {} at {}",
            axis["device"].as_str().unwrap_or(""),
            axis["axis"].as_str().unwrap_or(""),
            axis["position"]
        ));
    }
}
