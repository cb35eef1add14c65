use super::*;
use crate::optics::{sensor::*, sensor_scene::texture_coordinate};

fn small_sensor(texture: TextureMode) -> SensorOptics {
    let light = |name: &str, center_mm: [f64; 3], facing: [f64; 3], rgb: [f64; 3]| LightSpec {
        name: name.to_owned(),
        shape: LightShapeSpec::Rectangle { center_mm, facing, size_mm: [6.0, 2.0] },
        rgb,
        energy: 1000.0,
        cosine_power: 0.0,
        two_sided: false,
        albedo: 0.5,
    };
    SensorOptics {
        camera: CameraSpec {
            width_px: 48,
            height_px: 36,
            mm_per_px: 0.25,
            distance_mm: 12.0,
            center_mm: [0.0, 0.0],
            distortion: None,
            aperture_radius_mm: 0.0,
        },
        housing: Some(HousingSpec {
            x_mm: [-8.0, 8.0],
            y_mm: [-8.0, 8.0],
            height_mm: 14.0,
            skirt_mm: 0.5,
            albedo: 0.4,
        }),
        plate: None,
        lens: None,
        baffles: Vec::new(),
        markers: None,
        grain: None,
        lights: vec![
            light("blue", [-7.999, 0.0, -4.0], [1.0, 0.0, 0.0], [25.0, 75.0, 255.0]),
            light("red", [0.0, 7.999, -4.0], [0.0, -1.0, 0.0], [255.0, 50.0, 75.0]),
        ],
        coating: CoatingSpec::default(),
        texture,
        mesh: MeshSpec::default(),
        image: ImageSpec::default(),
        max_events: 6,
    }
}

const FAST: Method =
    Method::Fast { tolerance: 0.005, fallback: reference::Settings { samples: 16, seed: 0 } };

fn pressed() -> DisplacedSurface {
    let mut s = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    for p in &mut s.positions {
        let r2 = (p.x - 1.0).powi(2) + p.y.powi(2);
        p.z -= 0.8 * (-r2 / 2.0).exp();
    }
    s
}

fn dusty() -> Vec<u8> {
    (0..48 * 36 * 3).map(|k| 60 + ((k * 7919) % 131) as u8).collect()
}

#[test]
fn the_ratio_of_the_untouched_sensor_is_its_image() {
    let mut sensor = small_sensor(TextureMode::Ratio);
    // The image has been through all of this.
    sensor.image = ImageSpec {
        exposure: Some(3.0),
        gamma: Some(2.6),
        vignetting: 0.7,
        blur_px: 1.5,
        full_well_electrons: Some(500.0),
        read_noise: 4.0,
        noise_seed: 7,
    };
    let rest = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    // From black to white.
    let rgb: Vec<u8> = (0..48 * 36 * 3).map(|k| (k * 7919 % 256) as u8).collect();
    let background = Background { width: 48, height: 36, rgb: &rgb };
    let settings = reference::Settings { samples: 4, seed: 2 };
    let imager = Imager::new(&sensor, settings, Some(background), &rest).unwrap();
    assert_eq!(imager.picture(&rest, 0).unwrap().rgb, rgb);
    let touched = imager.picture(&pressed(), 0).unwrap();
    assert_ne!(touched.rgb, rgb);
    // The image's noise is the only one: every picture of a face is the same.
    assert_eq!(imager.picture(&pressed(), 1).unwrap().rgb, touched.rgb);
    // Depth on the pixel grid: the press stands 1 mm (4 pixels) right of the centre.
    let deepest = (0..48 * 36).min_by(|&a, &b| touched.depth_mm[a].total_cmp(&touched.depth_mm[b])).unwrap();
    assert!((26..30).contains(&(deepest % 48)) && (16..20).contains(&(deepest / 48)));
    assert!((touched.depth_mm[deepest] + 0.8).abs() < 0.04);
    assert_eq!(touched.depth_mm, depth_map(&sensor, &face(&sensor, &pressed())).unwrap());
}

/// Columns from where a row of the picture has risen by a tenth to where it lacks a tenth, between pixels linearly.
fn rise_px(rgb: &[u8]) -> f32 {
    let row: Vec<f32> = (0..48).map(|x| f32::from(rgb[3 * (18 * 48 + x)])).collect();
    let (low, high) = (row[12], row[35]);
    let reached = |part: f32| {
        let level = low + part * (high - low);
        let after = (12..36).find(|&x| row[x] > level).unwrap();
        after as f32 - (row[after] - level) / (row[after] - row[after - 1])
    };
    reached(0.9) - reached(0.1)
}

#[test]
fn an_edge_of_light_is_as_soft_where_the_image_is_relit_by_ratio_as_where_it_is_lit() {
    let rest = DisplacedSurface::flat(33, 33, [16.0, 16.0]);
    let mut moved = rest.clone();
    moved.positions.iter_mut().for_each(|p| p.z -= 0.01);
    let rgb = [100; 48 * 36 * 3];
    let rise = |texture: TextureMode, blur_px: f64| {
        let mut sensor = small_sensor(texture);
        let (gamma, exposure) = (Some(1.0), Some(1.0));
        sensor.image = ImageSpec { gamma, exposure, blur_px, ..ImageSpec::default() };
        let image = Background { width: 48, height: 36, rgb: &rgb };
        let imager = Imager::new(&sensor, FAST, Some(image), &rest).unwrap();
        let untouched = imager.seen(&imager.scene(&rest.at_rest()).unwrap()).unwrap().0;
        // The right half has twice the light of the left; what is worn is relit, else the coat shows it as it is.
        let mut seen = (*untouched).clone();
        for (k, p) in seen.light.pixels.iter_mut().enumerate() {
            let before = if texture == TextureMode::Ratio { *p } else { Vec3::splat(0.3) };
            *p = if k % 48 < 24 { before } else { 2.0 * before };
        }
        let pad = imager.scene(&moved).unwrap().surface(Role::Pad).unwrap().mesh.clone();
        imager.reuse.or_render(&pad, || Ok::<_, Error>(seen)).unwrap();
        rise_px(&imager.picture(&moved, 0).unwrap().rgb)
    };
    let [lit, relit, sharp] = [(TextureMode::Lit, 1.5), (TextureMode::Ratio, 1.5), (TextureMode::Ratio, 0.0)]
        .map(|(t, px)| rise(t, px));
    // A Gaussian's integral takes 2.563 of its standard deviations, and lines between pixels a little more.
    assert!((lit - 3.95).abs() < 0.25, "{lit}");
    assert!((relit - lit).abs() < 0.2, "{relit} {lit}");
    assert!(sharp < 1.0, "{sharp}");
}

#[test]
fn a_sensor_without_light_is_told_and_one_with_some_is_not() {
    let rest = DisplacedSurface::flat(33, 33, [16.0, 16.0]);
    let mut sensor = small_sensor(TextureMode::None);
    let dark = sensor.lights.split_off(1);
    let told = |sensor: &SensorOptics| {
        let imager = Imager::new(sensor, FAST, None, &rest).unwrap();
        let rgb = imager.picture(&pressed(), 0).unwrap().rgb;
        (imager.notices().contains(&Notice::Dark), rgb.iter().all(|code| *code == 0))
    };
    sensor.lights.extend(dark.into_iter().map(|light| LightSpec { energy: 0.0, ..light }));
    assert_eq!(told(&sensor), (false, false));
    sensor.lights[0].rgb = [0.0; 3];
    assert_eq!(told(&sensor), (true, true));
}

#[test]
fn an_untouched_image_that_is_white_or_black_is_told() {
    let notice = |codes: [u8; 4]| {
        let rgb: Vec<u8> = codes.into_iter().flat_map(|code| [code; 3]).collect();
        clipped(&Background { width: 2, height: 2, rgb: &rgb }).map(|notice| notice.to_string())
    };
    assert!(notice([255, 255, 30, 0]).is_some_and(|n| n.contains("50 %") && n.contains("shorter exposure")));
    assert!(notice([0, 9, 30, 200]).is_some_and(|n| n.contains("25 %") && n.contains("longer exposure")));
    assert!(notice([1, 254, 30, 200]).is_none());
}

#[test]
fn a_tolerance_that_picks_no_work_is_told_where_the_fast_mode_renders() {
    let said = |tolerance| Notice::of_tolerance(tolerance).map(|notice| notice.to_string());
    assert_eq!([0.002, 0.005, 0.01].map(said), [const { None }; 3]);
    assert!(said(0.0019).is_some_and(|s| s.contains("0.0019 takes longer") && s.contains("reference mode")));
    assert!(said(0.02).is_some_and(|s| s.contains("0.02 saves little over 0.01")));
    let rest = DisplacedSurface::flat(33, 33, [16.0, 16.0]);
    let mut sensor = small_sensor(TextureMode::None);
    let Method::Fast { fallback, .. } = FAST else { panic!("{FAST:?}") };
    let notices = |sensor: &SensorOptics| {
        Imager::new(sensor, Method::Fast { tolerance: 0.1, fallback }, None, &rest)
            .unwrap()
            .notices()
            .to_vec()
    };
    assert_eq!(notices(&sensor), [Notice::BeyondWork { tolerance: 0.1 }]);
    sensor.coating.roughness = 0.5;
    assert!(matches!(notices(&sensor)[..], [Notice::FellBack { .. }]));
}

#[test]
fn a_glossy_sensor_falls_back_and_says_so_and_a_diffuse_one_does_not() {
    let rest = DisplacedSurface::flat(33, 33, [16.0, 16.0]);
    let mut sensor = small_sensor(TextureMode::None);
    (sensor.camera.width_px, sensor.camera.height_px, sensor.camera.mm_per_px) = (16, 12, 0.75);
    let fast = FAST;
    let folder = std::env::temp_dir().join(format!("twinrig-optics-{}", std::process::id()));
    let store = Store::new(&folder);
    let imager = Imager::with_store(&sensor, fast, None, &rest, Some(&store)).unwrap();
    assert!(imager.notices().is_empty());
    let picture = imager.picture(&pressed(), 0).unwrap();
    assert!(picture.estimated_error.is_some_and(|e| e > 0.0));

    // From the folder it is the same to the bit; from a torn file it is made anew.
    let again =
        |store| Imager::with_store(&sensor, fast, None, &rest, Some(store)).unwrap().picture(&pressed(), 0);
    assert_eq!(again(&store).unwrap().light, picture.light);
    let files = || std::fs::read_dir(&folder).unwrap().map(|f| f.unwrap().path()).collect::<Vec<_>>();
    let [file] = &files()[..] else { panic!("{:?}", files()) };
    let whole = std::fs::read(file).unwrap();
    std::fs::write(file, &whole[..whole.len() / 2]).unwrap();
    assert_eq!(again(&store).unwrap().light, picture.light);
    assert_eq!(std::fs::read(file).unwrap(), whole);
    std::fs::remove_dir_all(&folder).unwrap();

    sensor.coating.roughness = 0.5;
    let imager = Imager::new(&sensor, fast, None, &rest).unwrap();
    let [Notice::FellBack { why, .. }] = imager.notices() else { panic!("no notice") };
    assert!(why.contains("optics.coating.roughness = 0.5") && why.contains("diffuse"), "{why}");
    // Its noise is told, and judged by what was asked of the fast mode.
    let picture = imager.picture(&rest, 0).unwrap();
    let noise = picture.estimated_error.unwrap();
    assert!(noise > 0.005 && picture.meets_tolerance == Some(false), "{noise}");
    let told = imager.notices()[0].to_string();
    assert!(told.contains(&format!("{:.1} % of noise", 100.0 * noise)), "{told}");
    // What a record is told is what was truly done.
    let truly = |method: Method| (method.name(), method.samples());
    assert_eq!(truly(imager.method()), ("reference", Some(FALLBACK_SAMPLES)));
    assert_eq!(truly(picture.method), truly(imager.method()));
    // More samples than the usual are taken where they are asked for.
    let many = reference::Settings { samples: 100, seed: 5 };
    let imager =
        Imager::new(&sensor, Method::Fast { tolerance: 0.005, fallback: many }, None, &rest).unwrap();
    assert_eq!(imager.method(), Method::Reference(many));
    let told = imager.notices()[0].to_string();
    assert!(told.contains("100 samples") && told.contains("optics.samples"), "{told}");
}

#[test]
fn a_pad_that_the_fast_mode_cannot_render_is_traced_and_those_after_it_are_not() {
    let rest = DisplacedSurface::flat(33, 33, [16.0, 16.0]);
    let mut sensor = small_sensor(TextureMode::None);
    (sensor.camera.width_px, sensor.camera.height_px, sensor.camera.mm_per_px) = (16, 12, 0.75);
    let imager = Imager::new(&sensor, FAST, None, &rest).unwrap();
    let mut deep = rest.clone();
    deep.positions.iter_mut().for_each(|p| p.z -= 3.5 * (-(p.x * p.x + p.y * p.y) / 8.0).exp());
    let picture = imager.picture(&deep, 0).unwrap();
    assert_eq!((picture.method.name(), picture.method.samples()), ("reference", Some(64)));
    let Some(Notice::PictureFellBack { why, samples: 64, noise }) = &picture.notice else {
        panic!("{:?}", picture.notice)
    };
    assert_eq!(picture.estimated_error, *noise);
    assert!(noise.is_some_and(|noise| picture.meets_tolerance == Some(noise <= 0.005)), "{noise:?}");
    assert!(why.contains("-1.5 to 3 mm"), "{why}");
    // Seen again it is told again, though it is not rendered again.
    assert_eq!(imager.picture(&deep, 1).unwrap().notice, picture.notice);
    let after = imager.picture(&pressed(), 2).unwrap();
    assert_eq!(after.method.name(), "fast");
    assert!(imager.notices().is_empty() && after.estimated_error.is_some());
}

#[test]
fn a_press_rendered_light_by_light_is_the_picture_and_other_colours_are_sums() {
    let rest = DisplacedSurface::flat(33, 33, [16.0, 16.0]);
    let sensor = small_sensor(TextureMode::None);
    let traced = Method::Reference(reference::Settings { samples: 64, seed: 3 });
    // (Of the reference mode the two have noise of their own.)
    for (method, bound) in [(FAST, 1e-3), (traced, 0.03)] {
        let imager = Imager::new(&sensor, method, None, &rest).unwrap();
        let plain = imager.picture(&pressed(), 4).unwrap();
        assert_eq!(plain.basis, None);
        let by_light = imager.light_by_light();
        let picture = by_light.picture(&pressed(), 4).unwrap();
        assert!(picture.light.relative_rmse(&plain.light) < bound);
        let basis = picture.basis.unwrap();
        assert_eq!(basis.basis.combine(&basis.radiances), picture.light);
        // The camera is that of the pictures, without its noise.
        let camera = basis.camera.unwrap();
        assert_eq!(camera.picture(&picture.light), picture.rgb);
        let stated = basis.errors.unwrap();
        assert!(stated.len() == sensor.lights.len() && stated.iter().all(|e| *e > 0.0), "{stated:?}");
        let (sum, one) = (picture.estimated_error.unwrap(), plain.estimated_error.unwrap());
        let Method::Fast { .. } = method else {
            assert!((sum / one - 1.0).abs() < 0.2, "{sum} {one}");
            continue;
        };
        assert!((sum / one - 1.0).abs() < 0.02, "{sum} {one}");
        // One light alone is what a sensor with that light alone has.
        let mut alone = sensor.clone();
        alone.lights[1..].iter_mut().for_each(|light| light.rgb = [0.0; 3]);
        let alone = Imager::new(&alone, method, None, &rest).unwrap().picture(&pressed(), 4).unwrap();
        let sum = basis.basis.combine(&basis.radiances[..1]);
        assert!(sum.relative_rmse(&alone.light) < 3e-3, "{}", sum.relative_rmse(&alone.light));
    }
}

#[test]
fn left_is_blue_and_bottom_is_red_and_the_automatic_exposure_holds() {
    let sensor = small_sensor(TextureMode::None);
    let rest = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    let settings = reference::Settings { samples: 16, seed: 2 };
    let imager = Imager::new(&sensor, settings, None, &rest).unwrap();
    let picture = imager.picture(&rest, 0).unwrap();
    let at = |x: usize, y: usize| picture.light.at(x, y);
    assert!(at(2, 18).z > 1.5 * at(45, 18).z, "blue falls from left to right");
    assert!(at(24, 33).x > 1.5 * at(24, 2).x, "red falls from bottom to top");
    let mean: f64 = picture.rgb.iter().map(|&c| f64::from(response::decode(c, &sensor.image))).sum();
    assert!((mean / picture.rgb.len() as f64 - 0.35).abs() < 0.02);
}

fn dome() -> DisplacedSurface {
    DisplacedSurface::resting(65, 65, [16.0, 16.0], |x, y| (400.0 - x * x - y * y).sqrt() - 20.0)
}

/// Relighting by ratio and printed markers on a pad that is not flat, in both modes.
#[test]
fn an_untouched_dome_shows_its_image_and_what_is_printed_on_it_rides_along() {
    let sensor = small_sensor(TextureMode::Ratio);
    let rest = dome();
    let rgb = dusty();
    let background = Background { width: 48, height: 36, rgb: &rgb };
    let reference = Method::Reference(reference::Settings { samples: 4, seed: 2 });
    for method in [reference, FAST] {
        let imager = Imager::new(&sensor, method, Some(background), &rest).unwrap();
        assert_eq!(imager.picture(&rest, 0).unwrap().rgb, rgb, "{}", method.name());
        let mut touched = rest.clone();
        touched.positions.iter_mut().for_each(|p| p.z -= 0.8 * (-(p.x * p.x + p.y * p.y) / 2.0).exp());
        assert_ne!(imager.picture(&touched, 0).unwrap().rgb, rgb);
    }
    // A point of the face looks the same in the picture wherever it went: a dark dot off the apex is dragged along.
    let mark = Vec3::new(3.0, 2.0, (400.0f32 - 13.0).sqrt() - 20.0);
    let at = texture_coordinate(&sensor, mark) * Vec2::new(48.0, 36.0);
    let dotted: Vec<u8> = (0..48 * 36)
        .flat_map(|k| {
            let far = (Vec2::new((k % 48) as f32 + 0.5, (k / 48) as f32 + 0.5) - at).length();
            [if far < 1.5 { 40 } else { 180 }; 3]
        })
        .collect();
    let imager =
        Imager::new(&sensor, reference, Some(Background { rgb: &dotted, ..background }), &rest).unwrap();
    let mut dragged = rest.clone();
    dragged.positions.iter_mut().for_each(|p| p.x += 1.0);
    let moved = imager.picture(&dragged, 0).unwrap();
    let darkest = (0..48 * 36).min_by_key(|&k| moved.rgb[3 * k + 1]).unwrap();
    let now = texture_coordinate(&sensor, mark + Vec3::X) * Vec2::new(48.0, 36.0);
    let found = Vec2::new((darkest % 48) as f32 + 0.5, (darkest / 48) as f32 + 0.5);
    assert!((found - now).length() < 1.6, "{found} {now} {at}");
}

#[test]
fn a_pixel_of_the_untouched_picture_is_its_own_texture_coordinate() {
    let sensor = small_sensor(TextureMode::Ratio);
    let rest = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    let renderer = reference::Renderer::new(&scene(&sensor, &rest, None).unwrap()).unwrap();
    for (k, sight) in renderer.sights().iter().enumerate() {
        let sight = sight.unwrap();
        let centre = Vec2::new((k % 48) as f32 + 0.5, (k / 48) as f32 + 0.5) / Vec2::new(48.0, 36.0);
        assert!((sight.uv - centre).length() < 1e-5);
        assert!((texture_coordinate(&sensor, sight.point) - centre).length() < 1e-5);
    }
}

/// By how much the coat's grain changes each pixel, told by the same picture without it.
fn grain_seen(sensor: &SensorOptics, method: Method, face: &DisplacedSurface) -> Vec<f32> {
    let rest = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    let light = |sensor: &SensorOptics| {
        Imager::new(sensor, method, None, &rest).unwrap().picture(face, 0).unwrap().light
    };
    let (grainy, plain) = (light(sensor), light(&SensorOptics { grain: None, ..sensor.clone() }));
    grainy.pixels.iter().zip(&plain.pixels).map(|(g, p)| g.y / p.y - 1.0).collect()
}

#[test]
fn grain_rides_on_the_face_and_looks_the_same_in_both_modes() {
    let mut sensor = small_sensor(TextureMode::Ratio);
    sensor.grain = Some(GrainSpec {
        rms: 0.1,
        size_mm: 0.5,
        specks_per_mm2: 0.2,
        speck_mm: 1.0,
        speck_depth: 0.2,
        seed: 3,
    });
    let rest = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    let mut dragged = rest.clone();
    dragged.positions.iter_mut().for_each(|p| p.x += 1.0);
    let reference = Method::Reference(reference::Settings { samples: 64, seed: 2 });
    let rms = |values: &mut dyn Iterator<Item = f32>| {
        let (n, sum) = values.fold((0, 0.0), |(n, sum), v| (n + 1, sum + f64::from(v * v)));
        (sum / f64::from(n)).sqrt()
    };
    let [traced, fast] = [reference, FAST].map(|method| {
        let (before, after) = (grain_seen(&sensor, method, &rest), grain_seen(&sensor, method, &dragged));
        // 1 mm is 4 pixels, and nothing follows from beyond the view.
        let inner = || (0..48 * 36).filter(|k| (3..43).contains(&(k % 48)) && (2..34).contains(&(k / 48)));
        let there = rms(&mut inner().map(|k| before[k]));
        let left = rms(&mut inner().map(|k| before[k] - after[k + 4]));
        let stays = rms(&mut inner().map(|k| before[k] - after[k]));
        assert!(there > 0.07, "{there}");
        assert!(left < 0.1 * there && stays > 0.8 * there, "{}: {left} {stays} of {there}", method.name());
        before
    });
    let apart = rms(&mut traced.iter().zip(&fast).map(|(a, b)| a - b));
    assert!(apart < 0.05 * rms(&mut fast.iter().copied()), "{apart}");
}

#[test]
fn grain_that_is_off_or_in_the_untouched_image_changes_no_bit() {
    let plain = small_sensor(TextureMode::Ratio);
    let with = |grain: GrainSpec| SensorOptics { grain: Some(grain), ..plain.clone() };
    let off = with(GrainSpec { seed: 9, size_mm: 0.3, ..GrainSpec::default() });
    let on = with(GrainSpec { rms: 0.1, ..GrainSpec::default() });
    let rest = DisplacedSurface::flat(65, 65, [16.0, 16.0]);
    let rgb = dusty();
    let image = Background { width: 48, height: 36, rgb: &rgb };
    let traced = Method::Reference(reference::Settings { samples: 2, seed: 2 });
    for method in [traced, FAST] {
        let seen = |sensor: &SensorOptics, image: Option<Background<'_>>| {
            let picture = Imager::new(sensor, method, image, &rest).unwrap().picture(&pressed(), 0).unwrap();
            (picture.rgb, picture.light)
        };
        assert_eq!(seen(&plain, None), seen(&off, None));
        assert_ne!(seen(&plain, None), seen(&on, None));
        for texture in [TextureMode::Ratio, TextureMode::Lit] {
            let worn = |sensor: &SensorOptics| seen(&SensorOptics { texture, ..sensor.clone() }, Some(image));
            assert_eq!(worn(&plain), worn(&on));
        }
    }
}
