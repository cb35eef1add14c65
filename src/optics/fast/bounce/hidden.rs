//! What unseen parts of the pad send towards the walls.

use super::elevation::{own_plane, weight};
use super::row::{Horizons, ahead};
use super::sender::Sender;
use super::{Cells, DIRECTIONS, Unseen, Untouched, nearest};
use crate::optics::fast::echo;
use crate::optics::fast::horizon::Stand;
use crate::optics::fast::lanes::{Eight, Vectors, WIDTH, Work, lanes, with_widest};
use glam::Vec3;
use rayon::prelude::*;

/// Horizons are followed from here upwards, as a slope.
const LOWEST: f32 = -10.0;

/// Up to eight of those cells, the first of which is cell `first` of all.
pub struct Hidden<'a> {
    pub cells: &'a Cells<'a>,
    pub first: usize,
    pub unseen: &'a [Unseen],
    pub untouched: Untouched<'a>,
}

/// By cell and picture, what it sends into each direction.
pub type Sent = Vec<[Vec3; echo::DIRECTIONS]>;

impl Work for Hidden<'_> {
    type Output = Sent;

    #[inline(always)]
    fn run(self) -> Sent {
        let Self { cells, first, unseen, untouched: Untouched { ground, normal: rest, .. } } = self;
        let of = |k: usize| &unseen[k.min(unseen.len() - 1)];
        let normals: [Vec3; WIDTH] = std::array::from_fn(|k| of(k).normal);
        let rests: [Vec3; WIDTH] = std::array::from_fn(|k| rest(of(k).position));
        let sender = Sender {
            areas: [Eight(lanes!(k => of(k).area_mm2)), Eight(lanes!(k => of(k).level_mm2 / rests[k].z))],
            normal: vectors(&normals),
            rest_normal: vectors(&rests),
            place: vectors(&std::array::from_fn(|k| of(k).position)),
        };
        let mut horizons: Horizons = [[Eight::all(0.0); 2]; DIRECTIONS];
        for (direction, horizon) in horizons.iter_mut().enumerate() {
            *horizon = horizon_of(cells, direction, &of, sender.normal);
        }
        let parts = sender.parts(&horizons, cells.extent, cells.edge_mm);
        let mut out = Vec::with_capacity(unseen.len() * cells.lights.len());
        for (k, cell) in unseen.iter().enumerate() {
            for (film, lights) in cells.unseen_lights.iter().enumerate() {
                let (now, before) =
                    (lights[first + k] * cells.albedo, ground(film, cell.position) * cells.albedo);
                out.push(parts.map(|[part, rest]| now * part.0[k] - before * rest.0[k]));
            }
        }
        out
    }
}

/// What eight cells see of the pad in a direction: the slope below which they do, and its weight.
#[inline(always)]
fn horizon_of<'a>(
    cells: &Cells<'_>,
    direction: usize,
    of: &impl Fn(usize) -> &'a Unseen,
    normal: Vectors,
) -> [Eight; 2] {
    let ahead = ahead(direction);
    let along = normal.x * Eight::all(ahead.x) + normal.y * Eight::all(ahead.y);
    let [plane, own] = own_plane(along, normal.z);
    let highest = Eight(lanes!(k => {
        let cell = of(k);
        let from = Stand::on(cell.position, cell.normal);
        cells.heights.horizon(from, ahead, f32::INFINITY, plane.0[k].max(LOWEST), f32::INFINITY)
    }));
    let risen = (plane.max(Eight::all(LOWEST)) + Eight::all(1e-4)).below(highest);
    [risen.choose(highest, plane), risen.choose(weight(highest, along, normal.z), own)]
}

impl Cells<'_> {
    /// Adds what is sent by what is not seen, as from the nearest cell of the picture.
    pub(super) fn send_unseen(&self, untouched: Untouched<'_>, sent: &mut [Vec3]) {
        let films = self.lights.len();
        let of_cells = self.unseen.par_chunks(WIDTH).enumerate();
        let of_cells: Vec<Sent> = of_cells
            .map(|(chunk, unseen)| {
                with_widest(Hidden { cells: self, first: chunk * WIDTH, unseen, untouched })
            })
            .collect();
        let columns = self.size[0].div_ceil(self.sending);
        for (cell, of_films) in self.unseen.iter().zip(of_cells.iter().flat_map(|of| of.chunks_exact(films)))
        {
            let [i, j] = nearest([self.size[0], self.rows], cell.at).map(|n| n / self.sending);
            for (film, of_film) in of_films.iter().enumerate() {
                let to = &mut sent[((j * columns + i) * films + film) * echo::DIRECTIONS..];
                to.iter_mut().zip(of_film).for_each(|(to, more)| *to += *more);
            }
        }
    }
}

#[inline(always)]
fn vectors(of: &[Vec3; WIDTH]) -> Vectors {
    Vectors { x: Eight(lanes!(k => of[k].x)), y: Eight(lanes!(k => of[k].y)), z: Eight(lanes!(k => of[k].z)) }
}
