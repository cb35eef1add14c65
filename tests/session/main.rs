//! Sessions on a whole bench: two emulated controllers over pipes, the virtual camera, paused time.
//!
//! What must hold whatever happens: a capture comes with the proof of where the indenter was and that
//! its frame was exposed after that; a session that ends early has stopped both movers, and has lifted
//! the arm if, and only if, its position is trusted.

mod arm;
mod bench_over_pipes;
mod faults;
mod overhead;

use bench_over_pipes::{TestBench, press, pressed_by_grbl, slip, touching};
use std::collections::BTreeSet;
use std::time::Duration;
use twinrig::device::camera::CameraError;
use twinrig::device::mover::{MoverError, Reference};
use twinrig::device::virtual_bench::{CameraFault, FaultKind};
use twinrig::pose::Pose;
use twinrig::protocol::Failure;
use twinrig::session::bench::Feeds;
use twinrig::session::touch_off::TouchOffError;
use twinrig::session::{BenchError, Event, RealCapture, SessionError, StopLevel};

fn captures(events: &[Event]) -> Vec<&RealCapture> {
    events.iter().filter_map(|e| if let Event::Captured(c) = e { Some(&**c) } else { None }).collect()
}

fn names(events: &[Event]) -> Vec<String> {
    events
        .iter()
        .map(|e| match e {
            Event::Identified { device, .. } => format!("identified {device}"),
            Event::Homed => "homed".into(),
            Event::Mounted { indenter } => format!("mounted {indenter}"),
            Event::Background { number, .. } => format!("background {number}"),
            Event::Touched { indenter, .. } => format!("touched {indenter}"),
            Event::Episode { episode } => format!("episode {episode}"),
            Event::Captured(c) => format!("capture {}", c.capture),
            Event::Retracted => "retracted".into(),
        })
        .collect()
}

/// Every capture is what it says it is, in the truth of the world too.
fn assert_proven(b: &TestBench, events: &[Event]) {
    for c in captures(events) {
        assert!(c.frame.stamp.exposed_at >= c.settled_at, "capture {} is older than its pose", c.capture);
        let off = c.commanded.distance_mm(&c.measured);
        assert!(off < 0.03 && !c.departed, "capture {}: {} / {}", c.capture, c.commanded, c.measured);
        assert!((c.commanded.theta_deg - c.measured.theta_deg).abs() < 0.1);
        let truth = b.true_pose(c.frame.stamp.exposed_at);
        let nominal = Pose { z_mm: c.commanded.z_mm + c.contact_zero_mm, ..c.commanded };
        assert!(truth.distance_mm(&nominal) < 0.05, "capture {}: in truth at {truth}", c.capture);
    }
}

#[tokio::test(start_paused = true)]
async fn a_slip_episode_goes_in_order_and_every_capture_is_proven() {
    let mut b = TestBench::new(&slip()).await.unwrap();
    let (result, events) = b.run(&BTreeSet::new()).await;
    result.unwrap();
    let expected = [
        "identified arm",
        "identified stage",
        "homed",
        "mounted sphere",
        "background 0",
        "episode 0",
        "capture 0",
        "capture 1",
        "capture 2",
        "episode 1",
        "capture 3",
        "capture 4",
        "capture 5",
        "retracted",
    ];
    assert_eq!(names(&events), expected);
    assert_proven(&b, &events);
    let all = captures(&events);
    assert!(all.windows(2).all(|w| w[0].frame.stamp.exposed_at < w[1].frame.stamp.exposed_at));
    assert!(all.iter().all(|c| c.axes.len() == 4 && c.axes.iter().all(|a| a.measured.is_finite())));
    // Slid left in the first episode and right in the second, at depth.
    assert!((all[2].measured.x_mm + 2.0).abs() < 0.03, "{}", all[2].measured);
    assert!((all[5].measured.x_mm - 2.0).abs() < 0.03, "{}", all[5].measured);
    assert!(b.height_mm() > 2.9, "up again");
}

#[tokio::test(start_paused = true)]
async fn touch_off_finds_the_hidden_contact() {
    for indenter in ["sphere", "moon", "pacman", "dot_in", "cross_lines", "cone"] {
        let mut b = TestBench::new(&touching(indenter)).await.unwrap();
        let (result, events) = b.run(&BTreeSet::new()).await;
        result.unwrap_or_else(|e| panic!("{indenter}: {e}"));
        let found = events.iter().find_map(|e| match e {
            Event::Touched { contact_zero_mm, .. } => Some(*contact_zero_mm),
            _ => None,
        });
        let hidden = b.world.contact_offset_mm();
        let found = found.expect("a touch");
        assert!((found - hidden).abs() < 0.03, "{indenter}: found {found}, hidden {hidden}");
        assert!(captures(&events).iter().all(|c| c.contact_zero_mm == found));
    }
}

#[tokio::test(start_paused = true)]
async fn what_is_done_is_not_done_again() {
    let mut b = TestBench::new(&slip()).await.unwrap();
    let (result, events) = b.run(&BTreeSet::from([0, 1, 2, 4])).await;
    result.unwrap();
    assert_eq!(captures(&events).iter().map(|c| c.capture).collect::<Vec<_>>(), [3, 5]);
    assert!(!names(&events).contains(&"episode 0".to_owned()), "an episode that is done is not walked");
    assert_proven(&b, &events);

    let (result, events) = b.run(&(0..6).collect()).await;
    result.unwrap();
    assert_eq!(names(&events), ["identified arm", "identified stage", "retracted"]);
}

/// Raises the switch when the n-th capture has been seen and so much time has passed.
async fn stopped_after(
    b: &mut TestBench,
    capture: u32,
    delay_ms: u64,
) -> (Result<(), SessionError>, Vec<Event>) {
    let (stop, clock) = (b.bench.stop.clone(), b.clock);
    b.run_with(&BTreeSet::new(), move |event| {
        if matches!(event, Event::Captured(c) if c.capture == capture) {
            let stop = stop.clone();
            tokio::spawn(async move {
                clock.sleep(Duration::from_millis(delay_ms)).await;
                stop.raise(StopLevel::Controlled);
            });
        }
        true
    })
    .await
}

#[tokio::test(start_paused = true)]
async fn a_stop_during_a_slide_ends_all_motion() {
    // After capture 0 the stage slides for a second; the arm rests.
    let mut b = TestBench::new(&slip()).await.unwrap();
    let (result, events) = stopped_after(&mut b, 0, 500).await;
    let error = result.expect_err("stopped");
    assert!(error.is_stop(), "{error}");
    assert_eq!(captures(&events).len(), 1);
    assert_eq!(b.bench.movers["stage"].reference(), Reference::Referenced, "a held GRBL keeps its position");
    assert_eq!(b.bench.movers["arm"].reference(), Reference::Suspect, "a quick-stopped Marlin does not");
    assert!(b.sent("arm").contains("M410"), "the arm was stopped too");
    assert!(b.sent("stage").contains('!'), "the stage was held");
    // The arm lost its position, so it stays, and nothing moves any more.
    assert!(!names(&events).contains(&"retracted".to_owned()));
    b.assert_at_rest_from_now_on().await;
    let after_stop = b.sent("arm");
    let after_stop = after_stop.rsplit("M410").next().unwrap();
    assert!(!after_stop.contains("G1") && !after_stop.contains("G0"), "{after_stop}");
}

#[tokio::test(start_paused = true)]
async fn a_stopped_grbl_arm_keeps_its_position_and_retracts() {
    let mut b = TestBench::new(&pressed_by_grbl()).await.unwrap();
    // The second press has begun: the arm itself is on its way down.
    let (result, events) = stopped_after(&mut b, 0, 400).await;
    let error = result.expect_err("stopped");
    assert!(error.is_stop(), "{error}");
    assert_eq!(b.bench.movers["stage"].reference(), Reference::Referenced);
    assert_eq!(names(&events).last().unwrap(), "retracted");
    assert!(b.height_mm() > 2.9);
    b.assert_at_rest_from_now_on().await;
}

#[tokio::test(start_paused = true)]
async fn a_stop_at_any_time_is_a_stop_and_nothing_moves_sideways_after_it() {
    for ms in [0, 1, 40, 200, 900, 2500, 6000, 9000, 12_000, 20_000, 26_000, 30_000] {
        let mut b = TestBench::new(&slip()).await.unwrap();
        let (stop, clock) = (b.bench.stop.clone(), b.clock);
        let raising = tokio::spawn(async move {
            clock.sleep(Duration::from_millis(ms)).await;
            stop.raise(StopLevel::Controlled);
        });
        let (result, events) = b.run(&BTreeSet::new()).await;
        raising.await.unwrap();
        let error = result.expect_err("stopped");
        assert!(error.is_stop(), "after {ms} ms: {error} ({:?})", names(&events));
        assert_proven(&b, &events);
        b.assert_at_rest_from_now_on().await;
    }
}

#[tokio::test(start_paused = true)]
async fn pitfall_26_a_lost_stage_does_not_keep_a_trusted_arm_down() {
    // The arm is a GRBL here, so that its stop keeps the position.
    let mut b = TestBench::new(&pressed_by_grbl()).await.unwrap();
    let struck = b.strike_after_capture(0, "arm", FaultKind::Unplug, 10);
    let (result, events) = b.run_with(&BTreeSet::new(), struck).await;
    let error = result.expect_err("the other device is gone");
    let SessionError::Bench(BenchError::Mover { source, .. }) = &error else { panic!("{error:?}") };
    let is_lost =
        matches!(**source, MoverError::Device(Failure::LinkLost(_)) | MoverError::PositionLost { .. });
    assert!(is_lost, "{error:?}");
    assert_eq!(names(&events).last().unwrap(), "retracted", "{:?}", names(&events));
    assert!(b.height_mm() > 2.9, "{}", b.height_mm());
    assert!(b.sent("stage").contains('!'), "and the other one is stopped, whatever it did");
}

#[tokio::test(start_paused = true)]
async fn pitfall_26_what_moves_is_stopped_when_the_other_device_is_lost() {
    for what in [FaultKind::Unplug, FaultKind::Reset] {
        let mut b = TestBench::new(&press()).await.unwrap();
        b.bench.home().await.unwrap();
        let feeds = Feeds { mm_s: 2.0, deg_s: 10.0 };
        let here = b.true_pose(b.clock.now());
        // Three seconds to where the stage begins; then ten seconds' way for it, with the arm at rest.
        b.strike_after("arm", what.clone(), 5000);
        b.bench.go(&Pose { x_mm: here.x_mm - 5.0, ..here }, feeds).await.unwrap();
        let (begun, from) = (b.clock.now(), b.true_pose(b.clock.now()));
        let error = b.bench.go(&Pose { x_mm: from.x_mm - 20.0, ..from }, feeds).await.unwrap_err();
        assert!(error.to_string().starts_with("device arm: the position was lost"), "{what:?}: {error}");
        let took = b.clock.now().since(begun);
        assert!(took < Duration::from_millis(3500), "{what:?}: the stage went on for {took:?}");
        b.bench.come_to_rest().await;
        let way = from.x_mm - b.true_pose(b.clock.now()).x_mm;
        assert!(way > 1.0 && way < 6.0, "{what:?}: it was stopped on its way, after {way} mm");
        assert!(b.sent("stage").contains('!'));
        b.assert_at_rest_from_now_on().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_restart_between_arrival_and_exposure_makes_no_capture() {
    // Swept over the whole span of a capture: settling, the two frames, the reading after them.
    for device in ["arm", "stage"] {
        for after_ms in (0..900).step_by(60) {
            let mut b = TestBench::new(&press()).await.unwrap();
            let struck = b.strike_after_capture(0, device, FaultKind::Reset, after_ms);
            let (result, events) = b.run_with(&BTreeSet::new(), struck).await;
            assert!(result.is_err(), "{device} after {after_ms} ms");
            assert_proven(&b, &events);
            let struck_at = b.struck_at();
            for c in captures(&events) {
                assert!(
                    c.frame.stamp.exposed_at < struck_at,
                    "{device} after {after_ms} ms: capture {} was exposed after the restart",
                    c.capture
                );
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_camera_that_fails_ends_the_session_retracted() {
    let stall = CameraFault::Stall(Duration::from_secs(60));
    // A Marlin would lose its position by a stop: nothing moves while the camera looks, so none is sent.
    let faults = [(stall, 3), (stall, 8), (CameraFault::Unplug, 2), (CameraFault::Unplug, 5)];
    for (wanted, (fault, served)) in
        [pressed_by_grbl(), press()].iter().flat_map(|w| faults.map(|fault| (w, fault)))
    {
        let mut b = TestBench::new(wanted).await.unwrap();
        b.camera.after_frames(b.camera.served() + served, fault);
        let (result, events) = b.run(&BTreeSet::new()).await;
        let error = result.expect_err("no frames");
        match fault {
            CameraFault::Unplug => {
                assert!(matches!(error, SessionError::Bench(BenchError::Camera(CameraError::Lost { .. }))))
            }
            _ => {
                assert!(matches!(error, SessionError::Bench(BenchError::Camera(CameraError::Stalled { .. }))))
            }
        }
        assert!(error.to_string().contains("then resume"), "{error}");
        assert_eq!(names(&events).last().unwrap(), "retracted", "{:?}", names(&events));
        assert!(b.height_mm() > 2.9);
        assert_proven(&b, &events);
    }
}

#[tokio::test(start_paused = true)]
async fn stale_and_dropped_frames_are_noticed_and_cost_nothing_but_time() {
    let mut b = TestBench::new(&press()).await.unwrap();
    for k in 0..40 {
        b.camera.after_frames(b.camera.served() + k, CameraFault::Stale(4));
        b.camera.after_frames(b.camera.served() + k, CameraFault::Drop(3));
    }
    let (result, events) = b.run(&BTreeSet::new()).await;
    result.unwrap();
    assert_proven(&b, &events);
    assert!(b.camera.stale_refused() > 10);
    assert!(captures(&events).iter().any(|c| c.frame.stamp.dropped_before > 0));
}

#[tokio::test(start_paused = true)]
async fn an_operator_who_says_no_ends_it_and_one_who_says_nothing_can_be_stopped() {
    let mut b = TestBench::new(&press()).await.unwrap();
    b.operator_answers(Some(false));
    let (result, events) = b.run(&BTreeSet::new()).await;
    match result {
        Err(SessionError::NotMounted { indenter }) => assert_eq!(indenter, "sphere"),
        other => panic!("{other:?}"),
    }
    assert_eq!(captures(&events).len(), 0);

    let mut b = TestBench::new(&press()).await.unwrap();
    b.operator_answers(None);
    let (stop, clock) = (b.bench.stop.clone(), b.clock);
    tokio::spawn(async move {
        clock.sleep(Duration::from_secs(3600)).await;
        stop.raise(StopLevel::Controlled);
    });
    let ended = tokio::time::timeout(Duration::from_secs(7200), b.run(&BTreeSet::new())).await;
    let (result, _) = ended.expect("a stop reaches a session that waits for its operator");
    assert!(result.expect_err("stopped").is_stop());
}

#[tokio::test(start_paused = true)]
async fn when_nobody_receives_any_more_the_bench_stops_and_retracts() {
    let mut b = TestBench::new(&pressed_by_grbl()).await.unwrap();
    // The receiver goes with the second capture: a full disk.
    let (result, events) =
        b.run_with(&BTreeSet::new(), |e| !matches!(e, Event::Captured(c) if c.capture == 1)).await;
    assert!(matches!(result, Err(SessionError::NoReceiver)), "{result:?}");
    assert_eq!(captures(&events).len(), 2);
    assert!(b.height_mm() > 2.9);
    b.assert_at_rest_from_now_on().await;
}

#[tokio::test(start_paused = true)]
async fn with_another_device_on_a_port_nothing_moves() {
    for device in ["arm", "stage"] {
        let mut wanted = press();
        wanted.sets.push(format!("devices.{device}.identity=SomethingElse"));
        match TestBench::new(&wanted).await.map(|_| ()) {
            Err(failed) => {
                assert!(matches!(failed.error, MoverError::WrongIdentity { .. }), "{:?}", failed.error);
                assert_eq!(failed.moved_by, 0.0);
            }
            Ok(()) => panic!("{device} was accepted"),
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_indenter_that_is_not_there_is_never_touched_off() {
    let mut b = TestBench::new(&touching("sphere")).await.unwrap();
    b.mounts_nothing();
    let (result, events) = b.run(&BTreeSet::new()).await;
    match result {
        Err(SessionError::TouchOff { source: TouchOffError::NotFound { deepest_mm, .. }, .. }) => {
            assert!((deepest_mm - 0.5).abs() < 1e-9)
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(captures(&events).len(), 0);
    assert_eq!(names(&events).last().unwrap(), "retracted", "{:?}", names(&events));
    assert!(b.height_mm() > 2.9, "{}", b.height_mm());
}
