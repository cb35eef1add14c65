//! What is not skipped is done, and the answer is the same: to the bit where the skip is exact, else within what is stated.

use super::*;
use crate::elastomer::Surface;

const DEPTH_MM: f64 = 0.4;

fn at(x_mm: f64, z_mm: f64) -> Pose {
    Pose::new(x_mm, 0.0, z_mm, 0.0)
}

fn above(friction: Friction, without: &[Skip]) -> QuasiStaticSolver {
    let settings = Settings { tolerance: 0.05, without: without.to_vec(), ..settings(friction) };
    QuasiStaticSolver::new(&pad(Law::NeoHookean), &settings, Arc::new(Sphere(4.0)), &at(0.0, 1.0))
        .expect("settings are in range")
}

fn pressed(friction: Friction, without: &[Skip]) -> (QuasiStaticSolver, ElastomerCapture) {
    let mut s = above(friction, without);
    s.advance(&at(0.0, -DEPTH_MM)).expect("an easy press");
    let capture = s.capture(81, 81).expect("a lattice");
    (s, capture)
}

fn rms_apart_mm(a: &Surface, b: &Surface) -> f64 {
    let squares = a.positions.iter().zip(&b.positions).map(|(a, b)| f64::from(a.z - b.z).powi(2));
    (squares.sum::<f64>() / a.positions.len() as f64).sqrt()
}

/// Two answers are apart by no more than both state.
fn agree(with: &ElastomerCapture, without: &ElastomerCapture) {
    let stated: f64 = [with, without].iter().filter_map(|c| c.stats.estimated_error).sum();
    let apart = rms_apart_mm(&with.surface, &without.surface) / DEPTH_MM;
    assert!(apart <= stated && stated < 0.2, "{apart} apart, {stated} stated");
    let [a, b] = [with, without].map(|c| c.forces.normal_force_n);
    assert!((a / b - 1.0).abs() < 0.03, "{a} N and {b} N");
}

#[test]
fn the_air_may_be_looked_at_and_the_press_is_the_same_to_the_bit() {
    let follow = |without: &[Skip]| {
        let mut s = above(Friction::Infinite, without);
        s.advance(&at(0.3, 0.6)).expect("the air is free");
        s.advance(&at(0.3, 0.5)).expect("the air is free");
        let looks: Vec<u64> = s.levels.iter().map(|step| step.level.newton.strains).collect();
        s.advance(&at(0.3, -DEPTH_MM)).expect("an easy press");
        (looks, s.capture(81, 81).expect("a lattice"))
    };
    let ((none, with), (looks, without)) = (follow(&[]), follow(&[Skip::FirstTouch]));
    assert!(none.iter().all(|n| *n == 0) && looks.iter().all(|n| *n >= 2), "{none:?}, {looks:?}");
    assert_eq!(with, without);
}

#[test]
fn every_waypoint_may_start_from_rest_along_the_whole_way() {
    let way = [at(0.0, -0.2), at(0.0, -0.3), at(0.0, -DEPTH_MM), at(0.15, -DEPTH_MM), at(0.3, -DEPTH_MM)];
    let follow = |without: &[Skip], way: &[Pose]| {
        let mut s = above(Friction::Coefficient(0.5), without);
        let told: Vec<ElastomerCapture> = way
            .iter()
            .map(|pose| {
                s.advance(pose).expect("an easy way");
                s.capture(81, 81).expect("a lattice")
            })
            .collect();
        (s.path, told)
    };
    let (all, with) = follow(&[], &way);
    let (corners, without) = follow(&[Skip::WarmStart], &way);
    assert_eq!((all.len(), corners), (way.len() + 1, vec![at(0.0, 1.0), way[2], way[4]]));
    assert_eq!(with[0], without[0]);
    for (with, without) in with.iter().zip(&without).skip(1) {
        agree(with, without);
        assert!(without.stats.passes > with.stats.passes, "{:?}, {:?}", without.stats, with.stats);
    }
    // Nothing is left of the waypoints between.
    let (_, told) = follow(&[], &[way[2], way[4]]);
    let (alone, last) = (&told[1], &without[4]);
    assert!(rms_apart_mm(&alone.surface, &last.surface) < 1e-5);
    assert!((alone.forces.shear_force_n[0] / last.forces.shear_force_n[0] - 1.0).abs() < 1e-4);
}

#[test]
fn cells_may_be_as_high_below_as_at_the_face() {
    let (grown, with) = pressed(Friction::Infinite, &[]);
    let (even, without) = pressed(Friction::Infinite, &[Skip::GrowingCells]);
    let [grown, even] = [&grown, &even].map(|s| s.finest().grid().hz.clone());
    assert!(even.len() > grown.len() && even.iter().all(|h| (h / even[0] - 1.0).abs() < 1e-9), "{even:?}");
    agree(&with, &without);
}

#[test]
fn cells_may_be_half_as_wide_everywhere_instead_of_a_relief() {
    let (wide, with) = pressed(Friction::Infinite, &[]);
    let (narrow, without) = pressed(Friction::Infinite, &[Skip::Relief]);
    let [wide, narrow] = [&wide, &narrow].map(|s| s.finest().grid().nx);
    assert!(narrow >= 2 * wide, "{narrow} and {wide} cells");
    agree(&with, &without);
    // The face is that of the splines.
    let level = pressed(Friction::Infinite, &[Skip::Relief]).0;
    let splines = level.finest().capture(level.indenter.as_ref(), 81, 81).expect("a lattice");
    assert_eq!((splines.surface, splines.forces), (without.surface, without.forces));
}

#[test]
fn what_slides_without_friction_may_have_anchors_that_bear_nothing() {
    let slid = |without: &[Skip]| {
        let (mut s, press) = pressed(Friction::Coefficient(0.0), without);
        let anchors = s.finest().anchors();
        s.advance(&at(0.3, -DEPTH_MM)).expect("an easy slide");
        (anchors, press, s.capture(81, 81).expect("a lattice"))
    };
    let ((none, press, slide), (some, anchored_press, anchored_slide)) =
        (slid(&[]), slid(&[Skip::Frictionless]));
    assert!(none == 0 && some > 10, "{some} anchors, {none} without");
    agree(&press, &anchored_press);
    agree(&slide, &anchored_slide);
    let drag = |c: &ElastomerCapture| c.forces.shear_force_n[0].abs() / c.forces.normal_force_n;
    assert!((drag(&slide) - drag(&anchored_slide)).abs() < 0.01);
}
