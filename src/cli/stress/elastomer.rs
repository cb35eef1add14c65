//! `twinrig stress elastomer`: several hundred cases, each of which must end in a correct answer or in a typed error that
//! says what to change.
//!
//! Every case runs in a process of its own on one thread, several beside each other: so a case that panics, exhausts
//! its time or takes its process with it is an outcome like any other. Time is processor time, so that a
//! busy machine does not make cases hang. What a case is and what it is judged by: [`crate::trial::stress`].
//! The exit code is 1 when any case ended in a failure class; `--only` runs one case in this process and
//! shows all its checks. A sweep that is stopped shows what has ended until then.

use crate::cli::exit::Exit;
use crate::cli::{options, screen, signals};
use crate::trial::stress::{self, Body, Case, Family, Judgement, Verdict, case};
use serde::Serialize;
use std::collections::BTreeMap;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Put the elastomer through hundreds of cases; count what is wrong, hangs or panics
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig stress elastomer\n  twinrig stress elastomer --cases 1000 --seed 7 --json > sweep.json\n  twinrig stress elastomer --family hostile\n  twinrig stress elastomer --only 137"
)]
pub struct Args {
    /// How many cases; the first of any number are the same
    #[arg(long, default_value_t = 360, value_parser = options::whole::<u32>(1..=100_000))]
    pub cases: u32,
    /// Another seed draws other cases
    #[arg(long, default_value_t = 1, value_parser = options::whole(0..=u64::MAX))]
    pub seed: u64,
    /// Run this case alone, with all its checks
    #[arg(long, conflicts_with = "family", value_parser = options::whole(0..=u32::MAX))]
    pub only: Option<u32>,
    /// Of the cases run only this family (press, slide, turn, layer, finer, mirror, repeat, cycles, border, scale, shape, thin, explicit, long, hostile)
    #[arg(long, value_parser = family)]
    pub family: Option<Family>,
    /// Cases beside each other [default: one for each core]
    #[arg(long, value_parser = options::whole::<usize>(1..=1024))]
    pub jobs: Option<usize>,
    /// Processor time after which a case hangs, s
    #[arg(long, default_value_t = 180, value_parser = options::whole::<u64>(1..=86_400))]
    pub limit_s: u64,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Be the process of one case
    #[arg(long, hide = true)]
    pub worker: bool,
}

fn family(text: &str) -> Result<Family, String> {
    serde_json::from_value(serde_json::Value::String(text.to_owned()))
        .map_err(|_| format!("{text:?} is no family of cases; --help lists them"))
}

/// Cases after which a line tells how far it is, where no bar can.
const TOLD_EVERY: u64 = 20;
/// A process that needs so many times its processor time is stuck without working.
const WALL_PER_CPU: u32 = 20;

/// The sweep as one document.
#[derive(Debug, Serialize)]
struct Sweep {
    seed: u64,
    cases: usize,
    failures: usize,
    verdicts: BTreeMap<&'static str, usize>,
    errors: BTreeMap<String, usize>,
    wall_s: f64,
    cpu_s: f64,
    worst: Option<u32>,
    judgements: Vec<Judgement>,
}

impl Args {
    /// Runs the sweep.
    pub async fn run(self) -> Exit {
        let bodies: Vec<Body> = crate::config::shipped_indenters()
            .into_iter()
            .map(|(name, spec)| Body { name: name.to_owned(), spec })
            .collect();
        if let Some(number) = self.only {
            return self.run_one(&case(number, self.seed, &bodies));
        }
        let wanted = |c: &Case| self.family.is_none_or(|f| f == c.family);
        let cases: Vec<Case> = (0..self.cases).map(|n| case(n, self.seed, &bodies)).filter(wanted).collect();
        if cases.is_empty() {
            let first = (self.cases..).find(|n| wanted(&case(*n, self.seed, &bodies))).unwrap_or(u32::MAX);
            screen::error(format_args!(
                "--cases {}: none of the first {} cases is of the family asked for, whose first is case {first}; ask for {} or more",
                self.cases,
                self.cases,
                first.saturating_add(1)
            ));
            return Exit::Refused;
        }
        let asked = cases.len();
        let begun = Instant::now();
        let (stop, stopped) = watch::channel(0);
        let swept = match signals::on_each(move |number| {
            if stop.send_replace(number) != 0 {
                std::process::exit(i32::from(Exit::StoppedHard.code()));
            }
        }) {
            Ok(()) => self.sweep(cases, &stopped).await,
            Err(e) => Err(e),
        };
        let judgements = match swept {
            Ok(judgements) => judgements,
            Err(e) => {
                screen::error(format_args!("the cases need processes of their own: {e}"));
                return Exit::Failed;
            }
        };
        let sweep = Sweep::of(self.seed, judgements, begun.elapsed());
        if self.json {
            screen::json(&sweep);
        } else {
            sweep.show();
        }
        match *stopped.borrow() {
            0 if sweep.failures == 0 => Exit::Done,
            0 => Exit::Failed,
            number => {
                screen::warning(format_args!(
                    "stopped: {} of {asked} cases were not run",
                    asked - sweep.cases
                ));
                Exit::Stopped(number)
            }
        }
    }

    /// One case in this process.
    fn run_one(&self, case: &Case) -> Exit {
        if self.worker {
            limit_processor_time(self.limit_s);
            // What is told of a panic is in the judgement.
            std::panic::set_hook(Box::new(|_| {}));
        } else {
            screen::note(format_args!("case {}: {}", case.number, case.title()));
        }
        let judgement = stress::run(case);
        if self.json || self.worker {
            screen::json(&judgement);
        } else {
            for check in &judgement.checks {
                let mark = if check.part() <= 1.0 { ' ' } else { '!' };
                let (value, bound) = (check.value, check.bound);
                screen::result(format_args!("{mark} {:<36} {value:12.4e}  bound {bound:10.4e}", check.what));
            }
            let stated = judgement.stated_error.map_or("none".into(), |e| format!("{:.2} %", 100.0 * e));
            screen::result(format_args!(
                "{} ({}; stated error {stated}; {:.2} s)",
                judgement.verdict.name(),
                if judgement.what.is_empty() { "every check held" } else { &judgement.what },
                judgement.cpu_s
            ));
        }
        if judgement.verdict.is_failure() { Exit::Failed } else { Exit::Done }
    }

    async fn sweep(
        &self,
        cases: Vec<Case>,
        stopped: &watch::Receiver<u8>,
    ) -> std::io::Result<Vec<Judgement>> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = self.jobs.unwrap_or(cores).clamp(1, cases.len().max(1));
        let bars = screen::bars();
        let bar = screen::bar(&bars, "stress", cases.len() as u64);
        let (cases, next) = (Arc::new(cases), Arc::new(AtomicU32::new(0)));
        let mut workers = tokio::task::JoinSet::new();
        for _ in 0..jobs {
            let (args, cases, next, bar) = (self.clone(), cases.clone(), next.clone(), bar.clone());
            let (mut stopped, watched) = (stopped.clone(), !bars.is_hidden());
            workers.spawn(async move {
                let mut done = Vec::new();
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed) as usize) {
                    let judgement = tokio::select! {
                        judgement = args.judge(case) => judgement?,
                        _ = stopped.wait_for(|number| *number != 0) => break,
                    };
                    if judgement.verdict.is_failure() {
                        let (n, verdict) = (judgement.number, judgement.verdict.name());
                        let line = format!("case {n}: {verdict}: {}", judgement.what);
                        if watched { bar.println(line) } else { screen::note(line) }
                    }
                    bar.set_message(format!("{} {}", case.number, case.family.name()));
                    bar.inc(1);
                    if !watched && bar.position().is_multiple_of(TOLD_EVERY) {
                        screen::note(screen::progress_line(&[&bar]));
                    }
                    done.push(judgement);
                }
                Ok::<_, std::io::Error>(done)
            });
        }
        let mut judgements = Vec::new();
        while let Some(done) = workers.join_next().await {
            judgements.extend(done.map_err(std::io::Error::other)??);
        }
        bar.finish_and_clear();
        judgements.sort_by_key(|j| j.number);
        Ok(judgements)
    }

    /// One case in a process of its own.
    async fn judge(&self, case: &Case) -> std::io::Result<Judgement> {
        let mut command = tokio::process::Command::new(std::env::current_exe()?);
        command.args(["stress", "elastomer", "--worker", "--only", &case.number.to_string()]);
        command.args(["--seed", &self.seed.to_string(), "--limit-s", &self.limit_s.to_string()]);
        // In a group of its own: a Ctrl-C of the terminal ends the sweep, which ends its cases.
        command.env("RAYON_NUM_THREADS", "1").kill_on_drop(true).process_group(0);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let begun = Instant::now();
        let ended = |verdict, what| Judgement::ended(case, verdict, what, begun.elapsed().as_secs_f64());
        let patience = WALL_PER_CPU * Duration::from_secs(self.limit_s);
        let Ok(output) = tokio::time::timeout(patience, command.spawn()?.wait_with_output()).await else {
            return Ok(ended(Verdict::Hung, format!("no end after {patience:?}")));
        };
        let output = output?;
        if let Ok(judgement) = serde_json::from_slice::<Judgement>(&output.stdout) {
            return Ok(judgement);
        }
        use std::os::unix::process::ExitStatusExt;
        if output.status.signal() == Some(rustix::process::Signal::XCPU.as_raw()) {
            return Ok(ended(Verdict::Hung, format!("no end after {} s of processor time", self.limit_s)));
        }
        let said = String::from_utf8_lossy(&output.stderr);
        let said = said.lines().last().unwrap_or_default();
        Ok(ended(Verdict::Panicked, format!("the process ended with {}: {said}", output.status)))
    }
}

/// The system ends this process when it has used so much processor time.
fn limit_processor_time(limit_s: u64) {
    use rustix::process::{Resource, Rlimit, setrlimit};
    let limit = Rlimit { current: Some(limit_s), maximum: Some(limit_s + 5) };
    if let Err(e) = setrlimit(Resource::Cpu, limit) {
        screen::warning(format_args!("this case may run for ever: its time cannot be limited ({e})"));
    }
}

impl Sweep {
    fn of(seed: u64, judgements: Vec<Judgement>, took: Duration) -> Sweep {
        let mut verdicts = BTreeMap::new();
        let mut errors = BTreeMap::new();
        for j in &judgements {
            *verdicts.entry(j.verdict.name()).or_default() += 1;
            if j.verdict == Verdict::Refused {
                *errors.entry(j.error.clone()).or_default() += 1;
            }
        }
        let part = |j: &Judgement| j.worst().map_or(0.0, |c| c.part());
        // A failure without checks (a panic, a hang) is worse than any check.
        let rank = |j: &Judgement| if j.verdict.is_failure() { 1e9 + part(j).min(1e9) } else { part(j) };
        let failures = judgements.iter().filter(|j| j.verdict.is_failure()).count();
        Sweep {
            seed,
            cases: judgements.len(),
            failures,
            verdicts,
            errors,
            wall_s: took.as_secs_f64(),
            cpu_s: judgements.iter().map(|j| j.cpu_s).sum(),
            worst: judgements.iter().max_by(|a, b| rank(a).total_cmp(&rank(b))).map(|j| j.number),
            judgements,
        }
    }

    fn show(&self) {
        let seen: Vec<Verdict> = Verdict::ALL
            .into_iter()
            .filter(|v| *v == Verdict::Correct || self.verdicts.contains_key(v.name()))
            .collect();
        let mut head = format!("{:<16}{:>7}", "family", "cases");
        for verdict in &seen {
            head += &format!("{:>18}", verdict.name());
        }
        screen::result(format_args!("{head}{:>14}{:>12}", "CPU s, mean", "most"));
        for family in Family::ALL {
            let of: Vec<&Judgement> = self.judgements.iter().filter(|j| j.family == family).collect();
            if of.is_empty() {
                continue;
            }
            let mut line = format!("{:<16}{:>7}", family.name(), of.len());
            for verdict in &seen {
                line += &format!("{:>18}", of.iter().filter(|j| j.verdict == *verdict).count());
            }
            let times = of.iter().map(|j| j.cpu_s);
            let (mean, most) = (times.clone().sum::<f64>() / of.len() as f64, times.fold(0.0, f64::max));
            screen::result(format_args!("{line}{mean:>14.2}{most:>12.2}"));
        }
        for (kind, count) in &self.errors {
            screen::result(format_args!("refused with {kind}: {count}"));
        }
        for j in self.judgements.iter().filter(|j| j.verdict.is_failure()) {
            screen::result(format_args!(
                "case {}: {}: {}\n  {}",
                j.number,
                j.verdict.name(),
                j.what,
                j.title
            ));
        }
        if let Some(j) = self.judgements.iter().find(|j| Some(j.number) == self.worst) {
            let check = j.worst().map_or("no check".to_owned(), |c| {
                format!("{} {:.3e} of {:.3e} allowed", c.what, c.value, c.bound)
            });
            screen::result(format_args!(
                "worst: case {} ({}): {check}\n  {}",
                j.number,
                j.verdict.name(),
                j.title
            ));
            screen::result(format_args!(
                "again: twinrig stress elastomer --seed {} --only {}",
                self.seed, j.number
            ));
        }
        screen::result(format_args!(
            "{} cases, {} failures; {:.0} s, {:.0} s of processor time",
            self.cases, self.failures, self.wall_s, self.cpu_s
        ));
    }
}
