//! The light on the untouched face, from which the bounce tells what a press changes.

use super::grid::Grid;
use super::plate::Slab;
use super::source::Source;
use super::{Tables, probes, tables};
use glam::Vec3;
use rayon::prelude::*;

/// Nodes of the untouched face's light between two of the probes.
const GROUND_STEPS: usize = 3;

/// Irradiance of the untouched face, of all lights together, and of each alone with radiance 1.
pub fn grounds(sources: &[Source], tables: &Tables, slab: Option<&Slab>, radiances: &[Vec3]) -> Vec<Grid<3>> {
    let places = tables.probes[0].parts().0.face(GROUND_STEPS);
    let rest_normal = |p: Vec3| tables.probes[0].rest_normal(p);
    let of_light = |l: usize| -> Vec<[f32; 3]> {
        let of_place = |k: usize| {
            let p = places.point(k);
            let n = rest_normal(p);
            let phi = match &tables.direct[l] {
                Some(table) => tables::looked_up(table, &sources[l], slab, p),
                None => tables::arriving(&sources[l], None, p),
            };
            let indirect = probes::irradiance(&tables.probes[l].at(p), n);
            (indirect + phi.dot(n).max(0.0)).to_array()
        };
        (0..places.count()).into_par_iter().map(of_place).collect()
    };
    let lights: Vec<Vec<[f32; 3]>> = (0..sources.len()).map(of_light).collect();
    let mut total = vec![[0.0; 3]; places.count()];
    for (light, radiance) in lights.iter().zip(radiances) {
        for (sum, e) in total.iter_mut().zip(light) {
            *sum = (Vec3::from(*sum) + Vec3::from(*e) * *radiance).to_array();
        }
    }
    std::iter::once(total).chain(lights).map(|values| Grid::from_values(places.clone(), values)).collect()
}
