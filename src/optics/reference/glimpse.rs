//! Lamps that the camera sees by way of the plate: mirrored in it, or as the ghost that two reflections inside set beside a lamp.
//!
//! A ray that is mirrored or goes on by chance meets such an image once in twenty-five times, or in sixteen thousand, and what it finds
//! is as bright as a lamp: a few pixels would be most of a picture's noise. From the camera each of these ways is known beforehand. So
//! they are looked along all together, each for its part of the light, and what chance finds along them counts no more.

use super::path::Path;
use super::plate::Route;
use crate::optics::bsdf::{Lobe, fresnel, refract};
use glam::Vec3;

impl Path<'_> {
    /// Hands the light of lamps that a ray of the camera meets by each way that is [told](super::plate::Way::is_glimpsed).
    pub(super) fn glimpse(&self, origin: Vec3, direction: Vec3, add: &mut impl FnMut(usize, Vec3)) {
        let scene = self.scene;
        let Some(plate) = scene.plate.filter(|plate| plate.is_outside(origin)) else { return };
        for route in Route::GLIMPSED {
            // Most rays pass all lamps by far, which is told without tracing any.
            let leaves = plate.leaves(origin, direction, route);
            if leaves.is_some_and(|(from, along)| scene.passes_lamp(from, along)) {
                self.follow_glimpse(origin, direction, route, add);
            }
        }
    }

    fn follow_glimpse(
        &self,
        mut origin: Vec3,
        mut direction: Vec3,
        route: Route,
        add: &mut impl FnMut(usize, Vec3),
    ) {
        let scene = self.scene;
        let (mut kept, mut event) = (1.0, 0);
        loop {
            self.rays.set(self.rays.get() + 1);
            let Some(surfel) = scene.trace(origin, direction) else { return };
            let Some(through) = route.goes_through(event) else {
                // It has left the plate.
                if let Some(light) = surfel.light {
                    let emitter = &scene.emitters[light];
                    let profile = emitter.profile(-direction.dot(surfel.hit.normal));
                    add(light, emitter.radiance * (kept * profile));
                }
                return;
            };
            let (Lobe::Dielectric { eta }, true) = (surfel.bsdf.lobe, surfel.is_face()) else { return };
            if event == scene.max_events {
                return;
            }
            event += 1;
            let mirrored = fresnel(-direction.dot(surfel.normal), eta);
            let next = match through {
                true => refract(-direction, surfel.normal, eta),
                false => Some(direction - surfel.normal * (2.0 * direction.dot(surfel.normal))),
            };
            let Some(next) = next else { return };
            kept *= if through { 1.0 - mirrored } else { mirrored };
            origin = surfel.hit.point + surfel.normal * if through { -scene.offset } else { scene.offset };
            direction = next;
        }
    }
}
