//! Sixteen numbers at once: the small vocabulary in which the kernels are written.
//!
//! A kernel is written once, generic over [`Lanes`], and instantiated inside functions that have
//! the instruction set switched on ([`Isa::run`]). Sixteen lanes serve two purposes: sixteen
//! particles side by side (stress, weights, motion), or four grid nodes of four components (a row
//! of the stencil). A narrower machine makes them of two or four of its own registers.
//!
//! Every implementation evaluates the same expressions in the same order, but fused products round
//! differently from separate ones, so results are bitwise equal on one instruction set only.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(test)]
pub mod counted;
#[cfg(target_arch = "aarch64")]
mod neon;
mod pair;
mod portable;

pub use pair::Pair;
use std::ops::{Add, Mul, Neg, Sub};

/// How many lanes: a batch of particles, or four nodes of four components.
pub const WIDTH: usize = 16;

/// Sixteen floats with the alignment of the widest register.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Row(pub [f32; WIDTH]);

impl Row {
    /// All zero.
    pub const ZERO: Row = Row([0.0; WIDTH]);
}

/// What the constitutive laws need of a number: one `f64`, or sixteen `f32`.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// Square of the last step at which an iteration of quadratic convergence is exact to rounding.
    const SQUARED_STEP: f64;
    /// The same constant in every lane.
    fn splat(x: f64) -> Self;
    /// `self * b + c`, fused where the machine can.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `self * b - c`, fused where the machine can.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    /// Quotient.
    fn over(self, b: Self) -> Self;
    /// Square root.
    fn root(self) -> Self;
    /// The larger of the two.
    fn larger(self, b: Self) -> Self;
    /// The smaller of the two.
    fn smaller(self, b: Self) -> Self;
    /// Whether `self < b` in every lane.
    fn all_below(self, b: Self) -> bool;
}

/// Sixteen `f32`.
pub trait Lanes: Number {
    /// Whether nine of them, the rows of a stencil, stay in registers beside what is worked on. With sixteen registers to read them
    /// again for each particle is faster by a tenth.
    const STENCIL_FITS: bool;
    /// The same value in every lane.
    fn fill(x: f32) -> Self;
    /// Reads an aligned row.
    fn load(row: &Row) -> Self;
    /// Writes an aligned row.
    fn store(self, row: &mut Row);
    /// Reads sixteen floats from `from[0..16]` at any alignment.
    ///
    /// # Safety
    /// `from` must be valid for reading sixteen floats.
    unsafe fn read(from: *const f32) -> Self;
    /// Writes sixteen floats to `to[0..16]` at any alignment.
    ///
    /// # Safety
    /// `to` must be valid for writing sixteen floats.
    unsafe fn write(self, to: *mut f32);
    /// The four floats at group `g` of the row, four times over.
    fn repeat_group<const G: usize>(row: &Row) -> Self;
    /// In groups of four: `[a0 + a1 + a2 | a2 - a0 | b0 + b1 + b2 | c0 + c1 + c2]`. The last group of each must be zero.
    fn moments(a: Self, b: Self, c: Self) -> Self;
    /// The fourth float of each group, in all four places of the group.
    fn fourth_of_group(self) -> Self;
    /// Transposes sixteen rows of sixteen.
    fn transpose(rows: &mut [Self; WIDTH]);
    /// Bit i is set where lane i of `self` is less than that of `b` (never for NaN).
    fn less(self, b: Self) -> u16;
    /// Lane i of `self` where bit i of `keep` is set, else zero.
    fn keep(self, keep: u16) -> Self;
    /// Largest whole number not above each lane.
    fn floor(self) -> Self;
    /// Asks for a cache line that will be read soon; any address is allowed.
    #[inline(always)]
    fn fetch_soon<T>(at: *const T) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a prefetch never faults, and SSE belongs to the baseline of x86_64.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            _mm_prefetch::<_MM_HINT_T0>(at.cast());
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = at;
    }
    /// The same of one that will be read later: it comes no nearer than the second cache.
    #[inline(always)]
    fn fetch_later<T>(at: *const T) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
            _mm_prefetch::<_MM_HINT_T1>(at.cast());
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = at;
    }
}

/// Work that can be instantiated for any instruction set.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// The work; implementations are `#[inline(always)]` so that they compile with the features of their caller.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Instruction set of the kernels, chosen at run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512F and FMA.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// NEON, always there on 64-bit ARM.
    #[cfg(target_arch = "aarch64")]
    Neon,
    /// What every machine has.
    Portable,
    /// The same, counting its flops.
    #[cfg(test)]
    Counted,
}

impl Isa {
    /// The best set this machine has.
    pub fn best() -> Isa {
        Self::available()[0]
    }

    /// Every set this machine has, best first.
    pub fn available() -> Vec<Isa> {
        let mut found = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("fma") {
                found.push(Isa::Avx512);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                found.push(Isa::Avx2);
            }
        }
        #[cfg(target_arch = "aarch64")]
        found.push(Isa::Neon);
        found.push(Isa::Portable);
        found
    }

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => "avx2",
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => "neon",
            Isa::Portable => "portable",
            #[cfg(test)]
            Isa::Counted => "counted",
        }
    }

    /// Runs a kernel with this instruction set. Must have come from [`Isa::available`].
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            // SAFETY: the variant exists only after its features were detected.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => unsafe { with_avx512(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => unsafe { with_avx2(kernel) },
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => kernel.run::<neon::Neon>(),
            Isa::Portable => kernel.run::<portable::Portable>(),
            #[cfg(test)]
            Isa::Counted => kernel.run::<counted::Counted>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<avx512::Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<avx2::Avx2>()
}

impl Number for f64 {
    const SQUARED_STEP: f64 = 1e-16;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
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
        self / b
    }
    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn larger(self, b: Self) -> Self {
        self.max(b)
    }
    #[inline(always)]
    fn smaller(self, b: Self) -> Self {
        self.min(b)
    }
    #[inline(always)]
    fn all_below(self, b: Self) -> bool {
        self < b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exercises every operation and returns what it saw.
    struct Everything<'a> {
        a: &'a Row,
        b: &'a Row,
        many: &'a [Row; WIDTH],
    }

    impl Kernel for Everything<'_> {
        type Output = (Vec<Row>, Vec<u16>);
        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Output {
            let (a, b) = (L::load(self.a), L::load(self.b));
            let mut rows = self.many.map(|r| L::load(&r));
            let sums = L::moments(rows[0].keep(0x0fff), rows[1].keep(0x0fff), rows[2].keep(0x0fff));
            L::transpose(&mut rows);
            let results = [
                a + b,
                a - b,
                a * b,
                -a,
                a.over(b),
                b.root(),
                a.larger(b),
                a.smaller(b),
                a.floor(),
                a.keep(0b1010_0110_0001_1101),
                L::repeat_group::<2>(self.a),
                a.fourth_of_group(),
                a.mul_add(b, rows[0]),
                a.mul_sub(b, rows[0]),
                L::fill(2.5),
                sums,
            ];
            let mut out: Vec<Row> = Vec::new();
            for r in results.into_iter().chain(rows) {
                let mut row = Row::ZERO;
                r.store(&mut row);
                out.push(row);
            }
            (
                out,
                vec![a.less(b), b.less(a), u16::from(a.all_below(L::fill(99.0))), u16::from(a.all_below(b))],
            )
        }
    }

    #[test]
    fn every_instruction_set_computes_the_same() {
        let row =
            |seed: usize| Row(std::array::from_fn(|i| ((i * 37 + seed * 101) % 41) as f32 * 0.37 - 5.0));
        let a = row(1);
        let b = Row(row(2).0.map(|x| x.abs() + 0.25));
        let many: [Row; WIDTH] = std::array::from_fn(|k| row(k + 3));
        let work = || Everything { a: &a, b: &b, many: &many };
        let (truth, masks) = Isa::Portable.run(work());
        for i in 0..WIDTH {
            assert_eq!(truth[16 + i].0, std::array::from_fn::<f32, WIDTH, _>(|k| many[k].0[i]));
        }
        let expected: f32 = (0..3).map(|g| many[1].0[g * 4 + 2]).sum();
        assert!((truth[15].0[10] - expected).abs() < 1e-5);
        assert!((truth[15].0[6] - (many[0].0[10] - many[0].0[2])).abs() < 1e-5);
        for isa in Isa::available() {
            let (rows, m) = isa.run(work());
            assert_eq!(m, masks, "{isa:?}");
            for (k, (x, y)) in rows.iter().zip(&truth).enumerate() {
                for i in 0..WIDTH {
                    assert!((x.0[i] - y.0[i]).abs() <= 1e-5, "{isa:?} result {k} lane {i}");
                }
            }
        }
    }
}
