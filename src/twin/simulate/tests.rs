use super::*;
use crate::elastomer::{Friction, Law};
use crate::indenter::spec::{IndenterSpec, Shape};
use std::sync::Mutex;
use std::sync::atomic::AtomicUsize;

fn model() -> Model {
    let ball = |radius_mm: f64| -> Arc<dyn Indenter> {
        let shape = Shape::Dome { radius_mm, diameter_mm: 2.0 * radius_mm };
        let spec = IndenterSpec { description: String::new(), edge_round_mm: 0.0, height_mm: 8.0, shape };
        crate::indenter::from_spec("ball", &spec, None).expect("a ball")
    };
    let material = Material {
        law: Law::FixedCorotated,
        youngs_modulus_mpa: 0.145,
        poisson_ratio: 0.45,
        density_g_mm3: 1.0,
    };
    Model {
        pad: Pad::slab([10.0, 10.0, 3.0], material),
        settings: Settings { tolerance: 0.05, friction: Friction::Coefficient(0.5), ..Settings::default() },
        indenters: [("small", 1.5), ("large", 3.0)].map(|(name, r)| (name.to_owned(), ball(r))).into(),
    }
}

/// A press with slides to both sides by each ball: captures 0 to 2 and 3 to 5.
fn roots() -> Vec<Root> {
    let branch = |x: f64, z: f64, capture: u32, next: Vec<Branch>| Branch {
        pose: Pose::new(x, 0.0, z, 0.0),
        captures: vec![capture],
        next,
    };
    let root = |(indenter, first): (&str, u32)| Root {
        indenter: indenter.into(),
        start: Pose::new(0.0, 0.0, 0.1, 0.0),
        next: vec![branch(
            0.0,
            -0.3,
            first,
            vec![branch(-0.2, -0.3, first + 1, Vec::new()), branch(0.2, -0.3, first + 2, Vec::new())],
        )],
    };
    [("small", 0), ("large", 3)].map(root).into()
}

fn run(crew: &Crew, emit: &(dyn Fn(Outcome) -> bool + Sync)) -> bool {
    let (model, cancel) = (model(), Arc::new(AtomicBool::new(false)));
    Walk { model: &model, lattice: [21, 21], crew, cancel: &cancel, emit }.run(&roots())
}

#[test]
fn a_crew_of_any_size_walks_the_same_to_the_bit() {
    let walked = |threads: u32| {
        let found = Mutex::new(BTreeMap::new());
        let is_complete = run(&Crew::new(Some(threads)).expect("threads"), &|outcome| {
            let Outcome::Deformed(deformed) = outcome else { panic!("{outcome:?}") };
            found.lock().unwrap().insert(deformed.captures.clone(), deformed.pad);
            true
        });
        assert!(is_complete);
        found.into_inner().unwrap()
    };
    let alone = walked(1);
    assert_eq!(alone.keys().flatten().copied().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
    for threads in [2, 3] {
        assert_eq!(walked(threads), alone, "{threads} threads");
    }
}

#[test]
fn paths_that_are_walked_alone_and_to_their_end_find_the_same() {
    let walked = |roots: &[Root]| {
        let (model, cancel) = (model(), Arc::new(AtomicBool::new(false)));
        let crew = Crew::new(Some(2)).expect("threads");
        let found = Mutex::new(BTreeMap::new());
        let emit = |outcome| {
            let Outcome::Deformed(deformed) = outcome else { panic!("{outcome:?}") };
            let told = (deformed.pad.surface, deformed.pad.forces);
            assert!(found.lock().unwrap().insert(deformed.captures, told).is_none());
            true
        };
        let walk = Walk { model: &model, lattice: [21, 21], crew: &crew, cancel: &cancel, emit: &emit };
        assert!(walk.run(roots));
        found.into_inner().unwrap()
    };
    let shared = roots().remove(0);
    // Up again, and to where no indenter can be: nobody wants to know.
    let end = |x: f64, z: f64, next| Branch { pose: Pose::new(x, 0.0, z, 0.0), captures: Vec::new(), next };
    let alone = [0, 1].map(|n| {
        let mut root = shared.clone();
        let press = &mut root.next[0];
        press.next = vec![press.next.swap_remove(n)];
        if n > 0 {
            press.captures.clear();
        }
        let slide = &mut press.next[0];
        let (x, z) = (slide.pose.x_mm, slide.pose.z_mm);
        slide.next = vec![end(x, 0.1, vec![end(x, 100.0 * z, Vec::new())])];
        root
    });
    let found = walked(&alone);
    assert_eq!(found.keys().flatten().copied().collect::<Vec<_>>(), [0, 1, 2]);
    assert!(found == walked(&[shared]));
}

#[test]
fn nobody_begins_anything_once_one_was_told_to_stop() {
    let taken = AtomicUsize::new(0);
    let crew = Crew::new(Some(2)).expect("threads");
    assert!(!run(&crew, &|_| {
        taken.fetch_add(1, Ordering::Relaxed);
        false
    }));
    assert!((1..=2).contains(&taken.into_inner()), "each of the two may have been about to deliver one");
}

#[test]
fn a_walker_that_panics_takes_the_others_home() {
    let crew = Crew::new(Some(2)).expect("threads");
    let walk = || run(&crew, &|_| panic!("on purpose"));
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(walk)).is_err());
}

#[test]
fn a_depth_that_is_not_resolved_costs_none_below_it() {
    let branch = |z: f64, captures: Vec<u32>, next: Vec<Branch>| Branch {
        pose: Pose::new(0.0, 0.0, z, 0.0),
        captures,
        next,
    };
    let pressed = |way: Vec<Branch>| {
        let (model, cancel) = (model(), Arc::new(AtomicBool::new(false)));
        let crew = Crew::new(Some(2)).expect("threads");
        let told = Mutex::new(Vec::new());
        let emit = |outcome| {
            told.lock().unwrap().push(outcome);
            true
        };
        let root = Root { indenter: "small".into(), start: Pose::new(0.0, 0.0, 0.1, 0.0), next: way };
        let walk = Walk { model: &model, lattice: [21, 21], crew: &crew, cancel: &cancel, emit: &emit };
        assert!(walk.run(&[root]));
        told.into_inner().unwrap()
    };
    let shallow = -0.0003;
    let told = pressed(vec![branch(shallow, vec![0], vec![branch(-0.3, vec![1], Vec::new())])]);
    let [Outcome::Failed { captures, error }, Outcome::Deformed(deep)] = &told[..] else {
        panic!("{told:?}")
    };
    assert_eq!((&captures[..], &deep.captures[..]), (&[0][..], &[1][..]));
    assert!(error.goes_on() && error.to_string().contains("deeper captures of this press"), "{error}");

    // Who has not asked is not told, and gets the same.
    let told = pressed(vec![branch(shallow, Vec::new(), vec![branch(-0.3, vec![1], Vec::new())])]);
    let [Outcome::Deformed(passed)] = &told[..] else { panic!("{told:?}") };
    assert_eq!(passed.pad, deep.pad);

    // As deep at once, it is the same to within rounding.
    let told = pressed(vec![branch(-0.3, vec![1], Vec::new())]);
    let [Outcome::Deformed(alone)] = &told[..] else { panic!("{told:?}") };
    let (with, without) = (deep.pad.forces.normal_force_n, alone.pad.forces.normal_force_n);
    assert!((with / without - 1.0).abs() < 2e-3, "{with} N after a shallow capture, {without} N without");
}
