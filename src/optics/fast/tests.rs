mod images;
mod lamps;
mod plates;

use super::*;
use crate::optics::trial::{Press, Trial};
use crate::optics::{Film, LightShape, Material, Mesh, Role, Surface, bench_scene, reference};
use std::f32::consts::FRAC_1_PI;
use std::sync::{Arc, LazyLock};

const SCENE: &str = include_str!("../../../tests/data/optics/tactile-bench-1.json");

/// The benchmark scene on a coarse lattice with another pad.
pub(super) fn scene(variant: bench_scene::Variant, height: impl Fn(f32, f32) -> f32) -> Scene {
    let mut scene = bench_scene::parse(SCENE, variant).unwrap();
    scene.camera = scene.camera.with_raster(64, 48);
    let (nx, ny) = (201, 151);
    let at = |k: usize| Vec2::new((k % nx) as f32 * 0.1 - 10.0, (k / nx) as f32 * 0.1 - 7.5);
    let positions = (0..nx * ny).map(|k| at(k).extend(height(at(k).x, at(k).y))).collect();
    let uvs = (0..nx * ny).map(|k| (at(k) + Vec2::new(10.0, 7.5)) / Vec2::new(20.0, 15.0)).collect();
    scene.surfaces[0].mesh = Arc::new(Mesh::from_lattice(nx, ny, positions, uvs));
    scene
}

/// The benchmark scene, its pad untouched, with its plate lifted by so much, between walls of this albedo.
fn with_plate(lift_mm: f32, walls: f32) -> Scene {
    let mut scene = scene(bench_scene::Variant::B, |_, _| 0.0);
    for surface in &mut scene.surfaces {
        match surface.role {
            Role::Plate => {
                Arc::make_mut(&mut surface.mesh).positions.iter_mut().for_each(|p| p.z += lift_mm);
            }
            Role::Housing => {
                surface.material = Material::Lambert { albedo: crate::optics::Albedo::grey(walls) }
            }
            _ => {}
        }
    }
    scene
}

fn sphere(x: f32, y: f32) -> f32 {
    let r = (x - 1.5).hypot(y + 1.0);
    if r < 2.0 { (16.0 - r * r).sqrt() - 3.0 } else { 0.4641 * (-1.244 * (r - 2.0)).exp() }
}

pub(super) fn punch(x: f32, y: f32) -> f32 {
    let r = (x + 3.0).hypot(y - 2.0);
    if r < 2.5 { 1.5 } else { 1.5 * (-1.6 * (r - 2.5)).exp() }
}

/// Upright ridges, a millimetre high and wide, in whose grooves light goes to and fro.
pub(super) fn ridges(x: f32, _: f32) -> f32 {
    f32::from(u8::from((x - 2.0 * (x / 2.0).round()).abs() < 0.5))
}

/// A scene with its pad untouched.
fn flat(scene: &Scene) -> Scene {
    let mut flat = scene.clone();
    let mesh = Arc::make_mut(&mut flat.surfaces[0].mesh);
    mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
    flat
}

pub(super) static ONCE: LazyLock<Precomputed> =
    LazyLock::new(|| Precomputed::new(&scene(bench_scene::Variant::Ac, |_, _| 0.0)).unwrap());

/// relRMSE against the reference, its own noise taken off, and the ratio of means.
pub(super) fn against_reference(scene: &Scene, fast: &Film) -> (f64, Vec3) {
    let film = |seed| {
        let settings = reference::Settings { samples: 32, seed };
        reference::Renderer::new(scene).unwrap().render(&settings)
    };
    let (a, b) = (film(1), film(2));
    let noise = a.relative_rmse(&b) / 2.0;
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(p, q)| (*p + *q) * 0.5).collect();
    let truth = Film { pixels, ..a };
    let error = fast.relative_rmse(&truth);
    ((error * error - noise * noise).max(0.0).sqrt(), fast.mean() / truth.mean())
}

#[test]
fn presses_agree_with_the_reference_within_the_estimate() {
    for (name, height, bound) in [
        ("sphere", sphere as fn(f32, f32) -> f32, 0.006),
        ("punch", punch, 0.02),
        ("step", |x, _| f32::from(u8::from(x > 0.5)), 0.02),
        ("flat", |_, _| 0.0, 0.005),
        ("lifted", |_, _| 1.0, 0.005),
    ] {
        let scene = scene(bench_scene::Variant::Ac, height);
        let renderer = Renderer::new(&ONCE, &scene, 0.005).unwrap();
        let (film, estimated) = renderer.render_with_error();
        let (error, means) = against_reference(&scene, &film);
        assert!(error < bound, "{name}: {error}");
        assert!((means - Vec3::ONE).abs().max_element() < 0.004, "{name}: {means}");
        assert!(error < 1.5 * estimated + 0.001, "{name}: {error}");
        // No pixel is out of what its neighbourhood could be.
        let most = film.mean() * 8.0;
        assert!(
            film.pixels.iter().all(|p| p.is_finite() && p.cmpge(Vec3::ZERO).all() && p.cmple(most).all())
        );
    }
}

/// Under one light a press changes most of what walls send back.
#[test]
fn a_lamp_that_shines_at_the_camera_ends_within_pixels() {
    let towards_it = |scene: &mut Scene| {
        scene.lights[0].shape =
            LightShape::Rectangle { center: Vec3::new(-6.1, 0.2, 8.0), half_u: Vec3::X, half_v: Vec3::Y };
    };
    let mut scene = scene(bench_scene::Variant::Ac, sphere);
    towards_it(&mut scene);
    let once = Precomputed::new(&flat(&scene)).unwrap();
    let (film, estimated) = Renderer::new(&once, &scene, 0.005).unwrap().render_with_error();
    let (error, _) = against_reference(&scene, &film);
    // (The judges' edges are noisy themselves.)
    assert!(error < 0.02 && estimated < 0.005, "{error} {estimated}");
    // Light by light it is the same.
    let sum = Renderer::new(&once, &scene, 0.005).unwrap().basis().combine(&once.radiances);
    assert!(film.relative_rmse(&sum) < 0.002);
}

#[test]
fn walls_answer_a_press_as_in_the_reference() {
    let alone = |mut scene: Scene| {
        scene.lights[1..].iter_mut().for_each(|l| l.radiance = Vec3::ZERO);
        scene
    };
    let scene = alone(scene(bench_scene::Variant::Ac, punch));
    let radiances: Vec<Vec3> = scene.lights.iter().map(|l| l.radiance).collect();
    let once = ONCE.with_radiances(&radiances).unwrap();
    let mut deaf = once.clone();
    deaf.tables.echo = None;
    let [with, without] = [&once, &deaf].map(|once| {
        let film = Renderer::new(once, &scene, 0.005).unwrap().render();
        against_reference(&scene, &film)
    });
    assert!(with.0 < without.0 && with.0 < 0.016, "{with:?} {without:?}");
    assert!((with.1.z - 1.0).abs() < 0.008, "{with:?}");
    // What was kept on disk answers alike.
    let again = Precomputed::decode(&flat(&scene), &once.encode()).unwrap().unwrap();
    assert_eq!(again.tables.echo, once.tables.echo);
}

/// Between nodes the light of a source falls off as it does.
#[test]
fn below_a_light_an_even_face_has_the_light_of_the_formula() {
    let mut scene = flat(&scene(bench_scene::Variant::Ac, sphere));
    (scene.max_events, scene.camera) = (1, scene.camera.with_raster(320, 240));
    scene.lights[1..].iter_mut().for_each(|l| l.radiance = Vec3::ZERO);
    let once = Precomputed::new(&scene).unwrap();
    let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
    let lamp = Lamp::new(&scene.lights[0]).unwrap();
    let (mut squares, mean) = (0.0, film.mean().z);
    for (k, p) in film.pixels.iter().enumerate() {
        let (x, y) = ((k % 320) as f32 + 0.5, (k / 320) as f32 + 0.5);
        // (The plane z = 0 as the scene's description says.)
        let at = Vec3::new(-9.0 + 18.0 * x / 320.0, 6.75 - 13.5 * y / 240.0, 0.0);
        let truth = lamp.irradiance(at, Vec3::Z) * 0.5 * FRAC_1_PI * scene.lights[0].radiance.z;
        squares += ((p.z - truth) / mean).powi(2);
    }
    let error = (squares / film.pixels.len() as f32).sqrt();
    assert!(error < 6e-4, "{error}");
}

#[test]
fn a_textured_pad_agrees_with_the_reference() {
    let once = Precomputed::new(&scene(bench_scene::Variant::At, |_, _| 0.0)).unwrap();
    let scene = scene(bench_scene::Variant::At, sphere);
    let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
    let (error, means) = against_reference(&scene, &film);
    // Four samples a pixel meet dots of about three pixels here.
    assert!(error < 0.02 && (means - Vec3::ONE).abs().max_element() < 0.005, "{error} {means}");
}

#[test]
fn one_picture_for_each_light_adds_up_and_colours_can_be_fitted() {
    let scene = scene(bench_scene::Variant::Ac, sphere);
    let renderer = Renderer::new(&ONCE, &scene, 0.005).unwrap();
    let (film, basis) = (renderer.render(), renderer.basis());
    let radiances: Vec<Vec3> = scene.lights.iter().map(|l| l.radiance).collect();
    assert_eq!(basis.names, ["blue", "white", "green", "red"]);
    assert!(basis.combine(&radiances).relative_rmse(&film) < 1e-3);
    // Other colours, as a rendering of them shows, are found again.
    let mut other = scene.clone();
    let colours = [Vec3::new(3.0, 1.0, 0.5), Vec3::ZERO, Vec3::new(0.2, 5.0, 1.0), Vec3::splat(2.0)];
    other.lights.iter_mut().zip(colours).for_each(|(l, c)| l.radiance = c);
    let once = Precomputed::new(&flat(&other)).unwrap();
    let real = Renderer::new(&once, &other, 0.005).unwrap().render();
    for (fitted, truth) in basis.fit(&real, |_| true).unwrap().iter().zip(colours) {
        assert!((*fitted - truth).abs().max_element() < 0.02, "{fitted} {truth}");
    }
}

#[test]
fn the_error_of_each_picture_of_a_basis_is_stated_and_that_of_their_sum_is_the_pictures() {
    for height in [sphere as fn(f32, f32) -> f32, punch] {
        let scene = scene(bench_scene::Variant::Ac, height);
        let renderer = Renderer::new(&ONCE, &scene, 0.005).unwrap();
        let (basis, stated) = renderer.basis_with_error();
        let picture = renderer.render_with_error().1;
        assert!((stated.together / picture - 1.0).abs() < 0.02, "{} {picture}", stated.together);
        // Under one light errors do not even out.
        assert!(stated.lights.iter().all(|e| *e > picture), "{:?} {picture}", stated.lights);
        let mut white = scene.clone();
        white.lights.iter_mut().for_each(|l| l.radiance = Vec3::ONE);
        let judge = reference::Renderer::new(&white).unwrap();
        let [a, b] = [1, 2].map(|seed| judge.render_lights(&reference::Settings { samples: 32, seed }));
        for ((film, stated), (a, b)) in basis.films.iter().zip(&stated.lights).zip(a.iter().zip(&b)) {
            let noise = a.relative_rmse(b) / 2.0;
            let pixels = a.pixels.iter().zip(&b.pixels).map(|(p, q)| (*p + *q) * 0.5).collect();
            let error = film.relative_rmse(&Film { pixels, ..a.clone() });
            let error = (error * error - noise * noise).max(0.0).sqrt();
            assert!(error < 1.5 * stated + 0.001, "{error} {stated}");
        }
    }
}

#[test]
fn lamps_that_are_taken_together_give_what_each_gives_apart() {
    for height in [sphere as fn(f32, f32) -> f32, punch, |x, _| f32::from(u8::from(x > 0.5))] {
        let scene = scene(bench_scene::Variant::Ac, height);
        let mut once = Precomputed::new(&flat(&scene)).unwrap();
        assert!(once.greys.is_some() && once.is_skyline_grey, "nothing in the scene has a colour");
        let (together, stated) = Renderer::new(&once, &scene, 0.005).unwrap().basis_with_error();
        once.is_skyline_grey = false;
        let (apart, stated_apart) = Renderer::new(&once, &scene, 0.005).unwrap().basis_with_error();
        for (a, b) in together.films.iter().zip(&apart.films) {
            assert!(a.relative_rmse(b) < 1e-6, "{}", a.relative_rmse(b));
        }
        assert!((stated.together / stated_apart.together - 1.0).abs() < 1e-4);
        for (a, b) in stated.lights.iter().zip(&stated_apart.lights) {
            assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
        }
    }
}

#[test]
fn threads_change_nothing_and_sights_are_the_references() {
    let scene = scene(bench_scene::Variant::Ac, sphere);
    let renderer = Renderer::new(&ONCE, &scene, 0.005).unwrap();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(alone.install(|| renderer.render()), renderer.render());
    let truth = reference::Renderer::new(&scene).unwrap().sights();
    for (a, b) in renderer.sights().iter().zip(&truth) {
        let (a, b) = (a.unwrap(), b.unwrap());
        assert!((a.point - b.point).length() < 1e-3 && (a.uv - b.uv).length() < 1e-4, "{a:?} {b:?}");
    }
}

#[test]
fn what_is_skipped_changes_nothing_and_other_colours_need_nothing_anew() {
    let scene = scene(bench_scene::Variant::Ac, sphere);
    let renderer = || Renderer::new(&ONCE, &scene, 0.005).unwrap();
    let film = renderer().render();
    let error = renderer().thorough().render().relative_rmse(&film);
    assert!(error < 1e-3, "{error}");
    let mut black = scene.clone();
    black.surfaces[0].material = Material::Lambert { albedo: crate::optics::Albedo::grey(0.0) };
    let once_black = Precomputed::new(&flat(&black)).unwrap();
    let of_black = || Renderer::new(&once_black, &black, 0.005).unwrap();
    let bounced = of_black().bouncing().render().relative_rmse(&of_black().render());
    assert!(bounced < 1e-6, "{bounced}");
    let mut other = scene.clone();
    other.lights.iter_mut().for_each(|l| l.radiance = Vec3::new(l.radiance.y, 0.0, 3.0));
    let radiances: Vec<Vec3> = other.lights.iter().map(|l| l.radiance).collect();
    let once = ONCE.with_radiances(&radiances).unwrap();
    let recoloured = Renderer::new(&once, &other, 0.005).unwrap().render();
    assert!(renderer().basis().combine(&radiances).relative_rmse(&recoloured) < 1e-3);
    assert!(ONCE.with_radiances(&radiances[1..]).is_err());
    // Without a second event nothing bounces.
    let mut single = flat(&scene);
    single.max_events = 1;
    let once = Precomputed::new(&single).unwrap();
    single.surfaces = scene.surfaces.clone();
    let renderer = || Renderer::new(&once, &single, 0.005).unwrap();
    let film = renderer().render();
    let (error, _) = against_reference(&single, &film);
    assert!(error < 0.006, "{error}");
    // (It would be looked for, and be wrong.)
    let bounced = renderer().bouncing().render().relative_rmse(&film);
    assert!(bounced > 0.001, "{bounced}");
}

#[test]
fn what_it_cannot_render_it_refuses_and_names_the_reference() {
    let refused = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene(bench_scene::Variant::Ac, |_, _| 0.0);
        change(&mut scene);
        let message = Precomputed::new(&scene).unwrap_err().to_string();
        assert!(message.contains("reference"), "{message}");
    };
    refused(&|s| s.surfaces[0].material = Material::RoughConductor { f0: Vec3::ONE, alpha: 0.2 });
    refused(&|s| s.lights[1].two_sided = true);
    refused(&|s| {
        s.lights[0].shape = LightShape::Mesh(Arc::new(Mesh::parallelogram(Vec3::Z, Vec3::X, Vec3::Y)))
    });
    refused(&|s| {
        *s = bench_scene::parse(SCENE, bench_scene::Variant::B).unwrap();
        s.surfaces[2].material = Material::RoughDielectric { ior: 1.49, alpha: 0.1 };
    });
    refused(&|s| {
        *s = bench_scene::parse(SCENE, bench_scene::Variant::B).unwrap();
        s.max_events = 6;
    });
    // What would throw shadows that it knows nothing of.
    for role in [Role::Other, Role::Housing] {
        refused(&|s| {
            let mesh =
                Arc::new(Mesh::parallelogram(Vec3::new(-5.0, -3.0, 1.0), Vec3::Y * 6.0, Vec3::Z * 3.0));
            s.surfaces.push(Surface { name: "baffle".to_owned(), role, mesh, ..s.surfaces[1].clone() });
        });
    }
    let mut moved = scene(bench_scene::Variant::Ac, sphere);
    moved.lights[0].radiance *= 2.0;
    assert!(Renderer::new(&ONCE, &moved, 0.005).is_err());
}

/// The benchmark scene with an upright step up at x = 0.5 mm, under its first light alone, with another shape.
fn step_under(shape: LightShape) -> Trial {
    let trial = Trial::new(bench_scene::Variant::Ac, Press::Cliff, [96, 72], [401, 301]).unwrap();
    trial.changed(|scene| {
        scene.lights.truncate(1);
        scene.lights[0].shape = shape.clone();
    })
}

#[test]
fn what_the_foot_of_a_step_lost_is_not_taken_from_its_rim() {
    // Columns 51 and 53 show the rim, whose pixels are upright flank to a tenth, and what is level behind it.
    let shape = LightShape::Disc { center: Vec3::new(9.7, 1.6, 6.6), normal: Vec3::NEG_X, radius: 1.0 };
    let Trial { scene, untouched } = step_under(shape);
    let once = Precomputed::new(&untouched).unwrap();
    let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
    let settings = reference::Settings { samples: 32, seed: 1 };
    let truth = reference::Renderer::new(&scene).unwrap().render(&settings);
    let [part, truth] = [film, truth].map(|film| {
        let column = |x: usize| (0..72).map(|y| film.pixels[y * 96 + x].x).sum::<f32>();
        column(51) / column(53)
    });
    assert!((part - truth).abs() < 0.03, "{part} {truth}");
}

#[test]
fn a_press_that_comes_near_a_light_is_left_to_the_reference() {
    let upright = |z: f32, half_mm: f32| LightShape::Rectangle {
        center: Vec3::new(9.99, 0.0, z),
        half_u: Vec3::Y * half_mm,
        half_v: Vec3::Z * 0.2,
    };
    let refused = |shape: LightShape, change: fn(&mut Vec3)| {
        let Trial { mut scene, untouched } = step_under(shape);
        Arc::make_mut(&mut scene.surfaces[0].mesh).positions.iter_mut().for_each(change);
        let once = Precomputed::new(&untouched).unwrap();
        Renderer::new(&once, &scene, 0.005).err().map(|e| e.to_string())
    };
    // The step's upper side is a millimetre high, and lies under this.
    let near = refused(upright(1.55, 1.0), |_| ());
    assert!(near.is_some_and(|why| why.contains("0.55 mm over what a press has lifted")));
    assert_eq!(refused(upright(1.75, 1.0), |_| ()), None);
    // So it does if it lies under an end of it alone, and not if it hardly rises.
    let end_alone = refused(upright(1.55, 4.0), |p| p.z *= f32::from(u8::from(p.y > 3.0)));
    assert!(end_alone.is_some_and(|why| why.contains("0.55 mm over what a press has lifted")));
    assert_eq!(refused(upright(0.7, 1.0), |p| p.z *= 0.09), None);
}

/// Flanks that run askew over the lattice have notches, look away from the camera, and stand in their own shadow.
#[test]
fn at_the_foot_of_a_round_plug_it_is_as_bright_as_in_the_reference() {
    for variant in [bench_scene::Variant::Ac, bench_scene::Variant::At] {
        let Trial { scene, untouched } = Trial::new(variant, Press::Plug, [96, 72], [401, 301]).unwrap();
        let once = Precomputed::new(&untouched).unwrap();
        let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
        let settings = reference::Settings { samples: 48, seed: 1 };
        let truth = reference::Renderer::new(&scene).unwrap().render(&settings);
        let [foot, truth] = [film, truth].map(|film| {
            let at = |k: usize| {
                (Vec2::new((k % 96) as f32 - 47.5, 35.5 - (k / 96) as f32) * 0.1875) - Vec2::new(1.5, -1.0)
            };
            let around = (0..96 * 72).filter(|k| (2.8..3.5).contains(&at(*k).length()));
            around.map(|k| film.pixels[k].element_sum()).sum::<f32>()
        });
        assert!((foot / truth - 1.0).abs() < 0.01, "{variant:?}: {}", foot / truth);
    }
}
