//! The engine against scripted peers; the pitfalls of real controllers by name.

use super::*;
use crate::protocol::conformance::tests::shipped;

/// An engine, a clock, and what came out.
struct Bench {
    engine: Engine,
    now: Timestamp,
    events: Vec<Event>,
}

impl Bench {
    fn new(protocol: &str, wires: &[(&str, &str)]) -> Bench {
        let axes = wires.iter().map(|(name, wire)| AxisWire {
            name: (*name).to_owned(),
            wire: (*wire).to_owned(),
            counts_per_unit: Some(100.0),
            accel: Some(50.0),
        });
        let engine = Engine::new(shipped(protocol), axes.collect(), 1.0).unwrap();
        Bench { engine, now: Timestamp(1_000_000_000), events: Vec::new() }
    }

    fn grbl() -> Bench {
        let mut bench = Bench::new("grbl", &[("slide", "X"), ("spin", "Y")]);
        bench.engine.set_live();
        bench
    }

    fn marlin() -> Bench {
        let mut bench = Bench::new("marlin", &[("x", "X"), ("z", "Z")]);
        bench.engine.set_live();
        bench.engine.stream("position", Fields::new());
        assert_eq!(bench.out(), "N0 M110 N0*125\n");
        bench.say("ok\n");
        assert_eq!(bench.out(), "N1 M114*38\n");
        bench.say("X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok\n");
        bench
    }

    /// What goes out now, urgent bytes first, bytes above ASCII as `\xNN`.
    fn out(&mut self) -> String {
        let output = self.engine.poll(self.now);
        self.events.extend(output.events);
        let bytes: Vec<u8> = output.urgent.into_iter().chain(output.bytes).collect();
        bytes
            .iter()
            .map(|b| if b.is_ascii() { (*b as char).to_string() } else { format!("\\x{b:02x}") })
            .collect()
    }

    fn say(&mut self, text: &str) {
        self.engine.receive(text.as_bytes(), self.now);
    }

    fn pass_ms(&mut self, ms: u64) {
        self.now = self.now.after(Duration::from_millis(ms));
    }

    /// Time passes step by step, nothing is received; everything that goes out.
    fn out_during_ms(&mut self, ms: u64) -> String {
        let mut all = String::new();
        for _ in 0..ms / 10 {
            self.pass_ms(10);
            all += &self.out();
        }
        all
    }

    fn finished(&mut self, ticket: Ticket) -> Option<Outcome> {
        let extra = self.out();
        assert_eq!(extra, "", "nothing more is sent");
        self.events.iter().find_map(|e| match e {
            Event::Finished(t, outcome) if *t == ticket => Some(outcome.clone()),
            _ => None,
        })
    }

    fn trust_lost(&self) -> bool {
        self.events.iter().any(|e| matches!(e, Event::TrustLost(_)))
    }

    fn noted(&self, part: &str) -> bool {
        self.events.iter().any(|e| matches!(e, Event::Note(n) if n.contains(part)))
    }
}

fn go(targets: &[(usize, f64)], feed: f64) -> Request {
    Request::Move { targets: targets.to_vec(), feed, jog: false }
}

const SETTLE: Request = Request::Settle { stall: Duration::from_secs(3), expected: None };

#[test]
fn a_grbl_move_is_a_jog_and_ends_when_idle_is_confirmed_twice() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(go(&[(0, 1.5), (1, 0.25)], 5.0));
    assert_eq!(b.out(), "$J=G90 G21 G53 X1.5 Y0.25 F300\n");
    b.say("ok\r\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    let t = b.engine.submit(SETTLE);
    assert_eq!(b.out(), "?");
    b.say("<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
    assert_eq!(b.out_during_ms(100), "?");
    // The first answer came before the planner started: idle once is not enough.
    b.say("<Jog|MPos:0.700,0.000,0.000|FS:300,0>\r\n");
    assert_eq!(b.out_during_ms(100), "?");
    b.say("<Idle|MPos:1.500,0.250,0.000|FS:0,0>\r\n");
    assert_eq!(b.out_during_ms(100), "?");
    b.say("<Idle|MPos:1.500,0.250,0.000|FS:0,0>\r\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    let positions = b.engine.positions();
    assert_eq!(positions[0].unwrap().value, 1.5);
    assert_eq!(positions[1].unwrap().value, 0.25);
}

#[test]
fn pitfall_01_an_ok_between_reset_and_banner_is_stale() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(Request::Command { name: "unlock".into(), fields: Fields::new(), axis: None });
    assert_eq!(b.out(), "$X\n");
    b.engine.realtime("reset", b.now).unwrap();
    let next =
        b.engine.submit(Request::Command { name: "identify".into(), fields: Fields::new(), axis: None });
    assert_eq!(b.out(), "\x18", "nothing follows the reset before the banner");
    b.say("ok\r\n");
    assert!(matches!(b.finished(t), Some(Err(Failure::Stopped))));
    assert!(b.finished(next).is_none(), "the stale ok must not end the next command");
    assert!(b.noted("ignored until the banner"));
    b.say("\r\nGrbl 1.1h ['$' for help]\r\n");
    assert_eq!(b.out(), "$I\n");
}

#[test]
fn pitfall_02_a_swallowed_reset_is_sent_again() {
    let mut b = Bench::grbl();
    b.say("ALARM:1\r\n");
    let t = b.engine.submit(Request::Run(Which::Recover("limit".into())));
    let sent = b.out_during_ms(3500);
    assert_eq!(sent, "\x18\x18", "sent after 900 ms, and again after 2 s without a banner");
    b.say("\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n");
    assert_eq!(b.out(), "$X\n");
    b.say("[MSG:Caution: Unlocked]\r\nok\r\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    assert!(b.trust_lost());
}

#[test]
fn pitfall_03_a_device_silent_by_design_is_not_asked_and_not_given_up() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(Request::Run(Which::Home));
    assert_eq!(b.out(), "$H\n");
    let settle = b.engine.submit(SETTLE);
    assert!(b.engine.is_silent());
    assert_eq!(b.out_during_ms(44_000), "", "no question while homing");
    b.say("ok\r\n");
    assert_eq!(b.out(), "?");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    assert!(b.finished(settle).is_none());
    // Mute after ALARM:2 until the reset: nothing is sent at all.
    let mut b = Bench::grbl();
    b.say("ALARM:2\r\n");
    b.engine.stream("raw", [("text".to_owned(), Value::from("G1 X1 F100"))].into());
    assert_eq!(b.out_during_ms(2000), "");
}

#[test]
fn pitfall_04_the_sticky_error_of_grblhal_is_cleared_at_once() {
    let mut b = Bench::new("grblhal", &[("slide", "X")]);
    let t = b.engine.submit(Request::Command {
        name: "raw".into(),
        fields: [("text".to_owned(), Value::from("X"))].into(),
        axis: None,
    });
    assert_eq!(b.out(), "X\n");
    b.say("error:2\r\n");
    assert_eq!(b.out(), "\n", "the empty line");
    b.say("ok\r\n");
    match b.finished(t) {
        Some(Err(Failure::Refused { code, .. })) => assert_eq!(code, "2"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn pitfall_05_an_ok_on_an_error_line_does_not_accept_it() {
    let mut b = Bench::marlin();
    let t = b.engine.stream("raw", [("text".to_owned(), Value::from("foo"))].into());
    assert_eq!(b.out(), "N2 foo*58\n");
    let next = b.engine.stream("raw", [("text".to_owned(), Value::from("M105"))].into());
    // The line is refused, but not done with: its ok is still to come, and is nobody else's.
    b.say("echo:Unknown command: \"foo\"\n");
    assert_eq!(b.out(), "", "nothing is sent into the refusal");
    assert!(b.finished(t).is_none());
    b.say("ok\n");
    assert!(b.out().starts_with("N3 M105*"));
    assert!(matches!(b.finished(t), Some(Err(Failure::Refused { .. }))));
    assert!(b.finished(next).is_none(), "the ok of the refused line has not accepted this one");
    b.say("ok\n");
    assert!(matches!(b.finished(next), Some(Ok(_))));
}

#[test]
fn pitfall_06_a_lost_ok_sends_the_same_line_again_and_never_moves_twice() {
    let mut b = Bench::marlin();
    let t = b.engine.submit(go(&[(0, 5.0)], 10.0));
    let line = b.out();
    assert!(line.starts_with("N2 G1 X5 F600*"), "{line}");
    assert_eq!(b.out_during_ms(2000), line, "the same number, so that it cannot be executed twice");
    // The device had it: it asks for the next one.
    b.say("Error:Line Number is not Last Line Number+1, Last Line: 2\nResend: 3\nok\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    assert!(b.noted("has line 2 already"));
}

#[test]
fn pitfall_06_a_lost_ok_of_a_grbl_move_is_an_unknown_outcome() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(go(&[(0, 5.0)], 10.0));
    assert_eq!(b.out(), "$J=G90 G21 G53 X5 F600\n");
    assert_eq!(b.out_during_ms(2500), "", "a move is never sent again by itself");
    assert!(matches!(b.finished(t), Some(Err(Failure::NoReply { .. }))));
    // The next command is preceded by one with data of its own, so that a late ok cannot be its ok.
    let next =
        b.engine.submit(Request::Command { name: "barrier".into(), fields: Fields::new(), axis: None });
    assert_eq!(b.out(), "$G\n");
    b.say("ok\r\n");
    assert_eq!(b.out(), "", "the late ok is not taken for the answer");
    b.say("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n");
    assert_eq!(b.out(), "G4 P0.01\n");
    b.say("ok\r\n");
    assert!(matches!(b.finished(next), Some(Ok(_))));
}

#[test]
fn pitfall_07_a_request_to_resend_may_come_without_its_ok_and_name_an_old_line() {
    let mut b = Bench::marlin();
    b.engine.stream("absolute", Fields::new());
    let first = b.out();
    b.say("ok\n");
    let t = b.engine.stream("units", Fields::new());
    let second = b.out();
    b.say("Error:checksum mismatch, Last Line: 1\nResend: 2\n");
    assert_eq!(b.out(), "");
    assert_eq!(b.out_during_ms(310), format!("{first}{second}"), "from the line it names on");
    b.say("ok\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
}

#[test]
fn a_line_that_is_garbled_each_time_is_given_up() {
    let mut b = Bench::marlin();
    let t = b.engine.stream("units", Fields::new());
    let mut sent = 0;
    for _ in 0..10 {
        sent += b.out().matches("G21").count();
        b.say("Error:checksum mismatch, Last Line: 1\nResend: 2\nok\n");
    }
    assert!(sent <= 5, "{sent}");
    assert!(matches!(b.finished(t), Some(Err(Failure::ResendLoop { line: 2 }))));
}

#[test]
fn pitfall_09_alarm_3_loses_the_position_and_ends_what_waits() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(SETTLE);
    assert_eq!(b.out(), "?");
    b.say("ALARM:3\r\n");
    assert!(matches!(b.finished(t), Some(Err(Failure::Alarm { trust: Trust::Lost, .. }))));
    assert!(b.trust_lost());
}

#[test]
fn pitfall_16_a_banner_in_mid_run_is_a_restart() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(go(&[(0, 5.0)], 10.0));
    b.out();
    b.say("\r\nGrbl 1.1h ['$' for help]\r\n");
    assert!(matches!(b.finished(t), Some(Err(Failure::Restarted))));
    assert!(b.trust_lost());
    let mut b = Bench::marlin();
    b.say("start\necho: Watchdog Reset\nMarlin 1.1.6.1\n");
    b.engine.stream("units", Fields::new());
    assert_eq!(b.out(), "N0 M110 N0*125\n", "its line counter is zero again");
    assert!(b.trust_lost());
}

#[test]
fn pitfall_17_work_positions_need_the_cached_offset() {
    let mut b = Bench::grbl();
    b.say("<Idle|WPos:19.660,0.000,0.000|FS:0,0>\r\n");
    assert_eq!(b.engine.positions()[0], None, "without an offset a work position tells nothing");
    b.say("<Idle|WPos:1.000,0.000,0.000|FS:0,0|WCO:5.000,0.000,0.000>\r\n");
    b.say("<Idle|WPos:2.000,0.000,0.000|FS:0,0>\r\n");
    assert_eq!(b.engine.positions()[0].unwrap().value, 7.0);
    b.say("<Idle|MPos:3.000,0.000,0.000|FS:0,0>\r\n");
    assert_eq!(b.engine.positions()[0].unwrap().value, 3.0);
}

#[test]
fn pitfall_18_boot_noise_is_not_text() {
    let mut b = Bench::new("grbl", &[("slide", "X")]);
    b.engine.receive(b"\xff\xfe\x80garbage\x00\xf0Grbl 1.1h ['$' for help]\r\n", b.now);
    b.out();
    assert_eq!(b.engine.banner(), Some("Grbl 1.1h ['$' for help]"));
    // Nor is a whole line of it.
    b.engine.receive(b"\x00\xff\xc3(\r\n", b.now);
    b.out();
    assert!(b.noted("unknown reply") && b.engine.strange().is_some());
}

#[test]
fn pitfall_19_split_and_merged_reads_are_the_same_dialogue() {
    let text = "<Idle|MPos:1.500,0.250,0.000|FS:0,0>\r\nok\r\n[MSG:Caution: Unlocked]\r\n";
    for cut in 1..text.len() {
        let mut b = Bench::grbl();
        let t =
            b.engine.submit(Request::Command { name: "unlock".into(), fields: Fields::new(), axis: None });
        assert_eq!(b.out(), "$X\n");
        b.say(&text[..cut]);
        b.out();
        b.say(&text[cut..]);
        assert!(matches!(b.finished(t), Some(Ok(_))), "cut at {cut}");
        assert_eq!(b.engine.positions()[0].unwrap().value, 1.5);
    }
}

#[test]
fn pitfall_20_numbers_have_decimals_and_no_exponent() {
    let mut b = Bench::grbl();
    b.engine.submit(go(&[(0, 1e-5), (1, -0.00004)], 0.001));
    assert_eq!(b.out(), "$J=G90 G21 G53 X0 Y0 F0.06\n");
}

#[test]
fn pitfall_27_a_stop_goes_before_everything_that_waits() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(go(&[(0, 5.0)], 10.0));
    let waiting = b.engine.submit(go(&[(0, 6.0)], 10.0));
    let stop = b.engine.urgent(StopKind::Controlled, false, b.now);
    assert_eq!(b.out(), "\\x85!?", "jog cancel and hold, then the question; no move");
    assert!(matches!(b.finished(t), Some(Err(Failure::Stopped))));
    assert!(matches!(b.finished(waiting), Some(Err(Failure::Stopped))));
    b.say("<Hold:1|MPos:1.000,0.000,0.000|FS:100,0>\r\n");
    assert_eq!(b.out_during_ms(100), "?");
    b.say("<Hold:0|MPos:1.100,0.000,0.000|FS:0,0>\r\n");
    assert_eq!(b.out(), "\x18");
    b.say("\r\nGrbl 1.1h ['$' for help]\r\n");
    assert!(matches!(b.finished(stop), Some(Ok(_))));
    assert!(!b.trust_lost(), "a reset from Hold:0 keeps the position");
}

#[test]
fn an_emergency_stop_of_marlin_is_unnumbered_and_loses_trust() {
    let mut b = Bench::marlin();
    b.engine.submit(go(&[(0, 5.0)], 10.0));
    b.engine.urgent(StopKind::Emergency, false, b.now);
    assert_eq!(b.out(), "M112\n");
    assert!(b.trust_lost());
    assert_eq!(b.engine.stop_bytes(StopKind::Controlled), b"M410\n");
}

#[test]
fn busy_lines_extend_the_barrier_and_silence_ends_it() {
    let mut b = Bench::marlin();
    let t = b.engine.submit(SETTLE);
    let line = b.out();
    assert!(line.starts_with("N2 M400*"), "{line}");
    for _ in 0..30 {
        b.pass_ms(2000);
        b.say("echo:busy: processing\n");
        assert_eq!(b.out(), "");
    }
    b.say("ok\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    // A lost ok of the barrier: what the device has received it may not have finished, so it is asked anew.
    let t = b.engine.submit(SETTLE);
    let line = b.out();
    assert_eq!(b.out_during_ms(10_000), line);
    b.say("Error:Line Number is not Last Line Number+1, Last Line: 3\nResend: 4\nok\n");
    let anew = b.out();
    assert!(anew.starts_with("N4 M400*"), "{anew}");
    b.say("ok\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
}

#[test]
fn a_move_without_progress_has_stalled_and_a_slow_one_has_not() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(SETTLE);
    let mut x = 0.0;
    for step in 0..1000 {
        if b.out().contains('?') {
            if step < 600 {
                x += 0.001;
            }
            b.say(&format!("<Run|MPos:{x:.3},0.000,0.000|FS:1,0>\r\n"));
        }
        b.pass_ms(50);
        if step == 599 {
            assert!(b.finished_now(t).is_none(), "30 s of slow motion are no stall");
        }
    }
    assert!(matches!(b.finished_now(t), Some(Err(Failure::Stalled { .. }))));
}

impl Bench {
    fn finished_now(&self, ticket: Ticket) -> Option<Outcome> {
        self.events.iter().find_map(|e| match e {
            Event::Finished(t, outcome) if *t == ticket => Some(outcome.clone()),
            _ => None,
        })
    }
}

#[test]
fn a_mute_device_ends_a_wait_with_an_error() {
    let mut b = Bench::grbl();
    let t = b.engine.submit(SETTLE);
    b.out_during_ms(4000);
    assert!(matches!(b.finished_now(t), Some(Err(Failure::NoReply { .. }))));
    let mut b = Bench::new("marlin", &[("x", "X")]);
    let t = b.engine.submit(Request::Identify);
    b.out_during_ms(10_000);
    assert!(matches!(b.finished_now(t), Some(Err(Failure::NoReply { .. }))));
}

#[test]
fn character_counting_fills_the_buffer_and_no_more() {
    let mut b = Bench::grbl();
    let text = "G1 X1.000 Y1.000 F100";
    for _ in 0..10 {
        b.engine.stream("raw", [("text".to_owned(), Value::from(text))].into());
    }
    let sent = b.out();
    assert_eq!(sent.len(), 5 * (text.len() + 1));
    assert!(sent.len() <= 120);
    b.say("ok\r\n");
    assert_eq!(b.out().len(), text.len() + 1);
}

#[test]
fn zaber_replies_are_matched_by_id() {
    let mut b = Bench::new("zaber_ascii", &[("slide", "1/1")]);
    let t = b.engine.submit(Request::Position);
    assert_eq!(b.out(), "/1 1 00 get pos:2C\n");
    b.say("@01 1 77 OK IDLE -- 4242\r\n");
    assert!(b.finished(t).is_none(), "a reply with another id is not the answer");
    b.say("@01 1 00 OK IDLE -- 1250\r\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
    let reading = b.engine.positions()[0].unwrap();
    assert_eq!((reading.value, reading.counts), (12.5, Some(crate::units::Steps(1250))));
}

/// Found by replaying sessions with faults: a wake that had passed made the link spin until the answer came.
#[test]
fn an_unanswered_question_wakes_nobody_in_the_meantime() {
    let mut b = Bench::new("zaber_ascii", &[("slide", "1/1")]);
    b.engine.submit(Request::Settle { stall: Duration::from_secs(3), expected: None });
    b.out();
    for _ in 0..20 {
        b.pass_ms(60);
        let wake = b.engine.poll(b.now).wake;
        assert!(wake.is_some_and(|at| at > b.now), "{wake:?} at {:?}", b.now);
    }
}

#[test]
fn zaber_a_wrong_checksum_is_dropped_and_the_question_repeated() {
    let mut b = Bench::new("zaber_ascii", &[("slide", "1/1")]);
    let t = b.engine.submit(Request::Position);
    b.out();
    b.say("@01 1 00 OK IDLE -- 1250:00\r\n");
    assert_eq!(b.out_during_ms(2000), "/1 1 01 get pos:2B\n");
    b.say("@01 1 01 OK IDLE -- 1250\r\n");
    assert!(matches!(b.finished(t), Some(Ok(_))));
}

#[test]
fn zaber_a_stall_flag_fails_the_move() {
    let mut b = Bench::new("zaber_ascii", &[("slide", "1/1")]);
    b.engine.submit(go(&[(0, 5.0)], 2.0));
    assert_eq!(b.out(), "/1 1 00 set maxspeed 328:5E\n");
    b.say("@01 1 00 OK IDLE -- 0\r\n");
    assert_eq!(b.out(), "/1 1 01 move abs 500:1B\n");
    b.say("@01 1 01 OK BUSY -- 0\r\n");
    b.out();
    let t = b.engine.submit(SETTLE);
    assert_eq!(b.out(), "/1 1 02:FC\n");
    b.say("@01 1 02 OK IDLE FS 0\r\n");
    b.out();
    assert!(matches!(b.finished_now(t), Some(Err(Failure::Flag { .. }))));
    assert!(b.trust_lost());
}

/// What goes out now, in hex.
fn out_hex(b: &mut Bench) -> String {
    let output = b.engine.poll(b.now);
    b.events.extend(output.events);
    crate::protocol::value::hex(&[output.urgent, output.bytes].concat())
}

fn say_hex(b: &mut Bench, digits: &str) {
    let bytes = crate::protocol::value::parse_hex(digits).unwrap();
    b.engine.receive(&bytes, b.now);
}

#[test]
fn apt_arrival_is_asked_for_when_told_and_needs_no_message() {
    let mut b = Bench::new("thorlabs_apt", &[("spin", "80/1")]);
    b.engine.submit(go(&[(0, 1727.75)], 1.0));
    // 100 counts a unit: 1 unit/s and 50 units/s2 are 2237 and 38 in the controller's time base.
    let speed = "13 04 0e 00 d0 01 01 00 00 00 00 00 26 00 00 00 bd 08 00 00";
    assert_eq!(out_hex(&mut b), format!("{speed} 53 04 06 00 d0 01 01 00 e7 a2 02 00"));
    let t = b.engine.submit(SETTLE);
    let ask = "90 04 01 00 50 01";
    assert_eq!(out_hex(&mut b), ask);
    say_hex(&mut b, "91 04 0e 00 81 50 01 00 00 01 00 00 00 00 00 00 10 04 00 80");
    assert_eq!(out_hex(&mut b), "");
    assert_eq!(b.engine.state(), Some(MotionState::Moving));
    // The completion message makes it ask before the period is over.
    b.pass_ms(20);
    say_hex(&mut b, "64 04 0e 00 81 50 01 00 e7 a2 02 00 00 00 00 00 00 04 00 80");
    assert_eq!(out_hex(&mut b), ask);
    let idle = "91 04 0e 00 81 50 01 00 e7 a2 02 00 00 00 00 00 00 04 00 80";
    say_hex(&mut b, idle);
    b.pass_ms(100);
    assert_eq!(out_hex(&mut b), ask);
    say_hex(&mut b, idle);
    out_hex(&mut b);
    assert!(matches!(b.finished_now(t), Some(Ok(_))));
    assert!((b.engine.positions()[0].unwrap().value - 1727.75).abs() < 1e-9);
    assert_eq!(b.engine.stop_bytes(StopKind::Emergency), [0x65, 0x04, 1, 1, 0x50, 1]);
}

#[test]
fn dobot_moves_whole_poses_and_waits_for_its_queue() {
    let mut b = Bench::new("dobot_magician", &[("r", "r"), ("x", "x"), ("y", "y"), ("z", "z")]);
    let blind = b.engine.submit(go(&[(3, 49.5)], 10.0));
    out_hex(&mut b);
    assert!(
        matches!(b.finished_now(blind), Some(Err(Failure::Encode(_)))),
        "the rest of the pose is not known"
    );
    let t = b.engine.submit(Request::Position);
    assert_eq!(out_hex(&mut b), "aa aa 02 0a 00 f6");
    let mut pose = vec![10u8, 0];
    for value in [200.0f32, 0.0, 10.0, 0.0, 1.0, 2.0, 3.0, 4.0] {
        pose.extend(value.to_le_bytes());
    }
    let sum = crate::protocol::ChecksumKind::TwosComplement.of(&pose) as u8;
    let frame = [&[0xaa, 0xaa, pose.len() as u8][..], &pose, &[sum]].concat();
    b.engine.receive(&frame, b.now);
    out_hex(&mut b);
    assert!(matches!(b.finished_now(t), Some(Ok(_))));
    let t = b.engine.submit(go(&[(3, 49.5)], 10.0));
    assert_eq!(out_hex(&mut b), "aa aa 12 51 03 00 00 20 41 00 00 20 41 00 00 48 42 00 00 48 42 d6");
    say_hex(&mut b, "aa aa 0a 51 03 04 00 00 00 00 00 00 00 a8");
    assert_eq!(out_hex(&mut b), "aa aa 13 54 03 02 00 00 48 43 00 00 00 00 00 00 46 42 00 00 00 00 94");
    say_hex(&mut b, "aa aa 0a 54 03 05 00 00 00 00 00 00 00 a4");
    out_hex(&mut b);
    assert!(matches!(b.finished_now(t), Some(Ok(_))));
    let t = b.engine.submit(SETTLE);
    assert_eq!(out_hex(&mut b), "aa aa 02 f6 00 0a");
    say_hex(&mut b, "aa aa 0a f6 00 04 00 00 00 00 00 00 00 06");
    out_hex(&mut b);
    assert!(b.finished_now(t).is_none(), "the queue has not passed the move");
    b.pass_ms(50);
    assert_eq!(out_hex(&mut b), "aa aa 02 f6 00 0a");
    // More was queued since: past is as good as equal.
    say_hex(&mut b, "aa aa 0a f6 00 06 00 00 00 00 00 00 00 04");
    out_hex(&mut b);
    assert!(matches!(b.finished_now(t), Some(Ok(_))));
}

#[test]
fn a_frame_cut_short_is_given_up_after_a_pause() {
    let mut b = Bench::new("feetech_sts", &[("joint", "1")]);
    let t = b.engine.submit(Request::Position);
    assert_eq!(out_hex(&mut b), "ff ff 01 04 02 38 0b b5");
    say_hex(&mut b, "ff ff 01 0d 00 00 08");
    b.pass_ms(100);
    say_hex(&mut b, "ff ff 01 0d 00 00 08 32 00 08 00 4a 1e 00 00 01 46");
    out_hex(&mut b);
    assert!(matches!(b.finished_now(t), Some(Ok(_))));
    assert!((b.engine.positions()[0].unwrap().value - 20.48).abs() < 1e-9);
}
