//! Output of the MPC: the plan, and how it was found.

use crate::qp::QpStatus;
use crate::state::{choices, state};
use crate::units::AxisState;

/// N jerks per axis and the states they lead to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan<const N: usize> {
    /// Δ \[s\].
    pub step_s: f64,
    /// State at the plan's beginning, per axis.
    pub start: [AxisState; 3],
    /// Jerk over step j = 0..N−1 \[m/s³\], per axis (3 x N).
    pub jerks: [[f64; N]; 3],
}

state! { [const N: usize] Plan<N> { step_s, start, jerks } }

impl<const N: usize> Plan<N> {
    /// No motion: at rest at the origin for N steps.
    #[must_use]
    pub const fn resting(step_s: f64) -> Self {
        Self { step_s, start: [AxisState::at_rest(0.0); 3], jerks: [[0.0; N]; 3] }
    }

    /// Time the plan covers \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.step_s * N as f64
    }

    /// The planned state `elapsed_s` after the plan's start. `None` before it, beyond the horizon, or for
    /// NaN.
    #[must_use]
    pub fn state_at(&self, elapsed_s: f64) -> Option<[AxisState; 3]> {
        if !(elapsed_s >= 0.0 && elapsed_s <= self.duration_s()) {
            return None;
        }
        let mut states = self.start;
        for (state, jerks) in states.iter_mut().zip(&self.jerks) {
            let mut left = elapsed_s;
            for jerk in jerks {
                let spent = left.min(self.step_s);
                *state = state.advanced(*jerk, spent);
                left -= spent;
            }
            // Rounding beyond the last step belongs to it.
            *state = state.advanced(jerks.last().copied().unwrap_or(0.0), left);
        }
        Some(states)
    }
}

/// Which method gave an axis' jerks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolvePath {
    /// Constant gains: the unconstrained optimum keeps every limit.
    Gain,
    /// The exact dual active set.
    ActiveSet,
    /// Solved by the interior-point backend.
    Other,
    /// There is no usable solution.
    #[default]
    Failed,
}

choices! { SolvePath { Gain, ActiveSet, Other, Failed } }

/// Rows that shape an axis' plan, by kind, over the whole horizon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ActiveLimits {
    /// Steps at the jerk limit.
    pub jerk: u8,
    /// Steps held at the acceleration limit.
    pub acceleration: u8,
    /// Steps held at the velocity limit.
    pub velocity: u8,
    /// Steps held at the edge of the workspace.
    pub position: u8,
    /// Soft rows beyond their limit, of any kind.
    pub saturated: u8,
}

state! { [] ActiveLimits { jerk, acceleration, velocity, position, saturated } }

impl ActiveLimits {
    /// All rows with a multiplier.
    #[must_use]
    pub const fn total(self) -> u32 {
        self.jerk as u32
            + self.acceleration as u32
            + self.velocity as u32
            + self.position as u32
            + self.saturated as u32
    }
}

/// How one axis was solved.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxisReport {
    /// Which method found the solution.
    pub path: SolvePath,
    /// Whether the jerks may be used.
    pub status: QpStatus,
    /// Steps of the active set or of the interior-point method.
    pub iterations: u32,
    /// Limits that shape the plan.
    pub active: ActiveLimits,
    /// Largest violation of the optimality conditions; see [`crate::mpc`] for its units.
    pub kkt_residual: f64,
}

state! { [] AxisReport { path, status, iterations, active, kkt_residual } }

impl AxisReport {
    /// No usable solution, after `iterations` steps.
    pub(super) fn failed(status: QpStatus, iterations: u32) -> Self {
        Self { status, iterations, kkt_residual: f64::NAN, ..Self::default() }
    }
}

/// How a plan was found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlanReport {
    /// Per axis of the writing plane's frame.
    pub axes: [AxisReport; 3],
}

impl PlanReport {
    /// All three axes may be used: the plan was written.
    #[must_use]
    pub fn usable(&self) -> bool {
        self.axes.iter().all(|axis| axis.status.usable())
    }

    /// Active-set or interior-point steps over all axes.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        self.axes.iter().map(|axis| axis.iterations).sum()
    }

    /// Rows with a multiplier over all axes.
    #[must_use]
    pub fn active(&self) -> u32 {
        self.axes.iter().map(|axis| axis.active.total()).sum()
    }

    /// The largest residual; NaN if any is.
    #[must_use]
    pub fn kkt_residual(&self) -> f64 {
        // f64::max would drop a NaN.
        let residuals = self.axes.iter().map(|axis| axis.kkt_residual);
        residuals
            .fold(0.0, |worst, residual| if residual <= worst || worst.is_nan() { worst } else { residual })
    }
}
