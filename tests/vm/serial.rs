//! Serial ports against a real kernel's drivers: a USB adapter (FTDI), a 16550 and its cable.
//!
//! Run by `tests/vm/run`, which brings a virtual machine with them; `cargo test` alone leaves these out. The controller
//! on the far end is our emulator; what is tested is the port: exclusive opening, identity, and above all what
//! happens when the adapter is pulled out in mid-move.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;
use tokio_serial::SerialPortBuilderExt;
use twinrig::clock::Clock;
use twinrig::device::mover::{Mover, Reference};
use twinrig::device::port::{self, ConnectError, PortError};
use twinrig::device::settings::MoverSettings;
use twinrig::device::virtual_bench::serve::serve;
use twinrig::device::virtual_bench::{Emulator, EmulatorOptions, Faulty, World};
use twinrig::protocol::{Spec, StopKind};

/// The adapter, and the 16550 at the far end of its cable.
const ADAPTER: (&str, &str) = ("/dev/ttyUSB0", "/dev/ttyS3");
/// Two 16550 on one cable.
const CABLE: (&str, &str) = ("/dev/ttyS1", "/dev/ttyS2");

fn alone() -> MutexGuard<'static, ()> {
    static PORTS: Mutex<()> = Mutex::new(());
    let guard = PORTS.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    assert!(Path::new(ADAPTER.0).exists(), "no adapter at {}: run tests/vm/run", ADAPTER.0);
    guard
}

fn spec() -> Arc<Spec> {
    twinrig::config::protocol("grbl").expect("the shipped protocol")
}

/// A rail on a GRBL.
const SETTINGS: &str = r#"
    protocol = "grbl"
    port = "/dev/ttyUSB0"
    settle_ms = 20
    [axes.slide]
    wire = "X"
    kind = "linear"
    min = -60.0
    max = -1.0
    max_feed = 20.0
    accel = 200.0
    tolerance = 0.02
"#;

fn settings() -> MoverSettings {
    toml::from_str(SETTINGS).expect("settings")
}

/// A controller on the far end of a cable, until the handle is aborted.
fn controller(far: &str) -> JoinHandle<()> {
    let (spec, clock, settings) = (spec(), Clock::real_time(), settings());
    let table = spec.emulator.as_ref().expect("an emulator");
    let (options, world) = (EmulatorOptions::default(), World::without_pad());
    let emulator =
        Emulator::new(table, "stage", &settings.axes, &options, world, clock.now()).expect("it starts");
    let device = Arc::new(Mutex::new(Faulty::sound(emulator, clock.now())));
    let stream = tokio_serial::new(far, 115_200).open_native_async().expect("the far end opens");
    tokio::spawn(async move {
        let ended = serve(stream, &device, clock).await;
        println!("the controller's service ended: {ended:?}");
    })
}

async fn connect(path: &str) -> Result<Mover, ConnectError> {
    port::connect(Path::new(path), spec(), settings(), Clock::real_time(), None).await
}

/// The USB device of a serial port, as the driver's `unbind` takes it.
fn usb_device(port: &str) -> String {
    let name = Path::new(port).file_name().and_then(|n| n.to_str()).expect("a name");
    let device = std::fs::canonicalize(format!("/sys/class/tty/{name}/device")).expect("sysfs knows it");
    // .../usb1/1-1/1-1:1.0/ttyUSB0: the device is the one without an interface number.
    let parts: Vec<&str> = device.iter().filter_map(|p| p.to_str()).collect();
    (*parts.iter().rfind(|p| p.contains('-') && !p.contains(':')).expect("a USB device")).to_owned()
}

fn plug(device: &str, inside: bool) {
    let file = format!("/sys/bus/usb/drivers/usb/{}", if inside { "bind" } else { "unbind" });
    std::fs::write(&file, device).unwrap_or_else(|e| panic!("{file}: {e}"));
}

#[test]
fn an_adapter_is_listed_with_its_identity_and_found_by_it() {
    let _alone = alone();
    let ports = port::list();
    let adapter = ports.iter().find(|p| p.path == Path::new(ADAPTER.0)).expect("listed");
    let usb = adapter.usb.clone().expect("a USB identity");
    println!("{adapter:?}");
    assert_eq!((usb.vid.as_str(), usb.pid.as_str()), ("0403", "6001"));
    let text = format!("vid = \"{}\"\npid = \"{}\"", usb.vid, usb.pid);
    let wanted: twinrig::device::settings::UsbPort = toml::from_str(&text).expect("an identity");
    let found = port::resolve(&twinrig::device::settings::PortSettings::Usb(wanted)).expect("found");
    assert_eq!(found, PathBuf::from(ADAPTER.0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_controller_homes_moves_and_stops_over_real_drivers() {
    let _alone = alone();
    for (near, far) in [ADAPTER, CABLE] {
        let controller = controller(far);
        let mut mover = connect(near).await.unwrap_or_else(|e| panic!("{near}: {e}"));
        assert!(mover.identity().is_some_and(|i| i.contains("Grbl")), "{near}: {:?}", mover.identity());
        // A second program does not get in.
        let second = connect(near).await.err();
        assert!(matches!(second, Some(ConnectError::Port(PortError::Busy { .. }))), "{near}: {second:?}");

        mover.home().await.unwrap_or_else(|e| panic!("{near}: {e}"));
        mover.move_to(&[("slide", -5.0)], 20.0).await.unwrap_or_else(|e| panic!("{near}: {e}"));
        let handle = mover.stop_handle();
        let stopper = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(200));
            handle.stop(StopKind::Controlled)
        });
        let moved = mover.move_to(&[("slide", -55.0)], 5.0).await;
        assert!(moved.is_err_and(|e| e.is_stop()), "{near}");
        assert!(stopper.join().expect("a thread"), "{near}: the driver took the bytes at once");
        let at = mover.position().await.expect("a position")[0].position;
        assert!(at < -5.0 && at > -20.0, "{near}: stopped at {at}");
        drop(mover);
        controller.abort();
        // The far end is closed before it is opened again.
        _ = controller.await;
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_adapter_pulled_out_in_mid_move_loses_trust_at_once_and_is_homed_when_it_is_back() {
    let _alone = alone();
    let serving = controller(ADAPTER.1);
    let mut mover = connect(ADAPTER.0).await.expect("connects");
    mover.home().await.expect("homes");
    mover.move_to(&[("slide", -5.0)], 20.0).await.expect("moves");
    let usb = usb_device(ADAPTER.0);
    println!("the adapter is USB device {usb}");

    let pulled = {
        let usb = usb.clone();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(300));
            let begun = Instant::now();
            plug(&usb, false);
            (begun, begun.elapsed())
        })
    };
    let moved = mover.move_to(&[("slide", -55.0)], 5.0).await;
    let noticed = Instant::now();
    let (begun, took) = pulled.join().expect("a thread");
    println!("unplugging took {took:?}, noticed {:?} after its beginning", noticed - begun);
    let error = moved.expect_err("the adapter is gone");
    println!("{error}");
    assert!(error.to_string().contains("the position was lost"), "{error}");
    assert!(noticed - begun < took + Duration::from_secs(1), "at once, not by a timeout");
    assert_eq!(mover.reference(), Reference::Suspect);
    assert!(mover.move_to(&[("slide", -6.0)], 5.0).await.is_err(), "nothing moves any more");
    assert!(
        !mover.stop_handle().stop(StopKind::Controlled),
        "there is no port to write to, and no waiting for it"
    );
    assert!(matches!(connect(ADAPTER.0).await, Err(ConnectError::Port(_))), "nothing to open");
    drop(mover);

    plug(&usb, true);
    let back = Instant::now();
    while !Path::new(ADAPTER.0).exists() {
        assert!(back.elapsed() < Duration::from_secs(10), "the adapter does not come back");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let mut mover = connect(ADAPTER.0).await.expect("connects again");
    assert_eq!(mover.reference(), Reference::Unknown);
    assert!(mover.move_to(&[("slide", -6.0)], 5.0).await.is_err(), "not before it is homed");
    mover.home().await.expect("homes again");
    mover.move_to(&[("slide", -6.0)], 20.0).await.expect("moves again");
    serving.abort();
    _ = serving.await;
}

/// Whether the 16550's driver holds DTR up.
fn dtr_is_up(port: &str) -> bool {
    let number = port.trim_start_matches("/dev/ttyS");
    let text = std::fs::read_to_string("/proc/tty/driver/serial").expect("the driver tells");
    let line = text.lines().find(|l| l.trim_start().starts_with(&format!("{number}:"))).expect("the port");
    line.contains("DTR")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn dtr_follows_the_policy_and_is_not_dropped_when_the_port_is_closed() {
    let _alone = alone();
    let near = CABLE.0;
    let open = |policy: &str| {
        let text = format!("dtr = \"{policy}\"\n{}", SETTINGS);
        let settings: MoverSettings = toml::from_str(&text).expect("settings");
        port::open(Path::new(near), &spec(), &settings).unwrap_or_else(|e| panic!("{policy}: {e}"))
    };
    for (policy, up) in [("high", true), ("low", false), ("pulse", true)] {
        let opened = open(policy);
        assert_eq!(dtr_is_up(near), up, "{policy}");
        drop(opened);
        assert_eq!(dtr_is_up(near), up, "{policy}, closed: the board behind it would reset");
    }
    // Left as it is: neither opening nor closing makes an edge.
    let opened = open("leave");
    assert!(dtr_is_up(near));
    drop(opened);
    assert!(dtr_is_up(near));
}
