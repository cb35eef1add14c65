//! Lamps that a plate mirrors to the camera, and doubles.

use super::*;

/// Means of what the camera sees of a lamp in and through a plate of diamond, all else black: by the fast mode and the reference.
fn seen(center: Vec3, half_v: Vec3) -> [f32; 2] {
    let mut scene = scene(bench_scene::Variant::B, |_, _| 0.0);
    for surface in &mut scene.surfaces {
        surface.material = match surface.role {
            Role::Plate => Material::Dielectric { ior: 2.4 },
            _ => Material::Lambert { albedo: crate::optics::Albedo::grey(0.0) },
        };
    }
    scene.lights.truncate(1);
    let lamp = &mut scene.lights[0];
    lamp.shape = LightShape::Rectangle { center, half_u: Vec3::Y * 2.0, half_v };
    (lamp.radiance, lamp.albedo) = (Vec3::ONE, Vec3::ZERO);
    let once = Precomputed::new(&scene).unwrap();
    let fast = Renderer::new(&once, &scene, 0.005).unwrap().render();
    let settings = reference::Settings { samples: 256, seed: 5 };
    let reference = reference::Renderer::new(&scene).unwrap().render(&settings);
    [fast, reference].map(|film| film.mean().x)
}

#[test]
fn a_lamp_shows_where_a_plate_mirrors_it_after_a_further_round_trip() {
    let [fast, reference] = seen(Vec3::new(-9.1, 0.0, 4.9), Vec3::Z * 0.7);
    assert!(reference > 0.0 && (fast / reference - 1.0).abs() < 0.08, "{fast} {reference}");
}

#[test]
fn a_lamp_beside_the_view_shows_as_a_ghost_in_it() {
    let [fast, reference] = seen(Vec3::new(-8.4, 0.0, 0.9), Vec3::new(-0.15, 0.0, 0.15));
    assert!(reference > 0.0 && (fast / reference - 1.0).abs() < 0.08, "{fast} {reference}");
}

#[test]
fn a_lamp_seen_through_a_plate_is_as_much_darker_as_the_plate_makes_it() {
    let [fast, reference] = seen(Vec3::new(-6.5, 0.0, 0.9), Vec3::new(-0.3, 0.0, 0.3));
    assert!(reference > 0.0 && (fast / reference - 1.0).abs() < 0.02, "{fast} {reference}");
}
