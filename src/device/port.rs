//! Serial ports: which ones there are, which one a rig file means, and opening it for us alone.
//!
//! A port is named by a path (best one of `/dev/serial/by-id`, which stays with the adapter) or by
//! its USB identity, never by the order in which adapters were plugged in. It is opened exclusively
//! (`TIOCEXCL` and a lock, so that neither another program nor a second copy of this one gets in),
//! and the DTR line is treated as the rig or the protocol file says, since many boards reset on it.
//! Hang-up-on-close is switched off for the same reason.

use super::link::{LinkOptions, UrgentWrite};
use super::mover::{self, Mover, MoverError};
use super::settings::{Dtr, MoverSettings, PortSettings, UsbPort};
use crate::clock::Clock;
use crate::protocol::spec::{DtrPolicy, PortFlow};
use crate::protocol::{Spec, StopKind};
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};
use serialport::{FlowControl, SerialPort, SerialPortType};
use std::io;
use std::os::fd::{AsRawFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio_serial::SerialStream;

/// A serial port of this machine.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct PortInfo {
    /// Its device path.
    pub path: PathBuf,
    /// The name under `/dev/serial/by-id` that stays with the adapter.
    pub by_id: Option<PathBuf>,
    /// The adapter's USB identity, ready for a rig file.
    pub usb: Option<UsbPort>,
    /// What the adapter calls itself.
    pub product: Option<String>,
}

/// Why a port could not be had.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// There is no such path.
    #[error("there is no port {path}; the ports of this machine are: {present}")]
    Missing {
        /// The path of the rig file.
        path: String,
        /// The ports there are.
        present: String,
    },
    /// No adapter, or more than one, has the identity.
    #[error(
        "{found} adapters have vid {vid}, pid {pid}, serial {serial}; exactly one is needed: plug it in, or give its `serial`. Present: {present}"
    )]
    Usb {
        /// How many match.
        found: usize,
        /// Vendor id.
        vid: String,
        /// Product id.
        pid: String,
        /// Serial number or `any`.
        serial: String,
        /// The ports there are.
        present: String,
    },
    /// Another program has it.
    #[error(
        "port {path} is in use by another program; close it (a slicer, a terminal, another session), then try again"
    )]
    Busy {
        /// The path.
        path: String,
    },
    /// The user may not open it.
    #[error(
        "port {path} may not be opened by this user; join the group that owns it (often dialout), then log in again"
    )]
    Forbidden {
        /// The path.
        path: String,
    },
    /// Anything else the system says.
    #[error("port {path}: {reason}")]
    Failed {
        /// The path.
        path: String,
        /// The system's words.
        reason: String,
    },
    /// The port is the virtual bench's, which has no path of its own.
    #[error("port \"virtual\" is served by the virtual bench; open it through its pseudo-terminal")]
    Virtual,
}

/// Why a device could not be connected.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The port.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The byte log.
    #[error("the byte log {path} cannot be written: {source}")]
    Log {
        /// Its path.
        path: PathBuf,
        /// The system's words.
        source: io::Error,
    },
    /// The device.
    #[error(transparent)]
    Mover(#[from] MoverError),
}

/// An open port.
pub struct OpenPort {
    /// The stream for [`Mover::connect_with`].
    pub stream: SerialStream,
    /// The second door for stops.
    pub door: PortDoor,
    /// The path that was opened.
    pub path: PathBuf,
}

/// A second door to an open port: a duplicate of its descriptor.
pub struct PortDoor(OwnedFd);

impl UrgentWrite for PortDoor {
    fn write_now(&self, bytes: &[u8]) -> io::Result<usize> {
        // The descriptor is non-blocking: a full buffer is an error at once, not a wait.
        Ok(rustix::io::write(&self.0, bytes)?)
    }
}

/// The serial ports of this machine, by path.
pub fn list() -> Vec<PortInfo> {
    let mut ports: Vec<PortInfo> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| {
            let path = PathBuf::from(&port.port_name);
            let (usb, product) = match port.port_type {
                SerialPortType::UsbPort(usb) => {
                    let id = |n: u16| format!("{n:04x}");
                    let identity = UsbPort { vid: id(usb.vid), pid: id(usb.pid), serial: usb.serial_number };
                    (Some(identity), usb.product)
                }
                _ => (None, None),
            };
            PortInfo { by_id: by_id(&path), path, usb, product }
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

fn by_id(path: &Path) -> Option<PathBuf> {
    let target = path.canonicalize().ok()?;
    let links = std::fs::read_dir("/dev/serial/by-id").ok()?;
    links.flatten().map(|e| e.path()).find(|link| link.canonicalize().ok().as_ref() == Some(&target))
}

/// The path that a rig file's port means on this machine.
pub fn resolve(port: &PortSettings) -> Result<PathBuf, PortError> {
    match port {
        PortSettings::Path(path) if path == "virtual" => Err(PortError::Virtual),
        PortSettings::Path(path) if Path::new(path).exists() => Ok(PathBuf::from(path)),
        PortSettings::Path(path) => Err(PortError::Missing { path: path.clone(), present: present(&list()) }),
        PortSettings::Usb(wanted) => match_usb(wanted, &list()),
    }
}

fn match_usb(wanted: &UsbPort, ports: &[PortInfo]) -> Result<PathBuf, PortError> {
    let same_id =
        |a: &str, b: &str| u16::from_str_radix(a, 16).is_ok_and(|a| Ok(a) == u16::from_str_radix(b, 16));
    let matches = |usb: &UsbPort| {
        same_id(&usb.vid, &wanted.vid)
            && same_id(&usb.pid, &wanted.pid)
            && (wanted.serial.is_none() || usb.serial == wanted.serial)
    };
    let found: Vec<&PortInfo> = ports.iter().filter(|p| p.usb.as_ref().is_some_and(matches)).collect();
    match found[..] {
        [only] => Ok(only.path.clone()),
        _ => Err(PortError::Usb {
            found: found.len(),
            vid: wanted.vid.clone(),
            pid: wanted.pid.clone(),
            serial: wanted.serial.clone().unwrap_or_else(|| "any".to_owned()),
            present: present(ports),
        }),
    }
}

fn present(ports: &[PortInfo]) -> String {
    if ports.is_empty() {
        return "none".to_owned();
    }
    let name = |p: &PortInfo| match &p.usb {
        Some(usb) => format!(
            "{} (vid {}, pid {}, serial {})",
            p.path.display(),
            usb.vid,
            usb.pid,
            usb.serial.as_deref().unwrap_or("none")
        ),
        None => p.path.display().to_string(),
    };
    ports.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Opens a port for us alone. `path` is what [`resolve`] found, or a pseudo-terminal.
pub fn open(path: &Path, spec: &Spec, settings: &MoverSettings) -> Result<OpenPort, PortError> {
    let shown = path.display().to_string();
    let failed = |reason: String| PortError::Failed { path: shown.clone(), reason };
    let baud = settings.baud.unwrap_or(spec.link.baud);
    let flow = match spec.link.flow {
        PortFlow::None => FlowControl::None,
        PortFlow::Software => FlowControl::Software,
        PortFlow::Hardware => FlowControl::Hardware,
    };
    let builder = tokio_serial::new(path.to_string_lossy(), baud).flow_control(flow).preserve_dtr_on_open();
    let mut stream = SerialStream::open(&builder).map_err(|e| refused(&shown, &e))?;
    let policy = settings.dtr.unwrap_or(match spec.link.dtr {
        DtrPolicy::Leave => Dtr::Leave,
        DtrPolicy::Assert => Dtr::High,
        DtrPolicy::Deassert => Dtr::Low,
        DtrPolicy::Pulse => Dtr::Pulse,
    });
    // A pseudo-terminal has no such line; a real port that refuses will not answer, and that is told.
    let mut dtr =
        |on| stream.write_data_terminal_ready(on).unwrap_or_else(|e| tracing::debug!("DTR of {shown}: {e}"));
    match policy {
        Dtr::Leave => {}
        Dtr::High => dtr(true),
        Dtr::Low => dtr(false),
        Dtr::Pulse => {
            dtr(false);
            std::thread::sleep(Duration::from_millis(100));
            dtr(true);
        }
    }
    // SAFETY: the descriptor belongs to `stream`, which outlives this borrow of one statement.
    let door = unsafe { BorrowedFd::borrow_raw(stream.as_raw_fd()) };
    let door = door.try_clone_to_owned().map_err(|e| failed(e.to_string()))?;
    keep_dtr_on_close(&door).map_err(|e| failed(e.to_string()))?;
    Ok(OpenPort { stream, door: PortDoor(door), path: path.to_owned() })
}

fn keep_dtr_on_close(port: &OwnedFd) -> io::Result<()> {
    let mut modes = tcgetattr(port)?;
    modes.control_modes.remove(ControlModes::HUPCL);
    Ok(tcsetattr(port, OptionalActions::Now, &modes)?)
}

fn refused(path: &str, error: &serialport::Error) -> PortError {
    let path = path.to_owned();
    let words = error.description.to_lowercase();
    if words.contains("busy") || words.contains("exclusive lock") {
        return PortError::Busy { path };
    }
    match error.kind() {
        serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => PortError::Forbidden { path },
        serialport::ErrorKind::Io(io::ErrorKind::WouldBlock | io::ErrorKind::ResourceBusy) => {
            PortError::Busy { path }
        }
        _ => PortError::Failed { path, reason: error.to_string() },
    }
}

/// Opens a port that nobody has open and writes the bytes that stop its device; answers the bytes.
/// What the device says is not waited for.
///
/// # Errors
/// When the port cannot be opened, or does not take the bytes.
pub fn write_stop(
    path: &Path,
    spec: &Arc<Spec>,
    settings: &MoverSettings,
    kind: StopKind,
) -> Result<Vec<u8>, ConnectError> {
    let bytes = mover::stop_bytes(spec, settings, kind)?;
    let port = open(path, spec, settings)?;
    let failed = |reason: String| PortError::Failed { path: path.display().to_string(), reason };
    match port.door.write_now(&bytes) {
        Ok(n) if n == bytes.len() => {}
        Ok(n) => return Err(failed(format!("took {n} of {} bytes of the stop", bytes.len())).into()),
        Err(e) => return Err(failed(e.to_string()).into()),
    }
    // Closing drops what has not left yet.
    rustix::termios::tcdrain(&port.door.0).map_err(|e| failed(e.to_string()))?;
    Ok(bytes)
}

/// Opens the port at `path` and connects the device behind it; `log` is where its bytes are kept.
pub async fn connect(
    path: &Path,
    spec: Arc<Spec>,
    settings: MoverSettings,
    clock: Clock,
    log: Option<&Path>,
) -> Result<Mover, ConnectError> {
    let port = open(path, &spec, &settings)?;
    let log = match log {
        Some(path) => {
            let create = super::byte_log::ByteLog::create(path);
            Some(create.map_err(|source| ConnectError::Log { path: path.to_owned(), source })?)
        }
        None => None,
    };
    let options = LinkOptions { log, urgent: Some(Box::new(port.door)) };
    Ok(Mover::connect_with(port.stream, spec, settings, clock, options).await?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::byte_log::Record;
    use crate::device::settings::AxisSettings;
    use crate::device::virtual_bench::serve::{pty::pty, serve};
    use crate::device::virtual_bench::{Emulator, EmulatorOptions, Faulty, World};
    use crate::motion::AxisKind;
    use crate::protocol::conformance::tests::shipped;
    use std::sync::Mutex;
    use tokio::io::AsyncReadExt;

    fn settings() -> MoverSettings {
        let axis = AxisSettings {
            wire: "X".to_owned(),
            kind: AxisKind::Linear,
            min: -10.0,
            max: -1.0,
            max_feed: 5.0,
            accel: 100.0,
            counts_per_unit: None,
            tolerance: 0.01,
            approach: None,
        };
        MoverSettings {
            protocol: "grbl".to_owned(),
            port: PortSettings::Path("virtual".to_owned()),
            baud: None,
            identity: None,
            dtr: None,
            settle_ms: 0,
            stall_ms: 1000,
            axes: [("slide".to_owned(), axis)].into(),
            kinematics: None,
        }
    }

    #[test]
    fn a_usb_adapter_is_found_by_identity_alone() {
        let port = |path: &str, serial: &str| PortInfo {
            path: path.into(),
            by_id: None,
            usb: Some(UsbPort { vid: "0403".into(), pid: "6001".into(), serial: Some(serial.into()) }),
            product: None,
        };
        let ports = [port("/dev/ttyUSB0", "B"), port("/dev/ttyUSB1", "A")];
        let wanted = |serial: Option<&str>| UsbPort {
            vid: "403".into(),
            pid: "6001".into(),
            serial: serial.map(str::to_owned),
        };
        assert_eq!(match_usb(&wanted(Some("A")), &ports).unwrap(), Path::new("/dev/ttyUSB1"));
        let two = match_usb(&wanted(None), &ports).unwrap_err().to_string();
        assert!(two.starts_with("2 adapters") && two.contains("ttyUSB1"), "{two}");
        assert!(match_usb(&wanted(Some("C")), &ports).unwrap_err().to_string().starts_with("0 adapters"));
    }

    #[test]
    fn a_missing_port_is_named() {
        let error = resolve(&PortSettings::Path("/dev/ttyNowhere".into())).unwrap_err();
        assert!(error.to_string().contains("/dev/ttyNowhere"), "{error}");
        assert!(matches!(resolve(&PortSettings::Path("virtual".into())), Err(PortError::Virtual)));
    }

    /// Whether a terminal refuses to be opened again. (By any but the superuser, who may run these tests.)
    fn is_exclusive(port: &OwnedFd) -> bool {
        /// TIOCGEXCL, `_IOR('T', 0x40, int)`.
        const IS_EXCLUSIVE: rustix::ioctl::Opcode = rustix::ioctl::opcode::read::<i32>(b'T', 0x40);
        // SAFETY: this request writes one `int`, which is what the getter makes room for.
        let asked = unsafe { rustix::ioctl::ioctl(port, rustix::ioctl::Getter::<IS_EXCLUSIVE, i32>::new()) };
        asked.unwrap() != 0
    }

    #[tokio::test]
    async fn pitfall_24_a_port_is_opened_by_one_alone_and_free_again_afterwards() {
        let pair = pty().unwrap();
        let spec = shipped("grbl");
        let first = open(&pair.slave, &spec, &settings()).unwrap();
        // The lock keeps out whoever looks for one, the terminal's own flag (TIOCEXCL) whoever does not.
        assert!(is_exclusive(&first.door.0), "other users' programs may open it");
        let second = open(&pair.slave, &spec, &settings()).map(|_| ());
        assert!(matches!(second, Err(PortError::Busy { .. })), "{second:?}");
        drop(first);
        open(&pair.slave, &spec, &settings()).map(|_| ()).unwrap();
    }

    #[tokio::test]
    async fn the_second_door_writes_at_once() {
        let mut pair = pty().unwrap();
        let port = open(&pair.slave, &shipped("grbl"), &settings()).unwrap();
        assert_eq!(port.door.write_now(b"\x85!").unwrap(), 2);
        let mut got = [0u8; 2];
        pair.stream.read_exact(&mut got).await.unwrap();
        assert_eq!(&got, b"\x85!");
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_stage_behind_a_pseudo_terminal_homes_moves_and_is_stopped_at_once() {
        let (pair, clock, spec) = (pty().unwrap(), Clock::with_speed(20.0), shipped("grbl"));
        let table = spec.emulator.as_ref().unwrap();
        let (options, world, now) = (EmulatorOptions::default(), World::without_pad(), clock.now());
        let emulator = Emulator::new(table, "stage", &settings().axes, &options, world, now).unwrap();
        let device = Arc::new(Mutex::new(Faulty::sound(emulator, now)));
        let served = tokio::spawn(async move { serve(pair.stream, &device, clock).await });
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("stage.log");
        let mut mover = connect(&pair.slave, spec, settings(), clock, Some(&log)).await.unwrap();
        mover.home().await.unwrap();
        mover.move_to(&[("slide", -2.0)], 5.0).await.unwrap();
        let handle = mover.stop_handle();
        let stopper = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(40));
            handle.stop(StopKind::Controlled)
        });
        let result = mover.move_to(&[("slide", -9.0)], 1.0).await;
        assert!(stopper.join().unwrap(), "the bytes were written by the calling thread");
        assert!(result.as_ref().is_err_and(MoverError::is_stop), "{result:?}");
        mover.move_to(&[("slide", -3.0)], 5.0).await.unwrap();
        drop(mover);
        served.abort();
        let text = std::fs::read_to_string(&log).unwrap();
        let records: Vec<_> = text.lines().map(|l| Record::read(l).unwrap()).collect();
        assert!(records.iter().any(|r| r.sign == '!' && r.bytes().unwrap() == b"\x85!"), "{text}");
        // Also what a second thread did to the port is lived through again.
        let story = crate::device::replay::replay(&text, &shipped("grbl")).unwrap();
        assert_eq!(story.difference, None, "{text}");
    }
}
