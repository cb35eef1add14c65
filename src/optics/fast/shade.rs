//! From a block's four nodes to the light on eight pixels.
//!
//! Fields and horizons are interpolated between the nodes of a block, bilinearly in the raster; the normal of each pixel
//! comes in at the end. Near a light, and where a block is bent, its field is worked out at each pixel. What is hidden of a
//! light is taken off as the irradiance of the ribbon below the cut.

use super::arrival::Arrival;
use super::lanes::{Eight, Vectors, WIDTH, lanes};
use super::plate::Slab;
use super::probes;
use super::slots::{POSITION, Slots};
use super::source::{KEPT, Line, Source, coarse};
use super::vector::{edges, quadrilateral};
use glam::Vec3;

/// Coefficients of 1, u, v and u v.
type Bilinear = [f32; 4];

/// A block made ready: everything as coefficients.
pub struct Block<'a, const N: usize> {
    slots: &'a Slots<N>,
    sources: &'a [Source],
    coefficients: Vec<Bilinear>,
    hidden: Vec<bool>,
    /// By light: of how many lines one is taken.
    step: Vec<usize>,
    thorough: bool,
    fixed: Vec<Option<[Line; N]>>,
    /// By light: its corners, where it has a closed form.
    closed: Vec<Option<[Vec3; 4]>>,
    /// By light: what arrives of its parts, where that is not the same of all.
    arrivals: Vec<Option<Arrival>>,
    /// By light: whether its field is not to be interpolated.
    exact: Vec<bool>,
    /// By light: what its irradiance counts for, as part of what may be wrong.
    pub weights: Vec<f32>,
}

/// What the pad hides of lights at eight points, where it is not interpolated.
#[derive(Debug, Clone, Copy)]
pub struct Own<'a> {
    /// Nodes, of which horizons alone are filled.
    pub nodes: &'a [f32],
    /// Where the node of each point starts.
    pub at: [usize; WIDTH],
}

#[inline(always)]
fn at(c: &Bilinear, u: Eight, v: Eight) -> Eight {
    Eight::all(c[0]) + Eight::all(c[1]) * u + v * (Eight::all(c[2]) + Eight::all(c[3]) * u)
}

#[inline(always)]
fn vectors_at(c: &[Bilinear], u: Eight, v: Eight) -> Vectors {
    Vectors { x: at(&c[0], u, v), y: at(&c[1], u, v), z: at(&c[2], u, v) }
}

impl<'a, const N: usize> Block<'a, N> {
    /// Room for the blocks of a picture, some lights beyond a plate. `closed` tells lights whose field has a closed form, `weights` what the irradiance
    /// of each counts for, as part of what may be wrong.
    pub fn new(
        slots: &'a Slots<N>,
        sources: &'a [Source],
        slab: Option<&Slab>,
        closed: impl Fn(usize) -> bool,
        weights: Vec<f32>,
        thorough: bool,
    ) -> Self {
        let corners = |(l, s): (usize, &Source)| s.corners().filter(|_| closed(l));
        let fixed = sources
            .iter()
            .map(|s| s.is_fixed().then(|| std::array::from_fn(|k| s.line(k, N - 1, Vec3::ZERO))));
        Self {
            slots,
            sources,
            coefficients: vec![[0.0; 4]; slots.stride()],
            hidden: vec![false; sources.len()],
            step: vec![1; sources.len()],
            thorough,
            fixed: fixed.map(|lines| lines.filter(|_| !slots.bent())).collect(),
            closed: sources.iter().enumerate().map(corners).collect(),
            arrivals: sources.iter().map(|s| Arrival::of(s, slab)).collect(),
            exact: vec![false; sources.len()],
            weights,
        }
    }

    /// Takes the nodes at the upper left, upper right, lower left and lower right corner. `bent` is how far the middle
    /// departs from their mean, mm.
    #[inline(always)]
    pub fn prepare(&mut self, [a, b, c, d]: [&[f32]; 4], bent: f32) {
        for (k, out) in self.coefficients.iter_mut().enumerate() {
            *out = [a[k], b[k] - a[k], c[k] - a[k], d[k] - c[k] - b[k] + a[k]];
        }
        for (l, (hidden, step)) in self.hidden.iter_mut().zip(&mut self.step).enumerate() {
            let flag = self.slots.light(l);
            let most = [a, b, c, d].iter().fold(0.0f32, |most, n| most.max(n[flag]));
            *hidden = self.thorough || most > 0.0;
            *step =
                step_of::<N>(self.arrivals[l].is_none() && self.sources[l].is_fixed(), most, self.thorough);
        }
        let [p, q, r] = [a, d, b].map(|n| Vec3::from_slice(&n[POSITION..]));
        let (middle, size2) = ((p + q) * 0.5, (q - p).length_squared().max((r - p).length_squared()));
        for (l, exact) in self.exact.iter_mut().enumerate() {
            let faced = [a, b, c, d].iter().all(|n| n[self.slots.gain(l)] == 1.0);
            let Some(corners) = self.closed[l].filter(|_| faced) else {
                *exact = false;
                continue;
            };
            let direct = self.slots.direct(l);
            let field = Vec3::from_slice(&a[direct..]).abs().max_element() * self.weights[l];
            *exact = falls_off(&corners, middle, field, size2, bent);
        }
    }

    /// Adds the irradiance on eight points at (u, v) of the block with unit normals, one picture after the other. With horizons
    /// of their `own`, no light's field is interpolated that has a closed form.
    #[inline(always)]
    pub fn light(
        &self,
        [u, v]: [Eight; 2],
        points: Vectors,
        normals: Vectors,
        radiances: &[Vec3],
        own: Option<Own<'_>>,
        sums: &mut [Vectors],
    ) {
        let many = self.slots.films > 1;
        for l in 0..self.sources.len() {
            let phi = match &self.closed[l] {
                Some(corners) if own.is_some() || self.exact[l] => quadrilateral(corners, points),
                _ => vectors_at(&self.coefficients[self.slots.direct(l)..], u, v),
            };
            let mut e = phi.dot(normals);
            let (hidden, step) = match own {
                None => (self.hidden[l], self.step[l]),
                Some(own) => {
                    let mut most = 0.0f32;
                    for at in own.at {
                        most = most.max(own.nodes[at + self.slots.light(l)]);
                    }
                    let even = self.arrivals[l].is_none() && self.sources[l].is_fixed();
                    (self.thorough || most > 0.0, step_of::<N>(even, most, self.thorough))
                }
            };
            if hidden || self.dips(l, [u, v], points, normals) {
                e = e - self.taken(l, [u, v], points, normals, (hidden, step, own));
            }
            let e = e.max(Eight::all(0.0));
            if many {
                sums[l] = sums[l] + Vectors { x: e, y: e, z: e };
            } else {
                sums[0] = sums[0] + Vectors::all(radiances[l]).scaled(e);
            }
        }
        let n = normals;
        let terms = probes::terms_of(n);
        for (film, sum) in sums.iter_mut().enumerate() {
            let c = &self.coefficients[self.slots.indirect(film)..][..self.slots.indirect_numbers()];
            if self.slots.grey {
                let mut e = at(&c[0], u, v);
                for (k, term) in terms.iter().enumerate() {
                    e = e + at(&c[k + 1], u, v) * *term;
                }
                let e = e.max(Eight::all(0.0));
                *sum = *sum + Vectors { x: e, y: e, z: e };
                continue;
            }
            let mut e = vectors_at(c, u, v);
            for (k, term) in terms.iter().enumerate() {
                e = e + vectors_at(&c[3 * (k + 1)..], u, v).scaled(*term);
            }
            let zero = Eight::all(0.0);
            *sum = *sum + Vectors { x: e.x.max(zero), y: e.y.max(zero), z: e.z.max(zero) };
        }
    }

    /// Whether some of the light's lower edge is below the horizon of some normal.
    #[inline(always)]
    fn dips(&self, l: usize, uv: [Eight; 2], points: Vectors, normals: Vectors) -> bool {
        let zero = Eight::all(0.0);
        let ends = [0, N - 1].map(|k| self.end(l, k, 0, uv, points).dot(normals));
        ends[0].min(ends[1]).below(zero).any()
    }

    /// An end of a line as seen from the points.
    #[inline(always)]
    fn end(&self, l: usize, line: usize, end: usize, [u, v]: [Eight; 2], points: Vectors) -> Vectors {
        match &self.fixed[l] {
            Some(lines) => Vectors::all(lines[line][end]) - points,
            None => {
                let kept = |k: usize| vectors_at(&self.coefficients[self.slots.line(l, k) + 3 * end..], u, v);
                if line.is_multiple_of(KEPT) {
                    kept(line)
                } else {
                    (kept(line - 1) + kept(line + 1)).scaled(Eight::all(0.5))
                }
            }
        }
    }

    /// Irradiance of what is hidden.
    #[inline(always)]
    fn taken(
        &self,
        l: usize,
        uv: [Eight; 2],
        points: Vectors,
        normals: Vectors,
        (hidden, step, own): (bool, usize, Option<Own<'_>>),
    ) -> Eight {
        let [u, v] = uv;
        let (zero, one) = (Eight::all(0.0), Eight::all(1.0));
        let horizons = self.slots.horizons(l);
        let mut lows = [Vectors::all(Vec3::ZERO); N];
        let mut cuts = lows;
        for k in (0..N).step_by(step) {
            let (low, high) = (self.end(l, k, 0, uv, points), self.end(l, k, 1, uv, points));
            // The part of the line below the surface's own plane...
            let dipped = part_below(low.dot(normals), high.dot(normals));
            // ...and below the pad's horizon.
            // (Heights over it, times 1 - |squeezed|.)
            let slope = match own {
                None => at(&self.coefficients[horizons + k], u, v),
                Some(own) => Eight(lanes!(i => own.nodes[own.at[i] + horizons + k])),
            };
            let scale = one - slope.abs();
            let over = |q: Vectors| q.z * scale - slope * (q.x * q.x + q.y * q.y).sqrt();
            let part = if hidden { dipped.max(part_below(over(low), over(high))) } else { dipped };
            let part = part.max(zero).min(one);
            lows[k] = low.unit();
            cuts[k] = (low + (high - low).scaled(part)).unit();
        }
        let gain = at(&self.coefficients[self.slots.gain(l)], u, v) * Eight::all(-0.5);
        if let Some(arrival) = &self.arrivals[l] {
            return strips(&lows, &cuts, step, |q| arrival.part(q)).dot(normals) * gain;
        }
        let mut sum = edges(lows[N - 1], cuts[N - 1]) + edges(cuts[0], lows[0]);
        for k in (step..N).step_by(step) {
            sum = sum + edges(lows[k - step], lows[k]) + edges(cuts[k], cuts[k - step]);
        }
        sum.dot(normals) * gain
    }
}

/// Vector irradiance of a ribbon between two curves, times -2, each strip between lines with the radiance of its middle.
#[inline(always)]
fn strips<const N: usize>(
    lows: &[Vectors; N],
    cuts: &[Vectors; N],
    step: usize,
    radiance: impl Fn(Vectors) -> Eight,
) -> Vectors {
    let mut sum = Vectors::all(Vec3::ZERO);
    let mut upright = edges(lows[0], cuts[0]);
    for k in (step..N).step_by(step) {
        let next = edges(lows[k], cuts[k]);
        let strip = edges(lows[k - step], lows[k]) + next + edges(cuts[k], cuts[k - step]) - upright;
        let middle = (lows[k - step] + lows[k] + cuts[k - step] + cuts[k]).unit();
        sum = sum + strip.scaled(radiance(middle));
        upright = next;
    }
    sum
}

/// Of how many lines of a light one is taken, for the largest flag of the nodes; whether it is `even`, a rectangle all of whose parts
/// shine alike.
#[inline(always)]
fn step_of<const N: usize>(even: bool, most: f32, thorough: bool) -> usize {
    if thorough {
        return 1;
    }
    // A plane cuts a rectangle along a straight line, a horizon does not; round lights have no straight edge, and a profile or a
    // plate makes each line another.
    let followed = (coarse(N) >> most as u32).max(1);
    if even { followed } else { followed.min(KEPT) }
}

/// Whether the field of a rectangle bends too much to be interpolated across a block around `place`, whose diagonal squared is
/// `size2`, mm^2, and whose middle is `bent` off the mean of its corners, mm. `field` is what there is of it, as part of what may
/// be wrong.
#[inline(always)]
pub fn falls_off(corners: &[Vec3; 4], place: Vec3, field: f32, size2: f32, bent: f32) -> bool {
    // A field that falls off over the distance d errs by parts of its own of about (size/d)^2/8, twice.
    let away2 = distance_squared(corners, place).max(1e-6);
    field * (0.125 * size2 + bent * away2.sqrt()) > away2
}

/// Square of the distance to a rectangle.
#[inline(always)]
pub fn distance_squared([a, b, _, d]: &[Vec3; 4], p: Vec3) -> f32 {
    let (u, v, from) = (*b - *a, *d - *a, p - *a);
    let along = |e: Vec3| e * (from.dot(e) / e.length_squared().max(1e-12)).clamp(0.0, 1.0);
    (from - along(u) - along(v)).length_squared()
}

/// How much of a line lies below, for the heights of its ends.
#[inline(always)]
fn part_below(low: Eight, high: Eight) -> Eight {
    let zero = Eight::all(0.0);
    let part = low.over(low - high);
    // A high end that is below, too: all of it. (A line that only dips at its high end keeps all.)
    let part = high.below(Eight::all(1e-12)).choose(Eight::all(1.0), part);
    low.below(zero).choose(part, zero)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_to_a_rectangle_is_that_of_its_nearest_point() {
        let corners = [Vec3::ZERO, Vec3::X * 2.0, Vec3::new(2.0, 0.0, 1.0), Vec3::Z];
        for (p, truth) in [
            (Vec3::new(1.0, 3.0, 0.5), 9.0),
            (Vec3::new(1.0, 0.0, 2.0), 1.0),
            (Vec3::new(4.0, 1.0, -2.0), 9.0),
        ] {
            assert!((distance_squared(&corners, p) - truth).abs() < 1e-5, "{p}");
        }
    }
}
