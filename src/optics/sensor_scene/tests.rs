use super::*;
use crate::optics::fast::TOLERANCES;
use crate::optics::imager::{Imager, Method, Notice};
use crate::optics::reference::{Renderer, Settings, Sight};
use crate::optics::render_file::{Mode, Request, render_sensor};
use crate::optics::sensor::{BaffleShapeSpec, BaffleSpec, LensSpec, PlateSpec};
use crate::optics::{Film, bench_scene::Variant};

/// A box of 16 mm with a light on the left wall near the face and one high on the right.
fn sensor(rest: &str) -> SensorOptics {
    let light = |name: &str, x: f64, z: f64| {
        format!(
            "[[lights]]\nname = \"{name}\"\nshape = {{ kind = \"rectangle\", center_mm = [{x:?}, 0.0, {z:?}], \
             facing = [{:?}, 0.0, 0.0], size_mm = [6.0, 2.0] }}\nrgb = [255.0, 255.0, 255.0]\nenergy = 1000.0\n",
            -x.signum()
        )
    };
    toml::from_str(&format!(
        "max_events = 12\n[camera]\nwidth_px = 24\nheight_px = 18\nmm_per_px = 0.5\ndistance_mm = 12.0\n[housing]\n\
         x_mm = [-8.0, 8.0]\ny_mm = [-8.0, 8.0]\nheight_mm = 14.0\nalbedo = 0.4\n{}{}{rest}",
        light("low", -7.999, -2.5),
        light("high", 7.999, -11.0)
    ))
    .unwrap()
}

fn lens(front_radius_mm: Option<f64>, ior: f64) -> LensSpec {
    LensSpec { gap_mm: 4.0, thickness_mm: 5.0, diameter_mm: 15.0, front_radius_mm, back_radius_mm: None, ior }
}

fn request(mode: Mode) -> Request {
    Request {
        variant: Variant::Ac,
        mode,
        samples: 4,
        tolerance: 0.01,
        seed: 0,
        size: None,
        repeat: 1,
        basis: false,
        store: None,
    }
}

fn flat() -> DisplacedSurface {
    DisplacedSurface::flat(33, 33, [16.0, 16.0])
}

fn renderer(sensor: &SensorOptics) -> Renderer {
    Renderer::new(&scene(sensor, &flat(), None).unwrap()).unwrap()
}

fn render(sensor: &SensorOptics, samples: u32, seed: u32) -> Film {
    renderer(sensor).render(&Settings { samples, seed })
}

#[test]
fn a_lens_of_air_changes_nothing() {
    let without = sensor("");
    let mut with = without.clone();
    with.lens = Some(lens(Some(9.0), 1.0));
    assert!((camera_of(&with).tan_half_x / camera_of(&without).tan_half_x - 1.0).abs() < 1e-6);
    let (a, b) = (render(&without, 256, 1), render(&with, 1024, 2));
    // Two pictures of each tell their noise (through the lens the high light is found by chance alone), the square root of two
    // times that between one and one.
    let noise = a.relative_rmse(&render(&without, 256, 3)).hypot(b.relative_rmse(&render(&with, 1024, 4)));
    let error = b.relative_rmse(&a);
    assert!(error < 0.8 * noise && noise < 0.2, "{error} {noise}");
    let means = b.mean() / a.mean();
    assert!((means - Vec3::ONE).abs().max_element() < 0.01, "{means}");
    // Light by light as well.
    let by_light = |sensor: &SensorOptics, samples| {
        renderer(sensor)
            .render_lights(&Settings { samples, seed: 5 })
            .iter()
            .map(|f| f.mean().x)
            .collect::<Vec<_>>()
    };
    for (k, (a, b)) in by_light(&without, 256).into_iter().zip(by_light(&with, 1024)).enumerate() {
        assert!((b / a - 1.0).abs() < [0.01, 0.03][k], "light {k}: {b} {a}");
    }
}

#[test]
fn a_plate_of_air_is_no_part_of_the_scene_and_one_that_shows_is() {
    let without = sensor("");
    let with = |ior: f64, roughness: f64| {
        let plate =
            format!("[plate]\ngap_mm = 4.0\nthickness_mm = 2.0\nior = {ior:?}\nroughness = {roughness:?}\n");
        scene(&sensor(&plate), &flat(), None).unwrap()
    };
    assert_eq!(with(1.0, 0.0), scene(&without, &flat(), None).unwrap());
    for plate in [with(1.49, 0.0), with(1.0, 0.3)] {
        assert!(plate.surface(Role::Plate).is_some() && plate.max_events > without.max_events);
    }
}

#[test]
fn lights_are_still_found_through_a_plate_beside_a_lens() {
    let mut without = sensor("[plate]\ngap_mm = 0.5\nthickness_mm = 0.5\nior = 1.5\n");
    without.lights.truncate(1);
    let mut with = without.clone();
    with.lens = Some(lens(Some(9.0), 1.0));
    let pictures = |sensor: &SensorOptics| [6, 7].map(|seed| render(sensor, 512, seed));
    let ([a, b], [c, d]) = (pictures(&without), pictures(&with));
    let mean = |a: &Film, b: &Film| a.mean().x + b.mean().x;
    assert!((mean(&c, &d) / mean(&a, &b) - 1.0).abs() < 0.02, "{} {}", mean(&c, &d), mean(&a, &b));
    // By chance alone, as through a plate that is hardly frosted, the light is found with several times the noise. (What lies
    // behind the lens sees the light by chance in either.)
    let mut by_chance = with.clone();
    by_chance.plate.as_mut().unwrap().roughness = 0.04;
    let [e, f] = pictures(&by_chance);
    let noise = [c.relative_rmse(&d), e.relative_rmse(&f)];
    assert!(noise[1] > 2.0 * noise[0], "{noise:?}");
}

#[test]
fn pixels_see_through_a_lens_what_refraction_says() {
    let mut sensor = sensor("");
    let center = [0.5, -0.75];
    sensor.camera.center_mm = center;
    for lens in [
        lens(None, 1.5),
        lens(Some(14.0), 1.5),
        // A shell, and a lens that is hollow below.
        LensSpec { back_radius_mm: Some(-9.0), ..lens(Some(12.0), 1.6) },
        LensSpec { front_radius_mm: Some(-20.0), ..lens(None, 1.4) },
    ] {
        sensor.lens = Some(lens.clone());
        let line = Sightline::of(&sensor);
        let tan_half_x = f64::from(camera_of(&sensor).tan_half_x);
        let sights = renderer(&sensor).sights();
        let mut seen = 0;
        for (k, sight) in sights.iter().enumerate() {
            let at = [(k % 24) as f64 - 11.5, (k / 24) as f64 - 8.5];
            let tangent = at[0].hypot(at[1]) * tan_half_x / 12.0;
            let (Some(Sight { point, .. }), Some(r)) = (sight, line.meets(tangent, 0.0)) else { continue };
            let off = [f64::from(point.x) - center[0], f64::from(point.y) - center[1]];
            // Facets that bent light by their own normals would be off by hundredths.
            assert!((off[0].hypot(off[1]) - r).abs() < 2e-3, "{lens:?} {at:?}: {off:?} {r}");
            let turned = (off[0] * at[1] - off[1] * at[0]) / at[0].hypot(at[1]);
            assert!(turned.abs() < 2e-3, "{lens:?} {at:?}: {off:?}");
            seen += 1;
        }
        assert!(seen > 150, "{seen} {lens:?}");
        // Near the axis a pixel sees what its description says.
        let near = sights[9 * 24 + 12].unwrap();
        let mm_per_px = (f64::from(near.point.x) - center[0]) / 0.5;
        assert!((mm_per_px / sensor.camera.mm_per_px - 1.0).abs() < 5e-3, "{mm_per_px} {lens:?}");
    }
}

#[test]
fn a_sheet_before_a_light_hides_it() {
    let mut sensor = sensor("");
    sensor.max_events = 1;
    let by_light = |sensor: &SensorOptics| -> Vec<f32> {
        let films = renderer(sensor).render_lights(&Settings { samples: 64, seed: 5 });
        films.iter().map(|film| film.mean().x).collect()
    };
    let open = by_light(&sensor);
    let sheet = |name: &str, center_mm: [f64; 3], size_mm: [f64; 2]| BaffleSpec {
        name: name.to_owned(),
        shape: BaffleShapeSpec::Rectangle { center_mm, facing: [1.0, 0.0, 0.0], size_mm },
        albedo: 0.0,
    };
    sensor.baffles = vec![sheet("low", [-7.5, 0.0, -2.5], [10.0, 4.0])];
    let hidden = by_light(&sensor);
    assert!(
        hidden[0].abs() < 0.02 * open[0] && (hidden[1] / open[1] - 1.0).abs() < 0.03,
        "{hidden:?} {open:?}"
    );
    // A block does the same, and half of a sheet half of it.
    sensor.baffles[0].shape = BaffleShapeSpec::Box { from_mm: [-7.4, 5.0, -4.5], to_mm: [-7.6, -5.0, -0.5] };
    let block = by_light(&sensor);
    assert!(block[0].abs() < 0.02 * open[0], "{block:?} {open:?}");
    sensor.baffles = vec![sheet("half", [-7.5, -2.5, -2.5], [5.0, 4.0])];
    let half = by_light(&sensor)[0] / open[0];
    assert!((half - 0.5).abs() < 0.02, "{half}");
    // Its colour counts: what a white one reflects comes back.
    sensor.max_events = 8;
    let dark = by_light(&sensor)[1];
    sensor.baffles[0].albedo = 0.9;
    assert!(by_light(&sensor)[1] > 1.01 * dark);
}

#[test]
fn what_hides_or_bends_light_falls_back_and_names_its_key() {
    let mut with_baffle = sensor(
        "[[baffles]]\nname = \"hood\"\nshape = { kind = \"box\", from_mm = [-7.0, -3.0, -4.0], to_mm = [-6.0, 3.0, -3.0] }\n",
    );
    with_baffle.camera.width_px = 12;
    with_baffle.camera.height_px = 9;
    assert_eq!(with_baffle.baffles[0].albedo, 0.05);
    let mut with_lens = with_baffle.clone();
    with_lens.baffles.clear();
    with_lens.lens = Some(lens(Some(9.0), 1.5));
    for (sensor, told) in [
        (with_baffle, "optics.baffles = \"hood\": the fast mode renders sensors without baffles only"),
        (with_lens, "optics.lens = of index 1.5: the fast mode renders sensors without a lens or dome only"),
    ] {
        let fallback = Settings { samples: 1, seed: 0 };
        let imager =
            Imager::new(&sensor, Method::Fast { tolerance: TOLERANCES[1], fallback }, None, &flat()).unwrap();
        let [Notice::FellBack { why, samples: 64, .. }] = imager.notices() else {
            panic!("{:?}", imager.notices())
        };
        assert!(why.starts_with(told), "{why}");
        assert_eq!(imager.picture(&flat(), 0).unwrap().method.name(), "reference");
        // Asked for by name the fast mode refuses.
        let refused = render_sensor(&sensor, &flat(), &request(Mode::Fast)).unwrap_err().to_string();
        assert!(refused.starts_with(told), "{refused}");
    }
}

#[test]
fn a_picture_of_what_reflects_nothing_is_told_to_be_dark_and_has_no_error() {
    let lit = sensor("");
    let mut black = lit.clone();
    black.coating.albedo = 0.0;
    black.housing.as_mut().unwrap().albedo = 0.0;
    black.lights.iter_mut().for_each(|light| light.albedo = 0.0);
    for (mode, sensor, is_dark) in
        [(Mode::Reference, &lit, false), (Mode::Reference, &black, true), (Mode::Fast, &black, true)]
    {
        let times = render_sensor(sensor, &flat(), &request(mode)).unwrap().times;
        assert_eq!(times.is_dark, is_dark, "{mode:?}");
        assert_eq!(times.estimated_error == Some(0.0), is_dark, "{mode:?}: {:?}", times.estimated_error);
    }
}

#[test]
fn a_pressed_face_that_reaches_into_a_lens_or_a_baffle_is_refused() {
    let mut sensor = sensor("");
    let pressed = |depth: f32, x: f32| {
        let mut face = flat();
        face.positions.iter_mut().for_each(|p| p.z -= depth * (-((p.x - x).powi(2) + p.y * p.y) / 4.0).exp());
        face
    };
    let told = |sensor: &SensorOptics, face: &DisplacedSurface| {
        scene(sensor, face, None).map_err(|e| e.to_string()).err().unwrap_or_default()
    };
    sensor.lens = Some(LensSpec { gap_mm: 1.0, ..lens(Some(9.0), 1.5) });
    assert_eq!(told(&sensor, &pressed(0.9, 0.0)), "");
    assert!(told(&sensor, &pressed(1.1, 0.0)).contains("the pad of the scene: it reaches into the lens"));
    // Off its axis a convex lens leaves more room.
    assert_eq!(told(&sensor, &pressed(1.4, 4.0)), "");
    sensor.lens = None;
    let shape = BaffleShapeSpec::Box { from_mm: [3.0, -1.0, -2.0], to_mm: [5.0, 1.0, -1.2] };
    sensor.baffles = vec![BaffleSpec { name: "block".to_owned(), shape, albedo: 0.1 }];
    assert_eq!(told(&sensor, &pressed(1.4, -4.0)), "");
    assert!(told(&sensor, &pressed(1.4, 4.0)).contains("reaches into the baffle \"block\""));
}

/// What the fast mode says of a sensor that it has no way for.
fn refused(sensor: &SensorOptics) -> String {
    not_fast(sensor).map_or_else(String::new, |e| e.to_string())
}

fn problems_of(sensor: &SensorOptics) -> Vec<String> {
    let mut problems = Problems::new();
    sensor.check(&mut problems);
    problems.into_vec().into_iter().map(|p| format!("{} = {}: {}", p.key, p.value, p.allowed)).collect()
}

#[test]
fn a_light_with_two_sides_is_two_lights_back_to_back() {
    // A sheet across the box, half way up: below it the pad, above it the ceiling.
    let sheet = "[[lights]]\nname = \"sheet\"\nshape = { kind = \"disc\", center_mm = [0.0, 7.0, -6.0], \
                 facing = [0.0, 0.0, 1.0], radius_mm = 0.9 }\nrgb = [255.0, 255.0, 255.0]\nenergy = 4000.0\nalbedo = 0.5\n";
    let mut one = sensor(sheet);
    one.lights.drain(..2);
    let mut both = one.clone();
    both.lights[0].two_sided = true;
    let mut pair = one.clone();
    let mut back = one.lights[0].clone();
    back.name = "back".to_owned();
    let LightShapeSpec::Disc { center_mm, facing, .. } = &mut back.shape else { unreachable!() };
    (*center_mm, *facing) = ([0.0, 7.0, -6.002], [0.0, 0.0, -1.0]);
    pair.lights.push(back);
    let mean = |sensor: &SensorOptics| render(sensor, 512, 1).mean().x;
    let (one, pair, both_mean) = (mean(&one), mean(&pair), mean(&both));
    // The back lights the ceiling, which gives a part of it to the pad.
    assert!(one < 0.9 * pair && (both_mean / pair - 1.0).abs() < 0.01, "{one} {pair} {both_mean}");
    assert!(refused(&both).contains("\"sheet\", which shines on both sides"), "{}", refused(&both));
    both.lights[0].shape =
        LightShapeSpec::Tube { from_mm: [0.0, 6.0, -6.0], to_mm: [0.0, 7.0, -6.0], radius_mm: 0.2 };
    assert!(problems_of(&both).concat().contains("lights[0].two_sided"), "{:?}", problems_of(&both));
}

#[test]
fn frost_scatters_what_a_plate_lets_through_and_takes_none_of_it() {
    let plated = |roughness| {
        sensor(&format!("[plate]\ngap_mm = 5.0\nthickness_mm = 2.0\nior = 1.49\nroughness = {roughness:?}\n"))
    };
    let (polished, frosted) = (plated(0.0), plated(0.5));
    assert!(refused(&polished).is_empty(), "{}", refused(&polished));
    assert!(refused(&frosted).contains("optics.plate.roughness = 0.5"), "{}", refused(&frosted));
    let material = |sensor: &SensorOptics| {
        let scene = scene(sensor, &flat(), None).unwrap();
        scene.surfaces.into_iter().find(|s| s.role == Role::Plate).map(|s| s.material)
    };
    assert_eq!(material(&frosted), Some(Material::RoughDielectric { ior: 1.49, alpha: 0.25 }));
    // A plate that is hardly frosted is a polished one: one picture by the refracted path, one by chance.
    let (a, b) = (render(&polished, 256, 1), render(&plated(0.04), 1024, 2));
    let means = b.mean() / a.mean();
    assert!((means - Vec3::ONE).abs().max_element() < 0.02, "{means}");
    // Where a pixel looks is where it would look without the frost.
    assert_eq!(renderer(&frosted).sights(), renderer(&polished).sights());
    assert!(
        problems_of(&plated(1.5)).concat().contains("plate.roughness = 1.5"),
        "{:?}",
        problems_of(&plated(1.5))
    );
}

#[test]
fn flakes_cover_what_is_said_or_what_the_roughness_leaves() {
    let coated = |rest: &str| sensor(&format!("[coating]\nalbedo = 0.5\n{rest}"));
    let pad = |sensor: &SensorOptics| scene(sensor, &flat(), None).unwrap().surfaces.swap_remove(0).material;
    let flakes = |material: Material| match material {
        Material::Lambert { .. } => 0.0,
        Material::FlakeCoating { flakes, .. } => flakes,
        Material::RoughConductor { .. } => 1.0,
        other => panic!("{other:?}"),
    };
    for (written, cover) in [
        ("", 0.0),
        ("roughness = 0.75", 0.25),
        ("roughness = 0.75\nflakes = 0.1", 0.1),
        ("roughness = 0.5\nflakes = 0.0", 0.0),
        ("roughness = 0.5\nflakes = 1.0", 1.0),
    ] {
        let sensor = coated(written);
        assert_eq!(flakes(pad(&sensor)), cover, "{written}");
        let key =
            if written.contains("flakes") { "optics.coating.flakes" } else { "optics.coating.roughness" };
        assert_eq!(refused(&sensor).contains(key), cover > 0.0, "{written}: {}", refused(&sensor));
    }
    // What is printed on the binder cannot be where there is none.
    let film = coated("flakes = 1.0\n[markers]\npitch_mm = 1.5\ndiameter_mm = 0.5\n");
    assert!(problems_of(&film).concat().contains("below 1 with markers"), "{:?}", problems_of(&film));
    assert!(problems_of(&coated("flakes = 1.2")).concat().contains("coating.flakes = 1.2"));
}

#[test]
fn a_plate_without_walls_lies_where_the_camera_looks() {
    let mut sensor = sensor("");
    sensor.housing = None;
    sensor.plate = Some(PlateSpec { gap_mm: 3.2, thickness_mm: 2.0, ior: 1.49, roughness: 0.0 });
    sensor.camera.center_mm = [40.0, -30.0];
    let scene = scene(&sensor, &flat(), None).unwrap();
    let plate = &scene.surface(Role::Plate).unwrap().mesh.positions;
    // The view is 12 x 9 mm about (40, 30) of the scene frame.
    for corner in [Vec2::new(34.0, 25.5), Vec2::new(46.0, 34.5)] {
        assert!(plate.iter().any(|p| p.truncate().cmplt(corner).all()), "{corner}");
        assert!(plate.iter().any(|p| p.truncate().cmpgt(corner).all()), "{corner}");
    }
}
