//! Binary dialects against frames that vendors' own clients sent, and against their manuals.

use super::replay::{bare, shipped};
use super::*;
use crate::protocol::value::parse_hex;

fn at(ms: u64) -> Timestamp {
    Timestamp(0).after(Duration::from_millis(ms))
}

/// Sends a frame given in hex; returns the replies within 20 ms in hex.
fn ask(emulator: &mut Emulator, frame: &str, at_ms: u64) -> Vec<String> {
    emulator.receive(&parse_hex(frame).unwrap(), at(at_ms));
    emulator.poll_replies(at(at_ms + 20)).iter().map(|f| crate::protocol::value::hex(f)).collect()
}

fn f32_at(frame: &str, index: usize) -> f32 {
    let bytes = parse_hex(frame).unwrap();
    f32::from_le_bytes(bytes[index..index + 4].try_into().unwrap())
}

fn i32_at(frame: &str, index: usize) -> i32 {
    let bytes = parse_hex(frame).unwrap();
    i32::from_le_bytes(bytes[index..index + 4].try_into().unwrap())
}

const DOBOT_MOVE: &str = "aa aa 13 54 03 02 00 00 48 43 00 00 00 00 00 00 46 42 00 00 00 00 94";
const DOBOT_POSE: &str = "aa aa 02 0a 00 f6";
const DOBOT_INDEX: &str = "aa aa 02 f6 00 0a";

fn dobot() -> Emulator {
    let mut dobot = bare(&shipped("dobot_magician"), &EmulatorOptions::default());
    assert_eq!(ask(&mut dobot, "aa aa 02 f0 01 0f", 0), ["aa aa 02 f0 01 0f"]);
    assert_eq!(
        ask(&mut dobot, "aa aa 06 1f 03 00 00 00 00 de", 50),
        ["aa aa 0a 1f 03 01 00 00 00 00 00 00 00 dd"]
    );
    assert!(ask(&mut dobot, DOBOT_INDEX, 100)[0].starts_with("aa aa 0a f6 00 00 00"));
    dobot
}

#[test]
fn a_dobot_answers_with_an_index_and_arrives_later() {
    let mut dobot = dobot();
    assert!(ask(&mut dobot, DOBOT_INDEX, 30_000)[0].starts_with("aa aa 0a f6 00 01 00"));
    assert!(ask(&mut dobot, DOBOT_MOVE, 30_100)[0].starts_with("aa aa 0a 54 03 02 00"));
    assert!(ask(&mut dobot, DOBOT_INDEX, 30_200)[0].starts_with("aa aa 0a f6 00 01 00"));
    assert!(ask(&mut dobot, DOBOT_INDEX, 33_000)[0].starts_with("aa aa 0a f6 00 02 00"));
    let pose = ask(&mut dobot, DOBOT_POSE, 33_100);
    assert_eq!((f32_at(&pose[0], 5), f32_at(&pose[0], 13)), (200.0, 49.5));
}

#[test]
fn a_dobot_does_not_move_before_its_queue_is_started_nor_answer_a_wrong_sum() {
    let mut dobot = bare(&shipped("dobot_magician"), &EmulatorOptions::default());
    ask(&mut dobot, DOBOT_MOVE, 0);
    assert!(ask(&mut dobot, DOBOT_INDEX, 60_000)[0].starts_with("aa aa 0a f6 00 00 00"));
    assert!(ask(&mut dobot, "aa aa 02 0a 00 f5", 60_100).is_empty());
    // Noise before a frame does not hide it.
    assert_eq!(ask(&mut dobot, "55 aa 03 aa aa 02 0a 00 f6", 60_200).len(), 1);
}

#[test]
fn a_dobot_out_of_reach_raises_an_alarm_and_advances_its_index() {
    let mut dobot = dobot();
    // x = 400 mm.
    let far = "aa aa 13 54 03 02 00 00 c8 43 00 00 00 00 00 00 46 42 00 00 00 00";
    let sum = parse_hex(&far[9..]).unwrap().iter().fold(0u8, |s, b| s.wrapping_add(*b)).wrapping_neg();
    ask(&mut dobot, &format!("{far} {sum:02x}"), 30_000);
    assert!(ask(&mut dobot, DOBOT_INDEX, 30_100)[0].starts_with("aa aa 0a f6 00 02 00"));
    let alarms = ask(&mut dobot, "aa aa 02 14 00 ec", 30_200);
    assert!(parse_hex(&alarms[0]).unwrap()[5..21].iter().any(|b| *b != 0));
    // The alarm holds the queue until it is cleared.
    ask(&mut dobot, DOBOT_MOVE, 30_300);
    assert!(ask(&mut dobot, DOBOT_INDEX, 40_000)[0].starts_with("aa aa 0a f6 00 02 00"));
    ask(&mut dobot, "aa aa 02 14 01 eb", 40_100);
    assert!(ask(&mut dobot, DOBOT_INDEX, 50_000)[0].starts_with("aa aa 0a f6 00 03 00"));
}

const APT_ABS_5_MM: &str = "53 04 06 00 d0 01 01 00 e7 a2 02 00";

#[test]
fn an_apt_move_is_answered_when_it_is_over_and_never_when_preempted() {
    let mut apt = bare(&shipped("thorlabs_apt"), &EmulatorOptions::default());
    assert!(ask(&mut apt, "43 04 01 00 50 01", 0).is_empty());
    let homed = apt.poll(at(30_000));
    assert_eq!(homed, [0x44, 0x04, 0x01, 0x00, 0x01, 0x50]);
    assert!(ask(&mut apt, APT_ABS_5_MM, 30_000).is_empty());
    let status = ask(&mut apt, "90 04 01 00 50 01", 31_000);
    assert!(i32_at(&status[0], 8) < 172_775, "{status:?}");
    assert_eq!(i32_at(&status[0], 16) & 0x10, 0x10);
    // A second move preempts the first: one completion in all, at the second target.
    ask(&mut apt, "53 04 06 00 d0 01 01 00 00 00 00 00", 31_100);
    let over = apt.poll_replies(at(60_000));
    assert_eq!(over.len(), 1);
    let completed = crate::protocol::value::hex(&over[0]);
    assert!(completed.starts_with("64 04 0e 00 81 50 01 00 00 00 00 00"), "{completed}");
}

#[test]
fn apt_updates_cease_when_nobody_acknowledges_them() {
    let mut apt = bare(&shipped("thorlabs_apt"), &EmulatorOptions::default());
    ask(&mut apt, "11 00 00 00 50 01", 0);
    assert_eq!(apt.poll_replies(at(5_000)).len(), 9);
    ask(&mut apt, "11 00 00 00 50 01", 5_000);
    let mut updates = 0;
    for k in 0..20 {
        updates += ask(&mut apt, "92 04 00 00 50 01", 5_500 + 500 * k).len();
    }
    updates += apt.poll_replies(at(15_400)).len();
    assert!(updates >= 90, "{updates}");
}

#[test]
fn an_apt_controller_tells_what_it_is() {
    let mut apt = bare(&shipped("thorlabs_apt"), &EmulatorOptions::default());
    let info = ask(&mut apt, "05 00 00 00 50 01", 0);
    let bytes = parse_hex(&info[0]).unwrap();
    assert_eq!((bytes.len(), &bytes[10..16]), (90, &b"KDC101"[..]));
}

#[test]
fn dynamixel_frames_of_the_vendors_client_are_answered() {
    let options = EmulatorOptions { power_on: [("1".to_owned(), 90.0)].into(), ..EmulatorOptions::default() };
    let mut bus = bare(&shipped("dynamixel2"), &options);
    // The answer of the e-Manual's example has the same form: model, firmware.
    let pong = ask(&mut bus, "ff ff fd 00 01 03 00 01 19 4e", 0);
    assert!(pong[0].starts_with("ff ff fd 00 01 07 00 55 00 b0 04 2e"), "{pong:?}");
    // Torque off: the goal is stored and nothing moves.
    let goal = "ff ff fd 00 01 09 00 03 74 00 00 08 00 00 42 89";
    let position = "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15";
    let moving = "ff ff fd 00 01 07 00 02 7a 00 01 00 36 93";
    ask(&mut bus, goal, 100);
    assert_eq!(i32_at(&ask(&mut bus, position, 2_000)[0], 9), 1024);
    ask(&mut bus, "ff ff fd 00 01 06 00 03 40 00 01 db 66", 2_100);
    assert!(ask(&mut bus, goal, 2_200)[0].starts_with("ff ff fd 00 01 04 00 55 00"));
    assert_eq!(parse_hex(&ask(&mut bus, moving, 2_300)[0]).unwrap()[9], 1);
    assert_eq!(i32_at(&ask(&mut bus, position, 5_000)[0], 9), 2048);
    assert_eq!(parse_hex(&ask(&mut bus, moving, 5_100)[0]).unwrap()[9], 0);
    // A wrong CRC is not answered.
    assert!(ask(&mut bus, "ff ff fd 00 01 03 00 01 19 4f", 6_000).is_empty());
}

#[test]
fn feetech_frames_of_the_vendors_client_are_answered() {
    let mut bus = bare(&shipped("feetech_sts"), &EmulatorOptions::default());
    assert_eq!(ask(&mut bus, "ff ff 01 02 01 fb", 0), ["ff ff 01 02 00 fc"]);
    ask(&mut bus, "ff ff 01 04 03 28 01 ce", 100);
    ask(&mut bus, "ff ff 01 05 03 2a 00 08 c4", 200);
    assert_eq!(ask(&mut bus, "ff ff 01 04 02 42 01 b5", 250), ["ff ff 01 03 00 01 fa"]);
    assert_eq!(ask(&mut bus, "ff ff 01 04 02 38 02 be", 5_000), ["ff ff 01 04 00 00 08 f2"]);
    // The other servo has not moved; nobody has the id 3.
    assert_ne!(ask(&mut bus, "ff ff 02 04 02 38 02 bd", 5_100), ["ff ff 02 04 00 00 08 f1"]);
    assert!(ask(&mut bus, "ff ff 03 02 01 f9", 5_200).is_empty());
}
