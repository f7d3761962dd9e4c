//! `Optimiser`: how a gradient becomes a step, elementwise (gradient *ascent*).
//!
//! The rule is chosen once per group of parameters; the loops inside have no branch and no call.

use crate::predict::online::WeightsError;

/// How a gradient becomes a step; `G` and `M` are running sums per parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Optimiser {
    /// G += g²; θ += rate/(√G + δ)·g.
    AdaGrad {
        /// Step of the first update.
        rate: f64,
        /// δ, 1e-6.
        delta: f64,
    },
    /// G = γG + (1−γ)g²; θ += rate/(√G + δ)·g.
    RmsProp {
        /// Step size of an update.
        rate: f64,
        /// γ, 0.9.
        gamma: f64,
        /// δ, 1e-8.
        delta: f64,
    },
    /// Ordinary Adam; its step count is never reset.
    Adam {
        /// Step size of an update.
        rate: f64,
        /// β of the mean, 0.9.
        beta: f64,
        /// γ of the square, 0.999.
        gamma: f64,
        /// ε, 1e-8.
        epsilon: f64,
    },
}

impl Optimiser {
    /// AdaGrad with the reference's δ.
    #[must_use]
    pub const fn ada_grad(rate: f64) -> Self {
        Self::AdaGrad { rate, delta: 1e-6 }
    }

    /// RMSProp with the reference's γ and δ.
    #[must_use]
    pub const fn rms_prop(rate: f64) -> Self {
        Self::RmsProp { rate, gamma: 0.9, delta: 1e-8 }
    }

    /// Adam with its usual β, γ and ε.
    #[must_use]
    pub const fn adam(rate: f64) -> Self {
        Self::Adam { rate, beta: 0.9, gamma: 0.999, epsilon: 1e-8 }
    }

    /// Checks every number.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        let within = |name, got, min, max| WeightsError::bounded("DyBM optimiser", name, got, min, max);
        match *self {
            Self::AdaGrad { rate, delta } => {
                within("rate", rate, 0.0, 10.0).and(within("delta", delta, 1e-12, 1.0))
            }
            Self::RmsProp { rate, gamma, delta } => within("rate", rate, 0.0, 10.0)
                .and(within("gamma", gamma, 0.0, 0.999_999))
                .and(within("delta", delta, 1e-12, 1.0)),
            Self::Adam { rate, beta, gamma, epsilon } => within("rate", rate, 0.0, 10.0)
                .and(within("beta", beta, 0.0, 0.999_999))
                .and(within("gamma", gamma, 0.0, 0.999_999))
                .and(within("epsilon", epsilon, 1e-12, 1.0)),
        }
    }

    /// Moves every θ of `group` along its gradient.
    #[inline]
    pub(crate) fn ascend(&self, powers: &Powers, pull: Pull, group: ParameterGroup<'_>) {
        match *self {
            Self::AdaGrad { rate, delta } => group.ascend(pull, |second, _, g| {
                *second += g * g;
                let eta = rate / (second.sqrt() + delta);
                (eta, eta * g)
            }),
            Self::RmsProp { rate, gamma, delta } => group.ascend(pull, |second, _, g| {
                *second = gamma * *second + (1.0 - gamma) * g * g;
                let eta = rate / (second.sqrt() + delta);
                (eta, eta * g)
            }),
            Self::Adam { rate, beta, gamma, epsilon } => group.ascend(pull, |second, first, g| {
                *first = beta * *first + (1.0 - beta) * g;
                *second = gamma * *second + (1.0 - gamma) * g * g;
                let eta = rate / ((*second / (1.0 - powers.gamma)).sqrt() + epsilon);
                (eta, eta * *first / (1.0 - powers.beta))
            }),
        }
    }
}

/// Adam's β^n and γ^n.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Powers {
    beta: f64,
    gamma: f64,
}

impl Powers {
    /// Before the first step.
    pub(crate) const START: Self = Self { beta: 1.0, gamma: 1.0 };

    #[inline]
    pub(crate) fn count(&mut self, optimiser: &Optimiser) {
        if let Optimiser::Adam { beta, gamma, .. } = *optimiser {
            self.beta *= beta;
            self.gamma *= gamma;
        }
    }
}

/// What pulls parameters to zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pull {
    /// Soft threshold after the step, in units of the step size.
    pub(crate) l1: f64,
    /// Taken off the gradient, times θ.
    pub(crate) l2: f64,
}

impl Pull {
    pub(crate) const NONE: Self = Self { l1: 0.0, l2: 0.0 };
}

/// Parameters of equal standing with their G, M and gradients; equally long.
pub(crate) struct ParameterGroup<'a> {
    pub(crate) theta: &'a mut [f64],
    pub(crate) second: &'a mut [f64],
    pub(crate) first: &'a mut [f64],
    pub(crate) gradient: &'a [f64],
}

impl ParameterGroup<'_> {
    /// `rule(G, M, g)` updates the sums and gives (step size, step).
    #[inline]
    fn ascend(self, pull: Pull, rule: impl Fn(&mut f64, &mut f64, f64) -> (f64, f64)) {
        let sums = self.second.iter_mut().zip(self.first);
        let each = self.theta.iter_mut().zip(sums).zip(self.gradient);
        if pull == Pull::NONE {
            for ((theta, (second, first)), gradient) in each {
                *theta += rule(second, first, *gradient).1;
            }
            return;
        }
        for ((theta, (second, first)), gradient) in each {
            let (eta, moved) = rule(second, first, gradient - pull.l2 * *theta);
            let stepped = *theta + moved;
            *theta = stepped.signum() * (stepped.abs() - pull.l1 * eta).max(0.0);
        }
    }
}
