//! What walls give back to the cells.

use super::means::Means;
use super::{Cells, MOST};
use crate::optics::fast::grid::Grid;
use crate::optics::fast::probes::{self, NUMBERS};
use glam::Vec3;
use rayon::prelude::*;

/// An echo below this part of the light is none. (Rounding and interpolation leave up to half of it where nothing is pressed.)
const SILENT: f32 = 3e-5;

/// What walls gave back to the cells that see the pad; nothing where that is silent.
pub(super) struct Echoed {
    /// Mean light before.
    pub(super) mean: Vec3,
    pub(super) changes: Vec<Vec3>,
}

impl Echoed {
    /// That of all lights together.
    pub(super) fn sum(all: &[Self], radiances: &[Vec3]) -> Self {
        let longest = all.iter().map(|one| one.changes.len()).max().unwrap_or(0);
        let mut sum = Self { mean: Vec3::ZERO, changes: vec![Vec3::ZERO; longest] };
        for (one, radiance) in all.iter().zip(radiances) {
            sum.mean += one.mean * *radiance;
            sum.changes.iter_mut().zip(&one.changes).for_each(|(sum, change)| *sum += *change * *radiance);
        }
        sum
    }

    /// As a part of the mean light.
    pub(super) fn mean_square(&self) -> f64 {
        let share = 1.0 / self.mean.max_element().max(1e-12);
        let squares: f64 = self.changes.iter().map(|c| f64::from((*c * share).length_squared())).sum();
        squares / self.changes.len().max(1) as f64
    }
}

impl Cells<'_> {
    /// Adds what walls give back to the gains of a picture.
    pub(super) fn echo(
        &self,
        means: &Means,
        film: usize,
        answer: &Grid<NUMBERS>,
        gains: &mut [Vec3],
    ) -> Echoed {
        let ([nx, _], [x, y, z]) = (self.size, &means.own[film]);
        let at = |k: usize| means.at(k % nx, k / nx);
        let seen = || (0..gains.len()).filter(|k| self.cells[*k].count > 0.0);
        let light = |k: usize| Vec3::new(x[at(k)], y[at(k)], z[at(k)]);
        let n = seen().count().max(1) as f32;
        let mean = (seen().map(light).sum::<Vec3>() / n).max(Vec3::splat(1e-12));
        let most = answer.parts().1.iter().flatten().fold(0.0f32, |most, v| most.max(v.abs()));
        if most < SILENT * mean.max_element() {
            return Echoed { mean, changes: Vec::new() };
        }
        let seen: Vec<usize> = seen().collect();
        let change = |k: &usize| {
            let i = at(*k);
            let p = Vec3::new(means.places[0][i], means.places[1][i], means.heights[i]);
            let normal = Vec3::new(means.normals[0][i], means.normals[1][i], means.normals[2][i]);
            probes::change(&answer.at(p), normal)
        };
        let changes: Vec<Vec3> = seen.par_iter().with_min_len(1024).map(change).collect();
        for (k, change) in seen.into_iter().zip(&changes) {
            let light = light(k);
            let bounded = change.clamp(-0.9 * light, light * (MOST - 1.0));
            gains[k] += bounded / light.max(Vec3::splat(1e-12));
        }
        Echoed { mean, changes }
    }
}
