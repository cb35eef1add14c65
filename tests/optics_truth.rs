//! The reference renderer against pictures whose value is known: furnaces, quadrature, invariances.

use glam::{DVec3, Vec2, Vec3};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use twinrig::optics::bsdf::Bsdf;
use twinrig::optics::lens_mesh::of_lens;
use twinrig::optics::reference::{Renderer, Settings};
use twinrig::optics::sensor::LensSpec;
use twinrig::optics::{
    Albedo, Camera, Film, Light, LightShape, Material, Mesh, Role, Scene, Surface, Texture, camera::ThinLens,
};

const PI: f32 = std::f32::consts::PI;

fn lambert(albedo: f32) -> Material {
    Material::Lambert { albedo: Albedo::grey(albedo) }
}

fn surface(name: &str, mesh: Mesh, material: Material) -> Surface {
    Surface { name: name.to_owned(), role: Role::Other, mesh: Arc::new(mesh), material }
}

fn light(shape: LightShape, radiance: Vec3, albedo: f32) -> Light {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    Light {
        name: format!("light {}", COUNT.fetch_add(1, Ordering::Relaxed)),
        shape,
        radiance,
        two_sided: false,
        cosine_power: 0.0,
        albedo: Vec3::splat(albedo),
    }
}

/// A 4 x 4 picture straight down from height 3 on the spot around (x, y) at z = 0.
fn spot_camera(x: f32, y: f32) -> Camera {
    Camera::above(Vec3::new(x, y, 3.0), 1e-4, 4, 4)
}

fn floor(material: Material) -> Surface {
    let mesh = Mesh::parallelogram(Vec3::new(-20.0, -20.0, 0.0), Vec3::X * 40.0, Vec3::Y * 40.0);
    surface("floor", mesh, material)
}

fn render(surfaces: Vec<Surface>, lights: Vec<Light>, camera: Camera, max_events: u32, samples: u32) -> Film {
    let scene = Scene { surfaces, lights, camera, max_events };
    Renderer::new(&scene).unwrap().render(&Settings { samples, seed: 5 })
}

/// The cuboid's faces turned inwards.
fn inwards(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

/// Radiance in a closed box whose walls have albedo `a` and shine with radiance 1, after at most `n` events.
fn furnace(a: f32, n: u32) -> f32 {
    (0..=n).map(|k| a.powi(k as i32)).sum()
}

#[test]
fn a_furnace_of_rectangles_is_uniform() {
    // Closed form at every event: the six walls are six rectangular lights.
    let (h, a) = (Vec3::new(2.0, 3.0, 4.0), 0.6);
    let axes = [Vec3::X * h.x, Vec3::Y * h.y, Vec3::Z * h.z];
    let wall = |axis: usize, sign: f32| {
        let (u, v) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
        let shape = LightShape::Rectangle { center: axes[axis] * sign, half_u: u * -sign, half_v: v };
        light(shape, Vec3::ONE, a)
    };
    let lights = (0..3).flat_map(|axis| [wall(axis, -1.0), wall(axis, 1.0)]).collect();
    let camera = Camera::above(Vec3::new(0.5, 0.3, 1.0), 1.2, 16, 16);
    let film = render(Vec::new(), lights, camera, 12, 64);
    let truth = furnace(a, 12);
    assert!((film.mean().x / truth - 1.0).abs() < 2e-3, "{} against {truth}", film.mean().x);
    assert!(film.pixels.iter().all(|p| (p.x / truth - 1.0).abs() < 0.05));
}

#[test]
fn a_furnace_of_a_mesh_light_is_uniform() {
    // No closed form: light sampling and scattered rays share the work.
    let mesh = inwards(Mesh::cuboid(Vec3::new(-2.0, -3.0, -4.0), Vec3::new(2.0, 3.0, 4.0)));
    let lights = vec![light(LightShape::Mesh(Arc::new(mesh)), Vec3::ONE, 0.5)];
    let camera = Camera::above(Vec3::new(0.5, 0.3, 1.0), 1.2, 16, 16);
    let film = render(Vec::new(), lights, camera, 10, 256);
    let truth = furnace(0.5, 10);
    assert!((film.mean().x / truth - 1.0).abs() < 5e-3, "{} against {truth}", film.mean().x);
}

#[test]
fn clear_bodies_vanish_in_a_furnace() {
    // Smooth and frosted glass absorb nothing: in uniform light they cannot be seen, from outside or from
    // within (facets lose a little energy, so the frosted one is darker by less than a per cent).
    for (material, tolerance) in [
        (Material::Dielectric { ior: 1.49 }, 2e-3),
        (Material::RoughDielectric { ior: 1.49, alpha: 0.03 }, 1e-2),
    ] {
        let walls = inwards(Mesh::cuboid(Vec3::splat(-5.0), Vec3::splat(5.0)));
        let lights = vec![light(LightShape::Mesh(Arc::new(walls)), Vec3::ONE, 0.0)];
        let plate = Mesh::cuboid(Vec3::new(-2.0, -2.0, -1.0), Vec3::new(2.0, 2.0, 0.0));
        let camera = Camera::above(Vec3::new(0.1, 0.2, 3.0), 0.8, 16, 16);
        let film = render(vec![surface("plate", plate, material.clone())], lights, camera, 60, 256);
        assert!((film.mean().x - 1.0).abs() < tolerance, "{material:?}: {}", film.mean().x);
    }
}

#[test]
fn lenses_and_domes_vanish_in_a_furnace() {
    // With normals that are not those of its facets, too, a lens neither makes light nor takes any.
    let lens = |front_radius_mm: f64, back_radius_mm: Option<f64>, ior: f64| LensSpec {
        gap_mm: 1.0,
        thickness_mm: 3.5,
        diameter_mm: 6.0,
        front_radius_mm: Some(front_radius_mm),
        back_radius_mm,
        ior,
    };
    for lens in [lens(3.0, None, 1.49), lens(5.0, Some(7.0), 1.8), lens(4.0, Some(-3.5), 1.41)] {
        let walls = inwards(Mesh::cuboid(Vec3::splat(-9.0), Vec3::splat(9.0)));
        let lights = vec![light(LightShape::Mesh(Arc::new(walls)), Vec3::ONE, 0.0)];
        let glass = Material::Dielectric { ior: lens.ior as f32 };
        let dome = surface("dome", of_lens(&lens, [0.2, 0.1]), glass);
        let camera = Camera::above(Vec3::new(0.1, 0.2, 8.0), 0.8, 16, 16);
        let film = render(vec![dome], lights, camera, 100, 256);
        assert!((film.mean().x - 1.0).abs() < 2e-3, "{lens:?}: {}", film.mean().x);
        assert!(film.pixels.iter().all(|p| (p.x - 1.0).abs() < 0.03), "{lens:?}");
    }
}

#[test]
fn inside_glass_radiance_is_eta_squared_times_as_large() {
    // A camera in a glass ball-like cuboid in a black furnace of radiance 1 sees n^2 at least where light enters
    // head on (times the transmittance of one face; inner reflections add the rest in a lossless body).
    let walls = inwards(Mesh::cuboid(Vec3::splat(-5.0), Vec3::splat(5.0)));
    let lights = vec![light(LightShape::Mesh(Arc::new(walls)), Vec3::ONE, 0.0)];
    let plate = Mesh::cuboid(Vec3::new(-4.0, -4.0, -1.0), Vec3::new(4.0, 4.0, 1.0));
    let glass = Material::Dielectric { ior: 1.5 };
    let film =
        render(vec![surface("glass", plate, glass)], lights, Camera::above(Vec3::ZERO, 0.1, 8, 8), 40, 256);
    assert!((film.mean().x - 2.25).abs() < 5e-3, "{}", film.mean().x);
}

/// Radiance of a floor point that a parallelogram lights, by the midpoint rule; `seen` tells what is visible.
fn quadrature(point: Vec3, bsdf: &Bsdf, corner: Vec3, u: Vec3, v: Vec3, seen: impl Fn(Vec3) -> bool) -> f64 {
    let n = 600;
    let normal = u.cross(v).normalize();
    let area = f64::from(u.cross(v).length()) / f64::from(n * n);
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..n {
            let y = corner + u * ((i as f32 + 0.5) / n as f32) + v * ((j as f32 + 0.5) / n as f32);
            let to = y - point;
            let w = to.normalize();
            if seen(y) {
                let f = f64::from(bsdf.eval(Vec3::Z, w).x);
                sum += f * f64::from(w.z.max(0.0) * (-w.dot(normal)).max(0.0) / to.length_squared()) * area;
            }
        }
    }
    sum
}

const CORNER: Vec3 = Vec3::new(-1.5, 1.0, 2.0);
const EDGE_U: Vec3 = Vec3::new(0.0, 2.0, 0.5);
const EDGE_V: Vec3 = Vec3::new(2.0, 0.0, 0.0);

/// The same luminous parallelogram as a rectangle (closed form) and as a mesh (sampled).
fn both_shapes() -> [LightShape; 2] {
    let center = CORNER + (EDGE_U + EDGE_V) / 2.0;
    [
        LightShape::Rectangle { center, half_u: EDGE_U / 2.0, half_v: EDGE_V / 2.0 },
        LightShape::Mesh(Arc::new(Mesh::parallelogram(CORNER, EDGE_U, EDGE_V))),
    ]
}

#[test]
fn direct_light_agrees_with_quadrature_for_every_material_open_and_half_hidden() {
    let materials = [
        lambert(0.7),
        Material::RoughConductor { f0: Vec3::splat(0.8), alpha: 0.3 },
        Material::FlakeCoating { albedo: Albedo::grey(0.5), flakes: 0.4, f0: Vec3::splat(0.9), alpha: 0.4 },
    ];
    // A black square that hides part of the light.
    let edge = Vec3::new(-0.3, 0.0, 1.0);
    let blocker = Mesh::parallelogram(edge, Vec3::new(5.0, 0.0, 0.0), Vec3::new(0.0, 5.0, 0.0));
    let point = Vec3::new(-0.2, 0.1, 0.0);
    let hidden = |y: Vec3| {
        let at = point + (y - point) * (1.0 / (y.z - point.z));
        at.x > edge.x && at.y > edge.y
    };
    for material in materials {
        let bsdf = Bsdf::new(&material, Vec2::ZERO, true);
        for half_hidden in [false, true] {
            let truth = quadrature(point, &bsdf, CORNER, EDGE_U, EDGE_V, |y| !(half_hidden && hidden(y)));
            for shape in both_shapes() {
                let mut surfaces = vec![floor(material.clone())];
                if half_hidden {
                    surfaces.push(surface("blocker", blocker.clone(), lambert(0.0)));
                }
                // The camera looks past the blocker's edge.
                let lights = vec![light(shape.clone(), Vec3::ONE, 0.0)];
                let mut camera = spot_camera(point.x, point.y);
                camera.origin.z = 0.5;
                let film = render(surfaces, lights, camera, 1, 4096);
                let error = (f64::from(film.mean().x) / truth - 1.0).abs();
                assert!(error < 4e-3, "{material:?} hidden {half_hidden}: {} against {truth}", film.mean().x);
            }
        }
    }
}

#[test]
fn lamps_behind_frosted_glass_are_as_bright_with_a_closed_form_as_without() {
    // Of what lies behind the glass no irradiance is known in front of it: lamps are chosen without.
    let frosted = || {
        let sheet = Mesh::cuboid(Vec3::new(-4.0, -4.0, 1.0), Vec3::new(4.0, 4.0, 1.5));
        surface("sheet", sheet, Material::RoughDielectric { ior: 1.49, alpha: 0.3 })
    };
    let picture = |is_mesh: bool| {
        let lamp = |x: f32, radiance: f32| {
            let (corner, u, v) = (Vec3::new(x, -0.5, 0.0), Vec3::X, Vec3::Y);
            let shape = match is_mesh {
                true => LightShape::Mesh(Arc::new(Mesh::parallelogram(corner, u, v))),
                false => {
                    LightShape::Rectangle { center: corner + 0.5 * (u + v), half_u: 0.5 * u, half_v: 0.5 * v }
                }
            };
            light(shape, Vec3::splat(radiance), 0.0)
        };
        let lamps = vec![lamp(-1.5, 1.0), lamp(0.5, 3.0)];
        render(vec![frosted()], lamps, Camera::above(Vec3::Z * 4.0, 0.6, 16, 16), 6, 1024).mean().x
    };
    let (closed, sampled) = (picture(false), picture(true));
    assert!((closed / sampled - 1.0).abs() < 0.02, "{closed} against {sampled}");
}

#[test]
fn unhidden_direct_light_has_no_noise() {
    let shape = both_shapes()[0].clone();
    let film =
        render(vec![floor(lambert(0.5))], vec![light(shape, Vec3::ONE, 0.0)], spot_camera(0.3, 0.2), 1, 1);
    let mean = film.mean().x;
    assert!(mean > 0.0 && film.pixels.iter().all(|p| (p.x / mean - 1.0).abs() < 1e-3));
}

#[test]
fn discs_tubes_and_narrow_profiles_light_as_they_should() {
    // A disc of radius r at height h lights the floor below with E = pi r^2/(r^2 + h^2).
    let disc = LightShape::Disc { center: Vec3::Z * 2.0, normal: Vec3::NEG_Z, radius: 1.0 };
    let mut camera = spot_camera(0.0, 0.0);
    camera.origin.z = 1.0;
    let film =
        render(vec![floor(lambert(0.5))], vec![light(disc.clone(), Vec3::ONE, 0.0)], camera.clone(), 1, 4096);
    let truth = 0.5 / PI * PI / 5.0;
    assert!((film.mean().x / truth - 1.0).abs() < 3e-3, "{} against {truth}", film.mean().x);

    // With radiance cos^2 the disc's ring at rho adds 2 pi rho h^4/(rho^2 + h^2)^3:
    // E = pi (1 - h^4/(r^2 + h^2)^2)/2.
    let narrow = Light { cosine_power: 2.0, ..light(disc, Vec3::ONE, 0.0) };
    let film = render(vec![floor(lambert(0.5))], vec![narrow], camera.clone(), 1, 4096);
    let truth = 0.5 / PI * PI * (1.0 - 16.0 / 25.0) / 2.0;
    let profile = film.mean().x;
    assert!((profile / truth - 1.0).abs() < 4e-3, "{profile} against {truth}");

    // A long thin tube at distance d shows its width 2 r from every side: E = 2 r/d times the integral of
    // cos^2 over the half turn, pi/2.
    let tube =
        LightShape::Tube { from: Vec3::new(-500.0, 0.0, 2.0), to: Vec3::new(500.0, 0.0, 2.0), radius: 0.01 };
    camera.origin = Vec3::new(0.0, 0.0, 1.0);
    let film =
        render(vec![floor(lambert(0.5))], vec![light(tube, Vec3::splat(100.0), 0.0)], camera, 1, 65536);
    let truth = 100.0 * 0.5 / PI * 2.0 * 0.01 / 2.0 * (PI / 2.0);
    assert!((film.mean().x / truth - 1.0).abs() < 0.03, "{} against {truth}", film.mean().x);
}

/// A room with a bump, three lights of different kinds, glass and metal: everything at once.
fn mixed_scene() -> Scene {
    let n = 25;
    let at = |k: usize| {
        let (x, y) = ((k % n) as f32 / 3.0 - 4.0, (k / n) as f32 / 3.0 - 4.0);
        Vec3::new(x, y, (1.0 - 0.5 * (x * x + y * y)).max(0.0))
    };
    let pad = Mesh::from_lattice(n, n, (0..n * n).map(at).collect(), Vec::new());
    let coat =
        Material::FlakeCoating { albedo: Albedo::grey(0.5), flakes: 0.3, f0: Vec3::splat(0.9), alpha: 0.3 };
    let room = Mesh::open_box(Vec3::new(-4.0, -4.0, -0.2), Vec3::new(4.0, 4.0, 6.0));
    let strip = LightShape::Rectangle {
        center: Vec3::new(-3.99, 0.0, 2.0),
        half_u: Vec3::Y * 2.0,
        half_v: Vec3::Z * 0.5,
    };
    let disc = LightShape::Disc { center: Vec3::new(0.0, 3.99, 2.0), normal: Vec3::NEG_Y, radius: 0.6 };
    let tube =
        LightShape::Tube { from: Vec3::new(3.5, -2.0, 2.0), to: Vec3::new(3.5, 2.0, 2.0), radius: 0.1 };
    Scene {
        surfaces: vec![
            surface("pad", pad, coat),
            surface("room", room, lambert(0.5)),
            surface(
                "plate",
                Mesh::cuboid(Vec3::new(-4.1, -4.1, 3.0), Vec3::new(4.1, 4.1, 3.5)),
                Material::Dielectric { ior: 1.49 },
            ),
        ],
        lights: vec![
            light(strip, Vec3::new(2.0, 4.0, 12.0), 0.5),
            light(disc, Vec3::new(12.0, 3.0, 3.0), 0.5),
            light(tube, Vec3::ONE, 0.5),
        ],
        camera: Camera::above(Vec3::Z * 5.5, 0.6, 40, 30),
        max_events: 10,
    }
}

#[test]
fn pictures_do_not_depend_on_threads_and_are_finite() {
    let renderer = Renderer::new(&mixed_scene()).unwrap();
    let settings = Settings { samples: 8, seed: 3 };
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| renderer.render(&settings))
    };
    let one = with_threads(1);
    assert_eq!(one, with_threads(3));
    assert_ne!(one, renderer.render(&Settings { seed: 4, ..settings }));
    assert!(one.pixels.iter().all(|p| p.is_finite()));
}

#[test]
fn one_picture_for_each_light_adds_up() {
    let renderer = Renderer::new(&mixed_scene()).unwrap();
    let settings = Settings { samples: 8, seed: 3 };
    let whole = renderer.render(&settings);
    let parts = renderer.render_lights(&settings);
    assert_eq!(parts.len(), 3);
    for (k, p) in whole.pixels.iter().enumerate() {
        let sum: DVec3 = parts.iter().map(|f| f.pixels[k].as_dvec3()).sum();
        assert!((sum.as_vec3() - *p).abs().max_element() <= 1e-4 * p.abs().max_element().max(1e-3));
    }
    // And each is the picture with the other lights off.
    let mut scene = mixed_scene();
    // (Without the plate, through which lights are found by chance only.)
    scene.surfaces.pop();
    let basis = Renderer::new(&scene).unwrap().render_lights(&Settings { samples: 256, seed: 9 })[1].mean();
    for k in [0, 2] {
        scene.lights[k].radiance = Vec3::ZERO;
    }
    let alone = Renderer::new(&scene).unwrap().render(&Settings { samples: 256, seed: 8 }).mean();
    assert!((basis / alone - Vec3::ONE).abs().max_element() < 0.02, "{basis} against {alone}");
}

#[test]
fn a_lens_blurs_what_is_out_of_focus_and_only_that() {
    // A floor, black on the left and white on the right, under a light without noise.
    let stripes = Texture::from_fn(400, 1, |u, _| Vec3::splat(if u < 0.5 { 0.0 } else { 1.0 }));
    let floor = floor(Material::Lambert { albedo: Albedo::Texture(Arc::new(stripes)) });
    let lamp =
        LightShape::Rectangle { center: Vec3::Z * 9.0, half_u: Vec3::X * 5.0, half_v: Vec3::NEG_Y * 5.0 };
    let mut camera = Camera::above(Vec3::Z * 4.0, 0.5, 40, 4);
    // Width of the edge in pixels: 1/(steepest step).
    let width = |camera: &Camera| {
        let film =
            render(vec![floor.clone()], vec![light(lamp.clone(), Vec3::ONE, 0.0)], camera.clone(), 1, 256);
        let step = (1..40).map(|x| film.at(x, 1).x - film.at(x - 1, 1).x).fold(0.0, f32::max);
        film.at(38, 1).x / step
    };
    assert!(width(&camera) < 2.5);
    camera.lens = Some(ThinLens { aperture_radius_mm: 0.4, focus_mm: 4.0 });
    assert!(width(&camera) < 2.5);
    // Out of focus the blur has radius a |d/f - 1| = 0.4 mm, 4 pixels; its steepest step is 2/(pi r).
    camera.lens = Some(ThinLens { aperture_radius_mm: 0.4, focus_mm: 2.0 });
    let blurred = width(&camera);
    assert!((5.0..8.0).contains(&blurred), "{blurred}");
}

#[test]
fn nothing_to_see_is_black_and_what_cannot_be_rendered_is_told() {
    let scene = Scene {
        surfaces: Vec::new(),
        lights: Vec::new(),
        camera: Camera::above(Vec3::Z, 0.5, 8, 8),
        max_events: 4,
    };
    assert_eq!(Renderer::new(&scene).unwrap().render(&Settings::default()).mean(), Vec3::ZERO);
    let mut broken = mixed_scene();
    broken.camera.width = 0;
    assert!(Renderer::new(&broken).err().unwrap().to_string().contains("raster is 0 x 30"));
    let mut broken = mixed_scene();
    broken.surfaces[1].material = lambert(1.2);
    assert!(Renderer::new(&broken).err().unwrap().to_string().starts_with("room of the scene: its albedo"));
}

#[test]
fn a_plate_connection_finds_what_chance_finds() {
    // The same glass twice: as one closed box (connections through it) and with a second clear speck far away, which
    // turns the connections off. Below, inside and above the plate there are diffuse surfaces.
    let mut scene = mixed_scene();
    scene.lights.truncate(1);
    scene.lights[0].shape = LightShape::Rectangle {
        center: Vec3::new(-3.99, 0.0, 4.5),
        half_u: Vec3::Y * 3.0,
        half_v: Vec3::Z * 0.8,
    };
    scene.surfaces[0].material = lambert(0.5);
    scene.camera = scene.camera.with_raster(12, 12);
    let settings = |samples| Settings { samples, seed: 3 };
    let connected = Renderer::new(&scene).unwrap().render(&settings(512));
    let speck = Mesh::cuboid(Vec3::splat(30.0), Vec3::splat(30.1));
    scene.surfaces.push(surface("speck", speck, Material::Dielectric { ior: 1.49 }));
    let by_chance = Renderer::new(&scene).unwrap().render(&settings(4096));
    let ratio = connected.mean() / by_chance.mean();
    assert!((ratio - Vec3::ONE).abs().max_element() < 0.01, "{ratio}");
}
