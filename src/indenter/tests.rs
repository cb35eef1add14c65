//! Every shipped indenter against the table of measured solids, and against what any signed
//! distance must fulfil.

use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;

fn spec(name: &str) -> IndenterSpec {
    let path = format!("{}/../../rig_configs/indenters/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    toml::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn load(name: &str, round: f64) -> Arc<dyn Indenter> {
    from_spec(name, &spec(name), Some(round)).unwrap()
}

const ALL: [&str; 21] = [
    "sphere",
    "sphere2",
    "curved_surface",
    "cone",
    "cylinder",
    "cylinder_shell",
    "cylinder_side",
    "dot_in",
    "dots",
    "flat_slab",
    "hexagon",
    "line",
    "parallel_lines",
    "cross_lines",
    "moon",
    "pacman",
    "prism",
    "random",
    "torus",
    "triangle",
    "wave1",
];

/// Area, extent in x and in y of the cross-section at height `z`, by counting cells of `step` and by
/// bisecting the outermost crossings.
fn section(body: &dyn Indenter, z: f64, step: f64) -> (f64, f64, f64) {
    let half = DVec2::from(body.half_extent_mm()) + 0.1;
    let inside = |p: DVec2| body.distance(p.extend(z)) < 0.0;
    let n = (half * 2.0 / step).ceil();
    let cells = |j: f64| (0..n.x as usize).map(move |i| (DVec2::new(i as f64, j) - (n - 1.0) / 2.0) * step);
    let all: Vec<DVec2> = (0..n.y as usize).flat_map(|j| cells(j as f64)).filter(|&p| inside(p)).collect();
    // The first point outside, at most one cell away from the outermost one inside.
    let edge = |axis: DVec2| {
        let reach = all.iter().map(|p| p.dot(axis)).fold(f64::NEG_INFINITY, f64::max);
        let outermost = all.iter().filter(|p| p.dot(axis) > reach - step / 2.0);
        let bisect = |p: &DVec2| {
            let (mut from, mut to) = (0.0, 2.0 * step);
            for _ in 0..30 {
                let middle = (from + to) / 2.0;
                if inside(*p + axis * middle) { from = middle } else { to = middle }
            }
            p.dot(axis) + from
        };
        outermost.map(bisect).fold(f64::NEG_INFINITY, f64::max)
    };
    let extent = |axis: DVec2| edge(axis) + edge(-axis);
    (all.len() as f64 * step * step, extent(DVec2::X), extent(DVec2::Y))
}

#[test]
fn the_table_of_measured_solids_is_reproduced() {
    // Name, height above the tip, extent in x, extent in y, area (where the table has them).
    let cap = |r: f64, z: f64| 2.0 * (2.0 * r * z - z * z).sqrt();
    type Row = (&'static str, f64, Option<f64>, Option<f64>, Option<f64>);
    let rows: Vec<Row> = vec![
        ("sphere", 0.05, Some(1.06), Some(1.06), None),
        ("sphere", 0.5, Some(3.29), Some(3.29), None),
        ("sphere", 1.0, Some(4.45), Some(4.45), None),
        ("sphere2", 0.05, Some(1.37), None, None),
        ("sphere2", 0.5, Some(4.30), None, None),
        ("sphere2", 1.0, Some(5.98), None, None),
        ("curved_surface", 0.05, Some(2.81), None, None),
        ("curved_surface", 0.5, Some(8.87), None, None),
        ("curved_surface", 1.0, Some(12.43), Some(cap(20.0, 1.0)), None),
        ("cone", 1e-6, Some(1.0), Some(1.0), None),
        ("cone", 1.0, Some(1.70), Some(1.70), None),
        ("cylinder", 0.5, Some(6.0), Some(6.0), Some(9.0 * std::f64::consts::PI)),
        ("cylinder_shell", 0.5, Some(7.0), Some(7.0), Some(std::f64::consts::PI * (12.25 - 2.695 * 2.695))),
        ("cylinder_side", 0.05, Some(1.10), Some(14.0), None),
        ("cylinder_side", 0.5, Some(3.32), Some(14.0), None),
        ("cylinder_side", 1.0, Some(4.46), Some(14.0), None),
        ("dot_in", 1e-6, Some(8.0), Some(8.0), Some(64.0 - 4.0 * std::f64::consts::PI)),
        ("flat_slab", 0.5, Some(14.0), Some(14.0), Some(196.0)),
        ("hexagon", 0.5, Some(7.0), Some(6.06), None),
        ("line", 0.5, Some(2.0), Some(16.0), Some(32.0)),
        ("parallel_lines", 0.5, Some(11.0), Some(14.0), Some(84.0)),
        ("cross_lines", 0.5, Some(11.0), Some(14.0), Some(84.0)),
        ("cross_lines", 1.5, Some(14.0), Some(11.0), Some(84.0)),
        ("moon", 0.5, Some(5.8), Some(7.0), Some(19.4)),
        ("pacman", 0.5, Some(3.0 + 3.0 * (std::f64::consts::PI / 5.0).cos()), Some(6.0), Some(22.6)),
        ("prism", 0.5, Some(5.0), Some(7.0), Some(35.0)),
        ("random", 0.5, Some(7.0), Some(4.6), Some(15.8)),
        ("torus", 1.5, Some(9.0), Some(9.0), Some(std::f64::consts::PI * (20.25 - 2.25))),
        ("triangle", 0.5, Some(7.0), Some(5.0), Some(10.8)),
        ("wave1", 0.3, None, Some(14.0), None),
    ];
    for (name, z, x_mm, y_mm, area) in rows {
        let (a, x, y) = section(&*load(name, 0.0), z, 0.02);
        // 0.05 mm: the table was measured on faceted solids, and sharp corners fall between cells.
        for (what, got, want) in [("x", x, x_mm), ("y", y, y_mm)] {
            if let Some(want) = want {
                assert!(
                    (got - want).abs() < f64::max(0.05, 0.015 * want),
                    "{name} at {z}: {what} {got:.3}, table {want}"
                );
            }
        }
        if let Some(want) = area {
            assert!((a - want).abs() < 0.006 * want, "{name} at {z}: area {a:.3}, table {want}");
        }
    }
}

#[test]
fn dots_are_five_caps_on_a_pentagon() {
    let dots = load("dots", 0.0);
    for i in 0..5 {
        let c = DVec2::from_angle(std::f64::consts::TAU * f64::from(i) / 5.0) * 3.0;
        assert!(dots.lower_surface(c.x, c.y).unwrap().abs() < 1e-12);
        let q = c * (3.6 / 3.0);
        assert!((dots.lower_surface(q.x, q.y).unwrap() - 0.2).abs() < 1e-9);
    }
    assert_eq!(dots.lower_surface(0.0, 0.0), None);
    // 0.05 mm deep: five caps of radius^2 = 2 R d - d^2.
    let (area, ..) = section(&*dots, 0.05, 0.01);
    assert!((area - 5.0 * std::f64::consts::PI * 0.0975).abs() < 0.01, "{area}");
}

#[test]
fn the_cavity_of_dot_in_is_a_hemisphere() {
    let body = load("dot_in", 0.0);
    assert!((body.lower_surface(0.0, 0.0).unwrap() - 2.0).abs() < 1e-9);
    assert!((body.lower_surface(1.2, 0.0).unwrap() - 1.6).abs() < 1e-9);
    assert!(body.lower_surface(3.0, 3.0).unwrap().abs() < 1e-12);
    assert_eq!(body.lower_surface(4.1, 0.0), None);
}

#[test]
fn the_wave_is_asymmetric_and_its_crests_touch() {
    let body = load("wave1", 0.0);
    let heights: Vec<f64> =
        (0..400).map(|i| body.lower_surface(-2.0 + 0.01 * f64::from(i), 0.0).unwrap()).collect();
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let crest = heights.iter().position(|&h| h == lowest).unwrap();
    assert!(lowest.abs() < 1e-4 && (crest as f64 * 0.01 - 2.0).abs() > 0.2, "crest at {crest}");
    // The same height is reached sooner on the steep flank.
    let left = heights[..crest].iter().rev().position(|&h| h > 0.5).unwrap();
    let right = heights[crest..].iter().position(|&h| h > 0.5).unwrap();
    assert!(left * 5 < right * 4, "{left} against {right}");
}

#[test]
fn tips_are_at_zero_and_bodies_within_their_extent_for_every_round() {
    for name in ALL {
        for round in [0.0, 0.1, 0.3] {
            let body = load(name, round);
            assert_eq!(body.name(), name);
            let [hx, hy] = body.half_extent_mm();
            let mut lowest = f64::INFINITY;
            for j in 0..=120 {
                for i in 0..=120 {
                    let (x, y) =
                        (f64::from(i - 60) / 60.0 * (hx + 0.2), f64::from(j - 60) / 60.0 * (hy + 0.2));
                    let Some(z) = body.lower_surface(x, y) else { continue };
                    assert!(x.abs() <= hx + 1e-9 && y.abs() <= hy + 1e-9, "{name}: body beyond its extent");
                    assert!(z > -1e-9, "{name}: {z} below the tip");
                    // The height is on the surface: nothing of the body is nearer than it says.
                    let d = body.distance(DVec3::new(x, y, z));
                    assert!(
                        d.abs() < 1e-6,
                        "{name} round {round} at {x} {y}: lower surface {z} has distance {d}"
                    );
                    lowest = lowest.min(z);
                }
            }
            assert!(lowest < 0.02, "{name} round {round}: lowest sampled point {lowest}");
        }
    }
}

#[test]
fn rounding_keeps_faces_and_removes_only_what_is_at_edges() {
    for name in
        ["cylinder", "cylinder_shell", "flat_slab", "prism", "line", "parallel_lines", "dot_in", "hexagon"]
    {
        let (sharp, round) = (load(name, 0.0), load(name, 0.3));
        let [sx, sy] = sharp.half_extent_mm();
        let [rx, ry] = round.half_extent_mm();
        assert!((sy - ry).abs() < 1e-6, "{name}: {sy} became {ry}");
        // Only a hexagon's corners lose width: 0.3 (1/cos 30 - 1) each.
        let lost =
            if name == "hexagon" { 0.3 * (1.0 / (std::f64::consts::PI / 6.0).cos() - 1.0) } else { 0.0 };
        assert!((sx - rx - lost).abs() < 1e-6, "{name}: {sx} became {rx}");
    }
    // The quarter circle at the edge of the disc, exactly.
    let disc = load("cylinder", 0.3);
    assert!(disc.lower_surface(2.7, 0.0).unwrap().abs() < 1e-12);
    assert!((disc.lower_surface(2.85, 0.0).unwrap() - (0.3 - (0.09f64 - 0.0225).sqrt())).abs() < 1e-12);
    // The rim of a cavity: a ball of radius 0.3 resting against the face and the sphere.
    let dot = load("dot_in", 0.3);
    let centre = (2.3f64 * 2.3 - 0.09).sqrt();
    assert!(dot.lower_surface(centre, 0.0).unwrap().abs() < 1e-9);
    assert!(
        (dot.lower_surface(centre - 0.15, 0.0).unwrap() - (0.3 - (0.09f64 - 0.0225).sqrt())).abs() < 1e-9
    );
}

/// Random points within `reach` of the surface and of the middle of a box.
fn near(body: &dyn Indenter, middle: DVec3, half: DVec3, count: usize, reach: f64) -> Vec<DVec3> {
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
    };
    let all = std::iter::repeat_with(|| middle + half * DVec3::new(random(), random(), random()));
    all.take(200_000).filter(|&p| body.distance(p).abs() < reach).take(count).collect()
}

#[test]
fn gradients_are_unit_and_match_finite_differences() {
    for name in ALL {
        for round in [0.0, 0.3] {
            let body = load(name, round);
            let mut creases = 0;
            let [hx, hy] = body.half_extent_mm();
            for p in near(&*body, DVec3::Z, DVec3::new(hx + 0.3, hy + 0.3, 1.5), 400, 0.3) {
                let (d, n) = body.distance_and_normal(p);
                assert_eq!(d, body.distance(p));
                assert!((n.length() - 1.0).abs() < 1e-9, "{name}: |n| = {}", n.length());
                let h = 1e-5;
                let difference =
                    |axis: DVec3| (body.distance(p + axis * h) - body.distance(p - axis * h)) / (2.0 * h);
                let g = DVec3::new(difference(DVec3::X), difference(DVec3::Y), difference(DVec3::Z));
                // On the medial axis (inside, between two faces) there is no gradient to match.
                creases += usize::from((g - n).length() > 1e-4);
            }
            assert!(creases <= 4, "{name} round {round}: {creases} of 400 gradients differ");
        }
    }
}

#[test]
fn distances_agree_with_the_nearest_sampled_surface_point() {
    // Surface samples: a fine grid, each point brought onto the zero set along the gradient.
    let step = 0.04;
    for name in ALL {
        for round in [0.0, 0.3] {
            let body = load(name, round);
            let [hx, hy] = body.half_extent_mm();
            // A window with faces, edges and corners of every shape, small enough to sample densely.
            let y = [0.5 * hy.min(3.2), 0.0].into_iter().find(|&y| {
                (0..90).any(|i| body.lower_surface(0.05 * f64::from(i), y).is_some_and(|z| z < 0.5))
            });
            let y = y.expect("something is low");
            let low = |i: &i32| body.lower_surface(0.05 * f64::from(*i), y).is_some_and(|z| z < 0.5);
            let middle =
                DVec3::new(0.05 * f64::from((0..(hx.min(4.5) / 0.05) as i32).rfind(low).unwrap()), y, 0.4);
            let mut cloud: BTreeMap<[i64; 3], Vec<DVec3>> = BTreeMap::new();
            let cell = |p: DVec3| (p / 0.25).floor().as_i64vec3().to_array();
            let n = (1.2 / step) as i64;
            for (k, j, i) in
                (-n..=n).flat_map(|k| (-n..=n).flat_map(move |j| (-n..=n).map(move |i| (k, j, i))))
            {
                let mut p = middle + DVec3::new(i as f64, j as f64, k as f64) * step;
                if body.distance(p).abs() > step {
                    continue;
                }
                for _ in 0..6 {
                    let (d, n) = body.distance_and_normal(p);
                    p -= n * d;
                }
                if body.distance(p).abs() < 1e-9 {
                    cloud.entry(cell(p)).or_default().push(p);
                }
            }
            let mut compared = 0;
            for p in near(&*body, middle, DVec3::splat(0.85), 300, 0.2) {
                // Inside a union the distance is a bound: here, where the two layers of ridges meet.
                if name == "cross_lines" && p.z > 0.7 && body.distance(p) < 0.0 {
                    continue;
                }
                let c = cell(p);
                let mut brute = f64::INFINITY;
                for dk in -1..=1 {
                    for dj in -1..=1 {
                        for di in -1..=1 {
                            for q in cloud.get(&[c[0] + di, c[1] + dj, c[2] + dk]).into_iter().flatten() {
                                brute = brute.min(p.distance(*q));
                            }
                        }
                    }
                }
                let d = body.distance(p).abs();
                // Sampling can only overestimate, by less than a cell.
                assert!(
                    d <= brute + 1e-9 && brute - d < 1.2 * step,
                    "{name} round {round} at {p}: distance {d:.4}, nearest sample {brute:.4}"
                );
                compared += 1;
            }
            assert!(compared > 100, "{name} round {round}: only {compared} points compared");
        }
    }
}

#[test]
fn a_round_that_does_not_fit_is_refused_with_the_largest_that_does() {
    let error = from_spec("line", &spec("line"), Some(1.2)).unwrap_err();
    let Error::RoundTooLarge { largest_mm, .. } = &error else { panic!("{error}") };
    assert!((largest_mm - 1.0).abs() < 0.01, "{largest_mm}");
    assert!(error.to_string().contains("choose edge_round_mm below"), "{error}");
    // Nothing is left of a bead that is rounded by its own radius.
    let bead = Shape::Dome { radius_mm: 0.3, diameter_mm: 0.6 };
    let bead = IndenterSpec { shape: bead, ..spec("line") };
    assert!(matches!(from_spec("bead", &bead, Some(0.3)), Err(Error::RoundTooLarge { .. })));
    let rounded = from_spec("bead", &bead, Some(0.29)).expect("a tip is left");
    assert!(rounded.half_extent_mm()[0] < 0.31 && rounded.distance(DVec3::new(0.0, 0.0, -1.0)) > 0.9);
}

#[test]
fn every_wrong_number_is_reported_with_its_key() {
    let bad: IndenterSpec = toml::from_str(
        "edge_round_mm = -1\n[shape]\nkind = \"flat\"\nplan = { kind = \"ring\", outer_diameter_mm = 3, inner_diameter_mm = 4 }",
    )
    .unwrap();
    let error = from_spec("ring", &bad, None).unwrap_err().to_string();
    assert!(
        error.contains("edge_round_mm = -1") && error.contains("shape.plan.inner_diameter_mm = 4"),
        "{error}"
    );
    let crossed: IndenterSpec = toml::from_str(
        "[shape]\nkind = \"flat\"\nplan = { kind = \"polygon\", corners_mm = [[0, 0], [2, 2], [2, 0], [0, 2]] }",
    )
    .unwrap();
    assert!(from_spec("bow", &crossed, None).unwrap_err().to_string().contains("cross"));
    assert!(
        toml::from_str::<IndenterSpec>("[shape]\nkind = \"dome\"\nradius_mm = 1\ndiameter_mm = 2\nround = 3")
            .is_err()
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn distance_never_changes_faster_than_the_point_moves(
        which in 0usize..21,
        rounded in any::<bool>(),
        a in prop::array::uniform3(-9.0f64..9.0),
        step in prop::array::uniform3(-1.0f64..1.0),
    ) {
        let body = load(ALL[which], if rounded { 0.3 } else { 0.0 });
        let (p, q) = (DVec3::from(a), DVec3::from(a) + DVec3::from(step));
        prop_assert!((body.distance(p) - body.distance(q)).abs() <= p.distance(q) + 1e-9);
    }

    #[test]
    fn an_eroded_polygon_is_where_the_distance_says(
        radii in prop::collection::vec(1.5f64..4.0, 3..9),
        by in 0.02f64..0.6,
        at in prop::array::uniform2(-4.0f64..4.0),
    ) {
        let n = radii.len() as f64;
        let corners: Vec<DVec2> = radii
            .iter()
            .enumerate()
            .map(|(i, &r)| DVec2::from_angle(std::f64::consts::TAU * i as f64 / n) * r)
            .collect();
        let whole = outline::Outline::polygon(&corners);
        let core = whole.eroded(by);
        let p = DVec2::from(at);
        let (outer, inner) = (whole.distance(p).0, if core.is_empty() { f64::INFINITY } else { core.distance(p).0 });
        if (outer + by).abs() > 1e-6 {
            prop_assert_eq!(outer < -by, inner < 0.0, "whole {} core {}", outer, inner);
        }
        // Inside, the two distances differ by exactly the erosion.
        if outer < -by {
            prop_assert!((inner - (outer + by)).abs() < 1e-6);
        }
    }
}
