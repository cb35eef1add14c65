//! The lanes as two AVX registers, with FMA.

use super::{Lanes, Number, Row, WIDTH};
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Neg, Sub};

/// Sixteen floats in two registers. Only [`super::Isa::run`] instantiates kernels with it, after detection;
/// that is what makes every intrinsic below safe to execute.
#[derive(Clone, Copy)]
pub struct Avx2(__m256, __m256);

/// Applies an intrinsic of AVX, AVX2 or FMA to both halves.
macro_rules! both {
    ($f:ident, $($x:expr),+) => {
        // SAFETY: see [`Avx2`]: its kernels run only where AVX2 and FMA were detected.
        unsafe { Self($f($($x.0),+), $f($($x.1),+)) }
    };
}

impl Add for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        both!(_mm256_add_ps, self, b)
    }
}

impl Sub for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        both!(_mm256_sub_ps, self, b)
    }
}

impl Mul for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        both!(_mm256_mul_ps, self, b)
    }
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::fill(0.0) - self
    }
}

impl Number for Avx2 {
    const SQUARED_STEP: f64 = 1e-7;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self::fill(x as f32)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        both!(_mm256_fmadd_ps, self, b, c)
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        both!(_mm256_fmsub_ps, self, b, c)
    }
    #[inline(always)]
    fn over(self, b: Self) -> Self {
        both!(_mm256_div_ps, self, b)
    }
    #[inline(always)]
    fn root(self) -> Self {
        both!(_mm256_sqrt_ps, self)
    }
    #[inline(always)]
    fn larger(self, b: Self) -> Self {
        both!(_mm256_max_ps, self, b)
    }
    #[inline(always)]
    fn smaller(self, b: Self) -> Self {
        both!(_mm256_min_ps, self, b)
    }
    #[inline(always)]
    fn all_below(self, b: Self) -> bool {
        self.less(b) == u16::MAX
    }
}

impl Lanes for Avx2 {
    const STENCIL_FITS: bool = false;
    #[inline(always)]
    fn fill(x: f32) -> Self {
        // SAFETY: see [`Avx2`].
        let v = unsafe { _mm256_set1_ps(x) };
        Self(v, v)
    }
    #[inline(always)]
    fn load(row: &Row) -> Self {
        let from = row.0.as_ptr();
        // SAFETY: see [`Avx2`]; the row is aligned to 64 bytes.
        unsafe { Self(_mm256_load_ps(from), _mm256_load_ps(from.add(8))) }
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        let to = row.0.as_mut_ptr();
        // SAFETY: see [`Avx2`]; the row is aligned to 64 bytes.
        unsafe {
            _mm256_store_ps(to, self.0);
            _mm256_store_ps(to.add(8), self.1);
        }
    }
    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        // SAFETY: see [`Avx2`]; the caller vouches for the memory.
        unsafe { Self(_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))) }
    }
    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        // SAFETY: see [`Avx2`]; the caller vouches for the memory.
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm256_storeu_ps(to.add(8), self.1);
        }
    }
    #[inline(always)]
    fn repeat_group<const G: usize>(row: &Row) -> Self {
        // SAFETY: see [`Avx2`]; four groups of four floats make the row.
        let v = unsafe {
            let g = _mm_load_ps(row.0.as_ptr().add(G * 4));
            _mm256_set_m128(g, g)
        };
        Self(v, v)
    }
    #[inline(always)]
    fn moments(a: Self, b: Self, c: Self) -> Self {
        // SAFETY: see [`Avx2`].
        unsafe {
            // [a1 | a2] + [a2 | 0] + [a0 | -a0].
            let sign = _mm256_setr_ps(1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0);
            let rest = _mm256_add_ps(_mm256_permute2f128_ps::<0x21>(a.0, a.1), a.1);
            let [b, c] = [b, c].map(|x| _mm256_add_ps(x.0, x.1));
            Self(
                _mm256_fmadd_ps(_mm256_permute2f128_ps::<0x00>(a.0, a.0), sign, rest),
                _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(b, c), _mm256_permute2f128_ps::<0x31>(b, c)),
            )
        }
    }
    #[inline(always)]
    fn fourth_of_group(self) -> Self {
        // SAFETY: see [`Avx2`].
        unsafe {
            Self(_mm256_permute_ps::<0b11_11_11_11>(self.0), _mm256_permute_ps::<0b11_11_11_11>(self.1))
        }
    }
    #[inline(always)]
    fn transpose(rows: &mut [Self; WIDTH]) {
        // Four 8x8 transposes; the off-diagonal ones change places.
        let upper_left = transpose8(std::array::from_fn(|i| rows[i].0));
        let upper_right = transpose8(std::array::from_fn(|i| rows[i].1));
        let lower_left = transpose8(std::array::from_fn(|i| rows[8 + i].0));
        let lower_right = transpose8(std::array::from_fn(|i| rows[8 + i].1));
        for i in 0..8 {
            rows[i] = Self(upper_left[i], lower_left[i]);
            rows[8 + i] = Self(upper_right[i], lower_right[i]);
        }
    }
    #[inline(always)]
    fn less(self, b: Self) -> u16 {
        // SAFETY: see [`Avx2`].
        unsafe {
            let lo = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0)) as u16;
            let hi = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.1, b.1)) as u16;
            lo | hi << 8
        }
    }
    #[inline(always)]
    fn keep(self, keep: u16) -> Self {
        // SAFETY: see [`Avx2`].
        unsafe {
            let half = |v: __m256, bits: i32| {
                let bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let set = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(bits), bit), bit);
                _mm256_and_ps(v, _mm256_castsi256_ps(set))
            };
            Self(half(self.0, i32::from(keep & 0xff)), half(self.1, i32::from(keep >> 8)))
        }
    }
    #[inline(always)]
    fn floor(self) -> Self {
        both!(_mm256_floor_ps, self)
    }
}

/// Transposes eight rows of eight.
#[inline(always)]
fn transpose8(x: [__m256; 8]) -> [__m256; 8] {
    // SAFETY: see [`Avx2`].
    unsafe {
        let mut t = [_mm256_setzero_ps(); 8];
        for h in 0..2 {
            let [a, b, c, d] = [x[4 * h], x[4 * h + 1], x[4 * h + 2], x[4 * h + 3]];
            let (ab0, ab1) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let (cd0, cd1) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            t[4 * h] = _mm256_shuffle_ps::<0b01_00_01_00>(ab0, cd0);
            t[4 * h + 1] = _mm256_shuffle_ps::<0b11_10_11_10>(ab0, cd0);
            t[4 * h + 2] = _mm256_shuffle_ps::<0b01_00_01_00>(ab1, cd1);
            t[4 * h + 3] = _mm256_shuffle_ps::<0b11_10_11_10>(ab1, cd1);
        }
        let mut out = [_mm256_setzero_ps(); 8];
        for k in 0..4 {
            out[k] = _mm256_permute2f128_ps::<0x20>(t[k], t[4 + k]);
            out[4 + k] = _mm256_permute2f128_ps::<0x31>(t[k], t[4 + k]);
        }
        out
    }
}
