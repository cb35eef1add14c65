//! Where control sockets are: in a folder that only its owner can enter, one socket for each process.
//!
//! `$XDG_RUNTIME_DIR/twinrig`, or `twinrig-<user id>` in the folder for temporary files. A socket is called
//! `<rig>.<process id>`. One that nobody listens on any more was left by a process that was killed; whoever
//! meets it removes it.

use super::ControlError;
use std::path::{Path, PathBuf};

/// Longest name of a rig in a path: a socket's path has room for about a hundred bytes.
const NAME_CHARS: usize = 24;

/// The folder of the sockets; made if it does not exist.
///
/// # Errors
/// When it cannot be made, or others can enter it.
#[cfg(unix)]
pub fn folder() -> Result<PathBuf, ControlError> {
    use std::os::unix::fs::{DirBuilderExt, MetadataExt};
    let user = rustix::process::geteuid().as_raw();
    let path = match std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|p| p.is_absolute()) {
        Some(runtime) => runtime.join("twinrig"),
        None => std::env::temp_dir().join(format!("twinrig-{user}")),
    };
    let refused = |why: String| ControlError::Folder { path: path.display().to_string(), why };
    match std::fs::DirBuilder::new().mode(0o700).create(&path) {
        Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => {
            return Err(refused(format!("cannot be made: {e}")));
        }
        _ => {}
    }
    // Not followed if it is a link: somebody else may have put it there.
    let found = std::fs::symlink_metadata(&path).map_err(|e| refused(format!("cannot be looked at: {e}")))?;
    if !found.is_dir() || found.uid() != user || found.mode() & 0o077 != 0 {
        return Err(refused("is not a folder of yours alone (mode 0700)".to_owned()));
    }
    Ok(path)
}

/// As above, where there are no such sockets.
#[cfg(not(unix))]
pub fn folder() -> Result<PathBuf, ControlError> {
    Err(ControlError::NoSockets)
}

/// The socket of a process with this rig.
pub fn socket(folder: &Path, rig: &str, pid: u32) -> PathBuf {
    let safe = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    let name: String = rig.chars().take(NAME_CHARS).map(safe).collect();
    folder.join(format!("{name}.{pid}"))
}

/// The process that a socket belongs to, by its name.
pub fn pid_of(socket: &Path) -> Option<u32> {
    socket.file_name()?.to_str()?.rsplit_once('.')?.1.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_is_named_after_its_rig_and_its_process() {
        let path = socket(Path::new("/run/user/1000/twinrig"), "Skin bench 2/3 (grblHAL, Zaber)", 4711);
        assert_eq!(path, Path::new("/run/user/1000/twinrig/skin-bench-2-3--grblhal-.4711"));
        assert_eq!(pid_of(&path), Some(4711));
        assert_eq!(pid_of(Path::new("/x/other")), None);
    }
}
