//! The fast renderer: what changes with the pad, on top of what a sensor needs once.
//!
//! For a diffuse pad the light that arrives splits into parts that are each cheap:
//! 1. *Direct light* is a vector irradiance dotted with the normal ([`vector`]), a smooth field over space
//!    ([`tables`]). Where the pad hides part of a light, or a light dips below the surface's own horizon, what is below
//!    the cut is taken off: ribbons ([`source`]) cut at the pad's horizon ([`horizon`]), in closed form, without noise.
//! 2. *Indirect light* comes from walls and pad of the untouched sensor, solved once ([`radiosity`] over [`world`]) and
//!    kept as irradiance over place and normal ([`probes`]). What the press itself changes in it is added as one bounce
//!    on a coarse raster ([`bounce`]), which knows by direction what walls it hides ([`skyline`]) and what the picture does not
//!    show of the pad ([`unseen`]).
//! 3. *What a pixel sees* is found by drawing the pad's lattice ([`raster`]) over the corners of pixels; fields and
//!    horizons are worked out at nodes a few pixels apart and interpolated ([`frame`], [`desk`], [`shade`]), but for
//!    [`crease`]s, which are sampled.
//!
//! 4. *Between flanks* that face each other one bounce is not enough: there a picture that is well above its tolerance has its
//!    bounced light [traced] by a few paths, smoothed over what is [alike].
//!
//! Those paths' random numbers follow from the pixel, so a picture depends on scene and tolerance alone; in all other pictures there
//! are none, so no noise and no fireflies.
//! Where this does not apply (glossy coatings, mesh lights, thin lenses, baffles, domes) it refuses with [`Error::NotFast`], and the
//! [imager](super::imager) falls back to the reference mode, which renders all of them.

mod alike;
mod around_lamps;
mod arrival;
mod bounce;
mod byway;
mod cover;
mod crease;
mod desk;
mod echo;
mod eclipse;
mod estimate;
mod exchange;
mod facet;
mod fixed;
mod frame;
mod gains;
mod glow;
mod grid;
mod ground;
mod grouping;
mod horizon;
mod lanes;
mod lookout;
mod mirrored;
mod nodes;
mod notches;
mod packed;
mod pad_image;
mod parted;
mod piece;
mod plate;
mod probes;
mod profile;
mod radiosity;
mod raster;
mod record;
mod renderer;
mod rim;
mod shade;
mod skyline;
mod slots;
mod source;
mod suited;
mod tables;
mod tilt;
mod toward;
mod traced;
mod traces;
mod unseen;
pub(super) mod vector;
mod view;
mod wall_shadow;
mod world;

use super::{Error, Scene};
use cover::Covers;
use echo::Echo;
use fixed::Looks;
use glam::{Vec2, Vec3};
use glow::Glow;
use grid::{Grid, Layout};
use horizon::Heights;
use mirrored::Mirrored;
use plate::Slab;
use radiosity::Radiosity;
pub use renderer::Renderer;
use source::{Lamp, Source};
use suited::{
    coarse, fine_camera, lattice_of, lights_clear_of_camera, lights_clear_of_face, lights_off_face,
    lit_from_within, nothing_within, pad_of, sources_of, unsupported, without_pad_mesh,
};
use view::View;
use world::World;

/// Grid of the direct tables: across and upwards, mm. Like the probes' it is finer over small pads.
const DIRECT_STEP_MM: f32 = 0.5;
/// Heights above the untouched face that are tabulated, mm.
const DIRECT_LIFT_MM: [f32; 2] = [-0.75, 3.0];
/// Grid of the probes, mm.
const PROBE_STEP_MM: f32 = 1.0;
const PROBE_LIFT_MM: [f32; 2] = [0.0, 2.0];
const PROBE_LIFT_STEP_MM: f32 = 0.5;
/// How far under a plate tables end, mm.
const UNDER_PLATE_MM: f32 = 0.01;
/// Nodes keep this far from the pad's rim, where walls stand, mm.
const RIM_MM: f32 = 0.05;
/// relRMSE that may be asked for: finer work than the first gives nothing, beyond the second a picture is none.
pub const TOLERANCES: [f64; 2] = [1e-4, 0.5];
/// Between these a tolerance picks the work. Finer work than the first takes brings a picture hardly nearer to the truth, since what the
/// method leaves out stays; coarser work than the second there is none, but that pictures which state more are not looked at again.
pub const WORKED: [f64; 2] = [0.002, 0.01];
/// Smallest and largest extent of a pad, mm.
const PAD_MM: [f32; 2] = [4.0, 200.0];
/// Points this far below the untouched face are under it, mm.
const BURIED_MM: f32 = 0.02;

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
    /// Whether walls low over the face have no colour either.
    is_skyline_grey: bool,
    /// Irradiance of the untouched face: of all lights together, and by light.
    grounds: Vec<Grid<3>>,
    /// What of the fixed parts shows, of all lights together, by corner.
    fixed_total: Vec<Vec3>,
    /// What covers pixels in part, of all lights together.
    cover_total: Vec<Vec3>,
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
    /// Pixels that they cover in part.
    covers: Covers,
    /// What of them a press may light; nothing where the face is curved.
    glow: Glow,
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
        if let Some(lens) = &untouched.camera.lens {
            let value = lens.aperture_radius_mm.to_string();
            return Err(unsupported(
                "camera.aperture_radius_mm",
                &value,
                "only pinholes, whose aperture is 0",
            ));
        }
        let sources = sources_of(untouched)?;
        if sources.is_empty() {
            return Err(unsupported("lights", "none", "scenes with a light"));
        }
        nothing_within(untouched)?;
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
        let fineness = world::fineness(untouched);
        let across = [low + fineness * RIM_MM, high - fineness * RIM_MM];
        let size = high - low;
        if !(size.min_element() >= PAD_MM[0] && size.max_element() <= PAD_MM[1]) {
            let value = format!("{} x {} mm", size.x, size.y);
            return Err(unsupported("pad", &value, "pads of 4 to 200 mm, for which its steps are chosen"));
        }
        lit_from_within(untouched, [low, high], rest)?;
        let view = View::new(&fine_camera(untouched)?, slab);
        lights_clear_of_face(&untouched.lights, pad, &view, [low, high], rest)?;
        lights_clear_of_camera(&untouched.lights, &untouched.camera)?;
        eclipse::none(&untouched.lights, &sources, [low, high], rest)?;
        // (Beside a level face walls are parted, and light finds its own way.)
        let level = parted::level_of(untouched);
        // Tables end under a plate, where light changes at once.
        let room_mm = match (slab, level) {
            (Some(slab), Some(level)) => (slab.low - level - UNDER_PLATE_MM).max(UNDER_PLATE_MM),
            _ => f32::INFINITY,
        };
        let under_plate = |[low, high]: [f32; 2]| [low, high.min(room_mm)];
        let direct_layout = Layout {
            across,
            step_mm: fineness * DIRECT_STEP_MM,
            lift_mm: under_plate(DIRECT_LIFT_MM),
            lift_step_mm: fineness * DIRECT_STEP_MM,
        };
        let probe_layout = Layout {
            across,
            step_mm: fineness * PROBE_STEP_MM,
            lift_mm: under_plate(PROBE_LIFT_MM),
            lift_step_mm: fineness * PROBE_LIFT_STEP_MM,
        };
        // How often what a press changes may have been scattered before, and at the pad is once more. (Of so little it is enough that
        // through a plate about every second event is one of its faces.)
        let scatterings = match slab {
            Some(_) => untouched.max_events / 2 - 1,
            None => untouched.max_events.saturating_sub(1),
        };
        let buried = |p: Vec3| level.is_none() && p.z < heights.at(p.truncate()) - BURIED_MM;
        let solved = Radiosity::new(&world, &lamps, slab, untouched.max_events, buried);
        lights_off_face(&untouched.lights, &view, pixel_mm(&view), [low, high], rest)?;
        let top = pad.mesh.positions.iter().fold(f32::NEG_INFINITY, |top, p| top.max(p.z));
        let high = top + DIRECT_LIFT_MM[1];
        let looks = Looks::new(untouched, &view, &world, &lamps, &solved, high, &buried)?;
        let corners = looks.corners();
        let covers = Covers::new(&looks, &corners, view.corners(), lamps.len());
        let glow = match level {
            Some(_) if scatterings > 0 => {
                let edge = frame::cell_px(pixel_mm(&view));
                Glow::new(&looks, &corners, &covers, view.corners()[0], edge)
            }
            _ => Glow::default(),
        };
        let (fixed, fixed_lights) = fixed::by_light(&corners, lamps.len());
        let echo = Echo::new(&world, &view, &lamps, &probe_layout, scatterings, rest, buried);
        let mirrored = Mirrored::new(&world, &lamps, slab);
        let tables = Tables {
            echo,
            direct: tables::direct(&sources, slab.as_ref(), &direct_layout, rest),
            probes: probes::gather(&world, &mirrored, &solved, &probe_layout, rest),
            skylines: skyline::gather(&world, &solved, &mirrored, &probe_layout, rest),
            fixed,
            fixed_lights,
            covers,
            glow,
            veils: slab.map_or_else(Vec::new, |slab| fixed::veils(&view, &slab, &world, &lamps, &solved)),
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
            && tables.covers.fit(pixels)
            && tables.glow.fit(pixels, sources.len())
            && tables.veils.iter().all(|v| v.len() == pixels)
            && (tables.veils.is_empty() == view.slab.is_none())
            && tables.echo.as_ref().is_none_or(|echo| echo.size == sending_cells(&view).1);
        Ok(fits.then(|| Self::assemble(untouched, view, sources, tables)))
    }

    fn assemble(untouched: &Scene, view: View, sources: Vec<Source>, tables: Tables) -> Self {
        let radiances: Vec<Vec3> = untouched.lights.iter().map(|l| l.radiance).collect();
        let together = |lights: &[Vec<Vec3>]| {
            let mut total = vec![Vec3::ZERO; lights.first().map_or(0, Vec::len)];
            for (light, radiance) in lights.iter().zip(&radiances) {
                total.iter_mut().zip(light).for_each(|(sum, l)| *sum += *l * *radiance);
            }
            total
        };
        let [fixed_total, cover_total, veil_total] =
            [&tables.fixed_lights, &tables.covers.lights, &tables.veils].map(|lights| together(lights));
        let pixels = view.camera.width * view.camera.height;
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
            grounds: ground::grounds(&sources, &tables, view.slab.as_ref(), &radiances),
            total: probes::total(&tables.probes, &radiances),
            skyline: probes::total(&tables.skylines, &radiances),
            greys: tables.probes.iter().map(probes::grey).collect(),
            is_skyline_grey: tables.skylines.iter().all(skyline::is_grey),
            view,
            sources,
            radiances,
            tables,
            fixed_total,
            cover_total,
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

    /// Height of the untouched face in its middle, mm.
    fn level(&self) -> f32 {
        let rest = &self.total.parts().0.rest;
        rest[rest.len() / 2]
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

/// Cells that send towards walls: how many pixels along an edge, and how many along x and y of a view.
fn sending_cells(view: &View) -> (usize, [usize; 2]) {
    let edge = bounce::SENDING * frame::cell_px(pixel_mm(view));
    (edge, [view.camera.width.div_ceil(edge), view.camera.height.div_ceil(edge)])
}

/// Extent of a pixel on the untouched face, mm.
fn pixel_mm(view: &View) -> f32 {
    let camera = &view.camera;
    // A plate lifts what is below it.
    let lifted = view.slab.map_or(0.0, |slab| (slab.high - slab.low) * (1.0 - 1.0 / slab.ior));
    2.0 * camera.tan_half_x * (camera.origin.z.abs() - lifted) / camera.width as f32
}

#[cfg(test)]
mod tests;
