//! One axis, one tick: constant gains, else the exact active set, else a status.
//!
//! The certificate uses only the model's sweeps, bounds and weights, no condensed matrix, so it also judges
//! those.

use super::behind::ArmState;
use super::cost::{Cost, Weights};
use super::limits::{Influence, inside};
use super::model::{AxisVector, MotionRows, rollout};
use super::plan::{ActiveLimits, AxisReport, SolvePath};
use crate::qp::dual::{Bounds, DualActiveSet, Termination};
use crate::qp::{KKT_TOLERANCE, QpStatus};

/// Distance beyond a row's limit \[normalised units\] that the active set leaves standing.
const FEASIBILITY: f64 = 1e-11;

/// Above this residual an iterative refinement is tried; it costs about as much as one more active row.
const REFINE_ABOVE: f64 = KKT_TOLERANCE * 0.03;

/// Most refinements. One is nearly always enough; a multiplier that changes sign takes another.
const REFINEMENTS: u32 = 4;

/// ½J of one axis at one tick, in normalised units with positions counted from the start.
pub(super) struct AxisProblem<'a, const N: usize> {
    pub cost: &'a Cost<N>,
    pub bounds: &'a Bounds<4, N>,
    pub start: AxisVector,
    /// The arm, positions counted from the same origin; read where the cost is that of the arm behind a
    /// servo.
    pub arm: ArmState<f64>,
    /// (1−α)G_c² x_c + αG_f² g.
    pub pull: Weights<N>,
}

impl<const N: usize> AxisProblem<'_, N> {
    /// Linear term q = ∇½J at zero jerk, and its size, which the residuals are relative to: 1 + max |q|.
    /// `None` if any input is non-finite.
    #[inline]
    pub(super) fn linear_term(&self) -> Option<([f64; N], f64)> {
        let linear = self.gradient(&rollout(&self.start, &[0.0; N]), &[[0.0; N]; 4]);
        // A sum propagates a NaN, which a maximum drops.
        let size = linear.iter().map(|entry| entry.abs()).sum::<f64>();
        (size < f64::INFINITY).then(|| (linear, 1.0 + largest(&linear)))
    }

    /// ∇½J at `motion` plus C̃ᵀ `multipliers`.
    #[inline]
    pub(super) fn gradient(&self, motion: &MotionRows<N>, multipliers: &MotionRows<N>) -> [f64; N] {
        self.cost.gradient((&self.start, self.arm), motion, &self.pull, multipliers)
    }

    /// The optimum by constant gains or by the active set, with its certificate.
    #[inline]
    pub(super) fn solve(
        &self,
        set: &mut DualActiveSet<4, N, N>,
        max_iterations: u32,
    ) -> ([f64; N], AxisReport) {
        let Some((linear, scale)) = self.linear_term() else {
            return ([0.0; N], AxisReport::failed(QpStatus::NotFinite, 0));
        };
        let mut jerks = self.cost.solve(&linear).map(|entry| -entry);
        let mut motion = rollout(&self.start, &jerks);
        for attempt in 0..=REFINEMENTS {
            if !inside(&motion, self.bounds) {
                return self.constrained(set, max_iterations, motion, scale);
            }
            let gradient = self.gradient(&motion, &[[0.0; N]; 4]);
            let kkt_residual = largest(&gradient) / scale;
            if kkt_residual <= REFINE_ABOVE || attempt == REFINEMENTS {
                let status =
                    if kkt_residual <= KKT_TOLERANCE { QpStatus::Optimal } else { QpStatus::Uncertified };
                let path = if status.usable() { SolvePath::Gain } else { SolvePath::Failed };
                return (jerks, AxisReport { path, status, kkt_residual, ..AxisReport::default() });
            }
            for (jerk, correction) in jerks.iter_mut().zip(self.cost.solve(&gradient)) {
                *jerk -= correction;
            }
            motion = rollout(&self.start, &jerks);
        }
        (jerks, AxisReport::failed(QpStatus::Uncertified, 0))
    }

    /// The active set from the unconstrained optimum `motion`.
    pub(super) fn constrained(
        &self,
        set: &mut DualActiveSet<4, N, N>,
        max_iterations: u32,
        mut motion: MotionRows<N>,
        scale: f64,
    ) -> ([f64; N], AxisReport) {
        let influence = Influence(self.cost);
        let (termination, iterations) =
            set.solve(&influence, self.bounds, FEASIBILITY, max_iterations, &mut motion);
        let [mut jerks, ..] = motion;
        match termination {
            Termination::Optimal => {}
            Termination::IterationCap => {
                return (jerks, AxisReport::failed(QpStatus::IterationCap, iterations));
            }
            Termination::Infeasible => return (jerks, AxisReport::failed(QpStatus::Infeasible, iterations)),
        }
        let mut kkt_residual = f64::NAN;
        for attempt in 0..=REFINEMENTS {
            self.pin(&mut jerks, set);
            motion = rollout(&self.start, &jerks);
            let gradient = self.gradient(&motion, set.multipliers());
            kkt_residual = self.residual(&motion, set.multipliers(), &gradient, scale);
            if kkt_residual <= REFINE_ABOVE || attempt == REFINEMENTS {
                break;
            }
            self.refine(&mut jerks, &motion, &gradient, set);
        }
        let status = if kkt_residual <= KKT_TOLERANCE { QpStatus::Optimal } else { QpStatus::Uncertified };
        let path = if status.usable() { SolvePath::ActiveSet } else { SolvePath::Failed };
        let active = self.count(set.multipliers());
        (jerks, AxisReport { path, status, iterations, active, kkt_residual })
    }

    /// Jerks exactly inside their hard limits, those held exactly on them.
    #[inline]
    pub(super) fn pin(&self, jerks: &mut [f64; N], set: &DualActiveSet<4, N, N>) {
        let ([lower, ..], [upper, ..], [multipliers, ..]) =
            (&self.bounds.lower, &self.bounds.upper, set.multipliers());
        let limits = lower.iter().zip(upper).zip(multipliers);
        for (jerk, ((lower, upper), multiplier)) in jerks.iter_mut().zip(limits) {
            *jerk = if *multiplier > 0.0 {
                *upper
            } else if *multiplier < 0.0 {
                *lower
            } else {
                jerk.max(*lower).min(*upper)
            };
        }
    }

    /// One Newton step on the optimality conditions of the active set, from residuals computed afresh.
    fn refine(
        &self,
        jerks: &mut [f64; N],
        motion: &MotionRows<N>,
        gradient: &[f64; N],
        set: &mut DualActiveSet<4, N, N>,
    ) {
        let step = self.cost.solve(gradient).map(|entry| -entry);
        let moved = rollout(&[0.0; 3], &step);
        let mut excess = [0.0; N];
        for (entry, (row, side)) in excess.iter_mut().zip(set.active()) {
            let bounds = if side > 0.0 { &self.bounds.upper } else { &self.bounds.lower };
            let at = |rows: &MotionRows<N>| rows.as_flattened().get(row).copied().unwrap_or(0.0);
            *entry = at(motion) + at(&moved) - at(bounds);
        }
        let [correction, ..] = set.correct(&excess, self.bounds);
        for (jerk, (step, correction)) in jerks.iter_mut().zip(step.iter().zip(correction)) {
            *jerk += step - correction;
        }
    }

    /// The full KKT residual at a point: stationarity relative to `scale` plus the largest multiplier; row
    /// values against what their multipliers require, relative to 1 + their size; multipliers against \[−ρ,
    /// ρ\].
    #[inline]
    pub(super) fn residual(
        &self,
        motion: &MotionRows<N>,
        multipliers: &MotionRows<N>,
        gradient: &[f64; N],
        scale: f64,
    ) -> f64 {
        let forces = largest(multipliers.as_flattened());
        let stationarity = largest(gradient) / (scale + forces);
        let mut worst = 0.0_f64;
        // Sums propagate a NaN that a maximum would drop.
        let mut sum = stationarity;
        let limits = self.bounds.lower.as_flattened().iter().zip(self.bounds.upper.as_flattened());
        let prices = self.bounds.penalty.as_flattened().iter().zip(multipliers.as_flattened());
        for ((r, (lower, upper)), (penalty, z)) in motion.as_flattened().iter().zip(limits).zip(prices) {
            sum += r;
            let (above, below) = (r - upper, lower - r);
            let off = if *z != 0.0 {
                // Positive towards the inside: an active row is on its bound, a saturated one on or beyond
                // it.
                let short = if *z > 0.0 { -above } else { -below };
                let excess = (z.abs() - penalty) / (scale + forces);
                worst = worst.max(excess);
                if z.abs() < *penalty { short.abs() } else { short.max(0.0) }
            } else if above > 0.0 {
                above
            } else if below > 0.0 {
                below
            } else {
                continue;
            };
            worst = worst.max(off / (1.0 + r.abs()));
        }
        if sum.is_finite() { worst.max(stationarity) } else { f64::NAN }
    }

    /// Rows with a multiplier, by kind.
    pub(super) fn count(&self, multipliers: &MotionRows<N>) -> ActiveLimits {
        let mut saturated = 0;
        let mut held = [0_u8; 4];
        for ((kind, row), prices) in held.iter_mut().zip(multipliers).zip(&self.bounds.penalty) {
            for (z, penalty) in row.iter().zip(prices) {
                if z.abs() >= *penalty {
                    saturated += 1;
                } else if *z != 0.0 {
                    *kind += 1;
                }
            }
        }
        let [jerk, acceleration, velocity, position] = held;
        ActiveLimits { jerk, acceleration, velocity, position, saturated }
    }
}

/// Largest absolute entry; NaN if any is.
#[inline]
fn largest(entries: &[f64]) -> f64 {
    let (fours, rest) = entries.as_chunks::<4>();
    let mut worst = [0.0_f64; 4];
    let mut sums = [0.0; 4];
    for four in fours {
        for ((worst, sum), entry) in worst.iter_mut().zip(&mut sums).zip(four) {
            let size = entry.abs();
            *worst = if size > *worst { size } else { *worst };
            *sum += size;
        }
    }
    let (mut most, mut sum) = (0.0, sums.iter().sum::<f64>());
    for size in worst.iter().copied().chain(rest.iter().map(|entry| entry.abs())) {
        most = if size > most { size } else { most };
        sum += size;
    }
    // The sum carries a NaN that the comparisons have dropped.
    if sum.is_nan() { sum } else { most }
}
