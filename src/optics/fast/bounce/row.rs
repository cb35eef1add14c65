//! A row of cells: from eight at once the pad's profile is followed in all directions.

use super::elevation::{mean_slope, own_plane, shares, weight};
use super::sender::Sender;
use super::walk::{Walk, distances};
use super::{Cells, DIRECTIONS, MARGIN, MOST, Means, SENDING};
use crate::optics::fast::echo::{self, RISES, SLOPES};
use crate::optics::fast::lanes::{Eight, Mask, Vectors, WIDTH, Work, with_widest};
use crate::optics::fast::lookout::Lookout;
use crate::optics::fast::skyline;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};

/// Ground this even, up to the farthest distance, needs no look: a slope.
const EVEN: f32 = 4e-3;
/// Cells that see nothing of the pad are taken to be this high, mm.
const NOWHERE: f32 = -1e4;
/// Cells are no nearer to each other than this, in their edges.
const NEAREST: f32 = 0.3;
/// From its middle a flank reaches about so many times as far as to what counts as low on it.
const FLANK: f32 = 1.5;
/// What rises on by this slope above the line of sight has an edge, which is looked for.
const EDGED: f32 = 0.3;
/// So often the height is halved between a flank's foot and its rim, to find the flank.
const HALVINGS: usize = 2;

/// Cells farther aside of the direction looked into than to 45 degrees are not seen in it, as a cosine.
const ASTRAY: f32 = 0.7;
/// Planes whose normal has less of it upwards are steep; 1 over the square of the sine by which something is clear of one.
const STEEP: f32 = 0.7;
const CLEAR: f32 = 100.0;

/// A row of cells.
pub struct Row<'a> {
    pub cells: &'a Cells<'a>,
    pub means: &'a Means,
    /// The untouched sensor's walls, in a picture at a place.
    pub sky: &'a (dyn Fn(usize, Vec3) -> [f32; skyline::NUMBERS] + Sync),
    pub j: usize,
    /// Gains, picture by picture, and what changes with height.
    pub out: &'a mut [Vec3],
    pub pass: Pass<'a>,
}

/// Which cells of a row.
pub enum Pass<'a> {
    /// Those that are worked on together with an upright flank.
    Flanks,
    /// All, and what they send towards walls.
    All { sent: &'a mut [Vec3] },
}

/// A row of a pad with or without flanks: what only they need costs others nothing.
struct OfPad<'a, const FLANKS: bool>(Row<'a>);

impl<const FLANKS: bool> Work for OfPad<'_, FLANKS> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.over::<FLANKS>();
    }
}

/// By direction: the slope below which the pad is seen, and the weight of what is.
pub type Horizons = [[Eight; 2]; DIRECTIONS];

impl Row<'_> {
    /// Works on the row.
    pub fn work(self) {
        match self.means.tilts.is_empty() {
            true => with_widest(OfPad::<false>(self)),
            false => with_widest(OfPad::<true>(self)),
        }
    }

    #[inline(always)]
    fn over<const FLANKS: bool>(mut self) {
        let nx = self.cells.size[0];
        let films = self.means.lights.len();
        let mut sums = vec![Vectors::all(Vec3::ZERO); films];
        let mut skies: Vec<[Eight; skyline::NUMBERS]> = Vec::new();
        for i in (0..nx).step_by(WIDTH) {
            let lanes = WIDTH.min(nx - i);
            let at = self.means.at(i, self.j);
            let even = EVEN * self.cells.edge_mm;
            let level = |k: usize| {
                let z = self.means.heights[k];
                z == f32::NEG_INFINITY
                    || (self.means.normals[2][k] > 1.0 - 1e-5 && self.means.highest - z < even)
            };
            let flanks = &self.cells.flanks[self.j * nx + i..][..lanes];
            if matches!(self.pass, Pass::Flanks) && !flanks.contains(&true) {
                continue;
            }
            if (at..at + lanes).all(level) {
                self.send_level(at, i);
                continue;
            }
            skies.clear();
            // (From low on a flank first: what is seen there more or less than from its middle changes with height.)
            let mut low = Vec::new();
            if FLANKS && flanks.contains(&true) {
                low = vec![Vectors::all(Vec3::ZERO); films];
                self.look::<FLANKS>(at, lanes, true, &mut low, &mut skies);
            }
            sums.fill(Vectors::all(Vec3::ZERO));
            skies.clear();
            let horizons = self.look::<FLANKS>(at, lanes, false, &mut sums, &mut skies);
            for (film, (high, low)) in sums.iter().zip(&low).enumerate() {
                let per_mm = Eight::all(TAU / DIRECTIONS as f32)
                    .over(Means::eight(&self.means.lower, at).max(Eight::all(1e-3)));
                let more = (*high - *low).scaled(per_mm);
                for k in 0..lanes {
                    let is_tall = self.means.lower[at + k] > 0.0;
                    let more = Vec3::new(more.x.0[k], more.y.0[k], more.z.0[k]);
                    self.out[(films + film) * nx + i + k] = if is_tall { more } else { Vec3::ZERO };
                }
            }
            for (film, sum) in sums.iter().enumerate() {
                for k in 0..lanes {
                    if level(at + k) {
                        continue;
                    }
                    let change = Vec3::new(sum.x.0[k], sum.y.0[k], sum.z.0[k]) * (TAU / DIRECTIONS as f32);
                    let [x, y, z] = &self.means.own[film];
                    let e = Vec3::new(x[at + k], y[at + k], z[at + k]);
                    let most = e * (MOST - 1.0);
                    self.out[film * nx + i + k] =
                        Vec3::ONE + change.clamp(-0.9 * e, most) / e.max(Vec3::splat(1e-12));
                }
            }
            self.send(at, i, lanes, &horizons);
        }
    }

    /// Follows the profile from eight cells into all directions; what rises above what was seen before takes the place of
    /// sky or ground. `lowered` is from low on a flank, else it is from the cells' middles.
    #[inline(always)]
    fn look<const FLANKS: bool>(
        &mut self,
        at: usize,
        lanes: usize,
        lowered: bool,
        sums: &mut [Vectors],
        skies: &mut Vec<[Eight; skyline::NUMBERS]>,
    ) -> Horizons {
        let mut horizons = [[Eight::all(0.0); 2]; DIRECTIONS];
        let means = self.means;
        let (zero, even, least) = (Eight::all(0.0), Eight::all(EVEN), Eight::all(1e-3));
        let mut z = Means::eight(&means.heights, at);
        let [mut x, mut y] = [0, 1].map(|c| Means::eight(&means.places[c], at));
        let nearest = Eight::all(NEAREST * self.cells.edge_mm);
        let [nx, ny, nz] = [0, 1, 2].map(|c| Means::eight(&means.normals[c], at));
        let shown_normals =
            if means.shown_normals[0].is_empty() { &means.normals } else { &means.shown_normals };
        if FLANKS && lowered {
            // Down the flank's plane.
            let by = Means::eight(&means.lower, at);
            let aside = (by * nz).over((nx * nx + ny * ny).max(least));
            (x, y, z) = (x + nx * aside, y + ny * aside, z - by);
        }
        // Slopes of the cell's own plane along x and y.
        let flat = Eight::all(1e-3).below(nz);
        let [plane_x, plane_y] = [nx, ny].map(|n| flat.choose((-n).over(nz), zero));
        let is_steep = nz.below(Eight::all(STEEP)).any();
        let reflected = self.cells.albedo * FRAC_1_PI;
        let distances = distances(self.cells.closely, self.cells.sending / SENDING);
        let farthest = distances[distances.len() - 1] * self.cells.edge_mm;
        // By picture: what was seen last, the untouched ground there, and by how much the first changes with the slope under which
        // it is seen.
        let mut tops = vec![[Vectors::all(Vec3::ZERO); 3]; sums.len()];
        let middle = (0..lanes).min_by_key(|k| (!z.0[*k].is_finite(), k.abs_diff(lanes / 2))).unwrap_or(0);
        let stands = Vec3::new(x.0[middle], y.0[middle], z.0[middle].max(NOWHERE));
        let lookout = Lookout::new(stands, self.cells.eye.z, self.cells.edge_mm);
        for (direction, horizon) in horizons.iter_mut().enumerate() {
            let ahead = ahead(direction);
            let along = nx * Eight::all(ahead.x) + ny * Eight::all(ahead.y);
            // Elevations as slopes. Below the surface's own plane nothing arrives.
            let [mut before, mut below] = own_plane(along, nz);
            let borders: [Eight; echo::RISES - 1] =
                std::array::from_fn(|k| weight(Eight::all(SLOPES[k + 1]), along, nz));
            // Where the step before showed something, what shows next lies between the two; first of all the cell itself.
            let mut shown: Option<(usize, Mask)> = Some((at, zero.below(Eight::all(1.0))));
            let mut turned = zero;
            let (mut steep, mut seen) = (zero, zero);
            let back = self.neighbour(lookout.cells_to(ahead * self.cells.edge_mm, stands.z)).unwrap_or(0);
            let mut height = stands.z;
            let mut walk = Walk::over(distances);
            while let Some(distance) = walk.step() {
                let ahead_mm = ahead * (distance * self.cells.edge_mm);
                let last_height = height;
                // How high it is there is known when it is found: the second look is at the right place.
                let Some(first) = self.neighbour(lookout.cells_to(ahead_mm, height)) else { break };
                let of_middle = at + middle;
                let there = means.heights[of_middle.wrapping_add_signed(first)];
                let second = lookout.tells((there - height).abs()).then(|| {
                    height = there;
                    self.neighbour(lookout.cells_to(ahead_mm, there))
                });
                let mut seen_at = second.flatten().unwrap_or(first);
                let found = means.heights[of_middle.wrapping_add_signed(seen_at)];
                if second.is_some() && lookout.tells((found - height).abs()) {
                    (seen_at, height) =
                        self.between((of_middle, &lookout), ahead_mm, [last_height, height], seen_at);
                }
                let k = at.wrapping_add_signed(seen_at);
                // (The picture moves what is high: places tell how far away it is.)
                let (dx, dy) = (Means::eight(&means.places[0], k) - x, Means::eight(&means.places[1], k) - y);
                let away = (dx * dx + dy * dy).sqrt().max(nearest);
                // What is looked at lies a little aside of the direction: there the cell's own plane has another slope.
                let mut plane =
                    plane_x * (Eight::all(ahead.x) * away - dx) + plane_y * (Eight::all(ahead.y) * away - dy);
                let dz = (Means::eight(&means.heights, k) - z).max(Eight::all(NOWHERE));
                if is_steep {
                    // What stands clear of a steep plane is where it is.
                    let (clear, far) = (nx * dx + ny * dy + nz * dz, away * away + dz * dz);
                    plane = plane * far.over(far + clear * clear * Eight::all(CLEAR));
                }
                let rise = (dz + plane).over(away);
                // (What lies aside may stand over the cell's own plane there, and not over it ahead.)
                let straight = dx * Eight::all(ahead.x) + dy * Eight::all(ahead.y);
                let risen = (before + even).below(rise).and((away * Eight::all(ASTRAY)).below(straight));
                if !risen.any() {
                    shown = None;
                    continue;
                }
                // How much is seen of a step on what is there, and on what was there before: by how much its slope is above
                // the line of sight.
                let normal = |c: usize| Means::eight(&shown_normals[c], k);
                let toward =
                    -(normal(0) * dx + normal(1) * dy + normal(2) * dz).over(away * normal(2).max(least));
                let hides = toward.below(least);
                // (Of a step whose top is not seen, what rises to it lies in between.)
                if walk.leapt() && risen.and(hides).any() {
                    walk.go_back();
                    height = last_height;
                    continue;
                }
                let now = weight(rise, along, nz);
                let (hidden, of_ground) = shares([before, below], [rise, now], risen);
                let of_sky = hidden[1] - hidden[0];
                if skies.is_empty() {
                    self.gather(at, lanes, skies);
                }
                if shown.is_some_and(|(nearer, _)| nearer == at) {
                    // Of the cell itself half is in that where both planes meet halfway, and nothing where they meet at an end.
                    let own = (nx * dx + ny * dy + nz * dz).over(away * nz.max(least)).max(least);
                    let halfway = (toward * own * Eight::all(2.0)).over((toward + own) * (toward + own));
                    let beside = toward * halfway.over(Eight::all(1.0) - halfway);
                    turned = hides.choose(Eight::all(1.0), beside.max(least));
                    // (An upright flank goes down to its foot as it is: the cell itself is before that.)
                    if FLANKS {
                        turned = Eight::all(0.5).below(Means::eight(&means.upright, k)).choose(zero, turned);
                    }
                }
                let step =
                    k.checked_add_signed(-back).filter(|s| s + WIDTH <= means.heights.len()).unwrap_or(k);
                let toward = toward.max(least);
                if FLANKS {
                    seen = risen.choose(mean_slope([before, below], [rise, now], [along, nz]), seen);
                }
                for (film, sum) in sums.iter_mut().enumerate() {
                    let walls = skyline::hidden(&skies[film], direction, &borders, hidden);
                    let scaled = |light: Vectors| Vectors {
                        x: light.x * Eight::all(reflected.x),
                        y: light.y * Eight::all(reflected.y),
                        z: light.z * Eight::all(reflected.z),
                    };
                    // The light there, and what it changes by with the slope.
                    let light_of = |k: usize| {
                        let light = Means::light(&means.lights[film], k);
                        if !FLANKS {
                            return (light, Vectors::all(Vec3::ZERO));
                        }
                        let tilts = &means.tilts[film];
                        let [dx, dy] = [0, 1].map(|c| Means::eight(&means.places[c], k) - [x, y][c]);
                        let away = (dx * dx + dy * dy).sqrt();
                        let up = z + seen * away - Means::eight(&means.heights, k).max(Eight::all(NOWHERE));
                        let most = Means::eight(&means.lower, k) * Eight::all(FLANK);
                        let by_mm = Means::light(tilts, k);
                        (light + by_mm.scaled(up.max(-most).min(most)), by_mm.scaled(away))
                    };
                    let (mut light, mut by_slope) = light_of(k);
                    if hides.any() {
                        // The top of a step is not seen, but what rises to it.
                        let of_step = light_of(step);
                        light = hides.pick(of_step.0, light);
                        if FLANKS {
                            by_slope = hides.pick(of_step.1, by_slope);
                        }
                    }
                    let mut ground = Means::light(&means.grounds[film], k);
                    if let Some((nearer, of)) = shown {
                        let whole = Eight::all(1.0).over(turned + toward);
                        let between = |near: Vectors, far: Vectors| {
                            (near.scaled(turned) + far.scaled(toward)).scaled(whole)
                        };
                        let (near, far) = (light_of(nearer), light_of(k));
                        light = of.pick(between(near.0, far.0), light);
                        if FLANKS {
                            by_slope = of.pick(between(near.1, far.1), by_slope);
                        }
                        let (near, far) = (
                            Means::light(&means.grounds[film], nearer),
                            Means::light(&means.grounds[film], k),
                        );
                        ground = of.pick(between(near, far), ground);
                    }
                    let (radiance, ground) = (scaled(light), scaled(ground));
                    *sum = *sum + (radiance.scaled(of_sky) - walls) + (radiance - ground).scaled(of_ground);
                    let top = &mut tops[film];
                    (top[0], top[1]) = (risen.pick(radiance, top[0]), risen.pick(ground, top[1]));
                    if FLANKS {
                        top[2] = risen.pick(scaled(by_slope), top[2]);
                    }
                }
                (shown, turned) = (Some((k, risen)), toward);
                steep = risen.choose(hides.choose(steep, toward), steep);
                before = risen.choose(rise, before);
                below = risen.choose(now, below);
            }
            let rose = Eight::all(EDGED).below(steep);
            if rose.any() {
                // What was seen last goes on to its edge, which lies between the middles of cells.
                let mut top = before;
                for lane in (0..lanes).filter(|lane| rose.lane(*lane)) {
                    let p = Vec3::new(x.0[lane], y.0[lane], z.0[lane]);
                    top.0[lane] =
                        self.cells.heights.horizon(p, ahead, farthest, before.0[lane], f32::INFINITY);
                }
                let now = weight(top, along, nz);
                let (hidden, of_ground) = shares([before, below], [top, now], rose);
                let mut higher = zero;
                if FLANKS {
                    higher = rose.choose(mean_slope([before, below], [top, now], [along, nz]) - seen, zero);
                }
                for (film, sum) in sums.iter_mut().enumerate() {
                    let walls = skyline::hidden(&skies[film], direction, &borders, hidden);
                    let [radiance, ground, by_slope] = tops[film];
                    let radiance = if FLANKS { radiance + by_slope.scaled(higher) } else { radiance };
                    *sum = *sum
                        + (radiance.scaled(hidden[1] - hidden[0]) - walls)
                        + (radiance - ground).scaled(of_ground);
                }
                (before, below) = (top, now);
            }
            *horizon = [before, below];
        }
        horizons
    }

    /// Where a flank is seen that a look as from its foot passes and one as from its rim, too: some of it is as high as it was
    /// taken to be. By how much the index of that cell differs from one in the `middle`, and its height, from the two heights that
    /// were tried and what was seen last.
    #[inline(never)]
    fn between(
        &self,
        (middle, lookout): (usize, &Lookout),
        ahead_mm: Vec2,
        [mut from, mut to]: [f32; 2],
        mut seen_at: isize,
    ) -> (isize, f32) {
        let (upwards, mut height) = (from < to, to);
        for _ in 0..HALVINGS {
            let found = self.means.heights[middle.wrapping_add_signed(seen_at)];
            let between = 0.5 * (from + to);
            let cell = self.neighbour(lookout.cells_to(ahead_mm, between));
            let Some(cell) = cell.filter(|_| lookout.tells((found - height).abs())) else { break };
            (seen_at, height) = (cell, between);
            let is_higher = self.means.heights[middle.wrapping_add_signed(cell)] > between;
            if is_higher == upwards { from = between } else { to = between }
        }
        (seen_at, height)
    }

    /// By how much the index of a cell of this row differs from that of another, unless that is far beside the picture.
    #[inline(always)]
    fn neighbour(&self, (aside, down): (isize, isize)) -> Option<isize> {
        let rows = self.cells.size[1] + 2 * self.means.beside;
        let row = (self.j + self.means.beside).checked_add_signed(down).filter(|row| *row < rows);
        row.map(|_| aside.clamp(-(MARGIN as isize), MARGIN as isize) + down * self.means.stride as isize)
    }

    /// Eight level cells in the open: more or less light than before goes everywhere as from an even face.
    #[inline(always)]
    fn send_level(&mut self, at: usize, i: usize) {
        let (means, films) = (self.means, self.means.own.len());
        let Pass::All { sent } = &mut self.pass else { return };
        if self.cells.echo.is_none() {
            return;
        }
        let [area, rest_area] = [0, 1].map(|k| Means::eight(&means.areas[k], at));
        for film in 0..films {
            let (now, before) = (Means::light(&means.own[film], at), Means::light(&means.grounds[film], at));
            let more = (now.scaled(area) - before.scaled(rest_area)).sums() * self.cells.albedo;
            let to =
                &mut sent[(i / self.cells.sending * films + film) * echo::DIRECTIONS..][..echo::DIRECTIONS];
            for (k, to) in to.iter_mut().enumerate() {
                *to += more * echo::level_part(k % RISES);
            }
        }
    }

    /// What eight cells send into each direction above their horizons, less what the untouched face sent.
    #[inline(always)]
    fn send(&mut self, at: usize, i: usize, lanes: usize, horizons: &Horizons) {
        let (means, films, nx) = (self.means, self.means.own.len(), self.cells.size[0]);
        if self.cells.echo.is_none() || matches!(self.pass, Pass::Flanks) {
            return;
        }
        let sender = Sender {
            areas: [0, 1].map(|k| Means::eight(&means.areas[k], at)),
            normal: Means::light(&means.normals, at),
            rest_normal: Means::light(&means.rest_normals, at),
            place: Vectors {
                x: Means::eight(&means.places[0], at),
                y: Means::eight(&means.places[1], at),
                z: Means::eight(&means.heights, at),
            },
        };
        let parts = sender.parts(horizons, self.cells.extent, self.cells.edge_mm);
        for film in 0..films {
            let mut now = Means::light(&means.own[film], at);
            for k in 0..lanes {
                let gain = self.out[film * nx + i + k];
                (now.x.0[k], now.y.0[k], now.z.0[k]) =
                    (now.x.0[k] * gain.x, now.y.0[k] * gain.y, now.z.0[k] * gain.z);
            }
            let before = Means::light(&means.grounds[film], at);
            let Pass::All { sent } = &mut self.pass else { return };
            let to =
                &mut sent[(i / self.cells.sending * films + film) * echo::DIRECTIONS..][..echo::DIRECTIONS];
            for (to, [part, rest]) in to.iter_mut().zip(&parts) {
                *to += (now.scaled(*part) - before.scaled(*rest)).sums() * self.cells.albedo;
            }
        }
    }

    /// The untouched sensor's walls at eight cells, by picture.
    #[inline(never)]
    fn gather(&self, at: usize, lanes: usize, skies: &mut Vec<[Eight; skyline::NUMBERS]>) {
        for film in 0..self.means.lights.len() {
            let mut numbers = [Eight::all(0.0); skyline::NUMBERS];
            for lane in 0..lanes {
                let k = at + lane;
                if self.means.heights[k] == f32::NEG_INFINITY {
                    continue;
                }
                let p = Vec3::new(self.means.places[0][k], self.means.places[1][k], self.means.heights[k]);
                for (out, number) in numbers.iter_mut().zip((self.sky)(film, p)) {
                    out.0[lane] = number;
                }
            }
            skies.push(numbers);
        }
    }
}

/// A direction looked into.
#[inline(always)]
pub fn ahead(direction: usize) -> Vec2 {
    Vec2::from_angle((direction as f32 + 0.5) * (TAU / DIRECTIONS as f32))
}
