//! `twinrig bench elastomer` and `twinrig stress elastomer` as a shell meets them: what they print, how they end, what
//! they leave. What they find is tested beside their code.

use std::process::{Command, Output};

fn run(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_twinrig"));
    command.args(args).env("NO_COLOR", "1").env_remove("TWINRIG_LOG");
    command.output().expect("the program starts")
}

fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn a_smoke_bench_names_its_machine_and_leaves_tables_and_a_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("deep/bench");
    let output = run(&["bench", "elastomer", "--smoke", "--json", "--out", out.to_str().expect("a path")]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let report = json(&output);
    assert!(report["machine"]["cores"].as_u64().is_some_and(|n| n > 0));
    assert!(report["machine"]["simd"].as_str().is_some_and(|s| !s.is_empty()));
    assert!(report["throughput"][0]["bytes_per_particle"].as_f64().is_some_and(|b| b >= 56.0));
    assert!(report["curves"]["points"].as_array().is_some_and(|p| p.len() >= 4));
    for name in
        ["throughput.csv", "time_to_solution.csv", "error_vs_time.csv", "skips.csv", "error_vs_time.svg"]
    {
        let size = std::fs::metadata(out.join(name)).map(|m| m.len());
        assert!(size.is_ok_and(|n| n > 100), "{name}");
    }
}

#[test]
fn a_sweep_of_bad_settings_refuses_them_all_and_counts_them() {
    let output = run(&["stress", "elastomer", "--cases", "60", "--family", "hostile", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let sweep = json(&output);
    assert_eq!((&sweep["cases"], &sweep["failures"]), (&9.into(), &0.into()));
    assert_eq!(sweep["verdicts"]["refused"], 9);
    let numbers: Vec<u64> =
        sweep["judgements"].as_array().into_iter().flatten().filter_map(|j| j["number"].as_u64()).collect();
    assert_eq!(numbers, [3, 9, 15, 23, 29, 35, 43, 49, 55]);
    let output = run(&["stress", "elastomer", "--cases", "20", "--family", "hostile"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("bad settings") && text.contains("3 cases, 0 failures"), "{text}");
}

#[test]
fn a_case_can_be_run_again_by_its_number() {
    let output = run(&["stress", "elastomer", "--only", "3"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("refused") && text.contains("tolerance"), "{text}");
    let again = json(&run(&["stress", "elastomer", "--only", "3", "--json"]));
    assert_eq!((&again["number"], &again["verdict"]), (&3.into(), &"refused".into()));
}

#[test]
fn a_case_without_end_is_a_hang_and_the_sweep_fails() {
    // A hundred presses take longer than a second of processor time.
    let args = ["--family", "cycles", "--cases", "20", "--limit-s", "1", "--json"];
    let output = run(&[&["stress", "elastomer"][..], &args].concat());
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let sweep = json(&output);
    assert!(sweep["verdicts"]["hang"].as_u64().is_some_and(|n| n >= 1), "{sweep}");
    assert_eq!(sweep["failures"], sweep["verdicts"]["hang"]);
}
