//! What bounces from the pad: onto itself, by the walls, and onto what is fixed.

use super::Frame;
use super::shading::Shaded;
use crate::optics::fast::bounce::{self, Cells, Untouched};
use crate::optics::fast::gains::{self, Gains};
use crate::optics::fast::glow::Pressed;
use crate::optics::fast::grid::Grid;
use crate::optics::fast::notches::Notches;
use crate::optics::fast::packed::{CHANNELS, Packing};
use crate::optics::fast::skyline;
use crate::optics::fast::tilt::Tilts;
use crate::optics::fast::unseen::AllUnseen;
use crate::optics::fast::{traces, wall_shadow};
use crate::optics::{Albedo, Film};
use glam::Vec3;

/// What bouncing has changed, and what tells of its error.
pub(super) struct Rebound {
    /// Sum over pixels and channels of the squares of what it changed, as in [`traces`].
    pub bounced: Vec<f64>,
    /// Mean square of what walls gave back of the press, as a part of the mean light.
    pub echoed: Vec<f64>,
    /// What the press changes in the light on what is fixed, by picture and spot.
    pub glows: Vec<Vec<Vec3>>,
    /// How much of the light of upright flanks falls on themselves: [`Notches::part`].
    pub notched: f64,
}

impl Rebound {
    /// Nothing bounces in so many pictures.
    pub fn nothing(films: usize) -> Self {
        let zeros = vec![0.0; traces::count(films)];
        Self { bounced: zeros.clone(), echoed: zeros, glows: Vec::new(), notched: 0.0 }
    }
}

impl<const N: usize> Frame<'_, N> {
    /// Multiplies the pictures by what a press changes in the light that comes from pad and walls. `border_mm` is how unevenly the
    /// pad goes on beyond them.
    pub(super) fn rebound(&self, shaded: &Shaded, border_mm: f64, films: &mut [Film]) -> Rebound {
        let Shaded { size, cell_px, finer, ref cells, ref is_flank, ref lights, .. } = *shaded;
        let border = shaded.border(self.once.pixel_mm);
        let edge_mm = border.edge_mm;
        let albedo = match self.albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Texture(texture) => texture.mean(),
        };
        // (Of large cells a part of the rows counts.)
        let most_count = (cell_px * cell_px) as f32 * if cell_px >= 4 { 0.25 } else { 1.0 };
        let packing = self.packing(albedo, lights.len());
        let tilts = Tilts::of(&shaded.parts_of_flanks, shaded.in_row(), lights.len()).packed(packing);
        let packed_lights = packing.pack(lights);
        let AllUnseen { cells: unseen, lights: unseen_lights } = self.unseen(&border, border_mm);
        let unseen_lights = packing.pack(&unseen_lights);
        let Notches { kept, part: notched } = self.notched(&border, albedo);
        let cells = Cells {
            size,
            rows: border.size[1],
            edge_mm,
            sending: finer * bounce::SENDING,
            cells,
            flanks: is_flank,
            kept: &kept,
            tilts: &tilts,
            lights: &packed_lights,
            unseen: &unseen,
            unseen_lights: &unseen_lights,
            most_count,
            albedo,
            eye: self.once.view.camera.origin,
            extent: self.heights.extent(),
            heights: self.heights,
            echo: self.once.tables.echo.as_ref(),
            lost: &packing.pack(&self.lost(lights.len())),
            packing,
            radiances: &self.once.radiances,
            again: self.effort.fine,
            closely: !self.effort.sparse,
        };
        let skylines = match lights.len() {
            1 => std::slice::from_ref(&self.once.skyline),
            _ => &self.once.tables.skylines[..],
        };
        let grounds = if lights.len() == 1 { &self.once.grounds[..1] } else { &self.once.grounds[1..] };
        let untouched = Untouched {
            sky: &|film, p| packed_sky(packing, skylines, film, p),
            ground: &|film, p| packed_ground(packing, grounds, film, p),
            normal: &|p| self.once.total.rest_normal(p),
        };
        let changes = cells.changes(untouched);
        let pressed = Pressed {
            view: &self.once.view,
            heights: self.heights,
            level: self.once.level(),
            albedo,
            columns: size[0],
            cell_px,
            edge_mm,
            cells: cells.cells,
            lights,
            gains: &changes.gains,
            grounds,
            skylines,
            sources: &self.once.sources,
            radiances: &self.once.radiances,
        };
        let glows = pressed.changes(&self.once.tables.glow);
        let lifts: Vec<f32> = cells.cells.iter().map(|c| c.position.z / c.count.max(1e-6)).collect();
        let (lifts, hidden, columns) = (&lifts[..], &self.hidden()[..], size[0]);
        let (flanks, splits) = (&is_flank[..], &shaded.splits[..]);
        let of = |gains| Gains { gains, lifts, flanks, columns, cell_px, splits, hidden };
        let all_gains: Vec<Gains<'_>> = changes.gains.iter().map(|gains| of(&gains[..])).collect();
        let veil = |k: usize, x: usize, y: usize| self.once.veil(k, lights.len(), x, y);
        let height_mm = |x: usize, y: usize| self.height_mm(x, y);
        let bounced = gains::apply(&all_gains, films, &self.once.radiances, height_mm, veil);
        Rebound { bounced, echoed: changes.echoed, glows, notched }
    }

    /// By picture: what groups of walls lose of the lights to the pad.
    fn lost(&self, films: usize) -> Vec<Vec<Vec3>> {
        let Some(echo) = &self.once.tables.echo else { return Vec::new() };
        let losses = wall_shadow::losses(echo, &self.once.sources, self.heights);
        if losses.is_empty() {
            return Vec::new();
        }
        if films > 1 {
            return losses
                .iter()
                .map(|of_light| of_light.iter().map(|loss| Vec3::splat(*loss)).collect())
                .collect();
        }
        let mut sum = vec![Vec3::ZERO; echo.groups];
        for (of_light, radiance) in losses.iter().zip(&self.once.radiances) {
            sum.iter_mut().zip(of_light).for_each(|(sum, loss)| *sum += *radiance * *loss);
        }
        vec![sum]
    }

    /// Which pictures the bounce takes together.
    fn packing(&self, albedo: Vec3, films: usize) -> Packing {
        let is_grey = self.slots.grey && self.once.is_skyline_grey && albedo == Vec3::splat(albedo.x);
        if films > 1 && is_grey { Packing::Grey(films) } else { Packing::Apart }
    }
}

/// What the sky over a point of the untouched face sends there in a picture, or in those that are packed into one.
fn packed_sky(
    packing: Packing,
    skylines: &[Grid<{ skyline::NUMBERS }>],
    film: usize,
    p: Vec3,
) -> [f32; skyline::NUMBERS] {
    let Packing::Grey(lamps) = packing else { return skylines[film].at(p) };
    let mut numbers = [0.0; skyline::NUMBERS];
    for (c, of_lamp) in skylines[..lamps].iter().skip(film * CHANNELS).take(CHANNELS).enumerate() {
        let of_lamp = of_lamp.at(p);
        numbers[c..].iter_mut().zip(&of_lamp).step_by(3).for_each(|(n, of)| *n = *of);
    }
    numbers
}

/// The same of what the untouched face around it sends. (Under the table it holds what it has at the untouched face.)
fn packed_ground(packing: Packing, grounds: &[Grid<3>], film: usize, p: Vec3) -> Vec3 {
    let of = |lamp: usize| Vec3::from(grounds[lamp].at(p.with_z(f32::MIN)));
    match packing {
        Packing::Apart => of(film),
        Packing::Grey(_) => Vec3::from_array([0, 1, 2].map(|c| packing.number(film, c, |lamp| of(lamp).x))),
    }
}
