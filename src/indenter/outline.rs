//! Plane regions bounded by straight lines and circular arcs, with exact signed distance.
//!
//! A region is a set of loops, counter-clockwise around the outside and clockwise around holes, so
//! that the outward normal is always on the right of the direction of travel. Pieces need no
//! order: inside or outside is decided by parity, distance by the nearest piece.
//!
//! [`Outline::eroded`] moves the boundary inwards. Lines and arcs stay lines and arcs when they are
//! offset, so the result is exact: offset every piece, put a circle around every vertex, cut
//! everything where it meets, and keep what is really that far from the old boundary. A solid
//! rounded by a ball is the eroded solid grown by the ball again (a morphological opening): its flat
//! faces stay where they were, and only convex edges are taken off.

use glam::DVec2;

/// Points nearer than this are the same point, mm.
const WELD_MM: f64 = 1e-9;
/// Cuts nearer than this are one cut: where circles touch, their crossing is known to about 1e-7 mm.
const SAME_STOP_MM: f64 = 1e-6;
/// How far a kept offset piece may be from the exact offset distance, mm.
const OFFSET_TOLERANCE_MM: f64 = 1e-8;

/// A straight line or an arc of less than half a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Piece {
    /// From `a` to `b`.
    Line {
        /// Start.
        a: DVec2,
        /// End.
        b: DVec2,
    },
    /// From `a` to `b` around `centre`.
    Arc {
        /// Start.
        a: DVec2,
        /// End.
        b: DVec2,
        /// Centre of the circle.
        centre: DVec2,
        /// Radius of the circle, mm.
        radius: f64,
        /// Whether it runs counter-clockwise: the region is then on the side of the centre.
        ccw: bool,
    },
}

impl Piece {
    fn ends(&self) -> (DVec2, DVec2) {
        match *self {
            Piece::Line { a, b } | Piece::Arc { a, b, .. } => (a, b),
        }
    }

    /// Whether the direction `v` from an arc's centre points at the arc.
    fn arc_spans(a: DVec2, b: DVec2, centre: DVec2, ccw: bool, v: DVec2) -> bool {
        let (from, to) = if ccw { (a - centre, b - centre) } else { (b - centre, a - centre) };
        from.perp_dot(v) >= 0.0 && v.perp_dot(to) >= 0.0
    }

    /// The point of the piece nearest to `p`.
    fn nearest(&self, p: DVec2) -> DVec2 {
        match *self {
            Piece::Line { a, b } => {
                let t = b - a;
                a + t * ((p - a).dot(t) / t.length_squared()).clamp(0.0, 1.0)
            }
            Piece::Arc { a, b, centre, radius, ccw } => {
                let v = p - centre;
                let length = v.length();
                if length > 0.0 && Self::arc_spans(a, b, centre, ccw, v) {
                    centre + v * (radius / length)
                } else if p.distance_squared(a) <= p.distance_squared(b) {
                    a
                } else {
                    b
                }
            }
        }
    }

    /// Outward unit normal at a point of the piece.
    fn normal(&self, q: DVec2) -> DVec2 {
        match *self {
            Piece::Line { a, b } => {
                let t = (b - a).normalize();
                DVec2::new(t.y, -t.x)
            }
            Piece::Arc { centre, ccw, .. } => {
                let n = (q - centre).normalize();
                if ccw { n } else { -n }
            }
        }
    }

    fn middle(&self) -> DVec2 {
        match *self {
            Piece::Line { a, b } => (a + b) / 2.0,
            Piece::Arc { a, b, centre, radius, .. } => {
                centre + ((a - centre) + (b - centre)).normalize() * radius
            }
        }
    }

    /// The piece moved outwards by `by` (inwards when negative); `None` when an arc shrinks away.
    fn moved(&self, by: f64) -> Option<Piece> {
        match *self {
            Piece::Line { a, b } => {
                let n = self.normal(a) * by;
                Some(Piece::Line { a: a + n, b: b + n })
            }
            Piece::Arc { a, b, centre, radius, ccw } => {
                let grown = if ccw { radius + by } else { radius - by };
                let scale = grown / radius;
                (grown > WELD_MM).then(|| Piece::Arc {
                    a: centre + (a - centre) * scale,
                    b: centre + (b - centre) * scale,
                    centre,
                    radius: grown,
                    ccw,
                })
            }
        }
    }

    /// How far along the piece a point on it lies (any increasing measure).
    fn along(&self, q: DVec2) -> f64 {
        match *self {
            Piece::Line { a, b } => (q - a).dot(b - a),
            Piece::Arc { a, centre, ccw, .. } => {
                let angle = (a - centre).angle_to(q - centre);
                if ccw { angle } else { -angle }
            }
        }
    }

    /// The part of the piece between two of its points.
    fn between(&self, from: DVec2, to: DVec2) -> Piece {
        match *self {
            Piece::Line { .. } => Piece::Line { a: from, b: to },
            Piece::Arc { centre, radius, ccw, .. } => Piece::Arc { a: from, b: to, centre, radius, ccw },
        }
    }

    /// Points where the carriers (infinite line, full circle) of two pieces meet.
    fn crossings(&self, other: &Piece) -> Vec<DVec2> {
        let line_circle = |a: DVec2, b: DVec2, centre: DVec2, radius: f64| {
            let t = (b - a).normalize();
            let foot = a + t * (centre - a).dot(t);
            let rest = radius * radius - foot.distance_squared(centre);
            if rest < 0.0 { vec![] } else { vec![foot + t * rest.sqrt(), foot - t * rest.sqrt()] }
        };
        match (*self, *other) {
            (Piece::Line { a, b }, Piece::Line { a: c, b: d }) => {
                let (t, u) = (b - a, d - c);
                let det = t.perp_dot(u);
                if det.abs() <= 1e-12 * t.length() * u.length() {
                    return vec![];
                }
                vec![a + t * ((c - a).perp_dot(u) / det)]
            }
            (Piece::Line { a, b }, Piece::Arc { centre, radius, .. })
            | (Piece::Arc { centre, radius, .. }, Piece::Line { a, b }) => line_circle(a, b, centre, radius),
            (Piece::Arc { centre: c, radius: r, .. }, Piece::Arc { centre: d, radius: s, .. }) => {
                let axis = d - c;
                let gap = axis.length();
                if gap < WELD_MM {
                    return vec![];
                }
                let x = (gap * gap + r * r - s * s) / (2.0 * gap);
                let rest = r * r - x * x;
                if rest < 0.0 {
                    return vec![];
                }
                let (e, h) = (axis / gap, rest.sqrt());
                vec![c + e * x + e.perp() * h, c + e * x - e.perp() * h]
            }
        }
    }

    /// Lowest y of the piece at abscissa `x`.
    fn lowest_at(&self, x: f64) -> Option<f64> {
        match *self {
            Piece::Line { a, b } => {
                let (lo, hi) = if a.x <= b.x { (a, b) } else { (b, a) };
                if x < lo.x - WELD_MM || x > hi.x + WELD_MM {
                    None
                } else if hi.x - lo.x < WELD_MM {
                    Some(lo.y.min(hi.y))
                } else {
                    Some(lo.y + (hi.y - lo.y) * ((x - lo.x) / (hi.x - lo.x)).clamp(0.0, 1.0))
                }
            }
            Piece::Arc { a, b, centre, radius, ccw } => {
                let rest = radius * radius - (x - centre.x).powi(2);
                let sides: &[f64] = if rest >= 0.0 { &[-1.0, 1.0] } else { &[] };
                let on_circle = sides
                    .iter()
                    .map(|side| DVec2::new(x - centre.x, side * rest.sqrt()))
                    .filter(|&v| Self::arc_spans(a, b, centre, ccw, v))
                    .map(|v| centre + v);
                let mut hits: Vec<DVec2> = on_circle.collect();
                hits.extend([a, b]);
                let below = hits.into_iter().filter(|q| (q.x - x).abs() < WELD_MM);
                below.map(|q| q.y).reduce(f64::min)
            }
        }
    }
}

/// A closed plane region.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outline {
    pieces: Vec<Piece>,
}

impl Outline {
    /// A region from its boundary pieces, which must close up.
    pub fn from_pieces(pieces: Vec<Piece>) -> Outline {
        Outline { pieces: pieces.into_iter().filter(|p| p.ends().0.distance(p.ends().1) > WELD_MM).collect() }
    }

    /// A polygon; the corners may be given in either sense.
    pub fn polygon(corners: &[DVec2]) -> Outline {
        let n = corners.len();
        let twice_area: f64 = (0..n).map(|i| corners[i].perp_dot(corners[(i + 1) % n])).sum();
        let line = |i: usize| {
            let (a, b) = (corners[i], corners[(i + 1) % n]);
            if twice_area > 0.0 { Piece::Line { a, b } } else { Piece::Line { a: b, b: a } }
        };
        Self::from_pieces((0..n).map(line).collect())
    }

    /// An axis-parallel rectangle around `centre`.
    pub fn rectangle(centre: DVec2, half: DVec2) -> Outline {
        let corner = |sx: f64, sy: f64| centre + DVec2::new(sx, sy) * half;
        Self::polygon(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
    }

    /// A disc.
    pub fn disc(centre: DVec2, radius: f64) -> Outline {
        Outline { pieces: circle(centre, radius, true).to_vec() }
    }

    /// Arc from angle `from` to `to` (radians, either sense), cut into pieces of a quarter turn at most.
    pub fn arc(centre: DVec2, radius: f64, from: f64, to: f64) -> Vec<Piece> {
        let n = ((to - from).abs() / (std::f64::consts::FRAC_PI_2 * 1.000_001)).ceil().max(1.0) as usize;
        let at = |i: usize| centre + DVec2::from_angle(from + (to - from) * i as f64 / n as f64) * radius;
        (0..n).map(|i| Piece::Arc { a: at(i), b: at(i + 1), centre, radius, ccw: to > from }).collect()
    }

    /// This region without `hole`, which must lie wholly inside it.
    pub fn with_hole(mut self, hole: &Outline) -> Outline {
        self.pieces.extend(hole.pieces.iter().map(|p| match *p {
            Piece::Line { a, b } => Piece::Line { a: b, b: a },
            Piece::Arc { a, b, centre, radius, ccw } => Piece::Arc { a: b, b: a, centre, radius, ccw: !ccw },
        }));
        self
    }

    /// This region together with `other`, which must not touch it.
    pub fn beside(mut self, other: Outline) -> Outline {
        self.pieces.extend(other.pieces);
        self
    }

    /// The region moved by `by`.
    pub fn shifted(mut self, by: DVec2) -> Outline {
        for piece in &mut self.pieces {
            match piece {
                Piece::Line { a, b } => (*a, *b) = (*a + by, *b + by),
                Piece::Arc { a, b, centre, .. } => (*a, *b, *centre) = (*a + by, *b + by, *centre + by),
            }
        }
        self
    }

    /// Drops the pieces at x < 0, for a region that is symmetric about x = 0 and is only ever asked
    /// about points at x >= 0.
    pub fn right_half(mut self) -> Outline {
        self.pieces.retain(|p| [p.ends().0, p.ends().1, p.middle()].iter().any(|q| q.x > WELD_MM));
        self
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Area, mm^2.
    pub fn area(&self) -> f64 {
        let piece_area = |p: &Piece| {
            let (a, b) = p.ends();
            let bulge = match *p {
                Piece::Line { .. } => 0.0,
                Piece::Arc { centre, radius, .. } => {
                    let sweep = (a - centre).angle_to(b - centre);
                    radius * radius * (sweep - sweep.sin())
                }
            };
            (a.perp_dot(b) + bulge) / 2.0
        };
        self.pieces.iter().map(piece_area).sum()
    }

    /// Smallest and largest coordinates.
    pub fn bounds(&self) -> (DVec2, DVec2) {
        let mut low = DVec2::splat(f64::INFINITY);
        let mut high = DVec2::splat(f64::NEG_INFINITY);
        let mut take = |p: DVec2| (low, high) = (low.min(p), high.max(p));
        for piece in &self.pieces {
            take(piece.ends().0);
            take(piece.ends().1);
            if let Piece::Arc { a, b, centre, radius, ccw } = *piece {
                for v in [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y] {
                    if Piece::arc_spans(a, b, centre, ccw, v) {
                        take(centre + v * radius);
                    }
                }
            }
        }
        (low, high)
    }

    /// Whether `p` is inside.
    pub fn contains(&self, p: DVec2) -> bool {
        // Parity of the polygon of chords, corrected by the bulge between each chord and its arc.
        // Both use the same predicate `left`, so that points exactly on a chord are consistent.
        let mut inside = false;
        for piece in &self.pieces {
            let (a, b) = piece.ends();
            let left = (b - a).perp_dot(p - a) > 0.0;
            if (a.y > p.y) != (b.y > p.y) && left == (b.y > a.y) {
                inside = !inside;
            }
            if let Piece::Arc { centre, radius, ccw, .. } = *piece
                && left != ccw
                && p.distance_squared(centre) < radius * radius
            {
                inside = !inside;
            }
        }
        inside
    }

    /// Signed distance from `p` to the boundary (negative inside) and its gradient.
    pub fn distance(&self, p: DVec2) -> (f64, DVec2) {
        let mut best = (f64::INFINITY, DVec2::ZERO, 0);
        for (i, piece) in self.pieces.iter().enumerate() {
            let q = piece.nearest(p);
            let d2 = p.distance_squared(q);
            if d2 < best.0 {
                best = (d2, q, i);
            }
        }
        let (d2, q, i) = best;
        let d = d2.sqrt();
        if d < WELD_MM {
            return (self.sign(p) * d, self.pieces[i].normal(q));
        }
        let sign = self.sign(p);
        (sign * d, (p - q) * (sign / d))
    }

    fn sign(&self, p: DVec2) -> f64 {
        if self.contains(p) { -1.0 } else { 1.0 }
    }

    /// Lowest y at abscissa `x` of the region grown by a disc of radius `by`.
    pub fn lowest_at(&self, x: f64, by: f64) -> Option<f64> {
        // The boundary of the grown region is part of the moved pieces and the circles about the
        // ends, and all of those lie within it: their lowest point is the region's.
        let mut lowest: Option<f64> = None;
        let mut take = |y: Option<f64>| {
            if let Some(y) = y {
                lowest = Some(lowest.map_or(y, |l| l.min(y)));
            }
        };
        for piece in &self.pieces {
            take(piece.moved(by).and_then(|m| m.lowest_at(x)));
            for end in [piece.ends().0, piece.ends().1] {
                let rest = by * by - (x - end.x).powi(2);
                take((rest >= 0.0).then(|| end.y - rest.sqrt()));
            }
        }
        lowest
    }

    /// The points at least `by` inside the region; empty when there are none.
    pub fn eroded(&self, by: f64) -> Outline {
        if by == 0.0 {
            return self.clone();
        }
        // 1. Every candidate: moved pieces, and a circle around each vertex.
        let mut raw: Vec<Piece> = self.pieces.iter().filter_map(|p| p.moved(-by)).collect();
        let mut vertices: Vec<DVec2> = Vec::new();
        for v in self.pieces.iter().flat_map(|p| [p.ends().0, p.ends().1]) {
            if vertices.iter().all(|w| w.distance(v) > WELD_MM) {
                vertices.push(v);
            }
        }
        raw.extend(vertices.iter().flat_map(|&v| circle(v, by, false)));

        // 2. Cut each candidate where it meets the others, 3. keep what is exactly `by` inside.
        let mut kept: Vec<Piece> = Vec::new();
        for (i, piece) in raw.iter().enumerate() {
            for part in cut(piece, i, &raw) {
                let (d, _) = self.distance(part.middle());
                let twin = |k: &Piece| k.middle().distance(part.middle()) < OFFSET_TOLERANCE_MM;
                if (d + by).abs() < OFFSET_TOLERANCE_MM && !kept.iter().any(twin) {
                    kept.push(part);
                }
            }
        }

        // 4. Make touching ends equal, so that parity sees closed loops.
        let mut corners: Vec<DVec2> = Vec::new();
        let mut weld = |p: &mut DVec2| match corners.iter().find(|c| c.distance(*p) < SAME_STOP_MM) {
            Some(c) => *p = *c,
            None => corners.push(*p),
        };
        for piece in &mut kept {
            match piece {
                Piece::Line { a, b } | Piece::Arc { a, b, .. } => {
                    weld(a);
                    weld(b);
                }
            }
        }
        Self::from_pieces(kept)
    }

    /// The largest erosion that leaves anything, mm (by bisection, to 1 um).
    pub fn inradius(&self) -> f64 {
        let (low, high) = self.bounds();
        let (mut fits, mut fails) = (0.0, (high - low).min_element());
        while fails - fits > 1e-3 {
            let half = (fits + fails) / 2.0;
            if self.eroded(half).is_empty() { fails = half } else { fits = half }
        }
        fits
    }
}

/// A full circle as four quarters.
fn circle(centre: DVec2, radius: f64, ccw: bool) -> [Piece; 4] {
    let at = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y].map(|v| centre + v * radius);
    std::array::from_fn(|i| {
        let (a, b) = (at[i], at[(i + 1) % 4]);
        if ccw {
            Piece::Arc { a, b, centre, radius, ccw }
        } else {
            Piece::Arc { a: b, b: a, centre, radius, ccw }
        }
    })
}

/// The parts of `raw[i]` between its meetings with all other pieces.
fn cut(piece: &Piece, i: usize, raw: &[Piece]) -> Vec<Piece> {
    let on = |p: &Piece, q: DVec2| p.nearest(q).distance(q) < WELD_MM * 10.0;
    // Ends are exact, crossings of nearly tangent circles are not: ends come first and win.
    let others = || raw.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, other)| other);
    let ends = others().flat_map(|o| [o.ends().0, o.ends().1]);
    let crossings = others().flat_map(|o| piece.crossings(o).into_iter().filter(move |&q| on(o, q)));
    let mut stops = vec![piece.ends().0, piece.ends().1];
    for q in ends.chain(crossings) {
        if on(piece, q) && stops.iter().all(|s| s.distance(q) > SAME_STOP_MM) {
            stops.push(q);
        }
    }
    stops.sort_by(|p, q| piece.along(*p).total_cmp(&piece.along(*q)));
    stops.windows(2).map(|w| piece.between(w[0], w[1])).collect()
}
