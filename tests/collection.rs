//! Bench and twin together into one dataset: pairs, stops, full disks, refusals of the twin, measured poses.
//!
//! Virtual benches at many times their speed and pictures of a few pixels; what is tested is that both sides
//! of every capture come together, or that it is told why not.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use twinrig::assemble::{self, BenchOptions};
use twinrig::collection::{Collection, CollectionError, Ending, Progress, SessionPart};
use twinrig::config::{self, Setup};
use twinrig::dataset::{self, Dataset, verify::verify};
use twinrig::report;
use twinrig::session::{Session, StopLevel, StopSwitch};

/// The small plan with a picture that costs nothing, and what else is wanted.
fn setup(sets: &[&str]) -> Setup {
    let cheap = [
        "optics.samples=1",
        "elastomer.mode=\"quasi_static\"",
        "elastomer.tolerance=0.05",
        "sensor.optics.camera.width_px=96",
        "sensor.optics.camera.height_px=72",
        "sensor.optics.camera.mm_per_px=0.1875",
        "sensor.optics.mesh.vertices=[96, 72]",
    ];
    let sets: Vec<String> = cheap.iter().chain(sets).map(|s| (*s).to_owned()).collect();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig_configs");
    let plan = folder.join("plans/small.toml");
    config::load(&folder.join("virtual.toml"), Some(&plan), &sets).unwrap_or_else(|e| panic!("{e}"))
}

/// What a collection is to do, beside what its files say.
struct Wanted<'a> {
    setup: &'a Setup,
    root: PathBuf,
    real: bool,
    sim: bool,
    /// Raise the stop switch when so many real captures are stored.
    stop_after: Option<u32>,
    /// The disk is full after so many moments of writing.
    room: Option<i64>,
    /// The twin believes in a pad of this size.
    pad_mm: Option<f64>,
}

impl<'a> Wanted<'a> {
    fn new(setup: &'a Setup, root: &Path) -> Self {
        Wanted {
            setup,
            root: root.to_owned(),
            real: true,
            sim: true,
            stop_after: None,
            room: None,
            pad_mm: None,
        }
    }

    /// Collects; also answers how high the indenter truly hovers at the end, in mm above the pad.
    async fn run(&self) -> (Result<Ending, CollectionError>, f64) {
        let (setup, plan) = (self.setup, self.setup.plan.as_ref().expect("a plan"));
        let asked = assemble::provenance(setup).expect("hashes");
        let mut dataset = match self.root.join("dataset.json").exists() {
            true => Dataset::resume(&self.root, &asked).expect("resumes").0,
            false => Dataset::create(&self.root, asked, &plan.trajectory).expect("a new dataset"),
        };
        if let Some(room) = self.room {
            let left = AtomicI64::new(room);
            dataset.interrupt_with(Box::new(move |_| match left.fetch_sub(1, Ordering::SeqCst) > 0 {
                true => Ok(()),
                false => Err(Error::from(ErrorKind::StorageFull)),
            }));
        }
        let dataset = Arc::new(dataset);
        let stop = StopSwitch::new();
        let twin = self.sim.then(|| {
            let mut twin = assemble::twin(setup).expect("a twin");
            if let Some(pad_mm) = self.pad_mm {
                (twin.model.pad.size_x_mm, twin.model.pad.size_y_mm) = (pad_mm, pad_mm);
            }
            Arc::new(twin)
        });
        let (progress, mut told) = tokio::sync::mpsc::unbounded_channel();
        let watching = tokio::spawn({
            let (stop, stop_after, mut stored) = (stop.clone(), self.stop_after, 0);
            async move {
                while let Some(event) = told.recv().await {
                    stored += u32::from(matches!(event, Progress::Real { .. }));
                    if stop_after == Some(stored) {
                        stop.raise(StopLevel::Controlled);
                    }
                }
            }
        });
        if !self.real {
            let ended = Collection { dataset, session: None, twin, stop, progress }.run().await;
            return (ended, f64::INFINITY);
        }
        let options = BenchOptions { speed: 40.0, ..BenchOptions::default() };
        let mut assembled = assemble::bench(setup, &options, stop.clone()).await.expect("a bench");
        let world = assembled.world.clone().expect("a virtual bench");
        let (events, received) = tokio::sync::mpsc::channel(8);
        let session = Session {
            settings: assemble::session_settings(setup, plan),
            operator: {
                let (world, bodies) = (world.clone(), plan.bodies());
                Box::new(move |indenter| {
                    world.mount(bodies.get(indenter).cloned());
                    Box::pin(std::future::ready(true))
                })
            },
            contact_zero_mm: BTreeMap::new(),
            bench: &mut assembled.bench,
            trajectory: &plan.trajectory,
            events,
        };
        let part = SessionPart { session, events: received, run: assemble::run_notes("s", setup, plan) };
        let ended = Collection { dataset, session: Some(part), twin, stop, progress }.run().await;
        watching.await.expect("the watcher ends");
        let height_mm = world.scene_at(assembled.bench.clock.now()).pose.z_mm;
        (ended, height_mm)
    }
}

/// The same bench with a stage that keeps its position when it is stopped for an arm.
const PRESSED_BY_GRBL: [&str; 4] = [
    "motion.z={ device = \"stage\", axis = \"x\", sign = 1, origin = -30.0 }",
    "motion.x={ device = \"arm\", axis = \"y\", sign = 1, origin = 30.0 }",
    "motion.y={ device = \"arm\", axis = \"z\", sign = 1, origin = 30.0 }",
    "devices.stage.axes.x.tolerance=0.01",
];

fn all() -> BTreeSet<u32> {
    (0..4).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn both_sides_of_every_capture_come_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let setup = setup(&[]);
    let (ended, height_mm) = Wanted::new(&setup, folder.path()).run().await;
    assert_eq!(ended.expect("collects"), Ending::default());
    assert!(height_mm > 1.0, "left at {height_mm} mm");

    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!((dataset.done_real(), dataset.done_sim()), (all(), all()));
    let trajectory = dataset.trajectory();
    for row in dataset.rows() {
        let (real, sim) = (row.real.expect("a real side").record, row.sim.expect("a simulated side").record);
        let pose = trajectory.pose_of(row.capture);
        assert!(!real.departed && real.measured.distance_mm(&pose) < 0.02, "{}", real.measured);
        assert_eq!(sim.pose, pose, "the twin follows the commanded poses");
        assert_eq!(sim.poses, "commanded");
        assert!(real.exposed_mono_ns >= real.settled_mono_ns);
    }
    // The deeper, the harder it pushes back.
    let forces: Vec<f64> =
        dataset.rows().iter().map(|r| r.sim.as_ref().unwrap().record.normal_force_n).collect();
    assert!(forces[1] > 0.0 && forces.is_sorted(), "{forces:?}");

    report::write(&dataset).expect("a report");
    let found = verify(folder.path()).expect("verifies");
    assert_eq!((found.rows, found.findings), (4, vec![]));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_stop_leaves_is_continued_and_nothing_is_done_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let setup = setup(&PRESSED_BY_GRBL);
    let (ended, height_mm) = Wanted { stop_after: Some(2), ..Wanted::new(&setup, folder.path()) }.run().await;
    assert!(ended.expect("a stop is no failure").stopped);
    assert!(height_mm > 1.0, "a GRBL that was stopped knows where it is and retracts: {height_mm} mm");

    let journal =
        |side: &str| std::fs::read_to_string(folder.path().join(format!("journal/{side}.ndjson"))).unwrap();
    let before = [journal("real"), journal("sim")];
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert!((2..4).contains(&dataset.done_real().len()), "{:?}", dataset.done_real());

    let (ended, _) = Wanted::new(&setup, folder.path()).run().await;
    assert_eq!(ended.expect("continues"), Ending::default());
    for (before, side) in before.iter().zip(["real", "sim"]) {
        let after = journal(side);
        assert!(after.starts_with(before.as_str()), "what was stored stays as it is");
        assert_eq!(after.lines().count(), 4, "{side}: nothing is done twice");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_full_disk_stops_the_bench_and_is_continued_when_there_is_room() {
    let setup = setup(&PRESSED_BY_GRBL);
    // Full before the first picture of the untouched sensor, between two files, within a journal line.
    for room in [0, 13, 31] {
        let folder = tempfile::tempdir().expect("a folder");
        let (ended, height_mm) =
            Wanted { room: Some(room), ..Wanted::new(&setup, folder.path()) }.run().await;
        let error = ended.expect_err("a full disk");
        assert!(matches!(error, CollectionError::Dataset(dataset::Error::DiskFull { .. })), "{error:?}");
        assert!(error.to_string().contains("--resume"), "{error}");
        assert!(height_mm > 1.0, "after {room} moments the arm was left at {height_mm} mm");

        let dataset = Dataset::open(folder.path()).expect("a dataset");
        assert!(dataset.done_real().len() < 4 || dataset.done_sim().len() < 4);
        drop(dataset);
        let (ended, _) = Wanted::new(&setup, folder.path()).run().await;
        assert_eq!(ended.expect("continues"), Ending::default());
        let dataset = Dataset::open(folder.path()).expect("a dataset");
        report::write(&dataset).expect("a report");
        let found = verify(folder.path()).expect("verifies");
        assert_eq!((found.rows, found.findings), (4, vec![]), "after {room} moments");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_refusal_of_the_twin_is_told_and_costs_no_real_capture() {
    let folder = tempfile::tempdir().expect("a folder");
    let setup = setup(&["plan.locations={ points_mm = [[2.0, 0.0]] }"]);
    let narrow = Wanted { pad_mm: Some(8.0), ..Wanted::new(&setup, folder.path()) };
    let (ended, _) = narrow.run().await;
    let ending = ended.expect("a twin that refuses is no failure of the bench");
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!(dataset.done_real(), all());
    let refused: BTreeSet<u32> =
        ending.not_simulated.iter().flat_map(|(captures, _)| captures.clone()).collect();
    assert!(refused.contains(&3), "{ending:?}");
    assert_eq!(dataset.done_sim().union(&refused).copied().collect::<BTreeSet<_>>(), all());
    assert!(
        ending.not_simulated.iter().all(|(_, why)| why.contains("smaller indenter or a larger pad")),
        "{ending:?}"
    );
    // Only pairs are rows.
    assert_eq!(dataset.rows().len(), dataset.done_sim().len());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_twin_can_follow_what_was_measured_also_afterwards() {
    let folder = tempfile::tempdir().expect("a folder");
    let setup = setup(&["twin.poses=\"measured\""]);
    let real_only = Wanted { sim: false, ..Wanted::new(&setup, folder.path()) };
    real_only.run().await.0.expect("the bench alone");
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!((dataset.done_real(), dataset.rows().len()), (all(), 4), "rows of one side");

    let sim_only = Wanted { real: false, ..Wanted::new(&setup, folder.path()) };
    assert_eq!(sim_only.run().await.0.expect("the twin alone"), Ending::default());
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    for row in dataset.rows() {
        let (real, sim) = (row.real.expect("real").record, row.sim.expect("simulated").record);
        assert_eq!(sim.poses, "measured");
        assert_eq!(sim.pose, real.measured);
    }
}
