//! Quadratic B-splines on a stencil of three nodes, centred on the middle one.
//!
//! With g the offset from the middle node (-0.5 to 0.5), the weights are (0.5 - g)^2 / 2, 3/4 - g^2 and
//! (0.5 + g)^2 / 2. Written as squares none is ever negative. Distances are taken from the middle node, so
//! they are -1, 0 and 1 for every particle; the particle's own offset is put in afterwards, once.

use super::lanes::{Lanes, Row, WIDTH};

/// Repeats one value per node over its four components.
const fn per_node(v: [f32; 4]) -> Row {
    let mut row = [0.0; WIDTH];
    let mut i = 0;
    while i < WIDTH {
        row[i] = v[i / 4];
        i += 1;
    }
    Row(row)
}

// Node i = lane / 4 has the weight c (f - r)^2 + a; the fourth has none.
const C: Row = per_node([0.5, -1.0, 0.5, 0.0]);
const R: Row = per_node([1.5, 1.0, 0.5, 0.0]);
const A: Row = per_node([0.0, 0.75, 0.0, 0.0]);
const STEP: Row = per_node([-1.0, 0.0, 1.0, 0.0]);

/// The four nodes along x in the lanes of one register.
pub struct AlongX<L> {
    c: L,
    r: L,
    a: L,
    /// Distance of each node from the middle one.
    pub step: L,
}

impl<L: Lanes> AlongX<L> {
    /// The constants in registers.
    #[inline(always)]
    pub fn in_registers() -> Self {
        Self { c: L::load(&C), r: L::load(&R), a: L::load(&A), step: L::load(&STEP) }
    }

    /// Weights for an offset of 0.5 to 1.5 cells from the first node.
    #[inline(always)]
    pub fn weights(&self, offset: f32) -> L {
        let t = L::fill(offset) - self.r;
        (self.c * t).mul_add(t, self.a)
    }
}

/// Weights along one axis for sixteen particles side by side.
// A function, not a closure: closures are not inlined into kernels and then lose the instruction set.
#[inline(always)]
pub fn weights<L: Lanes>(offset: L) -> [L; 3] {
    let (lo, mid, hi) = (L::fill(1.5) - offset, offset - L::fill(1.0), offset - L::fill(0.5));
    let half = L::fill(0.5);
    [half * lo * lo, L::fill(0.75) - mid * mid, half * hi * hi]
}

/// Weights of the three nodes for one offset.
#[inline(always)]
pub fn weights_of(offset: f32) -> [f32; 3] {
    let (lo, mid, hi) = (1.5 - offset, offset - 1.0, offset - 0.5);
    [0.5 * lo * lo, 0.75 - mid * mid, 0.5 * hi * hi]
}
