//! The lanes as four NEON registers, which every 64-bit ARM has.

use super::{Lanes, Number, Row, WIDTH};
use std::arch::aarch64::*;
use std::ops::{Add, Mul, Neg, Sub};

/// Sixteen floats in four registers.
#[derive(Clone, Copy)]
pub struct Neon([float32x4_t; 4]);

/// Applies an intrinsic to the four quarters.
macro_rules! each {
    (|$($x:ident),+| $e:expr) => {
        // SAFETY: NEON belongs to the baseline of aarch64.
        Self(std::array::from_fn(|q| { $(let $x = $x.0[q];)+ unsafe { $e } }))
    };
}

impl Add for Neon {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        let a = self;
        each!(|a, b| vaddq_f32(a, b))
    }
}

impl Sub for Neon {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        let a = self;
        each!(|a, b| vsubq_f32(a, b))
    }
}

impl Mul for Neon {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let a = self;
        each!(|a, b| vmulq_f32(a, b))
    }
}

impl Neg for Neon {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let a = self;
        each!(|a| vnegq_f32(a))
    }
}

impl Number for Neon {
    const SQUARED_STEP: f64 = 1e-7;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self::fill(x as f32)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        let a = self;
        each!(|a, b, c| vfmaq_f32(c, a, b))
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        let a = self;
        each!(|a, b, c| vfmaq_f32(vnegq_f32(c), a, b))
    }
    #[inline(always)]
    fn over(self, b: Self) -> Self {
        let a = self;
        each!(|a, b| vdivq_f32(a, b))
    }
    #[inline(always)]
    fn root(self) -> Self {
        let a = self;
        each!(|a| vsqrtq_f32(a))
    }
    #[inline(always)]
    fn larger(self, b: Self) -> Self {
        let a = self;
        each!(|a, b| vmaxq_f32(a, b))
    }
    #[inline(always)]
    fn smaller(self, b: Self) -> Self {
        let a = self;
        each!(|a, b| vminq_f32(a, b))
    }
    #[inline(always)]
    fn all_below(self, b: Self) -> bool {
        self.less(b) == u16::MAX
    }
}

impl Lanes for Neon {
    const STENCIL_FITS: bool = false;
    #[inline(always)]
    fn fill(x: f32) -> Self {
        // SAFETY: NEON belongs to the baseline of aarch64.
        Self([unsafe { vdupq_n_f32(x) }; 4])
    }
    #[inline(always)]
    fn load(row: &Row) -> Self {
        // SAFETY: the row holds sixteen floats.
        unsafe { Self::read(row.0.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        // SAFETY: the row holds sixteen floats.
        unsafe { self.write(row.0.as_mut_ptr()) }
    }
    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        // SAFETY: the caller vouches for the memory.
        Self(std::array::from_fn(|q| unsafe { vld1q_f32(from.add(4 * q)) }))
    }
    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        for q in 0..4 {
            // SAFETY: the caller vouches for the memory.
            unsafe { vst1q_f32(to.add(4 * q), self.0[q]) }
        }
    }
    #[inline(always)]
    fn repeat_group<const G: usize>(row: &Row) -> Self {
        // SAFETY: four groups of four floats make the row.
        Self([unsafe { vld1q_f32(row.0.as_ptr().add(G * 4)) }; 4])
    }
    #[inline(always)]
    fn moments(a: Self, b: Self, c: Self) -> Self {
        // SAFETY: NEON belongs to the baseline of aarch64.
        let sum = |x: Self| unsafe { vaddq_f32(vaddq_f32(x.0[0], x.0[2]), x.0[1]) };
        // SAFETY: as above.
        Self([sum(a), unsafe { vsubq_f32(a.0[2], a.0[0]) }, sum(b), sum(c)])
    }
    #[inline(always)]
    fn fourth_of_group(self) -> Self {
        let a = self;
        each!(|a| vdupq_laneq_f32::<3>(a))
    }
    #[inline(always)]
    fn transpose(rows: &mut [Self; WIDTH]) {
        // Sixteen 4x4 transposes: tile (r, q) becomes tile (q, r).
        let from = *rows;
        for r in 0..4 {
            for q in 0..4 {
                let t: [float32x4_t; 4] = std::array::from_fn(|i| from[4 * r + i].0[q]);
                // SAFETY: NEON belongs to the baseline of aarch64.
                let columns = unsafe {
                    let (lo0, hi0) = (vzip1q_f32(t[0], t[2]), vzip2q_f32(t[0], t[2]));
                    let (lo1, hi1) = (vzip1q_f32(t[1], t[3]), vzip2q_f32(t[1], t[3]));
                    [vzip1q_f32(lo0, lo1), vzip2q_f32(lo0, lo1), vzip1q_f32(hi0, hi1), vzip2q_f32(hi0, hi1)]
                };
                for i in 0..4 {
                    rows[4 * q + i].0[r] = columns[i];
                }
            }
        }
    }
    #[inline(always)]
    fn less(self, b: Self) -> u16 {
        (0..4).fold(0, |m, q| {
            // SAFETY: NEON belongs to the baseline of aarch64; the constant has four elements.
            let bits = unsafe {
                let bit = vld1q_u32([1u32, 2, 4, 8].as_ptr());
                vaddvq_u32(vandq_u32(vcltq_f32(self.0[q], b.0[q]), bit))
            };
            m | (bits as u16) << (4 * q)
        })
    }
    #[inline(always)]
    fn keep(self, keep: u16) -> Self {
        Self(std::array::from_fn(|q| {
            // SAFETY: NEON belongs to the baseline of aarch64; the constant has four elements.
            unsafe {
                let bit = vld1q_u32([1u32, 2, 4, 8].as_ptr());
                let set = vtstq_u32(vdupq_n_u32(u32::from(keep >> (4 * q))), bit);
                vreinterpretq_f32_u32(vandq_u32(vreinterpretq_u32_f32(self.0[q]), set))
            }
        }))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        let a = self;
        each!(|a| vrndmq_f32(a))
    }
}
