//! Eight sequences side by side in one of the two float types that a network trains in.
//!
//! A group of eight sequences advances together, one per lane; every inner loop runs over lanes, so that the
//! compiler turns it into vector instructions of whatever width the machine has. Lanes never mix but in
//! [`EightLanes::sum`], whose order is fixed: results do not depend on that width.

use std::ops::{Add, Mul, Sub};

/// `f32` for speed, `f64` for checks.
pub use foretrace_control::predict::models::activation::Scalar as Real;

/// Sequences that advance together.
pub const LANES: usize = 8;

/// The same quantity of eight sequences.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C, align(32))]
pub(super) struct EightLanes<F>(pub(super) [F; LANES]);

impl<F: Real> EightLanes<F> {
    #[inline(always)]
    pub(super) fn splat(x: F) -> Self {
        Self([x; LANES])
    }

    #[inline(always)]
    pub(super) fn map(self, f: impl Fn(F) -> F) -> Self {
        let mut out = self;
        for l in 0..LANES {
            out.0[l] = f(self.0[l]);
        }
        out
    }

    #[inline(always)]
    pub(super) fn zip(self, other: Self, f: impl Fn(F, F) -> F) -> Self {
        let mut out = self;
        for l in 0..LANES {
            out.0[l] = f(self.0[l], other.0[l]);
        }
        out
    }

    /// `self += factor * x`.
    #[inline(always)]
    pub(super) fn add_scaled(&mut self, factor: F, x: Self) {
        for l in 0..LANES {
            self.0[l] += factor * x.0[l];
        }
    }

    /// `self += a * b`.
    #[inline(always)]
    pub(super) fn add_product(&mut self, a: Self, b: Self) {
        for l in 0..LANES {
            self.0[l] += a.0[l] * b.0[l];
        }
    }

    /// Each component cut to +-`limit`.
    #[inline(always)]
    pub(super) fn clamp(self, limit: F) -> Self {
        self.map(|x| x.within(limit))
    }

    /// Over the lanes, pairwise.
    #[inline(always)]
    pub(super) fn sum(self) -> F {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

impl<F: Real> Add for EightLanes<F> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl<F: Real> Sub for EightLanes<F> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl<F: Real> Mul for EightLanes<F> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}
