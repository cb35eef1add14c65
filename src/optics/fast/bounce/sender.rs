//! What cells send towards the walls, by direction: above their horizons, and what the untouched face sent.

use super::elevation::weight;
use super::row::{Horizons, ahead};
use crate::optics::fast::echo::{self, PER_WEIGHT, RISES, SLOPES};
use crate::optics::fast::lanes::{Eight, Vectors};
use glam::Vec2;

/// Weights of level ground up to the slopes between rises, and of all of it.
const FLAT: [f32; RISES + 1] = {
    let mut flat = [0.5; RISES + 1];
    let mut k = 0;
    while k < RISES {
        let slope2 = SLOPES[k] * SLOPES[k];
        flat[k] = 0.5 * slope2 / (1.0 + slope2);
        k += 1;
    }
    flat
};

/// Eight cells that send.
pub struct Sender {
    /// Of the cells and of the untouched face under them, mm^2.
    pub areas: [Eight; 2],
    pub normal: Vectors,
    pub rest_normal: Vectors,
    pub place: Vectors,
}

impl Sender {
    /// By direction: how much of the light goes there, now and at rest. `extent` is from where to where the pad goes.
    #[inline(always)]
    pub fn parts(
        &self,
        horizons: &Horizons,
        extent: [Vec2; 2],
        edge_mm: f32,
    ) -> [[Eight; 2]; echo::DIRECTIONS] {
        let (zero, steepest) = (Eight::all(0.0), Eight::all(1e4));
        let [area, rest_area] = self.areas.map(|area| area * Eight::all(PER_WEIGHT));
        let (n, rest) = (self.normal, self.rest_normal);
        let flat = !Eight::all(1e-6).below(rest.x.abs().max(rest.y.abs())).any();
        let mut parts = [[zero; 2]; echo::DIRECTIONS];
        for (direction, [slope, below]) in horizons.iter().enumerate() {
            let ahead = ahead(direction);
            let along = n.x * Eight::all(ahead.x) + n.y * Eight::all(ahead.y);
            let rest_along = rest.x * Eight::all(ahead.x) + rest.y * Eight::all(ahead.y);
            let plane = if flat { zero } else { (-rest_along).over(rest.z) };
            let rest_below = if flat { zero } else { weight(plane, rest_along, rest.z) };
            // What leaves from high up meets a wall where steeper light from the level would; what meets none is the pad's.
            let lift = self.lift(ahead, extent, edge_mm);
            let from = |k: usize, lift: Eight, along: Eight, up: Eight, horizon: Eight, below: Eight| {
                let edge = SLOPES.get(k).map_or(steepest, |s| Eight::all(*s)) - lift;
                horizon.below(edge).choose(weight(edge, along, up), below)
            };
            let of_now = |k: usize| from(k, lift, along, n.z, *slope, *below);
            // Most faces are flat at rest.
            let of_rest = |k: usize| match flat {
                true => Eight::all(FLAT[k]),
                false => from(k, zero, rest_along, rest.z, plane, rest_below),
            };
            let mut low = [of_now(0), of_rest(0)];
            for rise in 0..RISES {
                let high = [of_now(rise + 1), of_rest(rise + 1)];
                parts[direction * RISES + rise] = [(high[0] - low[0]) * area, (high[1] - low[1]) * rest_area];
                low = high;
            }
        }
        parts
    }

    /// By how much the slope from the level to where a wall stands differs from that from each of the cells, if it stands at the
    /// rim of the pad.
    #[inline(always)]
    fn lift(&self, ahead: Vec2, [low, high]: [Vec2; 2], edge_mm: f32) -> Eight {
        let away = |place: Eight, ahead: f32, low: f32, high: f32| {
            let wall = Eight::all(if ahead > 0.0 { high } else { low });
            (wall - place) * Eight::all(1.0 / ahead)
        };
        let aside = away(self.place.x, ahead.x, low.x, high.x);
        let far = aside.min(away(self.place.y, ahead.y, low.y, high.y)).max(Eight::all(edge_mm));
        self.place.z.max(Eight::all(0.0)).over(far)
    }
}
