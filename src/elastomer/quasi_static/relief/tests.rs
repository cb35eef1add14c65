use super::super::tests::{pad, settings};
use super::super::{Body, QuasiStaticSolver, Resolution};
use super::settle::CLOSE_MM;
use super::*;
use crate::elastomer::{Elastomer, Friction, Law};
use crate::indenter::spec::{Plan, Shape};
use crate::indenter::{self, IndenterSpec};
use std::sync::Arc;

/// Force, N, and pressed area, mm^2, of a body with this underside, its tip `depth` below a level face 16 mm wide.
fn pressed(depth: f64, spacing_mm: f64, underside: impl Fn(f64) -> Option<f64>) -> [f64; 2] {
    let n = (16.0 / spacing_mm) as usize + 1;
    let body = Body::new(&pad(Law::NeoHookean), &settings(Friction::Coefficient(0.0)));
    let mut layer = Compliance::new(&body, [n, n], [spacing_mm; 2]);
    let at = |k: usize| k as f64 * spacing_mm - 8.0;
    let gap: Vec<f32> = (0..n * n)
        .map(|k| underside(at(k % n).hypot(at(k / n))).map_or(f64::INFINITY, |h| h - depth) as f32)
        .collect();
    let guess = gap.iter().map(|gap| if *gap < 0.0 { 0.01 } else { 0.0 }).collect();
    let [pressure, given] = settle(&gap, &vec![0.0; n * n], &mut layer, guess).expect("an easy press");
    for (k, p) in pressure.iter().enumerate() {
        let gap = gap[k] + given[k];
        assert!(gap >= -CLOSE_MM && (*p == 0.0 || gap <= CLOSE_MM) && *p >= 0.0, "{gap} {p}");
    }
    let area = spacing_mm * spacing_mm;
    let force = pressure.iter().map(|p| f64::from(*p)).sum::<f64>() * area;
    [force, pressure.iter().filter(|p| **p > 0.0).count() as f64 * area]
}

#[test]
fn a_punch_and_a_sphere_press_a_bonded_layer_as_theory_has_it() {
    // E 0.145, nu 0.45, 4 mm: F/d of a flat punch of radius 2.7 is 2.174 N/mm, exact for small strain.
    let [force, area] = pressed(0.1, 0.1, |r| (r < 2.7).then_some(0.0));
    assert!((force / 0.2174 - 1.0).abs() < 0.02, "{force}");
    assert!((area / (std::f64::consts::PI * 2.7 * 2.7) - 1.0).abs() < 0.02, "{area}");
    // A paraboloid of radius 4, 0.1 deep: 0.0183889 N.
    let [force, _] = pressed(0.1, 0.1, |r| Some(r * r / 8.0));
    assert!((force / 0.018_388_9 - 1.0).abs() < 0.02, "{force}");
}

#[test]
fn smoothing_keeps_what_is_level_and_takes_what_is_short() {
    let mut field: Vec<f32> =
        (0..60 * 40).map(|k| 2.0 + if (k % 60) % 2 == 0 { 0.5 } else { -0.5 }).collect();
    smooth(&mut field, [60, 40], [3.0, 2.0]);
    assert!(field.iter().all(|v| (v - 2.0).abs() < 1e-3));
}

#[test]
fn smoothing_is_a_gaussian_along_either_side_mirrored_at_its_ends() {
    // The second is narrower than the kernel reaches.
    for (size, deviation) in [([23, 37], [1.3, 2.1]), ([5, 19], [2.4, 0.9])] {
        let [nx, ny] = size;
        let given: Vec<f32> = (0..nx * ny).map(|k| ((k * k * 31 + 7 * k) % 97) as f32).collect();
        let mirrored = |at: i64, n: usize| {
            let period = 2 * (n as i64 - 1);
            let at = at.rem_euclid(period);
            at.min(period - at) as usize
        };
        let weighed = |deviation: f64, value: &dyn Fn(i64) -> f64| {
            let reach = (4.0 * deviation).ceil() as i64;
            let weight = |k: i64| (-0.5 * (k as f64 / deviation).powi(2)).exp();
            let sum: f64 = (-reach..=reach).map(|k| weight(k) * value(k)).sum();
            sum / (-reach..=reach).map(weight).sum::<f64>()
        };
        let along_x = |i: usize, j: usize| {
            weighed(deviation[0], &|k| f64::from(given[j * nx + mirrored(i as i64 + k, nx)]))
        };
        let mut field = given.clone();
        smooth(&mut field, size, deviation);
        for (k, v) in field.iter().enumerate() {
            let truth = weighed(deviation[1], &|d| along_x(k % nx, mirrored((k / nx) as i64 + d, ny)));
            assert!((f64::from(*v) - truth).abs() < 1e-3, "{size:?}, {k}: {v}, not {truth}");
        }
    }
}

#[test]
fn a_lattice_is_refined_to_four_points_a_cell_and_left_alone_where_it_is_coarse() {
    assert_eq!(finer([0.1, 0.1], [0.46, 0.46]), Some([1, 1]));
    assert_eq!(finer([0.4, 0.2], [0.46, 0.46]), Some([4, 2]));
    assert_eq!(finer([0.2, 0.2], [0.33, 0.33]), Some([2, 2]));
    // Three points a cell where four would be closer than 0.1 mm.
    assert_eq!(finer([0.1, 0.1], [0.28, 0.33]), Some([2, 1]));
    assert_eq!(finer([0.2, 0.2], [0.21, 0.21]), Some([3, 3]));
    assert_eq!(finer([0.5, 0.1], [0.46, 0.46]), None);
    assert_eq!(finer([f64::INFINITY; 2], [0.46, 0.46]), None);
}

/// A face of 201 x 201 points under a square of 5 mm whose edges run as (2, 1) over the lattice, pressed 0.5 mm.
fn under_a_slanted_square() -> (Arc<dyn Indenter>, Pose, crate::elastomer::ElastomerCapture, Surface) {
    let plan = Plan::Rectangle { x_mm: 5.0, y_mm: 5.0 };
    let spec = IndenterSpec {
        description: String::new(),
        edge_round_mm: 0.0,
        height_mm: 8.0,
        shape: Shape::Flat { plan },
    };
    let body = indenter::from_spec("square", &spec, None).expect("a body");
    let turn_deg = 0.5f64.atan().to_degrees();
    let start = Pose::new(0.0, 0.0, 0.1, turn_deg);
    let coarse = Resolution::for_tolerance(0.01).for_body(body.as_ref(), [20.0, 20.0, 4.0]);
    let mut solver = QuasiStaticSolver::with_resolution(
        &pad(Law::FixedCorotated),
        &settings(Friction::Coefficient(0.5)),
        coarse,
        Arc::clone(&body),
        &start,
    )
    .expect("settings in range");
    let pose = Pose::new(0.0, 0.0, -0.5, turn_deg);
    solver.advance(&pose).expect("an easy press");
    let splined = solver.finest().capture(body.as_ref(), 201, 201).expect("a lattice").surface;
    let capture = solver.capture(201, 201).expect("a lattice");
    (body, pose, capture, splined)
}

#[test]
fn a_slanted_edge_is_straight_and_the_face_lies_on_the_body() {
    let (body, pose, capture, splined) = under_a_slanted_square();
    // Beside its edges: how much heights differ where the face is equally far off them.
    let ripple = |face: &Surface| {
        let mut bins = vec![[0.0f64; 3]; 9];
        for p in &face.positions {
            let (x, y) = (f64::from(p.x), f64::from(p.y));
            let [along, across] = [(2.0 * x + y) / 5f64.sqrt(), (2.0 * y - x) / 5f64.sqrt()].map(f64::abs);
            // (Rows along the edges are 0.1 mm / sqrt(5) apart.)
            let off = (along.max(across) - 2.65) / (0.1 / 5f64.sqrt());
            if (0.0..9.0).contains(&off) && along.min(across) < 1.5 {
                let bin = &mut bins[off as usize];
                let z = f64::from(p.z);
                *bin = [bin[0] + 1.0, bin[1] + z, bin[2] + z * z];
            }
        }
        let variance = |[n, sum, squares]: &[f64; 3]| squares / n - (sum / n).powi(2);
        (bins.iter().map(variance).sum::<f64>() / bins.len() as f64).sqrt()
    };
    let [before, after] = [ripple(&splined), ripple(&capture.surface)];
    assert!(after < 0.5 * before && after < 5e-3, "{after} mm, splines alone {before} mm");
    // What is well within its edges lies on it, and what is beside it does not enter it.
    for (k, p) in capture.surface.positions.iter().enumerate() {
        let [x, y] = capture.surface.rest_xy(k % 201, k / 201);
        let [along, across] = [(2.0 * x + y) / 5f64.sqrt(), (2.0 * y - x) / 5f64.sqrt()];
        let local = pose.to_indenter(p.as_dvec3());
        let gap =
            body.lower_surface(local.x, local.y).map_or(f64::INFINITY, |h| h + pose.z_mm - f64::from(p.z));
        if along.abs().max(across.abs()) < 2.4 {
            assert!(gap.abs() < 1e-3 && capture.contact[k], "{gap} at {x} {y}");
        }
        assert!(gap > -1e-3, "{gap} at {x} {y}");
    }
    let area = capture.contact.iter().filter(|c| **c).count() as f64 * 0.01;
    assert!((area / 25.0 - 1.0).abs() < 0.05, "{area}");
    // A millimetre off the contact it is the splines' face.
    for (p, q) in capture.surface.positions.iter().zip(&splined.positions) {
        if p.x.hypot(p.y) > 5.5 {
            assert!((*p - *q).length() < 3e-3, "{p} {q}");
        }
    }
}

#[test]
fn points_beside_a_sharp_edge_are_drawn_on_it() {
    let (body, pose, capture, _) = under_a_slanted_square();
    let drawn = capture.drawn();
    for rim in &capture.rim {
        let local = pose.to_indenter(rim.at.as_dvec3());
        let off_edge_mm = local.x.abs().max(local.y.abs()) - 2.5;
        // (At a corner a chord cuts it off.)
        let least = if local.x.abs().min(local.y.abs()) > 2.4 { -0.05 } else { -1e-3 };
        assert!((least..1e-3).contains(&off_edge_mm), "{off_edge_mm} mm off the edge at {local}");
        assert!((rim.at.z + 0.5).abs() < 1e-3, "{rim:?}");
        let moved_mm = rim.at.truncate().distance(capture.surface.positions[rim.point].truncate());
        assert!(moved_mm < 0.055, "{moved_mm} mm: {rim:?}");
    }
    // Where the edge passes between two points of the lattice, one of them is on it.
    let under = |p: Vec3| {
        let local = pose.to_indenter(p.as_dvec3());
        body.lower_surface(local.x, local.y).is_some()
    };
    let on_it = |k: usize| capture.rim.iter().any(|rim| rim.point == k);
    let mut passes = 0;
    for k in (0..201 * 200).filter(|k| k % 201 < 200) {
        for n in [k + 1, k + 201] {
            if !on_it(k) && !on_it(n) {
                assert_eq!(under(drawn[k]), under(drawn[n]), "{} {}", drawn[k], drawn[n]);
            } else {
                passes += 1;
            }
        }
    }
    // 20 mm of edge pass a side of the lattice at least every 0.1 mm.
    assert!(passes > 200, "{passes}");
}

#[test]
fn round_edges_and_balls_have_no_rim() {
    let ball = Arc::new(super::super::tests::Sphere(4.0)) as Arc<dyn Indenter>;
    for body in [flat(Plan::Disc { diameter_mm: 6.0 }, 0.3), ball] {
        let rim = press(&body, None).capture(201, 201).expect("a lattice").rim;
        assert!(rim.is_empty(), "{rim:?}");
    }
}

/// A body with this plan.
fn flat(plan: Plan, edge_round_mm: f64) -> Arc<dyn Indenter> {
    let shape = Shape::Flat { plan };
    let spec = IndenterSpec { description: String::new(), edge_round_mm, height_mm: 8.0, shape };
    indenter::from_spec("flat", &spec, None).expect("a body")
}

/// A pad pressed 0.5 mm by a body over such cells; where none are given, by a solver that picks them for 0.01.
fn press(body: &Arc<dyn Indenter>, cell_mm: Option<f64>) -> QuasiStaticSolver {
    press_to(0.5, body, cell_mm)
}

/// The same to another depth, mm.
fn press_to(depth_mm: f64, body: &Arc<dyn Indenter>, cell_mm: Option<f64>) -> QuasiStaticSolver {
    let (pad, settings) = (pad(Law::FixedCorotated), settings(Friction::Coefficient(0.0)));
    let settings = crate::elastomer::Settings { tolerance: 0.01, ..settings };
    let start = Pose::new(0.0, 0.0, 0.1, 0.0);
    let usual = Resolution::for_tolerance(0.01).for_body(body.as_ref(), [20.0, 20.0, 4.0]);
    let solver = match cell_mm {
        None => QuasiStaticSolver::new(&pad, &settings, Arc::clone(body), &start),
        Some(cell_mm) => {
            let given = Resolution { cell_mm, ..usual };
            QuasiStaticSolver::with_resolution(&pad, &settings, given, Arc::clone(body), &start)
        }
    };
    let mut solver = solver.expect("settings in range");
    solver.advance(&Pose::new(0.0, 0.0, -depth_mm, 0.0)).expect("an easy press");
    solver
}

#[test]
fn a_punch_presses_as_hard_over_the_usual_cells_as_over_ones_of_half_their_size() {
    let punch = flat(Plan::Disc { diameter_mm: 6.0 }, 0.3);
    let force_n = |cell_mm: f64, n: usize| {
        let capture = press(&punch, Some(cell_mm)).capture(n, n).expect("a lattice");
        let forces = capture.forces.normal_force_n;
        assert!((capture.stats.base_reaction_n / forces - 1.0).abs() < 2e-3, "{capture:?}");
        forces
    };
    let [fine, usual, splines] = [force_n(0.21, 201), force_n(0.46, 201), force_n(0.46, 21)];
    let [with, without] = [usual, splines].map(|force_n| (force_n / fine - 1.0).abs());
    assert!(with < 4e-3 && with < 0.6 * without, "{with}, splines alone {without}");
}

#[test]
fn a_cone_presses_alike_wherever_it_stands_on_cells_and_points() {
    // Touched along less than three cells; splines scatter by 4 %.
    let spec = IndenterSpec {
        description: String::new(),
        edge_round_mm: 0.3,
        height_mm: 8.0,
        shape: Shape::Cone { tip_diameter_mm: 1.0, half_angle_deg: 19.29 },
    };
    let cone = indenter::from_spec("cone", &spec, None).expect("a body");
    let force_n = |n: usize| {
        let mut solver = press(&cone, Some(0.46));
        solver.capture(n, n).expect("a lattice").forces.normal_force_n
    };
    let [points, closer] = [201, 801].map(force_n);
    assert!((points / closer - 1.0).abs() < 5e-3, "{points} N, of points four times as close {closer} N");
}

#[test]
fn an_edge_between_two_points_of_the_lattice_lies_where_it_is() {
    // What a square 0.1 mm wider presses more, whether its edges come to lie on points of the lattice or between them.
    let force_n = |side: f64| {
        let square = flat(Plan::Rectangle { x_mm: side, y_mm: side }, 0.0);
        press(&square, Some(0.46)).capture(201, 201).expect("a lattice").forces.normal_force_n
    };
    let [at, between, next] = [5.0, 5.1, 5.2].map(force_n);
    let middle = 0.5 * (at + next);
    assert!((between / middle - 1.0).abs() < 0.012, "{at} {between} {next}");
}

#[test]
fn a_face_in_relief_states_its_own_error_and_needs_no_finer_cells_for_a_sharp_edge() {
    let square = flat(Plan::Rectangle { x_mm: 5.07, y_mm: 5.07 }, 0.0);
    let mut solver = press(&square, None);
    assert!((solver.finest().grid().hx - 20.0 / 48.0).abs() < 1e-9, "{}", solver.finest().grid().hx);
    let stated = |c: &crate::elastomer::ElastomerCapture| c.stats.estimated_error.expect("a press");
    let capture = solver.capture(201, 201).expect("a lattice");
    // Coarser than the cells it is the splines' face.
    let splined = stated(&solver.capture(21, 21).expect("a lattice"));
    assert!(stated(&capture) < 0.5 * splined, "{}, splines alone {splined}", stated(&capture));
    let truth = press(&square, Some(0.21)).capture(201, 201).expect("a lattice");
    let (mut squares, mut n) = (0.0, 0);
    for (k, (p, q)) in capture.surface.positions.iter().zip(&truth.surface.positions).enumerate() {
        let [x, y] = capture.surface.rest_xy(k % 201, k / 201);
        if x.hypot(y) < 5.7 && (x.abs().max(y.abs()) - 2.535).abs() > 0.2 {
            squares += f64::from(p.z - q.z).powi(2);
            n += 1;
        }
    }
    let found = (squares / f64::from(n)).sqrt() / 0.5;
    assert!(found < stated(&capture), "{found}, stated {}", stated(&capture));
}

/// Force and stated error of a press in relief, and of the same without.
fn with_and_without_relief(depth_mm: f64, body: &Arc<dyn Indenter>) -> [[f64; 2]; 2] {
    let mut solver = press_to(depth_mm, body, Some(0.63));
    [101, 21].map(|n| {
        let capture = solver.capture(n, n).expect("a lattice");
        [capture.forces.normal_force_n, capture.stats.estimated_error.expect("a press")]
    })
}

#[test]
fn a_press_through_a_third_of_the_pad_comes_to_have_the_forces_of_the_splines() {
    // The pad is 4 mm thick: from an eighth of that on the force, from a quarter the stated error.
    let punch = flat(Plan::Disc { diameter_mm: 6.0 }, 0.0);
    let more = |depth_mm: f64| {
        let [with, without] = with_and_without_relief(depth_mm, &punch);
        [0, 1].map(|k| with[k] / without[k] - 1.0)
    };
    let [shallow, all, some, little] = [0.45, 0.98, 1.2, 1.38].map(more);
    assert!(shallow[0].abs() > 3e-3 && all[0].abs() < 2e-3, "{shallow:?} {all:?}");
    assert!(some[0] == 0.0 && little[0] == 0.0, "{some:?} {little:?}");
    assert!(all[1].abs() > 3e-3, "{all:?}");
    assert!((some[1] / all[1] - 0.5).abs() < 0.25, "{some:?} {all:?}");
    assert!((little[1] / all[1] - 0.05).abs() < 0.05, "{little:?} {all:?}");
    let [with, without] = with_and_without_relief(1.41, &punch);
    assert_eq!(with, without);
}

#[test]
fn a_contact_that_is_all_rim_has_the_forces_of_the_splines() {
    // Less than two cells wide, and five.
    let bar = |wide_mm: f64| flat(Plan::Rectangle { x_mm: 5.0, y_mm: wide_mm }, 0.0);
    let [with, without] = with_and_without_relief(0.4, &bar(0.8));
    assert_eq!(with, without);
    let [with, without] = with_and_without_relief(0.4, &bar(3.2));
    assert!(with[0] != without[0] && with[1] != without[1], "{with:?} {without:?}");
}

#[test]
fn the_rim_of_a_sharp_disc_is_round_a_quarter_of_the_pad_down() {
    let body = flat(Plan::Disc { diameter_mm: 6.0 }, 0.0);
    let face = press_to(1.0, &body, None).capture(201, 201).expect("a lattice").surface;
    for p in &face.positions {
        let p = p.as_dvec3();
        let r = p.truncate().length();
        let above_mm = p.z + 1.0;
        // (Three quarters of the spacing of the lattice may lie between its last point and the rim.)
        assert!(r > 3.0 - 0.075 || above_mm < 5e-3, "{above_mm} mm above the disc at {p}");
        assert!(above_mm > -5e-3, "{above_mm} mm below the disc at {p}");
    }
}
