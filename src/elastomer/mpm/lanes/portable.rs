//! The lanes as a plain array: correct everywhere, fast where the compiler vectorises it.

use super::{Lanes, Number, Row, WIDTH};
use std::ops::{Add, Mul, Neg, Sub};

/// Sixteen floats in an array.
#[derive(Clone, Copy)]
pub struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn zip(self, b: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], b.0[i])))
    }
}

impl Add for Portable {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, |x, y| x + y)
    }
}

impl Sub for Portable {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, |x, y| x - y)
    }
}

impl Mul for Portable {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.zip(b, |x, y| x * y)
    }
}

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Number for Portable {
    const SQUARED_STEP: f64 = 1e-7;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x as f32; WIDTH])
    }
    // Separate rounding: without a fused instruction, f32::mul_add is a slow library call.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self * b - c
    }
    #[inline(always)]
    fn over(self, b: Self) -> Self {
        self.zip(b, |x, y| x / y)
    }
    #[inline(always)]
    fn root(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn larger(self, b: Self) -> Self {
        self.zip(b, f32::max)
    }
    #[inline(always)]
    fn smaller(self, b: Self) -> Self {
        self.zip(b, f32::min)
    }
    #[inline(always)]
    fn all_below(self, b: Self) -> bool {
        self.less(b) == u16::MAX
    }
}

impl Lanes for Portable {
    const STENCIL_FITS: bool = false;
    #[inline(always)]
    fn fill(x: f32) -> Self {
        Self([x; WIDTH])
    }
    #[inline(always)]
    fn load(row: &Row) -> Self {
        Self(row.0)
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        row.0 = self.0;
    }
    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        // SAFETY: the caller vouches for sixteen readable floats.
        Self(unsafe { from.cast::<[f32; WIDTH]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        // SAFETY: the caller vouches for sixteen writable floats.
        unsafe { to.cast::<[f32; WIDTH]>().write_unaligned(self.0) }
    }
    #[inline(always)]
    fn repeat_group<const G: usize>(row: &Row) -> Self {
        Self(std::array::from_fn(|i| row.0[G * 4 + i % 4]))
    }
    #[inline(always)]
    fn moments(a: Self, b: Self, c: Self) -> Self {
        Self(std::array::from_fn(|i| {
            let sum = |x: &Self| (x.0[i % 4] + x.0[8 + i % 4]) + x.0[4 + i % 4];
            match i / 4 {
                0 => sum(&a),
                1 => a.0[8 + i % 4] - a.0[i % 4],
                2 => sum(&b),
                _ => sum(&c),
            }
        }))
    }
    #[inline(always)]
    fn fourth_of_group(self) -> Self {
        Self(std::array::from_fn(|i| self.0[i / 4 * 4 + 3]))
    }
    #[inline(always)]
    fn transpose(rows: &mut [Self; WIDTH]) {
        for i in 0..WIDTH {
            for k in 0..i {
                let t = rows[i].0[k];
                rows[i].0[k] = rows[k].0[i];
                rows[k].0[i] = t;
            }
        }
    }
    #[inline(always)]
    fn less(self, b: Self) -> u16 {
        (0..WIDTH).fold(0, |m, i| m | (u16::from(self.0[i] < b.0[i]) << i))
    }
    #[inline(always)]
    fn keep(self, keep: u16) -> Self {
        Self(std::array::from_fn(|i| if keep >> i & 1 == 1 { self.0[i] } else { 0.0 }))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.map(f32::floor))
    }
}
