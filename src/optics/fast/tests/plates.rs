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
