//! How much longer a session takes than it must, on a machine that costs no time: paused time leaves what devices, links
//! and cameras take. (`twinrig bench session` measures the same with this machine's own delays.)

use super::bench_over_pipes::{TestBench, slip};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tracing::field::{Field, Visit};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::{Context, SubscriberExt};
use twinrig::clock::SPENT;

/// Sums of needed time and of everything that was told on one thread. It listens to the whole process, because a
/// subscriber of one thread can miss what another thread met first with nobody listening.
#[derive(Clone)]
struct Ledger {
    sums: Arc<Mutex<(Duration, Duration)>>,
    thread: std::thread::ThreadId,
}

#[derive(Default)]
struct Entry(String, Duration);

impl Visit for Entry {
    fn record_u64(&mut self, _: &Field, ns: u64) {
        self.1 = Duration::from_nanos(ns);
    }

    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "part" {
            self.0 = format!("{value:?}");
        }
    }
}

impl<S: tracing::Subscriber> Layer<S> for Ledger {
    fn on_event(&self, event: &tracing::Event<'_>, _: Context<'_, S>) {
        if event.metadata().target() == SPENT && std::thread::current().id() == self.thread {
            let mut entry = Entry::default();
            event.record(&mut entry);
            let mut sums = self.sums.lock().unwrap();
            sums.1 += entry.1;
            if ["Motion", "Homing", "Settle", "Exposure"].contains(&entry.0.as_str()) {
                sums.0 += entry.1;
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_slip_episode_is_hardly_longer_than_motion_settling_and_exposures() {
    let ledger = Ledger { sums: Arc::default(), thread: std::thread::current().id() };
    tracing::subscriber::set_global_default(tracing_subscriber::registry().with(ledger.clone()))
        .expect("no other test of this program listens");
    let mut b = TestBench::new(&slip()).await.unwrap();
    let begun = b.clock.now();
    let (result, _) = b.run(&BTreeSet::new()).await;
    result.unwrap();
    let total = b.clock.now().since(begun);
    let (needed, told) = *ledger.sums.lock().unwrap();
    let overhead = total.as_secs_f64() / needed.as_secs_f64() - 1.0;
    assert!(needed > Duration::from_secs(10), "there was something to do: {needed:?}");
    assert!(
        told <= total && total - told < total / 20,
        "hardly anything is unaccounted for: {told:?} of {total:?}"
    );
    assert!(overhead < OVERHEAD, "{:.1} % longer than {needed:?}", 100.0 * overhead);
}

/// What is promised for a whole session; 2.9 % were found when this was written.
const OVERHEAD: f64 = 0.05;
