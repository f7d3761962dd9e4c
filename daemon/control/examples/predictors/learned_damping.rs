//! Learned damping: x̂_k = ρ^k x, with ρ fitted to recent motion. Example of `docs/extend/predictor.md`.
//!
//! ρ = Σ x_t · x_{t−1} / Σ |x_{t−1}|², both sums forgetting: least squares with one coefficient.

use crate::pen::TARGET_RMS;
use crate::predict::online::{ModelParameters, OnlineModel, WeightsError, is_usable};
use crate::predict::{Entry, Models, OnlinePredictor, Pace, Predictor, shortened};
use crate::state::state;

pub(super) const ENTRY: Entry =
    Entry::taught::<LearnedDamping>("repeats the last velocity, damped as it recently was, learning online");

/// Forgetting factor per step.
const FORGETTING: f64 = 0.999;
/// Σ |x|² needed for an estimate: one step of usual length.
const LEAST: f64 = TARGET_RMS * TARGET_RMS;

/// Parameters: ρ and what it was made for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// Counts every change of the live parameters.
    pub version: u64,
    /// Δ \[ns\].
    pub step_ns: u64,
    /// ρ, 0 to 1.
    pub rho: f64,
}

state! { [] Damping { version, step_ns, rho } }

impl ModelParameters for Damping {
    const MODEL: &'static str = "learned damping";

    fn version(&self) -> u64 {
        self.version
    }

    fn with_version(self, version: u64) -> Self {
        Self { version, ..self }
    }

    fn step_ns(&self) -> u64 {
        self.step_ns
    }

    fn input_scale(&self) -> f64 {
        TARGET_RMS
    }

    fn validate(&self) -> Result<(), WeightsError> {
        WeightsError::bounded(Self::MODEL, "rho", self.rho, 0.0, 1.0)
    }

    fn accepts(&self, other: &Self) -> Result<(), WeightsError> {
        other.fits(self.step_ns)
    }
}

/// The predictor: parameters and memory.
#[derive(Debug, Clone)]
pub struct LearnedDamping {
    damping: Damping,
    last: [f64; 2],
}

state! { [] LearnedDamping { damping, last } }

impl Predictor for LearnedDamping {
    fn observe(&mut self, x: [f64; 2]) {
        self.last = if is_usable(x) { x } else { [0.0; 2] };
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        roll_out(&self.damping, self.last, limit, out);
    }

    fn reset(&mut self) {
        self.last = [0.0; 2];
    }
}

impl OnlinePredictor for LearnedDamping {
    const NAME: &'static str = "learned-damping";
    const PACE: Pace = Pace::Following;
    type Learner = DampingLearner;

    fn start(models: &Models) -> Damping {
        Damping { version: 0, step_ns: models.settings().step_ns, rho: 0.95 }
    }

    fn predictor(_models: &Models, damping: &Damping) -> Result<Self, WeightsError> {
        damping.validate()?;
        Ok(Self { damping: *damping, last: [0.0; 2] })
    }

    fn learner(_models: &Models, damping: &Damping) -> Result<DampingLearner, WeightsError> {
        damping.validate()?;
        Ok(DampingLearner { damping: *damping, last: [0.0; 2], products: 0.0, squares: 0.0 })
    }

    fn weights(&self) -> &Damping {
        &self.damping
    }

    fn set_weights(&mut self, damping: &Damping) -> Result<(), WeightsError> {
        damping.validate()?;
        self.damping.accepts(damping)?;
        self.damping = *damping;
        Ok(())
    }
}

/// The learner: parameters, memory and the two sums.
#[derive(Debug, Clone)]
pub struct DampingLearner {
    damping: Damping,
    last: [f64; 2],
    products: f64,
    squares: f64,
}

impl OnlineModel for DampingLearner {
    type Parameters = Damping;
    type Memory = [f64; 2];

    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let [px, py] = self.last;
        let predicted = [self.damping.rho * px, self.damping.rho * py];
        if is_usable(x) {
            let [dx, dy] = x;
            self.products = FORGETTING * self.products + dx * px + dy * py;
            self.squares = FORGETTING * self.squares + px * px + py * py;
            if self.squares > LEAST {
                self.damping.rho = (self.products / self.squares).clamp(0.0, 1.0);
            }
        }
        self.observe(x);
        predicted
    }

    fn observe(&mut self, x: [f64; 2]) {
        self.last = if is_usable(x) { x } else { [0.0; 2] };
    }

    fn reset_state(&mut self) {
        self.last = [0.0; 2];
    }

    fn parameters(&self) -> &Damping {
        &self.damping
    }

    fn memory(&self) -> &[f64; 2] {
        &self.last
    }

    fn continue_from(&mut self, damping: &Damping) -> Result<(), WeightsError> {
        damping.validate()?;
        self.damping.accepts(damping)?;
        self.damping = *damping;
        Ok(())
    }

    fn restart_from(&mut self, damping: &Damping) -> Result<(), WeightsError> {
        self.continue_from(damping)?;
        (self.products, self.squares) = (0.0, 0.0);
        Ok(())
    }

    fn preview_from(&self, damping: &Damping, last: &[f64; 2], limit: f64, out: &mut [[f64; 2]]) {
        roll_out(damping, *last, limit, out);
    }
}

fn roll_out(damping: &Damping, mut x: [f64; 2], limit: f64, out: &mut [[f64; 2]]) {
    for predicted in out {
        x = shortened(x.map(|x| damping.rho * x), limit);
        *predicted = x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::{Learner, LearnerSettings};
    use crate::pen::Motion;
    use crate::predict::{LearnStep, ModelSettings, Networks, Panel, PenStep, PredictorKind};

    #[test]
    fn what_the_learner_found_reaches_the_loop() {
        let models = Models::new(ModelSettings::preset(10_000_000), Networks::default()).unwrap();
        let mut learner = Learner::new(LearnerSettings::preset(10_000_000, 0), &models).unwrap();
        let mut panel = Panel::new(&models, learner.weights()).unwrap();
        let kind = PredictorKind::from_name("learned-damping").unwrap();
        assert!(kind.learns() && panel.offers(kind));
        // Strokes that slow down by a fifth per step.
        for index in 0..600_u32 {
            let x = [20.0 * 0.8_f64.powi((index % 12).cast_signed()), 3.0];
            let (motion, pen) = (Motion::Continues, PenStep { x, ..PenStep::default() });
            let step = LearnStep { index: index.into(), motion, pen, ..LearnStep::default() };
            if learner.learn(&step).hand_over {
                panel.set_weights(learner.weights()).unwrap();
            }
            panel.observe(&PenStep::of(x));
        }
        let learned = learner.weights().learned_damping;
        assert!(learned.version > 0 && learner.counters_of(kind).promotions > 0, "{learned:?}");
        assert!((0.6..0.95).contains(&learned.rho), "{learned:?}");
        let mut next = [[0.0; 2]];
        panel.forget();
        panel.observe(&PenStep::of([10.0, 0.0]));
        panel.roll_out(kind, f64::INFINITY, 1.0, [0.0; 2], &mut next);
        assert_eq!(next, [[10.0 * learned.rho, 0.0]]);
    }
}
