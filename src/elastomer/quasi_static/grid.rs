//! The pad's grid: a box of cells that fits the pad exactly, with quadratic B-splines over it.
//!
//! In the plane the splines are uniform (n cells, n + 2 control points, the outer ones beside the pad);
//! through the depth the knots are open and the cells grow away from the contact face, so the top
//! control layer alone is the face's trace and the bottom layer alone is the bonded base. Every cell has
//! 2 x 2 x 2 Gauss points (Cottrell, Hughes and Bazilevs, *Isogeometric Analysis*, 2009, chapter 2).

/// Gauss points on [0, 1].
pub const GAUSS: [f64; 2] = [0.211_324_865_405_187_13, 0.788_675_134_594_812_9];

/// Values and slopes of the three splines that meet a cell, at its two Gauss points.
#[derive(Debug, Clone, Copy, Default)]
pub struct CellBasis {
    /// `value[g][a]`.
    pub value: [[f64; 3]; 2],
    /// `slope[g][a]`, per mm.
    pub slope: [[f64; 3]; 2],
}

/// Cells and splines of a box.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Cells along x, a multiple of [`WIDTH`](super::lanes::WIDTH).
    pub nx: usize,
    /// Cells along y.
    pub ny: usize,
    /// Cell size in x, mm.
    pub hx: f64,
    /// Cell size in y, mm.
    pub hy: f64,
    /// Cell heights from the base up, mm; one is zero where a coating begins.
    pub hz: Vec<f64>,
    /// Extent, mm.
    pub size: [f64; 3],
    /// Splines along x in every cell.
    pub x: CellBasis,
    /// Splines along y in every cell.
    pub y: CellBasis,
    /// Splines along z, cell by cell from the base up.
    pub z: Vec<CellBasis>,
}

impl Grid {
    /// A grid over a pad of `size` mm with cells of at most `h` mm in the plane. Cell heights
    /// begin at `first` h at the face and grow by `growth` from cell to cell.
    pub fn new(size: [f64; 3], h: f64, first: f64, growth: f64) -> Self {
        Self::below_coating(size, h, first, growth, 0.0)
    }

    /// As [`Self::new`], with cells that end `coating` mm below the face.
    pub fn below_coating(size: [f64; 3], h: f64, first: f64, growth: f64, coating: f64) -> Self {
        let nx = 16 * Self::blocks(size[0], h);
        let hx = size[0] / nx as f64;
        let ny = ((size[1] / hx).round() as usize).max(8);
        let hy = size[1] / ny as f64;
        let coats = (coating / (first * hx)).ceil() as usize;
        let coat = coating / coats.max(1) as f64;
        let bulk = size[2] - coating;
        let mut heights = Vec::new();
        // Below a thin coating cells double until they are as high as they would be without it.
        let mut next = if coats == 0 { first * hx } else { (2.0 * coat).min(first * hx) };
        let mut sum = 0.0;
        while sum < bulk - 1e-9 {
            heights.push(next);
            sum += next;
            next = if next < first * hx { (2.0 * next).min(first * hx) } else { next * growth };
        }
        while heights.len() < 4 {
            let last = heights.len() as f64;
            heights.push(heights[0].max(1e-6) * growth.powf(last));
        }
        let total: f64 = heights.iter().sum();
        let mut hz: Vec<f64> = heights.iter().rev().map(|t| t * bulk / total).collect();
        if coats > 0 {
            // A cell without height doubles the knot: strain may jump where the material does.
            hz.push(0.0);
            hz.extend(std::iter::repeat_n(coat, coats));
        }
        let z = open_basis(&hz);
        Self { nx, ny, hx, hy, hz, size, x: uniform_basis(hx), y: uniform_basis(hy), z }
    }

    /// Blocks of sixteen cells of at most `h` mm along a side of `size` mm.
    pub fn blocks(size: f64, h: f64) -> usize {
        ((size / h / 16.0 - 1e-6).ceil() as usize).max(1)
    }

    /// Control points along x.
    pub fn cx(&self) -> usize {
        self.nx + 2
    }

    /// Control points along y.
    pub fn cy(&self) -> usize {
        self.ny + 2
    }

    /// Control layers, the bonded one included.
    pub fn layers(&self) -> usize {
        self.hz.len() + 2
    }

    /// Control points of one layer.
    pub fn plane(&self) -> usize {
        self.cx() * self.cy()
    }

    /// Length of a field of three components. Component outermost, then layer, y, x.
    pub fn field_len(&self) -> usize {
        3 * self.layers() * self.plane()
    }

    /// Where component `c` of layer `k` begins.
    pub fn at(&self, c: usize, k: usize) -> usize {
        (c * self.layers() + k) * self.plane()
    }

    /// Quadrature points.
    pub fn points(&self) -> usize {
        8 * self.nx * self.ny * self.hz.len()
    }

    /// Open knots through the depth, from the base up.
    pub fn knots_z(&self) -> Vec<f64> {
        open_knots(&self.hz)
    }

    /// The first control layer and the three weights of a height above the base.
    pub fn values_z(&self, z: f64) -> (usize, [f64; 3]) {
        let knots = self.knots_z();
        let cell = (0..self.hz.len()).rfind(|c| knots[c + 2] <= z).unwrap_or(0);
        (cell, open_values(&knots, cell, z).0)
    }

    /// As [`Self::trace`] for a coordinate counted from the pad's side, the outer cells continued beyond it.
    pub fn extended_trace(x: f64, size: f64, n: usize) -> (usize, [f64; 3]) {
        let s = x / size * n as f64;
        let cell = (s.max(0.0) as usize).min(n - 1);
        (cell, uniform_values(s - cell as f64))
    }

    /// The first control index and the three weights of the face's trace along one axis at coordinate
    /// `x` of a pad of extent `size` and `n` cells.
    pub fn trace(x: f64, size: f64, n: usize) -> (usize, [f64; 3]) {
        let s = ((x / size + 0.5) * n as f64).clamp(0.0, n as f64);
        let cell = (s.floor() as usize).min(n - 1);
        (cell, uniform_values(s - cell as f64))
    }

    /// Where a point of the face at rest is with the displacement `u` of the control points, mm; the [traces](Self::trace) are those of
    /// its place along x and y.
    #[inline(always)]
    pub fn moved(&self, u: &[f32], rest: [f64; 3], [(i, wx), (j, wy)]: [(usize, [f64; 3]); 2]) -> [f64; 3] {
        let (cx, top) = (self.cx(), self.layers() - 1);
        let mut p = rest;
        for (c, p) in p.iter_mut().enumerate() {
            let plane = &u[self.at(c, top)..][..self.plane()];
            for (b, wy) in wy.iter().enumerate() {
                for (a, wx) in wx.iter().enumerate() {
                    *p += wy * wx * f64::from(plane[(j + b) * cx + i + a]);
                }
            }
        }
        p
    }
}

/// The three uniform quadratic splines at `t` in a cell.
pub fn uniform_values(t: f64) -> [f64; 3] {
    [0.5 * (1.0 - t) * (1.0 - t), 0.5 + t * (1.0 - t), 0.5 * t * t]
}

fn uniform_basis(h: f64) -> CellBasis {
    let mut basis = CellBasis::default();
    for (g, &t) in GAUSS.iter().enumerate() {
        basis.value[g] = uniform_values(t);
        basis.slope[g] = [(t - 1.0) / h, (1.0 - 2.0 * t) / h, t / h];
    }
    basis
}

/// Open knots with the given spans.
fn open_knots(spans: &[f64]) -> Vec<f64> {
    let mut knots = vec![0.0; 3];
    for s in spans {
        knots.push(knots[knots.len() - 1] + s);
    }
    let end = knots[knots.len() - 1];
    knots.extend([end, end]);
    knots
}

/// Values and slopes at `x` of the three quadratic splines of a cell.
fn open_values(knots: &[f64], cell: usize, x: f64) -> ([f64; 3], [f64; 3]) {
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    let i = cell + 2;
    // Cox-de Boor: linear splines of this span, then quadratic ones.
    let span = knots[i + 1] - knots[i];
    let n1 = [ratio(knots[i + 1] - x, span), ratio(x - knots[i], span)];
    let (w0, w1) = (knots[i + 1] - knots[i - 1], knots[i + 2] - knots[i]);
    let value = [
        ratio(knots[i + 1] - x, w0) * n1[0],
        ratio(x - knots[i - 1], w0) * n1[0] + ratio(knots[i + 2] - x, w1) * n1[1],
        ratio(x - knots[i], w1) * n1[1],
    ];
    let slope =
        [-2.0 * ratio(n1[0], w0), 2.0 * ratio(n1[0], w0) - 2.0 * ratio(n1[1], w1), 2.0 * ratio(n1[1], w1)];
    (value, slope)
}

/// Quadratic splines on open knots whose spans are `spans`, at the Gauss points of every cell.
fn open_basis(spans: &[f64]) -> Vec<CellBasis> {
    let knots = open_knots(spans);
    (0..spans.len())
        .map(|cell| {
            let mut basis = CellBasis::default();
            for (g, &t) in GAUSS.iter().enumerate() {
                (basis.value[g], basis.slope[g]) =
                    open_values(&knots, cell, knots[cell + 2] + t * spans[cell]);
            }
            basis
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splines_sum_to_one_and_reproduce_linear_fields() {
        let grid = Grid::new([20.0, 16.0, 4.0], 0.42, 0.8, 1.25);
        assert_eq!(grid.nx % 16, 0);
        assert!((grid.hz.iter().sum::<f64>() - 4.0).abs() < 1e-12);
        for basis in grid.z.iter().chain([&grid.x, &grid.y]) {
            for g in 0..2 {
                assert!((basis.value[g].iter().sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(basis.slope[g].iter().sum::<f64>().abs() < 1e-12);
            }
        }
        // Control points at the Greville abscissae give z itself, whose slope is one.
        let mut knots = vec![0.0; 3];
        for h in &grid.hz {
            knots.push(knots[knots.len() - 1] + h);
        }
        let end = knots[knots.len() - 1];
        knots.extend([end, end]);
        for (k, basis) in grid.z.iter().enumerate() {
            for g in 0..2 {
                let slope: f64 =
                    (0..3).map(|a| basis.slope[g][a] * 0.5 * (knots[k + a + 1] + knots[k + a + 2])).sum();
                assert!((slope - 1.0).abs() < 1e-12, "cell {k}: {slope}");
            }
        }
    }
}
