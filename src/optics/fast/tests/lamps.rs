//! Lamps whose light comes by way of a plate, and lamps with an angular profile, against the reference.

use super::*;
use crate::optics::Albedo;
use bench_scene::Variant;

/// The benchmark scene under a plate over its lamps, between grey walls, with changed lights.
fn under_plate(change: fn(&mut crate::optics::Light)) -> Scene {
    let mut scene = with_plate(5.5, 0.5);
    scene.lights.iter_mut().for_each(change);
    scene
}

/// How far a picture is off in means of 8 x 8 pixels, what is stated of it, and the ratio of means.
fn off(scene: &Scene) -> (f64, f64, Vec3) {
    off_by(scene, 48)
}

/// The same, judged by twice so many samples a pixel.
fn off_by(scene: &Scene, samples: u32) -> (f64, f64, Vec3) {
    let once = Precomputed::new(scene).unwrap();
    let (film, stated) = Renderer::new(&once, scene, 0.005).unwrap().render_with_error();
    let judge = reference::Renderer::new(scene).unwrap();
    let [a, b] = [1, 2].map(|seed| judge.render(&reference::Settings { samples, seed }).shrunk(8));
    let means = film.mean() / ((a.mean() + b.mean()) * 0.5);
    let film = film.shrunk(8);
    let apart =
        film.pixels.iter().zip(a.pixels.iter().zip(&b.pixels)).map(|(f, (a, b))| (*f - *a).dot(*f - *b));
    let mean_square = f64::from(apart.sum::<f32>()) / (3 * film.pixels.len()) as f64;
    (mean_square.max(0.0).sqrt() / f64::from(a.mean().element_sum() / 3.0), stated, means)
}

#[test]
fn small_lamps_under_a_plate_leave_no_marks() {
    // (As large as a light-emitting diode.)
    let mut scene = under_plate(|light| {
        let LightShape::Rectangle { half_u, half_v, .. } = &mut light.shape else { return };
        (*half_u, *half_v) = (half_u.normalize() * 0.7, half_v.normalize() * 0.7);
        light.radiance *= 10.0;
    });
    scene.lights.truncate(1);
    let (error, stated, means) = off(&scene);
    assert!(error < stated && (means.z - 1.0).abs() < 0.01, "{error} {stated} {means}");
    // An even face has nowhere more or less light than on either side.
    let once = Precomputed::new(&scene).unwrap();
    let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
    for row in film.pixels.chunks_exact(film.width) {
        for three in row.windows(3) {
            let departs = three[1].z - 0.5 * (three[0].z + three[2].z);
            assert!(departs.abs() < 0.03 * three[1].z, "{three:?}");
        }
    }
}

#[test]
fn profiles_count_in_what_comes_by_way_of_walls_and_plate() {
    let (error, stated, means) = off(&under_plate(|light| light.cosine_power = 4.0));
    assert!(error < stated && (means - Vec3::ONE).abs().max_element() < 0.01, "{error} {stated} {means}");
}

#[test]
fn a_lamp_at_the_camera_is_left_to_the_reference() {
    // One 4 mm wide looks down from so far before the camera, and so far beside it.
    let with_lamp = |at_mm: Vec3| {
        let mut scene = scene(Variant::Ac, |_, _| 0.0);
        let center = scene.camera.origin + at_mm;
        let shape = LightShape::Rectangle { center, half_u: 2.0 * Vec3::X, half_v: -Vec3::Y };
        scene.lights[0].shape = shape;
        Precomputed::new(&scene)
    };
    for (at_mm, gap_mm) in [(Vec3::new(1.0, 0.5, -0.1), "0.10"), (Vec3::new(2.5, 0.0, -0.2), "0.54")] {
        let told = with_lamp(at_mm).expect_err("a lamp before the camera").to_string();
        assert!(
            told.contains(&format!("{gap_mm} mm from the camera")) && told.contains("reference"),
            "{told}"
        );
    }
    assert!(with_lamp(Vec3::new(3.5, 0.0, -0.2)).is_ok());
}

#[test]
fn tubes_have_their_profiles() {
    for power in [1.0, 4.0] {
        let mut scene = scene(Variant::Ac, |_, _| 0.0);
        scene.lights.truncate(1);
        let (from, to) = (Vec3::new(-9.5, -3.0, 3.0), Vec3::new(-9.5, 1.0, 3.5));
        scene.lights[0].shape = LightShape::Tube { from, to, radius: 0.2 };
        scene.lights[0].cosine_power = power;
        let (error, stated, means) = off(&scene);
        // (All of the light, as its colour is blue.)
        assert!(error < stated && (means.z - 1.0).abs() < 0.015, "{power}: {error} {stated} {means}");
    }
}

#[test]
fn the_wall_behind_a_tube_sends_on_its_light_from_where_it_falls() {
    // The gap is 0.3 mm wide. All but what comes straight from the tube comes by one reflection, most of it from there.
    let mut scene = scene(Variant::Ac, |_, _| 0.0);
    scene.max_events = 2;
    scene.lights.truncate(1);
    let (from, to) = (Vec3::new(9.5, -0.7, 1.64), Vec3::new(9.5, 0.7, 1.64));
    scene.lights[0].shape = LightShape::Tube { from, to, radius: 0.2 };
    for surface in scene.surfaces.iter_mut().filter(|s| s.role == Role::Housing) {
        surface.material = Material::Lambert { albedo: Albedo::Constant(Vec3::splat(0.5)) };
    }
    let (error, stated, means) = off_by(&scene, 768);
    assert!(error < stated && (means.z - 1.0).abs() < 0.01, "{error} {stated} {means}");
}

#[test]
fn a_lamp_with_a_profile_is_seen_as_bright_as_it_shines_there() {
    // It hangs in the view and shines upwards, past the camera.
    let mut scene = scene(Variant::Ac, |_, _| 0.0);
    scene.lights.truncate(1);
    let (center, half_u, half_v) = (Vec3::new(-6.1, 0.2, 8.0), Vec3::X, Vec3::Y);
    scene.lights[0].shape = LightShape::Rectangle { center, half_u, half_v };
    scene.lights[0].cosine_power = 4.0;
    let once = Precomputed::new(&scene).unwrap();
    let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
    let truth =
        reference::Renderer::new(&scene).unwrap().render(&reference::Settings { samples: 16, seed: 1 });
    let brightest = |film: &Film| film.pixels.iter().map(|p| p.z).fold(0.0, f32::max);
    let (found, truth) = (brightest(&film), brightest(&truth));
    assert!((found / truth - 1.0).abs() < 0.02, "{found} {truth}");
}
