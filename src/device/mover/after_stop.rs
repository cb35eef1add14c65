//! What a stop at once leaves behind: the next homing works, or says what happened and what to do.

use super::faults::subjects;
use super::tests::*;
use super::*;
use crate::device::virtual_bench::FaultPlan;
use crate::device::virtual_bench::serve::{SharedDevice, serve, with};
use crate::protocol::Value;
use crate::protocol::conformance::tests::shipped;

/// Another session with a device, as far as its homing.
async fn next_session(
    device: &SharedDevice,
    settings: &MoverSettings,
    clock: Clock,
) -> Result<Mover, MoverError> {
    let (near, far) = tokio::io::duplex(4096);
    let served = device.clone();
    tokio::spawn(async move { serve(far, &served, clock).await });
    let mut mover = Mover::connect(near, shipped(&settings.protocol), settings.clone(), clock).await?;
    mover.home().await.map(|()| mover)
}

#[tokio::test(start_paused = true)]
async fn after_a_stop_at_once_the_next_homing_works_or_says_what_to_do() {
    for subject in subjects() {
        for in_mid_move in [false, true] {
            let protocol = subject.settings.protocol.clone();
            let (device, _, clock, mover) = try_connect(subject.settings.clone(), FaultPlan::none()).await;
            let mut mover = mover.unwrap();
            mover.home().await.unwrap();
            if in_mid_move {
                let stop = mover.stop_handle();
                tokio::spawn(async move {
                    clock.sleep(Duration::from_millis(200)).await;
                    stop.stop(StopKind::Emergency);
                });
                let moved = mover.move_to(&[(subject.axis, subject.targets[1])], subject.feed).await;
                assert!(moved.as_ref().is_err_and(MoverError::is_stop), "{protocol}: {moved:?}");
            } else {
                mover.stop(StopKind::Emergency).await.unwrap();
            }
            let in_this_session = mover.home().await;
            drop(mover);
            clock.sleep(Duration::from_secs(1)).await;
            let in_the_next = next_session(&device, &subject.settings, clock).await.map(drop);
            for homed in [in_this_session, in_the_next] {
                if protocol != "marlin" {
                    assert_eq!(homed, Ok(()), "{protocol}, in mid-move: {in_mid_move}");
                    continue;
                }
                let said = homed.unwrap_err().to_string();
                for words in
                    ["no reply to", "`twinrig stop --now`", "M112", "reset button", "`twinrig home RIG`"]
                {
                    assert!(said.contains(words), "{words} is missing: {said}");
                }
            }
            if protocol == "marlin" {
                with(&device, |d| d.emulator().restart(clock.now()));
                next_session(&device, &subject.settings, clock).await.unwrap();
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_grbl_that_does_not_home_is_told_how_it_does() {
    let mut mover = try_connect(grbl(), FaultPlan::none()).await.3.unwrap();
    // Soft limits need homing: they go first.
    for line in ["$20=0", "$22=0"] {
        let fields = [("text".to_owned(), Value::Text(line.to_owned()))].into();
        mover.call(Request::Command { name: "raw".to_owned(), fields, axis: None }).await.unwrap();
    }
    let said = mover.home().await.unwrap_err().to_string();
    for words in ["it refused home: 5", "$22=0", "send `$22=1`", "then home again"] {
        assert!(said.contains(words), "{words} is missing: {said}");
    }
}
