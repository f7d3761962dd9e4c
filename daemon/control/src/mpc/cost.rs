//! The objective of one axis: weights per quantity and step, its Hessian, its gradient.
//!
//! ½J = ½(1−α)‖G_c(x_c − x̃)‖² + ½α‖G_f(g − x̃)‖² + ½β‖ũ‖². H depends on α only, and not even on that when
//! G_c = G_f; it is factored again only when α has changed. The linear term needs no gain matrix: q = B̃ᵀ(…)
//! is one backward sweep, cheaper than a dense N x 3N product.

use super::behind::{ArmState, Behind};
use super::condense::Condensed;
use super::model::{AxisVector, MotionRows, adjoint};
use crate::qp::cholesky::{Cholesky, Square};
use crate::state::state;
use crate::units::Trust;

/// Diagonal of G_c or G_f: what an error costs. The step i = 1..N weighs gain · decay^(i−1).
///
/// Units are normalised (mm and steps of Δ): with velocity gain 1 an error of 1 mm per step costs as much as
/// 1 mm of position error at gain 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// \[1/mm\], ≥ 0
    pub position: f64,
    /// \[1/(mm/Δ)\], ≥ 0
    pub velocity: f64,
    /// \[1/(mm/Δ²)\], ≥ 0
    pub acceleration: f64,
    /// Factor from one step to the next, in (0, 1]: later predictions weigh less.
    pub decay: f64,
}

impl Gains {
    /// G_c for plans in steps of 10 ms. A velocity gain as large as the position gain damps the approach to a
    /// held pen: overshoot 2 % for a 1 mm step, 0.5 % for a 10 mm step, settling time 70 ms. Twice the
    /// velocity gain costs 20 % more lag behind a moving pen. Acceleration is left to the effort weight.
    pub const FEEDBACK: Self = Self { position: 1.0, velocity: 1.0, acceleration: 0.0, decay: 1.0 };

    /// G_f for plans in steps of 10 ms. Position dominates, since a reader sees it; some velocity gain keeps
    /// steps in the preview from causing jerk. A predicted acceleration is mostly noise and is not followed.
    /// The decay halves a weight within about four steps, because the error of predictions doubles with the
    /// lead.
    pub const FEEDFORWARD: Self = Self { position: 1.0, velocity: 0.3, acceleration: 0.0, decay: 0.85 };

    /// β for plans in steps of 10 ms: 30 mm letters follow a perfect preview within 0.007 mm RMS with 50 m/s³
    /// RMS, the letters' own jerk, and white noise of 0.05 mm in the preview adds 20 m/s³. A smaller weight
    /// adds jerk for no visible gain; a much larger one increases the error.
    pub const EFFORT: f64 = 0.05;
}

/// Largest deviation of H H⁻¹ from I: each refinement of a plan gains about that factor.
const INVERSION: f64 = 1e-4;

/// The objective of one axis at one trust.
#[derive(Debug, Clone)]
pub struct Cost<const N: usize> {
    gains: [Gains; 2],
    /// The servo behind which errors are counted; none: errors of the command.
    behind: Option<Behind>,
    /// Squared gains (acceleration, velocity, position) x N, feedback then feedforward.
    feedback: Weights<N>,
    feedforward: Weights<N>,
    hessian_feedback: Square<N>,
    hessian_feedforward: Square<N>,
    effort: f64,
    /// G_c = G_f: H is the same at every α.
    constant: bool,
    alpha: f64,
    /// (1−α) G_c², α G_f² and their sum.
    weights: [Weights<N>; 3],
    hessian: Square<N>,
    inverse: Square<N>,
}

state! {
    [const N: usize] Cost<N> { alpha, weights, hessian, inverse }
    fixed {
        gains, behind, feedback, feedforward, hessian_feedback, hessian_feedforward, effort, constant,
    }
}

/// Squared gains in the order of [`MotionRows`] without its jerk block.
pub type Weights<const N: usize> = [[f64; N]; 3];

impl<const N: usize> Cost<N> {
    /// Build the cost at α = 0, of the arm behind a servo or of the command itself. `effort` is β > 0
    /// \[1/(mm/Δ³)²\]. `None` when H is not positive definite to working precision at some α.
    #[must_use]
    pub fn new(
        condensed: &Condensed<N>,
        behind: Option<Behind>,
        feedback: &Gains,
        feedforward: &Gains,
        effort: f64,
    ) -> Option<Self> {
        let responses = behind.map_or(condensed.forced, |behind| behind.responses());
        let (weights_feedback, weights_feedforward) = (squared(feedback), squared(feedforward));
        let mut cost = Self {
            gains: [*feedback, *feedforward],
            behind,
            feedback: weights_feedback,
            feedforward: weights_feedforward,
            hessian_feedback: hessian(&responses, &weights_feedback),
            hessian_feedforward: hessian(&responses, &weights_feedforward),
            effort,
            constant: feedback == feedforward,
            alpha: f64::NAN,
            weights: [[[0.0; N]; 3]; 3],
            hessian: [[0.0; N]; N],
            inverse: [[0.0; N]; N],
        };
        // H is affine in α: positive definite at both ends means positive definite between.
        let sound = [1.0, 0.0].map(|alpha| cost.factor(alpha) && cost.inversion_error() <= INVERSION);
        (sound == [true, true]).then_some(cost)
    }

    /// Largest entry of H H⁻¹ − I.
    fn inversion_error(&self) -> f64 {
        let mut worst = 0.0_f64;
        for (i, row) in self.hessian.iter().enumerate() {
            for (j, column) in self.inverse.iter().enumerate() {
                let entry: f64 = row.iter().zip(column).map(|(a, b)| a * b).sum();
                worst = worst.max((entry - f64::from(u8::from(i == j))).abs());
            }
        }
        worst
    }

    /// Whether the objective is the same at every α.
    #[must_use]
    pub(super) fn same_gains(&self, other: &Self) -> bool {
        self.gains == other.gains && self.effort == other.effort
    }

    /// Take over what `other`, which has the same gains, computed for its α.
    pub(super) fn copy_blend(&mut self, other: &Self) {
        self.alpha = other.alpha;
        self.weights = other.weights;
        self.hessian = other.hessian;
        self.inverse = other.inverse;
    }

    /// Blend the weights for `trust`; factor H again if it depends on α and α has changed. `false` when that
    /// fails, which [`Cost::new`] has made impossible up to rounding.
    #[inline]
    pub fn set_trust(&mut self, trust: Trust) -> bool {
        let alpha = trust.alpha();
        if alpha == self.alpha {
            return true;
        }
        if self.constant {
            self.blend(alpha);
            return true;
        }
        self.factor(alpha)
    }

    /// Like [`Cost::set_trust`], but factors in any case: what the constant path must agree with.
    pub fn factor(&mut self, alpha: f64) -> bool {
        self.blend(alpha);
        let parts = self.hessian_feedback.as_flattened().iter().zip(self.hessian_feedforward.as_flattened());
        for (entry, (feedback, feedforward)) in self.hessian.as_flattened_mut().iter_mut().zip(parts) {
            *entry = (1.0 - alpha) * feedback + alpha * feedforward;
        }
        for (i, row) in self.hessian.iter_mut().enumerate() {
            if let Some(diagonal) = row.get_mut(i) {
                *diagonal += self.effort;
            }
        }
        match Cholesky::new(&self.hessian) {
            Some(factor) => {
                self.inverse = factor.inverse();
                true
            }
            None => {
                self.alpha = f64::NAN;
                false
            }
        }
    }

    fn blend(&mut self, alpha: f64) {
        self.alpha = alpha;
        let [feedback, feedforward, sum] = &mut self.weights;
        let parts = self.feedback.as_flattened().iter().zip(self.feedforward.as_flattened());
        let blended = feedback.as_flattened_mut().iter_mut().zip(feedforward.as_flattened_mut());
        for (((c, f), both), (gc, gf)) in blended.zip(sum.as_flattened_mut()).zip(parts) {
            *c = (1.0 - alpha) * gc;
            *f = alpha * gf;
            *both = *c + *f;
        }
    }

    /// α of the present weights.
    #[must_use]
    pub const fn alpha(&self) -> f64 {
        self.alpha
    }

    /// β, the weight of effort.
    #[must_use]
    pub const fn effort(&self) -> f64 {
        self.effort
    }

    /// H (N x N).
    #[must_use]
    pub const fn hessian(&self) -> &Square<N> {
        &self.hessian
    }

    /// H⁻¹ (N x N): the constant gains from −q to the unconstrained optimum.
    #[must_use]
    pub const fn inverse(&self) -> &Square<N> {
        &self.inverse
    }

    /// (1−α)G_c² x_c + αG_f² g, for `held` x_c and `references` g at steps 1 to N in normalised units.
    #[must_use]
    pub fn pull(&self, held: &AxisVector, references: impl Iterator<Item = AxisVector>) -> Weights<N> {
        let (feedback, feedforward) = self.blended();
        let mut pull = [[0.0; N]; 3];
        let [on_acceleration, on_velocity, on_position] = &mut pull;
        let [held_position, held_velocity, held_acceleration] = *held;
        let [ca, cv, cp] = feedback;
        let held = ca.iter().zip(cv).zip(cp);
        let to = on_acceleration.iter_mut().zip(on_velocity).zip(on_position);
        for (((a, v), p), ((ca, cv), cp)) in to.zip(held) {
            (*a, *v, *p) = (ca * held_acceleration, cv * held_velocity, cp * held_position);
        }
        // A predictor at zero trust must have no effect on Hold.
        if self.alpha > 0.0 {
            let [on_acceleration, on_velocity, on_position] = &mut pull;
            let [fa, fv, fp] = feedforward;
            let weights = fa.iter().zip(fv).zip(fp);
            let to = on_acceleration.iter_mut().zip(on_velocity).zip(on_position);
            for ((((a, v), p), ((fa, fv), fp)), [position, velocity, acceleration]) in
                to.zip(weights).zip(references)
            {
                *a += fa * acceleration;
                *v += fv * velocity;
                *p += fp * position;
            }
        }
        pull
    }

    /// (1−α)G_c² and αG_f², both in the order acceleration, velocity, position.
    #[must_use]
    pub const fn blended(&self) -> (&Weights<N>, &Weights<N>) {
        let [feedback, feedforward, _] = &self.weights;
        (feedback, feedforward)
    }

    /// The servo behind which errors count.
    #[must_use]
    pub(super) const fn behind(&self) -> Option<&Behind> {
        self.behind.as_ref()
    }

    /// ∇½J at `motion` from `start` with the arm at `arm`, given `pull` = (1−α)G_c² x_c + αG_f² g per
    /// quantity and step, plus C̃ᵀ `multipliers`.
    #[must_use]
    #[inline]
    pub(super) fn gradient(
        &self,
        (start, arm): (&AxisVector, ArmState<f64>),
        motion: &MotionRows<N>,
        pull: &Weights<N>,
        multipliers: &MotionRows<N>,
    ) -> [f64; N] {
        let [jerk, states @ ..] = motion;
        let [_, _, weights] = &self.weights;
        let mut force = *multipliers;
        let [on_jerk, on_states @ ..] = &mut force;
        for (to, u) in on_jerk.iter_mut().zip(jerk) {
            *to += self.effort * u;
        }
        let Some(behind) = &self.behind else {
            let errors = weights.as_flattened().iter().zip(states.as_flattened()).zip(pull.as_flattened());
            for (to, ((weight, x), pull)) in on_states.as_flattened_mut().iter_mut().zip(errors) {
                *to += weight * x - pull;
            }
            return adjoint(&force);
        };
        let mut seen = behind.along(start, arm, motion);
        let errors = weights.as_flattened().iter().zip(pull.as_flattened());
        for (entry, (weight, pull)) in seen.as_flattened_mut().iter_mut().zip(errors) {
            *entry = weight * *entry - pull;
        }
        behind.along_transposed(&seen, &mut force);
        adjoint(&force)
    }

    /// H⁻¹ v, by the factor of H.
    #[must_use]
    #[inline]
    pub fn solve(&self, v: &[f64; N]) -> [f64; N] {
        let mut out = [0.0; N];
        for (row, factor) in self.inverse.iter().zip(v) {
            for (to, entry) in out.iter_mut().zip(row) {
                *to += factor * entry;
            }
        }
        out
    }
}

fn squared<const N: usize>(gains: &Gains) -> Weights<N> {
    let mut weights = [[0.0; N]; 3];
    for (row, gain) in weights.iter_mut().zip([gains.acceleration, gains.velocity, gains.position]) {
        let mut step = gain;
        for weight in row {
            *weight = step * step;
            step *= gains.decay;
        }
    }
    weights
}

/// B̃ᵀ W B̃, B̃ per quantity.
fn hessian<const N: usize>(responses: &[Square<N>; 3], weights: &Weights<N>) -> Square<N> {
    let mut sum = [[0.0; N]; N];
    // `responses` are stored position first, the weights acceleration first.
    for (response, weights) in responses.iter().zip(weights.iter().rev()) {
        for (row, weight) in response.iter().zip(weights) {
            for (to, left) in sum.iter_mut().zip(row) {
                for (to, right) in to.iter_mut().zip(row) {
                    *to += weight * left * right;
                }
            }
        }
    }
    sum
}
