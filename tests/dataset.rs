//! Datasets on disk: a process that dies at any moment loses at most the capture in flight.

use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use twinrig::dataset::{self, Dataset, Provenance, RealRecord, SCHEMA, SimRecord, depth};
use twinrig::motion::{CaptureMark, Episode, Phase, Primitive, Trajectory, Waypoint};
use twinrig::pose::Pose;

const CAPTURES: u32 = 4;

fn trajectory() -> Trajectory {
    let mut t = Trajectory { waypoints: Vec::new(), episodes: Vec::new(), captures: Vec::new() };
    for k in 0..CAPTURES {
        t.captures.push(CaptureMark {
            waypoint: k,
            episode: 0,
            step: k,
            depth_mm: 0.1 * f64::from(k),
            slip_mm: 0.0,
            slip_direction_deg: 0.0,
            rotation_deg: 0.0,
        });
        t.waypoints.push(Waypoint {
            pose: Pose::new(0.0, 0.0, -0.1 * f64::from(k), 0.0),
            starts: Duration::ZERO,
            arrives: Duration::ZERO,
            feed_mm_s: 1.0,
            feed_deg_s: 0.0,
            phase: Phase::Press,
            episode: 0,
            capture: Some(k),
        });
    }
    t.episodes.push(Episode {
        indenter: "sphere".into(),
        primitive: Primitive::Press,
        location_mm: [0.0, 0.0],
        repeat: 0,
        first_waypoint: 0,
        end_waypoint: CAPTURES,
    });
    t
}

fn provenance(trajectory: &Trajectory) -> Provenance {
    Provenance {
        schema: SCHEMA.into(),
        tool_version: "test".into(),
        created_utc: "2026-01-01T00:00:00Z".into(),
        rig: "virtual".into(),
        plan: "small".into(),
        sensor: "gelsight".into(),
        real_is_virtual: true,
        captures: CAPTURES,
        splits: vec!["train".into(), "train".into(), "test".into(), "test".into()],
        seed: 1,
        trajectory_hash: trajectory.hash(),
        rig_hash: "r".into(),
        simulation_hash: "s".into(),
        rig_toml: "rig".into(),
        plan_toml: "plan".into(),
        sensor_toml: "sensor".into(),
        overrides: vec![],
    }
}

fn real(k: u32) -> (RealRecord, Vec<u8>) {
    let pose = Pose::new(0.0, 0.0, -0.1 * f64::from(k), 0.0);
    let record = RealRecord {
        session: "s".into(),
        is_virtual: true,
        commanded: pose,
        measured: pose,
        contact_zero_mm: 0.1,
        contact_method: "given".into(),
        axes: vec![],
        departed: false,
        exposed_mono_ns: i64::from(k),
        settled_mono_ns: 0,
        utc_ns: 0,
        settle_ms: 1.0,
        still_rms: 0.5,
        frame_sequence: k,
        frame_flags: 0,
        dropped_before: 0,
        frames_averaged: 1,
        exposure_us: None,
        width: 2,
        height: 2,
        fourcc: "RGB3".into(),
        drift_rms: 0.0,
    };
    (record, format!("real picture {k}").repeat(100).into_bytes())
}

fn sim(k: u32) -> (SimRecord, Vec<u8>, Vec<u8>) {
    let record = SimRecord {
        config_hash: "s".into(),
        engine_version: "test".into(),
        pose: Pose::default(),
        poses: "commanded".into(),
        elastomer_mode: "impm".into(),
        law: "neo_hookean".into(),
        youngs_modulus_mpa: 0.145,
        poisson_ratio: 0.45,
        friction: None,
        optics_mode: "reference".into(),
        spp: Some(16),
        seed: 1,
        elastomer_ms: 1.0,
        render_ms: 1.0,
        normal_force_n: 0.1,
        shear_force_n: [0.0, 0.0],
        torque_n_mm: 0.0,
        contact_area_mm2: 1.0,
        held: None,
        contact_box_px: Some([1, 1, 2, 2]),
        iterations: 3,
        passes_per_step: 1.0,
        limit_hits: 0,
        particles: 5,
        residual: 0.0,
        estimated_error: None,
        light_error: None,
        light_meets_tolerance: None,
    };
    let tiff = depth::encode(2, 2, &[0.0, -0.1, -0.2, k as f32]).expect("encodes");
    (record, format!("simulated picture {k}").into_bytes(), tiff)
}

/// Stores everything that is missing; ends early when the process "dies".
fn collect(dataset: &Dataset) -> Result<(), dataset::Error> {
    let (done_real, done_sim) = (dataset.done_real(), dataset.done_sim());
    for k in 0..CAPTURES {
        if !done_real.contains(&k) {
            let (record, png) = real(k);
            dataset.append_real(k, record, &png)?;
        }
        if !done_sim.contains(&k) {
            let (record, png, tiff) = sim(k);
            dataset.append_sim(k, record, &png, &tiff, b"contact")?;
        }
    }
    dataset.finalise(&BTreeMap::new())
}

fn assert_complete(root: &std::path::Path) {
    let found = dataset::verify::verify(root).expect("opens");
    assert_eq!(found.findings, [], "nothing is torn");
    assert_eq!((found.real, found.sim, found.rows), (4, 4, 4), "nothing is lost");
    for name in ["real", "sim"] {
        let journal = std::fs::read_to_string(root.join(format!("journal/{name}.ndjson"))).expect("journal");
        let mut captures: Vec<_> =
            journal.lines().map(|l| l.split(',').next().unwrap_or("").to_owned()).collect();
        let all = captures.len();
        captures.sort();
        captures.dedup();
        assert_eq!(captures.len(), all, "nothing is doubled in {name}");
    }
}

#[test]
fn killed_at_every_moment_and_resumed_nothing_is_lost_doubled_or_torn() {
    let trajectory = trajectory();
    let asked = provenance(&trajectory);
    // Four captures with three files and two journal lines each, seven moments per file with its line.
    let mut moment = 0;
    loop {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().join("set");
        let mut dataset = Dataset::create(&root, asked.clone(), &trajectory).expect("creates");
        let count = Arc::new(AtomicUsize::new(0));
        dataset.interrupt_with(Box::new(move |_| {
            if count.fetch_add(1, Ordering::SeqCst) == moment {
                return Err(std::io::Error::other("killed"));
            }
            Ok(())
        }));
        let survived = collect(&dataset).is_ok();
        drop(dataset);
        let (dataset, damaged) = Dataset::resume(&root, &asked).expect("resumes");
        assert_eq!(damaged, BTreeSet::new(), "an interrupted write damages nothing that was stored");
        collect(&dataset).expect("the rest is stored");
        drop(dataset);
        assert_complete(&root);
        if survived {
            break;
        }
        moment += 1;
    }
    assert_eq!(moment, 4 * (4 * 5 + 2 * 2), "every moment of every capture was tried");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_journal_cut_anywhere_resumes(cut_real in 0.0..1.0f64, cut_sim in 0.0..1.0f64) {
        let trajectory = trajectory();
        let asked = provenance(&trajectory);
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().join("set");
        collect(&Dataset::create(&root, asked.clone(), &trajectory).expect("creates")).expect("stores");
        for (name, cut) in [("real", cut_real), ("sim", cut_sim)] {
            let path = root.join(format!("journal/{name}.ndjson"));
            let length = std::fs::metadata(&path).expect("journal").len();
            let file = std::fs::OpenOptions::new().write(true).open(&path).expect("opens");
            file.set_len((length as f64 * cut) as u64).expect("cuts");
        }
        let (dataset, _) = Dataset::resume(&root, &asked).expect("resumes");
        collect(&dataset).expect("the rest is stored");
        drop(dataset);
        assert_complete(&root);
    }
}

#[test]
fn a_damaged_file_is_found_and_done_again() {
    let trajectory = trajectory();
    let asked = provenance(&trajectory);
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("set");
    collect(&Dataset::create(&root, asked.clone(), &trajectory).expect("creates")).expect("stores");
    std::fs::write(root.join("data/train/real/000001.png"), b"rotten").expect("writes");
    std::fs::remove_file(root.join("data/test/depth/000002.tiff")).expect("removes");
    let found = dataset::verify::verify(&root).expect("opens").findings;
    assert_eq!(found.len(), 2, "{found:?}");
    let (dataset, damaged) = Dataset::resume(&root, &asked).expect("resumes");
    assert_eq!(damaged, BTreeSet::from([1, 2]));
    collect(&dataset).expect("stores again");
    drop(dataset);
    assert_eq!(dataset::verify::verify(&root).expect("opens").findings, []);
}

#[test]
fn what_no_journal_knows_is_found_among_the_data() {
    let trajectory = trajectory();
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("set");
    collect(&Dataset::create(&root, provenance(&trajectory), &trajectory).expect("creates")).expect("stores");
    for stray in ["data/train/real/000099.png", "data/test/thumbs.db"] {
        std::fs::write(root.join(stray), b"?").expect("writes");
    }
    let found = dataset::verify::verify(&root).expect("opens").findings;
    let paths: Vec<&str> = found.iter().map(|f| f.path.as_str()).collect();
    assert_eq!(paths, ["data/test/thumbs.db", "data/train/real/000099.png"]);

    // Where nobody can look, nobody knows: a folder that cannot be read is no empty one.
    std::fs::rename(root.join("data"), root.join("away")).expect("moves");
    std::fs::write(root.join("data"), b"no folder").expect("writes");
    let found = dataset::verify::verify(&root).expect("opens").findings;
    assert!(
        found.iter().any(|f| f.path == "data" && f.problem.contains("cannot be looked into")),
        "{found:?}"
    );
    std::fs::remove_file(root.join("data")).expect("removes");
    std::fs::rename(root.join("away"), root.join("data")).expect("moves back");

    // A shorter plan does not have the captures that were made for a longer one.
    let mut lines = std::fs::read_to_string(root.join("journal/real.ndjson")).expect("journal");
    std::fs::remove_file(root.join("data/test/thumbs.db")).expect("removes");
    lines = lines.replace("\"capture\":3", "\"capture\":7");
    std::fs::write(root.join("journal/real.ndjson"), lines).expect("writes");
    let found = dataset::verify::verify(&root).expect("opens").findings;
    assert!(found.iter().any(|f| f.problem.contains("tells of captures 7")), "{found:?}");
}

#[test]
fn another_plan_or_a_second_writer_is_refused() {
    let trajectory = trajectory();
    let asked = provenance(&trajectory);
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("set");
    let first = Dataset::create(&root, asked.clone(), &trajectory).expect("creates");
    let locked = Dataset::resume(&root, &asked).expect_err("locked").to_string();
    assert!(locked.contains("being written by another process"), "{locked}");
    collect(&first).expect("stores");
    drop(first);
    let mut other = asked.clone();
    other.trajectory_hash = "f".repeat(64);
    let refused = Dataset::resume(&root, &other).expect_err("refused").to_string();
    // The files are the same and the way is not: what the plan names must have changed.
    assert!(refused.contains("another trajectory") && refused.contains("an indenter file"), "{refused}");
    other.plan_toml = "seed = 7".into();
    let refused = Dataset::resume(&root, &other).expect_err("refused").to_string();
    assert!(refused.contains("seed of the plan file was absent and is 7"), "{refused}");
    let again = Dataset::create(&root, asked, &trajectory).expect_err("exists").to_string();
    assert!(again.contains("--resume"), "{again}");
}

#[test]
fn a_folder_in_which_nothing_was_captured_is_begun_anew_with_other_files() {
    let trajectory = trajectory();
    let asked = provenance(&trajectory);
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("set");
    let first = Dataset::create(&root, asked.clone(), &trajectory).expect("creates");
    first.put_background("background-000", b"of another sensor").expect("stores");
    drop(first);
    let other = Provenance { rig: "another bench".to_owned(), ..asked.clone() };
    let second = Dataset::create(&root, other, &trajectory).expect("nothing is lost by it");
    assert_eq!(
        (second.provenance().rig.as_str(), second.background("background-000")),
        ("another bench", None)
    );
    drop(second);
    // A journal that cannot be read is no empty journal.
    std::fs::write(root.join("journal/real.ndjson"), "torn").expect("writes");
    let refused = Dataset::create(&root, asked, &trajectory).expect_err("something is there").to_string();
    assert!(refused.contains("--resume"), "{refused}");
}
