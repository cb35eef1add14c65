//! The program itself, as a shell or a script meets it: what it prints, how it ends, what it leaves.
//!
//! Runs on the virtual bench at high speed with a picture of a few pixels; what is tested is the process,
//! its signals and its files, not the physics.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const VIRTUAL: &str = "rig_configs/virtual.toml";
const SMALL: &str = "rig_configs/plans/small.toml";
const NO_TEXTURE: &str = "sensor.optics.texture=none";
/// A picture that costs nothing.
const CHEAP: [&str; 6] = [
    "optics.samples=1",
    "elastomer.tolerance=0.05",
    "sensor.optics.camera.width_px=96",
    "sensor.optics.camera.height_px=72",
    "sensor.optics.camera.mm_per_px=0.1875",
    "sensor.optics.mesh.vertices=[96, 72]",
];

fn twinrig(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_twinrig"));
    command.args(args).current_dir(env!("CARGO_MANIFEST_DIR")).env("NO_COLOR", "1").env("COLUMNS", "100");
    command.env("TWINRIG_LOGS", concat!(env!("CARGO_TARGET_TMPDIR"), "/logs"));
    command.env_remove("TWINRIG_LOG").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn run(args: &[&str]) -> Output {
    twinrig(args).output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The small plan into a folder; `speed` and more arguments as given.
fn collect(out: &Path, speed: &str, more: &[&str]) -> Command {
    let mut args = vec!["collect", VIRTUAL, SMALL, "--speed", speed, "--out", out.to_str().expect("a path")];
    for set in CHEAP {
        args.extend(["--set", set]);
    }
    args.extend(more);
    twinrig(&args)
}

fn verified(out: &Path) -> serde_json::Value {
    let output = run(&["verify", out.to_str().expect("a path"), "--json"]);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", text(&output.stderr)))
}

fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn ends(child: &mut Child) -> std::process::ExitStatus {
    wait_for("the end of the program", || child.try_wait().expect("a child"))
}

fn send(signal: &str, child: &Child) {
    let pid = child.id().to_string();
    let sent = Command::new("kill").args(["-s", signal, &pid]).status().expect("kill starts");
    assert!(sent.success(), "{signal}");
}

/// Lines of the real side's journal.
fn real_lines(out: &Path) -> usize {
    let journal = std::fs::read_to_string(out.join("journal/real.ndjson")).unwrap_or_default();
    journal.matches('\n').count()
}

#[test]
fn every_subcommand_explains_itself_with_an_example() {
    let commands = [
        "collect", "check", "simulate", "drive", "devices", "home", "move", "capture", "verify", "report",
        "emulate", "render", "relight", "protocol", "jog", "stop", "status", "camera", "bench", "stress",
        "replay",
    ];
    let overview = text(&run(&["--help"]).stdout);
    for command in commands {
        assert!(overview.contains(&format!("\n  {command} ")), "{command} is not in the overview");
        let output = run(&[command, "--help"]);
        let help = text(&output.stdout);
        assert!(output.status.success(), "{command}");
        let (_, examples) = help.split_once("Example").unwrap_or_else(|| panic!("{command}: {help}"));
        assert!(examples.contains(&format!("twinrig {command} ")) || command == "devices", "{help}");
        assert!(examples.contains(&format!("twinrig {command}")), "{help}");
    }
    assert!(overview.contains("Exit codes: 0 done, 1 failed"), "{overview}");
}

#[test]
fn check_prints_the_expansion_and_refuses_what_is_unsafe() {
    let output = run(&["check", VIRTUAL, SMALL]);
    assert_eq!(output.status.code(), Some(0));
    let printed = text(&output.stdout);
    let lines: Vec<&str> = printed.lines().collect();
    // The time, the disk and the hash follow the shipped feeds and cameras: they have tests of their own.
    let golden = [
        "rig: virtual bench (virtual)",
        "sensor: gelsight",
        "plan: small (press)",
        "expansion: 1 indenter, 1 location, 4 depths from 0 to 0.9 mm",
        "indenters: sphere",
        "episodes: 1",
        "captures: 4",
        "contact: given, 0 mm above nominal",
        "everything is in order; nothing was moved",
    ];
    for line in golden {
        assert!(lines.contains(&line), "{line:?} is missing in\n{printed}");
    }
    assert!(lines.iter().filter(|l| l.starts_with("axis ")).count() == 4, "{printed}");

    let unsafe_plan = run(&["check", VIRTUAL, SMALL, "--set", "motion.z.origin=59.5"]);
    assert_eq!(unsafe_plan.status.code(), Some(2));
    let said = text(&unsafe_plan.stderr);
    assert!(said.contains("arm") && said.contains("60"), "{said}");
}

#[test]
fn what_is_wrong_is_refused_with_code_2_and_nothing_is_made() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("set");
    let out_text = out.to_str().expect("a path");
    let cases: [(&[&str], &str); 8] = [
        (&["frobnicate"], "frobnicate"),
        (&["collect", VIRTUAL, SMALL], "--out"),
        (&["collect", VIRTUAL, SMALL, "--out", out_text, "--speed", "0"], "0.1 to 1000"),
        (&["collect", VIRTUAL, "no_such_plan.toml", "--out", out_text], "no_such_plan.toml"),
        (&["collect", VIRTUAL, SMALL, "--out", out_text, "--set", "optics.sampels=1"], "samples"),
        (&["collect", VIRTUAL, SMALL, "--out", out_text, "--real-only", "--sim-only"], "--sim-only"),
        (
            &[
                "collect",
                "rig_configs/skin_marlin_grbl.toml",
                "rig_configs/plans/slip.toml",
                "--out",
                out_text,
            ],
            "--yes",
        ),
        (&["verify", out_text], "set"),
    ];
    for (args, says) in cases {
        let output = run(args);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
        assert!(said.contains(says), "{args:?}: {said}");
        assert!(!out.exists(), "{args:?} made a folder");
    }
    // No port: a run-time failure that names the port.
    let output = run(&["home", "rig_configs/gelsight_printer.toml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("device"), "{}", text(&output.stderr));
}

#[test]
fn a_tip_below_the_contact_is_not_moved_sideways_unasked() {
    const ABOVE: &str = "devices.arm.axes.z.approach={ from = \"above\", distance = 0.05 }";
    // With this sign the home switch of the press axis lies 40 mm below the contact.
    let low = ["move", VIRTUAL, "--home", "--speed", "50", "--set", "motion.z.sign=1", "--set", ABOVE];
    let output = run(&[&low[..], &["--x", "1"]].concat());
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("z = -40.000 mm") && said.contains("--press"), "{said}");
    // Lifted first, and sideways up there.
    let output = run(&[&low[..], &["--x", "1", "--z", "5"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).starts_with("x 1.000 y "), "{}", text(&output.stdout));
}

#[test]
fn a_simulation_that_is_stopped_leaves_its_account() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a path");
    let slip = "rig_configs/plans/slip.toml";
    let coarse = "elastomer.tolerance=0.1";
    let arguments = ["simulate", VIRTUAL, slip, "--out", out, "--surface", "--set", coarse];
    let mut child = twinrig(&arguments).spawn().expect("starts");
    let account = folder.path().join("captures.jsonl");
    let read = || std::fs::read_to_string(&account).unwrap_or_default();
    wait_for("the first capture", || read().ends_with('\n').then_some(()));
    let begun = Instant::now();
    send("INT", &child);
    let status = ends(&mut child);
    assert_eq!(status.code(), Some(130));
    // The rest of the plan takes minutes; the ear is open at every step of the solver.
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    let lines: Vec<serde_json::Value> =
        read().lines().map(|l| serde_json::from_str(l).expect("a whole line")).collect();
    assert!(!lines.is_empty() && lines.len() < 48, "{}", lines.len());
    for line in lines {
        let surface = format!("surface/{:06}.npy", line["capture"].as_u64().expect("a number"));
        assert!(folder.path().join(surface).exists(), "{line}");
    }
}

#[test]
fn a_simulation_that_fails_is_not_complete_and_says_where() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a path");
    // So short a step takes more steps than are allowed.
    let settings = ["elastomer.mode=impm", "elastomer.dt_s=1e-8", "elastomer.speed_mm_s=0.1"];
    let mut args = vec!["simulate", VIRTUAL, SMALL, "--out", out, "--surface", "--captures", "1-2", "--json"];
    for setting in settings.iter().chain(&["elastomer.particles=[41, 41, 9]"]) {
        args.extend(["--set", setting]);
    }
    let output = run(&args);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a summary");
    assert_eq!([&summary["captures"], &summary["simulated"], &summary["failed"]], [2, 0, 2], "{summary}");
    assert_eq!(summary["is_complete"], false);
    let rows = std::fs::read_to_string(folder.path().join("captures.jsonl")).expect("rows");
    let rows: Vec<serde_json::Value> =
        rows.lines().map(|l| serde_json::from_str(l).expect("a whole line")).collect();
    assert_eq!(rows.len(), 2);
    for (row, (capture, z_mm)) in rows.iter().zip([(1, -0.3), (2, -0.6)]) {
        assert_eq!(
            [&row["capture"], &row["pose"]["z_mm"]],
            [&serde_json::json!(capture), &z_mm.into()],
            "{row}"
        );
        assert_eq!([&row["status"], &row["indenter"]], ["failed", "sphere"]);
        assert!(row["error"].as_str().is_some_and(|why| why.contains("elastomer.speed_mm_s")), "{row}");
    }
}

/// It has no rig to home.
#[test]
fn a_simulation_that_is_stopped_at_once_says_what_is_stored_and_how_to_go_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a path");
    let slip = "rig_configs/plans/slip.toml";
    let mut simulation = twinrig(&["simulate", VIRTUAL, slip, "--out", out, "--surface"]);
    let mut child = simulation.stderr(std::process::Stdio::piped()).spawn().expect("starts");
    wait_for("the account", || folder.path().join("captures.jsonl").exists().then_some(()));
    // Both signals would count as one if they came at once.
    send("TERM", &child);
    std::thread::sleep(Duration::from_millis(30));
    send("TERM", &child);
    let status = ends(&mut child);
    let mut said = String::new();
    std::io::Read::read_to_string(child.stderr.as_mut().expect("piped"), &mut said).expect("text");
    assert!(!said.contains("home the rig"), "{said}");
    // On a slow machine the first may have been enough.
    match status.code() {
        Some(131) => assert!(said.contains("captures.jsonl") && said.contains("--captures"), "{said}"),
        code => assert_eq!(code, Some(143), "{said}"),
    }
}

#[test]
fn a_simulation_of_another_sensor_stays_where_it_is() {
    let checked = run(&["check", VIRTUAL, SMALL, "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&checked.stdout).expect("a report");
    let hash = report["plan"]["trajectory_blake3"].as_str().expect("a hash").to_owned();
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("sim")).expect("a folder");
    let files = [
        ("trajectory.blake3", format!("{hash}\nsensor digit\n")),
        ("sim/000000.png", "a picture".to_owned()),
        ("captures.jsonl", "{}\n".to_owned()),
    ];
    for (name, content) in &files {
        std::fs::write(at(name), content).expect("a file");
    }
    let out = folder.path().to_str().expect("a path");
    let output = run(&["simulate", VIRTUAL, SMALL, "--out", out]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("sensor digit") && said.contains("this is gelsight"), "{said}");
    assert!(said.contains("choose another --out"), "{said}");
    for (name, content) in &files {
        assert_eq!(&std::fs::read_to_string(at(name)).expect("it is still there"), content, "{name}");
    }
}

/// A pressed frame light by light: what is written is what relight takes.
#[test]
fn a_simulated_press_is_relit_without_rendering() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).to_str().expect("a path").to_owned();
    let out = at("sim");
    let quick = ["--captures", "2", "--set", "elastomer.tolerance=0.1", "--set", "optics.tolerance=0.05"];
    // What an earlier run left is not taken for this one's.
    std::fs::create_dir_all(at("sim/basis/000003")).expect("a folder");
    std::fs::write(at("sim/basis/000003/basis.json"), "[]").expect("a file");
    let output =
        run(&[&["simulate", VIRTUAL, SMALL, "--out", &out, "--basis", "--judge", "1"][..], &quick].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(!std::path::Path::new(&at("sim/basis/000003")).exists());
    let basis = at("sim/basis/000002");
    let list = std::fs::read_to_string(at("sim/basis/000002/basis.json")).expect("a list");
    let list: serde_json::Value = serde_json::from_str(&list).expect("lights");
    let lights = list["lights"].as_array().expect("a list");
    assert_eq!(lights.len(), 4);
    assert!(lights.iter().all(|light| light["estimated_error"].as_f64().is_some_and(|e| e > 0.0)), "{list}");
    let line = std::fs::read_to_string(at("sim/captures.jsonl")).expect("a line");
    let line: serde_json::Value = serde_json::from_str(&line).expect("a capture");
    assert!(line["light_error"].as_f64().is_some_and(|e| e > 0.0), "{line}");
    assert_eq!(list["estimated_error"], line["light_error"]);
    // Two pictures of one sample a pixel find no more than that.
    let [found, floor] = ["light_error_found", "light_error_floor"].map(|name| line[name].as_f64());
    assert!(floor.is_some_and(|floor| floor > 0.0 && found < Some(0.05 + floor)), "{line}");
    let summary = text(&output.stdout);
    assert!(summary.contains("1 judged, the worst is 2:"), "{summary}");
    let picture = |path: &str| {
        let bytes = std::fs::read(path).expect("a picture");
        twinrig::image::png::decode(&bytes).expect("a PNG").rgb
    };
    let relit = |lights: &[&str]| {
        let to = at("relit.png");
        let output = run(&[&["relight", &basis, "--out", &to][..], lights].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        picture(&to)
    };
    // In the sensor's own colours it is the picture, but for the camera's noise.
    let simulated = picture(&at("sim/sim/000002.png"));
    let apart = |a: &[u8], b: &[u8]| {
        a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
    };
    let same = relit(&[]);
    assert!(apart(&same, &simulated) < 3.0, "{}", apart(&same, &simulated));
    let without = relit(&["--light", &format!("{}=0,0,0", lights[0]["light"].as_str().expect("a name"))]);
    assert!(apart(&without, &simulated) > 2.0 * apart(&same, &simulated));
}

#[test]
fn a_dry_run_prints_the_bytes_and_touches_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("set");
    let output = collect(&out, "1", &["--dry-run"]).output().expect("starts");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    for z in ["Z40.3", "Z40.6", "Z40.9"] {
        assert!(printed.lines().any(|l| l.contains("press") && l.contains(z)), "{z}:\n{printed}");
    }
    assert!(printed.contains("capture 3"), "{printed}");
    assert!(!out.exists());
}

#[test]
fn an_emulator_answers_other_peoples_clients() {
    let folder = tempfile::tempdir().expect("a folder");
    let link = folder.path().join("stage");
    let mut child = twinrig(&["emulate", "grbl", "--link", link.to_str().expect("a path"), "--speed", "10"])
        .spawn()
        .expect("starts");
    wait_for("the link", || link.exists().then_some(()));
    let mut port = std::fs::OpenOptions::new().read(true).write(true).open(&link).expect("the port opens");
    port.write_all(b"$I\n").expect("writes");
    let mut said = Vec::new();
    let mut byte = [0u8];
    while !text(&said).contains("ok\r\n") {
        assert_eq!(port.read(&mut byte).expect("reads"), 1);
        said.push(byte[0]);
        assert!(said.len() < 4096, "{}", text(&said));
    }
    assert!(text(&said).contains("[VER:1.1h"), "{}", text(&said));
    drop(port);
    // Nobody takes its place while it lives.
    let second = run(&["emulate", "marlin", "--link", link.to_str().expect("a path")]);
    assert_eq!(second.status.code(), Some(1));
    assert!(text(&second.stderr).contains("another emulator answers there"), "{}", text(&second.stderr));
    send("TERM", &child);
    assert_eq!(ends(&mut child).code(), Some(0), "a signal is an emulator's proper end");
    let mut said = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut said).expect("reads");
    assert_eq!(said, "", "of which nobody need be told");
    assert!(link.symlink_metadata().is_err(), "it has cleared its link away");
}

#[test]
fn killed_in_mid_run_and_resumed_nothing_is_lost_or_doubled() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("set");
    let mut child = collect(&out, "15", &[]).spawn().expect("starts");
    wait_for("the second capture", || (real_lines(&out) >= 2).then_some(()));
    child.kill().expect("SIGKILL");
    child.wait().expect("ends");
    let before = std::fs::read_to_string(out.join("journal/real.ndjson")).expect("a journal");

    let refused = collect(&out, "50", &[]).output().expect("starts");
    assert_eq!(refused.status.code(), Some(2), "without --resume it is refused");
    assert!(text(&refused.stderr).contains("--resume"), "{}", text(&refused.stderr));

    let resumed = collect(&out, "50", &["--resume", "--json"]).output().expect("starts");
    assert_eq!(resumed.status.code(), Some(0), "{}", text(&resumed.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&resumed.stdout).expect("JSON");
    assert_eq!(
        (&summary["real"], &summary["simulated"], &summary["pairs"]),
        (&4.into(), &4.into(), &4.into())
    );
    let found = verified(&out);
    assert_eq!(found["findings"], serde_json::json!([]));
    assert_eq!(found["rows"], 4);
    let after = std::fs::read_to_string(out.join("journal/real.ndjson")).expect("a journal");
    let whole = before.rfind('\n').map_or("", |end| &before[..=end]);
    assert!(after.starts_with(whole), "what was there is not written again");
    assert_eq!(real_lines(&out), 4);
    assert!(std::fs::metadata(out.join("report.html")).expect("a report").len() > 1000);
}

#[test]
fn a_signal_ends_it_with_its_code_and_a_dataset_that_resumes() {
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let folder = tempfile::tempdir().expect("a folder");
        let out: PathBuf = folder.path().join("set");
        let mut child = collect(&out, "15", &["--real-only"]).spawn().expect("starts");
        wait_for("the first capture", || (real_lines(&out) >= 1).then_some(()));
        send(signal, &child);
        let status = ends(&mut child);
        let mut said = String::new();
        child.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
        assert_eq!(status.code(), Some(code), "{signal}: {said}");
        assert!(said.contains("stopping"), "{said}");
        let done = real_lines(&out);
        assert!(done < 4, "{signal} came too late");
        assert_eq!(verified(&out)["real"], done, "{signal}: {said}");
        let resumed = collect(&out, "50", &["--real-only", "--resume"]).output().expect("starts");
        assert_eq!(resumed.status.code(), Some(0), "{}", text(&resumed.stderr));
        assert_eq!(real_lines(&out), 4, "{signal}");
    }
}

#[test]
fn a_dataset_of_another_plan_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("set");
    let first = collect(&out, "100", &["--real-only"]).output().expect("starts");
    assert_eq!(first.status.code(), Some(0), "{}", text(&first.stderr));
    let other = collect(&out, "100", &["--real-only", "--resume", "--set", "plan.depths.list_mm=[0.2]"])
        .output()
        .expect("starts");
    assert_eq!(other.status.code(), Some(2), "{}", text(&other.stderr));
    assert!(text(&other.stderr).contains("another"), "{}", text(&other.stderr));
    assert_eq!(verified(&out)["real"], 4);
}

#[test]
fn protocols_are_listed_linted_and_tested() {
    let listed = text(&run(&["protocol", "list"]).stdout);
    for name in ["grbl", "marlin", "zaber_ascii", "newport_smc100"] {
        assert!(listed.lines().any(|l| l.starts_with(&format!("{name} "))), "{listed}");
    }
    let output = run(&["protocol", "test", "grbl", "newport_smc100"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout).matches("all hold").count(), 2);

    // What does not hold is code 1, and told with its line.
    let fails = "tests/bad_protocols/fails.toml";
    let output = run(&["protocol", "test", fails]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("3 of them FAIL"), "{said}");
    let line = said.lines().find(|l| l.contains("1PA5.1")).unwrap_or_else(|| panic!("{said}"));
    let number: usize =
        line.split(':').nth(1).and_then(|n| n.parse().ok()).unwrap_or_else(|| panic!("{line}"));
    let file = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(fails)).expect("a fixture");
    assert_eq!(file.lines().nth(number - 1), Some(r#"tx = "1PA5.1\r\n""#), "{line}");

    // What is not a protocol is code 2.
    let output = run(&["protocol", "test", "grbl", "tests/bad_protocols/syntax.toml", "--json"]);
    assert_eq!(output.status.code(), Some(2));
    let verdicts: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one document");
    assert_eq!(verdicts[0]["refused"], serde_json::Value::Null);
    assert!(verdicts[1]["refused"]["findings"][0]["line"].as_u64().is_some(), "{verdicts}");
    assert_eq!(run(&["protocol", "lint", "nothing_of_that_name"]).status.code(), Some(2));
}

#[test]
fn a_coordinate_that_the_rig_has_not_is_refused_before_anything_moves() {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("rig.toml");
    let shipped = std::fs::read_to_string(VIRTUAL).expect("the shipped rig");
    let without_y: Vec<&str> = shipped.lines().filter(|l| !l.starts_with("y = {")).collect();
    std::fs::write(&rig, without_y.join("\n")).expect("writes");
    let output = run(&["move", rig.to_str().expect("a path"), "--y", "3", "--home", "--speed", "50"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let said = text(&output.stderr);
    assert!(said.contains("no axis for y") && said.contains("nothing was moved"), "{said}");
}

#[test]
fn the_log_of_every_port_is_replayed_and_a_difference_is_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let moved = twinrig(&["move", VIRTUAL, "--z", "5", "--home", "--speed", "20"])
        .env("TWINRIG_LOGS", folder.path())
        .output()
        .expect("the program starts");
    assert!(moved.status.success(), "{}", text(&moved.stderr));
    let session =
        std::fs::read_dir(folder.path()).expect("logs").next().expect("a session").expect("a folder");
    for device in ["arm", "stage"] {
        let log = session.path().join(format!("{device}.log"));
        let path = log.to_str().expect("a path");
        let output = run(&["replay", path]);
        let said = text(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{said}{}", text(&output.stderr));
        assert!(said.contains("run home") && said.contains("would do the same"), "{said}");
    }
    let log = session.path().join("arm.log");
    let honest = std::fs::read_to_string(&log).expect("a log");
    let target = honest.lines().find(|l| l.contains(" > ") && l.contains("G1 ")).expect("a move");
    std::fs::write(&log, honest.replace(target, &target.replace("G1 ", "G0 "))).expect("a log");
    let output = run(&["replay", log.to_str().expect("a path"), "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let story: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one document");
    assert!(story["difference"]["engine"].as_str().is_some_and(|e| e.contains("G1 ")), "{story}");
    assert_eq!(run(&["replay", "README.md"]).status.code(), Some(2));
}

#[test]
fn a_move_of_axes_that_are_not_homed_says_how_they_are() {
    let output = run(&["move", VIRTUAL, "--z", "5", "--speed", "50"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let said = text(&output.stderr);
    assert!(
        said.contains("not homed") && said.contains("--home") && said.contains("nothing was moved"),
        "{said}"
    );
}

#[test]
fn an_arm_is_not_homed_for_a_pose_that_it_cannot_take() {
    let wide = "devices.arm.kinematics.tool.x.max=150.0";
    let arm = "rig_configs/servo_arm.toml";
    let output = run(&["move", arm, "--x", "120", "--home", "--speed", "50", "--set", wide]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("device arm: (x 120.000") && said.contains("nothing was moved"), "{said}");
}

#[test]
fn no_message_has_a_number_of_three_hundred_digits() {
    for args in [
        ["check", VIRTUAL, SMALL, "--set", "plan.clearance_mm=1e300"],
        [
            "check",
            "rig_configs/servo_arm.toml",
            SMALL,
            "--set",
            "devices.arm.kinematics.ready_mm=[1e300, 0.0, 0.0]",
        ],
        ["move", VIRTUAL, "--home", "--z=1e300", "--speed=50"],
    ] {
        let output = run(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        let said = text(&output.stderr);
        assert!(said.contains("1e300") && !said.contains("00000000000"), "{said}");
    }
}

#[test]
fn a_tolerance_that_picks_no_work_is_told() {
    const SCENE: &str = "tests/data/optics/tactile-bench-1.json";
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("a.npy").to_str().expect("a path").to_owned();
    let told = |tolerance: &str| {
        let small = ["--mode", "fast", "--size", "16x12", "--out", &out, "--tolerance", tolerance];
        let output = run(&[&["render", SCENE][..], &small].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stderr).to_owned()
    };
    let coarse = told("0.05");
    assert!(coarse.contains("from 0.002 to 0.01; 0.05 saves little over 0.01"), "{coarse}");
    assert!(told("0.001").contains("from 0.002 to 0.01; 0.001 takes longer"));
    assert!(!told("0.01").contains("from 0.002 to 0.01"));
    for command in ["render", "bench optics", "stress optics"] {
        let args: Vec<&str> = command.split(' ').chain(["--help"]).collect();
        let help = run(&args);
        let help = text(&help.stdout).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(help.contains("from 0.002 to 0.01"), "{command}: {help}");
    }
}

#[test]
fn what_optics_cannot_do_is_refused_before_the_work() {
    const SCENE: &str = "tests/data/optics/tactile-bench-1.json";
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).to_str().expect("a path").to_owned();
    let (out, nowhere, file) = (at("a.npy"), at("none/a.npy"), at("file"));
    std::fs::write(&file, "").expect("a file");
    let below = at("file/x");
    let cases: [(&[&str], &str); 24] = [
        (&["render", SCENE, "--out", &out, "--tolerance", "0.01"], "--mode fast"),
        (&["render", SCENE, "--out", &out, "--mode", "fast", "--seed", "3"], "--mode reference"),
        (&["render", SCENE, "--out", &out, "--mode", "fast", "--spp", "3"], "--mode reference"),
        (&["render", SCENE, "--out", &out, "--mode", "fast", "--tolerance", "7"], "0.0001 to 0.5"),
        (
            &["render", SCENE, "--out", &out, "--mode", "fast", "--tolerance", "-1"],
            "'-1' for '--tolerance <TOLERANCE>': a tolerance is from 0.0001 to 0.5",
        ),
        (
            &["render", SCENE, "--out", &out, "--mode", "fast", "--tolerance", "-.5"],
            "'-.5' for '--tolerance <TOLERANCE>': a tolerance is from 0.0001 to 0.5",
        ),
        (&["render", SCENE, "--out", &out, "--spp", "-1"], "\"-1\" is not a whole number from 1 to 1000000"),
        (
            &["render", SCENE, "--out", &out, "--spp", "1e3"],
            "\"1e3\" is not a whole number from 1 to 1000000",
        ),
        (&["render", SCENE, "--out", &out, "--seed", "9e9"], "from 0 to 4294967295"),
        (&["render", SCENE, "--out", &out, "--size", "-1x5"], "\"-1x5\" is no raster"),
        (&["bench", "optics", "--judge-spp", "-3"], "\"-3\" is not a whole number from 2 to 65536"),
        (&["collect", VIRTUAL, SMALL, "--out", &out, "--speed", "-2"], "speed from 0.1 to 1000"),
        (&["render", SCENE, "--out", &out, "--size", "0x4"], "1 to 16384"),
        (&["render", SCENE, "--out", &nowhere], "cannot write"),
        (&["render", SCENE, "--out", &out, "--basis", &file], "cannot write"),
        (&["bench", "optics", "--cases", "zzz"], "glossy coat"),
        (&["bench", "optics", "--cases", "glossy", "--tolerance", "7"], "0.0001 to 0.5"),
        (&["bench", "optics", "--quick", "--out", &below], "choose another folder"),
        (&["bench", "elastomer", "--smoke", "--out", &file], "choose another folder"),
        (&["stress", "optics", "--tolerance", "9"], "0.0001 to 0.5"),
        (&["simulate", VIRTUAL, SMALL, "--out", &nowhere, "--surface", "--background", &file], "--render"),
        (&["simulate", VIRTUAL, SMALL, "--out", &nowhere, "--surface", "--judge", "4"], "add --render"),
        (
            &["simulate", VIRTUAL, SMALL, "--out", &nowhere, "--judge", "0"],
            "\"0\" is not a whole number from 1 to 65536",
        ),
        (
            &["simulate", VIRTUAL, SMALL, "--out", &nowhere, "--set", NO_TEXTURE, "--background", &file],
            "sensor.optics.texture=ratio",
        ),
    ];
    for (args, says) in cases {
        let output = run(args);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
        assert!(said.contains(says), "{args:?}: {said}");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).expect("a list").collect();
    assert_eq!(left.len(), 1, "{left:?}");
    // A sensor that the fast mode has no way for: the next move is the mode that has.
    let glossy = at("gelsight.toml");
    let gelsight = std::fs::read_to_string("rig_configs/sensors/gelsight.toml").expect("the sensor");
    std::fs::write(&glossy, gelsight.replace("roughness = 1.0", "roughness = 0.5")).expect("a sensor");
    let output = run(&["render", &glossy, "--mode", "fast", "--out", &out]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("optics.coating.roughness = 0.5") && said.contains("--mode reference"), "{said}");
    // Nor has relight a way without a basis.
    let folder_told = folder.path().to_str().expect("a path");
    let said = text(&run(&["relight", folder_told, "--out", &out]).stderr);
    assert!(said.contains("holds no basis") && said.contains("--basis"), "{said}");
    // A picture without light is one, and is told.
    let mut dark: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(SCENE).expect("the scene")).expect("a scene");
    let night = at("night.json");
    for (mode, lights_are_off) in [("reference", true), ("fast", true), ("reference", false)] {
        let lights = dark["lights"].as_array_mut().expect("a list");
        match lights_are_off {
            true => lights.iter_mut().for_each(|l| l["radiance_linear_rgb"] = serde_json::json!([0, 0, 0])),
            false => lights.clear(),
        }
        std::fs::write(&night, dark.to_string()).expect("a scene");
        let small = ["--size", "8x6", "--json", "--mode", mode];
        let output = run(&[&["render", &night, "--out", &out][..], &small].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.contains("no light of") && text(&output.stdout).contains("\"is_dark\": true"), "{said}");
    }
    std::fs::remove_file(&out).expect("written");
    let output = run(&["render", &night, "--out", &out, "--basis", &at("basis")]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stdout));
    assert!(text(&output.stderr).contains("the scene has no light"), "{}", text(&output.stderr));
    // What is full is known too late: that is a failure.
    std::os::unix::fs::symlink("/dev/full", &out).expect("a link");
    let output = run(&["render", SCENE, "--out", &out, "--size", "8x6", "--spp", "1"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
}
