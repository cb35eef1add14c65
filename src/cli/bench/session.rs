//! `twinrig bench session`: how much longer a session takes than it must.
//!
//! Performs a plan on the virtual bench, whose devices move, settle and expose at their real speed, without the twin and
//! into a dataset that is thrown away. What cannot be saved is the motion (as long as its feeds and accelerations
//! make it, and the device's own search for references), the settling times of the rig file and the exposures as far as
//! they are waited for; everything else is overhead, and is told by where it went. An indenter changes hands at once.
//! So that slow homing hides nothing, the overhead is also told against the needed time without it.

use super::load::ThrownAway;
use crate::assemble::{self, BenchOptions};
use crate::cli::exit::Exit;
use crate::cli::screen;
use crate::clock::SPENT;
use crate::collection::{Collection, SessionPart};
use crate::config::Setup;
use crate::dataset::Dataset;
use crate::session::{Session, StopSwitch};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tracing::field::{Field, Visit};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::SubscriberExt;

/// Measure how much longer a session takes than its motion, settling and exposures
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig bench session\n  twinrig bench session --plan rig_configs/plans/small.toml --json"
)]
pub struct Args {
    /// Rig file of a virtual bench
    #[arg(long, default_value = "rig_configs/virtual.toml")]
    pub rig: PathBuf,
    /// Plan
    #[arg(long, default_value = "rig_configs/plans/slip.toml")]
    pub plan: PathBuf,
    /// Override a setting, as elsewhere
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// What users are promised: a session is not longer than it must be by more than this.
const TARGET: f64 = 0.05;

/// What cannot be saved.
const BUDGET: [&str; 4] = ["Motion", "Homing", "Settle", "Exposure"];

/// Where the time went.
#[derive(Debug, Serialize)]
struct Account {
    total_s: f64,
    budget_s: f64,
    /// `total / budget - 1`.
    overhead: f64,
    /// The same time against the budget without homing.
    overhead_without_homing: f64,
    captures: usize,
    /// Seconds and occasions by part.
    parts: BTreeMap<String, (f64, u64)>,
    /// What no part accounts for.
    elsewhere_s: f64,
}

impl Args {
    /// Runs the benchmark.
    pub async fn run(self) -> Exit {
        let setup = match crate::config::load(&self.rig, Some(&self.plan), &self.set) {
            Ok(setup) if setup.rig.is_virtual() => setup,
            Ok(_) => {
                screen::error("this benchmark moves without asking; give it a virtual bench with --rig");
                return Exit::Refused;
            }
            Err(e) => {
                screen::error(e);
                return Exit::Refused;
            }
        };
        if let Some(plan) = &setup.plan {
            screen::note(format_args!(
                "performing {} at real speed, about {:.0?} ...",
                plan.plan.name,
                plan.estimate.total()
            ));
        }
        let account = match measure(&setup).await {
            Ok(account) => account,
            Err(e) => {
                screen::error(e);
                return Exit::Failed;
            }
        };
        let met = account.overhead_without_homing <= TARGET;
        if self.json {
            screen::json(&serde_json::json!({ "target": TARGET, "met": met, "account": account }));
        } else {
            show(&account, met);
        }
        if met { Exit::Done } else { Exit::Failed }
    }
}

fn show(account: &Account, met: bool) {
    let Account { total_s, budget_s, overhead, overhead_without_homing, captures, parts, elsewhere_s } =
        account;
    screen::result(format_args!(
        "{captures} captures in {total_s:.2} s; motion, settling and exposures {budget_s:.2} s"
    ));
    for (part, (seconds, count)) in parts {
        let kind = if BUDGET.contains(&part.as_str()) { "needed  " } else { "overhead" };
        let each = seconds * 1e3 / (*count).max(1) as f64;
        screen::result(format_args!(
            "  {kind} {part:<12} {seconds:8.2} s  {:5.1} %  {count:5} times {each:7.1} ms",
            100.0 * seconds / total_s
        ));
    }
    screen::result(format_args!(
        "  overhead {:<12} {elsewhere_s:8.2} s  {:5.1} %",
        "elsewhere",
        100.0 * elsewhere_s / total_s
    ));
    let word = if met { "met" } else { "missed" };
    screen::result(format_args!(
        "overhead {:.1} %, of the time without homing {:.1} % (target {:.0} %: {word})",
        100.0 * overhead,
        100.0 * overhead_without_homing,
        100.0 * TARGET
    ));
}

async fn measure(setup: &Setup) -> Result<Account, Box<dyn std::error::Error>> {
    let plan = setup.plan.as_ref().ok_or("no plan")?;
    let thrown_away = ThrownAway::new("session");
    let folder = &thrown_away.0;
    let dataset = Arc::new(Dataset::create(folder, assemble::provenance(setup)?, &plan.trajectory)?);

    let ledger = Ledger::default();
    // Only this thread's: it is the one that runs the session.
    let accounts = tracing_subscriber::registry().with(ledger.clone());
    let _accounts = tracing::subscriber::set_default(accounts);

    let stop = StopSwitch::new();
    let options = BenchOptions { speed: 1.0, logs: Some(folder.join("logs")), no_camera: false };
    let mut assembled = assemble::bench(setup, &options, stop.clone()).await?;
    let (world, clock) = (assembled.world.clone(), assembled.bench.clock);
    let (events, received) = tokio::sync::mpsc::channel(8);
    let session = Session {
        settings: assemble::session_settings(setup, plan),
        operator: crate::cli::collect::operator(plan, world, true),
        contact_zero_mm: BTreeMap::new(),
        bench: &mut assembled.bench,
        trajectory: &plan.trajectory,
        events,
    };
    let part = SessionPart { session, events: received, run: assemble::run_notes("bench", setup, plan) };
    let (progress, _watched) = tokio::sync::mpsc::unbounded_channel();
    let collection = Collection { dataset: dataset.clone(), session: Some(part), twin: None, stop, progress };
    let begun = clock.now();
    collection.run().await?;
    let total_s = clock.now().since(begun).as_secs_f64();
    let captures = dataset.done_real().len();
    drop(thrown_away);

    let parts: BTreeMap<String, (f64, u64)> = ledger.parts();
    let sum = |wanted: bool| -> f64 {
        parts.iter().filter(|(p, _)| BUDGET.contains(&p.as_str()) == wanted).map(|(_, (s, _))| s).sum()
    };
    let budget_s = sum(true);
    let elsewhere_s = total_s - budget_s - sum(false);
    let homing_s = parts.get("Homing").map_or(0.0, |(s, _)| *s);
    let overhead_s = total_s - budget_s;
    Ok(Account {
        total_s,
        budget_s,
        overhead: overhead_s / budget_s,
        overhead_without_homing: overhead_s / (budget_s - homing_s),
        captures,
        parts,
        elsewhere_s,
    })
}

/// Sums what [`crate::clock::spent`] tells.
#[derive(Debug, Clone, Default)]
struct Ledger(Arc<Mutex<BTreeMap<String, (Duration, u64)>>>);

impl Ledger {
    fn parts(&self) -> BTreeMap<String, (f64, u64)> {
        let parts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        parts.iter().map(|(part, (time, count))| (part.clone(), (time.as_secs_f64(), *count))).collect()
    }
}

impl<S: tracing::Subscriber> Layer<S> for Ledger {
    fn on_event(&self, event: &tracing::Event<'_>, _: tracing_subscriber::layer::Context<'_, S>) {
        if event.metadata().target() != SPENT {
            return;
        }
        let mut entry = Entry::default();
        event.record(&mut entry);
        let mut parts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let sum = parts.entry(entry.part).or_default();
        sum.0 += Duration::from_nanos(entry.ns);
        sum.1 += 1;
    }
}

#[derive(Default)]
struct Entry {
    part: String,
    ns: u64,
}

impl Visit for Entry {
    fn record_u64(&mut self, _: &Field, value: u64) {
        self.ns = value;
    }

    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "part" {
            self.part = format!("{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{Part, spent};

    #[test]
    fn what_is_spent_is_summed_by_part() {
        let ledger = Ledger::default();
        let accounts = tracing_subscriber::registry().with(ledger.clone());
        tracing::subscriber::with_default(accounts, || {
            spent(Part::Motion, Duration::from_millis(1500));
            spent(Part::Motion, Duration::from_millis(500));
            spent(Part::Frame, Duration::from_millis(20));
            tracing::info!("not of time");
        });
        let expected = [("Frame".to_owned(), (0.02, 1)), ("Motion".to_owned(), (2.0, 2))];
        assert_eq!(ledger.parts(), expected.into());
    }
}
