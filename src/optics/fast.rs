//! The fast renderer: what changes with the pad, on top of what a sensor needs once.
//!
//! For a diffuse pad under rectangular lights the light that arrives splits into parts that are each cheap:
//! 1. *Direct light* is a vector irradiance dotted with the normal ([`vector`]), a smooth field that is tabulated once
//!    ([`tables`]). Only where the pad hides part of a light, or a light dips below the surface's own horizon, is it
//!    worked out anew: strips of the light clipped at the pad's horizon ([`horizon`]), in closed form, without noise.
//! 2. *Indirect light* comes from walls and pad of the untouched sensor, solved once ([`radiosity`] over [`world`]) and
//!    kept as irradiance over place and normal ([`probes`]). What the press itself changes in it is left out: second order.
//! 3. *What a pixel sees* is found by drawing the pad's lattice ([`raster`]), a few samples a pixel, over the
//!    fixed parts of the sensor, which are traced once.
//!
//! There are no random numbers in a frame, so no noise and no fireflies; a picture depends on scene and tolerance alone.
//! Where this does not apply (glossy coatings, lights of other shapes, lenses, plates) it refuses: the reference mode
//! renders all of them.

mod grid;
mod horizon;
mod probes;
mod radiosity;
mod raster;
mod shade;
mod tables;
mod vector;
mod world;

use super::reference::Sight;
use super::{Albedo, Camera, Error, Film, LightShape, Material, Mesh, Role, Scene, emitter::Emitter, to_pad};
use glam::{Vec2, Vec3};
use grid::{Grid, Layout};
use horizon::{Heights, Panel};
use radiosity::Radiosity;
use raster::{Projected, Sample};
use rayon::prelude::*;
use shade::Shading;
use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;
use world::World;

/// Grid of the direct tables: across and upwards, mm.
const DIRECT_STEP_MM: f32 = 0.25;
/// Heights above the untouched face that are tabulated, mm.
const DIRECT_LIFT_MM: [f32; 2] = [-0.75, 3.0];
/// Grid of the probes, mm.
const PROBE_STEP_MM: f32 = 1.0;
const PROBE_LIFT_MM: [f32; 2] = [0.0, 2.0];
const PROBE_LIFT_STEP_MM: f32 = 0.5;
/// Nodes keep this far from the pad's rim, where walls stand, mm.
const RIM_MM: f32 = 0.05;
/// Points this far below the untouched face are under it, mm.
const BURIED_MM: f32 = 0.02;
/// Samples along a pixel's edge of what is fixed.
const FIXED_GRAIN: usize = 2;

/// What a sensor needs once, from its untouched scene.
#[derive(Debug, Clone)]
pub struct Precomputed {
    /// The scene without its pad's mesh.
    fixed_scene: Scene,
    camera: Camera,
    panels: Vec<Panel>,
    radiances: Vec<Vec3>,
    direct: Vec<Grid<{ tables::NUMBERS }>>,
    probes: Grid<{ probes::NUMBERS }>,
    /// Fixed parts that samples show: inverse depth and radiance; None where no sample shows any.
    fixed: Option<Vec<(f32, Vec3)>>,
    /// This close to a light's plane its table is not used, mm.
    near_mm: f32,
}

impl Precomputed {
    /// Works out everything that does not change with the pad.
    ///
    /// # Errors
    /// When the scene is none for this mode; the message says to use the reference mode.
    pub fn new(untouched: &Scene) -> Result<Self, Error> {
        untouched.check()?;
        let pad = pad_of(untouched)?;
        if untouched.camera.lens.is_some() {
            return Err(unsupported("camera.aperture_radius_mm", "above 0", "only pinhole cameras"));
        }
        for light in &untouched.lights {
            if !world::closed_form(light) {
                let what = "only one-sided rectangular lights without an angular profile";
                return Err(unsupported("lights", &light.name, what));
            }
        }
        let world = World::new(untouched, true)?;
        let emitters: Vec<Emitter> = untouched.lights.iter().map(Emitter::new).collect();
        let lit: Vec<&super::Light> =
            untouched.lights.iter().filter(|l| l.radiance != Vec3::ZERO && l.albedo.is_finite()).collect();
        let panels: Vec<Panel> = lit.iter().filter_map(|l| panel(&l.shape)).collect();
        let radiances = lit.iter().map(|l| l.radiance).collect();

        let lattice = lattice_of(&pad.mesh)?;
        let heights = Heights::new(&pad.mesh.positions, lattice, 0.25);
        let rest = |p: Vec2| heights.at(p);
        let inf = Vec2::splat(f32::INFINITY);
        let [low, high] = pad
            .mesh
            .positions
            .iter()
            .fold([inf, -inf], |[l, h], p| [l.min(p.truncate()), h.max(p.truncate())]);
        let across = [low + RIM_MM, high - RIM_MM];
        if across[0].cmpge(across[1]).any() {
            return Err(unsupported("pad", &format!("{:?} mm across", high - low), "larger pads"));
        }
        let direct_layout =
            Layout { across, step_mm: DIRECT_STEP_MM, lift_mm: DIRECT_LIFT_MM, lift_step_mm: DIRECT_STEP_MM };
        let probe_layout = Layout {
            across,
            step_mm: PROBE_STEP_MM,
            lift_mm: PROBE_LIFT_MM,
            lift_step_mm: PROBE_LIFT_STEP_MM,
        };
        // What arrives at the pad indirectly was scattered at least once, and at the pad once more.
        let events = untouched.max_events.saturating_sub(1);
        let buried = |p: Vec3| p.z < heights.at(p.truncate()) - BURIED_MM;
        let solved = Radiosity::new(&world, &emitters, events, buried);
        Ok(Self {
            fixed_scene: without_pad_mesh(untouched),
            camera: untouched.camera.clone(),
            direct: tables::direct(&panels, &direct_layout, rest),
            probes: probes::gather(&world, &solved, &probe_layout, rest),
            fixed: fixed_samples(untouched, &world, &emitters, &solved)?,
            panels,
            radiances,
            near_mm: 2.0 * DIRECT_STEP_MM,
        })
    }

    /// The fixed part that a sample of a pixel shows.
    #[inline(always)]
    fn fixed(&self, x: usize, y: usize, u: usize, v: usize, grain: usize) -> Option<(f32, Vec3)> {
        let fixed = self.fixed.as_ref()?;
        let (u, v) = (u * FIXED_GRAIN / grain, v * FIXED_GRAIN / grain);
        Some(fixed[(y * FIXED_GRAIN + v) * self.camera.width * FIXED_GRAIN + x * FIXED_GRAIN + u])
    }
}

/// A pad as the prepared sensor sees it.
pub struct Renderer<'a> {
    once: &'a Precomputed,
    mesh: Arc<Mesh>,
    lattice: [usize; 2],
    albedo: Albedo,
    heights: Heights,
    doubts: Vec<bool>,
    grain: usize,
}

impl<'a> Renderer<'a> {
    /// Makes the scene's pad ready. `tolerance` is the relRMSE asked for.
    ///
    /// # Errors
    /// When anything but the pad's mesh differs from what was prepared, or the mesh is none for this mode.
    pub fn new(once: &'a Precomputed, scene: &Scene, tolerance: f64) -> Result<Self, Error> {
        if !(tolerance > 0.0 && tolerance <= 1.0) {
            return Err(Error::Setting {
                key: "tolerance",
                value: tolerance.to_string(),
                why: "it is a relative error above 0 and up to 1, e.g. 0.005".to_owned(),
            });
        }
        let pad = pad_of(scene)?;
        pad.mesh.check(&pad.name)?;
        if !same_but_pad_mesh(scene, &once.fixed_scene) {
            return Err(Error::Setting {
                key: "mode",
                value: "fast".to_owned(),
                why: "more than the pad's mesh has changed since the sensor was prepared; prepare it anew"
                    .to_owned(),
            });
        }
        let Material::Lambert { albedo } = &pad.material else {
            return Err(unsupported("coating", &pad.name, "only diffuse coatings"));
        };
        if matches!(albedo, Albedo::Texture(_)) && pad.mesh.uvs.is_empty() {
            return Err(Error::Scene {
                part: pad.name.clone(),
                what: "it has a texture, but its mesh has no texture coordinates".to_owned(),
                next: "give the mesh one coordinate a vertex, or use a constant albedo".to_owned(),
            });
        }
        let lattice = lattice_of(&pad.mesh)?;
        let p = &pad.mesh.positions;
        let spacing = (p[1] - p[0]).length().max((p[lattice[0]] - p[0]).length());
        let heights = Heights::new(p, lattice, (2.0 * spacing).clamp(0.05, 0.2));
        let doubts = heights.doubts(&once.panels);
        Ok(Self {
            once,
            mesh: pad.mesh.clone(),
            lattice,
            albedo: albedo.clone(),
            heights,
            doubts,
            grain: if tolerance < 0.008 { 2 } else { 1 },
        })
    }

    /// The vertices in a raster of `grain` samples along a pixel's edge, with their inverse depths.
    fn projected(&self, grain: usize) -> Vec<Vec3> {
        let camera = &self.once.camera;
        let (width, height) = (camera.width * grain, camera.height * grain);
        let scale = Vec2::new(width as f32, height as f32) * 0.5;
        let tangents = Vec2::new(camera.tan_half_x, camera.tan_half_y());
        self.mesh
            .positions
            .par_iter()
            .with_min_len(4096)
            .map(|p| {
                let to = *p - camera.origin;
                let depth = to.dot(camera.forward);
                let mut q = Vec2::new(to.dot(camera.right), to.dot(camera.up)) / depth;
                if let Some(d) = camera.distortion {
                    q = d.distort(q);
                }
                if depth <= 0.0 {
                    return Vec3::NAN;
                }
                let image = q / tangents;
                (Vec2::new(1.0 + image.x, 1.0 - image.y) * scale).extend(1.0 / depth)
            })
            .collect()
    }

    /// What the centre of each pixel sees of the pad's face, row 0 on top; None where something else is in the way.
    pub fn sights(&self) -> Vec<Option<Sight>> {
        let camera = &self.once.camera;
        let vertices = self.projected(1);
        let drawn = Projected { lattice: self.lattice, vertices: &vertices };
        let bands = drawn.bands(camera.width, camera.height, 8, |first, samples| {
            let sight = |(k, sample): (usize, &Sample)| {
                let (x, y) = (k % camera.width, first + k / camera.width);
                // The fixed part at the sample nearest to the centre.
                let hidden = self.once.fixed(x, y, 1, 1, FIXED_GRAIN).is_some_and(|f| f.0 > sample.value);
                if sample.triangle == u32::MAX || hidden {
                    return None;
                }
                let (origin, direction) = camera.ray(x as f32 + 0.5, y as f32 + 0.5, Vec2::ZERO);
                let point = origin + direction / (sample.value * direction.dot(camera.forward));
                let uv = shade::uv(&self.mesh, self.lattice[0], sample.triangle, point);
                Some(Sight { point: to_pad(point), uv })
            };
            samples.iter().enumerate().map(sight).collect::<Vec<_>>()
        });
        bands.concat()
    }

    /// The picture.
    pub fn render(&self) -> Film {
        let camera = &self.once.camera;
        let grain = self.grain;
        let (width, height) = (camera.width * grain, camera.height * grain);
        let vertices = self.projected(grain);
        let shading = Shading {
            once: self.once,
            mesh: &self.mesh,
            nx: self.lattice[0],
            albedo: &self.albedo,
            heights: &self.heights,
            doubts: &self.doubts,
            grain,
        };
        let drawn = Projected { lattice: self.lattice, vertices: &vertices };
        let bands = drawn.bands(width, height, 8 * grain, |first, samples| {
            let mut out = Vec::with_capacity(samples.len() / (grain * grain));
            for (y, rows) in samples.chunks_exact(width * grain).enumerate() {
                out.extend((0..camera.width).map(|x| shading.pixel(x, first / grain + y, rows, width)));
            }
            out
        });
        Film { width: camera.width, height: camera.height, pixels: bands.concat() }
    }
}

/// Error of a gently pressed pad of one colour, and of a textured one.
const BASE_ERROR: [f64; 2] = [0.0025, 0.0045];
/// What steep flanks add, by the rms of |n - z|^2 over the face.
const STEEP_ERROR: f64 = 0.075;

impl Renderer<'_> {
    /// What relRMSE to expect of the picture. Three constants chosen by hand on four presses of 1 to 1.5 mm (sphere,
    /// textured sphere, punch, square stamp) compared with the reference: what is left out, the light that flanks send
    /// each other, grows with their steepness. It is no bound, and no other scene has confirmed it.
    pub fn estimated_error(&self) -> f64 {
        let p = &self.mesh.positions;
        let [nx, ny] = self.lattice;
        let (mut sum, mut area) = (0.0, 0.0);
        for k in (0..nx * (ny - 1)).filter(|k| k % nx + 1 < nx) {
            let n = (p[k + nx + 1] - p[k]).cross(p[k + nx] - p[k + 1]);
            let weight = f64::from(n.length());
            let departure = f64::from((n.normalize_or_zero() - Vec3::Z).length_squared());
            sum += departure * departure * weight;
            area += weight;
        }
        let steep = STEEP_ERROR * (sum / area.max(1e-30)).sqrt();
        let base = BASE_ERROR[usize::from(matches!(self.albedo, Albedo::Texture(_)))];
        base.hypot(steep)
    }
}

fn unsupported(key: &'static str, value: &str, what: &str) -> Error {
    Error::Setting {
        key,
        value: value.to_owned(),
        why: format!("the fast mode renders {what}; set optics.mode = \"reference\" for this sensor"),
    }
}

fn pad_of(scene: &Scene) -> Result<&super::Surface, Error> {
    let mut pads = scene.surfaces.iter().filter(|s| s.role == Role::Pad);
    match (pads.next(), pads.next()) {
        (Some(pad), None) => Ok(pad),
        (found, _) => {
            let n = if found.is_some() { "several" } else { "none" };
            Err(unsupported("pad", n, "scenes with exactly one pad"))
        }
    }
}

fn lattice_of(mesh: &Mesh) -> Result<[usize; 2], Error> {
    match mesh.lattice {
        Some([nx, ny]) if nx >= 2 && ny >= 2 && mesh.positions.len() == nx * ny => Ok([nx, ny]),
        _ => Err(unsupported("pad", "no lattice", "pads whose mesh is a lattice of points")),
    }
}

fn panel(shape: &LightShape) -> Option<Panel> {
    let LightShape::Rectangle { center, half_u, half_v } = shape else { return None };
    let corner = |s: f32, t: f32| *center + *half_u * s + *half_v * t;
    Some(Panel::new([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]))
}

fn without_pad_mesh(scene: &Scene) -> Scene {
    let mut fixed = scene.clone();
    for surface in fixed.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        surface.mesh = Arc::new(Mesh::default());
    }
    fixed
}

fn same_but_pad_mesh(scene: &Scene, fixed: &Scene) -> bool {
    scene.camera == fixed.camera
        && scene.lights == fixed.lights
        && scene.max_events == fixed.max_events
        && scene.surfaces.len() == fixed.surfaces.len()
        && scene.surfaces.iter().zip(&fixed.surfaces).all(|(a, b)| {
            a.role == b.role && a.material == b.material && (a.role == Role::Pad || a.mesh == b.mesh)
        })
}

/// Traces what the camera would see without the pad.
fn fixed_samples(
    scene: &Scene,
    world: &World,
    emitters: &[Emitter],
    solved: &Radiosity,
) -> Result<Option<Vec<(f32, Vec3)>>, Error> {
    let camera = &scene.camera;
    let bare = World::new(scene, false)?;
    let (width, height) = (camera.width * FIXED_GRAIN, camera.height * FIXED_GRAIN);
    let per = 1.0 / FIXED_GRAIN as f32;
    let samples: Vec<(f32, Vec3)> = (0..width * height)
        .into_par_iter()
        .map(|k| {
            let (x, y) = (((k % width) as f32 + 0.5) * per, ((k / width) as f32 + 0.5) * per);
            let (origin, direction) = camera.ray(x, y, Vec2::ZERO);
            let Some(met) = bare.trace(origin, direction) else { return (f32::NEG_INFINITY, Vec3::ZERO) };
            let inverse_depth = 1.0 / (met.hit.t * direction.dot(camera.forward));
            // Its radiance is that of the whole sensor, pad included; what the pad hides is not shown anyway.
            let to = direction * (met.hit.t * 1.001);
            let radiance = match world.trace(origin, direction) {
                Some(whole) if (whole.hit.point - origin).length() >= to.length() * 0.998 => {
                    let mut radiance =
                        met.albedo * FRAC_1_PI * world.direct(met.hit.point, met.normal, met.light, emitters);
                    radiance += solved.direct_free(whole.element);
                    if let Some(light) = met.light.filter(|_| met.front) {
                        radiance += emitters[light].radiance;
                    }
                    radiance
                }
                _ => Vec3::ZERO,
            };
            (inverse_depth, radiance)
        })
        .collect();
    Ok(samples.iter().any(|s| s.0.is_finite()).then_some(samples))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{bench_scene, reference};
    use std::sync::LazyLock;

    const SCENE: &str = include_str!("../../tests/data/optics/tactile-bench-1.json");

    /// The benchmark scene on a coarse lattice with another pad.
    fn scene(variant: bench_scene::Variant, height: impl Fn(f32, f32) -> f32) -> Scene {
        let mut scene = bench_scene::parse(SCENE, variant).unwrap();
        scene.camera = scene.camera.with_raster(64, 48);
        let (nx, ny) = (201, 151);
        let at = |k: usize| Vec2::new((k % nx) as f32 * 0.1 - 10.0, (k / nx) as f32 * 0.1 - 7.5);
        let positions = (0..nx * ny).map(|k| at(k).extend(height(at(k).x, at(k).y))).collect();
        let uvs = (0..nx * ny).map(|k| (at(k) + Vec2::new(10.0, 7.5)) / Vec2::new(20.0, 15.0)).collect();
        scene.surfaces[0].mesh = Arc::new(Mesh::from_lattice(nx, ny, positions, uvs));
        scene
    }

    fn sphere(x: f32, y: f32) -> f32 {
        let r = (x - 1.5).hypot(y + 1.0);
        if r < 2.0 { (16.0 - r * r).sqrt() - 3.0 } else { 0.4641 * (-1.244 * (r - 2.0)).exp() }
    }

    fn punch(x: f32, y: f32) -> f32 {
        let r = (x + 3.0).hypot(y - 2.0);
        if r < 2.5 { 1.5 } else { 1.5 * (-1.6 * (r - 2.5)).exp() }
    }

    static ONCE: LazyLock<Precomputed> =
        LazyLock::new(|| Precomputed::new(&scene(bench_scene::Variant::Ac, |_, _| 0.0)).unwrap());

    /// relRMSE against the reference, its own noise taken off, and the ratio of means.
    fn against_reference(scene: &Scene, fast: &Film) -> (f64, Vec3) {
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
            ("flat", |_, _| 0.0, 0.005),
        ] {
            let scene = scene(bench_scene::Variant::Ac, height);
            let renderer = Renderer::new(&ONCE, &scene, 0.005).unwrap();
            let film = renderer.render();
            let (error, means) = against_reference(&scene, &film);
            assert!(error < bound, "{name}: {error}");
            assert!((means - Vec3::ONE).abs().max_element() < 0.004, "{name}: {means}");
            assert!(error < 1.5 * renderer.estimated_error() + 0.002, "{name}: {error}");
            // No pixel is out of what its neighbourhood could be.
            let most = film.mean() * 8.0;
            assert!(
                film.pixels.iter().all(|p| p.is_finite() && p.cmpge(Vec3::ZERO).all() && p.cmple(most).all())
            );
        }
    }

    #[test]
    fn a_textured_pad_agrees_with_the_reference() {
        let flat = scene(bench_scene::Variant::At, |_, _| 0.0);
        let once = Precomputed::new(&flat).unwrap();
        let scene = scene(bench_scene::Variant::At, sphere);
        let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
        let (error, means) = against_reference(&scene, &film);
        // Four samples a pixel meet dots of about three pixels here.
        assert!(error < 0.02 && (means - Vec3::ONE).abs().max_element() < 0.005, "{error} {means}");
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
    fn what_it_cannot_render_it_refuses_and_names_the_reference() {
        let refused = |change: &dyn Fn(&mut Scene)| {
            let mut scene = scene(bench_scene::Variant::Ac, |_, _| 0.0);
            change(&mut scene);
            let message = Precomputed::new(&scene).unwrap_err().to_string();
            assert!(message.contains("reference"), "{message}");
        };
        refused(&|s| s.surfaces[0].material = Material::RoughConductor { f0: Vec3::ONE, alpha: 0.2 });
        refused(&|s| s.lights[1].cosine_power = 2.0);
        refused(&|s| {
            s.lights[0].shape = LightShape::Disc { center: Vec3::Z, normal: Vec3::NEG_Z, radius: 1.0 };
        });
        refused(&|s| *s = bench_scene::parse(SCENE, bench_scene::Variant::B).unwrap());
        let mut moved = scene(bench_scene::Variant::Ac, sphere);
        moved.lights[0].radiance *= 2.0;
        assert!(Renderer::new(&ONCE, &moved, 0.005).is_err());
    }
}
