//! Least squares for the response of the arm as a whole, trimmed: joints that do not fit are left out.
//!
//! Contract: c(t − d) = m + a₁ṁ + a₂m̈ over all joints, c commanded, m measured, both through the same band,
//! which removes offsets and noise. Sums are kept per joint, so that every set of joints without one or two
//! of them can be solved; leaving a joint out costs as much as a residual of [`WORTH_RAD`]. The cheapest pair
//! of delay and set wins; a sweep over all takes [`DELAYS`]/[`PER_STEP`] grid steps. Source: equation-error
//! method with state-variable filters (Young, "Parameter estimation for continuous-time models", Automatica
//! 17 (1981), 23-39); least trimmed squares (Rousseeuw, "Least median of squares regression", J. Am. Stat.
//! Assoc. 79 (1984), 871-880).

use super::servo::{Delayed, SecondOrder};
use crate::arm::band::{Band, STAGES, push};
use crate::arm::track::GRID_S;
use crate::state::state;

/// Grid steps of the difference and of each running sum of the band: its middle is at 3.3 Hz.
const LENGTH: usize = 8;
/// Settling time of the band \[grid steps\].
const SETTLING: usize = STAGES * LENGTH;
/// Candidate delays: 0, 20, ... 200 ms; the servo takes up what is between them.
const DELAYS: usize = 11;
const DELAY_STEPS: usize = 2;
/// Samples of the measured joints for central differences, and of the commands for the longest delay.
const STENCIL: usize = 5;
const HISTORY: usize = STENCIL / 2 + (DELAYS - 1) * DELAY_STEPS + 1;
/// An arm at its commands \[rad\] that is asked to move no more than this \[1\] stands still.
const STANDS_RAD: f64 = 0.01;
const STANDS: f64 = 0.01;
/// Time constant of forgetting, in time of motion \[s\].
const MEMORY_S: f64 = 1.0;
/// Least motion for a fit \[s\].
const LEAST_MOTION_S: f64 = 0.3;
/// Residual, root of the mean square, from which a joint is better left out \[rad\].
const WORTH_RAD: f64 = 2e-3;
/// Delays that are solved in one grid step.
const PER_STEP: usize = 2;
/// The longest servo \[grid steps\], and the largest a₂ as a share of a₁²: a damping ratio of 0.4.
const LONGEST: f64 = 22.0;
const LARGEST_SHARE: f64 = 1.0 / (4.0 * 0.4 * 0.4);
/// Relative ridge that keeps the equations regular when the motion has a single frequency.
const RIDGE: f64 = 1e-5;

/// Sums of one joint: of (ṁ², ṁm̈, m̈²), and per delay of (ṁy, m̈y, y²) with y = c(t − d) − m.
#[derive(Debug, Clone, Copy)]
struct JointSums {
    gram: [f64; 3],
    fits: [[f64; 3]; DELAYS],
}

state! { [] JointSums { gram, fits } }

impl JointSums {
    const NONE: Self = Self { gram: [0.0; 3], fits: [[0.0; 3]; DELAYS] };

    fn scale(&mut self, keep: f64) {
        let sums = self.gram.iter_mut().chain(self.fits.iter_mut().flatten());
        sums.for_each(|sum| *sum *= keep);
    }
}

/// A response, and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FittedResponse {
    pub(super) shape: Delayed,
    /// Residual of the joints that agree, root of the mean square \[rad\].
    pub(super) residual_rad: f64,
    /// Σ of squared residuals, and what the joints left out cost.
    cost: f64,
}

state! { whole [] FittedResponse { shape, residual_rad, cost } }

#[derive(Debug, Clone)]
pub(super) struct ResponseFit<const J: usize> {
    filters: Option<[Band<J, LENGTH>; 2]>,
    /// Grid steps since the filters began.
    age: usize,
    /// Newest first, one per grid step.
    commanded: [[f64; J]; HISTORY],
    measured: [[f64; J]; STENCIL],
    /// Weight of everything that is remembered \[grid steps\].
    weight: f64,
    sums: [JointSums; J],
    /// Next delay of the sweep, its best so far, and that of the sweep before.
    next: usize,
    candidate: Option<FittedResponse>,
    best: Option<FittedResponse>,
}

state! {
    [const J: usize] ResponseFit<J> {
        filters, age, commanded, measured, weight, sums, next, candidate, best,
    }
}

impl<const J: usize> ResponseFit<J> {
    pub(super) fn new() -> Self {
        Self {
            filters: None,
            age: 0,
            commanded: [[0.0; J]; HISTORY],
            measured: [[0.0; J]; STENCIL],
            weight: 0.0,
            sums: [JointSums::NONE; J],
            next: 0,
            candidate: None,
            best: None,
        }
    }

    /// The next sample does not follow the last one; `keep`: share of the evidence that remains.
    pub(super) fn break_off(&mut self, keep: f64) {
        (self.filters, self.age) = (None, 0);
        self.fade(keep);
        (self.next, self.candidate, self.best) = (0, None, None);
    }

    /// The response, once there was enough motion.
    pub(super) fn best(&self) -> Option<&FittedResponse> {
        self.best.as_ref()
    }

    fn fade(&mut self, keep: f64) {
        self.weight *= keep;
        self.sums.iter_mut().for_each(|sums| sums.scale(keep));
    }

    /// One grid step of `measured` and `commanded` joints \[rad\], with weight `motion`.
    pub(super) fn add(&mut self, measured: &[f64; J], commanded: &[f64; J], motion: f64) {
        if self.filters.is_none() {
            // An arm that stands still, as after arming, is what the band begins with.
            let stands = measured.iter().zip(commanded).all(|(m, c)| (m - c).abs() <= STANDS_RAD);
            self.age = if stands && motion <= STANDS { SETTLING + HISTORY } else { 0 };
            (self.commanded, self.measured) = ([[0.0; J]; HISTORY], [[0.0; J]; STENCIL]);
        }
        let start = || [Band::at_rest(commanded), Band::at_rest(measured)];
        let [command_band, joint_band] = self.filters.get_or_insert_with(start);
        push(&mut self.commanded, command_band.pass(commanded));
        push(&mut self.measured, joint_band.pass(measured));
        self.age = self.age.saturating_add(1);
        if self.age <= SETTLING + HISTORY {
            return;
        }
        self.fade(1.0 - motion * GRID_S / MEMORY_S);
        self.weight += motion;
        let [m0, m1, m2, m3, m4] = &self.measured;
        let joints = m0.iter().zip(m1).zip(m2).zip(m3).zip(m4).zip(&mut self.sums).enumerate();
        for (j, (((((m0, m1), m2), m3), m4), sums)) in joints {
            let (d1, d2) = ((8.0 * (m1 - m3) - (m0 - m4)) / 12.0, m1 - 2.0 * m2 + m3);
            let [g11, g12, g22] = &mut sums.gram;
            *g11 += motion * d1 * d1;
            *g12 += motion * d1 * d2;
            *g22 += motion * d2 * d2;
            let delayed = self.commanded.iter().skip(STENCIL / 2).step_by(DELAY_STEPS);
            for ([b1, b2, square], commanded) in sums.fits.iter_mut().zip(delayed) {
                let y = commanded.get(j).copied().unwrap_or_default() - m2;
                *b1 += motion * d1 * y;
                *b2 += motion * d2 * y;
                *square += motion * y * y;
            }
        }
        self.sweep();
    }

    /// Solves the next delays of the sweep.
    fn sweep(&mut self) {
        if !(self.weight * GRID_S >= LEAST_MOTION_S) {
            return;
        }
        for _ in 0..PER_STEP {
            if self.next >= DELAYS {
                self.best = self.candidate.take().or(self.best);
                self.next = 0;
            }
            let found = self.cheapest(self.next);
            self.next += 1;
            if let Some(found) = found
                && self.candidate.as_ref().is_none_or(|best| found.cost < best.cost)
            {
                self.candidate = Some(found);
            }
        }
    }

    /// The cheapest set of joints at candidate delay `index`.
    fn cheapest(&self, index: usize) -> Option<FittedResponse> {
        let mut all = Equations::default();
        for sums in &self.sums {
            all.add(sums, index, 1.0);
        }
        let price = WORTH_RAD * WORTH_RAD * self.weight;
        let mut best: Option<(f64, [f64; 2], f64)> = None;
        let mut consider = |equations: &Equations, left_out: usize| {
            let Some((a, residual)) = equations.solve() else { return };
            let cost = residual + left_out as f64 * price;
            if best.is_none_or(|(least, ..)| cost < least) {
                let count = self.weight * J.saturating_sub(left_out).max(1) as f64;
                best = Some((cost, a, (residual / count).sqrt()));
            }
        };
        consider(&all, 0);
        for (first, sums) in self.sums.iter().enumerate() {
            let mut without_one = all;
            without_one.add(sums, index, -1.0);
            consider(&without_one, 1);
            for other in self.sums.get(first + 1..).unwrap_or_default() {
                let mut without_two = without_one;
                without_two.add(other, index, -1.0);
                consider(&without_two, 2);
            }
        }
        let (cost, [a1, a2], residual_rad) = best?;
        let shape = Delayed { delay: index * DELAY_STEPS, servo: SecondOrder::new(a1, a2) };
        Some(FittedResponse { shape, residual_rad, cost })
    }
}

/// Normal equations of a set of joints.
#[derive(Debug, Clone, Copy, Default)]
struct Equations {
    gram: [f64; 3],
    fit: [f64; 3],
}

impl Equations {
    fn add(&mut self, sums: &JointSums, index: usize, sign: f64) {
        let fit = sums.fits.get(index).copied().unwrap_or_default();
        self.gram.iter_mut().zip(sums.gram).for_each(|(sum, one)| *sum += sign * one);
        self.fit.iter_mut().zip(fit).for_each(|(sum, one)| *sum += sign * one);
    }

    /// a₁ and a₂ of a servo that there can be, and Σ of the squared residuals.
    fn solve(&self) -> Option<([f64; 2], f64)> {
        let ([g11, g12, g22], [b1, b2, square]) = (self.gram, self.fit);
        let (d11, d22) = (g11 * (1.0 + RIDGE), g22 * (1.0 + RIDGE));
        let determinant = d11 * d22 - g12 * g12;
        if !(determinant > 0.0 && d11 > 0.0) {
            return None;
        }
        let (mut a1, mut a2) = ((d22 * b1 - g12 * b2) / determinant, (d11 * b2 - g12 * b1) / determinant);
        if !(a2 > 0.0) {
            (a1, a2) = (b1 / d11, 0.0);
        }
        a1 = a1.clamp(0.0, LONGEST);
        a2 = a2.min(LARGEST_SHARE * a1 * a1);
        let explained = 2.0 * (a1 * b1 + a2 * b2) - (a1 * a1 * g11 + 2.0 * a1 * a2 * g12 + a2 * a2 * g22);
        Some(([a1, a2], (square - explained).max(0.0)))
    }
}
