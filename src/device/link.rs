//! The link to one serial device: a task that owns the stream and the protocol engine.
//!
//! The task writes what the engine wants sent, hands it what arrives, and wakes it in time. It works
//! over anything that reads and writes: a serial port, a pseudo-terminal, a pipe of a test.
//!
//! *Stopping* bypasses every queue. [`StopHandle::stop`] may be called from any thread; where the
//! stream has a second door ([`UrgentWrite`], a duplicate of the port's descriptor) the stop's bytes
//! are on the wire when it returns, even if the task is starved of processor time. A gate shared by
//! both sides makes sure that no command follows the stop's bytes: the task looks at the stop flag
//! under the same lock under which it writes.

mod outgoing;

use super::byte_log::{ByteLog, Direction, Input};
use crate::clock::{Clock, Timestamp};
use crate::protocol::{Engine, Event, Failure, Outcome, Reading, Request, StopKind, Ticket};
pub(crate) use outgoing::Outgoing;
use std::collections::HashMap;
use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::Poll;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::{Notify, mpsc, oneshot, watch};

/// In the order of their urgency; a stop's place here is one less than its level.
const STOP_KINDS: [StopKind; 3] = [StopKind::Controlled, StopKind::Homing, StopKind::Emergency];

/// A second door to a port, for bytes that must not wait.
pub trait UrgentWrite: Send + Sync {
    /// Writes without blocking; returns how many bytes went out.
    fn write_now(&self, bytes: &[u8]) -> io::Result<usize>;
}

/// What the link needs beside the stream.
#[derive(Default)]
pub struct LinkOptions {
    /// Where every byte is written down.
    pub log: Option<ByteLog>,
    /// The port's second door.
    pub urgent: Option<Box<dyn UrgentWrite>>,
}

/// What is known about the device at present.
#[derive(Debug, Clone, Default)]
pub struct Telemetry {
    /// The state, once reported.
    pub state: Option<crate::protocol::spec::MotionState>,
    /// Positions in the order of the axes.
    pub positions: Vec<Option<Reading>>,
    /// When the device first said that its last motion had ended ([`Engine::rested_at`]).
    pub rested_at: Option<Timestamp>,
    /// How often trust in the positions was lost.
    pub trust_losses: u64,
    /// Why it was lost last.
    pub last_loss: Option<String>,
    /// What the firmware introduced itself with.
    pub banner: Option<String>,
    /// The last thing the device said that is no reply of its protocol.
    pub strange: Option<String>,
    /// Why the link ended, once it has.
    pub ended: Option<String>,
    /// Stops begun, and stops whose steps have ended.
    pub stops: (u64, u64),
    /// Why the last stop's steps failed.
    pub stop_failure: Option<Failure>,
    /// Recoveries worth telling: lines sent again, stray replies.
    pub notes: u64,
}

enum Call {
    Request(Request, oneshot::Sender<Outcome>),
    Live,
}

struct Shared {
    gate: Mutex<Gate>,
    wanted: AtomicU8,
    written: AtomicBool,
    latched: AtomicBool,
    /// References are being searched for.
    homing: AtomicBool,
    stops: AtomicU64,
    notify: Notify,
    bytes: [Vec<u8>; 3],
}

/// Under this lock bytes are written.
struct Gate {
    /// The last write ended inside a line or frame.
    inside_unit: bool,
    /// The second door; given up when the link ends, so that the port is closed.
    urgent: Option<Box<dyn UrgentWrite>>,
}

/// Stops one device, from any thread, at once. Cheap to clone.
#[derive(Clone)]
pub struct StopHandle {
    shared: Arc<Shared>,
}

impl std::fmt::Debug for StopHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StopHandle").field("stopped", &self.is_stopped()).finish()
    }
}

impl StopHandle {
    /// Stops the device. Returns true when the stop's bytes are with the operating system already;
    /// otherwise the link's task writes them next.
    pub fn stop(&self, kind: StopKind) -> bool {
        let shared = &self.shared;
        let kind = if shared.homing.load(Ordering::SeqCst) { kind.max(StopKind::Homing) } else { kind };
        let (level, bytes) = (kind as u8 + 1, &shared.bytes[kind as usize]);
        let gate = shared.gate.lock().unwrap_or_else(PoisonError::into_inner);
        shared.latched.store(true, Ordering::SeqCst);
        shared.wanted.fetch_max(level, Ordering::SeqCst);
        shared.stops.fetch_add(1, Ordering::SeqCst);
        let direct = gate.urgent.as_ref().filter(|_| !gate.inside_unit);
        let written = direct.is_some_and(|d| matches!(d.write_now(bytes), Ok(n) if n == bytes.len()));
        shared.written.store(written, Ordering::SeqCst);
        drop(gate);
        shared.notify.notify_one();
        written
    }

    /// Whether a stop was called and motion is not yet allowed again.
    pub fn is_stopped(&self) -> bool {
        self.shared.latched.load(Ordering::SeqCst)
    }
}

/// The caller's end of a link.
#[derive(Debug)]
pub struct Link {
    calls: mpsc::UnboundedSender<Call>,
    telemetry: watch::Receiver<Telemetry>,
    stop: StopHandle,
}

impl Link {
    /// Starts the task on the present tokio runtime.
    pub fn start<S>(stream: S, engine: Engine, clock: Clock, options: LinkOptions) -> Link
    where
        S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let shared = Arc::new(Shared {
            gate: Mutex::new(Gate { inside_unit: false, urgent: options.urgent }),
            wanted: AtomicU8::new(0),
            written: AtomicBool::new(false),
            latched: AtomicBool::new(false),
            homing: AtomicBool::new(false),
            stops: AtomicU64::new(0),
            notify: Notify::new(),
            bytes: STOP_KINDS.map(|kind| engine.stop_bytes(kind)),
        });
        let (calls, incoming) = mpsc::unbounded_channel();
        let (sender, telemetry) = watch::channel(Telemetry::default());
        let stop = StopHandle { shared: shared.clone() };
        let pending = Outgoing::new(engine.spec().clone());
        let task = LinkTask {
            engine,
            clock,
            shared,
            calls: incoming,
            telemetry: sender,
            log: options.log,
            waiting: HashMap::new(),
            pending,
            stops_seen: (0, 0),
            stop_tickets: Vec::new(),
            known: Telemetry::default(),
        };
        tokio::spawn(task.run(stream));
        Link { calls, telemetry, stop }
    }

    /// Asks something of the device and waits for the end of it.
    pub async fn call(&self, request: Request) -> Outcome {
        let (done, ended) = oneshot::channel();
        let gone = || Failure::LinkLost(self.telemetry.borrow().ended.clone().unwrap_or_default());
        self.calls.send(Call::Request(request, done)).map_err(|_| gone())?;
        ended.await.unwrap_or_else(|_| Err(gone()))
    }

    /// Says whether references are being searched for; a stop is then one that ends the search.
    pub fn set_homing(&self, homing: bool) {
        self.stop.shared.homing.store(homing, Ordering::SeqCst);
    }

    /// From now on an unexpected banner means a restart.
    pub fn set_live(&self) {
        // A link that has ended needs no telling.
        let _ = self.calls.send(Call::Live);
    }

    /// What is known at present.
    pub fn telemetry(&self) -> Telemetry {
        self.telemetry.borrow().clone()
    }

    /// Follows what is known.
    pub fn watch(&self) -> watch::Receiver<Telemetry> {
        self.telemetry.clone()
    }

    /// The handle that stops this device.
    pub fn stop_handle(&self) -> StopHandle {
        self.stop.clone()
    }

    /// Waits until the steps of every stop have ended, then allows motion again.
    pub async fn finish_stop(&self) -> Result<(), Failure> {
        let wanted = self.stop.shared.stops.load(Ordering::SeqCst);
        let mut telemetry = self.telemetry.clone();
        let done = |t: &Telemetry| t.ended.is_some() || (t.stops.0 >= wanted && t.stops.0 == t.stops.1);
        let known = match telemetry.wait_for(done).await {
            Ok(known) => known.clone(),
            Err(_) => self.telemetry(),
        };
        if let Some(reason) = known.ended {
            return Err(Failure::LinkLost(reason));
        }
        self.stop.shared.latched.store(false, Ordering::SeqCst);
        known.stop_failure.map_or(Ok(()), Err)
    }
}

struct LinkTask {
    engine: Engine,
    clock: Clock,
    shared: Arc<Shared>,
    calls: mpsc::UnboundedReceiver<Call>,
    telemetry: watch::Sender<Telemetry>,
    log: Option<ByteLog>,
    waiting: HashMap<Ticket, oneshot::Sender<Outcome>>,
    pending: Outgoing,
    stops_seen: (u64, u64),
    stop_tickets: Vec<Ticket>,
    known: Telemetry,
}

impl LinkTask {
    async fn run<S: AsyncRead + AsyncWrite + Unpin>(mut self, stream: S) {
        let (mut reader, mut writer) = tokio::io::split(stream);
        let mut buffer = [0u8; 1024];
        // The engine is called only at instants that are in the log, each with what it is told then: so a replay does
        // what was done here, to the nanosecond. Bytes that were written tell it nothing.
        let mut wake = self.turn(self.clock.now());
        let ended = loop {
            let far = self.clock.now().after(Duration::from_secs(3600));
            let until = wake.unwrap_or(far);
            let writes = !self.pending.is_empty();
            let shared = self.shared.clone();
            let told_at = tokio::select! {
                biased;
                () = shared.notify.notified() => None,
                result = write_some(&shared, &mut writer, &self.pending), if writes => match result {
                    Ok(Some(n)) => {
                        self.wrote(n);
                        None
                    }
                    Ok(None) => None,
                    Err(e) => break format!("writing failed: {e}"),
                },
                result = reader.read(&mut buffer) => match result {
                    Ok(0) => break "the device hung up".to_owned(),
                    Ok(n) => Some(self.received(&buffer[..n])),
                    Err(e) => break format!("reading failed: {e}"),
                },
                call = self.calls.recv() => match call {
                    Some(call) => Some(self.call(call)),
                    None => {
                        self.abandon(&mut writer).await;
                        self.close_door();
                        return;
                    }
                },
                () = self.clock.sleep_until(until) => Some(self.note_down(Input::Wake)),
            };
            if let Some(now) = told_at {
                wake = self.turn(now);
            }
            if let Some(now) = self.take_stop() {
                wake = self.turn(now);
            }
        };
        self.close_door();
        let lost_at = self.note_down(Input::Lost(ended.clone()));
        self.engine.link_lost(&ended);
        self.known.ended = Some(ended);
        self.turn(lost_at);
        self.refuse_calls();
    }

    /// Lets the engine do what is due at the instant of what it was told last; returns when to call again.
    fn turn(&mut self, now: Timestamp) -> Option<Timestamp> {
        let output = self.engine.poll(now);
        self.pending.push_urgent(output.urgent);
        self.pending.push(output.bytes);
        let mut answers = Vec::new();
        for event in output.events {
            answers.extend(self.on_event(event, now));
        }
        // Whoever is answered must find the telemetry that led to the answer, on whatever thread it runs.
        self.publish();
        for (done, outcome) in answers {
            // The caller may have given up waiting.
            let _ = done.send(outcome);
        }
        output.wake.map(|at| Timestamp(at.0.max(now.0)))
    }

    /// A stop that was called: whatever waits is dropped, in the engine, here, and in the channel. Answers when.
    fn take_stop(&mut self) -> Option<Timestamp> {
        let (level, written, calls) = {
            let _gate = self.shared.gate.lock().unwrap_or_else(PoisonError::into_inner);
            let level = self.shared.wanted.swap(0, Ordering::SeqCst);
            let written = self.shared.written.swap(false, Ordering::SeqCst);
            (level, written, self.shared.stops.load(Ordering::SeqCst))
        };
        let kind = usize::from(level).checked_sub(1).and_then(|at| STOP_KINDS.get(at)).copied()?;
        self.pending.drop_unbegun();
        let now = self.note_down(Input::Stop { kind, written });
        self.stops_seen.0 = calls;
        let ticket = self.engine.urgent(kind, written, now);
        self.stop_tickets.push(ticket);
        if written {
            let bytes = self.shared.bytes[kind as usize].clone();
            self.write_down(now, Direction::Stop, &bytes);
        }
        while let Ok(call) = self.calls.try_recv() {
            match call {
                Call::Request(_, done) => drop(done.send(Err(Failure::Stopped))),
                Call::Live => _ = self.set_live(),
            }
        }
        Some(now)
    }

    fn wrote(&mut self, n: usize) {
        let bytes = self.pending.wrote(n);
        self.write_down(self.clock.now(), Direction::Sent, &bytes);
    }

    fn received(&mut self, bytes: &[u8]) -> Timestamp {
        let now = self.clock.now();
        self.write_down(now, Direction::Received, bytes);
        self.engine.receive(bytes, now);
        now
    }

    fn write_down(&mut self, at: Timestamp, direction: Direction, bytes: &[u8]) {
        self.in_log(|log| log.bytes(at, direction, bytes));
    }

    /// Writes down what the engine is told beside bytes, now.
    fn note_down(&mut self, input: Input) -> Timestamp {
        let at = self.clock.now();
        self.in_log(|log| log.input(at, &input));
        at
    }

    fn in_log(&mut self, write: impl FnOnce(&mut ByteLog) -> io::Result<()>) {
        if let Some(log) = &mut self.log
            && let Err(e) = write(log)
        {
            tracing::warn!("the byte log cannot be written and ends here: {e}");
            self.log = None;
        }
    }

    fn set_live(&mut self) -> Timestamp {
        let at = self.note_down(Input::Live);
        self.engine.set_live();
        at
    }

    fn call(&mut self, call: Call) -> Timestamp {
        match call {
            Call::Live => self.set_live(),
            Call::Request(request, done) => {
                let at = self.note_down(Input::Request(request.clone()));
                let ticket = self.engine.submit(request);
                self.waiting.insert(ticket, done);
                at
            }
        }
    }

    /// Takes in an event; what a caller is to be told comes back.
    fn on_event(&mut self, event: Event, now: Timestamp) -> Option<(oneshot::Sender<Outcome>, Outcome)> {
        match event {
            Event::Finished(ticket, outcome) => {
                self.in_log(|log| log.outcome(now, ticket, &outcome));
                if let Some(at) = self.stop_tickets.iter().position(|t| *t == ticket) {
                    self.stop_tickets.remove(at);
                    // A second stop ends the first one's steps; only the last one's end counts.
                    if self.stop_tickets.is_empty() {
                        self.stops_seen.1 = self.stops_seen.0;
                        self.known.stop_failure = outcome.err();
                        if let Some(failure) = self.known.stop_failure.clone() {
                            self.lost(format!("the stop did not end as it should: {failure}"));
                        }
                    }
                } else if let Some(done) = self.waiting.remove(&ticket) {
                    return Some((done, outcome));
                }
            }
            Event::TrustLost(reason) => {
                self.in_log(|log| log.remark(now, &format!("trust lost: {reason}")));
                self.lost(reason);
            }
            Event::Banner { text, expected } => {
                if !expected {
                    tracing::warn!("the device restarted by itself: {text}");
                }
            }
            Event::Alarm { code, text } => {
                self.in_log(|log| log.remark(now, &format!("alarm {code}: {text}")));
                tracing::warn!("alarm {code}: {text}");
            }
            Event::Flag { code, text } => {
                self.in_log(|log| log.remark(now, &format!("flag {code}: {text}")));
                tracing::warn!("the device reports {code}: {text}");
            }
            Event::Note(text) => {
                self.known.notes += 1;
                tracing::debug!("{text}");
                self.in_log(|log| log.remark(now, &text));
            }
        }
        None
    }

    fn lost(&mut self, reason: String) {
        self.known.trust_losses += 1;
        self.known.last_loss = Some(reason);
    }

    fn publish(&mut self) {
        self.known.state = self.engine.state();
        self.known.positions = self.engine.positions();
        self.known.rested_at = self.engine.rested_at();
        self.known.banner = self.engine.banner().map(str::to_owned);
        self.known.strange = self.engine.strange().map(str::to_owned);
        self.known.stops = self.stops_seen;
        self.telemetry.send_replace(self.known.clone());
    }

    /// The owner is gone. A device in motion is stopped; nothing else is sent.
    async fn abandon<W: AsyncWrite + Unpin>(&mut self, writer: &mut W) {
        let moving = self.engine.is_busy()
            || !matches!(self.engine.state(), None | Some(crate::protocol::spec::MotionState::Idle));
        if moving && !self.shared.latched.load(Ordering::SeqCst) {
            let mut bytes = self.pending.rest_of_unit().unwrap_or_default();
            let homing = self.shared.homing.load(Ordering::SeqCst);
            let kind = if homing { StopKind::Homing } else { StopKind::Controlled };
            bytes.extend(&self.shared.bytes[kind as usize]);
            // Nobody is left to tell when the port does not take them.
            let _ = tokio::time::timeout(Duration::from_millis(200), writer.write_all(&bytes)).await;
            self.write_down(self.clock.now(), Direction::Stop, &bytes);
        }
    }

    fn close_door(&self) {
        self.shared.gate.lock().unwrap_or_else(PoisonError::into_inner).urgent = None;
    }

    fn refuse_calls(&mut self) {
        let reason = self.known.ended.clone().unwrap_or_default();
        self.calls.close();
        while let Ok(call) = self.calls.try_recv() {
            if let Call::Request(_, done) = call {
                let _ = done.send(Err(Failure::LinkLost(reason.clone())));
            }
        }
    }
}

/// Writes some of the first chunk; `None` when a stop was called meanwhile.
async fn write_some<W: AsyncWrite + Unpin>(
    shared: &Shared,
    writer: &mut W,
    pending: &Outgoing,
) -> io::Result<Option<usize>> {
    let Some(chunk) = pending.front() else { return Ok(None) };
    poll_fn(|context| {
        let mut gate = shared.gate.lock().unwrap_or_else(PoisonError::into_inner);
        if shared.wanted.load(Ordering::SeqCst) != 0 {
            return Poll::Ready(Ok(None));
        }
        match Pin::new(&mut *writer).poll_write(context, chunk) {
            Poll::Ready(Ok(0)) => Poll::Ready(Err(io::ErrorKind::WriteZero.into())),
            Poll::Ready(Ok(n)) => {
                gate.inside_unit = n < chunk.len();
                Poll::Ready(Ok(Some(n)))
            }
            Poll::Ready(Err(e)) => Poll::Ready(Err(e)),
            Poll::Pending => Poll::Pending,
        }
    })
    .await
}
