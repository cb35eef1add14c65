//! Pitfalls of real benches that the firmware makes: each must happen here, so that clients can be
//! tested against it. Numbers are those of the list that the project keeps.

use super::replay::{bare, shipped};
use super::*;
use crate::motion::AxisKind;

const T0: Timestamp = Timestamp(1_000_000_000);

fn at(ms: u64) -> Timestamp {
    T0.after(Duration::from_millis(ms))
}

/// Sends at one instant and returns everything that has come some time later.
fn say(emulator: &mut Emulator, bytes: &[u8], at_ms: u64, wait_ms: u64) -> String {
    let before = emulator.poll(at(at_ms));
    assert!(before.is_empty() || !bytes.is_empty(), "unread: {}", String::from_utf8_lossy(&before));
    emulator.receive(bytes, at(at_ms));
    String::from_utf8(emulator.poll(at(at_ms + wait_ms))).unwrap()
}

fn rig_axis(wire: &str, min: f64, max: f64) -> AxisSettings {
    AxisSettings {
        wire: wire.into(),
        kind: AxisKind::Linear,
        min,
        max,
        max_feed: 10.0,
        accel: 100.0,
        counts_per_unit: None,
        tolerance: 0.01,
        approach: None,
    }
}

/// A GRBL set up for a rig with one X axis: homing and soft limits are on.
fn stage(world: &World) -> Emulator {
    let axes = BTreeMap::from([("slide".to_owned(), rig_axis("X", -40.0, 0.0))]);
    let options = EmulatorOptions::default();
    let mut grbl = Emulator::new(&shipped("grbl"), "stage", &axes, &options, world.clone(), T0).unwrap();
    let boot = grbl.poll(at(100));
    assert!(boot.ends_with(b"[MSG:'$H'|'$X' to unlock]\r\n"));
    grbl
}

fn homed(world: &World) -> Emulator {
    let mut grbl = stage(world);
    assert_eq!(say(&mut grbl, b"$H\n", 100, 30_000), "ok\r\n");
    grbl
}

fn marlin() -> Emulator {
    let mut marlin = bare(&shipped("marlin"), &EmulatorOptions::default());
    marlin.poll(T0);
    marlin
}

#[test]
fn pitfall_1_a_stale_ok_comes_after_reset_and_before_the_banner() {
    let mut grbl = homed(&World::without_pad());
    say(&mut grbl, b"G1 X-20 F300\n", 31_000, 10);
    assert_eq!(say(&mut grbl, b"G4 P5\n", 31_100, 100), "");
    assert_eq!(say(&mut grbl, b"\x18", 31_300, 100), "ALARM:3\r\n");
    let rest = String::from_utf8(grbl.poll(at(33_000))).unwrap();
    assert_eq!(rest, "ok\r\n\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n");
}

#[test]
fn pitfall_2_a_reset_within_half_a_second_of_an_alarm_is_swallowed() {
    let mut grbl = homed(&World::without_pad());
    grbl.trip_limit(at(40_000));
    assert_eq!(grbl.poll(at(40_100)), b"ALARM:1\r\n");
    assert_eq!(say(&mut grbl, b"\x18", 40_160, 300), "");
    assert_eq!(grbl.poll(at(41_000)), b"[MSG:Reset to continue]\r\n");
    assert_eq!(say(&mut grbl, b"?", 50_000, 30_000), "");
    assert!(say(&mut grbl, b"\x18", 81_000, 100).contains("Grbl 1.1h"));
}

#[test]
fn pitfall_3_nothing_is_answered_while_homing_nor_after_a_critical_alarm() {
    let world = World::without_pad();
    let mut grbl = stage(&world);
    assert_eq!(say(&mut grbl, b"$H\n?", 200, 2_000), "");
    let all = String::from_utf8(grbl.poll(at(40_000))).unwrap();
    assert!(all.starts_with("<Home|") && all.ends_with(">\r\nok\r\n"), "{all}");
    let status = say(&mut grbl, b"?", 40_000, 10);
    assert!(status.starts_with("<Idle|MPos:-1.000,-1.000,-1.000|"), "{status}");
    assert!((world.position("stage", "slide", at(40_000)) + 1.0).abs() < 1e-6);

    assert_eq!(say(&mut grbl, b"G0 X5\n", 41_000, 400), "ALARM:2\r\n");
    assert_eq!(grbl.poll(at(42_000)), b"[MSG:Reset to continue]\r\n");
    assert_eq!(say(&mut grbl, b"?\nG0 X-5\n$$\n", 42_000, 60_000), "");
}

#[test]
fn pitfall_4_grblhal_repeats_an_error_until_an_empty_line() {
    let mut hal = bare(&shipped("grblhal"), &EmulatorOptions::default());
    hal.poll(T0);
    assert_eq!(say(&mut hal, b"FOO\n", 10, 10), "error:2\r\n");
    assert_eq!(say(&mut hal, b"G1 X-1 F100\n", 30, 10), "error:2\r\n");
    assert_eq!(say(&mut hal, b"\n", 50, 10), "ok\r\n");
    assert_eq!(say(&mut hal, b"G1 X-1 F100\n", 70, 10), "ok\r\n");
}

#[test]
fn pitfall_5_marlin_says_ok_to_a_refused_line_and_nothing_to_an_unnumbered_checksum() {
    let mut marlin = marlin();
    let refused = say(&mut marlin, b"N1 M114*0\n", 10, 50);
    assert_eq!(refused, "Error:checksum mismatch, Last Line: 0\nResend: 1\nok\n");
    assert_eq!(
        say(&mut marlin, b"M114*44\n", 100, 5_000),
        "Error:No Line Number with checksum, Last Line: 0\n"
    );
    assert_eq!(
        say(&mut marlin, b"N1 M114\n", 6_000, 50),
        "Error:No Checksum with line number, Last Line: 0\nResend: 1\nok\n"
    );
}

#[test]
fn pitfall_7_a_refused_line_takes_the_lines_behind_it_along() {
    let mut marlin = marlin();
    // Three lines arrive at once, the first is damaged: the others are flushed, not executed.
    let all = say(&mut marlin, b"N1 G1 X9*99\n", 10, 50);
    assert!(all.contains("Resend: 1"));
    let all = say(&mut marlin, b"N3 M114*36\nN4 M114*35\n", 100, 50);
    assert_eq!(all.matches("Resend: 1").count(), 2, "{all}");
}

#[test]
fn pitfall_8_and_16_a_reset_by_the_line_loses_the_position_and_prints_the_banner() {
    let world = World::without_pad();
    let mut grbl = homed(&world);
    say(&mut grbl, b"G1 X-20 F300\n", 31_000, 1_000);
    grbl.restart(at(32_000));
    assert!(String::from_utf8(grbl.poll(at(32_100))).unwrap().contains("to unlock"));
    let status = say(&mut grbl, b"?", 32_200, 10);
    assert!(status.starts_with("<Alarm|MPos:0.000,0.000,0.000|"), "{status}");
    assert!(world.position("stage", "slide", at(33_000)) < -5.0);

    let mut marlin = marlin();
    say(&mut marlin, b"G1 X9 F600\n", 10, 100);
    marlin.restart(at(200));
    assert!(marlin.poll(at(500)).starts_with(b"start\n"));
    assert!(say(&mut marlin, b"M114\n", 500, 50).starts_with("X:0.00 "));
}

#[test]
fn pitfall_9_and_12_a_reset_in_motion_leaves_a_counter_that_lies() {
    let world = World::without_pad();
    let mut grbl = homed(&world);
    say(&mut grbl, b"G1 X-30 F500\n", 31_000, 1_500);
    say(&mut grbl, b"\x18", 32_500, 2_000);
    assert_eq!(say(&mut grbl, b"$X\n", 34_500, 50), "[MSG:Caution: Unlocked]\r\nok\r\n");
    let counted = grbl.counted("X", at(34_600)).unwrap();
    let truth = world.position("stage", "slide", at(34_600));
    assert!((counted - truth).abs() > 0.01, "{counted} {truth}");
}

#[test]
fn a_reset_from_a_completed_hold_keeps_the_position_and_raises_no_alarm() {
    let world = World::without_pad();
    let mut grbl = homed(&world);
    say(&mut grbl, b"G1 X-30 F500\n", 31_000, 500);
    say(&mut grbl, b"!", 31_500, 2_000);
    assert!(say(&mut grbl, b"?", 33_500, 10).starts_with("<Hold:0|"));
    assert_eq!(say(&mut grbl, b"\x18", 33_600, 100), "\r\nGrbl 1.1h ['$' for help]\r\n");
    let counted = grbl.counted("X", at(34_000)).unwrap();
    assert!((counted - world.position("stage", "slide", at(34_000))).abs() < 1e-9);
}

#[test]
fn pitfall_10_m114_tells_the_target_and_count_tells_the_steps() {
    let mut marlin = marlin();
    assert_eq!(say(&mut marlin, b"G1 X100 F600\n", 10, 50), "ok\n");
    let position = say(&mut marlin, b"M114\n", 100, 50);
    assert!(position.starts_with("X:100.00 "), "{position}");
    let count: i64 = position.split("Count X:").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(count < 100 * 80 / 10, "{position}");
}

#[test]
fn pitfall_11_soft_endstops_clamp_without_a_word() {
    let mut marlin = marlin();
    assert_eq!(say(&mut marlin, b"G1 X-20 F6000\n", 10, 50), "ok\n");
    assert_eq!(say(&mut marlin, b"M400\n", 100, 50), "ok\n");
    assert!(say(&mut marlin, b"M114\n", 200, 50).starts_with("X:0.00 "));
}

#[test]
fn pitfall_14_a_move_to_where_it_is_never_leaves_idle() {
    let mut grbl = homed(&World::without_pad());
    assert_eq!(say(&mut grbl, b"$J=G90 G21 G53 X-1.0001 F300\n", 31_000, 20), "ok\r\n");
    assert!(say(&mut grbl, b"?", 31_020, 10).starts_with("<Idle|"));
}

#[test]
fn pitfall_17_work_and_machine_positions_differ_and_the_offset_comes_rarely() {
    let mut grbl = homed(&World::without_pad());
    say(&mut grbl, b"G92 X0\n$10=0\n", 31_000, 50);
    let first = say(&mut grbl, b"?", 31_100, 10);
    assert!(first.contains("|WPos:0.000,") && first.contains("|WCO:-1.000,"), "{first}");
    assert!(!say(&mut grbl, b"?", 31_200, 10).contains("WCO"));
}

#[test]
fn pitfall_20_an_exponent_is_refused() {
    let mut grbl = homed(&World::without_pad());
    assert_eq!(say(&mut grbl, b"G1 X-1e-05 F100\n", 31_000, 20), "error:20\r\n");
}

#[test]
fn pitfall_27_real_time_bytes_act_while_a_line_blocks() {
    let mut grbl = homed(&World::without_pad());
    say(&mut grbl, b"G1 X-30 F500\n", 31_000, 50);
    assert_eq!(say(&mut grbl, b"G4 P0.01\n", 31_100, 100), "");
    assert!(say(&mut grbl, b"?", 31_300, 10).starts_with("<Run|"));
    assert_eq!(say(&mut grbl, b"!", 31_400, 2_000), "");
    assert!(say(&mut grbl, b"?", 33_400, 10).starts_with("<Hold:0|"));

    // Without an emergency parser Marlin's quick stop waits its turn behind the barrier.
    let mut marlin = marlin();
    assert_eq!(say(&mut marlin, b"G1 X100 F600\nM400\nM410\n", 10, 1_000), "ok\n");
}

#[test]
fn a_locked_controller_refuses_motion_until_homed_or_unlocked() {
    let mut grbl = stage(&World::without_pad());
    assert_eq!(say(&mut grbl, b"G0 X-5\n", 200, 20), "error:9\r\n");
    assert_eq!(say(&mut grbl, b"$J=G91 X-5 F300\n", 300, 20), "error:8\r\n");
}

#[test]
fn a_jog_beyond_travel_is_refused_without_an_alarm() {
    let mut grbl = homed(&World::without_pad());
    assert_eq!(say(&mut grbl, b"$J=G90 G53 X1 F300\n", 31_000, 20), "error:15\r\n");
    assert!(say(&mut grbl, b"?", 31_100, 20).starts_with("<Idle|"));
}

#[test]
fn a_full_planner_holds_back_its_ok_and_counts_every_line() {
    let mut grbl = homed(&World::without_pad());
    let mut oks = 0;
    for i in 0..20u64 {
        let x = if i % 2 == 0 { -2 } else { -1 };
        oks += say(&mut grbl, format!("G1X{x}F60\n").as_bytes(), 31_000 + 50 * i, 40).matches("ok").count();
    }
    assert!((15..20).contains(&oks), "{oks}");
    let rest = String::from_utf8(grbl.poll(at(90_000))).unwrap();
    assert_eq!(oks + rest.matches("ok").count(), 20);
}

#[test]
fn marlin_says_that_it_is_busy_while_homing_and_loses_its_voice_when_killed() {
    let mut marlin = marlin();
    let all = say(&mut marlin, b"G28\n", 10, 60_000);
    assert!(all.matches("echo:busy: processing\n").count() >= 2, "{all}");
    assert!(all.ends_with("ok\n"));
    assert_eq!(say(&mut marlin, b"M112\nM114\n", 70_000, 60_000), "");
}

#[test]
fn the_wrong_firmware_can_be_put_on_a_port() {
    let identity = Some(vec!["Smoothie 1.0".to_owned(), "[VER:none]".to_owned()]);
    let options = EmulatorOptions { identity, ..EmulatorOptions::default() };
    let mut grbl = bare(&shipped("grbl"), &options);
    assert_eq!(grbl.poll(T0), b"\r\nSmoothie 1.0\r\n");
    assert_eq!(say(&mut grbl, b"$I\n", 10, 20), "[VER:none]\r\nok\r\n");
}

#[test]
fn an_axis_that_the_firmware_has_not_is_refused_by_name() {
    let axes = BTreeMap::from([("spin".to_owned(), rig_axis("A", 0.0, 90.0))]);
    let options = EmulatorOptions::default();
    let made = Emulator::new(&shipped("grbl"), "stage", &axes, &options, World::without_pad(), T0);
    let error = made.err().expect("GRBL has no A").to_string();
    assert!(error.contains("spin") && error.contains("X, Y, Z"), "{error}");
    assert!(Emulator::new(&shipped("grblhal"), "stage", &axes, &options, World::without_pad(), T0).is_ok());
}

#[test]
fn a_device_made_of_rules_homes_moves_refuses_and_stops() {
    let mut smc = bare(&shipped("newport_smc100"), &EmulatorOptions::default());
    assert_eq!(say(&mut smc, b"1TS\r\n", 10, 20), "1TS00000A\r\n");
    assert_eq!(say(&mut smc, b"1PA5\r\n1TE\r\n", 100, 20), "1TEH\r\n");
    assert_eq!(say(&mut smc, b"1OR\r\n1TS\r\n", 200, 20), "1TS00001E\r\n");
    assert_eq!(say(&mut smc, b"1TS\r\n1TP\r\n", 20_000, 20), "1TS000033\r\n1TP0.00000\r\n");
    assert_eq!(say(&mut smc, b"1PA5.5\r\n1TE\r\n1TS\r\n", 21_000, 20), "1TE@\r\n1TS000028\r\n");
    assert_eq!(say(&mut smc, b"1TP\r\n", 30_000, 20), "1TP5.50000\r\n");
    assert_eq!(say(&mut smc, b"1PA26\r\n1TE\r\n1TE\r\n", 31_000, 20), "1TEC\r\n1TE@\r\n");
    say(&mut smc, b"1PA25\r\n", 32_000, 500);
    assert_eq!(say(&mut smc, b"1ST\r\n", 32_600, 1000), "");
    assert_eq!(say(&mut smc, b"1TS\r\n", 34_000, 20), "1TS000033\r\n");
    assert!((5.5..25.0).contains(&smc.counted("1", at(35_000)).unwrap()));
}
