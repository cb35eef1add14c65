//! Faults at every place of a whole dialogue, and random sequences of commands.
//!
//! What must hold whatever goes wrong: a move that reports success is where it says in truth, a
//! device whose position may be lost moves no more, and nothing ever leaves the limits.

use super::tests::*;
use super::*;
use crate::device::virtual_bench::serve::with;
use crate::device::virtual_bench::{FaultKind, FaultPlan, Trigger};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// What a session did until it ended or failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Ended {
    Clean,
    Recovered,
    Refused,
}

/// Connects, homes, moves three times; the truth is compared after each success.
async fn session(
    settings: MoverSettings,
    targets: [f64; 3],
    plan: FaultPlan,
    origin: Option<f64>,
) -> (Ended, u64, usize, f64) {
    let name = if settings.protocol == "marlin" { "z" } else { "slide" };
    let index = settings.axes.keys().position(|n| n == name).unwrap();
    // Steps lost in silence cannot be seen by a device without encoders; no client can. So are those
    // that the emulated Marlin loses at a collision.
    let marlin = settings.protocol == "marlin";
    let unseen = |what: &FaultKind| match what {
        FaultKind::LoseSteps { .. } => true,
        FaultKind::Alarm => marlin,
        _ => false,
    };
    let lossless = !plan.0.iter().any(|f| unseen(&f.what));
    let tried = format!("{:?}", plan.0);
    let (device, world, clock, connected) = try_connect(settings, plan).await;
    let mut zero = 0.0;
    let seen = |device: &_| with(device, |d| (d.replies(), d.struck().len()));
    let mut ended = Ended::Clean;
    let Ok(mut mover) = connected else {
        let (replies, struck) = seen(&device);
        return (Ended::Refused, replies, struck, zero);
    };
    let mut homed = false;
    for attempt in 0..2 {
        match mover.home().await {
            Ok(()) => {
                homed = true;
                break;
            }
            Err(_) if attempt == 0 => ended = Ended::Recovered,
            Err(_) => {}
        }
    }
    if homed {
        // The frame of the truth and the firmware's differ by what homing found.
        // It is the same in every run; a run with faults cannot be asked for it.
        zero = match origin {
            Some(zero) => zero,
            None => {
                world.position("stage", name, clock.now()) - mover.position().await.unwrap()[index].position
            }
        };
        for target in targets {
            match mover.move_to(&[(name, target)], 8.0).await {
                Ok(reached) => {
                    let truth = world.position("stage", name, clock.now()) - zero;
                    let told = reached.measured[index].position;
                    assert!((told - target).abs() <= 0.0101, "told {told} for {target}: {tried}");
                    assert!(
                        !lossless || (truth - target).abs() < 0.02,
                        "truth {truth} for {target}: {tried}"
                    );
                    if reached.recoveries > 0 {
                        ended = ended.max(Ended::Recovered);
                    }
                }
                Err(_) => {
                    ended = Ended::Refused;
                    if mover.reference() != Reference::Referenced {
                        assert!(mover.move_to(&[(name, targets[0])], 8.0).await.is_err());
                    }
                    break;
                }
            }
        }
    } else {
        ended = Ended::Refused;
    }
    let (replies, struck) = seen(&device);
    (ended, replies, struck, zero)
}

fn sweep(settings: MoverSettings, targets: [f64; 3], every: u64) -> BTreeMap<Ended, usize> {
    let runtime =
        || tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
    let (clean, replies, _, zero) =
        runtime().block_on(session(settings.clone(), targets, FaultPlan::none(), None));
    assert_eq!(clean, Ended::Clean);
    let mut outcomes = BTreeMap::new();
    for what in FaultKind::all() {
        for at in (0..replies).step_by(every as usize) {
            let plan = FaultPlan::one(Trigger::Reply(at), what.clone());
            let (ended, _, struck, _) =
                runtime().block_on(session(settings.clone(), targets, plan, Some(zero)));
            if struck > 0 {
                *outcomes.entry(ended).or_insert(0) += 1;
            }
        }
    }
    outcomes
}

#[test]
fn a_fault_at_any_reply_of_grbl_ends_true_recovered_or_refused() {
    let outcomes = sweep(grbl(), [-5.0, -12.0, -3.0], 3);
    let tried: usize = outcomes.values().sum();
    assert!(tried > 200, "{outcomes:?}");
    assert!(outcomes[&Ended::Clean] > tried / 2, "{outcomes:?}");
}

#[test]
fn a_fault_at_any_reply_of_marlin_ends_true_recovered_or_refused() {
    let outcomes = sweep(marlin(), [5.0, 12.0, 3.0], 1);
    let tried: usize = outcomes.values().sum();
    assert!(tried > 200, "{outcomes:?}");
    assert!(outcomes[&Ended::Clean] > tried / 3, "{outcomes:?}");
}

/// One thing an operator may do.
#[derive(Debug, Clone)]
enum Act {
    Home,
    Move(f64, f64),
    Jog(f64),
    Cancel,
    Stop,
    Wait(u64),
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        Just(Act::Home),
        (-80.0..30.0f64, -1.0..15.0f64).prop_map(|(t, f)| Act::Move(t, f)),
        (-80.0..30.0f64).prop_map(Act::Jog),
        Just(Act::Cancel),
        Just(Act::Stop),
        (0..3000u64).prop_map(Act::Wait),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_sequence_of_commands_leaves_the_limits(acts in proptest::collection::vec(act(), 1..12)) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
        runtime.block_on(async {
            let (_device, world, clock, mover) = try_connect(grbl(), FaultPlan::none()).await;
            let mut mover = mover.unwrap();
            mover.home().await.unwrap();
            let origin = world.position("stage", "slide", clock.now()) - mover.position().await.unwrap()[0].position;
            let limits = grbl().axes["slide"].limits();
            for act in &acts {
                // Errors are expected: most of these are refused. What counts is where it ends up.
                match act {
                    Act::Home => drop(mover.home().await),
                    Act::Move(t, f) => drop(mover.move_to(&[("slide", *t)], *f).await),
                    Act::Jog(t) => drop(mover.jog("slide", *t, 5.0).await),
                    Act::Cancel => drop(mover.jog_cancel().await),
                    Act::Stop => drop(mover.stop(StopKind::Controlled).await),
                    Act::Wait(ms) => clock.sleep(Duration::from_millis(*ms)).await,
                }
                let truth = world.position("stage", "slide", clock.now()) - origin;
                assert!(truth >= limits.min - 0.01 && truth <= limits.max + 0.01, "{act:?}: {truth}");
            }
        });
    }
}
