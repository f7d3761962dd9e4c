//! `DybmLearner`: one online gradient step per input (gradient *ascent* of the Gaussian log-likelihood).
//!
//! With d = x − μ: g_b = d, g_W[l] = f_l ⊗ d, g_V[k] = e_k ⊗ d, all with the parameters from before the step; L2 is
//! taken off the gradient (twice for W and b, once for V, as the reference does), L1 shrinks after the step.

use super::{DybmShape, DybmState, DybmWeights, Parameters, WeightsError};

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
        /// Step size.
        rate: f64,
        /// γ, 0.9.
        gamma: f64,
        /// δ, 1e-8.
        delta: f64,
    },
    /// Ordinary Adam; its step count is never reset.
    Adam {
        /// Step size.
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

    fn validate(&self) -> Result<(), WeightsError> {
        let within = |name, got: f64, min: f64, max: f64| {
            if min <= got && got <= max {
                Ok(())
            } else {
                Err(WeightsError::Optimiser { name, got, min, max })
            }
        };
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
}

/// Shape and learning rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmSettings {
    /// Size and time constants.
    pub shape: DybmShape,
    /// Learning rule.
    pub optimiser: Optimiser,
    /// Strength of the soft threshold after each step, in units of the step size.
    pub l1: f64,
    /// Strength of the pull to zero in each gradient.
    pub l2: f64,
}

impl DybmSettings {
    /// Checks every bound.
    ///
    /// *Errors*: the first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        self.shape.validate()?;
        self.optimiser.validate()?;
        for (name, got) in [("l1", self.l1), ("l2", self.l2)] {
            if !(0.0..=1.0).contains(&got) {
                return Err(WeightsError::Optimiser { name, got, min: 0.0, max: 1.0 });
            }
        }
        Ok(())
    }
}

/// Weights that learn, with their own memory and accumulators.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmLearner {
    settings: DybmSettings,
    weights: DybmWeights,
    state: DybmState,
    second: Parameters,
    first: Parameters,
    /// Adam's 1 − β^n and 1 − γ^n, kept as powers.
    beta_power: f64,
    gamma_power: f64,
}

impl DybmLearner {
    /// Starts from `weights` with empty memory and accumulators.
    ///
    /// *Errors*: invalid settings or weights, or weights of another shape.
    pub fn new(settings: DybmSettings, weights: DybmWeights) -> Result<Self, WeightsError> {
        settings.validate()?;
        weights.validate()?;
        if weights.shape != settings.shape {
            let (got_delay, loop_delay) = (weights.shape.delay, settings.shape.delay);
            return Err(WeightsError::Shape { got_delay, loop_delay });
        }
        Ok(Self {
            settings,
            weights,
            state: DybmState::default(),
            second: Parameters::ZERO,
            first: Parameters::ZERO,
            beta_power: 1.0,
            gamma_power: 1.0,
        })
    }

    /// Learns from one real normalised displacement, then remembers it; returns the prediction made before seeing it.
    pub fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let predicted = self.weights.predict(&self.state);
        self.update(difference(x, predicted));
        self.state.observe(&self.settings.shape, x);
        predicted
    }

    /// Remembers a displacement without learning from it.
    pub fn observe(&mut self, x: [f64; 2]) {
        self.state.observe(&self.settings.shape, x);
    }

    /// Forgets the history; weights and accumulators stay.
    pub fn reset_state(&mut self) {
        self.state = DybmState::default();
    }

    /// Replaces the weights by others of the same shape; accumulators and memory stay, so that learning goes on at the
    /// pace it had reached.
    pub fn continue_from(&mut self, weights: &DybmWeights) {
        self.weights = *weights;
    }

    /// Replaces the weights by others of the same shape and forgets the accumulators; memory stays.
    pub fn restart_from(&mut self, weights: &DybmWeights) {
        self.weights = *weights;
        (self.second, self.first) = (Parameters::ZERO, Parameters::ZERO);
        (self.beta_power, self.gamma_power) = (1.0, 1.0);
    }

    /// Present weights.
    #[must_use]
    pub fn weights(&self) -> &DybmWeights {
        &self.weights
    }

    /// Present memory.
    #[must_use]
    pub fn state(&self) -> &DybmState {
        &self.state
    }

    /// G, the running (sum of) squared gradients.
    #[must_use]
    pub fn second_moments(&self) -> &Parameters {
        &self.second
    }

    /// M, Adam's running mean of gradients; zero for the others.
    #[must_use]
    pub fn first_moments(&self) -> &Parameters {
        &self.first
    }

    fn update(&mut self, error: [f64; 2]) {
        let DybmSettings { shape, optimiser, l1, l2 } = self.settings;
        if let Optimiser::Adam { beta, gamma, .. } = optimiser {
            self.beta_power *= beta;
            self.gamma_power *= gamma;
        }
        let (beta_power, gamma_power) = (self.beta_power, self.gamma_power);
        let step = |theta: &mut f64, second: &mut f64, first: &mut f64, gradient: f64, decay: f64| {
            let g = gradient - decay * *theta;
            let (eta, moved) = match optimiser {
                Optimiser::AdaGrad { rate, delta } => {
                    *second += g * g;
                    let eta = rate / (second.sqrt() + delta);
                    (eta, eta * g)
                }
                Optimiser::RmsProp { rate, gamma, delta } => {
                    *second = gamma * *second + (1.0 - gamma) * g * g;
                    let eta = rate / (second.sqrt() + delta);
                    (eta, eta * g)
                }
                Optimiser::Adam { rate, beta, gamma, epsilon } => {
                    *first = beta * *first + (1.0 - beta) * g;
                    *second = gamma * *second + (1.0 - gamma) * g * g;
                    let eta = rate / ((*second / (1.0 - gamma_power)).sqrt() + epsilon);
                    (eta, eta * *first / (1.0 - beta_power))
                }
            };
            *theta += moved;
            if l1 > 0.0 {
                *theta = theta.signum() * (theta.abs() - l1 * eta).max(0.0);
            }
        };
        let Self { weights, state, second, first, .. } = self;
        let parameters = &mut weights.parameters;
        for (((theta, second), first), d) in
            parameters.bias.iter_mut().zip(&mut second.bias).zip(&mut first.bias).zip(error)
        {
            step(theta, second, first, d, 2.0 * l2);
        }
        let fifo = parameters.fifo.iter_mut().zip(&mut second.fifo).zip(&mut first.fifo).zip(&state.fifo);
        let traces =
            parameters.traces.iter_mut().zip(&mut second.traces).zip(&mut first.traces).zip(&state.traces);
        let fifo = fifo.take(shape.fifo_len()).map(|matrix| (matrix, 2.0 * l2));
        let traces = traces.take(shape.traces).map(|matrix| (matrix, l2));
        for ((((theta, second), first), input), decay) in fifo.chain(traces) {
            for (((theta, second), first), f) in theta.iter_mut().zip(second).zip(first).zip(input) {
                for (((theta, second), first), d) in theta.iter_mut().zip(second).zip(first).zip(error) {
                    step(theta, second, first, f * d, decay);
                }
            }
        }
    }
}

fn difference(x: [f64; 2], mean: [f64; 2]) -> [f64; 2] {
    let ([x, y], [mean_x, mean_y]) = (x, mean);
    [x - mean_x, y - mean_y]
}
