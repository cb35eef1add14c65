//! Sessions of a servo arm: every pose by five joints on one bus, judged by the truth of the world.

use super::bench_over_pipes::{TestBench, by_servo_arm, press, slip, touching};
use super::{assert_proven, captures, names};
use std::collections::BTreeSet;
use twinrig::session::Event;

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
