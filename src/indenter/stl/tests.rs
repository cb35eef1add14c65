//! Meshes against the parametric solids they are cut from, and one broken file for every defect.

use super::*;
use crate::indenter::{self, Indenter, IndenterSpec};
use std::f64::consts::TAU;

type Triangles = Vec<[DVec3; 3]>;

fn quad(out: &mut Triangles, a: DVec3, b: DVec3, c: DVec3, d: DVec3) {
    out.extend([[a, b, c], [a, c, d]]);
}

/// A box from `low` to `high`, outward faces.
fn cuboid(low: DVec3, high: DVec3) -> Triangles {
    let v = |x: f64, y: f64, z: f64| low + (high - low) * DVec3::new(x, y, z);
    let mut t = Vec::new();
    quad(&mut t, v(0., 0., 0.), v(0., 1., 0.), v(1., 1., 0.), v(1., 0., 0.));
    quad(&mut t, v(0., 0., 1.), v(1., 0., 1.), v(1., 1., 1.), v(0., 1., 1.));
    quad(&mut t, v(0., 0., 0.), v(1., 0., 0.), v(1., 0., 1.), v(0., 0., 1.));
    quad(&mut t, v(0., 1., 0.), v(0., 1., 1.), v(1., 1., 1.), v(1., 1., 0.));
    quad(&mut t, v(0., 0., 0.), v(0., 0., 1.), v(0., 1., 1.), v(0., 1., 0.));
    quad(&mut t, v(1., 0., 0.), v(1., 1., 0.), v(1., 1., 1.), v(1., 0., 1.));
    t
}

/// A torus about z with its lowest point at 0.
fn torus(n: usize, m: usize) -> Triangles {
    let point = |i: usize, j: usize| {
        let (u, v) = (TAU * (i % n) as f64 / n as f64, TAU * (j % m) as f64 / m as f64);
        let rho = 3.0 + 1.5 * v.cos();
        DVec3::new(rho * u.cos(), rho * u.sin(), 1.5 + 1.5 * v.sin())
    };
    let mut t = Vec::new();
    for i in 0..n {
        for j in 0..m {
            quad(&mut t, point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1));
        }
    }
    t
}

fn binary(triangles: &Triangles) -> Vec<u8> {
    // The header begins like an ASCII file, as many exporters write it.
    let mut bytes = b"solid but binary".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        bytes.extend([0u8; 12]);
        for c in t.iter().flat_map(|v| v.to_array()) {
            bytes.extend((c as f32).to_le_bytes());
        }
        bytes.extend([0u8; 2]);
    }
    bytes
}

fn ascii(triangles: &Triangles) -> Vec<u8> {
    let mut text = String::from("solid test\n");
    for t in triangles {
        text += "  facet normal 0 0 0\n    outer loop\n";
        for v in t {
            text += &format!("      vertex {} {} {}\n", v.x, v.y, v.z);
        }
        text += "    endloop\n  endfacet\n";
    }
    (text + "endsolid test\n").into_bytes()
}

fn load_bytes(bytes: &[u8], unit: LengthUnit, tip: TipEnd) -> Result<Mesh, Defect> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.stl");
    std::fs::write(&path, bytes).unwrap();
    load("mesh", &path, unit, tip, Centre::Bounds, None).map_err(|e| {
        assert!(e.to_string().contains("mesh.stl "));
        e.defect
    })
}

fn load_mm(triangles: &Triangles) -> Result<Mesh, Defect> {
    load_bytes(&binary(triangles), LengthUnit::Millimetre, TipEnd::MinusZ)
}

#[test]
fn a_box_has_the_distance_of_a_box_at_faces_edges_and_corners() {
    let prism: IndenterSpec =
        toml::from_str("[shape]\nkind = \"flat\"\nplan = { kind = \"rectangle\", x_mm = 5, y_mm = 7 }")
            .unwrap();
    let exact = indenter::from_spec("prism", &prism, None).unwrap();
    let mesh = load_mm(&cuboid(DVec3::new(-2.5, -3.5, 0.0), DVec3::new(2.5, 3.5, 8.0))).unwrap();
    assert_eq!(mesh.half_extent_mm(), [2.5, 3.5]);
    for k in 0..12 {
        for j in 0..21 {
            for i in 0..21 {
                let p =
                    DVec3::new(0.37 * f64::from(i - 10), 0.41 * f64::from(j - 10), 0.83 * f64::from(k) - 0.9);
                let ((d, n), (e, m)) = (mesh.distance_and_normal(p), exact.distance_and_normal(p));
                assert!((d - e).abs() < 1e-9, "at {p}: mesh {d}, exact {e}");
                if e > 0.0 {
                    assert!((n - m).length() < 1e-9, "at {p}: mesh {n}, exact {m}");
                }
                let (low, exact_low) = (mesh.lower_surface(p.x, p.y), exact.lower_surface(p.x, p.y));
                assert_eq!(low.is_some(), exact_low.is_some());
                assert!(low.is_none_or(|z| z.abs() < 1e-12));
            }
        }
    }
}

#[test]
fn a_fine_torus_mesh_agrees_with_the_torus_within_its_facets() {
    let mesh = load_mm(&torus(256, 128)).unwrap();
    for i in 0..2000 {
        let t = f64::from(i);
        let p =
            DVec3::new(5.0 * (t * 0.37).sin(), 5.0 * (t * 0.73).cos(), 4.0 * (t * 0.11).sin().abs() - 0.5);
        let exact = (p.x.hypot(p.y) - 3.0).hypot(p.z - 1.5) - 1.5;
        let (d, n) = mesh.distance_and_normal(p);
        // Sagitta of the facets: R (1 - cos(pi / n)).
        assert!((d - exact).abs() < 1.5e-3, "at {p}: mesh {d}, exact {exact}");
        assert!((n.length() - 1.0).abs() < 1e-12);
    }
    let exact_low = 1.5 - (2.25f64 - 0.25).sqrt();
    assert!((mesh.lower_surface(2.5, 0.0).unwrap() - exact_low).abs() < 1e-3);
    assert_eq!(mesh.lower_surface(0.0, 0.0), None);
}

#[test]
fn ascii_metres_inside_out_and_upside_down_give_the_same_body() {
    let upright = cuboid(DVec3::new(1.0, 1.0, 0.0), DVec3::new(3.0, 5.0, 6.0));
    let reference = load_mm(&upright).unwrap();
    let text = load_bytes(&ascii(&upright), LengthUnit::Millimetre, TipEnd::MinusZ).unwrap();
    let inside_out = load_mm(&upright.iter().map(|t| [t[0], t[2], t[1]]).collect()).unwrap();
    let metres: Triangles = upright.iter().map(|t| t.map(|v| v * 1e-3)).collect();
    let metres = load_bytes(&binary(&metres), LengthUnit::Metre, TipEnd::MinusZ).unwrap();
    let turned: Triangles = upright.iter().map(|t| t.map(|v| DVec3::new(v.x, -v.y, -v.z))).collect();
    let turned = load_bytes(&binary(&turned), LengthUnit::Millimetre, TipEnd::PlusZ).unwrap();
    for p in [DVec3::new(0.2, 0.3, -0.4), DVec3::new(1.3, -2.2, 0.5), DVec3::new(0.9, 1.9, 0.05)] {
        let d = reference.distance(p);
        for other in [&text, &inside_out, &metres, &turned] {
            assert!((other.distance(p) - d).abs() < 1e-5, "{} {d}", other.distance(p));
        }
    }
}

#[test]
fn every_defect_is_named() {
    let whole = cuboid(DVec3::ZERO, DVec3::splat(4.0));
    let message = |r: Result<Mesh, Defect>| r.map(|_| ()).unwrap_err().to_string();
    let mm = LengthUnit::Millimetre;

    let open = message(load_mm(&whole[1..].to_vec()));
    assert!(open.contains("not watertight: 3 open edges, the first from ["), "{open}");

    let mut fin = whole.clone();
    fin.push([whole[0][0], whole[0][1], DVec3::new(0.0, 0.0, 9.0)]);
    assert!(
        message(load_mm(&fin)).contains("more than two triangles at 1 edge, the first from [0, 0, 0] to [")
    );

    let mut flipped = whole.clone();
    flipped[0].swap(1, 2);
    assert!(message(load_mm(&flipped)).contains("face opposite ways"));

    assert!(message(load_mm(&Vec::new())).contains("holds no triangle"));
    assert!(message(load_mm(&vec![[DVec3::ONE; 3]])).contains("of 1 given, all are degenerate"));

    let mut nan = whole.clone();
    nan[3][1].y = f64::NAN;
    assert!(message(load_mm(&nan)).contains("not a finite number, in triangle 3"));

    let metres: Triangles = whole.iter().map(|t| t.map(|v| v * 1e-3)).collect();
    let guess = load_mm(&metres).map(|_| ()).unwrap_err();
    assert!(guess.to_string().contains("0.0040 mm across when read in mm"), "{guess}");
    assert!(
        guess.advice().contains("unit = \"m\"") && guess.allowed().contains("0.5 to 200 mm"),
        "{guess:?}"
    );

    let cut = &binary(&whole)[..400];
    assert!(
        message(load_bytes(cut, mm, TipEnd::MinusZ))
            .contains("is cut short: 12 triangles need 684 bytes, there are 400")
    );
    assert!(message(load_bytes(b"PK\x03\x04", mm, TipEnd::MinusZ)).contains("is not an STL file"));
    assert!(message(load_bytes(&[0xff; 300], mm, TipEnd::MinusZ)).contains("is not an STL file"));
    assert!(message(load_bytes(b"solid x\nvertex 1 2 nonsense\n", mm, TipEnd::MinusZ)).contains("line 2"));

    let missing = load("mesh", Path::new("/nonexistent/a.stl"), mm, TipEnd::MinusZ, Centre::Bounds, None);
    assert!(missing.map(|_| ()).unwrap_err().to_string().contains("cannot be read"));
}

#[test]
fn a_defect_is_the_problem_and_its_own_advice_the_next_move() {
    let (from, to) = (DVec3::new(-1.0 / 3.0, -1e-9, 2.0), DVec3::new(0.1 + 0.2, 0.0, 1e-4));
    let told = |defect| {
        let source = Error { path: "open.stl".into(), defect };
        indenter::Error::Stl { name: "open".to_owned(), source }.problem("indenters[0]")
    };
    let open = told(Defect::OpenEdges { count: 1, from, to });
    let places = "the first from [-0.333333, 0, 2] to [0.3, 0, 0.0001] (file units)";
    assert_eq!(open.value, format!("open: open.stl is not watertight: 1 open edge, {places}"));
    assert_eq!((&*open.key, &*open.allowed), ("indenters[0]", "a closed mesh that bounds a solid"));
    assert!(open.next.starts_with("close the holes"), "{}", open.next);
    let crossing = told(Defect::Crossing { from, to }).value;
    assert!(crossing.contains("from [-0.333, 0, 2] to [0.3, 0, 0] (mm"), "{crossing}");
}

/// A sphere about (x, 0, 4), its triangles turned inwards if asked.
fn ball(x: f64, radius: f64, inwards: bool) -> Triangles {
    let (n, m) = (24, 12);
    let point = |i: usize, j: usize| {
        let (u, v) = (TAU * (i % n) as f64 / n as f64, 0.5 * TAU * j as f64 / m as f64);
        DVec3::new(x, 0.0, 4.0) + radius * DVec3::new(v.sin() * u.cos(), v.sin() * u.sin(), -v.cos())
    };
    let mut t = Vec::new();
    for i in 0..n {
        for j in 0..m {
            quad(&mut t, point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j));
        }
    }
    if inwards {
        t.iter_mut().for_each(|t| t.swap(1, 2));
    }
    t
}

#[test]
fn what_bounds_no_solid_is_refused_and_cavities_are_filled() {
    let both = |a: Triangles, b: Triangles| load_mm(&[a, b].concat());
    let message = |r: Result<Mesh, Defect>| r.map(|_| ()).unwrap_err().to_string();
    let (low, high) = (DVec3::new(-2.0, -2.0, 0.0), DVec3::new(2.0, 2.0, 4.0));
    let whole = cuboid(low, high);

    // Boxes through each other: askew, and with faces in common planes.
    let askew = cuboid(DVec3::new(0.3, -1.1, 1.3), DVec3::new(5.0, 1.2, 3.1));
    assert!(message(both(whole.clone(), askew)).contains("cuts through itself: the edge from ["));
    let flush = cuboid(low + DVec3::X, high + 2.0 * DVec3::X);
    assert!(message(both(whole.clone(), flush)).contains("(of 2) that lies in another"));
    // A corner pulled through the opposite face.
    let twisted =
        whole.iter().map(|t| t.map(|v| if v == low { DVec3::new(0.7, 0.4, 9.0) } else { v })).collect();
    assert!(message(load_mm(&twisted)).contains("cuts through itself"));
    // One in another, and one inside out beside another.
    assert!(message(both(ball(0.0, 3.0, false), ball(0.0, 2.0, false))).contains("lies in another"));
    assert!(message(both(ball(0.0, 3.0, false), ball(7.0, 2.5, true))).contains("is inside out"));

    // Beside each other they are fine; and a hollow ball is as a full one.
    assert!(both(ball(0.0, 3.0, false), ball(7.0, 2.5, false)).is_ok());
    let hollow = both(ball(0.0, 3.0, false), ball(0.0, 2.9, true)).unwrap();
    // (Its facets lie nearer to the middle than its corners.)
    assert!((hollow.distance(DVec3::new(0.0, 0.0, 3.0)) + 3.0).abs() < 0.15);
    assert!((hollow.height_mm() - 6.0).abs() < 1e-6);
}

#[test]
fn surfaces_that_fold_back_enclose_nothing_and_thin_bodies_something() {
    let refused = |t: Triangles| match load_mm(&t) {
        Err(Defect::Flat { parts, thickness_mm, .. }) => (parts, thickness_mm < 1e-4),
        other => panic!("{:?}", other.map(|_| ())),
    };
    let [a, b, c, d] =
        [[-3.1, -2.7, 0.3], [4.3, -1.9, 2.9], [3.7, 2.3, 4.1], [-3.7, 1.5, 1.5]].map(DVec3::from);
    // Both sides of a triangle, slanted, lying and upright.
    for place in [DVec3::ONE, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 0.0, 1.0)] {
        let t = [a, b, c].map(|v| v * place);
        assert_eq!(refused(vec![t, [t[0], t[2], t[1]]]), (1, true));
    }
    // Both sides of a rectangle, each cut along another diagonal: coordinates are rounded, so a little is enclosed.
    let slanted = |x: f64, y: f64| a + (b - a) * x + (d - a) * y;
    let [p, q, r, s] = [slanted(0.0, 0.0), slanted(1.0, 0.0), slanted(1.0, 1.0), slanted(0.0, 1.0)];
    let sheet = vec![[p, q, r], [p, r, s], [p, s, q], [q, s, r]];
    assert_eq!(refused(sheet.clone()), (1, true));
    // A sheet beside a body.
    let beside = sheet.iter().map(|t| t.map(|v| v + 20.0 * DVec3::X)).collect();
    assert_eq!(refused([cuboid(DVec3::ZERO, DVec3::splat(4.0)), beside].concat()), (2, true));

    // Foils of 20 um, lying and standing, and a needle.
    for size in [[10.0, 10.0, 0.02], [10.0, 0.02, 6.0], [0.01, 0.01, 20.0]] {
        let body = load_mm(&cuboid(DVec3::ZERO, DVec3::from(size))).unwrap();
        assert!((body.height_mm() - size[2]).abs() < 1e-6);
    }
}

#[test]
fn a_spec_names_a_mesh_relative_to_its_file_and_refuses_to_round_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cube.stl"), binary(&cuboid(DVec3::ZERO, DVec3::splat(4.0)))).unwrap();
    let mut spec: IndenterSpec =
        toml::from_str("[shape]\nkind = \"stl\"\npath = \"cube.stl\"\nunit = \"mm\"\ntip = \"+z\"").unwrap();
    spec.resolve(folder.path());
    let cube = indenter::from_spec("cube", &spec, None).unwrap();
    assert!((cube.distance(DVec3::new(0.0, 0.0, -1.0)) - 1.0).abs() < 1e-9);
    let error = indenter::from_spec("cube", &spec, Some(0.3)).unwrap_err().to_string();
    assert!(error.contains("edges of a mesh cannot be rounded"), "{error}");
}

#[test]
fn a_large_mesh_is_checked_once_and_comes_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (path, kept) = (folder.path().join("ring.stl"), folder.path().join("kept"));
    let store = Store::new(&kept, &kept::KIND);
    let load = |tip| load("ring", &path, LengthUnit::Millimetre, tip, Centre::Bounds, Some(&store)).unwrap();
    let files = || std::fs::read_dir(&kept).map_or(0, Iterator::count);
    let places =
        (0..40).map(|k| DVec3::new(0.1 * f64::from(k), 0.07 * f64::from(k) - 1.0, 0.05 * f64::from(k)));
    let places: Vec<DVec3> = places.collect();
    let distances = |mesh: &Mesh| places.iter().map(|p| mesh.distance(*p).to_bits()).collect::<Vec<_>>();

    // A small one is not worth a file.
    std::fs::write(&path, binary(&torus(60, 40))).unwrap();
    load(TipEnd::MinusZ);
    assert_eq!(files(), 0);

    let bytes = binary(&torus(150, 71));
    assert!(bytes.len() >= kept::WORTH_KEEPING);
    std::fs::write(&path, &bytes).unwrap();
    let first = load(TipEnd::MinusZ);
    assert_eq!(files(), 1);
    assert_eq!(distances(&load(TipEnd::MinusZ)), distances(&first));
    // Turned over it is another solid.
    load(TipEnd::PlusZ);
    assert_eq!(files(), 2);

    // What is kept is what is used, as long as it is whole.
    let key = kept::key(&bytes, LengthUnit::Millimetre, TipEnd::MinusZ, Centre::Bounds);
    let cube = topology::close(&cuboid(DVec3::ZERO, DVec3::splat(4.0))).unwrap();
    store.keep(&key, &kept::encode(&cube));
    assert_eq!(load(TipEnd::MinusZ).height_mm(), 4.0);
    let file = kept.join(format!("{}.bin", blake3::Hash::from(key).to_hex()));
    let mut torn = std::fs::read(&file).unwrap();
    torn[120] ^= 1;
    std::fs::write(&file, torn).unwrap();
    assert_eq!(distances(&load(TipEnd::MinusZ)), distances(&first));
    // And the torn file was made anew.
    assert_eq!(store.take(&key, kept::decode).unwrap().triangles.len(), 150 * 71 * 2);
}

#[test]
fn bytes_that_are_no_solid_are_none() {
    let cube = topology::close(&cuboid(DVec3::ZERO, DVec3::splat(4.0))).unwrap();
    let bytes = kept::encode(&cube);
    assert_eq!(kept::decode(&bytes), Some(cube));
    for end in 0..bytes.len() {
        let cut = kept::decode(&bytes[..end]);
        assert!(cut.is_none_or(|c| c.triangles.len() < 12), "cut at {end}");
    }
    let mut beyond = bytes.clone();
    *beyond.last_mut().unwrap() = 9;
    assert_eq!(kept::decode(&beyond), None);
    beyond[..8].fill(255);
    assert_eq!(kept::decode(&beyond), None);
}

#[test]
fn corners_are_welded_across_cells_and_no_further_than_the_tolerance() {
    // Along a line, each in five copies that are up to a third of a millionth of the size apart.
    let size = 10.0;
    let mut t = cuboid(DVec3::ZERO, DVec3::splat(size));
    for (k, corner) in t.iter_mut().flatten().enumerate() {
        *corner += DVec3::new((k % 5) as f64 - 2.0, (k % 3) as f64 - 1.0, (k % 2) as f64) * 1e-6;
    }
    let welded = topology::close(&t).unwrap();
    assert_eq!((welded.vertices.len(), welded.triangles.len()), (8, 12));
    for (k, corner) in t.iter_mut().flatten().enumerate() {
        *corner += DVec3::splat(1e-4 * (k % 7) as f64);
    }
    assert!(matches!(topology::close(&t), Err(Defect::OpenEdges { .. })));
}

/// A fin of this thickness and height along y below a block 4 mm wide and 2 mm high, 3 mm long.
fn fin_under_a_block(thick: f64, high: f64) -> Triangles {
    let half = 0.5 * thick;
    let profile = [
        (-half, 0.0),
        (half, 0.0),
        (half, high),
        (2.0, high),
        (2.0, 2.0),
        (half, 2.0),
        (-half, 2.0),
        (-2.0, 2.0),
        (-2.0, high),
        (-half, high),
    ];
    let at = |k: usize, y: f64| DVec3::new(profile[k % 10].0, y, profile[k % 10].1);
    let mut t = Vec::new();
    for k in 0..10 {
        quad(&mut t, at(k, -1.5), at(k + 1, -1.5), at(k + 1, 1.5), at(k, 1.5));
    }
    for [a, b, c, d] in [[0, 1, 2, 9], [9, 2, 5, 6], [2, 3, 4, 5], [8, 9, 6, 7]] {
        quad(&mut t, at(a, -1.5), at(d, -1.5), at(c, -1.5), at(b, -1.5));
        quad(&mut t, at(a, 1.5), at(b, 1.5), at(c, 1.5), at(d, 1.5));
    }
    t
}

#[test]
fn a_fin_is_found_under_the_block_that_hides_it() {
    for (thick, high) in [(0.01, 0.5), (0.04, 0.15), (0.08, 1.0)] {
        let body = load_mm(&fin_under_a_block(thick, high)).expect("a solid");
        let thin = body.thin_parts();
        assert!(thin.len() >= 27, "{thick} {high}: {}", thin.len());
        let astray: Vec<_> = thin.iter().filter(|p| p.x.abs() > 0.5 * thick || p.z.abs() > 1e-6).collect();
        assert!(astray.is_empty(), "{thick} {high}: {astray:?}");
    }
    let wide = load_mm(&fin_under_a_block(0.3, 0.5)).expect("a solid");
    assert_eq!(wide.thin_parts(), []);
}
