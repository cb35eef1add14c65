//! Recorded dialogues of real controllers, held again by our client: its bytes must equal the
//! recorded client's, and every recorded line must be understood.

use super::*;
use crate::protocol::conformance::tests::shipped;

struct Line {
    at: Timestamp,
    sent: bool,
    bytes: Vec<u8>,
}

/// Reads a transcript: `seconds > text`, `seconds < text`; `hex:` and `raw:` before real-time bytes.
fn read(name: &str) -> Vec<Line> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/transcripts").join(name);
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = Vec::new();
    for line in text.lines() {
        let mut parts = line.trim_start().splitn(3, ' ');
        let seconds: f64 = parts.next().unwrap().parse().unwrap();
        let sign = parts.next().unwrap();
        let body = parts.next().unwrap_or("").trim_matches('\'');
        if sign == "#" {
            continue;
        }
        let body = body.replace("\\r", "\r").replace("\\n", "\n");
        let bytes = match body.strip_prefix("raw:") {
            Some(raw) => raw.as_bytes().to_vec(),
            None => crate::protocol::Bytes::parse(&body).unwrap().0,
        };
        lines.push(Line { at: Timestamp((seconds * 1e9) as i64), sent: sign == ">", bytes });
    }
    assert!(lines.len() > 40);
    lines
}

struct Player {
    engine: Engine,
    events: Vec<Event>,
}

impl Player {
    fn new(protocol: &str, wires: &[&str]) -> Player {
        let axes = wires.iter().map(|w| AxisWire {
            name: format!("axis {w}"),
            wire: (*w).to_owned(),
            counts_per_unit: Some(100.0),
            accel: Some(50.0),
        });
        Player { engine: Engine::new(shipped(protocol), axes.collect(), 1.0).unwrap(), events: Vec::new() }
    }

    fn out(&mut self, now: Timestamp) -> Vec<u8> {
        let output = self.engine.poll(now);
        self.events.extend(output.events);
        output.urgent.into_iter().chain(output.bytes).collect()
    }

    fn unknown(&self) -> Vec<&String> {
        let notes = self.events.iter().filter_map(|e| match e {
            Event::Note(n) if n.starts_with("unknown reply") || n.starts_with("unreadable") => Some(n),
            _ => None,
        });
        notes.collect()
    }

    fn outcome(&self, ticket: Ticket) -> Option<&Outcome> {
        self.events.iter().find_map(|e| match e {
            Event::Finished(t, outcome) if *t == ticket => Some(outcome),
            _ => None,
        })
    }
}

/// Holds a GRBL dialogue: real-time bytes by name, known lines by their command, others as `raw`.
fn hold_grbl(protocol: &str, transcript: &str) -> (Player, usize) {
    let spec = shipped(protocol);
    let mut player = Player::new(protocol, &["X", "Y", "Z"]);
    let mut held = 0;
    let mut open: Vec<(Ticket, Vec<u8>)> = Vec::new();
    let lines = read(transcript);
    for (i, line) in lines.iter().enumerate() {
        if !line.sent {
            player.engine.receive(&line.bytes, line.at);
            let sent = player.out(line.at);
            // The empty line that clears a latched error is ours alone: answer it as the firmware does.
            if sent == b"\n" {
                player.engine.receive(b"ok\r\n", line.at);
                player.out(line.at);
            }
            let text = String::from_utf8_lossy(&line.bytes).trim().to_owned();
            if (text == "ok" || text.starts_with("error:")) && !player.engine.is_silent() && !open.is_empty()
            {
                let (ticket, command) = open.remove(0);
                let outcome = player.outcome(ticket).unwrap_or_else(|| panic!("{text} ends {command:?}"));
                match outcome {
                    Ok(_) => assert_eq!(text, "ok", "{}", String::from_utf8_lossy(&command)),
                    Err(Failure::Refused { code, .. }) => assert_eq!(text, format!("error:{code}")),
                    other => panic!("{other:?}"),
                }
            }
            continue;
        }
        player.out(line.at);
        let realtime = spec.realtime.iter().find(|(_, b)| b.0 == line.bytes).map(|(name, _)| name.clone());
        if let Some(name) = realtime {
            player.engine.realtime(&name, line.at).unwrap();
            if name == "reset" {
                open.clear();
            }
        } else if line.bytes.ends_with(b"\n") {
            // While the device is mute our client sends nothing, and a line too long is refused here.
            let text = String::from_utf8_lossy(&line.bytes[..line.bytes.len() - 1]).into_owned();
            if player.engine.is_silent() || text.len() > spec.line.as_ref().unwrap().max_line.unwrap() {
                continue;
            }
            // Not waited for in the record: our client would not send while this one is unanswered.
            let next = lines[i + 1..].iter().find(|l| !l.sent).map(|l| l.bytes.clone()).unwrap_or_default();
            let known = spec.cmd.iter().find(|(name, _)| {
                crate::protocol::encode(&spec, name, &Fields::new(), None).is_ok_and(|b| b == line.bytes)
            });
            let (name, fields) = match known {
                Some((name, _)) => (name.clone(), Fields::new()),
                None => ("raw".to_owned(), [("text".to_owned(), Value::Text(text.clone()))].into()),
            };
            let ticket = player.engine.stream(&name, fields);
            if !next.starts_with(b"ALARM") {
                open.push((ticket, line.bytes.clone()));
            }
        } else {
            continue; // overrides (0x90, 0x91), which our client does not use
        }
        assert_eq!(player.out(line.at), line.bytes, "at {:?}", line.at);
        held += 1;
    }
    (player, held)
}

#[test]
fn recorded_grbl_is_understood_and_answered_byte_for_byte() {
    for (name, least) in [("grbl11h_avr_basic.txt", 47), ("grbl11h_avr_motion.txt", 79)] {
        let (player, held) = hold_grbl("grbl", name);
        assert_eq!(player.unknown(), Vec::<&String>::new(), "{name}");
        assert!(held >= least, "{name}: {held}");
        assert!(player.engine.positions()[0].is_some());
    }
    let (player, _) = hold_grbl("grbl", "grbl11h_avr_motion.txt");
    let alarms: Vec<&str> = player
        .events
        .iter()
        .filter_map(|e| match e {
            Event::Alarm { code, .. } => Some(code.as_str()),
            _ => None,
        })
        .collect();
    assert_eq!(alarms, ["3", "2", "2"]);
}

#[test]
fn recorded_grblhal_is_understood_and_answered_byte_for_byte() {
    let (player, held) = hold_grbl("grblhal", "grblhal_sim_basic.txt");
    assert_eq!(player.unknown(), Vec::<&String>::new());
    assert!(held >= 43, "{held}");
}

#[test]
fn recorded_marlin_is_understood_and_its_numbered_lines_are_ours() {
    let lines = read("marlin116_creality_avr.txt");
    // Every line of the record has a class.
    let mut player = Player::new("marlin", &["X", "Y", "Z"]);
    for line in lines.iter().filter(|l| !l.sent) {
        player.engine.receive(&line.bytes, line.at);
        player.out(line.at);
    }
    assert_eq!(player.unknown(), Vec::<&String>::new());
    // From `N0 M110` on the client's lines are the ones we would send; N2 was garbled on purpose.
    let mut player = Player::new("marlin", &["X", "Y", "Z"]);
    let at = |text: &str| lines.iter().position(|l| l.sent && l.bytes == text.as_bytes()).unwrap();
    let begin = at("N0 M110 N0*125\n");
    let end = at("N4 M114*35\n");
    let mut tickets = Vec::new();
    let mut garbled = false;
    for line in &lines[begin..end] {
        if !line.sent {
            player.engine.receive(&line.bytes, line.at);
            continue;
        }
        let mut ours = player.out(line.at);
        if ours.is_empty() {
            tickets.push(player.engine.stream("position", Fields::new()));
            ours = player.out(line.at);
        }
        if line.bytes == b"N2 M114*99\n" {
            // The line that the recorded client spoiled: ours was right, the device answers as recorded.
            assert_eq!(ours, b"N2 M114*37\n");
            garbled = true;
        } else {
            assert_eq!(ours, line.bytes);
        }
    }
    assert!(garbled);
    player.out(lines[end].at);
    assert_eq!(tickets.len(), 2);
    for ticket in tickets {
        assert!(matches!(player.outcome(ticket), Some(Ok(_))));
    }
    assert_eq!(player.engine.positions()[0].unwrap().value, 0.5);
    assert_eq!(player.engine.positions()[0].unwrap().counts, Some(crate::units::Steps(40)));
}

#[test]
fn recorded_zaber_is_understood_and_answered_byte_for_byte() {
    let mut player = Player::new("zaber_ascii", &["1/1"]);
    let (mut held, mut last, mut busy) = (0, None, 0);
    for line in read("zaber_motion_client_dialogue.txt") {
        if !line.sent {
            player.engine.receive(&line.bytes, line.at);
            player.out(line.at);
            let refused = line.bytes.windows(4).any(|w| w == b" RJ ");
            let outcome = player.outcome(last.unwrap()).expect("every command is answered");
            assert_eq!(outcome.is_err(), refused, "{outcome:?}");
            busy += usize::from(player.engine.state() == Some(MotionState::Moving));
            continue;
        }
        let text = String::from_utf8(line.bytes.clone()).unwrap();
        let body = text.trim_start_matches('/').split(':').next().unwrap();
        let mut words = body.splitn(4, ' ');
        let number = |w: Option<&str>| Value::Int(w.unwrap().parse().unwrap());
        let mut fields: Fields = [("device", number(words.next())), ("axis", number(words.next()))]
            .map(|(k, v)| (k.to_owned(), v))
            .into();
        words.next();
        fields.insert("text".to_owned(), Value::Text(words.next().unwrap_or("").to_owned()));
        let request = Request::Command { name: "raw".to_owned(), fields, axis: None };
        last = Some(player.engine.submit(request));
        assert_eq!(player.out(line.at), line.bytes, "{text}");
        held += 1;
    }
    assert_eq!(player.unknown(), Vec::<&String>::new());
    assert_eq!(held, 48);
    assert!(busy > 15, "{busy}");
}
