//! The models that learn online under the clock: as predictors, and learning.
//!
//! Contract: a learner's row costs one `learn`: the prediction before the displacement is seen, the update, the memory.
//! The DyBM is that of the reference tables (delay 2, decay 0.5, AdaGrad 0.1) and starts at zero; time does not depend on
//! what was learned.

use std::sync::Arc;

use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::models::esn::{ReadoutRule, Reservoir, ReservoirSettings};
use foretrace_control::predict::{
    ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights, Dybm, DybmEsn, DybmEsnLearner, DybmEsnSettings,
    DybmLearner, DybmSettings, DybmWeights, Mixture, Models, OnlineModel, Optimiser, Predictor, Taught,
    WeightsError,
};

use super::predictors::Candidate;

/// Learns from what it observes.
struct Learning<M>(M);

impl<M: OnlineModel> Predictor for Learning<M> {
    fn observe(&mut self, x: [f64; 2]) {
        std::hint::black_box(self.0.learn(x));
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        if !out.is_empty() {
            self.0.preview_from(self.0.parameters(), self.0.memory(), limit, out);
        }
    }

    fn reset(&mut self) {
        self.0.reset_state();
    }
}

/// One row each for predicting 10 steps and for learning.
pub(super) fn candidates(step_ns: u64) -> Result<Vec<Candidate>, WeightsError> {
    let shape = DybmShape::new(2, &[0.5], TraceInput::Newest);
    let optimiser = Optimiser::ada_grad(0.1);
    let dybm = DybmSettings { shape, optimiser, l1: 0.0, l2: 0.0 };
    let dybm_weights = DybmWeights::zero(step_ns, shape);
    let reservoir = Arc::new(Reservoir::seeded(&ReservoirSettings::default())?);
    let esn = DybmEsnSettings { dybm, readout: optimiser, rule: ReadoutRule::SharedResidual };
    let esn = DybmEsnLearner::untrained(esn, dybm_weights, reservoir.clone())?;
    let ar_weights = ArRlsWeights::constant_velocity(step_ns);
    let ar_settings = ArRlsSettings::default();
    let predicting = |name, predictor| Candidate { name, steps: 10, predictor };
    let learning = |name, predictor| Candidate { name, steps: 0, predictor };
    Ok(vec![
        predicting("dybm", Box::new(Dybm::new(dybm_weights)?)),
        predicting("dybm-esn", Box::new(DybmEsn::new(*esn.parameters(), reservoir)?)),
        predicting("ar-rls", Box::new(ArRls::new(ar_weights, ar_settings.gate)?)),
        learning("dybm, learning", Box::new(Learning(DybmLearner::new(dybm, dybm_weights)?))),
        learning("dybm-esn, learning", Box::new(Learning(esn))),
        learning("ar-rls, learning", Box::new(Learning(ArRlsLearner::new(ar_settings, ar_weights)?))),
    ])
}

/// The mixture of the loop, predicting `leads` steps and learning.
pub(super) fn mixture(models: &Models, leads: usize) -> Result<[Candidate; 2], WeightsError> {
    let weights = models.initial_weights();
    Ok([
        Candidate {
            name: "mixture",
            steps: leads,
            predictor: Box::new(Mixture::predictor(models, &weights.mixture)?),
        },
        Candidate {
            name: "mixture, learning",
            steps: 0,
            predictor: Box::new(Learning(Mixture::learner(models, &weights.mixture)?)),
        },
    ])
}
