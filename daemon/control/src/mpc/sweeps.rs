//! Forward and backward sweeps over three axes at once; the same equations as [`super::model`].

use super::lanes::{Coefficient, Lanes};

/// Start of the motion; its position is the origin.
#[derive(Clone, Copy)]
pub(super) struct Begin {
    pub(super) velocity: Lanes,
    pub(super) acceleration: Lanes,
    pub(super) arm: [Lanes; 2],
}

/// The forward sweep: jerk, acceleration, velocity, position per step.
#[inline(always)]
pub(super) fn roll<const N: usize>(jerks: &[Lanes; N], begin: &Begin, motion: &mut [[Lanes; 4]; N]) {
    let Begin { mut velocity, mut acceleration, .. } = *begin;
    let mut position = Lanes::ZERO;
    for (u, motion) in jerks.iter().zip(motion).take(rolled(N)) {
        position += velocity + (acceleration * 0.5 + *u * (1.0 / 6.0));
        velocity += acceleration + *u * 0.5;
        acceleration += *u;
        *motion = [*u, acceleration, velocity, position];
    }
}

/// A loop bound that is opaque to the compiler.
///
/// Unrolled, the sweeps are kilobytes of code that is cold in the cache at every tick: fetching it takes
/// longer than running it.
#[inline(always)]
pub(super) fn rolled(steps: usize) -> usize {
    std::hint::black_box(steps)
}

/// Adjoint state of the backward sweep: λ_i = f_i + Aᵀ λ_{i+1}.
pub(super) struct Sweep {
    p: Lanes,
    v: Lanes,
    a: Lanes,
}

impl Default for Sweep {
    fn default() -> Self {
        Self { p: Lanes::ZERO, v: Lanes::ZERO, a: Lanes::ZERO }
    }
}

impl Sweep {
    /// One step back with `force` on the state's acceleration, velocity and position; Bᵀλ.
    #[inline(always)]
    pub(super) fn back(&mut self, [fa, fv, fp]: [Lanes; 3]) -> Lanes {
        self.a += self.v + (self.p * 0.5 + fa);
        self.v += self.p + fv;
        self.p += fp;
        self.p * (1.0 / 6.0) + (self.v * 0.5 + self.a)
    }
}

/// Weighted errors of a state: acceleration, velocity, position.
#[inline(always)]
pub(super) fn errors<C: Coefficient>(state: &[Lanes; 3], weights: &[C; 3], pull: &[Lanes; 3]) -> [Lanes; 3] {
    let ([a, v, p], [wa, wv, wp], [pa, pv, pp]) = (state, weights, pull);
    [wa.times(*a) - *pa, wv.times(*v) - *pv, wp.times(*p) - *pp]
}

#[inline(always)]
pub(super) fn from_weights<C: Coefficient>(weights: &[C; 3], values: &[Lanes; 3]) -> [Lanes; 3] {
    let ([wa, wv, wp], [a, v, p]) = (weights, values);
    [wa.times(*a), wv.times(*v), wp.times(*p)]
}
