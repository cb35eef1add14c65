//! Faults at every byte of the dialogue with every shipped protocol, and random sequences of commands.
//!
//! What must hold whatever goes wrong: a move that reports success is where it says in truth, a
//! device whose position may be lost moves no more, nothing ever leaves the limits, and everything ends in time.
//!
//! `TWINRIG_FAULT_BYTES=N` strikes at N bytes of each dialogue for each kind of fault, `TWINRIG_FAULT_BYTES=all` at
//! every one; how many were tried is printed. `TWINRIG_FAULT_PROTOCOL=grbl` sweeps that one alone, and
//! `TWINRIG_FAULT_KIND=lose,double` tries these kinds alone: a long sweep in parts.

use super::tests::*;
use super::*;
use crate::device::virtual_bench::serve::with;
use crate::device::virtual_bench::{FaultKind, FaultPlan, Faulty, Trigger};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// What a session did until it ended or failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Ended {
    Clean,
    Recovered,
    Refused,
}

/// A device of a sweep, and what is done with it.
#[derive(Clone)]
pub(super) struct Subject {
    pub(super) settings: MoverSettings,
    pub(super) axis: &'static str,
    pub(super) targets: [f64; 3],
    pub(super) feed: f64,
}

/// One device of each shipped protocol.
pub(super) fn subjects() -> Vec<Subject> {
    let turn = 4096.0 / 360.0;
    let one = |protocol: &str, axis: AxisSettings, targets, feed| Subject {
        settings: settings(protocol, &[("a", axis)]),
        axis: "a",
        targets,
        feed,
    };
    vec![
        Subject { settings: grbl(), axis: "slide", targets: [-5.0, -12.0, -3.0], feed: 8.0 },
        Subject { settings: marlin(), axis: "z", targets: [5.0, 12.0, 3.0], feed: 8.0 },
        one("grblhal", axis("X", -50.0, -1.0), [-5.0, -12.0, -3.0], 8.0),
        one("zaber_ascii", counted("1/1", 100.0, 2015.7480315), [5.0, 12.0, 3.0], 8.0),
        one("thorlabs_apt", counted("80/1", 50.0, 34554.96), [2.0, 4.0, 1.0], 2.0),
        one("thorlabs_apt_stepper", counted("80/1", 360.0, 136533.3333), [10.0, 30.0, 5.0], 10.0),
        Subject { settings: dobot(), axis: "z", targets: [20.0, 50.0, 10.0], feed: 20.0 },
        one("feetech_sts", counted("1", 350.0, turn), [40.0, 60.0, 50.0], 20.0),
        one("dynamixel2", counted("1", 350.0, turn), [40.0, 60.0, 50.0], 20.0),
        one("dynamixel_p", counted("1", 170.0, 2788.461111), [20.0, 40.0, 30.0], 20.0),
        one("newport_smc100", axis("1", 0.0, 25.0), [1.0, 3.0, 2.0], 2.0),
        one("pi_gcs2", axis("1", 0.0, 50.0), [5.0, 12.0, 3.0], 8.0),
    ]
}

/// How a session with a device ended.
struct Told {
    ended: Ended,
    reply_bytes: u64,
    struck: usize,
    /// What truth and counter differ by after homing.
    zero: f64,
}

/// Longest that a session takes in bench time, whatever happens in it.
const LONGEST: Duration = Duration::from_secs(900);

/// Connects, homes, moves three times; the truth is compared after each success.
async fn session(subject: &Subject, plan: FaultPlan, origin: Option<f64>) -> Result<Told, String> {
    let tried = format!("{}: {:?}", subject.settings.protocol, plan.0);
    let whole = tokio::time::timeout(LONGEST, attempt(subject, plan, origin));
    let ended = whole.await.unwrap_or_else(|_| Err("it never ended".to_owned()));
    ended.map_err(|why| format!("{tried}: {why}"))
}

fn must(holds: bool, or_else: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(or_else()) }
}

async fn attempt(subject: &Subject, plan: FaultPlan, origin: Option<f64>) -> Result<Told, String> {
    let Subject { settings, axis: name, targets, feed } = subject.clone();
    let index = settings.axes.keys().position(|n| n == name).unwrap();
    let tolerance = settings.axes[name].tolerance;
    // Steps lost in silence cannot be seen by a device without encoders; no client can. So are those
    // that the emulated Marlin loses at a collision.
    let marlin = settings.protocol == "marlin";
    let unseen = |what: &FaultKind| match what {
        FaultKind::LoseSteps { .. } => true,
        FaultKind::Alarm => marlin,
        _ => false,
    };
    let lossless = !plan.0.iter().any(|f| unseen(&f.what));
    let (device, world, clock, connected) = try_connect(settings, plan).await;
    let told = |ended, zero| {
        let told = |d: &mut Faulty| (d.reply_bytes(), d.struck().len());
        let (reply_bytes, struck) = with(&device, told);
        Ok(Told { ended, reply_bytes, struck, zero })
    };
    let mut zero = 0.0;
    let mut ended = Ended::Clean;
    let Ok(mut mover) = connected else { return told(Ended::Refused, zero) };
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
    if !homed {
        return told(Ended::Refused, zero);
    }
    // The frame of the truth and the firmware's differ by what homing found.
    // It is the same in every run; a run with faults cannot be asked for it.
    zero = match origin {
        Some(zero) => zero,
        None => world.position("stage", name, clock.now()) - mover.position().await.unwrap()[index].position,
    };
    for target in targets {
        match mover.move_to(&[(name, target)], feed).await {
            Ok(reached) => {
                let truth = world.position("stage", name, clock.now()) - zero;
                let measured = reached.measured[index].position;
                let near = (measured - target).abs() <= tolerance + 1e-4;
                must(near, || format!("told {measured} for {target}"))?;
                let is_true = !lossless || (truth - target).abs() < 2.0 * tolerance;
                must(is_true, || format!("truth {truth} for {target}"))?;
                if reached.recoveries > 0 {
                    ended = ended.max(Ended::Recovered);
                }
            }
            Err(_) => {
                ended = Ended::Refused;
                if mover.reference() != Reference::Referenced {
                    let asked = with(&device, |d| d.request_bytes());
                    let again = mover.move_to(&[(name, targets[0])], feed).await;
                    must(again.is_err(), || "a second move while nobody knew where it was".to_owned())?;
                    let since = with(&device, |d| d.request_bytes()) - asked;
                    must(since == 0, || format!("{since} bytes were sent for a move that was refused"))?;
                }
                break;
            }
        }
    }
    // Whatever it was told last, it comes to rest, and inside its limits.
    clock.sleep(Duration::from_secs(60)).await;
    must(world.velocity("stage", name, clock.now()) == 0.0, || "it still moves".to_owned())?;
    let truth = world.position("stage", name, clock.now()) - zero;
    let limits = subject.settings.axes[name].limits();
    let inside = !lossless || (limits.min - 1.0..=limits.max + 1.0).contains(&truth);
    must(inside, || format!("it left its limits: {truth}"))?;
    told(ended, zero)
}

/// What a sweep over one dialogue has tried.
#[derive(Debug, Default)]
struct Tried {
    /// Replied when nothing goes wrong.
    bytes: u64,
    faults: usize,
    outcomes: BTreeMap<Ended, usize>,
    /// What did not hold, and after what.
    broken: Vec<String>,
}

fn paused() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap()
}

/// Strikes at so many bytes of a dialogue with each kind of fault; at every byte for `u64::MAX`.
fn sweep(subject: &Subject, places: u64, kinds: Option<&str>) -> Tried {
    let clean = paused().block_on(session(subject, FaultPlan::none(), None)).unwrap();
    assert_eq!(clean.ended, Ended::Clean, "{}", subject.settings.protocol);
    let bytes = clean.reply_bytes;
    let mut tried = Tried { bytes, ..Tried::default() };
    for (k, what) in FaultKind::all().into_iter().enumerate() {
        if kinds.is_some_and(|kinds| !kinds.split(',').any(|kind| kind == what.name())) {
            continue;
        }
        let n = places.min(bytes);
        for i in 0..n {
            // No two kinds strike at the same bytes, unless at all.
            let byte = ((bytes as u128 * (7 * u128::from(i) + k as u128 % 7)) / (7 * u128::from(n))) as u64;
            let byte = if n == bytes { i } else { byte };
            let plan = FaultPlan::one(Trigger::ReplyByte(byte), what.clone());
            match paused().block_on(session(subject, plan, Some(clean.zero))) {
                Ok(told) if told.struck > 0 => {
                    tried.faults += 1;
                    *tried.outcomes.entry(told.ended).or_insert(0) += 1;
                }
                Ok(_) => {}
                Err(why) => tried.broken.push(why),
            }
        }
    }
    tried
}

#[test]
#[expect(clippy::print_stderr, reason = "how many faults were tried is worth knowing")]
fn a_fault_at_any_byte_of_any_protocol_ends_true_recovered_or_refused() {
    let places = match std::env::var("TWINRIG_FAULT_BYTES").as_deref() {
        Ok("all") => u64::MAX,
        Ok(n) => n.parse().expect("TWINRIG_FAULT_BYTES is a number or `all`"),
        Err(_) => 20,
    };
    let only = std::env::var("TWINRIG_FAULT_PROTOCOL").ok();
    let kinds = std::env::var("TWINRIG_FAULT_KIND").ok();
    let (mut sum, mut broken) = (0, Vec::new());
    for subject in subjects() {
        let protocol = &subject.settings.protocol;
        if only.as_ref().is_some_and(|only| only != protocol) {
            continue;
        }
        let tried = sweep(&subject, places, kinds.as_deref());
        eprintln!("{protocol}: {} faults in {} bytes, {:?}", tried.faults, tried.bytes, tried.outcomes);
        sum += tried.faults;
        let kept = tried.outcomes.get(&Ended::Clean).copied().unwrap_or(0);
        if tried.faults < 40 || (kinds.is_none() && kept * 3 < tried.faults) {
            broken.push(format!("{protocol}: hardly any fault was tried or survived: {:?}", tried.outcomes));
        }
        broken.extend(tried.broken);
    }
    eprintln!("faults tried: {sum}");
    assert!(broken.is_empty(), "{} of {sum}:\n{}", broken.len(), broken.join("\n"));
}

#[test]
fn every_shipped_protocol_is_swept() {
    let swept: std::collections::BTreeSet<String> =
        subjects().into_iter().map(|s| s.settings.protocol).collect();
    let shipped = crate::protocol::conformance::tests::all_shipped().into_iter().collect();
    assert_eq!(swept, shipped);
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
        paused().block_on(async {
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
