//! The session's side: answers on a thread of its own for as long as the session lives.
//!
//! Each caller is answered on its own thread, so that one who connects and says nothing keeps nobody
//! waiting. [`Board`] is where the session writes what it is doing.

use super::message::{Answer, Progress, Request, RigKey, Status};
use super::{ControlError, place};
use crate::device::mover::Observer;
use crate::motion::PoseMap;
use crate::session::{StopLevel, StopSwitch};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a session shows to those who ask. Clones are the same board.
#[derive(Clone)]
pub struct Board(Arc<Mutex<State>>);

struct State {
    command: &'static str,
    begun_utc: String,
    rig: RigKey,
    map: PoseMap,
    out: Option<PathBuf>,
    progress: Option<Progress>,
    devices: BTreeMap<String, Observer>,
}

impl Board {
    /// The board of a subcommand that begins now.
    pub fn new(command: &'static str, rig: RigKey, map: PoseMap) -> Board {
        let begun_utc = jiff::Timestamp::now().to_string();
        let (out, progress, devices) = (None, None, BTreeMap::new());
        Board(Arc::new(Mutex::new(State { command, begun_utc, rig, map, out, progress, devices })))
    }

    /// The devices, once they are open.
    pub fn show_devices(&self, devices: BTreeMap<String, Observer>) {
        self.state().devices = devices;
    }

    /// Where the dataset goes.
    pub fn show_out(&self, out: PathBuf) {
        self.state().out = Some(out);
    }

    /// How far the session is.
    pub fn update(&self, change: impl FnOnce(&mut Progress)) {
        change(self.state().progress.get_or_insert_default());
    }

    /// Everything, as it is now.
    pub fn status(&self, stop: StopLevel) -> Status {
        let state = self.state();
        let devices: BTreeMap<_, _> = state.devices.iter().map(|(n, o)| (n.clone(), o.look())).collect();
        let mut complete = !devices.is_empty();
        let pose = state.map.pose(|device, axis| {
            let seen = devices.get(device).and_then(|d| d.axes.iter().find(|a| a.axis == axis));
            seen.and_then(|a| a.position).unwrap_or_else(|| {
                complete = false;
                0.0
            })
        });
        Status {
            pid: std::process::id(),
            command: state.command.to_owned(),
            begun_utc: state.begun_utc.clone(),
            rig: state.rig.clone(),
            stop: format!("{stop:?}").to_lowercase(),
            out: state.out.clone(),
            progress: state.progress.clone(),
            pose: complete.then_some(pose),
            devices,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Every change is one assignment: a panic elsewhere leaves nothing half done.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a stop does; called on the thread of whoever asked.
pub type OnStop = Box<dyn Fn(StopLevel) + Send + Sync>;

/// Answers until it is dropped; then the socket is gone.
pub struct Server {
    #[cfg(unix)]
    _listening: unix::Listening,
}

impl Server {
    /// Begins to answer for this board.
    ///
    /// # Errors
    /// When there is no folder for the socket, or the socket cannot be made.
    #[cfg(unix)]
    pub fn start(board: Board, stop: StopSwitch, on_stop: OnStop) -> Result<Server, ControlError> {
        let folder = place::folder()?;
        let rig = board.state().rig.name.clone();
        let path = place::socket(&folder, &rig, std::process::id());
        Ok(Server { _listening: unix::Listening::start(path, board, stop, on_stop)? })
    }

    /// As above, where there are no such sockets.
    #[cfg(not(unix))]
    pub fn start(_: Board, _: StopSwitch, _: OnStop) -> Result<Server, ControlError> {
        Err(ControlError::NoSockets)
    }
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::io::{BufRead, BufReader, Read, Write};
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::net::{UnixListener, UnixStream};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread::JoinHandle;
    use std::time::Duration;

    /// A caller who says nothing for so long is given up.
    const PATIENCE: Duration = Duration::from_secs(2);
    /// Requests are shorter.
    const MAX_REQUEST: u64 = 4096;

    pub(super) struct Listening {
        path: PathBuf,
        ending: Arc<AtomicBool>,
        thread: Option<JoinHandle<()>>,
    }

    struct Desk {
        board: Board,
        stop: StopSwitch,
        on_stop: OnStop,
    }

    impl Listening {
        pub(super) fn start(
            path: PathBuf,
            board: Board,
            stop: StopSwitch,
            on_stop: OnStop,
        ) -> Result<Listening, ControlError> {
            let failed = |e: std::io::Error| ControlError::Listen {
                path: path.display().to_string(),
                why: e.to_string(),
            };
            // A socket of our own process id was left by a process that is no more.
            _ = std::fs::remove_file(&path);
            let listener = UnixListener::bind(&path).map_err(failed)?;
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).map_err(failed)?;
            let ending = Arc::new(AtomicBool::new(false));
            let desk = Arc::new(Desk { board, stop, on_stop });
            let ends = ending.clone();
            let thread = std::thread::Builder::new().name("control".into()).spawn(move || {
                for caller in listener.incoming() {
                    if ends.load(Ordering::SeqCst) {
                        break;
                    }
                    let (Ok(caller), desk) = (caller, desk.clone()) else { continue };
                    let served = std::thread::Builder::new().name("control-caller".into()).spawn(move || {
                        if let Err(e) = desk.serve(&caller) {
                            tracing::debug!("control: {e}");
                        }
                    });
                    if let Err(e) = served {
                        tracing::warn!("a request to the control socket is not answered: {e}");
                    }
                }
            });
            Ok(Listening { thread: Some(thread.map_err(failed)?), path, ending })
        }
    }

    impl Drop for Listening {
        fn drop(&mut self) {
            self.ending.store(true, Ordering::SeqCst);
            // Wakes the thread, which then finds that it is over.
            let woken = UnixStream::connect(&self.path);
            _ = std::fs::remove_file(&self.path);
            if let (Ok(_), Some(thread)) = (woken, self.thread.take()) {
                _ = thread.join();
            }
        }
    }

    impl Desk {
        /// Answers every line of a caller.
        fn serve(&self, caller: &UnixStream) -> std::io::Result<()> {
            caller.set_read_timeout(Some(PATIENCE))?;
            caller.set_write_timeout(Some(PATIENCE))?;
            let mut lines = BufReader::new(caller.take(MAX_REQUEST));
            let mut line = String::new();
            while lines.read_line(&mut line)? > 0 {
                let answer = match serde_json::from_str(&line) {
                    Ok(request) => self.answer(request),
                    Err(e) => Answer::Refused { why: format!("{e}; ask \"status\" or \"stop\"") },
                };
                let mut text = serde_json::to_vec(&answer)?;
                text.push(b'\n');
                (&*caller).write_all(&text)?;
                line.clear();
            }
            Ok(())
        }

        fn answer(&self, request: Request) -> Answer {
            match request {
                Request::Status => Answer::Status(Box::new(self.board.status(self.stop.level()))),
                Request::Stop { now } => {
                    (self.on_stop)(if now { StopLevel::Emergency } else { StopLevel::Controlled });
                    let command = self.board.state().command.to_owned();
                    Answer::Stopped { pid: std::process::id(), command }
                }
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use crate::motion::AxisRole;

        fn board() -> Board {
            let rig =
                RigKey { name: "t".into(), file: "/t.toml".into(), is_virtual: true, ports: Vec::new() };
            let z = AxisRole { device: "arm".into(), axis: "z".into(), sign: 1.0, origin: 0.0 };
            Board::new("drive", rig, PoseMap { x: None, y: None, z, theta: None })
        }

        fn ask(path: &std::path::Path, text: &str) -> Answer {
            let stream = UnixStream::connect(path).unwrap();
            (&stream).write_all(text.as_bytes()).unwrap();
            let mut line = String::new();
            BufReader::new(&stream).read_line(&mut line).unwrap();
            serde_json::from_str(&line).unwrap()
        }

        #[test]
        fn a_silent_caller_keeps_nobody_waiting_and_the_socket_goes_with_the_session() {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("t.1");
            // Left by a process that was killed.
            drop(UnixListener::bind(&path).unwrap());
            let stop = StopSwitch::new();
            let on_stop: OnStop = {
                let stop = stop.clone();
                Box::new(move |level| stop.raise(level))
            };
            let listening = Listening::start(path.clone(), board(), stop.clone(), on_stop).unwrap();
            assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);

            let _silent = UnixStream::connect(&path).unwrap();
            let Answer::Status(status) = ask(&path, "{\"ask\":\"status\"}\n") else { panic!("no status") };
            assert_eq!((status.stop.as_str(), status.command.as_str()), ("running", "drive"));
            assert_eq!(status.pose, None, "no device has told where it is");
            assert!(matches!(ask(&path, "home!\n"), Answer::Refused { .. }));
            assert!(!stop.is_raised());
            assert!(matches!(ask(&path, "{\"ask\":\"stop\"}\n"), Answer::Stopped { .. }));
            assert_eq!(stop.level(), StopLevel::Controlled);
            ask(&path, "{\"ask\":\"stop\",\"now\":true}\n");
            assert_eq!(stop.level(), StopLevel::Emergency);
            drop(listening);
            assert!(!path.exists());
        }
    }
}
