//! One joint's expectation: which torque it needs for a motion in free space, learned there.
//!
//!   y = θ · x,   x = (torque of the links, torque of one more kilogram, way of motion, speed, 1)
//!
//! that is gain, unknown payload, Coulomb and viscous friction, and offset. Weighted recursive least squares
//! from a prior (Bayesian linear regression); old evidence fades by time of motion, never below the prior.
//! *Source*: Ljung 1999, *System Identification*, section 11.2; bounded covariance against wind-up.

use nalgebra::{SMatrix, SVector};

use crate::state::state;

/// Terms of the expectation.
pub(super) const TERMS: usize = 5;
/// What one joint's torque depends on.
pub(super) type Terms = SVector<f64, TERMS>;

/// Weights and their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TorqueFit {
    weights: Terms,
    covariance: SMatrix<f64, TERMS, TERMS>,
}

state! { whole [] TorqueFit { weights, covariance } }

impl TorqueFit {
    /// The prior: the torque of the links alone, each weight with a standard deviation of `spread`.
    pub(super) fn prior(spread: &Terms) -> Self {
        let mut weights = Terms::zeros();
        weights.x = 1.0;
        Self { weights, covariance: SMatrix::from_diagonal(&spread.component_mul(spread)) }
    }

    /// The torque that is expected \[Nm\].
    pub(super) fn expected(&self, terms: &Terms) -> f64 {
        self.weights.dot(terms)
    }

    /// Standard deviation of that, as far as the weights are uncertain \[Nm\].
    pub(super) fn uncertain(&self, terms: &Terms) -> f64 {
        terms.dot(&(self.covariance * terms)).max(0.0).sqrt()
    }

    /// The gain, within a factor of five.
    pub(super) fn gain(&self) -> f64 {
        self.weights.x.clamp(0.2, 5.0)
    }

    /// Coulomb friction \[Nm\].
    pub(super) fn friction(&self) -> f64 {
        self.weights.z.abs()
    }

    /// Takes in that the torque was `observed` \[Nm\], with a standard deviation of `noise` \[Nm\]. Evidence
    /// fades by the factor `kept` first.
    pub(super) fn learn(&mut self, terms: &Terms, observed: f64, noise: f64, kept: f64, spread: &Terms) {
        let faded = self.covariance / kept;
        let within = faded.diagonal().iter().zip(spread).all(|(faded, own)| *faded <= own * own);
        let covariance = if within { faded } else { self.covariance };
        let direction = covariance * terms;
        let scale = noise * noise + terms.dot(&direction);
        if !(scale.is_finite() && scale > 0.0 && observed.is_finite()) {
            return;
        }
        let gain = direction / scale;
        let weights = self.weights + gain * (observed - self.expected(terms));
        let next = covariance - gain * direction.transpose();
        if weights.iter().chain(next.iter()).all(|number| number.is_finite()) {
            // Rounding must not make it lopsided.
            (self.weights, self.covariance) = (weights, (next + next.transpose()) * 0.5);
        }
    }
}
