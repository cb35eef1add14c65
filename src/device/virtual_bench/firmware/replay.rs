//! Replays recorded dialogues: the client's bytes at the recorded instants, and the recorded replies
//! demanded back, text and order.
//!
//! Exempt are, and only these: in-motion positions and speeds in status lines (two machines are
//! never at the same step at the same instant), and what each test names besides.

use super::*;
use crate::protocol::emulation::EmulatorSpec;
use std::path::Path;

/// The `[emulator]` table of a shipped protocol file.
pub(super) fn shipped(name: &str) -> EmulatorSpec {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("firmware_protocols/{name}.toml"));
    let text = std::fs::read_to_string(path).unwrap();
    crate::protocol::Spec::parse(name, &text).unwrap().emulator.unwrap()
}

/// A device that nobody watches, with the firmware's own axes.
pub(super) fn bare(spec: &EmulatorSpec, options: &EmulatorOptions) -> Emulator {
    Emulator::new(spec, "device", &BTreeMap::new(), options, World::without_pad(), Timestamp(0)).unwrap()
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Entry {
    Sent(Vec<u8>),
    Received(String),
}

/// A transcript as (seconds, entry).
pub(super) fn transcript(name: &str) -> Vec<(f64, Entry)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/transcripts/{name}.txt"));
    let text = std::fs::read_to_string(path).unwrap();
    let entry = |line: &str| {
        let (time, rest) = line.trim_start().split_once(' ')?;
        let time: f64 = time.parse().ok()?;
        let (direction, body) = rest.split_once(' ')?;
        let unquoted = body.trim_matches('\'').replace("\\r", "\r").replace("\\n", "\n");
        match direction {
            ">" => Some((time, Entry::Sent(client_bytes(&unquoted)))),
            "<" => Some((time, Entry::Received(unquoted))),
            _ => None,
        }
    };
    text.lines().filter_map(entry).collect()
}

fn client_bytes(text: &str) -> Vec<u8> {
    match (text.strip_prefix("hex:"), text.strip_prefix("raw:")) {
        (Some(hex), _) => vec![u8::from_str_radix(hex, 16).unwrap()],
        (_, Some(raw)) => raw.as_bytes().to_vec(),
        _ => text.as_bytes().to_vec(),
    }
}

/// Bench time that passes for a second of the recording, and how a line is compared.
pub(super) struct Rules {
    pub(super) pace: f64,
    pub(super) normalise: fn(&str) -> String,
    /// Status requests wait until the device is in the state that the record shows: a recorded
    /// `Idle` or `Hold:0` means that the motion before it was over.
    pub(super) patient: bool,
}

/// Plays a transcript; returns what was recorded and what came, both normalised.
pub(super) fn play(
    emulator: &mut Emulator,
    from: Timestamp,
    name: &str,
    rules: &Rules,
) -> (Timestamp, Vec<String>, Vec<String>) {
    let entries = transcript(name);
    let (mut recorded, mut came) = (Vec::new(), Vec::new());
    let mut late = Duration::ZERO;
    let mut now = from;
    let at =
        |seconds: f64, late: Duration| from.after(Duration::from_secs_f64(seconds * rules.pace)).after(late);
    for (i, (time, entry)) in entries.iter().enumerate() {
        now = at(*time, late).max(now);
        came.extend(emulator.poll_replies(now));
        match entry {
            Entry::Received(line) => recorded.push((rules.normalise)(line)),
            Entry::Sent(bytes) => {
                let answer = entries.get(i + 1).map(|(_, e)| e);
                if let (true, Some(Entry::Received(line))) = (rules.patient && bytes == b"?", answer) {
                    let wanted = line.trim_start_matches('<').split('|').next().unwrap_or_default();
                    let before = now;
                    while !is_in_state(emulator, wanted, now) && now.since(before) < Duration::from_secs(10) {
                        now = now.after(Duration::from_millis(20));
                    }
                    late += now.since(before);
                }
                emulator.receive(bytes, now);
            }
        }
    }
    now = now.after(Duration::from_secs(1));
    came.extend(emulator.poll_replies(now));
    let came = came.iter().map(|l| (rules.normalise)(&String::from_utf8_lossy(l))).collect();
    (now, recorded, came)
}

/// Whether nothing moves any more; states of motion are not waited for.
fn is_in_state(emulator: &mut Emulator, wanted: &str, now: Timestamp) -> bool {
    let still = emulator.firmware.motors().speed(now) == 0.0;
    !matches!(wanted, "Idle" | "Hold:0") || still
}

/// Positions and speeds of a status line while something moves become a blank.
fn in_motion_aside(line: &str) -> String {
    let moving = ["<Run", "<Jog", "<Hold:1"].iter().any(|s| line.starts_with(s));
    if !moving {
        return line.to_owned();
    }
    let keep = |field: &str| match field.split_once(':') {
        Some((name @ ("MPos" | "FS"), _)) => format!("{name}:_"),
        // A planner that joins blocks frees them at other instants.
        Some(("Bf", rest)) => format!("Bf:_,{}", rest.split_once(',').map_or("", |(_, b)| b)),
        _ => field.to_owned(),
    };
    line.split('|').map(keep).collect::<Vec<_>>().join("|")
}

fn compare(recorded: &[String], came: &[String]) {
    for (i, (a, b)) in recorded.iter().zip(came).enumerate() {
        assert_eq!(a, b, "line {i}, after {:?}", &recorded[i.saturating_sub(3)..i]);
    }
    assert_eq!(recorded.len(), came.len(), "recorded {:?}, came {:?}", recorded.last(), came.last());
}

/// Both recordings are of one controller, one after the other, so one emulator plays both. It ran
/// in a simulated AVR at about 0.56 of real time (`G1 X8 F200` covers 4.412 mm in 2.356 s where F200
/// is 3.33 mm/s), hence the pace. The controller had 0.5 mm on its counter when the record began.
#[test]
fn recorded_grbl_is_reproduced() {
    let options = EmulatorOptions { counter: [("X".to_owned(), 0.5)].into(), ..EmulatorOptions::default() };
    let mut grbl = bare(&shipped("grbl"), &options);
    let rules = Rules { pace: 0.56, normalise: in_motion_aside, patient: true };
    let power_up = grbl.poll_replies(Timestamp(1_000_000_000));
    assert_eq!(power_up.concat(), b"\r\nGrbl 1.1h ['$' for help]\r\n");
    let (now, recorded, came) = play(&mut grbl, Timestamp(1_000_000_000), "grbl11h_avr_basic", &rules);
    compare(&recorded, &came);
    let (_, recorded, mut came) = play(&mut grbl, now, "grbl11h_avr_motion", &rules);
    // Where a hold, a cancelled jog and a reset leave the axis depends on the instant they strike.
    same_rest(&recorded, &mut came, &["7.748", "18.396", "16.512", "19.660"]);
    compare(&recorded, &came);
}

/// Rest positions that an interruption made: wherever the record repeats one, the emulator must
/// repeat its own. Then they are written as recorded.
fn same_rest(recorded: &[String], came: &mut [String], rests: &[&str]) {
    fn x(line: &str) -> Option<&str> {
        line.split_once("Pos:")?.1.split(',').next()
    }
    for rest in rests {
        let mut own: Option<String> = None;
        for (recorded, came) in recorded.iter().zip(came.iter_mut()).filter(|(r, _)| x(r) == Some(rest)) {
            let mine = x(came).expect("a status line where one was recorded").to_owned();
            assert_eq!(own.get_or_insert_with(|| mine.clone()), &mine, "instead of {recorded}");
            *came = came.replacen(&mine, rest, 1);
        }
        assert!(own.is_some(), "{rest} is not in the record");
    }
}

/// The record begins while the printer boots: of the boot text only the last two lines are in it.
/// After M112 the record ends in silence; so does the emulator.
#[test]
fn recorded_marlin_is_reproduced() {
    let mut marlin = bare(&shipped("marlin"), &EmulatorOptions::default());
    let rules = Rules { pace: 1.0, normalise: str::to_owned, patient: false };
    let (_, recorded, came) = play(&mut marlin, Timestamp(0), "marlin116_creality_avr", &rules);
    let boot = came.len() - recorded.len();
    assert_eq!(came[0], "start\n");
    compare(&recorded, &came[boot..]);
}

/// Timing of the simulator is its own: a move starts and is acknowledged 0.24 s late, hence the pace,
/// at which a move still runs where the record saw it run. The emulator has a
/// fourth axis, so lists of three coordinates are recorded and lists of four come: the fourth is
/// dropped, as are its settings and its place in `$I`. The 16th report after the second reset has
/// a `WCO:` that neither the idle nor the busy count explains; it is exempt.
#[test]
fn recorded_grblhal_is_reproduced() {
    let mut hal = bare(&shipped("grblhal"), &EmulatorOptions::default());
    hal.poll(Timestamp(500_000_000));
    let rules = Rules { pace: 0.85, normalise: three_axes, patient: true };
    let (_, recorded, came) = play(&mut hal, Timestamp(1_000_000_000), "grblhal_sim_basic", &rules);
    let fourth = ["$103=", "$113=", "$123=", "$133="];
    let mut came: Vec<String> =
        came.into_iter().filter(|l| !fourth.iter().any(|s| l.starts_with(s))).collect();
    let mut recorded = recorded;
    let odd = recorded.iter().rposition(|l| l.contains("WCO:")).unwrap();
    for lines in [&mut recorded, &mut came] {
        lines[odd] = lines[odd].replace("|WCO:0.000,0.000,0.000", "");
    }
    compare(&recorded, &came);
}

fn three_axes(line: &str) -> String {
    in_motion_aside(line)
        .replace("0.000,0.000,0.000,0.000", "0.000,0.000,0.000")
        .replace(".000,0.000,0.000,0.000|", ".000,0.000,0.000|")
        .replace("[AXS:4:XYZA]", "[AXS:3:XYZ]")
        .replace("1024,4,0]", "1024,3,0]")
}

/// BUSY or IDLE depends on how fast a stage is, so it is exempt, and with it the LRC (checked line by
/// line); so is the id-less silence after a broadcast. Homing is immediate where the axis is home.
#[test]
fn recorded_zaber_is_reproduced() {
    let options =
        EmulatorOptions { power_on: [("1/1".to_owned(), 0.0)].into(), ..EmulatorOptions::default() };
    let mut zaber = bare(&shipped("zaber_ascii"), &options);
    let rules = Rules { pace: 1.0, normalise: busy_aside, patient: false };
    let (_, recorded, came) = play(&mut zaber, Timestamp(0), "zaber_motion_client_dialogue", &rules);
    assert_eq!(recorded.len(), 48);
    compare(&recorded, &came);
}

fn busy_aside(line: &str) -> String {
    let body = line.trim_end();
    let (text, lrc) = body.rsplit_once(':').unwrap();
    assert_eq!(format!("{:02X}", crate::protocol::ChecksumKind::Lrc8.of(&text.as_bytes()[1..])), lrc);
    text.replace(" BUSY ", " IDLE ")
}
