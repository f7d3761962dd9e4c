//! Least squares for the delay, and the filter behind it, that turn the commanded path into the measured one.
//!
//! Contract: residuals over all joints that move, a constant offset per joint taken out (calibration,
//! gravity); gain 1. Levenberg-Marquardt within bounds, from several starts, because a filter and a delay
//! look alike at first.

use nalgebra::{DMatrix, DVector};

use super::Sample;
use super::response::CommandGrid;

/// Range of lags \[s\]; wrong stamps can make the arm seem early.
pub(super) const SHIFTS_S: (f64, f64) = (-0.05, 0.4);
/// Spacing of the first search \[s\].
const SCAN_S: f64 = 0.002;
/// Bounds of delay, filter and joint loop \[s\].
const BOUNDS_S: [(f64, f64); 3] = [SHIFTS_S, (0.0, 0.4), (0.0, 0.1)];
/// Where the search for a filter begins \[s\].
const FILTER_STARTS_S: [f64; 4] = [0.004, 0.02, 0.06, 0.15];
const ITERATIONS: usize = 40;
/// Step of the numeric derivatives \[s\].
const STEP_S: f64 = 0.25e-3;

/// Commands and the joint states to be explained.
#[derive(Debug)]
pub(super) struct LagProblem<'a> {
    pub(super) path: CommandGrid,
    pub(super) states: &'a [Sample],
    pub(super) joints: &'a [usize],
}

/// \[delay, filter, joint loop\] in seconds, and the root of the mean squared residual \[rad\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ServoFit {
    pub(super) p: [f64; 3],
    pub(super) rms: f64,
}

impl LagProblem<'_> {
    /// (shift \[s\], RMS of the residual \[rad\]) over the whole range.
    pub(super) fn curve(&self) -> Vec<(f64, f64)> {
        let count = ((SHIFTS_S.1 - SHIFTS_S.0) / SCAN_S).round() as usize;
        let shift = |index: usize| SHIFTS_S.0 + index as f64 * SCAN_S;
        (0..=count).map(shift).map(|s| (s, rms(&self.residuals(&self.path, s)))).collect()
    }

    /// The best pure delay.
    pub(super) fn shift(&self, curve: &[(f64, f64)]) -> ServoFit {
        let best = curve.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |best| best.0);
        self.refined([best, 0.0, 0.0], &[0])
    }

    /// The best delay and filter, from a good pure delay.
    pub(super) fn filter(&self, shift_s: f64) -> ServoFit {
        let fits = FILTER_STARTS_S.iter().map(|filter_s| {
            let delay_s = (shift_s - filter_s).max(BOUNDS_S[0].0);
            self.refined([delay_s, *filter_s, 0.0], &[0, 1])
        });
        fits.min_by(|a, b| a.rms.total_cmp(&b.rms))
            .unwrap_or(ServoFit { p: [shift_s, 0.0, 0.0], rms: f64::MAX })
    }

    /// The best of all three, from the best of two.
    pub(super) fn joint_loop(&self, filter: ServoFit) -> ServoFit {
        let [delay_s, filter_s, _] = filter.p;
        self.refined([(delay_s - STEP_S).max(BOUNDS_S[0].0), filter_s, STEP_S], &[0, 1, 2])
    }

    /// Improves the parameters in `free`; the others stay.
    pub(super) fn refined(&self, start: [f64; 3], free: &[usize]) -> ServoFit {
        let mut at = start;
        let mut damping = 1e-3;
        let mut residuals = self.at(at);
        let mut cost = residuals.norm_squared();
        for _ in 0..ITERATIONS {
            let jacobian = self.jacobian(at, free);
            let normal = jacobian.transpose() * &jacobian;
            let gradient = jacobian.transpose() * &residuals;
            let mut moved = 0.0_f64;
            // The damping grows until the step makes it better.
            for _ in 0..12 {
                let mut damped = normal.clone();
                for (index, row) in normal.diagonal().iter().enumerate() {
                    damped[(index, index)] = row * (1.0 + damping) + f64::MIN_POSITIVE;
                }
                let Some(step) = damped.lu().solve(&gradient) else { break };
                let mut next = at;
                for (parameter, step) in free.iter().zip(step.iter()) {
                    let (low, high) = BOUNDS_S[*parameter];
                    next[*parameter] = (at[*parameter] - step).clamp(low, high);
                }
                let tried = self.at(next);
                if tried.norm_squared() < cost {
                    moved = free.iter().map(|p| (next[*p] - at[*p]).abs()).fold(0.0, f64::max);
                    (at, cost, residuals) = (next, tried.norm_squared(), tried);
                    damping = (damping * 0.2).max(1e-9);
                    break;
                }
                damping *= 5.0;
            }
            if moved < 1e-7 {
                break;
            }
        }
        ServoFit { p: at, rms: rms(&residuals) }
    }

    /// Measured minus modelled \[rad\], joint by joint, without each joint's mean.
    pub(super) fn residuals(&self, path: &CommandGrid, delay_s: f64) -> DVector<f64> {
        let count = self.states.len();
        let mut out = DVector::zeros(count * self.joints.len());
        for (block, joint) in self.joints.iter().enumerate() {
            let mut rows = out.rows_mut(block * count, count);
            for (row, state) in rows.iter_mut().zip(self.states) {
                *row = state.q[*joint] - path.at(*joint, state.t_s - delay_s);
            }
            let mean = rows.mean();
            rows.add_scalar_mut(-mean);
        }
        out
    }

    fn at(&self, p: [f64; 3]) -> DVector<f64> {
        let [delay_s, filter_s, loop_s] = p;
        if filter_s > 0.0 || loop_s > 0.0 {
            self.residuals(&self.path.filtered(filter_s, loop_s), delay_s)
        } else {
            self.residuals(&self.path, delay_s)
        }
    }

    fn jacobian(&self, p: [f64; 3], free: &[usize]) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = free
            .iter()
            .map(|parameter| {
                let (low, high) = BOUNDS_S[*parameter];
                let moved = |by: f64| {
                    let mut q = p;
                    q[*parameter] = (p[*parameter] + by).clamp(low, high);
                    (q[*parameter], self.at(q))
                };
                let ((a, before), (b, after)) = (moved(-STEP_S), moved(STEP_S));
                (after - before) / (b - a)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

pub(super) fn rms(residuals: &DVector<f64>) -> f64 {
    (residuals.norm_squared() / residuals.len().max(1) as f64).sqrt()
}
