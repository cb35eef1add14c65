//! Reaching a session from outside, and moving a bench by hand: the program as another process meets it.
//!
//! Sessions run on the virtual bench; where ports are needed, `twinrig emulate` serves them. Each test has a folder of
//! control sockets of its own.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const VIRTUAL: &str = "rig_configs/virtual.toml";
const SMALL: &str = "rig_configs/plans/small.toml";

/// The program, with its control sockets in `sockets`.
fn twinrig(sockets: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_twinrig"));
    command.args(args).current_dir(env!("CARGO_MANIFEST_DIR")).env("NO_COLOR", "1").env_remove("TWINRIG_LOG");
    command.env("XDG_RUNTIME_DIR", sockets);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn run(sockets: &Path, args: &[&str]) -> Output {
    twinrig(sockets, args).output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", text(&output.stderr)))
}

fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The one session that `twinrig status` finds.
fn session(sockets: &Path, rig: &str) -> Option<serde_json::Value> {
    let output = run(sockets, &["status", rig, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    json(&output)["sessions"].get(0).cloned()
}

/// A session at real speed, real side only, whose arm knows where it is.
fn session_at_work(sockets: &Path, out: &Path) -> Child {
    let out = out.to_str().expect("a path");
    let child = twinrig(sockets, &["collect", VIRTUAL, SMALL, "--real-only", "--speed", "4", "--out", out])
        .spawn()
        .expect("the program starts");
    wait_for("a homed bench", || {
        let found = session(sockets, VIRTUAL)?;
        (found["devices"]["stage"]["reference"] == "referenced" && found["pose"].is_object()).then_some(())
    });
    child
}

fn ends(mut child: Child) -> (Option<i32>, String) {
    let status = wait_for("the end of the program", || child.try_wait().expect("a child"));
    let mut said = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
    (status.code(), said)
}

#[test]
fn a_running_session_tells_what_it_does_and_stops_when_it_is_asked_to() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let child = session_at_work(folder.path(), &out);
    let found = session(folder.path(), VIRTUAL).expect("it still runs");
    assert_eq!((found["command"].as_str(), found["stop"].as_str()), (Some("collect"), Some("running")));
    assert_eq!(found["progress"]["captures"], 4);
    assert_eq!(found["devices"]["arm"]["axes"][1]["axis"], "z");
    assert!(found["devices"]["arm"]["identity"].as_str().is_some_and(|i| i.contains("Marlin")), "{found}");
    let shown = text(&run(folder.path(), &["status", VIRTUAL]).stdout);
    assert!(shown.contains("collect runs (process") && shown.contains("of 4 captures"), "{shown}");
    // Another bench has no session.
    let other = folder.path().join("other.toml");
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join(VIRTUAL), &other).unwrap();
    assert!(session(folder.path(), other.to_str().unwrap()).is_none());

    let stopped = run(folder.path(), &["stop", VIRTUAL]);
    assert_eq!(stopped.status.code(), Some(0), "{}", text(&stopped.stderr));
    assert!(
        text(&stopped.stdout).starts_with("stopping: collect on virtual bench"),
        "{}",
        text(&stopped.stdout)
    );
    let (code, said) = ends(child);
    assert_eq!(code, Some(143), "{said}");
    assert!(said.contains("`twinrig stop` asks for it"), "{said}");
    let verified = run(folder.path(), &["verify", out.to_str().unwrap()]);
    assert_eq!(verified.status.code(), Some(0), "{}", text(&verified.stderr));

    assert!(session(folder.path(), VIRTUAL).is_none());
    let nothing = run(folder.path(), &["stop", VIRTUAL]);
    assert_eq!(nothing.status.code(), Some(0));
    assert!(text(&nothing.stdout).contains("no session"), "{}", text(&nothing.stdout));
    let left = std::fs::read_dir(folder.path().join("twinrig")).unwrap().count();
    assert_eq!(left, 0, "no socket is left behind");
}

#[test]
fn stop_now_ends_a_session_as_a_second_signal_does_and_a_killed_one_leaves_nothing_in_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let child = session_at_work(folder.path(), &folder.path().join("a"));
    let stopped = run(folder.path(), &["stop", VIRTUAL, "--now", "--json"]);
    assert_eq!(json(&stopped)["sessions"][0]["command"], "collect");
    assert_eq!(ends(child).0, Some(131));

    let mut killed = session_at_work(folder.path(), &folder.path().join("b"));
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert_eq!(
        std::fs::read_dir(folder.path().join("twinrig")).unwrap().count(),
        1,
        "its socket is still there"
    );
    assert!(session(folder.path(), VIRTUAL).is_none());
    assert_eq!(std::fs::read_dir(folder.path().join("twinrig")).unwrap().count(), 0, "and removed");
}

/// A printer and a stage as `twinrig emulate` serves them; killed on drop.
struct Ports(Vec<Child>);

impl Drop for Ports {
    fn drop(&mut self) {
        for child in &mut self.0 {
            _ = child.kill();
            _ = child.wait();
        }
    }
}

#[test]
fn without_a_session_the_ports_are_asked_and_stopped_directly() {
    let folder = tempfile::tempdir().unwrap();
    let sockets = folder.path();
    let (arm, stage) = (folder.path().join("arm"), folder.path().join("stage"));
    let serve = |protocol: &str, link: &Path| {
        let link = link.to_str().expect("a path");
        twinrig(sockets, &["emulate", protocol, "--link", link, "--speed", "10"]).spawn().expect("it starts")
    };
    let mut ports = Ports(vec![serve("marlin", &arm), serve("grbl", &stage)]);
    wait_for("the ports", || (arm.exists() && stage.exists()).then_some(()));
    let sets = [
        format!("devices.arm.port={:?}", arm.display().to_string()),
        format!("devices.stage.port={:?}", stage.display().to_string()),
    ];
    let rig = "rig_configs/skin_marlin_grbl.toml";
    let args = |command| {
        vec![
            command,
            rig,
            "--set",
            &sets[0],
            "--set",
            &sets[1],
            "--set",
            "devices.arm.identity=Marlin",
            "--json",
        ]
    };

    let status = run(sockets, &args("status"));
    assert_eq!(status.status.code(), Some(0), "{}", text(&status.stderr));
    let devices = &json(&status)["devices"];
    assert!(devices["stage"]["identity"].as_str().is_some_and(|i| i.contains("Grbl")), "{devices}");
    assert_eq!(devices["stage"]["reference"], "unknown");
    assert!(devices["arm"]["axes"][0]["position"].is_number(), "{devices}");

    let stop = run(sockets, &args("stop"));
    assert_eq!(stop.status.code(), Some(0), "{}", text(&stop.stderr));
    assert_eq!(json(&stop)["ports"]["stage"]["written"], "\\x85!");
    assert_eq!(json(&stop)["ports"]["arm"]["written"], "M410\\n");

    // As they are served, the emulated controllers are set up for the rig: it homes.
    let home = || run(sockets, &["home", rig, "--set", &sets[0], "--set", &sets[1]]);
    let homed = home();
    assert_eq!(homed.status.code(), Some(0), "{}", text(&homed.stderr));
    // A Marlin that was killed is silent from then on: the stop says so, and so does whoever finds it.
    let mut now = args("stop");
    now.retain(|arg| *arg != "--json");
    now.push("--now");
    let stop = run(sockets, &now);
    assert_eq!(stop.status.code(), Some(0), "{}", text(&stop.stderr));
    let not_homed = home();
    assert_eq!(not_homed.status.code(), Some(1));
    for said in [text(&stop.stderr), text(&not_homed.stderr)] {
        for words in ["arm", "M112", "halted", "reset button", "`twinrig home RIG`"] {
            assert!(said.contains(words), "{words} is missing: {said}");
        }
    }

    // One port that is gone hides nothing of the other, and stops nothing less.
    ports.0[0].kill().unwrap();
    ports.0[0].wait().unwrap();
    _ = std::fs::remove_file(&arm);
    let stop = run(sockets, &args("stop"));
    assert_eq!(stop.status.code(), Some(1));
    assert!(text(&stop.stderr).contains("device arm: there is no port"), "{}", text(&stop.stderr));
    assert_eq!(json(&stop)["ports"]["stage"]["written"], "\\x85!");
    let status = run(sockets, &args("status"));
    assert_eq!(status.status.code(), Some(1));
    assert!(json(&status)["devices"]["stage"]["axes"][0]["position"].is_number());
}

mod at_a_terminal {
    use super::*;
    use rustix::pty::OpenptFlags;
    use std::fs::File;
    use std::io::Write;
    use std::os::fd::OwnedFd;
    use std::sync::{Arc, Mutex};

    /// Somebody at a terminal.
    struct Hands {
        keyboard: File,
        screen: Arc<Mutex<String>>,
        /// Where in it the last look ended.
        looked: Arc<Mutex<usize>>,
        child: Child,
    }

    /// What a terminal tells of keys.
    #[derive(Clone, Copy, PartialEq)]
    enum Tells {
        /// Touches, repeats and releases apart: the kitty keyboard protocol.
        Everything,
        /// A repeat looks like a touch, a release like nothing: most terminals.
        Touches,
    }

    impl Hands {
        fn on(mut command: Command, tells: Tells) -> Hands {
            let master =
                rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
            rustix::pty::grantpt(&master).unwrap();
            rustix::pty::unlockpt(&master).unwrap();
            let name = rustix::pty::ptsname(&master, Vec::new()).unwrap();
            let slave = || -> OwnedFd {
                File::options().read(true).write(true).open(name.to_str().unwrap()).unwrap().into()
            };
            let child =
                command.stdin(slave()).stdout(slave()).stderr(slave()).env("TERM", "xterm").spawn().unwrap();
            let keyboard: File = master.into();
            let screen = Arc::<Mutex<String>>::default();
            let (mut reader, mut answers, shown) =
                (keyboard.try_clone().unwrap(), keyboard.try_clone().unwrap(), screen.clone());
            std::thread::spawn(move || {
                let mut buffer = [0; 4096];
                while let Ok(n @ 1..) = reader.read(&mut buffer) {
                    let text = String::from_utf8_lossy(&buffer[..n]).into_owned();
                    // Which flags are set, which most terminals do not understand; then who are you.
                    if text.contains("\x1b[?u") {
                        let flags: &[u8] = if tells == Tells::Everything { b"\x1b[?0u" } else { b"" };
                        answers.write_all(flags).unwrap();
                        answers.write_all(b"\x1b[?62c").unwrap();
                    }
                    shown.lock().unwrap().push_str(&text);
                }
            });
            Hands { keyboard, screen, looked: Arc::default(), child }
        }

        fn type_in(&mut self, keys: &str) {
            self.keyboard.write_all(keys.as_bytes()).unwrap();
        }

        /// What was painted since the last look.
        fn painted(&self) -> String {
            let (all, mut looked) = (self.all(), self.looked.lock().unwrap());
            let from = std::mem::replace(&mut *looked, all.len());
            all[from..].to_owned()
        }

        /// All that was ever painted.
        fn all(&self) -> String {
            self.screen.lock().unwrap().clone()
        }

        /// What was painted before is not looked at.
        fn wait_for_rest(&self) {
            self.painted();
            self.wait_for("at rest");
        }

        fn wait_for(&self, words: &str) {
            let mut all = String::new();
            super::wait_for(words, || {
                all.push_str(&self.painted());
                all.contains(words).then_some(())
            });
        }
    }

    impl Drop for Hands {
        fn drop(&mut self) {
            _ = self.child.kill();
            _ = self.child.wait();
        }
    }

    /// The rig file of a virtual bench whose controllers home faster than the recorded ones, by protocol files beside it: how
    /// long that takes is none of what is looked at.
    fn bench_that_homes_fast(folder: &Path) -> String {
        let faster = |protocol: &str, slow: &str, fast: &str| {
            let name = format!("firmware_protocols/{protocol}.toml");
            let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(&name)).unwrap();
            assert!(text.contains(slow), "{name} has no {slow:?}");
            std::fs::write(folder.join(name), text.replace(slow, fast)).unwrap();
        };
        std::fs::create_dir(folder.join("firmware_protocols")).unwrap();
        faster("marlin", "Z = 4.0 }", "Z = 40.0 }");
        faster("grbl", r#""24=25.000", "25=500.000""#, r#""24=2500.000", "25=5000.000""#);
        let rig = folder.join("virtual.toml");
        std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join(VIRTUAL), &rig).unwrap();
        rig.to_str().unwrap().to_owned()
    }

    const LEFT: &str = "\x1b[D";
    const LEFT_REPEATS: &str = "\x1b[1;1:2D";
    const LEFT_LET_GO: &str = "\x1b[1;1:3D";

    #[test]
    fn keys_move_the_bench_in_steps_and_for_as_long_as_they_are_held() {
        let folder = tempfile::tempdir().unwrap();
        let rig = bench_that_homes_fast(folder.path());
        let mut jog = twinrig(folder.path(), &["jog", &rig, "--feed", "4"]);
        // The log has much to say, and the display is not to be written over.
        jog.env("TWINRIG_LOG", "trace");
        let mut hands = Hands::on(jog, Tells::Everything);
        let x = || {
            let found = session(folder.path(), &rig).expect("it runs");
            found["pose"]["x_mm"].as_f64().expect("a position")
        };
        hands.wait_for("not homed: press h");
        // Before that nothing moves.
        hands.type_in(LEFT);
        hands.wait_for("the position is not known: press h to home");
        hands.type_in("h");
        hands.wait_for("at rest");
        // GRBL pulls a millimetre off its switch.
        assert!((x() - 29.0).abs() < 0.01, "homing ends near the end of the axis: {}", x());

        // The limits are the ends: of a step that would go further, the rest is left out; then there is none.
        hands.type_in("+++");
        hands.type_in("\x1b[C");
        super::wait_for("a step to the limit", || ((x() - 30.0).abs() < 0.011).then_some(()));
        hands.wait_for_rest();
        hands.type_in("\x1b[C");
        hands.wait_for("x is at its limit");
        // One touch is one step.
        hands.type_in("---");
        hands.type_in(LEFT);
        hands.type_in(LEFT_LET_GO);
        super::wait_for("a step", || ((x() - 29.9).abs() < 0.011).then_some(()));
        hands.wait_for_rest();

        // Held for about a second: about a second's way. Then the dead-man: no release is ever told.
        hands.type_in(LEFT);
        std::thread::sleep(Duration::from_millis(900));
        let from = x();
        for _ in 0..30 {
            hands.type_in(LEFT_REPEATS);
            std::thread::sleep(Duration::from_millis(33));
        }
        std::thread::sleep(Duration::from_millis(600));
        let to = x();
        assert!(from - to > 1.0 && from - to < 8.0, "from {from} to {to} at 4 mm/s");
        std::thread::sleep(Duration::from_millis(400));
        assert!((x() - to).abs() < 0.011, "it has come to rest");

        hands.type_in("q");
        let status = super::wait_for("the end", || hands.child.try_wait().unwrap());
        assert_eq!(status.code(), Some(0), "{}", hands.painted());
        super::wait_for("the cursor", || hands.all().contains("\x1b[?25h").then_some(()));
        let all = hands.all();
        let (display, after) = all.split_once("\x1b[?25h").unwrap();
        let (_, display) = display.split_once("not homed: press h").unwrap();
        let alone = display.replace("\r\n", "");
        assert!(
            display.contains("TRACE") && !alone.contains('\n'),
            "the latest is shown in the display: {display:?}"
        );
        assert!(after.matches("TRACE").count() > 1, "and all of it is told afterwards: {after:?}");
    }

    /// Hands at a bench that has been homed, and where its logs are.
    fn at_a_homed_bench(folder: &Path, tells: Tells) -> Hands {
        let mut jog = twinrig(folder, &["jog", &bench_that_homes_fast(folder), "--feed", "4"]);
        jog.env("TWINRIG_LOGS", folder.join("logs"));
        let mut hands = Hands::on(jog, tells);
        hands.wait_for("not homed: press h");
        hands.type_in("h");
        hands.wait_for("at rest");
        hands
    }

    /// The log of the stage's port, as far as it is written.
    fn stage_log(folder: &Path) -> String {
        let mut folders = vec![folder.join("logs")];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap().flatten() {
                match entry.path() {
                    path if path.is_dir() => folders.push(path),
                    path if path.ends_with("stage.log") => return std::fs::read_to_string(path).unwrap(),
                    _ => {}
                }
            }
        }
        panic!("no log of the stage's port");
    }

    /// How often GRBL was told to end a jog.
    fn cancels(folder: &Path) -> usize {
        stage_log(folder).matches(r"> \x85").count()
    }

    /// Holds a key until it has moved the stage for a third of a second, ends that in some way, and returns how long
    /// after the last key, or what ended it, the bytes that end the motion were on the port.
    fn held_then(hands: &mut Hands, folder: &Path, repeat: &str, end: &str) -> Duration {
        let before = cancels(folder);
        glide(hands, folder, repeat);
        assert_eq!(cancels(folder), before, "while the key is held nothing ends");
        let last = Instant::now();
        hands.type_in(if end.is_empty() { repeat } else { end });
        loop {
            if cancels(folder) > before {
                return last.elapsed();
            }
            assert!(last.elapsed() < Duration::from_secs(10), "the motion is never ended");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Holds a key down: the first touch is a step; the repeats that outlive it move the stage piece by piece.
    fn glide(hands: &mut Hands, folder: &Path, repeat: &str) {
        let pieces = || stage_log(folder).matches("\"jog\":true").count();
        let (before, begun) = (pieces(), Instant::now());
        hands.type_in(LEFT);
        std::thread::sleep(Duration::from_millis(100));
        while pieces() < before + 4 {
            assert!(begun.elapsed() < Duration::from_secs(30), "a held key moves nothing");
            hands.type_in(repeat);
            std::thread::sleep(Duration::from_millis(33));
        }
    }

    const DEAD_MAN: Duration = Duration::from_millis(150);
    /// For the scheduler of a machine that runs other tests; on a free one it takes 5 ms.
    const LATE: Duration = Duration::from_millis(120);

    #[test]
    #[expect(clippy::print_stderr, reason = "how long it took is worth knowing")]
    fn the_stop_bytes_leave_when_repeats_stay_out_and_at_once_when_the_terminal_tells_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let mut hands = at_a_homed_bench(folder.path(), Tells::Everything);
        let mut held = |repeat, end| {
            let took = held_then(&mut hands, folder.path(), repeat, end);
            hands.wait_for_rest();
            took
        };
        let silence: Vec<Duration> = (0..3).map(|_| held(LEFT_REPEATS, "")).collect();
        let released = held(LEFT_REPEATS, LEFT_LET_GO);
        let focus_lost = held(LEFT_REPEATS, "\x1b[O");
        eprintln!("silence {silence:?}, release {released:?}, focus {focus_lost:?}");
        for took in &silence {
            assert!((DEAD_MAN..DEAD_MAN + LATE).contains(took), "after the last repeat: {silence:?}");
        }
        assert!(released < LATE, "after the release: {released:?}");
        assert!(focus_lost < LATE, "after the loss of the focus: {focus_lost:?}");

        // What the keyboard repeats into a window without the focus, or after its release, moves nothing.
        let moves = || stage_log(folder.path()).matches("> $J=").count();
        let before = moves();
        for _ in 0..10 {
            hands.type_in(LEFT_REPEATS);
            std::thread::sleep(Duration::from_millis(33));
        }
        assert_eq!(moves(), before);
    }

    #[test]
    #[expect(clippy::print_stderr, reason = "how long it took is worth knowing")]
    fn a_terminal_that_tells_no_releases_has_the_dead_man_and_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let mut hands = at_a_homed_bench(folder.path(), Tells::Touches);
        hands.wait_for("this terminal tells no key releases: motion ends 150 ms after the last repeat");
        let silence: Vec<Duration> = (0..3)
            .map(|_| {
                let took = held_then(&mut hands, folder.path(), LEFT, "");
                hands.wait_for_rest();
                took
            })
            .collect();
        eprintln!("silence {silence:?}");
        assert!(silence.iter().all(|took| (DEAD_MAN..DEAD_MAN + LATE).contains(took)), "{silence:?}");
    }

    #[test]
    fn the_position_is_live_between_its_limits_and_space_stops_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut hands = at_a_homed_bench(folder.path(), Tells::Everything);
        hands.painted();
        glide(&mut hands, folder.path(), LEFT_REPEATS);
        for _ in 0..20 {
            hands.type_in(LEFT_REPEATS);
            std::thread::sleep(Duration::from_millis(33));
        }
        let stops = || stage_log(folder.path()).lines().filter(|l| l.contains(" ! ")).count();
        assert_eq!(stops(), 0);
        hands.type_in(" ");
        let typed = Instant::now();
        super::wait_for("the stop's bytes", || (stops() > 0).then_some(()));
        assert!(typed.elapsed() < LATE, "{:?}", typed.elapsed());
        // One line of x: where it is, between the ends of its range, with a mark.
        let painted = hands.painted();
        let lines: Vec<&str> = painted.split("    x ").skip(1).collect();
        assert!(lines.iter().all(|l| l.contains("-30.0 [") && l.contains("] 30.0")), "{painted:?}");
        let mut seen: Vec<f64> =
            lines.iter().filter_map(|l| l.split_whitespace().next()?.parse().ok()).collect();
        assert!(seen.is_sorted_by(|a, b| a >= b), "{seen:?}");
        seen.dedup();
        assert!(seen.len() > 5, "it is told on the way, not at the end alone: {seen:?}");
        hands.wait_for("stopped");
    }
}

#[test]
fn jogging_without_a_terminal_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["jog", VIRTUAL]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("needs a terminal"), "{}", text(&output.stderr));
}
