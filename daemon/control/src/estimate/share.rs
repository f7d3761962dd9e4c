//! Share: how far of its way a preview is followed, per lead.
//!
//! s_j = min(1, β_j + doubt · σ_j), with β_j the slope of the regression of the pen's real displacement since
//! its newest sample on the predicted one, and σ_j its standard deviation: a predictor that overshoots at
//! lead 12 is shortened there and used fully at lead 2.

use crate::state::state;

/// Sums of the regression at one lead, with forgetting \[normalised²\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Slope {
    /// ⟨real displacement, real⟩, ⟨real, predicted⟩ and ⟨predicted, predicted⟩.
    real: f64,
    along: f64,
    way: f64,
    cases: f64,
}

state! { [] Slope { real, along, way, cases } }

impl Slope {
    /// Adds a case: the pen moved by `real`, `predicted` was that \[normalised\].
    pub(super) fn add(&mut self, [rx, ry]: [f64; 2], [px, py]: [f64; 2], forgetting: f64) {
        let Self { real, along, way, cases } = self;
        let case = [rx * rx + ry * ry, rx * px + ry * py, px * px + py * py, 1.0];
        for (sum, value) in [real, along, way, cases].into_iter().zip(case) {
            *sum = forgetting * *sum + value;
        }
    }

    /// s, of a lead `ahead` steps ahead.
    pub(super) fn share(&self, ahead: f64, doubt: f64) -> f64 {
        if !(self.way > 0.0) {
            return 1.0;
        }
        let slope = self.along / self.way;
        // Errors at far leads are correlated from step to step.
        let independent = 2.0 * self.cases / ahead;
        let deviation = ((self.real / self.way - slope * slope).max(0.0) / independent).sqrt();
        (slope + doubt * deviation).clamp(0.0, 1.0)
    }
}
