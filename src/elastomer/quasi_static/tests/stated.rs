//! The error that an answer states, and the finer cells that are taken for it.

use super::*;

/// A blade along y, thinner than the way from one sample point to the next.
#[derive(Debug)]
struct Blade;

impl Indenter for Blade {
    fn name(&self) -> &str {
        "blade"
    }
    fn distance(&self, p: DVec3) -> f64 {
        let q = DVec3::new(p.x.abs() - 0.1, p.y.abs() - 5.0, (p.z - 5.0).abs() - 5.0);
        q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
    }
    fn distance_and_normal(&self, p: DVec3) -> (f64, DVec3) {
        let step = |axis: DVec3| self.distance(p + axis * 1e-6) - self.distance(p - axis * 1e-6);
        let normal = DVec3::new(step(DVec3::X), step(DVec3::Y), step(DVec3::Z));
        (self.distance(p), normal.normalize_or(DVec3::NEG_Z))
    }
    fn half_extent_mm(&self) -> [f64; 2] {
        [0.1, 5.0]
    }
    fn lower_surface(&self, x: f64, y: f64) -> Option<f64> {
        (x.abs() <= 0.1 && y.abs() <= 5.0).then_some(0.0)
    }
}

#[test]
fn a_blade_that_the_sample_points_miss_is_told_as_an_error() {
    let settings = Settings { tolerance: 0.05, ..settings(Friction::Coefficient(0.0)) };
    let mut s = QuasiStaticSolver::new(
        &pad(Law::NeoHookean),
        &settings,
        Arc::new(Blade),
        &Pose::new(0.0, 0.0, 1.0, 0.0),
    )
    .unwrap();
    s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).unwrap();
    let capture = s.capture(41, 41).unwrap();
    let stated = capture.stats.estimated_error.expect("a press");
    let deepest = capture.surface.positions.iter().fold(0.0, |d: f32, p| d.min(p.z));
    // Either the blade dents the face as deep as it stands, or the capture says how far that is from true.
    let missing = f64::from(0.5 + deepest) / 0.5;
    assert!(stated > 0.5 * missing, "stated {stated}, the dent lacks {missing} of the depth");
}

#[test]
fn what_states_too_much_is_solved_with_finer_cells_until_it_is_let_go() {
    let settings = Settings { tolerance: 0.02, ..settings(Friction::Infinite) };
    let start = Pose::new(0.0, 0.0, 0.2, 0.0);
    let punch = Arc::new(Punch(1.75, 0.02));
    let solver = |resolution: Option<Resolution>| {
        // Small, to be quick.
        let pad = Pad { size_x_mm: 10.0, size_y_mm: 10.0, ..pad(Law::NeoHookean) };
        match resolution {
            None => QuasiStaticSolver::new(&pad, &settings, punch.clone(), &start),
            Some(r) => QuasiStaticSolver::with_resolution(&pad, &settings, r, punch.clone(), &start),
        }
        .expect("settings are in range")
    };
    let coarse = Resolution::for_tolerance(settings.tolerance).for_body(punch.as_ref(), [10.0, 10.0, 4.0]);
    let press = Pose::new(0.0, 0.0, -0.3, 0.0);
    let drag = Pose::new(0.1, 0.0, -0.3, 0.0);
    let run = |s: &mut QuasiStaticSolver, pose: &Pose| {
        s.advance(pose).expect("an easy way");
        (s.finest().grid().nx, s.capture(41, 41).expect("a lattice"))
    };
    let (mut given, mut s) = (solver(Some(coarse)), solver(None));
    let (cells, before) = run(&mut given, &press);
    let stated = |c: &ElastomerCapture| c.stats.estimated_error.expect("a press");
    assert!(stated(&before) > 2.0 * settings.tolerance, "{}", stated(&before));
    let (finer, pressed) = run(&mut s, &press);
    assert!(finer > cells && stated(&pressed) <= 2.0 * settings.tolerance, "{finer} {}", stated(&pressed));
    assert!(pressed.stats.iterations > before.stats.iterations, "work on levels that are left counts");
    // A copy goes the same way.
    let mut copy = s.fork();
    // It is dragged with them, and as well.
    let (again, dragged) = run(&mut s, &drag);
    let (_, plain) = run(&mut given, &drag);
    assert!(stated(&plain) > 2.25 * settings.tolerance, "{}", stated(&plain));
    assert!(again >= finer && stated(&dragged) <= 2.25 * settings.tolerance, "{again} {}", stated(&dragged));
    copy.advance(&drag).expect("an easy way");
    assert_eq!(copy.capture(41, 41).expect("a lattice").surface, dragged.surface);
    assert_eq!(run(&mut s, &start).0, cells);
    assert_eq!(run(&mut s, &press).1.surface, pressed.surface);
}

#[test]
fn a_first_tenth_of_a_millimetre_to_a_coarse_tolerance_takes_no_finer_cells_than_to_the_usual_one() {
    let first = |tolerance: f64| {
        let settings = Settings { tolerance, ..settings(Friction::Infinite) };
        let start = Pose::new(0.0, 0.0, 0.2, 0.0);
        let mut s = QuasiStaticSolver::new(&pad(Law::NeoHookean), &settings, Arc::new(Sphere(4.0)), &start)
            .expect("in range");
        s.advance(&Pose::new(0.0, 0.0, -0.1, 0.0)).expect("an easy press");
        let stated = s.capture(101, 101).expect("a lattice").stats.estimated_error.expect("a press");
        assert!(stated < refinement::wanted(tolerance), "{tolerance}: {stated}");
        s.finest().grid().nx
    };
    let usual = first(0.01);
    assert!(first(0.02) <= usual, "{usual}");
}

#[test]
fn a_drag_states_no_more_than_was_asked_for() {
    let settings = Settings { tolerance: 0.1, ..settings(Friction::Infinite) };
    let start = Pose::new(0.0, 0.0, 0.5, 0.0);
    let sphere = Arc::new(Sphere(4.0));
    let mut s = QuasiStaticSolver::new(&pad(Law::NeoHookean), &settings, sphere, &start).expect("in range");
    // A contact of the size of a cell.
    for n in 0..3 {
        s.advance(&Pose::new(0.1 * f64::from(n), 0.0, -0.06, 0.0)).expect("an easy way");
        let stated = s.capture(2, 2).expect("a lattice").stats.estimated_error.expect("a press");
        assert!(stated < settings.tolerance, "{n}: {stated}");
    }
}

#[test]
fn a_flat_punch_presses_as_hard_over_the_usual_cells_as_over_fine_ones() {
    use crate::indenter::spec::{Plan, Shape};
    use crate::indenter::{IndenterSpec, from_spec};
    let shape = Shape::Flat { plan: Plan::Disc { diameter_mm: 5.4 } };
    let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.3, height_mm: 8.0, shape };
    let punch = from_spec("punch", &spec, None).expect("a disc");
    let force_n = |tolerance: f64, cell_mm: Option<f64>| {
        let settings = Settings { tolerance, ..settings(Friction::Coefficient(0.0)) };
        let (pad, start) = (pad(Law::NeoHookean), Pose::new(0.0, 0.0, 0.2, 0.0));
        let usual = Resolution::for_tolerance(tolerance);
        let resolution = Resolution { cell_mm: cell_mm.unwrap_or(usual.cell_mm), ..usual };
        let mut s = QuasiStaticSolver::with_resolution(&pad, &settings, resolution, punch.clone(), &start)
            .expect("in range");
        s.advance(&Pose::new(0.0, 0.0, -0.5, 0.0)).expect("an easy press");
        s.capture(2, 2).expect("a lattice").forces.normal_force_n
    };
    let (usual, fine) = (force_n(0.01, None), force_n(0.01, Some(0.25)));
    assert!((usual / fine - 1.0).abs() < 0.01, "{usual} instead of {fine}");
}
