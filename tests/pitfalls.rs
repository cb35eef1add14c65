//! Every pitfall of real hardware that is known to have bitten somebody has a test that bears its number.

use std::collections::BTreeMap;
use std::path::Path;

/// The pitfalls, by number.
const PITFALLS: [&str; 28] = [
    "a stale ok comes after a reset",
    "a reset soon after an alarm is swallowed",
    "mute while homing and after an alarm, by design",
    "grblHAL repeats an error until a line succeeds",
    "Marlin says ok to refused lines, and to some nothing",
    "an ok is lost",
    "a resend names an old line, or comes without its ok",
    "the board resets when the port is opened",
    "an alarm at random makes the position suspect",
    "M114 tells the target",
    "soft endstops clamp in silence",
    "done is told before the readback settles",
    "a fixed time for a move fails long ones",
    "a target where it already is never begins to move",
    "arrivals are a window, not an equality",
    "a banner in mid-run is a reset",
    "work positions and machine positions, and their offset",
    "boot noise is not text",
    "replies are split and merged",
    "numbers in a locale, or with an exponent",
    "backlash",
    "a frame from before the end of the move",
    "two devices swap their ports",
    "a port opened twice",
    "a cable pulled out in mid-move",
    "one device is lost while another moves",
    "a stop waits in a queue",
    "units of feeds and counts",
];

/// Numbers in the name of a test: `pitfall_8_and_16_...` has two.
fn numbers(name: &str) -> Vec<usize> {
    let mut found = Vec::new();
    for word in name.trim_start_matches("pitfall_").split('_') {
        match word.parse() {
            Ok(number) => found.push(number),
            Err(_) if word == "and" => {}
            Err(_) => break,
        }
    }
    found
}

fn tests_in(folder: &Path, found: &mut BTreeMap<usize, Vec<String>>) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            tests_in(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests/pitfalls.rs") {
            let text = std::fs::read_to_string(&path).expect("a source");
            let mut is_test = false;
            for line in text.lines().map(str::trim) {
                let name = line.trim_start_matches("async ").strip_prefix("fn ");
                if let Some(name) = name.filter(|name| is_test && name.starts_with("pitfall_")) {
                    let name = name.split('(').next().unwrap_or_default();
                    numbers(name).into_iter().for_each(|n| found.entry(n).or_default().push(name.to_owned()));
                }
                is_test = line.ends_with("test]")
                    || line.contains("::test(")
                    || (is_test && line.starts_with("#["));
            }
        }
    }
}

#[test]
#[expect(clippy::print_stdout, reason = "the list is worth reading")]
fn every_pitfall_is_a_test_by_name() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = BTreeMap::new();
    tests_in(&root.join("src"), &mut found);
    tests_in(&root.join("tests"), &mut found);
    for (i, what) in PITFALLS.iter().enumerate() {
        let tests = found.get(&(i + 1)).map_or_else(Vec::new, Clone::clone);
        println!("{:>2} {what}: {}", i + 1, tests.join(", "));
        assert!(!tests.is_empty(), "pitfall {}, {what}, has no test of that name", i + 1);
    }
    assert!(found.keys().all(|n| (1..=PITFALLS.len()).contains(n)), "{:?}", found.keys());
}
