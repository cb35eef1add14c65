//! One camera path.
//!
//! At each event: (1) every light whose irradiance is known in closed form is added for the diffuse part as if
//! nothing stood in the way; (2) one point of one light, chosen in proportion to that irradiance, is tested for
//! visibility, and what is hidden is taken off again: a control variate, exact in the mean and free of noise where
//! nothing is hidden; the same point lights the other lobe, and lights without a closed form, weighted against
//! (3) the scattered ray, which goes on and may hit a light itself (Veach 1997, power heuristic). Where a clear body
//! stands between, the closed form is left out; by way of a flat plate the diffuse part is connected to the point
//! along refracted and mirrored paths ([`super::plate`]), weighted against scattered rays as well. All else is found by scattered
//! rays that hit the light, but for lamps that the camera is shown by a plate ([`super::glimpse`]).
//!
//! Dimension groups of the sampler: 0 pixel and first direction, 1 lens and first lobe, then for event
//! n = 1, 2, ... 2n: light and roulette, 2n + 1: direction and lobe of event n + 1.

use super::by_plate::by_area;
use super::choice::choose;
use super::plate::Way;
use super::prepared::{Prepared, Surfel};
use crate::optics::bsdf::{Lobe, concentric_disc};
use crate::optics::sampler::Sampler;
use glam::{Vec2, Vec3};
use std::cell::Cell;
use std::f32::consts::FRAC_1_PI;

/// Russian roulette begins after this many events...
const ROULETTE_FROM: u32 = 2;
/// ...and a path survives with this multiple of its largest throughput, at most 1. Found by experiment on the
/// benchmark scene: 2 doubles the error for half the time, no roulette at all gains 8 % for half as much again.
const ROULETTE_GAIN: f32 = 8.0;
/// Part of the light choice that is uniform, so that a glossy lobe may see a light that irradiates little.
const UNIFORM_CHOICE: f32 = 0.1;

/// How the ray at hand came about, which decides what a light it hits may add.
#[derive(Clone, Copy)]
pub(super) enum Arrival {
    /// From the camera or a mirror direction: everything.
    Certain,
    /// From the camera, by nothing but the plate: what is not [glimpsed](super::glimpse).
    Seen { way: Way },
    /// Scattered with this density, then by way of the plate: what connections from there do not claim.
    ByPlate { from: Corner, pdf: f32, lobe_throughput: Vec3, way: Way },
    /// Scattered with this density: what light sampling at `from` does not claim.
    Scattered { from: Corner, pdf: f32, lobe_throughput: Vec3 },
}

/// Where a path turned, and how many events that took.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    pub point: Vec3,
    pub normal: Vec3,
    pub event: u32,
}

/// A point of a path where light is gathered.
struct Vertex<'a> {
    surfel: &'a Surfel,
    frame: &'a Frame,
    wo: Vec3,
    throughput: Vec3,
    /// Number of the event, from 1.
    event: u32,
    /// Whether no light was gathered on the path before.
    first: bool,
}

/// Scratch space for following paths of one scene.
pub struct Path<'a> {
    pub(super) scene: &'a Prepared,
    /// Probability of each light to be chosen at the present event.
    pub(super) choice: Vec<f32>,
    /// Whether its diffuse part was added in closed form.
    closed: Vec<bool>,
    /// Rays traced so far.
    pub(super) rays: Cell<u64>,
    /// The light that leaves the pad, where only what bounces is wanted.
    known: Option<&'a Known<'a>>,
}

/// The radiance that leaves a point of the pad, where it is known.
pub type Known<'a> = dyn Fn(Vec3) -> Option<Vec3> + Sync + 'a;

impl<'a> Path<'a> {
    pub fn new(scene: &'a Prepared) -> Self {
        let n = scene.emitters.len();
        Self { scene, choice: vec![0.0; n], closed: vec![false; n], rays: Cell::new(0), known: None }
    }

    /// Paths that gather at their first point only what bounces there, and end where the light that leaves the pad is known.
    pub fn of_bounces(scene: &'a Prepared, known: &'a Known<'a>) -> Self {
        Self { known: Some(known), ..Self::new(scene) }
    }

    /// Rays traced so far, of all kinds.
    pub fn rays(&self) -> u64 {
        self.rays.get()
    }

    /// Follows sample `index` of pixel (x, y) and hands every contribution to `add` with its light.
    pub fn follow(
        &mut self,
        sampler: &Sampler,
        index: u32,
        x: f32,
        y: f32,
        add: &mut impl FnMut(usize, Vec3),
    ) {
        let scene = self.scene;
        let [px, py, mut du, mut dv] = sampler.group(index, 0);
        let [lens_u, lens_v, mut lobe, _] = sampler.group(index, 1);
        let lens = concentric_disc(Vec2::new(lens_u, lens_v));
        let (mut origin, mut direction) = scene.camera.ray(x + px, y + py, lens);
        let mut throughput = Vec3::ONE;
        let mut arrival = match scene.plate {
            Some(plate) if self.known.is_none() && plate.is_outside(origin) => {
                self.glimpse(origin, direction, add);
                Arrival::Seen { way: Way::new(true) }
            }
            _ => Arrival::Certain,
        };
        let mut event = 0;
        let mut first = true;
        loop {
            self.rays.set(self.rays.get() + 1);
            let Some(surfel) = scene.trace(origin, direction) else { return };
            if let Some(light) = surfel.light {
                self.emission(light, &surfel, direction, throughput, arrival, add);
            }
            if event == scene.max_events {
                return;
            }
            let leaving = self.known.filter(|_| event > 0 && surfel.pad);
            if let Some(light) = leaving.and_then(|known| known(surfel.hit.point)) {
                add(0, throughput * light);
                return;
            }
            event += 1;
            let [pick, light_u, light_v, roulette] = sampler.group(index, 2 * event);
            let frame = Frame::new(surfel.normal);
            let wo = frame.local(-direction);
            if wo.z <= 0.0 {
                return;
            }
            if self.known.is_some() && event == 1 {
                // Of lights that the scattered ray hits all is told.
                self.closed.fill(true);
            } else if !surfel.bsdf.is_specular() {
                let vertex = Vertex { surfel: &surfel, frame: &frame, wo, throughput, event, first };
                first = false;
                self.direct(&vertex, [pick, light_u, light_v], add);
            }

            // Scatter.
            let Some(next) = surfel.bsdf.sample(wo, Vec2::new(du, dv), lobe) else { return };
            let lobe_throughput = throughput * next.lobe_weight;
            throughput *= next.weight;
            let mut survive = 1.0;
            if event >= ROULETTE_FROM && next.pdf > 0.0 {
                survive = (ROULETTE_GAIN * throughput.max_element()).min(1.0);
                if roulette >= survive {
                    return;
                }
                throughput /= survive;
            }
            // The last ray can only hit a light, and only tells what light sampling has not told.
            let told = next.pdf > 0.0 && next.lobe_weight == Vec3::ZERO && self.closed.iter().all(|&c| c);
            if throughput == Vec3::ZERO || (event == scene.max_events && told) {
                return;
            }
            direction = frame.world(next.wi);
            origin = surfel.hit.point + surfel.normal * (scene.offset * next.wi.z.signum());
            arrival = if next.pdf > 0.0 {
                let lobe_throughput = lobe_throughput / survive;
                let from = Corner { point: surfel.hit.point, normal: surfel.normal, event };
                Arrival::Scattered { from, pdf: next.pdf, lobe_throughput }
            } else {
                self.met_clear(arrival, &surfel, next.weight, next.wi.z < 0.0)
            };
            [du, dv, lobe, _] = sampler.group(index, 2 * event + 1);
        }
    }
}

impl Path<'_> {
    /// Light that reaches the vertex straight from the lights.
    fn direct(&mut self, vertex: &Vertex, sample: [f32; 3], add: &mut impl FnMut(usize, Vec3)) {
        let Vertex { surfel, throughput, first, .. } = *vertex;
        let scene = self.scene;
        let (point, normal, bsdf) = (surfel.hit.point, surfel.normal, &surfel.bsdf);
        let diffuse = throughput * bsdf.diffuse * FRAC_1_PI;
        let has_lobe = bsdf.lobe != Lobe::None;

        // Through a plate no closed form holds: where a path gathers first, and most, each light is tested.
        let tests_each = first && scene.plate.is_some();
        // The closed form, as if nothing stood in the way.
        for (k, emitter) in scene.emitters.iter().enumerate() {
            // A flat patch does not light itself.
            let itself = emitter.analytic && surfel.light == Some(k);
            let e = if emitter.is_dark() || itself { 0.0 } else { emitter.unoccluded(point, normal) };
            self.closed[k] = emitter.analytic && !scene.passes_clear(point, emitter.center);
            if self.closed[k] && e > 0.0 {
                add(k, diffuse * e * emitter.radiance);
            }
            self.choice[k] = match (emitter.is_dark(), tests_each) {
                (true, _) => 0.0,
                (false, true) => 1.0,
                (false, false) => (e + scene.mirrored(point, normal, k)) * emitter.luminance,
            };
        }

        let [pick, u, v] = sample;
        if tests_each {
            for k in 0..scene.emitters.len() {
                if self.choice[k] > 0.0 {
                    self.connect(vertex, k, [pick, u, v], add);
                }
            }
            return;
        }

        let uniform = if has_lobe || scene.plate.is_some() { UNIFORM_CHOICE } else { 0.0 };
        let shines = |k: usize| !scene.emitters[k].is_dark();
        let Some((k, pick)) = choose(&mut self.choice, shines, uniform, pick) else { return };
        self.connect(vertex, k, [pick, u, v], add);
    }

    /// Tests a point of a light that was chosen.
    fn connect(&self, vertex: &Vertex, k: usize, [pick, u, v]: [f32; 3], add: &mut impl FnMut(usize, Vec3)) {
        let Vertex { surfel, frame, wo, throughput, event, .. } = *vertex;
        let scene = self.scene;
        let (point, normal, bsdf) = (surfel.hit.point, surfel.normal, &surfel.bsdf);
        let diffuse = throughput * bsdf.diffuse * FRAC_1_PI;
        let has_lobe = bsdf.lobe != Lobe::None;
        let emitter = &scene.emitters[k];
        let at = emitter.sample(Vec2::new(u, v));
        if let Some(plate) = &scene.plate {
            let from = Corner { point, normal, event };
            if let Some((link, value, share)) = self.route(plate, &from, &at, k, pick) {
                let density = self.choice[k] * at.pdf_area * share;
                let scattered = bsdf.pdf(wo, frame.local(link.leaving)) * by_area(&link, &at);
                let weight = power_heuristic(density, scattered);
                add(k, diffuse * emitter.radiance * (value * weight / density));
            }
            if plate.between(point, at.point) {
                return;
            }
        }
        let to = at.point - point;
        let distance2 = to.length_squared();
        let direction = to / distance2.sqrt();
        let cos_light = -direction.dot(at.normal);
        let wi = frame.local(direction);
        let profile = emitter.profile(cos_light);
        let lobe = if has_lobe { bsdf.eval_lobe(wo, wi) } else { Vec3::ZERO };
        let useful = (wi.z > 0.0 && bsdf.diffuse != Vec3::ZERO) || lobe != Vec3::ZERO;
        if profile <= 0.0 || !useful || distance2 <= 0.0 {
            return;
        }
        let from = point + normal * (scene.offset * wi.z.signum());
        let target = at.point + at.normal * (scene.offset * cos_light.signum());
        let visible = !scene.blocked(from, target, k, &self.rays);
        let pdf = self.choice[k] * at.pdf_area * distance2 / cos_light.abs();
        let light = emitter.radiance * (profile / pdf);
        if self.closed[k] && !visible {
            add(k, -diffuse * light * wi.z.max(0.0));
        }
        if visible && (has_lobe || !self.closed[k]) {
            let weight = power_heuristic(pdf, bsdf.pdf(wo, wi));
            let mut value = throughput * lobe * wi.z.abs();
            if !self.closed[k] {
                value += diffuse * wi.z.max(0.0);
            }
            add(k, value * light * weight);
        }
    }

    /// Light that a path finds by hitting the light itself.
    fn emission(
        &self,
        k: usize,
        surfel: &Surfel,
        direction: Vec3,
        throughput: Vec3,
        arrival: Arrival,
        add: &mut impl FnMut(usize, Vec3),
    ) {
        let emitter = &self.scene.emitters[k];
        let cos = -direction.dot(surfel.hit.normal);
        let light = emitter.radiance * emitter.profile(cos);
        if light == Vec3::ZERO {
            return;
        }
        match arrival {
            Arrival::Seen { way } if way.is_glimpsed() => {}
            Arrival::Certain | Arrival::Seen { .. } => add(k, throughput * light),
            Arrival::ByPlate { from, pdf, lobe_throughput, way } => {
                let told = self.told_by_plate(from, pdf, way, surfel, k);
                add(k, (throughput - (throughput - lobe_throughput) * told) * light);
            }
            Arrival::Scattered { from, pdf, lobe_throughput } => {
                let throughput = if self.closed[k] { lobe_throughput } else { throughput };
                if throughput != Vec3::ZERO {
                    let distance2 = (surfel.hit.point - from.point).length_squared();
                    let by_light = self.choice[k] * emitter.pdf_area() * distance2 / cos.abs();
                    add(k, throughput * light * power_heuristic(pdf, by_light));
                }
            }
        }
    }
}

/// Weight of a sample of density `a` that another strategy would have taken with density `b`.
pub(super) fn power_heuristic(a: f32, b: f32) -> f32 {
    let ratio = b / a;
    1.0 / (1.0 + ratio * ratio)
}

/// An orthonormal frame whose z is a surface normal.
struct Frame {
    x: Vec3,
    y: Vec3,
    z: Vec3,
}

impl Frame {
    fn new(normal: Vec3) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        Self { x, y, z: normal }
    }

    fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }

    fn world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}
