//! Pitfalls of devices whose position lags, bounces, or is only the target.

use super::tests::*;
use super::*;
use crate::device::virtual_bench::serve::with;

/// A servo, and a shaft that is bent by so much when the move ends and springs back some time later.
async fn bent(by: f64, back_after_ms: u64) -> (Result<travel::Reached, MoverError>, Duration, f64) {
    let turn = 4096.0 / 360.0;
    let mut b = homed(settings("dynamixel2", &[("a", counted("1", 350.0, turn))])).await;
    b.mover.move_to(&[("a", 40.0)], 20.0).await.unwrap();
    let (clock, device) = (b.clock, b.device.clone());
    let begun = clock.now();
    tokio::spawn(async move {
        // 20 degrees at 20 degrees a second, with ramps of a fifth; before the first look at where it is.
        clock.sleep(Duration::from_millis(1230)).await;
        let push = |by: f64| {
            with(&device, |d| {
                d.emulator().lose_steps("1", by, clock.now());
                d.emulator().reseat("1");
            });
        };
        push(by);
        clock.sleep(Duration::from_millis(back_after_ms)).await;
        push(-by);
    });
    let reached = b.mover.move_to(&[("a", 60.0)], 20.0).await;
    let truth = b.truth("a");
    (reached, clock.now().since(begun), truth)
}

#[tokio::test(start_paused = true)]
async fn pitfall_12_a_readback_that_lags_is_read_again_and_then_settles() {
    let (straight, took, _) = bent(0.0, 10).await;
    straight.unwrap();
    let (reached, longer, truth) = bent(1.0, 300).await;
    let at = reached.unwrap().measured[0].position;
    assert!((at - 60.0).abs() < 0.1 && (truth - 60.0).abs() < 0.1, "{at}, in truth {truth}");
    assert!(longer > took + Duration::from_millis(100), "{longer:?} after {took:?}");
    // What does not come back has not arrived.
    let (missed, _, _) = bent(1.0, 5000).await;
    assert!(matches!(missed, Err(MoverError::NotReached { .. })), "{missed:?}");
}

#[tokio::test(start_paused = true)]
async fn pitfall_15_a_count_beside_the_target_is_an_arrival() {
    let (reached, _, _) = bent(-360.0 / 4096.0, 60_000).await;
    let at = reached.unwrap().measured[0].position;
    assert!((at - 60.0).abs() > 0.03 && (at - 60.0).abs() < 0.14, "{at}");
}

#[tokio::test(start_paused = true)]
async fn pitfall_10_a_target_that_is_told_as_the_position_is_no_arrival() {
    let mut b = homed(marlin()).await;
    let from = b.mover.position().await.unwrap()[1].position;
    let (begun, before) = (b.clock.now(), b.truth("z"));
    // M114 says 20 mm at once; the carriage takes four seconds.
    b.mover.move_to(&[("z", from + 20.0)], 5.0).await.unwrap();
    assert!(b.clock.now().since(begun) > Duration::from_secs(4));
    assert!((b.truth("z") - before - 20.0).abs() < 0.01);
}

#[tokio::test(start_paused = true)]
async fn pitfall_08_a_board_that_resets_on_opening_is_waited_for() {
    // The emulated boards are switched on as they are opened: their banner is on its way while they are asked.
    for settings in [grbl(), marlin()] {
        let b = homed(settings).await;
        let telemetry = b.mover.link().telemetry();
        assert!(telemetry.banner.is_some() && telemetry.trust_losses == 0, "{telemetry:?}");
        assert_eq!(b.mover.reference(), Reference::Referenced);
    }
}
