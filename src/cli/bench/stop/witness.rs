//! The process that sends the signals and looks at the far ends of the ports.

use super::Args;
use super::victim::{READY, SPEED};
use crate::cli::bench::load::ThrownAway;
use crate::clock::{Clock, Timestamp};
use crate::config::Setup;
use crate::device::mover;
use crate::device::settings::MoverSettings;
use crate::device::virtual_bench::serve::pty::{Clients, Pty, PtyStream, pty};
use crate::device::virtual_bench::serve::serve;
use crate::device::virtual_bench::{Emulator, EmulatorOptions, Faulty, World};
use crate::protocol::StopKind;
use std::pin::Pin;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncWrite, AsyncWriteExt, BufReader, Lines, ReadBuf};
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::task::JoinHandle;

/// What is wrong with the last port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// Nothing.
    None,
    /// It takes no bytes any more.
    Mute,
    /// It was pulled out.
    Gone,
}

impl Fault {
    pub(super) fn words(self) -> &'static str {
        match self {
            Fault::None => "three ports alive",
            Fault::Mute => "two alive, one takes no bytes",
            Fault::Gone => "two alive, one pulled out",
        }
    }
}

/// The devices of a rig, and its last one once more: the one that may die.
pub(super) fn devices(setup: &Setup) -> Vec<MoverSettings> {
    let mut devices: Vec<MoverSettings> = setup.rig.devices.values().cloned().collect();
    devices.extend(devices.last().cloned());
    devices
}

/// Times of one state of the ports.
#[derive(Debug, Default)]
pub(super) struct Measured {
    pub arrived_ms: Vec<f64>,
    pub handed_over_ms: Vec<f64>,
    pub missed: usize,
    pub cores: f64,
}

/// Why there is no measurement.
#[derive(Debug, thiserror::Error)]
pub(super) enum WitnessError {
    #[error("{0}")]
    Config(String),
    #[error("device {0} has no emulator; choose another --rig")]
    NoEmulator(String),
    #[error(transparent)]
    Emulator(#[from] crate::device::virtual_bench::EmulatorError),
    #[error(transparent)]
    Mover(#[from] crate::device::mover::MoverError),
    #[error("the victim cannot be served: {0}")]
    Io(#[from] std::io::Error),
    #[error("the victim ended by itself, or does not move")]
    NoVictim,
}

/// The far end of one port.
struct Port {
    seen: Arc<Mutex<Seen>>,
    mute: Arc<AtomicBool>,
    served: JoinHandle<()>,
    _clients: Clients,
}

/// What came out of a port since the last signal.
#[derive(Default)]
struct Seen {
    stop: Vec<u8>,
    bytes: Vec<u8>,
    complete_at: Option<Timestamp>,
}

pub(super) struct Witness {
    clock: Clock,
    ports: Vec<Port>,
    fault: Fault,
    child: Child,
    says: Lines<BufReader<ChildStdout>>,
    tell: ChildStdin,
    /// After the child, which writes there.
    _scratch: ThrownAway,
}

/// A port that saw nothing for so long has missed the stop.
const MISSED: Duration = Duration::from_secs(2);
/// A victim that is not in motion for so long is broken.
const PATIENCE: Duration = Duration::from_secs(60);

impl Witness {
    /// Serves the ports and starts the victim.
    pub(super) async fn start(args: &Args, fault: Fault) -> Result<Witness, WitnessError> {
        let setup = crate::config::load(&args.rig, Some(&args.plan), &[])
            .map_err(|e| WitnessError::Config(e.to_string()))?;
        let (mut ports, mut paths) = (Vec::new(), Vec::new());
        for settings in devices(&setup) {
            let (port, path) = open_port(&setup, &settings)?;
            ports.push(port);
            paths.push(path);
        }
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["bench", "stop", "--rig"]).arg(&args.rig).arg("--plan").arg(&args.plan);
        let scratch = ThrownAway::new("stop");
        command.arg("--victim").arg(paths.join(",")).arg("--scratch").arg(&scratch.0);
        if args.idle {
            command.arg("--idle");
        }
        // Alarms and lost links are what the victim lives with.
        command.env("TWINRIG_LOG", "error");
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).kill_on_drop(true);
        let mut child = command.spawn()?;
        let (Some(out), Some(tell)) = (child.stdout.take(), child.stdin.take()) else {
            return Err(WitnessError::NoVictim);
        };
        let says = BufReader::new(out).lines();
        Ok(Witness { clock: Clock::real_time(), ports, fault, child, says, tell, _scratch: scratch })
    }

    /// Stops the victim so often.
    pub(super) async fn measure(mut self, stops: usize) -> Result<Measured, WitnessError> {
        let mut measured = Measured::default();
        let pid = self.child.id().and_then(|id| rustix::process::Pid::from_raw(id.cast_signed()));
        let pid = pid.ok_or(WitnessError::NoVictim)?;
        // Instants of a fixed sequence that repeats in no rhythm of the victim's.
        let mut random = 0x2545_f491_4f6c_dd1d_u64;
        for round in 0..stops {
            while self.line().await? != READY {}
            if round == 0 {
                self.break_a_port();
            }
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            tokio::time::sleep(Duration::from_micros(1000 + (random >> 33) % 40_000)).await;

            // What is gone is not among the ports any more.
            let living = self.ports.len() - usize::from(self.fault == Fault::Mute);
            self.ports[..living].iter().for_each(|p| p.lock().reset());
            let sent = self.clock.now();
            rustix::process::kill_process(pid, rustix::process::Signal::TERM)
                .map_err(std::io::Error::from)?;
            let says = self.line().await?;
            let mut words = says.split(' ');
            let handed =
                words.next().and_then(|w| w.parse().ok()).map(Timestamp).ok_or(WitnessError::NoVictim)?;
            measured.handed_over_ms.push(handed.seconds_since(sent) * 1e3);
            measured.cores = words.next().and_then(|w| w.parse().ok()).unwrap_or(f64::NAN);
            match self.last_of(living, sent).await {
                Some(at) => measured.arrived_ms.push(at.seconds_since(sent) * 1e3),
                None => measured.missed += 1,
            }
            self.tell.write_all(b"next\n").await?;
        }
        self.child.kill().await?;
        Ok(measured)
    }

    /// When the stop was complete at the last of the ports that live.
    async fn last_of(&self, living: usize, sent: Timestamp) -> Option<Timestamp> {
        loop {
            let all: Option<Vec<_>> = self.ports[..living].iter().map(|p| p.lock().complete_at).collect();
            if let Some(all) = all {
                return all.into_iter().max();
            }
            if self.clock.now().since(sent) > MISSED {
                return None;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    fn break_a_port(&mut self) {
        let last = self.ports.len() - 1;
        match self.fault {
            Fault::None => {}
            Fault::Mute => self.ports[last].mute.store(true, Ordering::SeqCst),
            // Whoever holds the far end open lets go: the port hangs up.
            Fault::Gone => drop(self.ports.remove(last)),
        }
    }

    async fn line(&mut self) -> Result<String, WitnessError> {
        match tokio::time::timeout(PATIENCE, self.says.next_line()).await {
            Ok(Ok(Some(line))) => Ok(line),
            Ok(Err(e)) => Err(e.into()),
            _ => Err(WitnessError::NoVictim),
        }
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.served.abort();
    }
}

impl Port {
    fn lock(&self) -> std::sync::MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Seen {
    fn reset(&mut self) {
        self.bytes.clear();
        self.complete_at = None;
    }

    fn take(&mut self, bytes: &[u8], at: Timestamp) {
        self.bytes.extend(bytes);
        if self.complete_at.is_none() && self.bytes.windows(self.stop.len()).any(|w| w == self.stop) {
            self.complete_at = Some(at);
        }
    }
}

/// A port with an emulated controller on its far end.
fn open_port(setup: &Setup, settings: &MoverSettings) -> Result<(Port, String), WitnessError> {
    let spec = setup.protocols[&settings.protocol].clone();
    let described =
        spec.emulator.as_ref().ok_or_else(|| WitnessError::NoEmulator(settings.protocol.clone()))?;
    let clock = Clock::with_speed(SPEED);
    let options = EmulatorOptions::default();
    let emulator =
        Emulator::new(described, "port", &settings.axes, &options, World::without_pad(), clock.now())?;
    let stop = mover::stop_bytes(&spec, settings, StopKind::Controlled)?;
    let seen = Arc::new(Mutex::new(Seen { stop, ..Seen::default() }));
    let mute = Arc::new(AtomicBool::new(false));
    let Pty { stream, slave, clients } = pty()?;
    let tap = Tap { stream, seen: seen.clone(), mute: mute.clone(), clock: Clock::real_time() };
    let device = Arc::new(Mutex::new(Faulty::sound(emulator, clock.now())));
    let served = tokio::spawn(async move {
        if let Err(e) = serve(tap, &device, clock).await {
            tracing::debug!("a port of the witness: {e}");
        }
    });
    Ok((Port { seen, mute, served, _clients: clients }, slave.display().to_string()))
}

/// Notes when bytes come out of a port; and lets none out any more once it is mute.
struct Tap {
    stream: PtyStream,
    seen: Arc<Mutex<Seen>>,
    mute: Arc<AtomicBool>,
    clock: Clock,
}

impl AsyncRead for Tap {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        if self.mute.load(Ordering::SeqCst) {
            return Poll::Pending;
        }
        let before = buf.filled().len();
        let polled = Pin::new(&mut self.stream).poll_read(cx, buf);
        if matches!(polled, Poll::Ready(Ok(()))) {
            let at = self.clock.now();
            self.seen.lock().unwrap_or_else(PoisonError::into_inner).take(&buf.filled()[before..], at);
        }
        polled
    }
}

impl AsyncWrite for Tap {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
