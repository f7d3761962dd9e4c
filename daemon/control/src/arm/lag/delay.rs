//! The group delay of an arm at low frequency: of a dead time, a servo filter, or both together.
//!
//! An all-pole model behind a candidate delay, over all joints: c(t − d) = m + a₁ṁ + a₂m̈ + a₃m⃛, c
//! commanded, m measured. A critically damped servo with a joint loop behind it is exactly such a filter, and
//! the error of a wrong d nearly is. −H'(0), the mean of the impulse response, is d + a₁ whatever the other
//! coefficients. Both signals pass the same band around 1.3 Hz, which removes offsets and noise and leaves
//! low frequencies, where every filter is a delay. Linear least squares with the caller's weights and
//! forgetting; the d with the smallest residual is used. Contract: no allocation, bounded work. Source:
//! equation-error method with state-variable filters (Young, "Parameter estimation for continuous-time
//! models", Automatica 17 (1981), 23-39).

use crate::state::state;
use nalgebra::{Matrix3, Vector3};

use crate::arm::band::{Band, STAGES, push};
use crate::arm::track::GRID_S;

/// Grid steps of the difference and of each running sum of the band.
const LENGTH: usize = 20;
/// Settling time of the band filter, from unknown initial values \[grid steps\].
const SETTLING: usize = STAGES * LENGTH;
/// Candidate delays: 0, 20, ... 200 ms.
const DELAYS: usize = 11;
/// Grid steps between them.
const DELAY_STEPS: usize = 2;
/// Samples of the commands needed for the middle of the stencil.
const STENCIL: usize = 5;
/// Independent residuals per second of motion and joint: twice the bandwidth; a few joints move together.
const HISTORY: usize = STENCIL / 2 + (DELAYS - 1) * DELAY_STEPS + 1;
/// Independent residuals per second of motion: twice the width of the band, on every joint; a few move
/// together.
const INDEPENDENT_HZ: f64 = 24.0;
/// Relative ridge that keeps the normal equations regular when the motion has a single frequency.
const RIDGE: f64 = 1e-5;

/// Group delay and its standard deviation \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GroupDelay {
    pub(super) delay_s: f64,
    pub(super) std_s: f64,
}

/// Filters of the current stretch, and sums over recent motion.
#[derive(Debug, Clone)]
pub(super) struct DelayFit<const J: usize> {
    filters: Option<[Band<J, LENGTH>; 2]>,
    /// Instants since the filters began.
    age: usize,
    /// Newest first, one per grid step.
    commanded: [[f64; J]; HISTORY],
    measured: [[f64; J]; STENCIL],
    weight: f64,
    gram: Matrix3<f64>,
    fits: [DelayMoments; DELAYS],
}

state! { [const J: usize] DelayFit<J> { filters, age, commanded, measured, weight, gram, fits } }

/// One candidate delay: Σ φ y and Σ y², y = c − m.
#[derive(Debug, Clone, Copy)]
struct DelayMoments {
    moment: Vector3<f64>,
    square: f64,
}

state! { [] DelayMoments { moment, square } }

impl<const J: usize> DelayFit<J> {
    pub(super) fn new() -> Self {
        Self {
            filters: None,
            age: 0,
            commanded: [[0.0; J]; HISTORY],
            measured: [[0.0; J]; STENCIL],
            weight: 0.0,
            gram: Matrix3::zeros(),
            fits: [DelayMoments { moment: Vector3::zeros(), square: 0.0 }; DELAYS],
        }
    }

    /// A gap: the next sample does not follow the last one.
    pub(super) fn restart(&mut self) {
        self.filters = None;
        self.age = 0;
    }

    /// Scales the evidence so far by `keep`.
    pub(super) fn fade(&mut self, keep: f64) {
        self.weight *= keep;
        self.gram *= keep;
        for fit in &mut self.fits {
            fit.moment *= keep;
            fit.square *= keep;
        }
    }

    /// Adds one sample with weight `weight`, after scaling the evidence so far by `keep`.
    pub(super) fn add(&mut self, measured: &[f64; J], commanded: &[f64; J], keep: f64, weight: f64) {
        let start = || [Band::at_rest(commanded), Band::at_rest(measured)];
        let [command_band, joint_band] = self.filters.get_or_insert_with(start);
        push(&mut self.commanded, command_band.pass(commanded));
        push(&mut self.measured, joint_band.pass(measured));
        self.age += 1;
        if self.age <= SETTLING + HISTORY {
            return;
        }
        self.fade(keep);
        self.weight += weight;
        let [m0, m1, m2, m3, m4] = &self.measured;
        let joints = m0.iter().zip(m1).zip(m2).zip(m3).zip(m4).enumerate();
        for (j, ((((m0, m1), m2), m3), m4)) in joints {
            // Central differences in grid steps: zero phase.
            let derivatives = Vector3::new(
                (8.0 * (m1 - m3) - (m0 - m4)) / 12.0,
                m1 - 2.0 * m2 + m3,
                0.5 * (m0 - m4) - (m1 - m3),
            );
            let weighted = weight * derivatives;
            self.gram += weighted * derivatives.transpose();
            let delayed = self.commanded.iter().skip(STENCIL / 2).step_by(DELAY_STEPS);
            for (fit, commanded) in self.fits.iter_mut().zip(delayed) {
                let y = commanded.get(j).copied().unwrap_or_default() - m2;
                fit.moment += weighted * y;
                fit.square += weight * y * y;
            }
        }
    }

    /// The group delay; `None` without motion.
    pub(super) fn best(&self) -> Option<GroupDelay> {
        let mut gram = self.gram;
        gram.set_diagonal(&(gram.diagonal() * (1.0 + RIDGE)));
        let inverse = gram.cholesky()?.inverse();
        let residual = |fit: &DelayMoments| (fit.square - fit.moment.dot(&(inverse * fit.moment))).max(0.0);
        let (index, fit) =
            self.fits.iter().enumerate().min_by(|a, b| residual(a.1).total_cmp(&residual(b.1)))?;
        let delay = (index * DELAY_STEPS) as f64 + (inverse * fit.moment).x;
        let count = (self.weight * GRID_S * INDEPENDENT_HZ).max(1.0);
        let variance = residual(fit) * inverse.m11 / count;
        Some(GroupDelay { delay_s: delay * GRID_S, std_s: variance.max(0.0).sqrt() * GRID_S })
    }
}
