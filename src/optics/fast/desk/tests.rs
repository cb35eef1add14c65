//! Light that changes within a block or a pixel.

use crate::optics::fast::tests::{punch, scene};
use crate::optics::fast::{Precomputed, Renderer};
use crate::optics::{LightShape, bench_scene::Variant, reference};
use glam::Vec3;

#[test]
fn a_light_narrower_than_a_block_shines_at_the_camera() {
    // It covers pixel (32, 24) and one half to one pixel around, less than the distance of nodes.
    let turned = |height: fn(f32, f32) -> f32| {
        let mut scene = scene(Variant::Ac, height);
        scene.lights[0].shape = LightShape::Rectangle {
            center: Vec3::new(0.0814, -0.0814, 8.0),
            half_u: Vec3::X * 0.2,
            half_v: Vec3::Y * 0.2,
        };
        scene
    };
    let once = Precomputed::new(&turned(|_, _| 0.0)).unwrap();
    for height in [|_, _| 0.0, punch] {
        let scene = turned(height);
        let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
        // What it reflects of the others is below 1, that of the face around as well.
        let more = film.pixels[24 * 64 + 32] - scene.lights[0].radiance;
        assert!(more.min_element() > -1e-3 && more.max_element() < 1.0, "{more}");
        assert!(film.pixels[24 * 64 + 36].max_element() < 2.0);
    }
}

#[test]
fn a_flank_within_one_pixel_between_slopes_that_are_alike_is_taken_apart() {
    // Both feet lie in column 32. (As level as its corners, it is 0.3 and 0.8 % off.)
    for (slope, [from_mm, rise_mm], within) in [(0.0, [0.24, 0.05], 0.0015), (0.1, [0.16, 0.1], 0.005)] {
        let mut scene = scene(Variant::Ac, |x, _| slope * x + if x < from_mm { 0.0 } else { rise_mm });
        scene.max_events = 1;
        let mut rest = scene.clone();
        let mesh = std::sync::Arc::make_mut(&mut rest.surfaces[0].mesh);
        mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
        let once = Precomputed::new(&rest).unwrap();
        let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
        let settings = reference::Settings { samples: 64, seed: 1 };
        let truth = reference::Renderer::new(&scene).unwrap().render(&settings);
        let [found, truth] = [film, truth].map(|film| (4..44).map(|y| film.at(32, y)).sum::<Vec3>());
        assert!((found / truth - Vec3::ONE).abs().max_element() < within, "{found} {truth}");
    }
}
