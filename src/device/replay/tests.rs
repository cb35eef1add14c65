//! Sessions with faults, recorded and lived through again.

use super::*;
use crate::clock::Clock;
use crate::device::byte_log::ByteLog;
use crate::device::link::LinkOptions;
use crate::device::mover::Mover;
use crate::device::settings::{AxisSettings, MoverSettings, PortSettings};
use crate::device::virtual_bench::serve::serve;
use crate::device::virtual_bench::{Emulator, EmulatorOptions, FaultKind, FaultPlan, Faulty, Trigger, World};
use crate::motion::AxisKind;
use crate::protocol::conformance::tests::shipped;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// One axis of each protocol: name, wire, counts, and two places to go to.
const DEVICES: [(&str, &str, Option<f64>, [f64; 2]); 6] = [
    ("grbl", "X", None, [-5.0, -3.0]),
    ("marlin", "Z", None, [5.0, 3.0]),
    ("zaber_ascii", "1/1", Some(2015.7480315), [5.0, 3.0]),
    ("thorlabs_apt", "80/1", Some(34554.96), [5.0, 3.0]),
    ("feetech_sts", "1", Some(11.37777778), [25.0, 13.0]),
    ("newport_smc100", "1", None, [5.0, 3.0]),
];

fn settings(device: usize) -> MoverSettings {
    let (protocol, wire, counts_per_unit, targets) = DEVICES[device];
    let (min, max) = if targets[0] < 0.0 { (-20.0, 0.0) } else { (0.0, 40.0) };
    let axis = AxisSettings {
        wire: wire.to_owned(),
        kind: AxisKind::Linear,
        min,
        max,
        max_feed: 10.0,
        accel: 100.0,
        counts_per_unit,
        tolerance: 0.1,
        approach: None,
    };
    MoverSettings {
        protocol: protocol.to_owned(),
        port: PortSettings::Path("virtual".to_owned()),
        baud: None,
        identity: None,
        dtr: None,
        settle_ms: 50,
        stall_ms: 3000,
        axes: BTreeMap::from([("a".to_owned(), axis)]),
        kinematics: None,
    }
}

/// The log of a session: connect, home, two moves, a stop in the third; under these faults.
async fn recorded(device: usize, faults: FaultPlan) -> String {
    recorded_at(device, faults, Clock::real_time()).await
}

async fn recorded_at(device: usize, faults: FaultPlan, clock: Clock) -> String {
    let settings = settings(device);
    let spec = shipped(&settings.protocol);
    let (options, world, now) = (EmulatorOptions::default(), World::without_pad(), clock.now());
    let table = spec.emulator.as_ref().unwrap();
    let emulator = Emulator::new(table, "d", &settings.axes, &options, world, now).unwrap();
    let shared = Arc::new(Mutex::new(Faulty::new(emulator, faults, now)));
    let (near, far) = tokio::io::duplex(4096);
    tokio::spawn(async move { serve(far, &shared, clock).await });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("port.log");
    let options = LinkOptions { log: Some(ByteLog::create(&path).unwrap()), urgent: None };
    if let Ok(mut mover) = Mover::connect_with(near, spec, settings, clock, options).await {
        // Whether it succeeds is for other tests; here it only has to be told truly.
        let [first, second] = DEVICES[device].3;
        let there = [("a", first)];
        if mover.home().await.is_ok() {
            drop(mover.move_to(&[("a", first)], 4.0).await);
            drop(mover.move_to(&[("a", second)], 4.0).await);
            let handle = mover.stop_handle();
            let stopping = async {
                clock.sleep(Duration::from_millis(700)).await;
                handle.stop(StopKind::Controlled);
            };
            let (_, _) = tokio::join!(mover.move_to(&there, 1.0), stopping);
            drop(mover.position().await);
        }
    }
    std::fs::read_to_string(&path).unwrap()
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap()
}

#[test]
fn what_was_recorded_is_lived_through_without_a_difference() {
    for (device, (protocol, ..)) in DEVICES.iter().enumerate() {
        let log = runtime().block_on(recorded(device, FaultPlan::none()));
        let story = replay(&log, &shipped(protocol)).unwrap();
        assert_eq!(story.difference, None, "{protocol}:\n{log}");
        assert!(story.judged && story.requests >= 12, "{protocol}: {}", story.requests);
        let sent = story.steps.iter().filter(|s| matches!(s.told, Told::Sent { .. })).count();
        assert!(sent > 12, "{protocol}: {sent}");
    }
}

/// Where time passes between an input and what the engine does about it, the engine must have been called at the
/// instant that the log tells, or what was due in between differs.
#[test]
fn so_is_what_was_recorded_while_time_went_by() {
    let runtime = || tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    for (device, (protocol, ..)) in DEVICES.iter().enumerate() {
        let log = runtime().block_on(recorded_at(device, FaultPlan::none(), Clock::with_speed(40.0)));
        let story = replay(&log, &shipped(protocol)).unwrap();
        assert_eq!(story.difference, None, "{protocol}:\n{log}");
        assert!(story.judged && story.requests >= 3, "{protocol}: {}", story.requests);
    }
}

/// What failed in the field: each log of `tests/field/` is lived through, and must be told as on record beside it
/// (written anew where TWINRIG_ACCEPT is set, for whoever meant to change it).
#[test]
fn what_failed_in_the_field_ends_as_on_record() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/field");
    let mut logs: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    logs.retain(|path| path.extension().is_some_and(|e| e == "log"));
    assert!(!logs.is_empty());
    for path in logs {
        let text = std::fs::read_to_string(&path).unwrap();
        let story = replay(&text, &shipped(&header(&text).unwrap().protocol)).unwrap();
        let told = told(&story);
        let record = path.with_extension("txt");
        if std::env::var_os("TWINRIG_ACCEPT").is_some() {
            std::fs::write(&record, &told).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&record).unwrap_or_default(), told, "{}", path.display());
    }
}

/// Requests, their ends, stops and conclusions, and the first difference; not the bytes between them.
fn told(story: &Story) -> String {
    let mut lines: Vec<String> = Vec::new();
    for step in &story.steps {
        lines.push(match &step.told {
            Told::Asked { request, what } => format!("? {request} {what}"),
            Told::Ended { request, how } => format!("= {request} {how}"),
            Told::Stopped { how } => format!("* stop {how}"),
            Told::StopSent { bytes } => format!("! {bytes}"),
            Told::Lost { why } => format!("* lost: {why}"),
            Told::Remark { text } => format!("# {text}"),
            Told::Sent { .. } | Told::Received { .. } => continue,
        });
    }
    lines.extend(story.difference.as_ref().map(|d| format!("differs: {} | {}", d.log, d.engine)));
    lines.join("\n") + "\n"
}

#[test]
fn so_is_a_session_in_which_something_fails() {
    let (mut lived, mut failed) = (0, 0);
    for (device, (protocol, ..)) in DEVICES.iter().enumerate().take(3) {
        for (i, what) in FaultKind::all().into_iter().enumerate().skip(device % 2).step_by(2) {
            let at = [6, 9, 13, 18][i / 2 % 4];
            let plan = FaultPlan::one(Trigger::Reply(at), what.clone());
            let log = runtime().block_on(recorded(device, plan));
            let story = replay(&log, &shipped(protocol)).unwrap();
            assert_eq!(story.difference, None, "{protocol}, {what:?} at {at}:\n{log}");
            (lived, failed) = (lived + 1, failed + story.failed);
        }
    }
    assert!(lived > 18 && failed > 8, "{lived} {failed}");
}

#[test]
fn what_was_tampered_with_is_pointed_at() {
    let log = runtime().block_on(recorded(0, FaultPlan::none()));
    let spec = shipped("grbl");
    let line_of = |sign: &str, part: &str| {
        log.lines().position(|l| l.contains(&format!(" {sign} ")) && l.contains(part)).unwrap() + 1
    };
    let tampered = |line: usize, from: &str, to: &str| {
        let mut lines: Vec<String> = log.lines().map(str::to_owned).collect();
        assert!(lines[line - 1].contains(from), "{}", lines[line - 1]);
        lines[line - 1] = lines[line - 1].replace(from, to);
        replay(&(lines.join("\n") + "\n"), &spec).unwrap().difference.unwrap()
    };

    // Bytes that the engine would not have sent.
    let line = line_of(">", "X-5");
    let found = tampered(line, "X-5", "X-6");
    assert_eq!(found.line, line);
    assert!(found.log.contains("X-6") && found.engine.contains("X-5"), "{found:?}");

    // A refusal where there was an acceptance: the request ends otherwise.
    let accepted = line + log.lines().skip(line).position(|l| l.contains("< ok")).unwrap() + 1;
    let found = tampered(accepted, "< ok", "< error:15");
    assert!(found.line > accepted && found.log.contains("done"), "{found:?}");
    assert!(found.engine.contains("refused"), "{found:?}");

    // Another target: the log goes where nobody asked it to go.
    let asked = line_of("?", "-3.0");
    let found = tampered(asked, "-3.0", "-4.0");
    assert!(found.engine.contains("X-4") && found.log.contains("X-3"), "{found:?}");
}

#[test]
fn what_is_no_log_is_refused_and_one_without_its_beginning_is_told_without_a_verdict() {
    let spec = shipped("grbl");
    assert!(matches!(replay("0.1 > $I\n", &spec), Err(ReplayError::NoHeader { .. })));
    let log = runtime().block_on(recorded(0, FaultPlan::none()));
    let (first, rest) = log.split_once('\n').unwrap();
    assert!(matches!(
        replay(&format!("{first}\nnonsense\n{rest}"), &spec),
        Err(ReplayError::Line { line: 2, .. })
    ));
    assert!(matches!(
        replay(&log.replace("\"wire\":\"X\"", "\"wire\":\"80/1\""), &spec),
        Err(ReplayError::Protocol(_))
    ));
    let later: Vec<&str> = rest.lines().skip(40).collect();
    let first = first.replace("\"continued\":false", "\"continued\":true");
    let story = replay(&format!("{first}\n{}\n", later.join("\n")), &spec).unwrap();
    assert!(!story.judged && story.difference.is_none() && story.steps.len() > 20);
}
