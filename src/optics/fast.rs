//! The fast renderer: what changes with the pad, on top of what a sensor needs once.
//!
//! For a diffuse pad the light that arrives splits into parts that are each cheap:
//! 1. *Direct light* is a vector irradiance dotted with the normal ([`vector`]), a smooth field over space
//!    ([`tables`]). Where the pad hides part of a light, or a light dips below the surface's own horizon, what is below
//!    the cut is taken off: ribbons ([`source`]) cut at the pad's horizon ([`horizon`]), in closed form, without noise.
//! 2. *Indirect light* comes from walls and pad of the untouched sensor, solved once ([`radiosity`] over [`world`]) and
//!    kept as irradiance over place and normal ([`probes`]). What the press itself changes in it is added as one bounce
//!    on a coarse raster ([`bounce`]), which knows by direction what walls it hides ([`skyline`]).
//! 3. *What a pixel sees* is found by drawing the pad's lattice ([`raster`]) over the corners of pixels; fields and
//!    horizons are worked out at nodes a few pixels apart and interpolated ([`frame`], [`desk`], [`shade`]), but for
//!    [`crease`]s, which are sampled.
//!
//! There are no random numbers in a frame, so no noise and no fireflies; a picture depends on scene and tolerance alone.
//! Where this does not apply (glossy coatings, mesh lights, thin lenses) it refuses with [`Error::NotFast`], and the
//! [imager](super::imager) falls back to the reference mode, which renders all of them.

mod bounce;
mod crease;
mod desk;
mod echo;
mod estimate;
mod exchange;
mod fixed;
mod frame;
mod grid;
mod ground;
mod horizon;
mod lanes;
mod lookout;
mod plate;
mod probes;
mod radiosity;
mod raster;
mod record;
mod shade;
mod skyline;
mod slots;
mod source;
mod tables;
pub(super) mod vector;
mod view;
mod world;

use super::basis::LightBasis;
use super::reference::Sight;
use super::{Albedo, Error, Film, Material, Mesh, Role, Scene, to_pad};
use echo::Echo;
use frame::{Effort, Frame};
use glam::{Vec2, Vec3};
use grid::{Grid, Layout};
use horizon::Heights;
use plate::Slab;
use radiosity::Radiosity;
use raster::Projected;
use rayon::prelude::*;
use slots::Slots;
use source::{Lamp, Source};
use std::sync::Arc;
use view::View;
use world::World;

/// Grid of the direct tables: across and upwards, mm.
const DIRECT_STEP_MM: f32 = 0.5;
/// Heights above the untouched face that are tabulated, mm.
const DIRECT_LIFT_MM: [f32; 2] = [-0.75, 3.0];
/// Grid of the probes, mm.
const PROBE_STEP_MM: f32 = 1.0;
const PROBE_LIFT_MM: [f32; 2] = [0.0, 2.0];
const PROBE_LIFT_STEP_MM: f32 = 0.5;
/// Nodes keep this far from the pad's rim, where walls stand, mm.
const RIM_MM: f32 = 0.05;
/// Smallest and largest extent of a pad, mm.
const PAD_MM: [f32; 2] = [4.0, 200.0];
/// Points this far below the untouched face are under it, mm.
const BURIED_MM: f32 = 0.02;
/// Most points along an edge of the pad in the world that light is solved in: the untouched face is smooth.
const WORLD_POINTS: usize = 81;

/// What a sensor needs once, from its untouched scene.
#[derive(Debug, Clone)]
pub struct Precomputed {
    /// The scene without its pad's mesh.
    fixed_scene: Scene,
    /// Samples along the edge of a pixel: more than one where the pad's lattice is finer than pixels.
    grain: usize,
    /// The camera with that many times its pixels.
    view: View,
    sources: Vec<Source>,
    radiances: Vec<Vec3>,
    tables: Tables,
    /// Indirect light of all lights together.
    total: Grid<{ probes::NUMBERS }>,
    /// Walls low over the face in the light of all.
    skyline: Grid<{ skyline::NUMBERS }>,
    /// Indirect light by light in one number for three colours, where nothing in the sensor has a colour.
    greys: Option<Vec<Grid<{ probes::TERMS }>>>,
    /// Irradiance of the untouched face: of all lights together, and by light.
    grounds: Vec<Grid<3>>,
    /// What of the fixed parts shows, of all lights together, by corner.
    fixed_total: Vec<Vec3>,
    /// What a plate mirrors into each pixel, and the part of the pad's light that it lets through; empty without one.
    veil_total: Vec<Vec3>,
    transmitted: Vec<f32>,
    /// Extent of a pixel on the untouched face, mm.
    pixel_mm: f32,
}

/// What takes long to work out. All of it is for lights of radiance 1.
#[derive(Debug, Clone, PartialEq)]
struct Tables {
    /// By light, where it has no closed form.
    direct: Vec<Option<Grid<3>>>,
    /// By light.
    probes: Vec<Grid<{ probes::NUMBERS }>>,
    /// By light: walls low over the face.
    skylines: Vec<Grid<{ skyline::NUMBERS }>>,
    /// Fixed parts that corners of pixels see: inverse depth, and radiance by light; empty where none sees any.
    fixed: Vec<f32>,
    fixed_lights: Vec<Vec<Vec3>>,
    /// What a plate mirrors into each pixel, by light; empty without one.
    veils: Vec<Vec<Vec3>>,
    /// What walls give back of a press; none where light is scattered too seldom, or the face is curved.
    echo: Option<Echo>,
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
        let sources = sources_of(untouched)?;
        if sources.is_empty() {
            return Err(unsupported("lights", "none", "scenes with a light"));
        }
        let slab = Slab::of(untouched)?;
        let world = World::new(&coarse(untouched)?, true)?;
        let lamps: Vec<Lamp> = untouched.lights.iter().filter_map(Lamp::new).collect();

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
        let size = high - low;
        if !(size.min_element() >= PAD_MM[0] && size.max_element() <= PAD_MM[1]) {
            let value = format!("{} x {} mm", size.x, size.y);
            return Err(unsupported("pad", &value, "pads of 4 to 200 mm, for which its steps are chosen"));
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
        // (Through a plate about every second event is one of its faces.)
        let events = match slab {
            Some(_) => (untouched.max_events / 2).saturating_sub(1).max(1),
            None => untouched.max_events.saturating_sub(1),
        };
        let buried = |p: Vec3| p.z < heights.at(p.truncate()) - BURIED_MM;
        let solved = Radiosity::new(&world, &lamps, events, buried);
        let view = View::new(&fine_camera(untouched)?, slab);
        let (fixed, fixed_lights) = fixed::corners(untouched, &view, &world, &lamps, &solved)?;
        let cell_px = bounce::SENDING * frame::cell_px(pixel_mm(&view));
        let echo = Echo::new(&world, &view, cell_px, &probe_layout, events, rest, buried);
        let tables = Tables {
            echo,
            direct: tables::direct(&sources, slab.as_ref(), &direct_layout, rest),
            probes: probes::gather(&world, &solved, &probe_layout, rest),
            skylines: skyline::gather(&world, &solved, &probe_layout, rest),
            fixed,
            fixed_lights,
            veils: slab.map_or_else(Vec::new, |slab| fixed::veils(&view, &slab, &world, &solved)),
        };
        Ok(Self::assemble(untouched, view, sources, tables))
    }

    /// From what [`Precomputed::encode`] gave for a scene of the same key; None when the bytes are not that.
    ///
    /// # Errors
    /// When the scene is none for this mode.
    pub fn decode(untouched: &Scene, bytes: &[u8]) -> Result<Option<Self>, Error> {
        untouched.check()?;
        let sources = sources_of(untouched)?;
        let Some(tables) = record::decode(bytes) else { return Ok(None) };
        let view = View::new(&fine_camera(untouched)?, Slab::of(untouched)?);
        let [columns, rows] = view.corners();
        let pixels = view.camera.width * view.camera.height;
        let corners = |n: usize| n == 0 || n == columns * rows;
        let fits = tables.direct.len() == sources.len()
            && corners(tables.fixed.len())
            && tables.fixed_lights.iter().all(|l| l.len() == tables.fixed.len())
            && tables.veils.iter().all(|v| v.len() == pixels)
            && (tables.veils.is_empty() == view.slab.is_none())
            && tables.echo.as_ref().is_none_or(|echo| echo.size == cells_of(&view));
        Ok(fits.then(|| Self::assemble(untouched, view, sources, tables)))
    }

    fn assemble(untouched: &Scene, view: View, sources: Vec<Source>, tables: Tables) -> Self {
        let radiances: Vec<Vec3> = untouched.lights.iter().map(|l| l.radiance).collect();
        let mut fixed_total = vec![Vec3::ZERO; tables.fixed.len()];
        for (light, radiance) in tables.fixed_lights.iter().zip(&radiances) {
            fixed_total.iter_mut().zip(light).for_each(|(sum, l)| *sum += *l * *radiance);
        }
        let camera = &view.camera;
        let pixels = camera.width * camera.height;
        let mut veil_total = vec![Vec3::ZERO; if tables.veils.is_empty() { 0 } else { pixels }];
        for (light, radiance) in tables.veils.iter().zip(&radiances) {
            veil_total.iter_mut().zip(light).for_each(|(sum, l)| *sum += *l * *radiance);
        }
        let transmitted = view.slab.map_or_else(Vec::new, |slab| {
            let width = view.camera.width;
            let centre = |k: usize| Vec2::new((k % width) as f32 + 0.5, (k / width) as f32 + 0.5);
            (0..pixels)
                .map(|k| slab.transmitted(view.camera.ray(centre(k).x, centre(k).y, Vec2::ZERO).1))
                .collect()
        });
        let pixel_mm = pixel_mm(&view);
        Self {
            fixed_scene: without_pad_mesh(untouched),
            grain: view.camera.width / untouched.camera.width,
            grounds: ground::grounds(&sources, &tables, &radiances),
            total: probes::total(&tables.probes, &radiances),
            skyline: probes::total(&tables.skylines, &radiances),
            greys: tables.probes.iter().map(probes::grey).collect(),
            view,
            sources,
            radiances,
            tables,
            fixed_total,
            veil_total,
            transmitted,
            pixel_mm,
        }
    }

    /// The same sensor with lights of other radiances, one a light: what was worked out holds for all.
    ///
    /// # Errors
    /// When there is not one radiance for each light.
    pub fn with_radiances(&self, radiances: &[Vec3]) -> Result<Self, Error> {
        let lights = self.fixed_scene.lights.len();
        if radiances.len() != lights {
            return Err(Error::Setting {
                key: "lights",
                value: format!("{} radiances", radiances.len()),
                why: format!("the sensor has {lights} lights; give one radiance each"),
            });
        }
        Ok(self.lit_by(radiances))
    }

    fn lit_by(&self, radiances: &[Vec3]) -> Self {
        let mut scene = self.fixed_scene.clone();
        scene.lights.iter_mut().zip(radiances).for_each(|(light, radiance)| light.radiance = *radiance);
        Self::assemble(&scene, self.view.clone(), self.sources.clone(), self.tables.clone())
    }

    /// The value of the fixed part that a corner of a pixel sees.
    #[inline(always)]
    fn fixed(&self, x: usize, y: usize) -> Option<f32> {
        let [columns, _] = self.view.corners();
        (!self.tables.fixed.is_empty()).then(|| self.tables.fixed[y * columns + x])
    }

    /// Its light in picture `film` of `films`.
    fn fixed_light(&self, film: usize, films: usize, x: usize, y: usize) -> Vec3 {
        let k = y * self.view.corners()[0] + x;
        let lights = if films == 1 { &self.fixed_total } else { &self.tables.fixed_lights[film] };
        lights.get(k).copied().unwrap_or(Vec3::ZERO)
    }

    /// Part of the pad's light that reaches pixel (x, y).
    #[inline(always)]
    fn transmitted(&self, x: usize, y: usize) -> f32 {
        self.transmitted.get(y * self.view.camera.width + x).copied().unwrap_or(1.0)
    }

    /// Light that a plate mirrors into a pixel of picture `film` of `films`.
    #[inline(always)]
    fn veil(&self, film: usize, films: usize, x: usize, y: usize) -> Vec3 {
        if self.veil_total.is_empty() {
            return Vec3::ZERO;
        }
        let veil = if films == 1 { &self.veil_total } else { &self.tables.veils[film] };
        veil[y * self.view.camera.width + x]
    }
}

/// Cells that send towards walls, along x and y of a view.
fn cells_of(view: &View) -> [usize; 2] {
    let edge = bounce::SENDING * frame::cell_px(pixel_mm(view));
    [view.camera.width.div_ceil(edge), view.camera.height.div_ceil(edge)]
}

/// Extent of a pixel on the untouched face, mm.
fn pixel_mm(view: &View) -> f32 {
    let camera = &view.camera;
    // A plate lifts what is below it.
    let lifted = view.slab.map_or(0.0, |slab| (slab.high - slab.low) * (1.0 - 1.0 / slab.ior));
    2.0 * camera.tan_half_x * (camera.origin.z.abs() - lifted) / camera.width as f32
}

/// A pad as the prepared sensor sees it.
pub struct Renderer<'a> {
    once: &'a Precomputed,
    mesh: Arc<Mesh>,
    lattice: [usize; 2],
    albedo: Albedo,
    heights: Heights,
    effort: Effort,
    tolerance: f64,
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
        if !p.par_iter().with_min_len(65_536).all(|p| p.is_finite()) {
            // The full check names the vertex.
            pad.mesh.check(&pad.name)?;
        }
        let lift = p.iter().step_by(1 + p.len() / 4096).map(|p| once.total.lift(*p));
        let [low, high] = lift.fold([0.0f32; 2], |[l, h], lift| [l.min(lift), h.max(lift)]);
        if low < 2.0 * DIRECT_LIFT_MM[0] || high > DIRECT_LIFT_MM[1] {
            let value = format!("{low} to {high} mm above its untouched face");
            return Err(unsupported("pad", &value, "pads that move by -1.5 to 3 mm"));
        }
        let mut effort = Effort::for_tolerance(tolerance);
        // Without interreflection there is no bounce to look for.
        let dark = matches!(albedo, Albedo::Constant(a) if *a == Vec3::ZERO);
        effort.bounce = scene.max_events > 1 && !dark;
        Ok(Self {
            once,
            mesh: pad.mesh.clone(),
            lattice,
            albedo: albedo.clone(),
            heights: Heights::of(&pad.mesh, lattice, effort.cell),
            effort,
            tolerance,
        })
    }

    /// Does what this scene does not need as well: shadow tests where no light can be hidden, the bounce where nothing
    /// reflects. For measuring what leaving it out saves.
    pub fn thorough(mut self) -> Self {
        (self.effort.thorough, self.effort.bounce) = (true, true);
        self
    }

    /// The vertices in a raster of pixels.
    fn projected(&self) -> Vec<Vec3> {
        let positions = self.mesh.positions.par_iter().with_min_len(4096);
        positions.map(|p| self.once.view.project(*p)).collect()
    }

    /// What the centre of each pixel sees of the pad's face, row 0 on top; None where something else is in the way.
    pub fn sights(&self) -> Vec<Option<Sight>> {
        let view = &self.once.view;
        let grain = self.once.grain;
        let (width, height) = (view.camera.width / grain, view.camera.height / grain);
        let mut vertices = self.projected();
        let share = 1.0 / grain as f32;
        vertices.par_iter_mut().with_min_len(4096).for_each(|v| *v *= Vec3::new(share, share, 1.0));
        let samples =
            Projected { lattice: self.lattice, vertices: &vertices, offset: 0.5 }.draw(width, height);
        let sight = |(k, sample): (usize, &raster::Sample)| {
            let (x, y) = (k % width, k / width);
            // The fixed part at the corner at the middle, or below and to the right of it.
            let corner = [x, y].map(|c| c * grain + grain.div_ceil(2));
            let hidden = self.once.fixed(corner[0], corner[1]).is_some_and(|value| value > sample.value);
            if sample.triangle == u32::MAX || hidden {
                return None;
            }
            let ray = view.ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * grain as f32);
            let point = View::point(ray, sample.value);
            let uv = frame::uv(&self.mesh, self.lattice[0], sample.triangle, point);
            Some(Sight { point: to_pad(point), uv })
        };
        samples.par_iter().with_min_len(4096).enumerate().map(sight).collect()
    }

    /// The picture.
    pub fn render(&self) -> Film {
        self.render_with_error().0
    }

    /// The picture and what relRMSE to expect of it. Where that would be above the tolerance, and more work would help, more is
    /// done.
    pub fn render_with_error(&self) -> (Film, f64) {
        let (mut pictures, error) = self.within_tolerance();
        (pictures.films.swap_remove(0), error)
    }

    /// One picture for each light of radiance 1, in the scene's order.
    pub fn basis(&self) -> LightBasis {
        let names = self.once.fixed_scene.lights.iter().map(|l| l.name.clone()).collect();
        let n = self.once.sources.len();
        let films = match n {
            // A single picture is one of all lights together: here of a white one.
            1 => self.pictures_of(&self.once.lit_by(&[Vec3::ONE]), 1).films,
            _ => self.pictures(n).films,
        };
        LightBasis { names, films }
    }

    fn pictures(&self, films: usize) -> frame::Pictures {
        self.pictures_of(self.once, films)
    }

    fn pictures_of(&self, once: &Precomputed, films: usize) -> frame::Pictures {
        let [columns, rows] = once.view.corners();
        let vertices = self.projected();
        let seen = Projected { lattice: self.lattice, vertices: &vertices, offset: 0.0 }.draw(columns, rows);
        let varying = once.sources.iter().any(|s| !s.is_fixed());
        let grey = films > 1 && once.greys.is_some();
        let frame = Frame {
            once,
            mesh: &self.mesh,
            nx: self.lattice[0],
            albedo: &self.albedo,
            heights: &self.heights,
            seen: &seen,
            vertices: &vertices,
            effort: self.effort,
            slots: Slots::new(once.sources.len(), films, varying, once.view.slab.is_some(), grey),
            level: 0.0,
        };
        let mut pictures = frame.render();
        let grain = once.grain;
        if grain > 1 {
            pictures.films.iter_mut().for_each(|film| *film = film.shrunk(grain));
            // Errors of neighbours average out over a pixel, changes do not.
            pictures.spread /= (grain * grain).pow(2) as f64;
            pictures.bounced /= (grain * grain) as f64;
        }
        pictures
    }
}

fn unsupported(key: &'static str, value: &str, what: &str) -> Error {
    Error::NotFast { key, value: value.to_owned(), what: what.to_owned() }
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

/// The scene's camera with so many times its pixels that they are not coarser than the pad's lattice.
fn fine_camera(scene: &Scene) -> Result<super::Camera, Error> {
    let camera = &scene.camera;
    let mesh = &pad_of(scene)?.mesh;
    let [nx, _] = lattice_of(mesh)?;
    let p = &mesh.positions;
    let spacing = (p[1] - p[0]).length().max((p[nx] - p[0]).length());
    let pixel = 2.0 * camera.tan_half_x * camera.origin.z.abs() / camera.width as f32;
    let grain = if spacing > 0.0 { (pixel / spacing).round() as usize } else { 1 };
    let grain = grain.clamp(1, MOST_GRAIN);
    Ok(camera.with_raster(camera.width * grain, camera.height * grain))
}

/// Most samples along the edge of a pixel.
const MOST_GRAIN: usize = 4;

fn sources_of(scene: &Scene) -> Result<Vec<Source>, Error> {
    let source = |light: &super::Light| {
        Source::new(light)
            .ok_or_else(|| unsupported("lights", &light.name, "only one-sided lights that are no meshes"))
    };
    scene.lights.iter().map(source).collect()
}

/// The same scene with a pad of no more points than light between walls needs.
fn coarse(scene: &Scene) -> Result<Scene, Error> {
    let mut out = scene.clone();
    for surface in out.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        let [nx, ny] = lattice_of(&surface.mesh)?;
        let picked = |n: usize| -> Vec<usize> {
            let m = n.min(WORLD_POINTS);
            (0..m).map(|k| k * (n - 1) / (m - 1)).collect()
        };
        let (columns, rows) = (picked(nx), picked(ny));
        let at = |k: usize| rows[k / columns.len()] * nx + columns[k % columns.len()];
        let positions = (0..rows.len() * columns.len()).map(|k| surface.mesh.positions[at(k)]).collect();
        surface.mesh = Arc::new(Mesh::from_lattice(columns.len(), rows.len(), positions, Vec::new()));
    }
    Ok(out)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{LightShape, bench_scene, reference};
    use std::f32::consts::FRAC_1_PI;
    use std::sync::LazyLock;

    const SCENE: &str = include_str!("../../tests/data/optics/tactile-bench-1.json");

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

    fn sphere(x: f32, y: f32) -> f32 {
        let r = (x - 1.5).hypot(y + 1.0);
        if r < 2.0 { (16.0 - r * r).sqrt() - 3.0 } else { 0.4641 * (-1.244 * (r - 2.0)).exp() }
    }

    pub(super) fn punch(x: f32, y: f32) -> f32 {
        let r = (x + 3.0).hypot(y - 2.0);
        if r < 2.5 { 1.5 } else { 1.5 * (-1.6 * (r - 2.5)).exp() }
    }

    /// The same with an untouched pad.
    fn flat(scene: &Scene) -> Scene {
        let mut flat = scene.clone();
        let mesh = Arc::make_mut(&mut flat.surfaces[0].mesh);
        mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
        flat
    }

    pub(super) static ONCE: LazyLock<Precomputed> =
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
        let film = Renderer::new(&once, &single, 0.005).unwrap().render();
        let (error, _) = against_reference(&single, &film);
        assert!(error < 0.006, "{error}");
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
        let mut moved = scene(bench_scene::Variant::Ac, sphere);
        moved.lights[0].radiance *= 2.0;
        assert!(Renderer::new(&ONCE, &moved, 0.005).is_err());
    }
}
