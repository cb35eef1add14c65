//! The master side of a pseudo-terminal: a serial port that other programs can open.
//!
//! A pseudo-terminal differs from a serial port in what this module makes up for. Its terminal
//! settings vanish with the last client, so one descriptor of the slave is kept open, in raw mode
//! from the start (a cooked terminal would echo the emulator's words back to it). Because of that
//! the master never sees a hang-up; the kernel's file notifications tell when clients come and go.
//! When the last one goes, bytes that it did not read are dropped, as a serial port drops them, and the exclusive
//! flag it may have set is cleared, so that the next one can open. When nobody listens, or nobody
//! reads, what the device says is lost. There is no DTR line: whether a new client resets the board
//! is the caller's choice.

use crate::clock::Clock;
use rustix::fs::{Mode, OFlags, inotify};
use rustix::pty::OpenptFlags;
use rustix::termios::{self, OptionalActions, QueueSelector};
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::unix::AsyncFd;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use super::{Ended, SharedDevice, with};

/// A pseudo-terminal whose slave other programs open as a serial port.
pub struct Pty {
    /// The stream to serve an emulator on.
    pub stream: PtyStream,
    /// What other programs open.
    pub slave: PathBuf,
    /// Tells when programs open and close it.
    pub clients: Clients,
}

/// Opens a pseudo-terminal. Needs a tokio runtime with I/O enabled.
pub fn pty() -> io::Result<Pty> {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let master = rustix::pty::openpt(flags)?;
    rustix::pty::grantpt(&master)?;
    rustix::pty::unlockpt(&master)?;
    let name = rustix::pty::ptsname(&master, Vec::new())?;
    let slave = PathBuf::from(name.to_string_lossy().into_owned());
    let keeper = rustix::fs::open(&slave, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
    make_raw(&keeper)?;
    rustix::io::ioctl_fionbio(&master, true)?;

    let notify = inotify::init(inotify::CreateFlags::CLOEXEC | inotify::CreateFlags::NONBLOCK)?;
    let events =
        inotify::WatchFlags::OPEN | inotify::WatchFlags::CLOSE_WRITE | inotify::WatchFlags::CLOSE_NOWRITE;
    inotify::add_watch(&notify, &slave, events)?;
    let clients = Clients { notify: watch(notify)?, keeper, open: 0 };
    Ok(Pty { stream: PtyStream(watch(master)?), slave, clients })
}

fn watch(fd: OwnedFd) -> io::Result<AsyncFd<OwnedFd>> {
    // SAFETY: an `OwnedFd` is one valid descriptor until it is dropped; it moves into the `AsyncFd`,
    // which no code here takes it out of or replaces.
    unsafe { AsyncFd::register(fd) }.map_err(io::Error::from)
}

fn make_raw(slave: &OwnedFd) -> io::Result<()> {
    let mut settings = termios::tcgetattr(slave)?;
    settings.make_raw();
    Ok(termios::tcsetattr(slave, OptionalActions::Now, &settings)?)
}

/// The master side as a stream.
pub struct PtyStream(AsyncFd<OwnedFd>);

impl AsyncRead for PtyStream {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        loop {
            let mut guard = ready!(self.0.poll_read_ready(cx))?;
            let result = guard.try_io(|fd| Ok(rustix::io::read(fd, buf.initialize_unfilled())?));
            match result {
                Ok(Ok(n)) => {
                    buf.advance(n);
                    return Poll::Ready(Ok(()));
                }
                Ok(Err(e)) => return Poll::Ready(Err(e)),
                Err(_would_block) => {}
            }
        }
    }
}

impl AsyncWrite for PtyStream {
    fn poll_write(self: Pin<&mut Self>, _: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        // A wire does not wait for its reader: what does not fit is lost.
        match rustix::io::write(self.0.get_ref(), bytes) {
            Ok(_) | Err(rustix::io::Errno::AGAIN) => Poll::Ready(Ok(bytes.len())),
            Err(e) => Poll::Ready(Err(e.into())),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}

/// Programs that hold the slave open, besides ourselves.
pub struct Clients {
    notify: AsyncFd<OwnedFd>,
    keeper: OwnedFd,
    open: usize,
}

/// What a client did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visit {
    /// The first client opened the port.
    Came,
    /// The last client closed it.
    Left,
}

impl Clients {
    /// Waits until the first client comes or the last one leaves.
    pub async fn next(&mut self) -> io::Result<Visit> {
        loop {
            let mut guard = self.notify.readable().await?;
            let mut events = Vec::new();
            let mut buffer = [MaybeUninit::<u8>::uninit(); 512];
            let mut reader = inotify::Reader::new(self.notify.get_ref(), &mut buffer);
            while events.is_empty() || !reader.is_buffer_empty() {
                match reader.next() {
                    Ok(event) => events.push(event.events()),
                    Err(rustix::io::Errno::AGAIN) => {
                        guard.clear_ready();
                        break;
                    }
                    Err(e) => return Err(e.into()),
                }
            }
            let visit = events.into_iter().fold(None, |visit, event| self.count(event).or(visit));
            if let Some(visit) = visit {
                if visit == Visit::Left {
                    self.tidy()?;
                }
                return Ok(visit);
            }
        }
    }

    fn count(&mut self, event: inotify::ReadFlags) -> Option<Visit> {
        if event.contains(inotify::ReadFlags::OPEN) {
            self.open += 1;
            return (self.open == 1).then_some(Visit::Came);
        }
        self.open = self.open.saturating_sub(1);
        (self.open == 0).then_some(Visit::Left)
    }

    /// Leaves the port as a fresh one. What the client had written has left its port, as far as it can tell: it is read.
    fn tidy(&self) -> io::Result<()> {
        termios::ioctl_tiocnxcl(&self.keeper)?;
        termios::tcflush(&self.keeper, QueueSelector::IFlush)?;
        make_raw(&self.keeper)
    }
}

/// What to do for [`serve_port`].
#[derive(Debug, Clone, Default)]
pub struct PortOptions {
    /// Where to link the slave, for clients that want a known path. A link that an emulator has left there is
    /// replaced; one at which another answers is an error. Removed at the end.
    pub link: Option<PathBuf>,
    /// Reset the board whenever a client opens the port, as DTR does on many boards.
    pub reset_on_open: bool,
}

/// Serves a device on a pseudo-terminal to one client after another, until the future is dropped or
/// a fault pulls the cable. `ready` is called with the path to open.
pub async fn serve_port(
    device: &SharedDevice,
    clock: Clock,
    options: &PortOptions,
    ready: impl FnOnce(&Path),
) -> io::Result<Ended> {
    let Pty { stream, slave, mut clients } = pty()?;
    let link = options.link.as_deref().map(|path| Link::new(&slave, path)).transpose()?;
    ready(link.as_ref().map_or(slave.as_path(), |l| l.path.as_path()));
    let visits = async {
        loop {
            if clients.next().await? == Visit::Came && options.reset_on_open {
                with(device, |d| d.emulator().restart(clock.now()));
            }
        }
    };
    tokio::select! {
        ended = super::serve(stream, device, clock) => ended,
        failed = visits => failed,
    }
}

/// A symbolic link that goes when it is dropped.
struct Link {
    path: PathBuf,
    /// Holds the name of the path as long as this process lives, however it ends.
    _claim: UnixDatagram,
}

impl Link {
    fn new(slave: &Path, path: &Path) -> io::Result<Self> {
        let claim = claim(path)?;
        match std::fs::read_link(path) {
            // Of terminals that nobody claims: an emulator that was killed could not remove it.
            Ok(to) if to.starts_with("/dev/pts") => std::fs::remove_file(path)?,
            Ok(to) => {
                let words = format!("it is a link to {}, no emulator's", to.display());
                return Err(io::Error::new(io::ErrorKind::AlreadyExists, words));
            }
            Err(_) => {}
        }
        std::os::unix::fs::symlink(slave, path)?;
        Ok(Link { path: path.to_owned(), _claim: claim })
    }
}

/// Claims a path against other emulators: by a socket whose name the kernel forgets with the process. (A number of a
/// pseudo-terminal would not do: it is given to the next who asks.)
fn claim(path: &Path) -> io::Result<UnixDatagram> {
    let absolute = std::path::absolute(path)?;
    let folder = absolute.parent().and_then(|folder| folder.canonicalize().ok());
    let place = folder.zip(absolute.file_name()).map_or(absolute.clone(), |(folder, name)| folder.join(name));
    let name = format!("twinrig-emulator-{}", blake3::hash(place.as_os_str().as_encoded_bytes()).to_hex());
    UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(name)?).map_err(|e| match e.kind() {
        io::ErrorKind::AddrInUse => {
            io::Error::new(io::ErrorKind::AddrInUse, "another emulator answers there; end it first")
        }
        _ => e,
    })
}

impl Drop for Link {
    fn drop(&mut self) {
        // Nothing can be done about a link that somebody else has removed.
        std::fs::remove_file(&self.path).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::{Read, Write};
    use std::time::Duration;

    fn open(path: &Path) -> File {
        File::options().read(true).write(true).open(path).unwrap()
    }

    #[tokio::test]
    async fn clients_come_and_go_and_find_a_clean_port() {
        let Pty { mut stream, slave, mut clients } = pty().unwrap();
        let mut first = open(&slave);
        assert_eq!(clients.next().await.unwrap(), Visit::Came);
        termios::ioctl_tiocexcl(&first).unwrap();
        first.write_all(b"?\n").unwrap();
        let mut buffer = [0; 16];
        let n = tokio::io::AsyncReadExt::read(&mut stream, &mut buffer).await.unwrap();
        assert_eq!(&buffer[..n], b"?\n");
        tokio::io::AsyncWriteExt::write_all(&mut stream, b"unread").await.unwrap();
        drop(first);
        assert_eq!(clients.next().await.unwrap(), Visit::Left);

        // Neither the exclusive flag nor the unread bytes are left for the next one.
        let mut second = open(&slave);
        assert_eq!(clients.next().await.unwrap(), Visit::Came);
        tokio::io::AsyncWriteExt::write_all(&mut stream, b"ok\r\n").await.unwrap();
        let n = tokio::task::spawn_blocking(move || {
            let n = second.read(&mut buffer)?;
            // What is said in leaving is said: the stop of a program that does nothing else.
            second.write_all(b"M112\n")?;
            io::Result::Ok(buffer[..n].to_vec())
        });
        assert_eq!(n.await.unwrap().unwrap(), b"ok\r\n");
        assert_eq!(clients.next().await.unwrap(), Visit::Left);
        let mut heard = [0; 16];
        let reading = tokio::io::AsyncReadExt::read(&mut stream, &mut heard);
        let n = tokio::time::timeout(Duration::from_secs(10), reading).await.unwrap().unwrap();
        assert_eq!(&heard[..n], b"M112\n");
    }

    #[tokio::test]
    async fn a_client_that_does_not_read_cannot_block_the_device() {
        let Pty { mut stream, slave, .. } = pty().unwrap();
        let _deaf = open(&slave);
        let flood = async {
            for _ in 0..1000 {
                tokio::io::AsyncWriteExt::write_all(&mut stream, &[b'x'; 100]).await.unwrap();
            }
        };
        assert!(tokio::time::timeout(Duration::from_secs(10), flood).await.is_ok());
    }

    #[test]
    fn a_link_is_taken_over_from_the_dead_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stage");
        let first = Link::new(Path::new("/dev/pts/900"), &path).unwrap();
        let error = Link::new(Path::new("/dev/pts/901"), &path).map(drop).unwrap_err();
        assert!(error.to_string().contains("another emulator answers there"), "{error}");
        assert_eq!(
            std::fs::read_link(&path).unwrap(),
            Path::new("/dev/pts/900"),
            "and it stays whose it was"
        );
        // Another way of writing the same path is the same path.
        let roundabout = folder.path().join("..").join(folder.path().file_name().unwrap()).join("stage");
        assert!(Link::new(Path::new("/dev/pts/901"), &roundabout).is_err());
        drop(first);
        assert!(path.symlink_metadata().is_err());
        // What a killed one has left behind is replaced.
        std::os::unix::fs::symlink("/dev/pts/900", &path).unwrap();
        drop(Link::new(Path::new("/dev/pts/901"), &path).unwrap());
        // Somebody's own link and file are left alone.
        std::os::unix::fs::symlink("/dev/ttyUSB0", &path).unwrap();
        assert!(Link::new(Path::new("/dev/pts/901"), &path).is_err());
        assert_eq!(std::fs::read_link(&path).unwrap(), Path::new("/dev/ttyUSB0"));
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "mine").unwrap();
        assert!(Link::new(Path::new("/dev/pts/901"), &path).is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "mine");
    }
}
