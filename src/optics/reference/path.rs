//! One camera path.
//!
//! At each event: (1) every light whose irradiance is known in closed form is added for the diffuse part as if
//! nothing stood in the way; (2) one point of one light, chosen in proportion to that irradiance, is tested for
//! visibility, and what is hidden is taken off again: a control variate, exact in the mean and free of noise where
//! nothing is hidden; the same point lights the other lobe, and lights without a closed form, weighted against
//! (3) the scattered ray, which goes on and may hit a light itself (Veach 1997, power heuristic). Where a clear body
//! stands between, the closed form is left out; through a flat plate the diffuse part is connected to the point
//! along the refracted path ([`super::plate`]), all else is found by scattered rays that hit the light.
//!
//! Dimension groups of the sampler: 0 pixel and first direction, 1 lens and first lobe, then for event
//! n = 1, 2, ... 2n: light and roulette, 2n + 1: direction and lobe of event n + 1.

use super::plate::Link;
use super::prepared::{Prepared, Surfel};
use crate::optics::bsdf::{Lobe, concentric_disc};
use crate::optics::emitter::{Emitter, LightPoint};
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
enum Arrival {
    /// From the camera or a mirror direction: everything.
    Certain,
    /// Scattered, then straight through a plate: what a refracted connection does not claim.
    Through { lobe_throughput: Vec3 },
    /// Scattered with this density: what light sampling at `from` does not claim.
    Scattered { from: Vec3, pdf: f32, lobe_throughput: Vec3 },
}

/// A point of a path where light is gathered.
struct Vertex<'a> {
    surfel: &'a Surfel,
    frame: &'a Frame,
    wo: Vec3,
    throughput: Vec3,
    /// Number of the event, from 1.
    event: u32,
}

/// Scratch space for following paths of one scene.
pub struct Path<'a> {
    scene: &'a Prepared,
    /// Probability of each light to be chosen at the present event.
    choice: Vec<f32>,
    /// Whether its diffuse part was added in closed form.
    closed: Vec<bool>,
    /// Rays traced so far.
    rays: Cell<u64>,
}

impl<'a> Path<'a> {
    pub fn new(scene: &'a Prepared) -> Self {
        let n = scene.emitters.len();
        Self { scene, choice: vec![0.0; n], closed: vec![false; n], rays: Cell::new(0) }
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
        let mut arrival = Arrival::Certain;
        let mut event = 0;
        loop {
            self.rays.set(self.rays.get() + 1);
            let Some(surfel) = scene.trace(origin, direction) else { return };
            if let Some(light) = surfel.light {
                self.emission(light, &surfel, direction, throughput, arrival, add);
            }
            if event == scene.max_events {
                return;
            }
            event += 1;
            let [pick, light_u, light_v, roulette] = sampler.group(index, 2 * event);
            let frame = Frame::new(surfel.normal);
            let wo = frame.local(-direction);
            if wo.z <= 0.0 {
                return;
            }
            if !surfel.bsdf.is_specular() {
                let vertex = Vertex { surfel: &surfel, frame: &frame, wo, throughput, event };
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
                Arrival::Scattered { from: surfel.hit.point, pdf: next.pdf, lobe_throughput }
            } else {
                let straight = surfel.connects && next.wi.z < 0.0 && surfel.normal.z.abs() > 0.999;
                match arrival {
                    Arrival::Scattered { lobe_throughput, .. } | Arrival::Through { lobe_throughput }
                        if straight =>
                    {
                        Arrival::Through { lobe_throughput: lobe_throughput * next.weight }
                    }
                    _ => Arrival::Certain,
                }
            };
            [du, dv, lobe, _] = sampler.group(index, 2 * event + 1);
        }
    }
}

impl Path<'_> {
    /// Light that reaches the vertex straight from the lights.
    fn direct(&mut self, vertex: &Vertex, [pick, u, v]: [f32; 3], add: &mut impl FnMut(usize, Vec3)) {
        let Vertex { surfel, frame, wo, throughput, event } = *vertex;
        let scene = self.scene;
        let (point, normal, bsdf) = (surfel.hit.point, surfel.normal, &surfel.bsdf);
        let diffuse = throughput * bsdf.diffuse * FRAC_1_PI;
        let has_lobe = bsdf.lobe != Lobe::None;

        // The closed form, as if nothing stood in the way.
        let mut total = 0.0;
        for (k, emitter) in scene.emitters.iter().enumerate() {
            // A flat patch does not light itself.
            let itself = emitter.analytic && surfel.light == Some(k);
            let e = if emitter.is_dark() || itself { 0.0 } else { emitter.unoccluded(point, normal) };
            self.closed[k] = emitter.analytic && !scene.passes_clear(point, emitter.center);
            if self.closed[k] && e > 0.0 {
                add(k, diffuse * e * emitter.radiance);
            }
            self.choice[k] = e * emitter.luminance;
            total += self.choice[k];
        }

        // Choose a light.
        let uniform = if has_lobe || total <= 0.0 || scene.plate.is_some() { UNIFORM_CHOICE } else { 0.0 };
        let scale = if total > 0.0 { (1.0 - uniform) / total } else { 0.0 };
        let floor = uniform / scene.lit as f32;
        let mut chosen = None;
        let mut running = 0.0;
        for (k, p) in self.choice.iter_mut().enumerate() {
            *p = if scene.emitters[k].is_dark() { 0.0 } else { *p * scale + floor };
            if *p > 0.0 && (chosen.is_none() || pick >= running) {
                chosen = Some(k);
            }
            running += *p;
        }
        let Some(k) = chosen else { return };
        let emitter = &scene.emitters[k];

        // Test one of its points.
        let at = emitter.sample(Vec2::new(u, v));
        if let Some(plate) = scene.plate.filter(|plate| plate.between(point, at.point)) {
            if let Some(link) = plate.link(point, at.point).filter(|l| event + l.faces <= scene.max_events) {
                let light = emitter.radiance / (self.choice[k] * at.pdf_area);
                add(k, diffuse * light * self.transmitted(&link, surfel, &at, emitter, k));
            }
            return;
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

    /// Irradiance of the surfel by a unit of area and radiance of a light behind the plate.
    fn transmitted(
        &self,
        link: &Link,
        surfel: &Surfel,
        at: &LightPoint,
        emitter: &Emitter,
        light: usize,
    ) -> f32 {
        let scene = self.scene;
        let cos = link.leaving.dot(surfel.normal);
        let cos_light = -link.arriving.dot(at.normal);
        let profile = emitter.profile(cos_light);
        if cos <= 0.0 || profile <= 0.0 {
            return 0.0;
        }
        // Each stretch of the path, off the surfaces at its ends.
        let vertical = Vec3::Z * (scene.offset * link.leaving.z.signum());
        let mut from = surfel.hit.point + surfel.normal * scene.offset;
        for crossing in &link.crossings[..link.faces as usize] {
            if scene.blocked(from, *crossing - vertical, light, &self.rays) {
                return 0.0;
            }
            from = *crossing + vertical;
        }
        if scene.blocked(from, at.point + at.normal * (scene.offset * cos_light.signum()), light, &self.rays)
        {
            return 0.0;
        }
        cos * profile * link.transmittance * link.solid_angle * cos_light.abs()
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
            Arrival::Certain => add(k, throughput * light),
            Arrival::Through { lobe_throughput } => add(k, lobe_throughput * light),
            Arrival::Scattered { from, pdf, lobe_throughput } => {
                let throughput = if self.closed[k] { lobe_throughput } else { throughput };
                if throughput != Vec3::ZERO {
                    let distance2 = (surfel.hit.point - from).length_squared();
                    let by_light = self.choice[k] * emitter.pdf_area() * distance2 / cos.abs();
                    add(k, throughput * light * power_heuristic(pdf, by_light));
                }
            }
        }
    }
}

/// Weight of a sample of density `a` that another strategy would have taken with density `b`.
fn power_heuristic(a: f32, b: f32) -> f32 {
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
