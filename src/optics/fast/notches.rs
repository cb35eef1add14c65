//! Light that upright flanks send to themselves.
//!
//! A flank as narrow as the lattice is fine that runs askew to it goes round corners, inwards and outwards by turns. What stands in
//! a notch sees the other side of it: of half of the directions, at 45 degrees, three tenths. A [cell](super::bounce) of the bounce is
//! even and knows nothing of that: it would send a third too much (of light that is scattered twice; half as much of light that goes
//! on and on between the sides, of which some comes out in the end).

use super::frame::Frame;
use super::unseen::Border;
use crate::optics::Albedo;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Part of the normal upwards below which a triangle is a flank.
const LEVEL: f32 = 0.5;
/// Height of a quad with such, over its width.
const STEEP: f32 = 1.0;
/// Quads to either side among which a triangle looks for those that it sees.
const REACH: usize = 2;

/// An upright triangle of the mesh, from above.
#[derive(Debug, Clone, Copy)]
struct Facet {
    /// Its quad along the row.
    column: usize,
    middle: Vec3,
    /// Where it shows: what looks away from the camera at its highest place, as what is [unseen](super::unseen) does.
    shown: Vec3,
    /// Its normal, of length 1.
    normal: Vec2,
    /// Its area, mm^2, and the length of an upright band as large and as high, mm.
    area: f32,
    length: f32,
    /// What it reflects.
    albedo: Vec3,
}

/// What upright flanks send of the light on them, as far as cells do not know it.
#[derive(Debug, Default)]
pub struct Notches {
    /// By cell of the picture: over what it would send were it even and of the pad's mean albedo. Empty where all cells do.
    pub kept: Vec<Vec3>,
    /// Area of what sends light to itself, times the part that it catches, over the area in the picture.
    pub part: f64,
}

impl Facet {
    /// A triangle with this vector of its area, if it is upright.
    fn of(
        column: usize,
        corners: [Vec3; 3],
        area: Vec3,
        eye: Vec3,
        albedo: impl Fn() -> Vec3,
    ) -> Option<Self> {
        let whole = area.length();
        if area.z.abs() >= LEVEL * whole {
            return None;
        }
        let [p, q, r] = corners;
        let [low, top] = [q, r].into_iter().fold([p, p], |[low, top], p| {
            [if p.z < low.z { p } else { low }, if p.z > top.z { p } else { top }]
        });
        let (middle, normal) = ((p + q + r) / 3.0, area.truncate().normalize_or_zero());
        let shown = if (middle - eye).dot(area) > 0.0 { top } else { middle };
        Some(Self {
            column,
            middle,
            shown,
            normal,
            area: whole,
            length: whole / (top.z - low.z),
            albedo: albedo(),
        })
    }

    /// How much of what it sends falls on another, both of them upright bands that are much higher than wide.
    fn sees(&self, other: &Self) -> f32 {
        let way = (other.middle - self.middle).truncate();
        let far = way.length();
        let (from, to) = (way.dot(self.normal), -way.dot(other.normal));
        if from.min(to) > 0.0 { from * to * other.length / (2.0 * far.powi(3)) } else { 0.0 }
    }
}

impl<const N: usize> Frame<'_, N> {
    /// What of the light on upright flanks leaves them; `albedo` is the mean of the pad.
    pub(super) fn notched(&self, border: &Border<'_>, albedo: Vec3) -> Notches {
        let facets = if self.heights.has_sharp_rims() { self.facets() } else { Vec::new() };
        if facets.iter().all(Vec::is_empty) {
            return Notches::default();
        }
        let [nx, ny] = border.size;
        let cell_of = |facet: &Facet| {
            let place = self.once.view.project(facet.shown).truncate() / border.cell_px as f32;
            let inside = place.cmpge(Vec2::ZERO).all() && place.cmplt(Vec2::new(nx as f32, ny as f32)).all();
            inside.then(|| place.y as usize * nx + place.x as usize)
        };
        let of_row = |j: usize| -> Vec<(usize, Caught)> {
            let around = &facets[j.saturating_sub(REACH)..(j + REACH + 1).min(facets.len())];
            facets[j].iter().filter_map(|facet| Some((cell_of(facet)?, Caught::by(facet, around)))).collect()
        };
        let rows: Vec<Vec<(usize, Caught)>> =
            (0..facets.len()).into_par_iter().with_min_len(16).map(of_row).collect();
        let mut cells = vec![Caught::default(); border.cells.len()];
        for (cell, caught) in rows.into_iter().flatten() {
            cells[cell].add(&caught);
        }
        let caught_mm2: f32 = cells.iter().map(|caught| caught.area * caught.part()).sum();
        let picture_mm2 = (nx * ny) as f32 * border.edge_mm * border.edge_mm;
        let kept = cells.iter().map(|caught| caught.kept(albedo)).collect();
        Notches { kept, part: f64::from(caught_mm2 / picture_mm2) }
    }

    /// The mesh's upright triangles, by row of quads and along it.
    fn facets(&self) -> Vec<Vec<Facet>> {
        let (nx, positions) = (self.nx, &self.mesh.positions);
        let rows = positions.len() / nx - 1;
        let (forth, eye) = (self.forth(), self.once.view.camera.origin);
        let side_mm = (positions[nx - 1] - positions[0]).truncate().length();
        let least_mm = STEEP * side_mm / (nx - 1) as f32;
        let of_row = |j: usize| -> Vec<Facet> {
            let mut facets = Vec::new();
            for i in 0..nx - 1 {
                let corners = [j * nx + i, j * nx + i + 1, (j + 1) * nx + i + 1, (j + 1) * nx + i];
                let heights = corners.map(|k| positions[k].z);
                let [low, high] =
                    [f32::min, f32::max].map(|of| heights.into_iter().reduce(of).unwrap_or(0.0));
                if high - low < least_mm {
                    continue;
                }
                let [a, b, c, d] = corners;
                for half in [[a, b, c], [a, c, d]] {
                    let albedo = || match self.albedo {
                        Albedo::Constant(albedo) => *albedo,
                        Albedo::Texture(texture) => {
                            texture.sample(half.map(|k| self.mesh.uvs[k]).into_iter().sum::<Vec2>() / 3.0)
                        }
                    };
                    let [p, q, r] = half.map(|k| positions[k]);
                    let area = (q - p).cross(r - p) * (0.5 * forth);
                    facets.extend(Facet::of(i, [p, q, r], area, eye, albedo));
                }
            }
            facets
        };
        (0..rows).into_par_iter().with_min_len(16).map(of_row).collect()
    }
}

/// What is summed up over facets, times their area: the part that falls on others, and how much larger they and those around are than
/// what shows of them, which is the most that can.
#[derive(Debug, Clone, Copy, Default)]
struct Caught {
    area: f32,
    seen: f32,
    most: f32,
    albedo: Vec3,
}

impl Caught {
    /// Of a facet, by those in the rows around.
    fn by(facet: &Facet, around: &[Vec<Facet>]) -> Self {
        let (mut seen, mut sum, mut areas) = (0.0, Vec2::ZERO, 0.0);
        for row in around {
            let first = row.partition_point(|other| other.column + REACH < facet.column);
            for other in row[first..].iter().take_while(|other| other.column <= facet.column + REACH) {
                seen += facet.sees(other);
                sum += other.normal * other.area;
                areas += other.area;
            }
        }
        let most = 1.0 - sum.length() / areas;
        let area = facet.area;
        Self { area, seen: seen * area, most: most * area, albedo: facet.albedo * area }
    }

    fn add(&mut self, other: &Self) {
        self.area += other.area;
        self.seen += other.seen;
        self.most += other.most;
        self.albedo += other.albedo;
    }

    fn part(&self) -> f32 {
        if self.area > 0.0 { self.seen.min(self.most) / self.area } else { 0.0 }
    }

    /// See [`Notches::kept`].
    fn kept(&self, mean: Vec3) -> Vec3 {
        if self.area == 0.0 {
            return Vec3::ONE;
        }
        let albedo = self.albedo / self.area;
        kept(self.part(), albedo) * albedo / mean.max(Vec3::splat(1e-6))
    }
}

/// What of the light of a flank leaves it, over what would if it were even, where this part falls on itself each time.
fn kept(caught: f32, albedo: Vec3) -> Vec3 {
    Vec3::splat(1.0 - caught) / (Vec3::ONE - albedo * caught)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of an upright wall from one place to another, as two triangles of a quad have it, the outside to its left.
    fn step(facets: &mut Vec<Facet>, from: Vec2, to: Vec2) {
        let normal = (to - from).perp().normalize();
        for part in [0.25, 0.75] {
            let column = facets.len() / 2;
            let length = from.distance(to) / 2.0;
            let middle = from.lerp(to, part).extend(0.0);
            let (area, albedo) = (length, Vec3::ONE);
            facets.push(Facet { column, middle, shown: middle, normal, area, length, albedo });
        }
    }

    fn of(facets: Vec<Facet>) -> f32 {
        let mut all = Caught::default();
        // (All in one row: columns are near enough.)
        let n = facets.len();
        for facet in &facets[n / 2 - 2..n / 2 + 2] {
            all.add(&Caught::by(facet, std::slice::from_ref(&facets)));
        }
        all.part()
    }

    #[test]
    fn stairs_catch_what_crossed_strings_tell_and_walls_and_edges_nothing() {
        // Of two sides of a right angle, each as long as 1, a string takes the hypotenuse: 1 - sqrt(2) / 2.
        let mut stairs = Vec::new();
        for k in 0..6 {
            let corner = Vec2::splat(k as f32);
            step(&mut stairs, corner, corner + Vec2::X);
            step(&mut stairs, corner + Vec2::X, corner + Vec2::ONE);
        }
        let truth = 1.0 - 0.5f32.sqrt();
        let caught = of(stairs);
        assert!((caught - truth).abs() < 0.05, "{caught} instead of {truth}");
        let mut wall = Vec::new();
        (0..6).for_each(|k| step(&mut wall, Vec2::X * k as f32, Vec2::X * (k + 1) as f32));
        assert_eq!(of(wall), 0.0);
        // Round an edge from one side to the other.
        let mut edge = Vec::new();
        (0..3).for_each(|k| step(&mut edge, Vec2::X * k as f32, Vec2::X * (k + 1) as f32));
        (0..3).for_each(|k| step(&mut edge, Vec2::new(3.0, -(k as f32)), Vec2::new(3.0, -(k as f32) - 1.0)));
        assert_eq!(of(edge), 0.0);
    }

    #[test]
    fn what_is_caught_comes_out_in_part() {
        assert_eq!(kept(0.0, Vec3::splat(0.5)), Vec3::ONE);
        assert_eq!(kept(0.3, Vec3::ZERO), Vec3::splat(0.7));
        assert!((kept(0.3, Vec3::ONE) - Vec3::ONE).length() < 1e-6);
    }
}
