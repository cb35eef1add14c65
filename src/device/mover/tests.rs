//! Movers against the firmware emulators, over pipes, under paused time.

use super::*;
use crate::device::settings::{Approach, PortSettings, Side};
use crate::device::virtual_bench::serve::{SharedDevice, serve, with};
use crate::device::virtual_bench::{
    Emulator, EmulatorOptions, Fault, FaultKind, FaultPlan, Faulty, Trigger, World,
};
use crate::motion::{AxisKind, LimitError};
use crate::protocol::conformance::tests::shipped;
use std::sync::Mutex;

/// A mover connected to an emulator.
pub(super) struct Bench {
    pub(super) mover: Mover,
    pub(super) device: SharedDevice,
    pub(super) world: World,
    pub(super) clock: Clock,
}

pub(super) fn axis(wire: &str, min: f64, max: f64) -> AxisSettings {
    AxisSettings {
        wire: wire.to_owned(),
        kind: AxisKind::Linear,
        min,
        max,
        max_feed: 10.0,
        accel: 100.0,
        counts_per_unit: None,
        tolerance: 0.01,
        approach: None,
    }
}

pub(super) fn settings(protocol: &str, axes: &[(&str, AxisSettings)]) -> MoverSettings {
    MoverSettings {
        protocol: protocol.to_owned(),
        port: PortSettings::Path("virtual".to_owned()),
        baud: None,
        identity: None,
        dtr: None,
        settle_ms: 150,
        stall_ms: 3000,
        axes: axes.iter().map(|(name, axis)| ((*name).to_owned(), axis.clone())).collect(),
        kinematics: None,
    }
}

pub(super) fn grbl() -> MoverSettings {
    settings("grbl", &[("slide", axis("X", -50.0, -1.0)), ("spin", axis("Y", -50.0, -1.0))])
}

pub(super) fn marlin() -> MoverSettings {
    settings("marlin", &[("x", axis("X", 0.0, 200.0)), ("z", axis("Z", 0.0, 200.0))])
}

fn device(settings: &MoverSettings, clock: Clock, plan: FaultPlan) -> (SharedDevice, World) {
    let spec = shipped(&settings.protocol);
    let world = World::without_pad();
    let now = clock.now();
    let table = spec.emulator.as_ref().expect("the protocol has an emulator");
    let emulator =
        Emulator::new(table, "stage", &settings.axes, &EmulatorOptions::default(), world.clone(), now)
            .unwrap();
    (Arc::new(Mutex::new(Faulty::new(emulator, plan, now))), world)
}

/// An emulator with faults, and the attempt to connect to it.
pub(super) async fn try_connect(
    settings: MoverSettings,
    plan: FaultPlan,
) -> (SharedDevice, World, Clock, Result<Mover, MoverError>) {
    let clock = Clock::real_time();
    let (device, world) = device(&settings, clock, plan);
    let (near, far) = tokio::io::duplex(4096);
    let served = device.clone();
    tokio::spawn(async move { serve(far, &served, clock).await });
    let spec = shipped(&settings.protocol);
    let mover = Mover::connect(near, spec, settings, clock).await;
    (device, world, clock, mover)
}

async fn connect(settings: MoverSettings, plan: FaultPlan) -> Result<Bench, MoverError> {
    let (device, world, clock, mover) = try_connect(settings, plan).await;
    Ok(Bench { mover: mover?, device, world, clock })
}

pub(super) async fn homed(settings: MoverSettings) -> Bench {
    let mut bench = connect(settings, FaultPlan::none()).await.unwrap();
    bench.mover.home().await.unwrap();
    bench
}

impl Bench {
    fn strike(&self, at: Trigger, what: FaultKind) {
        with(&self.device, |d| d.strike_later(Fault { at, what }));
    }

    pub(super) fn truth(&self, axis: &str) -> f64 {
        self.world.position("stage", axis, self.clock.now())
    }
}

#[tokio::test(start_paused = true)]
async fn a_grbl_stage_homes_and_moves_to_where_it_says() {
    let mut b = connect(grbl(), FaultPlan::none()).await.unwrap();
    assert!(b.mover.identity().unwrap().contains("Grbl 1.1"), "{:?}", b.mover.identity());
    assert_eq!(b.mover.reference(), Reference::Unknown);
    let refused = b.mover.move_to(&[("slide", -5.0)], 5.0).await;
    assert!(matches!(refused, Err(MoverError::NotReferenced { .. })), "{refused:?}");
    b.mover.home().await.unwrap();
    assert_eq!(b.mover.reference(), Reference::Referenced);
    let reached = b.mover.move_to(&[("slide", -10.0), ("spin", -5.0)], 5.0).await.unwrap();
    assert_eq!(reached.recoveries, 0);
    assert!((reached.measured[0].position + 10.0).abs() < 0.01, "{reached:?}");
    let before = b.truth("slide");
    b.mover.move_to(&[("slide", -12.0)], 5.0).await.unwrap();
    assert!((b.truth("slide") - before + 2.0).abs() < 0.01);
}

#[tokio::test(start_paused = true)]
async fn a_marlin_printer_homes_and_moves_to_where_it_says() {
    let mut b = homed(marlin()).await;
    assert!(b.mover.identity().unwrap().contains("Marlin"));
    let before = b.truth("z");
    let from = b.mover.position().await.unwrap()[1].position;
    let begun = b.clock.now();
    let reached = b.mover.move_to(&[("z", from + 20.0)], 5.0).await.unwrap();
    assert!((reached.measured[1].position - from - 20.0).abs() < 0.01, "{reached:?}");
    assert!(reached.measured[1].counts.is_some());
    assert!((b.truth("z") - before - 20.0).abs() < 0.01);
    assert!(b.clock.now().since(begun).as_secs_f64() >= 4.0 + 0.15, "motion and settling take their time");
}

#[tokio::test(start_paused = true)]
async fn nothing_is_sent_for_a_target_or_feed_beyond_the_limits() {
    let mut b = homed(grbl()).await;
    let before = with(&b.device, |d| d.reply_bytes());
    for (target, feed) in [(0.0, 5.0), (-50.1, 5.0), (f64::NAN, 5.0), (f64::INFINITY, 5.0)] {
        let result = b.mover.move_to(&[("slide", target)], feed).await;
        assert!(
            matches!(result, Err(MoverError::Limit(LimitError::Position { .. }))),
            "{target}: {result:?}"
        );
    }
    assert_eq!(with(&b.device, |d| d.reply_bytes()), before, "not even a question");
    for feed in [0.0, -1.0, 10.1, f64::NAN] {
        let result = b.mover.move_to(&[("slide", -5.0)], feed).await;
        assert!(matches!(result, Err(MoverError::Limit(LimitError::Feed { .. }))), "{feed}: {result:?}");
    }
    let unknown = b.mover.move_to(&[("tilt", 1.0)], 1.0).await;
    assert!(unknown.unwrap_err().to_string().contains("slide, spin"));
}

#[tokio::test(start_paused = true)]
async fn pitfall_06_a_lost_reply_never_leads_to_a_second_move() {
    for settings in [grbl(), marlin()] {
        let (name, target) = if settings.protocol == "grbl" { ("slide", -20.0) } else { ("z", 20.0) };
        let mut b = homed(settings).await;
        b.mover.move_to(&[(name, target / 2.0)], 5.0).await.unwrap();
        // The reply after the position query of the next move is the `ok` of the move itself.
        let replies = if b.mover.spec().protocol.name == "marlin" { 2 } else { 1 };
        let struck = with(&b.device, |d| d.struck().len());
        b.strike_skipping(replies, FaultKind::Lose);
        let reached = b.mover.move_to(&[(name, target)], 5.0).await.unwrap();
        assert_eq!(with(&b.device, |d| d.struck().len()), struck + 1);
        assert!(reached.measured.iter().any(|m| (m.position - target).abs() < 0.01));
        assert_eq!(b.mover.reference(), Reference::Referenced);
    }
}

impl Bench {
    /// Strikes at the reply that comes after `skip` others.
    fn strike_skipping(&self, skip: u64, what: FaultKind) {
        let count = with(&self.device, |d| d.replies());
        self.strike(Trigger::Reply(count + skip), what);
    }
}

#[tokio::test(start_paused = true)]
async fn pitfall_09_an_alarm_that_loses_the_position_allows_only_homing() {
    let mut b = homed(grbl()).await;
    b.strike_soon(FaultKind::Alarm);
    let result = b.mover.move_to(&[("slide", -40.0)], 5.0).await;
    assert!(matches!(result, Err(MoverError::PositionLost { .. })), "{result:?}");
    assert_eq!(b.mover.reference(), Reference::Suspect);
    let refused = b.mover.move_to(&[("slide", -5.0)], 5.0).await;
    assert!(matches!(refused, Err(MoverError::NotReferenced { .. })), "{refused:?}");
    b.mover.home().await.unwrap();
    b.mover.move_to(&[("slide", -5.0)], 5.0).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn pitfall_16_a_restart_in_mid_run_allows_only_homing() {
    for settings in [grbl(), marlin()] {
        let (name, target) = if settings.protocol == "grbl" { ("slide", -40.0) } else { ("z", 40.0) };
        let mut b = homed(settings).await;
        b.strike_soon(FaultKind::Reset);
        let result = b.mover.move_to(&[(name, target)], 5.0).await;
        assert!(matches!(result, Err(MoverError::PositionLost { .. })), "{result:?}");
        assert_eq!(b.mover.reference(), Reference::Suspect);
        assert!(b.mover.move_to(&[(name, target)], 5.0).await.is_err());
        b.mover.home().await.unwrap();
        b.mover.move_to(&[(name, target)], 5.0).await.unwrap();
    }
}

impl Bench {
    /// Strikes two seconds from now.
    fn strike_soon(&self, what: FaultKind) {
        let device = self.device.clone();
        let clock = self.clock;
        tokio::spawn(async move {
            clock.sleep(Duration::from_secs(2)).await;
            with(&device, |d| d.strike_later(Fault { at: Trigger::After(Duration::ZERO), what }));
        });
    }
}

#[tokio::test(start_paused = true)]
async fn pitfall_25_an_unplugged_device_is_an_error_and_stays_one() {
    let mut b = homed(grbl()).await;
    b.strike_soon(FaultKind::Unplug);
    let result = b.mover.move_to(&[("slide", -40.0)], 5.0).await;
    assert!(result.is_err(), "{result:?}");
    assert_eq!(b.mover.reference(), Reference::Suspect);
    assert!(b.mover.home().await.is_err());
}

#[tokio::test(start_paused = true)]
async fn a_stop_ends_a_move_at_once_and_keeps_the_position_of_grbl() {
    let mut b = homed(grbl()).await;
    let handle = b.mover.stop_handle();
    let clock = b.clock;
    tokio::spawn(async move {
        clock.sleep(Duration::from_secs(2)).await;
        handle.stop(StopKind::Controlled);
    });
    let begun = b.clock.now();
    let result = b.mover.move_to(&[("slide", -45.0)], 5.0).await;
    assert!(result.as_ref().is_err_and(MoverError::is_stop), "{result:?}");
    assert!(b.clock.now().since(begun) < Duration::from_millis(2600));
    let at = b.mover.position().await.unwrap()[0].position;
    let rest = b.truth("slide");
    b.clock.sleep(Duration::from_secs(5)).await;
    assert_eq!(b.truth("slide"), rest, "it stays where it stopped");
    assert!(at > -30.0 && at < -2.0, "{at}");
    assert_eq!(b.mover.reference(), Reference::Referenced);
    b.mover.move_to(&[("slide", -5.0)], 5.0).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn an_emergency_stop_loses_the_position() {
    let mut b = homed(grbl()).await;
    b.mover.stop(StopKind::Emergency).await.unwrap();
    assert_eq!(b.mover.reference(), Reference::Suspect);
    b.mover.home().await.unwrap();
    assert_eq!(b.mover.reference(), Reference::Referenced);
}

#[tokio::test(start_paused = true)]
async fn a_jog_is_cancelled_where_it_is() {
    let mut b = homed(grbl()).await;
    b.mover.jog("slide", -45.0, 5.0).await.unwrap();
    b.clock.sleep(Duration::from_secs(2)).await;
    let here = b.mover.jog_cancel().await.unwrap()[0].position;
    assert!(here < -5.0 && here > -20.0, "{here}");
    assert!(b.mover.jog("slide", 3.0, 5.0).await.is_err());
    let mut printer = homed(marlin()).await;
    assert!(matches!(printer.mover.jog("z", 3.0, 5.0).await, Err(MoverError::NotSupported { .. })));
}

#[tokio::test(start_paused = true)]
async fn pitfall_21_backlash_is_taken_up_from_one_side() {
    let mut settings = grbl();
    let slide = settings.axes.get_mut("slide").unwrap();
    slide.approach = Some(Approach { from: Side::Above, distance: 2.0 });
    let mut b = homed(settings).await;
    b.mover.move_to(&[("slide", -20.0)], 5.0).await.unwrap();
    // Upwards: it must go beyond the target and come back down.
    let mut telemetry = b.mover.link().watch();
    let highest = tokio::spawn(async move {
        let mut highest = f64::MIN;
        while telemetry.changed().await.is_ok() {
            if let Some(reading) = telemetry.borrow().positions[0] {
                highest = highest.max(reading.value);
            }
        }
        highest
    });
    b.mover.move_to(&[("slide", -10.0)], 5.0).await.unwrap();
    assert!((b.mover.position().await.unwrap()[0].position + 10.0).abs() < 0.01);
    drop(b);
    let highest = highest.await.unwrap();
    assert!((highest + 8.0).abs() < 0.01, "{highest}");
}

#[tokio::test(start_paused = true)]
async fn pitfall_14_a_target_where_it_already_is_does_not_hang() {
    let moves = async {
        let mut b = homed(grbl()).await;
        for target in [-5.0, -5.0, -5.001] {
            b.mover.move_to(&[("slide", target)], 5.0).await.unwrap();
        }
    };
    tokio::time::timeout(Duration::from_secs(600), moves).await.expect("it ends");
}

#[tokio::test(start_paused = true)]
async fn pitfall_11_a_target_clamped_in_silence_is_not_an_arrival() {
    // The rig file allows more than the firmware: Marlin clamps and says ok.
    let narrow = marlin();
    let clock = Clock::real_time();
    let (device, _world) = device(&narrow, clock, FaultPlan::none());
    let (near, far) = tokio::io::duplex(4096);
    let served = device.clone();
    tokio::spawn(async move { serve(far, &served, clock).await });
    let mut wide = narrow.clone();
    wide.axes.get_mut("z").unwrap().max = 400.0;
    let mut mover = Mover::connect(near, shipped("marlin"), wide, clock).await.unwrap();
    mover.home().await.unwrap();
    match mover.move_to(&[("z", 300.0)], 10.0).await {
        Err(MoverError::NotReached { axis, measured, .. }) => {
            assert_eq!(axis, "z");
            assert!((measured - 200.0).abs() < 0.01);
        }
        other => panic!("{other:?}"),
    }
}

#[tokio::test(start_paused = true)]
async fn pitfall_13_a_long_move_is_no_stall() {
    let mut settings = grbl();
    settings.stall_ms = 1000;
    let mut b = homed(settings).await;
    let begun = b.clock.now();
    b.mover.move_to(&[("slide", -49.0)], 0.4).await.unwrap();
    assert!(b.clock.now().since(begun) > Duration::from_secs(100));
}

#[tokio::test(start_paused = true)]
async fn pitfall_23_another_device_on_the_port_is_refused() {
    let mut wrong = grbl();
    wrong.identity = Some("FluidNC".to_owned());
    match connect(wrong, FaultPlan::none()).await.map(|_| ()) {
        Err(MoverError::WrongIdentity { says, expected }) => {
            assert!(says.contains("Grbl 1.1"), "{says}");
            assert_eq!(expected, "FluidNC");
        }
        other => panic!("{other:?}"),
    }
}

#[tokio::test(start_paused = true)]
async fn a_port_that_says_nothing_is_an_error_that_says_so() {
    for settings in [grbl(), marlin()] {
        let result = connect(settings, FaultPlan::one(Trigger::Reply(0), FaultKind::Mute(None))).await;
        match result.map(|_| ()) {
            Err(error @ (MoverError::Device(Failure::NoReply { .. }) | MoverError::Halted { .. })) => {
                assert!(error.to_string().contains("check the cable"));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_grblhal_rotary_axis_homes_and_turns() {
    let mut turn = axis("A", -300.0, 300.0);
    turn.kind = AxisKind::Rotary;
    let mut b = connect(settings("grblhal", &[("spin", turn)]), FaultPlan::none()).await.unwrap();
    assert!(b.mover.identity().unwrap().contains("GrblHAL"));
    b.mover.home().await.unwrap();
    let from = b.mover.position().await.unwrap()[0].position;
    let target = if from > 0.0 { from - 45.0 } else { from + 45.0 };
    let before = b.truth("spin");
    b.mover.move_to(&[("spin", target)], 10.0).await.unwrap();
    assert!((b.truth("spin") - before - (target - from)).abs() < 0.02);
}

#[tokio::test(start_paused = true)]
async fn a_zaber_stage_homes_and_moves_to_where_it_says() {
    let mut slide = axis("1/1", 0.0, 20.0);
    slide.counts_per_unit = Some(2015.748);
    let mut b = connect(settings("zaber_ascii", &[("slide", slide)]), FaultPlan::none()).await.unwrap();
    b.mover.home().await.unwrap();
    assert_eq!(b.mover.reference(), Reference::Referenced);
    let (at, before) = (b.mover.position().await.unwrap()[0].position, b.truth("slide"));
    let reached = b.mover.move_to(&[("slide", at + 5.0)], 5.0).await.unwrap();
    assert!(reached.measured[0].counts.is_some());
    assert!((b.truth("slide") - before - 5.0).abs() < 0.02);
    let handle = b.mover.stop_handle();
    let clock = b.clock;
    tokio::spawn(async move {
        clock.sleep(Duration::from_millis(500)).await;
        handle.stop(StopKind::Controlled);
    });
    let result = b.mover.move_to(&[("slide", 18.0)], 2.0).await;
    assert!(result.as_ref().is_err_and(MoverError::is_stop), "{result:?}");
    b.mover.move_to(&[("slide", 1.0)], 5.0).await.unwrap();
}

#[test]
fn a_dry_run_shows_the_bytes_and_keeps_the_limits() {
    let bytes = preview_move(&shipped("grbl"), &grbl(), &BTreeMap::new(), &[("slide", -2.5)], 5.0).unwrap();
    assert_eq!(bytes, [b"$J=G90 G21 G53 X-2.5 F300\n".to_vec()]);
    assert!(preview_move(&shipped("grbl"), &grbl(), &BTreeMap::new(), &[("slide", 2.5)], 5.0).is_err());
}

#[test]
fn an_axis_the_protocol_cannot_name_is_refused() {
    let bad = settings("grbl", &[("slide", axis("Q", 0.0, 1.0))]);
    assert!(check_settings(&shipped("grbl"), &bad).unwrap_err().to_string().contains("wire \"Q\""));
    let bad = settings("zaber_ascii", &[("slide", axis("1/1", 0.0, 1.0))]);
    assert!(
        check_settings(&shipped("zaber_ascii"), &bad).unwrap_err().to_string().contains("counts_per_unit")
    );
}

/// Speaks in counts, so its axis has a scale; everything else as [`axis`].
pub(super) fn counted(wire: &str, max: f64, counts_per_unit: f64) -> AxisSettings {
    AxisSettings {
        counts_per_unit: Some(counts_per_unit),
        max_feed: 40.0,
        tolerance: 0.1,
        ..axis(wire, 0.0, max)
    }
}

pub(super) fn dobot() -> MoverSettings {
    let arm =
        |wire: &str, min, max| (wire.to_owned(), AxisSettings { max_feed: 80.0, ..axis(wire, min, max) });
    let mut settings = settings("dobot_magician", &[]);
    settings.axes =
        [arm("x", 120.0, 300.0), arm("y", -100.0, 100.0), arm("z", -90.0, 150.0), arm("r", -90.0, 90.0)]
            .into();
    settings
}

#[tokio::test(start_paused = true)]
async fn pitfall_28_the_feed_of_a_move_is_the_speed_of_the_device_whatever_it_was_set_to() {
    let turn = 4096.0 / 360.0;
    let devices = [
        (settings("thorlabs_apt", &[("a", counted("80/1", 50.0, 34554.96))]), "a", [1.0, 5.0], 1.0),
        (
            settings("thorlabs_apt_stepper", &[("a", counted("80/1", 360.0, 136533.3333))]),
            "a",
            [10.0, 30.0],
            5.0,
        ),
        (settings("dynamixel2", &[("a", counted("1", 350.0, turn))]), "a", [10.0, 90.0], 20.0),
        (settings("feetech_sts", &[("a", counted("1", 350.0, turn))]), "a", [10.0, 90.0], 20.0),
        (settings("pi_gcs2", &[("a", axis("1", 0.0, 50.0))]), "a", [1.0, 11.0], 4.0),
        (dobot(), "z", [20.0, 100.0], 20.0),
        // These count minutes.
        (grbl(), "slide", [-5.0, -45.0], 8.0),
        (marlin(), "z", [5.0, 45.0], 8.0),
        (settings("newport_smc100", &[("a", axis("1", 0.0, 25.0))]), "a", [1.0, 5.0], 1.0),
        (settings("zaber_ascii", &[("a", counted("1/1", 100.0, 2015.7480315))]), "a", [5.0, 45.0], 8.0),
    ];
    for (settings, name, [from, to], feed) in devices {
        let protocol = settings.protocol.clone();
        let mut b = homed(settings).await;
        b.mover.move_to(&[(name, from)], feed).await.unwrap_or_else(|e| panic!("{protocol}: {e}"));
        let mut lasted = Vec::new();
        for (target, feed) in [(to, feed), (from, 0.5 * feed)] {
            let begun = b.clock.now();
            b.mover.move_to(&[(name, target)], feed).await.unwrap_or_else(|e| panic!("{protocol}: {e}"));
            lasted.push(b.clock.now().since(begun).as_secs_f64());
        }
        // Ramps, questions and settling come besides; they are the same for both.
        let ideal = (to - from).abs() / feed;
        assert!(lasted[0] > ideal && lasted[0] < 1.3 * ideal + 0.8, "{protocol}: {lasted:?}, ideal {ideal}");
        let longer = lasted[1] - lasted[0];
        assert!((longer - ideal).abs() < 0.15 * ideal + 0.2, "{protocol}: {lasted:?}, ideal {ideal}");
    }
}

/// The torque switch of servo 1, asked for by hand.
async fn torque_of_servo_1(b: &Bench, ask: &[u8], at: usize) -> u8 {
    let device = b.device.clone();
    let asked = b.clock.now();
    with(&device, |d| d.receive(ask, asked));
    let later = asked.after(Duration::from_millis(2));
    let said: Vec<u8> = with(&device, |d| d.poll(later)).concat();
    said[at]
}

#[tokio::test(start_paused = true)]
async fn servos_that_are_stopped_hold_where_they_are_and_torque_never_makes_them_jump() {
    // Reading one byte of the table: by hand, and (the checksum) by dynamixel-sdk.
    let feetech: (&str, &[u8], usize) = ("feetech_sts", &[0xff, 0xff, 1, 4, 2, 40, 1, 0xcf], 5);
    let read = [0xff, 0xff, 0xfd, 0, 1, 7, 0, 2, 64, 0, 1, 0, 0x3c, 0xdb];
    let dynamixel: (&str, &[u8], usize) = ("dynamixel2", &read, 9);
    for (protocol, ask, at) in [feetech, dynamixel] {
        let mut b = homed(settings(protocol, &[("a", counted("1", 350.0, 4096.0 / 360.0))])).await;
        b.mover.move_to(&[("a", 40.0)], 20.0).await.unwrap();
        let (clock, stop) = (b.clock, b.mover.stop_handle());
        let stopping = tokio::spawn(async move {
            clock.sleep(Duration::from_millis(1000)).await;
            stop.stop(StopKind::Controlled);
        });
        let stopped = b.mover.move_to(&[("a", 100.0)], 20.0).await;
        assert!(matches!(stopped, Err(MoverError::Device(Failure::Stopped))), "{protocol}: {stopped:?}");
        stopping.await.unwrap();
        let rests_at = b.mover.position().await.unwrap()[0].position;
        assert!(rests_at > 50.0 && rests_at < 65.0, "{protocol}: {rests_at}");
        assert_eq!(torque_of_servo_1(&b, ask, at).await, 1, "{protocol} holds");
        b.clock.sleep(Duration::from_secs(5)).await;
        let later = b.mover.position().await.unwrap()[0].position;
        assert!((later - rests_at).abs() < 0.2, "{protocol} went on from {rests_at} to {later}");
        assert_eq!(b.mover.reference(), Reference::Referenced);

        // At once: without torque. What a hand does then is not undone by the torque that returns.
        let stop = b.mover.stop_handle();
        let stopping = tokio::spawn(async move {
            clock.sleep(Duration::from_millis(1000)).await;
            stop.stop(StopKind::Emergency);
        });
        assert!(b.mover.move_to(&[("a", 100.0)], 20.0).await.is_err());
        stopping.await.unwrap();
        b.mover.position().await.unwrap();
        assert_eq!(torque_of_servo_1(&b, ask, at).await, 0, "{protocol} is limp");
        let limp_at = b.mover.position().await.unwrap()[0].position;
        b.mover.home().await.unwrap();
        let homed_at = b.mover.position().await.unwrap()[0].position;
        assert!((homed_at - limp_at).abs() < 0.2, "{protocol} jumped from {limp_at} to {homed_at}");
    }
}
