//! Single-precision numbers side by side in a register: the one place of the solver that knows instruction sets.
//!
//! A kernel is written once over [`Lanes`] and run through [`dispatch`], which picks AVX-512, AVX2 with
//! FMA, NEON or what every machine has when the program starts. Lanes are as many as one register holds: a stress takes dozens of
//! numbers a point, and with two registers to a number the sixteen of AVX2 hold next to none of them. Data that are made
//! elsewhere lie in blocks of [`WIDTH`], which all of them divide; the tangent lies as the kernel that makes it has lanes, and is for
//! kernels of the same instruction set. Results are bitwise equal on one instruction set, whatever the thread count.

use glam::Vec4;
use std::sync::OnceLock;

/// Numbers in a block of data, a multiple of every [`Lanes::COUNT`].
pub const WIDTH: usize = 16;

/// Arithmetic on the numbers in a register.
pub trait Lanes: Copy {
    /// How many there are.
    const COUNT: usize;
    /// How many columns of lanes, side by side, have their sums of five rows in registers (for a product's tile).
    const ABREAST: usize;

    /// The same number in each lane.
    fn splat(x: f32) -> Self;
    /// Reads the front of a slice.
    fn load(from: &[f32]) -> Self;
    /// Writes to the front of a slice.
    fn store(self, to: &mut [f32]);
    /// self + b.
    fn add(self, b: Self) -> Self;
    /// self - b.
    fn sub(self, b: Self) -> Self;
    /// self b.
    fn mul(self, b: Self) -> Self;
    /// self / b.
    fn div(self, b: Self) -> Self;
    /// self b + c.
    fn fma(self, b: Self, c: Self) -> Self;
    /// c - self b.
    fn fnma(self, b: Self, c: Self) -> Self;
    /// Lesser of two, lane by lane.
    fn min(self, b: Self) -> Self;
    /// Greater of two, lane by lane.
    fn max(self, b: Self) -> Self;

    /// The lanes from the last to the first.
    #[inline(always)]
    fn reversed(self) -> Self {
        let lanes = self.to_array();
        let mut reversed = [0.0; WIDTH];
        for i in 0..Self::COUNT {
            reversed[i] = lanes[Self::COUNT - 1 - i];
        }
        Self::load(&reversed)
    }

    /// Adds `x[0]` to the front of a slice, `x[1]` one number further and `x[2]` two.
    #[inline(always)]
    fn add_staggered(x: [Self; 3], to: &mut [f32]) {
        for (a, x) in x.into_iter().enumerate() {
            let to = &mut to[a..];
            Self::load(to).add(x).store(to);
        }
    }

    /// Asks for the memory that number `at` of a slice lies in, if it has one, for soon.
    #[inline(always)]
    fn fetch(from: &[f32], at: usize) {
        let at = from.as_ptr().wrapping_add(at);
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a prefetch never faults, and SSE belongs to the baseline of x86_64.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            _mm_prefetch::<_MM_HINT_T0>(at.cast());
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = at;
    }

    /// The lanes in the first [`Self::COUNT`] places, zeros behind them.
    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        let mut out = [0.0; WIDTH];
        self.store(&mut out);
        out
    }
}

/// Work written over [`Lanes`].
pub trait Kernel {
    /// What it gives back.
    type Output;
    /// Does the work; implementations must be `#[inline(always)]`, as must everything they call with `L`.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// An instruction set the program can use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512F.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX2 with FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// NEON.
    #[cfg(target_arch = "aarch64")]
    Neon,
    /// What every machine of its kind has.
    Portable,
}

/// The best instruction set of this machine.
pub fn best_isa() -> Isa {
    static BEST: OnceLock<Isa> = OnceLock::new();
    *BEST.get_or_init(|| {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                return Isa::Avx512;
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Isa::Avx2;
            }
        }
        #[cfg(target_arch = "aarch64")]
        if std::arch::is_aarch64_feature_detected!("neon") {
            return Isa::Neon;
        }
        Isa::Portable
    })
}

/// Runs a kernel on the best instruction set.
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    dispatch_on(best_isa(), kernel)
}

/// Every instruction set of this machine that the program can use.
#[cfg(test)]
pub fn of_this_machine() -> Vec<Isa> {
    let mut sets = vec![Isa::Portable, best_isa()];
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        sets.push(Isa::Avx2);
    }
    sets
}

/// Runs a kernel on a named instruction set, which must be one this machine has.
pub(super) fn dispatch_on<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    match isa {
        // SAFETY (all three): `best_isa` has seen the feature on this machine; tests ask the same way.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::run_avx512(kernel) },
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::run_avx2(kernel) },
        #[cfg(target_arch = "aarch64")]
        Isa::Neon => unsafe { arm::run_neon(kernel) },
        Isa::Portable => kernel.run::<Portable>(),
    }
}

/// A vector of glam's: a register where all machines of a kind have one, else plain numbers.
#[derive(Clone, Copy)]
pub struct Portable(Vec4);

impl Lanes for Portable {
    const COUNT: usize = 4;
    const ABREAST: usize = 2;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(Vec4::splat(x))
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self(Vec4::from_slice(from))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.0.write_to_slice(to);
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(self.0 + b.0)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(self.0 - b.0)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(self.0 * b.0)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(self.0 / b.0)
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn fnma(self, b: Self, c: Self) -> Self {
        c.sub(self.mul(b))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(self.0.min(b.0))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(self.0.max(b.0))
    }
}

/// Implements [`Lanes`] by a register of `$count` numbers, with room for `$abreast` abreast. (Without closures, which have no instruction
/// set: where one is not inlined, nothing in it is.)
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! register {
    ($name:ident, $reg:ty, $count:literal, $abreast:literal, $set1:ident, $load:ident, $store:ident, $add:ident, $sub:ident,
     $mul:ident, $div:ident, |$x:ident, $y:ident, $z:ident| $fma:expr, |$u:ident, $v:ident, $t:ident| $fnma:expr,
     $min:ident, $max:ident $(, $more:item)*) => {
        /// Lanes of a vector register.
        #[derive(Clone, Copy)]
        pub struct $name($reg);

        // SAFETY (whole block): values of this type are made only inside the entry function below it,
        // which carries the target feature; loads and stores are bounds-checked by the slicing before them.
        impl Lanes for $name {
            const COUNT: usize = $count;
            const ABREAST: usize = $abreast;

            #[inline(always)]
            fn splat(x: f32) -> Self {
                Self(unsafe { $set1(x) })
            }
            #[inline(always)]
            fn load(from: &[f32]) -> Self {
                Self(unsafe { $load(from[..$count].as_ptr()) })
            }
            #[inline(always)]
            fn store(self, to: &mut [f32]) {
                unsafe { $store(to[..$count].as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                Self(unsafe { $add(self.0, b.0) })
            }
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                Self(unsafe { $sub(self.0, b.0) })
            }
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                Self(unsafe { $mul(self.0, b.0) })
            }
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                Self(unsafe { $div(self.0, b.0) })
            }
            #[inline(always)]
            fn fma(self, b: Self, c: Self) -> Self {
                let ($x, $y, $z) = (self.0, b.0, c.0);
                Self(unsafe { $fma })
            }
            #[inline(always)]
            fn fnma(self, b: Self, c: Self) -> Self {
                let ($u, $v, $t) = (self.0, b.0, c.0);
                Self(unsafe { $fnma })
            }
            #[inline(always)]
            fn min(self, b: Self) -> Self {
                Self(unsafe { $min(self.0, b.0) })
            }
            #[inline(always)]
            fn max(self, b: Self) -> Self {
                Self(unsafe { $max(self.0, b.0) })
            }
            $($more)*
        }
    };
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Kernel, Lanes};
    use std::arch::x86_64::*;

    register!(
        Avx512,
        __m512,
        16,
        4,
        _mm512_set1_ps,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_div_ps,
        |a, b, c| _mm512_fmadd_ps(a, b, c),
        |a, b, c| _mm512_fnmadd_ps(a, b, c),
        _mm512_min_ps,
        _mm512_max_ps,
        // Loads that overlap a store just made would wait for it: the three are added in registers, and what
        // they put beyond the front follows.
        #[inline(always)]
        fn add_staggered(x: [Self; 3], to: &mut [f32]) {
            let [Self(a), Self(b), Self(c)] = x;
            let (front, beyond) = unsafe {
                let zero = _mm512_setzero_si512();
                let (b, c) = (_mm512_castps_si512(b), _mm512_castps_si512(c));
                let b_up = _mm512_castsi512_ps(_mm512_alignr_epi32::<15>(b, zero));
                let c_up = _mm512_castsi512_ps(_mm512_alignr_epi32::<14>(c, zero));
                let b_beyond = _mm512_castsi512_ps(_mm512_alignr_epi32::<15>(zero, b));
                let c_beyond = _mm512_castsi512_ps(_mm512_alignr_epi32::<14>(zero, c));
                let beyond = _mm_add_ps(_mm512_castps512_ps128(b_beyond), _mm512_castps512_ps128(c_beyond));
                (_mm512_add_ps(_mm512_add_ps(a, b_up), c_up), beyond)
            };
            add_beyond(Self(front), beyond, to);
        },
        #[inline(always)]
        fn reversed(self) -> Self {
            let order = [15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0i32];
            Self(unsafe { _mm512_permutexvar_ps(_mm512_loadu_si512(order.as_ptr().cast()), self.0) })
        }
    );
    register!(
        Avx2,
        __m256,
        8,
        2,
        _mm256_set1_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_div_ps,
        |a, b, c| _mm256_fmadd_ps(a, b, c),
        |a, b, c| _mm256_fnmadd_ps(a, b, c),
        _mm256_min_ps,
        _mm256_max_ps,
        // As above.
        #[inline(always)]
        fn add_staggered(x: [Self; 3], to: &mut [f32]) {
            let [Self(a), Self(b), Self(c)] = x;
            let (front, beyond) = unsafe {
                let zero = _mm256_setzero_ps();
                let b = _mm256_permutevar8x32_ps(b, _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6));
                let c = _mm256_permutevar8x32_ps(c, _mm256_setr_epi32(6, 7, 0, 1, 2, 3, 4, 5));
                let (b_up, c_up) = (_mm256_blend_ps::<1>(b, zero), _mm256_blend_ps::<3>(c, zero));
                let b_beyond = _mm256_castps256_ps128(_mm256_blend_ps::<1>(zero, b));
                let beyond = _mm_add_ps(b_beyond, _mm256_castps256_ps128(c));
                (_mm256_add_ps(_mm256_add_ps(a, b_up), c_up), beyond)
            };
            add_beyond(Self(front), beyond, to);
        },
        #[inline(always)]
        fn reversed(self) -> Self {
            Self(unsafe { _mm256_permutevar8x32_ps(self.0, _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0)) })
        }
    );

    /// Adds lanes to the front of a slice, and the first two of `beyond` to what follows.
    #[inline(always)]
    fn add_beyond<L: Lanes>(front: L, beyond: __m128, to: &mut [f32]) {
        let to = &mut to[..L::COUNT + 2];
        L::load(to).add(front).store(to);
        let mut rest = [0.0; 4];
        unsafe { _mm_storeu_ps(rest.as_mut_ptr(), beyond) };
        to[L::COUNT] += rest[0];
        to[L::COUNT + 1] += rest[1];
    }

    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<Avx512>()
    }

    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<Avx2>()
    }
}

#[cfg(target_arch = "aarch64")]
mod arm {
    use super::{Kernel, Lanes};
    use std::arch::aarch64::*;

    register!(
        Neon,
        float32x4_t,
        4,
        4,
        vdupq_n_f32,
        vld1q_f32,
        vst1q_f32,
        vaddq_f32,
        vsubq_f32,
        vmulq_f32,
        vdivq_f32,
        |a, b, c| vfmaq_f32(c, a, b),
        |a, b, c| vfmsq_f32(c, a, b),
        vminq_f32,
        vmaxq_f32
    );

    #[target_feature(enable = "neon")]
    pub(super) unsafe fn run_neon<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<Neon>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Works on all of two rows of [`WIDTH`] and more.
    struct Probe<'a>(&'a [f32], &'a [f32]);

    impl Kernel for Probe<'_> {
        type Output = [[f32; WIDTH + 2]; 6];
        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Output {
            let mut out = [[0.25; WIDTH + 2]; 6];
            let c = L::splat(0.5);
            for at in (0..WIDTH).step_by(L::COUNT) {
                let (a, b) = (L::load(&self.0[at..]), L::load(&self.1[at + 1..]));
                a.fma(b, c).store(&mut out[0][at..]);
                a.fnma(b, c).sub(b).store(&mut out[1][at..]);
                a.div(b).min(c).store(&mut out[2][at..]);
                a.mul(b).max(c).add(a).store(&mut out[3][at..]);
                L::add_staggered([a, b, c], &mut out[4][at..]);
                a.reversed().store(&mut out[5][WIDTH - L::COUNT - at..]);
            }
            out
        }
    }

    #[test]
    fn every_instruction_set_computes_the_same_within_rounding() {
        let a: Vec<f32> = (0..16).map(|i| 0.3 + i as f32).collect();
        let b: Vec<f32> = (0..17).map(|i| 1.7 - 0.25 * i as f32).collect();
        let want = dispatch_on(Isa::Portable, Probe(&a, &b));
        let mut staggered = [0.25; WIDTH + 2];
        for i in 0..WIDTH {
            for (n, x) in [a[i], b[i + 1], 0.5].into_iter().enumerate() {
                staggered[i + n] += x;
            }
        }
        let near = |g: f32, w: f32| (g - w).abs() <= 1e-5 * w.abs().max(1.0);
        assert!(want[5].iter().zip(a.iter().rev()).all(|(g, w)| g == w), "{:?}", want[5]);
        assert!(want[4].iter().zip(&staggered).all(|(g, w)| near(*g, *w)), "{:?}", want[4]);
        for isa in of_this_machine() {
            let got = dispatch_on(isa, Probe(&a, &b));
            for (g, w) in got.iter().flatten().zip(want.iter().flatten()) {
                assert!(near(*g, *w), "{isa:?}: {g} instead of {w}");
            }
        }
    }
}
