//! Settings of the MPC and the bounds they must keep.

use thiserror::Error;

use super::cost::Gains;
use super::limits::{AxisLimits, SoftPenalty};
use crate::qp::backend::Backend;

/// Everything the MPC needs to know before the first tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MpcSettings {
    /// Grid step Δ \[s\].
    pub step_s: f64,
    /// Group delay of the arm's servo, a critically damped filter of second order, behind which errors count
    /// \[s\]; 0: the arm is where the command is.
    pub servo_s: f64,
    /// G_c of feedback, per axis.
    pub gains_feedback: [Gains; 3],
    /// G_f of feedforward, per axis.
    pub gains_feedforward: [Gains; 3],
    /// β \[1/(mm/Δ³)²\].
    pub effort: f64,
    /// Limits per axis of the writing plane's frame.
    pub axes: [AxisLimits; 3],
    /// Switches off the limits on jerk, acceleration and velocity, not the workspace: for experiments with
    /// arms without limits.
    pub unlimited: bool,
    /// Penalties on the soft limits.
    pub soft_penalty: SoftPenalty,
    /// Solver of the plan's QP.
    pub backend: Backend,
    /// Ceiling on the solver's steps per axis and plan; a tick's budget may be smaller.
    pub max_iterations: u32,
}

/// A setting outside its legal range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum MpcError {
    /// Δ out of range.
    #[error("MPC step is {value_s} s, must be within [0.001, 0.1] s")]
    Step {
        /// As given \[s\].
        value_s: f64,
    },
    /// The servo's group delay out of range.
    #[error("MPC servo delay is {value_s} s, must be 0 or within [0.001, 1] s")]
    Servo {
        /// As given \[s\].
        value_s: f64,
    },
    /// β out of range.
    #[error("MPC effort weight is {value}, must be within [1e-9, 1e9]")]
    Effort {
        /// The refused value, as it was given.
        value: f64,
    },
    /// A gain out of range.
    #[error("MPC {kind} gain on {quantity} of axis {axis} is {value}, must be within [0, 1000]")]
    Gain {
        /// `feedback` or `feedforward`.
        kind: &'static str,
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// `position`, `velocity` or `acceleration`.
        quantity: &'static str,
        /// The refused value, as it was given.
        value: f64,
    },
    /// A decay out of range.
    #[error("MPC {kind} decay of axis {axis} is {value}, must be within [0.01, 1]")]
    Decay {
        /// `feedback` or `feedforward`.
        kind: &'static str,
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// The refused value, as it was given.
        value: f64,
    },
    /// A symmetric limit out of range.
    #[error(
        "MPC {quantity} limit of axis {axis} is {value} {unit}, must be within [{lowest}, {highest}] {unit}"
    )]
    Limit {
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// `jerk`, `acceleration` or `velocity`.
        quantity: &'static str,
        /// The refused value, as it was given.
        value: f64,
        /// Smallest value that is legal, itself included.
        lowest: f64,
        /// Largest value that is legal, itself included.
        highest: f64,
        /// Unit of all three.
        unit: &'static str,
    },
    /// The workspace is empty or too far away.
    #[error(
        "MPC workspace of axis {axis} is [{lower_m}, {upper_m}] m, must lie within [-10, 10] m and be at \
         least 0.001 m wide"
    )]
    Workspace {
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// As given \[m\].
        lower_m: f64,
        /// As given \[m\].
        upper_m: f64,
    },
    /// A penalty out of range.
    #[error("MPC penalty on {quantity} is {value}, must be within [1, 1e9]")]
    Penalty {
        /// `acceleration`, `velocity` or `position`.
        quantity: &'static str,
        /// The refused value, as it was given.
        value: f64,
    },
    /// No step allowed.
    #[error("MPC iteration cap is {value}, must be within [1, 10000]")]
    Iterations {
        /// The refused value, as it was given.
        value: u32,
    },
    /// Gains and effort are too far apart for double precision.
    #[error(
        "MPC cost of axis {axis} is singular to working precision: raise the effort weight or lower the gains"
    )]
    Singular {
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
    },
    /// The plan's horizon is too short for its gains.
    #[error(
        "MPC does not settle: at trust {alpha} a small deviation of axis {axis} becomes {per_s:.1e} times as \
         large every second; raise the gains on velocity, or look farther ahead: more steps, longer ones, \
         decay nearer to 1, less effort"
    )]
    Swings {
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// Trust α at which it happens.
        alpha: f64,
        /// Growth per second; 1: does not decay.
        per_s: f64,
    },
    /// Another solver refused the problem.
    #[error("{solver} could not be set up for axis {axis}: use the exact backend")]
    Solver {
        /// Name of the solver that refused.
        solver: &'static str,
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
    },
}

impl MpcSettings {
    /// The limits in force: infinite on jerk, acceleration and velocity where those are off.
    #[must_use]
    pub fn limits(&self) -> [AxisLimits; 3] {
        let off = f64::INFINITY;
        let held = |axis: AxisLimits| {
            if self.unlimited {
                AxisLimits { jerk_mps3: off, acceleration_mps2: off, velocity_mps: off, ..axis }
            } else {
                axis
            }
        };
        self.axes.map(held)
    }

    /// The point of the workspace nearest to `[x, y]` \[m\].
    #[must_use]
    pub fn inside(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let nearest = |value: f64, [low, high]: [f64; 2]| value.max(low).min(high);
        let [along_x, along_y, _] = self.axes.map(|axis| axis.position_m);
        [nearest(x, along_x), nearest(y, along_y)]
    }

    /// Check every bound; NaN is outside every range.
    ///
    /// # Errors
    /// The first bound broken.
    pub fn validate(&self) -> Result<(), MpcError> {
        if !within(self.step_s, 1e-3, 0.1) {
            return Err(MpcError::Step { value_s: self.step_s });
        }
        if !(self.servo_s == 0.0 || within(self.servo_s, 1e-3, 1.0)) {
            return Err(MpcError::Servo { value_s: self.servo_s });
        }
        if !within(self.effort, 1e-9, 1e9) {
            return Err(MpcError::Effort { value: self.effort });
        }
        for (kind, axes) in [("feedback", &self.gains_feedback), ("feedforward", &self.gains_feedforward)] {
            for (axis, gains) in axes.iter().enumerate() {
                validate_gains(kind, axis, gains)?;
            }
        }
        for (axis, limits) in self.axes.iter().enumerate() {
            validate_limits(axis, limits)?;
        }
        let penalty = &self.soft_penalty;
        for (quantity, value) in [
            ("acceleration", penalty.acceleration),
            ("velocity", penalty.velocity),
            ("position", penalty.position),
        ] {
            if !within(value, 1.0, 1e9) {
                return Err(MpcError::Penalty { quantity, value });
            }
        }
        if self.max_iterations == 0 || self.max_iterations > 10_000 {
            return Err(MpcError::Iterations { value: self.max_iterations });
        }
        Ok(())
    }
}

fn validate_gains(kind: &'static str, axis: usize, gains: &Gains) -> Result<(), MpcError> {
    for (quantity, value) in
        [("position", gains.position), ("velocity", gains.velocity), ("acceleration", gains.acceleration)]
    {
        if !within(value, 0.0, 1e3) {
            return Err(MpcError::Gain { kind, axis, quantity, value });
        }
    }
    if !within(gains.decay, 0.01, 1.0) {
        return Err(MpcError::Decay { kind, axis, value: gains.decay });
    }
    Ok(())
}

fn validate_limits(axis: usize, limits: &AxisLimits) -> Result<(), MpcError> {
    for (quantity, value, lowest, highest, unit) in [
        ("jerk", limits.jerk_mps3, 1.0, 1e5, "m/s³"),
        ("acceleration", limits.acceleration_mps2, 0.01, 1e3, "m/s²"),
        ("velocity", limits.velocity_mps, 0.001, 20.0, "m/s"),
    ] {
        if !within(value, lowest, highest) {
            return Err(MpcError::Limit { axis, quantity, value, lowest, highest, unit });
        }
    }
    let [lower_m, upper_m] = limits.position_m;
    if !(within(lower_m, -10.0, 10.0) && within(upper_m, -10.0, 10.0) && upper_m - lower_m >= 1e-3) {
        return Err(MpcError::Workspace { axis, lower_m, upper_m });
    }
    Ok(())
}

fn within(value: f64, lowest: f64, highest: f64) -> bool {
    value >= lowest && value <= highest
}
