//! The asking side: finds the sessions of a rig, and talks to one.

use super::message::{Answer, Request, RigKey, Status};
use super::{ControlError, place};
use std::path::{Path, PathBuf};

/// The sessions that run.
#[derive(Debug, Default)]
pub struct Found {
    /// Those of the rig that was asked for.
    pub sessions: Vec<Running>,
    /// Those of other rigs.
    pub others: Vec<Status>,
    /// Those that do not answer.
    pub mute: Vec<ControlError>,
}

/// A session that runs and answers.
#[derive(Debug)]
pub struct Running {
    /// What it said.
    pub status: Status,
    socket: PathBuf,
}

/// Asks every session of this user who it is. Sockets that nobody listens on are removed.
///
/// # Errors
/// When the folder of the sockets cannot be trusted.
pub fn find(rig: &RigKey) -> Result<Found, ControlError> {
    find_in(&place::folder()?, rig)
}

fn find_in(folder: &Path, rig: &RigKey) -> Result<Found, ControlError> {
    let mut found = Found::default();
    let entries = std::fs::read_dir(folder)
        .map_err(|e| ControlError::Folder { path: folder.display().to_string(), why: e.to_string() })?;
    let mut sockets: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    sockets.sort();
    for socket in sockets {
        let Some(pid) = place::pid_of(&socket) else { continue };
        match ask(&socket, Request::Status) {
            Ok(Answer::Status(status)) if status.rig.is_same_bench(rig) => {
                found.sessions.push(Running { status: *status, socket });
            }
            Ok(Answer::Status(status)) => found.others.push(*status),
            Ok(other) => found.mute.push(ControlError::Mute { pid, why: format!("it answers {other:?}") }),
            Err(e) if is_deserted(&e) => {
                tracing::debug!("nobody listens on {}: removed", socket.display());
                _ = std::fs::remove_file(&socket);
            }
            Err(e) => found.mute.push(ControlError::Mute { pid, why: e.to_string() }),
        }
    }
    Ok(found)
}

impl Running {
    /// Asks it something.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn ask(&self, request: Request) -> Result<Answer, ControlError> {
        let pid = self.status.pid;
        ask(&self.socket, request).map_err(|e| ControlError::Mute { pid, why: e.to_string() })
    }
}

/// Nobody listens (any more).
fn is_deserted(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{ConnectionRefused, NotFound};
    matches!(error.kind(), ConnectionRefused | NotFound)
}

#[cfg(unix)]
fn ask(socket: &Path, request: Request) -> std::io::Result<Answer> {
    use std::io::{BufRead, BufReader, Write};
    use std::time::Duration;
    /// A session answers at once or not at all.
    const PATIENCE: Duration = Duration::from_secs(3);
    let mut stream = std::os::unix::net::UnixStream::connect(socket)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut text = serde_json::to_vec(&request)?;
    text.push(b'\n');
    stream.write_all(&text)?;
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line)?;
    Ok(serde_json::from_str(&line)?)
}

#[cfg(not(unix))]
fn ask(_: &Path, _: Request) -> std::io::Result<Answer> {
    Err(std::io::ErrorKind::Unsupported.into())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader, Write};
    use std::os::unix::net::UnixListener;

    #[test]
    fn deserted_sockets_are_removed_and_a_session_that_is_mute_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let (dead, mute) = (folder.path().join("rig.41"), folder.path().join("rig.42"));
        drop(UnixListener::bind(&dead).unwrap());
        let listener = UnixListener::bind(&mute).unwrap();
        let answers = std::thread::spawn(move || {
            let (mut caller, _) = listener.accept().unwrap();
            let mut line = String::new();
            BufReader::new(caller.try_clone().unwrap()).read_line(&mut line).unwrap();
            caller.write_all(b"what?\n").unwrap();
        });
        let rig = RigKey { name: "rig".into(), file: "/r".into(), is_virtual: true, ports: Vec::new() };
        let found = find_in(folder.path(), &rig).unwrap();
        answers.join().unwrap();
        assert!(found.sessions.is_empty() && found.others.is_empty());
        assert!(found.mute[0].to_string().contains("kill -TERM 42"), "{:?}", found.mute);
        assert!(!dead.exists() && mute.exists());
    }
}
