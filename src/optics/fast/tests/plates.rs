//! What comes through a plate.

use super::*;

#[test]
fn through_a_plate_means_agree_with_the_reference() {
    let scene = scene(bench_scene::Variant::B, sphere);
    let once = Precomputed::new(&flat(&scene)).unwrap();
    let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
    // The reference is noisy here: means over the picture and over its quarters.
    let settings = reference::Settings { samples: 32, seed: 3 };
    let truth = reference::Renderer::new(&scene).unwrap().render(&settings);
    let quarters = |film: &Film| {
        let mut sums = [Vec3::ZERO; 5];
        for (k, p) in film.pixels.iter().enumerate() {
            sums[k % 64 / 32 + 2 * (k / 64 / 24)] += *p;
            sums[4] += *p;
        }
        sums
    };
    for (k, (a, b)) in quarters(&film).iter().zip(quarters(&truth)).enumerate() {
        // (About three standard errors of it.)
        let bound = if k == 4 { 0.008 } else { 0.015 };
        assert!((*a / b - Vec3::ONE).abs().max_element() < bound, "{k}: {}", *a / b);
    }
}

/// Between bright walls much of the light is cut off where the events end, and every face of the plate is one.
#[test]
fn faces_of_a_plate_are_events_in_both_modes() {
    // Lamps beyond the plate, and between it and the pad.
    let mut means = Vec::new();
    for (lift_mm, events) in [(0.0, 7), (0.0, 16), (5.5, 7)] {
        let mut scene = with_plate(lift_mm, 0.8);
        scene.max_events = events;
        scene.lights.iter_mut().for_each(|light| light.albedo = Vec3::splat(0.8));
        let once = Precomputed::new(&scene).unwrap();
        let (film, stated) = Renderer::new(&once, &scene, 0.005).unwrap().render_with_error();
        let settings = reference::Settings { samples: 64, seed: 7 };
        let truth = reference::Renderer::new(&scene).unwrap().render(&settings);
        let off = (film.mean() / truth.mean() - Vec3::ONE).abs().max_element();
        assert!(off < 0.006 && f64::from(off) < stated, "{lift_mm} mm, {events}: {off} {stated}");
        means.push(truth.mean().x);
    }
    // (What comes after the seventh event matters.)
    assert!(means[1] > 1.2 * means[0], "{means:?}");
}

/// A wide or barrel-shaped view may meet walls above a plate, where nothing is looked for.
#[test]
fn a_view_of_walls_above_a_plate_is_left_to_the_reference() {
    let with_view = |tan_half_x: f32| {
        let mut scene = with_plate(0.0, 0.5);
        scene.camera.tan_half_x = tan_half_x;
        scene
    };
    // 15.5 mm below the camera, by way of the plate, rays of the picture's corners are 9.7 and 10.8 mm aside.
    assert!(Precomputed::new(&with_view(0.58)).is_ok());
    let wide = with_view(0.65);
    let told = Precomputed::new(&wide).expect_err("walls that are not seen").to_string();
    assert!(told.contains("camera = a view of x -10.8") && told.contains("reference"), "{told}");
    // So it is where a lens bends the picture's corners outwards, and without a plate it is nobody's business.
    let mut bent = with_view(0.5);
    bent.camera.distortion = Some(crate::optics::camera::Distortion { k1: -0.35, k2: 0.0 });
    assert!(Precomputed::new(&bent).is_err());
    bent.surfaces.retain(|surface| surface.role != Role::Plate);
    assert!(Precomputed::new(&bent).is_ok());
}
