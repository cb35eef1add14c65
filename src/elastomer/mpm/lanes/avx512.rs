//! The lanes as one AVX-512 register.

use super::{Lanes, Number, Row, WIDTH};
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Neg, Sub};

/// Sixteen floats in one register. Only [`super::Isa::run`] instantiates kernels with it, after detection;
/// that is what makes every intrinsic below safe to execute.
#[derive(Clone, Copy)]
pub struct Avx512(__m512);

/// -1 in the second group, 1 elsewhere.
const MINUS_SECOND: Row = Row([1., 1., 1., 1., -1., -1., -1., -1., 1., 1., 1., 1., 1., 1., 1., 1.]);

/// Wraps an intrinsic of AVX-512F.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: see [`Avx512`]: its kernels run only where AVX-512F was detected.
        Self(unsafe { $e })
    };
}

impl Add for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        op!(_mm512_add_ps(self.0, b.0))
    }
}

impl Sub for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        op!(_mm512_sub_ps(self.0, b.0))
    }
}

impl Mul for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        op!(_mm512_mul_ps(self.0, b.0))
    }
}

impl Neg for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        op!(_mm512_sub_ps(_mm512_setzero_ps(), self.0))
    }
}

impl Number for Avx512 {
    const SQUARED_STEP: f64 = 1e-7;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        op!(_mm512_set1_ps(x as f32))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        op!(_mm512_fmadd_ps(self.0, b.0, c.0))
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        op!(_mm512_fmsub_ps(self.0, b.0, c.0))
    }
    #[inline(always)]
    fn over(self, b: Self) -> Self {
        op!(_mm512_div_ps(self.0, b.0))
    }
    #[inline(always)]
    fn root(self) -> Self {
        op!(_mm512_sqrt_ps(self.0))
    }
    #[inline(always)]
    fn larger(self, b: Self) -> Self {
        op!(_mm512_max_ps(self.0, b.0))
    }
    #[inline(always)]
    fn smaller(self, b: Self) -> Self {
        op!(_mm512_min_ps(self.0, b.0))
    }
    #[inline(always)]
    fn all_below(self, b: Self) -> bool {
        self.less(b) == u16::MAX
    }
}

impl Lanes for Avx512 {
    const STENCIL_FITS: bool = true;
    #[inline(always)]
    fn fill(x: f32) -> Self {
        op!(_mm512_set1_ps(x))
    }
    #[inline(always)]
    fn load(row: &Row) -> Self {
        op!(_mm512_load_ps(row.0.as_ptr()))
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        // SAFETY: see [`Avx512`]; the row is aligned to 64 bytes.
        unsafe { _mm512_store_ps(row.0.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        op!(_mm512_loadu_ps(from))
    }
    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        // SAFETY: see [`Avx512`]; the caller vouches for the memory.
        unsafe { _mm512_storeu_ps(to, self.0) }
    }
    #[inline(always)]
    fn repeat_group<const G: usize>(row: &Row) -> Self {
        op!(_mm512_broadcast_f32x4(_mm_load_ps(row.0.as_ptr().add(G * 4))))
    }
    #[inline(always)]
    fn moments(a: Self, b: Self, c: Self) -> Self {
        op!({
            let b0c0 = _mm512_shuffle_f32x4::<0b01_00_01_00>(b.0, c.0);
            let b2c2 = _mm512_shuffle_f32x4::<0b10_10_10_10>(b.0, c.0);
            let first = _mm512_shuffle_f32x4::<0b10_00_10_00>(a.0, b0c0);
            let second = _mm512_shuffle_f32x4::<0b11_01_00_01>(a.0, b0c0);
            let third = _mm512_shuffle_f32x4::<0b10_00_11_10>(a.0, b2c2);
            // first + third = [a0 + a2 | a2 | b0 + b2 | c0 + c2], second = [a1 | a0 | b1 | c1].
            let sign = _mm512_load_ps(MINUS_SECOND.0.as_ptr());
            _mm512_fmadd_ps(second, sign, _mm512_add_ps(first, third))
        })
    }
    #[inline(always)]
    fn fourth_of_group(self) -> Self {
        op!(_mm512_permute_ps::<0b11_11_11_11>(self.0))
    }
    #[inline(always)]
    fn transpose(rows: &mut [Self; WIDTH]) {
        // 4x4 tiles inside each group of four rows, then a 4x4 transpose of the tiles themselves.
        // SAFETY: see [`Avx512`].
        unsafe {
            let mut t = [_mm512_setzero_ps(); WIDTH];
            for g in 0..4 {
                let [a, b, c, d] = [rows[4 * g].0, rows[4 * g + 1].0, rows[4 * g + 2].0, rows[4 * g + 3].0];
                let (ab0, ab1) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
                let (cd0, cd1) = (_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
                t[4 * g] = _mm512_shuffle_ps::<0b01_00_01_00>(ab0, cd0);
                t[4 * g + 1] = _mm512_shuffle_ps::<0b11_10_11_10>(ab0, cd0);
                t[4 * g + 2] = _mm512_shuffle_ps::<0b01_00_01_00>(ab1, cd1);
                t[4 * g + 3] = _mm512_shuffle_ps::<0b11_10_11_10>(ab1, cd1);
            }
            for k in 0..4 {
                // t[4 g + k] holds, in its group q, column 4 q + k of rows 4 g .. 4 g + 3.
                let [a, b, c, d] = [t[k], t[4 + k], t[8 + k], t[12 + k]];
                let ab0 = _mm512_shuffle_f32x4::<0b01_00_01_00>(a, b);
                let ab1 = _mm512_shuffle_f32x4::<0b11_10_11_10>(a, b);
                let cd0 = _mm512_shuffle_f32x4::<0b01_00_01_00>(c, d);
                let cd1 = _mm512_shuffle_f32x4::<0b11_10_11_10>(c, d);
                rows[k].0 = _mm512_shuffle_f32x4::<0b10_00_10_00>(ab0, cd0);
                rows[4 + k].0 = _mm512_shuffle_f32x4::<0b11_01_11_01>(ab0, cd0);
                rows[8 + k].0 = _mm512_shuffle_f32x4::<0b10_00_10_00>(ab1, cd1);
                rows[12 + k].0 = _mm512_shuffle_f32x4::<0b11_01_11_01>(ab1, cd1);
            }
        }
    }
    #[inline(always)]
    fn less(self, b: Self) -> u16 {
        // SAFETY: see [`Avx512`].
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, b.0) }
    }
    #[inline(always)]
    fn keep(self, keep: u16) -> Self {
        op!(_mm512_maskz_mov_ps(keep, self.0))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        op!(_mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0))
    }
}
