//! Every shipped file is loaded and resolved, and every rule about bad files has a fixture.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use twinrig::config::{self, ConfigError, Kind, Setup};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn rig(name: &str) -> PathBuf {
    root().join(format!("rig_configs/{name}.toml"))
}

fn plan(name: &str) -> PathBuf {
    root().join(format!("rig_configs/plans/{name}.toml"))
}

fn load(rig_name: &str, plan_name: &str, sets: &[&str]) -> Result<Setup, ConfigError> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    config::load(&rig(rig_name), Some(&plan(plan_name)), &sets)
}

fn stems(folder: &str) -> BTreeSet<String> {
    let files = std::fs::read_dir(root().join(folder)).unwrap().map(|e| e.unwrap().path());
    files
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .map(|p| p.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect()
}

#[test]
fn every_shipped_rig_loads_with_the_protocols_and_the_sensor_it_names() {
    for name in stems("rig_configs") {
        let setup = config::load(&rig(&name), None, &[]).unwrap_or_else(|e| panic!("{name}: {e}"));
        for mover in setup.rig.devices.values() {
            assert!(setup.protocols.contains_key(&mover.protocol), "{name}: {}", mover.protocol);
        }
        assert_eq!(setup.sensor.is_none(), setup.rig.is_virtual(), "{name}");
        assert_eq!(setup.rig.optics.mode, config::OpticsMode::Fast, "{name}");
    }
}

#[test]
fn every_shipped_plan_runs_on_the_virtual_bench_and_is_counted() {
    let counts = [("press", 2079), ("slip", 48), ("rotate", 60), ("small", 4)];
    assert_eq!(stems("rig_configs/plans"), counts.iter().map(|(n, _)| (*n).to_owned()).collect());
    for (name, captures) in counts {
        let setup = load("virtual", name, &[]).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(setup.rig.is_virtual());
        assert_eq!(setup.plan.as_ref().unwrap().trajectory.captures.len(), captures, "{name}");
        let report = config::CheckReport::new(&setup);
        assert!(report.to_string().lines().any(|l| l == format!("captures: {captures}")), "{report}");
        assert_eq!(serde_json::to_value(&report).unwrap()["plan"]["captures"], captures);
    }
}

#[test]
fn the_real_benches_do_the_plans_they_are_made_for() {
    let press = load("gelsight_printer", "press", &[]).unwrap_or_else(|e| panic!("{e}"));
    assert!(!press.rig.is_virtual());
    assert_eq!(press.plan.unwrap().indenters.len(), 21);
    for name in ["slip", "rotate"] {
        load("skin_marlin_grbl", name, &[]).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}

#[test]
fn every_shipped_sensor_and_indenter_is_loaded_through_a_plan() {
    let indenters: Vec<String> =
        stems("rig_configs/indenters").iter().map(|n| format!("{{ name = \"{n}\" }}")).collect();
    for sensor in stems("rig_configs/sensors") {
        let sets = [
            format!("plan.sensor={sensor}"),
            format!("plan.indenters=[{}]", indenters.join(", ")),
            "plan.locations.columns=1".to_owned(),
            "plan.locations.rows=1".to_owned(),
        ];
        let loaded = config::load(&rig("virtual"), Some(&plan("press")), &sets);
        let setup = loaded.unwrap_or_else(|e| panic!("{sensor}: {e}"));
        assert_eq!(setup.sensor.unwrap().name, sensor);
        assert_eq!(setup.plan.unwrap().indenters.len(), indenters.len());
    }
}

#[test]
fn a_virtual_camera_takes_the_raster_of_the_sensor() {
    let size = |plan: &str| {
        let setup = load("virtual", plan, &[]).unwrap();
        (setup.rig.camera.width, setup.rig.camera.height)
    };
    assert_eq!((size("slip"), size("press")), ((480, 480), (640, 480)));
}

#[test]
fn every_override_of_the_conventions_reaches_its_setting() {
    let setup = load(
        "virtual",
        "slip",
        &[
            "elastomer.mode=quasi_static",
            "elastomer.law=fixed_corotated",
            "elastomer.youngs_modulus_mpa=0.2",
            "elastomer.poisson_ratio=0.4",
            "elastomer.friction=infinite",
            "elastomer.tolerance=.02",
            "optics.mode=reference",
            "twin.poses=measured",
            "plan.slide.distance_mm=2",
            "plan.indenters[3].edge_round_mm=0.1",
            "sensor.pad.thickness_mm=5",
            "virtual.contact_offset_mm=-.1",
            "devices.arm.axes.z.max_feed=9",
        ],
    )
    .unwrap_or_else(|e| panic!("{e}"));
    use twinrig::elastomer::{Friction, Law, Mode};
    let elastomer = &setup.rig.elastomer;
    assert_eq!(elastomer.mode, Mode::QuasiStatic);
    assert_eq!(elastomer.law, Some(Law::FixedCorotated));
    assert_eq!((elastomer.youngs_modulus_mpa, elastomer.poisson_ratio), (Some(0.2), Some(0.4)));
    assert_eq!((elastomer.friction, elastomer.tolerance), (Friction::Infinite, 0.02));
    assert_eq!(setup.rig.optics.mode, config::OpticsMode::Reference);
    assert_eq!(setup.rig.twin.poses, config::TwinPoses::Measured);
    assert_eq!(setup.rig.world.unwrap().contact_offset_mm, -0.1);
    assert_eq!(setup.rig.devices["arm"].axes["z"].max_feed, 9.0);
    assert_eq!(setup.sensor.as_ref().unwrap().pad.thickness_mm, 5.0);
    let plan = setup.plan.as_ref().unwrap();
    assert_eq!(plan.trajectory.captures.len(), 4 * 2 * 3);
    assert_eq!(plan.indenters["sphere"].edge_round_mm, 0.1);
    // A friction of 0 is a number, and frictionless.
    let frictionless = ["elastomer.mode=\"quasi_static\"", "elastomer.friction=0"];
    let frictionless = load("virtual", "slip", &frictionless).unwrap();
    assert_eq!(frictionless.rig.elastomer.friction, Friction::Coefficient(0.0));
    assert_ne!(frictionless.hash(), setup.hash());
}

#[test]
fn skips_are_left_out_by_their_words_and_a_dataset_knows() {
    use twinrig::elastomer::Skip;
    let simulation_hash = |sets: &[&str]| {
        let setup = load("virtual", "slip", sets).unwrap_or_else(|e| panic!("{e}"));
        let provenance = twinrig::assemble::provenance(&setup).expect("a plan");
        (setup.rig.elastomer.without, provenance.simulation_hash, provenance.overrides)
    };
    let (none, usual, _) = simulation_hash(&[]);
    let set = "elastomer.without=[\"warm_start\", \"shared_paths\"]";
    let (without, other, overrides) = simulation_hash(&[set]);
    assert_eq!((none, without), (Vec::new(), vec![Skip::WarmStart, Skip::SharedPaths]));
    assert_ne!(usual, other);
    assert_eq!(overrides, [set]);
    // The words in the file, and in the error that names all of them.
    let said = load("virtual", "slip", &["elastomer.without=[\"warmth\"]"]).unwrap_err().to_string();
    assert!(Skip::ALL.iter().all(|skip| said.contains(&format!("\"{}\"", skip.name()))), "{said}");
}

#[test]
fn shipped_files_are_found_from_anywhere_and_own_files_come_first() {
    let elsewhere = tempfile::tempdir().unwrap();
    let slip = config::load(Path::new("virtual"), Some(Path::new("slip.toml")), &[]).unwrap();
    assert_eq!(slip.plan.unwrap().trajectory.captures.len(), 48);

    // A copy of the rig with a sphere of its own beside it.
    std::fs::copy(rig("virtual"), elsewhere.path().join("mine.toml")).unwrap();
    std::fs::create_dir(elsewhere.path().join("indenters")).unwrap();
    let own = "[shape]\nkind = \"dome\"\nradius_mm = 2.0\ndiameter_mm = 4.0\n";
    std::fs::write(elsewhere.path().join("indenters/sphere.toml"), own).unwrap();
    let mine = elsewhere.path().join("mine.toml");
    let setup = config::load(&mine, Some(Path::new("small")), &[]).unwrap_or_else(|e| panic!("{e}"));
    let sphere = setup.sources.iter().find(|s| s.kind == Kind::Indenter).unwrap();
    assert_eq!(sphere.text, own);
    assert_eq!(sphere.blake3, blake3::hash(own.as_bytes()).to_hex().to_string());
    let marlin = setup.sources.iter().find(|s| s.kind == Kind::Protocol && s.name == "marlin").unwrap();
    assert!(!marlin.text.is_empty());
}

#[test]
fn files_that_are_not_there_are_named_both() {
    let error = config::load(Path::new("rig_configs/virtul.toml"), Some(Path::new("no/where.toml")), &[]);
    let said = error.unwrap_err().to_string();
    assert!(said.contains("rig_configs/virtul.toml: there is no such file"), "{said}");
    assert!(said.contains("did you mean rig_configs/virtual.toml?"), "{said}");
    assert!(said.contains("no/where.toml: there is no such file"), "{said}");
}

/// Loads every folder of `tests/bad_configs/`: `rig.toml` and `plan.toml` (the virtual bench and the
/// small plan where absent), `sets.txt` with one override a line. What is said must be
/// `expected.txt`, written anew where TWINRIG_ACCEPT is set.
#[test]
fn bad_files_are_refused_with_the_message_on_record() {
    let folder = root().join("tests/bad_configs");
    let mut cases: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    cases.sort();
    assert!(cases.len() >= 20, "{} fixtures", cases.len());
    let mut wrong = Vec::new();
    for case in cases.iter().filter(|c| c.is_dir()) {
        let own = |name: &str, shipped: PathBuf| {
            let path = case.join(name);
            if path.exists() { path } else { shipped }
        };
        let sets: Vec<String> = std::fs::read_to_string(case.join("sets.txt"))
            .map(|text| text.lines().map(str::to_owned).collect())
            .unwrap_or_default();
        let (rig, plan) = (own("rig.toml", rig("virtual")), own("plan.toml", plan("small")));
        let said = match config::load(&rig, Some(&plan), &sets) {
            Ok(_) => "accepted\n".to_owned(),
            Err(error) => format!("{error}\n").replace(&format!("{}/", root().display()), ""),
        };
        let expected = case.join("expected.txt");
        if std::env::var_os("TWINRIG_ACCEPT").is_some() {
            std::fs::write(&expected, &said).unwrap();
        }
        assert_ne!(said, "accepted\n", "{} must be refused", case.display());
        if std::fs::read_to_string(&expected).unwrap_or_default() != said {
            wrong.push(format!("{}:\n{said}", case.display()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Refuses every `tests/bad_protocols/*.toml`, each with the message on record beside it (written anew
/// where TWINRIG_ACCEPT is set). `fails.toml` is sound, but its examples do not hold.
#[test]
fn bad_protocols_are_refused_with_the_message_on_record() {
    let folder = root().join("tests/bad_protocols");
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "toml") && !f.ends_with("fails.toml"));
    files.sort();
    assert!(files.len() >= 8, "{} fixtures", files.len());
    let mut wrong = Vec::new();
    for file in files {
        let error = config::protocol(file.to_str().unwrap()).expect_err(&file.display().to_string());
        let said = format!("{error}\n").replace(&format!("{}/", root().display()), "");
        let expected = file.with_extension("txt");
        if std::env::var_os("TWINRIG_ACCEPT").is_some() {
            std::fs::write(&expected, &said).unwrap();
        }
        if std::fs::read_to_string(&expected).unwrap_or_default() != said {
            wrong.push(format!("{}:\n{said}", file.display()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(config::protocol(folder.join("fails.toml").to_str().unwrap()).is_ok());
}

#[test]
fn every_shipped_protocol_is_sound_and_keeps_its_word() {
    use twinrig::protocol::conformance::{Case, check};
    let shipped = config::shipped_protocols();
    assert_eq!(shipped.iter().map(|n| (*n).to_owned()).collect::<BTreeSet<_>>(), stems("firmware_protocols"));
    for name in shipped {
        let spec = config::protocol(name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(check(&spec).failures().collect::<Vec<_>>(), Vec::<&Case>::new(), "{name}");
    }
}

#[test]
fn a_tool_that_may_go_where_its_arm_cannot_is_warned_of() {
    let warned = |set: &[&str]| {
        let sets: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
        let setup = config::load(&rig("servo_arm"), None, &sets).unwrap_or_else(|e| panic!("{e}"));
        let report = config::CheckReport::new(&setup);
        assert_eq!(report.to_string().contains("\nwarning: "), !report.warnings.is_empty());
        report.warnings
    };
    assert_eq!(warned(&[]), Vec::<String>::new());
    let far = warned(&["devices.arm.kinematics.tool.x.max=150.0"]);
    assert_eq!(far.len(), 1);
    for words in ["[devices.arm.kinematics.tool]", "of the 16 corners", "x 150.000", "make the box smaller"] {
        assert!(far[0].contains(words), "{words} is missing: {}", far[0]);
    }
}

#[test]
fn a_file_may_hold_the_settings_of_two_modes_for_an_override_to_choose_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let load = |text: &str, sets: &[&str]| {
        let shipped = std::fs::read_to_string(rig("virtual")).unwrap();
        std::fs::write(&path, shipped.replacen("[elastomer]\n", &format!("[elastomer]\n{text}\n"), 1))
            .unwrap();
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        config::load(&path, Some(&plan("small")), &sets)
    };
    let own = load("tolerance = 0.02", &[]).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(own.warnings, Vec::<String>::new());
    // What the override leaves idle is told, by `check`, too.
    let other = load("tolerance = 0.02", &["elastomer.mode=impm"]).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(other.warnings.len(), 1);
    for words in
        ["elastomer.tolerance = 0.02", "mine.toml:79", "--set elastomer.mode=impm", "\"quasi_static\""]
    {
        assert!(other.warnings[0].contains(words), "{words} is missing: {}", other.warnings[0]);
    }
    assert_eq!(config::CheckReport::new(&other).warnings, other.warnings);
    // What the command line gives is for this run: it is refused, in part of a list, too.
    let particles = "particles = [101, 101, 21]";
    for sets in [
        &["elastomer.mode=impm", "elastomer.tolerance=0.02"][..],
        &["elastomer.mode=quasi_static", "elastomer.particles[0]=11"],
    ] {
        let said = load(particles, sets).unwrap_err().to_string();
        assert!(said.starts_with("1 problem") && said.contains("(unused with elastomer.mode"), "{said}");
    }
    // And so is what a file gives beside its own mode, but once.
    let said = load(particles, &[]).unwrap_err().to_string();
    assert!(said.contains("mine.toml:79: elastomer.particles = [101, 101, 21] (unused with"), "{said}");
    let said = load("particles = [101, 101, 1]", &[]).unwrap_err().to_string();
    assert!(said.starts_with("1 problem") && said.contains("3 to 4001 particles"), "{said}");
    // Lights traced by the fast mode where it falls back have samples and a seed.
    load("", &["optics.samples=9", "optics.seed=2"]).unwrap_or_else(|e| panic!("{e}"));
}

#[test]
fn one_mistake_in_the_pressing_axis_is_one_finding() {
    for (rig_name, mistake) in [
        ("virtual", "devices.arm.axes.z.max_feed=-1.0"),
        ("virtual", "devices.arm.axes.z.max_feed=1e-9"),
        ("virtual", "devices.arm.axes.z.min=100.0"),
        ("virtual", "devices.arm.axes.z.max=inf"),
        ("virtual", "devices.arm.axes.z.max=1e300"),
        ("virtual", "devices.arm.axes.z.accel=0.0"),
        ("virtual", "devices.arm.axes.z.kind=\"rotary\""),
        ("virtual", "devices.arm.axes.z.wire=\"q\""),
        ("virtual", "motion.z.axis=\"q\""),
        ("virtual", "motion.z.origin=-500.0"),
        ("servo_arm", "devices.arm.kinematics.press=[0.0, 1.0, 0.0]"),
        ("servo_arm", "devices.arm.kinematics.press=[0.0, 0.0, 0.0]"),
        ("servo_arm", "devices.arm.kinematics.tool.z.max_feed=-1.0"),
        ("servo_arm", "devices.arm.kinematics.tool.z.min=100.0"),
    ] {
        let said = load(rig_name, "small", &[mistake]).unwrap_err().to_string();
        assert!(said.starts_with("1 problem in the configuration"), "{mistake}: {said}");
    }
}
