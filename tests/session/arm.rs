//! Sessions of a servo arm: every pose by five joints on one bus, judged by the truth of the world.

use super::bench_over_pipes::{TestBench, by_servo_arm, press, slip, touching};
use super::{assert_proven, captures, names};
use std::collections::BTreeSet;
use twinrig::motion::Coordinate;
use twinrig::pose::Pose;
use twinrig::session::Event;
use twinrig::session::bench::Feeds;

#[tokio::test(start_paused = true)]
async fn an_arm_presses_where_its_joints_prove_that_it_is() {
    let mut b = TestBench::new(&by_servo_arm(press())).await.unwrap();
    let (result, events) = b.run(&BTreeSet::new()).await;
    result.unwrap_or_else(|e| panic!("{e}: {:?}", names(&events)));
    assert_proven(&b, &events);
    let all = captures(&events);
    assert_eq!(all.len(), 4);
    for capture in all {
        let of =
            |axis: &str| capture.axes.iter().find(|a| a.axis == axis).unwrap_or_else(|| panic!("{axis}"));
        // The tool's axes, and the joints they were measured by.
        assert_eq!(capture.axes.len(), 9, "{:?}", capture.axes);
        for joint in ["pan", "shoulder", "elbow", "wrist", "roll"] {
            assert!((of(joint).measured - of(joint).commanded).abs() < 0.01, "{:?}", of(joint));
        }
        assert!((of("z").measured - of("z").commanded).abs() < 0.02, "{:?}", of("z"));
    }
    assert!(b.height_mm() > 2.9, "up again");
}

#[tokio::test(start_paused = true)]
async fn an_arm_slides_at_depth_and_turns_its_tool() {
    let mut b = TestBench::new(&by_servo_arm(slip())).await.unwrap();
    let (result, events) = b.run(&BTreeSet::new()).await;
    result.unwrap_or_else(|e| panic!("{e}: {:?}", names(&events)));
    assert_proven(&b, &events);
    let all = captures(&events);
    assert!((all[2].measured.x_mm + 2.0).abs() < 0.03, "{}", all[2].measured);
    assert!((all[5].measured.x_mm - 2.0).abs() < 0.03, "{}", all[5].measured);
}

#[tokio::test(start_paused = true)]
async fn an_arm_touches_off_at_the_hidden_contact() {
    let mut b = TestBench::new(&by_servo_arm(touching("sphere"))).await.unwrap();
    let (result, events) = b.run(&BTreeSet::new()).await;
    result.unwrap_or_else(|e| panic!("{e}: {:?}", names(&events)));
    let touched = events.iter().find_map(|e| match e {
        Event::Touched { contact_zero_mm, .. } => Some(*contact_zero_mm),
        _ => None,
    });
    let (found, hidden) = (touched.expect("a touch"), b.world.contact_offset_mm());
    assert!((found - hidden).abs() < 0.03, "found {found}, hidden {hidden}");
    assert_proven(&b, &events);
}

#[tokio::test(start_paused = true)]
async fn nothing_moves_towards_a_pose_that_the_arm_cannot_take() {
    let mut wanted = by_servo_arm(press());
    wanted.sets.push("devices.arm.kinematics.tool.x.max=150.0".to_owned());
    let mut b = TestBench::new(&wanted).await.unwrap();
    let feeds = Feeds { mm_s: 10.0, deg_s: 20.0 };
    let before = b.sent("arm").len();
    // Not even homing, where a pose cannot be reached from where homing leads.
    let far = |coordinate| (coordinate == Coordinate::X).then_some(120.0);
    let error = b.bench.refuse_from_home(far, feeds).await.unwrap_err().to_string();
    assert!(error.contains("device arm") && error.contains("x 120.000"), "{error}");
    let near = |coordinate| (coordinate == Coordinate::X).then_some(10.0);
    b.bench.refuse_from_home(near, feeds).await.unwrap();
    assert_eq!(b.sent("arm").len(), before, "it was all thought, and nothing said");

    // Nor the first line of a way whose second one is out of reach.
    b.bench.home().await.unwrap();
    let here = b.true_pose(b.clock.now());
    let sent = |b: &TestBench| b.sent("arm").len();
    let (mut to, before) = (here, sent(&b));
    (to.y_mm, to.x_mm, to.z_mm) = (10.0, 10.0, 3.0);
    b.bench.go(&to, feeds).await.unwrap();
    assert!(sent(&b) > before);
    let (here, before) = (b.true_pose(b.clock.now()), sent(&b));
    let beyond = Pose { x_mm: 120.0, z_mm: 40.0, ..to };
    let error = b.bench.go(&beyond, feeds).await.unwrap_err().to_string();
    assert!(error.contains("x 120.000"), "{error}");
    assert_eq!(sent(&b), before, "not even upwards, which it could");
    assert_eq!(b.true_pose(b.clock.now()), here);
}
