//! Four numbers processed together: one per axis, and one for padding.
//!
//! Plain arrays, which the compiler vectorises on any x86-64. NaN propagates through sums and products as
//! usual; comparisons state what they do with it.

use crate::state::wraps;
use std::ops::{Add, AddAssign, Mul, Sub};

/// One number per axis, and a zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lanes([f64; 4]);

wraps! { Lanes }

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; 4]);

    #[inline(always)]
    pub(super) fn of([x, y, z]: [f64; 3]) -> Self {
        Self([x, y, z, 0.0])
    }

    #[inline(always)]
    pub(super) fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let ([a, b, c, d], [e, g, h, i]) = (self.0, other.0);
        Self([f(a, e), f(b, g), f(c, h), f(d, i)])
    }

    /// The larger; drops a NaN in `self`.
    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// The smaller; drops a NaN in `self`.
    #[inline(always)]
    pub(super) fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self(self.0.map(f64::abs))
    }

    /// The number of axis 0, 1 or 2.
    #[inline(always)]
    pub(super) fn axis(self, axis: usize) -> f64 {
        let [x, y, z, _] = self.0;
        match axis {
            0 => x,
            1 => y,
            _ => z,
        }
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Mul<f64> for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|a| a * factor))
    }
}

/// What lanes are multiplied with: one number for all axes, or one per axis.
///
/// Axes with equal gains share their coefficients: a quarter of the memory, which is cold in the cache at
/// every tick.
pub(super) trait Coefficient: Copy + std::fmt::Debug {
    const ZERO: Self;
    fn of(axes: [f64; 3]) -> Self;
    fn times(self, lanes: Lanes) -> Lanes;
}

impl Coefficient for f64 {
    const ZERO: Self = 0.0;

    /// The axes are equal; the first stands for all.
    #[inline(always)]
    fn of([x, ..]: [f64; 3]) -> Self {
        x
    }

    #[inline(always)]
    fn times(self, lanes: Lanes) -> Lanes {
        lanes * self
    }
}

impl Coefficient for Lanes {
    const ZERO: Self = Self::ZERO;

    #[inline(always)]
    fn of(axes: [f64; 3]) -> Self {
        Self::of(axes)
    }

    #[inline(always)]
    fn times(self, lanes: Lanes) -> Lanes {
        self * lanes
    }
}
