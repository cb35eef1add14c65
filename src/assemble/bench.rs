//! A bench from its configuration: ports, or emulators behind pseudo-terminals; a camera, real or virtual.

use crate::clock::Clock;
use crate::config::{RigConfig, Setup};
use crate::device::camera::absent::AbsentCamera;
use crate::device::camera::settings::CameraSource;
use crate::device::camera::{Camera, CameraError, open};
use crate::device::mover::Mover;
use crate::device::port::{self, ConnectError};
use crate::device::settings::{MoverSettings, PortSettings};
use crate::device::virtual_bench::camera::VirtualCamera;
use crate::device::virtual_bench::picture::look::SensorLook;
use crate::device::virtual_bench::serve::pty::{PortOptions, serve_port};
use crate::device::virtual_bench::{Emulator, EmulatorError, EmulatorOptions, Faulty, World};
use crate::optics::sensor::SensorOptics;
use crate::protocol::Spec;
use crate::protocol::engine::StopKind;
use crate::session::{Bench, StopLevel, StopSwitch};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use tokio::sync::oneshot;
use tokio::task::JoinSet;

/// Why a bench could not be put together. Nothing has moved.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A device cannot be opened or does not answer as it should.
    #[error("device {device}: {source}")]
    Device {
        /// Device of the rig file.
        device: String,
        /// Why.
        source: ConnectError,
    },
    /// The camera cannot be opened.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The protocol has no emulator.
    #[error(
        "device {device}: protocol {protocol} has no [emulator] table, so it has no virtual port; give a real port or add the table"
    )]
    NoEmulator {
        /// Device of the rig file.
        device: String,
        /// Its protocol.
        protocol: String,
    },
    /// The emulator cannot be made.
    #[error("device {device}: {source}")]
    Emulator {
        /// Device of the rig file.
        device: String,
        /// Why.
        source: EmulatorError,
    },
    /// The pseudo-terminal cannot be made.
    #[error("device {device}: no pseudo-terminal: {why}")]
    Terminal {
        /// Device of the rig file.
        device: String,
        /// The system's reason.
        why: String,
    },
    /// A real bench cannot be hurried.
    #[error("--speed {speed} is for virtual benches; {rig} has real devices: leave --speed out")]
    RealTimeOnly {
        /// What was asked.
        speed: f64,
        /// The rig.
        rig: String,
    },
}

/// A bench that stands ready.
pub struct Assembled {
    /// Devices, camera, clock.
    pub bench: Bench,
    /// The world of a virtual bench.
    pub world: Option<World>,
    /// Emulators at work; they end with this value.
    _emulators: JoinSet<()>,
}

/// What a caller wants otherwise than the rig file says.
#[derive(Debug, Clone, Default)]
pub struct BenchOptions {
    /// Times faster than real time, virtual benches only; 0 means 1.
    pub speed: f64,
    /// Folder for the byte logs of all ports.
    pub logs: Option<PathBuf>,
    /// Leave the camera alone: for commands that only move.
    pub no_camera: bool,
}

/// Only a virtual bench knows another time than the wall's.
pub fn can_run_at(setup: &Setup, speed: f64) -> bool {
    speed == 1.0 || setup.rig.is_virtual()
}

/// Opens everything and verifies who answers. Nothing moves.
pub async fn bench(setup: &Setup, options: &BenchOptions, stop: StopSwitch) -> Result<Assembled, BenchError> {
    let rig = &setup.rig;
    let speed = if options.speed > 0.0 { options.speed } else { 1.0 };
    if !can_run_at(setup, speed) {
        return Err(BenchError::RealTimeOnly { speed, rig: rig.name.clone() });
    }
    let clock = Clock::with_speed(speed);
    let world = rig.world.map(|w| World::with_arms(rig.motion.clone(), rig.arms(), w.contact_offset_mm));
    let mut emulators = JoinSet::new();
    let mut movers = BTreeMap::new();
    for (device, settings) in &rig.devices {
        let spec = setup.protocols[&settings.protocol].clone();
        let port = match (&world, settings.port.is_virtual()) {
            (Some(world), true) => {
                let path = emulate(device, settings, &spec, world.clone(), clock, &mut emulators).await?;
                PortSettings::Path(path.display().to_string())
            }
            _ => settings.port.clone(),
        };
        let mover = connect(device, settings, &port, spec, clock, options).await?;
        let handle = mover.stop_handle();
        stop.register(
            device,
            Box::new(move |level| {
                _ = handle.stop(if level == StopLevel::Emergency {
                    StopKind::Emergency
                } else {
                    StopKind::Controlled
                });
            }),
        );
        movers.insert(device.clone(), mover);
    }
    let camera = match options.no_camera {
        true => Box::new(AbsentCamera::default()),
        false => camera(rig, setup.sensor.as_ref().map(|s| &s.optics), world.as_ref(), clock).await?,
    };
    let bench = Bench {
        movers,
        map: rig.motion.clone(),
        camera,
        clock,
        stop,
        reached: None,
        rested_at: None,
        settled_at: None,
    };
    Ok(Assembled { bench, world, _emulators: emulators })
}

/// The devices of a real rig, each opened by itself, so that one that is dead hides no other.
pub async fn movers_alone(setup: &Setup) -> BTreeMap<String, Result<Mover, BenchError>> {
    let mut opening = JoinSet::new();
    for (device, settings) in setup.rig.devices.clone() {
        let spec = setup.protocols[&settings.protocol].clone();
        opening.spawn(async move {
            let (clock, options) = (Clock::real_time(), BenchOptions::default());
            let mover = connect(&device, &settings, &settings.port, spec, clock, &options).await;
            (device, mover)
        });
    }
    opening.join_all().await.into_iter().collect()
}

/// Writes the stop bytes of every device of a real rig, each on a thread of its own, without waiting for
/// anybody's answer; answers per device what was written.
pub fn stop_ports(setup: &Setup, kind: StopKind) -> BTreeMap<String, Result<Vec<u8>, BenchError>> {
    let threads: Vec<_> = setup
        .rig
        .devices
        .clone()
        .into_iter()
        .map(|(device, settings)| {
            let spec = setup.protocols[&settings.protocol].clone();
            let runtime = tokio::runtime::Handle::current();
            std::thread::spawn(move || {
                // The port registers itself with the runtime.
                let _entered = runtime.enter();
                let failed = |source| BenchError::Device { device: device.clone(), source };
                let stopped = port::resolve(&settings.port)
                    .map_err(ConnectError::from)
                    .and_then(|path| port::write_stop(&path, &spec, &settings, kind))
                    .map_err(failed);
                (device, stopped)
            })
        })
        .collect();
    threads.into_iter().filter_map(|thread| thread.join().ok()).collect()
}

async fn connect(
    device: &str,
    settings: &MoverSettings,
    port: &PortSettings,
    spec: Arc<Spec>,
    clock: Clock,
    options: &BenchOptions,
) -> Result<Mover, BenchError> {
    let failed = |source| BenchError::Device { device: device.to_owned(), source };
    let path = port::resolve(port).map_err(|e| failed(e.into()))?;
    let log = options.logs.as_ref().map(|folder| folder.join(format!("{device}.log")));
    if let Some(folder) = &options.logs {
        let unwritable = |source| failed(ConnectError::Log { path: folder.clone(), source });
        std::fs::create_dir_all(folder).map_err(unwritable)?;
    }
    port::connect(&path, spec, settings.clone(), clock, log.as_deref()).await.map_err(failed)
}

/// Starts an emulator behind a pseudo-terminal and answers the path to open.
async fn emulate(
    device: &str,
    settings: &MoverSettings,
    spec: &Spec,
    world: World,
    clock: Clock,
    emulators: &mut JoinSet<()>,
) -> Result<PathBuf, BenchError> {
    let name = device.to_owned();
    let described = spec.emulator.as_ref().ok_or_else(|| BenchError::NoEmulator {
        device: name.clone(),
        protocol: settings.protocol.clone(),
    })?;
    let options = EmulatorOptions { baud: settings.baud, ..EmulatorOptions::default() };
    let emulator = Emulator::new(described, device, &settings.axes, &options, world, clock.now())
        .map_err(|source| BenchError::Emulator { device: name.clone(), source })?;
    let shared = Arc::new(Mutex::new(Faulty::sound(emulator, clock.now())));
    let (ready, path) = oneshot::channel();
    let (failed, failure) = oneshot::channel();
    emulators.spawn(async move {
        let options = PortOptions::default();
        let served = serve_port(&shared, clock, &options, |path| {
            _ = ready.send(path.to_owned());
        });
        if let Err(e) = served.await {
            tracing::error!("an emulator ended: {e}");
            _ = failed.send(e.to_string());
        }
    });
    match path.await {
        Ok(path) => Ok(path),
        Err(_) => {
            let why = failure.await.unwrap_or_else(|_| "the emulator ended at once".to_owned());
            Err(BenchError::Terminal { device: name, why })
        }
    }
}

async fn camera(
    rig: &RigConfig,
    sensor: Option<&SensorOptics>,
    world: Option<&World>,
    clock: Clock,
) -> Result<Box<dyn Camera>, CameraError> {
    match (rig.camera.source, world) {
        (CameraSource::Virtual, Some(world)) => {
            let camera = VirtualCamera::new(&rig.camera, look(rig, sensor), world.clone(), clock);
            open::ready(Box::new(camera), &rig.camera, clock).await
        }
        _ => open::open(&rig.camera, clock).await,
    }
}

/// The virtual camera's look: its own cheap model, but size, scale and colours of the sensor.
fn look(rig: &RigConfig, sensor: Option<&SensorOptics>) -> SensorLook {
    let Some(sensor) = sensor else {
        return SensorLook::gelsight(rig.camera.width, rig.camera.height, DEFAULT_MM_PER_PX);
    };
    let camera = &sensor.camera;
    let (width, height) = (camera.width_px as u32, camera.height_px as u32);
    let is_white = sensor.lights.iter().all(|l| l.rgb[0] == l.rgb[1] && l.rgb[1] == l.rgb[2]);
    if is_white {
        SensorLook::white_skin(width, height, camera.mm_per_px)
    } else {
        SensorLook::gelsight(width, height, camera.mm_per_px)
    }
}

/// Scale of a virtual camera that no sensor describes: 18 mm across 640 pixels.
const DEFAULT_MM_PER_PX: f64 = 18.0 / 640.0;

/// The camera of a setup without its movers: what a single picture needs.
pub async fn camera_alone(setup: &Setup, clock: Clock) -> Result<Box<dyn Camera>, CameraError> {
    let world = setup
        .rig
        .world
        .map(|w| World::with_arms(setup.rig.motion.clone(), setup.rig.arms(), w.contact_offset_mm));
    camera(&setup.rig, setup.sensor.as_ref().map(|s| &s.optics), world.as_ref(), clock).await
}
