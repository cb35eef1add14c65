//! Eight numbers side by side, and the choice of the instruction set that works on them.
//!
//! Kernels are written once, as plain code over [`Eight`] that the compiler turns into the vector instructions of the
//! function it is inlined into; [`with_widest`] calls it inside a function that has them switched on. Nothing is
//! fused or reassociated, so every machine computes the same numbers.

use std::ops::{Add, Mul, Neg, Sub};

/// Eight values of an expression of a lane's number. (Written out, so that it is fast without an optimiser's help, too: closures
/// and iterators are calls in builds for tests.)
macro_rules! lanes {
    ($i:ident => $value:expr) => {
        lanes!($i => $value; 0, 1, 2, 3, 4, 5, 6, 7)
    };
    ($i:ident => $value:expr; $($lane:literal),*) => {
        [$({
            let $i = $lane;
            $value
        }),*]
    };
}
pub(super) use lanes;

/// How many.
pub const WIDTH: usize = 8;

/// Eight `f32`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(32))]
pub struct Eight(pub [f32; WIDTH]);

/// Which of the eight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mask([bool; WIDTH]);

impl Eight {
    /// The same number eight times.
    #[inline(always)]
    pub fn all(value: f32) -> Self {
        Self([value; WIDTH])
    }

    /// The larger of each pair.
    #[inline(always)]
    pub fn max(self, b: Self) -> Self {
        Self(lanes!(i => if self.0[i] > b.0[i] { self.0[i] } else { b.0[i] }))
    }

    /// The smaller of each pair.
    #[inline(always)]
    pub fn min(self, b: Self) -> Self {
        Self(lanes!(i => if self.0[i] < b.0[i] { self.0[i] } else { b.0[i] }))
    }

    /// Quotients.
    #[inline(always)]
    pub fn over(self, b: Self) -> Self {
        Self(lanes!(i => self.0[i] / b.0[i]))
    }

    /// Square roots.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(lanes!(i => self.0[i].sqrt()))
    }

    /// Powers.
    #[inline(always)]
    pub fn powf(self, exponent: f32) -> Self {
        Self(lanes!(i => self.0[i].powf(exponent)))
    }

    /// Magnitudes.
    #[inline(always)]
    pub fn abs(self) -> Self {
        Self(lanes!(i => self.0[i].abs()))
    }

    /// Arc tangents, to 2e-8 (Abramowitz and Stegun 4.4.49, and its complement beyond 1).
    #[inline(always)]
    pub fn atan(self) -> Self {
        const TERMS: [f32; 9] = [
            1.0,
            -0.333_331_45,
            0.199_935_51,
            -0.142_089,
            0.106_562_64,
            -0.075_289_64,
            0.042_909_614,
            -0.016_165_737,
            0.002_866_225_7,
        ];
        let (zero, one) = (Self::all(0.0), Self::all(1.0));
        let size = self.abs();
        let far = one.below(size);
        let x = far.choose(one.over(size), size);
        let x2 = x * x;
        let sum = polynomial(&TERMS, x2) * x;
        let angle = far.choose(Self::all(std::f32::consts::FRAC_PI_2) - sum, sum);
        self.below(zero).choose(-angle, angle)
    }

    /// Which are below the other's.
    #[inline(always)]
    pub fn below(self, b: Self) -> Mask {
        Mask(lanes!(i => self.0[i] < b.0[i]))
    }
}

/// A polynomial by its coefficients, the lowest first.
#[inline(always)]
pub fn polynomial<const N: usize>(coefficients: &[f32; N], x: Eight) -> Eight {
    let mut k = N - 1;
    let mut sum = Eight::all(coefficients[k]);
    while k > 0 {
        k -= 1;
        sum = sum * x + Eight::all(coefficients[k]);
    }
    sum
}

impl Mask {
    /// Whether any is set.
    #[inline(always)]
    pub fn any(self) -> bool {
        let m = &self.0;
        (m[0] | m[1] | m[2] | m[3]) | (m[4] | m[5] | m[6] | m[7])
    }

    /// Those of either.
    #[inline(always)]
    pub fn or(self, b: Self) -> Self {
        Self(lanes!(i => self.0[i] | b.0[i]))
    }

    /// Both.
    #[inline(always)]
    pub fn and(self, b: Self) -> Self {
        Self(lanes!(i => self.0[i] & b.0[i]))
    }

    /// Whether lane `i` is set.
    #[inline(always)]
    pub fn lane(self, i: usize) -> bool {
        self.0[i]
    }

    /// Vectors where set `a`, else `b`.
    #[inline(always)]
    pub fn pick(self, a: Vectors, b: Vectors) -> Vectors {
        Vectors { x: self.choose(a.x, b.x), y: self.choose(a.y, b.y), z: self.choose(a.z, b.z) }
    }

    /// Where set `a`, else `b`.
    #[inline(always)]
    pub fn choose(self, a: Eight, b: Eight) -> Eight {
        Eight(lanes!(i => if self.0[i] { a.0[i] } else { b.0[i] }))
    }
}

impl Add for Eight {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(lanes!(i => self.0[i] + b.0[i]))
    }
}

impl Sub for Eight {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(lanes!(i => self.0[i] - b.0[i]))
    }
}

impl Mul for Eight {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(lanes!(i => self.0[i] * b.0[i]))
    }
}

impl Neg for Eight {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(lanes!(i => -self.0[i]))
    }
}

/// Eight vectors.
#[derive(Debug, Clone, Copy)]
pub struct Vectors {
    /// Their first components.
    pub x: Eight,
    /// Their second components.
    pub y: Eight,
    /// Their third components.
    pub z: Eight,
}

impl Vectors {
    /// The same vector eight times.
    #[inline(always)]
    pub fn all(v: glam::Vec3) -> Self {
        Self { x: Eight::all(v.x), y: Eight::all(v.y), z: Eight::all(v.z) }
    }

    /// Scalar products.
    #[inline(always)]
    pub fn dot(self, b: Self) -> Eight {
        self.x * b.x + self.y * b.y + self.z * b.z
    }

    /// Vector products.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        Self {
            x: self.y * b.z - self.z * b.y,
            y: self.z * b.x - self.x * b.z,
            z: self.x * b.y - self.y * b.x,
        }
    }

    /// Each times a number of its own.
    #[inline(always)]
    pub fn scaled(self, s: Eight) -> Self {
        Self { x: self.x * s, y: self.y * s, z: self.z * s }
    }

    /// Sums over the eight, by component.
    #[inline(always)]
    pub fn sums(self) -> glam::Vec3 {
        let sum = |e: Eight| e.0[0] + e.0[1] + e.0[2] + e.0[3] + e.0[4] + e.0[5] + e.0[6] + e.0[7];
        glam::Vec3::new(sum(self.x), sum(self.y), sum(self.z))
    }

    /// Of length 1; what has no length becomes 0.
    #[inline(always)]
    pub fn unit(self) -> Self {
        let length = self.dot(self).sqrt().max(Eight::all(1e-30));
        self.scaled(Eight::all(1.0).over(length))
    }
}

impl Add for Vectors {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { x: self.x + b.x, y: self.y + b.y, z: self.z + b.z }
    }
}

impl Sub for Vectors {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { x: self.x - b.x, y: self.y - b.y, z: self.z - b.z }
    }
}

/// Work that is to be compiled for several instruction sets: its `run` must be `#[inline(always)]`.
pub trait Work {
    /// What comes out.
    type Output;
    /// Does it.
    fn run(self) -> Self::Output;
}

/// Runs the work with the widest vector instructions this machine has.
pub fn with_widest<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
        fn avx2<W: Work>(work: W) -> W::Output {
            work.run()
        }
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,lzcnt")]
        fn avx512<W: Work>(work: W) -> W::Output {
            work.run()
        }
        let bits = is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt");
        if bits
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
        {
            // SAFETY: the features that the function is compiled for have just been found.
            return unsafe { avx512(work) };
        }
        if bits && is_x86_feature_detected!("avx2") {
            // SAFETY: as above.
            return unsafe { avx2(work) };
        }
    }
    work.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_tangents_are_those_of_the_library() {
        for k in -200..200 {
            let x = (k as f32 * 0.05).sinh();
            let angle = Eight::all(x).atan().0[3];
            assert!((angle - x.atan()).abs() < 3e-7, "{x}: {angle}");
        }
        assert_eq!(Eight::all(f32::NEG_INFINITY).atan().0[0], -std::f32::consts::FRAC_PI_2);
    }
}
