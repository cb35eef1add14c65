//! A fault at any moment of a whole session: lost, doubled, late, garbled, split and merged replies, noise,
//! resets, alarms, a cable that comes out, requests that are swallowed, controllers that fall silent.
//!
//! Whatever happens, a session ends: with every capture proven, or with an error after which nothing begins to
//! move. `TWINRIG_FAULTS=N` spreads N moments over each dialogue instead of the default.

use super::bench_over_pipes::{TestBench, slip};
use super::{assert_proven, captures, names};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;
use twinrig::device::virtual_bench::{FaultKind, FaultPlan, Trigger};
use twinrig::session::{BenchError, SessionError};

/// Longest a session may take in bench time: six captures take less than one minute.
const LONGEST: Duration = Duration::from_secs(600);

/// Moments in each device's dialogue, for each kind of fault.
fn moments() -> u64 {
    std::env::var("TWINRIG_FAULTS").map_or(8, |n| n.parse().expect("TWINRIG_FAULTS is a number"))
}

/// How long the dialogue with a device is when nothing goes wrong.
async fn dialogue_bytes(device: &str) -> u64 {
    let mut b = TestBench::new(&slip()).await.unwrap();
    let (result, _) = b.run(&BTreeSet::new()).await;
    result.unwrap();
    b.reply_bytes(device)
}

/// How the sessions of a sweep ended.
#[derive(Debug, Default)]
struct Outcomes {
    tried: u32,
    never_struck: u32,
    completed: u32,
    refused_at_connection: u32,
    ended_early: BTreeMap<String, u32>,
}

async fn strike(device: &str, what: &FaultKind, byte: u64, outcomes: &mut Outcomes) {
    let tried = format!("{} in byte {byte} from the {device}", what.name());
    outcomes.tried += 1;
    let plan = FaultPlan::one(Trigger::ReplyByte(byte), what.clone());
    let faults = BTreeMap::from([(device.to_owned(), plan)]);
    let mut b = match TestBench::with_faults(&slip(), &faults).await {
        Ok(bench) => bench,
        Err(refused) => {
            assert_eq!(refused.moved_by, 0.0, "{tried}: {:?}", refused.error);
            outcomes.refused_at_connection += 1;
            return;
        }
    };
    let ended = tokio::time::timeout(LONGEST, b.run(&BTreeSet::new())).await;
    let (result, events) = ended.unwrap_or_else(|_| panic!("{tried}: the session never ended"));
    assert_proven(&b, &events);
    if !b.has_struck(device) {
        outcomes.never_struck += 1;
    }
    match result {
        Ok(()) => {
            assert_eq!(captures(&events).len(), 6, "{tried}: {:?}", names(&events));
            outcomes.completed += 1;
        }
        Err(e) => {
            assert!(!e.is_stop(), "{tried}: a fault is not a stop");
            let SessionError::Bench(BenchError::Mover { source: cause, .. }) = e else {
                panic!("{tried}: {e:?}")
            };
            *outcomes.ended_early.entry(what.name().to_owned()).or_default() += 1;
            let told = cause.to_string();
            assert!(!told.is_empty() && !told.contains("Err("), "{tried}: {told}");
        }
    }
    b.assert_ends_at_rest(device, &tried).await;
}

#[expect(clippy::print_stderr, reason = "how many faults were tried is worth knowing")]
async fn sweep(device: &str) {
    let bytes = dialogue_bytes(device).await;
    let mut outcomes = Outcomes::default();
    for (k, what) in FaultKind::all().iter().enumerate() {
        for n in 0..moments() {
            // No two kinds strike at the same bytes.
            let byte = (bytes * n + bytes * (k as u64 % 7) / 7) / moments();
            strike(device, what, byte, &mut outcomes).await;
        }
    }
    eprintln!("{device}: {bytes} bytes of dialogue, {outcomes:?}");
    for always in ["alarm", "reset", "unplug"] {
        assert!(outcomes.ended_early.contains_key(always), "{always} was survived: {outcomes:?}");
    }
    assert!(outcomes.completed * 4 > outcomes.tried, "hardly any fault was survived: {outcomes:?}");
}

#[tokio::test(start_paused = true)]
async fn a_fault_of_the_arm_ends_in_an_error_or_in_the_truth() {
    sweep("arm").await;
}

#[tokio::test(start_paused = true)]
async fn a_fault_of_the_stage_ends_in_an_error_or_in_the_truth() {
    sweep("stage").await;
}
