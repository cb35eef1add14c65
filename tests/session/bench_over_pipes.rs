//! A virtual rig file's bench, with pipes for ports: everything that was sent can be read back, every
//! device and the camera can be broken, and what is true can be asked of the world.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, DuplexStream, ReadBuf};
use twinrig::assemble::session_settings;
use twinrig::clock::{Clock, Timestamp};
use twinrig::config::{self, Setup};
use twinrig::device::mover::{Mover, MoverError};
use twinrig::device::virtual_bench::picture::look::SensorLook;
use twinrig::device::virtual_bench::serve::{SharedDevice, serve, with};
use twinrig::device::virtual_bench::{
    CameraFaults, Emulator, EmulatorOptions, Fault, FaultKind, FaultPlan, Faulty, Trigger, VirtualCamera,
    World,
};
use twinrig::pose::Pose;
use twinrig::protocol::StopKind;
use twinrig::session::{Bench, Event, Session, SessionError, StopLevel, StopSwitch};

/// A rig file's overrides and a plan.
pub struct Wanted {
    rig: &'static str,
    plan: &'static str,
    pub sets: Vec<String>,
    /// Whether the camera has the sensor's raster; else a coarse one, which is much cheaper to draw.
    full_raster: bool,
}

fn wanted(plan: &'static str, sets: &[&str]) -> Wanted {
    Wanted { rig: "virtual", plan, sets: sets.iter().map(|s| (*s).to_owned()).collect(), full_raster: false }
}

const SPHERE: &str = "plan.indenters=[{ name = \"sphere\", edge_round_mm = 0.0 }]";
const GIVEN: &str = "plan.contact={ zero_mm = 0.0 }";

/// One indenter, left and right, 3 captures each; the contact is given.
pub fn slip() -> Wanted {
    wanted("slip", &[SPHERE, GIVEN, "plan.slide.distance_mm=2"])
}

/// One indenter, four depths; the contact is given.
pub fn press() -> Wanted {
    wanted("small", &[])
}

/// A slip of one capture with touch-off, as the paper's plan does it.
pub fn touching(indenter: &str) -> Wanted {
    let indenters = format!("plan.indenters=[{{ name = \"{indenter}\", edge_round_mm = 0.3 }}]");
    let mut wanted =
        wanted("slip", &[&indenters, "plan.slide.distance_mm=1", "plan.slide.directions=[\"left\"]"]);
    wanted.full_raster = true;
    wanted
}

/// The press plan on a bench with the roles changed: GRBL presses, Marlin goes sideways.
pub fn pressed_by_grbl() -> Wanted {
    wanted(
        "small",
        &[
            "motion.z={ device = \"stage\", axis = \"x\", sign = 1, origin = -30.0 }",
            "motion.x={ device = \"arm\", axis = \"y\", sign = 1, origin = 30.0 }",
            "motion.y={ device = \"arm\", axis = \"z\", sign = 1, origin = 30.0 }",
            "devices.stage.axes.x.tolerance=0.01",
        ],
    )
}

/// The same plans on the servo arm, which does everything by itself.
pub fn by_servo_arm(wanted: Wanted) -> Wanted {
    Wanted { rig: "servo_arm", ..wanted }
}

/// A bench that stands ready.
pub struct TestBench {
    pub bench: Bench,
    pub world: World,
    pub camera: CameraFaults,
    pub clock: Clock,
    setup: Setup,
    devices: BTreeMap<String, SharedDevice>,
    sent: BTreeMap<String, Sent>,
    started: BTreeMap<String, Timestamp>,
    answer: Option<bool>,
    mounts: bool,
    struck_at: Arc<Mutex<Option<Timestamp>>>,
}

/// A bench that could not be put together.
#[derive(Debug)]
pub struct Refused {
    pub error: MoverError,
    /// How far any axis has truly moved since, and within ten seconds.
    pub moved_by: f64,
}

/// Every axis of every device of a rig.
fn axes(setup: &Setup) -> Vec<(String, String)> {
    let each = setup.rig.devices.iter();
    each.flat_map(|(device, mover)| mover.axes.keys().map(|axis| (device.clone(), axis.clone()))).collect()
}

fn true_axes(setup: &Setup, world: &World, now: Timestamp) -> Vec<f64> {
    axes(setup).iter().map(|(device, axis)| world.position(device, axis, now)).collect()
}

impl TestBench {
    /// Connects everything; nothing moves.
    pub async fn new(wanted: &Wanted) -> Result<TestBench, Refused> {
        Self::with_faults(wanted, &BTreeMap::new()).await
    }

    /// As [`TestBench::new`], with devices whose dialogue will go wrong.
    pub async fn with_faults(
        wanted: &Wanted,
        faults: &BTreeMap<String, FaultPlan>,
    ) -> Result<TestBench, Refused> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig_configs");
        let plan = root.join(format!("plans/{}.toml", wanted.plan));
        let setup = config::load(&root.join(format!("{}.toml", wanted.rig)), Some(&plan), &wanted.sets)
            .unwrap_or_else(|e| panic!("{e}"));
        let clock = Clock::real_time();
        let rig = &setup.rig;
        let world = World::with_arms(rig.motion.clone(), rig.arms(), rig.world.unwrap().contact_offset_mm);
        let stop = StopSwitch::new();
        let (mut devices, mut sent, mut movers) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        let mut started = BTreeMap::new();
        for (name, settings) in &rig.devices {
            let spec = setup.protocols[&settings.protocol].clone();
            let (table, now) = (spec.emulator.as_ref().unwrap(), clock.now());
            let options = EmulatorOptions::default();
            let emulator = Emulator::new(table, name, &settings.axes, &options, world.clone(), now).unwrap();
            let device: SharedDevice = {
                let plan = faults.get(name).cloned().unwrap_or_default();
                Arc::new(Mutex::new(Faulty::new(emulator, plan, now)))
            };
            let (near, far) = tokio::io::duplex(4096);
            let served = device.clone();
            tokio::spawn(async move { serve(far, &served, clock).await });
            let record = Sent::default();
            let before = true_axes(&setup, &world, clock.now());
            let tap = Tap { stream: near, sent: record.clone() };
            let mover = match Mover::connect(tap, spec, settings.clone(), clock).await {
                Ok(mover) => mover,
                Err(error) => {
                    clock.sleep(Duration::from_secs(10)).await;
                    let after = true_axes(&setup, &world, clock.now());
                    let moved = before.iter().zip(&after).map(|(b, a)| (a - b).abs());
                    return Err(Refused { error, moved_by: moved.fold(0.0, f64::max) });
                }
            };
            let handle = mover.stop_handle();
            let kind = |level| match level {
                StopLevel::Emergency => StopKind::Emergency,
                _ => StopKind::Controlled,
            };
            stop.register(name, Box::new(move |level| _ = handle.stop(kind(level))));
            movers.insert(name.clone(), mover);
            devices.insert(name.clone(), device);
            sent.insert(name.clone(), record);
            started.insert(name.clone(), now);
        }
        let look = match (wanted.full_raster, &setup.sensor) {
            (true, Some(sensor)) => {
                let camera = &sensor.optics.camera;
                SensorLook::white_skin(camera.width_px as u32, camera.height_px as u32, camera.mm_per_px)
            }
            _ => SensorLook::white_skin(96, 72, 0.2),
        };
        let camera = VirtualCamera::new(&rig.camera, look, world.clone(), clock);
        let faults = camera.faults();
        let bench = Bench {
            movers,
            map: rig.motion.clone(),
            camera: Box::new(camera),
            clock,
            stop,
            reached: None,
            rested_at: None,
            settled_at: None,
        };
        let (answer, mounts, struck_at) = (Some(true), true, Arc::default());
        Ok(TestBench {
            bench,
            world,
            camera: faults,
            clock,
            setup,
            devices,
            sent,
            started,
            answer,
            mounts,
            struck_at,
        })
    }

    /// What the operator will say to every indenter; `None`: nothing, ever.
    pub fn operator_answers(&mut self, answer: Option<bool>) {
        self.answer = answer;
    }

    /// The operator says yes and mounts nothing.
    pub fn mounts_nothing(&mut self) {
        self.mounts = false;
    }

    /// A session over the plan; answers how it ended and what it told.
    pub async fn run(&mut self, done: &BTreeSet<u32>) -> (Result<(), SessionError>, Vec<Event>) {
        self.run_with(done, |_| true).await
    }

    /// As [`TestBench::run`]; `watch` sees every event as it comes and answers whether to receive more.
    pub async fn run_with(
        &mut self,
        done: &BTreeSet<u32>,
        mut watch: impl FnMut(&Event) -> bool + Send + 'static,
    ) -> (Result<(), SessionError>, Vec<Event>) {
        let plan = self.setup.plan.as_ref().unwrap();
        let (world, bodies) = (self.world.clone(), plan.bodies());
        let (answer, mounts) = (self.answer, self.mounts);
        let (events, mut received) = tokio::sync::mpsc::channel(1);
        let session = Session {
            settings: session_settings(&self.setup, plan),
            operator: Box::new(move |indenter| {
                world.mount(bodies.get(indenter).filter(|_| mounts).cloned());
                Box::pin(async move {
                    match answer {
                        Some(answer) => answer,
                        None => std::future::pending().await,
                    }
                })
            }),
            contact_zero_mm: BTreeMap::new(),
            bench: &mut self.bench,
            trajectory: &plan.trajectory,
            events,
        };
        let receiving = tokio::spawn(async move {
            let mut told = Vec::new();
            while let Some(event) = received.recv().await {
                let go_on = watch(&event);
                told.push(event);
                if !go_on {
                    break;
                }
            }
            told
        });
        let result = session.run(done).await;
        (result, receiving.await.unwrap())
    }

    /// A watcher that makes a device fail so long after a capture was told.
    pub fn strike_after_capture(
        &self,
        capture: u32,
        name: &str,
        what: FaultKind,
        after_ms: u64,
    ) -> impl FnMut(&Event) -> bool + Send + 'static {
        let (device, clock) = (self.devices[name].clone(), self.clock);
        let struck_at = self.struck_at.clone();
        // A fault by the clock counts from power-up.
        let started = self.started[name];
        move |event| {
            if matches!(event, Event::Captured(c) if c.capture == capture) {
                let now = clock.now();
                let at = now.after(Duration::from_millis(after_ms));
                let after = at.since(started);
                with(&device, |d| d.strike_later(Fault { at: Trigger::After(after), what: what.clone() }));
                *struck_at.lock().unwrap() = Some(at);
            }
            true
        }
    }

    /// Makes a device fail so long after now.
    pub fn strike_after(&self, name: &str, what: FaultKind, after_ms: u64) {
        let at = self.clock.now().after(Duration::from_millis(after_ms)).since(self.started[name]);
        with(&self.devices[name], |d| d.strike_later(Fault { at: Trigger::After(at), what }));
    }

    /// When the fault of [`TestBench::strike_after_capture`] was due.
    pub fn struck_at(&self) -> Timestamp {
        self.struck_at.lock().unwrap().expect("a fault was planned")
    }

    /// How many bytes a device has replied.
    pub fn reply_bytes(&self, device: &str) -> u64 {
        with(&self.devices[device], |d| d.reply_bytes())
    }

    /// Whether the fault planned for a device has struck.
    pub fn has_struck(&self, device: &str) -> bool {
        with(&self.devices[device], |d| !d.struck().is_empty())
    }

    /// Everything that was sent to a device, as text.
    pub fn sent(&self, device: &str) -> String {
        String::from_utf8_lossy(&self.sent[device].0.lock().unwrap()).into_owned()
    }

    /// Where the indenter truly is, relative to the nominal contact.
    pub fn true_pose(&self, at: Timestamp) -> Pose {
        let pose = self.world.scene_at(at).pose;
        Pose { z_mm: pose.z_mm + self.world.contact_offset_mm(), ..pose }
    }

    /// How high the indenter truly is now, above the nominal contact.
    pub fn height_mm(&self) -> f64 {
        self.true_pose(self.clock.now()).z_mm
    }

    /// Nothing moves now, nor during the next minute.
    pub async fn assert_at_rest_from_now_on(&self) {
        let before = true_axes(&self.setup, &self.world, self.clock.now());
        self.clock.sleep(Duration::from_secs(60)).await;
        assert_eq!(
            true_axes(&self.setup, &self.world, self.clock.now()),
            before,
            "something moves after the end"
        );
    }
}

impl TestBench {
    /// What the faulty device was doing when it was lost it may finish; nothing else begins to move.
    pub async fn assert_ends_at_rest(&self, faulty: &str, tried: &str) {
        let now = |b: &Self| true_axes(&b.setup, &b.world, b.clock.now());
        let before = now(self);
        self.clock.sleep(Duration::from_secs(60)).await;
        let finished = now(self);
        for (i, (device, axis)) in axes(&self.setup).iter().enumerate() {
            assert!(
                *device == faulty || before[i] == finished[i],
                "{tried}: {device} {axis} moves after the end"
            );
        }
        self.clock.sleep(Duration::from_secs(60)).await;
        assert_eq!(now(self), finished, "{tried}: something moves a minute after the end");
    }
}

/// What went through a port.
#[derive(Clone, Default)]
struct Sent(Arc<Mutex<Vec<u8>>>);

/// A pipe that remembers what is written to it.
struct Tap {
    stream: DuplexStream,
    sent: Sent,
}

impl AsyncRead for Tap {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl AsyncWrite for Tap {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        if let Poll::Ready(Ok(n)) = written {
            self.sent.0.lock().unwrap().extend_from_slice(&bytes[..n]);
        }
        written
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
