//! What a path does by way of the plate: connections to lights along its routes, and their weights against scattered rays that
//! find the same light.
//!
//! Of the routes to a point of a light one is chosen by what each adds, so that a connection traces one chain of rays however
//! many there are.

use super::path::{Arrival, Corner, Path, power_heuristic};
use super::plate::{Link, Plate, Route, Way};
use super::prepared::Surfel;
use crate::optics::emitter::LightPoint;
use glam::Vec3;

impl Path<'_> {
    /// How a path goes on that was mirrored by, or went through, a smooth clear surface.
    pub(super) fn met_clear(
        &self,
        arrival: Arrival,
        surfel: &Surfel,
        weight: Vec3,
        is_transmitted: bool,
    ) -> Arrival {
        if let Arrival::Seen { way } = arrival {
            let way = way.after(is_transmitted).filter(|_| surfel.is_face());
            return way.map_or(Arrival::Certain, |way| Arrival::Seen { way });
        }
        let (from, pdf, lobe_throughput, way) = match (arrival, self.scene.plate) {
            (Arrival::Scattered { from, pdf, lobe_throughput }, Some(plate)) => {
                (from, pdf, lobe_throughput, Way::new(plate.is_outside(from.point)))
            }
            (Arrival::ByPlate { from, pdf, lobe_throughput, way }, _) => (from, pdf, lobe_throughput, way),
            _ => return Arrival::Certain,
        };
        match way.after(is_transmitted).filter(|_| surfel.is_face()) {
            Some(way) => Arrival::ByPlate { from, pdf, lobe_throughput: lobe_throughput * weight, way },
            None => Arrival::Certain,
        }
    }

    /// What a unit of area and radiance of a light adds to the irradiance by each route, were nothing in the way.
    fn routes(
        &self,
        plate: &Plate,
        from: &Corner,
        at: &LightPoint,
        light: usize,
    ) -> [(Option<Link>, f32); Route::ALL.len()] {
        let scene = self.scene;
        Route::ALL.map(|route| {
            let link = plate.link(from.point, at.point, route);
            let Some(link) = link.filter(|link| from.event + link.faces <= scene.max_events) else {
                return (None, 0.0);
            };
            let cos = link.leaving.dot(from.normal).max(0.0);
            let cos_light = -link.arriving.dot(at.normal);
            let profile = scene.emitters[light].profile(cos_light);
            (Some(link), cos * profile * link.transmittance * link.solid_angle * cos_light.abs())
        })
    }

    /// One of the routes to a point of a light, chosen by what they add: the path, what it adds to the irradiance, and the
    /// probability of its choice. None where nothing comes that way.
    pub(super) fn route(
        &self,
        plate: &Plate,
        from: &Corner,
        at: &LightPoint,
        light: usize,
        pick: f32,
    ) -> Option<(Link, f32, f32)> {
        let routes = self.routes(plate, from, at, light);
        let total: f32 = routes.iter().map(|(_, value)| value).sum();
        let (mut wanted, mut chosen) = (pick * total, None);
        for (link, value) in routes {
            if value > 0.0 && (chosen.is_none() || wanted >= 0.0) {
                chosen = link.map(|link| (link, value, value / total));
            }
            wanted -= value;
        }
        chosen.filter(|(link, ..)| !self.is_hidden(link, from, at, light))
    }

    /// Whether anything is in the way along a link.
    fn is_hidden(&self, link: &Link, from: &Corner, at: &LightPoint, light: usize) -> bool {
        let scene = self.scene;
        let off = |rises: bool| Vec3::Z * if rises { scene.offset } else { -scene.offset };
        let mut start = from.point + from.normal * scene.offset;
        for (k, crossing) in link.crossings[..link.faces as usize].iter().enumerate() {
            if scene.blocked(start, *crossing - off(link.rises[k]), light, &self.rays) {
                return true;
            }
            start = *crossing + off(link.rises[k + 1]);
        }
        let facing = -link.arriving.dot(at.normal).signum();
        scene.blocked(start, at.point + at.normal * (scene.offset * facing), light, &self.rays)
    }

    /// Weight, from 0 to 1, of the connection that would have found the light which a scattered ray found by way of the plate.
    pub(super) fn told_by_plate(
        &self,
        from: Corner,
        pdf: f32,
        way: Way,
        surfel: &Surfel,
        light: usize,
    ) -> f32 {
        let (Some(plate), Some(route)) = (&self.scene.plate, way.route()) else { return 0.0 };
        let pdf_area = self.scene.emitters[light].pdf_area();
        let at = LightPoint { point: surfel.hit.point, normal: surfel.hit.normal, pdf_area };
        let routes = self.routes(plate, &from, &at, light);
        let total: f32 = routes.iter().map(|(_, value)| value).sum();
        let of_route = Route::ALL.iter().position(|r| *r == route).map(|k| &routes[k]);
        let Some((Some(link), value)) = of_route else { return 0.0 };
        if *value <= 0.0 {
            return 0.0;
        }
        let density = self.choice[light] * pdf_area * (value / total);
        power_heuristic(density, pdf * by_area(link, &at))
    }
}

/// Density per area of a light at the end of a link, for a density of 1 per solid angle at its beginning: the faces mirror
/// and let through by chance.
pub(super) fn by_area(link: &Link, at: &LightPoint) -> f32 {
    link.kept * link.solid_angle * link.arriving.dot(at.normal).abs()
}
