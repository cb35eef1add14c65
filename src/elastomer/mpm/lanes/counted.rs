//! The portable lanes with a count of their flops: how the figure that the benchmark states is proved.
//!
//! Every lane counts, also those that a stencil leaves unused; a fused multiply-add is two, everything else that an
//! arithmetic unit does (sums, products, quotients, roots, larger and smaller) one. Moving, comparing and masking are none.

use super::portable::Portable;
use super::{Lanes, Number, Row, WIDTH};
use std::ops::{Add, Mul, Neg, Sub};
use std::sync::atomic::{AtomicU64, Ordering};

static FLOPS: AtomicU64 = AtomicU64::new(0);

/// Flops since the last call. Only one test may count at a time.
pub fn take() -> u64 {
    FLOPS.swap(0, Ordering::Relaxed)
}

/// Sixteen floats that count.
#[derive(Clone, Copy)]
pub struct Counted(Portable);

fn counted(each: usize, lanes: Portable) -> Counted {
    FLOPS.fetch_add((each * WIDTH) as u64, Ordering::Relaxed);
    Counted(lanes)
}

impl Add for Counted {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        counted(1, self.0 + b.0)
    }
}

impl Sub for Counted {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        counted(1, self.0 - b.0)
    }
}

impl Mul for Counted {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        counted(1, self.0 * b.0)
    }
}

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        counted(1, -self.0)
    }
}

impl Number for Counted {
    const SQUARED_STEP: f64 = Portable::SQUARED_STEP;
    fn splat(x: f64) -> Self {
        Self(Portable::splat(x))
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        counted(2, self.0.mul_add(b.0, c.0))
    }
    fn mul_sub(self, b: Self, c: Self) -> Self {
        counted(2, self.0.mul_sub(b.0, c.0))
    }
    fn over(self, b: Self) -> Self {
        counted(1, self.0.over(b.0))
    }
    fn root(self) -> Self {
        counted(1, self.0.root())
    }
    fn larger(self, b: Self) -> Self {
        counted(1, self.0.larger(b.0))
    }
    fn smaller(self, b: Self) -> Self {
        counted(1, self.0.smaller(b.0))
    }
    fn all_below(self, b: Self) -> bool {
        self.0.all_below(b.0)
    }
}

impl Lanes for Counted {
    const STENCIL_FITS: bool = false;
    fn fill(x: f32) -> Self {
        Self(Portable::fill(x))
    }
    fn load(row: &Row) -> Self {
        Self(Portable::load(row))
    }
    fn store(self, row: &mut Row) {
        self.0.store(row);
    }
    unsafe fn read(from: *const f32) -> Self {
        // SAFETY: the caller vouches for the memory.
        Self(unsafe { Portable::read(from) })
    }
    unsafe fn write(self, to: *mut f32) {
        // SAFETY: the caller vouches for the memory.
        unsafe { self.0.write(to) }
    }
    fn repeat_group<const G: usize>(row: &Row) -> Self {
        Self(Portable::repeat_group::<G>(row))
    }
    fn moments(a: Self, b: Self, c: Self) -> Self {
        counted(2, Portable::moments(a.0, b.0, c.0))
    }
    fn fourth_of_group(self) -> Self {
        Self(self.0.fourth_of_group())
    }
    fn transpose(rows: &mut [Self; WIDTH]) {
        let mut plain = rows.map(|r| r.0);
        Portable::transpose(&mut plain);
        *rows = plain.map(Self);
    }
    fn less(self, b: Self) -> u16 {
        self.0.less(b.0)
    }
    fn keep(self, keep: u16) -> Self {
        Self(self.0.keep(keep))
    }
    fn floor(self) -> Self {
        Self(self.0.floor())
    }
}
