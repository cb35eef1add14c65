//! Two numbers worked on side by side.
//!
//! The constitutive laws are long chains of dependent operations with divisions and roots; a processor
//! that waits for one chain has time for another.

use super::Number;
use std::ops::{Add, Mul, Neg, Sub};

/// Two independent numbers.
#[derive(Clone, Copy)]
pub struct Pair<T>(pub T, pub T);

impl<T: Number> Add for Pair<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(self.0 + b.0, self.1 + b.1)
    }
}

impl<T: Number> Sub for Pair<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(self.0 - b.0, self.1 - b.1)
    }
}

impl<T: Number> Mul for Pair<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(self.0 * b.0, self.1 * b.1)
    }
}

impl<T: Number> Neg for Pair<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<T: Number> Number for Pair<T> {
    const SQUARED_STEP: f64 = T::SQUARED_STEP;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self(T::splat(x), T::splat(x))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(self.0.mul_add(b.0, c.0), self.1.mul_add(b.1, c.1))
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        Self(self.0.mul_sub(b.0, c.0), self.1.mul_sub(b.1, c.1))
    }
    #[inline(always)]
    fn over(self, b: Self) -> Self {
        Self(self.0.over(b.0), self.1.over(b.1))
    }
    #[inline(always)]
    fn root(self) -> Self {
        Self(self.0.root(), self.1.root())
    }
    #[inline(always)]
    fn larger(self, b: Self) -> Self {
        Self(self.0.larger(b.0), self.1.larger(b.1))
    }
    #[inline(always)]
    fn smaller(self, b: Self) -> Self {
        Self(self.0.smaller(b.0), self.1.smaller(b.1))
    }
    #[inline(always)]
    fn all_below(self, b: Self) -> bool {
        self.0.all_below(b.0) && self.1.all_below(b.1)
    }
}
